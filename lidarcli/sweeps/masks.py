"""Masks of the robot's own body: the ranges that lie under them are left out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import OptionError
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, RawSweeps, SweepBatch
from lidarcli.system.records import dataclass

CLOSE = 1e-9
"""Rounding of a bearing [rad]."""
_TOGETHER = 1 << 14
"""Bearings that are looked at together: a polygon takes memory for each of them and each of its corners."""


class Rays(NamedTuple):
    """The beams of G sweeps in the frame of a mask."""

    x: float
    y: float
    """Ranges at which they begin [m]."""
    bearing: Float64
    """(G, B) in the frame of the sensor [rad]."""
    cos: Float64
    sin: Float64
    """(G, B) their directions in the frame of the mask."""


Span = tuple[Float64, Float64]
"""(G, B) each: where one stretch of each beam begins and ends [m]; it begins behind its end where there is none."""


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc with its edge [m]."""

    x: float
    y: float
    radius: float

    def spans(self, rays: Rays) -> Iterator[Span]:
        """Yield the stretch of each beam in the disc."""
        x, y = self.x - rays.x, self.y - rays.y
        middle = x * rays.cos + y * rays.sin
        half = self.radius**2 - (x**2 + y**2 - middle**2)
        half = np.where(half >= 0.0, np.sqrt(np.maximum(half, 0.0)), -np.inf)
        yield middle - half, middle + half


@dataclass(frozen=True, slots=True)
class Polygon:
    """An area by its corners [m]; of one that crosses itself, what is inside by the even-odd rule."""

    corners: tuple[tuple[float, float], ...]

    def spans(self, rays: Rays) -> Iterator[Span]:
        """Yield the stretches of each beam in the area, the nearest first."""
        corners = np.array(self.corners) - (rays.x, rays.y)
        # How far each corner lies to the left of each beam, and how far along it.
        left = corners[:, 1] * rays.cos[..., None] - corners[:, 0] * rays.sin[..., None]
        along = corners[:, 0] * rays.cos[..., None] + corners[:, 1] * rays.sin[..., None]
        next_left, next_along = np.roll(left, -1, axis=-1), np.roll(along, -1, axis=-1)
        crossed = (left > 0.0) != (next_left > 0.0)
        share = left / np.where(crossed, left - next_left, 1.0)
        # An even number of edges is crossed; the others stand behind them.
        at = np.sort(np.where(crossed, along + share * (next_along - along), np.inf), axis=-1)
        for k in range(0, len(corners) - 1, 2):
            yield at[..., k], np.where(np.isinf(at[..., k]), -np.inf, at[..., k + 1])


@dataclass(frozen=True, slots=True)
class Sector:
    """The beams whose bearings lie between two [rad], counted against the clock, from one range to another [m]."""

    begin: float
    end: float
    nearest: float
    farthest: float

    def spans(self, rays: Rays) -> Iterator[Span]:
        """Yield the stretch of each beam in the sector."""
        width = self.end - self.begin if 0.0 <= self.end - self.begin <= TURN else (self.end - self.begin) % TURN
        within = (rays.bearing - self.begin + CLOSE) % TURN <= width + 2 * CLOSE
        yield np.where(within, self.nearest, np.inf), np.where(within, self.farthest, -np.inf)


Shape = Circle | Polygon | Sector


@dataclass(frozen=True, slots=True)
class Mask:
    """An area in which there is nothing but the robot itself."""

    shape: Shape
    topic: str = ""
    """The only topic that it is for; empty for all."""
    frame: str = ""
    """The frame of its coordinates; empty for that of each sensor."""


@dataclass(frozen=True, slots=True)
class Mount:
    """Place of a frame, as seen from above, in the one that carries it."""

    frame: str
    parent: str
    x: float
    y: float
    """[m]"""
    yaw: float
    """[rad]"""
    upside_down: bool = False


@dataclass(frozen=True, slots=True)
class Masks:
    """The masks of a log, and where its sensors are mounted. A leading slash of a name does not matter."""

    masks: tuple[Mask, ...] = ()
    mounts: tuple[Mount, ...] = ()
    """Of several for one frame the first counts, before it one that leads straight to the frame of a mask."""
    path: str = ""
    """File that they were read from, if any."""
    learn: bool = False
    """True as long as they are to be learned from the log (`pipeline.reading.masking`)."""

    def under(self, raw: RawSweeps | SweepBatch, ranges: Float32) -> Bool:
        """Return which ranges (S, B), NaN where there is none, are under a mask.

        Raises
        ------
        OptionError
            Nothing tells where a sensor is in the frame of a mask.
        """
        masked = np.zeros(ranges.shape, np.bool_)
        masks = self._of_topic(raw.topic)
        for code in np.flatnonzero(np.bincount(raw.frame)).tolist() if masks else ():
            rows = np.flatnonzero(raw.frame == code)
            # Most sweeps of a sensor have one geometry.
            geometry = np.column_stack([raw.angle_min[rows], raw.angle_increment[rows]])
            geometry, which = np.unique(geometry, axis=0, return_inverse=True)
            which, some = which.reshape(-1), max(_TOGETHER // max(ranges.shape[1], 1), 1)
            for first in range(0, len(geometry), some):
                angle_min, increment = geometry[first : first + some].T
                bearing = angle_min[:, None] + increment[:, None] * np.arange(ranges.shape[1])
                mine = np.flatnonzero((which >= first) & (which < first + some))
                rays: dict[str, Rays] = {}
                for mask in masks:
                    if mask.frame not in rays:
                        rays[mask.frame] = self._rays(mask.frame, raw.frame_ids[code], bearing)
                    for least, most in mask.shape.spans(rays[mask.frame]):
                        _mark(masked, ranges, rows[mine], which[mine] - first, (least, most))
        return masked

    def hide(self, batch: SweepBatch, bearing: Float64, distance: Float64, *, beyond: bool = False) -> Bool:
        """Return which places (S, P), by bearing [rad] and distance [m] from the sensors of sweeps, are under a mask.

        `beyond`: or behind one.
        """
        hidden = np.zeros(bearing.shape, np.bool_)
        masks = self._of_topic(batch.topic)
        for frame, rows, _ in batch.by_frame() if masks else ():
            for some in np.array_split(rows, -(-bearing[rows].size // _TOGETHER)):
                for mask in masks:
                    for least, most in mask.shape.spans(self._rays(mask.frame, frame, bearing[some])):
                        hidden[some] |= (
                            (least <= distance[some]) & (distance[some] <= (np.inf if beyond else most)) & (least <= most)
                        )
        return hidden

    def _of_topic(self, topic: str) -> list[Mask]:
        return [mask for mask in self.masks if not mask.topic or same_name(mask.topic, topic)]

    def _rays(self, frame: str, sensor: str, bearing: Float64) -> Rays:
        """Return the beams of a sensor in a frame."""
        here = mounted(self.mounts, sensor, frame)
        if here is None:
            raise OptionError(
                f"--mask: nothing leads from frame {sensor or 'without a name'} to {frame}: add a [[mount]], or the "
                "'topic' that the [[mask]] is for"
            )
        direction = here.yaw + (-1.0 if here.upside_down else 1.0) * bearing
        return Rays(here.x, here.y, bearing, np.cos(direction), np.sin(direction))


def _mark(masked: Bool, ranges: Float32, rows: NDArray[np.intp], which: NDArray[np.intp], span: Span) -> None:
    """Mark the ranges of rows (K,) that lie within a stretch of the beams of their geometries (K,)."""
    columns = np.flatnonzero((span[0] <= span[1]).any(axis=0))
    if not len(columns):
        return
    # Ranges are float32: the edge of a circle of 0.3 m is where they say 0.3.
    low, high = (edge[:, columns].astype(np.float32) for edge in span)
    if len(low) > 1:
        low, high = low[which], high[which]
    here = np.ix_(rows, columns)
    values = ranges[here]
    with np.errstate(invalid="ignore"):
        masked[here] |= (values >= low) & (values <= high)


def mounted(mounts: Sequence[Mount], sensor: str, frame: str) -> Mount | None:
    """Return where a sensor is in a frame, by one mount or several in turn; None where nothing leads there.

    An empty name stands for the frame of the sensor itself.
    """
    x, y, turned, side = 0.0, 0.0, 0.0, 1.0
    here, left = sensor, len(mounts)
    while frame and not same_name(here, frame):
        known = [each for each in mounts if same_name(each.frame, here)]
        straight = [each for each in known if same_name(each.parent, frame)]
        mount = next(iter(straight + known), None)
        if mount is None or not left:
            return None
        cos, sin = math.cos(mount.yaw), math.sin(mount.yaw)
        flip = -1.0 if mount.upside_down else 1.0
        x, y = mount.x + cos * x - flip * sin * y, mount.y + sin * x + flip * cos * y
        turned, side = mount.yaw + flip * turned, flip * side
        here, left = mount.parent, left - 1
    return Mount(sensor, frame, x, y, turned, side < 0.0)


def same_name(one: str, other: str) -> bool:
    """Return True for two names of topics or frames that differ by a leading slash at most."""
    return one.lstrip("/") == other.lstrip("/")
