"""Robots of several sensors: which have known places next to each other, in one world in which they see the same things."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lidarcli.display.texts import Routine, some_of
from lidarcli.errors import OptionError
from lidarcli.pipeline.reading.needs import of_one_run
from lidarcli.pipeline.reading.path_choice import CheckedPath
from lidarcli.pose.calibration import SURE, UNSURE, differs, joined_outlines, solve, stretches_over
from lidarcli.pose.findings import Key
from lidarcli.pose.fit import poses_after
from lidarcli.pose.frames import WORLDS, FrameTree, Step, is_within, namespace
from lidarcli.pose.messages import TRANSFORMS, frame_name
from lidarcli.pose.sources import PoseChain
from lidarcli.pose.tracks import PoseMotion, PoseTrack, compose, flat, lifted, planar
from lidarcli.sweeps.masks import Mount
from lidarcli.sweeps.types import Float64
from lidarcli.sweeps.zone import ROBOT

LESS_ALIKE = 0.2
"""Two sensors that agree less with each other than each with itself, by this share, are not where the log places them."""


@dataclass(slots=True)
class Robots:
    """The sensors that are followed together, and what is to be said of that."""

    of: dict[str, tuple[Key, ...]] = field(default_factory=dict)
    """Topic → the sensors of its robot."""
    paths: dict[Key, CheckedPath] = field(default_factory=dict)
    """Their paths, all in one world."""
    notes: list[str] = field(default_factory=list)


def robots_in(
    paths: Mapping[Key, CheckedPath], tracks: Iterable[PoseTrack], mounts: Sequence[Mount], scans: Collection[str]
) -> Robots:
    """Return the robots of a run.

    Parameters
    ----------
    paths : what is known of the path of each sensor
    tracks : transforms of the log
    mounts : places that files tell; they count before the transforms
    scans : all topics of the log with sweeps
    """
    links = [_fixed(mount) for mount in reversed(mounts)]
    links += [one for one in tracks if one.is_link and _is_mount(one)]
    groups: list[list[_RobotSensor]] = []
    for key in sorted(paths):
        sensor = _RobotSensor(key, paths[key], FrameTree(links, key[0], scans))
        same = [group for group in groups if group[0].steps_from(sensor) is not None]
        if same and all(one.key[1] != key[1] for one in same[0]):
            same[0].append(sensor)
        elif not same:
            groups.append([sensor])
    found = Robots()
    for group in groups:
        if len(group) > 1:
            _join(group, found, scans, {frame_name(mount.frame) for mount in mounts})
    # Sensors of several robots are each in a tree.
    lost = {one.key[1]: one.key[0] for one, *_ in groups if one.frame not in one.tree.frames}
    if lost and len({one.key[1] for one, *_ in groups}) > 1:
        names = some_of([*dict.fromkeys(lost.values())])
        found.notes.append(f"followed apart: nothing tells where {names} are (info --deep)")
    return found


@dataclass(slots=True)
class _RobotSensor:
    key: Key
    path: CheckedPath
    tree: FrameTree

    @property
    def frame(self) -> str:
        """The frame that its sweeps are in."""
        return self.tree.sensor(frame_name(self.key[1]))

    def steps_from(self, other: _RobotSensor) -> tuple[Step, ...] | None:
        """Return the fixed steps from another sensor to this one, by the transforms that both know; None without any."""
        steps = self.tree.path(other.frame, self.frame)
        back = other.tree.path(self.frame, other.frame)
        if not steps or not back or {id(one.track) for one in steps} != {id(one.track) for one in back}:
            return None if other.key != self.key else ()
        return steps


def _fixed(mount: Mount) -> PoseTrack:
    """Return a mount as a transform of which nothing moves."""
    motion = lifted((mount.x, mount.y, mount.yaw))
    if mount.upside_down:
        motion = compose(motion, PoseMotion(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])))
    parent, child = frame_name(mount.parent), frame_name(mount.frame)
    return PoseTrack("", next(iter(TRANSFORMS)), parent, child, True, 1, np.zeros(1, np.int64), motion, (0, 1 << 62), 0)


def _is_mount(link: PoseTrack) -> bool:
    """Return whether a transform joins two frames of one robot that do not move in each other."""
    is_fixed = link.static or not link.moves
    return is_fixed and all(name.rpartition("/")[2] not in WORLDS for name in (link.parent, link.child))


def _join(group: list[_RobotSensor], found: Robots, scans: Collection[str], mounted: Collection[str]) -> None:
    """Find the world of some sensors, and join those that are where the log or, if `mounted`, files place them."""
    for one in group:
        if one.path.fit is not None and any(one.path.fit.mount):
            words = f"{one.key[0]} is followed apart: its sweeps do not fit the place of {one.key[1]} on the robot"
            found.notes.append(f"{words} (info --deep)")
            group = [each for each in group if each is not one]
    if len(group) < 2:
        return
    placed = _in_one_world(group, _robot_of([one.key[0] for one in group], scans), mounted)
    if placed is None:
        topics = some_of([one.key[0] for one in group])
        found.notes.append(f"{topics} are followed apart: their sweeps do not tell one path of the robot")
        return
    first, *others = placed
    together = [first]
    for one in others:
        if words := _misplaced(first, one):
            found.notes.append(f"{one.key[0]} is followed apart: {words} (info --deep)")
        else:
            together.append(one)
    if len(together) < 2:
        return
    keys = tuple(sorted(one.key for one in together))
    found.of |= {topic: keys for topic, _ in keys}
    found.paths |= {one.key: one.path for one in together}
    chain = first.path.chain
    assert chain is not None
    names = " and ".join(dict.fromkeys(topic for topic, _ in keys))
    where = "on a robot that stands" if frame_name(chain.world).rpartition("/")[2] == ROBOT else f"in {chain.world}"
    found.notes.append(Routine(f"{names} are taken together, {where}; track --apart takes each by itself"))


def _robot_of(topics: Sequence[str], scans: Collection[str]) -> str:
    """Return the name of the frame of a robot, with its namespace where the log has sensors of others."""
    space = posixpath.commonpath([namespace(topic) for topic in topics])
    return ROBOT if all(is_within(scan, space) for scan in scans) else f"{space}/{ROBOT}"


def _in_one_world(group: list[_RobotSensor], robot: str, mounted: Collection[str]) -> list[_RobotSensor] | None:
    """Return sensors with paths in one world, of which the first decides; None where there is none.

    `robot`: the frame of the robot, which is the world while it stands; `mounted`: frames whose places files tell.
    """
    known = [one for one in group if one.path.chain is not None]
    matched = [one for one in known if one.path.verdict == "matched"]
    if len(matched) == len(known) and all(len(one.path.still) and one.path.still.all() for one in group):
        return [replace(one, path=_resting(one, group[0], robot)) for one in group]
    if not known:
        return None
    chains = [one.path.chain for one in known if one.path.chain is not None]
    is_told = not matched and len(known) == len(group) and not any(one.frame in mounted for one in group)
    if is_told and len({chain.world for chain in chains}) == 1:
        return group
    # The best path leads all others.
    best = max(matched or known, key=lambda one: 0.0 if one.path.agreement is None else one.path.agreement.all)
    return [best, *(replace(one, path=_led(one, best)) for one in group if one is not best)]


def _resting(sensor: _RobotSensor, first: _RobotSensor, robot: str) -> CheckedPath:
    """Return the path of a sensor on a robot that is static: its place in the frame of that."""
    base, steps = first.tree.to_base(first.frame), sensor.tree.to_base(sensor.frame)
    if [step.target for step in steps[-1:]] != [step.target for step in base[-1:]]:
        steps = (*(first.steps_from(sensor) or ()), *base)
    # The sensor itself may be where the robot is.
    steps = steps or (Step(_fixed(Mount(sensor.frame, sensor.frame, 0.0, 0.0, 0.0)), down=False),)
    topics = tuple(dict.fromkeys(step.track.topic for step in steps))
    return replace(sensor.path, verdict="told", chain=PoseChain(topics, sensor.frame, robot, steps))


def _led(sensor: _RobotSensor, lead: _RobotSensor) -> CheckedPath:
    """Return the path of a sensor by that of another one on the same robot."""
    chain, steps = lead.path.chain, lead.steps_from(sensor)
    assert chain is not None
    led = replace(chain, frame=sensor.frame, steps=(*(steps or ()), *chain.steps))
    return replace(sensor.path, verdict=lead.path.verdict, chain=led, agreement=lead.path.agreement, notes=(), remark="")


def _misplaced(first: _RobotSensor, second: _RobotSensor) -> str:
    """Return in words how far a sensor is from where the log places it, by what both see; empty where it is there."""
    here, there, sample, other_sample = first.path.chain, second.path.chain, first.path.sample, second.path.sample
    if here is None or there is None or sample is None or other_sample is None:
        return ""
    samples = ((sample, here), (other_sample, there))
    if any(np.any(planar(chain.at(sample.stamp_ns)).upside_down) for sample, chain in samples):
        return ""
    alike = sample.agreement_with(other_sample, here, there)
    if alike < 1.0 - LESS_ALIKE and alike < min(sample.agreement(chain).all for sample, chain in samples) - LESS_ALIKE:
        return f"it and {first.key[0]} do not see the same from where they are told to be"
    parts = [sample.outlines(most=60) for sample, _ in samples]
    poses = [flat(chain.at(part.stamp_ns)) for part, (_, chain) in zip(parts, samples, strict=True)]
    known = [np.flatnonzero(np.isfinite(each[:, 0])) for each in poses]
    if min(map(len, known)) < 2:
        return ""
    outlines = joined_outlines([part.those(at) for part, at in zip(parts, known, strict=True)])
    own, other = (each[at] for each, at in zip(poses, known, strict=True))

    def placing(values: Float64) -> Float64:
        return np.vstack([own, poses_after(other, values)])

    # The path of the robot, by one of them.
    both = np.vstack([own, flat(here.at(parts[1].stamp_ns[known[1]]))])
    stretch = stretches_over(both, outlines.stamp_ns, drifts=of_one_run(here.world))
    solution = solve(outlines, placing, np.zeros(3), np.full(3, np.inf), stretch)
    deviation = np.maximum(solution.deviations, 3.0 * SURE)
    if not (deviation < UNSURE).all() or not differs(solution.values, deviation):
        return ""
    x, y, yaw = solution.values.tolist()
    off = f"{math.hypot(x, y):.2f} m and {abs(math.degrees(yaw)):.1f} degrees"
    return f"by what both see it is {off} from where it is told to be beside {first.key[0]}"


def mount_on(
    key: Key, frame: str | None, tracks: Iterable[PoseTrack], mounts: Sequence[Mount], scans: Collection[str]
) -> PoseChain:
    """Return the chain from a sensor to a frame of its robot, by default the robot itself; `OptionError`: there is none."""
    links = [_fixed(mount) for mount in reversed(mounts)] + [one for one in tracks if one.is_link and _is_mount(one)]
    tree = FrameTree(links, key[0], scans)
    start = tree.sensor(frame_name(key[1]))
    steps = tree.to_base(start) if frame is None else tree.path(start, frame_name(frame))
    if steps is None:
        raise OptionError(f"--merge-frame {frame}: nothing tells where {key[1]} of {key[0]} is in it")
    target = steps[-1].target if steps else start
    steps = steps or (Step(_fixed(Mount(start, start, 0.0, 0.0, 0.0)), down=False),)
    return PoseChain((), start, target, steps)
