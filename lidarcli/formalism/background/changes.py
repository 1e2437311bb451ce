"""§3, Fig. 8f: the objects that make r_w - r_e leave the noise: what has appeared, and what is gone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidarcli.formalism.background.combine import combine, select
from lidarcli.formalism.background.ragged import spans
from lidarcli.formalism.background.subtraction import Difference
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
)
from lidarcli.formalism.medians import grouped_medians
from lidarcli.formalism.parameters import Parameters
from lidarcli.sweeps import Bool, Closure, Float32, Float64, Status, SweepBatch, UInt8


def changes(
    batch: SweepBatch,
    difference: Difference,
    parameters: Parameters,
    sigma: Float64,
    *,
    per_beam: bool = False,
) -> Detection:
    """The objects that differ from the background: what has appeared and, where that was looked for, what is gone.

    Appeared objects are built from r_w, removed ones from r_e, by the same definitions. All other beams are in S (Def. 4).

    Parameters
    ----------
    batch : S sweeps
    difference : from their background
    parameters : of the detection; with `walls` those of what has not appeared
    sigma : (S,) noise of the ranges [m]
    per_beam : also fill `beam_set`, `beam_object` and `beam_s`
    """
    alone = replace(parameters, walls=False)
    found = detect(batch, alone, per_beam=per_beam, within=difference.appeared, sigma=sigma)
    found = _described(found, batch, difference.difference, difference.appeared, APPEARED)
    found = replace(
        found,
        station=difference.station.astype(np.int32),
        beam_difference=difference.difference if per_beam else None,
    )
    if difference.removed.any():
        found = _with_removed(found, batch, difference, alone)
    if parameters.walls:
        found = _with_walls(found, batch, difference.appeared, parameters, sigma)
    return found


def _with_removed(
    found: Detection, batch: SweepBatch, difference: Difference, parameters: Parameters
) -> Detection:
    """Add the objects that are gone, as the background shows them: none is in the sweep or owns a beam of it."""
    rows = np.flatnonzero(difference.removed.any(axis=1))
    before = batch.rows(rows)
    r_e, removed = difference.r_e[rows], difference.removed[rows]
    status = np.where(np.isnan(r_e), Status.INVALID, np.where(np.isinf(r_e), Status.NO_RETURN, Status.VALID))
    # A beam that is lost now says nothing of what was there: bridged like any other lost beam.
    status[(before.status != Status.VALID) & ~removed] = Status.INVALID
    status[before.status == Status.PADDING] = Status.PADDING
    ranges = np.where(status == Status.VALID, r_e, np.nan).astype(np.float32)
    scene = replace(before, ranges=ranges, status=status.astype(np.uint8), intensities=None)
    gone = detect(scene, parameters, within=removed, sigma=noise(scene))
    gone = _described(gone, scene, difference.difference[rows], removed, REMOVED)
    if found.intensity is not None:
        # What a beam passes through returned nothing of it.
        gone = replace(gone, intensity=np.full(len(gone), np.nan, np.float32))
    return combine(found, gone, rows)


def _with_walls(
    found: Detection, batch: SweepBatch, appeared: Bool, parameters: Parameters, sigma: Float64
) -> Detection:
    """Add the walls of the sweeps without what has appeared."""
    status = np.where(appeared, Status.INVALID, batch.status).astype(np.uint8)
    scene = replace(batch, ranges=np.where(appeared, np.nan, batch.ranges).astype(np.float32), status=status)
    if parameters.profile == "robust" and not np.isfinite(parameters.max_width):
        # Without a greatest width of objects there are no walls.
        parameters = replace(parameters, max_width=Parameters().max_width)
    seen = detect(scene, parameters, sigma=sigma)
    walls = select(seen, seen.shape == WALL)
    count = len(walls)
    walls = replace(
        walls,
        difference=np.full(count, np.nan),
        change=np.full(count, -1, np.int8),
        thing=np.full(count, np.nan),
    )
    return combine(found, walls, np.arange(len(batch)))


def _described(
    found: Detection, batch: SweepBatch, difference: Float32, within: Bool, change: int
) -> Detection:
    """Add what the background tells of each object."""
    return replace(
        found,
        visibility=_visibility(found),
        difference=_medians(found, batch, np.where(within, difference, np.nan)),
        change=np.full(len(found), change, np.int8),
    )


def _visibility(found: Detection) -> UInt8:
    """(K,) an object that leans against the background is not hidden by it: only a step beyond d_th hides."""
    with np.errstate(invalid="ignore"):
        start = (found.s_i > found.d_th) & np.isin(found.visibility, (START_HIDDEN, BOTH_HIDDEN))
        end = (found.s_f < -found.d_th) & np.isin(found.visibility, (END_HIDDEN, BOTH_HIDDEN))
    hidden = np.array([FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN], np.uint8)[start + 2 * end]
    return np.where(found.visibility == CUT, CUT, hidden).astype(np.uint8)


def _medians(found: Detection, batch: SweepBatch, values: Float32) -> Float64:
    """(K,) median of the (S, B) values over the beams of each object, NaN left out."""
    count = batch.beams - (batch.closure == Closure.SHARED)
    size = (found.beam_f - found.beam_i).astype(np.int64)
    size = np.where(size < 0, size + count[found.row], size) + 1
    beam, owner, _ = spans(found.beam_i.astype(np.int64), size)
    row = found.row[owner]
    value = values[row, beam % count[row]]
    return grouped_medians(value, owner, len(found))
