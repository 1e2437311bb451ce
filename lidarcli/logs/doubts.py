"""Findings on suspicious sweeps: units, geometry, limits and stamps, one line each with a remedy.

A fold with bounded memory over what `range_rules.normalise` has judged. Whatever reads sweeps tells the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from lidarcli.findings import Finding, Sensor
from lidarcli.logs.base import ReadReport
from lidarcli.logs.blocks import FAR, WIDEST_VIEW
from lidarcli.logs.clock import NO_STAMPS, SAME_NS, Clock
from lidarcli.range_rules import FARTHEST
from lidarcli.sweeps import Bool, Float32, Int64, RawSweeps, Status, SweepBatch, spared

MOST = 1000
"""Most pairs of topic and frame examined: a log may have a new name in every message."""
FINEST_STEP = 1e-5
"""No sensor has finer steps between beams [rad]."""
CERTAINLY_MM = 1000.0
"""Ranges in centimetres stay below this number."""
UNUSABLE = 0.95
"""Share of beams without a range above which something may be wrong."""
FIRST, THIN = 32, 11
"""The first sweeps are all examined, then one in every THIN; THIN is odd, so that each of two sensors is met."""
TOGETHER, PERIOD = 16, 256
"""Number of consecutive sweeps compared with each other, out of each period of sweeps."""
BEAMS = 60
"""Number of beams compared per sweep."""
REPEATS = 256
"""Most sweeps with a repeated stamp that are compared with the one before."""
APART = 0.1
"""Least change [m] of half of the beams between sweeps of two alternating sensors."""
NEARER = 3.0
"""Factor by which a sweep must be nearer to the second or third one before it."""
IN_TURNS = 0.3
"""Share of compared sweeps above which two sensors are assumed to alternate."""
LEAST = 6
"""Fewest compared sweeps."""
FROZEN_NS = 500_000_000
"""Age from which on the same ranges are those of a sensor that hangs [ns]; a driver may send each sweep some times."""
NOISY = 0.002
"""Least middle third difference of ranges that are measured [m]: a simulation without noise may repeat its sweeps."""
AT_MOST, ABOVE, BELOW = "at range_max", "above range_max", "below range_min"
WAYS = {
    "NaN": "the log tells no ranges there; --no-return nan counts them as no return",
    **dict.fromkeys(
        ("NaN, counted as no return", "zero", "infinite", AT_MOST),
        "nothing was within reach, or the sensor did not measure",
    ),
}
"""Remedies by the main cause of missing ranges."""
COARSE_STEP = 0.2
"""Beams as far apart as this are a quarter of a degree apart that is taken as a radian [rad]."""


class Doubts:
    """Collects findings on sweeps, taken in the order of the log."""

    def __init__(self, clouds: Collection[str] = ()) -> None:
        self._clouds = clouds
        """Topics of point clouds: in metres, whatever the unit of the log."""
        self._seen: dict[tuple[str, str], _Seen] = {}

    def add(self, raw: RawSweeps, batch: SweepBatch) -> Bool:
        """Take sweeps as the log holds them (`raw`) and with judged ranges (`batch`); return (S,) those that repeat."""
        frozen = np.zeros(len(batch), np.bool_)
        for frame, rows, mine in batch.by_frame():
            key = batch.topic, frame
            if key not in self._seen:
                if len(self._seen) == MOST:
                    continue
                self._seen[key] = _Seen()
            frozen[rows] = self._seen[key].add(raw if mine is batch else raw.rows(rows), mine)
        return frozen

    def clock(self, topic: str, frame: str) -> Clock:
        """Return the clock of one topic and frame."""
        return self._seen[topic, frame].clock

    def tell(self, report: ReadReport) -> None:
        """Put the findings so far into the report, by topic and frame."""
        told = {*report.doubts}
        frames = Counter(topic for topic, _ in self._seen)
        for (topic, _), seen in self._seen.items():
            if seen.is_far:
                # What was said of its ranges is in the wrong unit.
                report.doubts.pop(topic, None)
        for (topic, frame), seen in sorted(self._seen.items()):
            alone = frames[topic] == 1
            sensor = self.sensor(topic, frame)
            found = seen.findings(sensor, alone, topic in told, topic not in self._clouds)
            if unread := report.unread.get(topic):
                found = [each for each in found if each.id != "clock" or not unread.endswith(NO_STAMPS)]
                found.append(sensor.finding("clock", "error", unread))
            report.add_doubts(topic, found)

    def sensor(self, topic: str, frame: str) -> Sensor:
        """Return the words for a topic and frame."""
        alone = sum(topic == other for other, _ in self._seen) == 1
        return Sensor(topic, frame, topic if alone else f"{topic} (frame {frame or 'without a name'})")


@dataclass(slots=True)
class _Repeats:
    """Sweeps that repeat the ranges of the one before, bit for bit."""

    last: bytes | None = None
    """Ranges of the last sweep."""
    since_ns: tuple[int, int] = (0, 0)
    """Stamp and time of the recording of the first sweep that had them."""

    def add(self, raw: RawSweeps) -> tuple[Bool, Bool]:
        """Return which sweeps (S,) have the ranges of the one before, and of one older than `FROZEN_NS`, noise and all."""
        if not len(raw):
            return np.zeros(0, np.bool_), np.zeros(0, np.bool_)
        # Most sweeps differ in any few beams.
        few = np.ascontiguousarray(raw.ranges[:, :: max(raw.ranges.shape[1] // 16, 1)]).view(np.int32)
        same = np.concatenate([[self.last is not None], (few[1:] == few[:-1]).all(axis=1)])
        for row in np.flatnonzero(same).tolist():
            same[row] = self._ranges(raw, row) == (self._ranges(raw, row - 1) if row else self.last)
        begin = np.maximum.accumulate(np.where(same, -1, np.arange(len(raw))))
        times, begun = np.column_stack([raw.time_ns, raw.record_ns]), np.array(self.since_ns)
        since = np.where(begin[:, None] >= 0, times[np.maximum(begin, 0)], begun)
        frozen: Bool = same & ((times - since).max(axis=1) > FROZEN_NS)
        for first in dict.fromkeys(begin[frozen].tolist()):
            mine = frozen & (begin == first)
            frozen[mine] = _is_noisy(raw, int(mine.argmax()))
        self.last, self.since_ns = self._ranges(raw, len(raw) - 1), (int(since[-1, 0]), int(since[-1, 1]))
        return same, frozen

    @staticmethod
    def _ranges(raw: RawSweeps, row: int) -> bytes:
        return raw.ranges[row, : raw.beams[row]].tobytes()


def _is_noisy(raw: RawSweeps, row: int) -> bool:
    """Tell whether the ranges of a sweep have noise: on a straight wall 1/r is a sinusoid of the bearing.

    Rounding alone makes a middle third difference of 0.9 of its step.
    """
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
class _Seen:
    """Statistics of one topic and frame."""

    clock: Clock = field(default_factory=Clock)
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
    far: int = 0
    farther: int = 0
    ranged: int = 0
    """All ranges; `far` counts those beyond `FAR`, `farther` those beyond `CERTAINLY_MM`."""
    causes: dict[str, int] = field(default_factory=dict)
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
    same: _Repeats = field(default_factory=_Repeats)
    blind: int = 0
    """Sweeps without any range."""
    frozen: int = 0
    """Sweeps that repeat older ones."""

    @property
    def is_far(self) -> bool:
        """True if most ranges are too large for metres."""
        return 2 * self.far > self.ranged

    def add(self, raw: RawSweeps, batch: SweepBatch) -> Bool:
        """Take sweeps; return (S,) which repeat older ones."""
        number = self.clock.sweeps + np.arange(len(raw))
        self.clock.add(raw, batch.sweep)
        self._take_geometry(raw)
        if len(raw):
            begins = int(number[0])
            first = max(FIRST - begins, 0)
            # Slices copy nothing.
            self._take_ranges(raw, batch, slice(first))
            self._take_ranges(raw, batch, slice(first + -(begins + first) % THIN, None, THIN))
        self._take_order(raw, batch, number)
        same, frozen = self.same.add(raw)
        self._take_repeats(raw, batch, same)
        frozen &= batch.observed
        self.frozen += int(np.count_nonzero(frozen))
        self.blind += int(np.count_nonzero(~batch.observed))
        return frozen

    def findings(self, sensor: Sensor, alone: bool, told: bool, in_unit: bool) -> list[Finding]:
        """Return the findings so far.

        Parameters
        ----------
        alone : no other frame is on the topic
        told : there is a finding already on what is beyond the greatest range (`logs.piles`)
        in_unit : ranges may have another unit
        """
        found = self._of_geometry(sensor) + self._of_ranges(sensor, told, in_unit)
        if self.turns > IN_TURNS * self.compared and self.compared >= LEAST:
            found.append(
                sensor.finding(
                    "frames",
                    "error",
                    f"sweeps of {sensor.name} come from two sensors in turns: --every 2 may take one alone",
                    {"share": self.turns / self.compared},
                    {"share": IN_TURNS},
                    "--every 2",
                )
            )
        found += self._of_observed(sensor)
        return found + self.clock.info().findings(sensor, self.alike > 0.5 * self.repeats, alone)

    def _take_ranges(self, raw: RawSweeps, batch: SweepBatch, rows: slice) -> None:
        ranges, status, most = raw.ranges[rows], batch.status[rows], batch.range_max[rows, None]
        if not len(ranges):
            return
        least = batch.range_min[rows, None]
        beams, seen = raw.beams[rows], np.count_nonzero(status == Status.VALID, axis=1)
        valid = int(seen.sum())
        self.beams += int(beams.sum())
        self.valid += valid
        # Sweep by sweep, so that it does not matter what a block holds.
        few = seen < (1.0 - UNUSABLE) * beams
        if few.any():
            self._take_causes(ranges[few], status[few], least[few], most[few])
        self._take_units(ranges, status, valid)

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
            self.off += int(np.count_nonzero(off))

    def _take_causes(self, values: Float32, status: np.ndarray, least: Float32, most: Float32) -> None:
        """Count the causes of missing ranges."""
        without = (status != Status.PADDING) & (status != Status.VALID)
        finite, told = np.isfinite(values), status == Status.NO_RETURN
        with np.errstate(invalid="ignore"):
            found = {
                "NaN": np.isnan(values) & ~told,
                "NaN, counted as no return": np.isnan(values) & told,
                AT_MOST: finite & (values == most),
                ABOVE: finite & (values > most),
                BELOW: finite & (values > 0) & (values < least),
                "zero": values == 0,
                "infinite": np.isinf(values),
            }
        for cause, where in found.items():
            self.causes[cause] = self.causes.get(cause, 0) + int(np.count_nonzero(where & without))
        self.limits = float(least[0, 0]), float(most[0, 0])

    def _take_units(self, ranges: Float32, status: np.ndarray, valid: int) -> None:
        """Count ranges that are too far to be metres."""
        with np.errstate(invalid="ignore"):
            far = ranges > FAR
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
        self.far += int(np.count_nonzero(real & far))
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

    def _of_geometry(self, sensor: Sensor) -> list[Finding]:
        found = []
        name, sweeps = sensor.name, self.clock.sweeps
        view, end, last = np.degrees([self.view, *self.ends]).tolist()
        if self.wide:
            found.append(
                sensor.finding(
                    "units" if self.coarse else "geometry",
                    "error",
                    f"{name} sees {view:,.0f} deg, more than a turn and a half ({self.wide:,} of {sweeps:,} sweeps): "
                    "angles are probably degrees that are taken as radians; a LaserScan has radians, and a text log may "
                    "have --degrees",
                    {"view": self.view, "sweeps": self.wide},
                    {"view": WIDEST_VIEW},
                    "--degrees",
                )
            )
        if self.fine:
            found.append(
                sensor.finding(
                    "geometry",
                    "error",
                    f"the beams of {name} are {self.step:.1g} rad apart ({self.fine:,} of {sweeps:,} sweeps): no sensor is "
                    "as fine; write angle_increment in radians into the log, or for a text log give --fov and --angle-min",
                    {"step": self.step, "sweeps": self.fine},
                    {"step": FINEST_STEP},
                )
            )
        if self.off and not self.wide and not self.fine:
            found.append(
                sensor.finding(
                    "geometry",
                    "warning",
                    f"angle_max of {name} is {end:.2f} deg, and by angle_min and angle_increment the last beam is at "
                    f"{last:.2f} deg ({self.off:,} of {sweeps:,} sweeps): the increment is used",
                    {"angle_max": self.ends[0], "last_beam": self.ends[1], "sweeps": self.off},
                    {"steps": 0.5},
                )
            )
        return found

    def _of_ranges(self, sensor: Sensor, told: bool, in_unit: bool) -> list[Finding]:
        name = sensor.name
        if not self.some:
            message = f"the sweeps of {name} have no beams"
            return [sensor.finding("geometry", "error", message, {"beams": 0})] if self.clock.sweeps else []
        if self.is_far:
            return [self._of_units(sensor, in_unit)]
        without = self.beams - self.valid
        if without <= UNUSABLE * self.beams:
            return []
        total = max(sum(self.causes.values()), 1)
        least, most = self.limits
        counts = {cause: count for cause, count in self.causes.items() if count}
        leading = max(counts, key=lambda cause: counts[cause], default="")
        if told and leading == ABOVE:
            return []
        shown = ", ".join(
            f"{'all of them' if count == total else f'{count / total:.1%}'} {cause}"
            f"{f', {most:g} m' if cause == AT_MOST else ''}"
            for cause, count in sorted(counts.items(), key=lambda each: -each[1])
        )
        way = WAYS.get(leading, f"--range sets other limits than {least:g} to {most:g} m, --range-unit another unit")
        return [
            sensor.finding(
                {ABOVE: "limits", BELOW: "too_close"}.get(leading, "no_return"),
                "warning" if leading in WAYS else "error",
                f"{without / self.beams:.1%} of the beams of {name} have no range ({shown}): {way}",
                {"share": without / self.beams, **{cause: count / total for cause, count in counts.items()}},
                {"share": UNUSABLE},
            )
        ]

    def _of_observed(self, sensor: Sensor) -> list[Finding]:
        """Return the findings on sweeps that show nothing; if hardly a beam has a range, there is one on that already."""
        total = self.clock.sweeps
        blind = self.blind if self.beams - self.valid < UNUSABLE * self.beams else 0
        hung = "repeat an older one bit for bit, noise and all: the sensor or its driver hung"
        found = []
        for count, what in ((blind, "have no range at all: they show nothing of what was there"), (self.frozen, hung)):
            if count > spared(total):
                words = f"{count:,} of {total:,} sweeps of {sensor.name} {what}"
                found.append(sensor.finding("observed", "warning", words, {"sweeps": count}, {"sweeps": spared(total)}))
        return found

    def _of_units(self, sensor: Sensor, in_unit: bool) -> Finding:
        """Return the finding on ranges that are too large for metres."""
        share = self.far / self.ranged
        least, unit, way = FAR, "centimetres or millimetres", "--range-unit cm or mm"
        if in_unit and 2 * self.farther > self.ranged:
            least, unit, way = CERTAINLY_MM, "millimetres", "--range-unit mm"
        they = f"they are probably {unit} ({way})" if in_unit else "the points of the clouds are probably not in metres"
        return sensor.finding(
            "units",
            "error",
            f"most ranges of {sensor.name} are beyond {least:,.0f} m: {they}",
            {"share": share},
            {"share": 0.5, "range": FAR},
            way if in_unit else "",
        )
