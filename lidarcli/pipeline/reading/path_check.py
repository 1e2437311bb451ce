"""A first pass over the sweeps of a log: the path that they tell, and whether told poses fit it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lidarcli.choices import MATCH
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.options import TopicChoice
from lidarcli.poses.fit import PoseFit, judge_poses, joined, stands_still
from lidarcli.poses.matched import MatchedPath
from lidarcli.poses.sources import Correction, Way
from lidarcli.poses.tracks import Motion, planar
from lidarcli.poses.tree import Step
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import Bool, Float64, Int64

if TYPE_CHECKING:
    from lidarcli.poses.sources import PoseSources, Told

MOST_MATCHED = 16
"""Topics and frames whose paths are matched: each has a map in memory."""
SLIDING = 0.05
"""Share of the sweeps that may slide along walls from which there is a note."""

Key = tuple[str, str]
"""Topic and frame of sweeps."""


@dataclass(frozen=True, slots=True)
class CheckedPath:
    """The path of one sensor after a look at its sweeps."""

    verdict: str
    """accepted, corrected, stretches, rejected, matched, unchecked or none."""
    way: Way | None = None
    """Way to use in place of the told one."""
    fit: PoseFit | None = None
    stamp_ns: Int64 | None = None
    """(S,) stamps of the sweeps [ns], increasing, ..."""
    still: Bool | None = None
    """... and whether the sensor stood; None where the sweeps do not tell."""
    notes: tuple[str, ...] = ()


def check_paths(
    log: Log,
    sources: PoseSources | Told | None,
    choice: TopicChoice,
    rules: RangeRules,
    *,
    named: bool = False,
    match: bool = False,
) -> dict[Key, CheckedPath]:
    """Match the sweeps of a log that can be read twice, and compare the told poses with their paths.

    Parameters
    ----------
    sources : told poses of the log, None for none
    choice : topics to read
    named : the user has named the poses, so they are taken in any case
    match : the matched paths are taken in any case
    """
    paths: dict[Key, MatchedPath] = {}
    report = ReadReport()
    for batch in read_batches(log, ReadOptions(choice.wanted or None, rules=rules), report, choice):
        for frame, _, mine in batch.by_frame():
            key = batch.topic, frame
            if key not in paths and len(paths) < MOST_MATCHED:
                paths[key] = MatchedPath()
            if key in paths:
                paths[key].add(mine)
    return {key: _checked(key, path, sources, named, match) for key, path in paths.items()}


def _checked(
    key: Key, path: MatchedPath, sources: PoseSources | Told | None, named: bool, match: bool
) -> CheckedPath:
    topic, frame = key
    stamp_ns, order = np.unique(path.stamp_ns, return_index=True)
    poses = path.poses[order]
    stands, still = stands_still(stamp_ns, poses, path.slides[order])
    way = None if sources is None or match else sources.way(frame)
    told = None if way is None else planar(way.at(stamp_ns))
    if way is None or told is None or np.isnan(told.x).all():
        return _without_poses(key, path, stands, still, match)
    # A sensor that hangs head down sees the world mirrored.
    mirrored = bool(np.count_nonzero(told.upside_down) * 2 > len(told.x))
    seen = poses * np.array([1.0, -1.0, -1.0]) if mirrored else poses
    own = way

    def told_at(at_ns: Int64) -> Float64:
        there = planar(own.at(at_ns))
        return np.column_stack([there.x, there.y, there.yaw])

    fit = judge_poses(stamp_ns, seen, told_at)
    notes = [_fit_note(way, fit)]
    if fit.verdict == "rejected" and not named:
        matched = _without_poses(key, path, stands, still, True)
        return replace(matched, verdict="rejected", fit=fit, notes=(*notes, *matched.notes))
    if named and fit.verdict in ("rejected", "stretches"):
        return CheckedPath(fit.verdict, None, fit, stamp_ns, still, tuple(notes))
    correction = Correction(round(fit.delay * 1e9), _mount(fit.mount)) if fit.verdict == "corrected" else None
    if fit.cuts:
        gaps, moves, lost = joined(stamp_ns, seen, path.pieces[order], told_at, fit.cuts)
        position = np.column_stack([moves[:, :2], np.zeros(len(moves))])
        correction = replace(correction or Correction(), gaps=gaps, moves=Motion(position, _turns(moves[:, 2])))
        notes += [f"poses from {way.topics[0]} jump by {jump:,.1f} m: cut there" for jump in fit.jumps[:3]]
        if lost:
            notes.append(f"after a jump of {way.topics[0]} the path cannot be joined: no world columns from there on")
    return CheckedPath(
        fit.verdict,
        None if correction is None else replace(way, correction=correction),
        fit,
        stamp_ns,
        still,
        tuple(notes),
    )


def _without_poses(key: Key, path: MatchedPath, stands: bool, still: Bool | None, match: bool) -> CheckedPath:
    """Return the matched path of a sensor that moves."""
    topic, frame = key
    if stands and not match:
        return CheckedPath("none", None, None, path.stamp_ns, still)
    track = path.track(topic, frame)
    notes = []
    name = frame or "without a name"
    if track is None:
        return CheckedPath("none", None, None, None, None, (f"no path of frame {name}: the sweeps of {topic} cannot be matched",))
    if path.restarts:
        notes.append(
            f"the path of frame {name} was lost {path.restarts:,} times, and begins anew at its last known pose: what was "
            "driven unseen is missing"
        )
    sliding = float(np.nanmean(path.slides))
    if sliding > SLIDING:
        notes.append(
            f"{sliding:.0%} of the sweeps of {topic} do not fix the place along their walls: the path may be too short there"
        )
    way = Way((topic,), frame, track.parent, (Step(track, down=False),))
    return CheckedPath("matched", way, None, path.stamp_ns, still, tuple(notes))


def _fit_note(way: Way, fit: PoseFit) -> str:
    """Return the verdict on told poses in words."""
    topic = way.topics[0]
    if fit.verdict == "unchecked":
        return f"poses from {topic} are taken as they are: too few sweeps could be matched to check them"
    if fit.verdict == "accepted":
        return f"poses from {topic} fit the sweeps: {fit.share:.0%} of {fit.pairs} steps"
    if fit.verdict == "corrected":
        changes = []
        if fit.delay:
            side = "after" if fit.delay > 0 else "before"
            changes.append(f"{abs(fit.delay):.2f} s {side} the header stamps")
        x, y, yaw = fit.mount
        if abs(yaw) > 0.02:
            changes.append(f"with the sensor turned by {np.degrees(yaw):.0f} degrees")
        if max(abs(x), abs(y)) > 0.02:
            changes.append(f"with the sensor {x:.2f}, {y:.2f} m from there")
        return f"poses from {topic} fit the sweeps {' and '.join(changes)}: {fit.share:.0%} of {fit.pairs} steps"
    causes = []
    if np.isfinite(fit.ratio) and not 0.8 <= fit.ratio <= 1.25:
        causes.append(f"told steps are {fit.ratio:.3g} times those seen")
    if np.isfinite(fit.turn_ratio) and fit.turn_ratio < -0.5:
        causes.append("it turns the other way")
    cause = f"; {'; '.join(causes)}" if causes else ""
    if fit.verdict == "stretches":
        return f"poses from {topic} fit the sweeps in {len(fit.good)} stretches only ({fit.share:.0%} of {fit.pairs} steps{cause})"
    return f"poses from {topic} do not fit the sweeps ({fit.share:.0%} of {fit.pairs} steps{cause}): the path is matched from the sweeps"


def _mount(mount: tuple[float, float, float]) -> Motion | None:
    if mount == (0.0, 0.0, 0.0):
        return None
    return Motion(np.array([[mount[0], mount[1], 0.0]]), _turns(np.array([mount[2]])))


def _turns(yaw: Float64) -> Float64:
    """Return quaternions (N, 4) of turns about z (N,) [rad]."""
    flat = np.zeros(len(yaw))
    return np.column_stack([flat, flat, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])
