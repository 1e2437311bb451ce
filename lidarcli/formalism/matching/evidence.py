"""Evidence for a catalogue from one sweep: sides, extents and legs of its objects, with their standard deviations.

A face is a side of the thing if both of its ends are the thing's own: a corner, or an edge that nothing hides. If an end is
hidden or cut off, the face may go on there, and its length is a lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lidarcli.formalism.detection import (
    BOTH_HIDDEN,
    CORNER,
    CUT,
    END_HIDDEN,
    FULL,
    IRREGULAR,
    LEGGED,
    PRISMATIC,
    ROUND,
    START_HIDDEN,
    WALL,
    Detection,
)
from lidarcli.formalism.matching.catalogue import Evidence
from lidarcli.formalism.ragged import spans
from lidarcli.sweeps import Float64, Int32, Int64, SweepBatch

UNIFORM_SD = 1.0 / math.sqrt(12.0)
"""Standard deviation of a uniform distribution over a step."""
CORNER_SD = 4.0
"""Standard deviation of a corner between lines through n points, in standard deviations of a range over √n."""
FEW_POINTS = 2.5
"""Least number of points of a face with a line; other corners are points."""
SHORT_FACE = 3.5
"""Least number of points of a face whose ends are certain."""
ROUGH = 0.05
"""Standard deviation of the extent of an irregular thing from all sides, as a share."""
MOST_PARTS = 8
"""Greatest number of legs of a thing whose legs are measured."""
LEAST_LENGTH = 1e-9
SEEN_AS = ((0.925, 0.02, 0.005, 0.05), (0.06, 0.855, 0.005, 0.08), (0.06, 0.14, 0.60, 0.20), (0.33, 0.13, 0.005, 0.535))
"""Shares of the sweeps that take a prismatic, round, legged or irregular thing (rows) for prismatic, round,
legged or irregular: those of docs/accuracy.md with more room for rare cases, as one sweep is no proof. Sweeps that find
no shape, as few beams hit the thing, are left out."""
ALIKE = (10.0, 10.0, 5.0, 4.0)
"""Weight of these shares for prismatic, round, legged and irregular things, in sweeps: a box looks like any box, while
each plant is different."""


def evidence_of(batch: SweepBatch, detection: Detection) -> Evidence:
    """Return the evidence of each object of a batch, by its own sweep alone.

    Parameters
    ----------
    batch : the sweeps
    detection : result of `detect` for them, K objects

    Returns
    -------
    Evidence
        (K,) each; walls have none
    """
    count = len(detection)
    shape = detection.shape
    likelihood = np.zeros((WALL + 1, 4))
    likelihood[: IRREGULAR + 1] = np.log(SEEN_AS).T
    step = np.abs(batch.angle_increment)[detection.row]
    sigma = np.nan_to_num(detection.noise[detection.row])
    nothing = np.full(count, np.nan)
    found = {name: nothing.copy() for name in ("side_1", "side_1_sd", "side_2", "side_2_sd", "across", "across_sd")}
    _sides(detection, step, sigma, found)
    _extents(detection, step, sigma, found)
    legs, span_1, span_2 = _legs(detection)
    seen = (shape != WALL) & (detection.beams > 1)
    return Evidence(
        shape=likelihood[shape],
        **found,
        least_1=np.where(seen, detection.box_length, np.nan),
        least_2=np.where(seen, detection.box_width, np.nan),
        least_sd=2.0 * sigma + 0.5 * detection.r_min * step,
        legs=legs,
        span_1=span_1,
        span_2=span_2,
        span_sd=sigma + detection.r_min * step,
        moved=np.zeros(count, np.bool_),
        intensity=nothing if detection.intensity is None else detection.intensity.astype(np.float64),
    )


def _sides(detection: Detection, step: Float64, sigma: Float64, found: dict[str, Float64]) -> None:
    """Measure the longest faces of prismatic things with two own ends, along and across their boxes."""
    vertices, faces = np.diff(detection.vertex_offsets), np.diff(detection.face_offsets)
    owner = np.repeat(np.arange(len(detection)), faces)
    # A thing that a thin one in front cuts in two has hidden ends in its middle.
    mine = (detection.shape == PRISMATIC) & (vertices == faces + 1)
    face = np.flatnonzero(mine[owner])
    owner = owner[face]
    place = face - detection.face_offsets[owner]
    first = detection.vertex_offsets[owner] + place
    theta, r = detection.vertex_theta, detection.vertex_r
    x, y = r * np.cos(theta), r * np.sin(theta)
    dx, dy = x[first + 1] - x[first], y[first + 1] - y[first]
    straight = np.maximum(np.hypot(dx, dy), LEAST_LENGTH)
    visibility = detection.visibility[owner]
    variance = np.zeros(len(face))
    points = np.abs(np.diff(theta)) / np.repeat(step, vertices)[:-1] + 1.0 if len(theta) else theta
    # A face at a grazing angle may end early, where the next beam is too far behind to belong to it.
    own = points[first] > SHORT_FACE
    for end, hidden in ((0, START_HIDDEN), (1, END_HIDDEN)):
        at = first + end
        edge = place == (faces[owner] - 1 if end else 0)
        hides = (visibility == hidden) | (visibility == BOTH_HIDDEN) | (visibility == CUT)
        own &= np.where(edge, ~hides, detection.vertex_kind[at] == CORNER)
        grazing = np.abs(dx * y[at] - dy * x[at]) / (straight * np.maximum(r[at], LEAST_LENGTH))
        along = np.minimum(r[at] * step[owner] / np.maximum(grazing, LEAST_LENGTH), straight)
        # The line of the face beyond the corner gives the end of this one.
        beyond = np.clip(at if end else at - 1, 0, len(points) - 1)
        sharp = ~edge & (np.minimum(points[beyond], points[first]) > FEW_POINTS)
        corner = CORNER_SD * sigma[owner] / np.sqrt(points[beyond])
        variance += np.where(sharp, corner, UNIFORM_SD * along) ** 2
    length = detection.face_length[face]
    yaw = detection.box_yaw[owner]
    axis = np.abs(dx * np.cos(yaw) + dy * np.sin(yaw)) < np.abs(dy * np.cos(yaw) - dx * np.sin(yaw))
    for code, side in ((0, "side_1"), (1, "side_2")):
        chosen = np.flatnonzero(own & (axis == code))
        chosen = chosen[np.argsort(length[chosen], kind="stable")]
        found[side][owner[chosen]] = length[chosen]
        found[side + "_sd"][owner[chosen]] = np.sqrt(variance[chosen])


def _extents(detection: Detection, step: Float64, sigma: Float64, found: dict[str, Float64]) -> None:
    """Measure round things and the extents of irregular ones across the line of sight, if both edges are their own."""
    spacing = detection.r_min * step
    whole = detection.visibility == FULL
    is_round, irregular = (whole & (detection.shape == code) for code in (ROUND, IRREGULAR))
    # One step more than from the first to the last beam: half a beam on either side.
    angle = detection.theta_f - detection.theta_i + step
    across = 2.0 * np.hypot(detection.x, detection.y) * np.tan(0.5 * np.minimum(angle, 0.5 * np.pi))
    sd = np.hypot(math.sqrt(2.0) * UNIFORM_SD * spacing, sigma)
    found["across"] = np.where(is_round, detection.box_length, np.where(irregular, across, np.nan))
    rough = np.hypot(sd, ROUGH * across)
    found["across_sd"] = np.where(is_round, sd, np.where(irregular, rough, np.nan))


def _legs(detection: Detection) -> tuple[Int32, Float64, Float64]:
    """Return the legs of legged things, and the sides of the smallest rectangles through their places [m]."""
    count = len(detection)
    vertices, faces = np.diff(detection.vertex_offsets), np.diff(detection.face_offsets)
    parts = np.where(detection.shape == LEGGED, vertices - faces, 0).astype(np.int32)
    span_1, span_2 = np.full(count, np.nan), np.full(count, np.nan)
    rows = np.flatnonzero((parts >= 2) & (parts <= MOST_PARTS))
    if not len(rows):
        return parts, span_1, span_2
    x, y = _places(detection, rows)
    picked, _, _ = rectangle(x, y)
    span_1[rows] = picked[0]
    span_2[rows] = np.where(parts[rows] > 2, picked[1], np.nan)
    return parts, span_1, span_2


def rectangle(x: Float64, y: Float64) -> tuple[Float64, Float64, Float64]:
    """Return the smallest rectangles around some places.

    Parameters
    ----------
    x, y : (R, N) of up to N places each [m], NaN where there are fewer

    Returns
    -------
    (2, R) sides, along the first axis and across [m]; (R,) direction of that axis [rad]; (2, R) middle [m]
    """
    there = np.isfinite(x)
    # The smallest one has a side through two of the places.
    one, other = np.triu_indices(x.shape[1], 1)
    angle = np.arctan2(y[:, other] - y[:, one], x[:, other] - x[:, one])
    cos, sin = np.cos(angle)[:, :, None], np.sin(angle)[:, :, None]
    u, v = x[:, None, :] * cos + y[:, None, :] * sin, y[:, None, :] * cos - x[:, None, :] * sin
    ends = [_ends(np.where(there[:, None, :], each, np.nan)) for each in (u, v)]
    reach = np.stack([high - low for low, high in ends])
    area = np.where(np.isfinite(reach[0]), reach[0] * reach[1], np.inf)
    best = np.argmin(area, axis=1)
    every = np.arange(len(x))
    along, across = (0.5 * (low + high)[every, best] for low, high in ends)
    cos, sin = cos[every, best, 0], sin[every, best, 0]
    middle = np.stack([cos * along - sin * across, sin * along + cos * across])
    return reach[:, every, best], angle[every, best], middle


def _ends(along: Float64) -> tuple[Float64, Float64]:
    """Return the least and the greatest value along the last axis, without NaN; NaN if there is none."""
    empty = np.isnan(along)
    none = empty.all(axis=-1)
    low = np.where(none, np.nan, np.where(empty, np.inf, along).min(axis=-1))
    high = np.where(none, np.nan, np.where(empty, -np.inf, along).max(axis=-1))
    return low, high


def _places(detection: Detection, rows: Int64) -> tuple[Float64, Float64]:
    """Return (R, MOST_PARTS) the middles of the vertices of every part of some objects [m], NaN for fewer parts."""
    begin = detection.vertex_offsets[rows].astype(np.int64)
    vertex, row, offsets = spans(begin, np.diff(detection.vertex_offsets)[rows].astype(np.int64))
    face, owner, _ = spans(
        detection.face_offsets[rows].astype(np.int64), np.diff(detection.face_offsets)[rows].astype(np.int64)
    )
    theta, r = detection.vertex_theta[vertex], detection.vertex_r[vertex]
    # A part begins with a vertex where no face ends.
    starts = ~np.isin(row + 1j * theta, owner + 1j * detection.face_theta_f[face])
    counted: Int64 = np.cumsum(starts)
    number: Int64 = counted - counted[offsets[:-1]][row]
    place = row * MOST_PARTS + np.minimum(number, MOST_PARTS - 1)
    weight = np.bincount(place, minlength=len(rows) * MOST_PARTS)
    with np.errstate(invalid="ignore"):
        x, y = (
            (np.bincount(place, at, len(weight)) / weight).reshape(-1, MOST_PARTS)
            for at in (r * np.cos(theta), r * np.sin(theta))
        )
    return x, y


def shape_likelihood(seen: Sequence[float]) -> list[float]:
    """Return the log-likelihood of each shape by many sweeps of a thing, which are not independent of each other.

    The shares of sweeps by shape differ from thing to thing (Dirichlet), and the sweeps of a thing follow its shares.

    Parameters
    ----------
    seen : numbers of sweeps that took it for prismatic, round, legged and irregular; fractions count too

    Returns
    -------
    Log-likelihoods of prismatic, round, legged and irregular

    >>> [round(each, 2) for each in shape_likelihood([1, 0, 0, 5])]
    [-9.49, -11.31, -8.34, -3.95]
    """
    result = []
    for shares, weight in zip(SEEN_AS, ALIKE, strict=True):
        log = math.lgamma(weight) - math.lgamma(weight + sum(seen))
        for share, count in zip(shares, seen, strict=True):
            log += math.lgamma(weight * share + count) - math.lgamma(weight * share)
        result.append(log)
    return result
