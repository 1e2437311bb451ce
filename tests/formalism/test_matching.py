"""The same things in several runs: turned and shifted, moved, gone, new, and swapped."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from lidarcli.formalism.matching.runs import HERE, Matched, Motion, Standing, Things, align, alike, gains

Row = tuple[float, float, float, float]
ROOM: tuple[Row, ...] = (
    # x, y, length, width
    (2.0, -1.4, 0.8, 0.6),
    (2.5, 0.8, 0.7, 0.5),
    (0.9, 2.1, 0.55, 0.45),
    (-1.5, 1.7, 0.5, 0.5),
    (-1.9, -0.9, 0.4, 0.3),
)


def standing(rows: Sequence[Row], labels: Sequence[int] | None = None, sd: float = 0.01) -> Standing:
    """Things with sizes that are known to `sd`; NaN is not known."""
    x, y, length, width = np.array(rows, float).reshape(-1, 4).T
    return Standing(
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
    """The same things in coordinates from which `Motion(angle, x, y)` leads back."""
    cos, sin = math.cos(angle), math.sin(angle)
    return [
        (cos * (px - x) + sin * (py - y), cos * (py - y) - sin * (px - x), length, width)
        for px, py, length, width in rows
    ]


def matched(*runs: Standing, motions: Sequence[Motion | None] | None = None) -> list[Matched]:
    things = Things()
    return [things.take(run, motion) for run, motion in zip(runs, motions or [HERE] * len(runs), strict=True)]


def test_what_stands_still_is_the_same() -> None:
    first, second = matched(standing(ROOM), standing(ROOM[::-1]))
    assert first.thing.tolist() == [1, 2, 3, 4, 5]
    assert np.isnan(first.moved).all()
    assert np.isnan(first.score).all()
    assert second.thing.tolist() == [5, 4, 3, 2, 1]
    assert second.moved.tolist() == [0.0] * 5
    assert (second.score > 0.99).all()


def test_one_moved_one_gone_one_new() -> None:
    moved = (2.0, 2.4, 0.8, 0.6)
    new = (-2.5, -2.0, 1.2, 0.9)
    _, second = matched(standing(ROOM), standing([moved, *ROOM[1:4], new]))
    assert second.thing.tolist() == [1, 2, 3, 4, 6]
    assert second.moved[0] == pytest.approx(3.8)
    assert second.moved[1:4].tolist() == [0.0] * 3
    assert np.isnan([second.moved[4], second.score[4]]).all()
    assert 0.8 < second.score[0] < 1.0


def test_of_two_like_boxes_that_swapped_nobody_can_tell() -> None:
    like = [(0.0, 0.0, 0.6, 0.4), (3.0, 0.0, 0.6, 0.4)]
    _, second = matched(standing(like), standing(like[::-1]))
    assert second.thing.tolist() == [2, 1]
    assert second.moved.tolist() == [0.0, 0.0]


def test_two_boxes_of_other_sizes_that_swapped() -> None:
    _, second = matched(
        standing([(0.0, 0.0, 0.6, 0.4), (3.0, 0.0, 0.8, 0.5)]),
        standing([(3.0, 0.0, 0.6, 0.4), (0.0, 0.0, 0.8, 0.5)]),
    )
    assert second.thing.tolist() == [1, 2]
    assert second.moved.tolist() == [3.0, 3.0]


def test_labels_tell_things_of_one_size_apart() -> None:
    rows = [(0.0, 0.0, 0.6, 0.4), (3.0, 0.0, 0.6, 0.4)]
    _, second = matched(standing(rows, [0, 1]), standing(rows, [1, 0]))
    assert second.thing.tolist() == [2, 1]
    assert second.moved.tolist() == [3.0, 3.0]


def test_two_of_one_size_that_both_moved_are_half_sure() -> None:
    _, second = matched(
        standing([(0.0, 0.0, 0.6, 0.4), (3.0, 0.0, 0.6, 0.4)]),
        standing([(0.0, 3.0, 0.6, 0.4), (3.0, 3.0, 0.6, 0.4)]),
    )
    assert second.thing.tolist() == [1, 2]
    assert second.moved.tolist() == [3.0, 3.0]
    assert (second.score > 0.3).all()
    assert (second.score < 0.6).all()


def test_without_a_size_only_the_place_tells() -> None:
    nothing = (math.nan, math.nan)
    rows = [(0.0, 0.0, *nothing), (3.0, 0.0, *nothing)]
    _, second = matched(standing(rows), standing([(0.05, 0.0, *nothing), (3.0, 2.0, *nothing)]))
    assert second.thing.tolist() == [1, 3]
    assert second.moved[0] == pytest.approx(0.05)


def test_places_and_sizes_are_carried_from_run_to_run() -> None:
    """Moved twice; and what the second run did not see is remembered."""
    first = standing([(0.0, 0.0, 0.6, 0.4), (5.0, 5.0, 0.9, 0.3)])
    second, third = standing([(2.0, 0.0, 0.6, 0.4)]), standing([(2.0, 1.0, 0.6, 0.4), (5.0, 5.0, 0.9, 0.3)])
    _, two, three = matched(first, second, third)
    assert two.moved.tolist() == [2.0]
    assert three.thing.tolist() == [1, 2]
    assert three.moved.tolist() == [1.0, 0.0]


def test_sizes_are_joined_by_how_sure_they_are() -> None:
    things = Things()
    things.take(standing([(0.0, 0.0, 0.60, math.nan)], sd=0.0), HERE)
    things.take(standing([(0.0, 0.0, 0.64, 0.4)], sd=math.sqrt(3e-4)), HERE)
    # Variances 1e-4 and 4e-4, of which 1e-4 is that of being seen again.
    assert things.known.length == pytest.approx([0.608])
    assert things.known.length_sd == pytest.approx([math.sqrt(0.8e-4)])
    assert things.known.width == pytest.approx([0.4])


def test_where_nobody_knows_the_motion_all_is_new() -> None:
    _, second = matched(standing(ROOM), standing(ROOM), motions=[HERE, None])
    assert second.thing.tolist() == [6, 7, 8, 9, 10]


def test_a_run_that_nobody_can_place_is_no_place_to_look_for_things() -> None:
    rows: list[Row] = [(1.0, 1.0, 0.8, 0.6), (4.0, 2.0, 0.5, 0.4)]
    elsewhere: list[Row] = [(7.0, 1.0, 0.9, 0.3), (2.0, 5.0, 0.7, 0.2)]
    # The third run lies where the second, which nobody can place, says that its things are.
    first, second, third = matched(
        standing(rows), standing(elsewhere), standing(elsewhere), motions=[HERE, None, HERE]
    )
    assert first.thing.tolist() == [1, 2]
    assert second.thing.tolist() == [3, 4]
    assert third.thing.tolist() == [5, 6]
    assert np.isnan(third.moved).all()


def test_a_pair_is_weighed_by_both() -> None:
    one, other = standing([(0.0, 0.0, 0.6, 0.4)]), standing([(0.0, 0.0, 0.6, 0.5)])
    assert alike(one, one)[0, 0] > 5
    assert alike(one, other)[0, 0] < -5
    assert gains(one, other)[0, 0] < 2


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
    things = Things()
    things.take(standing(ROOM), HERE)
    found = things.take(run, motion, chance)
    assert found.thing.tolist() == [1, 2, 3, 4, 6]
    assert found.moved[:4] == pytest.approx([3.8, 0.0, 0.0, 0.0], abs=1e-9)


def test_places_that_are_not_exact() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    right = 0
    for _ in range(20):
        rows = np.column_stack(
            [rng.uniform(-5, 5, (12, 2)), np.sort(rng.uniform(0.2, 1.2, (12, 2)))[:, ::-1]]
        )
        again = np.array(seen_from([(a, b, c, d) for a, b, c, d in rows], 2.0, 3.0, 1.0))
        again[:, :2] += rng.normal(0, 0.05, (12, 2))
        again[:, 2:] += rng.normal(0, 0.01, (12, 2))
        order = rng.permutation(12)[:9]
        run = standing([(a, b, c, d) for a, b, c, d in again[order]])
        motion, _ = align(standing([(a, b, c, d) for a, b, c, d in rows]), run)
        things = Things()
        things.take(standing([(a, b, c, d) for a, b, c, d in rows]), HERE)
        found = things.take(run, motion)
        right += int((found.thing == order + 1).sum())
    assert right == 20 * 9


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


def test_another_place_is_not_found() -> None:
    rng = np.random.Generator(np.random.PCG64(8))
    for _ in range(10):
        one, other = (
            np.column_stack([rng.uniform(-5, 5, (6, 2)), np.sort(rng.uniform(0.2, 1.2, (6, 2)))[:, ::-1]])
            for _ in range(2)
        )
        motion, _ = align(standing([tuple(r) for r in one]), standing([tuple(r) for r in other]))
        assert motion is None


def test_nothing_to_align() -> None:
    assert align(standing([]), standing(ROOM)) == (None, 0.0)
    assert align(standing(ROOM), standing([])) == (None, 0.0)
    assert align(standing(ROOM[:2]), standing(seen_from(ROOM[:2], 1.0, 0.0, 0.0))) == (None, 0.0)
    assert align(standing(ROOM[:2]), standing(ROOM[:2]))[0] == HERE
