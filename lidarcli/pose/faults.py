"""Findings on the poses of a log: frames that lead nowhere, contradictions of the tree, broken rotations, leaps."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence

import numpy as np

from lidarcli.display import some_of, times
from lidarcli.findings import Finding
from lidarcli.pose.fit import JUMP_LENGTH, JUMP_SPEED, jumps_of
from lidarcli.pose.messages import frame_name
from lidarcli.pose.sources import GivenPaths, PoseSources, Way
from lidarcli.pose.tracks import SECOND_NS, Track
from lidarcli.pose.tree import WORLDS
from lidarcli.sweeps import Float64

NO_UNIT = 0.01
"""Deviation of the length of a quaternion from 1 that rounding does not make."""
TURN_RATE, LEAST_TURN = 10.0, 0.5
"""Steps that turn faster and by more are leaps [rad/s, rad]."""

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


def way_findings(way: Way, topic: str = "") -> list[Finding]:
    """Return findings on the poses that make the path of a sensor, which may spoil it."""
    found = []
    for step in way.steps:
        track = step.track
        if track.jumps_back:
            found.append(
                Finding(
                    "clock",
                    "warning",
                    topic,
                    way.frame,
                    f"stamps of {track.topic} jump back {times(track.jumps_back)}: poses there may mix two runs",
                    {"backward": track.jumps_back},
                    {"backward": 1},
                )
            )
        if not track.static and track.seems_w_first:
            found.append(
                Finding(
                    "frames",
                    "error",
                    topic,
                    way.frame,
                    f"quaternions of {track.topic} roll or hang head down, and never turn: they are probably written w "
                    "first, and x y z w is the order; the sensor seems to hang head down until that is mended",
                )
            )
    return found


def pose_findings(
    sources: PoseSources | GivenPaths, keys: Iterable[Key], jumping: Collection[Key]
) -> list[Finding]:
    """Return all findings on the poses of the sensors of a log.

    Parameters
    ----------
    keys : topics and frames with sweeps
    jumping : those of them whose poses are known to jump
    """
    found: list[Finding] = []
    links = {
        frame_name(name) for track in sources.tracks if track.is_link for name in (track.parent, track.child)
    }
    for topic, frame in sorted(keys):
        way = sources.way(frame)
        is_missing = frame and links and frame_name(frame) not in links and not sources.alike(frame)
        if is_missing and way is not None and way.assumption:
            message = f"no transform leads to frame {frame}: {way.assumption}"
            found.append(Finding("frames", "warning", topic, frame, message))
        if way is None:
            found += (
                [unplaced(frame, sources.alternatives(frame), topic, sources.tracks)] if is_missing else []
            )
            continue
        found += way_findings(way, topic)
        found += _leaps(way, topic, is_known=(topic, frame) in jumping)
    found += _of_tree([track for track in sources.tracks if track.is_link])
    found += [
        Finding(
            "frames",
            "warning",
            track.topic,
            track.child,
            f"{track.topic}: quaternions of {' > '.join(filter(None, (track.parent, track.child)))} are up to "
            f"{track.stretched:.2g} off length 1",
            {"off": track.stretched},
            {"off": NO_UNIT},
        )
        for track in sources.tracks
        if track.stretched > NO_UNIT
    ]
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
            yield Finding(
                "steps",
                "warning",
                topic,
                way.frame,
                f"poses from {track.topic} leap in heading {times(number)}, by up to {np.degrees(most):.0f} deg",
                {"leaps": number, "largest": most},
                {"rate": TURN_RATE, "turn": LEAST_TURN},
            )


def _turns(track: Track) -> Float64:
    """Return the angles between rotations that follow each other (N - 1,) [rad]."""
    rotation = track.motion.rotation
    angles: Float64 = 2.0 * np.arccos(np.clip(np.abs(np.sum(rotation[1:] * rotation[:-1], axis=1)), 0.0, 1.0))
    return angles


def _of_tree(links: Sequence[Track]) -> Iterator[Finding]:
    """Yield findings on frames that are mounted in two places."""
    parents: dict[str, dict[str, Track]] = {}
    for link in links:
        parents.setdefault(link.child, {}).setdefault(link.parent, link)
        if link.static and link.differs:
            yield Finding(
                "frames",
                "warning",
                link.topic,
                link.child,
                f"{link.topic}: {link.child} is told at two places in {link.parent}: the last counts",
            )
    for child, told in parents.items():
        if len(told) > 1 and any(link.static for link in told.values()):
            yield Finding(
                "frames",
                "warning",
                next(iter(told.values())).topic,
                child,
                f"frame {child} has {len(told)} parents: {some_of(sorted(told))}",
                {"parents": len(told)},
                {"parents": 2},
            )
