"""The points of each object, and what they say of it without its faces."""

from __future__ import annotations

from typing import Any

import numpy as np

from lidarcli.formalism.parts import Parts
from lidarcli.formalism.ragged import offsets_of, span_first, span_min, spans
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int32, Int64, UInt8


@record
class Members:
    """T points of K objects; (K,) each but for the last three."""

    row: Int64
    is_wall: Bool
    number: Int32
    """1, 2, … within the row."""
    several: Bool
    """Whether it has more than one body."""
    start_edge: UInt8
    end_edge: UInt8
    beam_i: Int32
    """The beam of its first point in the order of the log."""
    beam_f: Int32
    theta_i: Float64
    """Bearing of its first point [rad]."""
    theta_f: Float64
    theta_min: Float64
    """Bearing of its nearest point [rad]."""
    r_i: Float64
    """[m]"""
    r_f: Float64
    r_min: Float64
    s_i: Float64
    """Signed difference on entering its first run [m]."""
    s_f: Float64
    x: Float64
    """Mean of its points, forward [m]."""
    y: Float64
    width: Float64
    """Distance of its first point from its last [m]."""
    offsets: Int64
    """(K + 1,) object k has the points `offsets[k]:offsets[k + 1]`."""
    point_x: Float64
    """(T,) forward [m]."""
    point_y: Float64
    """(T,) left [m]."""

    def __len__(self) -> int:
        return len(self.row)


def gather(runs: Runs, parts: Parts, is_wall: Bool, body: Int64 | None) -> Members:
    """Join the points of the objects.

    Parameters
    ----------
    runs : R runs
    parts : K objects as lists of runs
    is_wall : (R,)
    body : (R,) objects have as many bodies as their runs have labels here; None: as they have runs
    """
    return Members(*gathered(runs, parts, is_wall, np.arange(len(runs)) if body is None else body))


@compiled
def gathered(runs: Runs, parts: Parts, is_wall: Bool, body: Int64) -> tuple[Any, ...]:
    """Columns of the `Members` that `gather` returns."""
    points, geometry = runs.points, runs.points.geometry
    begin, end = parts.run[parts.offsets[:-1]], parts.run[parts.offsets[1:] - 1]
    row, rows = runs.row[begin], len(geometry.first)
    first, last = runs.first[begin], runs.last[end]
    number = np.arange(len(row)) - offsets_of(np.bincount(row, minlength=rows))[row] + 1
    several = np.zeros(len(row), bool)
    owner = np.repeat(np.arange(len(row)), np.diff(parts.offsets))
    label = body[parts.run]
    several[owner[1:][(label[1:] != label[:-1]) & (owner[1:] == owner[:-1])]] = True
    reverse = geometry.reverse[row]
    beam_first = geometry.beam(row, points.position(first, row))
    beam_last = geometry.beam(row, points.position(last, row))

    index, _, part_offsets = spans(runs.first[parts.run], runs.size[parts.run])
    offsets = part_offsets[parts.offsets]
    x, y, r = points.x[index], points.y[index], points.range(index)
    count = np.diff(offsets)
    owner = np.repeat(np.arange(len(count)), count)
    r_min = span_min(r, offsets)
    nearest = span_first(r == r_min[owner], offsets)
    part = np.searchsorted(part_offsets, nearest, side="right") - 1
    dx, dy = points.x[last] - points.x[first], points.y[last] - points.y[first]
    middle_x, middle_y = (np.bincount(owner, values, len(count)) / count for values in (x, y))
    return (
        row,
        is_wall[begin],
        number.astype(np.int32),
        several,
        runs.start_edge[begin],
        runs.end_edge[end],
        np.where(reverse, beam_last, beam_first).astype(np.int32),
        np.where(reverse, beam_first, beam_last).astype(np.int32),
        parts.theta_i[parts.offsets[:-1]],
        parts.theta_f[parts.offsets[1:] - 1],
        points.theta(index[nearest], row) + parts.past[part],
        points.range(first),
        points.range(last),
        r_min,
        runs.s_start[begin],
        runs.s_end[end],
        middle_x,
        middle_y,
        np.sqrt(dx * dx + dy * dy),
        offsets,
        x,
        y,
    )
