"""Standing things recognised in several runs: tracks tables in, one table of matches out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.choices import MATCH_BY
from lidarcli.errors import OptionError
from lidarcli.formalism.matching.runs import HERE, Matched, Motion, Standing, Things, align
from lidarcli.newfiles import new_files, refuse
from lidarcli.pipeline.inputs.tables import TracksTable, find_tracks, read_tracks_table
from lidarcli.pipeline.reading.pose_sources import of_one_run
from lidarcli.stores.url import Place
from lidarcli.sweeps import Int32, Int64
from lidarcli.tabular.arrays import codes, floats, plain
from lidarcli.tabular.schemas import MATCHES
from lidarcli.tabular.stream import write_stream
from lidarcli.tabular.writing import table_metadata

POSITION, CONSTELLATION, AUTO = MATCH_BY
MOST_THINGS = 2000
"""Most standing things of a run: each is compared with all known ones."""
MOVED = 0.3
"""Least distance from its old position at which a thing has moved [m]: less may be another view of it."""


@dataclass(frozen=True, slots=True)
class Run:
    """Things of one log, topic and frame that never moved within it."""

    log: str
    topic: str
    world: str
    """Frame of the positions; empty for the sensor frame."""
    track: Int64
    things: Standing


@dataclass(slots=True)
class RunResult:
    """Matches of the things of one run."""

    name: str
    things: int
    known: int = 0
    moved: int = 0
    motion: Motion | None = HERE
    chance: float = 1.0

    @property
    def words(self) -> str:
        """One line for people."""
        line = f"{self.name}: {self.things:,} thing{'' if self.things == 1 else 's'}"
        if self.motion is None:
            return f"{line}, none matched: nothing tells how it lies beside the runs before"
        line += f", {self.known:,} known, {self.moved:,} of them moved by more than {MOVED:g} m"
        if self.motion != HERE:
            turn = math.degrees(self.motion.angle)
            line += f"; lies at {self.motion.x:.2f}, {self.motion.y:.2f} m, turned by {turn:.1f} deg"
        if self.chance < 0.5:
            line += f" (or elsewhere: {self.chance:.0%} sure)"
        return line


@dataclass(slots=True)
class MatchResult:
    """All matches, with a line for each run and notes."""

    table: pa.Table
    runs: list[RunResult] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def match_tables(inputs: Sequence[str], by: str = AUTO) -> MatchResult:
    """Match the things of all tracks tables that `inputs` name, run after run.

    Raises
    ------
    UnreadableError
        A table is not there, or is none.
    OptionError
        There are fewer than two runs.
    """
    tables = [read_tracks_table(path) for path in find_tracks(inputs)]
    runs = _runs(tables)
    for run in runs:
        if len(run.things) > MOST_THINGS:
            raise OptionError(
                f"{run.log}: {len(run.things):,} standing things of {run.topic} are more than can be matched "
                f"({MOST_THINGS:,}); track with --end, or in parts"
            )
    if len(tables) < 2:
        only = tables[0].path if tables else "nothing"
        raise OptionError(f"{only}: one run has nothing to be matched with; give the tracks of two or more")
    worlds = sorted({run.world for run in runs})
    chosen = _way(worlds) if by == AUTO else by
    things, results, matched = Things(), [], []
    for run in runs:
        result = RunResult(f"{run.log} {run.topic}", len(run.things))
        if chosen == CONSTELLATION and len(things.known):
            result.motion, result.chance = align(things.known, run.things)
        found = things.take(run.things, result.motion, result.chance)
        result.known = int(np.isfinite(found.moved).sum())
        result.moved = int((found.moved > MOVED).sum())
        matched.append(found)
        results.append(result)
    source = [{"name": table.path.name, "worlds": table.worlds} for table in tables]
    told = table_metadata({"by": by, "matched_by": chosen}, source)
    return MatchResult(_table(runs, matched, told), results, _notes(worlds, chosen, by))


def write_matches(result: MatchResult, path: Place, kind: str, overwrite: bool) -> list[str]:
    """Write the matches to a file of `kind` (parquet, csv, ndjson, arrow); returns notes."""
    with new_files([path], overwrite) as new:
        with new.part(path).open("wb") as out:
            table = result.table.combine_chunks()
            metadata = dict(table.schema.metadata)
            _, notes = write_stream(out, kind, str(path), MATCHES, metadata, table.to_batches())
        return [*notes, *new.publish()]


def refuse_matches(path: Place, inputs: Sequence[str], overwrite: bool) -> None:
    """Refuse an output that exists or that is one of the inputs, before any work."""
    refuse([path], overwrite, [str(table) for table in find_tracks(inputs)])


def _runs(tables: Sequence[TracksTable]) -> list[Run]:
    """Return the standing things of every table, by topic and frame."""
    shapes: dict[str, int] = {}
    labels: dict[str, int] = {}
    names = Counter(name for table in tables for name in set(table.rows["log"].to_pylist()))
    runs = []
    for table in tables:
        rows = table.rows.to_pydict()
        code = {"unknown": -1, None: -1}
        shape = [
            code[each] if each in code else shapes.setdefault(each, len(shapes)) for each in rows["shape"]
        ]
        label = [-1 if each is None else labels.setdefault(each, len(labels)) for each in rows["label"]]
        keys = list(zip(rows["log"], rows["topic"], rows["frame_id"], strict=True))
        stands = np.array([each == "O" for each in rows["set"]], np.bool_)
        numbers = {name: np.array(rows[name], np.float64) for name in _MEASURED}
        placed = np.isfinite(numbers["x"] + numbers["y"])
        for key in sorted(set(keys)):
            at = np.flatnonzero(np.array([each == key for each in keys], np.bool_) & stands & placed)
            log, topic, frame = key
            runs.append(
                Run(
                    log=str(table.path) if names[log] > 1 else log,
                    topic=topic,
                    world=table.worlds.get(frame, ""),
                    track=np.array(rows["track"], np.int64)[at],
                    things=Standing(
                        **{name: values[at] for name, values in numbers.items()},
                        shape=np.array(shape, np.int32)[at],
                        label=np.array(label, np.int32)[at],
                    ),
                )
            )
    return runs


_MEASURED = ("x", "y", "length", "width", "length_sd", "width_sd")


def _way(worlds: Sequence[str]) -> str:
    """Choose matching by position where all positions are in one world that outlives a run."""
    common = len(worlds) == 1 and worlds[0] and not of_one_run(worlds[0])
    return POSITION if common else CONSTELLATION


def _notes(worlds: Sequence[str], chosen: str, by: str) -> list[str]:
    """Return a note on how the matches were found."""
    named = ", ".join(world or "the sensor's own" for world in worlds)
    if chosen == CONSTELLATION:
        why = (
            ""
            if by == CONSTELLATION
            else f": the frame of the places is {named}, which need not be the same place"
        )
        return [f"matched by constellation{why}"]
    line = f"matched by position, in the frame {named}"
    if _way(worlds) != POSITION:
        line += ", which need not be the same place (--by constellation)"
    return [line]


def _table(runs: Sequence[Run], matched: Sequence[Matched], told: dict[bytes, bytes]) -> pa.Table:
    """Return the rows of all runs, by thing and run."""
    thing = _joined([found.thing for found in matched], np.int64)
    order = np.argsort(thing, kind="stable")
    columns = {
        "thing": plain(thing[order]),
        "log": _texts([run.log for run in runs], runs, order),
        "topic": _texts([run.topic for run in runs], runs, order),
        "track": plain(_joined([run.track for run in runs], np.int64)[order]),
    }
    for name in ("x", "y", "moved", "score"):
        values = _joined([getattr(found, name) for found in matched], np.float64)[order]
        columns[name] = floats(values, MATCHES.field(name).type)
    return pa.Table.from_arrays([columns[name] for name in MATCHES.names], schema=MATCHES.with_metadata(told))


def _joined(parts: Sequence[NDArray[Any]], kind: type[np.generic]) -> NDArray[Any]:
    return np.concatenate([np.empty(0, kind), *parts])


def _texts(names: Sequence[str], runs: Sequence[Run], order: Int64) -> pa.DictionaryArray:
    """Return a column with the name of the run of each row."""
    known = {name: code for code, name in enumerate(dict.fromkeys(names))}
    each: Int32 = np.array([known[name] for name in names], np.int32)
    lengths = np.array([len(run.track) for run in runs], np.int64)
    return codes(np.repeat(each, lengths)[order], tuple(known))
