"""Intensity of objects: the median over their own beams, for all objects of a batch at once."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.detection import Detection
from lidarcli.formalism.ragged import grouped_medians, spans
from lidarcli.sweeps import TURN, Closure, Float32, Float64, Int64, Status, SweepBatch

MOST_INTENSITY = 1e9
"""Greatest intensity that a sensor can mean, in any unit; the bytes of a broken message may give more."""


def object_intensities(batch: SweepBatch, found: Detection) -> Float32:
    """Return the median intensity of each object.

    Parameters
    ----------
    batch : S sweeps with intensities
    found : K objects in them

    Returns
    -------
    (K,) in the unit of the sensor; NaN where no beam of the object has an intensity, or it is above `MOST_INTENSITY`
    """
    if batch.intensities is None:
        return np.full(len(found), np.nan, np.float32)
    owner, first, last = _parts(batch, found)
    row = found.row[owner]
    count = (batch.beams - (batch.closure == Closure.SHARED)).astype(np.int64)[row]
    size = last - first
    # A part across the seam begins at the end of the sweep and ends at its start.
    size += np.where(size < 0, count, 0) + 1
    beam, part, _ = spans(first, size)
    beam -= np.where(beam >= count[part], count[part], 0)
    at = row[part] * batch.width + beam
    values = batch.intensities.ravel()[at]
    # Some beams between those of an object are lost.
    mine = batch.status.ravel()[at] == Status.VALID.value
    medians = grouped_medians(values[mine], owner[part[mine]], len(found))
    with np.errstate(invalid="ignore"):
        medians[~(np.abs(medians) <= MOST_INTENSITY)] = np.nan
    return medians.astype(np.float32)


def _parts(batch: SweepBatch, found: Detection) -> tuple[Int64, Int64, Int64]:
    """Return the connected parts of all objects: the object of each part, and its first and last beam."""
    vertices = np.diff(found.vertex_offsets).astype(np.int64)
    several = vertices - np.diff(found.face_offsets) > 1
    whole = np.flatnonzero(~several)
    owner, first, last = whole, found.beam_i[whole].astype(np.int64), found.beam_f[whole].astype(np.int64)
    if not several.any():
        return owner, first, last
    some = np.flatnonzero(several)
    vertex, mine, _ = spans(found.vertex_offsets[some].astype(np.int64), vertices[some])
    faces = np.diff(found.face_offsets).astype(np.int64)[some]
    face, its, _ = spans(found.face_offsets[some].astype(np.int64), faces)
    theta = found.vertex_theta[vertex]
    # A face leads from one vertex to the next: a part begins at a vertex where no face ends, and ends where none begins.
    # Object and bearing are the two parts of one complex number, so that pairs can be looked up among pairs.
    bearing = mine + 1j * theta
    begins = ~np.isin(bearing, its + 1j * found.face_theta_f[face])
    ends = ~np.isin(bearing, its + 1j * found.face_theta_i[face])
    parts = some[mine[begins]]
    one, other = (_beam_at(batch, found.row[parts], theta[which]) for which in (begins, ends))
    falls = batch.angle_increment[found.row[parts]] < 0
    return (
        np.concatenate([owner, parts]),
        np.concatenate([first, np.where(falls, other, one)]),
        np.concatenate([last, np.where(falls, one, other)]),
    )


def _beam_at(batch: SweepBatch, row: Int64, theta: Float64) -> Int64:
    """Return the beams of sweeps at some bearings, which may go on past a full turn."""
    step = batch.angle_increment[row]
    place = (theta - batch.angle_min[row]) / step
    turn = TURN / np.abs(step)
    place += np.where(place < -0.5, turn, 0.0)
    place -= np.where(place > batch.beams[row] - 0.5, turn, 0.0)
    beams: Int64 = np.rint(place).astype(np.int64)
    return np.clip(beams, 0, batch.beams[row] - 1)
