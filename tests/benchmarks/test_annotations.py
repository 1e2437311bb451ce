"""Which sweeps are judged by eye."""

from __future__ import annotations

from benchmarks.annotations.choice import CHOSEN, Chosen


def test_a_larger_count_keeps_what_is_judged_and_adds_what_lies_far_from_it() -> None:
    """Two of 100 sweeps, then two more, then again."""
    assert Chosen("log.bag", "/scan", 2).sweeps(100) == [25, 75]
    assert Chosen("log.bag", "/scan", 2).sweeps(100, [25, 75]) == [25, 75]
    assert Chosen("log.bag", "/scan", 4).sweeps(100, [25, 75]) == [0, 25, 50, 75]
    assert Chosen("log.bag", "/scan", 9).sweeps(3, [1]) == [0, 1, 2]


def test_each_chosen_topic_stands_once() -> None:
    """A log that stands twice would count twice."""
    assert len({(each.log, each.topic) for each in CHOSEN}) == len(CHOSEN)
