"""Sequences of sweeps: their courses over time, whether their sensors are alike, and the sweeps that stand out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Run
from lidarcli.sweeps import Bool, Float64, Int64

GAP = 1.5
"""Least step that is a gap, by the median step: at least one sweep is missing."""
BINS = 100
"""Most points of a course over time."""
SECOND = 1e-9
ALIKE = 1.2
"""Greatest ratio of rates, and of numbers of beams, of like sensors: no two motors turn equally fast."""
EACH = 3
"""Most sweeps of each kind that stand out."""
APART = 20
"""Sweeps of one log that stand out are at least one part in this many of it apart."""
KINDS = {
    "most_objects": "most objects",
    "fewest_objects": "fewest objects",
    "most_agents": "most agents",
    "most_lost": "most lost beams",
    "longest_gap": "longest gap before",
}


@dataclass(frozen=True, slots=True)
class Timeline:
    """Figures over time: T bins of equal numbers of sweeps, (T,) each."""

    seconds: Float64
    """Start of the bin, from the first stamp [s]."""
    sweep: Int64
    """First sweep of the bin."""
    objects_mean: Float64
    objects_min: Float64
    objects_max: Float64
    d_th: Float64
    """Mean [m]."""
    noise: Float64
    lost_share: Float64
    agents_mean: Float64
    """Different agents in view; NaN without tracks."""
    agents_max: Float64


@dataclass(frozen=True, slots=True)
class Stream:
    """The sweeps of one log, topic and frame, in log order."""

    source: int
    log: str
    topic: str
    frame_id: str
    sweeps: int
    beams: int
    """Median number of beams of a sweep."""
    objects: int
    start_ns: int
    end_ns: int
    rate: float | None
    """[Hz]"""
    gaps: int
    missing: int
    longest_gap: float
    """[s]"""
    backward: int
    repeated: int
    course: Timeline

    @property
    def duration(self) -> float:
        """From the first to the last stamp [s]."""
        return (self.end_ns - self.start_ns) * SECOND

    @property
    def name(self) -> str:
        """Log, topic and frame for people."""
        frame = f" ({self.frame_id})" if self.frame_id else ""
        return f"{self.log} {self.topic}{frame}"


@dataclass(frozen=True, slots=True)
class Streams:
    """All streams, and the stream and the step of each of S sweeps."""

    all: tuple[Stream, ...]
    stream: Int64
    """(S,) stream of each sweep."""
    step: Float64
    """(S,) time since the sweep before of the same stream [s]; NaN for the first."""
    gap: Bool
    """(S,) True where that step is a gap."""


def streams_of(run: Run) -> Streams:
    """Divide the sweeps of a run by log, topic and frame."""
    rows = run.sweeps
    topic, topics = rows.words("topic")
    frame, frames = rows.words("frame_id")
    key = (rows.source.astype(np.int64) * (len(topics) + 1) + topic) * (len(frames) + 1) + frame
    _, stream = np.unique(key, return_inverse=True)
    order = np.argsort(stream, kind="stable")
    bounds = np.flatnonzero(np.diff(stream[order], prepend=-1))
    step = np.full(len(rows), np.nan)
    gap = np.zeros(len(rows), bool)
    columns = _Columns(run)
    found = []
    for mine in np.split(order, bounds[1:]) if len(order) else []:
        first = mine[0]
        names = (topics[topic[first]] if topic[first] >= 0 else "", frames[frame[first]])
        found.append(_stream(run, columns, mine, names, step, gap))
    return Streams(tuple(found), stream.astype(np.int64), step, gap)


class _Columns:
    """The columns that streams need, read once."""

    def __init__(self, run: Run) -> None:
        rows = run.sweeps
        self.stamp = rows.integers("stamp")
        self.sweep = rows.integers("sweep")
        self.beams = rows.numbers("beams")
        self.objects = run.objects_per_sweep
        self.d_th = rows.numbers("d_th")
        self.noise = rows.numbers("noise")
        self.agents = run.agents_at_once
        lost = self.beams - rows.numbers("valid")
        self.lost = np.divide(lost, self.beams, out=np.zeros(len(rows)), where=self.beams > 0)


def _stream(run: Run, columns: _Columns, mine: Int64, names: tuple[str, str], step: Float64, gap: Bool) -> Stream:
    stamp, index = columns.stamp[mine], columns.sweep[mine]
    steps = np.diff(stamp)
    # Where only every n-th sweep was taken, a step of n sweeps is none too many.
    strides = np.maximum(np.diff(index), 1)
    single = steps / strides
    median = float(np.median(single[single > 0])) if (single > 0).any() else 0.0
    is_gap = (single >= GAP * median) & (steps > 0) if median else np.zeros(len(steps), bool)
    step[mine[1:]] = steps * SECOND
    gap[mine[1:]] = is_gap
    missing = np.round(steps[is_gap] / median) - strides[is_gap] if median else np.zeros(0)
    source = int(run.sweeps.source[mine[0]])
    return Stream(
        source=source,
        log=run.sources[source].log,
        topic=names[0],
        frame_id=names[1],
        sweeps=len(mine),
        beams=int(np.median(columns.beams[mine])),
        objects=int(columns.objects[mine].sum()),
        start_ns=int(stamp.min()),
        end_ns=int(stamp.max()),
        rate=1.0 / (median * SECOND) if median else None,
        gaps=int(is_gap.sum()),
        missing=int(missing.sum()),
        longest_gap=float(steps[is_gap].max(initial=0)) * SECOND,
        backward=int((steps < 0).sum()),
        repeated=int((steps == 0).sum()),
        course=_course(columns, mine),
    )


def _course(columns: _Columns, mine: Int64) -> Timeline:
    """Sum up bins of equal numbers of sweeps, so that a clock that jumps makes no hole."""
    begin = np.unique(np.linspace(0, len(mine), min(BINS, len(mine)), endpoint=False).astype(np.int64))
    size = np.diff(np.append(begin, len(mine)))

    def mean(values: Float64) -> Float64:
        there = np.isfinite(values)
        total = np.add.reduceat(np.where(there, values, 0.0), begin)
        count = np.add.reduceat(there.astype(np.int64), begin)
        found: Float64 = np.divide(total, count, out=np.full(len(begin), np.nan), where=count > 0)
        return found

    objects = columns.objects[mine]
    return Timeline(
        seconds=(columns.stamp[mine][begin] - columns.stamp[mine[0]]) * SECOND,
        sweep=columns.sweep[mine][begin],
        objects_mean=np.add.reduceat(objects, begin) / size,
        objects_min=np.minimum.reduceat(objects, begin),
        objects_max=np.maximum.reduceat(objects, begin),
        d_th=mean(columns.d_th[mine]),
        noise=mean(columns.noise[mine]),
        lost_share=mean(columns.lost[mine]),
        agents_mean=mean(columns.agents[mine]),
        agents_max=np.maximum.reduceat(columns.agents[mine], begin),
    )


@dataclass(frozen=True, slots=True)
class Unlike:
    """Properties in which the sensors of a run are unlike; a property that they share is empty."""

    rates: tuple[float, ...] = ()
    """Rate of every stream that has one [Hz]."""
    beams: tuple[float, ...] = ()
    """Median number of beams of every stream."""
    frames: tuple[str, ...] = ()
    """Frames of the sensors: each has its place on a robot, and looks its own way."""

    def __bool__(self) -> bool:
        return bool(self.rates or self.beams or self.frames)


def unlike_of(streams: Sequence[Stream]) -> Unlike:
    """Compare the sensors of these streams."""
    rates = tuple(one.rate for one in streams if one.rate is not None)
    beams = tuple(float(one.beams) for one in streams)
    frames = tuple(dict.fromkeys(one.frame_id for one in streams))
    return Unlike(rates if _differ(rates) else (), beams if _differ(beams) else (), frames if len(frames) > 1 else ())


def _differ(values: Sequence[float]) -> bool:
    """Return True if the greatest is more than `ALIKE` times the least."""
    return bool(values) and max(values) > ALIKE * min(values)


@dataclass(frozen=True, slots=True)
class Standing:
    """One sweep that stands out."""

    kind: str
    """One of `KINDS`."""
    stream: int
    log: str
    topic: str
    sweep: int
    stamp_ns: int
    value: float
    """Number of objects or agents, share of lost beams, or length of a gap [s]."""

    @property
    def words(self) -> str:
        """The value for people."""
        if self.kind == "most_lost":
            return f"{100 * self.value:.1f} %"
        return f"{self.value:.3g} s" if self.kind == "longest_gap" else f"{self.value:,.0f}"


def standing_out(run: Run, streams: Streams) -> tuple[Standing, ...]:
    """Return up to three sweeps of each kind, the most striking first; none where all are alike.

    They are of different logs and topics, each with its earliest; where there is only one, each is of another time.
    """
    rows = run.sweeps
    objects, beams, valid = run.objects_per_sweep, rows.numbers("beams"), rows.numbers("valid")
    lost = np.divide(beams - valid, beams, out=np.zeros(len(rows)), where=beams > 0)
    gap = np.where(streams.gap, streams.step, 0.0)
    agents = np.nan_to_num(run.agents_at_once)
    usual, usual_agents = (float(np.median(counts)) if len(counts) else 0.0 for counts in (objects, agents))
    scores: dict[str, tuple[Float64, Float64]] = {
        "most_objects": (objects, objects - usual),
        "fewest_objects": (objects, usual - objects),
        "most_agents": (agents, agents - usual_agents),
        "most_lost": (lost, lost),
        "longest_gap": (gap, gap),
    }
    sweep, stamp = rows.integers("sweep"), rows.integers("stamp")
    found = []
    for kind, (value, score) in scores.items():
        for row in _best(score, streams):
            stream = streams.all[streams.stream[row]]
            found.append(
                Standing(
                    kind=kind,
                    stream=int(streams.stream[row]),
                    log=stream.log,
                    topic=stream.topic,
                    sweep=int(sweep[row]),
                    stamp_ns=int(stamp[row]),
                    value=float(value[row]),
                )
            )
    return tuple(found)


def _best(score: Float64, streams: Streams) -> list[int]:
    """Return the rows of the greatest scores: one of each stream; of a single stream rows that are apart."""
    left = score.copy()
    found: list[int] = []
    while len(found) < EACH and len(left) and left.max() > 0:
        row = int(left.argmax())
        found.append(row)
        mine = np.flatnonzero(streams.stream == streams.stream[row])
        if len(streams.all) > 1:
            left[mine] = 0.0
        else:
            left[_around(score, row)] = 0.0
    return found


def _around(score: Float64, row: int) -> slice:
    """Return the sweeps near one of a single stream, and those beside it with the same score."""
    other = np.flatnonzero(score != score[row])
    at = int(np.searchsorted(other, row))
    near = max(1, len(score) // APART)
    low = min(int(other[at - 1]) + 1 if at else 0, row - near)
    high = max(int(other[at]) if at < len(other) else len(score), row + near + 1)
    return slice(max(low, 0), high)
