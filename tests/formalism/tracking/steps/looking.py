"""The views of one sweep as the steps get them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detect import scans
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import measurement
from lidarcli.formalism.tracking.measurement import Detections, Measurements
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import Course, Entity, Scene, SceneSensor
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, SweepBatch
from tests.sweeping import raw_sweeps

Pose = tuple[float, float, float, float]
"""x, y [m], yaw [rad] and side of the sensor."""
BEAMS = 360
STEP = TURN / BEAMS
HERE: Pose = (0.0, 0.0, 0.0, 1.0)
POSES: tuple[Pose, ...] = (HERE, (1.0, -2.0, 0.7, 1.0), (1.0, -2.0, 3.0, -1.0))
GEOMETRIES = {
    "turn": (BEAMS, -math.pi, STEP),
    "clockwise": (BEAMS, math.pi, -STEP),
    "from ahead": (BEAMS, 0.0, STEP),
    "twice": (BEAMS + 1, -math.pi, STEP),
    "more than once around": (BEAMS, 2.0, STEP),
}
"""Numbers of beams, first bearings and steps [rad] of a full turn."""


def sweep_of(
    ranges: np.ndarray,
    first: float = -math.pi,
    step: float = STEP,
    pose: Pose = HERE,
    way: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Measurements, Scans]:
    """One sweep, seen from there, while the sensor goes so far."""
    raw = raw_sweeps(ranges[None], angle_min=first, angle_increment=step, range_max=50.0)
    return look_at(normalise(raw, np.arange(1), RangeRules()), pose, way=way)


def at(r: float, bearing: float, pose: Pose = HERE) -> tuple[float, float]:
    """A point of the world by range and bearing of the sensor."""
    direction = pose[2] + pose[3] * bearing
    return pose[0] + r * math.cos(direction), pose[1] + r * math.sin(direction)


def look_at(
    batch: SweepBatch, pose: Pose = (0.0, 0.0, 0.0, 1.0), row: int = 0, way: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Measurements, Scans]:
    """The objects of a sweep whose sensor is there at its first beam, and goes so far until its last."""
    found = detect(batch, Parameters())
    poses, ways = np.tile(pose, (len(batch), 1)), np.tile(way, (len(batch), 1))
    placed = np.ones(len(batch), np.bool_)
    detections = Detections(found, poses, np.arange(len(batch)) / 10, ways, found.shares(batch), placed)
    meas = Measurements(max(detections.max_objects, 1), max(batch.width, 1))
    meas.start_x, meas.start_y, meas.start_yaw = meas.x, meas.y, _ = pose[:3]
    meas.motion_x, meas.motion_y, meas.motion_yaw = way
    meas.moves = any(way)
    meas.cos, meas.sin = math.cos(pose[2]), math.sin(pose[2])
    laid_out = scans(batch)
    measurement.extract(meas, detections, laid_out, row)
    measurement.classify_edges(meas)
    return meas, laid_out


def seen_from(sensor: SceneSensor, pose: Pose, *entities: Entity) -> tuple[Measurements, Scans]:
    """What a sensor at a pose sees of these, upside down where its side is -1."""
    x, y, yaw, side = pose
    hung = replace(sensor, angle_min=side * sensor.angle_min, angle_increment=side * sensor.angle_increment)
    scene = Scene("steps", hung, entities, Course(np.array([[x, y]]), yaw=yaw))
    raw, _, _ = simulate_sweep_arrays(scene, 1)
    if side < 0:
        # Hanging head down, bearings run the other way round.
        raw = replace(raw, angle_min=-raw.angle_min, angle_increment=-raw.angle_increment)
    return look_at(normalise(raw, np.arange(1), RangeRules()), pose)
