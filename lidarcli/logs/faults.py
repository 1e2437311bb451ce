"""Faults of sweeps that only a look at the whole log tells: lost beams, missing sweeps, odd headers, repeated sweeps.

Like `doubts` a fold with bounded memory over what `range_rules.normalise` has judged; `info` alone tells them, and each
command of topics that repeat others.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from lidarcli.findings import Finding, Sensor
from lidarcli.logs.clock import FASTEST, LONG, OFTEN, SOME, ClockInfo, Sample
from lidarcli.logs.doubts import BEAMS, THIN
from lidarcli.range_rules import LONGEST_SWEEP
from lidarcli.sweeps import TURN, Float64, Int32, RawSweeps, Status, SweepBatch

WHOLE = 512
"""The first sweeps of which every beam is counted, then one sweep in `THIN`, which stands for all of these."""
LOST = 0.08
"""Share of NaN, 0 or range_max above which they are told: REP 117 writes inf for no return.

Topics of public recordings have 5 % and less of them, or 10 % and more.
"""
TOO_CLOSE = 0.01
"""Share of beams below range_min above which something near is not seen."""
VIEW_VARIES = 0.05
"""Share by which views differ where sweeps are cut short; beams alone vary with the speed of many a motor."""
MISSING = 0.01
"""Share of long steps above which sweeps are missing: no sensor of public recordings has one by chance."""
APART = 1.0
"""Most seconds between header stamp and record time of one clock."""
OFF = 0.2
"""Deviation of the time of a sweep by `time_increment` from that by view and period, as a share."""
SAME_TOPIC = 0.5
"""Share of the sweeps of a topic that another one has, too."""
MOST_COMPARED, LEAST_COMPARED = 2000, 10
"""Most and fewest sweeps of a topic that are compared with those of others."""
MOST_TOPICS = 16
"""Most topics that are compared: a log may have a new one in every message."""
KEPT = 4096
"""Most values of a header that are kept for a median."""
KINDS = ("nan", "zero", "range_max")


@dataclass(slots=True)
class Faults:
    """Statistics of one topic and frame, taken in the order of the log."""

    compares: bool = False
    """True where other topics may hold the same sweeps."""
    sweeps: int = 0
    beams: int = 0
    """Beams, as far as the examined sweeps tell."""
    kinds: Counter[str] = field(default_factory=Counter)
    """Kind of a missing range → beams, in the same way."""
    views: tuple[float, float] = (np.inf, 0.0)
    """Least and greatest view [rad]."""
    counts: tuple[int, int] = (np.iinfo(np.int32).max, 0)
    """Fewest and most beams."""
    periods: Sample = field(default_factory=lambda: Sample(KEPT))
    """`scan_time` [s] where it is told."""
    lasting: Sample = field(default_factory=lambda: Sample(KEPT))
    """Time of a sweep by `time_increment` [s] where that is told."""
    shares: Sample = field(default_factory=lambda: Sample(KEPT))
    """View as a share of a turn."""
    compared: int = 0
    repeats: int = 0
    """Sweeps with the ranges of the one before; `compared` have enough of them."""
    last: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    """Some ranges of the last sweep, bit by bit."""
    known: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Hash of the ranges of a sweep → its stamp and record time [ns]."""

    def add(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Take sweeps as the log holds them (`raw`) and with judged ranges (`batch`)."""
        if not len(raw):
            return
        first = max(WHOLE - self.sweeps, 0)
        self._take_kinds(raw, batch, slice(first), 1)
        self._take_kinds(raw, batch, slice(first + -(self.sweeps + first) % THIN, None, THIN), THIN)
        self._take_headers(raw)
        self._take_repeats(raw, batch)
        if self.compares:
            self.add_hashes(raw)
        self.sweeps += len(raw)

    def _take_kinds(self, raw: RawSweeps, batch: SweepBatch, rows: slice, stand_for: int) -> None:
        """Count the kinds of beams of some sweeps, each of which stands for several."""
        ranges, status = raw.ranges[rows], batch.status[rows]
        if not len(ranges):
            return
        none, limit = status == Status.NO_RETURN, batch.range_max[rows, None]
        found = {
            "zero": (ranges == 0) & none,
            "range_max": (ranges == limit) & none & np.isfinite(ranges),
            "nan": np.isnan(ranges) & (status == Status.INVALID),
            "too_close": status == Status.TOO_CLOSE,
        }
        self.beams += stand_for * int(raw.beams[rows].sum())
        for kind, where in found.items():
            self.kinds[kind] += stand_for * int(np.count_nonzero(where))

    def _take_headers(self, raw: RawSweeps) -> None:
        step = np.abs(raw.angle_increment)
        gaps = np.maximum(raw.beams - 1, 0)
        views = gaps * step
        self.views = min(self.views[0], float(views.min())), max(self.views[1], float(views.max()))
        self.counts = min(self.counts[0], int(raw.beams.min())), max(self.counts[1], int(raw.beams.max()))
        self.shares.add(views / TURN)
        # A header may say anything.
        with np.errstate(invalid="ignore", over="ignore"):
            if raw.scan_time is not None:
                told = raw.scan_time.astype(np.float64)
                self.periods.add(told[(told >= 1.0 / FASTEST) & np.isfinite(told)])
            if raw.time_increment is not None:
                seconds = np.abs(raw.time_increment.astype(np.float64)) * gaps
                self.lasting.add(seconds[(seconds > 0.0) & (seconds <= LONGEST_SWEEP)])

    def _take_repeats(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Compare some ranges of each sweep with those of the one before; without beams there are none."""
        if not raw.ranges.shape[1]:
            return
        columns = np.arange(BEAMS) * int(raw.beams[0]) // BEAMS
        some = np.ascontiguousarray(raw.ranges[:, columns]).view(np.int32)
        seen = np.count_nonzero(batch.status[:, columns] == Status.VALID, axis=1) >= BEAMS // 4
        before = np.concatenate([self.last[None] if len(self.last) else some[:1] ^ 1, some[:-1]])
        same = (some == before).all(axis=1)
        self.compared += int(np.count_nonzero(seen))
        self.repeats += int(np.count_nonzero(seen & same))
        self.last = some[-1].copy()

    def add_hashes(self, raw: RawSweeps) -> None:
        """Take sweeps, as the log holds them, only to compare them with those of other topics."""
        room = MOST_COMPARED - len(self.known)
        times = zip(raw.time_ns.tolist(), raw.record_ns.tolist(), strict=True)
        for row, stamps in zip(range(min(len(raw), room)), times, strict=False):
            self.known.setdefault(hash(raw.ranges[row, : raw.beams[row]].tobytes()), stamps)

    def findings(self, sensor: Sensor, clock: ClockInfo, told: frozenset[str]) -> Iterator[Finding]:
        """Yield the findings; `told`: rules by which there are findings of the topic already."""
        yield from self._of_view(sensor)
        if not told & {"no_return", "too_close", "units"}:
            yield from self._of_ranges(sensor)
        if not told & {"clock", "duplicate"}:
            yield from self._of_repeats(sensor)
            yield from self._of_period(sensor, clock)
            # A view in wrong units tells no time.
            if not told & {"geometry", "units"}:
                yield from self._of_rolling(sensor, clock)
        if clock.offset is not None and abs(clock.offset) > APART and "clock" not in told:
            side = "before" if clock.offset < 0 else "after"
            yield sensor.finding(
                "clock",
                "hint",
                f"{sensor.name}: recorded {abs(clock.offset):,.1f} s {side} the stamps",
                {"record_minus_header": clock.offset},
                {"record_minus_header": APART},
            )

    def _of_view(self, sensor: Sensor) -> Iterator[Finding]:
        least, most = self.views
        if self.counts[0] < self.counts[1] and least < (1.0 - VIEW_VARIES) * most:
            yield sensor.finding(
                "geometry",
                "warning",
                f"{sensor.name}: {self.counts[0]:,} to {self.counts[1]:,} beams see {np.degrees(least):.0f} to "
                f"{np.degrees(most):.0f} deg: some sweeps are cut short",
                {"beams": list(self.counts), "view": [least, most]},
                {"share": VIEW_VARIES},
            )

    def _of_ranges(self, sensor: Sensor) -> Iterator[Finding]:
        beams = max(self.beams, 1)
        shares = {kind: self.kinds[kind] / beams for kind in KINDS}
        kind = max(KINDS, key=lambda each: shares[each])
        if shares[kind] > LOST:
            words = {"nan": "NaN (--no-return nan)", "zero": "0", "range_max": "range_max"}
            option = "--no-return inf,zero,max,above,pile,nan" if kind == "nan" else ""
            message = f"{sensor.name}: {shares[kind]:.0%} of the beams are {words[kind]}"
            yield sensor.finding("no_return", "hint", message, shares, {"share": LOST}, option)
        share = self.kinds["too_close"] / beams
        if share > TOO_CLOSE:
            yield sensor.finding(
                "too_close",
                "warning",
                f"{sensor.name}: {share:.0%} of the beams are below range_min",
                {"share": share},
                {"share": TOO_CLOSE},
            )

    def _of_repeats(self, sensor: Sensor) -> Iterator[Finding]:
        if self.repeats > max(OFTEN * self.compared, SOME):
            yield sensor.finding(
                "duplicate",
                "hint",
                f"{sensor.name}: {self.repeats:,} of {self.compared:,} sweeps repeat the ranges before them",
                {"repeats": self.repeats, "sweeps": self.compared},
                {"share": OFTEN},
            )

    def _of_period(self, sensor: Sensor, clock: ClockInfo) -> Iterator[Finding]:
        if clock.rate is None:
            return
        period, told = 1.0 / clock.rate, self.periods.median()
        if told is not None and period > LONG * told:
            every = period / told
            yield sensor.finding(
                "gaps",
                "warning",
                f"{sensor.name}: a sweep every {period:.3f} s, by scan_time every {told:.3f} s: {every - 1:.0f} of "
                f"{every:.0f} are missing",
                {"period": period, "scan_time": told},
                {"ratio": LONG},
            )
        elif clock.long_steps > MISSING and clock.long_steps * clock.sweeps >= SOME:
            yield sensor.finding(
                "gaps",
                "warning",
                f"{sensor.name}: {clock.long_steps:.0%} of the steps are over {LONG} times the median of {period:.3f} s",
                {"share": clock.long_steps, "period": period},
                {"share": MISSING, "ratio": LONG},
            )

    def _of_rolling(self, sensor: Sensor, clock: ClockInfo) -> Iterator[Finding]:
        lasts, view = self.lasting.median(), self.shares.median()
        if clock.rate is None or lasts is None or not view:
            return
        # Where sweeps are missing the header alone knows the period.
        told = self.periods.median()
        period = told if told is not None and told < LONG / clock.rate else 1.0 / clock.rate
        expected = view * period
        if abs(lasts - expected) > OFF * expected:
            yield sensor.finding(
                "rolling",
                "warning",
                f"{sensor.name}: a sweep takes {_short(lasts)} s by time_increment, {_short(expected)} s by its view",
                {"by_increment": lasts, "by_period": expected},
                {"share": OFF},
                "--no-deskew",
            )


def _short(seconds: float) -> str:
    return f"{seconds:.3f}" if seconds >= 0.001 else f"{seconds:.2g}"


def repeated_topics(found: Mapping[tuple[str, str], Faults]) -> Iterator[Finding]:
    """Yield findings on topics whose sweeps are those of another topic."""
    keys = sorted(key for key, faults in found.items() if len(faults.known) >= LEAST_COMPARED)
    repeating: set[tuple[str, str]] = set()
    for at, one in enumerate(keys):
        for other in keys[at + 1 :]:
            if one in repeating or other in repeating or one[0] == other[0]:
                continue
            mine, theirs = found[one].known, found[other].known
            both = np.array([(*mine[each], *theirs[each]) for each in mine.keys() & theirs.keys()], np.int64)
            if len(both) < max(SAME_TOPIC * min(len(mine), len(theirs)), LEAST_COMPARED):
                continue
            stamps, records = (_median_s(both[:, 2 + by] - both[:, by]) for by in (0, 1))
            # What was recorded later repeats the other.
            first, second, sign = (one, other, 1.0) if records >= 0 else (other, one, -1.0)
            repeating.add(second)
            side = "later" if sign * stamps > 0 else "earlier"
            apart = f", stamps {abs(stamps):.2f} s {side}" if stamps else ""
            sweeps = len(found[second].known)
            sensor = Sensor(*second, second[0])
            yield sensor.finding(
                "duplicate",
                "warning",
                f"{second[0]} repeats {first[0]}: {len(both):,} of {sweeps:,} sweeps{apart}",
                {"same": len(both), "sweeps": sweeps, "stamps_later": sign * stamps},
                {"share": SAME_TOPIC},
                f"--topic {shlex.quote(first[0])}",
            )


def _median_s(times: Float64 | np.ndarray) -> float:
    return float(np.median(times)) * 1e-9
