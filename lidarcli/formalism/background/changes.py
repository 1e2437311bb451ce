"""§3, Fig. 8f: the objects that make r_w - r_e leave the noise: those that have appeared, and those that are gone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    fields_per,
)
from lidarcli.formalism.parameters import Parameters
from lidarcli.formalism.ragged import grouped_medians, offsets_of, spans
from lidarcli.sweeps import Bool, Closure, Float32, Float64, Int32, Int64, Status, SweepBatch, UInt8

_LATER_FIELDS = ("label", "label_score", "features")
"""Fields that are filled when a detection is whole, or never with a background."""
_OBJECT_FIELDS = [name for name in fields_per("object") if name not in ("object", *_LATER_FIELDS)]
_LISTS = {"vertex_offsets": fields_per("vertex"), "face_offsets": fields_per("face")}
"""Offsets of the lists of objects → fields of their elements."""


def changes(
    batch: SweepBatch, difference: Difference, parameters: Parameters, sigma: Float64, *, per_beam: bool = False
) -> Detection:
    """Return the objects that differ from the background: appeared ones and, where asked for, removed ones.

    Appeared objects are built from r_w, removed ones from r_e, by the same definitions. All other beams are in S (Def. 4).

    Parameters
    ----------
    batch : S sweeps
    difference : difference from their background
    parameters : parameters of the detection; with `walls`, the walls of the background are reported too
    sigma : (S,) noise of the ranges [m]
    per_beam : also fill `beam_set`, `beam_object` and `beam_s`
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


def _with_removed(found: Detection, batch: SweepBatch, difference: Difference, parameters: Parameters) -> Detection:
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
    seen = detect(scene, parameters, sigma=sigma)
    walls = select(seen, seen.shape == WALL)
    count = len(walls)
    walls = replace(
        walls, difference=np.full(count, np.nan), change=np.full(count, -1, np.int8), thing=np.full(count, np.nan)
    )
    return combine(found, walls, np.arange(len(batch)))


def _described(found: Detection, batch: SweepBatch, difference: Float32, within: Bool, change: int) -> Detection:
    """Fill in the columns that depend on the background."""
    return replace(
        found,
        visibility=_visibility(found),
        difference=_medians(found, batch, np.where(within, difference, np.nan)),
        change=np.full(len(found), change, np.int8),
    )


def _visibility(found: Detection) -> UInt8:
    """Return (K,) the visibilities: the background hides an object only by a step beyond d_th."""
    with np.errstate(invalid="ignore"):
        start = (found.s_i > found.d_th) & np.isin(found.visibility, (START_HIDDEN, BOTH_HIDDEN))
        end = (found.s_f < -found.d_th) & np.isin(found.visibility, (END_HIDDEN, BOTH_HIDDEN))
    hidden = np.array([FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN], np.uint8)[start + 2 * end]
    return np.where(found.visibility == CUT, CUT, hidden).astype(np.uint8)


def _medians(found: Detection, batch: SweepBatch, values: Float32) -> Float64:
    """Return (K,) the median of the (S, B) values over the beams of each object, without NaN."""
    count = batch.beams - (batch.closure == Closure.SHARED)
    size = (found.beam_f - found.beam_i).astype(np.int64)
    size = np.where(size < 0, size + count[found.row], size) + 1
    beam, owner, _ = spans(found.beam_i.astype(np.int64), size)
    row = found.row[owner]
    value = values[row, beam % count[row]]
    return grouped_medians(value, owner, len(found))


def combine(first: Detection, second: Detection, rows: Int64) -> Detection:
    """Return the objects of both, numbered by increasing theta_i, walls last; the columns of sweeps are those of the first.

    Parameters
    ----------
    first : detection on S sweeps
    second : detection on some of them; none of its objects is there in the sweep: their beams end elsewhere, and count as
        they do in the first
    rows : rows of `first` that the rows of `second` are
    """
    second = replace(second, row=rows[second.row])
    keys = ("theta_i", "shape", "row")
    theta, shape, row = (_joined(first, second, name) for name in keys)
    order = np.lexsort((theta, shape == WALL, row))
    known = [name for name in _OBJECT_FIELDS if getattr(first, name) is not None]
    values = {name: _joined(first, second, name)[order] for name in known}
    counts = np.bincount(values["row"], minlength=len(first.objects))
    number = np.arange(len(order)) - offsets_of(counts)[values["row"]] + 1
    for offsets, names in _LISTS.items():
        values |= _lists(first, second, offsets, names, order)
    result = replace(first, **values, object=number.astype(np.int32))
    if first.beam_object is None:
        return result
    new = np.empty(len(order), np.int32)
    new[order] = number
    return replace(result, beam_object=_renumbered(first.beam_object, first.row, new[: len(first)]))


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


def _joined(first: Detection, second: Detection, name: str) -> NDArray[Any]:
    return np.concatenate([getattr(first, name), getattr(second, name)])


def _lists(
    first: Detection, second: Detection, offsets: str, names: Iterable[str], order: Int64
) -> dict[str, NDArray[Any]]:
    """Return the lists of the objects in a new order."""
    starts = np.concatenate([getattr(first, offsets)[:-1], getattr(second, offsets)[:-1] + getattr(first, offsets)[-1]])
    sizes = np.concatenate([np.diff(getattr(first, offsets)), np.diff(getattr(second, offsets))])
    index, _, joined = spans(starts[order].astype(np.int64), sizes[order].astype(np.int64))
    return {offsets: joined.astype(np.int32)} | {name: _joined(first, second, name)[index] for name in names}


def _renumbered(beam_object: Int32, row: Int64, new: Int32) -> Int32:
    """Return (S, B) the objects of the beams, with the numbers `new` (K,) in place of 1, 2, ... in each sweep."""
    table = np.append(new, 0)
    index = offsets_of(np.bincount(row, minlength=len(beam_object)))[:-1, None] + beam_object - 1
    result: Int32 = np.where(beam_object > 0, table[np.where(beam_object > 0, index, -1)], 0).astype(np.int32)
    return result
