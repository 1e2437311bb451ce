"""Places of sensors in the frames of zones, and velocities of these."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from lidarcli.errors import NoScanError
from lidarcli.logs.base import Log
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.inputs.sources import read_pose_messages
from lidarcli.pose.frames import WORLDS, FrameTree, Step, along, namespace
from lidarcli.pose.messages import frame_name
from lidarcli.pose.tracks import HOLD_STEPS, PoseTrack, planar
from lidarcli.sweeps.masks import Mask, Masks, Mount, mounted, same_name
from lidarcli.sweeps.types import Float64, Int64, SweepBatch, SweepPoses
from lidarcli.sweeps.zone import ROBOT, SENSOR, WORLD, Zones

LONG_HELD = 1.0
"""A link that moves and is extended for longer beyond its transforms has a note [s]."""


@dataclass(slots=True)
class Frames:
    """Places of sensors in the frames of zones."""

    mounts: Sequence[Mount]
    """Mounts that files declare; they count before the transforms of the log."""
    robot: str
    """Name of the frame of the robot; empty: the one at the end of the mounts, or by the transforms of the log."""
    _log: Log
    _until_ns: int | None = None
    """Time of recording up to which the transforms of the log are read; None: all of them."""
    _topic: str = ""
    """Topic of the sensors; empty: any."""
    _links: list[list[PoseTrack]] = field(default_factory=list)
    """One list of all transforms, once they have been read."""
    _trees: dict[str, FrameTree] = field(default_factory=dict)
    _found: dict[tuple[str, str, str], Mount] = field(default_factory=dict)
    _held: dict[str, float] = field(default_factory=dict)
    """Link that moves → longest time for which it is extended [s]."""
    _used: set[str] = field(default_factory=set)
    """Frames whose places count."""

    @classmethod
    def of(cls, log: Log, zones: Zones, mounts: Sequence[Mount] = (), until_ns: int | None = None) -> Frames:
        """Return the frames for the zones of a file, with more `mounts`, by transforms that were recorded up to a time."""
        return cls((*zones.masks.mounts, *mounts), zones.robot, log, until_ns)

    def of_topic(self, topic: str) -> Frames:
        """Return the frames for the sensors of a topic: robots may have the same names for theirs."""
        return replace(self, _topic=topic)

    @property
    def tree(self) -> FrameTree:
        """The transforms of the log for the topic of the sensors."""
        topics = self._log.topics()
        if not self._links:
            is_file = self._log.size is not None and topics is not None
            tracks = read_pose_messages(self._log, self._until_ns).tracks if is_file else ()
            self._links.append([track for track in tracks if track.is_link])
        if self._topic not in self._trees:
            scans = [topic.name for topic in topics or () if topic.is_scan]
            self._trees[self._topic] = FrameTree(self._links[0], self._topic, scans)
        return self._trees[self._topic]

    def sensor_in(self, frame: str, sensor: str, stamp_ns: Int64) -> SweepPoses:
        """Return where a sensor is in a frame other than the world (S,); `NoScanError` where nothing leads there."""
        if frame == SENSOR:
            return _resting(Mount(sensor, sensor, 0.0, 0.0, 0.0), len(stamp_ns))
        target = self.robot_of(sensor) if frame == ROBOT else frame
        mount = mounted(self.mounts, sensor, target)
        # Sweeps may be elsewhere in the frame that they name.
        if mount is not None and not same_name(sensor, target):
            return _resting(mount, len(stamp_ns))
        steps = self.tree.path(self.tree.sensor(frame_name(sensor)), frame_name(target))
        if steps is None:
            raise self._lost(sensor, target)
        # A mount stays where it is, also before the first transform of it and after the last one; the robot does not.
        return self._along(steps, stamp_ns, held=frame_name(target).rpartition("/")[2] not in WORLDS)

    def _along(self, steps: Sequence[Step], stamp_ns: Int64, *, held: bool) -> SweepPoses:
        """Return the places at times (S,); note links that are `held` though they moved."""
        self._used.update(step.track.child for step in steps)
        for track in (step.track for step in steps if held and step.track.moves):
            first, last = track.span_ns
            beyond = max(first - int(stamp_ns.min()), int(stamp_ns.max()) - last) / SECOND_NS
            if beyond > max(LONG_HELD, HOLD_STEPS / (track.rate or LONG_HELD)):
                link = f"{track.parent} > {track.child}"
                self._held[link] = max(beyond, self._held.get(link, 0.0))
        return planar(along(steps, stamp_ns, held=held))

    def notes(self) -> list[str]:
        """Return a note on each link that was extended for long, though it moved, and on contradictions."""
        from lidarcli.pose.findings import contradictions, upright_words

        links = self._links[0] if self._links else []
        noted = [each.message for each in contradictions(links) if each.frame in self._used]
        noted += filter(None, [upright_words(self._used)])
        return noted + [
            f"sweeps are up to {seconds:.1f} s beyond the transforms of {link}, which moved: it is held there"
            for link, seconds in self._held.items()
        ]

    def robot_of(self, sensor: str) -> str:
        """Return the name of the frame of the robot that carries a sensor; errors as of `sensor_in`."""
        if self.robot:
            return self.robot
        here, left = sensor, len(self.mounts)
        while left and (parent := next((one.parent for one in self.mounts if same_name(one.frame, here)), "")):
            here, left = parent, left - 1
        if here != sensor or any(same_name(one.parent, sensor) for one in self.mounts):
            return here
        steps = self.tree.to_base(self.tree.sensor(frame_name(sensor)))
        if steps:
            return steps[-1].target
        if frame_name(sensor).rpartition("/")[2].startswith("base"):
            return sensor
        raise self._lost(sensor, "")

    def mount_of(self, batch: SweepBatch) -> Mount | None:
        """Return the place of the sensor of one sweep on its robot; None if it is unknown, or the sweep is in its frame."""
        sensor = batch.frame_ids[int(batch.frame[0])]
        frames = self.of_topic(batch.topic)
        try:
            robot, here = frames.robot_of(sensor), frames.sensor_in(ROBOT, sensor, batch.stamp_ns)
        except NoScanError:
            return None
        x, y, yaw = (float(each[0]) for each in (here.x, here.y, here.yaw))
        known = np.isfinite([x, y, yaw]).all() and not same_name(robot, sensor)
        return Mount(sensor, robot, x, y, yaw, bool(here.upside_down[0])) if known else None

    def carrier_of(self, frame: str, sensor: str) -> tuple[str, str]:
        """Return the name of the frame of a zone, and the namespace of it: robots may have the same names."""
        target = self.robot_of(sensor) if frame == ROBOT else frame
        if frame in (SENSOR, WORLD) or mounted(self.mounts, sensor, target) is not None:
            return target, ""
        steps = self.tree.path(self.tree.sensor(frame_name(sensor)), frame_name(target))
        return frame_name(target), namespace(steps[-1].track.topic) if steps else ""

    def corners_in(self, sensor: str, frame: str, stamp_ns: int, corners: Float64) -> Float64 | None:
        """Return points (C, 2) of another frame in that of the robot at a time; None where nothing leads there."""
        robot = self.robot_of(sensor)
        if same_name(frame, robot):
            return corners
        steps = self.tree.path(frame_name(frame), frame_name(robot))
        if steps is None:
            return None
        pose = self._along(steps, np.array([stamp_ns]), held=True)
        row = np.zeros(len(corners), np.int64)
        x, y, _ = pose.to_world(row, corners[:, 0], corners[:, 1], np.zeros(len(corners)))
        found: Float64 = np.column_stack([x, y])
        return found if np.isfinite(found).all() else None

    def mounts_in(self, names: Collection[str]) -> Iterator[Mount]:
        """Yield where the frames of the log and of its mounts are in some others, where that is known before any sweep."""
        if not names:
            return
        known = dict.fromkeys([*(one.frame for one in self.mounts), *self.tree.frames])
        for name in sorted(names):
            for frame in known:
                if not same_name(frame, name):
                    with suppress(NoScanError):
                        yield self._mount(name, frame, np.zeros(1, np.int64))

    def masks_for(self, masks: Masks, batch: SweepBatch) -> Masks:
        """Return masks with a mount for each frame that they name, as it is at the first sweep of a batch."""
        placed: list[Mask] = []
        mounts: list[Mount] = [*self.mounts, *masks.mounts]
        for mask in masks.masks:
            if mask.topic and not same_name(mask.topic, batch.topic):
                continue
            placed.append(mask)
            for sensor in batch.frame_ids if mask.frame else ():
                if mounted(mounts, sensor, mask.frame) is None:
                    mounts.append(self._mount(mask.frame, sensor, batch.stamp_ns[:1]))
        return Masks(tuple(placed), tuple(mounts), masks.path)

    def _mount(self, frame: str, sensor: str, stamp_ns: Int64) -> Mount:
        key = self._topic, frame, sensor
        if key not in self._found:
            here = self.sensor_in(frame, sensor, stamp_ns)
            x, y, yaw = (float(each[0]) for each in (here.x, here.y, here.yaw))
            self._found[key] = Mount(sensor, frame, x, y, yaw, bool(here.upside_down[0]))
        return self._found[key]

    def _lost(self, sensor: str, target: str) -> NoScanError:
        name = sensor or "without a name"
        return NoScanError(
            f"nothing leads from frame {name} to {target or 'the robot'}; add to the zone file (Nav2: to one for --mask), "
            f'a line each: [[mount]] frame = "{sensor}" parent = "{target or "base_link"}" x = 0.0 y = 0.0 yaw = 0.0'
        )


def _resting(mount: Mount, count: int) -> SweepPoses:
    """Return one place for so many sweeps."""
    x, y, yaw = (np.full(count, value) for value in (mount.x, mount.y, mount.yaw))
    return SweepPoses(x, y, yaw, np.full(count, mount.upside_down))


OLDEST_NS = 2_000_000_000
"""Age from which on a velocity may be that of another time [ns]."""
VELOCITY_SPAN_NS = 200_000_000
"""Least time over which poses give a velocity [ns]."""


class Velocities(NamedTuple):
    """Velocities that a log reports."""

    stamp_ns: Int64
    velocity: Float64
    recorded: bool
    """True where the stamps are those of the recording."""

    def at(self, batch: SweepBatch) -> tuple[Float64, int]:
        """Return the newest velocity (S, 3) before each sweep, NaN before the first; and how many are too old."""
        times = batch.record_ns if self.recorded else batch.stamp_ns
        index = np.searchsorted(self.stamp_ns, times, side="right") - 1
        newest: Float64 = np.where(index[:, None] < 0, np.nan, self.velocity[np.maximum(index, 0)])
        old = (index >= 0) & (times - self.stamp_ns[np.maximum(index, 0)] > OLDEST_NS)
        return newest, int(np.count_nonzero(old))


def carrier_pose(sensor: SweepPoses, carried: SweepPoses) -> SweepPoses:
    """Return the poses of what carries a sensor, from those of the sensor and its places on what carries it."""
    turned_over = sensor.upside_down != carried.upside_down
    side = np.where(turned_over, -1.0, 1.0)
    yaw = sensor.yaw - side * carried.yaw
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = sensor.x - cos * carried.x + side * sin * carried.y
    y = sensor.y - sin * carried.x - side * cos * carried.y
    return SweepPoses(x, y, yaw, turned_over)


def velocity_of(velocity: Float64, place: SweepPoses, carried: SweepPoses) -> Float64:
    """Return the velocity (S, 3) of a frame in its own axes, from that of the robot that carries it.

    Parameters
    ----------
    place, carried : where the sensor is in the frame, and on the robot
    """
    frame = carrier_pose(carried, place)
    turning = velocity[:, 2]
    dx, dy = velocity[:, 0] - turning * frame.y, velocity[:, 1] + turning * frame.x
    cos, sin = np.cos(frame.yaw), np.sin(frame.yaw)
    # In a frame that hangs head down left is right.
    side = np.where(frame.upside_down, -1.0, 1.0)
    return np.column_stack([cos * dx + sin * dy, side * (cos * dy - sin * dx), side * turning])
