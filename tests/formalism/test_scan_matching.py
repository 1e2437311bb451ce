"""The matching of sweeps: the same bits compiled or not, where it slides, and what it does with a guess."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from lidarcli.formalism.scan_matching import Matcher
from lidarcli.sweeps.types import Float32, Float64
from lidarcli.system import compiled
from tests.places import ROOT

BEAMS = 181
BEARINGS = np.linspace(-np.pi, np.pi, BEAMS)
POSES = np.column_stack([0.04 * np.arange(40), 0.02 * np.arange(40), 0.03 * np.arange(40)])


def room(poses: Float64, x: tuple[float, float], y: tuple[float, float], reach: float = np.inf) -> Float32:
    """Ranges (S, B) inside of a rectangle [m]; NaN beyond the reach of the sensor."""
    angle = BEARINGS + poses[:, 2:]
    cos, sin = np.cos(angle), np.sin(angle)
    with np.errstate(divide="ignore"):
        to_x = np.where(cos > 0, x[1] - poses[:, :1], x[0] - poses[:, :1]) / cos
        to_y = np.where(sin > 0, y[1] - poses[:, 1:2], y[0] - poses[:, 1:2]) / sin
    ranges = np.minimum(np.abs(to_x), np.abs(to_y))
    return np.where(ranges <= reach, ranges, np.nan).astype(np.float32)


def found(ranges: Float32, told: Float64 | None = None, seconds: Float64 | None = None) -> Float64:
    """What the matcher finds of sweeps at 10 Hz, or at times (S,) [s]."""
    matcher, count = Matcher(BEAMS), len(ranges)
    timing = np.zeros((count, 3))
    timing[:, 0] = 0.1 * np.arange(count) if seconds is None else seconds
    answer = np.empty((count, matcher.columns))
    matcher.follow(
        np.ascontiguousarray(ranges),
        np.full(count, BEAMS, np.int32),
        np.full(count, BEARINGS[0]),
        np.full(count, BEARINGS[1] - BEARINGS[0]),
        timing,
        np.full((count, 4), np.nan) if told is None else told,
        answer,
    )
    return answer


def along_corridor(reach: float = 5.0) -> tuple[Float64, Float32]:
    """Poses along a straight corridor whose ends are out of reach, and what is seen."""
    poses = np.column_stack([0.05 * np.arange(60), np.zeros(60), np.zeros(60)])
    return poses, room(poses, (-50.0, 50.0), (-1.0, 1.0), reach)


def test_the_path_in_a_room_is_found() -> None:
    path = found(room(POSES, (-3.0, 4.0), (-2.0, 3.0)))
    np.testing.assert_allclose(path[:, :3], POSES, atol=0.01)
    assert (path[:, 6] == 1).all()
    assert path[:, 8].sum() == 0


@pytest.mark.parametrize("name", ["uneven", "far apart"])
def test_stamps_that_say_nothing_of_the_speed_do_no_harm(name: str) -> None:
    # Steps of 0.3 m and 6 degrees.
    poses = np.column_stack([0.3 * np.arange(20) - 3.0, 0.1 * np.arange(20), 0.1 * np.arange(20)])
    uneven = 0.2 * np.arange(20) + 0.08 * (np.arange(20) % 2)
    seconds = uneven if name == "uneven" else 5.0 * np.arange(20)
    path = found(room(poses, (-4.0, 5.0), (-2.0, 4.0)), seconds=seconds)
    np.testing.assert_allclose(path[:, 2], poses[:, 2], atol=0.02)
    np.testing.assert_allclose(path[:, :2], poses[:, :2] - poses[0, :2], atol=0.03)


def test_a_corridor_without_ends_is_told_and_a_guess_decides_there() -> None:
    poses, ranges = along_corridor()
    free = found(ranges)
    assert free[1:, 8].mean() >= 0.95
    assert abs(free[-1, 0]) < 0.5
    told = np.column_stack([1.02 * poses, np.zeros(len(poses))])
    guided = found(ranges, told)
    assert guided[1:, 8].mean() >= 0.95
    np.testing.assert_allclose(guided[:, 0], told[:, 0], atol=0.05)
    np.testing.assert_allclose(guided[:, 1:3], 0.0, atol=0.02)


def test_in_a_round_room_the_heading_stays() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.01, (60, BEAMS))
    path = found((3.0 + noise).astype(np.float32))
    np.testing.assert_allclose(path[:, :2], 0.0, atol=0.02)
    np.testing.assert_allclose(path[:, 2], 0.0, atol=0.01)


@pytest.mark.skipif(not compiled.is_there(), reason="the core was not compiled")
def test_the_compiled_matching_agrees_with_its_source() -> None:
    code = (
        "from tests.formalism.test_scan_matching import *\n"
        "for ranges in (room(POSES, (-3.0, 4.0), (-2.0, 3.0)), along_corridor()[1]):\n"
        "    print(found(ranges).tobytes().hex())\n"
    )
    answers = [
        subprocess.run(
            [sys.executable, "-c", code],
            cwd=ROOT,
            env=os.environ | {"LIDARCLI_COMPILED": core, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for core in ("yes", "no")
    ]
    assert len(answers[0]) > 10_000
    assert answers[0] == answers[1]
