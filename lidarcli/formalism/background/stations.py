"""§3: "a map linking each LASER sweep to a certain position": the places where sweeps were taken."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps import TURN, Bool, Float64, Int64, SweepPoses, record

STILL, STILL_ANGLE = 1e-3, 1e-4
"""[m], [rad] A smaller shift is none: the sensor is parked."""


def joined(parts: list[SweepPoses]) -> SweepPoses:
    """Poses one after the other."""
    return SweepPoses(
        np.concatenate([part.x for part in parts]),
        np.concatenate([part.y for part in parts]),
        np.concatenate([part.yaw for part in parts]),
        np.concatenate([part.upside_down for part in parts]),
    )


NOWHERE = SweepPoses(np.empty(0), np.empty(0), np.empty(0), np.empty(0, bool))
"""No place at all."""
UNKNOWN = SweepPoses(np.full(1, np.nan), np.full(1, np.nan), np.full(1, np.nan), np.zeros(1, bool))
"""One place that nobody knows."""


@record
class Shift:
    """Pose of the sensor of S sweeps in the sensor frame of a station each."""

    x: Float64
    y: Float64
    yaw: Float64
    """(S,) by how much the sensor is turned counter-clockwise, as its own bearings count [rad]."""
    way: Float64 | None = None
    """(S, 3) how far it goes during the sweep: ahead, to the left [m], turned [rad]; None: sweeps take no time."""

    @property
    def none(self) -> Bool:
        """(S,) sensors that are where the station is, and stay there."""
        still: Bool = (np.hypot(self.x, self.y) <= STILL) & (np.abs(self.yaw) <= STILL_ANGLE)
        if self.way is not None:
            still &= (np.hypot(self.way[:, 0], self.way[:, 1]) <= STILL) & (
                np.abs(self.way[:, 2]) <= STILL_ANGLE
            )
        return still

    def rows(self, index: Int64) -> Shift:
        """The shifts of `index`."""
        return Shift(
            self.x[index], self.y[index], self.yaw[index], None if self.way is None else self.way[index]
        )

    def during(self, share: Float64) -> tuple[Float64, Float64, Float64]:
        """(S, B) ahead, left [m], turned [rad]: where the sensor is at shares (S, B) of its sweep."""
        if self.way is None:
            nowhere = np.zeros((len(self.x), 1))
            return nowhere, nowhere, nowhere
        ahead, left, turned = (self.way[:, axis, None] * share for axis in range(3))
        return ahead, left, turned


def shift(poses: SweepPoses, places: SweepPoses) -> Shift:
    """Poses (S,) as seen from a place each (S,); no shift where one of the two is not known."""
    dx, dy = poses.x - places.x, poses.y - places.y
    side = np.where(places.upside_down, -1.0, 1.0)
    cos, sin = np.cos(places.yaw), np.sin(places.yaw)
    turn = side * (poses.yaw - places.yaw)
    yaw = (turn + np.pi) % TURN - np.pi
    parts = cos * dx + sin * dy, side * (cos * dy - sin * dx), yaw
    x, y, yaw = (np.nan_to_num(part, nan=0.0) for part in parts)
    return Shift(x, y, yaw, poses.own_way())


def nearest(poses: SweepPoses, places: SweepPoses, distance: float, angle: float) -> tuple[Int64, Float64]:
    """The place of each sweep within tolerance.

    Parameters
    ----------
    poses : of S sweeps
    places : K stations, all with a pose
    distance, angle : tolerance in position [m] and heading [rad]

    Returns
    -------
    station : (S,) the nearest, both measured in units of their tolerance; -1 where none is within it
    away : (S,) distance of the nearest position, whatever its heading [m]; inf without stations or pose
    """
    if not len(places.x):
        return np.full(len(poses.x), -1), np.full(len(poses.x), np.inf)
    cost, apart = _cost(poses, places, distance, angle)
    station = np.argmin(cost, axis=1)
    within = cost[np.arange(len(station)), station] < np.inf
    return np.where(within, station, -1), np.where(np.isnan(poses.x), np.inf, apart.min(axis=1))


def _cost(poses: SweepPoses, places: SweepPoses, distance: float, angle: float) -> tuple[Float64, Float64]:
    """(S, K) how far each pose is from each place in units of the tolerance, inf beyond it; the distance [m]."""
    apart = np.hypot(poses.x[:, None] - places.x, poses.y[:, None] - places.y)
    turn = np.abs((poses.yaw[:, None] - places.yaw + np.pi) % TURN - np.pi)
    with np.errstate(invalid="ignore"):
        within = (apart <= distance) & (turn <= angle)
        within &= poses.upside_down[:, None] == places.upside_down
    cost = np.where(within, np.square(apart / distance) + np.square(turn / angle), np.inf)
    return cost, np.where(np.isnan(apart), np.inf, apart)


def gather(
    poses: SweepPoses, places: SweepPoses, distance: float, angle: float, most: int
) -> tuple[Int64, SweepPoses]:
    """Send each sweep to the nearest station; a sweep out of reach of all opens a new one at its own pose.

    What a sweep opens serves all later ones, so the result does not depend on how sweeps come in batches.

    Parameters
    ----------
    poses : of S sweeps in order
    places : K stations that are there already
    distance, angle : reach of a station in position [m] and heading [rad]
    most : greatest number of stations

    Returns
    -------
    station : (S,) index; -1 without a pose, or where a further station would be too many
    places : the stations, the new ones after the others
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
        cost = _cost(poses.rows(slice(first, None)), poses.rows(slice(first, first + 1)), distance, angle)[0][
            :, 0
        ]
        closer = first + np.flatnonzero(cost < best[first:])
        station[closer] = known + len(opened)
        best[closer] = cost[closer - first]
        opened.append(first)
    return station, joined([places, poses.rows(np.array(opened, np.int64))])
