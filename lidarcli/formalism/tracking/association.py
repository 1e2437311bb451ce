"""Association of measurements with targets: gate, cluster, and assign at the least total cost (a global nearest neighbour).

A measurement goes to one target at most; those that remain may be fragments of a target. Then persons take up to two slim
measurements per sweep, because legs swing, hide each other and meet. A leg that moves initiates a person, whose state is
the middle of its legs.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import kalman, keyframes, measurement, results, track_evidence
from lidarcli.formalism.tracking.kalman import Sightings, Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import EdgeMeasurement, Measurements
from lidarcli.system import native

INFINITY = float("inf")
MIN_WAY = results.MIN_WAY
GATE = 6.25
"""Cost of a target without a measurement: one that costs more is outside the gate."""
CENTROID_SD, CENTROID_SD_SIZE = 0.12, 0.25
"""Standard deviation of the centroid of a measurement from where it is expected [m], and the share of the size that adds to
it."""
MAX_SIDE_COST = 4.0
"""Greatest cost of one side, in squared standard deviations."""
SIZE_SD, MAX_SIZE_COST = 0.15, 2.0
"""Standard deviation of the difference between two sizes of one target [m], and the greatest cost of one that differs."""
NEWCOMER_COST = 1.0
"""Cost of a target whose existence is doubtful, so that it comes after those that are certain."""
SEEN_BEFORE, SLIMMEST_LASTING = 1.5, 0.2
"""Cost by which a target that was hit in the sweep before comes first, where the place of the sensor is known, and the
greatest width of one without this advantage [m]: legs swing past each other."""
DUPLICATE_COST, DUPLICATE_SIGHTINGS = 1.5, 30
"""Cost of a target that began inside an older one, until it has so many sightings."""
FARTHEST_VIEW = 1.5
"""[m] Greatest distance of a measurement from where it is expected, however uncertain the target is."""
PART_MARGIN = 0.1
"""[m] Greatest distance of a further part of a target outside of it."""
WALKING_LEG_WIDTH, LEGS_WIDTH = 0.3, 0.65
"""[m] Greatest width of a measurement of a leg that walks, and of one of two legs."""
LEG_REACH, LEG_SD = 0.65, 0.4
"""[m] Greatest distance of a leg from the middle of its person, and roughly its standard deviation."""
SAME_PERSON = 0.6
"""Cost by which a leg that belonged to the person before is preferred."""
STANDING_SIGHTINGS = 12
"""Sightings from which on a target is not a leg, unless it was one before."""
TWO_LEGS_VAR, ONE_LEG_VAR, JOINT_LEGS_VAR = 0.0036, 0.0484, 0.01
"""[m²] Variance of the middle of a person by two legs, (6 cm)², by one, (22 cm)², and by two in one measurement, (10
cm)²."""
PERSONS_APART, MERGED_GAIN = 0.45, 2
"""Least distance between two persons who have two legs together [m]. Each sweep in which they are nearer counts as so many
of `track_evidence.DUPLICATE_SWEEPS`."""
PERSON_RADIUS = 0.2
"""[m] Half of the width of a person at the legs."""


class Candidates:
    """Candidate pairs of a target and a measurement, by target: `count` of them, with room for `capacity`."""

    def __init__(self, targets: int, meas: int) -> None:
        self.owner: list[Any] = []
        self.capacity = 8 * (targets + meas) + 64
        self.count = 0
        self.target = native.integers(self.owner, self.capacity)
        self.measurement = native.integers(self.owner, self.capacity)
        self.cost = native.doubles(self.owner, self.capacity)
        self.group = native.integers(self.owner, targets + meas)
        """Cluster of each target, then of each measurement: the lowest index among those that are connected with it."""
        self.place = native.integers(self.owner, targets + meas)
        """Row or column of each target and measurement in the current assignment."""
        self.member = native.integers(self.owner, targets + meas)
        """Targets, then measurements, of the current assignment."""
        self.next = native.integers(self.owner, self.capacity)
        self.head = native.integers(self.owner, targets + meas)
        """First pair of each group; `next` is the pair that follows, -1 at the end."""
        self.assignment = Assignment(targets, meas)


def associate(
    candidates: Candidates, sides: EdgeMeasurement, targets: Targets, meas: Measurements, frames: Keyframes
) -> None:
    """Fill in `targets.measurement` and `meas.assigned`."""
    _gate(candidates, sides, targets, meas, frames)
    for b in range(targets.slots_used):
        targets.measurement[b] = -1
    for k in range(meas.count):
        meas.assigned[k] = -1
    _cluster(candidates, targets)
    for i in range(candidates.count):
        if candidates.head[candidates.group[candidates.target[i]]] >= 0:
            _assign_group(candidates, candidates.assignment, targets, meas, candidates.group[candidates.target[i]])


def _gate(candidates: Candidates, sides: EdgeMeasurement, targets: Targets, meas: Measurements, frames: Keyframes) -> None:
    """Collect all pairs within the gate."""
    candidates.count = 0
    for b in range(targets.slots_used):
        if targets.state[b] != kalman.LIVE or targets.kind[b] == kalman.PERSON:
            continue
        x, y = kalman.centre(targets, b)
        moved_x, moved_y = x - targets.from_x[b], y - targets.from_y[b]
        x, y = targets.middle_x[b] + moved_x, targets.middle_y[b] + moved_y
        size = 2.0 * math.sqrt(targets.h[2 * b] * targets.h[2 * b] + targets.h[2 * b + 1] * targets.h[2 * b + 1])
        var = 0.5 * (targets.cc[2 * b] + targets.cc[2 * b + 1])
        reach = CENTROID_SD + CENTROID_SD_SIZE * size + math.sqrt(var)
        if meas.pose_var > 0.0 or meas.pose_turn_var > 0.0:
            dx, dy = x - meas.x, y - meas.y
            reach += math.sqrt(meas.pose_var + meas.pose_turn_var * (dx * dx + dy * dy))
        most = min(math.sqrt(GATE) * reach, FARTHEST_VIEW)
        advantage = precedence(targets, meas, b)
        for k in range(meas.count):
            dx, dy = meas.middle_x[k] - x, meas.middle_y[k] - y
            far = dx * dx + dy * dy
            if far > most * most:
                continue
            cost = far / (reach * reach) + NEWCOMER_COST * (1.0 - targets.existence[b])
            cost += _assignment_cost(sides, targets, meas, b, k)
            if cost >= GATE or candidates.count >= candidates.capacity:
                continue
            dx, dy = meas.middle_x[k] - targets.middle_x[b], meas.middle_y[k] - targets.middle_y[b]
            is_away = dx * dx + dy * dy > (size + MIN_WAY) * (size + MIN_WAY)
            # What was static there while the target was observed elsewhere is another object.
            if is_away and keyframes.stood_before(frames, meas, k, targets.last_time[b]):
                continue
            i = candidates.count
            candidates.target[i], candidates.measurement[i], candidates.cost[i] = b, k, cost + advantage
            candidates.count += 1


def precedence(targets: Targets, meas: Measurements, b: int) -> float:
    """Return the cost of a target by itself; `targets.measurement` is still that of the sweep before."""
    if not meas.is_placed or targets.member[b] != 0:
        return 0.0
    cost = 0.0
    if targets.measurement[b] >= 0 and targets.h[2 * b] + targets.h[2 * b + 1] > SLIMMEST_LASTING:
        cost -= SEEN_BEFORE
    if targets.same_as[b] != 0 and targets.sightings[b] < DUPLICATE_SIGHTINGS:
        cost += DUPLICATE_COST
    return cost


def _assignment_cost(sides: EdgeMeasurement, targets: Targets, meas: Measurements, b: int, k: int) -> float:
    """Return the cost of a measurement whose sides and size differ from those of a target."""
    kalman.measure(sides, meas, k, targets, b, measurement.pose_variance(meas, k))
    total, number = 0.0, 0.0
    for side in range(4):
        if sides.var[side] < 0.0 or (sides.by_centre and (side == 1 or side == 3)):
            continue
        sign = 0.0 if sides.by_centre else (1.0 if side == 1 or side == 3 else -1.0)
        off, s = kalman.residual(targets, 2 * b + side // 2, sides.z[side], sign, sides.var[side])
        total += min(off * off / s, MAX_SIDE_COST)
        number += 1.0
    cost = 0.5 * total / number if number > 0.0 else 0.0
    if targets.whole[b] >= 3 and not measurement.is_partial(meas, k):
        size = math.sqrt(meas.length[k] * meas.length[k] + meas.width[k] * meas.width[k])
        off = (size - targets.size[b]) / (SIZE_SD + 0.2 * targets.size[b])
        cost += min(off * off, MAX_SIZE_COST)
    return cost


def _cluster(candidates: Candidates, targets: Targets) -> None:
    """Cluster the pairs that share targets or measurements, and link the pairs of each cluster."""
    n = targets.capacity
    for i in range(candidates.count):
        b, k = candidates.target[i], n + candidates.measurement[i]
        candidates.group[b], candidates.group[k] = b, k
        candidates.head[b] = candidates.head[k] = -1
    for i in range(candidates.count):
        one, other = _root(candidates, candidates.target[i]), _root(candidates, n + candidates.measurement[i])
        if one != other:
            candidates.group[max(one, other)] = min(one, other)
    for i in range(candidates.count):
        b, k = candidates.target[i], n + candidates.measurement[i]
        candidates.group[b] = _root(candidates, b)
        candidates.group[k] = candidates.group[b]
    # From the last to the first, so that each chain begins with its first pair.
    for i in range(candidates.count - 1, -1, -1):
        root = candidates.group[candidates.target[i]]
        candidates.next[i] = candidates.head[root]
        candidates.head[root] = i


def _root(candidates: Candidates, at: int) -> int:
    while candidates.group[at] != at:
        candidates.group[at] = candidates.group[candidates.group[at]]
        at = candidates.group[at]
    return at


def _assign_group(candidates: Candidates, assignment: Assignment, targets: Targets, meas: Measurements, root: int) -> None:
    """Solve the assignment of one group of pairs."""
    n = targets.capacity
    begin = candidates.head[root]
    candidates.head[root] = -1
    if candidates.next[begin] < 0:
        b, k = candidates.target[begin], candidates.measurement[begin]
        targets.measurement[b], meas.assigned[k] = k, b
        return
    rows, columns = 0, 0
    i = begin
    while i >= 0:
        candidates.place[candidates.target[i]] = candidates.place[n + candidates.measurement[i]] = -1
        i = candidates.next[i]
    i = begin
    while i >= 0:
        b, k = candidates.target[i], n + candidates.measurement[i]
        if candidates.place[b] < 0:
            candidates.place[b] = rows
            candidates.member[rows] = b
            rows += 1
        if candidates.place[k] < 0:
            candidates.place[k] = columns
            candidates.member[n + columns] = candidates.measurement[i]
            columns += 1
        i = candidates.next[i]
    assignment.rows, assignment.columns = rows, columns
    for j in range(rows * columns):
        assignment.cost[j] = INFINITY
    i = begin
    while i >= 0:
        at = candidates.place[candidates.target[i]] * columns + candidates.place[n + candidates.measurement[i]]
        assignment.cost[at] = candidates.cost[i]
        i = candidates.next[i]
    solve(assignment, GATE)
    for row in range(rows):
        if assignment.column[row] >= 0:
            b, k = candidates.member[row], candidates.member[n + assignment.column[row]]
            targets.measurement[b], meas.assigned[k] = k, b


def merge_fragments(targets: Targets, meas: Measurements) -> None:
    """Make an unassigned measurement with a hidden edge a fragment of a target that is measured elsewhere and covers it."""
    for k in range(meas.count):
        if meas.assigned[k] != -1 or not measurement.is_partial(meas, k):
            continue
        best, least = -1, PART_MARGIN
        for b in range(targets.slots_used):
            if targets.state[b] != kalman.LIVE or targets.measurement[b] < 0 or targets.sightings[b] < 3:
                continue
            out = kalman.outside(targets, b, meas.middle_x[k], meas.middle_y[k])
            if not measurement.is_partial(meas, targets.measurement[b]):
                # A target that is visible whole has no further parts, unless it is ragged.
                out += 1.5 * PART_MARGIN
            size = math.sqrt(targets.h[2 * b] * targets.h[2 * b] + targets.h[2 * b + 1] * targets.h[2 * b + 1])
            if out < least and meas.chord[k] <= 2.0 * size + PART_MARGIN:
                best, least = b, out
        if best >= 0:
            meas.assigned[k] = -2 - best


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
        self.assigned_row = native.integers(self.owner, wide)
        self.before = native.integers(self.owner, wide)
        self.least = native.doubles(self.owner, wide)
        self.done = native.integers(self.owner, wide)


def solve(assignment: Assignment, without: float) -> None:
    """Fill in `column` by successive shortest augmenting paths. `without`: cost of a row without a column."""
    wide = assignment.columns + assignment.rows
    # Rows and columns count from 1; 0 is none.
    for j in range(wide + 1):
        assignment.column_price[j] = 0.0
        assignment.assigned_row[j] = 0
    for i in range(assignment.rows + 1):
        assignment.row_price[i] = 0.0
    for i in range(1, assignment.rows + 1):
        _augment(assignment, i, wide, without)
    for i in range(assignment.rows):
        assignment.column[i] = -1
    for j in range(1, assignment.columns + 1):
        if assignment.assigned_row[j] > 0:
            assignment.column[assignment.assigned_row[j] - 1] = j - 1


def _augment(assignment: Assignment, row: int, wide: int, without: float) -> None:
    """Give a row a column along the cheapest path of changes (Dijkstra with prices)."""
    assignment.assigned_row[0] = row
    at = 0
    for j in range(wide + 1):
        assignment.least[j] = INFINITY
        assignment.done[j] = 0
    while assignment.assigned_row[at] != 0:
        assignment.done[at] = 1
        i = assignment.assigned_row[at]
        step, next_at = INFINITY, 0
        for j in range(1, wide + 1):
            if assignment.done[j]:
                continue
            if j <= assignment.columns:
                cost = assignment.cost[(i - 1) * assignment.columns + j - 1]
            else:
                cost = without if j - assignment.columns == i else INFINITY
            reduced = cost - assignment.row_price[i] - assignment.column_price[j]
            if reduced < assignment.least[j]:
                assignment.least[j] = reduced
                assignment.before[j] = at
            if assignment.least[j] < step:
                step, next_at = assignment.least[j], j
        for j in range(wide + 1):
            if assignment.done[j]:
                assignment.row_price[assignment.assigned_row[j]] += step
                assignment.column_price[j] -= step
            else:
                assignment.least[j] -= step
        at = next_at
    while at != 0:
        previous = assignment.before[at]
        assignment.assigned_row[at] = assignment.assigned_row[previous]
        at = previous


class Persons:
    """Room for candidate pairs of a person and a measurement of one sweep."""

    def __init__(self, meas: int) -> None:
        self.owner: list[Any] = []
        self.capacity = 8 * meas + 64
        self.count = 0
        self.person = native.integers(self.owner, self.capacity)
        self.measurement = native.integers(self.owner, self.capacity)
        self.cost = native.doubles(self.owner, self.capacity)
        self.assigned = native.integers(self.owner, meas)
        """Number of the slot, plus 1, of the person who has each measurement; 0 for none."""


def track_persons(persons: Persons, targets: Targets, meas: Measurements, scans: Scans, sightings: Sightings) -> None:
    """Assign slim measurements to persons, in place of their legs, and initiate persons from legs that move."""
    for k in range(meas.count):
        persons.assigned[k] = 0
    _pair_persons(persons, targets, meas)
    sort_pairs(persons)
    for i in range(persons.count):
        b, k = persons.person[i], persons.measurement[i]
        legs = 2 if meas.chord[k] > WALKING_LEG_WIDTH else 1
        if persons.assigned[k] == 0 and targets.kind_hits[b] + legs <= 2:
            persons.assigned[k] = b + 1
            targets.kind_hits[b] += legs
    for b in range(targets.slots_used):
        if targets.state[b] == kalman.LIVE and targets.kind[b] == kalman.PERSON:
            _update_person(persons, targets, meas, scans, sightings, b)
    for b in range(targets.slots_used):
        if _is_person_hit(targets, b):
            merge_person(persons, targets, meas, sightings, b)
    for k in range(meas.count):
        leg = meas.assigned[k]
        if leg >= 0 and persons.assigned[k] == 0 and targets.moved[leg] == 1 and _is_leg(targets, leg):
            b = _person_missing_leg(targets, meas, k)
            if b >= 0:
                targets.kind_hits[b] += 1
                _join_leg(targets, leg, b)
                _give(targets, meas, sightings, b, k)
            else:
                _initiate_person(persons, targets, meas, sightings, leg, k)


def _is_person_hit(targets: Targets, b: int) -> bool:
    """Return whether a person has a measurement in this sweep."""
    return (
        targets.state[b] == kalman.LIVE
        and targets.kind[b] == kalman.PERSON
        and targets.measurement[b] >= 0
        and targets.kind_hits[b] > 0
    )


def merge_person(persons: Persons, targets: Targets, meas: Measurements, sightings: Sightings, b: int) -> None:
    """Give a person to an elder who is nearer than two can be in several sweeps, as long as both have two legs together."""
    x, y = kalman.centre(targets, b)
    elder = -1
    for c in range(targets.slots_used):
        if targets.number[c] >= targets.number[b] or not _is_person_hit(targets, c):
            continue
        other_x, other_y = kalman.centre(targets, c)
        dx, dy = x - other_x, y - other_y
        if dx * dx + dy * dy < PERSONS_APART * PERSONS_APART and (elder < 0 or targets.number[c] < targets.number[elder]):
            elder = c
    if elder < 0:
        return
    if targets.kind_hits[b] + targets.kind_hits[elder] > 2:
        targets.inside[b] = max(targets.inside[b] - MERGED_GAIN, 0)
        return
    targets.inside[b] += MERGED_GAIN
    if targets.inside[b] < track_evidence.DUPLICATE_SWEEPS:
        return
    for k in range(meas.count):
        if meas.assigned[k] == b:
            _give(targets, meas, sightings, elder, k)
            persons.assigned[k] = elder + 1
    for leg in range(targets.slots_used):
        if targets.member[leg] == targets.number[b]:
            targets.member[leg] = targets.number[elder]
    targets.kind_hits[elder] += targets.kind_hits[b]
    targets.same_as[b] = targets.number[elder]
    track_evidence.terminate(targets, b, track_evidence.LOST)


def _person_missing_leg(targets: Targets, meas: Measurements, k: int) -> int:
    """Return the nearest person within reach of a measurement that has fewer than two legs; -1 for none."""
    best, least = -1, LEG_REACH * LEG_REACH
    for b in range(targets.slots_used):
        if targets.state[b] != kalman.LIVE or targets.kind[b] != kalman.PERSON or targets.kind_hits[b] >= 2:
            continue
        x, y = kalman.centre(targets, b)
        dx, dy = meas.middle_x[k] - x, meas.middle_y[k] - y
        if dx * dx + dy * dy < least:
            best, least = b, dx * dx + dy * dy
    return best


def _is_leg(targets: Targets, b: int) -> bool:
    """Return whether a target is slim enough for a leg."""
    return targets.kind[b] == kalman.DISC and targets.h[2 * b] + targets.h[2 * b + 1] <= WALKING_LEG_WIDTH


def _pair_persons(persons: Persons, targets: Targets, meas: Measurements) -> None:
    """Collect all pairs of a person and a measurement near it."""
    persons.count = 0
    for b in range(targets.slots_used):
        if targets.state[b] != kalman.LIVE or targets.kind[b] != kalman.PERSON:
            continue
        x, y = kalman.centre(targets, b)
        # The legs of the person in this sweep, up to two.
        targets.kind_hits[b] = 0
        for k in range(meas.count):
            leg = meas.assigned[k]
            stands = leg >= 0 and targets.member[leg] == 0 and targets.sightings[leg] >= STANDING_SIGHTINGS
            if meas.chord[k] > LEGS_WIDTH or stands:
                continue
            dx, dy = meas.middle_x[k] - x, meas.middle_y[k] - y
            far = dx * dx + dy * dy
            if far > LEG_REACH * LEG_REACH or persons.count >= persons.capacity:
                continue
            i = persons.count
            persons.person[i], persons.measurement[i], persons.cost[i] = b, k, far / (LEG_SD * LEG_SD)
            if leg >= 0 and targets.member[leg] == targets.number[b]:
                persons.cost[i] -= SAME_PERSON
            persons.count += 1


def sort_pairs(persons: Persons) -> None:
    """Sort the pairs by cost; by insertion, as there are few."""
    for i in range(1, persons.count):
        person, measurement, cost = persons.person[i], persons.measurement[i], persons.cost[i]
        at = i
        while at > 0 and cost < persons.cost[at - 1]:
            persons.person[at], persons.measurement[at] = persons.person[at - 1], persons.measurement[at - 1]
            persons.cost[at] = persons.cost[at - 1]
            at -= 1
        persons.person[at], persons.measurement[at], persons.cost[at] = person, measurement, cost


def _update_person(
    persons: Persons, targets: Targets, meas: Measurements, scans: Scans, sightings: Sightings, b: int
) -> None:
    """Update a person with its measurements."""
    x, y, number, wide = 0.0, 0.0, 0.0, False
    for k in range(meas.count):
        if persons.assigned[k] == b + 1:
            x += meas.middle_x[k]
            y += meas.middle_y[k]
            number += 1.0
            wide = wide or meas.chord[k] > WALKING_LEG_WIDTH
            if meas.assigned[k] >= 0:
                _join_leg(targets, meas.assigned[k], b)
            _give(targets, meas, sightings, b, k)
            targets.measurement[b] = k
    if number == 0.0:
        targets.measurement[b] = -1
        track_evidence.record_miss(targets, b, meas, scans)
        return
    var = TWO_LEGS_VAR if number > 1.0 else (JOINT_LEGS_VAR if wide else ONE_LEG_VAR)
    kalman.update(targets, 2 * b, x / number, 0.0, var)
    kalman.update(targets, 2 * b + 1, y / number, 0.0, var)
    if number > 1.0:
        targets.whole[b] += 1
    elif (
        not wide
        and meas.start[targets.measurement[b]] == measurement.OWN
        and meas.end[targets.measurement[b]] == measurement.OWN
    ):
        # A person who never shows two legs has the width of one.
        targets.boxy[b] += 1
        targets.size[b] += (meas.chord[targets.measurement[b]] - targets.size[b]) / min(targets.boxy[b], 20)
    _record_person_hit(targets, b, meas, x / number, y / number)


def _join_leg(targets: Targets, leg: int, b: int) -> None:
    """Make a target a leg of a person; its earlier sightings become the person's too, if it had no person before."""
    if targets.member[leg] == 0:
        targets.same_as[leg] = targets.number[b]
    targets.member[leg] = targets.number[b]


def _give(targets: Targets, meas: Measurements, sightings: Sightings, b: int, k: int) -> None:
    """Give a measurement of a leg, and the sighting of it, to a person."""
    meas.assigned[k] = b
    if meas.sighting[k] >= 0:
        sightings.number[meas.sighting[k]] = targets.number[b]


def _record_person_hit(targets: Targets, b: int, meas: Measurements, x: float, y: float) -> None:
    """Record a hit of a person."""
    track_evidence.record_hit(targets, b)
    targets.sightings[b] += 1
    targets.last_sweep[b], targets.last_time[b] = meas.sweep, meas.time
    kalman.mark_seen(targets, b, meas.sensor)
    targets.middle_x[b], targets.middle_y[b] = x, y
    targets.from_x[b], targets.from_y[b] = kalman.centre(targets, b)


def _initiate_person(
    persons: Persons, targets: Targets, meas: Measurements, sightings: Sightings, leg: int, k: int
) -> None:
    """Initiate a person from a leg that moves and has none."""
    b = kalman.allocate(targets)
    kalman.reset(targets, b)
    targets.kind[b] = kalman.PERSON
    targets.first_sweep[b], targets.first_time[b] = meas.sweep, meas.time
    targets.onset[b] = targets.onset[leg]
    targets.moved[b] = targets.kind_hits[b] = 1
    targets.existence[b] = targets.existence[leg]
    targets.evidence[b] = targets.max_evidence[b] = targets.evidence[leg]
    for i in range(2):
        a = 2 * b + i
        middle = meas.middle_x[k] if i == 0 else meas.middle_y[k]
        kalman.initiate_axis(targets, a, middle - PERSON_RADIUS, middle + PERSON_RADIUS, ONE_LEG_VAR, ONE_LEG_VAR)
        targets.v[a] = targets.v[2 * leg + i]
        targets.ch[a] = 0.0
    _join_leg(targets, leg, b)
    targets.measurement[b] = k
    persons.assigned[k] = b + 1
    _give(targets, meas, sightings, b, k)
    _record_person_hit(targets, b, meas, meas.middle_x[k], meas.middle_y[k])
