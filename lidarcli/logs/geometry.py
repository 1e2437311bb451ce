"""The bearings of sweeps as text logs and options tell them."""

from __future__ import annotations

import numpy as np

from lidarcli.logs.base import OpenOptions
from lidarcli.logs.blocks import given_geometries
from lidarcli.sweeps import Float64, Int64

TELL_BEARINGS = "(tell --angle-min and --angle-increment, or --fov)"
"""The way out where a log does not tell bearings."""


def tells_geometry(options: OpenOptions) -> bool:
    """Whether options tell the whole geometry."""
    return options.fov is not None or (options.angle_min is not None and options.angle_increment is not None)


def as_told(options: OpenOptions, first: Float64, step: Float64, beams: Int64) -> tuple[Float64, Float64]:
    """What options tell in the place of the first bearings and steps [rad] that a log tells (S,)."""
    if tells_geometry(options):
        first, step = given_geometries(options, beams)
    if options.angle_increment is not None:
        step = np.full(len(beams), options.angle_increment)
    if options.angle_min is not None:
        first = np.full(len(beams), options.angle_min)
    return first, step


def full_steps(view: Float64, resolution: Float64, beams: Int64, rounded: float) -> Float64:
    """Steps [rad] with all the digits that a line lets know: where a step is rounded, the view says more.

    Where the view is that of the ranges, or of one more, its part for each beam is taken; else the step as it is told.
    `rounded`: by how much the last decimal of a step may be off [rad].
    """
    gaps = np.maximum(beams - 1, 1)
    steps = np.where(resolution == 0.0, view / gaps, resolution)
    parts = np.stack([view / gaps, view / np.maximum(beams, 1)])
    off = np.abs(parts - resolution)
    nearest = np.take_along_axis(parts, np.argmin(off, axis=0)[None], axis=0)[0]
    return np.where(off.min(axis=0) < rounded, nearest, steps)
