"""Habits of drivers that sweeps show: intensities in reverse, codes for ranges, hits on the robot, the pace of a log."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from lidarcli.display.texts import counted
from lidarcli.sweeps.finding_rules import CODES_BELOW, PACES
from lidarcli.sweeps.range_rules import FARTHEST
from lidarcli.sweeps.types import Bool, Float32, Float64, RawSweeps, Status, SweepBatch
from lidarcli.system.records import dataclass, field

MAX_ROWS, MAX_WIDTH = 256, 8192
"""Most sweeps, and beams of a sweep, that are kept to compare them: half of the sweeps go whenever there are more."""
MIN_ROWS = 50
"""Fewest sweeps that tell of hits on the robot, and of the pace."""
MIN_UNLIKE = 100
"""Fewest beams whose intensity and range contradict each other."""
BODY_REACH, BODY_SPREAD = 1.0, 0.06
"""A beam on the robot itself stays within so much, nearer than this [m]."""
BODY_SHARE = 0.8
"""Share of the sweeps in which it does."""
MIN_BODY_BEAMS = 3
"""Fewest beams side by side on the robot."""
CHANGES = 0.5
"""Median spread of the farther beams [m] from which on the sensor moves, or all around it does."""
PACE_FIT = 0.05
"""Greatest deviation of the times of records from a constant pace, as a share of the duration."""


@dataclass(slots=True)
class Thinned:
    """Every 1st, 2nd, 4th, ... row of many, at most `MAX_ROWS`."""

    rows: list[Any] = field(default_factory=list)
    stride: int = 1
    count: int = 0

    def takes(self) -> bool:
        """Count the next row, and return whether it is one to keep."""
        self.count += 1
        if (self.count - 1) % self.stride:
            return False
        if len(self.rows) == MAX_ROWS:
            del self.rows[1::2]
            self.stride *= 2
        return (self.count - 1) % self.stride == 0


@dataclass(slots=True)
class Habits:
    """What the sweeps of one topic and frame show of their driver, in bounded memory."""

    beams: int = 0
    codes: Counter[float] = field(default_factory=Counter)
    """Range below `CODES_BELOW` [m] → beams."""
    farthest: float = 0.0
    """Greatest limit of the ranges, or range where there is no limit [m]."""
    unlike: int = 0
    """Beams without a range that have an intensity, and those with a range that have none."""
    unlike_reversed: int = 0
    """The same, had the intensities of each sweep been sent in reverse."""
    ranges: Thinned = field(default_factory=Thinned)
    """(B,) ranges [m] of sweeps with the bearings of the first one, NaN without."""
    times: Thinned = field(default_factory=Thinned)
    """Time and time of the record of sweeps [ns]."""
    grid: tuple[int, float, float] | None = None
    """Beams, first bearing and step [rad] of the first sweep."""

    def add(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Take sweeps, one at least, as the log holds them (`raw`) and with judged ranges (`batch`)."""
        valid = batch.status == Status.VALID
        self.beams += int(raw.beams.sum())
        if len(self.codes) < MAX_WIDTH:
            self.codes.update(batch.ranges[valid & (batch.ranges < CODES_BELOW)].tolist())
        for times in zip(raw.time_ns.tolist(), raw.record_ns.tolist(), strict=True):
            if self.times.takes():
                self.times.rows.append(times)
        self.grid = self.grid or (int(raw.beams[0]), float(raw.angle_min[0]), float(raw.angle_increment[0]))
        beams, first, step = self.grid
        alike = (raw.beams == beams) & (raw.angle_min == first) & (raw.angle_increment == step)
        limits = batch.range_max[np.isfinite(batch.range_max) & (batch.range_max < FARTHEST)]
        self.farthest = max(self.farthest, float((limits if len(limits) else batch.ranges[valid]).max(initial=0.0)))
        if raw.intensities is not None:
            self._take_intensities(raw.intensities[alike, :beams], valid[alike, :beams])
        for row in np.flatnonzero(alike).tolist() if beams <= MAX_WIDTH else ():
            if self.ranges.takes():
                self.ranges.rows.append(np.where(valid[row, :beams], batch.ranges[row, :beams], np.float32(np.nan)))

    def _take_intensities(self, intensities: Float32, valid: Bool) -> None:
        """Count the beams (S, B) whose intensity is 0 where a range is, or is not where none is, as sent and in reverse."""
        dark = intensities == 0.0
        telling = dark.any(axis=1) & (intensities > 0.0).any(axis=1)
        valid, dark = valid[telling], dark[telling]
        self.unlike += int(np.count_nonzero(valid == dark))
        self.unlike_reversed += int(np.count_nonzero(valid == dark[:, ::-1]))

    def statistics(self) -> dict[str, Any]:
        """Return what the rules of `sweeps.findings` on habits use."""
        codes, body, (pace, fits) = sorted(self.codes), self._body(), self._pace()
        return {
            "codes_share": self.codes.total() / max(self.beams, 1),
            "codes_span": [codes[0], codes[-1]] if codes else [np.nan, np.nan],
            "farthest": self.farthest,
            "reversed_intensities": self.unlike >= MIN_UNLIKE and self.unlike_reversed < 0.1 * self.unlike,
            "unlike": self.unlike / max(self.beams, 1),
            "unlike_reversed": self.unlike_reversed / max(self.beams, 1),
            "body": body,
            "body_beams": len(body),
            "body_shown": counted(len(body), "beam"),
            "body_nearest": float(np.min(body, initial=np.inf)),
            "body_farthest": float(np.max(body, initial=0.0)),
            "pace": pace,
            "is_paced": fits and not PACES[0] <= pace <= PACES[1],
        }

    def _body(self) -> Float64:
        """Return the median ranges (K,) [m] of beams that stay on something near while those beyond it change."""
        if len(self.ranges.rows) < MIN_ROWS:
            return np.zeros(0)
        ranges = np.array(self.ranges.rows, np.float64)
        share = np.mean(np.isfinite(ranges), axis=0)
        ranges = ranges[:, share >= BODY_SHARE]
        if not ranges.size:
            return np.zeros(0)
        low, middle, high = np.nanpercentile(ranges, (5.0, 50.0, 95.0), axis=0)
        near = (middle < BODY_REACH) & (high - low < BODY_SPREAD)
        far = middle >= BODY_REACH
        if not far.any() or np.median((high - low)[far]) < CHANGES:
            return np.zeros(0)
        # Of beams that are kept, those side by side are neighbours in the sweep or nearly so.
        edges = np.flatnonzero(np.diff(near, prepend=False, append=False)).reshape(-1, 2)
        return np.concatenate([np.zeros(0), *(middle[a:b] for a, b in edges if b - a >= MIN_BODY_BEAMS)])

    def _pace(self) -> tuple[float, bool]:
        """Return how much faster than its stamps the log was recorded, and whether it was so throughout."""
        if len(self.times.rows) < MIN_ROWS:
            return 1.0, False
        stamps, records = (np.array(self.times.rows, np.float64) * 1e-9).T
        stamps, records = stamps - stamps[0], records - records[0]
        if not (stamps[-1] > 0.0 and records[-1] > 0.0):
            return 1.0, False
        pace = float(stamps[-1] / records[-1])
        return pace, bool(np.abs(records * pace - stamps).max() <= PACE_FIT * stamps[-1])
