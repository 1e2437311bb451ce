"""§3: r_e, the sweep of the scene without the objects of interest, at every place where it was taken."""

from __future__ import annotations

import numpy as np

from lidarcli.choices import STATION_ANGLE, STATION_DISTANCE
from lidarcli.display import Facts, counted, shown, span
from lidarcli.formalism.background.stations import Grid
from lidarcli.sweeps import Bool, Float32, Float64, Int64, SweepBatch, SweepPoses, record

KNOWN_GAP = 0.05
"""Greatest share of sweeps without a return of a surface that returns nearly always."""

STEADY = 0.8
"""Share of the observations that back the background of a steady beam."""
MOST_UNSTEADY = 0.4
"""Greatest share of unsteady beams of a parked sensor. Among people it is up to 0.3; for a sensor that stood in two
places, a metre or five degrees apart, it is 0.5 and more."""
MAJORITY = 0.5
"""Share of the observations below which the support of a background is weak."""

LATERAL = 0.05
"""[m] Distance by which a surface may look wider from beside a station."""


@shown
@record
class Background:
    """Background of one sensor, the scene without the objects of interest: K stations of B beams each.

    A station is a place and heading of the sensor. A sensor of which no pose is known has one, whose pose is NaN.

    Attributes
    ----------
    topic, frame_id : names of the sensor
    grid : the bearings of its beams
    range_max : greatest range of the sensor [m]; inf where unknown
    r_e : (K, B) r_e [m]; inf where the beam is open, as nothing returns; NaN where it is unknown
    r_near : (K, B) nearest surface with enough support for r_e [m]; another than r_e at some depth edges
    spread : (K, B) robust standard deviation of the ranges that back r_e [m]; NaN where r_e is no range
    support : (K, B) share of the observations that back r_e; 0 where it is unknown
    no_return : (K, B) share of the observations without a return
    sweeps : (K,) sweeps of each station
    poses : (K,) places in the world frame, NaN where none is known
    distance : greatest distance of a sweep from its station [m]
    angle : greatest difference between their headings [rad]
    """

    topic: str
    frame_id: str
    grid: Grid
    range_max: float
    r_e: Float64
    r_near: Float64
    spread: Float64
    support: Float64
    no_return: Float64
    sweeps: Int64
    poses: SweepPoses
    distance: float = STATION_DISTANCE
    angle: float = STATION_ANGLE

    def __len__(self) -> int:
        return len(self.sweeps)

    def facts(self) -> Facts:
        """Return a summary for printing."""
        surfaces = self.r_e[np.isfinite(self.r_e)]
        support = self.support[np.isfinite(self.r_e)]
        unknown = int(np.count_nonzero(np.isnan(self.r_e)))
        rows = (
            ("topic", self.topic),
            ("frame", self.frame_id or "without a name"),
            ("view", span(np.degrees(self.grid.bearings()).tolist(), ".2f", "deg")),
            ("sweeps", f"{self.sweeps.sum():,}"),
            ("stations", f"{len(self):,}, the poses of {np.count_nonzero(self.posed):,} are known"),
            ("r_e", span(surfaces.tolist(), ".3f", "m")),
            ("support", f"{np.median(support):.1%} of the sweeps (median)" if len(support) else "none"),
            ("open", counted(int(np.count_nonzero(np.isinf(self.r_e))), "beam")),
            ("unknown", counted(unknown, "beam")),
        )
        return Facts(f"of {self.topic}: {counted(len(self), 'station')} x {counted(self.grid.beams, 'beam')}", rows)

    @property
    def posed(self) -> Bool:
        """(K,) True for stations with a pose."""
        return ~np.isnan(self.poses.x)

    @property
    def weak(self) -> Bool:
        """(K, B) True for beams whose background, a surface or no return, most observations do not back."""
        return ~np.isnan(self.r_e) & (self.support < MAJORITY)

    @property
    def seems_moved(self) -> bool:
        """True if the sensor seems to have moved without poses, or to have stood in two places.

        Then many beams that return do not see their background in most sweeps. People hide only a part of the scene, and
        foliage and depth edges are few, but a sensor that moves finds no range again.
        """
        returning = ~np.isnan(self.r_e) & (self.no_return < MAJORITY) & ~self.posed[:, None]
        lost = np.count_nonzero(returning & (self.support < STEADY))
        return bool(lost > MOST_UNSTEADY * np.count_nonzero(returning))


@record
class Surroundings:
    """Background of each beam together with its neighbours, (K, B) each, because depth edges jitter by a beam."""

    r_e: Float32
    """r_e of the beam itself [m]."""
    r_near: Float32
    """Nearest surface of the beam itself [m]."""
    near: Float32
    """Nearest r_e [m], the greatest range of the sensor for an open beam; NaN where the beam itself is unknown."""
    nearest: Float32
    """Nearest of the nearest surfaces [m], also of those up to `LATERAL` to either side; NaN where the beam is unknown."""
    far: Float32
    """Farthest r_e [m]; inf with an open beam."""
    spread: Float32
    """Greatest spread [m]."""
    returns: Bool
    """True where all of them return nearly always."""


def greatest_range(batch: SweepBatch) -> Float32:
    """Return (S,) the greatest range of each sweep [m]; inf where the driver writes no valid limit."""
    limit = batch.range_max
    with np.errstate(invalid="ignore"):
        return np.where(limit > np.maximum(batch.range_min, 0), limit, np.inf).astype(np.float32)


def surroundings(background: Background, reach: int) -> Surroundings:
    """Return the background in windows of `reach` beams to either side of each beam."""
    r_e = background.r_e
    known = ~np.isnan(r_e)
    limit = background.range_max
    near = np.where(known, np.minimum(r_e, limit), np.inf)
    nearest = np.where(known, np.minimum(background.r_near, limit), np.inf)
    far = np.where(known, r_e, -np.inf)
    spread = np.where(known & np.isfinite(r_e), background.spread, 0.0)
    lost = background.no_return > KNOWN_GAP
    windows = [_beside(background, offset) for offset in range(-reach, reach + 1)]
    near = np.minimum.reduce([near[:, beam] for beam in windows])
    nearest = _dilated(background, nearest, reach)
    far = np.maximum.reduce([far[:, beam] for beam in windows])
    return Surroundings(
        r_e=r_e.astype(np.float32),
        r_near=background.r_near.astype(np.float32),
        near=np.where(known, near, np.nan).astype(np.float32),
        nearest=np.where(known, nearest, np.nan).astype(np.float32),
        far=np.where(known, far, np.nan).astype(np.float32),
        spread=np.maximum.reduce([spread[:, beam] for beam in windows]).astype(np.float32),
        returns=known & ~np.logical_or.reduce([lost[:, beam] for beam in windows]),
    )


def _dilated(background: Background, ranges: Float64, reach: int) -> Float64:
    """Return the nearest surface within `reach` beams or `LATERAL` of each beam [m]."""
    result = ranges.copy()
    step = abs(background.grid.angle_increment)
    known = ranges[np.isfinite(ranges)]
    if not len(known):
        return result
    most = min(max(reach, int(LATERAL / (step * float(known.min())))), background.grid.beams // 2)
    for distance in range(1, most + 1):
        close = np.where((distance * step * ranges <= LATERAL) | (distance <= reach), ranges, np.inf)
        for offset in (-distance, distance):
            np.minimum(result, close[:, _beside(background, offset)], out=result)
    return result


def _beside(background: Background, offset: int) -> Int64:
    """Return (B,) the beam so many beams further on, or the last one at the edge of the view."""
    grid = background.grid
    beam = np.arange(grid.beams) + offset
    return beam % grid.period if grid.period else np.clip(beam, 0, grid.beams - 1)
