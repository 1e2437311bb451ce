"""The raw sweeps that the viewer of the HTML report shows: from the logs, or from the beams tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import LogBatcher, ReadOptions
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, batches
from lidarcli.pipeline.reading.one_log import opening_of, rules_of
from lidarcli.reports.columns import Origin, Run, same_recording
from lidarcli.reports.html import Choice, choose_sweeps, pack, pack_map
from lidarcli.reports.map_picture import overview
from lidarcli.reports.report import Page
from lidarcli.reports.summary import Summary
from lidarcli.reports.world import Raw, map_of, walls_of
from lidarcli.sweeps.range_rules import closure
from lidarcli.sweeps.types import Float64, Int64, SweepBatch
from lidarcli.tabular.reading import Readable

BEAM_COLUMNS = ["topic", "sweep", "beam", "theta", "r"]
MAX_CELLS = 50_000_000
"""Most cells (sweeps times beams) of a beams table that are shown."""


def page_of(
    run: Run, summary: Summary, pairs: Sequence[TableSet], logs: Sequence[str], join: bool, command: str
) -> tuple[Page, list[str]]:
    """Return the contents of the HTML alone, and a line for each beams table that cannot be read.

    `command` makes the page again.
    """
    choice = choose_sweeps(run, summary)
    wanted = _wanted(run, summary, choice)
    origins = _match(run.sources, logs, join)
    raw: dict[tuple[int, str], Raw] = {}
    problems = []
    for source, topics in wanted.items():
        if source in origins:
            raw |= _from_log(source, origins[source], run.sources[source], topics)
        elif pairs[source].beams.exists():
            try:
                raw |= _from_beams(source, pairs[source], topics)
            except UnreadableError as err:
                problems.append(str(err))
    data = {**pack(run, summary, choice, raw), "note": choice.note}
    grid = map_of(run, raw)
    if grid is not None:
        data["map"] = pack_map(grid)
    # Every log has a world of its own.
    above = overview(run.sweeps, run.tracks, run.trajectories) if len(run.sources) == 1 else None
    return Page(data, above, walls_of(run, raw), grid, command), problems


def _wanted(run: Run, summary: Summary, choice: Choice) -> dict[int, dict[str, Int64]]:
    """Return by source and topic the sorted indices of the sweeps to show."""
    index = run.sweeps.integers("sweep")
    found: dict[int, dict[str, Int64]] = {}
    for stream, rows in zip(summary.streams.all, choice.rows, strict=False):
        topics = found.setdefault(stream.source, {})
        topics[stream.topic] = np.union1d(topics.get(stream.topic, np.empty(0, np.int64)), index[rows])
    return found


def _match(sources: Sequence[Origin], logs: Sequence[str], join: bool) -> dict[int, Source]:
    """Return the log of each pair of tables: by name, or because there is only one of each."""
    found: dict[int, Source] = {}
    # Parts are found together, or not at all.
    groups = [logs] if join and logs else [[named] for named in logs]
    for named in groups:
        logs_found = find_logs(named, join)
        own: dict[int, Source] = {}
        for log in logs_found:
            if isinstance(log, MissingInput):
                raise UnreadableError(f"{log.path}: {log.error}")
            names = [source.log for source in sources]
            own |= {k: log for k, name in enumerate(names) if log.name in (name, name.split("/")[-1])}
        if not own and len(logs_found) == len(groups) == len(sources) == 1 and isinstance(logs_found[0], Source):
            own = {0: logs_found[0]}
        # A folder may hold other logs, too.
        if not own:
            raise OptionError(f"--log {', '.join(named)}: none of the tables is of this log")
        found |= own
    return found


def _joined(parts: Sequence[SweepBatch]) -> Raw:
    """Return all sweeps of a topic in one, sorted."""
    width = max(part.ranges.shape[1] for part in parts)
    ranges = np.full((sum(map(len, parts)), width), np.nan)
    rows = np.cumsum([0, *map(len, parts)])
    for first, part in zip(rows, parts, strict=False):
        ranges[first : first + len(part), : part.ranges.shape[1]] = part.ranges
    raw = Raw._make([*(np.concatenate([getattr(part, name) for part in parts]) for name in Raw._fields[:-1]), ranges])
    return raw.rows(np.argsort(raw.sweep, kind="stable"))


def _from_log(number: int, log: Source, source: Origin, topics: dict[str, Int64]) -> dict[tuple[int, str], Raw]:
    """Read the ranges as `detect` did, by the parameters in the tables."""
    parts: dict[str, list[SweepBatch]] = {}
    with open_source(log, opening_of(source.parameters)) as opened:
        options = ReadOptions(topics=frozenset(topics), rules=rules_of(source.parameters, source.mask))
        batcher = LogBatcher(opened, options, ReadReport())
        for batch in batcher.batches():
            rows = np.flatnonzero(np.isin(batch.sweep, topics.get(batch.topic, [])))
            if len(rows):
                parts.setdefault(batch.topic, []).append(batch.rows(rows))
        if same_recording(batcher.recording(), source.recording) is False:
            raise UnreadableError(f"--log {log.label}: of another recording than {source.label}")
    return {(number, topic): _joined(found) for topic, found in parts.items()}


def _from_beams(number: int, pair: TableSet, topics: dict[str, Int64]) -> dict[tuple[int, str], Raw]:
    parts: dict[str, list[tuple[Int64, Int64, Float64, Float64]]] = {}
    for rows in batches(pair, BEAM_COLUMNS):
        names = rows["topic"].dictionary.to_pylist()
        code = rows["topic"].indices.to_numpy()
        columns = [
            rows[name].to_numpy(zero_copy_only=False).astype(kind)
            for name, kind in (("sweep", np.int64), ("beam", np.int64), ("theta", float), ("r", float))
        ]
        for topic, wanted in topics.items():
            if topic in names:
                chosen = (code == names.index(topic)) & np.isin(columns[0], wanted)
                sweep, beam, theta, r = (column[chosen] for column in columns)
                parts.setdefault(topic, []).append((sweep, beam, theta, r))
    found = {}
    for topic, pieces in parts.items():
        sweep, beam, theta, r = (np.concatenate(column) for column in zip(*pieces, strict=True))
        if len(sweep):
            found[number, topic] = _table(pair.beams, sweep, beam, theta, r)
    return found


def _table(path: Readable, sweep: Int64, beam: Int64, theta: Float64, r: Float64) -> Raw:
    """Turn rows of the beams table into one row per sweep."""
    indices, row, beams = np.unique(sweep, return_inverse=True, return_counts=True)
    width = int(beam.max()) + 1
    if width * len(indices) > MAX_CELLS:
        raise UnreadableError(
            f"{path}: column beam holds {width - 1:,}: {len(indices):,} sweeps of so many beams are too many to show"
        )
    ranges = np.full((len(indices), width), np.nan)
    ranges[row, beam] = r
    bearings = np.full_like(ranges, np.nan)
    bearings[row, beam] = theta
    # From the first beam to the last: in single precision a bearing is as exact as a step, not a step of two.
    last = np.zeros(len(indices), np.int64)
    np.maximum.at(last, row, beam)
    ends = bearings[np.arange(len(indices)), last]
    increment = np.nan_to_num((ends - bearings[:, 0]) / np.maximum(last, 1))
    kind = closure(beams.astype(np.int32), increment)
    return Raw(indices, bearings[:, 0], increment, kind, beams.astype(np.int64), ranges)
