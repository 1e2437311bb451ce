"""The tree of frames: which links lead from one frame to another, and what is level for the points of a sensor."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from lidarcli.logs.clouds import Levelled
from lidarcli.pose.messages import frame_name
from lidarcli.pose.tracks import UPRIGHT, PoseMotion, PoseTrack, compose, inverse, planar, rotate
from lidarcli.sweeps.types import Bool, Float64, Int64

MAP = "map"
"""Name of the fixed frame of a map."""
WORLDS = (MAP, "odom", "world", "camera_init")
"""Names of fixed frames, the better one first; a prefix (robot_0/odom) does not matter."""
LEVEL = " (level)"
"""End of the name of a level frame that looks where an optical one does."""
_AHEAD = np.array([[0.5, -0.5, 0.5, 0.5]])
"""Rotation of such a frame in the optical one, whose z axis is ahead and y axis down (REP 103)."""
BASES = ("base_footprint", "base_link", "base")
"""Names of the frame of the robot itself, the one on the floor first."""


class Step(NamedTuple):
    """A link of a chain from a frame to another one."""

    track: PoseTrack
    down: bool
    """True for a step from the parent to the child, against the direction of the link."""

    @property
    def target(self) -> str:
        """The frame that the step leads to."""
        return self.track.child if self.down else self.track.parent

    @property
    def source(self) -> str:
        """The frame that the step comes from."""
        return self.track.parent if self.down else self.track.child


def along(steps: Sequence[Step], stamp_ns: Int64, *, held: bool = False) -> PoseMotion:
    """Return the pose of the frame that the steps begin at in the one that they lead to, at each time (S,).

    NaN outside the span of any link that moves; `held`: there its first or last pose, as a mount stays where it is.
    """
    count = len(stamp_ns)
    pose = PoseMotion(np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    for track, down in steps:
        link = track.at(np.clip(stamp_ns, *track.span_ns) if held else stamp_ns)
        pose = compose(inverse(link) if down else link, pose)
    return pose


def namespace(topic: str) -> str:
    """Return the namespace of a topic: its name without the last word, such as robot1/front of /robot1/front/scan."""
    return topic.strip("/").rpartition("/")[0]


def is_within(topic: str, space: str) -> bool:
    """Return whether a topic is in a namespace, or in one below it."""
    return not space or f"{namespace(topic)}/".startswith(f"{space}/")


def nearness(poses: str, topic: str, scans: Collection[str] = ()) -> int | None:
    """Return how near the namespace of a topic of poses is to that of some sweeps: 0 if it does not enclose them.

    None where these poses are of other sensors: their namespace has sweeps of its own, of those of the log (`scans`).
    """
    space = namespace(poses)
    if is_within(topic, space):
        return len(space)
    return None if topic and any(is_within(scan, space) for scan in scans) else 0


def by_precedence(links: Sequence[PoseTrack]) -> list[PoseTrack]:
    """Return links in the order in which they count: static ones first, the last one before others, then the longest."""
    static = [one for one in reversed(links) if one.static]
    static.sort(key=lambda one: -one.record_ns[1])
    return static + sorted((one for one in links if not one.static), key=lambda one: -one.messages)


class FrameTree:
    """The links of a log, both ways, as the sweeps of a topic see them.

    Robots may have the same names for their frames. So what a nearer namespace tells of a frame counts alone.
    """

    def __init__(self, links: Sequence[PoseTrack], topic: str = "", scans: Collection[str] = ()) -> None:
        self._own = f"/{topic.strip('/')}"
        self._near: dict[str, dict[str, Step]] = {}
        self._parent: dict[str, PoseTrack] = {}
        nearest: dict[str, int] = {}
        near = [(at, link) for link in by_precedence(links) if (at := nearness(link.topic, topic, scans)) is not None]
        joined = Counter(name for _, link in near for name in (link.parent, link.child))
        for at, track in sorted(near, key=lambda one: -one[0]):
            if track.parent == track.child or not track.parent or not track.child:
                continue
            if nearest.setdefault(track.child, at) != at:
                continue
            # A frame has one parent at a time, unless that is none of the tree.
            other = self._parent.get(track.child, track)
            if track.static and other.parent != track.parent and joined[other.parent] > 1:
                continue
            # Of two links that join the same frames the better one has come first.
            self._near.setdefault(track.child, {}).setdefault(track.parent, Step(track, down=False))
            self._near.setdefault(track.parent, {}).setdefault(track.child, Step(track, down=True))
            self._parent.setdefault(track.child, track)
        for frame in [name for name in self._near if _is_optical(name)]:
            self._level(frame)

    def _level(self, frame: str) -> None:
        """Join an optical frame whose x-y plane is upright to the level one that looks ahead: no sweep is shown upright."""
        if steps := self.to_base(frame):
            first = steps[0].track
            x, y = along(steps, first.stamp_ns[:1], held=True).rotation[0, :2]
            if abs(1.0 - 2.0 * (x * x + y * y)) < UPRIGHT:
                still = replace(first, static=True, differs=False, stamp_ns=first.stamp_ns[:1])
                link = replace(still, parent=frame, child=frame + LEVEL, motion=PoseMotion(np.zeros((1, 3)), _AHEAD))
                self._near[frame + LEVEL] = {frame: Step(link, down=False)}
                self._near[frame][frame + LEVEL] = Step(link, down=True)
                self._parent[frame + LEVEL] = link

    @property
    def frames(self) -> list[str]:
        """The frames that links join."""
        return [*self._near]

    def sensor(self, frame: str) -> str:
        """Return where the sweeps of the topic are that say this frame: in it, or where each says that it is in it.

        Those of an optical frame that is upright are in the level one.
        """
        if frame in self._near.get(self._own, {}):
            return self._own
        return frame + LEVEL if frame + LEVEL in self._near else frame

    def path(self, start: str, target: str, avoid: Collection[str] = ()) -> tuple[Step, ...] | None:
        """Return the shortest chain between two frames, empty if they are one; None if there is none."""
        reached = self._reached(start, avoid)
        return _steps_to(reached, target) if target in reached else None

    def to_world(self, start: str) -> tuple[Step, ...] | None:
        """Return the chain to the best fixed frame: `WORLDS` in their order, else the root of the tree; None without one.

        The root counts only if something on the way to it moves and it is not the robot itself (base_link): a tree that
        ends at the robot says nothing of the world.
        """
        if _last(start) in WORLDS:
            return None
        reached = self._reached(start)
        if (world := _named(reached, WORLDS)) is not None:
            return _steps_to(reached, world)
        climbed: list[Step] = []
        climbed_frames = {start}
        frame = start
        while (link := self._parent.get(frame)) is not None and link.parent not in climbed_frames:
            climbed.append(Step(link, down=False))
            frame = link.parent
            climbed_frames.add(frame)
        moves = any(not step.track.static for step in climbed)
        return tuple(climbed) if moves and not _last(frame).startswith("base") else None

    def to_base(self, start: str) -> tuple[Step, ...]:
        """Return the chain to the robot itself: to the best of `BASES`, else to the last frame that is fixed to `start`.

        From a fixed frame without one of these it leads to what moves there, unless several do.
        """
        in_world = _last(start) in WORLDS
        # Beyond a fixed frame there are other robots.
        reached = self._reached(start, () if in_world else self.worlds)
        if (base := _named(reached, BASES)) is not None:
            return _steps_to(reached, base)
        if in_world:
            moving = _moving(reached)
            return _steps_to(reached, moving[0]) if len(moving) == 1 else ()
        climbed: list[Step] = []
        frame = start
        while (link := self._parent.get(frame)) is not None and link.static and len(climbed) < len(reached):
            climbed.append(Step(link, down=False))
            frame = link.parent
        return tuple(climbed)

    @property
    def worlds(self) -> list[str]:
        """The fixed frames among them, by name."""
        return sorted(frame for frame in self._near if _last(frame) in WORLDS)

    def _reached(self, start: str, avoid: Collection[str] = ()) -> dict[str, Step | None]:
        """Return every frame that can be reached, the nearest first, with the step that leads to it."""
        found: dict[str, Step | None] = {start: None}
        waiting = deque([start])
        while waiting:
            for neighbour, step in self._near.get(waiting.popleft(), {}).items():
                if neighbour not in found and neighbour not in avoid:
                    found[neighbour] = step
                    waiting.append(neighbour)
        return found


def _steps_to(reached: Mapping[str, Step | None], target: str) -> tuple[Step, ...]:
    """Return the steps to a frame that can be reached, from the start on."""
    steps: list[Step] = []
    while (step := reached[target]) is not None:
        steps.append(step)
        target = step.source
    return tuple(reversed(steps))


def _moving(reached: Mapping[str, Step | None]) -> list[str]:
    """Return the frames that move in a fixed one and that no other moving thing carries; the nearest frames come first."""
    carried: set[str] = set()
    found = []
    for frame, step in reached.items():
        if step is None:
            continue
        if step.source in carried:
            carried.add(frame)
        elif not step.track.static and _last(frame) not in WORLDS:
            carried.add(frame)
            found += [frame] if step.down else []
    return found


def _named(frames: Iterable[str], names: Sequence[str]) -> str | None:
    """Return the frame that has the best of some names, whatever its prefix; the first of several."""
    known = [frame for frame in frames if _last(frame) in names]
    return min(known, key=lambda frame: names.index(_last(frame)), default=None)


def _last(frame: str) -> str:
    return frame.rpartition("/")[2]


_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of an optical frame (z ahead, y down) in a frame with x ahead and z up (REP 103)."""


@dataclass(frozen=True, eq=False, slots=True)
class _Level:
    """Leveling of the points of one frame."""

    frame: str
    """Frame of the sweeps."""
    inward: tuple[Step, ...]
    """Steps from the frame of the points to that of the sweeps."""
    base: tuple[Step, ...]
    """Steps from there to the robot."""
    world: tuple[Step, ...] | None
    """Steps from there to the world, if known."""
    words: str

    def at(self, stamp_ns: Int64, frame_id: str) -> Levelled:
        """Return the leveling of points of `frame_id` at times (K,)."""
        points = along(self.inward, stamp_ns, held=_last(frame_name(frame_id)) not in WORLDS)
        base = along(self.base, stamp_ns, held=True)
        leaning, height = base.rotation, base.position[:, 2]
        if self.world is not None:
            world = along(self.world, stamp_ns)
            robot = compose(world, inverse(base))
            known = ~_unknown(world.rotation)
            leaning = np.where(known[:, None], world.rotation, leaning)
            height = np.where(known, world.position[:, 2] - robot.position[:, 2], height)
        level = _seen_from_above(leaning)
        offset = np.einsum("kij,kj->ki", level, points.position)
        offset[:, 2] += height
        name = self.frame if self.inward else frame_id
        return Levelled(name, level @ _matrices(points.rotation), offset)


@dataclass(slots=True)
class TreeLevels:
    """Leveling by the tree of frames of a log, for each frame of the points of a topic."""

    tracks: Sequence[PoseTrack]
    topic: str = ""
    scans: Collection[str] = ()
    """Topics of sweeps and points of the log."""
    _tree: FrameTree = field(init=False)
    _found: dict[str, _Level | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Find the links."""
        self._tree = FrameTree([track for track in self.tracks if track.is_link], self.topic, self.scans)

    def of(self, frame_id: str, stamp_ns: Int64) -> Levelled | None:
        """Return the leveling of points of one frame at times (K,); None if unknown."""
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
        """Return what heights of the points of a frame are counted from, for people."""
        frame = frame_name(frame_id)
        level = self._found.get(frame)
        name = frame or "without a name"
        if level is not None:
            return level.words
        if _last(frame) in WORLDS:
            return f"above the origin of frame {name}, which is no sensor's: sweeps are seen from there"
        if _is_optical(frame):
            return f"above the camera of frame {name}, which is taken for level: no transform leads to the robot"
        return f"along z of frame {name}, which is taken for level: no transform leads to the robot"

    def _level(self, frame: str, stamp_ns: Int64) -> _Level | None:
        base = self._tree.to_base(frame)
        robot = base[-1].target if base else frame
        if not base and self._tree.to_world(frame) is None:
            return None
        inward = base if _last(frame) in WORLDS else base[: self._inward(frame, base, stamp_ns)]
        here = inward[-1].target if inward else frame
        world = self._tree.to_world(here)
        topics = dict.fromkeys(step.track.topic for step in (*base, *(world or ())))
        return _Level(here, inward, base[len(inward) :], world, f"above {robot}, level by {' and '.join(topics)}")

    def _inward(self, frame: str, base: tuple[Step, ...], stamp_ns: Int64) -> int:
        """Return the number of steps to a frame whose z axis stands up; a camera frame looks ahead."""
        for count in range(len(base) + 1):
            world = self._tree.to_world(base[count - 1].target if count else frame)
            pose = along(base[count:], stamp_ns, held=True)
            if world is not None and not _unknown((known := along(world, stamp_ns)).rotation).any():
                pose = known
            # The cosine between its z axis and the vertical.
            if abs(rotate(pose.rotation[:1], np.array([[0.0, 0.0, 1.0]]))[0, 2]) >= UPRIGHT:
                return count
        return 0


def _is_optical(frame: str) -> bool:
    return frame.endswith(("_optical_frame", "_optical"))


def _unknown(rotation: Float64) -> Bool:
    return np.asarray(np.isnan(rotation).any(axis=1))


def _seen_from_above(rotation: Float64) -> Float64:
    """Return (K, 3, 3) rotations from leaning frames (K, 4) to a level view: x ahead, y left, z up."""
    matrices = _matrices(rotation)
    above = planar(PoseMotion(np.zeros((len(rotation), 3)), rotation))
    cos, sin = np.cos(above.yaw)[:, None], np.sin(above.yaw)[:, None]
    side = np.where(above.upside_down, -1.0, 1.0)[:, None]
    ahead, left = matrices[:, 0], matrices[:, 1]
    return np.stack([cos * ahead + sin * left, side * (cos * left - sin * ahead), matrices[:, 2]], axis=1)


def _matrices(rotation: Float64) -> Float64:
    """Return (K, 3, 3) rotations as matrices; of those that hardly turn nothing is left of rounding."""
    axes = [rotate(rotation, np.tile(axis, (len(rotation), 1))) for axis in np.eye(3)]
    found: Float64 = np.stack(axes, axis=2)
    found[np.abs(found) < 1e-12] = 0.0
    found[np.abs(found - 1.0) < 1e-12] = 1.0
    return found
