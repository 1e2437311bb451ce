"""Path of the sensor of a log as a file: TUM for evo and others, or a table."""

from __future__ import annotations

import io
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse, writing
from lidarcli.files.stores import Place
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.options.choices import MATCH, NS
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.reading.needs import Need, PoseOptions
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary, named_files, read_log, reading_as_dict
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.columns import constant, floats, plain, restamped
from lidarcli.tabular.schemas import POSES, STAMP
from lidarcli.tabular.writing import ParquetSink, table_metadata

if TYPE_CHECKING:
    from lidarcli.pose.tracks import PoseMotion

TUM, PARQUET = ".tum", ".parquet"


@dataclass(frozen=True, slots=True)
class PathOptions:
    """Options of `poses`, apart from input and output."""

    read: ReadOptions = field(default_factory=ReadOptions)
    opening: OpenOptions = field(default_factory=OpenOptions)
    poses: PoseOptions = field(default_factory=PoseOptions)
    overwrite: bool = False
    stamps: str = NS
    """Unit of the stamps of a table, as of `in_unit`."""


def refuse_path(
    path: Place, source: Source, options: PathOptions, more: Sequence[str] = (), read: Sequence[str] = ()
) -> None:
    """Refuse an output of an unknown suffix (`OptionError`), or that cannot be written (`OutputError`); `more` are known,
    too, and further files are `read`.
    """
    if path.suffix.lower() not in (known := (TUM, ".txt", PARQUET, *more)):
        raise OptionError(f"{path}: the suffix of a trajectory has to be one of {', '.join(known)}")
    refuse([path], options.overwrite, [*files_of([source]), *named_files(options), *read])


@dataclass(slots=True)
class PathSummary(RunSummary):
    """The counts of one run over one log, and the path of its sensors."""

    table: pa.Table = field(default_factory=POSES.empty_table)
    """One row per pose."""

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values."""
        return {**RunSummary.as_dict(self), "poses": self.table.num_rows}


def write_path(source: Source, path: Place | None, options: PathOptions, progress: Progress | None = None) -> PathSummary:
    """Return the known poses of the sensors of a log at its sweeps, and write them where a file is named.

    Without any pose an `UnreadableError`; several sensors in a TUM file, which has room for one, are an `OptionError`.
    """
    lines = None if path is None or path.suffix.lower() == PARQUET else io.BytesIO()
    with read_log(source, options, Need.ALL) as reading:
        summary = read_rows(source, reading, options, progress, lines)
    if path is not None:
        save(path, options, summary, None if lines is None else lines.getvalue())
    return summary


def save(path: Place, options: PathOptions, run: PathSummary, data: bytes | None) -> None:
    """Write the table of a run, or the data that stand for it."""
    with NewFiles([path], options.overwrite) as new:
        with writing(path, nameless=True):
            if data is not None:
                new.part(path).write_bytes(data)
            else:
                rows = restamped(run.table, options.stamps)
                with ParquetSink(new.part(path), rows.schema.remove_metadata(), path) as sink:
                    for each in rows.to_batches():
                        sink.write(each)
                    sink.finish(run.table.schema.metadata)
        run.notes += new.publish()
        run.outputs = [str(path)]


def read_rows(
    source: Source,
    reading: Reading,
    options: PathOptions,
    progress: Progress | None,
    lines: IO[bytes] | None = None,
    judge: Callable[[SweepBatch], None] = lambda batch: None,
) -> PathSummary:
    """Read the poses as rows, and write them as lines where there is a stream for these; `judge` takes each batch, too."""
    writer = PoseWriter(source.name, options.poses.source == MATCH, lines)
    for batch in reading.batches(progress):
        writer.add(batch, reading)
        judge(batch)
    found = reading.close()
    writer.conclude(found)
    parameters = reading_as_dict(options.read, options.opening, options.poses)
    metadata = table_metadata(parameters, reading.describe(source), found.damage)
    table = pa.Table.from_batches(writer.rows, POSES).unify_dictionaries().replace_schema_metadata(metadata)
    return PathSummary(**{name: getattr(found, name) for name in RunSummary.__dataclass_fields__}, table=table)


class PoseWriter:
    """Collects known poses as rows, and writes them as lines of TUM text where there is a stream for these."""

    def __init__(self, log: str, is_matched: bool, lines: IO[bytes] | None) -> None:
        """`is_matched`: the poses were matched from the sweeps; `lines` have room for one sensor."""
        self.rows: list[pa.RecordBatch] = []
        self._log, self._is_matched, self._lines = log, is_matched, lines
        self._last: dict[tuple[str, str, str], int] = {}
        self._count = 0
        self._left_out = 0
        self._twice: dict[str, str] = {}
        """Topic that is left out → topic of the same frame."""

    def add(self, batch: SweepBatch, reading: Reading) -> None:
        """Add the poses of a batch."""
        from lidarcli.pose.tracks import GAP, PoseMotion, trajectory_lines

        for frame, rows, motion, world in reading.posing.motions(batch):
            own = batch.rows(rows)
            known = np.asarray(~np.isnan(motion.position).any(axis=1))
            kept = np.flatnonzero(known)
            if self._lines is not None:
                kept = self._later((batch.topic, frame, world), own, kept) if len(kept) else kept
                # Without it, a reader would make up a path over the sweeps of which no pose is known.
                for part in np.split(np.arange(len(known)), np.flatnonzero(np.diff(known)) + 1) if len(known) else ():
                    some = np.intersect1d(part, kept)
                    poses = PoseMotion(motion.position[some], motion.rotation[some])
                    lines = trajectory_lines(own.stamp_ns[some], poses) if known[part[0]] else f"{GAP}\n"
                    self._lines.write(lines.encode())
            self._count += len(kept)
            own, motion = own.rows(kept), PoseMotion(motion.position[kept], motion.rotation[kept])
            self.rows.append(self._rows_of(own, frame, world, motion))

    def _rows_of(self, batch: SweepBatch, frame: str, world: str, motion: PoseMotion) -> pa.RecordBatch:
        from lidarcli.pose.tracks import planar, upright

        count = len(batch)
        rotation = upright(motion.rotation)
        columns: dict[str, Any] = {
            "log": constant(self._log, count),
            "topic": constant(batch.topic, count),
            "frame_id": constant(frame, count),
            "world": constant(world, count),
            "sweep": plain(batch.sweep),
            "stamp": plain(batch.stamp_ns, STAMP),
            "yaw": floats(planar(motion).yaw),
        }
        columns |= {name: floats(motion.position[:, axis].copy()) for axis, name in enumerate("xyz")}
        columns |= {f"q{name}": floats(rotation[:, axis].copy()) for axis, name in enumerate("xyzw")}
        arrays = [columns[field.name] if field.name in columns else pa.nulls(count, field.type) for field in POSES]
        return pa.RecordBatch.from_arrays(arrays, schema=POSES)

    def conclude(self, summary: RunSummary) -> None:
        """Refuse a path without a pose, and add notes on the number of poses."""
        if not summary.sweeps:
            raise UnreadableError("; ".join(["no sweep that could have a pose", *summary.damage, *summary.notes]))
        if not self._count:
            why = "; ".join(summary.notes) or "nothing in the log tells where the sensor was"
            hint = "" if self._is_matched else "; --pose match finds the path from the sweeps"
            raise UnreadableError(f"no poses: {why}{hint}")
        if self._left_out:
            summary.notes.append(
                f"left out, as their stamps are not after those before and evo reads none of these: {self._left_out:,}"
            )
        summary.notes += [
            f"{topic} is of the same frame as {first}: left out (--topic {shlex.quote(topic)})"
            for topic, first in self._twice.items()
        ]
        summary.notes.append(f"{self._count:,} pose{'' if self._count == 1 else 's'}")

    def _later(self, key: tuple[str, str, str], batch: SweepBatch, kept: Any) -> Any:
        """Return the rows whose stamps increase, of one sensor alone, from its first topic."""
        first = next(iter(self._last), key)
        if key != first and key[1:] == first[1:]:
            self._twice[key[0]] = first[0]
            return kept[:0]
        if key != first:
            raise OptionError(
                f"a TUM file holds the path of one sensor, and the log has {first[0]} ({first[1]}) and {key[0]} "
                f"({key[1]}): choose one with --topic, or write a .parquet"
            )
        stamps = batch.stamp_ns[kept]
        before = self._last.get(key, int(stamps[0]) - 1)
        highest = np.maximum.accumulate(np.concatenate([[before], stamps]))
        goes_on = stamps > highest[:-1]
        self._left_out += int(np.count_nonzero(~goes_on))
        self._last[key] = int(highest[-1])
        return kept[goes_on]
