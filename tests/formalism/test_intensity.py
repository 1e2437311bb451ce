"""The intensity of an object is the median over its own beams, against one object after the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.formalism import Detection, Parameters, detect, sweep
from lidarcli.formalism.detect import noise
from lidarcli.formalism.detection import REMOVED, WALL, grouped_medians
from lidarcli.formalism.subtraction import BackgroundDifference, changes
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import load_scene
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Closure, SweepBatch
from tests.places import SAMPLES


def lit(ranges: Any, intensities: Any, **geometry: float) -> SweepBatch:
    told = {"angle_min": -0.22, "angle_increment": 0.01} | geometry
    return replace(sweep(ranges, **told), intensities=np.atleast_2d(np.asarray(intensities, np.float32)))


def medians(batch: SweepBatch, found: Detection) -> list[float]:
    """Of the beams that the detection gives to each object."""
    assert batch.intensities is not None
    assert found.beam_object is not None
    expected = []
    for row, number in zip(found.row.tolist(), found.object.tolist(), strict=True):
        values = batch.intensities[row][found.beam_object[row] == number]
        values = values[~np.isnan(values)]
        expected.append(float(np.median(values.astype(float))) if len(values) else np.nan)
    return expected


CHAIRS = """
[sensor]
noise = 0.005
[[wall]]
points = [[-4, -4], [4, -4], [4, 4], [-4, 4]]
closed = true
""" + "".join(
    f"[[chair]]\nx = {x}\ny = {y}\nyaw = {yaw}\nleg = 0.09\n"
    for x, y, yaw in [(1.6, 0.2, 20), (-1.5, 0.05, 0), (0.1, 1.7, 40), (0.3, -1.8, 10)]
)
"""Things of several parts, between which walls are seen; one stands behind the sensor, at the seam."""
VIEWS: dict[str, dict[str, Any]] = {
    "open": {},
    "jitter": {"beams_jitter": 4},
    "closed": {"beams": 1081, "angle_min": -np.pi, "angle_increment": TURN / 1081},
    "nearly": {"beams": 720, "angle_min": 0.3, "angle_increment": TURN / 720 * 0.999, "beams_jitter": 1},
    "shared": {"beams": 721, "angle_min": -np.pi, "angle_increment": TURN / 720},
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("profile", ["robust", "paper"])
@pytest.mark.parametrize("scene", ["chairs", "people", "hall"])
def test_parts_of_objects_are_their_own_beams(scene: str, profile: Any, side: int, view: str, tmp_path: Path) -> None:
    """Also of what stands on legs, crosses the seam, or is seen by a sensor upside down."""
    (tmp_path / "chairs.toml").write_text(CHAIRS)
    sample = load_scene((tmp_path if scene == "chairs" else SAMPLES) / f"{scene}.toml")
    sensor = replace(sample.sensor, lost=0.05, **VIEWS[view])
    sensor = replace(sensor, angle_min=side * sensor.angle_min, angle_increment=side * sensor.angle_increment)
    raw, _, _ = simulate_sweep_arrays(replace(sample, sensor=sensor), 12, seed=3)
    intensities = np.random.default_rng(1).integers(1, 4000, raw.ranges.shape).astype(np.float32)
    batch = normalise(replace(raw, intensities=intensities), np.arange(len(raw)), RangeRules())
    parameters = replace(Parameters.for_profile(profile), group_gap=0.6)
    found = detect(batch, parameters, per_beam=True)
    assert found.intensity is not None
    assert len(found) > 12
    np.testing.assert_array_equal(found.intensity, np.float32(medians(batch, found)))
    several = np.diff(found.vertex_offsets) - np.diff(found.face_offsets) > 1
    if (scene, profile) == ("chairs", "robust"):
        assert np.count_nonzero(several) > 12
    if view == "shared":
        assert (batch.closure == Closure.SHARED).all()


def test_what_has_gone_returns_nothing_walls_do() -> None:
    """Against a background: one object has appeared, another is gone."""
    ranges = np.full((1, 60), 4.0, np.float32)
    ranges[0, 10:15] = 2.0
    batch = lit(ranges, np.arange(60.0))
    appeared, removed = np.zeros((1, 60), bool), np.zeros((1, 60), bool)
    appeared[0, 10:15], removed[0, 30:36] = True, True
    r_e = np.full((1, 60), 4.0, np.float32)
    r_e[0, 30:36] = 2.5
    difference = BackgroundDifference(
        station=np.zeros(1, np.int64),
        away=np.zeros(1),
        known=np.ones((1, 60), bool),
        r_e=r_e,
        difference=ranges - r_e,
        appeared=appeared,
        removed=removed,
    )
    found = changes(batch, difference, Parameters(walls=True), noise(batch))
    assert found.intensity is not None
    kinds = {
        "wall" if shape == WALL else "removed" if change == REMOVED else "appeared": intensity
        for shape, change, intensity in zip(
            found.shape.tolist(), (found.change if found.change is not None else []), found.intensity.tolist(), strict=True
        )
    }
    assert kinds["appeared"] == 12.0
    assert np.isnan(kinds["removed"])
    assert kinds["wall"] > 0
    assert changes(replace(batch, intensities=None), difference, Parameters(walls=True), noise(batch)).intensity is None


@given(st.lists(st.tuples(st.integers(0, 5), st.floats(width=32, allow_infinity=False)), max_size=40))
def test_medians_of_groups(pairs: list[tuple[int, float]]) -> None:
    owner = np.array([group for group, _ in pairs], np.int64)
    value = np.array([number for _, number in pairs], np.float32)
    found = grouped_medians(value, owner, 7)
    for group in range(7):
        mine = value[(owner == group) & ~np.isnan(value)].astype(float)
        np.testing.assert_array_equal(found[group], np.median(mine) if len(mine) else np.nan)
