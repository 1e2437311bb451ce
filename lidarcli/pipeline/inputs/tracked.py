"""Objects, tracks and paths of a log, as its tables have them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.formalism.detection import NOISE, SETS
from lidarcli.formalism.tracking.results import HIDDEN, VIEWS
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.sweeps.types import Bool, Float64, Int32, Int64, SweepBatch, UInt8
from lidarcli.sweeps.zone import WORLD
from lidarcli.tabular.columns import integers, numbers, values_and_mask
from lidarcli.tabular.reading import TopicRows, read_columns
from lidarcli.tabular.schemas import SCHEMAS

Columns = dict[str, NDArray[Any]]


def columns_of(tables: TableSet, kind: str, names: Iterable[str]) -> Columns:
    """Return columns (N,) of a table: names as text, stamps [ns], numbers; null is empty, -1 or NaN."""
    rows = read_columns(getattr(tables, kind), kind, SCHEMAS[kind], names)
    return {name: _values(rows[name]) for name in names}


def _values(column: pa.ChunkedArray) -> NDArray[Any]:
    if pa.types.is_dictionary(column.type):
        return names_in(column)
    if pa.types.is_timestamp(column.type):
        column = column.cast(pa.int64())
    if pa.types.is_floating(column.type):
        return numbers(column)
    values, there = values_and_mask(column)
    return np.where(there, values, -1)


def names_in(column: pa.ChunkedArray) -> NDArray[np.str_]:
    """Return a column of names as text, empty for null."""
    rows = column.unify_dictionaries().combine_chunks()
    if not len(rows):
        return np.zeros(0, np.str_)
    code, there = values_and_mask(rows.indices)
    # The last one is that of null.
    words: NDArray[np.str_] = np.array([*rows.dictionary.to_pylist(), ""])[np.where(there, code, -1)]
    return words


def tracks_of(tables: TableSet, topic: str, frame: str, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return the tracks of a sensor by number, with the columns `names`; stamps are integers [ns].

    Those that several sensors followed together are tracks of each; their `frame_id` is None.
    """
    rows = read_columns(tables.tracks, "tracks", SCHEMAS["tracks"], columns := ("topic", "frame_id", "track", *names))
    values = [each.cast(pa.int64()) if pa.types.is_timestamp(each.type) else each for each in map(rows.column, columns)]
    every = [dict(zip(columns, row, strict=True)) for row in zip(*(each.to_pylist() for each in values), strict=True)]
    shared = {row["track"]: row for row in every if row["frame_id"] is None and row["topic"] in (None, topic)}
    own = {row["track"]: row for row in every if (row["topic"], row["frame_id"]) == (topic, frame)}
    return [row for _, row in sorted((shared | own).items())]


class TrackPaths(NamedTuple):
    """Trajectories (N) of one topic, by track and sweep."""

    track: Int64
    sweep: Int64
    x: Float64
    y: Float64
    in_world: Bool
    """(N,) True for the world frame, else that of the sensor."""
    hidden: Bool
    """(N,) True where nothing of it is visible in the sweep."""
    more: Columns
    """Other columns, by name."""

    def of(self, track: int) -> slice:
        """Return the rows of a track."""
        first, after = np.searchsorted(self.track, [track, track + 1])
        return slice(int(first), int(after))


def paths_of(tables: TableSet, topic: str, names: Iterable[str] = ()) -> TrackPaths:
    """Return the trajectories of a topic, with more columns `names`."""
    columns = columns_of(tables, "trajectories", ("topic", "track", "sweep", "x", "y", "frame", "seen", *names))
    own = np.flatnonzero(columns.pop("topic") == topic)
    order = own[np.lexsort((columns["sweep"][own], columns["track"][own]))]
    track, sweep, x, y, frame, seen, *more = (values[order] for values in columns.values())
    return TrackPaths(track, sweep, x, y, frame == WORLD, seen == VIEWS[HIDDEN], dict(zip(names, more, strict=True)))


def to_sensor(pose: Float64, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """Return places (N,) in the sensor frame [m], of the frame in which the sensor is at `pose` (N, 4).

    A pose is x, y [m], yaw [rad], and 1 where the sensor hangs head down.
    """
    dx, dy = x - pose[:, 0], y - pose[:, 1]
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    left = cos * dy - sin * dx
    return cos * dx + sin * dy, np.where(pose[:, 3] > 0.0, -left, left)


def from_sensor(pose: Float64, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """Return places (N,) of the sensor frame in the frame in which the sensor is at `pose`, as of `to_sensor`."""
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    left = np.where(pose[:, 3] > 0.0, -y, y)
    return pose[:, 0] + cos * x - sin * left, pose[:, 1] + sin * x + cos * left


OBJECT_COLUMNS = ("topic", "sweep", "object", "beam_i", "beam_f", "set", "track", "vx", "vy")
"""Columns of the objects table by which beams have an object."""


class Objects(NamedTuple):
    """Objects of the sweeps of a batch, from the objects table."""

    row: Int64
    """(N,) sweep of the batch."""
    object: Int64
    beam_i: Int64
    beam_f: Int64
    set: UInt8
    """(N,) index into `SETS`."""
    track: Int64
    """(N,) its track, -1 for none."""
    velocity: Float64
    """(N, 2) [m/s] in the world or else the sensor frame; NaN where it is not known."""

    @staticmethod
    def of(rows: pa.RecordBatch, batch: SweepBatch) -> Objects:
        """Return the objects of a batch among rows of the table; walls are none."""
        sweep, first, beam_i, beam_f = (
            values_and_mask(rows[name])[0].astype(np.int64) for name in ("sweep", "object", "beam_i", "beam_f")
        )
        row = np.searchsorted(batch.sweep, sweep)
        names = rows["set"]
        letters = np.array([SETS.index(str(name)) for name in names.dictionary.to_pylist()] or [0], np.uint8)
        its = letters[values_and_mask(names.indices)[0]] if len(names) else np.zeros(0, np.uint8)
        own = its != NOISE
        track, there = values_and_mask(rows["track"])
        velocity = np.column_stack([numbers(rows["vx"]), numbers(rows["vy"])])
        track = np.where(there, track, -1)
        return Objects(row[own], first[own], beam_i[own], beam_f[own], its[own], track[own], velocity[own])

    def of_rows(self, rows: Int64) -> Objects:
        """Return the objects of some sweeps of the batch, which are numbered from 0."""
        at = np.searchsorted(rows, self.row)
        own = rows[np.minimum(at, len(rows) - 1)] == self.row
        return Objects(at[own], *(values[own] for values in self[1:]))

    def owners(self, batch: SweepBatch) -> Int32:
        """Return the object (S, B) of every beam, by index; -1 where there is none."""
        owner = np.full(batch.ranges.shape, -1, np.int32)
        # Beams between the first and the last of an object are on it, or have no range.
        count = (self.beam_f - self.beam_i) % np.maximum(batch.beams[self.row], 1) + 1
        which = np.repeat(np.arange(len(self.row)), count)
        after = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        beam = (self.beam_i[which] + after) % np.maximum(batch.beams[self.row[which]], 1)
        owner[self.row[which], beam] = which
        return owner


class ObjectRows:
    """The objects of a log, from its table, as its sweeps come by."""

    def __init__(self, tables: TableSet) -> None:
        self._tables = tables
        self._topics: dict[str, TopicRows] = {}

    def of(self, batch: SweepBatch) -> Objects:
        """Return the objects of a batch that is not empty; each sweep comes after those before it."""
        if batch.topic not in self._topics:
            self._topics[batch.topic] = TopicRows(self._tables.objects, "objects", OBJECT_COLUMNS, batch.topic)
        rows = self._topics[batch.topic].until(int(batch.sweep[-1]) + 1)
        there = np.isin(integers(rows, "sweep"), batch.sweep)
        return Objects.of(rows if there.all() else rows.filter(pa.array(there)), batch)
