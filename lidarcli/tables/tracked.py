"""What tracking tells of rows that are there already, and the rows of the tracks table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.formalism import SETS, SHAPES, Detection
from lidarcli.formalism.detection import AGENT, OBJECT
from lidarcli.formalism.tracking.tracked import ENDS, Followed, Tracks
from lidarcli.sweeps import SweepBatch
from lidarcli.tables.arrays import answers, codes, floats, masked, plain
from lidarcli.tables.rows import Form, beams_of, constant
from lidarcli.tables.schemas import STAMP, TRACKS

_TRACKS = Form.of(TRACKS)


def tracked_objects(rows: pa.RecordBatch, followed: Followed, labels: Sequence[str] = ()) -> pa.RecordBatch:
    """Rows of the objects table with what tracking tells of each; `labels` are the names in the catalogue."""
    columns = {
        "set": codes(followed.set, SETS),
        "track": masked(followed.track, followed.track == 0),
        "vx": floats(followed.vx),
        "vy": floats(followed.vy),
        "moving": answers(followed.moving),
    }
    return _with(rows, columns | _labelled(followed, labels))


def tracked_sweeps(rows: pa.RecordBatch, followed: Followed) -> pa.RecordBatch:
    """Rows of the sweeps table with the counts of objects and agents as tracking tells them."""
    names = ("objects", "agents", "object_beams", "agent_beams")
    return _with(rows, {name: plain(getattr(followed, name)) for name in names})


def tracked_beams(
    rows: pa.RecordBatch, batch: SweepBatch, detection: Detection, followed: Followed
) -> pa.RecordBatch:
    """Rows of the beams table with the set of each beam as tracking tells it: what belongs to an agent is in A."""
    assert detection.beam_set is not None
    assert detection.beam_object is not None
    agent = np.flatnonzero(followed.set == AGENT)
    if not len(agent):
        return rows
    most = int(detection.object.max(initial=0))
    is_agent = np.zeros((len(batch), most + 1), bool)
    is_agent[detection.row[agent], detection.object[agent]] = True
    row, beam = beams_of(batch)
    sets = detection.beam_set[row, beam]
    sets[(sets == OBJECT) & is_agent[row, detection.beam_object[row, beam]]] = AGENT
    return _with(rows, {"set": codes(sets, SETS)})


def tracks_rows(
    log: str, topic: str, tracks: Tracks, frames: Sequence[str], labels: Sequence[str] = ()
) -> pa.RecordBatch:
    """Rows of the tracks table: one per thing of a topic, by its number; `frames` are names of sensor frames."""
    count = len(tracks)
    columns = {
        "log": constant(log, count),
        "topic": constant(topic, count),
        "frame_id": codes(tracks.frame, frames),
        "set": codes(tracks.set, SETS),
        "shape": codes(tracks.shape, SHAPES),
        "first_stamp": plain(tracks.first_stamp_ns, STAMP),
        "last_stamp": plain(tracks.last_stamp_ns, STAMP),
        "moved_at": masked(tracks.moved_at_ns, ~tracks.moved, STAMP),
        "end": codes(tracks.end, ENDS),
    }
    return _TRACKS.fill(columns | _labelled(tracks, labels), tracks, count)


def _labelled(found: Followed | Tracks, labels: Sequence[str]) -> dict[str, Any]:
    """Names in the catalogue; without one there are none, and all is null."""
    return {"label": codes(found.label, labels), "label_score": floats(found.label_score)}


def _with(rows: pa.RecordBatch, columns: dict[str, Any]) -> pa.RecordBatch:
    """The rows with other columns in the place of some."""
    names = rows.schema.names
    arrays = [columns.get(name, column) for name, column in zip(names, rows.columns, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=rows.schema)
