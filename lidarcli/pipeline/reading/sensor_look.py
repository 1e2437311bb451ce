"""A look at the sweeps of one sensor: the path that is matched from them, as far as it is needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidarcli.options.choices import BEAM_ORDERS
from lidarcli.pose import candidates
from lidarcli.pose import matched as matching
from lidarcli.pose.sources import PoseChain
from lidarcli.sweeps.types import Float64, Int64, SweepBatch

ENOUGH, ENOUGH_WAY = 150, 15.0
"""The steps of a given path are evaluated by its first so many sweeps, once the sensor has gone so far [m]."""
SAMPLE, PERIOD = 5, 200
"""Of a sensor that has stood for a period of sweeps, so many of each period are matched."""
PART, PARTED = 50, 1000
"""So many sweeps are matched at once, of the first ones."""
ENOUGH_TURNING, LEADING = 100, 8
"""Sweeps during which the sensor turned that show the order of the beams; each is matched after so many before it."""
VERY_CLEAR, MAX_KEPT = 4.0, 600
"""Standard deviations by which an order must fit better to be taken before so many; most sweeps kept until then."""
MIN_PLACED = 0.7
"""Least share of sweeps with a pose that show the order of the beams."""


class SensorLook:
    """A look at the sweeps of one topic and frame, in log order."""

    def __init__(
        self, chains: Sequence[PoseChain], timing: matching.Timing, guess: PoseChain | None, *, whole: bool, wanted: bool
    ) -> None:
        """Take given paths, the chosen one first, and one whose steps guide the search; the rest as of `check_paths`."""
        self.chains, self.guess = chains, guess
        self.path = matching.MatchedPath(timing)
        self.sample = candidates.SweepSample()
        self.is_whole = True
        """True where every sweep was matched."""
        self.sweeps = 0
        self._whole, self._wanted = whole, wanted
        self._kept: list[SweepBatch] | None = [] if timing.order == matching.AUTO and wanted else None
        self._orders: dict[str, matching.MatchedPath] = {}
        """Order of the beams → the path of some of the kept sweeps by it."""
        self._ordered = 0
        """Number of kept sweeps that these have got, or were not to get."""
        self._is_static, self._found_at, self._is_off = False, 0, False
        """The last answer on standing, by so many matched sweeps; True where one has been off the first since."""

    def add(self, sweeps: SweepBatch) -> None:
        """Take sweeps, in small parts at first: each shows whether more are needed."""
        if self._wanted:
            self.sample.add(sweeps)
        while len(sweeps):
            most = PART - self.sweeps % PART if self.sweeps < PARTED else len(sweeps)
            rows = np.arange(len(sweeps))
            self._match(sweeps if len(sweeps) <= most else sweeps.rows(rows[:most]))
            sweeps = sweeps.rows(rows[most:])

    def _match(self, sweeps: SweepBatch) -> None:
        """Match sweeps: some while the sensor is static, none once they are enough to judge given steps."""
        part = np.arange(len(sweeps))
        if not self._whole:
            if self.sweeps >= PERIOD and self.is_static:
                part = part[(self.sweeps + part) % PERIOD < SAMPLE]
            elif self.is_enough or not (self._wanted or self.may_be_static):
                part = part[:0]
        self.is_whole &= len(part) == len(sweeps)
        self.sweeps += len(sweeps)
        if not len(part):
            return
        sweeps = sweeps if len(part) == len(sweeps) else sweeps.rows(part)
        poses = self.path.add(sweeps, self._guessed(sweeps))
        self._is_off |= not (np.abs(poses) < (matching.STANDING_OFF, matching.STANDING_OFF, matching.STANDING_TURN)).all()
        if self._kept is not None:
            self._kept.append(sweeps)
            self.decide_order(last=len(self.path.stamp_ns) >= MAX_KEPT)

    def decide_order(self, *, last: bool = True) -> None:
        """Find the order of the beams by sweeps during which the sensor turned, each after some that lead to it.

        Until the `last` of these sweeps only an order that is very clear is taken.
        """
        self._found_at = 0 if last else self._found_at
        if not (kept := self._kept):
            return
        own, duration = matching.duration_of(kept)
        turning = np.flatnonzero(self.path.turns(duration) > matching.SKEWED)
        last |= len(turning) >= ENOUGH_TURNING
        order = ""
        if len(turning) >= matching.MIN_SKEWED and self.path.placed >= MIN_PLACED:
            order = self._order(kept, turning[:ENOUGH_TURNING], VERY_CLEAR if not last else matching.CLEAR)
        if last or order:
            self._kept = None
        if not order:
            return
        first, self.path = self.path, matching.MatchedPath(matching.Timing(order, own))
        headers = np.concatenate([matching.headers_of(sweeps) for sweeps in kept])
        if np.array_equal(first.timing.of(headers), self.path.timing.of(headers)):
            first.timing, self.path = self.path.timing, first
            return
        for sweeps in kept:
            self.path.add(sweeps, self._guessed(sweeps))

    def _order(self, kept: Sequence[SweepBatch], turning: Int64, clear: float) -> str:
        """Return the order of the beams of kept sweeps by those during which the sensor turned; empty for none."""
        own, duration = matching.duration_of(kept)
        self._orders = self._orders or {
            order: matching.MatchedPath(matching.Timing(order, own)) for order in BEAM_ORDERS[1:]
        }
        rows = np.unique((turning[:, None] - np.arange(LEADING)).clip(0))
        rows = rows[rows >= self._ordered]
        ends = np.cumsum([0, *map(len, kept)])
        # Between these rows the sensor has gone on: the first path leads over that.
        guess = np.column_stack([self.path.poses, np.zeros(ends[-1])])
        for sweeps, first, end in zip(kept, ends[:-1], ends[1:], strict=True):
            chosen = rows[(rows >= first) & (rows < end)]
            for path in self._orders.values():
                path.add(sweeps.rows(chosen - first), guess[chosen])
        self._ordered = int(rows[-1]) + 1 if len(rows) else self._ordered
        return matching.order_of(self._orders, duration, clear)

    @property
    def is_static(self) -> bool:
        """True where the sensor has not moved so far; found again after a tenth more sweeps, or one off the first."""
        count = len(self.path.stamp_ns)
        if count >= 1.1 * self._found_at or (self._is_static and self._is_off):
            self._is_static, self._found_at, self._is_off = (
                matching.stands(self.path.poses, self.path.slides),
                count,
                False,
            )
        return self._is_static

    @property
    def may_be_static(self) -> bool:
        """True until the sensor was observed to move in the sweeps so far."""
        return self.sweeps < PERIOD or self.is_static

    @property
    def is_enough(self) -> bool:
        """True where given steps can be judged by the sweeps so far."""
        is_far = len(self.path.stamp_ns) >= ENOUGH and self.path.length >= ENOUGH_WAY
        return bool(self.chains) and self._kept is None and is_far

    def _guessed(self, sweeps: SweepBatch) -> Float64 | None:
        """Return the given poses of sweeps, as `MatchedPath.add` takes them."""
        if self.guess is None:
            return None
        return np.column_stack([candidates.poses_of(self.guess, sweeps.stamp_ns), np.zeros(len(sweeps))])
