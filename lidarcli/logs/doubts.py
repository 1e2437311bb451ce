"""What looks wrong in the sweeps of a log that are read: units, geometry, limits and stamps, a line each with the way out.

A fold with bounded memory over what `judging.normalise` has judged. Whatever reads sweeps tells the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lidarcli.judging import FARTHEST
from lidarcli.logs.blocks import WIDEST_VIEW
from lidarcli.logs.clock import SAME_NS, Clock
from lidarcli.sweeps import Bool, Float32, RawSweeps, Status, SweepBatch

MOST = 100
"""Topics and frames that are looked at: a log may have a new name in every message."""
FINEST_STEP = 1e-5
"""[rad] No sensor has finer steps from beam to beam."""
FAR = 200.0
"""[m] Of no 2D LiDAR most ranges are greater."""
CERTAINLY_MM = 1000.0
"""[m] What is seen in centimetres is nearer."""
UNUSABLE = 0.95
"""Share of the beams without a range from which on something may be wrong."""
SAMPLE = 16
"""Sweeps of each batch that are compared with each other, the first ones …"""
BEAMS = 90
"""… by so many of their beams, up to twice as many."""
APART = 0.1
"""[m] From one sweep to the next half of the beams change by more than this …"""
NEARER = 3.0
"""… and by so many times more than to the one before that, or the third …"""
IN_TURNS = 0.3
"""… in this share of them: they come from two sensors in turns."""
LEAST = 6
"""Sweeps that have to be compared before that is told."""
WAYS = {
    "NaN": "the log tells no ranges there; --no-return nan counts them as no return",
    **dict.fromkeys(
        ("zero", "infinite", "at range_max"), "nothing was within reach, or the sensor did not measure"
    ),
}
"""What to do where that is why most beams have no range."""


class Doubts:
    """Takes sweeps in the order of the log, and tells what looks wrong in them."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], _Seen] = {}

    def add(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Take sweeps as the log holds them, and as they were judged."""
        for frame, rows, mine in batch.by_frame():
            key = batch.topic, frame
            if key not in self._seen:
                if len(self._seen) == MOST:
                    continue
                self._seen[key] = _Seen()
            self._seen[key].add(raw if mine is batch else raw.rows(rows), mine)

    def notes(self) -> list[str]:
        """What was found so far, by topic and frame."""
        topics = [topic for topic, _ in self._seen]
        lines = []
        for (topic, frame), seen in sorted(self._seen.items()):
            name = topic if topics.count(topic) == 1 else f"{topic} (frame {frame or 'without a name'})"
            lines += seen.notes(name)
        return lines


@dataclass(slots=True)
class _Seen:
    """What was seen of one topic and frame."""

    clock: Clock = field(default_factory=Clock)
    beams: int = 0
    valid: int = 0
    """Beams, and those with a range."""
    wide: int = 0
    fine: int = 0
    view: float = 0.0
    """The widest [rad]."""
    step: float = 0.0
    """The finest of those that are too fine [rad]."""
    off: int = 0
    """Sweeps whose last beam is not where `angle_max` has it …"""
    ends: tuple[float, float] = (0.0, 0.0)
    """… and of the first of them, where that is, and where the increment has it [rad]."""
    far: int = 0
    farther: int = 0
    ranged: int = 0
    """Ranges beyond `FAR`, and beyond `CERTAINLY_MM`, of all."""
    causes: dict[str, int] = field(default_factory=dict)
    """Why beams have no range → how many, where hardly any has one."""
    limits: tuple[float, float] = (0.0, 0.0)
    last: tuple[int, Float32] | None = None
    """Stamp and ranges of the last sweep."""
    compared: int = 0
    turns: int = 0
    """Sweeps that are less like the one before than like one before that, of those that were compared."""
    repeats: int = 0
    alike: int = 0
    """Sweeps with the ranges of the one before, of those with its stamp."""

    def add(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Take sweeps."""
        self.clock.add(raw, batch.sweep)
        self._take_geometry(raw)
        beams, valid = int(raw.beams.sum()), int(np.count_nonzero(batch.status == Status.VALID))
        self.beams += beams
        self.valid += valid
        if valid < (1.0 - UNUSABLE) * beams:
            self._take_causes(raw, batch)
        self._take_units(raw.ranges, batch.status, valid)
        self._take_order(raw, batch)

    def notes(self, name: str) -> list[str]:
        """What was found so far."""
        lines = self._geometry_notes(name) + self._range_notes(name)
        if self.turns > IN_TURNS * self.compared and self.compared >= LEAST:
            lines.append(
                f"sweeps of {name} come from two sensors in turns: record a topic for each; --every 2 may take one alone"
            )
        return lines + self.clock.info().doubts(name, self.alike > 0.5 * self.repeats)

    def _take_geometry(self, raw: RawSweeps) -> None:
        step = np.abs(raw.angle_increment)
        gaps = np.maximum(raw.beams - 1, 0)
        view = gaps * step
        wide, fine = view > WIDEST_VIEW, (step < FINEST_STEP) & (gaps > 0)
        self.view = max(self.view, float(view.max(initial=0.0)))
        self.wide += int(np.count_nonzero(wide))
        if fine.any():
            self.step = float(step[fine].min()) if not self.fine else min(self.step, float(step[fine].min()))
            self.fine += int(np.count_nonzero(fine))
        if raw.angle_max is None:
            return
        last = raw.angle_min + gaps * raw.angle_increment
        # A header may say anything; what is no number says nothing.
        with np.errstate(invalid="ignore", over="ignore"):
            off = (
                (np.abs(raw.angle_max - last) > 0.5 * step * 1.001) & np.isfinite(raw.angle_max) & (gaps > 0)
            )
        if off.any():
            if not self.off:
                row = int(off.argmax())
                self.ends = float(raw.angle_max[row]), float(last[row])
            self.off += int(np.count_nonzero(off))

    def _take_causes(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Why beams have no range."""
        values, real = raw.ranges, batch.status != Status.PADDING
        without = real & (batch.status != Status.VALID)
        finite = np.isfinite(values)
        with np.errstate(invalid="ignore"):
            found = {
                "NaN": np.isnan(values),
                "at range_max": finite & (values == batch.range_max[:, None]),
                "above range_max": finite & (values > batch.range_max[:, None]),
                "below range_min": finite & (values > 0) & (values < batch.range_min[:, None]),
                "zero": values == 0,
                "infinite": np.isinf(values),
            }
        for cause, where in found.items():
            self.causes[cause] = self.causes.get(cause, 0) + int(np.count_nonzero(where & without))
        self.limits = float(batch.range_min[0]), float(batch.range_max[0])

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

    def _take_order(self, raw: RawSweeps, batch: SweepBatch) -> None:
        """Compare sweeps with those before them."""
        if not len(raw):
            return
        stamps, ranges = raw.time_ns, raw.ranges
        if self.last is not None and abs(int(stamps[0]) - self.last[0]) <= SAME_NS:
            self._compare(self.last[1], ranges[0])
        self.last = int(stamps[-1]), ranges[-1].copy()
        same = np.abs(np.diff(stamps)) <= SAME_NS * np.diff(batch.sweep)
        for row in np.flatnonzero(same)[:SAMPLE].tolist():
            self._compare(ranges[row], ranges[row + 1])
        some = np.nan_to_num(batch.ranges[:SAMPLE, :: max(batch.width // BEAMS, 1)])
        if len(some) < 4 or not some.shape[1]:
            return
        differences = np.abs(np.stack([some[3:] - some[3 - by : len(some) - by] for by in (1, 2, 3)]))
        half = some.shape[1] // 2
        changes = np.partition(differences, half, axis=2)[:, :, half]
        nearer = np.minimum(changes[1], changes[2]) * NEARER < changes[0]
        self.compared += len(nearer)
        self.turns += int(np.count_nonzero(nearer & (changes[0] > APART)))

    def _compare(self, before: Float32, after: Float32) -> None:
        """Compare a sweep with the one before, which has its stamp; blocks are padded to widths of their own."""
        width = min(len(before), len(after))
        self.repeats += 1
        self.alike += int(np.array_equal(before[:width], after[:width], equal_nan=True))

    def _geometry_notes(self, name: str) -> list[str]:
        lines = []
        sweeps = self.clock.info().sweeps
        view, end, last = np.degrees([self.view, *self.ends]).tolist()
        if self.wide:
            lines.append(
                f"{name} sees {view:,.0f} deg, more than a turn and a half ({self.wide:,} of {sweeps:,} sweeps): angles "
                "are probably degrees that are taken as radians; a LaserScan has radians, and a text log may have --degrees"
            )
        if self.fine:
            lines.append(
                f"the beams of {name} are {self.step:.1g} rad apart ({self.fine:,} of {sweeps:,} sweeps): no sensor is as "
                "fine; write angle_increment in radians into the log, or for a text log give --fov and --angle-min"
            )
        if self.off and not self.wide and not self.fine:
            lines.append(
                f"angle_max of {name} is {end:.2f} deg, and by angle_min and angle_increment the last beam is at "
                f"{last:.2f} deg ({self.off:,} of {sweeps:,} sweeps): the increment is used"
            )
        return lines

    def _range_notes(self, name: str) -> list[str]:
        sweeps = self.clock.info().sweeps
        if sweeps and not self.beams:
            return [f"the sweeps of {name} have no beams"]
        if 2 * self.far > self.ranged:
            if 2 * self.farther > self.ranged:
                least, unit, way = CERTAINLY_MM, "millimetres", "mm"
            else:
                least, unit, way = FAR, "centimetres or millimetres", "cm or mm"
            return [
                f"most ranges of {name} are beyond {least:,.0f} m: they are probably {unit} (--range-unit {way})"
            ]
        without = self.beams - self.valid
        if without <= UNUSABLE * self.beams:
            return []
        total = max(sum(self.causes.values()), 1)
        told = ", ".join(
            f"{count / total:.1%} {cause}"
            for cause, count in sorted(self.causes.items(), key=lambda each: -each[1])
            if count
        )
        leading = max(self.causes, key=lambda cause: self.causes[cause], default="")
        least, most = self.limits
        way = WAYS.get(
            leading, f"--range sets other limits than {least:g} to {most:g} m, --range-unit another unit"
        )
        return [f"{without / self.beams:.1%} of the beams of {name} have no range ({told}): {way}"]
