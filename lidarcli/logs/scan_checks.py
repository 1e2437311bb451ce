"""Statistics of sweeps in bounded memory, by which the rules of `sweeps.findings` find what looks wrong in them.

They are collected whenever sweeps are read, in the order of the log, after `range_rules.normalise`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection
from functools import partial
from types import SimpleNamespace

import numpy as np

from lidarcli.logs.base import MAX_BEAMS, ReadReport
from lidarcli.logs.clock import NO_STAMPS, SAME_NS, Clock, ClockInfo, in_words
from lidarcli.sweeps.finding_rules import (
    CERTAINLY_MM,
    FAR,
    FEW,
    FINEST_STEP,
    LONG_RANGE,
    MEET,
    OFTEN,
    SOME,
    SWEEP_RULES,
    UNEVEN_LISTS,
    UNUSABLE,
    WIDEST_VIEW,
    judge,
)
from lidarcli.sweeps.findings import Finding, Sensor
from lidarcli.sweeps.range_rules import FARTHEST
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int64, RawSweeps, Status, SweepBatch, spared
from lidarcli.system.records import dataclass, field, fields

MOST = 1000
"""Most pairs of topic and frame examined: a log may have a new name in every message."""
FIRST, THIN = 32, 11
"""The first sweeps are all examined, then one in every THIN; THIN is odd, so that each of two sensors is met."""
TOGETHER, PERIOD = 16, 256
"""Number of consecutive sweeps compared with each other, out of each period of sweeps."""
BEAMS = 60
"""Number of beams compared per sweep."""
PLOTTED = 500
"""Most values of an array that PlotJuggler keeps, unless it is set otherwise."""
APART = 0.1
"""Least change [m] of half of the beams between sweeps of two alternating sensors."""
RECENT = 8
"""So many different sweeps are remembered, in case they come again."""
FROZEN_NS = 500_000_000
"""Age from which on the same ranges are those of a sensor that hangs [ns]; a driver may send each sweep some times."""
AT_MOST, ABOVE, BELOW = "at range_max", "above range_max", "below range_min"
REMEDIES = {
    "NaN": "no ranges (--no-return nan)",
    **dict.fromkeys(("NaN, counted as no return", "zero", "infinite", AT_MOST), "nothing near, or nothing measured"),
}
"""Remedies by the main cause of missing ranges."""
ZEROS = TURN / 8
"""Least view of zeros, or of absurd values, that is reported [rad]: nothing may be there, or nothing was measured."""
HALF, ALIKE = 0.03, 0.03
"""Deviation of a view from half a turn, as a share of a turn, and of its last range from its first one, as a share."""
MIN_SEAMS, MAX_SEAMS = 20, 4096
WENT = 0.05
"""Least standard deviation of the mean range of sweeps, as a share of it, by which a sensor went elsewhere."""
"""Fewest sweeps that show a seam, and the most that are kept."""
Went = Callable[[str, str, Int64, Int64], Bool]
"""Returns whether the sensor of a topic and frame has moved between two stamps each (S,) [ns], by logged poses."""


class ScanChecks:
    """Collects findings on sweeps, taken in the order of the log."""

    def __init__(self, clouds: Collection[str] = (), went: Went | None = None) -> None:
        self._clouds = clouds
        """Topics of point clouds: in metres, whatever the unit of the log."""
        self._went = went
        self._stats: dict[tuple[str, str], SweepStats] = {}

    def add(self, raw: RawSweeps, batch: SweepBatch) -> Bool:
        """Take sweeps as the log holds them (`raw`) and with evaluated ranges (`batch`); return (S,) those that repeat."""
        frozen = np.zeros(len(batch), np.bool_)
        for frame, rows, sweeps in batch.by_frame():
            key = batch.topic, frame
            if key not in self._stats:
                if len(self._stats) == MOST:
                    continue
                self._stats[key] = SweepStats()
            went = None if self._went is None else partial(self._went, *key)
            frozen[rows] = self._stats[key].add(raw if sweeps is batch else raw.rows(rows), sweeps, went)
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
            if topic in report.numbered:
                findings += judge([UNEVEN_LISTS], stats.lengths(), sensor)
            if unread := report.unread.get(topic):
                findings = [each for each in findings if each.id != "clock" or not unread.endswith(NO_STAMPS)]
                findings.append(sensor.finding("clock", "error", unread))
            report.add_doubts(topic, findings)

    def sensor(self, topic: str, frame: str) -> Sensor:
        """Return the words for a topic and frame."""
        alone = sum(topic == other for other, _ in self._stats) == 1
        return Sensor(topic, frame, topic if alone else f"{topic} (frame {frame or 'without a name'})")


def range_bytes(raw: RawSweeps, row: int) -> bytes:
    """Return the ranges of a sweep as bytes: equal ones are those of one measurement."""
    return raw.ranges[row, : raw.beams[row]].tobytes()


def _sums(raw: RawSweeps) -> list[int]:
    """Return the sum of the bits of the ranges of each sweep."""
    bits, width = raw.ranges.view(np.uint32), raw.ranges.shape[1]
    if (raw.beams < width).any():
        bits = np.where(np.arange(width) < raw.beams[:, None], bits, np.uint32(0))
    sums: list[int] = bits.sum(axis=1, dtype=np.uint32).tolist()
    return sums


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
    # A simulation without noise may repeat its sweeps, and rounding makes a difference of 0.9 of its step.
    return bool(len(off) and np.median(off) > max(0.002, 2.0 * rounded))


@dataclass(slots=True)
class SweepStats:
    """Statistics of one topic and frame."""

    times: Clock = field(default_factory=Clock)
    some: bool = False
    """True if any sweep has a beam."""
    many: Counter[int] = field(default_factory=Counter)
    """Number of beams → sweeps."""
    first_and_last: tuple[int, int] | None = None
    """Beams of the first and of the last sweep."""
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
    recent: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    """Hash of the ranges of the last `RECENT` that differ → stamp, time of the recording of the first sweep that had them,
    and sum of their bits."""
    examined: int = 0
    zeros: int = 0
    """Sweeps that were examined; `zeros` counts those with a view of zeros, of which `most_zeros` is the widest [rad]."""
    most_zeros: float = 0.0
    rims: Float64 = field(default_factory=lambda: np.zeros((3, 0)))
    """First and last ranges of sweeps of half a turn by their header [m], at most `MAX_SEAMS`."""
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
        self._take_seam(raw, batch)
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
            **{each.name: getattr(self, each.name) for each in fields(self)},
            is_far=self.is_far,
            meet=self.meet,
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
                if share >= 0.01
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

    def lengths(self) -> SimpleNamespace:
        """Return how many sweeps have another number of beams than most; the first and the last may be cut."""
        others = self.many.copy()
        others.subtract(self.first_and_last or ())
        usual = max(others, key=lambda beams: (others[beams], beams), default=0)
        others = +Counter({beams: sweeps for beams, sweeps in others.items() if beams not in (0, usual)})
        span = [min(others, default=usual), max(others, default=usual)]
        shown = f"{span[0]:,} to {span[1]:,}" if span[0] < span[1] else f"{span[0]:,}"
        return SimpleNamespace(sweeps=self.times.sweeps, usual=usual, uneven=others.total(), span=span, span_shown=shown)

    def _compare(self, raw: RawSweeps, went: Callable[[Int64, Int64], Bool] | None) -> tuple[Bool, Bool]:
        """Return which sweeps (S,) have the ranges of the one before, and which of one older than `FROZEN_NS`.

        These have them noise and all, or while the sensor `went` on.
        """
        same, since = np.zeros(len(raw), np.bool_), np.column_stack([raw.time_ns, raw.record_ns])
        times, sums, rows = since.copy(), _sums(raw), range(len(raw))
        # Ranges of different sums differ: then the last ones, for the sweeps to come, are all that is worth a hash.
        if len({*sums, *(known[2] for known in self.recent.values())}) == len(sums) + len(self.recent):
            rows = rows[-RECENT:]
        keys = {row: hash(range_bytes(raw, row)) for row in rows}
        for row, key in keys.items():
            same[row] = key == next(reversed(self.recent), None)
            if key not in self.recent and len(self.recent) == RECENT:
                del self.recent[next(iter(self.recent))]
            self.recent[key] = self.recent.pop(key, (int(times[row, 0]), int(times[row, 1]), sums[row]))
            since[row] = self.recent[key][:2]
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
        if len(raw):
            self.many.update(raw.beams.tolist())
            self.first_and_last = (self.first_and_last or raw.beams.tolist())[0], int(raw.beams[-1])
        view = gaps * step
        wide, fine = view > WIDEST_VIEW, (step < FINEST_STEP) & (gaps > 0)
        self.view = max(self.view, float(view.max(initial=0.0)))
        self.wide += int(np.count_nonzero(wide))
        # A quarter of a degree taken as radians is such a step.
        self.coarse += int(np.count_nonzero(wide & (step > 0.2)))
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

    def _take_seam(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Compare the first range with the last one of sweeps of half a turn: where a whole turn is told so, they meet."""
        half = np.abs(2.0 * raw.beams * np.abs(raw.angle_increment) - TURN) < HALF * TURN
        rows = np.flatnonzero(half & (raw.beams > 2))
        if not len(rows):
            return
        ranges = batch.ranges[rows].astype(np.float64)
        means = np.nansum(ranges, axis=1) / np.maximum(np.isfinite(ranges).sum(axis=1), 1)
        ends = np.stack([ranges[:, 0], ranges[np.arange(len(rows)), raw.beams[rows] - 1], means])
        self.rims = np.hstack([self.rims, ends[:, np.isfinite(ends).all(axis=0)]])[:, :MAX_SEAMS]

    @property
    def meet(self) -> float:
        """Share of the sweeps of half a turn in which both ends have one range; 0 where these are not related.

        In the middle of a room they have, however a sensor turns: only where it goes they tell.
        """
        first, last, means = self.rims
        if len(means) < MIN_SEAMS or means.std() < WENT * means.mean() or not (first.std() and last.std()):
            return 0.0
        if np.corrcoef(first, last)[0, 1] < MEET:
            return 0.0
        return round(float((np.abs(first - last) < ALIKE * np.maximum(first, last)).mean()), 3)

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
        nearer = np.minimum(halves[1], halves[2]) * 3.0 < halves[0]
        self.compared += len(nearer)
        self.turns += int(np.count_nonzero(nearer & (halves[0] > APART)))

    def _take_repeats(self, raw: RawSweeps, batch: SweepBatch, same: Bool) -> None:
        """Count sweeps with the stamp of the one before, and those of them that also have the `same` ranges (S,)."""
        if not len(raw):
            return
        time_ns, sweep = self.last or (int(raw.time_ns[0]) - 2 * SAME_NS, int(batch.sweep[0]) - 1)
        steps, apart = np.diff(raw.time_ns, prepend=time_ns), np.diff(batch.sweep, prepend=sweep)
        rows = np.flatnonzero(np.abs(steps) <= SAME_NS * apart)[: 256 - self.repeats]
        self.repeats += len(rows)
        self.alike += int(np.count_nonzero(same[rows]))
        self.last = int(raw.time_ns[-1]), int(batch.sweep[-1])
