"""From the flat arrays of a detection to rows of the tables, without a Python object per row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.formalism import SETS, SHAPES, VERTEX_KINDS, VISIBILITIES, Detection
from lidarcli.formalism.detection import CHANGES
from lidarcli.range_rules import count_statuses
from lidarcli.sweeps import STATUSES, SweepBatch
from lidarcli.tabular.arrays import codes, floats, masked, names_of, plain
from lidarcli.tabular.schemas import BEAMS, FACE, FLOAT, OBJECTS, STAMP, SWEEPS, VERTEX

if TYPE_CHECKING:
    from lidarcli.formalism.tracking.results import Tracks


@dataclass(frozen=True, slots=True)
class Form:
    """A schema as its rows are filled in: asking Arrow for it again and again takes longer than the work."""

    schema: pa.Schema
    fields: tuple[tuple[str, pa.DataType, bool], ...]
    """Name and type of each column, and whether it holds floating-point numbers."""

    @classmethod
    def of(cls, schema: pa.Schema) -> Form:
        """The form of a schema."""
        return cls(schema, tuple((each.name, each.type, pa.types.is_floating(each.type)) for each in schema))

    def fill(self, columns: dict[str, Any], found: Detection | Tracks, count: int) -> pa.RecordBatch:
        """Complete `columns` by arrays of the same name in what was found, and by nulls for what is not known."""
        for name, kind, is_float in self.fields:
            if name in columns:
                continue
            values = getattr(found, name, None)
            if values is None:
                columns[name] = pa.nulls(count, kind)
            else:
                columns[name] = floats(values, kind) if is_float else plain(values)
        return pa.RecordBatch.from_arrays([columns[name] for name, _, _ in self.fields], schema=self.schema)


_OBJECTS, _SWEEPS, _BEAMS = map(Form.of, (OBJECTS, SWEEPS, BEAMS))


def objects_rows(
    log: str, batch: SweepBatch, detection: Detection, labels: Sequence[str] = ()
) -> pa.RecordBatch:
    """Rows of the objects table: one per object, in the order of the detection (sweep, object).

    `labels` are the names that the labels of the detection point into, where it has some.
    """
    row = detection.row
    count = len(row)
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "frame_id": codes(batch.frame[row], batch.frame_ids),
        "sweep": plain(batch.sweep[row]),
        "stamp": plain(batch.stamp_ns[row], STAMP),
        "t": plain(batch.seconds()[row]),
        "set": codes(detection.set, SETS),
        "shape": codes(detection.shape, SHAPES),
        "visibility": codes(detection.visibility, VISIBILITIES),
        "vertices": _vertices(detection),
        "faces": _faces(detection),
    }
    if detection.change is not None:
        columns["change"] = codes(detection.change, CHANGES)
    if detection.label is not None:
        columns["label"] = codes(detection.label, labels)
    if detection.features is not None:
        # Who asks for no reasons does not wait for this import.
        from lidarcli.formalism.explanation import reasons

        columns["why"] = pa.array(reasons(detection.features, detection.thing), pa.string())
    if batch.poses is not None:
        # An object is seen from where the sensor was when it came to the beam in its middle.
        boxes = detection.box_x, detection.box_y, detection.box_yaw
        world = batch.poses.to_world(row, *boxes, detection.shares(batch))
        columns |= zip(("world_x", "world_y", "world_yaw"), map(floats, world), strict=True)
    return _OBJECTS.fill(columns, detection, count)


def sweeps_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Rows of the sweeps table: one per sweep of the batch."""
    count = len(batch)
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "frame_id": codes(batch.frame, batch.frame_ids),
        "sweep": plain(batch.sweep),
        "stamp": plain(batch.stamp_ns, STAMP),
        "t": plain(batch.seconds()),
        "beams": plain(batch.beams),
        "d_th": floats(detection.sweep_d_th),
    }
    columns |= zip(STATUSES, map(plain, count_statuses(batch.status)), strict=False)
    if detection.station is not None:
        columns["station"] = masked(detection.station, detection.station < 0)
    if (poses := batch.poses) is not None:
        columns |= {"pose_x": floats(poses.x), "pose_y": floats(poses.y), "pose_yaw": floats(poses.yaw)}
    return _SWEEPS.fill(columns, detection, count)


def beams_rows(log: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
    """Rows of the beams table: one per beam of the batch, padding left out.

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
    difference = detection.beam_difference
    columns = {
        "log": constant(log, count),
        "topic": constant(batch.topic, count),
        "sweep": plain(batch.sweep[row]),
        "beam": plain(beam.astype(np.int32)),
        "theta": floats(batch.bearings()[row, beam]),
        "r": floats(batch.ranges[row, beam]),
        "status": codes(batch.status[row, beam], STATUSES),
        "s": floats(detection.beam_s[row, beam]),
        "set": codes(detection.beam_set[row, beam], SETS),
        "object": masked(owner, owner == 0),
        "difference": pa.nulls(count, FLOAT) if difference is None else floats(difference[row, beam]),
    }
    return _BEAMS.fill(columns, detection, count)


def beams_of(batch: SweepBatch) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column of every beam of a batch, padding left out, in the order of the beams table."""
    row, beam = np.nonzero(np.arange(batch.width) < batch.beams[:, None])
    return row, beam


def constant(text: str, count: int) -> pa.DictionaryArray:
    """A column of one name."""
    return codes(np.zeros(count, np.uint8), (text,))


def _vertices(detection: Detection) -> pa.ListArray:
    kinds = names_of(detection.vertex_kind, VERTEX_KINDS)
    values = [floats(detection.vertex_theta), floats(detection.vertex_r), kinds]
    return _lists(
        "vertices", detection.vertex_offsets, pa.StructArray.from_arrays(values, fields=list(VERTEX))
    )


def _faces(detection: Detection) -> pa.ListArray:
    values = [
        floats(detection.face_theta_i),
        floats(detection.face_theta_f),
        floats(detection.face_length),
        floats(detection.face_rms),
    ]
    return _lists("faces", detection.face_offsets, pa.StructArray.from_arrays(values, fields=list(FACE)))


def _lists(name: str, offsets: NDArray[np.int32], values: pa.StructArray) -> pa.ListArray:
    return pa.ListArray.from_arrays(plain(offsets), values, type=OBJECTS.field(name).type)
