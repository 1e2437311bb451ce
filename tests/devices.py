"""Sweeps of a room, as drivers send them by their sources (docs/devices.md).

The room has four walls, a post, and an opening in which nothing is. Messages are made as the source of a driver makes
them from what its sensor would tell: order of the beams, value for no return, limits, times, intensities.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Geometry = tuple[float, ...]
"""angle_min, angle_max, angle_increment, time_increment, scan_time, range_min, range_max."""

INF, NAN, TURN = float("inf"), float("nan"), 2 * np.pi
POST, RADIUS = (2.2, 0.5), 0.2
WALLS = (-4.0, 5.0, -3.0, 3.5)
"""Least and greatest x and y of the room [m]."""
OPEN = (-1.0, -0.3)
"""Bearings between which there is nothing [rad]."""
DRIFT = np.radians(0.05)
"""From turn to turn the room goes left, so that its post is seen by beams that lie otherwise [rad]."""
WALL, BRIGHT = 15.0, 40.0
"""Intensities of the walls, and of the post."""


def see(bearings: Any, turn: int) -> Floats:
    """(B,) ranges of a turn by their bearings [rad], with noise of 5 mm, +inf in the opening."""
    theta = (np.asarray(bearings, float) - turn * DRIFT + np.pi + 1e-9) % TURN - np.pi
    noise = np.random.default_rng(turn).normal(0.0, 0.005, theta.shape)
    along, across = np.cos(theta), np.sin(theta)
    with np.errstate(divide="ignore"):
        walls = np.minimum(
            np.where(along > 0, WALLS[1], WALLS[0]) / along, np.where(across > 0, WALLS[3], WALLS[2]) / across
        )
    ahead = POST[0] * along + POST[1] * across
    off = RADIUS**2 - (POST[0] * across - POST[1] * along) ** 2
    on_post = (ahead > 0) & (off > 0)
    ranges = np.where(on_post, ahead - np.sqrt(np.maximum(off, 0.0)), walls) + noise
    ranges[(theta > OPEN[0]) & (theta < OPEN[1])] = INF
    return ranges


def strength(ranges: Floats, none: float = 0.0) -> Floats:
    """(B,) intensities of such ranges; `none` without a return."""
    return np.where(np.isfinite(ranges), np.where(ranges < 2.6, BRIGHT, WALL), none)


class Sent(NamedTuple):
    """A message of a driver."""

    geometry: Geometry
    ranges: Any
    intensities: Any = ()
    echoes: list[list[float]] | None = None
    strengths: list[list[float]] | None = None
    after: float = 0.0
    """Time from the begin of the turn [s]."""


def even(degrees: tuple[float, float], beams: int) -> Floats:
    """(B,) bearings [rad] from the first to the last [degrees]."""
    return np.radians(np.linspace(*degrees, beams))


def over(theta: Floats, times: tuple[float, float], limits: tuple[float, float], *rest: Any, **more: Any) -> Sent:
    """A message whose bearings are these (B,), with time_increment, scan_time and limits."""
    return Sent((theta[0], theta[-1], (theta[-1] - theta[0]) / (len(theta) - 1), *times, *limits), *rest, **more)


def urg_node(turn: int) -> list[Sent]:
    theta = even((-135.0, 135.0), 1081)
    seen = see(theta, turn)
    ranges = np.where(np.isinf(seen), NAN, seen)
    return [over(theta, (0.75 * 0.025 / 1080, 0.025), (0.02, 30.0), ranges, strength(seen))]


def multi_echo(turn: int) -> list[Sent]:
    theta = even((-135.0, 135.0), 1081)
    echoes = [[r, r + 0.5] if r < INF else [] for r in see(theta, turn).tolist()]
    strengths = [[20.0, 30.0] if echo else [] for echo in echoes]
    return [over(theta, (0.75 * 0.025 / 1080, 0.025), (0.02, 30.0), [], (), echoes, strengths)]


def rplidar(turn: int, per_degree: float, least: float, last: float = 360.0, turned: bool = True) -> list[Sent]:
    """800 measurements, clockwise from behind, fill so many slots a degree; intensities are `turned` as the ranges are."""
    angles = 0.45 * np.arange(800)
    seen = see(np.radians(180.0 - angles), turn)
    ranges = np.full(int(360 * per_degree), INF)
    strengths = np.zeros(len(ranges))
    for angle, r in zip((angles * per_degree).astype(int).tolist(), seen.tolist(), strict=True):
        if r < INF:
            slots = slice(angle, angle + int(np.ceil(per_degree)))
            ranges[slots], strengths[slots] = r, strength(np.array(r))
    beams = len(ranges)
    intensities = strengths[::-1] if turned else strengths
    return [over(even((180.0 - last, 180.0), beams), (0.1 / (beams - 1), 0.1), (least, 12.0), ranges[::-1], intensities)]


def ydlidar(turn: int) -> list[Sent]:
    beams, points = 505, 498 + turn % 5
    theta = even((-180.0, 180.0), beams)
    ranges, at = np.zeros(beams), np.pi - TURN * np.arange(points) / points
    place = np.ceil((at + np.pi) / (theta[1] - theta[0])).astype(int)
    seen = see(at, turn)
    ranges[np.minimum(place, beams - 1)] = np.where(seen < INF, seen, 0.0)
    return [
        over(
            theta,
            (0.1 / points, 0.1) if turn else (0.0, 0.0),
            (0.1, 12.0),
            ranges,
            strength(np.where(ranges > 0, ranges, INF)),
        )
    ]


def ldlidar(turn: int) -> list[Sent]:
    beams = 448 + turn % 5
    theta = even((0.0, 360.0), beams)
    at = TURN * np.arange(beams) / beams
    place = beams - 1 - np.ceil(at / (theta[1] - theta[0]) - 1e-9).astype(int)
    ranges = np.full(beams, NAN)
    seen = see(-at, turn)
    ranges[place] = np.where(seen < INF, seen, NAN)
    return [over(theta, (0.1 / (beams - 1), 0.1), (0.02, 25.0), ranges, strength(ranges, NAN))]


def sick_telegram(turn: int) -> list[Sent]:
    theta = even((-135.0, 135.0), 811)
    seen = see(theta, turn)
    return [over(theta, (1 / 16200, 1 / 15), (0.0, 100.0), np.where(seen < INF, seen, 0.0), strength(seen))]


def sick_segments(turn: int) -> list[Sent]:
    found, scan_time = [], 0.1 if turn else 0.0
    for part in range(12):
        theta = np.radians(-180.0 + 30.0 * part + 0.25 * np.arange(120))
        seen = see(theta, turn)
        ranges = np.where(seen < INF, seen, 0.0)
        limits = max(0.05, ranges.min() - 0.001), ranges.max() + 0.001
        times = scan_time * (theta[-1] - theta[0]) / (120 * TURN), scan_time
        found.append(over(theta, times, limits, ranges, strength(seen), after=part * 0.1 / 12))
    return found


def sick_safetyscanners(turn: int) -> list[Sent]:
    theta = even((-137.5, 137.5), 551)
    seen = see(theta, turn)
    return [over(theta, (55e-6, 0.04), (0.1, 40.0), seen, strength(seen))]


def binned(turn: int, step: float, beams: int, nearest: bool) -> Floats:
    """(B,) ranges from -180 degrees on, each of the nearest or the last point from its bearing to the next."""
    at = np.radians(-179.9 + 0.2 * np.arange(1800))
    seen = see(at, turn)
    order = np.argsort(-seen, kind="stable") if nearest else np.arange(1800)
    ranges = np.full(beams, INF)
    ranges[((at + np.pi) / step).astype(int)[order]] = seen[order]
    return ranges


def velodyne_laserscan(turn: int) -> list[Sent]:
    ranges = binned(turn, 0.007, 898, nearest=False)
    return [Sent((-np.pi, np.pi, 0.007, 0.0, 0.0, 0.0, 200.0), ranges, strength(ranges))]


def pointcloud_to_laserscan(turn: int) -> list[Sent]:
    ranges = binned(turn, np.pi / 180, 360, nearest=True)
    return [Sent((-np.pi, np.pi, np.pi / 180, 0.0, 1 / 30, 0.0, INF), ranges)]


def depthimage_to_laserscan(turn: int) -> list[Sent]:
    pixel = -np.arctan((np.arange(640) - 319.5) / 570.0)
    theta = np.linspace(pixel[-1], pixel[0], 640)
    ranges, seen = np.full(640, NAN), see(pixel, turn)
    for place, r in zip(((pixel - theta[0]) / (theta[1] - theta[0])).astype(int).tolist(), seen.tolist(), strict=True):
        ranges[place] = np.fmin(ranges[place], r) if 0.45 <= r <= 10.0 else ranges[place]
    return [over(theta, (0.0, 0.033), (0.45, 10.0), ranges)]


def xv_11(turn: int) -> list[Sent]:
    seen = see(np.radians(np.arange(360.0)), turn)
    ranges = np.where(seen < INF, seen, 0.035)
    return [Sent((0.0, TURN, TURN / 360, 300 * 64 / 1e8, 0.0, 0.06, 5.0), ranges, strength(seen))]


def neato_robot(turn: int) -> list[Sent]:
    seen = see(np.radians(np.arange(360.0)), turn)
    return [Sent((0.0, 6.26, 0.017437326, 0.0, 0.0, 0.02, 5.0), np.where(seen < INF, seen, 0.0))]


def stage(turn: int) -> list[Sent]:
    theta = even((-135.0, 135.0), 1081)
    seen = see(theta, turn)
    return [over(theta, (0.0, 0.0), (0.0, 6.0), np.minimum(seen, 6.0), strength(seen))]


def gazebo(turn: int) -> list[Sent]:
    theta = even((-180.0, 180.0), 720)
    return [over(theta, (0.0, 0.0), (0.12, 30.0), see(theta, turn), np.zeros(720))]


def webots(turn: int) -> list[Sent]:
    theta = even((135.0, -135.0), 667)
    return [over(theta, (0.0, 0.0), (0.1, 30.0), see(theta, turn))]


def isaac(turn: int) -> list[Sent]:
    seen = see(np.radians(-179.5 + np.arange(360.0)), turn)
    geometry = (-np.pi, np.pi, np.pi / 180, 0.1 / 360, 0.1, 0.4, 100.0)
    return [Sent(geometry, np.where(seen < INF, seen, -1.0), strength(seen))]


A1 = 800 / 360 + 1
"""Slots a degree for 800 measurements a turn, where they are not rounded."""
SENT: dict[str, Callable[[int], list[Sent]]] = {
    "urg_node": urg_node,
    "laser_proc": multi_echo,
    "rplidar_ros (master)": partial(rplidar, per_degree=A1, least=0.15),
    "rplidar_ros (ros2)": partial(rplidar, per_degree=3, least=0.15, last=359.0, turned=False),
    "sllidar_ros2": partial(rplidar, per_degree=3, least=0.05),
    "ydlidar_ros2_driver": ydlidar,
    "ldlidar_stl_ros2": ldlidar,
    "sick_scan_xd (TiM, LMS)": sick_telegram,
    "sick_scan_xd (picoScan, multiScan)": sick_segments,
    "sick_safetyscanners (and 2)": sick_safetyscanners,
    "velodyne_laserscan": velodyne_laserscan,
    "pointcloud_to_laserscan": pointcloud_to_laserscan,
    "depthimage_to_laserscan": depthimage_to_laserscan,
    "xv_11_laser_driver": xv_11,
    "neato_robot": neato_robot,
    "stage_ros, stage_ros2": stage,
    "gazebo_ros_pkgs (classic)": gazebo,
    "ros_gz": gazebo,
    "webots_ros2": webots,
    "Isaac Sim (RTX)": isaac,
}
"""Driver → what it sends of a turn by its number."""
