"""The log of sightings: which body was seen when, and what its sides were; kept until their windows are settled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli import native
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.sides import Sides

INTEGERS = ("number", "sweep", "object", "centred")
NUMBERS = ("time", "x", "y", "cos", "sin", "half_1", "half_2", "odds")
SIDES = ("z", "var")


class Sightings:
    """`count` sightings in the order of the log, in arrays of which `attach` tells."""

    def __init__(self) -> None:
        self.count = 0
        self.room = 0

    def attach(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Write to these arrays from now on, which are to be kept as long."""
        self.room = len(arrays["number"])
        self.number = native.at_longs(arrays["number"])
        """The number of the body."""
        self.sweep = native.at_longs(arrays["sweep"])
        """Sweeps of the topic before."""
        self.object = native.at_longs(arrays["object"])
        """Its object, counted from the first that was ever found."""
        self.centred = native.at_longs(arrays["centred"])
        """Whether z[0] and z[2] are its centre rather than sides."""
        self.time = native.at_doubles(arrays["time"])
        self.x = native.at_doubles(arrays["x"])
        self.y = native.at_doubles(arrays["y"])
        """The estimate of its centre then [m]."""
        self.cos = native.at_doubles(arrays["cos"])
        self.sin = native.at_doubles(arrays["sin"])
        """Its axes."""
        self.half_1 = native.at_doubles(arrays["half_1"])
        self.half_2 = native.at_doubles(arrays["half_2"])
        self.odds = native.at_doubles(arrays["odds"])
        """Log-odds of being a thing, by this sweep alone."""
        self.z = native.at_doubles(arrays["z"])
        self.var = native.at_doubles(arrays["var"])
        """(N, 4) the sides and their variances, see `Sides`."""


def room(count: int) -> dict[str, NDArray[Any]]:
    """Arrays for so many sightings."""
    arrays: dict[str, NDArray[Any]] = {name: np.zeros(count, np.int64) for name in INTEGERS}
    arrays |= {name: np.zeros(count) for name in NUMBERS}
    return arrays | {name: np.zeros((count, 4)) for name in SIDES}


def note(
    log: Sightings, bodies: Bodies, b: int, sides: Sides, sweep: int, time: float, at: int, odds: float
) -> None:
    """Write a sighting of a body; there is room."""
    i = log.count
    log.odds[i] = odds
    log.number[i], log.sweep[i], log.object[i], log.time[i] = bodies.number[b], sweep, at, time
    along, across = bodies.c[2 * b], bodies.c[2 * b + 1]
    log.x[i] = bodies.cos[b] * along - bodies.sin[b] * across
    log.y[i] = bodies.sin[b] * along + bodies.cos[b] * across
    log.cos[i], log.sin[i] = bodies.cos[b], bodies.sin[b]
    log.half_1[i], log.half_2[i] = bodies.h[2 * b], bodies.h[2 * b + 1]
    log.centred[i] = 1 if sides.by_centre else 0
    for side in range(4):
        log.z[4 * i + side], log.var[4 * i + side] = sides.z[side], sides.var[side]
    log.count += 1
