"""What is said of each object, against plain numpy on its own points: box, faces, centroid, nearest point, chord."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.formalism import PROFILES, SHAPES, Detection, Parameters, detect
from lidarcli.formalism.detection import LEGGED, PRISMATIC, WALL
from lidarcli.formalism.parameters import Profile
from lidarcli.sweeps import Float64, SweepBatch
from tests.formalism.surroundings import simulated


@pytest.fixture(params=PROFILES)
def seen(request: pytest.FixtureRequest) -> tuple[SweepBatch, Detection]:
    """Objects of simulated scenes by each profile."""
    profile: Profile = request.param
    batch = simulated()
    return batch, detect(batch, Parameters.for_profile(profile), per_beam=True)


def points_of(batch: SweepBatch, found: Detection, k: int) -> np.ndarray:
    """(n, 4) x, y, θ, r of the points of object k from P_i to P_f; θ grows past the seam."""
    assert found.beam_object is not None
    row = found.row[k]
    beams = np.flatnonzero(found.beam_object[row] == found.object[k])
    theta = batch.angle_min[row] + batch.angle_increment[row] * beams
    theta = np.where(theta < found.theta_i[k] - 1e-9, theta + 2 * np.pi, theta)
    order = np.argsort(theta)
    theta, r = theta[order], batch.ranges[row, beams[order]].astype(float)
    return np.column_stack([r * np.cos(theta), r * np.sin(theta), theta, r])


def without_stray(points: Float64, found: Detection, k: int) -> Float64:
    """The points from which at most two at each end are left out: those outside of the box, which halves without them."""
    cos, sin = np.cos(found.box_yaw[k]), np.sin(found.box_yaw[k])
    off = np.abs(points @ np.array([[cos, -sin], [sin, cos]])) - [found.box_length[k] / 2, found.box_width[k] / 2]
    prism = found.shape[k] == PRISMATIC
    outside = (off > (0.03 + 5 * found.noise[found.row[k]] if prism else 1e-6)).any(axis=1)
    first, last = 0, len(points)
    while first < 2 and outside[first]:
        first += 1
    while len(points) - last < 2 and outside[last - 1]:
        last -= 1
    return points[first:last]


def test_boxes_are_tight_and_hold_every_point(seen: tuple[SweepBatch, Detection]) -> None:
    batch, found = seen
    for k in range(len(found)):
        points = points_of(batch, found, k)[:, :2] - [found.box_x[k], found.box_y[k]]
        if found.shape[k] not in (WALL, LEGGED):
            points = without_stray(points, found, k)
        cos, sin = np.cos(found.box_yaw[k]), np.sin(found.box_yaw[k])
        u, v = points @ [cos, sin], points @ [-sin, cos]
        half_length, half_width = found.box_length[k] / 2, found.box_width[k] / 2
        noise, shape = found.noise[found.row[k]], SHAPES[found.shape[k]]
        if shape == "round":
            # The square around the fitted circle, which also holds the side that is not seen.
            assert half_length == half_width
            assert np.hypot(u, v) == pytest.approx(half_length, abs=0.05 + 8 * noise)
            continue
        # The box of a prism holds its vertices, and ends half a beam further; its points scatter about the faces.
        spare = 0.03 + 5 * noise if shape == "prismatic" else 1e-9
        room = spare + (np.hypot(*np.diff(points, axis=0).T).max() if shape == "prismatic" else 0.0)
        for outermost, half in (
            (u.max(), half_length),
            (-u.min(), half_length),
            (v.max(), half_width),
            (-v.min(), half_width),
        ):
            assert half - room <= outermost <= half + spare
    assert (found.box_length >= found.box_width).all()
    assert (found.box_width >= 0).all()
    assert ((found.box_yaw > -np.pi / 2) & (found.box_yaw <= np.pi / 2)).all()
