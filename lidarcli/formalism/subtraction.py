"""§3: r_w - r_e, the beams where it leaves the noise, and the objects that appear or are gone by it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lidarcli.formalism.background import (
    Background,
    Shift,
    SurfaceLines,
    Surroundings,
    align,
    expected,
    greatest_range,
    lines,
    nearest,
    project,
    shift,
    surroundings,
)
from lidarcli.formalism.detect import detect, noise
from lidarcli.formalism.detection import (
    APPEARED,
    BOTH_HIDDEN,
    CUT,
    END_HIDDEN,
    FULL,
    REMOVED,
    START_HIDDEN,
    WALL,
    Detection,
    fields_per,
    grouped_medians,
    offsets_of,
    spans,
)
from lidarcli.formalism.parameters import Parameters
from lidarcli.sweeps.types import Bool, Closure, Float32, Float64, Int64, Status, SweepBatch, record

THRESHOLD_SDS, MIN_THRESHOLD, BESIDE_SHARE = 4.0, 0.08, 0.6
"""Standard deviations from which on a range differs from the background; least difference [m], for errors by the
reflectivity of a surface and the temperature of the sensor; share of the threshold that is enough next to a beam that
differs."""
ALIGNED_ERROR = 0.015
"""[m] Error of ranges that were projected onto a station."""
SEEN_THROUGH = 0.3
"""[m] Distance behind r_e from which on a range shows that the background is gone or another one."""
MAX_DIFFERING = 0.5
"""Share of the ranges that differ, before or behind the background, from which on a note is given. In busy halls it is
up to a fifth; with the background of another place, or of a parked sensor that moved, it is 0.6 and more."""

MAX_SWEEP_DIFFERING, MAX_SWEEPS_DIFFERING, MIN_SWEEPS_DIFFERING = 0.4, 0.05, 10
"""Share of the ranges of a sweep that differ above which somebody seems to have moved the sensor; share and least number of
such sweeps for a note."""


@record
class BackgroundDifference:
    """r_w - r_e of S sweeps of up to B beams."""

    station: Int64
    """(S,) station of the background, -1 for none."""
    away: Float64
    """(S,) distance from the nearest station [m]; 0 without poses, inf if unknown."""
    known: Bool
    """(S, B) True for beams with a range or no return whose background is known."""
    r_e: Float32
    """(S, B) background in the direction of each beam [m]; inf if open, NaN if unknown."""
    difference: Float32
    """(S, B) r_w - r_e [m], with the greatest range of the sensor for no return; NaN if unknown."""
    appeared: Bool
    """(S, B) True for beams that end before the background."""
    removed: Bool
    """(S, B) True for beams that pass through it."""


@record
class Tolerance:
    """Tolerances of the comparison with a background; None for those of the background."""

    threshold: float | None = None
    """Least |r_w - r_e| of a beam that differs [m]; by default from the noise."""
    distance: float | None = None
    """Greatest distance of the station [m]."""
    angle: float | None = None
    """Greatest difference of heading [rad]."""
    removed: bool = False
    """True to look for removed objects too."""
    max_gap: int = 2
    """Greatest number of beams without a return in a row that are lost; more show that nothing is there."""


class Subtraction:
    """A background, prepared for sweeps to be compared with it."""

    def __init__(self, background: Background, tolerance: Tolerance | None = None) -> None:
        self.background = background
        self.tolerance = tolerance or Tolerance()
        self._around: dict[int, Surroundings] = {}
        self._known: SurfaceLines | None = None
        with np.errstate(invalid="ignore"):
            self._two = bool((background.r_near < background.r_e).any())

    def difference(self, batch: SweepBatch, sigma: Float64) -> BackgroundDifference:
        """Compare S sweeps of this sensor with the background of the place where they were taken; `sigma` (S,) is their
        noise [m].
        """
        station, away = self._stations(batch)
        result = nothing_known(batch, station, away)
        posed = batch.poses is not None and bool(self.background.posed.any())
        moved = shift(batch.poses, self.background.poses.rows(station)) if posed and batch.poses else None
        here = self.background.grid.fits(batch)
        if moved is not None:
            here &= moved.none
        for rows in (np.flatnonzero(here & (station >= 0)), np.flatnonzero(~here & (station >= 0))):
            if not len(rows):
                continue
            whole = len(rows) == len(batch)
            part = batch if whole else batch.rows(rows)
            if here[rows[0]]:
                found = self._here(part, station[rows], sigma[rows])
            else:
                found = self._elsewhere(part, station[rows], sigma[rows], moved and moved.rows(rows))
            if whole and found.known.shape == result.known.shape:
                return replace(found, station=station, away=away)
            assemble(result, [(rows, replace(found, station=station[rows], away=away[rows]))])
        return result

    def _stations(self, batch: SweepBatch) -> tuple[Int64, Float64]:
        """Return the station of each sweep, and the distance of the nearest one [m]."""
        background, count = self.background, len(batch)
        only = np.zeros(count, np.int64)
        if not len(background):
            return only - 1, np.full(count, np.inf)
        if not background.posed.any():
            return only, np.zeros(count)
        if batch.poses is None:
            # A parked sensor needs no pose; one that moved does.
            return (only, np.zeros(count)) if len(background) == 1 else (only - 1, np.full(count, np.inf))
        distance = background.distance if self.tolerance.distance is None else self.tolerance.distance
        angle = background.angle if self.tolerance.angle is None else self.tolerance.angle
        return nearest(batch.poses, background.poses, distance, angle)

    def _surroundings(self, reach: int) -> Surroundings:
        if reach not in self._around:
            self._around[reach] = surroundings(self.background, reach)
        return self._around[reach]

    def _here(self, batch: SweepBatch, station: Int64, sigma: Float64) -> BackgroundDifference:
        """Compare sweeps with the bearings of the background, taken at their stations."""
        around = self._surroundings(1)
        beams = self.background.grid.beams
        at = station[:1] if bool((station == station[0]).all()) else station
        return self._judge(
            batch,
            batch.ranges[:, :beams],
            around.near[at],
            around.far[at],
            around.r_e[at],
            around.returns[at],
            self._threshold(around.spread[at], sigma, 0.0),
            around.r_near[at] if self._two else None,
        )

    def _elsewhere(self, batch: SweepBatch, station: Int64, sigma: Float64, moved: Shift | None) -> BackgroundDifference:
        """Compare sweeps with other bearings, or taken next to a station."""
        background = self.background
        if moved is not None:
            if self._known is None:
                self._known = lines(background.grid, background.r_e)
            moved = align(batch, background.grid, self._known, station, moved)
        beam, ranges = project(batch, background.grid, moved)
        # A coarse sweep may look anywhere between its beams.
        reach = np.maximum(np.rint(np.abs(batch.angle_increment / background.grid.angle_increment)), 1)
        near, far, r_e, spread = (np.full(beam.shape, np.nan, np.float32) for _ in range(4))
        returns = np.zeros(beam.shape, bool)
        for width in np.unique(reach).astype(int).tolist():
            around = self._surroundings(width)
            row, column = np.nonzero((beam >= 0) & (reach == width)[:, None])
            place = station[row], beam[row, column]
            # From next to a station both sides of an edge may be observed.
            near[row, column], far[row, column] = around.nearest[place], around.far[place]
            r_e[row, column], spread[row, column] = around.r_e[place], around.spread[place]
            returns[row, column] = around.returns[place]
        threshold = self._threshold(spread, sigma, 0.0 if moved is None else ALIGNED_ERROR)
        found = self._judge(batch, ranges.astype(np.float32), near, far, r_e, returns, threshold)
        if moved is None or not self.tolerance.removed:
            return found
        shown = expected(batch, background.grid, background.r_e[station], moved).astype(np.float32)
        gone = self._judge(
            batch, batch.ranges, np.full_like(shown, -np.inf), _farthest(batch, shown), shown, returns, threshold
        )
        removed = gone.removed & ~found.appeared
        return replace(
            found,
            removed=removed,
            r_e=np.where(removed, gone.r_e, found.r_e),
            difference=np.where(removed, gone.difference, found.difference),
        )

    def _threshold(self, spread: Float32, sigma: Float64, error: float) -> Float32:
        """Return (S, B) or (1, 1) the least difference that counts [m]."""
        if self.tolerance.threshold is not None:
            return np.full((1, 1), self.tolerance.threshold, np.float32)
        noisy = np.maximum(spread, sigma.astype(np.float32)[:, None])
        noisy *= np.float32(THRESHOLD_SDS)
        noisy += np.float32(error)
        return np.maximum(noisy, np.float32(MIN_THRESHOLD), out=noisy)

    def _judge(
        self,
        batch: SweepBatch,
        ranges: Float32,
        near: Float32,
        far: Float32,
        r_e: Float32,
        returns: Bool,
        threshold: Float32,
        also: Float32 | None = None,
    ) -> BackgroundDifference:
        """Compare ranges with the background in their directions, (S, B) or (1, B); ranges that agree with `also` are
        background, too.
        """
        width = ranges.shape[1]
        status = batch.status[:, :width]
        nothing = status == Status.NO_RETURN
        limit = greatest_range(batch)[:, None]
        with np.errstate(invalid="ignore"):
            known = ~np.isnan(r_e) & (status <= Status.NO_RETURN)
            difference = np.where(nothing, limit, ranges) - np.minimum(r_e, limit)
            nearer = -difference
            if also is not None:
                nearer[np.abs(ranges - also) <= threshold] = 0.0
            appeared = _runs(nearer, near - ranges, threshold)
            removed = np.zeros(ranges.shape, bool)
            if self.tolerance.removed:
                lost = nothing & returns & np.isfinite(far)
                removed = _runs(difference, ranges - far, threshold, lost, self.tolerance.max_gap)
            difference[~np.isfinite(difference)] = np.nan
        return BackgroundDifference(
            station=np.zeros(0, np.int64),
            away=np.zeros(0),
            known=known,
            r_e=np.broadcast_to(r_e, ranges.shape),
            difference=difference,
            appeared=appeared,
            removed=removed,
        )


def nothing_known(batch: SweepBatch, station: Int64 | None = None, away: Float64 | None = None) -> BackgroundDifference:
    """Return the difference of sweeps whose background is unknown."""
    shape = batch.ranges.shape
    return BackgroundDifference(
        station=np.full(len(batch), -1) if station is None else station,
        away=np.full(len(batch), np.inf) if away is None else away,
        known=np.zeros(shape, bool),
        r_e=np.full(shape, np.nan, np.float32),
        difference=np.full(shape, np.nan, np.float32),
        appeared=np.zeros(shape, bool),
        removed=np.zeros(shape, bool),
    )


def assemble(whole: BackgroundDifference, parts: list[tuple[Int64, BackgroundDifference]]) -> BackgroundDifference:
    """Copy the differences of some sweeps to their rows of the whole, and return it."""
    for rows, part in parts:
        whole.station[rows], whole.away[rows] = part.station, part.away
        for name in ("known", "r_e", "difference", "appeared", "removed"):
            values = getattr(part, name)
            getattr(whole, name)[rows, : values.shape[1]] = values
    return whole


def _farthest(batch: SweepBatch, ranges: Float32) -> Float32:
    """Return (S, B) the farthest range of each beam and its neighbours [m]; NaN where the beam itself is unknown."""
    far = np.where(np.isnan(ranges), -np.inf, ranges)
    wide = far.copy()
    np.maximum(wide[:, 1:], far[:, :-1], out=wide[:, 1:])
    np.maximum(wide[:, :-1], far[:, 1:], out=wide[:, :-1])
    rows = np.flatnonzero(batch.closure != Closure.OPEN)
    last = (batch.beams - 1)[rows]
    ends = np.maximum(far[rows, 0], far[rows, last])
    wide[rows, 0] = np.maximum(wide[rows, 0], ends)
    wide[rows, last] = np.maximum(wide[rows, last], ends)
    return np.where(np.isnan(ranges), np.nan, wide)


def _runs(own: Float32, beyond: Float32, threshold: Float32, lost: Bool | None = None, most_lost: int = 0) -> Bool:
    """Return (S, B) True for runs of beams that differ from the background.

    Every beam of a run is beyond its `own` r_e, and one of them also `beyond` that of its neighbours [m]: a depth edge that
    jitters by a beam has no such beam. `BESIDE_SHARE` of the threshold is enough next to a beam beyond it. More than
    `most_lost` beams in a row that are `lost`, without a return that they should have, need none. A single beam between two
    runs joins them if it is on their side of the background at all.
    """
    candidate = own > np.float32(BESIDE_SHARE) * threshold
    if lost is not None:
        candidate |= lost
    elif not candidate.any():
        return candidate
    width = max(own.shape[1], 1)
    at = np.flatnonzero(candidate)
    row = at // width
    begins = np.ones(len(at), bool)
    begins[1:] = (at[1:] - at[:-1] > 1) | (row[1:] != row[:-1])
    start = np.flatnonzero(begins)
    limit = np.broadcast_to(threshold, own.shape)[row, at - row * width]
    evidence = (beyond.reshape(-1)[at] > limit) * np.int64(most_lost + 1)
    if lost is not None:
        evidence += lost.reshape(-1)[at]
    sure = np.add.reduceat(evidence, start) > most_lost if len(at) else np.zeros(0, bool)
    kept = at[np.repeat(sure, np.diff(np.append(start, len(at))))]
    result = np.zeros(own.shape, bool)
    flat = result.reshape(-1)
    flat[kept] = True
    alone = (kept[1:] - kept[:-1] == 2) & (kept[1:] // width == kept[:-1] // width)
    hole = kept[:-1][alone] + 1
    flat[hole[own.reshape(-1)[hole] > 0]] = True
    return result


# Fig. 8f: the objects that make r_w - r_e leave the noise, those that have appeared, and those that are gone.

_LATER_FIELDS = ("label", "label_score", "features")
"""Fields that are filled when a detection is whole, or never with a background."""
_OBJECT_FIELDS = [name for name in fields_per("object") if name not in ("object", *_LATER_FIELDS)]
_LISTS = {"vertex_offsets": fields_per("vertex"), "face_offsets": fields_per("face")}
"""Offsets of the lists of objects → fields of their elements."""


def changes(
    batch: SweepBatch, difference: BackgroundDifference, parameters: Parameters, sigma: Float64, *, per_beam: bool = False
) -> Detection:
    """Return the objects that differ from the background: appeared ones and, where asked for, removed ones.

    Appeared objects are built from r_w, removed ones from r_e, by the same definitions; all other beams are in S (Def. 4).
    With `parameters.walls` the walls of the background are reported, too. `sigma`: (S,) noise of the ranges [m].
    """
    alone = replace(parameters, walls=False)
    found = detect(batch, alone, per_beam=per_beam, within=difference.appeared, sigma=sigma)
    found = _described(found, batch, difference.difference, difference.appeared, APPEARED)
    found = replace(
        found, station=difference.station.astype(np.int32), beam_difference=difference.difference if per_beam else None
    )
    if difference.removed.any():
        found = _with_removed(found, batch, difference, alone)
    if parameters.walls:
        found = _with_walls(found, batch, difference.appeared, parameters, sigma)
    return found


def _with_removed(
    found: Detection, batch: SweepBatch, difference: BackgroundDifference, parameters: Parameters
) -> Detection:
    """Add the removed objects, as the background shows them; they own no beam of the sweep."""
    rows = np.flatnonzero(difference.removed.any(axis=1))
    before = batch.rows(rows)
    r_e, removed = difference.r_e[rows], difference.removed[rows]
    status = np.where(np.isnan(r_e), Status.INVALID, np.where(np.isinf(r_e), Status.NO_RETURN, Status.VALID))
    # A beam that is lost now tells nothing: it is bridged like any other lost beam.
    status[(before.status != Status.VALID) & ~removed] = Status.INVALID
    status[before.status == Status.PADDING] = Status.PADDING
    ranges = np.where(status == Status.VALID, r_e, np.nan).astype(np.float32)
    scene = replace(before, ranges=ranges, status=status.astype(np.uint8), intensities=None)
    gone = detect(scene, parameters, within=removed, sigma=noise(scene))
    gone = _described(gone, scene, difference.difference[rows], removed, REMOVED)
    if found.intensity is not None:
        # A removed object has returned nothing.
        gone = replace(gone, intensity=np.full(len(gone), np.nan, np.float32))
    return combine(found, gone, rows)


def _with_walls(found: Detection, batch: SweepBatch, appeared: Bool, parameters: Parameters, sigma: Float64) -> Detection:
    """Add the walls of the sweeps without what has appeared."""
    status = np.where(appeared, Status.INVALID, batch.status).astype(np.uint8)
    scene = replace(batch, ranges=np.where(appeared, np.nan, batch.ranges).astype(np.float32), status=status)
    if parameters.profile == "robust" and not np.isfinite(parameters.max_width):
        # Without a greatest width of objects there are no walls.
        parameters = replace(parameters, max_width=Parameters().max_width)
    without = detect(scene, parameters, sigma=sigma)
    walls = select(without, without.shape == WALL)
    count = len(walls)
    walls = replace(
        walls, difference=np.full(count, np.nan), change=np.full(count, -1, np.int8), thing=np.full(count, np.nan)
    )
    return combine(found, walls, np.arange(len(batch)))


def _described(found: Detection, batch: SweepBatch, difference: Float32, within: Bool, change: int) -> Detection:
    """Fill in the columns that depend on the background, which hides an object only by a step beyond d_th."""
    with np.errstate(invalid="ignore"):
        start = (found.s_i > found.d_th) & np.isin(found.visibility, (START_HIDDEN, BOTH_HIDDEN))
        end = (found.s_f < -found.d_th) & np.isin(found.visibility, (END_HIDDEN, BOTH_HIDDEN))
    hidden = np.array([FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN], np.uint8)[start + 2 * end]
    # The median difference over the beams of each object, without NaN.
    count = batch.beams - (batch.closure == Closure.SHARED)
    size = (found.beam_f - found.beam_i).astype(np.int64)
    size = np.where(size < 0, size + count[found.row], size) + 1
    beam, owner, _ = spans(found.beam_i.astype(np.int64), size)
    row = found.row[owner]
    values = np.where(within, difference, np.nan)[row, beam % count[row]]
    return replace(
        found,
        visibility=np.where(found.visibility == CUT, CUT, hidden).astype(np.uint8),
        difference=grouped_medians(values, owner, len(found)),
        change=np.full(len(found), change, np.int8),
    )


def combine(first: Detection, second: Detection, rows: Int64) -> Detection:
    """Return the objects of both, numbered by increasing theta_i, walls last; the columns of sweeps are those of the first.

    The rows of the second are `rows` of the first. None of its objects is there in the sweep: their beams count as in the
    first.
    """
    second = replace(second, row=rows[second.row])
    keys = ("theta_i", "shape", "row")
    theta, shape, row = (np.concatenate([getattr(first, name), getattr(second, name)]) for name in keys)
    order = np.lexsort((theta, shape == WALL, row))
    known = [name for name in _OBJECT_FIELDS if getattr(first, name) is not None]
    values = {name: np.concatenate([getattr(first, name), getattr(second, name)])[order] for name in known}
    counts = np.bincount(values["row"], minlength=len(first.objects))
    number = np.arange(len(order)) - offsets_of(counts)[values["row"]] + 1
    for offsets, names in _LISTS.items():
        one, other = getattr(first, offsets), getattr(second, offsets)
        starts = np.concatenate([one[:-1], other[:-1] + one[-1]])[order].astype(np.int64)
        sizes = np.concatenate([np.diff(one), np.diff(other)])[order].astype(np.int64)
        index, _, joined = spans(starts, sizes)
        values[offsets] = joined.astype(np.int32)
        values |= {name: np.concatenate([getattr(first, name), getattr(second, name)])[index] for name in names}
    result = replace(first, **values, object=number.astype(np.int32))
    if first.beam_object is None:
        return result
    new = np.empty(len(order), np.int32)
    new[order] = number
    beams = first.beam_object
    begin = offsets_of(np.bincount(first.row, minlength=len(beams)))[:-1, None]
    index = np.where(beams > 0, begin + beams - 1, -1)
    numbers = np.append(new[: len(first)], 0)[index]
    return replace(result, beam_object=np.where(beams > 0, numbers, 0).astype(np.int32))


def select(found: Detection, chosen: Bool) -> Detection:
    """Return the chosen objects (K,), which keep their numbers; the columns of sweeps stay as they are."""
    index = np.flatnonzero(chosen)
    values: dict[str, Any] = {
        name: None if getattr(found, name) is None else getattr(found, name)[index] for name in (*_OBJECT_FIELDS, "object")
    }
    for offsets, names in _LISTS.items():
        starts = getattr(found, offsets).astype(np.int64)
        item, _, joined = spans(starts[index], np.diff(starts)[index])
        values |= {offsets: joined.astype(np.int32)} | {name: getattr(found, name)[item] for name in names}
    return replace(found, **values)
