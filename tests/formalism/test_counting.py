"""Which tracks are one person, and in which interval the true number of crossings lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pytest

from lidarcli.formalism.counting import DOUBLED, MISSED, PersonFinder, in_all, interval
from lidarcli.formalism.detection import AGENT, OBJECT
from lidarcli.formalism.tracking.results import HIDDEN, SEEN, Tracks, Trajectories

RATE = 10
Path = tuple[float, float, float, float, float, float]
"""Begin and end [s], place at the begin [m], velocity [m/s]."""


def rows_of(*paths: Path, hidden: Sequence[tuple[int, float, float]] = ()) -> Trajectories:
    """Rows of paths, which are tracks 1, 2, ...; some are hidden for a time."""
    found = []
    for track, (begin, end, x, y, vx, vy) in enumerate(paths, 1):
        for sweep in range(round(begin * RATE), round(end * RATE) + 1):
            after = sweep / RATE - begin
            unseen = any(track == one and low <= sweep / RATE <= high for one, low, high in hidden)
            found.append((track, sweep, x + vx * after, y + vy * after, vx, vy, HIDDEN if unseen else SEEN))
    order = np.random.default_rng(0).permutation(len(found))
    track, sweep, x, y, vx, vy, seen = (np.array(values)[order] for values in zip(*found, strict=True))
    none = np.zeros(len(found))
    known = {"track": track, "sweep": sweep, "stamp_ns": sweep * (10**9 // RATE), "x": x, "y": y, "vx": vx, "vy": vy}
    known |= {"sensor": none.astype(np.int32), "seen": seen}
    return Trajectories(**{each.name: known.get(each.name, none) for each in fields(Trajectories)})


def persons(*paths: Path, hidden: Sequence[tuple[int, float, float]] = (), **changed: Sequence[float]) -> list[int]:
    """The person of each track."""
    finder, rows = PersonFinder(), rows_of(*paths, hidden=hidden)
    finder.add(rows)
    count = len(paths)
    way = [(end - begin) * float(np.hypot(vx, vy)) for begin, end, _, _, vx, vy in paths]
    known = {"track": np.arange(1, count + 1), "set": np.full(count, AGENT), "length": np.full(count, np.nan)}
    known |= {"distance": np.array(way)} | {name: np.array(values) for name, values in changed.items()}
    columns = {each.name: known.get(each.name, np.zeros(count)) for each in fields(Tracks)}
    return finder.find(Tracks(**columns)).person.tolist()


WALK: Path = (0.0, 5.0, 0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize(("aside", "found"), [(0.3, [1, 1]), (0.48, [1, 1]), (0.52, [1, 2]), (0.75, [1, 2])])
def test_two_tracks_nearer_than_people_are_one(aside: float, found: list[int]) -> None:
    assert persons(WALK, (0.0, 5.0, 0.0, aside, 1.0, 0.0)) == found


def test_who_meets_stays_two() -> None:
    assert persons(WALK, (0.0, 5.0, 5.0, 0.1, -1.0, 0.0)) == [1, 2], "close in a few sweeps of many"
    assert persons(WALK, (1.0, 1.3, 1.0, 0.1, 1.0, 0.0), distance=[5.0, 5.0]) == [1, 2], "too few sweeps to tell"
    both = persons(WALK, (0.0, 5.0, 0.0, 0.1, 1.0, 0.0), hidden=[(2, 0.1, 4.9)], distance=[5.0, 5.0])
    assert both == [1, 2], "what is hidden is a guess"


@pytest.mark.parametrize(
    ("later", "found"),
    [
        ((5.2, 8.0, 5.2, 0.1, 1.0, 0.0), [1, 1]),
        ((4.8, 8.0, 4.8, 0.1, 1.0, 0.0), [1, 1]),
        ((5.2, 8.0, 6.2, 0.0, 1.0, 0.0), [1, 2]),
        ((5.7, 8.0, 5.7, 0.0, 1.0, 0.0), [1, 2]),
        ((5.4, 8.0, 5.4, 0.0, -2.0, 0.0), [1, 2]),
    ],
    ids=["goes on", "begins before the end", "elsewhere", "later", "comes from ahead"],
)
def test_a_track_goes_on_with_the_one_that_begins_at_its_end(later: Path, found: list[int]) -> None:
    assert persons(WALK, later) == found


def test_each_end_has_one_begin() -> None:
    left, right = (5.1, 8.0, 5.1, 0.2, 1.0, 0.3), (5.1, 8.0, 5.1, -0.1, 1.0, -0.3)
    assert persons(WALK, left, right) == [1, 2, 1], "the nearer one"


def test_three_tracks_of_one_person_and_pieces_of_the_log() -> None:
    paths = (WALK, (0.0, 5.0, 0.0, 0.2, 1.0, 0.0), (5.1, 9.0, 5.1, 0.0, 1.0, 0.0))
    assert persons(*paths) == [1, 1, 1]
    whole, finder = rows_of(*paths), PersonFinder()
    for low, high in ((0, 30), (31, 60), (61, 200)):
        own = (whole.sweep >= low) & (whole.sweep <= high)
        finder.add(Trajectories(**{each.name: getattr(whole, each.name)[own] for each in fields(Trajectories)}))
    count = {"track": np.arange(1, 4), "set": np.full(3, AGENT), "length": np.full(3, np.nan), "distance": np.full(3, 4.0)}
    tracks = Tracks(**{each.name: count.get(each.name, np.zeros(3)) for each in fields(Tracks)})
    assert finder.find(tracks).person.tolist() == [1, 1, 1]


def test_who_is_no_person() -> None:
    assert persons(WALK, hidden=[(1, 0.0, 5.0)]) == [0], "never seen"
    other = (0.0, 5.0, 0.0, 3.0, 1.0, 0.0)
    assert persons(WALK, other, set=[AGENT, OBJECT]) == [1, 0]
    assert persons(WALK, other, distance=[5.0, 1.9]) == [1, 0]
    assert persons(WALK, other, length=[0.4, 1.3]) == [1, 0]
    pieces = ((0.0, 1.2, 0.0, 0.0, 1.0, 0.0), (1.3, 2.4, 1.3, 0.0, 1.0, 0.0))
    assert persons(*pieces) == [1, 1], "2.3 m in two pieces"
    assert persons(pieces[0]) == [0]


@pytest.mark.parametrize(("observed", "agents"), [(1.0, 1.0), (1.0, 8.0), (0.6, 3.0), (0.2, 2.0)])
def test_true_numbers_lie_within(observed: float, agents: float) -> None:
    rng = np.random.default_rng(7)
    share, inside, widths = observed * (1.0 - MISSED * agents), 0, []
    for _ in range(2_000):
        true = int(rng.poisson(rng.choice([0.5, 4.0, 40.0])))
        seen = int(rng.binomial(true, share))
        low, high = interval(seen + int(rng.random() < seen * DOUBLED * agents), 0, observed, agents)
        assert high is not None
        inside += low <= true <= high
        widths.append(high - low)
    assert inside >= 0.9 * 2_000
    assert np.mean(widths) < 5.0 + 60.0 * (1.0 - observed)


def test_what_widens_an_interval() -> None:
    assert interval(0, 0, 1.0, 0.0) == (0, 0)
    assert interval(10, 0, 1.0, 0.0) == (10, 10)
    assert interval(10, 3, 1.0, 0.0) == (10, 13), "seen in part"
    assert interval(10, 0, 0.0, 2.0) == (9, None), "not observed"
    # 0.5^1 = 0.5 is below 0.95, so are 0.75, 0.875 and 0.9375.
    assert interval(0, 0, 0.5, 0.0) == (0, 4)
    highs = [interval(20, 0, observed, 2.0).high or 0 for observed in (1.0, 0.9, 0.5, 0.1)]
    assert highs == sorted(highs)
    low, high = interval(1_000_000, 0, 0.5, 4.0)
    assert high is not None
    assert 980_000 < low < 990_000 < 2_080_000 < high < 2_090_000


def test_all_intervals_together() -> None:
    rows = [
        {"start": 0, "end": 60, "count": 3, "unsure": 1, "observed": 1.0, "agents": 2.0},
        {"start": 60, "end": 80, "count": 1, "unsure": 0, "observed": 0.5, "agents": 0.0},
    ]
    whole = in_all(rows)
    assert (whole["start"], whole["end"], whole["count"], whole["unsure"]) == (0, 80, 4, 1)
    assert (whole["observed"], whole["agents"]) == (0.875, 2.0)
    assert (whole["low"], whole["high"]) == interval(4, 1, 0.875, 2.0)
