"""Which sweeps of a moving sensor say something new: people who wait beside a robot that waits are no wall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps import TURN, Int64, SweepPoses

MIN_TURN = math.radians(10.0)
"""A sensor that has turned by so much sees something new, too …"""
PAUSE_NS = 5_000_000_000
"""… and so does one that has waited for so long: things go."""


@dataclass(slots=True)
class MotionFilter:
    """A fold over the sweeps of a sensor, in the order of the log.

    Parameters
    ----------
    min_move : how far it has to go from one sweep that counts to the next [m]; 0: every sweep counts
    """

    min_move: float
    unplaced: int = 0
    """Sweeps without a pose, which never count."""
    _last: tuple[float, float, float, int] | None = None
    """x, y, yaw, stamp of the last sweep that counts."""

    def take(self, poses: SweepPoses, stamp_ns: Int64) -> Int64:
        """The sweeps (of S) that count."""
        known = np.flatnonzero(np.isfinite(poses.x) & np.isfinite(poses.y) & np.isfinite(poses.yaw))
        self.unplaced += len(stamp_ns) - len(known)
        if self.min_move <= 0.0:
            return known
        taken = []
        places = zip(
            known.tolist(),
            poses.x[known].tolist(),
            poses.y[known].tolist(),
            poses.yaw[known].tolist(),
            stamp_ns[known].tolist(),
            strict=True,
        )
        for row, *here in places:
            if self._is_new(*here):
                self._last = (here[0], here[1], here[2], here[3])
                taken.append(row)
        return np.array(taken, np.int64)

    def _is_new(self, x: float, y: float, yaw: float, stamp_ns: int) -> bool:
        if self._last is None:
            return True
        turned = abs((yaw - self._last[2] + 0.5 * TURN) % TURN - 0.5 * TURN)
        return (
            math.hypot(x - self._last[0], y - self._last[1]) >= self.min_move
            or turned >= MIN_TURN
            or abs(stamp_ns - self._last[3]) >= PAUSE_NS
        )
