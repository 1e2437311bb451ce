"""What is level for the points of a sensor: where its frame leans, and how high it is, by the tree of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.slicing import Levelled
from lidarcli.poses.motion import Motion, compose, inverse, planar, rotate
from lidarcli.poses.rows import frame_name
from lidarcli.poses.tracks import Track
from lidarcli.poses.tree import WORLDS, FrameTree, Step, along
from lidarcli.sweeps import Bool, Float64, Int64

UPRIGHT = 0.5
"""Sweeps are in a frame whose z axis is within 60 degrees of the vertical: the cosine of that."""

_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""How a camera's optical frame, z ahead and y down, lies in a frame that is x ahead and z up (REP 103)."""


@dataclass(frozen=True, eq=False, slots=True)
class _Level:
    """How the points of one frame come to be level."""

    frame: str
    """Frame of the sweeps."""
    inward: tuple[Step, ...]
    """From the frame of the points to that of the sweeps."""
    base: tuple[Step, ...]
    """From there to the robot."""
    world: tuple[Step, ...] | None
    """From there to the world, where the log tells where that is."""
    words: str

    def at(self, stamp_ns: Int64, frame_id: str) -> Levelled:
        """For points of `frame_id` at times (K,)."""
        points = along(self.inward, stamp_ns, held=not _is_world(frame_name(frame_id)))
        base = along(self.base, stamp_ns, held=True)
        leaning, height = base.rotation, base.position[:, 2]
        if self.world is not None:
            world = along(self.world, stamp_ns)
            robot = compose(world, inverse(base))
            told = ~_unknown(world.rotation)
            leaning = np.where(told[:, None], world.rotation, leaning)
            height = np.where(told, world.position[:, 2] - robot.position[:, 2], height)
        level = _seen_from_above(leaning)
        offset = np.einsum("kij,kj->ki", level, points.position)
        offset[:, 2] += height
        name = self.frame if self.inward else frame_id
        return Levelled(name, level @ _matrices(points.rotation), offset)


@dataclass(slots=True)
class TreeLevels:
    """What the tree of frames of a log says of what is level, for each frame of points."""

    tracks: Sequence[Track]
    _tree: FrameTree = field(init=False)
    _found: dict[str, _Level | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Find the links."""
        self._tree = FrameTree([track for track in self.tracks if track.is_link])

    def of(self, frame_id: str, stamp_ns: Int64) -> Levelled | None:
        """For the points of one frame at times (K,); None where nothing tells."""
        frame = frame_name(frame_id)
        if frame not in self._found:
            self._found[frame] = self._level(frame, stamp_ns[:1])
        level = self._found[frame]
        if level is not None:
            return level.at(stamp_ns, frame_id)
        if not _is_optical(frame):
            return None
        count = len(stamp_ns)
        return Levelled(frame_id, np.broadcast_to(_OPTICAL, (count, 3, 3)), np.zeros((count, 3)))

    def words(self, frame_id: str) -> str:
        """What heights of the points of a frame count from, for people."""
        frame = frame_name(frame_id)
        level = self._found.get(frame)
        name = frame or "without a name"
        if level is not None:
            return level.words
        if _is_world(frame):
            return f"above the origin of frame {name}, which is no sensor's: sweeps are seen from there"
        if _is_optical(frame):
            return (
                f"above the camera of frame {name}, which is taken for level: no transform leads to the robot"
            )
        return f"along z of frame {name}, which is taken for level: no transform leads to the robot"

    def _level(self, frame: str, stamp_ns: Int64) -> _Level | None:
        base = self._tree.to_base(frame)
        robot = base[-1].target if base else frame
        if not base and self._tree.to_world(frame) is None:
            return None
        inward = base if _is_world(frame) else base[: self._inward(frame, base, stamp_ns)]
        here = inward[-1].target if inward else frame
        world = self._tree.to_world(here)
        topics = dict.fromkeys(step.track.topic for step in (*base, *(world or ())))
        return _Level(
            here, inward, base[len(inward) :], world, f"above {robot}, level by {' and '.join(topics)}"
        )

    def _inward(self, frame: str, base: tuple[Step, ...], stamp_ns: Int64) -> int:
        """How many steps lead to a frame whose z axis stands up: that of a camera's points looks ahead."""
        for count in range(len(base) + 1):
            world = self._tree.to_world(base[count - 1].target if count else frame)
            pose = along(base[count:], stamp_ns, held=True)
            if world is not None and not _unknown((told := along(world, stamp_ns)).rotation).any():
                pose = told
            if abs(_upward(pose)) >= UPRIGHT:
                return count
        return 0


def _is_world(frame: str) -> bool:
    return frame.rpartition("/")[2] in WORLDS


def _is_optical(frame: str) -> bool:
    return frame.endswith(("_optical_frame", "_optical"))


def _upward(pose: Motion) -> float:
    """The cosine between a frame's z axis and the vertical."""
    up = rotate(pose.rotation[:1], np.array([[0.0, 0.0, 1.0]]))
    return float(up[0, 2])


def _unknown(rotation: Float64) -> Bool:
    return np.asarray(np.isnan(rotation).any(axis=1))


def _seen_from_above(rotation: Float64) -> Float64:
    """(K, 3, 3) what takes points of leaning frames (K, 4) to where `planar` sees them: x ahead, y to the left, z up.

    A frame that hangs head down keeps its own left, as its poses do.
    """
    matrices = _matrices(rotation)
    seen = planar(Motion(np.zeros((len(rotation), 3)), rotation))
    cos, sin = np.cos(seen.yaw)[:, None], np.sin(seen.yaw)[:, None]
    side = np.where(seen.upside_down, -1.0, 1.0)[:, None]
    ahead, left = matrices[:, 0], matrices[:, 1]
    return np.stack([cos * ahead + sin * left, side * (cos * left - sin * ahead), matrices[:, 2]], axis=1)


def _matrices(rotation: Float64) -> Float64:
    """(K, 3, 3) rotations as matrices; of those that hardly turn nothing is left of rounding."""
    axes = [rotate(rotation, np.tile(axis, (len(rotation), 1))) for axis in np.eye(3)]
    found: Float64 = np.stack(axes, axis=2)
    found[np.abs(found) < _NOTHING] = 0.0
    found[np.abs(found - 1.0) < _NOTHING] = 1.0
    return found


_NOTHING = 1e-12
