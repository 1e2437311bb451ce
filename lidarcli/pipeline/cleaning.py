"""A log without what moves in it: the same messages, but for beams that say nothing."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.choices import ABOVE, INF, KEEP, MATCH, NAN
from lidarcli.copying import MCAP, ROS1, ROS2, Copy, copy_log, replaced
from lidarcli.display import counted
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.tracking.tracker import share_moving
from lidarcli.logs.base import CLOUD_TYPES, SCAN_TYPES, Log, ReadReport
from lidarcli.logs.blocks import Locate
from lidarcli.logs.clock import LEAP
from lidarcli.logs.options import TopicChoice
from lidarcli.newfiles import NewFiles, refuse, refuse_nameless, writing
from lidarcli.pipeline.cleaned_beams import REASONS, Choice, Chosen, choose, doubted
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.search import SUFFIXES
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, world_in
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, damage_lines, rules_of
from lidarcli.pipeline.reading.pose_sources import NO_POSES, NONE, Need
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.range_rules import RangeRules
from lidarcli.stores import Place, Url
from lidarcli.tabular.columns import constant, held, restamped
from lidarcli.tabular.reading import file_metadata, note_value, read_columns
from lidarcli.tabular.schemas import CLEANED, SCHEMAS
from lidarcli.tabular.writing import PARAMETERS, SOURCE, ParquetSink, table_metadata, table_suffix
from lidarcli.times import SECOND_NS

FREEING = "inf says that nothing is there: costmaps with inf_is_valid free beams beyond walls"
ZERO = "0 becomes range_max in AMCL and gmapping: beams free what is beyond walls"
WALLS = "{:g} m is a range that the sensor can measure: programs take it for a wall"
_UNMATCHED = "no poses, and the path cannot be matched"
MOST_PLACED = 0.5
"""A sensor is placed if poses tell where it was at this share of its sweeps."""
MOSTLY = 0.9
"""A sensor stood if it did so at this share of its sweeps."""
POINTS = "sensor_msgs/msg/PointCloud"


@dataclass(frozen=True, slots=True)
class CleanOptions:
    """Options of `clean`, apart from input and output."""

    detect: DetectOptions
    """Options of reading, detection and tracking; its mask tells the robot itself."""
    remove: frozenset[str] = frozenset({"agents"})
    """Kinds of beams that are removed beside those under a mask: of agents and temporary."""
    value: str | float = NAN
    """Value of removed beams: one of `SAYINGS`, or a range [m]."""
    margin: int = 1
    """Beams beside them that are removed, too."""
    overwrite: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the table's metadata."""
        told = {"remove": sorted(self.remove), "value": self.value, "margin": self.margin}
        return self.detect.as_dict() | told


@dataclass(slots=True)
class CleanSummary(RunSummary):
    """The counts of one run over one log, and its lines for people."""

    table: pa.Table = field(default_factory=CLEANED.empty_table)
    """One row per sweep."""
    line: str = ""
    """Values of beams in the copy, and their reasons."""
    copied: str = ""
    """Number of messages that were copied."""
    removed: dict[str, int] = field(default_factory=dict)
    """Reason that was asked for → beams that say something else in the copy."""

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values."""
        return {**RunSummary.as_dict(self), "removed": self.removed}


def clean_log(source: Source, path: Place, options: CleanOptions, progress: Progress | None = None) -> CleanSummary:
    """Write a log without what moves in it, and beside it the table of what was left out.

    Raises
    ------
    OptionError
        The log is none that can be cleaned, or the output is another container, or the input.
    UnreadableError
        The log cannot be read, or it is not known how its sensor moved.
    NoScanError
        The log has no LaserScan topic, or not the one that was asked for.
    OutputError
        A file cannot be written.
    """
    with ExitStack() as stack:
        _refuse_names(source, path)
        # Messages are copied one by one, so they are read as they are.
        log = stack.enter_context(open_source(source, replace(options.detect.opening, segments=KEEP)))
        _refuse(log, source, path, options)
        outputs = (path, _table_path(path))
        new = stack.enter_context(NewFiles(outputs, options.overwrite, _bag(log, source, path)))
        private = new.part(path).with_name(f"{path.name}.tables")
        pair, found = detect_to_temporary(source, private, options.detect, progress)
        notes = file_metadata(pair.sweeps)
        described = note_value(notes, SOURCE, dict)
        if joined := described.get("segments"):
            raise OptionError(
                f"{source.path}: messages of {joined[0]} are segments of a turn, which clean cannot write back; "
                f"--segments {KEEP} cleans each alone"
            )
        mask = described.get("mask")
        rules = rules_of(note_value(notes, PARAMETERS, dict), mask if isinstance(mask, dict) else None)
        blind = _blind(pair)
        _refuse_motion(log, pair, described, options, rules, blind)
        detect = options.detect
        choice = Choice(detect.read.topics, rules, detect.poses, options.remove, options.margin)
        chosen = choose(log, pair, choice, second_half(progress, source.size))
        editing = _Editing(chosen, options.value)
        copy = Copy(editing, ReadReport())
        with writing(path):
            copy_log(log, new.part(path), copy)
        editing.conclude()
        summary = _summary(source, found, options, chosen, copy, editing)
        summary.notes += [f"no beam of {topic} has a range: nothing moves there" for topic in sorted(blind)]
        summary.notes += doubted(pair) if "agents" in options.remove else []
        metadata = table_metadata(options.as_dict(), described, summary.damage)
        table = restamped(_table(source.name, chosen), options.detect.stamps)
        summary.table = table.replace_schema_metadata(metadata)
        with ParquetSink(new.part(outputs[1]), table.schema, outputs[1]) as sink:
            for rows in summary.table.to_batches():
                sink.write(rows)
            sink.finish(metadata)
        summary.notes += new.publish()
        summary.outputs = [str(each) for each in outputs]
    return summary


def _table_path(path: Place) -> Place:
    """Return the path of the table beside a log."""
    return path.with_name(f"{_stem(path)}{table_suffix('cleaned')}")


def _stem(path: Place) -> str:
    """Return the name of a log without the suffixes of its container."""
    stem = path.name
    for suffix in (".zstd", ".mcap", ".bag", ".db3"):
        if stem.lower().endswith(suffix):
            stem = stem[: -len(suffix)]
    return stem


def _refuse_names(source: Source, path: Place) -> None:
    """Refuse names that cannot be those of a log and its copy."""
    if source.is_stdin:
        raise OptionError("a log is cleaned by reading it twice; give the name of its file instead of -")
    if str(path) == "-":
        raise OptionError("a log is no text for standard output; give the name of a file")
    refuse_nameless(path)
    if isinstance(path, Url):
        same = str(path) == source.path
    else:
        original = Path(source.path)
        same = original.is_dir() and original.resolve() in path.resolve().parents
        with suppress(OSError):
            same |= path.samefile(original)
    if same:
        raise OptionError(f"{path} is the log that is read; write elsewhere with -o")


def _refuse(log: Log, source: Source, path: Place, options: CleanOptions) -> None:
    """Refuse logs that cannot be cleaned, and outputs that cannot be written, before any work."""
    if not log.format.startswith((MCAP, ROS1, ROS2)) or source.parts:
        raise OptionError(f"{source.path}: only MCAP and ROS bags can be cleaned")
    wanted = _suffix(log, source)
    name = path.name.lower()
    fits = name.endswith(wanted) if wanted else not name.endswith(SUFFIXES)
    if not fits and not wanted:
        raise OptionError(
            f"{path}: {source.path} is a ROS 2 bag folder, and clean changes no container: name a folder, e.g. "
            f"-o {path.with_name(_stem(path))}"
        )
    if not fits:
        raise OptionError(f"{path}: a copy of {source.path} has to have the suffix {wanted}; clean changes no container")
    if not wanted and isinstance(path, Url):
        raise OptionError(f"{path}: the folder of a ROS 2 bag is not written into a store")
    topics = log.topics()
    chosen = frozenset(TopicChoice(options.detect.read.topics, topics).chosen)
    for topic in topics or ():
        if topic.name in chosen and topic.encoding == "json":
            raise OptionError(f"{source.path}: {topic.name} is in JSON, which has no NaN, and cannot be cleaned")
        if topic.name in chosen and topic.encoding == "protobuf" and options.value == ABOVE:
            raise OptionError(f"--value above: {topic.name} is a {topic.type}, which tells no range_max")
    outputs = (path, _table_path(path))
    refuse(outputs, options.overwrite, options.detect.inputs([source]), _bag(log, source, path))


def _bag(log: Log, source: Source, path: Place) -> Place | None:
    """Return the path of a copy that is a folder."""
    return None if _suffix(log, source) else path


def _suffix(log: Log, source: Source) -> str:
    """Return the suffix of a copy; empty for a folder."""
    if log.format.startswith(MCAP):
        return ".mcap"
    if log.format.startswith(ROS1):
        return ".bag"
    if Path(source.path).is_dir():
        return ""
    return ".db3.zstd" if log.compression == "zstd" and source.path.endswith(".zstd") else ".db3"


def _blind(pair: TableSet) -> set[str]:
    """Return the topics of which no beam has a range."""
    rows = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "valid"))
    topics, valid = np.array(rows["topic"].to_pylist(), np.str_), held(rows["valid"])[0]
    return {name for name in np.unique(topics).tolist() if not valid[topics == name].any()}


def _refuse_motion(
    log: Log, pair: TableSet, described: dict[str, Any], options: CleanOptions, rules: RangeRules, blind: Collection[str]
) -> None:
    """Refuse a log if it is not known where its sensor was while it moved: what stands would be taken for agents.

    In topics of which no beam has a range (`blind`) nothing can be taken for anything.
    """
    for frame, told in described.get("poses", {}).items():
        for topic, verdict in told.get("pose_verdict", {}).items():
            if verdict == "rejected" and world_in(told, topic) not in ("", MATCH):
                raise UnreadableError(
                    f"the poses of {frame or 'the sensor'} contradict the sweeps of {topic}; nothing written; "
                    "give other poses (--pose TOPIC, --poses FILE)"
                )
    rows = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "pose_x"))
    topics, known = np.array(rows["topic"].to_pylist(), np.str_), held(rows["pose_x"])[1]
    seeing = [name for name in np.unique(topics).tolist() if name not in blind]
    unplaced = [name for name in seeing if known[topics == name].mean() < MOST_PLACED]
    if not unplaced:
        return
    detect = options.detect
    choice = TopicChoice(detect.read.topics, log.topics())
    paths = Posing.of(log, NO_POSES, choice, rules, need=Need.MOVING).paths
    tracks = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], ("topic", "set", "sweeps")).to_pylist()
    for topic in unplaced:
        looks = [path for (name, _), path in paths.items() if name == topic]
        stood = bool(looks) and all(len(path.still) and path.still.mean() >= MOSTLY for path in looks)
        drove = any(not len(path.still) for path in looks)
        mine = [row for row in tracks if row["topic"] == topic]
        share = share_moving([row["sweeps"] for row in mine], [row["set"] == "A" for row in mine])
        if stood or not (drove or share is not None):
            continue
        seems = "the sensor moves" if share is None else f"{share:.0%} of what stands seems to move"
        why = "no poses (--pose none)" if detect.poses.source == NONE else _UNMATCHED
        raise UnreadableError(f"{why}: {seems}; nothing written")


class _Editing:
    """Replaces the chosen beams of messages, which come in the order of their topics."""

    def __init__(self, chosen: dict[str, Chosen], value: str | float) -> None:
        self._chosen, self._value = chosen, value
        self._done = dict.fromkeys(chosen, 0)
        self.is_measurable = False
        """True where a message says a range that is within its limits."""

    def __call__(self, topic: str, data: bytes, locate: Locate) -> bytes:
        """Return the message to write, as `copies.Edit`."""
        mine = self._chosen.get(topic)
        written = None if mine is None else locate(data)
        if mine is None or written is None:
            return data
        sweep = mine.sweep(self._done[topic])
        self._done[topic] += 1
        same = sweep is not None and written.beams == sweep.beams
        # A stamp that is farther off has been mended.
        if (
            sweep is None
            or not same
            or (written.stamp_ns and 0 < abs(written.stamp_ns - sweep.stamp_ns) < LEAP * SECOND_NS)
        ):
            raise _changed(topic)
        if not len(sweep.chosen):
            return data
        chosen = np.zeros(written.beams, np.bool_)
        chosen[sweep.chosen] = True
        number = self._number(topic, written.range_max)
        self.is_measurable |= written.range_min <= number <= written.range_max
        return replaced(data, written, chosen, number)

    def conclude(self) -> None:
        """Refuse a copy that lacks sweeps."""
        for topic, count in self._done.items():
            if count != len(self._chosen[topic]):
                raise _changed(topic)

    def _number(self, topic: str, range_max: float) -> float:
        if self._value != ABOVE:
            return float(self._value)
        if not math.isfinite(range_max):
            raise OptionError(f"--value above: the range_max of {topic} is {range_max}")
        return range_max + 1.0


def _changed(topic: str) -> UnreadableError:
    return UnreadableError(f"the sweeps of {topic} are not those that were read before: does the log still grow?")


def _summary(
    source: Source, found: RunSummary, options: CleanOptions, chosen: dict[str, Chosen], copy: Copy, editing: _Editing
) -> CleanSummary:
    summary = CleanSummary(sweeps=sum(map(len, chosen.values())), topics=set(chosen))
    summary.missing_topics = found.missing_topics
    summary.damage = [*dict.fromkeys([*found.damage, *damage_lines(copy.report)])]
    summary.notes = [*found.notes]
    beams = sum(int(each.beams[0].sum()) for each in chosen.values())
    totals = sum((each.counts[0].sum(axis=0) for each in chosen.values()), np.zeros(4, np.int64))
    removed = int(totals.sum())
    summary.by_status = found.by_status
    by_mask = ["body"] if options.detect.read.rules.masks else []
    asked = [*options.remove, *by_mask, *(["margin"] if options.margin else [])]
    summary.removed = {reason: int(count) for reason, count in zip(REASONS, totals, strict=True) if reason in asked}
    parts = ", ".join(f"{reason} {count:,}" for reason, count in summary.removed.items())
    share = f" ({removed / beams:.1%})" if beams else ""
    say = f"say {_words(options.value)}: {parts}"
    summary.line = f"{counted(summary.sweeps, 'sweep')}; {removed:,} of {beams:,} beams{share} {say}"
    alike = [
        f"{topic} ({kind.rsplit('/', 1)[-1].rsplit('.', 1)[-1]})"
        for topic, kind in sorted(copy.messages)
        if kind in {*CLOUD_TYPES, POINTS} or (kind in SCAN_TYPES and topic not in chosen)
    ]
    topics = len({topic for topic, _ in copy.messages})
    shows = f"; {', '.join(alike)} may show the same" if alike else ""
    summary.copied = f"{counted(copy.messages.total(), 'message')} of {counted(topics, 'topic')}{shows}"
    if options.value == INF:
        summary.notes.append(FREEING)
    elif options.value == 0:
        summary.notes.append(ZERO)
    elif editing.is_measurable:
        summary.notes.append(WALLS.format(options.value))
    if copy.left_out:
        summary.notes.append(f"{counted(copy.left_out, 'record')} of applications are not copied")
    return summary


def _words(value: str | float) -> str:
    """Return what beams say, for people."""
    named = {NAN: "NaN", INF: "inf", ABOVE: "range_max + 1"}
    return named[value] if isinstance(value, str) else f"{value:g} m"


def _table(log: str, chosen: dict[str, Chosen]) -> pa.Table:
    """Return the table of what was left out, by topic and sweep."""
    pieces = [_rows(log, topic, each) for topic, each in sorted(chosen.items())]
    return pa.Table.from_batches(pieces, CLEANED).unify_dictionaries()


def _rows(log: str, topic: str, each: Chosen) -> pa.RecordBatch:
    count = len(each)
    counts = each.counts[0]
    columns: Sequence[Any] = [
        constant(log, count),
        constant(topic, count),
        np.arange(count),
        each.stamp_ns[0],
        *(np.ascontiguousarray(counts[:, column]) for column in range(len(REASONS))),
    ]
    arrays = [
        values if isinstance(values, pa.Array) else pa.array(values).cast(one.type)
        for values, one in zip(columns, CLEANED, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=CLEANED)
