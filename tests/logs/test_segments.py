"""Sensors that publish segments of a turn: joined, however the log is cut, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidarcli.logs.base import ReadReport
from lidarcli.logs.segments import join
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.sweeping import START, raw_sweeps

TURN_NS = 100_000_000
DEGREE = np.pi / 180


def turns(
    count: int, view: int = 270, first: float = -135, *, sign: int = 1, frame: str = "laser", seed: int = 0
) -> RawSweeps:
    """Turns with a beam in each degree, of which each was taken when the sensor looked there."""
    ranges = np.random.default_rng(seed).uniform(1, 9, (count, view)).astype(np.float32)
    return raw_sweeps(
        ranges,
        frame_ids=(frame,),
        angle_min=sign * first * DEGREE,
        angle_increment=sign * DEGREE,
        stamp_ns=START + TURN_NS * np.arange(count),
    )


def cut(whole: RawSweeps, beams: int) -> RawSweeps:
    """The turns as segments of some beams, one after the other."""
    parts = []
    for row in range(len(whole)):
        for begin in range(0, whole.ranges.shape[1], beams):
            part = whole.rows(slice(row, row + 1))
            late = TURN_NS * begin // 360
            size = min(beams, whole.ranges.shape[1] - begin)
            columns: dict[str, Any] = {
                "angle_min": part.angle_min + begin * part.angle_increment,
                "stamp_ns": part.stamp_ns + late,
                "record_ns": part.record_ns + late,
                "beams": np.full(1, size, np.int32),
                "ranges": part.ranges[:, begin : begin + size],
            }
            parts.append(replace(part, **columns))
    return concatenate(parts)


def joined(block: RawSweeps, pieces: int = 1) -> tuple[RawSweeps, list[str]]:
    """What becomes of messages that come in blocks of a size; and the notes."""
    report = ReadReport()
    size = -(-len(block) // pieces)
    blocks = [block.rows(slice(at, at + size)) for at in range(0, len(block), size)]
    return concatenate([*join(blocks, report)]), report.notes


def check_same(got: RawSweeps, want: RawSweeps) -> None:
    np.testing.assert_array_equal(got.ranges, want.ranges)
    np.testing.assert_array_equal(got.stamp_ns, want.stamp_ns)
    np.testing.assert_array_equal(got.record_ns, want.record_ns)
    np.testing.assert_allclose(got.angle_min, want.angle_min, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.angle_increment, want.angle_increment, rtol=0, atol=1e-12)
    assert got.beams.tolist() == want.beams.tolist()


@pytest.mark.parametrize("pieces", [1, 7, 10_000])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("view", "first", "beams"),
    [(270, -135, 30), (270, -135, 135), (360, -180, 30), (360, 0, 4), (360, -90, 180), (276, -138, 50), (120, -60, 40)],
)
def test_segments_become_the_turns_that_they_were(view: int, first: int, beams: int, sign: int, pieces: int) -> None:
    whole = turns(8, view, first, sign=sign)
    got, notes = joined(cut(whole, beams), pieces)
    check_same(got, whole)
    assert notes == [f"/scan: segments of {beams} deg are joined to turns of {view} deg; --segments keep leaves them"]
    assert got.time_increment is not None
    np.testing.assert_allclose(got.time_increment, TURN_NS / 360e9, rtol=1e-6)


def test_a_turn_that_is_not_complete_keeps_its_geometry() -> None:
    whole = turns(6)
    parts = cut(whole, 30)
    there = np.ones(len(parts), np.bool_)
    # The log begins and ends within a turn; of the third, two segments are lost, and the last but one as a whole.
    there[[0, 1, 20, 21, *range(36, 45), 53]] = False
    got, _ = joined(parts.rows(there))
    want = whole.ranges.copy()
    want[0, :60] = want[2, 60:120] = want[5, 240:] = np.nan
    keep = [0, 1, 2, 3, 5]
    np.testing.assert_array_equal(got.ranges, want[keep])
    np.testing.assert_allclose(got.stamp_ns, whole.stamp_ns[keep], rtol=0, atol=1)
    assert set(got.beams.tolist()) == {270}


def test_a_turn_is_lost_between_two_segments_that_go_on() -> None:
    """The time tells that the second one belongs to a later turn."""
    whole = turns(8)
    parts = cut(whole, 30)
    there = np.ones(len(parts), np.bool_)
    there[38:57] = False
    got, _ = joined(parts.rows(there))
    want = whole.ranges.copy()
    want[4, 60:] = want[6, :90] = np.nan
    np.testing.assert_array_equal(got.ranges, np.delete(want, 5, axis=0))


@pytest.mark.parametrize("pieces", [1, 11, 1000])
def test_segments_across_the_seam_are_cut_there(pieces: int) -> None:
    """Segments of 50 degrees, of which no turn holds a whole number."""
    whole = turns(10, 360, 0)
    flat = whole.ranges.reshape(1, -1)
    count = 72
    begins = 50 * np.arange(count)
    parts = raw_sweeps(
        flat.reshape(count, 50),
        angle_min=(begins % 360) * DEGREE,
        angle_increment=DEGREE,
        stamp_ns=START + TURN_NS * begins // 360,
    )
    got, _ = joined(parts, pieces)
    np.testing.assert_array_equal(got.ranges, whole.ranges)
    np.testing.assert_allclose(got.stamp_ns, whole.stamp_ns, rtol=0, atol=400_000)


@pytest.mark.parametrize("pieces", [1, 13, 1000])
def test_each_frame_of_a_topic_is_a_sensor(pieces: int) -> None:
    """Two layers in segments and a sensor beside them that publishes sweeps: in the order in which they are complete."""
    layers = [cut(turns(6, frame=f"world_1_{n}", seed=n), 30) for n in range(2)]
    other = turns(6, 360, -180, frame="other", seed=9)
    mixed = concatenate([*layers, other])
    order = np.argsort(mixed.stamp_ns, kind="stable")
    got, notes = joined(mixed.rows(order), pieces)
    assert len(notes) == 1
    names = [got.frame_ids[code] for code in got.frame]
    assert names == ["other", *["world_1_0", "world_1_1", "other"] * 5, "world_1_0", "world_1_1"]
    for n in range(2):
        mine = np.array([name == f"world_1_{n}" for name in names])
        np.testing.assert_array_equal(got.ranges[mine][:, :270], turns(6, frame="x", seed=n).ranges)
    mine = np.array([name == "other" for name in names])
    np.testing.assert_array_equal(got.ranges[mine], other.ranges)


def plain(**columns: Any) -> RawSweeps:
    ranges = np.random.default_rng(1).uniform(1, 9, (40, 60)).astype(np.float32)
    return raw_sweeps(ranges, angle_increment=DEGREE, **columns)


@pytest.mark.parametrize(
    "block",
    [
        plain(angle_min=-0.5),
        plain(angle_min=-0.5 + 0.01 * np.random.default_rng(2).normal(size=40)),
        plain(angle_min=np.where(np.arange(40) % 2, -1.0, 1.0)),
        turns(20, 360, 0),
        turns(20, 360, 0).rows(slice(0, 1)),
        cut(turns(1, 270), 90),
        raw_sweeps(np.ones((30, 1), np.float32), angle_min=0.0, angle_increment=0.0),
    ],
    ids=["narrow", "trembling", "two views", "full turns", "one", "too few", "a beam each"],
)
def test_sweeps_stay_as_they_are(block: RawSweeps) -> None:
    got, notes = joined(block, 3)
    np.testing.assert_array_equal(got.ranges, block.ranges)
    np.testing.assert_array_equal(got.angle_min, block.angle_min)
    assert notes == []


def test_odd_numbers_end_in_sweeps_all_the_same() -> None:
    whole = cut(turns(8, 360, 0), 30)
    begin = whole.angle_min.copy()
    step = whole.angle_increment.copy()
    begin[60], step[61], step[62] = 1e300, -1e300, 1e-300
    got, _ = joined(replace(whole, angle_min=begin, angle_increment=step), 5)
    assert set(got.beams.tolist()) == {360}
    assert np.isfinite(got.angle_min).all()
    assert len(got) >= 8


def test_equal_stamps_leave_the_time_of_a_beam_to_the_header() -> None:
    parts = cut(turns(5), 90)
    stamps = np.repeat(START + TURN_NS * np.arange(5), 3)
    told = np.full(len(parts), 0.001, np.float32)
    got, _ = joined(replace(parts, stamp_ns=stamps, record_ns=stamps, time_increment=told))
    assert got.time_increment is not None
    assert got.time_increment.tolist() == [float(np.float32(0.001))] * 5
    assert got.stamp_ns.tolist() == stamps[::3].tolist()
