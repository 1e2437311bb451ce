"""Association of views with bodies, at the least total cost.

First each view goes to at most one body; views that remain may be further parts of a body. Then persons take up to two slim
views in every sweep, because legs swing, hide each other and meet. A leg that is shown to move founds a person, which is
followed by the middle of its legs from then on.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import belief, estimation, observation
from lidarcli.formalism.tracking.estimation import Bodies, Sides, Sightings
from lidarcli.formalism.tracking.observation import Views

INFINITY = float("inf")
GATE = 6.25
"""Cost of a body without a view: a view that costs more is not taken."""
CENTROID_SD = 0.12
"""[m] Standard deviation of the centroid of a view from where it is expected."""
CENTROID_SD_SIZE = 0.25
"""Share of the size of the body that adds to this."""
MOST_SIDE_COST = 4.0
"""Greatest cost of one side, in squared standard deviations."""
SIZE_SD = 0.15
"""[m] Standard deviation of the difference between two sizes of one body."""
MOST_SIZE_COST = 2.0
"""Greatest cost of a size that differs."""
NEWCOMER_COST = 1.0
"""Cost of a body whose existence is doubtful, so that it comes after those that are certain."""
SEEN_BEFORE = 1.5
"""Cost by which a body that was seen in the sweep before comes first, where the place of the sensor is known."""
SLIMMEST_LASTING = 0.2
"""[m] Greatest width of a body without this advantage: legs swing past each other."""
DUPLICATE_COST = 1.5
"""Cost of a body that began inside an older one, for as long as it is young."""
DUPLICATE_SIGHTINGS = 30
"""Sightings from which on such a body has no disadvantage."""
FARTHEST_VIEW = 1.5
"""[m] Greatest distance of a view from where it is expected, however uncertain the body is."""
PART_MARGIN = 0.1
"""[m] Greatest distance of a further part of a body outside of it."""
WALKING_LEG_WIDTH = 0.3
"""[m] Greatest width of a leg that walks."""
LEGS_WIDTH = 0.65
"""[m] Greatest width of a view of two legs."""
LEG_REACH = 0.65
"""[m] Greatest distance of a leg from the middle of its person."""
LEG_SD = 0.4
"""[m] Standard deviation of that distance, roughly."""
SAME_PERSON = 0.6
"""Cost by which a leg that belonged to the person before is preferred."""
STANDING_SIGHTINGS = 12
"""Sightings from which on a body is not a leg, unless it was one before."""
TWO_LEGS_VAR = 0.0036
"""[m²] Variance of the middle of two legs: (6 cm)²."""
ONE_LEG_VAR = 0.0484
"""[m²] Variance of the middle of a person of whom one leg is seen: (22 cm)²."""
JOINT_LEGS_VAR = 0.01
"""[m²] Variance of the middle of two legs in one view: (10 cm)²."""
PERSONS_APART = 0.45
"""[m] Least distance between two persons who have two legs together."""
MERGED_GAIN = 2
"""Each sweep in which they are nearer counts as so many of `belief.DUPLICATE_SWEEPS`."""
PERSON_RADIUS = 0.2
"""[m] Half of the width of a person at the legs."""


class Pairs:
    """Candidate pairs of a body and a view, by body: `count` of them, and room for `most`."""

    def __init__(self, bodies: int, views: int) -> None:
        self.owner: list[Any] = []
        self.most = 8 * (bodies + views) + 64
        self.count = 0
        self.body = native.integers(self.owner, self.most)
        self.view = native.integers(self.owner, self.most)
        self.cost = native.doubles(self.owner, self.most)
        self.group = native.integers(self.owner, bodies + views)
        """Group of each body, then of each view: the lowest index of a body or view that is connected with it."""
        self.place = native.integers(self.owner, bodies + views)
        """Row or column of each body and view in the current assignment."""
        self.member = native.integers(self.owner, bodies + views)
        """Bodies, then views, of the current assignment."""
        self.next = native.integers(self.owner, self.most)
        self.head = native.integers(self.owner, bodies + views)
        """First pair of each group; `next` is the pair that follows, -1 at the end."""


def associate(pairs: Pairs, task: Assignment, sides: Sides, bodies: Bodies, views: Views, owner: Any) -> None:
    """Fill in `bodies.view`, and `owner`: the body of each view, -1 for none."""
    _pair_views(pairs, sides, bodies, views)
    for b in range(bodies.high):
        bodies.view[b] = -1
    for k in range(views.count):
        owner[k] = -1
    _chain(pairs, bodies)
    for i in range(pairs.count):
        if pairs.head[pairs.group[pairs.body[i]]] >= 0:
            _assign_group(pairs, task, bodies, owner, pairs.group[pairs.body[i]])


def _pair_views(pairs: Pairs, sides: Sides, bodies: Bodies, views: Views) -> None:
    """Collect all pairs within the gate."""
    pairs.count = 0
    for b in range(bodies.high):
        if bodies.state[b] != estimation.LIVE or bodies.kind[b] == estimation.PERSON:
            continue
        x, y = estimation.centre(bodies, b)
        moved_x, moved_y = x - bodies.from_x[b], y - bodies.from_y[b]
        x, y = bodies.middle_x[b] + moved_x, bodies.middle_y[b] + moved_y
        size = 2.0 * math.sqrt(bodies.h[2 * b] * bodies.h[2 * b] + bodies.h[2 * b + 1] * bodies.h[2 * b + 1])
        var = 0.5 * (bodies.cc[2 * b] + bodies.cc[2 * b + 1])
        reach = CENTROID_SD + CENTROID_SD_SIZE * size + math.sqrt(var)
        if views.pose_var > 0.0 or views.pose_turn_var > 0.0:
            dx, dy = x - views.x, y - views.y
            reach += math.sqrt(views.pose_var + views.pose_turn_var * (dx * dx + dy * dy))
        most = min(math.sqrt(GATE) * reach, FARTHEST_VIEW)
        precedence = _precedence(bodies, views, b)
        for k in range(views.count):
            dx, dy = views.middle_x[k] - x, views.middle_y[k] - y
            far = dx * dx + dy * dy
            if far > most * most:
                continue
            cost = far / (reach * reach) + NEWCOMER_COST * (1.0 - bodies.existence[b])
            cost += _misfit(sides, bodies, views, b, k)
            if cost < GATE and pairs.count < pairs.most:
                i = pairs.count
                pairs.body[i], pairs.view[i], pairs.cost[i] = b, k, cost + precedence
                pairs.count += 1


def _precedence(bodies: Bodies, views: Views, b: int) -> float:
    """Return the cost of a body for what it is, before any view: `bodies.view` is still that of the sweep before."""
    if not views.is_placed or bodies.member[b] != 0:
        return 0.0
    cost = 0.0
    if bodies.view[b] >= 0 and bodies.h[2 * b] + bodies.h[2 * b + 1] > SLIMMEST_LASTING:
        cost -= SEEN_BEFORE
    if bodies.same_as[b] != 0 and bodies.sightings[b] < DUPLICATE_SIGHTINGS:
        cost += DUPLICATE_COST
    return cost


def _misfit(sides: Sides, bodies: Bodies, views: Views, b: int, k: int) -> float:
    """Return the cost of a view whose sides and size differ from those of a body."""
    estimation.measure(sides, views, k, bodies, b, observation.pose_variance(views, k))
    total, number = 0.0, 0.0
    for side in range(4):
        if sides.var[side] < 0.0 or (sides.by_centre and (side == 1 or side == 3)):
            continue
        sign = 0.0 if sides.by_centre else (1.0 if side == 1 or side == 3 else -1.0)
        off, s = estimation.residual(bodies, 2 * b + side // 2, sides.z[side], sign, sides.var[side])
        total += min(off * off / s, MOST_SIDE_COST)
        number += 1.0
    cost = 0.5 * total / number if number > 0.0 else 0.0
    if bodies.whole[b] >= 3 and not observation.is_partial(views, k):
        size = math.sqrt(views.length[k] * views.length[k] + views.width[k] * views.width[k])
        off = (size - bodies.size[b]) / (SIZE_SD + 0.2 * bodies.size[b])
        cost += min(off * off, MOST_SIZE_COST)
    return cost


def _chain(pairs: Pairs, bodies: Bodies) -> None:
    """Group the pairs that are connected by shared bodies or views, and chain the pairs of each group."""
    n = bodies.most
    for i in range(pairs.count):
        b, k = pairs.body[i], n + pairs.view[i]
        pairs.group[b], pairs.group[k] = b, k
        pairs.head[b] = pairs.head[k] = -1
    for i in range(pairs.count):
        one, other = _root(pairs, pairs.body[i]), _root(pairs, n + pairs.view[i])
        if one != other:
            pairs.group[max(one, other)] = min(one, other)
    for i in range(pairs.count):
        b, k = pairs.body[i], n + pairs.view[i]
        pairs.group[b] = _root(pairs, b)
        pairs.group[k] = pairs.group[b]
    # From the last to the first, so that each chain begins with its first pair.
    for i in range(pairs.count - 1, -1, -1):
        root = pairs.group[pairs.body[i]]
        pairs.next[i] = pairs.head[root]
        pairs.head[root] = i


def _root(pairs: Pairs, at: int) -> int:
    while pairs.group[at] != at:
        pairs.group[at] = pairs.group[pairs.group[at]]
        at = pairs.group[at]
    return at


def _assign_group(pairs: Pairs, task: Assignment, bodies: Bodies, owner: Any, root: int) -> None:
    """Solve the assignment of one group of pairs."""
    n = bodies.most
    begin = pairs.head[root]
    pairs.head[root] = -1
    if pairs.next[begin] < 0:
        bodies.view[pairs.body[begin]], owner[pairs.view[begin]] = pairs.view[begin], pairs.body[begin]
        return
    rows, columns = 0, 0
    i = begin
    while i >= 0:
        pairs.place[pairs.body[i]] = pairs.place[n + pairs.view[i]] = -1
        i = pairs.next[i]
    i = begin
    while i >= 0:
        b, k = pairs.body[i], n + pairs.view[i]
        if pairs.place[b] < 0:
            pairs.place[b] = rows
            pairs.member[rows] = b
            rows += 1
        if pairs.place[k] < 0:
            pairs.place[k] = columns
            pairs.member[n + columns] = pairs.view[i]
            columns += 1
        i = pairs.next[i]
    task.rows, task.columns = rows, columns
    for j in range(rows * columns):
        task.cost[j] = INFINITY
    i = begin
    while i >= 0:
        at = pairs.place[pairs.body[i]] * columns + pairs.place[n + pairs.view[i]]
        task.cost[at] = pairs.cost[i]
        i = pairs.next[i]
    solve(task, GATE)
    for row in range(rows):
        if task.column[row] >= 0:
            b, k = pairs.member[row], pairs.member[n + task.column[row]]
            bodies.view[b], owner[k] = k, b


def join_parts(bodies: Bodies, views: Views, owner: Any) -> None:
    """Make a view without a body a part of a body that is seen elsewhere, if a hidden edge of the view lies inside it.

    Such a view gets `owner` = -2 - body.
    """
    for k in range(views.count):
        if owner[k] != -1 or not observation.is_partial(views, k):
            continue
        best, least = -1, PART_MARGIN
        for b in range(bodies.high):
            if bodies.state[b] != estimation.LIVE or bodies.view[b] < 0 or bodies.sightings[b] < 3:
                continue
            out = estimation.outside(bodies, b, views.middle_x[k], views.middle_y[k])
            if not observation.is_partial(views, bodies.view[b]):
                # A body that is seen whole has no further parts, unless it is ragged.
                out += 1.5 * PART_MARGIN
            if out < least and _has_room(bodies, b, views, k):
                best, least = b, out
        if best >= 0:
            owner[k] = -2 - best


def _has_room(bodies: Bodies, b: int, views: Views, k: int) -> bool:
    """Return whether a body is large enough for a view to be a part of it."""
    size = math.sqrt(bodies.h[2 * b] * bodies.h[2 * b] + bodies.h[2 * b + 1] * bodies.h[2 * b + 1])
    return views.chord[k] <= 2.0 * size + PART_MARGIN


class Assignment:
    """Room for one assignment of `rows` to `columns`; each row may also stay without a column, at a cost."""

    def __init__(self, most_rows: int, most_columns: int) -> None:
        self.owner: list[Any] = []
        wide = most_rows + most_columns + 1
        self.rows = 0
        self.columns = 0
        self.most_columns = most_columns
        self.cost = native.doubles(self.owner, max(most_rows * most_columns, 1))
        """Cost of row i and column j at i * columns + j; infinite for pairs that are ruled out."""
        self.column = native.integers(self.owner, most_rows + 1)
        """Column of each row, -1 for none."""
        self.row_price = native.doubles(self.owner, most_rows + 1)
        self.column_price = native.doubles(self.owner, wide)
        self.taken_by = native.integers(self.owner, wide)
        self.before = native.integers(self.owner, wide)
        self.least = native.doubles(self.owner, wide)
        self.done = native.integers(self.owner, wide)


def solve(task: Assignment, without: float) -> None:
    """Fill in `column` by successive shortest augmenting paths. `without`: cost of a row without a column."""
    wide = task.columns + task.rows
    # Rows and columns count from 1; 0 is none.
    for j in range(wide + 1):
        task.column_price[j] = 0.0
        task.taken_by[j] = 0
    for i in range(task.rows + 1):
        task.row_price[i] = 0.0
    for i in range(1, task.rows + 1):
        _augment(task, i, wide, without)
    for i in range(task.rows):
        task.column[i] = -1
    for j in range(1, task.columns + 1):
        if task.taken_by[j] > 0:
            task.column[task.taken_by[j] - 1] = j - 1


def _augment(task: Assignment, row: int, wide: int, without: float) -> None:
    """Give a row a column along the cheapest path of changes (Dijkstra with prices)."""
    task.taken_by[0] = row
    at = 0
    for j in range(wide + 1):
        task.least[j] = INFINITY
        task.done[j] = 0
    while task.taken_by[at] != 0:
        task.done[at] = 1
        i = task.taken_by[at]
        step, next_at = INFINITY, 0
        for j in range(1, wide + 1):
            if task.done[j]:
                continue
            if j <= task.columns:
                cost = task.cost[(i - 1) * task.columns + j - 1]
            else:
                cost = without if j - task.columns == i else INFINITY
            reduced = cost - task.row_price[i] - task.column_price[j]
            if reduced < task.least[j]:
                task.least[j] = reduced
                task.before[j] = at
            if task.least[j] < step:
                step, next_at = task.least[j], j
        for j in range(wide + 1):
            if task.done[j]:
                task.row_price[task.taken_by[j]] += step
                task.column_price[j] -= step
            else:
                task.least[j] -= step
        at = next_at
    while at != 0:
        previous = task.before[at]
        task.taken_by[at] = task.taken_by[previous]
        at = previous


class Persons:
    """Room for candidate pairs of a person and a view of one sweep."""

    def __init__(self, views: int) -> None:
        self.owner: list[Any] = []
        self.most = 8 * views + 64
        self.count = 0
        self.person = native.integers(self.owner, self.most)
        self.view = native.integers(self.owner, self.most)
        self.cost = native.doubles(self.owner, self.most)
        self.entry = native.integers(self.owner, views)
        """Index of the sighting of each view in the log, -1 for none."""
        self.taken = native.integers(self.owner, views)
        """Number of the slot, plus 1, of the person who has each view; 0 for none."""


def follow_persons(
    persons: Persons, bodies: Bodies, views: Views, scans: Scans, owner: Any, log: Sightings, time: float, sweep: int
) -> None:
    """Assign slim views to persons, and let legs that move found new ones.

    Parameters
    ----------
    owner : slot of the body of each view, in and out: the slot of a person replaces that of its leg
    time, sweep : time of this sweep [s], and number of sweeps before it
    """
    for k in range(views.count):
        persons.taken[k] = 0
    _pair_persons(persons, bodies, views, owner)
    _sort_pairs(persons)
    for i in range(persons.count):
        _assign_view(persons, bodies, views, persons.person[i], persons.view[i])
    for b in range(bodies.high):
        if bodies.state[b] == estimation.LIVE and bodies.kind[b] == estimation.PERSON:
            _update_person(persons, bodies, views, scans, owner, log, b, time, sweep)
    for b in range(bodies.high):
        if _is_person_seen(bodies, b):
            _merge_person(persons, bodies, views, owner, log, b)
    for k in range(views.count):
        leg = owner[k]
        if leg >= 0 and persons.taken[k] == 0 and bodies.moved[leg] == 1 and _is_leg(bodies, leg):
            b = _without_leg(bodies, views, k)
            if b >= 0:
                bodies.settled[b] += 1
                _join_leg(bodies, leg, b)
                _rename_sighting(persons, bodies, log, b, k)
                owner[k] = b
            else:
                owner[k] = _found_person(persons, bodies, views, log, leg, k, time, sweep)


def _is_person_seen(bodies: Bodies, b: int) -> bool:
    """Return whether a person is seen in this sweep."""
    return (
        bodies.state[b] == estimation.LIVE
        and bodies.kind[b] == estimation.PERSON
        and bodies.view[b] >= 0
        and bodies.settled[b] > 0
    )


def _merge_person(persons: Persons, bodies: Bodies, views: Views, owner: Any, log: Sightings, b: int) -> None:
    """Give a person to an elder who is nearer than two can be in several sweeps, as long as both have two legs together."""
    x, y = estimation.centre(bodies, b)
    elder = -1
    for c in range(bodies.high):
        if bodies.number[c] >= bodies.number[b] or not _is_person_seen(bodies, c):
            continue
        other_x, other_y = estimation.centre(bodies, c)
        dx, dy = x - other_x, y - other_y
        if dx * dx + dy * dy < PERSONS_APART * PERSONS_APART and (elder < 0 or bodies.number[c] < bodies.number[elder]):
            elder = c
    if elder < 0:
        return
    if bodies.settled[b] + bodies.settled[elder] > 2:
        bodies.inside[b] = max(bodies.inside[b] - MERGED_GAIN, 0)
        return
    bodies.inside[b] += MERGED_GAIN
    if bodies.inside[b] < belief.DUPLICATE_SWEEPS:
        return
    for k in range(views.count):
        if owner[k] == b:
            _rename_sighting(persons, bodies, log, elder, k)
            owner[k] = elder
            persons.taken[k] = elder + 1
    for leg in range(bodies.high):
        if bodies.member[leg] == bodies.number[b]:
            bodies.member[leg] = bodies.number[elder]
    bodies.settled[elder] += bodies.settled[b]
    bodies.same_as[b] = bodies.number[elder]
    belief.finish(bodies, b, belief.LOST)


def _without_leg(bodies: Bodies, views: Views, k: int) -> int:
    """Return the nearest person within reach of a view that has fewer than two legs; -1 for none."""
    best, least = -1, LEG_REACH * LEG_REACH
    for b in range(bodies.high):
        if bodies.state[b] != estimation.LIVE or bodies.kind[b] != estimation.PERSON or bodies.settled[b] >= 2:
            continue
        x, y = estimation.centre(bodies, b)
        dx, dy = views.middle_x[k] - x, views.middle_y[k] - y
        if dx * dx + dy * dy < least:
            best, least = b, dx * dx + dy * dy
    return best


def _is_leg(bodies: Bodies, b: int) -> bool:
    """Return whether a body is slim enough for a leg."""
    return bodies.kind[b] == estimation.DISC and bodies.h[2 * b] + bodies.h[2 * b + 1] <= WALKING_LEG_WIDTH


def _pair_persons(persons: Persons, bodies: Bodies, views: Views, owner: Any) -> None:
    """Collect all pairs of a person and a view near it."""
    persons.count = 0
    for b in range(bodies.high):
        if bodies.state[b] != estimation.LIVE or bodies.kind[b] != estimation.PERSON:
            continue
        x, y = estimation.centre(bodies, b)
        # `settled` counts the legs of a person in this sweep, up to two.
        bodies.settled[b] = 0
        for k in range(views.count):
            leg = owner[k]
            if views.chord[k] > LEGS_WIDTH or (leg >= 0 and not _may_be_leg(bodies, leg)):
                continue
            dx, dy = views.middle_x[k] - x, views.middle_y[k] - y
            far = dx * dx + dy * dy
            if far > LEG_REACH * LEG_REACH or persons.count >= persons.most:
                continue
            i = persons.count
            persons.person[i], persons.view[i], persons.cost[i] = b, k, far / (LEG_SD * LEG_SD)
            if leg >= 0 and bodies.member[leg] == bodies.number[b]:
                persons.cost[i] -= SAME_PERSON
            persons.count += 1


def _may_be_leg(bodies: Bodies, b: int) -> bool:
    """Return whether a body may be a leg of a person: it was one before, or was seen a few times only."""
    return bodies.member[b] != 0 or bodies.sightings[b] < STANDING_SIGHTINGS


def _sort_pairs(persons: Persons) -> None:
    """Sort the pairs by cost; by insertion, as there are few."""
    for i in range(1, persons.count):
        person, view, cost = persons.person[i], persons.view[i], persons.cost[i]
        at = i
        while at > 0 and cost < persons.cost[at - 1]:
            persons.person[at], persons.view[at] = persons.person[at - 1], persons.view[at - 1]
            persons.cost[at] = persons.cost[at - 1]
            at -= 1
        persons.person[at], persons.view[at], persons.cost[at] = person, view, cost


def _assign_view(persons: Persons, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Assign a view to a person, if the view is free and a leg is missing."""
    if persons.taken[k] != 0 or bodies.settled[b] >= 2:
        return
    legs = 2 if views.chord[k] > WALKING_LEG_WIDTH else 1
    if legs == 2 and bodies.settled[b] > 0:
        return
    persons.taken[k] = b + 1
    bodies.settled[b] += legs


def _update_person(
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
    """Update a person with its views."""
    x, y, number, wide = 0.0, 0.0, 0.0, False
    for k in range(views.count):
        if persons.taken[k] == b + 1:
            x += views.middle_x[k]
            y += views.middle_y[k]
            number += 1.0
            wide = wide or views.chord[k] > WALKING_LEG_WIDTH
            if owner[k] >= 0:
                _join_leg(bodies, owner[k], b)
            _rename_sighting(persons, bodies, log, b, k)
            owner[k] = b
            bodies.view[b] = k
    if number == 0.0:
        bodies.view[b] = -1
        belief.note_missed(bodies, b, views, scans, time)
        return
    var = TWO_LEGS_VAR if number > 1.0 else (JOINT_LEGS_VAR if wide else ONE_LEG_VAR)
    estimation.update(bodies, 2 * b, x / number, 0.0, var)
    estimation.update(bodies, 2 * b + 1, y / number, 0.0, var)
    if number > 1.0:
        bodies.whole[b] += 1
    elif not wide and views.start[bodies.view[b]] == observation.OWN and views.end[bodies.view[b]] == observation.OWN:
        # A person who never shows two legs has the width of one.
        bodies.boxy[b] += 1
        bodies.size[b] += (views.chord[bodies.view[b]] - bodies.size[b]) / min(bodies.boxy[b], 20)
    _note_person(bodies, b, x / number, y / number, time, sweep)


def _join_leg(bodies: Bodies, leg: int, b: int) -> None:
    """Make a body a leg of a person; its earlier sightings become the person's too, if it had no person before."""
    if bodies.member[leg] == 0:
        bodies.same_as[leg] = bodies.number[b]
    bodies.member[leg] = bodies.number[b]


def _rename_sighting(persons: Persons, bodies: Bodies, log: Sightings, b: int, k: int) -> None:
    """Make the sighting of a leg one of its person."""
    if persons.entry[k] >= 0:
        log.number[persons.entry[k]] = bodies.number[b]


def _note_person(bodies: Bodies, b: int, x: float, y: float, time: float, sweep: int) -> None:
    """Note that a person was seen."""
    belief.note_seen(bodies, b)
    bodies.sightings[b] += 1
    bodies.last_sweep[b], bodies.seen_at[b] = sweep, time
    bodies.middle_x[b], bodies.middle_y[b] = x, y
    bodies.from_x[b], bodies.from_y[b] = estimation.centre(bodies, b)


def _found_person(
    persons: Persons, bodies: Bodies, views: Views, log: Sightings, leg: int, k: int, time: float, sweep: int
) -> int:
    """Found a person on a leg that moves and has none; return the slot of the person."""
    b = estimation.free_slot(bodies)
    estimation.clear(bodies, b)
    bodies.kind[b] = estimation.PERSON
    bodies.first_sweep[b], bodies.first_at[b] = sweep, time
    bodies.onset[b] = bodies.onset[leg]
    bodies.moved[b] = bodies.settled[b] = 1
    bodies.existence[b] = bodies.existence[leg]
    bodies.evidence[b] = bodies.evidence_most[b] = bodies.evidence[leg]
    for i in range(2):
        a = 2 * b + i
        middle = views.middle_x[k] if i == 0 else views.middle_y[k]
        estimation.begin_axis(bodies, a, middle - PERSON_RADIUS, middle + PERSON_RADIUS, ONE_LEG_VAR, ONE_LEG_VAR)
        bodies.v[a] = bodies.v[2 * leg + i]
        bodies.ch[a] = 0.0
    _join_leg(bodies, leg, b)
    bodies.view[b] = k
    persons.taken[k] = b + 1
    _rename_sighting(persons, bodies, log, b, k)
    _note_person(bodies, b, views.middle_x[k], views.middle_y[k], time, sweep)
    return b
