"""The fit of given poses: steps of the given path compared with those of the path that is matched from the sweeps.

Both paths are compared over pairs of sweeps between which the sensor went a little way. A delay of the poses and a mount
that the log does not tell are found from the same pairs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lidarcli.options.times import SECOND_NS
from lidarcli.pose.matched import MAX_UNPLACED, MIN_STEP, wrapped
from lidarcli.pose.sources import PoseChain, later
from lidarcli.sweeps.types import Bool, Float64, Int64

PAIR_LENGTH, PAIR_TURN = 0.3, 0.15
"""A pair ends at the first sweep that is so far from its beginning [m, rad], ..."""
PAIR_SECONDS = 3.0
"""... or after so long [s], where either path has gone `MOVED_LENGTH` or `MOVED_TURN` by then."""
MOVED_LENGTH, MOVED_TURN = 0.1, 0.05
MAX_PAIRS = 400
MIN_PAIRS = 8
OFF_LENGTH, OFF_LENGTH_GROWS = 0.05, 0.12
"""Two steps agree if their ends are no further apart than this [m], and this share of their length more, ..."""
OFF_TURN, OFF_TURN_GROWS = np.deg2rad(2.0), 0.1
"""... and their turns differ by no more than this [rad], and this share of the turn more."""
TURN_RATE, MIN_TURN = 10.0, 0.5
"""Steps that turn faster and by more are jumps, too [rad/s, rad]."""
JUMP_SPEED, JUMP_LENGTH = 10.0, 0.5
"""A given step that is longer than this and faster [m/s, m] is a jump."""
LONGEST_DELAY, DELAY_STEP, FINE_STEP = 0.6, 0.05, 0.01
"""Delays that are tried, to both sides, first in large steps and then around the best in small ones [s]."""
MIN_GIVEN, MAX_OFF, CLEARLY_BETTER = 0.6, 3.0, 0.05
"""Least share of pairs with a delayed pose; greatest cost of a pair; share by which a larger delay has to be better."""
FAR_STEP, MAX_TRIED, FAR_PAIRS = 0.1, 1 << 17, 60
"""Greater delays are tried in such steps [s], so many at most, by so many pairs."""
MIN_DELAY, SHARPER = 0.03, 0.7
"""Least delay of poses that fit also without one [s], and the greatest cost with it as a share of that without; that of a
far delay as a share of that of another one."""
FAR_TURN = 0.35
"""A mount that is turned by more is a fault by itself, and may be one of the driver [rad]."""
ACCEPTED = 0.8
"""Share of agreeing pairs from which poses are accepted as they are."""
CORRECTED, GAIN = 0.5, 0.1
"""Share from which they are accepted with a delay and a mount, and by how much these must better it."""
RATIOS = 0.8, 1.25
"""Given lengths and turns as a share of the matched ones, from least to most."""
LONG_STEP, LARGE_TURN, MIN_LONG = 0.15, 0.08, 5
"""Steps that are longer, or turn more, count for such a share [m, rad]; so many or fewer give none."""
MOUNT_SCALE = 0.05
"""Scale of the robust weights of a mount [m]."""
Steps = Float64
"""(K, 3): x, y [m] and turn [rad], in the frame at the beginning of each step."""


@dataclass(frozen=True, slots=True)
class PoseFit:
    """Fit of the given poses of one sensor to its sweeps."""

    verdict: str
    """accepted, corrected, rejected or unchecked."""
    share: float
    """Share of pairs that agree, after the correction where there is one; NaN where there are too few."""
    pairs: int
    delay: float = 0.0
    """The pose of a sweep is that at its header stamp and this much later [s]."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of the sensor in the frame that the poses are of: x, y [m], yaw [rad]."""
    ratio: float = float("nan")
    """Given lengths as a share of the matched ones."""
    turn_ratio: float = float("nan")
    moves: bool = False
    """True where nothing could be checked, though the given path goes some way."""
    as_told: float = float("nan")
    """Share of pairs that agree without the correction, where there is one."""

    @property
    def is_evaluated(self) -> bool:
        """True where enough steps could be compared."""
        return self.verdict != "unchecked"


def steps_between(begin: Float64, end: Float64) -> Steps:
    """Return the steps from poses (K, 3) to others, each in the frame of the first."""
    cos, sin = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    x, y = end[:, 0] - begin[:, 0], end[:, 1] - begin[:, 1]
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, wrapped(end[:, 2] - begin[:, 2])])


def poses_after(begin: Float64, step: Float64) -> Float64:
    """Return the poses (K, 3) after steps (K, 3) or (3,) in their frames."""
    step = np.broadcast_to(step, begin.shape)
    cos, sin = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    x = begin[:, 0] + cos * step[:, 0] - sin * step[:, 1]
    y = begin[:, 1] + sin * step[:, 0] + cos * step[:, 1]
    return np.column_stack([x, y, wrapped(begin[:, 2] + step[:, 2])])


def jump_of(chain: PoseChain) -> tuple[float, float]:
    """Return the longest step and the widest turn of moving poses of a chain that no sensor makes [m, rad]; 0 for none."""
    length = turn = 0.0
    for track in (step.track for step in chain.steps if not step.track.static):
        seconds = np.diff(track.stamp_ns) / SECOND_NS
        if not len(seconds) or np.median(seconds) <= MIN_STEP:
            continue
        lengths = np.hypot(*np.diff(track.motion.position[:, :2], axis=0).T)
        length = max(length, float(lengths[lengths > np.maximum(JUMP_SPEED * seconds, JUMP_LENGTH)].max(initial=0.0)))
        each = track.motion.rotation
        turns = 2.0 * np.arccos(np.clip(np.abs(np.sum(each[1:] * each[:-1], axis=1)), 0.0, 1.0))
        turn = max(turn, float(turns[turns > np.maximum(TURN_RATE * seconds, MIN_TURN)].max(initial=0.0)))
    return length, turn


def evaluate_poses(
    stamp_ns: Int64,
    matched: Float64,
    given_at: Callable[[Int64], Float64],
    pieces: Float64 | None = None,
    *,
    doubted: bool = False,
) -> PoseFit:
    """Compare a given path with the matched one.

    Parameters
    ----------
    stamp_ns : (S,) header stamps, increasing
    matched : (S, 3) x, y, yaw of the matched path, NaN where a sweep has no pose
    given_at : gives the given poses of the sensor (K, 3) at stamps (K,), NaN where there is none
    pieces : (S,) number of the piece of the matched path; steps from one to another are not known
    doubted : True to look for a delay and a mount also where the steps fit as they are

    Returns
    -------
    The verdict by the first rule that holds: unchecked, accepted, corrected, rejected.
    """
    given = given_at(stamp_ns)
    seconds = (stamp_ns - stamp_ns[0]) * 1e-9 if len(stamp_ns) else np.zeros(0)
    begin, end = pairs_of(seconds, matched, given, pieces)
    placed = float(np.isfinite(matched[:, 0]).mean()) if len(matched) else 0.0
    if placed < 1.0 - MAX_UNPLACED or len(begin) < MIN_PAIRS:
        gone = np.ptp(given[np.isfinite(given[:, 0]), :2], axis=0) if np.isfinite(given).any() else np.zeros(2)
        moves = bool(gone.max() > PAIR_LENGTH)
        return PoseFit("unchecked", float("nan"), len(begin), moves=moves)
    step = steps_between(matched[begin], matched[end])
    as_given = steps_between(given[begin], given[end])
    share = float(_agree(step, as_given).mean())
    pairs = _Pairs(stamp_ns[begin], stamp_ns[end], step, given_at)
    accepted = None
    if share >= ACCEPTED:
        accepted = _sharper(PoseFit("accepted", share, len(begin)), pairs)
        if not doubted:
            return accepted
    delay, mount, best = _corrected(pairs)
    ratio, turn_ratio = _ratios(step, best)
    better = float(_agree(step, mounted_steps(best, mount)).mean())
    # Of poses that lie at the bound, a greater delay may fit better yet.
    gained = better >= share + GAIN or (share >= ACCEPTED and better >= share and (delay, mount) != (0.0, (0.0, 0.0, 0.0)))
    found = better >= CORRECTED and gained and abs(delay) < LONGEST_DELAY - 0.5 * DELAY_STEP
    fits = all(not np.isfinite(one) or RATIOS[0] <= one <= RATIOS[1] for one in (ratio, turn_ratio))
    turn_given = _ratios(step, as_given)[1]
    fit = PoseFit("rejected", share, len(begin), ratio=ratio, turn_ratio=turn_given)
    if found and fits:
        return replace(
            fit, verdict="corrected", share=better, delay=delay, mount=mount, turn_ratio=turn_ratio, as_told=share
        )
    return accepted or fit


def far_delay(
    stamp_ns: Int64,
    matched: Float64,
    given_at: Callable[[Int64], Float64],
    pieces: Float64 | None,
    span_ns: tuple[int, int] | None,
    recorded_ns: int,
) -> PoseFit | None:
    """Find a delay of any size with which the given steps fit the matched ones; None where none or several do.

    Parameters are as of `evaluate_poses`; `span_ns`: first and last stamp of the given poses; `recorded_ns`: the delay by
    the times of the recording, 0 for none.
    """
    # Links that are never known at the same time have no span.
    if span_ns is None or span_ns[1] < span_ns[0] or not len(stamp_ns):
        return None
    begin, end = pairs_of((stamp_ns - stamp_ns[0]) * 1e-9, matched, matched, pieces)
    if len(begin) < MIN_PAIRS:
        return None
    step = steps_between(matched[begin], matched[end])

    def fit_at(delay_ns: int) -> PoseFit:
        """Return the fit with the best delay and mount around a delay."""
        pairs = _Pairs(stamp_ns[begin], stamp_ns[end], step, lambda at_ns: given_at(later(at_ns, delay_ns)))
        delay, mount, given = _corrected(pairs)
        known = np.isfinite(given[:, 0])
        share = float(_agree(step[known], mounted_steps(given[known], mount)).mean()) if known.any() else 0.0
        return PoseFit("corrected", share, len(begin), round(delay + delay_ns / SECOND_NS, 3), mount)

    if abs(recorded_ns) > LONGEST_DELAY * SECOND_NS:
        found = fit_at(recorded_ns)
        if found.share >= CORRECTED:
            return found
    # All delays at which the paths overlap, by some of the pairs.
    some = np.unique(np.linspace(0, len(begin) - 1, FAR_PAIRS).astype(np.int64))
    first_ns, whole = int(stamp_ns[0]), int(stamp_ns[-1] - stamp_ns[0])
    tick = max(round(FAR_STEP * SECOND_NS), (span_ns[1] - span_ns[0] + whole) // MAX_TRIED)
    pad, count = whole // tick + 2, (span_ns[1] - span_ns[0] + whole) // tick + 2
    grid = given_at(span_ns[0] + tick * np.arange(-pad, count + 2, dtype=np.int64))
    ahead = np.diff(grid, axis=0)
    ahead[:, 2] = wrapped(ahead[:, 2])
    cost, known = np.zeros(count), np.zeros(count)
    for k in some.tolist():
        places = [divmod(int(stamp_ns[row[k]]) - first_ns, tick) for row in (begin, end)]
        poses = [grid[at : at + count] + part / tick * ahead[at : at + count] for at, part in places]
        off = np.minimum(np.add(*_off(step[k : k + 1], steps_between(*poses))), MAX_OFF)
        known += np.isfinite(off)
        cost += np.nan_to_num(off)
    cost = np.where(known >= max(MIN_GIVEN * known.max(), 1.0), cost / np.maximum(known, 1.0), MAX_OFF)
    best = int(np.argmin(cost))
    near = round(2.0 * LONGEST_DELAY * SECOND_NS / tick)
    others = np.concatenate([cost[: max(best - near, 0)], cost[best + near + 1 :]])
    delay_ns = span_ns[0] - first_ns + (best - pad) * tick
    if cost[best] > SHARPER * others.min(initial=MAX_OFF) or abs(delay_ns) < LONGEST_DELAY * SECOND_NS:
        return None
    found = fit_at(delay_ns)
    return found if found.share >= ACCEPTED else None


def pairs_of(seconds: Float64, matched: Float64, given: Float64, pieces: Float64 | None = None) -> tuple[Int64, Int64]:
    """Return the sweeps where pairs begin and end: a pair is a short stretch of the path, within one of its `pieces`."""
    known = np.flatnonzero(np.isfinite(matched[:, 0]) & np.isfinite(given[:, 0]))
    pairs = []
    for at, first in enumerate(known.tolist()):
        last = int(np.searchsorted(seconds[known], seconds[first] + PAIR_SECONDS))
        later = known[at + 1 : last + 1]
        if not len(later):
            continue
        step = steps_between(np.broadcast_to(matched[first], (len(later), 3)), matched[later])
        far = (np.hypot(step[:, 0], step[:, 1]) > PAIR_LENGTH) | (np.abs(step[:, 2]) > PAIR_TURN)
        if far.any():
            pairs.append((first, int(later[far.argmax()])))
            continue
        other = steps_between(given[first : first + 1], given[later[-1:]])
        both = np.vstack([step[-1:], other])
        moved = (np.hypot(both[:, 0], both[:, 1]) > MOVED_LENGTH) | (np.abs(both[:, 2]) > MOVED_TURN)
        if seconds[later[-1]] - seconds[first] >= PAIR_SECONDS and moved.any():
            pairs.append((first, int(later[-1])))
    if len(pairs) > MAX_PAIRS:
        pairs = [pairs[k] for k in np.linspace(0, len(pairs) - 1, MAX_PAIRS).astype(int)]
    begin, end = np.array(pairs, np.int64).reshape(-1, 2).T
    is_whole = slice(None) if pieces is None else pieces[begin] == pieces[end]
    return begin[is_whole], end[is_whole]


def _off(step: Steps, other: Steps) -> tuple[Float64, Float64]:
    """Return how far steps are from others in place and in turn, as a share of what is allowed."""
    length = np.hypot(step[:, 0], step[:, 1])
    off = np.hypot(step[:, 0] - other[:, 0], step[:, 1] - other[:, 1])
    turn = np.abs(wrapped(step[:, 2] - other[:, 2]))
    return off / (OFF_LENGTH + OFF_LENGTH_GROWS * length), turn / (OFF_TURN + OFF_TURN_GROWS * np.abs(step[:, 2]))


def _agree(step: Steps, other: Steps) -> Bool:
    """Return which steps (K,) agree with the others; one that is not known does not."""
    off, turn = _off(step, other)
    with np.errstate(invalid="ignore"):
        found: Bool = (off < 1.0) & (turn < 1.0)
    return found


def mounted_steps(step: Steps, mount: tuple[float, float, float]) -> Steps:
    """Return the steps of a sensor that is mounted so on what makes `step`."""
    at = np.array(mount)
    return steps_between(np.broadcast_to(at, step.shape), poses_after(step, at))


class _Pairs(NamedTuple):
    """K pairs of sweeps, and what gives the given poses at stamps (K,)."""

    begin_ns: Int64
    end_ns: Int64
    step: Steps
    """The steps of the matched path."""
    given_at: Callable[[Int64], Float64]

    def given(self, delay: float) -> Steps:
        """Return the given steps so much later [s]."""
        delay_ns = round(delay * 1e9)
        return steps_between(self.given_at(self.begin_ns + delay_ns), self.given_at(self.end_ns + delay_ns))


def _sharper(fit: PoseFit, pairs: _Pairs) -> PoseFit:
    """Return the fit of accepted poses, with the delay that is clearly better than none."""

    def cost(delay: float) -> float:
        off, turn = _off(pairs.step, pairs.given(delay))
        # Steps beyond the ends of the given path count as much as those that are far off.
        return float(np.mean(np.nan_to_num(np.minimum(off + turn, MAX_OFF), nan=MAX_OFF)))

    count, fine = round(LONGEST_DELAY / DELAY_STEP), round(DELAY_STEP / FINE_STEP)
    coarse = min((number * DELAY_STEP for number in range(-count, count + 1)), key=cost)
    best = min((coarse + number * FINE_STEP for number in range(1 - fine, fine)), key=cost)
    is_bound = abs(coarse) > LONGEST_DELAY - 0.5 * DELAY_STEP
    if is_bound or abs(best) < MIN_DELAY or cost(best) > SHARPER * cost(0.0):
        return fit
    return replace(fit, verdict="corrected", delay=round(best, 3), as_told=fit.share)


class _Tried(NamedTuple):
    """A delay that was tried, with the mount that fits best with it."""

    cost: float
    delay: float
    mount: tuple[float, float, float]
    given: Steps


def _corrected(pairs: _Pairs) -> tuple[float, tuple[float, float, float], Steps]:
    """Find the delay and the mount with which the given steps fit best; return them and the given steps so delayed."""

    step = pairs.step

    def tried(delay: float) -> _Tried | None:
        given = pairs.given(delay)
        known = np.isfinite(given[:, 0])
        if known.mean() < MIN_GIVEN:
            return None
        mount = mount_between(step[known], given[known])
        off, turn = _off(step[known], mounted_steps(given[known], mount))
        cost = float(np.mean(np.minimum(off, MAX_OFF) + np.minimum(turn, MAX_OFF)))
        return _Tried(cost, delay, mount, given)

    best: _Tried | None = None
    count = round(LONGEST_DELAY / DELAY_STEP)
    # A small delay is more likely than a large one that fits as well.
    for number in sorted(range(-count, count + 1), key=lambda one: (abs(one), one)):
        one = tried(number * DELAY_STEP)
        if one is not None and (best is None or one.cost < best.cost - CLEARLY_BETTER * max(1.0, best.cost)):
            best = one
    if best is None:
        return 0.0, (0.0, 0.0, 0.0), np.full_like(step, np.nan)
    if best.delay:
        fine = round(DELAY_STEP / FINE_STEP)
        near = [tried(best.delay + number * FINE_STEP) for number in range(1 - fine, fine)]
        best = min((one for one in near if one is not None), key=lambda one: one.cost)
    return round(best.delay, 3), best.mount, best.given


def mount_between(step: Steps, given: Steps) -> tuple[float, float, float]:
    """Find where a sensor that makes `step` is mounted on what makes `given`: robust hand-eye calibration in the plane."""
    straight = (np.abs(step[:, 2]) < 0.1) & (np.hypot(*step[:, :2].T) > 0.1) & (np.hypot(*given[:, :2].T) > 0.1)
    yaws = [0.0]
    if np.count_nonzero(straight) >= 5:
        apart = np.arctan2(given[straight, 1], given[straight, 0]) - np.arctan2(step[straight, 1], step[straight, 0])
        yaws = [float(np.arctan2(np.median(np.sin(apart)), np.median(np.cos(apart)))), 0.0]
        yaws += [0.5 * np.pi, -0.5 * np.pi, np.pi]
    best, most = (0.0, 0.0, 0.0), -1.0
    cos, sin = np.cos(given[:, 2]), np.sin(given[:, 2])
    lever = np.stack([np.stack([cos - 1.0, -sin], 1), np.stack([sin, cos - 1.0], 1)], 1)
    for yaw in yaws:
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        apart = step[:, :2] @ turn.T - given[:, :2]
        place = np.zeros(2)
        for _ in range(8):
            left = np.einsum("kij,j->ki", lever, place) - apart
            weight = 1.0 / (1.0 + (left * left).sum(1) / MOUNT_SCALE**2) ** 2
            # A mount that the turns do not fix stays near 0.
            normal = np.einsum("k,kij,kil->jl", weight, lever, lever) + 0.2 * np.eye(2)
            place = np.linalg.solve(normal, np.einsum("k,kij,ki->j", weight, lever, apart))
        mount = float(place[0]), float(place[1]), yaw
        share = float(_agree(step, mounted_steps(given, mount)).mean())
        if share > most + 0.02:
            best, most = mount, share
    return best


def _ratios(step: Steps, given: Steps) -> tuple[float, float]:
    """Return given lengths and turns as a share of the matched ones, by medians; NaN where there are too few."""
    length, far = np.hypot(step[:, 0], step[:, 1]), np.hypot(given[:, 0], given[:, 1])
    long, turns = ((length > LONG_STEP) & np.isfinite(far), (np.abs(step[:, 2]) > LARGE_TURN) & np.isfinite(far))
    ratio = float(np.median(far[long] / length[long])) if np.count_nonzero(long) > MIN_LONG else float("nan")
    turned = wrapped(given[turns, 2]) / step[turns, 2]
    return ratio, float(np.median(turned)) if len(turned) > MIN_LONG else float("nan")


# The path of a sensor from its sweeps alone, as a track of poses, and the order in which it sends its beams.


# Findings on the poses of a log: frames that lead nowhere, contradictions of the tree, broken rotations, leaps.
