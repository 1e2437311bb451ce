"""Sweeps of the last seconds, which tell where it was free then; and how much a beam without a return proves."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native, sweeps
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.views import Views

KEPT = 16
"""Sweeps that are remembered …"""
APART = 0.3
"""[s] … so far apart at least."""
TURN = sweeps.TURN
VALID, NO_RETURN = sweeps.Status.VALID.value, sweeps.Status.NO_RETURN.value
FLICKER_SHARE = 0.02
"""Weight of a sweep in the mean numbers of beams that flicker."""
FLICKERS = 0.2
"""Where more than this share of the beams without a return have one a sweep later, none proves free space."""
HIT = 0.08
"""[m] A beam has ended at a point that is so near to its end, and twice the noise."""
LEAST_STEP = 1e-6
"""[rad] Beams that are closer together than this have no place of their own."""
NOTHING = -1.0
"""The range of a beam that tells nothing; of one without a return it is `FAR`."""
FAR = 1e9


class Memory:
    """The latest `KEPT` sweeps, with where the sensor was; the oldest is replaced by the newest."""

    def __init__(self, beams: int) -> None:
        """Room for sweeps of so many beams."""
        self.owner: list[Any] = []
        self.beams = beams
        self.count = 0
        """Sweeps that were remembered so far."""
        self.time = native.doubles(self.owner, KEPT)
        self.x = native.doubles(self.owner, KEPT)
        self.y = native.doubles(self.owner, KEPT)
        self.cos = native.doubles(self.owner, KEPT)
        self.sin = native.doubles(self.owner, KEPT)
        self.side = native.doubles(self.owner, KEPT)
        self.first = native.doubles(self.owner, KEPT)
        self.step = native.doubles(self.owner, KEPT)
        self.bearings = native.integers(self.owner, KEPT)
        self.period = native.integers(self.owner, KEPT)
        self.sigma = native.doubles(self.owner, KEPT)
        self.r = native.singles(self.owner, KEPT * beams)
        self.changes = 0.0
        """Beams that change between a range and no return from sweep to sweep, lately, on average …"""
        self.lost = 0.0
        """… and those without a return in either."""
        self.status = native.integers(self.owner, beams)
        """Of the sweep before, by beam."""
        self.watched = 0
        self.before = 0
        """Number of its beams."""

    def grow(self, old: Memory) -> None:
        """Take over what a smaller one remembers."""
        take_over(self, old)


def take_over(memory: Memory, old: Memory) -> None:
    """Copy what a smaller memory holds."""
    memory.count, memory.changes, memory.lost = old.count, old.changes, old.lost
    memory.watched, memory.before = old.watched, old.before
    for beam in range(old.before):
        memory.status[beam] = old.status[beam]
    for m in range(KEPT):
        memory.time[m], memory.x[m], memory.y[m] = old.time[m], old.x[m], old.y[m]
        memory.cos[m], memory.sin[m], memory.side[m] = old.cos[m], old.sin[m], old.side[m]
        memory.first[m], memory.step[m], memory.sigma[m] = old.first[m], old.step[m], old.sigma[m]
        memory.bearings[m], memory.period[m] = old.bearings[m], old.period[m]
        for k in range(old.bearings[m]):
            memory.r[m * memory.beams + k] = old.r[m * old.beams + k]


def watch(memory: Memory, views: Views, scans: Scans) -> None:
    """Count the beams that change between a range and no return."""
    begin, beams = views.row * scans.width, scans.beams[views.row]
    changes, lost = 0, 0
    if memory.before == beams:
        for beam in range(beams):
            now, then = scans.status[begin + beam], memory.status[beam]
            if now == NO_RETURN or then == NO_RETURN:
                lost += 1
                if now + then == NO_RETURN:
                    changes += 1
        # At first the sum of all so far.
        memory.watched += 1
        share = max(FLICKER_SHARE, 1.0 / memory.watched)
        memory.changes += share * (changes - memory.changes)
        memory.lost += share * (lost - memory.lost)
    for beam in range(beams):
        memory.status[beam] = scans.status[begin + beam]
    memory.before = beams


def is_steady(memory: Memory) -> bool:
    """Whether a beam without a return has met nothing."""
    return memory.changes <= FLICKERS * memory.lost


def range_at(views: Views, scans: Scans, position: int) -> float:
    """What the beam at a position says of free space [m]: its range, `FAR`, or `NOTHING`."""
    if views.period > 0:
        # C and Python disagree about what is left of negative numbers.
        position = (position + views.period) % views.period
    if position < 0 or position >= views.bearings:
        return NOTHING
    beam = views.row * scans.width + (views.bearings - 1 - position if views.reverse else position)
    if scans.status[beam] == VALID:
        return scans.ranges[beam]
    return FAR if views.steady and scans.status[beam] == NO_RETURN else NOTHING


def remember(memory: Memory, views: Views, scans: Scans, time: float) -> None:
    """Keep a sweep, unless the last one that was kept is too recent."""
    last = (memory.count + KEPT - 1) % KEPT
    if memory.count > 0 and 0.0 <= time - memory.time[last] < APART:
        return
    m = memory.count % KEPT
    memory.time[m] = time
    # One place stands for all from which the sweep was seen.
    looks.stand(views, 0.5)
    memory.x[m], memory.y[m], memory.cos[m], memory.sin[m] = views.x, views.y, views.cos, views.sin
    looks.stand(views, 0.0)
    memory.side[m], memory.first[m], memory.step[m] = views.side, views.first, views.step
    memory.bearings[m], memory.period[m], memory.sigma[m] = views.bearings, views.period, views.sigma
    for k in range(views.bearings):
        memory.r[m * memory.beams + k] = range_at(views, scans, k)
    memory.count += 1


def was_hit(memory: Memory, m: int, x: float, y: float) -> bool:
    """Whether a beam of a remembered sweep ended at a point of the world."""
    dx, dy = x - memory.x[m], y - memory.y[m]
    ahead = memory.cos[m] * dx + memory.sin[m] * dy
    left = memory.side[m] * (memory.cos[m] * dy - memory.sin[m] * dx)
    r = math.sqrt(ahead * ahead + left * left)
    past = math.atan2(left, ahead) - memory.first[m]
    past -= TURN * math.floor(past / TURN)
    if memory.step[m] < LEAST_STEP:
        return False
    at = int(past / memory.step[m] + 0.5)
    if memory.period[m] > 0:
        at %= memory.period[m]
    if at >= memory.bearings[m]:
        return False
    return abs(memory.r[m * memory.beams + at] - r) < HIT + 2.0 * memory.sigma[m]


def was_passed(memory: Memory, m: int, x: float, y: float, beside: float) -> bool:
    """Whether the beams of a remembered sweep passed a point of the world, all four around it.

    `beside`: by how much at least [m]; noise and the way between two beams come on top.
    """
    dx, dy = x - memory.x[m], y - memory.y[m]
    ahead = memory.cos[m] * dx + memory.sin[m] * dy
    left = memory.side[m] * (memory.cos[m] * dy - memory.sin[m] * dx)
    r = math.sqrt(ahead * ahead + left * left)
    # How far it is past the first bearing, within a turn.
    past = math.atan2(left, ahead) - memory.first[m]
    past -= TURN * math.floor(past / TURN)
    if memory.step[m] < LEAST_STEP:
        return False
    position = int(past / memory.step[m])
    need = r + beside + 3.5 * memory.sigma[m] + r * memory.step[m]
    for k in range(position - 1, position + 3):
        at = (k + memory.period[m]) % memory.period[m] if memory.period[m] > 0 else k
        if at < 0 or at >= memory.bearings[m] or memory.r[m * memory.beams + at] < need:
            return False
    return True
