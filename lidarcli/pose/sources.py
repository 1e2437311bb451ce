"""Choice of the source of poses for each sensor frame."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from lidarcli.logs.clouds import Levelled
from lidarcli.pose.tracks import (
    ODOMETRY,
    SECOND_NS,
    TRANSFORMS,
    UPRIGHT,
    WITH_COVARIANCE,
    Motion,
    Track,
    compose,
    frame_name,
    inverse,
    planar,
    rotate,
)
from lidarcli.ros.foxglove import SCAN
from lidarcli.sweeps.finding_rules import APART
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepPoses

_OF_ROBOT = re.compile(
    "ego|self|robot|base|vehicle|car|current|local|locali[sz]ation|localizer|amcl|slam|tracked|odom|odometry|"
    "sensor|laser|lidar|scan"
)
"""Words in the name of a topic that make its poses those of the robot."""
_OF_OTHERS = re.compile(
    "goals?|initial|initialpose|targets?|waypoints?|cmd|command|setpoint|desired|reference|plan|planned|clicked|"
    "marker|tag|object"
)
"""Words in the name of a topic that make its poses those of something else."""

_FARTHEST_NS = np.iinfo(np.int64).max - 2_000_000_000
"""Farthest start of a sweep for which the end fits into a stamp, either side of 0 [ns]."""


@dataclass(frozen=True, eq=False, slots=True)
class Correction:
    """Difference between given poses and those that fit the sweeps."""

    delay_ns: int = 0
    """The pose of a time is the given one this much later [ns]."""
    mount: Motion | None = None
    """Pose of the sensor in the frame that the poses tell of (N = 1); None where that is the sensor's own."""
    gaps: Int64 = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    """(G, 2) stamps between which poses are not known [ns]: the last before each gap, and the first after it."""
    laid: Motion | None = None
    """Pose of the world of the path in the one in which it is wanted (N = 1); None where it is that."""

    def at(self, steps: Sequence[Step], stamp_ns: Int64) -> Motion:
        """Return the corrected poses at times (S,), NaN where they are not known."""
        at_ns = later(stamp_ns, self.delay_ns)
        found = along(steps, at_ns)
        if self.mount is not None:
            found = compose(found, self.mount)
        if self.laid is not None:
            found = compose(self.laid, found)
        if len(self.gaps):
            after = np.minimum(np.searchsorted(self.gaps[:, 1], at_ns, "right"), len(self.gaps) - 1)
            inside = (at_ns > self.gaps[after, 0]) & (at_ns < self.gaps[after, 1])
            found.position[inside], found.rotation[inside] = np.nan, np.nan
        return found

    def after(self, other: Correction | None) -> Correction:
        """Return this correction of poses that another one has delayed."""
        return self if other is None else replace(self, delay_ns=self.delay_ns + other.delay_ns)


def later(stamp_ns: Int64, delay_ns: int | Int64) -> Int64:
    """Add delays [ns] to stamps (N,) [ns], limited to the range of int64."""
    most = np.iinfo(np.int64).max - np.abs(delay_ns)
    moved: Int64 = np.clip(stamp_ns, -most, most) + delay_ns
    return moved


@dataclass(frozen=True, eq=False, slots=True)
class PoseChain:
    """A chain of transforms from one sensor frame to the world."""

    topics: tuple[str, ...]
    """The topic that decides, then those that help."""
    frame: str
    """The sensor's frame."""
    world: str
    """The fixed frame; where the log has sensors of several namespaces, with its own one before it."""
    steps: tuple[Step, ...]
    """Steps from the sensor to the world."""
    correction: Correction | None = None
    """Correction that makes the given poses fit the sweeps."""
    assumption: str = ""
    """Assumption in words; empty without one."""

    @property
    def frames(self) -> str:
        """The frames from the world to the sensor, without those that no message names."""
        frames = [self.frame, *(step.target for step in self.steps)]
        return " > ".join(name for name in reversed(frames) if name)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """The stamps between which every moving link is known; None where nothing moves."""
        spans = [step.track.span_ns for step in self.steps if not step.track.static]
        return (max(first for first, _ in spans), min(last for _, last in spans)) if spans else None

    @property
    def record_ns(self) -> tuple[int, int]:
        """First and last record time of what decides."""
        moving = [step.track for step in self.steps if not step.track.static] or [self.steps[0].track]
        return max(track.record_ns[0] for track in moving), min(track.record_ns[1] for track in moving)

    def recorded_delay_ns(self, stamps: tuple[int, int], records: tuple[int, int]) -> int:
        """Return by how much poses of another clock are later than the sweeps, by record times [ns]; 0 where none tell.

        `stamps`, `records`: the first and last of the sweeps [ns].
        """
        span, own = self.span_ns, self.record_ns
        if span is None or span[1] <= span[0] or own[1] < records[0] or records[1] < own[0]:
            return 0
        ends = [[record - stamp for record, stamp in zip(*each, strict=True)] for each in ((own, span), (records, stamps))]
        delay_ns = (sum(ends[1]) - sum(ends[0])) // 2
        is_steady = all(abs(last - first) <= SECOND_NS for first, last in ends)
        if not is_steady or abs(delay_ns) <= APART * SECOND_NS:
            return 0
        return delay_ns - (0 if self.correction is None else self.correction.delay_ns)

    def at(self, stamp_ns: Int64) -> Motion:
        """Return the pose of the sensor in the world at each time (S,), NaN outside the span of any moving link."""
        if self.correction is not None:
            return self.correction.at(self.steps, stamp_ns)
        return along(self.steps, stamp_ns)

    def going(self, here: SweepPoses, at_ns: Int64, lasts_ns: Int64 | None) -> SweepPoses:
        """Return the poses `here` at `at_ns` (S,) with the motion of the sensor in the time after each.

        `lasts_ns`: (S,) how long, None for no time. Where nobody knows how it goes on, it stands.
        """
        if lasts_ns is None:
            return here
        at_ns = np.clip(at_ns, -_FARTHEST_NS, _FARTHEST_NS)
        chain = _between(here, planar(self.at(at_ns + lasts_ns)))
        # Where there is one pose per sweep, the last one is that at its start: then it goes on as it came.
        if (span := self.span_ns) is not None and (late := at_ns + lasts_ns > span[1]).any():
            chain[late] = _between(planar(self.at(at_ns - lasts_ns)), here)[late]
        chain[np.isnan(chain).any(axis=1)] = 0.0
        return replace(here, way=chain)


def _between(start: SweepPoses, end: SweepPoses) -> Float64:
    """Return (S, 3) the motion from one pose to another in x, y [m] and, by the shorter arc, in yaw [rad]."""
    turn = (end.yaw - start.yaw + np.pi) % TURN - np.pi
    return np.column_stack([end.x - start.x, end.y - start.y, turn])


@dataclass(frozen=True, eq=False, slots=True)
class GivenPaths:
    """Given paths of sensors, instead of all poses of a log; each names the frame of its sensor, or none for any."""

    tracks: tuple[Track, ...]
    gaps: Int64 = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    """(G, 2) stamps between which no pose is known, as of `Correction`."""

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics of the poses."""
        return tuple(dict.fromkeys(track.topic for track in self.tracks))

    def chains(self, frame_id: str, topic: str = "") -> list[PoseChain]:
        """Return the path of a sensor frame, if there is one."""
        chain = self.chain(frame_id, topic)
        return [] if chain is None else [chain]

    def chain(self, frame_id: str, topic: str = "") -> PoseChain | None:
        """Return the path of a sensor frame."""
        frame = frame_name(frame_id)
        correction = Correction(gaps=self.gaps) if len(self.gaps) else None
        for track in self.tracks:
            if frame_name(track.child) in ("", frame):
                return PoseChain((track.topic,), frame, track.parent, (Step(track, down=False),), correction=correction)
        return None

    def alternatives(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return nothing: what was asked for is taken."""
        return ()

    def alike(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return nothing."""
        return ()


WENT = 0.3
"""A sensor has moved that is so far from where it was [m, rad]: the poses of one that stands may be corrected."""


def went(sources: PoseSources | GivenPaths, topic: str, frame: str, since_ns: Int64, stamp_ns: Int64) -> Bool:
    """Return whether the sensor of a topic and frame has gone from some stamps to others (S,) [ns], as poses tell."""
    if (chain := sources.chain(frame, topic)) is None:
        return np.zeros(len(stamp_ns), np.bool_)
    way = _between(*(planar(chain.at(each)) for each in (since_ns, stamp_ns)))
    with np.errstate(invalid="ignore"):
        gone: Bool = (np.hypot(way[:, 0], way[:, 1]) > WENT) | (np.abs(way[:, 2]) > WENT)
    return gone


class PoseSources:
    """The tracks of a log, and the choice among them for each sensor: the frame of the sweeps of a topic.

    In the order of preference: the tree of frames where it leads to a fixed frame, Odometry,
    PoseWithCovarianceStamped, and poses whose topic has the name of a robot's. Of several topics that are alike none is
    taken unasked: they may be those of several robots. Poses in the namespace of the sweeps come first.
    """

    def __init__(
        self, tracks: Sequence[Track], wanted: str | None = None, scans: Collection[str] = (), *, on_map: bool = False
    ) -> None:
        """`wanted`: topic of the poses that the user chose; `scans`: all topics of the log with sweeps; `on_map`: the one
        chain by which the robot knew where it was on its map is chosen, if there is one.
        """
        self.tracks = tuple(tracks)
        self._wanted, self._on_map = wanted, on_map
        self._scans = tuple(scans)
        self._trees: dict[str, FrameTree] = {}
        self._ways: dict[tuple[str, str], tuple[PoseChain | None, tuple[str, ...], tuple[str, ...]]] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics with poses."""
        return tuple(dict.fromkeys(track.topic for track in self.tracks))

    def localised(self, frame_id: str, topic: str = "") -> PoseChain | None:
        """Return the chain by which the robot knew where the sensor was on its map; None where the log tells none."""
        chain = PoseSources(self.tracks, None, self._scans, on_map=True).chain(frame_id, topic)
        return chain if chain is not None and _last(chain.world) == MAP else None

    def chain(self, frame_id: str, topic: str = "") -> PoseChain | None:
        """Return the chosen chain for the sensor frame of a topic; None without a source."""
        return self._choice(frame_id, topic)[0]

    def chains(self, frame_id: str, topic: str = "") -> list[PoseChain]:
        """Return the chosen chain, then those to the other fixed frames of the tree and by the other topics."""
        chosen = self.chain(frame_id, topic)
        if chosen is None or self._wanted is not None or self._on_map:
            return [] if chosen is None else [chosen]
        tree = self._tree(topic)
        frame = tree.sensor(frame_name(frame_id))
        found = [chosen]
        for world in tree.worlds:
            steps = tree.path(frame, world)
            if steps and world != chosen.steps[-1].target and any(not step.track.static for step in steps):
                found.append(_by_steps(frame, self._world(steps[-1], topic), steps))
        for name in self.alternatives(frame_id, topic):
            found += self._of_topic(frame, topic, name)
        return found

    def alternatives(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return topics that could be chosen instead."""
        return self._choice(frame_id, topic)[1]

    def alike(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return equally likely topics, of which none is chosen without being asked for."""
        return self._choice(frame_id, topic)[2]

    def _choice(self, frame_id: str, topic: str) -> tuple[PoseChain | None, tuple[str, ...], tuple[str, ...]]:
        key = frame_id, topic
        if key not in self._ways:
            frame = self._tree(topic).sensor(frame_name(frame_id))
            alike: tuple[str, ...] = ()
            if self._wanted is None:
                chosen, alike = self._unasked(frame, topic)
                if self._on_map and (chosen is None or _last(chosen.world) != MAP):
                    found = self._unasked(frame, topic, MAP)
                    chosen, alike = found if any(found) else (chosen, alike)
            else:
                chosen = next(iter(self._of_topic(frame, topic, self._wanted)), None)
            used = {*chosen.topics} if chosen else {*alike}
            near = (name for name in self.topics if nearness(name, topic, self._scans) is not None)
            others = tuple(name for name in near if name not in used and self._of_topic(frame, topic, name))
            self._ways[key] = chosen, others, alike
        return self._ways[key]

    def _tree(self, topic: str) -> FrameTree:
        """Return the tree of frames for the sweeps of a topic."""
        if topic not in self._trees:
            self._trees[topic] = FrameTree([track for track in self.tracks if track.is_link], topic, self._scans)
        return self._trees[topic]

    def _unasked(self, frame: str, topic: str, world: str = "") -> tuple[PoseChain | None, tuple[str, ...]]:
        """Return the chain to take unasked; none, and the topics, where several are alike; `world`: no tree, but this."""
        if not world and (chain := self._by_tree(frame, topic, self._tree(topic))) is not None:
            return chain, ()
        found = []
        for track in self.tracks:
            rank, near = None if track.is_link else _rank(track), nearness(track.topic, topic, self._scans)
            if rank is not None and near is not None and world in ("", _last(track.parent)):
                chain = self._by_track(frame, topic, track)
                mountless = bool(chain.assumption) and track.type == ODOMETRY
                found.append(((-near, rank[0], mountless, rank), -track.messages, track.topic, track, chain))
        if not found:
            return None, ()
        found.sort(key=lambda one: one[:3])
        best = [one for one in found if one[0] == found[0][0]]
        alike = _alike([track for *_, track, _ in best]) if best[0][-1].assumption else ()
        if not alike:
            return best[0][-1], ()
        # Those with the prefix of the sensor's frame in their topic or frame: robot_1/laser, /robot_1.
        prefix = f"{frame.rpartition('/')[0]}/"
        mine = [
            (track.topic, chain)
            for *_, track, chain in best
            if prefix != "/" and any(f"{name}/".startswith(prefix) for name in (track.topic.strip("/"), track.child))
        ]
        if len({topic for topic, _ in mine}) == 1:
            return mine[0][1], ()
        return None, alike

    def _of_topic(self, frame: str, topic: str, wanted: str) -> list[PoseChain]:
        """Return the chain by one topic of poses, whatever its name; none if it leads to no fixed frame."""
        name = wanted.strip("/")
        mine = [track for track in self.tracks if track.topic.strip("/") == name]
        if any(track.is_link for track in mine):
            if all(track.static for track in mine):
                return []  # what only mounts something is no source of its own
            links = [
                one
                for one in self.tracks
                if one.is_link and (one.static or one.type == SCAN or one.topic.strip("/") == name)
            ]
            # What mounts the sensor is in the namespace of these poses, or else of its sweeps.
            trees = (FrameTree(links, near, self._scans) for near in (wanted, topic))
            chains = (self._by_tree(frame, topic, tree) for tree in trees)
            return [chain for chain in chains if chain is not None][:1]
        mine.sort(key=lambda track: (frame_name(track.child) != frame, -track.messages))
        return [self._by_track(frame, topic, track) for track in mine[:1]]

    def _world(self, last: Step, topic: str) -> str:
        """Return the name of the fixed frame to which the last step of a chain leads."""
        space = namespace(last.track.topic)
        alone = all(is_within(scan, space) for scan in self._scans)
        if alone or not is_within(topic, space) or last.target.startswith(f"{space}/"):
            return last.target
        return f"{space}/{last.target}"

    def _by_tree(self, frame: str, topic: str, tree: FrameTree) -> PoseChain | None:
        steps = tree.to_world(frame)
        return _by_steps(frame, self._world(steps[-1], topic), steps) if steps else None

    def _by_track(self, frame: str, topic: str, track: Track) -> PoseChain:
        """Return poses of the robot, with the sensor where the tree says it is mounted, else where the robot is."""
        last = Step(track, down=False)
        world = self._world(last, topic)
        if track.child:
            mount = self._tree(topic).path(frame, track.child, avoid={track.parent})
            if mount is not None:
                helping = dict.fromkeys(step.track.topic for step in mount)
                return PoseChain((track.topic, *helping), frame, world, (*mount, last))
        elif self._on_map and (mount := self._tree(topic).to_base(frame)):
            return PoseChain((track.topic,), frame, world, (*mount, last))
        taken = f"the sensor {frame or 'without a frame name'} is taken to be at "
        taken += f"{track.child}: {MOUNTLESS}" if track.child else "the pose itself"
        return PoseChain((track.topic,), frame, world, (last,), assumption=taken)


def _by_steps(frame: str, world: str, steps: tuple[Step, ...]) -> PoseChain:
    """Return the chain that steps make, named by the topics of those that move, then of the others."""
    moving = [step.track.topic for step in reversed(steps) if not step.track.static]
    return PoseChain(tuple(dict.fromkeys(moving + [step.track.topic for step in steps])), frame, world, steps)


def _alike(tracks: Sequence[Track]) -> tuple[str, ...]:
    """Return the topics of equally likely sources that may belong to several robots; else empty."""
    publishers = {(track.topic, track.child if track.type == ODOMETRY else track.topic) for track in tracks}
    robots = {robot for _, robot in publishers}
    topics = tuple(sorted({topic for topic, _ in publishers}))
    return topics if len(robots) > 1 and len(topics) > 1 else ()


def _rank(track: Track) -> tuple[int, int] | None:
    """Rank a source by how likely it tells the pose of the robot, best first; None if it must be asked for."""
    words = [word for word in re.split(r"[/_\-.]+", track.topic.lower()) if word]
    if any(map(_OF_OTHERS.fullmatch, words)):
        return None
    like_a_robot = any(map(_OF_ROBOT.fullmatch, words))
    if track.type == ODOMETRY:
        return 0, 0 if words[-1:] == ["odom"] else 1
    if track.type == WITH_COVARIANCE:
        return 1, 0 if like_a_robot else 1
    if track.type in TRANSFORMS:
        return None
    if like_a_robot:
        return 2, 0
    return (2, 1) if track.topic.rpartition("/")[2] == "pose" else None


# The tree of frames: which links lead from one frame to another, and what is level for the points of a sensor.

MOUNTLESS = "its mount is not in the log"
"""End of an assumption on where the sensor is on its robot."""
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

    track: Track
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


def along(steps: Sequence[Step], stamp_ns: Int64, *, held: bool = False) -> Motion:
    """Return the pose of the frame that the steps begin at in the one that they lead to, at each time (S,).

    NaN outside the span of any link that moves; `held`: there its first or last pose, as a mount stays where it is.
    """
    count = len(stamp_ns)
    pose = Motion(np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    for track, down in steps:
        link = track.at(np.clip(stamp_ns, *track.span_ns) if held else stamp_ns)
        pose = compose(inverse(link) if down else link, pose)
    return pose


def namespace(topic: str) -> str:
    """Return the namespace of a topic: its name without the last word, such as robot1/front of /robot1/front/scan."""
    return topic.strip("/").rpartition("/")[0]


def is_within(topic: str, space: str) -> bool:
    """Tell whether a topic is in a namespace, or in one below it."""
    return not space or f"{namespace(topic)}/".startswith(f"{space}/")


def nearness(poses: str, topic: str, scans: Collection[str] = ()) -> int | None:
    """Return how near the namespace of a topic of poses is to that of some sweeps: 0 if it does not enclose them.

    None where these poses are of other sensors: their namespace has sweeps of its own, of those of the log (`scans`).
    """
    space = namespace(poses)
    if is_within(topic, space):
        return len(space)
    return None if topic and any(is_within(scan, space) for scan in scans) else 0


def by_precedence(links: Sequence[Track]) -> list[Track]:
    """Return links in the order in which they count: static ones first, the last told before others, then the longest."""
    static = [one for one in reversed(links) if one.static]
    static.sort(key=lambda one: -one.record_ns[1])
    return static + sorted((one for one in links if not one.static), key=lambda one: -one.messages)


class FrameTree:
    """The links of a log, both ways, as the sweeps of a topic see them.

    Robots may have the same names for their frames. So what a nearer namespace tells of a frame counts alone.
    """

    def __init__(self, links: Sequence[Track], topic: str = "", scans: Collection[str] = ()) -> None:
        self._own = f"/{topic.strip('/')}"
        self._near: dict[str, dict[str, Step]] = {}
        self._parent: dict[str, Track] = {}
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
        """Join an optical frame whose x-y plane is upright to the level one that looks ahead: no sweep is seen upright."""
        if steps := self.to_base(frame):
            first = steps[0].track
            x, y = along(steps, first.stamp_ns[:1], held=True).rotation[0, :2]
            if abs(1.0 - 2.0 * (x * x + y * y)) < UPRIGHT:
                still = replace(first, static=True, differs=False, stamp_ns=first.stamp_ns[:1])
                link = replace(still, parent=frame, child=frame + LEVEL, motion=Motion(np.zeros((1, 3)), _AHEAD))
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
        return _way(reached, target) if target in reached else None

    def to_world(self, start: str) -> tuple[Step, ...] | None:
        """Return the chain to the best fixed frame: `WORLDS` in their order, else the root of the tree; None without one.

        The root counts only if something on the way to it moves and it is not the robot itself (base_link): a tree that
        ends at the robot says nothing of the world.
        """
        if _last(start) in WORLDS:
            return None
        reached = self._reached(start)
        if (world := _named(reached, WORLDS)) is not None:
            return _way(reached, world)
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
            return _way(reached, base)
        if in_world:
            moving = _moving(reached)
            return _way(reached, moving[0]) if len(moving) == 1 else ()
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


def _way(reached: Mapping[str, Step | None], target: str) -> tuple[Step, ...]:
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

    tracks: Sequence[Track]
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
    above = planar(Motion(np.zeros((len(rotation), 3)), rotation))
    cos, sin = np.cos(above.yaw)[:, None], np.sin(above.yaw)[:, None]
    side = np.where(above.upside_down, -1.0, 1.0)[:, None]
    ahead, left = matrices[:, 0], matrices[:, 1]
    return np.stack([cos * ahead + sin * left, side * (cos * left - sin * ahead), matrices[:, 2]], axis=1)


def _matrices(rotation: Float64) -> Float64:
    """Return (K, 3, 3) rotations as matrices; of those that hardly turn nothing is left of rounding."""
    axes = [rotate(rotation, np.tile(axis, (len(rotation), 1))) for axis in np.eye(3)]
    found: Float64 = np.stack(axes, axis=2)
    found[np.abs(found) < _NOTHING] = 0.0
    found[np.abs(found - 1.0) < _NOTHING] = 1.0
    return found


_NOTHING = 1e-12
