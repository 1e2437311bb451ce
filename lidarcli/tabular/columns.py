"""Columns and rows of tables: numpy arrays as Arrow columns on the same memory, and the rows of a detection and a tracking.

`pyarrow.array` would do for arrays, but it imports pandas to look at its argument, which costs half a second at start; what
needs `pyarrow.compute` costs a tenth of that. No row is a Python object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.formalism.detection import AGENT, COLUMNS, NOISE, OBJECT, Detection, fields_per
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks, Trajectories
from lidarcli.sweeps.range_rules import count_statuses
from lidarcli.sweeps.types import STATUSES, Column, Int32, Per, SweepBatch, UInt8
from lidarcli.tabular.schemas import FACES, KINDS, SCHEMAS, STAMP, TABLES, VERTICES, schema_of


def plain(values: NDArray[Any], kind: pa.DataType | None = None) -> pa.Array:
    """Return values without nulls; `kind` may give a type of the same size another meaning (a stamp)."""
    return _array(values, None, kind)


def masked(values: NDArray[Any], null: NDArray[np.bool_], kind: pa.DataType | None = None) -> pa.Array:
    """Return values that are null where `null` is true; `kind` as of `plain`."""
    return _array(values, ~null, kind)


def answers(values: NDArray[np.int8]) -> pa.BooleanArray:
    """Return yes or no, null where a value is negative.

    >>> answers(np.array([1, 0, -1], np.int8)).to_pylist()
    [True, False, None]
    """
    bits, known = (pa.py_buffer(np.packbits(one, bitorder="little")) for one in (values > 0, values >= 0))
    return pa.Array.from_buffers(pa.bool_(), len(values), [known, bits])


def floats(values: NDArray[np.floating[Any]], kind: pa.DataType | None = None) -> pa.Array:
    """Return numbers of double precision, or of another `kind`, null for NaN.

    >>> floats(np.array([1.5, np.nan])).to_pylist()
    [1.5, None]
    """
    kind = kind or pa.float64()
    # What single precision cannot hold, such as a bearing of a broken header, is infinite.
    with np.errstate(over="ignore"):
        numbers = np.ascontiguousarray(values, kind.to_pandas_dtype())
    # The minimum is NaN where any value is: one pass, where `isnan(...).any()` takes two.
    if not math.isnan(np.minimum.reduce(numbers, initial=0.0)):
        return plain(numbers, kind)
    return _array(numbers, ~np.isnan(numbers), kind)


def codes(values: NDArray[Any], names: Sequence[str]) -> pa.DictionaryArray:
    """Return a column of names from small integers, null where one is negative.

    >>> codes(np.array([1, 0, -1], np.int8), ("O", "S")).to_pylist()
    ['S', 'O', None]
    """
    index = np.ascontiguousarray(values, np.int32)
    none = None if values.dtype.kind == "u" else index < 0
    indices = plain(index) if none is None or not none.any() else masked(index, none)
    return pa.DictionaryArray.from_arrays(indices, _texts(tuple(names)), safe=False)


def names_of(values: NDArray[np.uint8], names: Sequence[str]) -> pa.StringArray:
    """Return a column of names as plain text, for columns inside lists, where not every reader takes dictionaries.

    >>> names_of(np.array([1, 0, 1], np.uint8), ("O", "AS")).to_pylist()
    ['AS', 'O', 'AS']
    """
    encoded = [name.encode() for name in names]
    offsets = np.zeros(len(values) + 1, np.int32)
    np.cumsum(np.array([*map(len, encoded)], np.int32).take(values), out=offsets[1:])
    # As an array shorter names end with zeros, which no name holds.
    text = np.array(encoded).take(values).tobytes().translate(None, b"\0")
    return pa.StringArray.from_buffers(len(values), pa.py_buffer(offsets), pa.py_buffer(text))


def values_and_mask(column: pa.Array | pa.ChunkedArray) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return (K,) numbers or answers of a column and where it is not null; as `to_numpy`, which imports pandas.

    >>> values_and_mask(answers(np.array([1, 0, -1], np.int8)))
    (array([ True, False, False]), array([ True,  True, False]))
    """
    if isinstance(column, pa.ChunkedArray):
        chunks = [values_and_mask(chunk) for chunk in column.chunks] or [(np.empty(0), np.empty(0, bool))]
        values, there = zip(*chunks, strict=True)
        return (np.concatenate(values), np.concatenate(there)) if len(chunks) > 1 else chunks[0]
    known, data = column.buffers()
    part = slice(column.offset, column.offset + len(column))
    there = _bits(known)[part] if column.null_count else np.ones(len(column), bool)
    if pa.types.is_boolean(column.type):
        return _bits(data)[part], there
    return np.frombuffer(b"" if data is None else data, column.type.to_pandas_dtype())[part], there


def numbers(column: pa.Array | pa.ChunkedArray) -> NDArray[np.float64]:
    """Return (K,) numbers of a column, NaN where it is null.

    >>> numbers(floats(np.array([1.5, np.nan])))
    array([1.5, nan])
    """
    values, there = values_and_mask(column)
    return np.where(there, values.astype(np.float64, copy=False), np.nan)


def integers(rows: pa.RecordBatch, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers or stamps [ns]; nulls are -1."""
    column = rows[name]
    if pa.types.is_timestamp(column.type):
        column = column.view(pa.int64())
    values, there = values_and_mask(column)
    return np.where(there, values, -1)


def are(column: pa.DictionaryArray | pa.ChunkedArray, word: str) -> NDArray[np.bool_]:
    """Return (K,) where a column of names has this one.

    >>> are(codes(np.array([1, 0, -1], np.int8), ("O", "S")), "S")
    array([ True, False, False])
    """
    if isinstance(column, pa.ChunkedArray):
        return np.concatenate([np.empty(0, bool), *(are(chunk, word) for chunk in column.chunks)])
    names = column.dictionary.to_pylist()
    code, there = values_and_mask(column.indices)
    return there & (code == names.index(word)) if word in names else np.zeros(len(column), bool)


def _bits(data: pa.Buffer) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little").view(bool)
    return found


@lru_cache(maxsize=256)
def _texts(names: tuple[str, ...]) -> pa.StringArray:
    encoded = [name.encode("utf-8", "replace") for name in names]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(names), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded)))


def _array(values: NDArray[Any], valid: NDArray[np.bool_] | None, kind: pa.DataType | None) -> pa.Array:
    values = np.ascontiguousarray(values)
    bitmap = None if valid is None else pa.py_buffer(np.packbits(valid, bitorder="little"))
    nulls = 0 if valid is None else -1
    kind = kind or pa.from_numpy_dtype(values.dtype)
    assert kind.bit_width == 8 * values.itemsize, f"{values.dtype} is no {kind}"
    return pa.Array.from_buffers(kind, len(values), [bitmap, pa.py_buffer(values)], nulls)


COARSE = 1_000
"""Stamps in microseconds have lost less than this [ns]."""

Rows = TypeVar("Rows", pa.RecordBatch, pa.Table)


def in_unit(schema: pa.Schema, unit: str | None) -> pa.Schema:
    """Return a schema whose stamps count in `unit`, `ns` or `us`; None leaves them as they are."""
    for index, field in enumerate(schema) if unit is not None else ():
        if pa.types.is_timestamp(field.type) and field.type.unit != unit:
            changed = field.with_metadata({**(field.metadata or {}), b"unit": unit})
            schema = schema.set(index, changed.with_type(pa.timestamp(unit, field.type.tz)))
    return schema


def restamped(rows: Rows, unit: str | None) -> Rows:
    """Return rows whose stamps count in a unit, as of `in_unit`; what is finer is cut off."""
    schema = in_unit(rows.schema, unit)
    return rows if schema is rows.schema else rows.cast(schema, safe=False)


class Form:
    """A table as its rows are filled in: asking Arrow for the schema again and again takes longer than the work."""

    def __init__(self, table: str) -> None:
        self.schema = schema_of(TABLES[table])
        self._columns = [(one, field.type) for one, field in zip(TABLES[table], self.schema, strict=True)]

    def fill(self, columns: dict[str, Any], found: Detection | Tracks | Trajectories | None, count: int) -> pa.RecordBatch:
        """Return rows: of `columns`, of the arrays that `found` has, and of nulls for what is not known."""
        arrays = []
        for one, kind in self._columns:
            values = columns[one.name] if one.name in columns else getattr(found, one.field, None)
            if values is None:
                values = pa.nulls(count, kind)
            arrays.append(values if isinstance(values, pa.Array) else as_column(values, one))
        return pa.RecordBatch.from_arrays(arrays, schema=self.schema)


def as_column(values: NDArray[Any], one: Column) -> pa.Array:
    """Return an array as the column that is declared."""
    if one.words:
        return names_of(values, one.words) if one.kind == "string" else codes(values, one.words)
    kind = KINDS[one.kind]
    return floats(values, kind) if pa.types.is_floating(kind) else plain(values, kind)


FORMS = {table: Form(table) for table in SCHEMAS}
"""Table of a log → its form."""


def objects_rows(
    log: str, batch: SweepBatch, detection: Detection, labels: Sequence[str] = (), more: dict[str, Any] | None = None
) -> pa.RecordBatch:
    """Return rows of the objects table: one per object, in the order of the detection (sweep, object).

    `labels` are the names that the labels of the detection, if any, are indices of; `more` are other columns.
    """
    row = detection.row
    count = len(row)
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "frame_id": codes(batch.frame[row], batch.frame_ids),
        "sweep": batch.sweep[row],
        "stamp": batch.stamp_ns[row],
        "t": batch.seconds[row],
        "vertices": _lists(detection, VERTICES, detection.vertex_offsets, "vertex"),
        "faces": _lists(detection, FACES, detection.face_offsets, "face"),
    }
    if detection.label is not None:
        columns["label"] = codes(detection.label, labels)
    if detection.features is not None:
        # Imported here, as few ask for reasons.
        from lidarcli.formalism.detect import reasons

        columns["why"] = pa.array(reasons(detection.features, detection.thing, detection.place), pa.string())
    if batch.poses is not None:
        # An object is observed from where the sensor was when it came to the beam in its middle.
        boxes = detection.box_x, detection.box_y, detection.box_yaw
        world = batch.poses.to_world(row, *boxes, detection.shares(batch))
        columns |= zip(("world_x", "world_y", "world_yaw"), world, strict=True)
    return FORMS["objects"].fill(columns | (more or {}), detection, count)


def sweeps_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Return rows of the sweeps table: one per sweep of the batch."""
    count = len(batch)
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "frame_id": codes(batch.frame, batch.frame_ids),
        "sweep": batch.sweep,
        "stamp": batch.stamp_ns,
        "t": batch.seconds,
        "beams": batch.beams,
    }
    columns |= zip(STATUSES, count_statuses(batch.status), strict=False)
    columns["observed"] = answers(batch.observed.astype(np.int8))
    if detection.station is not None:
        columns["station"] = masked(detection.station, detection.station < 0)
    if batch.poses is not None:
        poses = batch.poses.at_stamp()
        columns |= {"pose_x": poses.x, "pose_y": poses.y, "pose_yaw": poses.yaw}
    return FORMS["sweeps"].fill(columns, detection, count)


def beams_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Return rows of the beams table: one per beam of the batch, without padding.

    Raises
    ------
    ValueError
        The detection was made without its arrays per beam.
    """
    if detection.beam_set is None or detection.beam_object is None or detection.beam_s is None:
        raise ValueError("beams_rows needs a detection with per_beam")
    row, beam = beams_of(batch)
    count = len(row)
    owner = detection.beam_object[row, beam]
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "sweep": batch.sweep[row],
        "beam": beam.astype(np.int32),
        "theta": batch.bearings[row, beam],
        "r": batch.ranges[row, beam],
        "status": batch.status[row, beam],
        "s": detection.beam_s[row, beam],
        "set": detection.beam_set[row, beam],
        "object": masked(owner, owner == 0),
    }
    if detection.beam_difference is not None:
        columns["difference"] = detection.beam_difference[row, beam]
    return FORMS["beams"].fill(columns, detection, count)


def beams_of(batch: SweepBatch) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return row and column of every beam of a batch, without padding, in the order of the beams table."""
    row, beam = np.nonzero(np.arange(batch.width) < batch.beams[:, None])
    return row, beam


def constant(text: str, count: int) -> pa.DictionaryArray:
    """Return a column of one name."""
    return codes(np.zeros(count, np.uint8), (text,))


def _lists(detection: Detection, kind: pa.ListType, offsets: NDArray[np.int32], per: Per) -> pa.ListArray:
    """Return a list for each object, of the fields that have one entry per vertex or face."""
    values = [as_column(getattr(detection, field), COLUMNS[field]) for field in fields_per(per)]
    items = pa.StructArray.from_arrays(values, fields=list(kind.value_type))
    return pa.ListArray.from_arrays(plain(offsets), items, type=kind)


def tracked_rows(
    table: str, log: str, found: TrackedBatch, labels: Sequence[str] = (), *, walls: bool, tracks: bool
) -> pa.RecordBatch:
    """Return rows of the objects, sweeps or beams of a batch by the tracking; `labels` are the names in the catalogue.

    With `walls` bodies in set S have rows, too; without `tracks` agents are objects, and no column has tracks.
    """
    if table == "objects":
        return _tracked_objects(log, found, labels, walls=walls, tracks=tracks)
    if table == "beams":
        sets, number = beam_sets(found, tracks=tracks)
        return beams_rows(log, found.batch, replace(found.detection, beam_set=sets, beam_object=number))
    counts = {name: getattr(found, name) for name in ("objects", "agents", "object_beams", "agent_beams", "noise_beams")}
    for name, agents in () if tracks else (("objects", "agents"), ("object_beams", "agent_beams")):
        counts[name], counts[agents] = counts[name] + counts[agents], np.zeros_like(counts[agents])
    return sweeps_rows(log, found.batch, replace(found.detection, **counts))


def _tracked_objects(log: str, found: TrackedBatch, labels: Sequence[str], *, walls: bool, tracks: bool) -> pa.RecordBatch:
    order = found.order if walls else found.order[found.set[found.order] != NOISE]
    kind = found.set[order]
    some: dict[str, Any] = {"object": found.object[order], "shape": found.shape[order]}
    if not tracks:
        some["set"] = np.where(kind == AGENT, OBJECT, kind)
        return objects_rows(log, found.batch, replace(found.detection.taken(order), **some))
    some |= {"set": kind, "label": found.label[order], "label_score": found.label_score[order]}
    track = found.track[order]
    columns = {
        "track": masked(track, track == 0),
        "moving": answers(found.moving[order]),
        **{name: getattr(found, name)[order] for name in ("vx", "vy", "agent_score")},
    }
    return objects_rows(log, found.batch, replace(found.detection.taken(order), **some), labels, columns)


def beam_sets(found: TrackedBatch, *, tracks: bool = True) -> tuple[UInt8, Int32]:
    """Return the set of each beam and the number of its object, 0 for none, (S, B) each, by the tracking.

    `tracks`: distinguish agents from objects. The detection was made with `per_beam`.
    """
    detection = found.detection
    assert detection.beam_object is not None
    most = int(detection.object.max(initial=0))
    number = np.zeros((len(found.batch), most + 1), np.int32)
    sets = np.full((len(found.batch), most + 1), NOISE, np.uint8)
    at = np.flatnonzero(found.set != NOISE)
    place = detection.row[at], detection.object[at]
    number[place] = found.object[at]
    sets[place] = found.set[at] if tracks else OBJECT
    row = np.arange(len(found.batch))[:, None]
    return sets[row, detection.beam_object], number[row, detection.beam_object]


def tracks_rows(log: str, tracks: Tracks, sensors: Sequence[tuple[str, str]], labels: Sequence[str] = ()) -> pa.RecordBatch:
    """Return rows of the tracks table: one per track, by its number; `sensors` are their topics and frames."""
    count = len(tracks)
    columns = {
        "log": constant(log, count),
        "topic": _of_sensors(tracks.sensor, [topic for topic, _ in sensors]),
        "frame_id": _of_sensors(tracks.sensor, [frame for _, frame in sensors]),
        "person": masked(tracks.person, tracks.person == 0),
        "moved_at": masked(tracks.moved_at_ns, ~tracks.moved, STAMP),
        "label": codes(tracks.label, labels),
    }
    return FORMS["tracks"].fill(columns, tracks, count)


def trajectories_rows(log: str, sensors: Sequence[tuple[str, str]], found: Trajectories) -> pa.RecordBatch:
    """Return rows of the trajectories table: one per track and sweep; the rest as of `tracks_rows`."""
    count = len(found)
    columns = {
        "log": constant(log, count),
        "topic": _of_sensors(found.sensor, [topic for topic, _ in sensors]),
        "sweep": found.sweep,
        "stamp": found.stamp_ns,
        "t": found.seconds,
    }
    return FORMS["trajectories"].fill(columns, found, count)


def _of_sensors(sensor: Int32, names: Sequence[str]) -> pa.DictionaryArray:
    """Return a column of what each of some sensors is called; null for several that have not one name."""
    known = [*dict.fromkeys(names)]
    if len(known) == 1:
        return constant(known[0], len(sensor))
    number = np.array([known.index(name) for name in names] + [-1], np.int32)
    return codes(number[sensor], known)
