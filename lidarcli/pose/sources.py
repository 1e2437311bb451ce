"""Choice of the source of poses for each sensor frame."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lidarcli.options.times import SECOND_NS
from lidarcli.pose.frames import MAP, FrameTree, Step, _last, along, is_within, namespace, nearness
from lidarcli.pose.messages import ODOMETRY, TRANSFORMS, WITH_COVARIANCE, frame_name
from lidarcli.pose.tracks import PoseMotion, PoseTrack, compose, planar
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
    mount: PoseMotion | None = None
    """Pose of the sensor in the frame that the poses are of (N = 1); None where that is the sensor's own."""
    gaps: Int64 = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    """(G, 2) stamps between which poses are not known [ns]: the last before each gap, and the first after it."""
    laid: PoseMotion | None = None
    """Pose of the world of the path in the one in which it is wanted (N = 1); None where it is that."""

    def at(self, steps: Sequence[Step], stamp_ns: Int64) -> PoseMotion:
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
        """Return by how much poses of another clock are later than the sweeps, by record times [ns]; 0 for none.

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

    def at(self, stamp_ns: Int64) -> PoseMotion:
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

    tracks: tuple[PoseTrack, ...]
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
        """Return nothing: there is no alternative."""
        return ()

    def alike(self, frame_id: str, topic: str = "") -> tuple[str, ...]:
        """Return nothing."""
        return ()


WENT = 0.3
"""A sensor has moved that is so far from where it was [m, rad]: the poses of one that is static may be corrected."""


def went(sources: PoseSources | GivenPaths, topic: str, frame: str, since_ns: Int64, stamp_ns: Int64) -> Bool:
    """Return whether the sensor of a topic and frame has gone from some stamps to others (S,) [ns], as poses say."""
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
    taken unless it is named: they may be those of several robots. Poses in the namespace of the sweeps come first.
    """

    def __init__(
        self, tracks: Sequence[PoseTrack], wanted: str | None = None, scans: Collection[str] = (), *, on_map: bool = False
    ) -> None:
        """`wanted`: topic of the poses that the user chose; `scans`: all topics of the log with sweeps; `on_map`: the one
        chain by which the robot knew where it was on its map is chosen, if there is one.
        """
        self.tracks = tuple(tracks)
        self._wanted, self._on_map = wanted, on_map
        self._scans = tuple(scans)
        self._trees: dict[str, FrameTree] = {}
        self._choices: dict[tuple[str, str], tuple[PoseChain | None, tuple[str, ...], tuple[str, ...]]] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics with poses."""
        return tuple(dict.fromkeys(track.topic for track in self.tracks))

    def localised(self, frame_id: str, topic: str = "") -> PoseChain | None:
        """Return the chain by which the robot knew where the sensor was on its map; None where the log gives none."""
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
        """Return equally likely topics, of which none is chosen unless it is named."""
        return self._choice(frame_id, topic)[2]

    def _choice(self, frame_id: str, topic: str) -> tuple[PoseChain | None, tuple[str, ...], tuple[str, ...]]:
        key = frame_id, topic
        if key not in self._choices:
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
            self._choices[key] = chosen, others, alike
        return self._choices[key]

    def _tree(self, topic: str) -> FrameTree:
        """Return the tree of frames for the sweeps of a topic."""
        if topic not in self._trees:
            self._trees[topic] = FrameTree([track for track in self.tracks if track.is_link], topic, self._scans)
        return self._trees[topic]

    def _unasked(self, frame: str, topic: str, world: str = "") -> tuple[PoseChain | None, tuple[str, ...]]:
        """Return the chain where none is named; none, and the topics, where several are alike; `world`: this alone."""
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
        own = [
            (track.topic, chain)
            for *_, track, chain in best
            if prefix != "/" and any(f"{name}/".startswith(prefix) for name in (track.topic.strip("/"), track.child))
        ]
        if len({topic for topic, _ in own}) == 1:
            return own[0][1], ()
        return None, alike

    def _of_topic(self, frame: str, topic: str, wanted: str) -> list[PoseChain]:
        """Return the chain by one topic of poses, whatever its name; none if it leads to no fixed frame."""
        name = wanted.strip("/")
        own = [track for track in self.tracks if track.topic.strip("/") == name]
        if any(track.is_link for track in own):
            if all(track.static for track in own):
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
        own.sort(key=lambda track: (frame_name(track.child) != frame, -track.messages))
        return [self._by_track(frame, topic, track) for track in own[:1]]

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

    def _by_track(self, frame: str, topic: str, track: PoseTrack) -> PoseChain:
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


def _alike(tracks: Sequence[PoseTrack]) -> tuple[str, ...]:
    """Return the topics of equally likely sources that may belong to several robots; else empty."""
    publishers = {(track.topic, track.child if track.type == ODOMETRY else track.topic) for track in tracks}
    robots = {robot for _, robot in publishers}
    topics = tuple(sorted({topic for topic, _ in publishers}))
    return topics if len(robots) > 1 and len(topics) > 1 else ()


def _rank(track: PoseTrack) -> tuple[int, int] | None:
    """Rank a source by how likely it is that of the robot, best first; None if it counts only when named."""
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
