"""Findings on the poses of a log: frames that lead nowhere, contradictions of the tree, broken rotations, leaps."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from lidarcli.display import some_of, times
from lidarcli.findings import Finding
from lidarcli.pose.fit import JUMP_LENGTH, JUMP_SPEED, jumps_of, steps_between
from lidarcli.pose.messages import frame_name
from lidarcli.pose.sources import GivenPaths, PoseSources, Way
from lidarcli.pose.tracks import SECOND_NS, Motion, Track, planar
from lidarcli.pose.tree import WORLDS, namespace
from lidarcli.sweeps import Float64

NO_UNIT = 0.01
"""Deviation of the length of a quaternion from 1 that rounding does not make."""
TURN_RATE, LEAST_TURN = 10.0, 0.5
"""Steps that turn faster and by more are leaps [rad/s, rad]."""

APART, TURNED = 0.1, 0.1
"""Places of one frame that are further apart, or turned by more, are two [m, rad]."""
LEVER = 2.0
"""Distance at which a correction that turns counts as one that shifts [m]: things that are followed are rarely nearer."""

Key = tuple[str, str]
"""Topic and frame of sweeps."""


def unplaced(frame: str, others: Sequence[str], topic: str = "", tracks: Sequence[Track] = ()) -> Finding:
    """Return the finding on a frame from which no pose leads to a fixed frame; `others`: topics that could be named.

    `tracks` are the links of the log: one from the robot to the sensor may be missing.
    """
    hint = f"; --pose may name {some_of(others)}" if others else ""
    known = {name for track in tracks if track.is_link for name in (track.parent, track.child)}
    robots = [
        each.child
        for each in tracks
        if each.parent.rpartition("/")[2] in WORLDS and each.child.rpartition("/")[2] not in WORLDS
    ]
    if robots and not others and frame not in known:
        hint = f": {robots[0]} > {frame} is missing; in the first part? --join reads it"
    message = f"no pose for frame {frame or 'without a name'}: nothing leads from it to a fixed frame{hint}"
    return Finding("frames", "warning", topic, frame, message)


def way_findings(way: Way, links: Sequence[Track], topic: str = "") -> list[Finding]:
    """Return findings on the poses that make the path of a sensor, which may spoil it; `links`: all transforms it sees."""
    found = []
    for track in (step.track for step in way.steps):
        if track.jumps_back:
            words = f"stamps of {track.topic} jump back {times(track.jumps_back)}: poses there may mix two runs"
            back = {"backward": track.jumps_back}
            found.append(Finding("clock", "warning", topic, way.frame, words, back, {"backward": 1}))
        if not track.static and track.seems_w_first:
            words = (
                f"quaternions of {track.topic} roll or hang head down, and never turn: they are probably written w "
                "first, and x y z w is the order; the sensor seems to hang head down until that is mended"
            )
            found.append(Finding("frames", "error", topic, way.frame, words))
        found += _corrections(track, topic, way.frame)
    children = {step.track.child for step in way.steps}
    return found + [each for each in contradictions(links) if each.frame in children]


def pose_findings(sources: PoseSources | GivenPaths, keys: Iterable[Key], jumping: Collection[Key]) -> list[Finding]:
    """Return all findings on the poses of the sensors of a log.

    Parameters
    ----------
    keys : topics and frames with sweeps
    jumping : those of them whose poses are known to jump
    """
    found: list[Finding] = []
    links = {frame_name(name) for track in sources.tracks if track.is_link for name in (track.parent, track.child)}
    for topic, frame in sorted(keys):
        way = sources.way(frame, topic)
        is_missing = frame and links and frame_name(frame) not in links and not sources.alike(frame, topic)
        if is_missing and way is not None and way.assumption:
            message = f"no transform leads to frame {frame}: {way.assumption}"
            found.append(Finding("frames", "warning", topic, frame, message))
        if way is None:
            if is_missing:
                found.append(unplaced(frame, sources.alternatives(frame, topic), topic, sources.tracks))
            continue
        found += way_findings(way, (), topic)
        found += _leaps(way, topic, is_known=(topic, frame) in jumping)
    found += contradictions([track for track in sources.tracks if track.is_link])
    for track in sources.tracks:
        if track.stretched > NO_UNIT:
            link, off = " > ".join(filter(None, (track.parent, track.child))), {"off": track.stretched}
            words = f"{track.topic}: quaternions of {link} are up to {track.stretched:.2g} off length 1"
            found.append(Finding("frames", "warning", track.topic, track.child, words, off, {"off": NO_UNIT}))
    return list({each.message: each for each in found}.values())


def _leaps(way: Way, topic: str, is_known: bool) -> Iterator[Finding]:
    """Yield findings on steps of the poses that are faster than any robot."""
    jumps = jumps_of(way)
    threshold = {"speed": JUMP_SPEED, "length": JUMP_LENGTH}
    if len(jumps.lengths) and not is_known:
        most = float(jumps.lengths.max())
        words = f"poses from {way.topics[0]} jump {times(len(jumps.lengths))}, by up to {most:,.1f} m"
        evidence = {"jumps": len(jumps.lengths), "largest": most}
        yield Finding("steps", "warning", topic, way.frame, words, evidence, threshold)
    for track in (step.track for step in way.steps if not step.track.static):
        turns = _turns(track)
        fast = turns > np.maximum(TURN_RATE * np.diff(track.stamp_ns) / SECOND_NS, LEAST_TURN)
        if fast.any():
            number, most = int(np.count_nonzero(fast)), float(turns[fast].max())
            words = f"poses from {track.topic} leap in heading {times(number)}, by up to {np.degrees(most):.0f} deg"
            evidence, threshold = {"leaps": number, "largest": most}, {"rate": TURN_RATE, "turn": LEAST_TURN}
            yield Finding("steps", "warning", topic, way.frame, words, evidence, threshold)


def _corrections(track: Track, topic: str, frame: str) -> Iterator[Finding]:
    """Yield the finding on steps of localisation (map > odom), which no sensor makes."""
    if track.static or not {name.rpartition("/")[2] for name in (track.parent, track.child)} <= {*WORLDS}:
        return
    places = _planar(track.motion)
    x, y, turn = np.abs(steps_between(places[:-1], places[1:])).T
    shift = np.hypot(x, y)
    far = shift + LEVER * turn > APART
    if far.any():
        most = {"corrections": int(np.count_nonzero(far)), "largest": float(shift.max()), "turn": float(turn.max())}
        words = (
            f"{track.parent} > {track.child} is corrected {times(int(most['corrections']))}, by up to "
            f"{most['largest']:.2f} m and {np.degrees(most['turn']):.0f} degrees: what stands may seem to move then; "
            "--pose match does without it"
        )
        yield Finding("steps", "warning", topic, frame, words, most, {"shift": APART})


def _turns(track: Track) -> Float64:
    """Return the angles between rotations that follow each other (N - 1,) [rad]."""
    rotation = track.motion.rotation
    angles: Float64 = 2.0 * np.arccos(np.clip(np.abs(np.sum(rotation[1:] * rotation[:-1], axis=1)), 0.0, 1.0))
    return angles


def contradictions(links: Sequence[Track]) -> Iterator[Finding]:
    """Yield findings on frames of which transforms of one namespace tell several places."""
    told: dict[tuple[str, str], list[Track]] = {}
    for link in links:
        told.setdefault((namespace(link.topic), link.child), []).append(link)
    for (_, child), mine in told.items():
        parents = sorted({link.parent for link in mine})
        words = [
            f"{link.topic}: {child} is told at two places in {link.parent}: the last counts"
            for link in mine
            if link.static and link.differs
        ]
        mine.sort(key=lambda link: (not link.static, -link.messages))
        words += [
            f"{first.topic} and {second.topic} differ on where {child} is in {parent}: {first.topic} counts"
            for parent in parents
            for first, second in pairwise(link for link in mine if link.parent == parent)
            if _differ(first, second)
        ]
        if len(parents) > 1 and any(link.static for link in mine):
            words.append(f"frame {child} has {len(parents)} parents: {some_of(parents)}")
        for message in words:
            yield Finding("frames", "warning", mine[0].topic, child, message)


def _differ(first: Track, second: Track) -> bool:
    """Tell whether two tracks of one frame in another one tell different places of it at any time."""
    stamp_ns = first.stamp_ns if second.static else second.stamp_ns
    step = steps_between(*(_planar(each.at(stamp_ns)) for each in (first, second)))
    with np.errstate(invalid="ignore"):
        return bool(((np.hypot(step[:, 0], step[:, 1]) > APART) | (np.abs(step[:, 2]) > TURNED)).any())


def _planar(motion: Motion) -> Float64:
    here = planar(motion)
    return np.column_stack([here.x, here.y, here.yaw])
