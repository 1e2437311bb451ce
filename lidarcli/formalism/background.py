"""§3: r_e, the sweep of the scene without the objects of interest, at every place where it was taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.display.texts import Facts, counted, shown, span
from lidarcli.options.choices import STATION_ANGLE, STATION_DISTANCE
from lidarcli.sweeps.range_rules import NEAREST
from lidarcli.sweeps.types import TURN, Bool, Closure, Float32, Float64, Int32, Int64, SweepBatch, SweepPoses, record

# Stations, "a map linking each LASER sweep to a certain position". Sweeps with other bearings, or taken next to a station,
# are projected onto its bearings. Because odometry alone is not exact enough, they are first aligned with what it has
# observed.


@dataclass(frozen=True)
class AlignmentRules:
    """How sweeps are laid onto a background."""

    static_distance: float = 1e-3
    """[m] A sensor that moves by less is parked, ..."""
    static_angle: float = 1e-4
    """[rad] ... if it also turns by less."""
    line_window: float = 0.035
    """[rad] Half width of the windows in which lines are fitted, 2°: of wider ones fewer walls are straight."""
    straight_rms: float = 0.05
    """[m] Points with a greater rms from their line are not on one."""
    points: int = 180
    """Of a sweep with more points so many are aligned."""
    reaches: tuple[float, ...] = (0.4, 0.4, 0.3, 0.2, 0.15, 0.1, 0.1)
    """[m] Points further from their line are left out, round by round."""
    point_sd: float = 0.03
    """[m] Standard deviation of a point across its line."""
    place_sd: float = 0.1
    """[m] Standard deviation of the odometry: it decides where the lines do not, as along a corridor."""
    heading_sd: float = 0.05
    """[rad] Standard deviation of its heading."""


ALIGN = AlignmentRules()

SAME_BEAM = 0.05
"""Greatest difference between two bearings that are the same, as a share of a step."""


def joined(parts: list[SweepPoses]) -> SweepPoses:
    """Return the poses of several parts as one."""
    names = ("x", "y", "yaw", "upside_down")
    return SweepPoses(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


NO_PLACES = SweepPoses(np.empty(0), np.empty(0), np.empty(0), np.empty(0, bool))
"""Poses of no place."""
UNKNOWN_PLACE = SweepPoses(np.full(1, np.nan), np.full(1, np.nan), np.full(1, np.nan), np.zeros(1, bool))
"""Pose of one unknown place."""


@record
class Shift:
    """Pose of the sensor of S sweeps in the sensor frame of a station each."""

    x: Float64
    y: Float64
    yaw: Float64
    """(S,) turn of the sensor in the direction of its own bearings [rad]."""
    way: Float64 | None = None
    """(S, 3) way during the sweep: ahead, to the left [m], turned [rad]; None if sweeps take no time."""

    @property
    def none(self) -> Bool:
        """(S,) True for sensors that are static at their station."""
        still: Bool = (np.hypot(self.x, self.y) <= ALIGN.static_distance) & (np.abs(self.yaw) <= ALIGN.static_angle)
        if self.way is not None:
            still &= (np.hypot(self.way[:, 0], self.way[:, 1]) <= ALIGN.static_distance) & (
                np.abs(self.way[:, 2]) <= ALIGN.static_angle
            )
        return still

    def rows(self, index: Int64) -> Shift:
        """Return the shifts at `index`."""
        return Shift(self.x[index], self.y[index], self.yaw[index], None if self.way is None else self.way[index])

    def during(self, share: Float64) -> tuple[Float64, Float64, Float64]:
        """Return (S, B) the path ahead, left [m], turned [rad] of the sensor at shares (S, B) of its sweep."""
        if self.way is None:
            nowhere = np.zeros((len(self.x), 1))
            return nowhere, nowhere, nowhere
        ahead, left, turned = (self.way[:, axis, None] * share for axis in range(3))
        return ahead, left, turned


def shift(poses: SweepPoses, places: SweepPoses) -> Shift:
    """Return the poses (S,) as observed from a place each (S,); no shift where one of the two is unknown."""
    dx, dy = poses.x - places.x, poses.y - places.y
    side = np.where(places.upside_down, -1.0, 1.0)
    cos, sin = np.cos(places.yaw), np.sin(places.yaw)
    turn = side * (poses.yaw - places.yaw)
    yaw = (turn + np.pi) % TURN - np.pi
    parts = cos * dx + sin * dy, side * (cos * dy - sin * dx), yaw
    x, y, yaw = (np.nan_to_num(part, nan=0.0) for part in parts)
    return Shift(x, y, yaw, poses.own_way())


def nearest(poses: SweepPoses, places: SweepPoses, distance: float, angle: float) -> tuple[Int64, Float64]:
    """Return the nearest of K places, all with a pose, to each of S poses; distance [m] and angle [rad] are the tolerance.

    Both are measured in units of their tolerance: station (S,), -1 where none is within it, and away (S,), the distance of
    the nearest position [m], whatever its heading; inf without stations or pose.
    """
    if not len(places.x):
        return np.full(len(poses.x), -1), np.full(len(poses.x), np.inf)
    cost, apart = _cost(poses, places, distance, angle)
    station = np.argmin(cost, axis=1)
    within = cost[np.arange(len(station)), station] < np.inf
    return np.where(within, station, -1), np.where(np.isnan(poses.x), np.inf, apart.min(axis=1))


def _cost(poses: SweepPoses, places: SweepPoses, distance: float, angle: float) -> tuple[Float64, Float64]:
    """Return (S, K) the cost of each pose and place in units of the tolerance, inf beyond it, and their distance [m]."""
    apart = np.hypot(poses.x[:, None] - places.x, poses.y[:, None] - places.y)
    turn = np.abs((poses.yaw[:, None] - places.yaw + np.pi) % TURN - np.pi)
    with np.errstate(invalid="ignore"):
        within = (apart <= distance) & (turn <= angle)
        within &= poses.upside_down[:, None] == places.upside_down
    cost = np.where(within, np.square(apart / distance) + np.square(turn / angle), np.inf)
    return cost, np.where(np.isnan(apart), np.inf, apart)


def gather(poses: SweepPoses, places: SweepPoses, distance: float, angle: float, most: int) -> tuple[Int64, SweepPoses]:
    """Assign each sweep to the nearest station; a sweep out of reach of all opens a new one at its own pose.

    What a sweep opens serves all later ones, so the result does not depend on how sweeps come in batches. `places` are the
    stations so far; their reach is `distance` [m] and `angle` [rad], and there are `most` of them. Returned are the station
    of each sweep (S,), -1 without a pose, or where one more would be too many, and all stations, the new ones last.
    """
    count = len(poses.x)
    station = np.full(count, -1)
    best = np.full(count, np.inf)
    known = len(places.x)
    if known:
        cost, _ = _cost(poses, places, distance, angle)
        station = np.argmin(cost, axis=1)
        best = cost[np.arange(count), station]
        station[best == np.inf] = -1
    posed = ~np.isnan(poses.x)
    opened: list[int] = []
    while known + len(opened) < most:
        lost = np.flatnonzero(posed & (best == np.inf))
        if not len(lost):
            break
        first = int(lost[0])
        cost = _cost(poses.rows(slice(first, None)), poses.rows(slice(first, first + 1)), distance, angle)[0][:, 0]
        closer = first + np.flatnonzero(cost < best[first:])
        station[closer] = known + len(opened)
        best[closer] = cost[closer - first]
        opened.append(first)
    return station, joined([places, poses.rows(np.array(opened, np.int64))])


def beam_at(
    angle_min: float | Float64, angle_increment: float | Float64, beams: int | Int32, period: int | Int32, bearing: Float64
) -> Int32:
    """Return the beams of a geometry with the nearest bearings, -1 out of view; arrays of any shape.

    >>> beam_at(0.0, np.pi / 2, 4, 4, np.array([0.1, -0.1, 3 * np.pi])).tolist()
    [0, 0, 2]
    >>> beam_at(0.0, -0.1, 4, 0, np.array([-0.31, -0.4, 0.04, -0.1 + TURN])).tolist()
    [3, -1, 0, 1]
    """
    offset = (bearing - angle_min) / angle_increment
    turn = np.abs(TURN / angle_increment)
    # Half a step before the first beam still belongs to it.
    beam = np.rint(offset - turn * np.floor((offset + 0.5) / turn)).astype(np.int32)
    beyond = np.where(np.asarray(period) > 0, beam % np.maximum(period, 1), -1)
    limit = np.where(np.asarray(period) > 0, period, beams)
    return np.where(beam < limit, beam, beyond).astype(np.int32)


@record
class Grid:
    """Bearings of a background: those of its sweeps, or of the first of them."""

    angle_min: float
    angle_increment: float
    beams: int
    period: int
    """Number of distinct bearings of a full turn, 0 for a partial view."""

    @property
    def bearings(self) -> Float64:
        """Return (B,) the bearings [rad]."""
        return self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)

    def beam(self, bearing: Float64) -> Int32:
        """Return the beams with the nearest bearings, -1 out of view; arrays of any shape."""
        return beam_at(self.angle_min, self.angle_increment, self.beams, self.period, bearing)

    def fits(self, batch: SweepBatch) -> Bool:
        """Return (S,) True for sweeps with the same bearings, beam by beam."""
        first = batch.angle_min - self.angle_min
        last = first + (self.beams - 1) * (batch.angle_increment - self.angle_increment)
        slack = SAME_BEAM * abs(self.angle_increment)
        result: Bool = (batch.beams == self.beams) & (np.abs(first) < slack) & (np.abs(last) < slack)
        return result

    @staticmethod
    def of(batch: SweepBatch, row: int) -> Grid:
        """Return the bearings of a sweep."""
        beams, kind = int(batch.beams[row]), batch.closure[row]
        period = 0 if kind == Closure.OPEN else beams - int(kind == Closure.SHARED)
        return Grid(float(batch.angle_min[row]), float(batch.angle_increment[row]), beams, period)


def project(batch: SweepBatch, grid: Grid, moved: Shift | None) -> tuple[Int32, Float64]:
    """Project the ends of the beams of S sweeps onto the bearings of a station, from which the sensor has `moved` (S,).

    Returned are the beam of the station (S, B), -1 out of its view and for padding, and the distance from the station (S,
    B) [m], NaN without a range. A beam without a range keeps its direction.
    """
    bearing = batch.bearings
    ranges = batch.ranges.astype(np.float64)
    if moved is not None:
        valid = ~np.isnan(ranges)
        # From the pose of the sensor at each beam to that at the first beam, and from there to the station.
        ahead, left, turn = moved.during(batch.all_shares())
        own = bearing + turn
        x, y = ranges * np.cos(own) + ahead, ranges * np.sin(own) + left
        cos, sin = np.cos(moved.yaw)[:, None], np.sin(moved.yaw)[:, None]
        x, y = cos * x - sin * y + moved.x[:, None], sin * x + cos * y + moved.y[:, None]
        bearing = np.where(valid, np.arctan2(y, x), own + moved.yaw[:, None])
        ranges = np.hypot(x, y)
    beam = grid.beam(bearing)
    beam[np.arange(batch.width) >= batch.beams[:, None]] = -1
    return beam, ranges


def expected(batch: SweepBatch, grid: Grid, ranges: Float64, moved: Shift) -> Float64:
    """Return (S, B) the ranges [m] that sensors next to a station would see of the ranges (S, C) of the station.

    These are inf without a surface, NaN if unknown. Where several fall on one beam the nearest counts, NaN where none does.
    """
    bearing = np.broadcast_to(grid.bearings, ranges.shape)
    finite = np.isfinite(ranges)
    distance = np.where(finite, ranges, 0.0)
    x = distance * np.cos(bearing) - moved.x[:, None]
    y = distance * np.sin(bearing) - moved.y[:, None]
    turned = np.where(finite, np.arctan2(y, x), bearing) - moved.yaw[:, None]
    beam = _beam_of(batch, turned)
    if moved.way is not None:
        # The beam in that direction was taken later, from another place.
        ahead, left, turn = moved.during(batch.shares(np.arange(len(batch))[:, None], beam))
        cos, sin = np.cos(moved.yaw)[:, None], np.sin(moved.yaw)[:, None]
        x, y = cos * x + sin * y - ahead, cos * y - sin * x - left
        turned = np.where(finite, np.arctan2(y, x), bearing - moved.yaw[:, None]) - turn
        beam = np.where(beam < 0, -1, _beam_of(batch, turned))
    ranges_there = np.full((len(batch), batch.width), np.inf)
    known = np.zeros(ranges_there.shape, bool)
    row, column = np.nonzero((beam >= 0) & ~np.isnan(ranges))
    known[row, beam[row, column]] = True
    row, column = np.nonzero((beam >= 0) & finite)
    np.minimum.at(ranges_there, (row, beam[row, column]), np.maximum(np.hypot(x, y), NEAREST)[row, column])
    return np.where(known, ranges_there, np.nan)


def _beam_of(batch: SweepBatch, bearing: Float64) -> Int32:
    """Return (S, C) the beams of sweeps at bearings (S, C) of their own [rad], -1 for none."""
    bearings = batch.beams - (batch.closure == Closure.SHARED)
    return beam_at(
        batch.angle_min[:, None],
        batch.angle_increment[:, None],
        batch.beams[:, None],
        np.where(batch.closure == Closure.OPEN, 0, bearings)[:, None],
        bearing,
    )


@record
class SurfaceLines:
    """Straight surface at each beam of K stations, n · q = d, (K, B) each; NaN without one."""

    normal_x: Float64
    normal_y: Float64
    offset: Float64
    """d [m]"""


def lines(grid: Grid, ranges: Float64) -> SurfaceLines:
    """Fit a line to the neighbourhood of every beam, of ranges (K, B) [m] that are NaN or inf without a range.

    u = 1/r of a line is a sinusoid, nearly linear over a few degrees.
    """
    step = grid.angle_increment
    reach = max(2, round(ALIGN.line_window / abs(step)))
    known = np.isfinite(ranges) & (ranges > 0)
    u = 1.0 / np.where(known, ranges, 1.0)
    offset = np.arange(-reach, reach + 1)
    beam = np.arange(grid.beams)[:, None] + offset
    beam = beam % grid.period if grid.period else np.clip(beam, 0, grid.beams - 1)
    count = len(offset)
    mean, slope, square = (np.zeros_like(u) for _ in range(3))
    whole = np.ones(u.shape, bool)
    for column, k in enumerate(offset.tolist()):
        neighbour = u[:, beam[:, column]]
        mean += neighbour
        slope += k * neighbour
        square += neighbour * neighbour
        whole &= known[:, beam[:, column]]
    mean /= count
    moment = float(np.square(offset).sum())
    slope /= moment
    rms = np.sqrt(np.maximum(square / count - mean * mean - slope * slope * moment / count, 0.0))
    straight = whole & (rms < ALIGN.straight_rms * mean * mean)
    if not grid.period:
        straight[:, :reach] = False
        straight[:, grid.beams - reach :] = False
    tilt = slope / step
    direction = grid.bearings + np.arctan2(tilt, mean)
    return SurfaceLines(
        np.where(straight, np.cos(direction), np.nan),
        np.where(straight, np.sin(direction), np.nan),
        np.where(straight, 1.0 / np.hypot(mean, tilt), np.nan),
    )


def align(batch: SweepBatch, grid: Grid, known: SurfaceLines, station: Int64, start: Shift) -> Shift:
    """Return the shifts of the sensor from its stations (S,), by aligning each sweep with the lines `known` of its station.

    Points look for the line in their direction; their distances are made small by robust least squares. Where the lines
    leave a direction open, as in a corridor, `start`, the shifts by the poses, decides. People and new objects are too far
    from any line to count.
    """
    # The choice of columns does not depend on the widest sweep of the batch, so that sums do not either.
    column = np.arange(0, grid.beams, max(1, -(-grid.beams // ALIGN.points)))
    bearing = batch.angle_min[:, None] + batch.angle_increment[:, None] * column
    there = np.minimum(column, max(batch.width - 1, 0))
    ranges = batch.ranges[:, there].astype(np.float64)
    valid = ~np.isnan(ranges) & (column < batch.beams[:, None])
    ranges = np.where(valid, ranges, 0.0)
    ahead, left, turn = start.during(batch.shares(np.arange(len(batch))[:, None], column))
    x, y = ranges * np.cos(bearing + turn) + ahead, ranges * np.sin(bearing + turn) + left
    pose = np.stack([start.x, start.y, start.yaw], axis=1)
    guess = pose.copy()
    prior = np.diag(1.0 / np.square([ALIGN.place_sd, ALIGN.place_sd, ALIGN.heading_sd]))
    row = station[:, None]
    for reach in ALIGN.reaches:
        cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
        turned_x, turned_y = cos * x - sin * y, sin * x + cos * y
        at_x, at_y = turned_x + pose[:, :1], turned_y + pose[:, 1:2]
        beam = grid.beam(np.arctan2(at_y, at_x))
        normal_x, normal_y = known.normal_x[row, beam], known.normal_y[row, beam]
        away = normal_x * at_x + normal_y * at_y - known.offset[row, beam]
        with np.errstate(invalid="ignore"):
            near = valid & (beam >= 0) & (np.abs(away) < reach)
        away = np.where(near, away, 0.0)
        weight = np.where(near, np.square(1.0 - np.square(away / reach)), 0.0) / ALIGN.point_sd**2
        lever = np.where(near, normal_y * turned_x - normal_x * turned_y, 0.0)
        parts = (np.where(near, normal_x, 0.0), np.where(near, normal_y, 0.0), lever)
        weighted = [weight * part for part in parts]
        normal = np.empty((len(batch), 3, 3))
        for i in range(3):
            for j in range(i, 3):
                normal[:, i, j] = normal[:, j, i] = np.einsum("sm,sm->s", weighted[i], parts[j])
        right = np.stack([np.einsum("sm,sm->s", part, away) for part in weighted], axis=1)
        right += (pose - guess) @ prior
        pose = pose - np.linalg.solve(normal + prior, right[:, :, None])[:, :, 0]
    return Shift(pose[:, 0], pose[:, 1], pose[:, 2], start.way)


KNOWN_GAP = 0.05
"""Greatest share of sweeps without a return of a surface that returns nearly always."""

STEADY = 0.8
"""Share of the observations that back the background of a steady beam."""
MAX_UNSTEADY = 0.4
"""Greatest share of unsteady beams of a parked sensor. Among people it is up to 0.3; for a sensor that was static in two
places, a metre or five degrees apart, it is 0.5 and more."""
MAJORITY = 0.5
"""Share of the observations below which the support of a background is weak."""

LATERAL = 0.05
"""[m] Distance by which a surface may look wider from next to a station."""


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
            ("view", span(np.degrees(self.grid.bearings).tolist(), ".2f", "deg")),
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
        return bool(lost > MAX_UNSTEADY * np.count_nonzero(returning))


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
