"""Which view is which body: the assignment of least cost, and views that are a further part of a body."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism.tracking import assignment as assignments
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import sides as measures
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.assignment import Assignment
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.sides import Sides
from lidarcli.formalism.tracking.views import Views

INFINITY = assignments.INFINITY
GATE = 6.25
"""A body is rather without a view than with one that costs more."""
REACH = 0.12
"""[m] A centroid may be this far from where it is expected, as a standard deviation …"""
REACH_SIZE = 0.25
"""… and this share of the size of the body further."""
CAP = 4.0
"""A single side may not cost more than this squared number of standard deviations."""
SIZE_ERROR = 0.15
"""[m] Standard deviation of the difference between two sizes of one body."""
SIZE_CAP = 2.0
"""The size of a body says no more than this."""
NEWCOMER = 1.0
"""What is hardly known yet comes after what is well known, by this much."""
MOST_REACH = 1.5
"""[m] However uncertain a body is, a view is not further away than this many of these."""
JOIN = 0.1
"""[m] A further part of a body lies inside of it, give or take this."""


class Pairs:
    """Bodies and views that may be one, by body: `count` of them, and room for `most`."""

    def __init__(self, bodies: int, views: int) -> None:
        self.owner: list[Any] = []
        self.most = 8 * (bodies + views) + 64
        self.count = 0
        self.body = native.integers(self.owner, self.most)
        self.view = native.integers(self.owner, self.most)
        self.cost = native.doubles(self.owner, self.most)
        self.group = native.integers(self.owner, bodies + views)
        """Of bodies, then of views: one that they hang together with, by pairs."""
        self.place = native.integers(self.owner, bodies + views)
        """Of bodies and views: row and column in the assignment at hand."""
        self.member = native.integers(self.owner, bodies + views)
        """The bodies, then the views of the assignment at hand."""
        self.next = native.integers(self.owner, self.most)
        self.head = native.integers(self.owner, bodies + views)
        """The pairs of each group as a chain."""


def associate(pairs: Pairs, task: Assignment, sides: Sides, bodies: Bodies, views: Views, owner: Any) -> None:
    """Fill `bodies.view`, and `owner`, the body of each view, -1 for none."""
    for b in range(bodies.high):
        bodies.view[b] = -1
    for k in range(views.count):
        owner[k] = -1
    _collect(pairs, sides, bodies, views)
    _chain(pairs, bodies)
    for i in range(pairs.count):
        if pairs.head[pairs.group[pairs.body[i]]] >= 0:
            _assign_group(pairs, task, bodies, owner, pairs.group[pairs.body[i]])


def _collect(pairs: Pairs, sides: Sides, bodies: Bodies, views: Views) -> None:
    """All pairs within the gate."""
    pairs.count = 0
    for b in range(bodies.high):
        if bodies.state[b] != things.LIVE or bodies.kind[b] == things.PERSON:
            continue
        x, y = things.centre(bodies, b)
        moved_x, moved_y = x - bodies.from_x[b], y - bodies.from_y[b]
        x, y = bodies.middle_x[b] + moved_x, bodies.middle_y[b] + moved_y
        size = 2.0 * math.sqrt(bodies.h[2 * b] * bodies.h[2 * b] + bodies.h[2 * b + 1] * bodies.h[2 * b + 1])
        var = 0.5 * (bodies.cc[2 * b] + bodies.cc[2 * b + 1])
        reach = REACH + REACH_SIZE * size + math.sqrt(var)
        if views.pose_var > 0.0 or views.pose_turn_var > 0.0:
            dx, dy = x - views.x, y - views.y
            reach += math.sqrt(views.pose_var + views.pose_turn_var * (dx * dx + dy * dy))
        most = min(math.sqrt(GATE) * reach, MOST_REACH)
        for k in range(views.count):
            dx, dy = views.middle_x[k] - x, views.middle_y[k] - y
            far = dx * dx + dy * dy
            if far > most * most:
                continue
            cost = far / (reach * reach) + NEWCOMER * (1.0 - bodies.existence[b])
            cost += _misfit(sides, bodies, views, b, k)
            if cost < GATE and pairs.count < pairs.most:
                i = pairs.count
                pairs.body[i], pairs.view[i], pairs.cost[i] = b, k, cost
                pairs.count += 1


def _misfit(sides: Sides, bodies: Bodies, views: Views, b: int, k: int) -> float:
    """How badly the sides of a view fit those of a body, and its size that of the body."""
    measures.measure(sides, views, k, bodies, b, looks.pose_variance(views, k))
    total, number = 0.0, 0.0
    for side in range(4):
        if sides.var[side] < 0.0 or (sides.by_centre and (side == 1 or side == 3)):
            continue
        sign = 0.0 if sides.by_centre else (1.0 if side == 1 or side == 3 else -1.0)
        off, s = things.residual(bodies, 2 * b + side // 2, sides.z[side], sign, sides.var[side])
        total += min(off * off / s, CAP)
        number += 1.0
    cost = 0.5 * total / number if number > 0.0 else 0.0
    if bodies.whole[b] >= 3 and not measures.is_partial(views, k):
        size = math.sqrt(views.length[k] * views.length[k] + views.width[k] * views.width[k])
        off = (size - bodies.size[b]) / (SIZE_ERROR + 0.2 * bodies.size[b])
        cost += min(off * off, SIZE_CAP)
    return cost


def _chain(pairs: Pairs, bodies: Bodies) -> None:
    """Which pairs hang together: those of one body or one view, and so on."""
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
    # From the last to the first, so that chains begin with the first.
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
    """Solve one group of pairs."""
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
    assignments.solve(task, GATE)
    for row in range(rows):
        if task.column[row] >= 0:
            b, k = pairs.member[row], pairs.member[n + task.column[row]]
            bodies.view[b], owner[k] = k, b


def join_parts(bodies: Bodies, views: Views, owner: Any) -> None:
    """A view that nobody took, whose hidden edge lies inside of a body that is seen elsewhere, is a part of that.

    Such a view gets `owner` = -2 - body.
    """
    for k in range(views.count):
        if owner[k] != -1 or not measures.is_partial(views, k):
            continue
        best, least = -1, JOIN
        for b in range(bodies.high):
            if bodies.state[b] != things.LIVE or bodies.view[b] < 0 or bodies.sightings[b] < 3:
                continue
            out = outside(bodies, b, views.middle_x[k], views.middle_y[k])
            if not measures.is_partial(views, bodies.view[b]):
                # What is seen whole has no further parts, unless it is ragged.
                out += 1.5 * JOIN
            if out < least and _has_room(bodies, b, views, k):
                best, least = b, out
        if best >= 0:
            owner[k] = -2 - best


def _has_room(bodies: Bodies, b: int, views: Views, k: int) -> bool:
    """Whether a body is as large as a part of it."""
    size = math.sqrt(bodies.h[2 * b] * bodies.h[2 * b] + bodies.h[2 * b + 1] * bodies.h[2 * b + 1])
    return views.chord[k] <= 2.0 * size + JOIN


def outside(bodies: Bodies, b: int, x: float, y: float) -> float:
    """How far a point is outside of a body [m], negative inside."""
    centre_x, centre_y = things.centre(bodies, b)
    dx, dy = x - centre_x, y - centre_y
    if bodies.kind[b] != things.BOX:
        return math.sqrt(dx * dx + dy * dy) - 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
    along, across = things.to_axes(bodies, b, dx, dy)
    return max(abs(along) - bodies.h[2 * b], abs(across) - bodies.h[2 * b + 1])
