"""Labels of real recordings: legs marked by hand, and a car followed by motion capture.

The recordings are public but no part of the project: the environment variable LIDARCLI_REAL_LOGS names their folder.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

import lidarcli
from benchmarks.accuracy.cells import points_xy
from benchmarks.accuracy.methods import METHODS
from lidarcli.formalism import detect
from lidarcli.sweeps.types import Float64, Int64, SweepBatch

LEG_LOGS = "leg_tracker/positive_*_extracted.bag"
LEG_TOPIC = "/leg_cluster_positions"
CAR_LOGS = "datmo/*.bag"
CAR, EGO = "/red_pose", "/ego_pose"
WITHIN = (0.15, 0.25)
"""[m]"""
SEEN = 0.25
"""[m] Half the length of the car: without a return this near it is behind the sensor's own body or too close."""


@dataclass(frozen=True, slots=True)
class Legs:
    """How near the detections of one method come to the labelled legs."""

    method: str
    labels: int
    sweeps: int
    within: tuple[float, ...]
    """Share of the legs with a detection's centroid within each of `WITHIN`."""
    detections: float
    """Per sweep."""


@dataclass(frozen=True, slots=True)
class Car:
    """Distance from the car's position to the nearest box of one log, 0 inside [m], where the sensor sees the car."""

    log: str
    sweeps: int
    seen: int
    """Sweeps with a return within `SEEN` of the position."""
    median: float
    p90: float
    within: tuple[float, ...]
    to_point: float
    """Median distance from the car's position to the nearest valid return, in the same sweeps."""
    detections: float
    """Per sweep, over all sweeps."""


def measure_legs(folder: Path) -> list[Legs]:
    """Every method on every log with labelled legs; the k-th array of positions belongs to the k-th sweep."""
    logs = [(batch, labels) for path in sorted(folder.glob(LEG_LOGS)) for batch, labels in labelled_legs(path)]
    results = []
    for name, method in METHODS.items():
        away: list[float] = []
        count = 0
        for batch, labels in logs:
            row, x, y = centroids(method(batch), batch)
            count += len(row)
            for sweep, legs in enumerate(labels):
                mine = row == sweep
                for leg in legs:
                    off = np.hypot(x[mine] - leg[0], y[mine] - leg[1])
                    away.append(float(off.min(initial=np.inf)))
        sweeps = sum(len(batch) for batch, _ in logs)
        shares = tuple(float(np.mean(np.array(away) <= limit)) for limit in WITHIN)
        results.append(Legs(name, len(away), sweeps, shares, count / max(sweeps, 1)))
    return results


def centroids(labels: Int64, batch: SweepBatch) -> tuple[Int64, Float64, Float64]:
    """Row, x and y of the centroid of the points of every detection."""
    row, beam = np.nonzero(labels > 0)
    span = int(labels.max(initial=0)) + 1
    names, owner = np.unique(row * span + labels[row, beam], return_inverse=True)
    x, y = points_xy(batch)
    count = np.maximum(np.bincount(owner, minlength=len(names)), 1)
    middle_x = np.bincount(owner, x[row, beam], minlength=len(names)) / count
    middle_y = np.bincount(owner, y[row, beam], minlength=len(names)) / count
    return names // span, middle_x, middle_y


def measure_car(folder: Path) -> list[Car]:
    """The robust profile on every log with motion capture."""
    results = []
    for path in sorted(folder.glob(CAR_LOGS)):
        car, ego = mocap(path, CAR), mocap(path, EGO)
        boxes_off, points_off = [], []
        count = 0
        for batch in lidarcli.read(path):
            position = seen_from(poses_at(ego, batch.stamp_ns), poses_at(car, batch.stamp_ns))
            detection = detect(batch)
            count += len(detection)
            x, y = points_xy(batch)
            gap = np.hypot(x - position[:, :1], y - position[:, 1:2])
            points_off += np.nanmin(gap, axis=1).tolist()
            for sweep in range(len(batch)):
                k = np.flatnonzero(detection.row == sweep)
                off = to_boxes(
                    position[sweep],
                    np.column_stack([detection.box_x, detection.box_y])[k],
                    np.column_stack([detection.box_length, detection.box_width])[k],
                    detection.box_yaw[k],
                )
                boxes_off.append(float(off.min(initial=np.inf)))
        near = np.array(points_off)
        seen = near <= SEEN
        off = np.array(boxes_off)[seen]
        results.append(
            Car(
                log=path.name,
                sweeps=len(seen),
                seen=len(off),
                median=float(np.median(off)),
                p90=float(np.quantile(off, 0.9)),
                within=tuple(float(np.mean(off <= limit)) for limit in WITHIN),
                to_point=float(np.median(near[seen])),
                detections=count / max(len(seen), 1),
            )
        )
    return results


def to_boxes(point: Float64, centre: Float64, size: Float64, yaw: Float64) -> Float64:
    """(K,) distance from a point (2,) to oriented rectangles, 0 inside."""
    dx, dy = (point - centre).T
    along = np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy) - size[:, 0] / 2
    across = np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx) - size[:, 1] / 2
    away: Float64 = np.hypot(np.maximum(along, 0), np.maximum(across, 0))
    return away


def seen_from(origin: Float64, poses: Float64) -> Float64:
    """(S, 2) positions of (S, 3) world poses in the frames of the poses `origin`."""
    dx, dy = poses[:, 0] - origin[:, 0], poses[:, 1] - origin[:, 1]
    cos, sin = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    return np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx])


def labelled_legs(path: Path) -> Iterator[tuple[SweepBatch, list[Float64]]]:
    """The sweeps of a log, and for each the places of the legs in it (K, 2)."""
    labels = [
        np.array([[pose.position.x, pose.position.y] for pose in message.poses]).reshape(-1, 2)
        for message in _messages(path, LEG_TOPIC)
    ]
    for batch in lidarcli.read(path):
        first = int(batch.sweep[0])
        yield batch, labels[first : first + len(batch)]


@dataclass(frozen=True, slots=True)
class Mocap:
    """Poses of one body by time."""

    stamp_ns: Int64
    pose: Float64
    """(N, 3) x, y, unwrapped yaw."""


def mocap(path: Path, topic: str) -> Mocap:
    """The poses on a topic."""
    stamps, poses = [], []
    for message in _messages(path, topic):
        stamps.append(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)
        place, turn = message.pose.position, message.pose.orientation
        yaw = np.arctan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y * turn.y + turn.z * turn.z))
        poses.append([place.x, place.y, yaw])
    table = np.array(poses)
    table[:, 2] = np.unwrap(table[:, 2])
    return Mocap(np.array(stamps, np.int64), table)


def poses_at(track: Mocap, stamp_ns: Int64) -> Float64:
    """(S, 3) poses between the nearest two."""
    first = track.stamp_ns[0]
    when, known = (stamp_ns - first).astype(float), (track.stamp_ns - first).astype(float)
    return np.column_stack([np.interp(when, known, column) for column in track.pose.T])


def _messages(path: Path, topic: str) -> Iterator[Any]:
    with AnyReader([path]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        for connection, _, data in reader.messages(connections=connections):
            yield reader.deserialize(data, connection.msgtype)
