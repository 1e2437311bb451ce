"""From the flat arrays of a detection to rows of the tables, without a Python object per row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.formalism import SETS, SHAPES, VERTEX_KINDS, VISIBILITIES, Detection
from lidarcli.sweeps import Status, SweepBatch
from lidarcli.tables.schemas import BEAMS, FACE, OBJECTS, STAMP, SWEEPS, TEXT, VERTEX

_STATUSES = ("valid", "no_return", "too_close", "invalid")
"""Names of `Status` by code; padding is no beam and never gets a row."""


def objects_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Rows of the objects table: one per object, in the order of the detection (sweep, object)."""
    row = detection.row
    count = len(row)
    columns = {
        "log": _constant(log, count),
        "topic": _constant(batch.topic, count),
        "frame_id": _codes(batch.frame[row], batch.frame_ids),
        "sweep": pa.array(batch.sweep[row]),
        "stamp": pa.array(batch.stamp_ns[row]).view(STAMP),
        "set": _codes(detection.set, SETS),
        "shape": _codes(detection.shape, SHAPES),
        "visibility": _codes(detection.visibility, VISIBILITIES),
        "vertices": _vertices(detection),
        "faces": _faces(detection),
    }
    return _record_batch(OBJECTS, columns, detection, count)


def sweeps_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Rows of the sweeps table: one per sweep of the batch."""
    count = len(batch)
    columns = {
        "log": _constant(log, count),
        "topic": _constant(batch.topic, count),
        "frame_id": _codes(batch.frame, batch.frame_ids),
        "sweep": pa.array(batch.sweep),
        "stamp": pa.array(batch.stamp_ns).view(STAMP),
        "beams": pa.array(batch.beams),
        "d_th": _floats(detection.sweep_d_th),
    }
    for name, code in zip(_STATUSES, Status, strict=False):
        columns[name] = pa.array(np.count_nonzero(batch.status == code, axis=1).astype(np.int32))
    return _record_batch(SWEEPS, columns, detection, count)


def beams_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Rows of the beams table: one per beam of the batch, padding left out.

    Raises
    ------
    ValueError
        The detection was made without its arrays per beam.
    """
    if detection.beam_set is None or detection.beam_object is None or detection.beam_s is None:
        raise ValueError("beams_rows needs a detection with per_beam")
    row, beam = np.nonzero(np.arange(batch.width) < batch.beams[:, None])
    count = len(row)
    owner = detection.beam_object[row, beam]
    columns = {
        "log": _constant(log, count),
        "topic": _constant(batch.topic, count),
        "sweep": pa.array(batch.sweep[row]),
        "beam": pa.array(beam.astype(np.int32)),
        "theta": _floats(batch.bearings()[row, beam]),
        "r": _floats(batch.ranges[row, beam].astype(np.float64)),
        "status": _codes(batch.status[row, beam], _STATUSES),
        "s": _floats(detection.beam_s[row, beam].astype(np.float64)),
        "set": _codes(detection.beam_set[row, beam], SETS),
        "object": pa.array(owner.astype(np.int32), mask=owner == 0),
    }
    return _record_batch(BEAMS, columns, detection, count)


def _record_batch(
    schema: pa.Schema, columns: dict[str, Any], detection: Detection, count: int
) -> pa.RecordBatch:
    """Complete `columns` by arrays of the same name in the detection, and by nulls for what is not known."""
    for field in schema:
        if field.name in columns:
            continue
        values = getattr(detection, field.name, None)
        if values is None:
            columns[field.name] = pa.nulls(count, field.type)
        elif pa.types.is_floating(field.type):
            columns[field.name] = _floats(values)
        else:
            columns[field.name] = pa.array(values, field.type)
    return pa.record_batch([columns[field.name] for field in schema], schema=schema)


def _constant(text: str, count: int) -> pa.DictionaryArray:
    return _codes(np.zeros(count, np.int32), (text,))


def _codes(codes: NDArray[Any], names: Sequence[str]) -> pa.DictionaryArray:
    values = pa.array(list(names), pa.string())
    return pa.DictionaryArray.from_arrays(pa.array(codes, pa.int32(), safe=False), values).cast(TEXT)


def _floats(values: NDArray[np.float64]) -> pa.DoubleArray:
    """NaN becomes null: undefined is not a number to compute with."""
    return pa.array(values, pa.float64(), from_pandas=True)


def _vertices(detection: Detection) -> pa.ListArray:
    kinds = pa.array(VERTEX_KINDS, pa.string()).take(pa.array(detection.vertex_kind))
    values = [_floats(detection.vertex_theta), _floats(detection.vertex_r), kinds]
    return _lists(
        "vertices", detection.vertex_offsets, pa.StructArray.from_arrays(values, fields=list(VERTEX))
    )


def _faces(detection: Detection) -> pa.ListArray:
    values = [
        _floats(detection.face_theta_i),
        _floats(detection.face_theta_f),
        _floats(detection.face_length),
        _floats(detection.face_rms),
    ]
    return _lists("faces", detection.face_offsets, pa.StructArray.from_arrays(values, fields=list(FACE)))


def _lists(name: str, offsets: NDArray[np.int32], values: pa.StructArray) -> pa.ListArray:
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), values, type=OBJECTS.field(name).type)
