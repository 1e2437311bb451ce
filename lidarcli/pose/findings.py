"""Findings on the poses of a log: frames that lead nowhere, contradictions of the tree, broken rotations, leaps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from lidarcli.display.texts import some_of, times
from lidarcli.options.choices import MAX_DELAY
from lidarcli.pose.fit import LONGEST_DELAY, steps_between
from lidarcli.pose.frames import LEVEL, WORLDS, by_precedence, namespace
from lidarcli.pose.messages import frame_name
from lidarcli.pose.sources import GivenPaths, PoseChain, PoseSources
from lidarcli.pose.tracks import TUM, PoseTrack, flat
from lidarcli.sweeps.findings import Finding, Fix

NO_UNIT = 0.01
"""Deviation of the length of a quaternion from 1 that rounding does not make."""
APART, TURNED = 0.1, 0.1
"""Places of one frame that are further apart, or turned by more, are two [m, rad]."""
Key = tuple[str, str]
"""Topic and frame of sweeps."""


def unplaced(frame: str, others: Sequence[str], topic: str = "", tracks: Sequence[PoseTrack] = ()) -> Finding:
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
    return Finding("frames", "warning", topic, frame, message, mend="statics")


def clock_words(topic: str, delay: float) -> str:
    """Return that poses are stamped by another clock than the sweeps, `delay` later [s]."""
    side = "ahead of" if delay > 0.0 else "behind"
    return f"the clock of {topic} is {abs(delay):,.2f} s {side} that of the sweeps"


def apart_finding(key: Key, chain: PoseChain, delay: float) -> Finding:
    """Return the finding on a given path that has no pose at any sweep; `delay`: by how much it is late [s], 0: unknown."""
    words, span = f"no sweep of {key[0]} has a pose", chain.span_ns
    if not delay:
        together = f"the links {chain.frames} are never known at the same time"
        is_split = span is not None and span[0] > span[1]
        why = together if is_split else f"those of {chain.topics[0]} are of other times"
        return Finding("clock", "error", *key, f"{words}: {why}")
    fix = Fix("option", f"--pose-delay {delay:.2f}") if abs(delay) <= MAX_DELAY else None
    mend = "" if chain.steps[0].track.type == TUM else "clock"
    way = fix.text if fix else "clean --mend clock" if mend else "correct the stamps of the file"
    words = f"{words}: {clock_words(chain.topics[0], delay)} ({way})"
    return Finding("clock", "error", *key, words, {"delay": delay}, {"delay": LONGEST_DELAY}, fix, mend)


def chain_findings(chain: PoseChain, links: Sequence[PoseTrack], topic: str = "") -> list[Finding]:
    """Return findings on the poses that make the path of a sensor, which may spoil it; `links`: all transforms it sees."""
    found = []
    for track in (step.track for step in chain.steps):
        if track.jumps_back:
            words = f"stamps of {track.topic} jump back {times(track.jumps_back)}: poses there may mix two runs"
            back = {"backward": track.jumps_back}
            found.append(Finding("clock", "warning", topic, chain.frame, words, back, {"backward": 1}))
        if not track.static and track.seems_w_first:
            words = (
                f"quaternions of {track.topic} roll or hang head down, and never turn: they are probably written w "
                "first, and x y z w is the order; the sensor seems to hang head down until that is mended"
            )
            found.append(Finding("frames", "error", topic, chain.frame, words))
    children = {step.track.child for step in chain.steps}
    if words := upright_words(children):
        found.append(Finding("frames", "warning", topic, chain.frame.removesuffix(LEVEL), words))
    return found + [each for each in contradictions(links) if each.frame in children]


def upright_words(frames: Iterable[str]) -> str:
    """Return a line on sweeps of an optical frame, where some frames of their way are the level one of it; else empty."""
    names = [name.removesuffix(LEVEL) for name in frames if name.endswith(LEVEL)]
    return f"frame {names[0]} is optical, its plane upright: sweeps are taken as level, ahead along z" if names else ""


def pose_findings(sources: PoseSources | GivenPaths, keys: Iterable[Key]) -> list[Finding]:
    """Return all findings on the poses of the sensors of a log (keys: topics and frames with sweeps)."""
    found: list[Finding] = []
    links = {frame_name(name) for track in sources.tracks if track.is_link for name in (track.parent, track.child)}
    for topic, frame in sorted(keys):
        chain = sources.chain(frame, topic)
        is_missing = frame and links and frame_name(frame) not in links and not sources.alike(frame, topic)
        if is_missing and chain is not None and chain.assumption:
            message = f"no transform leads to frame {frame}: {chain.assumption}"
            found.append(Finding("frames", "warning", topic, frame, message, mend="statics"))
        if chain is None:
            if is_missing:
                found.append(unplaced(frame, sources.alternatives(frame, topic), topic, sources.tracks))
            continue
        found += chain_findings(chain, (), topic)
    found += contradictions([track for track in sources.tracks if track.is_link])
    for track in sources.tracks:
        if track.stretched > NO_UNIT:
            link, off = " > ".join(filter(None, (track.parent, track.child))), {"off": track.stretched}
            words = f"{track.topic}: quaternions of {link} are up to {track.stretched:.2g} off length 1"
            found.append(Finding("frames", "warning", track.topic, track.child, words, off, {"off": NO_UNIT}))
    return list({each.message: each for each in found}.values())


def contradictions(links: Sequence[PoseTrack]) -> Iterator[Finding]:
    """Yield findings on frames of which transforms of one namespace give several places."""
    given: dict[tuple[str, str], list[PoseTrack]] = {}
    for link in links:
        given.setdefault((namespace(link.topic), link.child), []).append(link)
    for (_, child), own in given.items():
        parents = sorted({link.parent for link in own})
        words = [
            f"{link.topic}: {child} is told at two places in {link.parent}: the last counts"
            if link.static
            else f"{link.topic}: {child} is told at two places in {link.parent} at one stamp: the first counts"
            for link in own
            if link.differs
        ]
        own = by_precedence(own)
        words += [
            f"{first.topic} and {second.topic} differ on where {child} is in {parent}: {first.topic} counts"
            for parent in parents
            for first, second in pairwise(link for link in own if link.parent == parent)
            if _differ(first, second)
        ]
        if len(parents) > 1 and any(link.static for link in own):
            last = f"; tf2 takes {own[0].parent}, told last" if sum(link.static for link in own) > 1 else ""
            words.append(f"frame {child} has {len(parents)} parents: {some_of(parents)}{last}")
        for message in words:
            yield Finding("frames", "warning", own[0].topic, child, message)


def _differ(first: PoseTrack, second: PoseTrack) -> bool:
    """Return whether two tracks of one frame in another one differ in its place at any time."""
    stamp_ns = first.stamp_ns if second.static else second.stamp_ns
    step = steps_between(*(flat(each.at(stamp_ns)) for each in (first, second)))
    with np.errstate(invalid="ignore"):
        return bool(((np.hypot(step[:, 0], step[:, 1]) > APART) | (np.abs(step[:, 2]) > TURNED)).any())
