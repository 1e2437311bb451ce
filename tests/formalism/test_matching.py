"""Things of two runs: in place, moved, and turned and shifted; without any free space."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from lidarcli.formalism.matching.alignment import StaticObjects, align
from lidarcli.formalism.matching.differences import Compared, FoundChange, RunEvidence
from lidarcli.formalism.matching.free_space import HERE, SpaceMotion
from lidarcli.options.choices import CHANGE_STATUSES, CHANGE_WHYS

Row = tuple[float, float, float, float]
ROOM: tuple[Row, ...] = (
    # x, y, length, width
    (2.0, -1.4, 0.8, 0.6),
    (2.5, 0.8, 0.7, 0.5),
    (0.9, 2.1, 0.55, 0.45),
    (-1.5, 1.7, 0.5, 0.5),
    (-1.9, -0.9, 0.4, 0.3),
)


def standing(rows: Sequence[Row], labels: Sequence[int] | None = None, sd: float = 0.01) -> StaticObjects:
    """Things with sizes that are known to `sd`; NaN is not known."""
    x, y, length, width = np.array(rows, float).reshape(-1, 4).T
    return StaticObjects(
        x=x,
        y=y,
        length=length,
        width=width,
        length_sd=np.where(np.isnan(length), np.nan, sd),
        width_sd=np.where(np.isnan(width), np.nan, sd),
        shape=np.full(len(x), -1, np.int32),
        label=np.full(len(x), -1, np.int32) if labels is None else np.array(labels, np.int32),
    )


def seen_from(rows: Sequence[Row], angle: float, x: float, y: float) -> list[Row]:
    """The same things in coordinates from which `SpaceMotion(angle, x, y)` leads back."""
    cos, sin = math.cos(angle), math.sin(angle)
    return [
        (cos * (px - x) + sin * (py - y), cos * (py - y) - sin * (px - x), length, width) for px, py, length, width in rows
    ]


def compared(
    first: StaticObjects, second: StaticObjects, motion: SpaceMotion = HERE, chance: float = 1.0
) -> list[FoundChange]:
    """Changes of two runs of which only the things are known."""
    runs = (RunEvidence(each, np.zeros(len(each)), None, np.empty((0, 2))) for each in (first, second))
    return Compared(*runs, motion, (None, None), chance).changes()


def pairs(found: list[FoundChange]) -> list[tuple[str, int, int]]:
    return sorted((CHANGE_STATUSES[each.status], each.first, each.second) for each in found)


def test_what_stands_still_is_known() -> None:
    found = compared(standing(ROOM), standing(ROOM[::-1]))
    assert pairs(found) == [("known", k, 4 - k) for k in range(5)]
    assert all(each.score > 0.99 for each in found)


def test_without_free_space_nothing_is_gone_or_new_or_moved_far() -> None:
    moved = (2.0, 2.4, 0.8, 0.6)
    new = (-2.5, -2.0, 1.2, 0.9)
    found = compared(standing(ROOM), standing([moved, *ROOM[1:4], new]))
    assert pairs(found) == [
        *(("known", k, k) for k in range(1, 4)),
        ("uncertain", -1, 0),
        ("uncertain", -1, 4),
        ("uncertain", 0, -1),
        ("uncertain", 4, -1),
    ]
    assert {CHANGE_WHYS[why] for why in (each.why for each in found) if why >= 0} == {"no free space"}


def test_what_was_moved_by_less_than_its_size_needs_no_free_space() -> None:
    """Two things cannot stand within each other, so one must have left its place."""
    found = compared(standing(ROOM), standing([(2.5, -1.4, 0.8, 0.6), *ROOM[1:]]))
    assert pairs(found) == [*(("known", k, k) for k in range(1, 5)), ("moved", 0, 0)]
    assert all(each.score > 0.9 for each in found)


def test_labels_tell_things_of_one_size_apart() -> None:
    row = [(0.0, 0.0, 0.6, 0.4)]
    assert pairs(compared(standing(row, [0]), standing(row, [0]))) == [("known", 0, 0)]
    assert [status for status, _, _ in pairs(compared(standing(row, [0]), standing(row, [1])))] == [
        "uncertain",
        "uncertain",
    ]


@pytest.mark.parametrize(("angle", "x", "y"), [(0.0, 0.0, 0.0), (0.7, 1.0, -2.0), (-3.0, -4.0, 0.5)])
def test_the_constellation_tells_how_a_run_lies(angle: float, x: float, y: float) -> None:
    motion, chance = align(standing(ROOM), standing(seen_from(ROOM, angle, x, y)))
    assert motion is not None
    assert (motion.angle, motion.x, motion.y) == pytest.approx((angle, x, y), abs=1e-9)
    assert chance > 0.99


def test_a_constellation_of_which_one_moved_one_left_and_one_came() -> None:
    now = [(2.0, 2.4, 0.8, 0.6), *ROOM[1:4], (-2.5, -2.0, 1.2, 0.9)]
    run = standing(seen_from(now, 1.0, 0.5, -0.5))
    motion, chance = align(standing(ROOM), run)
    assert motion is not None
    assert (motion.angle, motion.x, motion.y) == pytest.approx((1.0, 0.5, -0.5), abs=1e-9)
    assert chance > 0.9
    known = [pair for pair in pairs(compared(standing(ROOM), run, motion, chance)) if pair[0] == "known"]
    assert known == [("known", k, k) for k in range(1, 4)]


def test_a_square_of_like_boxes_lies_in_four_ways() -> None:
    """As the frames are is one of them, and taken; the chance says how sure that is."""
    square = [(x, y, 0.5, 0.5) for x, y in ((2.0, 2.0), (-2.0, 2.0), (-2.0, -2.0), (2.0, -2.0))]
    motion, chance = align(standing(square), standing(square))
    assert motion == HERE
    assert chance > 0.99
    turned, chance = align(standing(square), standing(seen_from(square, 0.4, 1.0, 0.0)))
    assert turned is not None
    assert (turned.angle - 0.4) % (math.pi / 2) == pytest.approx(0.0, abs=1e-9) or (
        (turned.angle - 0.4) % (math.pi / 2) == pytest.approx(math.pi / 2, abs=1e-9)
    )
    assert chance == pytest.approx(0.25, abs=1e-6)
