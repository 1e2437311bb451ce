"""Persons: bodies that take up to two slim views in every sweep, as legs swing, hide each other and meet.

A leg that is shown to move founds a person. From then on the person is followed by the middle of its legs, and the views
near it are its own, whichever leg they were taken for.
"""

from __future__ import annotations

from typing import Any

from lidarcli import native
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import life
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.sightings import Sightings
from lidarcli.formalism.tracking.views import Views

SLIM = 0.3
"""[m] A leg is no wider …"""
WIDE = 0.65
"""[m] … and two in one view no wider than this."""
REACH = 0.65
"""[m] A leg is no further from the middle of its person."""
SPREAD = 0.4
"""[m] Standard deviation of that, roughly."""
LOYALTY = 0.6
"""How much a leg that was this person's before comes first."""
STANDS = 12
"""Sightings of a body from which on it is no leg of somebody, unless it was one before."""
PAIR_VAR = 0.0036
"""[m²] Variance of the middle of two legs: (6 cm)² …"""
ONE_VAR = 0.0484
"""[m²] … and that of a person of whom one is seen: (22 cm)²."""
WIDE_VAR = 0.01
"""[m²] The same of two legs in one view."""
RADIUS = 0.2
"""[m] Half of the width of a person at its legs."""


class Persons:
    """Room for the views of one sweep and whom they may belong to."""

    def __init__(self, views: int) -> None:
        self.owner: list[Any] = []
        self.most = 8 * views + 64
        self.count = 0
        self.person = native.integers(self.owner, self.most)
        self.view = native.integers(self.owner, self.most)
        self.cost = native.doubles(self.owner, self.most)
        self.entry = native.integers(self.owner, views)
        """Of each view, its sighting in the log, -1 for none."""
        self.taken = native.integers(self.owner, views)
        """Whether somebody has it."""


def follow(
    persons: Persons,
    bodies: Bodies,
    views: Views,
    scans: Scans,
    owner: Any,
    log: Sightings,
    time: float,
    sweep: int,
) -> None:
    """Give slim views to persons, and let legs that move found new ones.

    Parameters
    ----------
    owner : slot of the body of each view; that of a person takes its place
    time, sweep : of this sweep [s], and how many were before
    """
    for k in range(views.count):
        persons.taken[k] = 0
    _collect(persons, bodies, views, owner)
    _sort(persons)
    for i in range(persons.count):
        _give(persons, bodies, views, persons.person[i], persons.view[i])
    for b in range(bodies.high):
        if bodies.state[b] == things.LIVE and bodies.kind[b] == things.PERSON:
            _update(persons, bodies, views, scans, owner, log, b, time, sweep)
    for k in range(views.count):
        leg = owner[k]
        if leg >= 0 and persons.taken[k] == 0 and bodies.moved[leg] == 1 and _is_leg(bodies, leg):
            b = _without_leg(bodies, views, k)
            if b >= 0:
                bodies.settled[b] += 1
                _join(bodies, leg, b)
                _rename(persons, bodies, log, b, k)
                owner[k] = b
            else:
                owner[k] = _found(persons, bodies, views, log, leg, k, time, sweep)


def _without_leg(bodies: Bodies, views: Views, k: int) -> int:
    """The nearest person within reach of a view that has a leg left; -1 for none."""
    best, least = -1, REACH * REACH
    for b in range(bodies.high):
        if bodies.state[b] != things.LIVE or bodies.kind[b] != things.PERSON or bodies.settled[b] >= 2:
            continue
        x, y = things.centre(bodies, b)
        dx, dy = views.middle_x[k] - x, views.middle_y[k] - y
        if dx * dx + dy * dy < least:
            best, least = b, dx * dx + dy * dy
    return best


def _is_leg(bodies: Bodies, b: int) -> bool:
    """Whether a body is slim enough."""
    return bodies.kind[b] == things.DISC and bodies.h[2 * b] + bodies.h[2 * b + 1] <= SLIM


def _collect(persons: Persons, bodies: Bodies, views: Views, owner: Any) -> None:
    """All pairs of persons and views that are near each other."""
    persons.count = 0
    for b in range(bodies.high):
        if bodies.state[b] != things.LIVE or bodies.kind[b] != things.PERSON:
            continue
        x, y = things.centre(bodies, b)
        # Two places, for two legs.
        bodies.settled[b] = 0
        for k in range(views.count):
            leg = owner[k]
            if views.chord[k] > WIDE or (leg >= 0 and not _may_be_leg(bodies, leg)):
                continue
            dx, dy = views.middle_x[k] - x, views.middle_y[k] - y
            far = dx * dx + dy * dy
            if far > REACH * REACH or persons.count >= persons.most:
                continue
            i = persons.count
            persons.person[i], persons.view[i], persons.cost[i] = b, k, far / (SPREAD * SPREAD)
            if leg >= 0 and bodies.member[leg] == bodies.number[b]:
                persons.cost[i] -= LOYALTY
            persons.count += 1


def _may_be_leg(bodies: Bodies, b: int) -> bool:
    """Whether a body may be a leg of a person: it was one before, or is hardly known yet."""
    return bodies.member[b] != 0 or bodies.sightings[b] < STANDS


def _sort(persons: Persons) -> None:
    """The cheapest pairs first, by insertion: there are few."""
    for i in range(1, persons.count):
        person, view, cost = persons.person[i], persons.view[i], persons.cost[i]
        at = i
        while at > 0 and cost < persons.cost[at - 1]:
            persons.person[at], persons.view[at] = persons.person[at - 1], persons.view[at - 1]
            persons.cost[at] = persons.cost[at - 1]
            at -= 1
        persons.person[at], persons.view[at], persons.cost[at] = person, view, cost


def _give(persons: Persons, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Let a person have a view, if it is free and there is a leg left."""
    if persons.taken[k] != 0 or bodies.settled[b] >= 2:
        return
    legs = 2 if views.chord[k] > SLIM else 1
    if legs == 2 and bodies.settled[b] > 0:
        return
    persons.taken[k] = b + 1
    bodies.settled[b] += legs


def _update(
    persons: Persons,
    bodies: Bodies,
    views: Views,
    scans: Scans,
    owner: Any,
    log: Sightings,
    b: int,
    time: float,
    sweep: int,
) -> None:
    """Follow a person by its views."""
    x, y, number, wide = 0.0, 0.0, 0.0, False
    for k in range(views.count):
        if persons.taken[k] == b + 1:
            x += views.middle_x[k]
            y += views.middle_y[k]
            number += 1.0
            wide = wide or views.chord[k] > SLIM
            if owner[k] >= 0:
                _join(bodies, owner[k], b)
            _rename(persons, bodies, log, b, k)
            owner[k] = b
            bodies.view[b] = k
    if number == 0.0:
        bodies.view[b] = -1
        life.miss(bodies, b, views, scans, time)
        return
    var = PAIR_VAR if number > 1.0 else (WIDE_VAR if wide else ONE_VAR)
    things.update(bodies, 2 * b, x / number, 0.0, var)
    things.update(bodies, 2 * b + 1, y / number, 0.0, var)
    if number > 1.0:
        bodies.whole[b] += 1
    elif not wide and views.start[bodies.view[b]] == looks.OWN and views.end[bodies.view[b]] == looks.OWN:
        # What never shows two legs is as wide as the one.
        bodies.boxy[b] += 1
        bodies.size[b] += (views.chord[bodies.view[b]] - bodies.size[b]) / min(bodies.boxy[b], 20)
    _note(bodies, b, x / number, y / number, time, sweep)


def _join(bodies: Bodies, leg: int, b: int) -> None:
    """A body is a leg of a person; what was seen of it before it was anybody's is of the person, too."""
    if bodies.member[leg] == 0:
        bodies.same_as[leg] = bodies.number[b]
    bodies.member[leg] = bodies.number[b]


def _rename(persons: Persons, bodies: Bodies, log: Sightings, b: int, k: int) -> None:
    """The sighting of a leg is one of its person."""
    if persons.entry[k] >= 0:
        log.number[persons.entry[k]] = bodies.number[b]


def _note(bodies: Bodies, b: int, x: float, y: float, time: float, sweep: int) -> None:
    """Write down that a person was seen."""
    life.see(bodies, b)
    bodies.sightings[b] += 1
    bodies.last_sweep[b], bodies.seen_at[b] = sweep, time
    bodies.middle_x[b], bodies.middle_y[b] = x, y
    bodies.from_x[b], bodies.from_y[b] = things.centre(bodies, b)


def _found(
    persons: Persons, bodies: Bodies, views: Views, log: Sightings, leg: int, k: int, time: float, sweep: int
) -> int:
    """A leg that moves and belongs to nobody founds a person; returns its slot."""
    b = things.free_slot(bodies)
    things.clear(bodies, b)
    bodies.kind[b] = things.PERSON
    bodies.first_sweep[b], bodies.first_at[b] = sweep, time
    bodies.onset[b] = bodies.onset[leg]
    bodies.moved[b] = bodies.settled[b] = 1
    bodies.existence[b] = bodies.existence[leg]
    bodies.evidence[b] = bodies.evidence_most[b] = bodies.evidence[leg]
    for i in range(2):
        a = 2 * b + i
        middle = views.middle_x[k] if i == 0 else views.middle_y[k]
        things.begin_axis(bodies, a, middle - RADIUS, middle + RADIUS, ONE_VAR, ONE_VAR)
        bodies.v[a] = bodies.v[2 * leg + i]
        bodies.ch[a] = 0.0
    _join(bodies, leg, b)
    bodies.view[b] = k
    persons.taken[k] = b + 1
    _rename(persons, bodies, log, b, k)
    _note(bodies, b, views.middle_x[k], views.middle_y[k], time, sweep)
    return b
