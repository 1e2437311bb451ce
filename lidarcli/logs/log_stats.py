"""Statistics of a complete log, collected by `info` alone: headers, missing ranges, repeated topics."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from lidarcli.logs.clock import ClockInfo, Sample
from lidarcli.logs.habits import Habits
from lidarcli.logs.scan_checks import THIN, range_bytes
from lidarcli.sweeps.finding_rules import ASIDE, FASTEST, LOG_RULES, LONG, REPEATED_TOPIC, judge
from lidarcli.sweeps.findings import Finding, Sensor
from lidarcli.sweeps.types import TURN, RawSweeps, Status, SweepBatch
from lidarcli.system.records import dataclass, field, fields

MAX_COMPARED, MIN_COMPARED = 2000, 10
"""Most and fewest sweeps of a topic that are compared with those of others."""
MAX_COMPARED_TOPICS = 16
"""Most topics that are compared: a log may have a new one in every message."""
KEPT = 4096
"""Most values of a header that are kept for a median."""
KINDS = ("nan", "negative", "zero", "range_max")


@dataclass(slots=True)
class LogStats:
    """Statistics of one topic and frame, taken in the order of the log."""

    compares: bool = False
    """True where other topics may hold the same sweeps."""
    sweeps: int = 0
    beams: int = 0
    """Beams, estimated from the examined sweeps."""
    kinds: Counter[str] = field(default_factory=Counter)
    """Kind of a missing range → beams, in the same way."""
    views: tuple[float, float] = (np.inf, 0.0)
    """Least and greatest view [rad]."""
    counts: tuple[int, int] = (np.iinfo(np.int32).max, 0)
    """Fewest and most beams."""
    periods: Sample = field(default_factory=lambda: Sample(KEPT))
    """`scan_time` [s] where headers have one."""
    lasting: Sample = field(default_factory=lambda: Sample(KEPT))
    """Time of a sweep by `time_increment` [s] where headers have one."""
    shares: Sample = field(default_factory=lambda: Sample(KEPT))
    """View as a share of a turn."""
    unlimited: int = 0
    """Sweeps whose greatest range is not above the least."""
    grid: tuple[float, float] | None = None
    """First bearing and step [rad] of the first sweep."""
    elsewhere: int = 0
    """Sweeps that begin at another bearing."""
    between: int = 0
    """Sweeps of this step whose beams lie between those of the first."""
    compared: int = 0
    repeats: int = 0
    """Sweeps with the ranges of the one before; `compared` have enough of them."""
    last: int | None = None
    """Hash of the ranges of the last sweep."""
    habits: Habits = field(default_factory=Habits)
    known: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Hash of the ranges of a sweep → its stamp and record time [ns]."""

    def add(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Take sweeps as the log holds them (`raw`) and with evaluated ranges (`batch`)."""
        if not len(raw):
            return
        # Of later sweeps one in `THIN` is counted, as often as it stands for others.
        first = max(512 - self.sweeps, 0)
        self._take_kinds(raw, batch, slice(first), 1)
        self._take_kinds(raw, batch, slice(first + -(self.sweeps + first) % THIN, None, THIN), THIN)
        self._take_headers(raw)
        self._take_repeats(raw, batch)
        self.habits.add(raw, batch)
        if self.compares:
            self.add_hashes(raw)
        self.sweeps += len(raw)

    def _take_kinds(self, raw: RawSweeps, batch: SweepBatch, rows: slice, stand_for: int) -> None:
        """Count the kinds of beams of some sweeps, each of which stands for several."""
        ranges, status = raw.ranges[rows], batch.status[rows]
        if not len(ranges):
            return
        none, limit = status == Status.NO_RETURN, batch.range_max[rows, None]
        with np.errstate(invalid="ignore"):
            negative = (ranges < 0) & (status == Status.INVALID)
        found = {
            "negative": negative,
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
        self.unlimited += int(np.count_nonzero(~(raw.range_max > np.maximum(raw.range_min, 0.0))))
        self.grid = self.grid or (float(raw.angle_min[0]), float(raw.angle_increment[0]) or 1.0)
        # A header may say anything.
        with np.errstate(invalid="ignore", over="ignore"):
            aside = (raw.angle_min - self.grid[0]) / self.grid[1]
            self.elsewhere += int(np.count_nonzero(np.abs(aside) > raw.beams / 2))
            alike = np.abs(raw.angle_increment - self.grid[1]) * raw.beams <= ASIDE * abs(self.grid[1])
            self.between += int(np.count_nonzero(alike & (np.abs(aside - np.rint(aside)) > ASIDE)))
            if raw.scan_time is not None:
                scan_time = raw.scan_time.astype(np.float64)
                self.periods.add(scan_time[(scan_time >= 1.0 / FASTEST) & np.isfinite(scan_time)])
            if raw.time_increment is not None:
                seconds = np.abs(raw.time_increment.astype(np.float64)) * gaps
                self.lasting.add(seconds[(seconds > 0.0) & np.isfinite(seconds)])

    def _take_repeats(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Compare the ranges of each sweep with those of the one before; few say nothing."""
        some = [hash(range_bytes(raw, row)) for row in range(len(raw))]
        valid = np.count_nonzero(batch.status == Status.VALID, axis=1)
        enough = valid * 4 >= np.maximum(raw.beams, 1)
        same = np.array([before == now for before, now in pairwise([self.last, *some])], np.bool_)
        self.compared += int(np.count_nonzero(enough))
        self.repeats += int(np.count_nonzero(enough & same))
        self.last = some[-1]

    def add_hashes(self, raw: RawSweeps) -> None:
        """Take sweeps, as the log holds them, only to compare them with those of other topics."""
        room = MAX_COMPARED - len(self.known)
        times = zip(raw.time_ns.tolist(), raw.record_ns.tolist(), strict=True)
        for row, stamps in zip(range(min(len(raw), room)), times, strict=False):
            self.known.setdefault(hash(range_bytes(raw, row)), stamps)

    def findings(self, sensor: Sensor, clock: ClockInfo, known: Collection[str], lacks_frame: bool) -> list[Finding]:
        """Return the findings; `known`: identifiers of those of the topic that there are already."""
        beams = max(self.beams, 1)
        lost = {kind: self.kinds[kind] / beams for kind in KINDS}
        period, scan_time = None if clock.rate is None else 1.0 / clock.rate, self.periods.median()
        lasts, view, by_view = self.lasting.median(), self.shares.median(), None
        # A segment takes all of the time to the next one.
        if period is not None and view and lasts is not None and 2 * self.elsewhere <= self.sweeps:
            # Where sweeps are missing the header alone knows the period.
            by_view = view * (scan_time if scan_time is not None and scan_time < LONG * period else period)
        ratio = 0.0 if period is None or not scan_time else period / scan_time
        stats = SimpleNamespace(
            **{each.name: getattr(self, each.name) for each in fields(self)},
            topic=sensor.topic,
            clock=clock,
            offset=abs(clock.offset or 0.0),
            side="before" if (clock.offset or 0.0) < 0 else "after",
            beams_span=list(self.counts),
            view_span=list(self.views),
            views_degrees=np.degrees(self.views),
            lost=lost,
            most_lost=max(KINDS, key=lambda kind: lost[kind]),
            too_close=self.kinds["too_close"] / beams,
            period=period,
            scan_time=scan_time,
            is_slow=period is not None and scan_time is not None and period > LONG * scan_time,
            missing=ratio - 1.0,
            expected=ratio,
            lasts=lasts,
            lasts_shown=_short(lasts),
            by_view=by_view,
            by_view_shown=_short(by_view),
            lacks_frame=lacks_frame,
            slashed=sensor.frame.startswith("/"),
            **self.habits.statistics(),
        )
        return judge(LOG_RULES, stats, sensor, known)


def _short(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:.3f}" if seconds >= 0.001 else f"{seconds:.2g}"


def repeated_topics(stats: Mapping[tuple[str, str], LogStats]) -> Iterator[Finding]:
    """Yield findings on topics whose sweeps are those of another topic."""
    keys = sorted(key for key, each in stats.items() if len(each.known) >= MIN_COMPARED)
    repeating: set[tuple[str, str]] = set()
    for at, one in enumerate(keys):
        for other in keys[at + 1 :]:
            if one in repeating or other in repeating or one[0] == other[0]:
                continue
            known, others = stats[one].known, stats[other].known
            both = np.array([(*known[each], *others[each]) for each in known.keys() & others.keys()], np.int64)
            if len(both) < MIN_COMPARED:
                continue
            stamps, records = (float(np.median(both[:, 2 + by] - both[:, by])) * 1e-9 for by in (0, 1))
            # What was recorded later repeats the other.
            first, second, later = (one, other, stamps) if records >= 0 else (other, one, -stamps)
            pair = SimpleNamespace(
                topic=second[0],
                first=first[0],
                first_quoted=shlex.quote(first[0]),
                same=len(both),
                fewest=min(len(known), len(others)),
                sweeps=len(stats[second].known),
                later=later,
                apart=f", stamps {abs(later):.2f} s {'later' if later > 0 else 'earlier'}" if later else "",
            )
            if found := judge([REPEATED_TOPIC], pair, Sensor(*second, second[0])):
                repeating.add(second)
                yield from found
