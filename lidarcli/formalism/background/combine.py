"""What is not in a sweep beside what is: two detections as one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.background.ragged import offsets_of, spans
from lidarcli.formalism.detection import WALL, Detection, fields_per
from lidarcli.sweeps import Bool, Int32, Int64

_LATER_FIELDS = ("label", "label_score", "features")
"""Fields that are filled when a detection is whole, or never with a background."""
_OBJECT_FIELDS = [name for name in fields_per("object") if name not in ("object", *_LATER_FIELDS)]
_LISTS = {"vertex_offsets": fields_per("vertex"), "face_offsets": fields_per("face")}
"""Offsets of the lists of objects → fields of their elements."""


def combine(first: Detection, second: Detection, rows: Int64) -> Detection:
    """The objects of both, numbered anew by increasing theta_i, walls last; the first tells of the sweeps.

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
    """The objects (K,) that are chosen, which keep their numbers; what is counted per sweep stays as it is."""
    index = np.flatnonzero(chosen)
    values: dict[str, Any] = {
        name: None if getattr(found, name) is None else getattr(found, name)[index]
        for name in (*_OBJECT_FIELDS, "object")
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
    """Lists of the objects in a new order."""
    starts = np.concatenate(
        [getattr(first, offsets)[:-1], getattr(second, offsets)[:-1] + getattr(first, offsets)[-1]]
    )
    sizes = np.concatenate([np.diff(getattr(first, offsets)), np.diff(getattr(second, offsets))])
    index, _, joined = spans(starts[order].astype(np.int64), sizes[order].astype(np.int64))
    return {offsets: joined.astype(np.int32)} | {name: _joined(first, second, name)[index] for name in names}


def _renumbered(beam_object: Int32, row: Int64, new: Int32) -> Int32:
    """(S, B) the numbers of the beams' objects, `new` (K,) in place of 1, 2, ... in each sweep."""
    table = np.append(new, 0)
    index = offsets_of(np.bincount(row, minlength=len(beam_object)))[:-1, None] + beam_object - 1
    result: Int32 = np.where(beam_object > 0, table[np.where(beam_object > 0, index, -1)], 0).astype(np.int32)
    return result
