"""The choice of the path of a sensor: of all that could be its path, the one with which its sweeps agree best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.path_agreement import Agreement, agreement
from lidarcli.options.times import SECOND_NS
from lidarcli.pose.matched import MIN_STEP, Timing, headers_of, wrapped
from lidarcli.pose.sources import Correction, PoseChain, later
from lidarcli.pose.tracks import PoseMotion, compose, inverse, lifted, planar
from lidarcli.sweeps.types import Float64, Int64, SweepBatch

if TYPE_CHECKING:
    from lidarcli.pose.calibration import Outlines

MAX_SAMPLED = 300
"""A sample has at least so many sweeps of a longer run, and fewer than twice as many."""
BEAMS = 120
"""Beams of a sweep that are compared, about."""
PART_SECONDS = 4.0
"""Duration of the parts of a run that are compared [s]."""
SEEN_AGAIN = 0.2
"""Share of hits that are observed again later from which on these decide; else the steps of the path do."""
DRIFTS = 0.03
"""A path drifts if places observed again agree less than those observed soon by more than this."""
CLEARLY, LESS, MUCH = 0.01, 0.02, 0.175
"""Shares by which the matched path must agree better than the given one by places observed again, drift less, or else agree
better by places observed soon."""
STANDS_BETTER = 0.05
"""Share by which standing still must agree better than every path."""
MIN_PLACED = 0.8
"""A matched path replaces a given one by places observed again only if more than this share of its sweeps has a pose."""
SAME_PLACE = 1e-3
"""Paths that are nowhere further apart are one [m, rad]."""


class SweepSample:
    """Sweeps that are taken evenly from all of a run, however it is cut into batches."""

    def __init__(self) -> None:
        self.timing = Timing()
        """Times at which the beams are sent."""
        self._every, self._count = 1, 0
        self._kept: list[tuple[NDArray[Any], ...]] = []

    def add(self, sweeps: SweepBatch) -> None:
        """Take sweeps of one sensor in log order."""
        number = np.arange(self._count, self._count + len(sweeps))
        self._count += len(sweeps)
        rows = np.flatnonzero(number % self._every == 0)
        if not len(rows):
            return
        step = max(1, round(sweeps.ranges.shape[1] / BEAMS))
        first, apart = sweeps.angle_min[rows], sweeps.angle_increment[rows] * step
        ranges, headers = sweeps.ranges[rows, ::step], headers_of(sweeps)[rows]
        self._kept.append((number[rows], sweeps.stamp_ns[rows], ranges, first, apart, headers))
        while sum(len(part[0]) for part in self._kept) >= 2 * MAX_SAMPLED:
            self._every *= 2
            self._kept = [tuple(values[part[0] % self._every == 0] for values in part) for part in self._kept]

    @property
    def stamp_ns(self) -> Int64:
        """(K,) stamps [ns]."""
        return self._column(1) if self._kept else np.zeros(0, np.int64)

    def agreement(self, chain: PoseChain | None) -> Agreement:
        """Return how well the sweeps agree under a path; None for standing still."""
        if not self._kept:
            return Agreement(np.nan, np.nan, np.nan, 0.0, 0.0)
        ranges, first, step, poses, motion = self._placed(chain)
        return agreement(ranges, first, step, poses, motion, self._parts())

    def agreement_with(self, other: SweepSample, chain: PoseChain, its: PoseChain) -> float:
        """Return how well the sweeps of two sensors on one robot agree under their paths; NaN where they share nothing."""
        if not self._kept or not other._kept:
            return np.nan
        own, others = self._placed(chain), other._placed(its)
        width = max(own[0].shape[1], others[0].shape[1])
        ranges = np.concatenate([_widened(each, width) for each in (own[0], others[0])])
        first, step, poses, motion = (np.concatenate(pair) for pair in zip(own[1:], others[1:], strict=True))
        return agreement(ranges, first, step, poses, motion, np.repeat([0, 1], [len(own[0]), len(others[0])])).all

    def outlines(self, most: int) -> Outlines:
        """Return the points of so many of the sweeps; their stamps are the times of the slots."""
        # Few logs need this import.
        from lidarcli.pose.calibration import SLOTS, outlines_of

        if not self._kept:
            return outlines_of([], SLOTS, BEAMS)
        rows: Int64 = np.unique(np.linspace(0, len(self.stamp_ns) - 1, most).astype(np.int64))
        every = [one for part in self._kept for one in zip(*part[1:5], strict=True)]
        found = outlines_of(
            [
                (int(stamp), first + step * np.arange(len(ranges)), ranges.astype(np.float64))
                for stamp, ranges, first, step in (every[row] for row in rows.tolist())
            ],
            SLOTS,
            BEAMS,
        )
        begin, end = (np.repeat(times[rows], SLOTS) for times in self.timing.of(self._column(5)))
        late = np.rint((begin + found.share * (end - begin)) * SECOND_NS).astype(np.int64)
        return replace(found, stamp_ns=later(found.stamp_ns, late))

    def _placed(
        self, chain: PoseChain | None
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return ranges, first bearings, increments, poses and motions as `agreement` takes them."""
        width = max(part[2].shape[1] for part in self._kept)
        begin = end = np.zeros((len(self.stamp_ns), 3))
        if chain is not None:
            begin, end = (
                poses_of(chain, later(self.stamp_ns, np.rint(times * SECOND_NS).astype(np.int64)))
                for times in self.timing.of(self._column(5))
            )
        motion = end - begin
        motion[:, 2] = wrapped(motion[:, 2])
        ranges = np.concatenate([_widened(part[2], width) for part in self._kept])
        return ranges, self._column(3), self._column(4), begin, motion

    def _column(self, which: int) -> NDArray[Any]:
        return np.concatenate([part[which] for part in self._kept])

    def _parts(self) -> Int64:
        """Return (K,) the number of the part of the run: each sweep is one of its own where stamps are no times."""
        seconds = (self.stamp_ns - self.stamp_ns.min()) / SECOND_NS
        if len(seconds) > 1 and np.median(np.abs(np.diff(seconds))) < MIN_STEP:
            return np.arange(len(seconds))
        parts: Int64 = np.unique(np.floor(seconds / PART_SECONDS), return_inverse=True)[1]
        return parts


def _widened(ranges: NDArray[Any], width: int) -> NDArray[Any]:
    return np.pad(ranges, ((0, 0), (0, width - ranges.shape[1])), constant_values=np.nan)


class Candidate(NamedTuple):
    """A path that could be that of the sensor."""

    verdict: str
    """told, corrected or matched."""
    chain: PoseChain
    agreement: Agreement

    @property
    def is_seen_again(self) -> bool:
        """True where enough places are observed again later."""
        return self.agreement.again >= SEEN_AGAIN and bool(np.isfinite(self.agreement.far))

    @property
    def drift(self) -> float:
        """By how much places that are observed again agree less than those observed soon; NaN where none are."""
        return self.agreement.near - self.agreement.far if self.is_seen_again else float("nan")

    @property
    def by_places(self) -> float:
        """Agreement of places that are observed again, where there are some, else of all."""
        return self.agreement.far if self.is_seen_again else self.agreement.all

    def over_run(self, standing: float) -> float:
        """Return the agreement of all sweeps, of which one without a pose counts as under standing still."""
        share = self.agreement.placed
        return float(np.nan_to_num(self.agreement.all)) * share + (1.0 - share) * standing


def given_candidates(chains: Sequence[PoseChain], sample: SweepSample) -> list[Candidate]:
    """Return the given paths that differ: the first one alone where nothing speaks against it."""
    found: list[Candidate] = []
    paths: list[Float64] = []
    for chain in chains:
        path = poses_of(chain, sample.stamp_ns)
        if any(np.allclose(path, one, rtol=0.0, atol=SAME_PLACE, equal_nan=True) for one in paths):
            continue
        paths.append(path)
        found.append(Candidate("told", chain, sample.agreement(chain)))
        if len(found) == 1 and found[0].drift <= DRIFTS:
            break
    return found


def best_given(found: Sequence[Candidate]) -> Candidate:
    """Return the given path that agrees best; an earlier one unless another is clearly better."""
    best = found[0]
    for one in found[1:]:
        if one.by_places > best.by_places + CLEARLY and one.is_seen_again >= best.is_seen_again:
            best = one
    return best


def better_path(given: Candidate, matched: Candidate, standing: float, *, is_likely: bool, jumps: bool) -> Candidate:
    """Choose between a given path and the matched one.

    A given path that is inexact but does not drift is blurred alike soon and later; a sharper one that drifts is no better.

    Parameters
    ----------
    standing : agreement of all sweeps under standing still
    is_likely : True where most steps of the given path fit the sweeps, or cannot be judged
    jumps : True where it has steps that no robot makes
    """
    gain = matched.over_run(standing) - given.over_run(standing)
    if jumps:
        is_better = gain > (CLEARLY if given.is_seen_again else -CLEARLY)
    elif given.is_seen_again and matched.is_seen_again and matched.agreement.placed > MIN_PLACED:
        is_sharper = matched.agreement.far > given.agreement.far + CLEARLY and gain > 0.0
        is_better = is_sharper and (not is_likely or given.drift > matched.drift + LESS)
        is_better |= matched.agreement.near > given.agreement.near + MUCH
    elif is_likely:
        is_better = matched.agreement.near > given.agreement.near + MUCH
    else:
        is_better = gain > CLEARLY
    return matched if is_better else given


def poses_of(chain: PoseChain, stamp_ns: Int64) -> Float64:
    """Return x, y [m] and yaw [rad] (S, 3) of the sensor at stamps, mirrored where it hangs upside down."""
    there = planar(chain.at(stamp_ns))
    known = np.isfinite(there.x)
    hangs = np.count_nonzero(there.upside_down & known) * 2 > np.count_nonzero(known)
    poses = np.column_stack([there.x, there.y, there.yaw])
    return poses * ([1.0, -1.0, -1.0] if hangs else [1.0, 1.0, 1.0])


def laid(chain: PoseChain, world: PoseChain, stamp_ns: Int64) -> PoseChain:
    """Return a path in the fixed frame of another one, by the rigid motion that fits most sweeps (stamps (S,) [ns])."""
    here, there = chain.at(stamp_ns), world.at(stamp_ns)
    motions = compose(there, inverse(here))
    flat = planar(motions)
    known = np.isfinite(flat.x)
    if not known.any():
        return chain
    yaw = float(np.angle(np.median(np.cos(flat.yaw[known])) + 1j * np.median(np.sin(flat.yaw[known]))))
    turn = lifted((0.0, 0.0, yaw))
    turned = compose(turn, here)
    place = np.nanmedian((there.position - turned.position)[known], axis=0)
    motion = PoseMotion(place[None], turn.rotation)
    return replace(chain, world=world.world, correction=replace(chain.correction or Correction(), laid=motion))
