"""What tracking tells of rows that are there already, and the rows of the tracks table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.formalism import SETS, SHAPES, Detection
from lidarcli.formalism.detection import AGENT, NOISE, OBJECT
from lidarcli.formalism.tracking.results import ENDS, Followed, Tracks
from lidarcli.sweeps import Int32, SweepBatch, UInt8
from lidarcli.tabular.arrays import answers, codes, floats, masked, plain
from lidarcli.tabular.rows import Form, beams_of, constant
from lidarcli.tabular.schemas import STAMP, TRACKS

_TRACKS = Form.of(TRACKS)


def tracked_objects(
    rows: pa.RecordBatch, followed: Followed, labels: Sequence[str] = (), *, walls: bool, tracks: bool
) -> pa.RecordBatch:
    """Rows of the objects table with what tracking tells of each; `labels` are the names in the catalogue.

    Parameters
    ----------
    walls : whether what is in set S has rows, too
    tracks : whether the columns that tell of tracks are filled
    """
    sets = followed.set
    columns = {
        "object": plain(followed.object),
        "shape": codes(followed.shape, SHAPES),
        "thing": floats(followed.thing),
    }
    if tracks:
        columns |= {
            "track": masked(followed.track, followed.track == 0),
            "vx": floats(followed.vx),
            "vy": floats(followed.vy),
            "moving": answers(followed.moving),
            **_labelled(followed, labels),
        }
    else:
        sets = np.where(sets == AGENT, OBJECT, sets)
    rows = _with(rows, {"set": codes(sets, SETS)} | columns)
    order = followed.order if walls else followed.order[followed.set[followed.order] != NOISE]
    whole = len(order) == len(rows) and np.array_equal(order, np.arange(len(rows)))
    return rows if whole else rows.take(pa.array(order))


def tracked_sweeps(rows: pa.RecordBatch, followed: Followed, *, tracks: bool) -> pa.RecordBatch:
    """Rows of the sweeps table with the counts of objects and agents as tracking tells them."""
    names = ("objects", "agents", "object_beams", "agent_beams", "noise_beams")
    counts = {name: getattr(followed, name) for name in names}
    if not tracks:
        counts["objects"] = counts["objects"] + counts["agents"]
        counts["object_beams"] = counts["object_beams"] + counts["agent_beams"]
        counts["agents"], counts["agent_beams"] = (
            np.zeros_like(counts["agents"]),
            np.zeros_like(counts["agents"]),
        )
    return _with(rows, {name: plain(values) for name, values in counts.items()})


def tracked_beams(
    rows: pa.RecordBatch, batch: SweepBatch, detection: Detection, followed: Followed, *, tracks: bool
) -> pa.RecordBatch:
    """Rows of the beams table with the object and the set of each beam as tracking tells them."""
    sets, number = beam_sets(batch, detection, followed, tracks=tracks)
    row, beam = beams_of(batch)
    owner = number[row, beam]
    return _with(rows, {"set": codes(sets[row, beam], SETS), "object": masked(owner, owner == 0)})


def beam_sets(
    batch: SweepBatch, detection: Detection, followed: Followed, *, tracks: bool = True
) -> tuple[UInt8, Int32]:
    """(S, B) the set of each beam, and the number of its object, 0 for none, as tracking tells them.

    `tracks`: whether agents are told apart. The detection was made with `per_beam`.
    """
    assert detection.beam_object is not None
    most = int(detection.object.max(initial=0))
    number = np.zeros((len(batch), most + 1), np.int32)
    sets = np.full((len(batch), most + 1), NOISE, np.uint8)
    at = np.flatnonzero(followed.set != NOISE)
    place = detection.row[at], detection.object[at]
    number[place] = followed.object[at]
    sets[place] = followed.set[at] if tracks else OBJECT
    row = np.arange(len(batch))[:, None]
    return sets[row, detection.beam_object], number[row, detection.beam_object]


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
