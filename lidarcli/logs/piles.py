"""Ranges that are no measurements: the value that a sensor writes for no return, and beams that always have one range.

The first is a pile of ranges at the most that a log holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lidarcli.logs.base import ReadReport
from lidarcli.logs.clock import MAX_TOPICS, StampMender
from lidarcli.options.choices import PILE
from lidarcli.sweeps.findings import Sensor
from lidarcli.sweeps.range_rules import FARTHEST, RangeRules, bounds, is_marked, judge, same_range
from lidarcli.sweeps.types import Bool, Float32, Float64, Int64, RawSweeps, concatenate
from lidarcli.system.records import dataclass, field, replace

WINDOW = 256
"""Sweeps of a topic examined together before any of them is evaluated."""
WINDOW_VALUES = 1 << 17
"""Most ranges of such a window: they wait in memory."""
THIN = 4
"""One sweep in this many is examined; all counts below refer to these."""
SURE, SELDOM = 16, 4
"""So many windows of a topic are all examined; later one in so many, and each that reaches farther than all before it: what
a sensor does it does from the start, but a robot may leave the house."""
MIN_SWEEPS = 5
MIN_SHARE = 0.002
"""Share of all beams that a pile holds."""
CLEAR = 20
"""Factor by which each slightly smaller value, and all larger ones together, are less frequent than the pile."""
BAND, MIN_BAND = 0.01, 0.25
"""Band below the pile in which smaller values are compared: a share of the range, and at least [m]."""
QUANTUM, WIDER = 0.01, 3.0
"""Rounding of ranges of a wall [m], and the factor by which arcs of a pile are wider than a wall within that."""
NEARER = 0.1
"""Share of the range by which returns of other sweeps must be nearer."""
COARSE, MAX_COARSE = 0.25, 1 << 12
"""Width [m] and number of the bins of the first search; the last bin has no end."""
MAX_LOST = 0.02
"""Share of beams beyond range_max that is worth a note if they look like measurements.

Of 29 topics of public recordings none has more than 1.4 %: at 8 m one sensor of a car race ends a beam in 200 beyond."""

MILLIMETRES = 1000.0


class NoReturnDetector:
    """Finds the rules by which ranges are evaluated, whatever the blocks in which they come.

    Rules that are found in a window of sweeps count for these and all later ones of their topic.
    """

    def __init__(self, rules: RangeRules, report: ReadReport) -> None:
        """`report` takes one note per topic, and the values that were found."""
        self._rules = rules
        self._report = report
        self._mender = StampMender()
        self._topics: dict[str, _PiledTopic] = {}

    def take(self, block: RawSweeps) -> Iterator[tuple[RawSweeps, RangeRules]]:
        """Take sweeps; yield those whose rules are known, in the order of the log within each topic."""
        for sweeps in self._mender.take(block):
            yield from self._take(sweeps)

    def flush(self) -> Iterator[tuple[RawSweeps, RangeRules]]:
        """Yield the sweeps that are left, and their rules."""
        for sweeps in self._mender.flush():
            yield from self._take(sweeps)
        for topic in self._topics.values():
            yield from topic.settle()

    def _take(self, sweeps: RawSweeps) -> Iterator[tuple[RawSweeps, RangeRules]]:
        topic = self._topics.get(sweeps.topic)
        if topic is None and len(self._topics) == MAX_TOPICS:
            yield sweeps, self._rules
            return
        if topic is None:
            topic = self._topics[sweeps.topic] = _PiledTopic(self._rules, self._report)
        yield from topic.take(sweeps)


@dataclass(slots=True)
class _PiledTopic:
    """The sweeps of one topic that wait until their window is full."""

    rules: RangeRules
    report: ReadReport
    _waiting: list[RawSweeps] = field(default_factory=list)
    _sweeps: int = 0
    _values: int = 0
    _windows: int = 0
    _reach: float = 0.0
    """Greatest range in the windows so far [m]."""
    _earlier: int = 0
    _beams: int = 0
    _examined: int = 0
    _since: int = 0
    """First sweep with other rules than the given ones."""
    _piled: int = 0
    _most: float = 0.0
    _is_passed: bool = False
    _stuck: dict[int, tuple[float, int]] = field(default_factory=dict)
    """Stuck beam → its range [m] and the first sweep in which it was known."""
    _lost: int = 0
    _lost_range: tuple[float, float] = (0.0, 0.0)
    """range_max, and the greatest of these ranges [m]."""

    def take(self, block: RawSweeps) -> Iterator[tuple[RawSweeps, RangeRules]]:
        """Add a block to the window; yield what completes windows."""
        first = 0
        while first < len(block):
            ends = self._values + np.cumsum(block.beams[first : first + WINDOW - self._sweeps], dtype=np.int64)
            rows = int(np.searchsorted(ends, WINDOW_VALUES, side="right"))
            # A sweep of more values is a window of its own.
            rows = rows if rows or self._waiting else 1
            if rows:
                self._waiting.append(block.rows(slice(first, first + rows)))
                self._values = int(ends[rows - 1])
                self._sweeps += rows
            first += rows
            if rows < len(ends) or self._sweeps == WINDOW:
                yield from self.settle()

    def settle(self) -> Iterator[tuple[RawSweeps, RangeRules]]:
        """Examine the waiting sweeps and yield them."""
        waiting, self._waiting = self._waiting, []
        if waiting:
            window, given_rules = concatenate(_every(waiting, THIN)), replace(self.rules, farthest=math.inf)
            low, high = bounds(window, given_rules)
            with np.errstate(invalid="ignore"):
                reach = float(np.fmax.reduce(window.ranges * (window.ranges < high[:, None]), axis=None, initial=0))
            if self._windows < SURE or self._windows % SELDOM == 0 or reach > self._reach:
                self._examine(window, low, high)
            if PILE in self.rules.no_return:
                self._count_piled(waiting, given_rules)
            self._report_findings(window.topic)
            self._reach = max(reach, self._reach)
            self._windows += 1
        self._earlier += self._sweeps
        self._sweeps = self._values = 0
        for block in waiting:
            yield block, self.rules

    def _examine(self, window: RawSweeps, low: Float32, high: Float32) -> None:
        self._examined += int(window.beams.sum())
        if self.rules.limits is None:
            self._find_beyond(window, high)
        if PILE in self.rules.no_return:
            clean, _ = judge(window.ranges, window.beams, low, bounds(window, self.rules)[1], self.rules.words)
            if self.rules.markers or self.rules.stuck:
                clean[is_marked(window.ranges, self.rules)] = np.nan
            self._find_stuck(clean)
            self._find_piles(window, clean)

    def _find_stuck(self, ranges: Float32) -> None:
        """Mark stuck beams from now on."""
        found = find_stuck_beams(ranges)
        for beam, value in found.items():
            self._stuck.setdefault(beam, (value, self._earlier))
            self.rules = replace(self.rules, stuck=(*self.rules.stuck, (beam, value)))
        if found:
            ranges[is_marked(ranges, self.rules)] = np.nan

    def _find_piles(self, window: RawSweeps, ranges: Float32) -> None:
        for _ in range(3):
            pile = _pile(ranges, int(window.beams.sum()), np.abs(window.angle_increment))
            if pile is None:
                return
            if not self._most:
                self._since, self._most = self._earlier, pile[1]
            self.rules = replace(self.rules, farthest=pile[0])
            self.report.no_return[window.topic] = pile[0]
            with np.errstate(invalid="ignore"):
                ranges[ranges >= np.float32(pile[0])] = np.nan

    def _count_piled(self, blocks: list[RawSweeps], given_rules: RangeRules) -> None:
        """Count the beams that are no return by a pile, and all."""
        for block in blocks:
            self._beams += int(block.beams.sum())
            if self._most:
                here = block.ranges >= np.float32(self.rules.farthest)
                here &= block.ranges < bounds(block, given_rules)[1][:, None]
                here &= np.arange(here.shape[1]) < block.beams[:, None]
                self._piled += int(np.count_nonzero(here))
                self._is_passed |= bool((block.ranges[here] > np.float32(self._most)).any())

    def _find_beyond(self, window: RawSweeps, high: Float32) -> None:
        with np.errstate(invalid="ignore"):
            beyond = (window.ranges > high[:, None]) & (window.ranges <= FARTHEST)
        few = MAX_LOST * window.beams.sum()
        # Most logs have hardly anything there, not even as padding.
        if np.count_nonzero(beyond) <= few:
            return
        beyond &= np.arange(window.ranges.shape[1]) < window.beams[:, None]
        if np.count_nonzero(beyond) <= few:
            return
        values, counts = _counted(_millimetres(window.ranges[beyond]))
        # What a driver writes for no return is one value, or a few.
        usual = counts * CLEAR > counts.sum()
        lost = counts[~usual].sum()
        if lost <= max(MAX_LOST * window.beams.sum(), 50):
            return
        self._lost += int(lost)
        greatest = max(self._lost_range[1], float(values[~usual][-1] / MILLIMETRES))
        self._lost_range = float(high[0]), greatest

    def _report_findings(self, topic: str) -> None:
        """Replace the notes on this topic in the report."""
        findings = []
        sensor = Sensor(topic, "", topic)
        words = ",".join(word for word in self.rules.in_order() if word != PILE)
        if self._most:
            since = f"from sweep {self._since} on, " if self._since else ""
            span = _span(self.rules.farthest, self._most)
            most = "nearly the most" if self._is_passed else "the most"
            share = self._piled / self._beams
            findings.append(
                sensor.finding(
                    "no_return",
                    "hint",
                    f"{topic}: {since}{share:.1%} of the beams end at {span}, {most} there is: taken as no return",
                    {"share": share, "range": self.rules.farthest},
                    {"share": MIN_SHARE},
                    f"--no-return {words}",
                    "no-return",
                )
            )
        for beam, (value, first) in list(self._stuck.items())[:3]:
            since = f"from sweep {first} on, " if first else ""
            findings.append(
                sensor.finding(
                    "no_return",
                    "hint",
                    f"{topic}: {since}beam {beam} is {value:g} m wherever the robot goes: taken as no return",
                    {"beam": beam, "range": value},
                    option=f"--no-return {words}",
                    mend="no-return",
                )
            )
        if self._lost > MAX_LOST * self._examined:
            limit, greatest = self._lost_range
            share, option = self._lost / self._examined, f"--range 0 {np.ceil(greatest):g}"
            findings.append(
                sensor.finding(
                    "limits",
                    "warning",
                    f"{topic}: {share:.1%} of the beams are beyond the greatest range of {limit:g} m that the log "
                    f"tells, but look like measurements; {option} takes them",
                    {"share": share, "range_max": limit, "greatest": greatest},
                    {"share": MAX_LOST},
                    option,
                    "limits",
                )
            )
        if findings:
            self.report.doubts[topic] = tuple(findings)
        else:
            self.report.doubts.pop(topic, None)


def _every(blocks: list[RawSweeps], step: int) -> list[RawSweeps]:
    """Return each `step`-th sweep of blocks that follow each other, the first one too."""
    found, first = [], 0
    for block in blocks:
        rows = block.rows(slice(-first % step, None, step))
        first += len(block)
        if len(rows):
            found.append(rows)
    return found


def _span(least: float, most: float) -> str:
    return f"{least:g} m" if most - least < 1e-4 else f"{least:g} to {most:g} m"


def _millimetres(values: Float32) -> Int64:
    return np.rint(values * np.float64(MILLIMETRES)).astype(np.int64)


def _counted(values: Int64) -> tuple[Int64, Int64]:
    """Return the distinct values (N,) in their order, and how often each is there; N > 0."""
    least = int(values.min())
    # Values in a narrow span are counted by their places, others sorted.
    if int(values.max()) - least > 1 << 16:
        return np.unique(values, return_counts=True)
    counts = np.bincount(values - least)
    found = np.flatnonzero(counts)
    return found + least, counts[found]


def _pile(ranges: Float32, beams: int, steps: Float64) -> tuple[float, float] | None:
    """Return the least and the greatest value of the farthest pile of (S, B) ranges, NaN where there is none [m]."""
    # The farthest values that are together the share of the beams that could be a pile: no less than the last of them.
    share = max(math.ceil(MIN_SHARE * beams), 1)
    if share > ranges.size:
        return None
    last = _greatest(ranges, share)
    if not last:
        return None
    edge = (min(last // COARSE, MAX_COARSE - 1) - 1) * COARSE
    band = max(MIN_BAND, BAND * edge)
    with np.errstate(invalid="ignore"):
        far = ranges >= np.float32(edge - band)
    if not far.any():
        return None
    values, counts = _counted(_millimetres(ranges[far]))
    at = int(counts.argmax())
    band = max(MIN_BAND, BAND * values[at] / MILLIMETRES)
    # A pile is one value, or two up to 5 cm apart, each a centimetre wide; measurements spread over more.
    near = np.abs(values - values[at]) <= 0.06 * MILLIMETRES
    below = ~near & (values < values[at]) & (values >= values[at] - band * MILLIMETRES)
    over = ~near & (values > values[at])
    two = np.sort(counts[near])[-2:].sum()
    if two < 0.8 * counts[near].sum() or max(counts[over].sum(), counts[below].max(initial=0)) * CLEAR > two:
        return None
    # Values that are rare, compared with the most frequent one, are no part of the pile.
    kept = values[near & (counts >= 0.01 * counts[at])]
    pile = ranges[far & (ranges >= (kept[0] - 0.5) / MILLIMETRES) & (ranges <= (kept[-1] + 0.5) / MILLIMETRES)]
    # The shortest decimals are what the sensor's driver has in mind.
    least, most = float(str(pile.min())), float(str(pile.max()))
    is_none = _is_seen_through(ranges, least, beams) or _is_round(ranges, least, most, steps)
    return (least, most) if is_none else None


def _greatest(ranges: Float32, n: int) -> float:
    """Return the n-th greatest of (S, B) ranges, 0 where fewer are above that [m]."""
    # As many bearings have one no less than the n-th greatest of their farthest ones: only what is no less is looked at.
    farthest = np.fmax(np.fmax.reduce(ranges, axis=0), 0.0)
    least = np.partition(farthest, -n)[-n] if n <= len(farthest) else 0.0
    with np.errstate(invalid="ignore"):
        far = ranges[ranges >= least]
    return float(np.partition(far, -n)[-n]) if n <= len(far) else 0.0


def _is_seen_through(ranges: Float32, least: float, beams: int) -> bool:
    """Return True if ranges from `least` on come and go at many bearings, unlike a wall."""
    with np.errstate(invalid="ignore"):
        piled = ranges >= np.float32(least)
        nearer = ranges < np.float32(least * (1.0 - NEARER))
    if np.count_nonzero(piled.any(axis=1)) < MIN_SWEEPS:
        return False
    hits, others = np.count_nonzero(piled, axis=0), np.count_nonzero(nearer, axis=0)
    # Bearings with the value count where at least one sweep in ten has something nearer.
    changing = (hits > 0) & (others >= 0.1 * (hits + others))
    changed = int(hits[changing].sum())
    # A standing sensor has a far wall at the same bearings all the time.
    enough = changed >= MIN_SHARE * beams and hits.sum() - changed <= 0.5 * hits.sum()
    return bool(enough and np.count_nonzero(changing) >= 10)


def _is_round(ranges: Float32, least: float, most: float, steps: Float64) -> bool:
    """Return True if ranges from `least` on form arcs around the sensor (`steps` [rad] between beams), unlike a wall."""
    # A wall at a distance d is farther by d x² / 2 at an angle x from its nearest point: only so far it keeps its range.
    with np.errstate(invalid="ignore"):
        piled = ranges >= np.float32(least)
        nearer = ranges < np.float32(least)
    count, others = np.count_nonzero(piled), np.count_nonzero(nearer)
    # In a round room most beams end at its wall.
    if count > 0.6 * (count + others) or len(np.unique(_millimetres(ranges[nearer]))) < 50:
        return False
    width = WIDER * 2.0 * math.sqrt(2.0 * (most - least + QUANTUM) / least)
    # Where arcs begin and end, row by row.
    edges = np.diff(np.pad(piled, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, begin), (_, end) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    wide = (end - begin) * steps[row] > width
    within = int((end - begin)[wide].sum())
    return bool(len(np.unique(row[wide])) >= MIN_SWEEPS and within >= 0.5 * count)


STEADY = 0.95
"""Least share of sweeps in which a stuck beam has its range."""
SOME = 4
"""One of these sweeps in this many is looked at first."""
MOVED, MIN_MOVED = 0.05, 0.2
"""Least change of a moved beam: share of its range, and [m]; a tenth of the sweeps at either end is left out."""
MOVING = 0.25
APART, MOSTLY = 0.1, 0.9
"""Share of the range by which neighbours differ, and share of the sweeps in which they do."""


def find_stuck_beams(ranges: Float32) -> dict[int, float]:
    """Return stuck beams of (S, B) ranges (nan where none) → their constant range [m]."""
    if len(ranges) < 10:
        return {}
    usual = ranges[len(ranges) // 2]
    # A few sweeps suffice to exclude nearly all beams, which change too often.
    changes = np.count_nonzero(~same_range(ranges[::SOME], usual), axis=0)
    # Nearer beams may see the body of the robot.
    steady = np.flatnonzero((changes <= (1.0 - STEADY) * len(ranges) + 1.0) & (usual > 1.0))
    stuck = np.zeros(len(usual), bool)
    stuck[steady] = same_range(ranges[:, steady], usual[steady]).mean(axis=0) >= STEADY
    # More stuck beams would be those of something that moves along.
    if not 0 < np.count_nonzero(stuck) <= max(1.0, 0.02 * len(stuck)) or not _moves(ranges):
        return {}
    return {
        beam: float(str(usual[beam]))
        for beam in np.flatnonzero(stuck).tolist()
        # A range that other beams have, too, is no matter of one beam.
        if same_range(ranges[:, ~stuck], usual[beam]).mean() <= 0.001
        and all(_differ(ranges[:, other], float(usual[beam])) for other in _neighbours(stuck, beam))
    }


def _moves(ranges: Float32) -> bool:
    """Return True if the robot drives: many beams see other places, and not only for a moment."""
    known = np.count_nonzero(~np.isnan(ranges), axis=0)
    known_beams = np.flatnonzero(2 * known >= len(ranges))
    ordered, last = np.sort(ranges[:, known_beams], axis=0), known[known_beams] - 1
    beams = np.arange(len(known_beams))
    low, high = (ordered[(share * last).astype(np.int64), beams] for share in (0.1, 0.9))
    moved = high - low > np.maximum(MIN_MOVED, MOVED * high)
    return len(known_beams) > 0 and bool(np.count_nonzero(moved) >= MOVING * len(known_beams))


def _neighbours(stuck: Bool, beam: int) -> list[int]:
    """Return the nearest beam on either side that is not stuck."""
    others = np.flatnonzero(~stuck)
    return [*others[others < beam][-1:].tolist(), *others[others > beam][:1].tolist()]


def _differ(ranges: Float32, value: float) -> bool:
    with np.errstate(invalid="ignore"):
        return float(np.mean(~(np.abs(ranges - value) <= APART * value))) >= MOSTLY
