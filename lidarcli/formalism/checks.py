"""What a batch has to be before the loops over one sweep read it: compiled, they know no array's length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps import Bool, Closure, Float64, SweepBatch


def check(batch: SweepBatch, within: Bool | None = None, sigma: Float64 | None = None) -> None:
    """Refuse a batch of S sweeps with up to B beams that the readers of logs and `range_rules.normalise` would not give.

    Parameters
    ----------
    batch : SweepBatch
    within, sigma : (S, B) and (S,), see `detect`

    Raises
    ------
    ValueError
        An array has another shape; a sweep has more beams than columns, or is a full turn of fewer than three;
        `angle_min` or `angle_increment` is NaN or infinite; a range is 0 m, negative or infinite.
    """
    _check_shapes(batch, within, sigma)
    for name in ("angle_min", "angle_increment"):
        values = getattr(batch, name)
        _refuse(batch, ~np.isfinite(values), f"{name} is {{}}, not a finite angle", values)
    beams = batch.beams
    _refuse(batch, (beams < 0) | (beams > batch.width), f"{{}} beams in {batch.width} columns", beams)
    turns = batch.closure != Closure.OPEN.value
    # The loops look at both neighbours of a beam.
    _refuse(batch, turns & (beams < 3), "a full turn of {} beams", beams)
    # NaN is neither of both.
    for wrong in (batch.ranges <= 0, batch.ranges == np.inf):
        if wrong.any():
            values = batch.ranges[np.arange(len(batch)), wrong.argmax(axis=1)]
            _refuse(batch, wrong.any(axis=1), "{:g} m is no range (NaN stands for none)", values)


def _check_shapes(batch: SweepBatch, within: Bool | None, sigma: Float64 | None) -> None:
    """Refuse arrays that have not the shape of their batch."""
    shape = (len(batch), batch.ranges.shape[-1])
    columns = ("beams", "closure", "angle_min", "angle_increment")
    arrays: list[tuple[str, Any, tuple[int, ...]]] = [
        (name, getattr(batch, name), shape[:1]) for name in columns
    ]
    arrays += [(name, getattr(batch, name), shape) for name in ("ranges", "status", "intensities")]
    arrays += [("within", within, shape), ("sigma", sigma, shape[:1])]
    for name, values, expected in arrays:
        if values is not None and np.shape(values) != expected:
            raise ValueError(f"{name} of shape {np.shape(values)} in place of {expected}")


def _refuse(batch: SweepBatch, wrong: Any, words: str, values: NDArray[Any]) -> None:
    """`ValueError` with the value of the first sweep that is wrong."""
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(f"sweep {int(batch.sweep[row])} of {batch.topic}: {words.format(values[row])}")
