"""From the flat arrays of a detection to rows of the tables, without a Python object per row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.columns import Column, Per
from lidarcli.formalism.detection import COLUMNS, Detection, fields_per
from lidarcli.formalism.tracking.results import Tracks, Trajectories
from lidarcli.range_rules import count_statuses
from lidarcli.sweeps import STATUSES, SweepBatch
from lidarcli.tabular.arrays import answers, codes, floats, masked, names_of, plain
from lidarcli.tabular.schemas import FACES, KINDS, SCHEMAS, TABLES, VERTICES, schema_of


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

    def replaced(self, rows: pa.RecordBatch, columns: dict[str, Any]) -> pa.RecordBatch:
        """Return the rows with some columns in the place of theirs."""
        return self.fill(dict(zip(rows.schema.names, rows.columns, strict=True)) | columns, None, len(rows))


def as_column(values: NDArray[Any], one: Column) -> pa.Array:
    """Return an array as the column that is declared."""
    if one.words:
        return names_of(values, one.words) if one.kind == "string" else codes(values, one.words)
    kind = KINDS[one.kind]
    return floats(values, kind) if pa.types.is_floating(kind) else plain(values, kind)


FORMS = {table: Form(table) for table in SCHEMAS}
"""Table of a log → its form."""


def objects_rows(log: str, batch: SweepBatch, detection: Detection, labels: Sequence[str] = ()) -> pa.RecordBatch:
    """Return rows of the objects table: one per object, in the order of the detection (sweep, object).

    `labels` are the names that the labels of the detection, if any, are indices of.
    """
    row = detection.row
    count = len(row)
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "frame_id": codes(batch.frame[row], batch.frame_ids),
        "sweep": batch.sweep[row],
        "stamp": batch.stamp_ns[row],
        "t": batch.seconds()[row],
        "vertices": _lists(detection, VERTICES, detection.vertex_offsets, "vertex"),
        "faces": _lists(detection, FACES, detection.face_offsets, "face"),
    }
    if detection.label is not None:
        columns["label"] = codes(detection.label, labels)
    if detection.features is not None:
        # Imported here, as few ask for reasons.
        from lidarcli.formalism.detect import reasons

        columns["why"] = pa.array(reasons(detection.features, detection.thing), pa.string())
    if batch.poses is not None:
        # An object is seen from where the sensor was when it came to the beam in its middle.
        boxes = detection.box_x, detection.box_y, detection.box_yaw
        world = batch.poses.to_world(row, *boxes, detection.shares(batch))
        columns |= zip(("world_x", "world_y", "world_yaw"), world, strict=True)
    return FORMS["objects"].fill(columns, detection, count)


def sweeps_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Return rows of the sweeps table: one per sweep of the batch."""
    count = len(batch)
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "frame_id": codes(batch.frame, batch.frame_ids),
        "sweep": batch.sweep,
        "stamp": batch.stamp_ns,
        "t": batch.seconds(),
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
        "theta": batch.bearings()[row, beam],
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
