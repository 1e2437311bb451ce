"""How a method does on the sweeps judged by eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.annotations.table import BUILDING, THING
from lidarcli.sweeps.types import Int64

SHARE = 0.7
"""A detection is right when this share of its beams that were judged thing or building are on things."""
HALF = 0.5
"""A thing is found when one right detection holds this share of its beams."""


@dataclass(frozen=True, slots=True)
class Counts:
    """They add up over sweeps."""

    detections: int = 0
    """Most of whose beams were judged thing or building."""
    right: int = 0
    things: int = 0
    found: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.detections + other.detections,
            self.right + other.right,
            self.things + other.things,
            self.found + other.found,
        )

    @property
    def precision(self) -> float:
        """Share of the detections that are right; 1 without any."""
        return self.right / self.detections if self.detections else 1.0

    @property
    def recall(self) -> float:
        """Share of the things that are found; 1 without any."""
        return self.found / self.things if self.things else 1.0


def count(labels: Int64, verdict: Int64, thing: Int64) -> Counts:
    """Compare the detections of a sweep, (B,) with 0 for none, with what was judged."""
    right, detections = [], 0
    for name in np.unique(labels[labels > 0]).tolist():
        mine = labels == name
        on_things, on_building = int(np.sum(verdict[mine] == THING)), int(np.sum(verdict[mine] == BUILDING))
        clear = on_things + on_building
        if 2 * clear < int(mine.sum()):
            continue
        detections += 1
        if on_things >= SHARE * clear:
            right.append(name)
    numbers = [int(number) for number in np.unique(thing[thing > 0])]
    found = 0
    for number in numbers:
        held = labels[(thing == number) & (verdict == THING)]
        most = max((int(np.sum(held == name)) for name in right), default=0)
        found += most >= HALF * len(held)
    return Counts(detections, len(right), len(numbers), found)
