"""Profile `robust` on scenes whose answer is known in closed form: straight segments and circles, cast by hand."""

from __future__ import annotations

from math import atan2, cos, inf, nan, pi, sin, sqrt, tan

import numpy as np
import pytest

from lidarcli.formalism import Detection, Parameters, detect
from tests.formalism.batches import batch_of
from tests.formalism.reference import EACH_BEARING_ONCE, FIRST_BEARING_TWICE, Sweep

Segment = tuple[float, float, float, float]
DEGREE = pi / 180


def cast(
    bearings: np.ndarray, segments: list[Segment], circles: tuple[tuple[float, float, float], ...] = ()
) -> list[float]:
    """The nearest hit of each beam [m]; inf where there is none."""
    nearest = np.full(len(bearings), inf)
    for x0, y0, x1, y1 in segments:
        for n, angle in enumerate(bearings):
            # (x0, y0) + t (dx, dy) = r (cos, sin), by Cramer's rule.
            dx, dy, c, s = x1 - x0, y1 - y0, cos(angle), sin(angle)
            determinant = c * dy - s * dx
            if abs(determinant) < 1e-12:
                continue
            r, t = (x0 * dy - y0 * dx) / determinant, (x0 * s - y0 * c) / determinant
            if r > 0 and -1e-12 <= t <= 1 + 1e-12:
                nearest[n] = min(nearest[n], r)
    for x, y, radius in circles:
        for n, angle in enumerate(bearings):
            along, across = x * cos(angle) + y * sin(angle), y * cos(angle) - x * sin(angle)
            if along > 0 and abs(across) < radius:
                nearest[n] = min(nearest[n], along - sqrt(radius**2 - across**2))
    return [float(value) for value in nearest]


def bearings_of(beams: int, angle_min: float, step: float) -> np.ndarray:
    return angle_min + step * np.arange(beams)


def turn(
    segments: list[Segment],
    circles: tuple[tuple[float, float, float], ...] = (),
    beams: int = 720,
    closing: str = EACH_BEARING_ONCE,
) -> Sweep:
    """A full turn from -π on."""
    step = 2 * pi / (beams - (closing == FIRST_BEARING_TWICE))
    return Sweep(cast(bearings_of(beams, -pi, step), segments, circles), -pi, step, closing)


def robust(sweep: Sweep, **overrides: object) -> Detection:
    """The default profile on one sweep."""
    return detect(batch_of([sweep]), Parameters.for_profile("robust", **overrides), per_beam=True)


def rectangle(x: float, y: float, length: float, width: float, yaw: float = 0.0) -> list[Segment]:
    """The sides of a box."""
    corners = []
    for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        a, b = u * length / 2, v * width / 2
        corners.append((x + a * cos(yaw) - b * sin(yaw), y + a * sin(yaw) + b * cos(yaw)))
    return [(*corners[k], *corners[(k + 1) % 4]) for k in range(4)]


ROOM = rectangle(0.3, -0.2, 8.0, 6.0)


@pytest.mark.parametrize(("beams", "closing"), [(720, EACH_BEARING_ONCE), (721, FIRST_BEARING_TWICE)])
def test_an_object_across_the_seam_is_one_object(beams: int, closing: str) -> None:
    sweep = turn([*ROOM, *rectangle(-2.2, 0.0, 0.4, 0.5)], beams=beams, closing=closing)
    found = robust(sweep)
    inside = int(atan2(0.25, 2.0) / (0.5 * DEGREE))
    assert len(found) == 1
    assert (found.beam_i[0], found.beam_f[0]) == (720 - inside, inside)
    assert found.beams[0] == 2 * inside + 1
    assert found.theta_i[0] == pytest.approx(pi - inside * 0.5 * DEGREE, abs=1e-9)
    assert found.theta_f[0] == pytest.approx(pi + inside * 0.5 * DEGREE, abs=1e-9)
    assert found.theta_min[0] == pytest.approx(pi, abs=1e-9)
    assert (found.x[0], found.y[0]) == pytest.approx((-2.0, 0.0), abs=1e-6)
    assert (found.box_x[0], found.box_y[0]) == pytest.approx((-2.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("lost", [nan, inf, -inf])
def test_a_lost_beam_inside_a_surface_does_not_split_it(lost: float) -> None:
    sweep = turn([*ROOM, *rectangle(2.2, 0.0, 0.4, 0.8)])
    whole = robust(sweep)
    sweep.ranges[360 + 4] = lost
    sweep.ranges[360 + 5] = lost
    found = robust(sweep)
    assert len(found) == len(whole) == 1
    assert (found.beam_i[0], found.beam_f[0]) == (whole.beam_i[0], whole.beam_f[0])
    assert found.beams[0] == whole.beams[0] - 2
    # What it has no range for is not part of it: those beams belong to S.
    assert found.beam_object is not None
    assert found.beam_object[0, 362:368].tolist() == [1, 1, 0, 0, 1, 1]
    assert found.object_beams[0] == found.beams[0]
    # One lost beam more than is bridged: two objects, whatever the trees say of each.
    for k in range(6, 10):
        sweep.ranges[360 + k] = lost
    assert len(robust(sweep, min_thing=0.0)) == len(robust(sweep, max_gap=5, min_thing=0.0)) == 2
    assert len(robust(sweep, max_gap=6)) == 1


@pytest.mark.parametrize("lost", [nan, inf, -inf])
@pytest.mark.parametrize(("away", "beams", "objects"), [(2.0, 3, 1), (2.0, 4, 2), (2.8, 3, 1), (3.0, 3, 2)])
def test_surfaces_beside_few_lost_beams_are_one_object_if_they_are_near(
    lost: float, away: float, beams: int, objects: int
) -> None:
    # Ends that are less than 10 cm apart, past up to three beams of half a degree.
    sweep = turn([*ROOM, *rectangle(away + 0.2, 0.0, 0.4, 0.8)])
    whole = robust(sweep)
    sweep.ranges[358 : 358 + beams] = [lost] * beams
    found = robust(sweep, min_thing=0.0)
    assert len(found) == objects
    assert (found.beam_i[0], found.beam_f[-1]) == (whole.beam_i[0], whole.beam_f[0])
    assert found.beams.sum() == whole.beams[0] - beams


@pytest.mark.parametrize("walls", [False, True])
def test_what_surrounds_the_sensor_without_a_break_is_no_object(walls: bool) -> None:
    # A drum of 0.6 m around the sensor: narrower than an object may be, but the sensor cannot be inside an object.
    for closing, beams in ((EACH_BEARING_ONCE, 360), (FIRST_BEARING_TWICE, 361)):
        found = robust(Sweep([0.6] * beams, -pi, 2 * pi / 360, closing), walls=walls)
        assert found.objects.tolist() == [0]
        assert found.noise_beams.tolist() == [beams]


def test_a_box_that_touches_a_wall_is_carved_out_of_it() -> None:
    # The wall y = 3 from x = -3 to 4; the box before it reaches from the wall to y = 2.4 and from x = -0.5 to 0.3.
    room: list[Segment] = [
        (4.0, -2.0, 4.0, 3.0),
        (4.0, 3.0, 0.3, 3.0),
        (0.3, 3.0, 0.3, 2.4),
        (0.3, 2.4, -0.5, 2.4),
        (-0.5, 2.4, -0.5, 3.0),
        (-0.5, 3.0, -3.0, 3.0),
        (-3.0, 3.0, -3.0, -2.0),
        (-3.0, -2.0, 4.0, -2.0),
    ]
    found = robust(turn(room))
    assert len(found) == 1
    # Only the front is seen: the sides turn away from the sensor.
    assert found.beams[0] == len(
        [
            k
            for k in range(720)
            if 2.4 / tan(k * DEGREE / 2 + 1e-12) <= 0.3 and 0 < k < 360 and 2.4 / tan(k * DEGREE / 2 + 1e-12) >= -0.5
        ]
    )
    assert found.y[0] == pytest.approx(2.4, abs=1e-3)
