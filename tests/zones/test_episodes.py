"""Episodes of a zone against a state machine that takes one sweep after the other."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.formalism.zones import Episode, episodes
from lidarcli.sweeps.types import Bool, Int64

NEVER = 1 << 60


def one_by_one(
    enough: Bool, time_ns: Int64, trigger: int, release: int, hold_ns: int, longest_gap_ns: int
) -> list[Episode]:
    """The rules of `episodes`, sweep by sweep."""
    found = []
    first = last = None
    in_a_row = fewer_in_a_row = 0
    for k, (is_enough, now) in enumerate(zip(enough.tolist(), time_ns.tolist(), strict=True)):
        if k and now - int(time_ns[k - 1]) > longest_gap_ns:
            if first is not None:
                found.append(Episode(first, last, all(enough[: first + 1]) and first + 1 == trigger))
            first = last = None
            in_a_row = fewer_in_a_row = 0
        if is_enough:
            in_a_row, fewer_in_a_row, last = in_a_row + 1, 0, k
            if first is None and in_a_row == trigger:
                first = k
        else:
            in_a_row, fewer_in_a_row = 0, fewer_in_a_row + 1
            if first is not None and fewer_in_a_row >= release and now - int(time_ns[last]) >= hold_ns:
                found.append(Episode(first, last, all(enough[: first + 1]) and first + 1 == trigger))
                first = None
    if first is not None:
        found.append(Episode(first, last, True))
    return found


def drawn(rng: np.random.Generator) -> tuple[Bool, Int64, int, int, int, int]:
    """Hits that come in runs, at stamps 100 ms apart with gaps and stamps that are there twice, and what rules them."""
    count = int(rng.integers(0, 60))
    stays = rng.uniform(0.3, 0.95)
    enough = np.logical_xor.accumulate(rng.random(count) > stays) ^ bool(rng.integers(2))
    step = rng.choice([0, 100, 110, 700, 3000], count, p=[0.05, 0.7, 0.15, 0.07, 0.03]) * 1_000_000
    trigger, release = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    hold = int(rng.choice([0, 100, 250, 500, 2000])) * 1_000_000
    gap = int(rng.choice([500_000_000, 2_000_000_000, NEVER]))
    return enough.astype(np.bool_), np.cumsum(step).astype(np.int64), trigger, release, hold, gap


@pytest.mark.parametrize("cases", [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_random_hits(cases: int) -> None:
    rng = np.random.default_rng(11)
    lengths = set()
    for case in range(cases):
        enough, time_ns, trigger, release, hold, gap = drawn(rng)
        expected = one_by_one(enough, time_ns, trigger, release, hold, gap)
        found = episodes(enough, time_ns, trigger=trigger, release=release, hold_ns=hold, longest_gap_ns=gap)
        assert found == expected, (case, enough, time_ns, trigger, release, hold, gap)
        lengths.add(len(found))
    assert {0, 1, 2, 3} <= lengths
