"""The fit of told poses: steps of the told path beside those of the path that is matched from the sweeps.

Both paths are compared over pairs of sweeps between which the sensor went a little way. A delay of the poses and a mount
that the log does not tell are found from the same pairs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lidarcli.pose.sources import Way
from lidarcli.sweeps import Bool, Float64, Int64

PAIR_LENGTH, PAIR_TURN = 0.3, 0.15
"""A pair ends at the first sweep that is so far from its beginning [m, rad], ..."""
PAIR_SECONDS = 3.0
"""... or after so long [s], where either path has gone `MOVED_LENGTH` or `MOVED_TURN` by then."""
MOVED_LENGTH, MOVED_TURN = 0.1, 0.05
MOST_PAIRS = 400
LEAST_PAIRS = 8
MOST_UNPLACED = 0.3
"""Nothing is judged where a greater share of the sweeps has no matched pose."""
OFF_LENGTH, OFF_LENGTH_GROWS = 0.05, 0.12
"""Two steps agree if their ends are no further apart than this [m], and this share of their length more, ..."""
OFF_TURN, OFF_TURN_GROWS = np.deg2rad(2.0), 0.1
"""... and their turns differ by no more than this [rad], and this share of the turn more."""
JUMP_SPEED, JUMP_LENGTH = 10.0, 0.5
"""A told step that is longer than this and faster [m/s, m] is a jump."""
MOST_JUMPS = 0.2
"""Share of told steps that jump from which on the poses of two bodies are mixed."""
DISAGREE, NEARER = 0.1, 3.0
"""So do steps that are longer [m], and lead away from where the poses were one or two before by so much less."""
LONGEST_DELAY, DELAY_STEP, FINE_STEP = 0.6, 0.05, 0.01
"""Delays that are tried, to both sides, first in large steps and then around the best in small ones [s]."""
LEAST_TOLD, MOST_OFF, CLEARLY_BETTER = 0.6, 3.0, 0.05
"""Least share of pairs with a delayed pose; greatest cost of a pair; share by which a larger delay has to be better."""
LEAST_DELAY, SHARPER = 0.03, 0.7
"""Least delay of poses that fit also without one [s], and the greatest cost with it as a share of that without."""
ACCEPTED = 0.8
"""Share of agreeing pairs from which poses are accepted as they are told."""
CORRECTED, GAIN = 0.5, 0.1
"""Share from which they are accepted with a delay and a mount, and by how much these must better it."""
RATIOS = 0.8, 1.25
"""Told lengths and turns as a share of the matched ones, from least to most."""
LONG_STEP, LARGE_TURN, LEAST_LONG = 0.15, 0.08, 5
"""Steps that are longer, or turn more, tell such a share [m, rad]; so many or fewer tell none."""
ONE_FACTOR = 0.2
"""Greatest median deviation of such shares where one factor explains them, as a share of the factor."""
STRETCH, STRETCH_FIT, STRETCHES = 10, 0.7, 0.4
"""Pairs of a stretch, the share that agrees in a good one, and the share of good ones from which these are accepted."""
MOUNT_SCALE = 0.05
"""Scale of the robust weights of a mount [m]."""

STANDING_OFF, STANDING_TURN = 0.02, np.deg2rad(0.5)
"""A sensor stands whose matched poses are no further from their middle [m, rad], but for 1 % of them."""
MOST_SLIDING = 0.5
"""Share of sweeps that may slide of a sensor that is known to stand."""
STILL_SECONDS, STILL_OFF, STILL_TURN = 2.0, 0.05, 0.035
"""It stands at a sweep if the poses at both ends of so many seconds around it are no further apart [m, rad]."""

Steps = Float64
"""(K, 3): x, y [m] and turn [rad], in the frame at the beginning of each step."""


@dataclass(frozen=True, slots=True)
class PoseFit:
    """Fit of the told poses of one sensor to its sweeps."""

    verdict: str
    """accepted, corrected, stretches, rejected or unchecked."""
    share: float
    """Share of pairs that agree, after the correction where there is one; NaN where there are too few."""
    pairs: int
    delay: float = 0.0
    """The pose of a sweep is that at its header stamp and this much later [s]."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of the sensor in the frame that the poses tell of: x, y [m], yaw [rad]."""
    cuts: tuple[tuple[int, int], ...] = ()
    """Stamps of the told poses before and after each jump [ns]."""
    jumps: tuple[float, ...] = ()
    """Length of each jump [m]."""
    ratio: float = float("nan")
    """Told lengths as a share of the matched ones."""
    turn_ratio: float = float("nan")
    moves: bool = False
    """True where nothing could be checked, though the told path goes some way."""
    good: tuple[tuple[int, int], ...] = ()
    """First and last stamp of the stretches that are accepted [ns]."""


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
    return np.column_stack(
        [
            begin[:, 0] + cos * step[:, 0] - sin * step[:, 1],
            begin[:, 1] + sin * step[:, 0] + cos * step[:, 1],
            wrapped(begin[:, 2] + step[:, 2]),
        ]
    )


@dataclass(frozen=True, slots=True)
class Jumps:
    """Jumps of told poses: no sensor is that fast."""

    gaps_ns: Int64
    """(G, 2) stamps before and after each jump [ns]."""
    lengths: Float64
    """(G,) metres."""
    share: float
    """Share of the told steps that jump."""
    in_turns: bool = False
    """True where they go back and forth, as poses of two bodies do."""


def jumps_of(way: Way) -> Jumps:
    """Find the jumps in the moving poses that make a way, of which the first kind that jumps counts."""
    for step in way.steps:
        track = step.track
        if track.static or len(track.stamp_ns) < 2:
            continue
        lengths = np.hypot(*np.diff(track.motion.position[:, :2], axis=0).T)
        seconds = np.diff(track.stamp_ns) * 1e-9
        jumps = np.flatnonzero(lengths > np.maximum(JUMP_SPEED * seconds, JUMP_LENGTH))
        turns = _in_turns(track.motion.position[:, :2], lengths)
        if in_turns := len(turns) >= MOST_JUMPS * len(lengths):
            jumps = np.union1d(jumps, turns)
        if len(jumps):
            gaps = np.column_stack([track.stamp_ns[jumps], track.stamp_ns[jumps + 1]])
            return Jumps(gaps, lengths[jumps], len(jumps) / len(lengths), in_turns)
    return Jumps(np.zeros((0, 2), np.int64), np.zeros(0), 0.0)


def _in_turns(places: Float64, lengths: Float64) -> Int64:
    """Return the steps between places (N, 2), of so many lengths (N - 1,), that come from two publishers in turns."""
    again = np.full(len(lengths), np.inf)
    for before in (2, 3):
        apart = np.hypot(*(places[before:] - places[:-before]).T)
        again[before - 1 :] = np.minimum(again[before - 1 :], apart)
    return np.flatnonzero((lengths > DISAGREE) & (NEARER * again < lengths))


def judge_poses(
    stamp_ns: Int64,
    matched: Float64,
    told_at: Callable[[Int64], Float64],
    pieces: Float64 | None = None,
    jumps: Jumps | None = None,
) -> PoseFit:
    """Compare a told path with the matched one.

    Parameters
    ----------
    stamp_ns : (S,) header stamps, increasing
    matched : (S, 3) x, y, yaw of the matched path, NaN where a sweep has no pose
    told_at : gives the told poses of the sensor (K, 3) at stamps (K,), NaN where none is told
    pieces : (S,) number of the piece of the matched path; steps from one to another are not known
    jumps : jumps of the told poses

    Returns
    -------
    The verdict by the first rule that holds: unchecked, accepted, corrected, accepted in stretches, rejected.
    """
    told = told_at(stamp_ns)
    seconds = (stamp_ns - stamp_ns[0]) * 1e-9 if len(stamp_ns) else np.zeros(0)
    cuts: tuple[tuple[int, int], ...] = ()
    sizes: tuple[float, ...] = ()
    if jumps is not None and len(jumps.gaps_ns) and jumps.share < MOST_JUMPS:
        cuts = tuple((int(before), int(after)) for before, after in jumps.gaps_ns)
        sizes = tuple(jumps.lengths.tolist())
    begin, end = pairs_of(seconds, matched, told)
    ends = np.array([after for _, after in cuts], np.int64)
    cut = np.searchsorted(ends, stamp_ns[begin], "right") != np.searchsorted(ends, stamp_ns[end], "right")
    if pieces is not None:
        cut |= pieces[begin] != pieces[end]
    begin, end = begin[~cut], end[~cut]
    placed = float(np.isfinite(matched[:, 0]).mean()) if len(matched) else 0.0
    if placed < 1.0 - MOST_UNPLACED or len(begin) < LEAST_PAIRS:
        if jumps is not None and jumps.in_turns:
            return PoseFit("rejected", float("nan"), len(begin), jumps=(float(jumps.lengths.max()),))
        gone = np.ptp(told[np.isfinite(told[:, 0]), :2], axis=0) if np.isfinite(told).any() else np.zeros(2)
        moves = bool(gone.max() > PAIR_LENGTH)
        return PoseFit("unchecked", float("nan"), len(begin), cuts=cuts, jumps=sizes, moves=moves)
    step = steps_between(matched[begin], matched[end])
    as_told = steps_between(told[begin], told[end])
    agree = _agree(step, as_told)
    share = float(agree.mean())
    if jumps is not None and jumps.share >= MOST_JUMPS:
        ratio, turn_ratio = _ratios(step, as_told)
        # Where a step jumps, what lies between told poses is of neither body.
        clean = share * (1.0 - jumps.share)
        rejected = PoseFit("rejected", clean, len(begin), ratio=ratio, turn_ratio=turn_ratio)
        # Steps that are all too long by one factor do not jump.
        return rejected if _is_scaled(step, as_told) else replace(rejected, jumps=(float(jumps.lengths.max()),))
    if share >= ACCEPTED:
        accepted = PoseFit("accepted", share, len(begin), cuts=cuts, jumps=sizes)
        return _sharper(accepted, stamp_ns, begin, end, step, told_at)
    delay, mount, best = _corrected(stamp_ns, begin, end, step, told_at)
    ratio, turn_ratio = _ratios(step, best)
    better = float(_agree(step, _mounted(best, mount)).mean())
    # Of poses that lie at the bound, a greater delay may fit better yet.
    found = better >= CORRECTED and better >= share + GAIN and abs(delay) < LONGEST_DELAY - 0.5 * DELAY_STEP
    fits = all(not np.isfinite(one) or RATIOS[0] <= one <= RATIOS[1] for one in (ratio, turn_ratio))
    turn_told = _ratios(step, as_told)[1]
    fit = PoseFit("rejected", share, len(begin), cuts=cuts, jumps=sizes, ratio=ratio, turn_ratio=turn_told)
    if found and fits:
        return replace(fit, verdict="corrected", share=better, delay=delay, mount=mount, turn_ratio=turn_ratio)
    parts = np.array_split(np.arange(len(begin)), max(1, len(begin) // STRETCH))
    good = [part for part in parts if agree[part].mean() >= STRETCH_FIT]
    if fits and len(good) >= STRETCHES * len(parts):
        spans = tuple((int(stamp_ns[begin[part[0]]]), int(stamp_ns[end[part[-1]]])) for part in good)
        return replace(fit, verdict="stretches", good=spans)
    return fit


def pairs_of(seconds: Float64, matched: Float64, told: Float64) -> tuple[Int64, Int64]:
    """Return the sweeps where pairs begin and end: a pair is a short way of the sensor."""
    known = np.flatnonzero(np.isfinite(matched[:, 0]) & np.isfinite(told[:, 0]))
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
        other = steps_between(told[first : first + 1], told[later[-1:]])
        both = np.vstack([step[-1:], other])
        moved = (np.hypot(both[:, 0], both[:, 1]) > MOVED_LENGTH) | (np.abs(both[:, 2]) > MOVED_TURN)
        if seconds[later[-1]] - seconds[first] >= PAIR_SECONDS and moved.any():
            pairs.append((first, int(later[-1])))
    if len(pairs) > MOST_PAIRS:
        pairs = [pairs[k] for k in np.linspace(0, len(pairs) - 1, MOST_PAIRS).astype(int)]
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


def _mounted(step: Steps, mount: tuple[float, float, float]) -> Steps:
    """Return the steps of a sensor that is mounted so on what makes `step`."""
    where = np.broadcast_to(np.array(mount), step.shape)
    return steps_between(where, poses_after(step, np.array(mount)))


def _sharper(
    fit: PoseFit, stamp_ns: Int64, begin: Int64, end: Int64, step: Steps, told_at: Callable[[Int64], Float64]
) -> PoseFit:
    """Return the fit of accepted poses, with the delay that is clearly better than none."""

    def cost(delay: float) -> float:
        delay_ns = round(delay * 1e9)
        told = steps_between(told_at(stamp_ns[begin] + delay_ns), told_at(stamp_ns[end] + delay_ns))
        off, turn = _off(step, told)
        # Steps beyond the ends of the told path count as much as those that are far off.
        return float(np.mean(np.nan_to_num(np.minimum(off + turn, MOST_OFF), nan=MOST_OFF)))

    count, fine = round(LONGEST_DELAY / DELAY_STEP), round(DELAY_STEP / FINE_STEP)
    coarse = min((number * DELAY_STEP for number in range(-count, count + 1)), key=cost)
    best = min((coarse + number * FINE_STEP for number in range(1 - fine, fine)), key=cost)
    is_bound = abs(coarse) > LONGEST_DELAY - 0.5 * DELAY_STEP
    if is_bound or abs(best) < LEAST_DELAY or cost(best) > SHARPER * cost(0.0):
        return fit
    return replace(fit, verdict="corrected", delay=round(best, 3))


@dataclass(frozen=True, slots=True)
class _Tried:
    """A delay that was tried, with the mount that fits best with it."""

    cost: float
    delay: float
    mount: tuple[float, float, float]
    told: Steps


def _corrected(
    stamp_ns: Int64, begin: Int64, end: Int64, step: Steps, told_at: Callable[[Int64], Float64]
) -> tuple[float, tuple[float, float, float], Steps]:
    """Find the delay and the mount with which the told steps fit best; return them and the told steps so delayed."""

    def tried(delay: float) -> _Tried | None:
        delay_ns = round(delay * 1e9)
        told = steps_between(told_at(stamp_ns[begin] + delay_ns), told_at(stamp_ns[end] + delay_ns))
        known = np.isfinite(told[:, 0])
        if known.mean() < LEAST_TOLD:
            return None
        mount = mount_between(step[known], told[known])
        off, turn = _off(step[known], _mounted(told[known], mount))
        cost = float(np.mean(np.minimum(off, MOST_OFF) + np.minimum(turn, MOST_OFF)))
        return _Tried(cost, delay, mount, told)

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
    return round(best.delay, 3), best.mount, best.told


def mount_between(step: Steps, told: Steps) -> tuple[float, float, float]:
    """Find where a sensor that makes `step` is mounted on what makes `told`: robust hand-eye calibration in the plane."""
    straight = (np.abs(step[:, 2]) < 0.1) & (np.hypot(*step[:, :2].T) > 0.1) & (np.hypot(*told[:, :2].T) > 0.1)
    yaws = [0.0]
    if np.count_nonzero(straight) >= 5:
        apart = np.arctan2(told[straight, 1], told[straight, 0]) - np.arctan2(step[straight, 1], step[straight, 0])
        yaws = [float(np.arctan2(np.median(np.sin(apart)), np.median(np.cos(apart)))), 0.0]
        yaws += [0.5 * np.pi, -0.5 * np.pi, np.pi]
    best, most = (0.0, 0.0, 0.0), -1.0
    cos, sin = np.cos(told[:, 2]), np.sin(told[:, 2])
    lever = np.stack([np.stack([cos - 1.0, -sin], 1), np.stack([sin, cos - 1.0], 1)], 1)
    for yaw in yaws:
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        apart = step[:, :2] @ turn.T - told[:, :2]
        place = np.zeros(2)
        for _ in range(8):
            left = np.einsum("kij,j->ki", lever, place) - apart
            weight = 1.0 / (1.0 + (left * left).sum(1) / MOUNT_SCALE**2) ** 2
            # A mount that the turns do not tell stays near 0.
            normal = np.einsum("k,kij,kil->jl", weight, lever, lever) + 0.2 * np.eye(2)
            place = np.linalg.solve(normal, np.einsum("k,kij,ki->j", weight, lever, apart))
        mount = float(place[0]), float(place[1]), yaw
        share = float(_agree(step, _mounted(told, mount)).mean())
        if share > most + 0.02:
            best, most = mount, share
    return best


def _ratios(step: Steps, told: Steps) -> tuple[float, float]:
    """Return told lengths and told turns as a share of those seen, by medians; NaN where there are too few."""
    length, far = np.hypot(step[:, 0], step[:, 1]), np.hypot(told[:, 0], told[:, 1])
    long, turns = ((length > LONG_STEP) & np.isfinite(far), (np.abs(step[:, 2]) > LARGE_TURN) & np.isfinite(far))
    ratio = float(np.median(far[long] / length[long])) if np.count_nonzero(long) > LEAST_LONG else float("nan")
    turned = wrapped(told[turns, 2]) / step[turns, 2]
    return ratio, float(np.median(turned)) if len(turned) > LEAST_LONG else float("nan")


def _is_scaled(step: Steps, told: Steps) -> bool:
    """Tell whether told steps are those seen but for one factor, as those in other units are."""
    length, far = np.hypot(step[:, 0], step[:, 1]), np.hypot(told[:, 0], told[:, 1])
    long = (length > LONG_STEP) & np.isfinite(far)
    if np.count_nonzero(long) <= LEAST_LONG:
        return False
    ratios = far[long] / length[long]
    middle = float(np.median(ratios))
    return middle > RATIOS[1] and float(np.median(np.abs(ratios - middle))) < ONE_FACTOR * middle


def joined(
    stamp_ns: Int64, matched: Float64, pieces: Float64, told: Float64, cuts: tuple[tuple[int, int], ...]
) -> tuple[Int64, Float64, bool]:
    """Join the parts of a told path between jumps by the matched path.

    Parameters
    ----------
    stamp_ns : (S,) stamps at which the poses of the sweeps are told, increasing [ns]
    matched, told : (S, 3) x, y, yaw, NaN where they are not known
    pieces : (S,) number of the piece of the matched path
    cuts : stamps of the told poses before and after each jump [ns]

    Returns
    -------
    gaps : (G, 2) stamps before and after each jump [ns]
    moves : (G + 1, 3) motion of the world for each part; NaN where it is not known
    lost : True where a part could not be joined
    """
    known = np.isfinite(told[:, 0]) & np.isfinite(matched[:, 0])
    moves = [np.zeros((1, 3))]
    for gap in cuts:
        first, second = np.searchsorted(stamp_ns, gap[0], "right"), np.searchsorted(stamp_ns, gap[1])
        before, behind = np.flatnonzero(known[:first]), np.flatnonzero(known[second:])
        if not len(before) or not len(behind):
            # There is nothing to be joined.
            moves.append(moves[-1])
            continue
        if pieces[before[-1]] != pieces[second + behind[0]]:
            moves.append(np.full((1, 3), np.nan))
            continue
        i, j = before[-1:], second + behind[:1]
        here = poses_after(poses_after(moves[-1], told[i]), steps_between(matched[i], matched[j]))
        # The motion that takes the told pose after the jump there.
        back = steps_between(told[j], np.zeros((1, 3)))
        moves.append(poses_after(here, back))
    found = np.vstack(moves)
    return np.array(cuts, np.int64).reshape(-1, 2), found, bool(np.isnan(found).any())


def stands(matched: Float64, slides: Float64) -> bool:
    """Tell from the matched path whether the sensor never moves.

    Parameters
    ----------
    matched : (S, 3) x, y, yaw, NaN where a sweep has no pose
    slides : (S,) 1 where the place is not fixed along some direction
    """
    known = np.isfinite(matched[:, 0])
    if len(known) == 0 or known.mean() < 1.0 - MOST_UNPLACED:
        return False
    middle = np.median(matched[known], axis=0)
    off = np.hypot(matched[known, 0] - middle[0], matched[known, 1] - middle[1])
    turn = np.abs(wrapped(matched[known, 2] - middle[2]))
    fixed = float(np.mean(slides[known] > 0)) < MOST_SLIDING
    return bool(fixed and np.quantile(off, 0.99) < STANDING_OFF and np.quantile(turn, 0.99) < STANDING_TURN)


def still_at(stamp_ns: Int64, matched: Float64, slides: Float64) -> Bool:
    """Tell at which sweeps (S,) the sensor stands; empty where too few sweeps have a pose.

    Parameters are as of `stands`, with the stamps of the sweeps (S,) [ns], increasing.
    """
    known = np.isfinite(matched[:, 0])
    if len(known) == 0 or known.mean() < 1.0 - MOST_UNPLACED:
        return np.zeros(0, bool)
    if stands(matched, slides):
        return np.ones(len(known), bool)
    seconds = (stamp_ns[-1] - stamp_ns[0]) * 1e-9
    third = min(max(1, round(STILL_SECONDS / 3.0 * len(stamp_ns) / max(seconds, 1e-3))), len(known))
    numbers = np.arange(len(known))
    filled = np.column_stack(
        [
            np.interp(numbers, numbers[known], matched[known, 0]),
            np.interp(numbers, numbers[known], matched[known, 1]),
            np.interp(numbers, numbers[known], np.unwrap(matched[known, 2])),
        ]
    )
    padded = np.pad(filled, ((third, third), (0, 0)), mode="edge")
    middles = np.median(np.lib.stride_tricks.sliding_window_view(padded, third, axis=0), axis=2)
    # Medians of the third of the window before each sweep, and of the third after it.
    apart = middles[third + 1 :] - middles[: -(third + 1)]
    apart = apart[: len(known)]
    still = (np.hypot(apart[:, 0], apart[:, 1]) < STILL_OFF) & (np.abs(apart[:, 2]) < STILL_TURN)
    found: Bool = still
    return found
