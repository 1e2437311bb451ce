"""How well boxes fit: the share of a box that beams have passed through, and boxes longer than an object may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism import Detection
from lidarcli.sweeps.types import TURN, Closure, Float64, SweepBatch

GRID = 10
"""Places along each side of a box that are asked."""
PAST = 0.03
"""[m] A beam has passed a place if it goes on for more than this and three times the noise."""
TOO_MUCH = 1.0 / 3.0
"""Share of a box that is too much of it."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """They add up."""

    boxes: int = 0
    crossed: int = 0
    """Boxes more than a third of which was passed through."""
    too_long: int = 0
    """Boxes longer than the limit."""

    def __add__(self, other: Boxes) -> Boxes:
        return Boxes(self.boxes + other.boxes, self.crossed + other.crossed, self.too_long + other.too_long)


def crossed_share(batch: SweepBatch, found: Detection) -> Float64:
    """(K,) the share of each box that beams passed through."""
    step = (np.arange(GRID) + 0.5) / GRID - 0.5
    u, v = (each.ravel() for each in np.meshgrid(step, step))
    cos, sin = np.cos(found.box_yaw)[:, None], np.sin(found.box_yaw)[:, None]
    along, across = found.box_length[:, None] * u, found.box_width[:, None] * v
    x = found.box_x[:, None] + cos * along - sin * across
    y = found.box_y[:, None] + sin * along + cos * across
    row = found.row[:, None]
    beam, inside = _beam_at(batch, row, np.arctan2(y, x))
    reach = batch.ranges[row, beam].astype(float)
    with np.errstate(invalid="ignore"):
        passed = inside & (reach > np.hypot(x, y) + PAST + 3.0 * found.noise[row])
    share: Float64 = passed.mean(axis=1)
    return share


def _beam_at(batch: SweepBatch, row: NDArray[np.int64], bearing: Float64) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The beam nearest to a bearing, and whether there is one."""
    increment, first = batch.angle_increment[row], batch.angle_min[row]
    turned = (bearing - first) / increment
    period = TURN / np.abs(increment)
    turned = np.mod(turned + 0.5, period) - 0.5
    beam = np.rint(turned).astype(np.int64)
    count = batch.beams[row]
    closed = batch.closure[row] != Closure.OPEN
    inside = (beam >= 0) & (beam < count)
    beam = np.where(closed & (beam >= count), 0, beam)
    return np.clip(beam, 0, count - 1), inside | closed


def measure(batch: SweepBatch, found: Detection, limit: float) -> Boxes:
    """Of the boxes of a batch; none should be longer than the limit [m]."""
    share = crossed_share(batch, found)
    return Boxes(len(found), int(np.sum(share > TOO_MUCH)), int(np.sum(found.box_length > limit + 1e-6)))
