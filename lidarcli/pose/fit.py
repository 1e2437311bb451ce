"""The fit of given poses: steps of the given path beside those of the path that is matched from the sweeps.

Both paths are compared over pairs of sweeps between which the sensor went a little way. A delay of the poses and a mount
that the log does not tell are found from the same pairs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import some_of, times
from lidarcli.formalism.scan_matching import Matcher
from lidarcli.options.choices import BEAM_ORDERS, MATCH, MAX_DELAY
from lidarcli.pose.sources import LEVEL, WORLDS, GivenPaths, PoseChain, PoseSources, by_precedence, later, namespace
from lidarcli.pose.tracks import SECOND_NS, TUM, Track, flat, frame_name, gathered
from lidarcli.sweeps.findings import Finding, Fix
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepBatch

MIN_STEP = 0.001
"""Stamps that are mostly closer tell no times [s]."""
PAIR_LENGTH, PAIR_TURN = 0.3, 0.15
"""A pair ends at the first sweep that is so far from its beginning [m, rad], ..."""
PAIR_SECONDS = 3.0
"""... or after so long [s], where either path has gone `MOVED_LENGTH` or `MOVED_TURN` by then."""
MOVED_LENGTH, MOVED_TURN = 0.1, 0.05
MAX_PAIRS = 400
MIN_PAIRS = 8
MAX_UNPLACED = 0.3
"""Nothing is judged where a greater share of the sweeps has no matched pose."""
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
MIN_TOLD, MAX_OFF, CLEARLY_BETTER = 0.6, 3.0, 0.05
"""Least share of pairs with a delayed pose; greatest cost of a pair; share by which a larger delay has to be better."""
FAR_STEP, MAX_TRIED, FAR_PAIRS = 0.1, 1 << 17, 60
"""Greater delays are tried in such steps [s], so many at most, by so many pairs."""
MIN_DELAY, SHARPER = 0.03, 0.7
"""Least delay of poses that fit also without one [s], and the greatest cost with it as a share of that without; that of a
far delay as a share of that of another one."""
ACCEPTED = 0.8
"""Share of agreeing pairs from which poses are accepted as they are."""
CORRECTED, GAIN = 0.5, 0.1
"""Share from which they are accepted with a delay and a mount, and by how much these must better it."""
RATIOS = 0.8, 1.25
"""Told lengths and turns as a share of the matched ones, from least to most."""
LONG_STEP, LARGE_TURN, MIN_LONG = 0.15, 0.08, 5
"""Steps that are longer, or turn more, tell such a share [m, rad]; so many or fewer tell none."""
MOUNT_SCALE = 0.05
"""Scale of the robust weights of a mount [m]."""

STANDING_OFF, STANDING_TURN = 0.02, np.deg2rad(0.5)
"""A sensor stands whose matched poses are no further from their middle [m, rad], but for 1 % of them."""
MAX_SLIDING = 0.5
"""Share of sweeps that may slide of a sensor that is known to stand."""
STILL_SECONDS, STILL_OFF, STILL_TURN = 2.0, 0.05, 0.035
"""It stands at a sweep if the poses at both ends of so many seconds around it are no further apart [m, rad]."""

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
    """Pose of the sensor in the frame that the poses tell of: x, y [m], yaw [rad]."""
    ratio: float = float("nan")
    """Given lengths as a share of the matched ones."""
    turn_ratio: float = float("nan")
    moves: bool = False
    """True where nothing could be checked, though the given path goes some way."""
    as_told: float = float("nan")
    """Share of pairs that agree without the correction, where there is one."""

    @property
    def is_judged(self) -> bool:
        """True where enough steps could be compared."""
        return self.verdict != "unchecked"


def wrapped(angle: Float64) -> Float64:
    """Return angles within ±π [rad]."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


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


def judge_poses(
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
    begin, end = pairs_of(seconds, matched, given)
    if pieces is not None:
        whole = pieces[begin] == pieces[end]
        begin, end = begin[whole], end[whole]
    placed = float(np.isfinite(matched[:, 0]).mean()) if len(matched) else 0.0
    if placed < 1.0 - MAX_UNPLACED or len(begin) < MIN_PAIRS:
        gone = np.ptp(given[np.isfinite(given[:, 0]), :2], axis=0) if np.isfinite(given).any() else np.zeros(2)
        moves = bool(gone.max() > PAIR_LENGTH)
        return PoseFit("unchecked", float("nan"), len(begin), moves=moves)
    step = steps_between(matched[begin], matched[end])
    as_given = steps_between(given[begin], given[end])
    agree = _agree(step, as_given)
    share = float(agree.mean())
    accepted = None
    if share >= ACCEPTED:
        accepted = _sharper(PoseFit("accepted", share, len(begin)), stamp_ns, begin, end, step, given_at)
        if not doubted:
            return accepted
    delay, mount, best = _corrected(stamp_ns, begin, end, step, given_at)
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

    Parameters are as of `judge_poses`; `span_ns`: first and last stamp of the given poses; `recorded_ns`: the delay by the
    times of the recording, 0 for none.
    """
    if span_ns is None or not len(stamp_ns):
        return None
    begin, end = pairs_of((stamp_ns - stamp_ns[0]) * 1e-9, matched, matched)
    if pieces is not None:
        whole = pieces[begin] == pieces[end]
        begin, end = begin[whole], end[whole]
    if len(begin) < MIN_PAIRS:
        return None
    step = steps_between(matched[begin], matched[end])

    def fit_at(delay_ns: int) -> PoseFit:
        """Return the fit with the best delay and mount around a delay."""
        delay, mount, given = _corrected(stamp_ns, begin, end, step, lambda at_ns: given_at(later(at_ns, delay_ns)))
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
    cost = np.where(known >= max(MIN_TOLD * known.max(), 1.0), cost / np.maximum(known, 1.0), MAX_OFF)
    best = int(np.argmin(cost))
    near = round(2.0 * LONGEST_DELAY * SECOND_NS / tick)
    others = np.concatenate([cost[: max(best - near, 0)], cost[best + near + 1 :]])
    delay_ns = span_ns[0] - first_ns + (best - pad) * tick
    if cost[best] > SHARPER * others.min(initial=MAX_OFF) or abs(delay_ns) < LONGEST_DELAY * SECOND_NS:
        return None
    found = fit_at(delay_ns)
    return found if found.share >= ACCEPTED else None


def pairs_of(seconds: Float64, matched: Float64, given: Float64) -> tuple[Int64, Int64]:
    """Return the sweeps where pairs begin and end: a pair is a short way of the sensor."""
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
    found = np.array(pairs, np.int64).reshape(-1, 2)
    return found[:, 0], found[:, 1]


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


def _delayed(stamp_ns: Int64, begin: Int64, end: Int64, given_at: Callable[[Int64], Float64], delay: float) -> Steps:
    """Return the given steps between pairs of sweeps, so much later [s]."""
    delay_ns = round(delay * 1e9)
    return steps_between(given_at(stamp_ns[begin] + delay_ns), given_at(stamp_ns[end] + delay_ns))


def _sharper(
    fit: PoseFit, stamp_ns: Int64, begin: Int64, end: Int64, step: Steps, given_at: Callable[[Int64], Float64]
) -> PoseFit:
    """Return the fit of accepted poses, with the delay that is clearly better than none."""

    def cost(delay: float) -> float:
        off, turn = _off(step, _delayed(stamp_ns, begin, end, given_at, delay))
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


def _corrected(
    stamp_ns: Int64, begin: Int64, end: Int64, step: Steps, given_at: Callable[[Int64], Float64]
) -> tuple[float, tuple[float, float, float], Steps]:
    """Find the delay and the mount with which the given steps fit best; return them and the given steps so delayed."""

    def tried(delay: float) -> _Tried | None:
        given = _delayed(stamp_ns, begin, end, given_at, delay)
        known = np.isfinite(given[:, 0])
        if known.mean() < MIN_TOLD:
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
            # A mount that the turns do not tell stays near 0.
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


def stands(matched: Float64, slides: Float64) -> bool:
    """Return whether the sensor never moves, by the matched path.

    Parameters
    ----------
    matched : (S, 3) x, y, yaw, NaN where a sweep has no pose
    slides : (S,) 1 where the place is not fixed along some direction
    """
    known = np.isfinite(matched[:, 0])
    if len(known) == 0 or known.mean() < 1.0 - MAX_UNPLACED:
        return False
    middle = np.median(matched[known], axis=0)
    off = np.hypot(matched[known, 0] - middle[0], matched[known, 1] - middle[1])
    turn = np.abs(wrapped(matched[known, 2] - middle[2]))
    fixed = float(np.mean(slides[known] > 0)) < MAX_SLIDING
    return bool(fixed and np.quantile(off, 0.99) < STANDING_OFF and np.quantile(turn, 0.99) < STANDING_TURN)


def still_at(stamp_ns: Int64, matched: Float64, slides: Float64) -> Bool:
    """Return at which sweeps (S,) the sensor stands; empty where too few sweeps have a pose.

    Parameters are as of `stands`, with the stamps of the sweeps (S,) [ns], increasing.
    """
    known = np.isfinite(matched[:, 0])
    if len(known) == 0 or known.mean() < 1.0 - MAX_UNPLACED:
        return np.zeros(0, bool)
    if stands(matched, slides):
        return np.ones(len(known), bool)
    seconds = (stamp_ns[-1] - stamp_ns[0]) * 1e-9
    third = min(max(1, round(STILL_SECONDS / 3.0 * len(stamp_ns) / max(seconds, 1e-3))), len(known))
    numbers = np.arange(len(known))
    columns = matched[known, 0], matched[known, 1], np.unwrap(matched[known, 2])
    filled = np.column_stack([np.interp(numbers, numbers[known], column) for column in columns])
    padded = np.pad(filled, ((third, third), (0, 0)), mode="edge")
    middles = np.median(np.lib.stride_tricks.sliding_window_view(padded, third, axis=0), axis=2)
    # Medians of the third of the window before each sweep, and of the third after it.
    apart = (middles[third + 1 :] - middles[: -(third + 1)])[: len(known)]
    still: Bool = (np.hypot(apart[:, 0], apart[:, 1]) < STILL_OFF) & (np.abs(apart[:, 2]) < STILL_TURN)
    return still


# The path of a sensor from its sweeps alone, as a track of poses, and the order in which it sends its beams.

TYPE = "matched"
"""Stands where a track has the type of its messages."""
AUTO, FORWARD, REVERSE, ONCE = BEAM_ORDERS
SHORTEST_SWEEP = 0.005
"""Duration below which headers do not count [s]: all beams are taken at once."""
MIN_SHARE, MAX_SHARE, USUAL_SHARE = 0.2, 1.25, 0.9
"""Shares of the time from sweep to sweep that a sweep can take, and the share where headers tell another."""
SKEWED, TYPICAL_RANGE = 0.03, 2.0
"""Motion during a sweep from which on it tells the order of its beams [m]; the range at which turns move points [m]."""
MIN_SKEWED, BLOCKS, CLEAR, OPPOSITE = 40, 20, 2.0, 1.5
"""Least sweeps that tell an order, blocks they are compared in, deviations from which a difference is clear, and how many
times as many it takes to the opposite order: all at once lies between the two."""
LONGEST_SLIDE = 1.0
"""A slide without a guess loses its poses from this duration on, and no pose is between poses further apart [s]."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Times at which the beams of sweeps are sent."""

    order: str = AUTO
    """Order of the beams, of `BEAM_ORDERS`; `auto`: as the headers tell."""
    duration: float = 0.0
    """Duration of a sweep [s] where the headers tell none that can be; 0 for that of the headers."""

    @property
    def takes_time(self) -> bool:
        """True where a sweep takes time whatever the headers tell."""
        return self.duration > 0.0 and self.order in (FORWARD, REVERSE)

    def of(self, headers: Float64) -> tuple[Float64, Float64]:
        """Return (S,) the times of the first and of the last beam after the header stamp [s].

        `headers`: (S,) duration of each sweep as its header tells it, 0 for none.
        """
        none = np.zeros(len(headers))
        if self.order == AUTO:
            return none, np.where(np.abs(headers) < SHORTEST_SWEEP, 0.0, headers)
        if self.order == ONCE:
            return none, none
        lasts = np.full(len(headers), self.duration) if self.duration else headers
        return (none, lasts) if self.order == FORWARD else (lasts, none)


def headers_of(sweeps: SweepBatch) -> Float64:
    """Return (S,) the duration of each sweep as its header tells it [s], 0 for none."""
    return np.zeros(len(sweeps)) if sweeps.duration is None else np.nan_to_num(sweeps.duration)


def duration_of(sweeps: Sequence[SweepBatch]) -> tuple[float, float]:
    """Return the duration of a sweep where the headers tell none that can be, else 0, and the one that counts [s]."""
    stamps = np.concatenate([batch.stamp_ns for batch in sweeps])
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0, 0.0
    period = float(np.median(steps)) / SECOND_NS
    given = [headers_of(batch) for batch in sweeps if batch.duration is not None]
    headers = float(np.median(np.concatenate(given))) if given else 0.0
    if MIN_SHARE * period <= headers <= MAX_SHARE * period:
        return 0.0, headers
    return USUAL_SHARE * period, USUAL_SHARE * period


class MatchedPath:
    """The path of one sensor: a fold over its batches in log order, however they are cut.

    A sweep has no pose where it has fewer than 15 points, repeats a stamp, or fits nowhere. Such sweeps do not change the
    map. After 10 that fit nowhere the map begins anew at the last known pose: the path is not to be trusted across that.
    """

    def __init__(self, timing: Timing | None = None) -> None:
        self.timing = timing or Timing()
        self._matcher = Matcher(0)
        self._first_ns: int | None = None
        self._stamp_ns: list[Int64] = []
        self._record_ns: list[Int64] = []
        self._found: list[Float64] = []

    def add(self, sweeps: SweepBatch, given: Float64 | None = None) -> Float64:
        """Take sweeps of one topic and frame; return their x, y, yaw (S, 3), as `poses` has them.

        Parameters
        ----------
        given : (S, 4) x, y, yaw of given poses of the sensor, NaN for none, and the part of the given path they belong to;
            the search begins with the steps between them
        """
        if not len(sweeps):
            return np.zeros((0, 3))
        if self._first_ns is None:
            self._first_ns = int(sweeps.stamp_ns[0])
        seconds = (sweeps.stamp_ns - self._first_ns) / SECOND_NS
        found = np.empty((len(sweeps), self._matcher.columns))
        self._matcher.follow(
            np.ascontiguousarray(sweeps.ranges, np.float32),
            np.ascontiguousarray(sweeps.beams, np.int32),
            np.ascontiguousarray(sweeps.angle_min, np.float64),
            np.ascontiguousarray(sweeps.angle_increment, np.float64),
            np.column_stack([seconds, *self.timing.of(headers_of(sweeps))]),
            np.full((len(sweeps), 4), np.nan) if given is None else np.ascontiguousarray(given),
            found,
        )
        self._stamp_ns.append(sweeps.stamp_ns)
        self._record_ns.append(sweeps.record_ns)
        self._found.append(found)
        return found[:, :3]

    @property
    def stamp_ns(self) -> Int64:
        """(S,) stamps of all sweeps [ns]."""
        return _one(self._stamp_ns) if self._stamp_ns else np.zeros(0, np.int64)

    @property
    def record_ns(self) -> Int64:
        """(S,) record times of all sweeps [ns]."""
        return _one(self._record_ns) if self._record_ns else np.zeros(0, np.int64)

    @property
    def poses(self) -> Float64:
        """(S, 3) x, y [m] and yaw [rad] of all sweeps, from the first; NaN without a pose."""
        return self._column(slice(0, 3))

    @property
    def sharp(self) -> Float64:
        """(S,) share of the points that lie on the map within 15 mm."""
        return self._column(5)

    @property
    def pieces(self) -> Float64:
        """(S,) number of the piece of the path, from 1: it is not known how one lies to the next."""
        return self._column(6)

    @property
    def slides(self) -> Float64:
        """(S,) 1 where the walls in view do not fix the place along some direction, NaN without a pose."""
        return self._column(8)

    @property
    def restarts(self) -> int:
        """Times that the map began anew."""
        return max(self._matcher.pieces - 1, 0)

    @property
    def placed(self) -> float:
        """Share of the sweeps that have a pose; 0 of none."""
        poses = self.poses
        return float(np.isfinite(poses[:, 0]).mean()) if len(poses) else 0.0

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        steps = np.diff(self.poses[:, :2], axis=0)
        return float(np.nansum(np.hypot(steps[:, 0], steps[:, 1])))

    def turns(self, duration: float) -> Float64:
        """Return (S,) how far points move as the sensor turns during each sweep [m], 0 where it is not known."""
        if not len(self.stamp_ns):
            return np.zeros(0)
        turns, seconds = np.abs(np.diff(self.poses[:, 2])), np.diff(self.stamp_ns) / SECOND_NS
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = TYPICAL_RANGE * np.minimum(turns, TURN - turns) * (duration / seconds)
        return np.concatenate([[0.0], np.nan_to_num(moved, nan=0.0, posinf=0.0, neginf=0.0)])

    def track(self, topic: str, frame: str) -> Track | None:
        """Return the path from the frame of the first sweep; None where no sweep has a pose.

        Long slides without a guess have no poses.
        """
        poses, there = self.poses, self._there()
        if not len(there):
            return None
        half, flat = 0.5 * poses[there, 2], np.zeros(len(there))
        numbers = np.column_stack([poses[there, :2], flat, flat, flat, np.sin(half), np.cos(half)])
        return gathered((topic, TYPE, MATCH, frame), self.stamp_ns[there], numbers, self.record_ns[there], Counter())

    @property
    def gaps(self) -> Int64:
        """(G, 2) stamps of the sweeps before and after each stretch without poses [ns].

        It is longer than `LONGEST_SLIDE`, or the map began anew after it.
        """
        there, stamps = self._there(), self.stamp_ns
        there = there[np.argsort(stamps[there], kind="stable")]
        ends = np.column_stack([stamps[there[:-1]], stamps[there[1:]]])
        is_long = ends[:, 1] - ends[:, 0] > LONGEST_SLIDE * SECOND_NS
        if len(stamps) > 1 and np.median(np.abs(np.diff(stamps))) < MIN_STEP * SECOND_NS:
            is_long[:] = True
        is_lost = np.diff(self.pieces[there]) != 0
        found: Int64 = ends[(np.diff(there) > 1) & (is_long | is_lost)]
        return found

    def _there(self) -> Int64:
        """Return the numbers of the sweeps whose poses are those of the path."""
        return np.flatnonzero(~np.isnan(self.poses[:, 0]) & ~self._long_slides())

    def _long_slides(self) -> Bool:
        """Return (S,) True in slides without a guess that are longer than `LONGEST_SLIDE`."""
        sliding = (np.nan_to_num(self.slides) > 0) & (np.nan_to_num(self._column(7)) == 0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], sliding.astype(np.int8), [0]])))
        long, stamps = np.zeros(len(sliding), bool), self.stamp_ns
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            long[begin:end] = stamps[end - 1] - stamps[begin] > LONGEST_SLIDE * SECOND_NS
        return long

    def _column(self, which: int | slice) -> Float64:
        found = _one(self._found) if self._found else np.zeros((0, self._matcher.columns))
        column: Float64 = found[:, which]
        return column


def _one(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Return parts as one array, and keep this in their place: a path is asked for after each batch."""
    if len(parts) > 1:
        parts[:] = [np.concatenate(parts)]
    return parts[0]


def order_of(paths: Mapping[str, MatchedPath], duration: float, clear: float) -> str:
    """Return the order of beams by which the sweeps fit the map best, empty where it is not clear.

    Parameters
    ----------
    paths : order → path that was matched by it, of the same sweeps
    duration : of a sweep [s]
    clear : standard deviations by which it must fit better than the others
    """
    skewed = np.flatnonzero(paths[FORWARD].turns(duration) > SKEWED)
    if len(skewed) < MIN_SKEWED:
        return ""
    sharp = {order: path.sharp[skewed] for order, path in paths.items()}

    def betters(one: str, other: str) -> float:
        """Return by how many standard deviations one order is better than the other."""
        apart = sharp[one] - sharp[other]
        means = np.array([np.nanmean(block) for block in np.array_split(apart, BLOCKS) if np.isfinite(block).any()])
        if len(means) < 2:
            return 0.0
        spread = float(np.std(means, ddof=1) / np.sqrt(len(means)))
        return float(np.mean(means)) / max(spread, 1e-9)

    for order in paths:
        others = {other: clear if ONCE in (order, other) else OPPOSITE * clear for other in paths if other != order}
        if all(betters(order, other) > least for other, least in others.items()):
            return order
    return ""


# Findings on the poses of a log: frames that lead nowhere, contradictions of the tree, broken rotations, leaps.

NO_UNIT = 0.01
"""Deviation of the length of a quaternion from 1 that rounding does not make."""

APART, TURNED = 0.1, 0.1
"""Places of one frame that are further apart, or turned by more, are two [m, rad]."""

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
    return Finding("frames", "warning", topic, frame, message, mend="statics")


def clock_words(topic: str, delay: float) -> str:
    """Return that poses are stamped by another clock than the sweeps, `delay` later [s]."""
    side = "ahead of" if delay > 0.0 else "behind"
    return f"the clock of {topic} is {abs(delay):,.2f} s {side} that of the sweeps"


def apart_finding(key: Key, chain: PoseChain, delay: float) -> Finding:
    """Return the finding on a told path that has no pose at any sweep; `delay`: by how much it is late [s], 0: unknown."""
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


def way_findings(chain: PoseChain, links: Sequence[Track], topic: str = "") -> list[Finding]:
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
        found += way_findings(chain, (), topic)
    found += contradictions([track for track in sources.tracks if track.is_link])
    for track in sources.tracks:
        if track.stretched > NO_UNIT:
            link, off = " > ".join(filter(None, (track.parent, track.child))), {"off": track.stretched}
            words = f"{track.topic}: quaternions of {link} are up to {track.stretched:.2g} off length 1"
            found.append(Finding("frames", "warning", track.topic, track.child, words, off, {"off": NO_UNIT}))
    return list({each.message: each for each in found}.values())


def contradictions(links: Sequence[Track]) -> Iterator[Finding]:
    """Yield findings on frames of which transforms of one namespace tell several places."""
    given: dict[tuple[str, str], list[Track]] = {}
    for link in links:
        given.setdefault((namespace(link.topic), link.child), []).append(link)
    for (_, child), mine in given.items():
        parents = sorted({link.parent for link in mine})
        words = [
            f"{link.topic}: {child} is told at two places in {link.parent}: the last counts"
            if link.static
            else f"{link.topic}: {child} is told at two places in {link.parent} at one stamp: the first counts"
            for link in mine
            if link.differs
        ]
        mine = by_precedence(mine)
        words += [
            f"{first.topic} and {second.topic} differ on where {child} is in {parent}: {first.topic} counts"
            for parent in parents
            for first, second in pairwise(link for link in mine if link.parent == parent)
            if _differ(first, second)
        ]
        if len(parents) > 1 and any(link.static for link in mine):
            last = f"; tf2 takes {mine[0].parent}, told last" if sum(link.static for link in mine) > 1 else ""
            words.append(f"frame {child} has {len(parents)} parents: {some_of(parents)}{last}")
        for message in words:
            yield Finding("frames", "warning", mine[0].topic, child, message)


def _differ(first: Track, second: Track) -> bool:
    """Return whether two tracks of one frame in another one differ in its place at any time."""
    stamp_ns = first.stamp_ns if second.static else second.stamp_ns
    step = steps_between(*(flat(each.at(stamp_ns)) for each in (first, second)))
    with np.errstate(invalid="ignore"):
        return bool(((np.hypot(step[:, 0], step[:, 1]) > APART) | (np.abs(step[:, 2]) > TURNED)).any())
