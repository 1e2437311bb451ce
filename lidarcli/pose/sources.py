"""Choice of the source of poses for each sensor frame."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lidarcli.foxglove import SCAN
from lidarcli.pose.messages import ODOMETRY, TRANSFORMS, WITH_COVARIANCE, frame_name
from lidarcli.pose.tracks import Motion, Track, compose, planar
from lidarcli.pose.tree import FrameTree, Step, along, is_within, namespace, nearness
from lidarcli.sweeps import TURN, Float64, Int64, SweepPoses

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
    """Difference between the poses that are told and those that fit the sweeps."""

    delay_ns: int = 0
    """The pose of a time is the one that is told this much later [ns]."""
    mount: Motion | None = None
    """Pose of the sensor in the frame that the poses tell of (N = 1); None where that is the sensor's own."""
    gaps: Int64 = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    """(G, 2) stamps between which poses jump or are not known [ns]: the last before each gap, and the first after it."""
    moves: Motion | None = None
    """G + 1 motions of the world, one for each part between gaps, that join the parts, NaN where they cannot be joined;
    None where they are joined."""

    def at(self, steps: Sequence[Step], stamp_ns: Int64) -> Motion:
        """Return the corrected poses at times (S,), NaN where they are not known."""
        at_ns = later(stamp_ns, self.delay_ns)
        found = along(steps, at_ns)
        if self.mount is not None:
            found = compose(found, self.mount)
        if len(self.gaps):
            part = np.searchsorted(self.gaps[:, 1], at_ns, "right")
            if self.moves is not None:
                found = compose(Motion(self.moves.position[part], self.moves.rotation[part]), found)
            after = np.minimum(part, len(self.gaps) - 1)
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
class Way:
    """A way to the pose of one sensor frame in the world."""

    topics: tuple[str, ...]
    """The topic that decides, then those that help."""
    frame: str
    """The sensor's frame."""
    world: str
    """The fixed frame; where the log has sensors of several namespaces, with its own one before it."""
    steps: tuple[Step, ...]
    """Steps from the sensor to the world."""
    correction: Correction | None = None
    """Correction that makes the told poses fit the sweeps."""
    assumption: str = ""
    """Assumption in words; empty without one."""

    @property
    def chain(self) -> str:
        """The frames from the world to the sensor.

        Frames that no message names are left out.
        """
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
        way = _between(here, planar(self.at(at_ns + lasts_ns)))
        # Where poses are told once in a sweep, the last one is that at its start: then it goes on as it came.
        if (span := self.span_ns) is not None and (late := at_ns + lasts_ns > span[1]).any():
            way[late] = _between(planar(self.at(at_ns - lasts_ns)), here)[late]
        way[np.isnan(way).any(axis=1)] = 0.0
        return replace(here, way=way)


def _between(start: SweepPoses, end: SweepPoses) -> Float64:
    """Return (S, 3) the way from one pose to another in x, y [m] and, by the shorter arc, in yaw [rad]."""
    turn = (end.yaw - start.yaw + np.pi) % TURN - np.pi
    return np.column_stack([end.x - start.x, end.y - start.y, turn])


@dataclass(frozen=True, eq=False, slots=True)
class GivenPaths:
    """Given paths of sensors, instead of all poses of a log; each names the frame of its sensor, or none for any."""

    tracks: tuple[Track, ...]

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics of the poses."""
        return tuple(dict.fromkeys(track.topic for track in self.tracks))

    def way(self, frame_id: str, topic: str = "") -> Way | None:
        """Return the path of a sensor frame."""
        frame = frame_name(frame_id)
        for track in self.tracks:
            if frame_name(track.child) in ("", frame):
                return Way((track.topic,), frame, track.parent, (Step(track, down=False),))
        return None

    def alternatives(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return nothing: what was asked for is taken."""
        return ()

    def alike(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return nothing."""
        return ()


class PoseSources:
    """The tracks of a log, and the choice among them for each sensor: the frame of the sweeps of a topic.

    In the order of preference: the tree of frames where it leads to a fixed frame, Odometry,
    PoseWithCovarianceStamped, and poses whose topic has the name of a robot's. Of several topics that are alike none is
    taken unasked: they may be those of several robots. Poses in the namespace of the sweeps come first.
    """

    def __init__(self, tracks: Sequence[Track], wanted: str | None = None, scans: Collection[str] = ()) -> None:
        """`wanted`: topic of the poses that the user chose; `scans`: all topics of the log with sweeps."""
        self.tracks = tuple(tracks)
        self._wanted = wanted
        self._scans = tuple(scans)
        self._trees: dict[str, FrameTree] = {}
        self._ways: dict[tuple[str, str], tuple[Way | None, tuple[str, ...], tuple[str, ...]]] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics with poses."""
        return tuple(dict.fromkeys(track.topic for track in self.tracks))

    def way(self, frame_id: str, topic: str = "") -> Way | None:
        """Return the chosen way for the sensor frame of a topic; None where no source tells."""
        return self._choice(frame_id, topic)[0]

    def alternatives(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return topics that could be chosen instead."""
        return self._choice(frame_id, topic)[1]

    def alike(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return equally likely topics, of which none is chosen without being asked for."""
        return self._choice(frame_id, topic)[2]

    def _choice(self, frame_id: str, topic: str) -> tuple[Way | None, tuple[str, ...], tuple[str, ...]]:
        key = frame_id, topic
        if key not in self._ways:
            frame = self._tree(topic).sensor(frame_name(frame_id))
            alike: tuple[str, ...] = ()
            if self._wanted is None:
                chosen, alike = self._unasked(frame, topic)
            else:
                chosen = next(iter(self._told(frame, topic, self._wanted)), None)
            used = {*chosen.topics} if chosen else {*alike}
            near = (told for told in self.topics if nearness(told, topic, self._scans) is not None)
            others = tuple(told for told in near if told not in used and self._told(frame, topic, told))
            self._ways[key] = chosen, others, alike
        return self._ways[key]

    def _tree(self, topic: str) -> FrameTree:
        """Return the tree of frames for the sweeps of a topic."""
        if topic not in self._trees:
            links = [track for track in self.tracks if track.is_link]
            self._trees[topic] = FrameTree(links, topic, self._scans)
        return self._trees[topic]

    def _unasked(self, frame: str, topic: str) -> tuple[Way | None, tuple[str, ...]]:
        """Return the way chosen without being asked; none, and the topics, where several are alike."""
        if (way := self._by_tree(frame, topic, self._tree(topic))) is not None:
            return way, ()
        found = []
        for track in self.tracks:
            rank, near = None if track.is_link else _rank(track), nearness(track.topic, topic, self._scans)
            if rank is not None and near is not None:
                way = self._by_track(frame, topic, track)
                mountless = bool(way.assumption) and track.type == ODOMETRY
                found.append(((-near, rank[0], mountless, rank), -track.messages, track.topic, track, way))
        if not found:
            return None, ()
        found.sort(key=lambda one: one[:3])
        best = [one for one in found if one[0] == found[0][0]]
        alike = _alike([track for *_, track, _ in best]) if best[0][-1].assumption else ()
        if not alike:
            return best[0][-1], ()
        mine = [(track.topic, way) for *_, track, way in best if _same_robot(frame, track)]
        if len({topic for topic, _ in mine}) == 1:
            return mine[0][1], ()
        return None, alike

    def _told(self, frame: str, topic: str, told: str) -> list[Way]:
        """Return the way by one topic of poses, whatever its name; none if it leads to no fixed frame."""
        name = told.strip("/")
        mine = [track for track in self.tracks if track.topic.strip("/") == name]
        if any(track.is_link for track in mine):
            if all(track.static for track in mine):
                return []  # what only mounts something is no source of its own
            links = [
                one
                for one in self.tracks
                if one.is_link and (one.static or one.type == SCAN or one.topic.strip("/") == name)
            ]
            # What mounts the sensor is beside these poses, or else beside its sweeps.
            trees = (FrameTree(links, near, self._scans) for near in (told, topic))
            ways = (self._by_tree(frame, topic, tree) for tree in trees)
            return [way for way in ways if way is not None][:1]
        mine.sort(key=lambda track: (frame_name(track.child) != frame, -track.messages))
        return [self._by_track(frame, topic, track) for track in mine[:1]]

    def _world(self, last: Step, topic: str) -> str:
        """Return the name of the fixed frame to which the last step of a way leads."""
        space = namespace(last.track.topic)
        alone = all(is_within(scan, space) for scan in self._scans)
        if alone or not is_within(topic, space) or last.target.startswith(f"{space}/"):
            return last.target
        return f"{space}/{last.target}"

    def _by_tree(self, frame: str, topic: str, tree: FrameTree) -> Way | None:
        steps = tree.to_world(frame)
        if not steps:
            return None
        moving = [step.track.topic for step in reversed(steps) if not step.track.static]
        topics = tuple(dict.fromkeys(moving + [step.track.topic for step in steps]))
        return Way(topics, frame, self._world(steps[-1], topic), steps)

    def _by_track(self, frame: str, topic: str, track: Track) -> Way:
        """Return poses of the robot, with the sensor where the tree says it is mounted, else where the robot is."""
        last = Step(track, down=False)
        world = self._world(last, topic)
        if track.child:
            mount = self._tree(topic).path(frame, track.child, avoid={track.parent})
            if mount is not None:
                helping = dict.fromkeys(step.track.topic for step in mount)
                return Way((track.topic, *helping), frame, world, (*mount, last))
        taken = f"the sensor {frame or 'without a frame name'} is taken to be at "
        taken += f"{track.child}: its mount is not in the log" if track.child else "the pose itself"
        return Way((track.topic,), frame, world, (last,), assumption=taken)


def _alike(tracks: Sequence[Track]) -> tuple[str, ...]:
    """Return the topics of equally likely sources that may belong to several robots; else empty.

    Odometry of one child frame is of one robot, however many topics tell it.
    """
    told = {(track.topic, track.child if track.type == ODOMETRY else track.topic) for track in tracks}
    robots = {robot for _, robot in told}
    topics = tuple(sorted({topic for topic, _ in told}))
    return topics if len(robots) > 1 and len(topics) > 1 else ()


def _same_robot(frame: str, track: Track) -> bool:
    """Return True if the frame of the sensor has the prefix of the topic or its frame: robot_1/laser, /robot_1."""
    prefix = frame.rpartition("/")[0]
    names = (track.topic.strip("/"), track.child)
    return bool(prefix) and any(name == prefix or name.startswith(f"{prefix}/") for name in names)


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
