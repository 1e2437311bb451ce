"""Statistics of sweeps in bounded memory, by which the rules of `logs.rules` find what looks wrong in them.

`ScanChecks` goes along whenever sweeps are read; `LogStats` is collected by `info` alone, for what only a look at the whole
log tells. Both take what `range_rules.normalise` has judged, in the order of the log.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from lidarcli.logs.base import MAX_BEAMS, ReadReport
from lidarcli.logs.clock import NO_STAMPS, SAME_NS, Clock, ClockInfo, Sample, in_words
from lidarcli.sweeps.findings import (
    ASIDE,
    CERTAINLY_MM,
    FAR,
    FASTEST,
    FEW,
    FINEST_STEP,
    LOG_RULES,
    LONG,
    LONG_RANGE,
    OFTEN,
    REPEATED_TOPIC,
    SOME,
    SWEEP_RULES,
    UNUSABLE,
    WIDEST_VIEW,
    Finding,
    Sensor,
    judge,
)
from lidarcli.sweeps.range_rules import FARTHEST
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int64, RawSweeps, Status, SweepBatch, spared

MOST = 1000
"""Most pairs of topic and frame examined: a log may have a new name in every message."""
FIRST, THIN = 32, 11
"""The first sweeps are all examined, then one in every THIN; THIN is odd, so that each of two sensors is met."""
TOGETHER, PERIOD = 16, 256
"""Number of consecutive sweeps compared with each other, out of each period of sweeps."""
BEAMS = 60
"""Number of beams compared per sweep."""
PLOTTED = 500
REPEATS = 256
"""Most sweeps with a repeated stamp that are compared with the one before."""
APART = 0.1
"""Least change [m] of half of the beams between sweeps of two alternating sensors."""
NEARER = 3.0
"""Factor by which a sweep must be nearer to the second or third one before it."""
FROZEN_NS = 500_000_000
"""Age from which on the same ranges are those of a sensor that hangs [ns]; a driver may send each sweep some times."""
TURNS_OF = 8
"""Most old sweeps that a sensor that hangs sends in turns."""
NOISY = 0.002
"""Least middle third difference of ranges that are measured [m]: a simulation without noise may repeat its sweeps."""
AT_MOST, ABOVE, BELOW = "at range_max", "above range_max", "below range_min"
REMEDIES = {
    "NaN": "no ranges (--no-return nan)",
    **dict.fromkeys(("NaN, counted as no return", "zero", "infinite", AT_MOST), "nothing near, or nothing measured"),
}
"""Remedies by the main cause of missing ranges."""
TOLD_SHARE = 0.01
"""Least share of the beams of a cause that is told."""
COARSE_STEP = 0.2
"""Beams as far apart as this are a quarter of a degree apart that is taken as a radian [rad]."""
WHOLE = 512
"""The first sweeps of which `LogStats` counts every beam, then one sweep in `THIN`, which stands for all of these."""
MAX_COMPARED, MIN_COMPARED = 2000, 10
"""Most and fewest sweeps of a topic that are compared with those of others."""
MAX_COMPARED_TOPICS = 16
"""Most topics that are compared: a log may have a new one in every message."""
KEPT = 4096
"""Most values of a header that are kept for a median."""
KINDS = ("nan", "zero", "range_max")
ZEROS = TURN / 8
"""Least view to be told of zeros, or values beyond all sense, [rad]: nothing may be there, or nothing measured."""
Went = Callable[[str, str, Int64, Int64], Bool]
"""Tells whether the sensor of a topic and frame has gone from some stamps to others (S,) [ns], by told poses."""


class ScanChecks:
    """Collects findings on sweeps, taken in the order of the log."""

    def __init__(self, clouds: Collection[str] = (), went: Went | None = None) -> None:
        self._clouds = clouds
        """Topics of point clouds: in metres, whatever the unit of the log."""
        self._went = went
        self._stats: dict[tuple[str, str], SweepStats] = {}

    def add(self, raw: RawSweeps, batch: SweepBatch) -> Bool:
        """Take sweeps as the log holds them (`raw`) and with judged ranges (`batch`); return (S,) those that repeat."""
        frozen = np.zeros(len(batch), np.bool_)
        for frame, rows, mine in batch.by_frame():
            key = batch.topic, frame
            if key not in self._stats:
                if len(self._stats) == MOST:
                    continue
                self._stats[key] = SweepStats()
            went = None if self._went is None else partial(self._went, *key)
            frozen[rows] = self._stats[key].add(raw if mine is batch else raw.rows(rows), mine, went)
        return frozen

    def clock(self, topic: str, frame: str) -> ClockInfo:
        """Return the statistics of the times of one topic and frame."""
        return self._stats[topic, frame].times.info()

    def report_to(self, report: ReadReport) -> None:
        """Put the findings so far into the report, by topic and frame."""
        before = {*report.doubts}
        frames = Counter(topic for topic, _ in self._stats)
        for (topic, _), stats in self._stats.items():
            if stats.is_far:
                # What was said of its ranges is in the wrong unit.
                report.doubts.pop(topic, None)
        for (topic, frame), stats in sorted(self._stats.items()):
            sensor = self.sensor(topic, frame)
            findings = stats.findings(sensor, frames[topic] == 1, topic in before, topic not in self._clouds)
            if unread := report.unread.get(topic):
                findings = [each for each in findings if each.id != "clock" or not unread.endswith(NO_STAMPS)]
                findings.append(sensor.finding("clock", "error", unread))
            report.add_doubts(topic, findings)

    def sensor(self, topic: str, frame: str) -> Sensor:
        """Return the words for a topic and frame."""
        alone = sum(topic == other for other, _ in self._stats) == 1
        return Sensor(topic, frame, topic if alone else f"{topic} (frame {frame or 'without a name'})")


def _bytes(raw: RawSweeps, row: int) -> bytes:
    return raw.ranges[row, : raw.beams[row]].tobytes()


def _is_noisy(raw: RawSweeps, row: int) -> bool:
    """Return whether the ranges of a sweep have noise: on a straight wall 1/r is a sinusoid of the bearing."""
    # Rounding alone makes a middle third difference of 0.9 of its step.
    ranges = raw.ranges[row, : raw.beams[row]].astype(np.float64)
    ranges[~(np.isfinite(ranges) & (ranges > 0.0))] = np.nan
    inverse = 1.0 / ranges
    off = inverse[:-2] + inverse[2:] - 2.0 * np.cos(raw.angle_increment[row]) * inverse[1:-1]
    off = np.abs(np.diff(off * ranges[1:-1] ** 2))
    off = off[np.isfinite(off)]
    steps = np.diff(np.sort(ranges[np.isfinite(ranges)]))
    rounded = float(steps[steps > 0.0].min(initial=np.inf))
    return bool(len(off) and np.median(off) > max(NOISY, 2.0 * rounded))


@dataclass(slots=True)
class SweepStats:
    """Statistics of one topic and frame."""

    times: Clock = field(default_factory=Clock)
    some: bool = False
    """True if any sweep has a beam."""
    beams: int = 0
    valid: int = 0
    """Beams of the examined sweeps; `valid` counts those with a range."""
    wide: int = 0
    fine: int = 0
    coarse: int = 0
    """Sweeps that see more than a turn and a half by steps as large as degrees."""
    view: float = 0.0
    """Widest view [rad]."""
    step: float = 0.0
    """Finest step that is too fine [rad]."""
    off: int = 0
    """Sweeps whose last beam is not at `angle_max`."""
    ends: tuple[float, float] = (0.0, 0.0)
    """Bearing of the last beam of the first such sweep by `angle_max`, and by the increment [rad]."""
    cut: str = ""
    """Words for beams that are not there."""
    far: int = 0
    farther: int = 0
    ranged: int = 0
    """All ranges; `far` counts those beyond `FAR`, `farther` those beyond `CERTAINLY_MM`, `long` beyond `LONG_RANGE`."""
    long: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    """Cause of a missing range → number of beams, in sweeps with hardly any range."""
    limits: tuple[float, float] = (0.0, 0.0)
    before: tuple[Int64, Float32] = field(default_factory=lambda: (np.zeros(0, np.int64), np.zeros((0, BEAMS), np.float32)))
    """Numbers and sampled ranges of the last three compared sweeps."""
    last: tuple[int, int] | None = None
    """Time and number in the log of the very last sweep."""
    compared: int = 0
    turns: int = 0
    """Compared sweeps that resemble an earlier sweep more than the one before."""
    repeats: int = 0
    alike: int = 0
    """Sweeps that repeat the ranges of the one before; `repeats` counts those that repeat its stamp."""
    recent: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Hash of the ranges of the last sweeps that differ → stamp and time of the recording of the first that had them."""
    examined: int = 0
    zeros: int = 0
    """Sweeps that were examined; `zeros` counts those with a view of zeros, of which `most_zeros` is the widest [rad]."""
    most_zeros: float = 0.0
    blind: int = 0
    """Sweeps without any range."""
    frozen: int = 0
    """Sweeps that repeat older ones."""

    @property
    def is_far(self) -> bool:
        """True if most ranges are too large for metres."""
        return 2 * self.far > self.ranged or (2 * self.long > self.ranged and self.far > FEW * self.ranged)

    def add(self, raw: RawSweeps, batch: SweepBatch, went: Callable[[Int64, Int64], Bool] | None = None) -> Bool:
        """Take sweeps; return (S,) which repeat older ones. `went` is `Went` for this sensor."""
        number = self.times.sweeps + np.arange(len(raw))
        self.times.add(raw, batch.sweep)
        self._take_geometry(raw)
        if len(raw):
            begins = int(number[0])
            first = max(FIRST - begins, 0)
            # Slices copy nothing.
            self._take_ranges(raw, batch, slice(first))
            self._take_ranges(raw, batch, slice(first + -(begins + first) % THIN, None, THIN))
        self._take_order(raw, batch, number)
        same, frozen = self._compare(raw, went)
        self._take_repeats(raw, batch, same)
        frozen &= batch.observed
        self.frozen += int(np.count_nonzero(frozen))
        self.blind += int(np.count_nonzero(~batch.observed))
        return frozen

    def findings(self, sensor: Sensor, alone: bool, has_limit: bool, in_unit: bool) -> list[Finding]:
        """Return the findings so far.

        Parameters
        ----------
        alone : no other frame is on the topic
        has_limit : there is a finding already on what is beyond the greatest range (`logs.piles`)
        in_unit : ranges may have another unit
        """
        clock, sweeps, name = self.times.info(), self.times.sweeps, sensor.name
        total = max(sum(self.counts.values()), 1)
        shares = {cause: count / total for cause, count in self.counts.items() if count}
        by_share = sorted(shares.items(), key=lambda each: -each[1])
        cause, (least, most) = by_share[0][0] if by_share else "", self.limits
        without = (self.beams - self.valid) / max(self.beams, 1)
        millimetres = 2 * self.farther > self.ranged
        centimetres = self.farther <= FEW * self.ranged
        unit, option = ("millimetres", "mm") if millimetres else ("centimetres or millimetres", "cm or mm")
        unit, option = ("centimetres", "cm") if centimetres else (unit, option)
        mostly, limit = (self.far, FAR) if 2 * self.far > self.ranged else (self.long, LONG_RANGE)
        astray = max(clock.astray, key=abs, default=0.0)
        shown, side = in_words(abs(astray)), "ahead of" if astray > 0 else "behind"
        every = f"--every {clock.copies}" if clock.copies > 1 and alone else ""
        stats = SimpleNamespace(
            **{each: getattr(self, each) for each in ("some", "beams", "wide", "coarse", "fine", "step", "view", "off")},
            **{
                each: getattr(self, each)
                for each in ("is_far", "turns", "compared", "frozen", "blind", "zeros", "examined")
            },
            zeros_share=self.zeros / max(self.examined, 1),
            zeros_degrees=np.degrees(self.most_zeros),
            clock=clock,
            sweeps=sweeps,
            view_degrees=np.degrees(self.view),
            angle_max=self.ends[0],
            last_beam=self.ends[1],
            ends_degrees=np.degrees(self.ends),
            far_share=mostly / max(self.ranged, 1),
            far_limit=limit,
            cut=self.cut,
            far_from=CERTAINLY_MM if in_unit and millimetres else limit,
            unit_option=f"--range-unit {option}" if in_unit else "",
            unit_mend="units" if in_unit and (millimetres or centimetres) else "",
            unit_remedy=f"they are probably {unit} (--range-unit {option})"
            if in_unit
            else "the points of the clouds are probably not in metres",
            without=without,
            without_by_cause={"share": without, **shares},
            cause=cause,
            has_limit=has_limit,
            causes_shown=", ".join(
                f"{'' if share == 1.0 else f'{share:.1%} '}{each}{f', {most:g} m' if each == AT_MOST else ''}"
                for each, share in by_share
                if share >= TOLD_SHARE
            ),
            remedy=REMEDIES.get(cause, f"limits {least:g} to {most:g} m (--range, --range-unit)"),
            turns_share=self.turns / max(self.compared, 1),
            spared=spared(sweeps),
            often=max(OFTEN * sweeps, SOME),
            copied=self.alike > 0.5 * self.repeats,
            every=every,
            once=f": {every} takes each once" if every else "",
            step_ns=1e9 / (clock.rate or np.inf),
            back=clock.times_back(in_words(clock.largest_backward)),
            ahead=in_words(clock.largest_forward),
            astray=astray,
            astray_count=len(clock.astray),
            astray_shown=f"one stamp of {name} is {shown} {side}"
            if len(clock.astray) == 1
            else f"{len(clock.astray):,} stamps of {name} are up to {shown} {side}",
            stampless=f"no sweep of {name} has a stamp"
            if clock.recorded == sweeps
            else f"{clock.recorded:,} of {sweeps:,} sweeps of {name} have no stamp",
        )
        return judge(SWEEP_RULES, stats, sensor)

    def _compare(self, raw: RawSweeps, went: Callable[[Int64, Int64], Bool] | None) -> tuple[Bool, Bool]:
        """Return which sweeps (S,) have the ranges of the one before, and which of one older than `FROZEN_NS`.

        These have them noise and all, or while the sensor `went` on.
        """
        same, since = np.zeros(len(raw), np.bool_), np.column_stack([raw.time_ns, raw.record_ns])
        times, keys = since.copy(), [hash(_bytes(raw, row)) for row in range(len(raw))]
        for row, key in enumerate(keys):
            same[row] = key == next(reversed(self.recent), None)
            if key not in self.recent and len(self.recent) == TURNS_OF:
                del self.recent[next(iter(self.recent))]
            since[row] = self.recent[key] = self.recent.pop(key, (int(times[row, 0]), int(times[row, 1])))
        frozen: Bool = (times - since).max(axis=1, initial=0) > FROZEN_NS
        old = np.flatnonzero(frozen)
        if len(old):
            noisy = {keys[row]: _is_noisy(raw, row) for row in {keys[row]: row for row in old.tolist()}.values()}
            frozen[old] = [noisy[keys[row]] for row in old.tolist()]
            if went is not None and not frozen[old].all():
                frozen[old] |= went(since[old, 0], times[old, 0])
        return same, frozen

    def _take_ranges(self, raw: RawSweeps, batch: SweepBatch, rows: slice) -> None:
        ranges, status, most = raw.ranges[rows], batch.status[rows], batch.range_max[rows, None]
        if not len(ranges):
            return
        least = batch.range_min[rows, None]
        beams, valid_beams = raw.beams[rows], np.count_nonzero(status == Status.VALID, axis=1)
        valid = int(valid_beams.sum())
        self.beams += int(beams.sum())
        self.valid += valid
        # Sweep by sweep, so that it does not matter what a block holds.
        few = valid_beams < (1.0 - UNUSABLE) * beams
        if few.any():
            self._take_causes(ranges[few], status[few], least[few], most[few])
        self._take_units(ranges, status, valid)
        odd = (ranges == 0.0) | ((ranges > FARTHEST) & np.isfinite(ranges))
        self._take_zeros(odd & (status == Status.NO_RETURN), np.abs(batch.angle_increment[rows]))

    def _take_zeros(self, zeros: Bool, step: Float64) -> None:
        """Count the sweeps whose beams are 0 over a wide view, step by step [rad]."""
        self.examined += len(zeros)
        for row in np.flatnonzero(np.count_nonzero(zeros, axis=1) * step >= ZEROS).tolist():
            view = float(np.diff(np.flatnonzero(np.diff(zeros[row], prepend=False, append=False)))[::2].max() * step[row])
            self.zeros += view >= ZEROS
            self.most_zeros = max(self.most_zeros, view)

    def _take_geometry(self, raw: RawSweeps) -> None:
        step = np.abs(raw.angle_increment)
        gaps = np.maximum(raw.beams - 1, 0)
        self.some |= bool(raw.beams.any())
        view = gaps * step
        wide, fine = view > WIDEST_VIEW, (step < FINEST_STEP) & (gaps > 0)
        self.view = max(self.view, float(view.max(initial=0.0)))
        self.wide += int(np.count_nonzero(wide))
        self.coarse += int(np.count_nonzero(wide & (step > COARSE_STEP)))
        if fine.any():
            self.step = float(step[fine].min()) if not self.fine else min(self.step, float(step[fine].min()))
            self.fine += int(np.count_nonzero(fine))
        if raw.angle_max is None:
            return
        last = raw.angle_min + gaps * raw.angle_increment
        # A header may say anything; what is no number says nothing.
        with np.errstate(invalid="ignore", over="ignore"):
            off = (np.abs(raw.angle_max - last) > 0.5 * step * 1.001) & np.isfinite(raw.angle_max) & (gaps > 0)
        if off.any():
            if not self.off:
                row = int(off.argmax())
                self.ends = float(raw.angle_max[row]), float(last[row])
                beams = float((raw.angle_max[row] - raw.angle_min[row]) / (raw.angle_increment[row] or np.nan)) + 1.0
                # So many PlotJuggler keeps of an array, unless it is told more.
                is_cut = raw.beams[row] == PLOTTED and PLOTTED < beams <= MAX_BEAMS
                self.cut = f", for {PLOTTED} of {beams:,.0f} beams are there: PlotJuggler cuts arrays" if is_cut else ""
            self.off += int(np.count_nonzero(off))

    def _take_causes(self, values: Float32, status: np.ndarray, least: Float32, most: Float32) -> None:
        """Count the causes of missing ranges."""
        without = (status != Status.PADDING) & (status != Status.VALID)
        finite, no_return = np.isfinite(values), status == Status.NO_RETURN
        with np.errstate(invalid="ignore"):
            found = {
                "NaN": np.isnan(values) & ~no_return,
                "NaN, counted as no return": np.isnan(values) & no_return,
                AT_MOST: finite & (values == most),
                ABOVE: finite & (values > most),
                BELOW: finite & (values > 0) & (values < least),
                "zero": values == 0,
                "infinite": np.isinf(values),
            }
        for cause, where in found.items():
            self.counts[cause] = self.counts.get(cause, 0) + int(np.count_nonzero(where & without))
        self.limits = float(least[0, 0]), float(most[0, 0])

    def _take_units(self, ranges: Float32, status: np.ndarray, valid: int) -> None:
        """Count ranges that are too far to be metres."""
        with np.errstate(invalid="ignore"):
            far = ranges > LONG_RANGE
            # Many a sensor writes inf, which is no range, in every sweep.
            if far.any():
                far &= ranges <= FARTHEST
        if not far.any():
            self.ranged += valid
            return
        with np.errstate(invalid="ignore"):
            real: Bool = (ranges > 0) & (ranges <= FARTHEST) & (status != Status.PADDING)
        top = np.where(real, ranges, 0).max(axis=1, keepdims=True, initial=0)
        # Many a driver has one great number for "no return"; where there is nothing else, it may be a range.
        below = real & (ranges < top)
        real = np.where(below.any(axis=1, keepdims=True), below, real)
        self.long += int(np.count_nonzero(real & far))
        self.far += int(np.count_nonzero(ranges[real] > FAR))
        self.farther += int(np.count_nonzero(ranges[real] > CERTAINLY_MM))
        self.ranged += int(np.count_nonzero(real))

    def _take_order(self, raw: RawSweeps, batch: SweepBatch, number: Int64) -> None:
        """Compare sweeps with those before them, also across blocks."""
        rows = np.flatnonzero((number % PERIOD < TOGETHER) & (raw.beams > 0))
        if not len(rows):
            return
        # Blocks are padded to widths of their own.
        beams = raw.beams[rows, None].astype(np.int64) * np.arange(BEAMS) // BEAMS
        some = batch.ranges[rows[:, None], beams]
        some[np.isnan(some)] = 0.0
        numbers = np.concatenate([self.before[0], number[rows]])
        some = np.concatenate([self.before[1], some])
        self.before = numbers[-3:], some[-3:].copy()
        fourth = np.flatnonzero(numbers[3:] - numbers[:-3] == 3) + 3
        if not len(fourth):
            return
        changes = np.abs(some[fourth] - np.stack([some[fourth - by] for by in (1, 2, 3)]))
        changes.partition(BEAMS // 2, axis=2)
        halves = changes[:, :, BEAMS // 2]
        nearer = np.minimum(halves[1], halves[2]) * NEARER < halves[0]
        self.compared += len(nearer)
        self.turns += int(np.count_nonzero(nearer & (halves[0] > APART)))

    def _take_repeats(self, raw: RawSweeps, batch: SweepBatch, same: Bool) -> None:
        """Count sweeps with the stamp of the one before, and those of them that also have the `same` ranges (S,)."""
        if not len(raw):
            return
        time_ns, sweep = self.last or (int(raw.time_ns[0]) - 2 * SAME_NS, int(batch.sweep[0]) - 1)
        steps, apart = np.diff(raw.time_ns, prepend=time_ns), np.diff(batch.sweep, prepend=sweep)
        rows = np.flatnonzero(np.abs(steps) <= SAME_NS * apart)[: REPEATS - self.repeats]
        self.repeats += len(rows)
        self.alike += int(np.count_nonzero(same[rows]))
        self.last = int(raw.time_ns[-1]), int(batch.sweep[-1])


@dataclass(slots=True)
class LogStats:
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
    unlimited: int = 0
    """Sweeps whose greatest range is not above the least."""
    grid: tuple[float, float] | None = None
    """First bearing and step [rad] of the first sweep."""
    between: int = 0
    """Sweeps of this step whose beams lie between those of the first."""
    compared: int = 0
    repeats: int = 0
    """Sweeps with the ranges of the one before; `compared` have enough of them."""
    last: int | None = None
    """Hash of the ranges of the last sweep."""
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
        self.unlimited += int(np.count_nonzero(~(raw.range_max > np.maximum(raw.range_min, 0.0))))
        self.grid = self.grid or (float(raw.angle_min[0]), float(raw.angle_increment[0]) or 1.0)
        # A header may say anything.
        with np.errstate(invalid="ignore", over="ignore"):
            aside = (raw.angle_min - self.grid[0]) / self.grid[1]
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
        some = [hash(_bytes(raw, row)) for row in range(len(raw))]
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
            self.known.setdefault(hash(_bytes(raw, row)), stamps)

    def findings(self, sensor: Sensor, clock: ClockInfo, known: Collection[str], lacks_frame: bool) -> list[Finding]:
        """Return the findings; `known`: identifiers of those of the topic that there are already."""
        beams = max(self.beams, 1)
        lost = {kind: self.kinds[kind] / beams for kind in KINDS}
        period, scan_time = None if clock.rate is None else 1.0 / clock.rate, self.periods.median()
        lasts, view, by_view = self.lasting.median(), self.shares.median(), None
        if period is not None and view:
            # Where sweeps are missing the header alone knows the period.
            by_view = view * (scan_time if scan_time is not None and scan_time < LONG * period else period)
        ratio = 0.0 if period is None or not scan_time else period / scan_time
        stats = SimpleNamespace(
            topic=sensor.topic,
            clock=clock,
            offset=abs(clock.offset or 0.0),
            side="before" if (clock.offset or 0.0) < 0 else "after",
            counts=self.counts,
            between=self.between,
            beams_span=list(self.counts),
            views=self.views,
            view_span=list(self.views),
            views_degrees=np.degrees(self.views),
            lost=lost,
            most_lost=max(KINDS, key=lambda kind: lost[kind]),
            too_close=self.kinds["too_close"] / beams,
            repeats=self.repeats,
            compared=self.compared,
            period=period,
            scan_time=scan_time,
            missing=ratio - 1.0,
            expected=ratio,
            lasts=lasts,
            lasts_shown=_short(lasts),
            by_view=by_view,
            by_view_shown=_short(by_view),
            lacks_frame=lacks_frame,
            slashed=sensor.frame.startswith("/"),
            sweeps=self.sweeps,
            unlimited=self.unlimited,
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
            mine, theirs = stats[one].known, stats[other].known
            both = np.array([(*mine[each], *theirs[each]) for each in mine.keys() & theirs.keys()], np.int64)
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
                fewest=min(len(mine), len(theirs)),
                sweeps=len(stats[second].known),
                later=later,
                apart=f", stamps {abs(later):.2f} s {'later' if later > 0 else 'earlier'}" if later else "",
            )
            if found := judge([REPEATED_TOPIC], pair, Sensor(*second, second[0])):
                repeating.add(second)
                yield from found
