"""Things that touch a wall: where no step divides the two, the corner between them does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidarcli.formalism.faces import Faces
from lidarcli.formalism.fragments import next_run
from lidarcli.formalism.ragged import offsets_of, span_first, span_max, span_sum, spans
from lidarcli.formalism.runs import HIDDEN, OWN, Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

TURN = np.deg2rad(25.0)
"""Faces that turn less than this do not make a corner."""
BACKING = 0.4
"""[m] A face at least this long, beside which a thing stands, is wall."""
RELIEF = 0.1
"""[m] A thing stands out from its wall by more than this: mouldings and skirting boards do not."""
WIDEST = 1.5
"""[m] What stands out over more than this is a part of the building."""
BEHIND = 0.1
"""[m] What is seen past the free edge of a thing lies no further than this behind the line of its wall."""
PLANE = 0.03
"""[m] Points stand out less than this from the wall that they are on."""
TRIM = 6
"""At each end so many points may turn out to be wall: the corner is only known to every few points."""


@record
class Carved:
    """C stretches of runs that are things."""

    run: Int64
    first: Int64
    """(C,) index of the first point."""
    last: Int64


def carve(runs: Runs, faces: Faces, worth: Bool, sigma: Float64) -> Carved:
    """Find stretches of runs that stand out: between corners that point away, with corners that point at the sensor.

    Parameters
    ----------
    runs, faces : R runs and their F faces
    worth : (R,) runs with points enough
    sigma : (S,) noise of the ranges [m]
    """
    return Carved(*stretches(runs, faces, worth, sigma))


@compiled
def stretches(runs: Runs, faces: Faces, worth: Bool, sigma: Float64) -> tuple[Int64, Int64, Int64]:
    """Columns of `Carved`."""
    face = np.flatnonzero(worth[faces.run])
    if not len(face):
        return face, face, face
    run = faces.run[face]
    turn = np.full(len(face), np.inf)
    turn[1:] = faces.turn(face[:-1], face[1:])
    fresh = np.ones(len(face), bool)
    fresh[1:] = run[1:] != run[:-1]
    begins = np.flatnonzero(fresh | (turn > np.sin(TURN)))
    pointed = np.add.reduceat((turn < -np.sin(TURN)) & ~fresh, begins)
    ends = np.append(begins[1:], len(face)) - 1
    inner_start, inner_end = ~fresh[begins], np.append(~fresh[begins[1:]], False)
    run = run[begins]
    # What backs a stretch may be torn into several faces by noise, without a corner between: the longest speaks for it.
    straight = np.append(np.flatnonzero(fresh | (np.abs(turn) > np.sin(TURN))), len(face))
    length = faces.length[face]
    size = np.diff(straight)
    longest = face[span_first(length == np.repeat(span_max(length, straight), size), straight)]
    back = np.repeat(longest, size)
    before, after = back[np.maximum(begins - 1, 0)], back[np.minimum(ends + 1, len(face) - 1)]
    free_start, free_end = runs.start_edge[run] == OWN, runs.end_edge[run] == OWN
    likely = ((pointed > 0) | ~inner_start | ~inner_end) & (inner_start | inner_end)
    # Of two straight faces without another corner the longer one is the wall.
    least = np.maximum(BACKING, np.where(pointed > 0, 0.0, span_sum(length, np.append(begins, len(face)))))
    likely &= np.where(inner_start, faces.length[before] >= least, free_start)
    likely &= np.where(inner_end, faces.length[after] >= least, free_end)
    k = np.flatnonzero(likely)
    first, last = faces.first[face[begins[k]]], faces.last[face[ends[k]]]
    level = sigma[runs.row[run[k]]]
    small, relief = _outline(runs, faces, face[begins[k]], ends[k] - begins[k] + 1, first, last)
    backs = [(before[k], inner_start[k]), (after[k], inner_end[k])]
    stands_out = small
    for back, there in backs:
        ahead = _ahead(runs, faces, back, relief)
        stands_out &= ~there | (ahead > RELIEF + 2.0 * level)
    k, first, last, level = k[stands_out], first[stands_out], last[stands_out], level[stands_out]
    beside = _wall_goes_on(runs, faces, run[k], before[k], inner_start[k], after[k], inner_end[k], level)
    k, first, last, level = k[beside], first[beside], last[beside], level[beside]
    for back, there, at, step in (
        (before[k], inner_start[k], first, 1),
        (after[k], inner_end[k], last, -1),
    ):
        _trim(runs, faces, back, there, at, step, PLANE + 2.0 * level, first, last)
    long_enough = last > first
    return run[k][long_enough], first[long_enough], last[long_enough]


def _wall_goes_on(
    runs: Runs,
    faces: Faces,
    run: Int64,
    before: Int64,
    inner_start: Bool,
    after: Int64,
    inner_end: Bool,
    sigma: Float64,
) -> Bool:
    """Whether past a free end the view is closed by the wall of the other end or before it: at a doorway it is not."""
    following = next_run(runs)
    previous = np.arange(len(runs))
    has_next = np.flatnonzero(following != previous)
    previous[following[has_next]] = has_next
    goes_on = np.ones(len(run), bool)
    for free, back, point in (
        (~inner_end, before, runs.first[following[run]]),
        (~inner_start, after, runs.last[previous[run]]),
    ):
        goes_on &= ~free | (_depth(runs, faces, back, point) >= -(BEHIND + 2.0 * sigma))
    return goes_on


def _outline(
    runs: Runs, faces: Faces, face: Int64, count: Int64, first: Int64, last: Int64
) -> tuple[Bool, tuple[Int64, Int64]]:
    """Which stretches are small enough, and their vertices that point out: indices of points, and offsets."""
    x, y = runs.points.x, runs.points.y
    size = count + 1
    offsets = offsets_of(size)
    vertex = np.empty(offsets[-1], np.int64)
    follows = np.ones(len(vertex), bool)
    follows[offsets[:-1]] = False
    vertex[offsets[:-1]] = first
    vertex[follows] = faces.last[spans(face, count)[0]]
    small = np.ones(len(face), bool)
    for end in (first, last):
        dx, dy = x[vertex] - np.repeat(x[end], size), y[vertex] - np.repeat(y[end], size)
        small &= np.sqrt(span_max(dx * dx + dy * dy, offsets)) <= WIDEST
    return small, (vertex, offsets)


def _ahead(runs: Runs, faces: Faces, back: Int64, outline: tuple[Int64, Int64]) -> Float64:
    """How far the foremost vertex of each stretch stands before the line of `back`, towards the sensor [m]."""
    vertex, offsets = outline
    if not len(back):
        return np.empty(0)
    depth = _depth(runs, faces, np.repeat(back, np.diff(offsets)), vertex)
    foremost: Float64 = np.maximum.reduceat(depth, offsets[:-1])
    return foremost


def _depth(runs: Runs, faces: Faces, back: Int64, point: Int64) -> Float64:
    """How far points stand before the line of a face, towards the sensor [m]."""
    mx, my, dx, dy = (
        faces.middle_x[back],
        faces.middle_y[back],
        faces.direction_x[back],
        faces.direction_y[back],
    )
    side = np.where(my * dx - mx * dy > 0, 1.0, -1.0)
    depth: Float64 = ((runs.points.x[point] - mx) * dy - (runs.points.y[point] - my) * dx) * side
    return depth


def _trim(
    runs: Runs,
    faces: Faces,
    back: Int64,
    there: Bool,
    at: Int64,
    step: int,
    tolerance: Float64,
    first: Int64,
    last: Int64,
) -> None:
    """Move an end of each stretch inwards past the points that lie on the wall beside it; in place."""
    on_wall = there.copy()
    for _ in range(TRIM):
        on_wall &= (_depth(runs, faces, back, at) <= tolerance) & (first < last)
        if not on_wall.any():
            return
        at += step * on_wall


def cut_out(runs: Runs, carved: Carved) -> tuple[Runs, Int64, Bool]:
    """Divide runs at what was carved from them.

    Returns
    -------
    runs : R + 2 C runs at most, in order
    origin : run each one was a part of
    thing : whether it is one of the carved stretches
    """
    if not len(carved.run):
        return runs, np.arange(len(runs)), np.zeros(len(runs), bool)
    x = np.concatenate([runs.first, carved.first, carved.last + 1])
    origin = np.concatenate([np.arange(len(runs)), carved.run, carved.run])
    thing = np.zeros(len(x), bool)
    thing[len(runs) : len(runs) + len(carved.run)] = True
    order = np.lexsort((thing, x, origin))
    begin, origin, thing = x[order], origin[order], thing[order]
    closing = np.ones(len(begin), bool)
    closing[:-1] = origin[1:] != origin[:-1]
    end = np.append(begin[1:], 0) - 1
    end[closing] = runs.last[origin[closing]]
    real = end >= begin
    begin, end, origin, thing = begin[real], end[real], origin[real], thing[real]
    starts, stops = begin == runs.first[origin], end == runs.last[origin]
    r = runs.points.range
    before, after = (
        r(begin) - r(np.maximum(begin - 1, 0)),
        r(np.minimum(end + 1, len(runs.points) - 1)) - r(end),
    )
    inner = np.where(thing, OWN, HIDDEN).astype(np.uint8)
    divided = replace(
        runs,
        row=runs.row[origin],
        first=begin,
        size=end - begin + 1,
        start_edge=np.where(starts, runs.start_edge[origin], inner),
        end_edge=np.where(stops, runs.end_edge[origin], inner),
        s_start=np.where(starts, runs.s_start[origin], before),
        s_end=np.where(stops, runs.s_end[origin], after),
    )
    return divided, origin, thing


def of_parts(faces: Faces, runs: Runs) -> Faces:
    """The faces with the divided runs they belong to: those that hold their middle."""
    middle = (faces.first + faces.last) // 2
    order = np.argsort(runs.first, kind="stable")
    run = order[np.searchsorted(runs.first[order], middle, side="right") - 1]
    return replace(faces, run=run, offsets=offsets_of(np.bincount(run, minlength=len(runs))))
