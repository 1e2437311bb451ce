"""The path of each sensor of a log, by its sweeps: given poses that fit, corrected, or matched where none fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.choices import BEAM_ORDERS
from lidarcli.display import counted, times
from lidarcli.findings import Finding, Fix
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import LogBatcher, ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.reading.posing import Need
from lidarcli.pose.fit import (
    ACCEPTED,
    AUTO,
    CORRECTED,
    JUMP_LENGTH,
    JUMP_SPEED,
    LEAST_DELAY,
    LEAST_PAIRS,
    LEAST_SKEWED,
    RATIOS,
    SKEWED,
    MatchedPath,
    PoseFit,
    Timing,
    duration_of,
    joined,
    judge_poses,
    jumps_of,
    order_of,
    stands,
    still_at,
)
from lidarcli.pose.sources import Correction, PoseChain, Step, later
from lidarcli.pose.tracks import SECOND_NS, Motion, planar
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import Bool, Float64, Int64, SweepBatch

if TYPE_CHECKING:
    from lidarcli.pose.sources import GivenPaths, PoseSources

MOST_MATCHED = 16
"""Topics and frames whose paths are matched: each has a map in memory."""
ENOUGH, ENOUGH_WAY = 2000, 30.0
"""A given path is judged by its first so many sweeps, once the sensor has gone so far [m]."""
SAMPLE, PERIOD = 5, 200
"""Of a sensor that has stood for a period of sweeps, so many of each period are matched."""
ENOUGH_SKEWED, MOST_HELD = 300, 3000
"""Sweeps during which the sensor moves that tell the order of the beams, and most sweeps that are held for it."""
WELL_CORRECTED = 0.9
"""Share of steps that agree from which on corrected poses are the path; below, they guide the matched one."""
LESS_PLACED, LESS_SHARP = 0.02, 0.01
"""Shares of sweeps that have no pose by a guess, and of points that lie worse, from which on the guess does harm."""
WORTH_A_GUESS = 0.2
"""Share of given steps that agree from which on the given steps guide the search."""
LEAST_PLACED = 0.7
"""Least share of sweeps with a pose that tell the order of the beams."""
SLIDING = 0.05
"""Share of the sweeps that may slide along walls from which there is a note."""
SHOWN_JUMPS = 3
"""Jumps of given poses that have a note each."""

Key = tuple[str, str]
"""Topic and frame of sweeps."""


@dataclass(frozen=True, slots=True)
class CheckedPath:
    """The path of one sensor after a look at its sweeps."""

    verdict: str
    """accepted, corrected, stretches, rejected, matched, unchecked or none."""
    chain: PoseChain | None = None
    """Path to use; None for none."""
    given: PoseChain | None = None
    """Told path, corrected, that does not fit well enough to be used, but guides a second look."""
    fit: PoseFit | None = None
    timing: Timing = field(default_factory=Timing)
    """Times at which the beams are sent."""
    stamp_ns: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    """(S,) stamps of sweeps [ns], increasing."""
    matched: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    """(S, 3) x, y [m] and yaw [rad] of the path that was matched from these sweeps, NaN without a pose."""
    pieces: Float64 = field(default_factory=lambda: np.zeros(0))
    """(S,) number of the piece of that path: one does not lie to the next as it should."""
    still: Bool = field(default_factory=lambda: np.zeros(0, bool))
    """(S,) True where the sensor stands at that sweep; empty where the sweeps do not tell."""
    notes: tuple[str | Finding, ...] = ()
    """Notes on the path; of what is a fault of the log, the finding."""

    @property
    def follows_told(self) -> bool:
        """True where the path to use is the told one."""
        if self.fit is None or self.fit.verdict in ("rejected", "stretches"):
            return False
        return self.fit.verdict != "corrected" or self.fit.share >= WELL_CORRECTED

    def stood(self, stamp_ns: Int64) -> Bool:
        """Tell whether the sensor stood at stamps (S,) [ns], as at the sweep before."""
        at = np.maximum(np.searchsorted(self.stamp_ns, stamp_ns, "right") - 1, 0)
        found: Bool = self.still[at]
        return found

    def facts(self) -> dict[str, Any]:
        """Return the verdict for the tables' metadata and `info`."""
        given: dict[str, Any] = {"pose_verdict": self.verdict}
        if self.fit is not None:
            fit = round(self.fit.share, 3) if np.isfinite(self.fit.share) else None
            given |= {"pose_fit": fit, "pose_delay": self.fit.delay, "pose_cuts": len(self.fit.cuts)}
        return given | ({} if self.timing.order == AUTO else {"beam_order": self.timing.order})


class _Look:
    """A look at the sweeps of one topic and frame, in log order."""

    def __init__(
        self,
        given: PoseChain | None,
        order: str,
        *,
        whole: bool = False,
        guess: PoseChain | None = None,
        wanted: bool = True,
    ) -> None:
        self.given = given
        self.path = MatchedPath(Timing(order))
        self.is_whole = True
        """True where every sweep was matched."""
        self.sweeps = 0
        self._whole, self._guess, self._wanted = whole, guess, wanted
        self._held: list[SweepBatch] | None = [] if order == AUTO and wanted else None

    def add(self, sweeps: SweepBatch) -> None:
        """Take sweeps. Some are matched while the sensor stands, and none once it has moved if no path is wanted."""
        if self.sweeps < PERIOD < self.sweeps + len(sweeps):
            rows = np.arange(len(sweeps))
            for part in np.split(rows, [PERIOD - self.sweeps]):
                self.add(sweeps.rows(part))
            return
        part = np.arange(len(sweeps))
        if not self._whole and self.sweeps >= PERIOD and self.stands:
            part = part[(self.sweeps + part) % PERIOD < SAMPLE]
            self.is_whole = False
        elif not self._wanted and not self.may_stand:
            part = part[:0]
        self.sweeps += len(sweeps)
        if not len(part):
            return
        sweeps = sweeps if len(part) == len(sweeps) else sweeps.rows(part)
        self.path.add(sweeps, self._guessed(sweeps))
        if self._held is not None:
            self._held.append(sweeps)
            held = len(self.path.stamp_ns)
            if held >= MOST_HELD or self._skewed() >= ENOUGH_SKEWED:
                self.settle()

    def settle(self) -> None:
        """Find the order of the beams by the sweeps so far."""
        held, self._held = self._held, None
        if not held or self._skewed(held) < LEAST_SKEWED or self.path.placed < LEAST_PLACED:
            return
        own, duration = duration_of(held)
        paths = {}
        for order in BEAM_ORDERS[1:]:
            path = paths[order] = MatchedPath(Timing(order, own))
            for sweeps in held:
                path.add(sweeps, self._guessed(sweeps))
        if order := order_of(paths, duration):
            self.path = paths[order]

    @property
    def stands(self) -> bool:
        """True where the sensor has not moved so far."""
        return stands(self.path.poses, self.path.slides)

    @property
    def may_stand(self) -> bool:
        """True until the sensor was seen to move in the sweeps so far."""
        return self.sweeps < PERIOD or self.stands

    @property
    def is_guided(self) -> bool:
        """True where given steps guide the search."""
        return self._guess is not None

    @property
    def is_enough(self) -> bool:
        """True where the given path can be judged by the sweeps so far."""
        return self.given is not None and self.sweeps >= ENOUGH and self.path.length >= ENOUGH_WAY

    def _skewed(self, held: list[SweepBatch] | None = None) -> int:
        """Return the number of sweeps during which the sensor moved."""
        duration = duration_of(held or self._held or [])[1]
        return int(np.count_nonzero(self.path.skews(duration) > SKEWED))

    def _guessed(self, sweeps: SweepBatch) -> Float64 | None:
        """Return the given poses of sweeps, as `MatchedPath.add` takes them."""
        if self._guess is None:
            return None
        given, mirrored = _seen(self._guess, sweeps.stamp_ns)
        cuts = np.zeros(0) if self._guess.correction is None else self._guess.correction.gaps[:, 1]
        part = np.searchsorted(cuts, sweeps.stamp_ns, "right")
        return np.column_stack([given * _mirror(mirrored), part])


def check_paths(
    log: Log,
    sources: PoseSources | GivenPaths | None,
    choice: TopicChoice,
    rules: RangeRules,
    *,
    delay_ns: int = 0,
    named: bool = False,
    match: bool = False,
    need: Need = Need.MOVING,
    wanted: bool = True,
    order: str = AUTO,
) -> dict[Key, CheckedPath]:
    """Match the sweeps of a log that can be read twice, and compare the given poses with these paths.

    Parameters
    ----------
    sources : given poses of the log, None for none
    choice : topics to read
    delay_ns : the pose of a sweep is told so much after its stamp [ns]
    named : the user has named the poses, so they are taken as they are
    match : the matched paths are taken in any case
    need : sensors without given poses that need a path
    wanted : False to tell only whether the sensor stands, until it was seen to move
    order : order of the beams, of `BEAM_ORDERS`

    Returns
    -------
    By topic and frame, for at most `MOST_MATCHED`; without those that need no look.
    """

    def given_by(topic: str, frame: str) -> PoseChain | None:
        chain = None if sources is None or match else sources.chain(frame, topic)
        return chain if chain is None or not delay_ns else replace(chain, correction=Correction(delay_ns))

    matched = match or need is Need.ALL
    looks: dict[Key, _Look] = {}
    expected = {topic.name for topic in log.topics() or () if topic.messages != 0} & set(choice.chosen)
    for key, sweeps in _sweeps(log, choice, rules):
        if key not in looks:
            given = given_by(*key)
            if len(looks) == MOST_MATCHED or (given is None and need is Need.TOLD and not match):
                continue
            looks[key] = _Look(given, order, whole=match, wanted=wanted)
        looks[key].add(sweeps)
        if {topic for topic, _ in looks} >= expected > set() and all(
            look.is_enough if wanted else not look.may_stand for look in looks.values()
        ):
            for look in looks.values():
                look.is_whole = False
            break
    found = {}
    again: dict[Key, _Look] = {}
    for key, look in looks.items():
        look.settle()
        found[key] = _checked(key, look, named, matched)
        if not wanted:
            still = found[key].still if look.may_stand else np.zeros(0, bool)
            found[key] = replace(found[key], verdict="none", chain=None, notes=(), still=still)
        elif (second := _second_look(look, found[key], named)) is not None:
            again[key] = second
    if again:
        for key, sweeps in _sweeps(log, choice, rules):
            if key in again:
                again[key].add(sweeps)
        for key, look in again.items():
            look.settle()
            better = _checked(key, look, named, matched)
            # Poses that do not fit are no help as a guess.
            first = looks[key].path
            is_worse = looks[key].is_whole and (
                better.verdict in ("rejected", "unchecked")
                or look.path.restarts > first.restarts
                or look.path.placed < first.placed - LESS_PLACED
                or look.path.sharpness < first.sharpness - LESS_SHARP
            )
            found[key] = found[key] if is_worse else better
    return found


def _sweeps(log: Log, choice: TopicChoice, rules: RangeRules) -> Iterator[tuple[Key, SweepBatch]]:
    """Yield the sweeps of a log by topic and frame; the pass that makes the tables reports the damage."""
    for batch in LogBatcher(log, ReadOptions(choice.wanted or None, rules=rules), ReadReport(), choice).batches():
        for frame, _, sweeps in batch.by_frame():
            yield (batch.topic, frame), sweeps


def _second_look(look: _Look, first: CheckedPath, named: bool) -> _Look | None:
    """Return a second look where the first does not do: at all sweeps, or with given steps as the guess."""
    if named or first.verdict == "none":
        return None
    if first.verdict == "corrected" and not first.follows_told:
        return _again(look, first.given)
    if first.fit is None or first.verdict in ("accepted", "corrected"):
        is_done = look.is_whole or (first.fit is not None and not first.fit.cuts)
        return None if is_done else _again(look)
    if first.verdict != "rejected" or first.fit.share >= WORTH_A_GUESS:
        return _again(look, look.given)
    return None if look.is_whole else _again(look)


def _again(look: _Look, guess: PoseChain | None = None) -> _Look:
    """Return a look at all sweeps, with the order of the beams that the first look found."""
    again = _Look(look.given, look.path.timing.order, whole=True, guess=guess)
    again.path = MatchedPath(look.path.timing)
    return again


def _seen(chain: PoseChain, stamp_ns: Int64) -> tuple[Float64, bool]:
    """Return the given poses (S, 3), and whether the sensor hangs head down at most of them."""
    there = planar(chain.at(stamp_ns))
    known = np.isfinite(there.x)
    mirrored = bool(np.count_nonzero(there.upside_down & known) * 2 > np.count_nonzero(known))
    return np.column_stack([there.x, there.y, there.yaw]), mirrored


def _mirror(mirrored: bool) -> Float64:
    """Return the signs of x, y and yaw of a sensor that sees the world mirrored."""
    return np.array([1.0, -1.0, -1.0]) if mirrored else np.ones(3)


def _checked(key: Key, look: _Look, named: bool, match: bool) -> CheckedPath:
    """Judge the given poses of a sensor by its matched path, and choose the path to use."""
    path, chain = look.path, look.given
    stamp_ns, order = np.unique(path.stamp_ns, return_index=True)
    poses, pieces = path.poses[order], path.pieces[order]
    mine = CheckedPath(
        "none",
        chain,
        timing=path.timing,
        stamp_ns=stamp_ns,
        matched=poses,
        pieces=pieces,
        still=still_at(stamp_ns, poses, path.slides[order]),
    )
    if chain is None or not np.isfinite(_given_at(chain, stamp_ns)).any():
        return mine if named else _unposed(key, look, replace(mine, chain=None), match)
    seen = poses * _mirror(_seen(chain, stamp_ns)[1])
    fit = judge_poses(stamp_ns, seen, partial(_given_at, chain), pieces, jumps_of(chain))
    mine = replace(mine, verdict=fit.verdict, fit=fit, notes=_fit_notes(key, chain, fit, named))
    if named:
        return mine
    if fit.verdict == "corrected":
        correction = Correction(round(fit.delay * SECOND_NS), _mount(fit.mount)).after(chain.correction)
        chain = replace(chain, correction=correction)
    if not mine.follows_told:
        return replace(_unposed(key, look, replace(mine, chain=None), True), verdict=fit.verdict, given=chain)
    if not fit.cuts or fit.verdict == "unchecked":
        return replace(mine, chain=chain)
    correction = chain.correction or Correction()
    given_ns = later(stamp_ns, correction.delay_ns)
    gaps, moves, lost = joined(given_ns, seen, pieces, _given_at(chain, stamp_ns), fit.cuts)
    motion = Motion(np.column_stack([moves[:, :2], np.zeros(len(moves))]), _turns(moves[:, 2]))
    chain = replace(chain, correction=replace(correction, gaps=gaps, moves=motion))
    topic = chain.topics[0]
    notes: list[str | Finding] = [
        _jump(key, fit, f"poses from {topic} jump by {jump:,.1f} m at {(after - stamp_ns[0]) / SECOND_NS:.1f} s: cut there")
        for jump, (_, after) in zip(fit.jumps[:SHOWN_JUMPS], fit.cuts, strict=False)
    ]
    if len(fit.jumps) > SHOWN_JUMPS:
        notes.append(f"poses from {topic} jump {len(fit.jumps) - SHOWN_JUMPS:,} more times")
    if lost:
        notes.append(f"after a jump of {topic} the path cannot be joined: no world columns from there on")
    return replace(mine, chain=chain, notes=(*mine.notes, *notes))


def _given_at(chain: PoseChain, stamp_ns: Int64) -> Float64:
    """Return the given poses (S, 3) at stamps."""
    return _seen(chain, stamp_ns)[0]


def _unposed(key: Key, look: _Look, mine: CheckedPath, match: bool) -> CheckedPath:
    """Return the matched path of a sensor that moves."""
    if look.stands and not match:
        return mine
    (topic, frame), path = key, look.path
    track = path.track(topic, frame)
    name = frame or "without a name"
    if track is None:
        return replace(mine, notes=(*mine.notes, f"no path of frame {name}: the sweeps of {topic} cannot be matched"))
    notes = []
    if path.restarts:
        notes.append(
            f"the path of frame {name} was lost {times(path.restarts)}, and begins anew "
            + ("where told steps lead" if look.is_guided else "at its last known pose: what was driven unseen is missing")
        )
    sliding = float(np.nanmean(path.slides))
    if sliding > SLIDING:
        notes.append(f"{sliding:.0%} of the sweeps of {topic} may slide along their walls: the path may be too short there")
    chain = PoseChain((topic,), frame, track.parent, (Step(track, down=False),))
    if len(gaps := path.gaps):
        chain = replace(chain, correction=Correction(gaps=gaps))
        missing = np.isnan(_given_at(chain, path.stamp_ns)[:, 0])
        notes.append(
            f"no pose for {np.count_nonzero(missing):,} of {len(missing):,} sweeps of {topic}: they fit nowhere, or may "
            "slide along their walls"
        )
    return replace(mine, verdict="matched", chain=chain, notes=(*mine.notes, *notes))


def _jump(key: Key, fit: PoseFit, message: str) -> Finding:
    """Return a finding on jumps of given poses."""
    evidence = {"jumps": len(fit.jumps), "largest": max(fit.jumps)}
    return Finding("steps", "warning", *key, message, evidence, {"speed": JUMP_SPEED, "length": JUMP_LENGTH})


def _fit_notes(key: Key, chain: PoseChain, fit: PoseFit, named: bool) -> tuple[str | Finding, ...]:
    """Return the verdict on given poses in words."""
    topic, steps = chain.topics[0], f"{fit.share:.0%} of {fit.pairs:,} steps" if fit.pairs else "no step"
    if fit.verdict == "unchecked":
        why = "the sensor hardly moves" if fit.pairs < LEAST_PAIRS else "too few sweeps could be matched"
        if fit.moves and fit.pairs < LEAST_PAIRS:
            why = f"only {counted(fit.pairs, 'step')} of its sweeps can be compared"
        note = f"poses from {topic} are taken as they are, unchecked: {why}"
        if not fit.jumps:
            return (note,)
        most = f"by up to {max(fit.jumps):,.1f} m"
        return note, _jump(key, fit, f"poses from {topic} jump {times(len(fit.jumps))}, {most}")
    if fit.verdict == "accepted":
        return (f"poses from {topic} fit the sweeps: {steps}",)
    evidence = {"share": fit.share, "steps": fit.pairs}
    if fit.verdict == "corrected":
        words = "; ".join(_changes(fit))
        hint = "" if fit.share >= WELL_CORRECTED else f"; the path is matched from the sweeps, guided by {topic}"
        hint = "; they are taken as they are, because they were named" if named else hint
        message = f"poses from {topic} fit the sweeps if corrected ({words}): {steps}{hint}"
        x, y, yaw = fit.mount
        evidence |= {"delay": fit.delay, "x": x, "y": y, "yaw": yaw}
        if not fit.delay:
            return (Finding("mount", "warning", *key, message, evidence, {"share": CORRECTED}),)
        fix = Fix("option", f"--pose-delay {fit.delay:.2f}")
        return (Finding("delay", "warning", *key, message, evidence, {"delay": LEAST_DELAY}, fix),)
    causes = []
    if np.isfinite(fit.ratio) and not RATIOS[0] <= fit.ratio <= RATIOS[1]:
        factor = f"{fit.ratio:,.0f}" if fit.ratio >= 100 else f"{fit.ratio:.3g}"
        causes.append(f"told steps are {factor} times those seen")
    if np.isfinite(fit.turn_ratio) and fit.turn_ratio < -0.5:
        causes.append("the sensor turns the other way")
    if fit.jumps and not fit.cuts:
        causes.append(f"they jump by up to {fit.jumps[0]:,.1f} m and back: two publishers that disagree?")
    cause = f"; {'; '.join(causes)}" if causes else ""
    end = "they are taken because they were named" if named else "the path is matched from the sweeps"
    words = f"fit the sweeps in {len(fit.good)} stretches only" if fit.verdict == "stretches" else "do not fit the sweeps"
    message = f"poses from {topic} {words} ({steps}{cause}): {end}"
    return (Finding("pose_fit", "warning", *key, message, evidence, {"share": ACCEPTED}),)


def _changes(fit: PoseFit) -> list[str]:
    """Return the delay and the mount of a correction in words."""
    changes = []
    if fit.delay:
        side = "later" if fit.delay > 0 else "earlier"
        changes.append(f"stamped {abs(fit.delay):.2f} s {side} than the sweeps")
    x, y, yaw = fit.mount
    moves = [f"turned by {np.degrees(yaw):.0f} degrees"] if abs(yaw) > 0.02 else []
    if max(abs(x), abs(y)) > 0.02:
        moves.append(f"moved by {x:.2f}, {y:.2f} m")
    if moves:
        changes.append(f"the sensor {' and '.join(moves)}")
    return changes


def _mount(mount: tuple[float, float, float]) -> Motion | None:
    """Return the pose of a sensor from x, y [m] and yaw [rad]; None where it is that of what carries it."""
    if mount == (0.0, 0.0, 0.0):
        return None
    return Motion(np.array([[mount[0], mount[1], 0.0]]), _turns(np.array([mount[2]])))


def _turns(yaw: Float64) -> Float64:
    """Return quaternions (N, 4) of turns about z (N,) [rad]."""
    flat = np.zeros(len(yaw))
    return np.column_stack([flat, flat, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])
