"""Streams of a run: the sweeps of each log, topic and frame, their clock, and their figures over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidarcli.display.texts import stamp
from lidarcli.reports.columns import Record, Run
from lidarcli.reports.document import Code, ReportTable
from lidarcli.reports.figures import plain_fields
from lidarcli.reports.wording import column, means_of, number, resample, spark
from lidarcli.sweeps.types import Bool, Float64, Int64

SECOND = 1e-9
ALIKE = 1.2
"""Greatest ratio of rates, and of numbers of beams, of like sensors: no two motors turn equally fast."""


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
    course: Record
    """Figures over time, (T,) each, in bins of equal numbers of sweeps: `seconds` from the first stamp and first `sweep` of
    the bin, `objects_mean`, `objects_min` and `objects_max`, means of `d_th`, `noise` [m] and `lost_share`, and different
    agents in view, `agents_mean` and `agents_max`, NaN without tracks."""

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
    rows, columns = run.sweeps, _columns(run)
    topic, topics = rows.words("topic")
    frame, frames = rows.words("frame_id")
    key = (rows.source.astype(np.int64) * (len(topics) + 1) + topic) * (len(frames) + 1) + frame
    _, stream = np.unique(key, return_inverse=True)
    order = np.argsort(stream, kind="stable")
    bounds = np.flatnonzero(np.diff(stream[order], prepend=-1))
    step = np.full(len(rows), np.nan)
    gap = np.zeros(len(rows), bool)
    found = []
    for own in np.split(order, bounds[1:]) if len(order) else []:
        first = own[0]
        names = (topics[topic[first]] if topic[first] >= 0 else "", frames[frame[first]])
        found.append(_stream(run, columns, own, names, step, gap))
    return Streams(tuple(found), stream.astype(np.int64), step, gap)


def _columns(run: Run) -> Record:
    """Return the columns that streams need, read once."""
    # What takes most memory comes first.
    agents = run.agents_at_once
    whole = {name: run.sweeps.integers(name) for name in ("stamp", "sweep")}
    numbers = {name: run.sweeps.numbers(name) for name in ("beams", "d_th", "noise")}
    lost = np.nan_to_num(run.lost_share)
    return Record(**whole, **numbers, objects=run.objects_per_sweep, agents=agents, lost=lost)


def _stream(run: Run, columns: Record, own: Int64, names: tuple[str, str], step: Float64, gap: Bool) -> Stream:
    stamp, index = columns.stamp[own], columns.sweep[own]
    steps = np.diff(stamp)
    # Where only every n-th sweep was taken, a step of n sweeps is none too many.
    strides = np.maximum(np.diff(index), 1)
    single = steps / strides
    median = float(np.median(single[single > 0])) if (single > 0).any() else 0.0
    # At least one sweep is missing.
    is_gap = (single >= 1.5 * median) & (steps > 0) if median else np.zeros(len(steps), bool)
    step[own[1:]] = steps * SECOND
    gap[own[1:]] = is_gap
    missing = np.round(steps[is_gap] / median) - strides[is_gap] if median else np.zeros(0)
    source = int(run.sweeps.source[own[0]])
    return Stream(
        source=source,
        log=run.sources[source].log,
        topic=names[0],
        frame_id=names[1],
        sweeps=len(own),
        beams=int(np.median(columns.beams[own])),
        objects=int(columns.objects[own].sum()),
        start_ns=int(stamp.min()),
        end_ns=int(stamp.max()),
        rate=1.0 / (median * SECOND) if median else None,
        gaps=int(is_gap.sum()),
        missing=int(missing.sum()),
        longest_gap=float(steps[is_gap].max(initial=0)) * SECOND,
        backward=int((steps < 0).sum()),
        repeated=int((steps == 0).sum()),
        course=_course(columns, own),
    )


def _course(columns: Record, own: Int64) -> Record:
    """Sum up bins of equal numbers of sweeps, so that a clock that jumps makes no hole."""
    begin = np.unique(np.linspace(0, len(own), min(100, len(own)), endpoint=False).astype(np.int64))
    size = np.diff(np.append(begin, len(own)))
    objects = columns.objects[own]
    return Record(
        seconds=(columns.stamp[own][begin] - columns.stamp[own[0]]) * SECOND,
        sweep=columns.sweep[own][begin],
        objects_mean=np.add.reduceat(objects, begin) / size,
        objects_min=np.minimum.reduceat(objects, begin),
        objects_max=np.maximum.reduceat(objects, begin),
        d_th=means_of(columns.d_th[own], begin),
        noise=means_of(columns.noise[own], begin),
        lost_share=means_of(columns.lost[own], begin),
        agents_mean=means_of(columns.agents[own], begin),
        agents_max=np.maximum.reduceat(columns.agents[own], begin),
    )


@dataclass(frozen=True, slots=True)
class Unlike:
    """Properties in which the sensors of a run are unlike; a property that they share is empty."""

    rates: tuple[float, ...] = ()
    """Rate of every stream that has one [Hz]."""
    beams: tuple[float, ...] = ()
    """Median number of beams of every stream."""
    frames: tuple[str, ...] = ()
    """Frames of the sensors: each has its own place and direction on a robot."""

    def __bool__(self) -> bool:
        return bool(self.rates or self.beams or self.frames)


def unlike_of(streams: Sequence[Stream]) -> Unlike:
    """Compare the sensors of these streams."""
    rates = tuple(one.rate for one in streams if one.rate is not None)
    beams = tuple(float(one.beams) for one in streams)
    frames = tuple(dict.fromkeys(one.frame_id for one in streams))
    rates, beams = (values if values and max(values) > ALIKE * min(values) else () for values in (rates, beams))
    return Unlike(rates, beams, frames if len(frames) > 1 else ())


STREAM_CELLS: dict[str, Callable[[Stream], str]] = {
    "log and topic": lambda one: f"{one.log} {one.topic}",
    "log, topic (frame)": lambda one: one.name,
    "log": lambda one: one.log,
    "topic": lambda one: one.topic,
    "frame": lambda one: one.frame_id,
    "sweeps": lambda one: f"{one.sweeps:,}",
    "beams": lambda one: number(one.beams),
    "gaps": lambda one: number(one.gaps),
    "backward": lambda one: number(one.backward),
    "objects": lambda one: number(one.objects),
    "objects per sweep": lambda one: Code(spark(resample(one.course.objects_mean, 60))),
}
"""Columns of tables of logs and topics, cell by cell ..."""
STREAM_COLUMNS: dict[str, Callable[[Sequence[Stream]], list[str]]] = {
    "duration": lambda streams: column([one.duration for one in streams], " s"),
    "rate": lambda streams: column([one.rate for one in streams], " Hz"),
    "most": lambda streams: column([most_of(one.course.objects_mean) for one in streams]),
}
"""... and those whose cells have the same number of decimals."""


def stream_table(streams: Sequence[Stream], cells: Sequence[str], right: int, most: int, more: str) -> ReportTable:
    """Return a table of the first `most` streams; columns from `right` on are flush right."""
    shown = streams[:most]
    columns = [
        STREAM_COLUMNS[name](shown) if name in STREAM_COLUMNS else [*map(STREAM_CELLS[name], shown)] for name in cells
    ]
    left = f"and {len(streams) - most:,} {more}" if len(streams) > most else ""
    return ReportTable(cells, [*zip(*columns, strict=True)], range(right, len(cells)), left)


def most_of(values: Float64) -> float | None:
    """Return the greatest of the values that are finite."""
    return max((value for value in values.tolist() if math.isfinite(value)), default=None)


def stream_values(one: Stream) -> dict[str, Any]:
    """Return a stream and its course for JSON."""
    columns = ["sweep", "seconds", "objects_mean", "objects_min", "objects_max", "d_th", "noise", "lost_share"]
    columns += ["agents_mean", "agents_max"] if np.isfinite(one.course.agents_max).any() else []
    return {
        **plain_fields(one, "log", "topic", "frame_id", "sweeps", "beams", "objects"),
        "start": stamp(one.start_ns),
        **plain_fields(one, "start_ns", "end_ns", "duration", "rate", "gaps"),
        "missing_sweeps": one.missing,
        **plain_fields(one, "longest_gap", "backward", "repeated"),
        "course": plain_fields(one.course, *columns),
    }
