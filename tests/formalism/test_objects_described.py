"""What is said of each object, against plain numpy on its own points: box, faces, centroid, nearest point, chord."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from lidarcli.formalism import PROFILES, SHAPES, VERTEX_KINDS, Detection, Parameters, detect
from lidarcli.formalism.detection import LEGGED, PRISMATIC, WALL
from lidarcli.formalism.parameters import Profile
from lidarcli.sweeps import Float64, SweepBatch
from tests.formalism.batches import batch_of
from tests.formalism.random_sweeps import random_sweep
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


def test_points_and_chord(seen: tuple[SweepBatch, Detection]) -> None:
    batch, found = seen
    assert len(found) > 200
    for k in range(len(found)):
        x, y, theta, r = points_of(batch, found, k).T
        assert len(r) == found.beams[k]
        assert (found.r_i[k], found.r_f[k], found.r_min[k]) == (r[0], r[-1], r.min())
        # A bearing past the seam is the logged one plus a turn; the float32 geometry of a log closes to 1e-7.
        assert found.theta_i[k] == pytest.approx(theta[0], abs=1e-9)
        assert found.theta_f[k] == pytest.approx(theta[-1], abs=1e-9)
        assert found.theta_min[k] == pytest.approx(theta[r.argmin()], abs=1e-9)
        assert found.x[k] == pytest.approx(x.mean(), abs=1e-9)
        assert found.y[k] == pytest.approx(y.mean(), abs=1e-9)
        assert found.width[k] == pytest.approx(np.hypot(x[-1] - x[0], y[-1] - y[0]), abs=1e-9)


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


def test_faces_join_the_vertices_and_fit_their_points(
    seen: tuple[SweepBatch, Detection], request: pytest.FixtureRequest
) -> None:
    batch, found = seen
    profile = request.node.callspec.params["seen"]
    for k in range(len(found)):
        points = points_of(batch, found, k)
        at = slice(found.vertex_offsets[k], found.vertex_offsets[k + 1])
        vertices = found.vertex_theta[at]
        kinds = [VERTEX_KINDS[kind] for kind in found.vertex_kind[at]]
        faces = slice(found.face_offsets[k], found.face_offsets[k + 1])
        # P_i and P_f are vertices, and a face lies between each vertex and the next: O ⊆ V ∪ F.
        assert kinds[0] == "start"
        if found.beams[k] > 1:
            assert kinds[-1] == "end"
            assert "start" not in kinds[1:]
            assert "end" not in kinds[:-1]
        assert (vertices[0], vertices[-1]) == (found.theta_i[k], found.theta_f[k])
        if len(vertices) != faces.stop - faces.start + 1:
            # A body of several runs: there is no face across the step between them.
            assert set(found.face_theta_i[faces]) | set(found.face_theta_f[faces]) == set(vertices)
            continue
        np.testing.assert_array_equal(found.face_theta_i[faces], vertices[:-1])
        np.testing.assert_array_equal(found.face_theta_f[faces], vertices[1:])
        x, y = found.vertex_r[at] * np.cos(vertices), found.vertex_r[at] * np.sin(vertices)
        longer = found.face_length[faces] - np.hypot(np.diff(x), np.diff(y))
        assert longer[1:-1] == pytest.approx(0, abs=1e-9)
        # At an edge of its own a thing ends half a beam past its last point, no further than the last two are apart.
        limits = np.zeros(len(longer))
        if profile == "robust" and len(points) > 1:
            limits[0] += np.hypot(*(points[1] - points[0])[:2])
            limits[-1] += np.hypot(*(points[-1] - points[-2])[:2])
        assert (longer > -1e-9).all()
        assert (longer < limits + 1e-9).all()
        corners = np.flatnonzero(~np.isin(vertices, points[:, 2]))
        for face, whole in enumerate(range(faces.start, faces.stop)):
            if np.isin([face, face + 1], corners).any():
                continue  # the line was fitted to points up to the beam nearest to such a corner
            low, high = found.face_theta_i[whole] - 1e-9, found.face_theta_f[whole] + 1e-9
            on = points[(points[:, 2] >= low) & (points[:, 2] <= high), :2]
            assert found.face_rms[whole] ** 2 == pytest.approx(np.linalg.eigvalsh(np.cov(on.T, bias=True))[0], abs=1e-12)


def test_every_literal_vertex_is_a_point_of_its_object() -> None:
    for points, theta, r in vertices_of("paper"):
        nearest = np.abs(points[:, 2] - theta).argmin()
        assert points[nearest, 2] == pytest.approx(theta, abs=1e-9)
        assert points[nearest, 3] == r


def test_every_robust_vertex_lies_on_the_outline_of_its_object() -> None:
    # A corner is where two faces meet: at most the splitting tolerance and two beams from a point of the object.
    moved = 0
    for points, theta, r in vertices_of("robust"):
        away = np.hypot(points[:, 0] - r * np.cos(theta), points[:, 1] - r * np.sin(theta)).min()
        moved += away > 1e-9
        spacing = np.hypot(*np.diff(points[:, :2], axis=0).T).max(initial=0.0)
        assert away <= 0.5 + 2 * spacing
    assert moved > 0


def vertices_of(profile: Profile) -> Iterator[tuple[NDArray[np.float64], float, float]]:
    """The points of the object and the polar coordinates of every vertex found in random sweeps."""
    rng = np.random.default_rng(2)
    batch = batch_of([random_sweep(rng) for _ in range(200)])
    found = detect(batch, Parameters.for_profile(profile), per_beam=True)
    for k in range(len(found)):
        points = points_of(batch, found, k)
        at = slice(found.vertex_offsets[k], found.vertex_offsets[k + 1])
        for theta, r in zip(found.vertex_theta[at], found.vertex_r[at], strict=True):
            yield points, theta, r
