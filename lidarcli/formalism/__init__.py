"""The paper's definitions as pure functions on batches of sweeps: loops over one sweep after the other, no I/O.

Fagundes et al., *Analytical Formalism for Data Representation and Object Detection with 2D LiDAR*, Sensors 2024, 24,
2284. Each module holds one stage and names its definitions; docs/formalism.md maps symbols to functions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidarcli.formalism.detect import detect, difference, noise
from lidarcli.formalism.detection import SETS, SHAPES, VERTEX_KINDS, VISIBILITIES, Detection
from lidarcli.formalism.parameters import Parameters
from lidarcli.options.choices import PROFILES
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Float32, RawSweeps, SweepBatch

__all__ = [
    "PROFILES",
    "SETS",
    "SHAPES",
    "VERTEX_KINDS",
    "VISIBILITIES",
    "Detection",
    "Parameters",
    "detect",
    "difference",
    "noise",
    "sweep",
]


def sweep(
    ranges: Sequence[float] | Sequence[Sequence[float]] | Float32,
    *,
    angle_min: float = -np.pi,
    angle_increment: float,
    range_min: float = 0.0,
    range_max: float = np.inf,
) -> SweepBatch:
    """A batch from plain ranges, for trying the definitions by hand.

    Parameters
    ----------
    ranges : (B,) one sweep or (S, B) sweeps [m]; inf, NaN, 0 … are beams without a range (`range_rules.normalise`)
    angle_min, angle_increment : bearing of the first beam, and from beam to beam [rad]
    range_min, range_max : limits [m]

    Returns
    -------
    SweepBatch

    Raises
    ------
    ValueError
        `angle_min` or `angle_increment` is NaN or infinite.
    """
    table = np.atleast_2d(np.asarray(ranges, np.float32))
    rows, width = table.shape
    stamps = np.zeros(rows, np.int64)
    raw = RawSweeps(
        topic="/scan",
        frame_ids=("",),
        frame=np.zeros(rows, np.int32),
        stamp_ns=stamps,
        record_ns=stamps,
        angle_min=np.full(rows, float(angle_min)),
        angle_increment=np.full(rows, float(angle_increment)),
        range_min=np.full(rows, range_min, np.float32),
        range_max=np.full(rows, range_max, np.float32),
        beams=np.full(rows, width, np.int32),
        ranges=table,
    )
    if not (np.isfinite(angle_min) and np.isfinite(angle_increment)):
        raise ValueError(f"angle_min {angle_min} or angle_increment {angle_increment} is not a finite angle")
    return normalise(raw, np.arange(rows), RangeRules())
