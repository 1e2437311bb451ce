"""Rows completed by the tracking, and rows of the tracks table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.formalism import Detection
from lidarcli.formalism.detection import AGENT, NOISE, OBJECT
from lidarcli.formalism.mapping.places import ByPlace
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks, Trajectories
from lidarcli.sweeps import Int32, SweepBatch, UInt8
from lidarcli.tabular.arrays import answers, codes, masked, plain
from lidarcli.tabular.rows import FORMS, beams_of, constant
from lidarcli.tabular.schemas import STAMP


def tracked_objects(
    rows: pa.RecordBatch, tracked: TrackedBatch, labels: Sequence[str] = (), *, walls: bool, tracks: bool
) -> pa.RecordBatch:
    """Return rows of the objects table, completed by the tracking; `labels` are the names in the catalogue.

    Parameters
    ----------
    walls : whether bodies in set S have rows, too
    tracks : whether the columns on tracks are filled
    """
    sets = tracked.set
    columns: dict[str, Any] = {"object": tracked.object, "shape": tracked.shape, "thing": tracked.thing}
    if tracks:
        columns |= {
            "track": masked(tracked.track, tracked.track == 0),
            "vx": tracked.vx,
            "vy": tracked.vy,
            "moving": answers(tracked.moving),
            **_labelled(tracked, labels),
        }
    else:
        sets = np.where(sets == AGENT, OBJECT, sets)
    rows = FORMS["objects"].replaced(rows, {"set": sets} | columns)
    order = tracked.order if walls else tracked.order[tracked.set[tracked.order] != NOISE]
    whole = len(order) == len(rows) and np.array_equal(order, np.arange(len(rows)))
    return rows if whole else rows.take(plain(order))


def explained_objects(rows: pa.RecordBatch, told: ByPlace) -> pa.RecordBatch:
    """Return rows of the objects table whose column `why` also tells of places and maps, if it tells anything."""
    reasons = rows.column("why")
    if reasons.null_count == len(reasons):
        return rows
    # Imported here, as few ask for reasons.
    from lidarcli.formalism.detect import reasons_by_place

    lines = reasons_by_place(reasons.to_pylist(), told.place, told.map)
    return FORMS["objects"].replaced(rows, {"why": pa.array(lines, pa.string())})


def tracked_sweeps(rows: pa.RecordBatch, tracked: TrackedBatch, *, tracks: bool) -> pa.RecordBatch:
    """Return rows of the sweeps table with the counts of objects and agents of the tracking."""
    names = ("objects", "agents", "object_beams", "agent_beams", "noise_beams")
    counts = {name: getattr(tracked, name) for name in names}
    if not tracks:
        counts["objects"] = counts["objects"] + counts["agents"]
        counts["object_beams"] = counts["object_beams"] + counts["agent_beams"]
        counts["agents"], counts["agent_beams"] = (np.zeros_like(counts["agents"]), np.zeros_like(counts["agents"]))
    return FORMS["sweeps"].replaced(rows, counts)


def tracked_beams(
    rows: pa.RecordBatch, batch: SweepBatch, detection: Detection, tracked: TrackedBatch, *, tracks: bool
) -> pa.RecordBatch:
    """Return rows of the beams table with the object and the set of each beam of the tracking."""
    sets, number = beam_sets(batch, detection, tracked, tracks=tracks)
    row, beam = beams_of(batch)
    owner = number[row, beam]
    return FORMS["beams"].replaced(rows, {"set": sets[row, beam], "object": masked(owner, owner == 0)})


def beam_sets(
    batch: SweepBatch, detection: Detection, tracked: TrackedBatch, *, tracks: bool = True
) -> tuple[UInt8, Int32]:
    """Return the set of each beam and the number of its object, 0 for none, (S, B) each, by the tracking.

    `tracks`: tell agents from objects. The detection was made with `per_beam`.
    """
    assert detection.beam_object is not None
    most = int(detection.object.max(initial=0))
    number = np.zeros((len(batch), most + 1), np.int32)
    sets = np.full((len(batch), most + 1), NOISE, np.uint8)
    at = np.flatnonzero(tracked.set != NOISE)
    place = detection.row[at], detection.object[at]
    number[place] = tracked.object[at]
    sets[place] = tracked.set[at] if tracks else OBJECT
    row = np.arange(len(batch))[:, None]
    return sets[row, detection.beam_object], number[row, detection.beam_object]


def tracks_rows(log: str, topic: str, tracks: Tracks, frames: Sequence[str], labels: Sequence[str] = ()) -> pa.RecordBatch:
    """Return rows of the tracks table: one per track of a topic, by its number; `frames` are names of sensor frames."""
    count = len(tracks)
    columns = {
        "log": constant(log, count),
        "topic": constant(topic, count),
        "frame_id": codes(tracks.frame, frames),
        "moved_at": masked(tracks.moved_at_ns, ~tracks.moved, STAMP),
    }
    return FORMS["tracks"].fill(columns | _labelled(tracks, labels), tracks, count)


def trajectories_rows(log: str, topic: str, found: Trajectories) -> pa.RecordBatch:
    """Return rows of the trajectories table: one per track and sweep of a topic."""
    count = len(found)
    columns = {
        "log": constant(log, count),
        "topic": constant(topic, count),
        "sweep": found.sweep,
        "stamp": found.stamp_ns,
        "t": found.seconds,
    }
    return FORMS["trajectories"].fill(columns, found, count)


def _labelled(found: TrackedBatch | Tracks, labels: Sequence[str]) -> dict[str, Any]:
    """Return the columns of names in the catalogue; without one all are null."""
    return {"label": codes(found.label, labels), "label_score": found.label_score}
