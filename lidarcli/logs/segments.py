"""Turns of a sensor that publishes segments: each message sees on where the one before it ended.

The first messages of a topic and frame decide. The beams of a turn stand in the columns of one grid, whose view is that of
all segments, so every turn has the same geometry: what was lost has no range, and a segment across the seam is cut there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Literal

import numpy as np

from lidarcli.display.texts import Routine
from lidarcli.logs.base import ReadReport
from lidarcli.logs.blocks import BLOCK_VALUES
from lidarcli.logs.clock import MAX_TOPICS
from lidarcli.sweeps.range_rules import LONGEST_SWEEP
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int64, RawSweeps, concatenate
from lidarcli.system.records import dataclass, field, replace

WIDEST, FINEST = 0.7, 1 << 14
"""Share of a turn that no segment exceeds, and most beams of a turn."""
LOOKED_AT, FEWEST, OFTEN = 16, 3, 0.4
"""Messages that decide, and the least number and share of them that go on where the one before ended."""
NEAR, ALIKE = 1.5, 0.05
"""Greatest distance from there [beams], and greatest change of the increment, as a share."""
TURNS, MOST = 3, 2048
"""Turns that show the view and how long a turn takes; most messages that wait for them, or for the end of a turn."""
SEAM, LATE = 3, 0.75
"""Beams of a full turn that nothing sees for rounding; share of a turn by which messages may be late."""


class SegmentJoiner:
    """Joins segments to turns, topic by topic. A turn takes its place in the topic where the next one begins."""

    def __init__(self, report: ReadReport) -> None:
        self._report = report
        self._topics: dict[str, _SegmentedTopic] = {}

    def take(self, block: RawSweeps) -> Iterable[RawSweeps]:
        """Take a block; return the sweeps and the turns that are complete."""
        if block.topic not in self._topics and len(self._topics) == MAX_TOPICS:
            return (block,)
        return self._topics.setdefault(block.topic, _SegmentedTopic(self._report)).take(block)

    def flush(self) -> Iterator[RawSweeps]:
        """Yield the rest, turns that are not complete included."""
        for topic in self._topics.values():
            yield from topic.take(None)
            yield from _in_order([turns.take(None, turns.place[:0]) for turns in topic.sensors.values() if turns])


def join(blocks: Iterable[RawSweeps], report: ReadReport) -> Iterator[RawSweeps]:
    """Return blocks with segments joined to turns."""
    joiner = SegmentJoiner(report)
    # Not a loop: nothing of this file stands between the log and who pulls.
    return chain(chain.from_iterable(map(joiner.take, blocks)), joiner.flush())


@dataclass(slots=True)
class _SegmentedTopic:
    """Sweeps of one topic, of which some frames may be in segments."""

    report: ReadReport
    sensors: dict[str, _Turns | None] = field(default_factory=dict)
    """Frame → its turns; None where messages are sweeps."""
    waiting: list[RawSweeps] = field(default_factory=list)
    """Blocks that wait until each of their frames is decided."""
    count: int = 0

    def take(self, block: RawSweeps | None) -> Iterator[RawSweeps]:
        """Take a block, None for the end; yield what is complete, which is nothing while a frame is undecided."""
        self.waiting += [] if block is None else [block]
        widest = max((each.ranges.shape[1] for each in self.waiting), default=0)
        if sum(map(len, self.waiting)) * max(widest, BLOCK_VALUES // MOST) <= BLOCK_VALUES:
            self.waiting = [concatenate(self.waiting)] if self.waiting else []
            if self.waiting and not self._is_decided(self.waiting[0], block is None):
                return
        waiting, self.waiting = self.waiting, []
        for each in waiting:
            place = np.arange(self.count, self.count + len(each))
            self.count += len(each)
            frames, found = _by_frame(each), []
            for frame, rows in frames.items():
                # What waits no longer is decided.
                turns, of_frame = self.sensors.setdefault(frame, None), each.rows(rows)
                found.append(turns.take(of_frame, place[rows]) if turns else (place[rows], of_frame))
            yield from _in_order(found) if any(map(self.sensors.get, frames)) else [each]

    def _is_decided(self, block: RawSweeps, final: bool) -> bool:
        """Decide which frames of a block are in segments; return False while one of them needs more messages."""
        for frame, rows in _by_frame(block).items():
            if frame not in self.sensors and len(self.sensors) < MAX_TOPICS:
                turns = _Turns.of(block.rows(rows), final)
                if turns is None:
                    return False
                self.sensors[frame] = turns or None
                if turns:
                    part, whole = np.degrees(abs(turns.step) * np.array([np.median(block.beams), turns.width]))
                    note = f"{block.topic}: segments of {part:.0f} deg are joined to turns of {whole:.0f} deg"
                    note += "; --segments keep leaves them"
                    self.report.add(ReadReport(notes=[Routine(note)], segments={block.topic}))
        return True


def _by_frame(block: RawSweeps) -> dict[str, Bool]:
    """Return the sweeps (S,) of each frame."""
    codes = np.flatnonzero(np.bincount(block.frame)).tolist()
    return {block.frame_ids[code]: block.frame == code for code in codes}


def _in_order(found: list[tuple[Int64, RawSweeps]]) -> Iterator[RawSweeps]:
    """Yield the sweeps of several frames by their places (S,)."""
    if any(len(place) for place, _ in found):
        order = np.argsort(np.concatenate([place for place, _ in found]), kind="stable")
        yield concatenate([block for _, block in found]).rows(order)


@dataclass(slots=True)
class _Turns:
    """The grid of the turns of one sensor, and the segments of the turn that is not complete."""

    step: float
    first: float
    round: int
    rows: RawSweeps
    place: Int64
    """Places of `rows` among the messages of the topic."""
    done: int = 0
    width: int = 0
    period_ns: float = 0.0
    """Time of a turn; 0 where it is not known."""

    @classmethod
    def of(cls, rows: RawSweeps, final: bool) -> _Turns | Literal[False] | None:
        """Return the turns of a sensor by its first messages, False where these are sweeps, None while that is open.

        `final`: there are no more.
        """
        step, begin = rows.angle_increment, rows.angle_min
        usual = float(np.sort(step)[len(step) // 2])
        view = np.abs(step) * rows.beams
        if view[:LOOKED_AT].max() > WIDEST * TURN or (begin[:1] == begin[1:2]).any():
            return False
        with np.errstate(all="ignore"):
            off = (begin[1:] - (begin + step * rows.beams)[:-1] + np.pi) % TURN - np.pi
            on = (np.abs(off) <= NEAR * np.abs(step[1:])) & (rows.beams[1:] > 1)
            on &= np.abs(np.diff(step)) <= ALIKE * np.abs(step[1:])
            turned = float((np.sign(usual) * np.diff(begin) % TURN).sum()) / TURN
        looked = on[: LOOKED_AT - 1]
        if len(looked) < LOOKED_AT - 1 and not final:
            return None
        if np.count_nonzero(looked) < max(FEWEST, OFTEN * len(looked)) or FINEST * abs(usual) < TURN:
            return False
        if turned < TURNS and not final:
            return None
        turns = cls(usual, float(begin[0]), round(TURN / abs(usual)), rows.rows(slice(0)), rows.stamp_ns[:0])
        turns._widen(rows)
        begins = np.flatnonzero(np.diff(turns._columns(rows)[0]) < 0) + 1
        turns.period_ns = float(np.median(np.diff(rows.time_ns[begins]))) if len(begins) > 1 else 0.0
        return turns

    def _columns(self, rows: RawSweeps) -> tuple[Int64, Int64]:
        """Return the first column of each message (K,), and those of all beams (K, B), from the turn of the first on."""
        with np.errstate(all="ignore"):
            begin = (rows.angle_min - self.first) / self.step
            start = _whole((begin + 0.5) % (TURN / abs(self.step)) - 0.5)
            beam = np.arange(rows.ranges.shape[1])
            column = start[:, None] + _whole(beam * (rows.angle_increment / self.step)[:, None])
        # Padding is in none of these turns.
        return start, np.where(beam < rows.beams[:, None], column, -self.round << 40)

    def _widen(self, rows: RawSweeps) -> None:
        """Widen the view to what these messages see."""
        start, column = self._columns(rows)
        covered = np.zeros(self.round, np.bool_)
        covered[: self.width] = True
        covered[column[column >= 0] % self.round] = True
        hit = np.flatnonzero(covered)
        gaps = np.diff(hit, append=hit[0] + self.round)
        widest, toward = int(np.argmax(gaps)), np.sign(self.step)
        begin, self.width = int(hit[(widest + 1) % len(hit)]), self.round - int(gaps[widest]) + 1
        if gaps[widest] <= SEAM + 1:
            begin, self.width = int(start[np.argmin(toward * rows.angle_min)]), self.round
        starts = toward * rows.angle_min[start == begin]
        self.first = float(toward * starts.min()) if len(starts) else self.first + begin * self.step

    def take(self, rows: RawSweeps | None, place: Int64) -> tuple[Int64, RawSweeps]:
        """Take messages (None: no more) and their places (K,); return the places of complete turns (S,), and these."""
        final = rows is None or len(self.rows) > MOST
        rows = self.rows if rows is None else concatenate([self.rows, rows])
        place = np.concatenate([self.place, place])
        if not len(rows):
            return place, rows
        start, column = self._columns(rows)
        if (column % self.round).max(initial=0) >= self.width:
            self._widen(rows)
            start, column = self._columns(rows)
        ahead, later = np.diff(start), np.diff(rows.time_ns.astype(np.float64))
        begins = ((ahead < 0) | ((ahead == 0) & (later != 0))).astype(np.int64)
        if self.period_ns > 0:
            # A turn is lost between these: they share none, whatever else goes on across the seam.
            begins[np.abs(later / self.period_ns - ahead % self.round / self.round) > LATE] = 2
        turn = np.concatenate([[0], np.cumsum(begins)])
        last = int(turn[-1]) + final
        made = np.unique(turn)
        made = made[(made >= self.done) & (made < last)]
        head, after = np.searchsorted(turn, made), np.searchsorted(turn, made, "right")
        found = self._assemble(rows, start, column + turn[:, None] * self.round, made, head, after - 1)
        places = place[head if final else after]
        # What goes on into the turn that is not complete is needed once more.
        ends = np.maximum(turn, turn + column.max(axis=1, initial=0) // self.round)
        begin = len(rows) if final else int(np.argmax(ends >= last))
        self.done = 0 if final else last - int(turn[begin])
        self.rows, self.place = rows.rows(slice(begin, None)), place[begin:]
        return places, found

    def _assemble(self, rows: RawSweeps, start: Int64, column: Int64, made: Int64, first: Int64, last: Int64) -> RawSweeps:
        """Return the turns `made` (S,), of beams in columns (K, B) counted through; they begin and end in messages (S,)."""
        turn, column = column // self.round, column % self.round
        there = (column < self.width) & np.isin(turn, made)
        cells = np.searchsorted(made, turn[there]), column[there]

        def laid(values: Float32) -> Float32:
            grid = np.full((len(made), self.width), np.nan, np.float32)
            grid[cells] = values[there]
            return grid

        head, apart, time_ns = rows.rows(first), start[last] - start[first], rows.time_ns
        increment_ns = 0.0 if head.time_increment is None else head.time_increment.astype(np.float64) * 1e9
        with np.errstate(all="ignore"):
            beam_ns: Float64 = (time_ns[last] - time_ns[first]) / apart
            beam_ns = np.where((apart > 0) & (beam_ns != 0), beam_ns, increment_ns)
            beam_ns[~(np.abs(beam_ns) * self.width <= LONGEST_SWEEP * 1e9)] = 0.0
        range_min, range_max = _limits(rows, head, first, last)
        return replace(
            head,
            range_min=range_min,
            range_max=range_max,
            # The first beam was taken earlier where the first segments are missing.
            stamp_ns=np.where(head.stamp_ns == 0, 0, head.stamp_ns - _whole(start[first] * beam_ns)),
            angle_min=np.full(len(head), self.first),
            angle_increment=np.full(len(head), self.step),
            beams=np.full(len(head), self.width, np.int32),
            ranges=laid(rows.ranges),
            intensities=None if rows.intensities is None else laid(rows.intensities),
            time_increment=(beam_ns * 1e-9).astype(np.float32),
            scan_time=None,
            angle_max=None,
        )


def _limits(rows: RawSweeps, head: RawSweeps, first: Int64, last: Int64) -> tuple[Float32, Float32]:
    """Return the limits (S,) [m] of turns of the messages `first` to `last`: drivers may tell those of each message.

    A message whose limits enclose nothing has seen nothing; a turn of such messages keeps those of its `head`.
    """
    bounds = np.column_stack([first, last + 1]).ravel()
    tells = np.append(rows.range_max > rows.range_min, False)
    least = np.where(tells, np.append(rows.range_min, 0.0), np.inf).astype(np.float32)
    most = np.where(tells, np.append(rows.range_max, 0.0), -np.inf).astype(np.float32)
    if not len(first):
        return head.range_min, head.range_max
    low, high = np.minimum.reduceat(least, bounds)[::2], np.maximum.reduceat(most, bounds)[::2]
    return np.where(low < high, low, head.range_min), np.where(low < high, high, head.range_max)


def _whole(values: Float64) -> Int64:
    """Return the nearest whole numbers, 0 for what is no number."""
    return np.rint(np.nan_to_num(np.clip(values, -(2.0**40), 2.0**40))).astype(np.int64)
