"""Masks: which ranges lie under a circle, a polygon or a sector, judged point by point, and what that does to a sweep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.errors import OptionError
from lidarcli.sweeps.masks import Circle, Mask, Masks, Mount, Polygon, Sector
from lidarcli.sweeps.range_rules import RangeRules, count_statuses, normalise
from lidarcli.sweeps.types import Status
from tests.sweeping import raw_sweeps

BEAMS = 90
places = st.floats(-2, 2).map(lambda value: round(value, 3))
points = st.tuples(places, places)
mounts = st.builds(Mount, st.just("laser"), st.just("base"), places, places, st.floats(-4, 4), st.booleans())


def is_in_polygon(corners: list[tuple[float, float]], x: float, y: float) -> bool:
    """By the edges that a ray to the right crosses."""
    inside = False
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside


def border(corners: list[tuple[float, float]], x: float, y: float) -> float:
    """The distance to the nearest edge."""
    found = []
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        along = (x1 - x0) ** 2 + (y1 - y0) ** 2
        share = 0.0 if along == 0 else ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / along
        share = min(max(share, 0.0), 1.0)
        found.append(math.hypot(x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0)))
    return min(found)


def under(mask: Mask, ranges: np.ndarray, *mounts: Mount, topic: str = "/scan") -> np.ndarray:
    return Masks((mask,), mounts).under(raw_sweeps(ranges, topic=topic), ranges.astype(np.float32))


def seen_from(mount: Mount | None, bearing: float, r: float) -> tuple[float, float]:
    """The point of a beam in the frame of the mask."""
    x, y = r * math.cos(bearing), r * math.sin(bearing)
    if mount is None:
        return x, y
    y = -y if mount.upside_down else y
    cos, sin = math.cos(mount.yaw), math.sin(mount.yaw)
    return mount.x + cos * x - sin * y, mount.y + sin * x + cos * y


@given(st.lists(points, min_size=3, max_size=9), st.one_of(st.none(), mounts), st.integers(0, 1000))
def test_a_polygon_is_what_is_inside_of_it(corners: list[tuple[float, float]], mount: Mount | None, seed: int) -> None:
    ranges = np.random.default_rng(seed).uniform(0.1, 4.0, (3, BEAMS)).astype(np.float32)
    mask = Mask(Polygon(tuple(corners)), frame="" if mount is None else "base")
    masked = under(mask, ranges, *([] if mount is None else [mount]))
    for row, beam in np.ndindex(ranges.shape):
        bearing = -math.pi + beam * 2 * math.pi / BEAMS
        x, y = seen_from(mount, bearing, float(ranges[row, beam]))
        if border(corners, x, y) > 1e-5:
            assert masked[row, beam] == is_in_polygon(corners, x, y)


@given(points, st.floats(0.05, 2), st.one_of(st.none(), mounts), st.integers(0, 1000))
def test_a_circle_is_what_is_near_its_centre(
    centre: tuple[float, float], radius: float, mount: Mount | None, seed: int
) -> None:
    ranges = np.random.default_rng(seed).uniform(0.1, 4.0, (3, BEAMS)).astype(np.float32)
    mask = Mask(Circle(*centre, radius), frame="" if mount is None else "/base")
    masked = under(mask, ranges, *([] if mount is None else [mount]))
    for row, beam in np.ndindex(ranges.shape):
        bearing = -math.pi + beam * 2 * math.pi / BEAMS
        x, y = seen_from(mount, bearing, float(ranges[row, beam]))
        away = math.hypot(x - centre[0], y - centre[1])
        if abs(away - radius) > 1e-5:
            assert masked[row, beam] == (away < radius)


def test_the_edge_of_a_circle_is_in_it() -> None:
    ranges = np.array([[0.3, np.nextafter(np.float32(0.3), np.float32(1)), 0.2, np.nan]], np.float32)
    assert under(Mask(Circle(0, 0, 0.3)), ranges).tolist() == [[True, False, True, False]]


@pytest.mark.parametrize(
    ("begin", "end", "beams"),
    [(-90, 0, {1, 2}), (170, -170, {0}), (-100, -80, {1}), (-180, 180, {0, 1, 2, 3}), (0, 0, {2}), (45, 315, {0, 1, 3})],
)
def test_a_sector_holds_beams_by_their_bearings(begin: float, end: float, beams: set[int]) -> None:
    # The beams look back, to the right, ahead and to the left.
    ranges = np.array([[0.5, 0.5, 0.5, 0.5], [0.2] * 4, [0.8] * 4, [0.81] * 4], np.float32)
    mask = Mask(Sector(math.radians(begin), math.radians(end), 0.3, 0.8))
    masked = under(mask, ranges)
    assert [set(np.flatnonzero(row).tolist()) for row in masked] == [beams, set(), beams, set()]


def test_a_mask_of_one_topic_leaves_others() -> None:
    ranges = np.full((1, 4), 0.5, np.float32)
    mask = Mask(Circle(0, 0, 1), topic="scan")
    assert under(mask, ranges, topic="/scan").all()
    assert not under(mask, ranges, topic="/rear_scan").any()


def test_mounts_lead_from_frame_to_frame() -> None:
    # The laser looks to the left, 0.2 m ahead on a plate that is 1 m ahead of the robot.
    plate = Mount("/laser", "plate", 0.2, 0.0, math.pi / 2)
    base = Mount("plate", "base", 1.0, 0.0, 0.0)
    ranges = np.full((1, 4), 0.5, np.float32)
    # Ahead of the laser is the left of the robot.
    mask = Mask(Circle(1.2, 0.5, 0.1), frame="base")
    assert np.flatnonzero(under(mask, ranges, base, plate)).tolist() == [2]


def test_a_frame_that_nothing_leads_to_is_an_error() -> None:
    ranges = np.full((1, 4), 0.5, np.float32)
    for mounts in ((), (Mount("laser", "plate", 0, 0, 0), Mount("plate", "laser", 0, 0, 0))):
        with pytest.raises(OptionError) as caught:
            under(Mask(Circle(0, 0, 1), frame="base"), ranges, *mounts)
        assert str(caught.value) == (
            "--mask: nothing leads from frame laser to base: add a [[mount]], or the 'topic' that the [[mask]] is for"
        )


def test_sweeps_of_any_geometry_and_frame_are_masked() -> None:
    ranges = np.full((3, 4), 0.5, np.float32)
    raw = raw_sweeps(
        ranges, frame_ids=("left", "right"), frame=[0, 1, 0], angle_min=[0, 0, np.pi / 2], angle_increment=np.pi / 2
    )
    ahead = Mask(Circle(0.5, 0, 0.1))
    assert np.argwhere(Masks((ahead,)).under(raw, ranges)).tolist() == [[0, 0], [1, 0], [2, 3]]
    turned = Masks(
        (Mask(Circle(0.5, 0, 0.1), frame="base"),),
        (Mount("left", "base", 0, 0, 0), Mount("right", "base", 0, 0, np.pi / 2)),
    )
    assert np.argwhere(turned.under(raw, ranges)).tolist() == [[0, 0], [1, 3], [2, 3]]


def test_only_ranges_are_masked_and_every_beam_has_one_status() -> None:
    nothing = [np.inf, 0.05, np.nan, 0.0]
    raw = raw_sweeps([[0.4, *nothing, 2.0], [0.4, *nothing, 0.6]], beams=[6, 5])
    batch = normalise(raw, np.arange(2), RangeRules(masks=Masks((Mask(Circle(0, 0, 0.5)),))))
    without = [Status.NO_RETURN, Status.TOO_CLOSE, Status.INVALID, Status.NO_RETURN]
    assert batch.status.tolist() == [[Status.MASKED, *without, Status.VALID], [Status.MASKED, *without, Status.PADDING]]
    assert np.isnan(batch.ranges[:, :5]).all()
    assert batch.ranges[0, 5] == 2.0
    assert count_statuses(batch.status)[: Status.PADDING].sum(axis=0).tolist() == [6, 5]
    assert "1 valid, 4 no_return, 2 too_close, 2 invalid, 2 masked" in str(batch.facts())
