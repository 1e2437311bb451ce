"""Sweeps of a scene: ray casting, then the faults of the sensor; and the odometry of the robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from lidarcli.simulation.scene import Entity, Odometry, Scene, SceneSensor
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int32, Int64, RawSweeps, concatenate

_CELLS = 1 << 20
"""Largest number of beam × primitive pairs held at once: what stays near the cache."""


@dataclass(frozen=True, eq=False, slots=True)
class Primitives:
    """Shapes in the sensor frame, per sweep; NaN coordinates mean absent."""

    segments: Float64
    """(S, K, 4) x0 y0 x1 y1"""
    circles: Float64
    """(S, C, 3) x y radius"""
    segment_entity: Int32
    circle_entity: Int32
    """(C,)"""


def place(entities: tuple[Entity, ...], sensor_poses: Float64, seconds: Float64) -> Primitives:
    """Bring the entities into the sensor's frame at each of the (S,) times, relative to the (S, 3) poses."""
    segments, circles = [np.empty((len(seconds), 0, 4))], [np.empty((len(seconds), 0, 3))]
    segment_counts, circle_counts = [], []
    for entity in entities:
        pose = relative(entity.poses(seconds), sensor_poses)
        pose[~entity.present(seconds)] = np.nan
        cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])

        def moved(x: Float64, y: Float64, pose: Float64 = pose, cos: Float64 = cos, sin: Float64 = sin) -> list[Float64]:
            return [pose[:, :1] + cos * x - sin * y, pose[:, 1:2] + sin * x + cos * y]

        sides, rings = entity.segments, entity.circles
        segments.append(np.stack(moved(sides[:, 0], sides[:, 1]) + moved(sides[:, 2], sides[:, 3]), axis=-1))
        swing = np.zeros((len(seconds), len(rings)))
        feet = entity.feet(seconds)
        if feet is None and entity.motion.stride:
            phase = np.pi * 2 * entity.motion.cadence * seconds
            swing = (entity.motion.stride / 2 * np.sin(phase))[:, None] * (1 - 2 * (np.arange(len(rings)) % 2))
        radius = np.broadcast_to(rings[:, 2], swing.shape)
        centres = moved(rings[:, 0] + swing, rings[:, 1])
        if feet is not None:
            dx, dy = feet[..., 0] - sensor_poses[:, :1], feet[..., 1] - sensor_poses[:, 1:2]
            ahead, left = np.cos(sensor_poses[:, 2:]), np.sin(sensor_poses[:, 2:])
            centres = [ahead * dx + left * dy, ahead * dy - left * dx]
            centres[0][~entity.present(seconds)] = np.nan
        circles.append(np.stack([*centres, radius], axis=-1))
        segment_counts.append(len(sides))
        circle_counts.append(len(rings))
    number = np.arange(len(entities), dtype=np.int32)
    return Primitives(
        segments=np.concatenate(segments, axis=1),
        circles=np.concatenate(circles, axis=1),
        segment_entity=np.repeat(number, np.array(segment_counts, int)),
        circle_entity=np.repeat(number, np.array(circle_counts, int)),
    )


def relative(poses: Float64, origin: Float64) -> Float64:
    """Return (S, 3) world poses as relative to the (S, 3) poses `origin`."""
    dx, dy = poses[:, 0] - origin[:, 0], poses[:, 1] - origin[:, 1]
    cos, sin = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    return np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, poses[:, 2] - origin[:, 2]])


def cast(primitives: Primitives, bearings: Float64) -> tuple[Float64, Int32]:
    """Return the nearest hit of every beam: (S, B) range [m], inf for none, and (S, B) entity, -1 for none.

    `bearings` is (B,) or (S, B).
    """
    sweeps = len(primitives.segments)
    bearings = np.broadcast_to(bearings, (sweeps, bearings.shape[-1]))
    beams = bearings.shape[1]
    ranges = np.full((sweeps, beams), np.inf)
    entity = np.full((sweeps, beams), -1, np.int32)
    for hits, shapes, owner in (
        (_hit_segments, primitives.segments, primitives.segment_entity),
        (_hit_circles, primitives.circles, primitives.circle_entity),
    ):
        if not len(owner):
            continue
        # Many primitives leave room for some of the beams at a time; each is cast on its own.
        across = max(1, min(beams, _CELLS // len(owner)))
        step = max(1, _CELLS // (across * len(owner)))
        for first in range(0, sweeps, step):
            for left in range(0, beams, across):
                part = slice(first, first + step), slice(left, left + across)
                angle = bearings[part]
                distance = hits(shapes[part[0]], np.cos(angle), np.sin(angle))
                nearest = distance.argmin(axis=1)
                found = np.take_along_axis(distance, nearest[:, None], axis=1)[:, 0]
                nearer = found < ranges[part]
                ranges[part] = np.where(nearer, found, ranges[part])
                entity[part] = np.where(nearer, owner[nearest], entity[part])
    return ranges, entity


def _hit_segments(segments: Float64, cos: Float64, sin: Float64) -> Float64:
    """Return (S, K, B) distance along each beam to each segment, inf where it misses."""
    x0, y0, x1, y1 = (segments[:, :, i, None] for i in range(4))
    cos, sin = cos[:, None, :], sin[:, None, :]
    dx, dy = x1 - x0, y1 - y0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1.0 / (cos * dy - sin * dx)
        distance = (x0 * dy - y0 * dx) * inverse
        along = (x0 * sin - y0 * cos) * inverse
        # Neighbouring segments overlap a little, so that no beam slips through a shared corner.
        hit = (along >= -1e-9) & (along <= 1 + 1e-9) & (distance > 0)
    return np.where(hit, distance, np.inf)


def _hit_circles(circles: Float64, cos: Float64, sin: Float64) -> Float64:
    """Return (S, C, B) distance along each beam to the near side of each circle, inf where it misses."""
    x, y, radius = (circles[:, :, i, None] for i in range(3))
    cos, sin = cos[:, None, :], sin[:, None, :]
    with np.errstate(invalid="ignore", over="ignore"):
        half = np.sqrt(radius**2 - (x * sin - y * cos) ** 2)
        distance = x * cos + y * sin - half
        hit = distance > 0
    return np.where(hit, distance, np.inf)


_WAVES = ((0.7, 2), (0.5, 5))
"""Glare over the bearings: height and number of waves; where they lie is drawn."""


def _depth_behind(ideal: Float64, padding: Bool) -> Float64:
    """Return (S, B) how far behind each hit the surface of a neighbouring beam lies, 0 where none does."""
    surface = np.where(np.isfinite(ideal) & ~padding, ideal, -np.inf)
    neighbour = np.full_like(surface, -np.inf)
    neighbour[:, 1:] = surface[:, :-1]
    neighbour[:, :-1] = np.maximum(neighbour[:, :-1], surface[:, 1:])
    depth: Float64 = np.maximum(neighbour - np.where(np.isfinite(ideal), ideal, np.inf), 0)
    return depth


class Faults:
    """Noise, lost and flickering beams, mixed pixels and changing beam counts, each from its own random stream."""

    def __init__(self, sensor: SceneSensor, seed: int, entities: Sequence[Entity]) -> None:
        self.sensor = sensor
        streams = np.random.SeedSequence(seed).spawn(7)
        self.noise, self.lost, self.mixed, self.count, self.flickering, surfaces, self.swallowed = (
            np.random.Generator(np.random.PCG64(stream)) for stream in streams
        )
        self.phases = surfaces.uniform(0, TURN, len(_WAVES))
        # A quarter of the entities is dark and flickers four times as much. One more for what is no entity's own surface:
        # its index is -1.
        self.darkness = np.append(np.where(surfaces.random(len(entities)) < 0.25, 4.0, 1.0), 1.0)
        self.swallows = np.append([entity.lost for entity in entities], 0.0)

    def beam_counts(self, sweeps: int) -> Int32:
        """Return (S,) beams of the next sweeps."""
        jitter = self.sensor.beams_jitter
        varied = self.count.integers(-jitter, jitter + 1, sweeps) if jitter else np.zeros(sweeps, np.int32)
        return (self.sensor.beams + varied).astype(np.int32)

    def apply(self, ideal: Float64, entity: Int32, padding: Bool, bearings: Float64) -> Float32:
        """Return (S, B) measured ranges; clears `entity` wherever a beam comes back without a range of its own."""
        sensor = self.sensor
        measured, hit = ideal, entity.copy()
        if sensor.mixed_pixels:
            draw = self._uniform(self.mixed, ideal.shape, columns=2)
            depth = _depth_behind(ideal, padding)
            # Between neighbouring surfaces that are further apart than 15 cm.
            edge = (depth > 0.15) & (draw[0] < sensor.mixed_pixels)
            measured = np.where(edge, ideal + draw[1] * depth, ideal)
            entity[edge] = -1
        if sensor.noise or sensor.noise_per_metre:
            spread = sensor.noise + sensor.noise_per_metre * np.where(np.isfinite(measured), measured, 0.0)
            measured = measured + spread * self.noise.standard_normal(self._full(ideal.shape))[:, : ideal.shape[1]]
        if sensor.resolution:
            measured = np.rint(measured / sensor.resolution) * sensor.resolution
        return self._limit(measured.astype(np.float32), entity, hit, padding, bearings)

    def _limit(self, measured: Float32, entity: Int32, hit: Int32, padding: Bool, bearings: Float64) -> Float32:
        """Return the ranges with those out of limits, lost, and padding replaced."""
        sensor = self.sensor
        nothing = ~(measured <= np.float32(sensor.range_max))
        measured[nothing] = self._fill()
        close = measured < np.float32(sensor.range_min)
        close &= ~nothing
        measured[close] = -np.inf
        nothing |= close
        if sensor.lost:
            draw = self._uniform(self.lost, measured.shape)[0]
            lost = (draw < sensor.lost) & ~nothing
            measured[lost] = self._fill()
            if sensor.lost_as == "mixed":
                # One draw decides both whether and how: its upper half of the lost share is NaN.
                measured[lost & (draw >= sensor.lost / 2)] = np.nan
            nothing |= lost
        if self.swallows.any():
            gone = (self._uniform(self.swallowed, measured.shape)[0] < self.swallows[hit]) & ~nothing
            measured[gone] = self._fill()
            nothing |= gone
        if sensor.flicker:
            gone = self._flickers(measured, entity, nothing | padding, bearings)
            measured[gone] = self._fill()
            nothing |= gone
        nothing |= padding
        measured[padding] = np.nan
        entity[nothing] = -1
        return measured

    def _flickers(self, measured: Float32, entity: Int32, nothing: Bool, bearings: Float64) -> Bool:
        """Return (S, B) True for beams that return nothing in this sweep: in runs, most where it is far or dark."""
        far = np.where(nothing, 0.0, measured / np.float64(self.sensor.range_max))
        glare = np.exp(
            sum(
                height * np.sin(count * bearings + phase)
                for (height, count), phase in zip(_WAVES, self.phases, strict=True)
            )
        )
        weight = np.where(nothing, 0.0, (far**2 + 0.05) * self.darkness[entity] * glare)
        wanted = self.sensor.flicker * np.count_nonzero(~nothing, axis=1)
        share = weight
        # Further rounds make no difference.
        for _ in range(12):
            total = share.sum(axis=1)
            scale = wanted / np.where(total > 0, total, 1.0)
            share = np.minimum(share * scale[:, None], 0.95)
        draw = self._uniform(self.flickering, measured.shape, columns=2)
        # A beam most often shares the luck of the one before it.
        alone = draw[0] >= 0.6
        alone[:, 0] = True
        leader = np.maximum.accumulate(np.where(alone, np.arange(measured.shape[1]), 0), axis=1)
        luck = np.take_along_axis(draw[1], leader, axis=1)
        gone: Bool = ~nothing & (luck < share)
        return gone

    def _fill(self) -> float:
        values = {"inf": np.inf, "mixed": np.inf, "nan": np.nan, "zero": 0.0, "max": self.sensor.range_max}
        return values[self.sensor.lost_as]

    def _full(self, shape: tuple[int, ...]) -> tuple[int, int]:
        """Return the shape of draws: that of the widest sweep, so that blocks do not shift the streams."""
        return shape[0], self.sensor.beams + self.sensor.beams_jitter

    def _uniform(self, stream: np.random.Generator, shape: tuple[int, ...], columns: int = 1) -> Float64:
        rows, width = self._full(shape)
        draw: Float64 = np.moveaxis(stream.random((rows, width, columns)), 2, 0)[:, :, : shape[1]]
        return draw


START_NS = 1_700_000_000_000_000_000
"""Stamp of the first sweep: fixed, because a simulation has no clock of its own."""


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedBlock:
    """A run of simulated sweeps and their truth."""

    raw: RawSweeps
    first: int
    seconds: Float64
    poses: Float64
    """(S, 3) of the sensor in the world."""
    entity: Int32
    """(S, B) index into the scene's entities, -1 for none and for padding."""


def simulate_blocks(scene: Scene, sweeps: int, seed: int = 0, size: int = 512) -> Iterator[SimulatedBlock]:
    """Yield sweeps of a scene in blocks of at most `size`."""
    faults = Faults(scene.sensor, seed, scene.entities)
    still = None
    for first in range(0, sweeps, size):
        index = np.arange(first, min(first + size, sweeps))
        seconds = index / scene.sensor.rate
        poses = scene.sensor_poses(seconds)
        beams = faults.beam_counts(len(index))
        # The field of view is kept for each number of beams.
        exact = scene.sensor.angle_increment * (scene.sensor.beams / beams)
        increment = np.where(beams == scene.sensor.beams, scene.sensor.angle_increment, exact)
        bearings = scene.sensor.angle_min + increment[:, None] * np.arange(beams.max(initial=0))
        if scene.still and not scene.sensor.beams_jitter:
            if still is None:
                still = cast(place(scene.entities, poses[:1], seconds[:1]), bearings[:1])
            ideal = np.repeat(still[0], len(index), axis=0)
            entity = np.repeat(still[1], len(index), axis=0)
        elif scene.sensor.time_increment:
            ideal, entity = _cast_in_turn(scene, seconds, _time_increments(scene.sensor, beams), bearings)
        else:
            ideal, entity = cast(place(scene.entities, poses, seconds), bearings)
        padding = np.arange(bearings.shape[1]) >= beams[:, None]
        ranges = faults.apply(ideal, entity, padding, bearings)
        raw = _raw(scene.sensor, START_NS + np.rint(seconds * 1e9).astype(np.int64), beams, increment, ranges)
        raw = replace(raw, intensities=_intensities(scene.entities, entity, padding))
        yield SimulatedBlock(raw, first, seconds, poses, entity)


def simulate_sweep_arrays(scene: Scene, n_sweeps: int, seed: int = 0) -> tuple[RawSweeps, Int32, tuple[Entity, ...]]:
    """Return all sweeps, the (S, B) entity of every beam (-1: none), and the entities."""
    blocks = list(simulate_blocks(scene, n_sweeps, seed))
    raw = concatenate([block.raw for block in blocks])
    entity = np.full(raw.ranges.shape, -1, np.int32)
    for block in blocks:
        rows, columns = block.entity.shape
        entity[block.first : block.first + rows, :columns] = block.entity
    return raw, entity, scene.entities


def _time_increments(sensor: SceneSensor, beams: Int32) -> Float64:
    """Return (S,) the time between beams [s]: the duration of a sweep does not depend on its number of beams."""
    exact: Float64 = sensor.time_increment * (sensor.beams / beams)
    return exact


def _cast_in_turn(scene: Scene, seconds: Float64, increment: Float64, bearings: Float64) -> tuple[Float64, Int32]:
    """Cast beams at their own times: world and sensor move during a sweep."""
    sweeps, beams = bearings.shape
    shapes = sum(len(entity.segments) + len(entity.circles) for entity in scene.entities)
    # Beams times shapes that are placed at once.
    step = max(1, (1 << 19) // (beams * max(shapes, 1)))
    ranges, entity = np.empty(bearings.shape), np.empty(bearings.shape, np.int32)
    for first in range(0, sweeps, step):
        part = slice(first, first + step)
        times = (seconds[part, None] + increment[part, None] * np.arange(beams)).ravel()
        placed = place(scene.entities, scene.sensor_poses(times), times)
        found, hit = cast(placed, bearings[part].reshape(-1, 1))
        ranges[part], entity[part] = found.reshape(-1, beams), hit.reshape(-1, beams)
    return ranges, entity


def _intensities(entities: Sequence[Entity], entity: Int32, padding: Bool) -> Float32 | None:
    """Return (S, B) the intensity of what each beam hit, 0 where unknown; None where the scene has none."""
    if all(each.intensity is None for each in entities):
        return None
    # One more for what is no entity's own surface: its index is -1.
    intensities = np.array([*(each.intensity or 0.0 for each in entities), 0.0], np.float32)
    return np.where(padding, np.float32(np.nan), intensities[entity])


def _raw(sensor: SceneSensor, stamp_ns: Int64, beams: Int32, increment: Float64, ranges: Float32) -> RawSweeps:
    """Put simulated ranges into the shape in which logs hold them."""
    rows = len(ranges)
    return RawSweeps(
        topic=sensor.topic,
        frame_ids=(sensor.frame_id,),
        frame=np.zeros(rows, np.int32),
        stamp_ns=stamp_ns,
        record_ns=stamp_ns,
        # What a LaserScan can hold: its geometry is float32, and so is ours from here on.
        angle_min=np.full(rows, np.float32(sensor.angle_min), np.float64),
        angle_increment=increment.astype(np.float32).astype(np.float64),
        range_min=np.full(rows, sensor.range_min, np.float32),
        range_max=np.full(rows, sensor.range_max, np.float32),
        beams=beams,
        ranges=ranges,
        time_increment=_time_increments(sensor, beams).astype(np.float32),
        scan_time=np.full(rows, 1 / sensor.rate if sensor.time_increment else 0.0, np.float32),
    )


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedPoses:
    """One pose per sweep, as the robot reports it, and the frames it speaks of."""

    odometry: Odometry
    laser_frame: str
    stamp_ns: Int64
    poses: Float64
    """(S, 3) x, y, yaw in the odometry frame."""
    speed: Float64
    """(S,) forward [m/s]."""
    yaw_rate: Float64
    """(S,) [rad/s]."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y, yaw of the laser on the robot, as the log states it."""

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def at(self, stamp_ns: Int64) -> Float64:
        """Return (K, 3) x, y, yaw of the robot at other times, interpolated."""
        since = (self.stamp_ns - self.stamp_ns[0]).astype(np.float64)
        wanted = (stamp_ns - self.stamp_ns[0]).astype(np.float64)
        return np.column_stack([np.interp(wanted, since, self.poses[:, column]) for column in range(3)])


def simulate_odometry(scene: Scene, sweeps: int, seed: int = 0) -> SimulatedPoses | None:
    """Simulate the odometry of a run; None for a scene without any. Without noise it is the true pose.

    Where stamps are late or early, further poses from before or after the run make up for it.
    """
    if scene.odometry is None or sweeps == 0:
        return None
    delay = scene.odometry.delay
    before, after = (ceil(max(late, 0.0) * scene.sensor.rate) for late in (delay, -delay))
    seconds = np.arange(-before, sweeps + after) / scene.sensor.rate
    count = len(seconds)
    true = scene.path.poses(seconds)
    step = np.diff(true, axis=0)
    step[:, 2] = np.mod(step[:, 2] + np.pi, TURN) - np.pi
    cos, sin = np.cos(true[:-1, 2]), np.sin(true[:-1, 2])
    ahead = np.column_stack([cos * step[:, 0] + sin * step[:, 1], cos * step[:, 1] - sin * step[:, 0]])
    distance = np.hypot(ahead[:, 0], ahead[:, 1])

    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 1])))
    drift = rng.standard_normal((count - 1, 3)) * np.sqrt(distance)[:, None]
    ahead += drift[:, :2] * scene.odometry.noise
    yaw = true[0, 2] + np.concatenate([[0.0], np.cumsum(step[:, 2] + drift[:, 2] * scene.odometry.yaw_noise)])
    cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    moved = np.column_stack([cos * ahead[:, 0] - sin * ahead[:, 1], sin * ahead[:, 0] + cos * ahead[:, 1]])
    believed = np.column_stack([true[0, :2] + np.vstack([np.zeros((1, 2)), np.cumsum(moved, axis=0)]), yaw])
    last = np.vstack([step, step[-1:]]) if count > 1 else np.zeros((1, 3))
    return SimulatedPoses(
        odometry=scene.odometry,
        laser_frame=scene.sensor.frame_id,
        stamp_ns=START_NS + np.rint((seconds + delay) * 1e9).astype(np.int64),
        poses=believed,
        speed=scene.path.speeds(seconds),
        yaw_rate=last[:, 2] * scene.sensor.rate,
        mount=scene.mount.pose if scene.mount.in_log else (0.0, 0.0, 0.0),
    )
