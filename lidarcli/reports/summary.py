"""The figures of a run: sequences of sweeps, tracks, maps, sweeps that stand out, and two runs compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.options.choices import beams_on
from lidarcli.options.times import SAME_STAMP, TimeZone
from lidarcli.reports.columns import Origin, Record, Rows, Run, places, same_recording
from lidarcli.reports.figures import (
    CATEGORIES,
    DELTA,
    PERCENT,
    SPREADS,
    STATISTICS,
    TRACK_CATEGORIES,
    TRACK_SPREADS,
    Density,
    Histogram,
    Spread,
    bearing_edges,
    density,
    finite,
    histogram,
    nice_edges,
)
from lidarcli.reports.streams import Streams, Unlike, streams_of, unlike_of
from lidarcli.reports.wording import number, percent, quantity, share, span
from lidarcli.reports.zones import ZonesPart, zones_part
from lidarcli.sweeps.types import STATUSES, Bool, Float64, Int64

KINDS = {
    "most_objects": "most objects",
    "fewest_objects": "fewest objects",
    "most_agents": "most agents",
    "most_lost": "most lost beams",
    "longest_gap": "longest gap before",
}
KEPT = 100
"""Most tracks that are kept one by one, for the tables of the report."""
TRACK_COLUMNS = (
    *("topic", "frame_id", "track", "set", "shape", "label", "first_sweep", "first_stamp", "sweeps"),
    *("duration", "hidden", "length", "width", "distance", "speed_mean", "speed_max", "end", "person"),
)
"""Columns of the tracks table that a summary reads."""
SET_COLUMNS = {"object": "O", "agent": "A", "noise": "S"}
DRAWN = ("range", "bearing", "width", "objects_per_sweep")
"""Figures with a histogram."""
OF_OBJECTS, OF_SWEEPS = (
    {name: figure.column for name, figure in SPREADS.items() if figure.table == table} for table in ("objects", "sweeps")
)
"""Figure → column of the objects table, and of the sweeps table."""
OBJECT_COLUMNS = ("set", "shape", "visibility", "change", "x", "y", "world_x", "world_y", "label", *OF_OBJECTS.values())
"""Columns of the objects table that a summary reads."""
TRACKED_COLUMNS = ("topic", "sweep", "track")
"""Further columns of the objects table that a summary reads where there are tracks."""
SWEEP_COLUMNS = (
    *("log", "topic", "frame_id", "sweep", "stamp", "beams", "observed", *STATUSES),
    *(*OF_SWEEPS.values(), "objects", *(f"{name}_beams" for name in SET_COLUMNS)),
)
"""Columns of the sweeps table that a summary reads."""
SHOWN = 10
CLOUD_BINS = "bins"
"""Parameter of tables made of point clouds: beams of a sweep."""
AS_READ = (CLOUD_BINS, "slice", "csv", "echo", "segments")
"""Parameters on which the ranges of the sweeps of a log depend."""


def outliers_of(run: Run, streams: Streams) -> list[Record]:
    """Return up to three sweeps of each of `KINDS` that stand out, the most striking first; none where all are alike.

    They are of different logs and topics, each with its earliest; where there is only one, each is of another time. Besides
    columns of the sweep they have `kind`, `stream`, `log`, `value` (number of objects or agents, share of lost beams, or
    length of a gap [s]), and `words`, the value for people.
    """
    rows = run.sweeps
    objects, lost = run.objects_per_sweep, np.nan_to_num(run.lost_share)
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
    found = []
    for kind, (value, score) in scores.items():
        at = np.array(_best(score, streams), np.int64)
        stream, values = streams.stream[at].tolist(), value[at].tolist()
        form = {"most_lost": percent, "longest_gap": "{:.3g} s".format}.get(kind, "{:,.0f}".format)
        found += rows.records(
            at,
            ("topic", "sweep", "stamp"),
            kind=[kind] * len(at),
            stream=stream,
            log=[streams.all[k].log for k in stream],
            value=values,
            words=[*map(form, values)],
        )
    return found


def _best(score: Float64, streams: Streams) -> list[int]:
    """Return the rows of the greatest scores: one of each stream; of a single stream rows that are apart."""
    left = score.copy()
    found: list[int] = []
    while len(found) < 3 and len(left) and left.max() > 0:
        row = int(left.argmax())
        found.append(row)
        own = np.flatnonzero(streams.stream == streams.stream[row])
        if len(streams.all) > 1:
            left[own] = 0.0
        else:
            left[_around(score, row)] = 0.0
    return found


def _around(score: Float64, row: int) -> slice:
    """Return the sweeps near one of a single stream, and those next to it with the same score."""
    other = np.flatnonzero(score != score[row])
    at = int(np.searchsorted(other, row))
    near = max(1, len(score) // 20)
    low = min(int(other[at - 1]) + 1 if at else 0, row - near)
    high = max(int(other[at]) if at < len(other) else len(score), row + near + 1)
    return slice(max(low, 0), high)


@dataclass(frozen=True, slots=True)
class TracksSummary:
    """The tracks of a run."""

    figures: dict[str, float | None]
    """Every name of `figures.track_names()` → value."""
    spreads: dict[str, Spread]
    kinds: dict[str, dict[str, int]]
    """`tracks.shape`, `tracks.end` → name → tracks; only names that occur."""
    agent_share: float | None
    """Share of the beams of the tracked sweeps in set A; None without beams."""
    tracks: list[Record]
    """By topic and number; of more than `KEPT` the agents and those that were visible longest.

    Besides its columns each has `log`, `stream`, its sequence of sweeps, None where there is none of its topic, and
    `start`, the time from the first sweep of its stream to its first sight [s].
    """

    @property
    def scene(self) -> str | None:
        """The paper's name (§2) of such a scene, by the share of A."""
        return None if self.agent_share is None else scene_of(self.agent_share)

    def most(self, count: int) -> list[Record]:
        """Return the `count` tracks to look at first, in their order: agents, then those that were visible longest."""
        best = sorted(self.tracks, key=lambda one: (one.set != "A", -one.sweeps))[:count]
        return [one for one in self.tracks if one in best]


def scene_of(agent_share: float) -> str:
    """Return the paper's name (§2) of a scene with this share of its beams on agents.

    Errors of the tracking stay below 0.1 %; in an unstructured scene agents fill more than a quarter of the view.

    >>> [scene_of(share) for share in (0.0, 0.03, 0.4)]
    ['structured', 'semi-structured', 'unstructured']
    """
    if agent_share <= 0.001:
        return "structured"
    return "semi-structured" if agent_share <= 0.25 else "unstructured"


def tracked_of(run: Run, streams: Streams) -> TracksSummary | None:
    """Sum up the tracks; None where no log has a tracks table."""
    rows = run.tracks
    if rows is None:
        return None
    values = {name: rows.numbers(figure.column) for name, figure in TRACK_SPREADS.items() if figure.table}
    values["agents_at_once"] = run.agents_at_once
    spreads = {name: Spread.of(values[name]) for name in TRACK_SPREADS}
    shapes, ends = rows.counts("shape"), rows.counts("end")
    kinds = {"tracks.shape": shapes, "tracks.end": {name.replace(" ", "_"): count for name, count in ends.items()}}
    is_agent = rows.are("set", "A")
    person = np.column_stack([rows.source, rows.words("topic")[0], np.nan_to_num(rows.numbers("person"))])
    people = len(np.unique(person[person[:, 2] > 0], axis=0))
    figures: dict[str, float | None] = {"tracks": len(rows), "tracks.agents": int(is_agent.sum()), "tracks.people": people}
    for name, spread in spreads.items():
        figures |= {f"{name}.{statistic}": getattr(spread, statistic) for statistic in STATISTICS}
    for name, known in TRACK_CATEGORIES.items():
        figures |= {f"{name}.{kind}": kinds[name].get(kind, 0) for kind in known}
    tracked = np.array([source.tracked for source in run.sources], bool)[run.sweeps.source]
    beams, on_agents = (float(run.sweeps.numbers(name)[tracked].sum()) for name in ("beams", "agent_beams"))
    share = on_agents / beams if beams else None
    return TracksSummary(figures, spreads, kinds, share, _kept(run, rows, is_agent, streams))


def labels_of(run: Run) -> list[Record]:
    """Return each `name` of the catalogue that occurs, with numbers of `tracks`, None without any, and `objects`."""
    objects = run.objects.counts("label", run.is_object)
    tracks = {} if run.tracks is None else run.tracks.counts("label")
    return [
        Record(name=name, tracks=None if run.tracks is None else tracks.get(name, 0), objects=objects.get(name, 0))
        for name in sorted({*objects, *tracks})
    ]


def _kept(run: Run, rows: Rows, is_agent: Bool, streams: Streams) -> list[Record]:
    """Return the tracks that are shown one by one, in the order of the table."""
    order = np.sort(np.lexsort((-rows.numbers("sweeps"), ~is_agent))[:KEPT])
    source = rows.source[order].tolist()
    # By log and topic, and of several frames the track's own before others.
    known: dict[tuple[object, ...], int] = {(one.source, one.topic): k for k, one in reversed([*enumerate(streams.all)])}
    known |= {(one.source, one.topic, one.frame_id): k for k, one in enumerate(streams.all)}
    # What several topics saw counts its time from the first of them.
    known |= {(one.source, ""): k for k, one in reversed([*enumerate(streams.all)])}
    of_stream = [
        known.get((log, topic, frame), known.get((log, topic)))
        for log, topic, frame in zip(source, rows.texts("topic", order), rows.texts("frame_id", order), strict=True)
    ]
    first = rows.integers("first_stamp")[order].tolist()
    begin = [stamp if k is None else streams.all[k].start_ns for k, stamp in zip(of_stream, first, strict=True)]
    start = [(stamp - since) * 1e-9 for stamp, since in zip(first, begin, strict=True)]
    return rows.records(
        order, TRACK_COLUMNS, log=[run.sources[k].log for k in source], stream=of_stream, start=start, first_ns=first
    )


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of a run."""

    sources: tuple[Origin, ...]
    streams: Streams
    unlike: Unlike
    """Differences of the sensors whose sweeps the figures pool."""
    figures: dict[str, float | None]
    """Every name of `figures.names()` → value, with tracks tables also those of `figures.track_names()`, with
    those of zones the figures of each zone; None where there is nothing to measure."""
    spreads: dict[str, Spread]
    histograms: dict[str, Histogram]
    kinds: dict[str, dict[str, int]]
    """`shape`, `visibility`, `change` → name → objects; only names that occur."""
    status: dict[str, int]
    """Beams by status."""
    sets: dict[str, int]
    """Beams by set (Def. 4)."""
    densities: tuple[Density, ...]
    outliers: list[Record]
    tracked: TracksSummary | None
    """None without tracks tables."""
    labels: list[Record]
    """Names of the catalogue that occur."""
    zones: ZonesPart | None
    """None without tables of zones."""
    time_zone: TimeZone


def values_of(run: Run, streams: Streams, name: str) -> Float64:
    """Return the values of a figure that has one per sweep or per object."""
    of_sweeps = {"objects_per_sweep": run.objects_per_sweep, "lost_share": run.lost_share, "step": streams.step}
    if name in of_sweeps:
        return of_sweeps[name]
    if name in OF_SWEEPS:
        return run.sweeps.numbers(OF_SWEEPS[name])
    own, column = run.is_object, OF_OBJECTS[name]
    numbers = run.objects.numbers(column) if run.objects.has_any(column) else np.empty(0)
    return numbers if own.all() or not len(numbers) else numbers[own]


def edges_of(*runs: tuple[Run, Streams]) -> dict[str, Float64]:
    """Return edges of the histograms that suit all of the runs."""
    edges = {"bearing": bearing_edges()}
    for name in DRAWN:
        if name != "bearing":
            values = [values_of(*one, name) for one in runs]
            edges[name] = nice_edges(np.concatenate(values) if len(values) > 1 else values[0])
    most = max((one.objects_per_sweep.max(initial=0.0) for one, _ in runs), default=0.0)
    stride = max(1, int(np.ceil((most + 1) / 40)))
    edges["objects_per_sweep"] = np.arange(0, most + 1 + stride, stride) - 0.5
    return edges


def summarise(run: Run, edges: Mapping[str, Float64] | None = None) -> Summary:
    """Sum up a run; `edges` of histograms that have to match those of another run."""
    streams = streams_of(run)
    edges = edges or edges_of((run, streams))
    spreads, histograms = dict[str, Spread](), dict[str, Histogram]()
    for name, figure in SPREADS.items():
        values = finite(values_of(run, streams, name))
        spreads[name] = Spread.of(values)
        if name in DRAWN:
            histograms[name] = histogram(name, figure.unit, values, edges[name])
    own = run.is_object
    kinds = {name: run.objects.counts(name, own) for name in CATEGORIES if name != "change"}
    # What has gone is no object of the sweep, but one of the changes.
    kinds["change"] = run.objects.counts("change")
    status = {name: int(np.nansum(run.sweeps.numbers(name))) for name in STATUSES}
    sets = {letter: int(run.sweeps.numbers(f"{name}_beams").sum()) for name, letter in SET_COLUMNS.items()}
    tracked = tracked_of(run, streams)
    differences = unlike_of(streams.all)
    figures = _figures(run, streams, spreads, kinds, status, sets)
    if tracked is not None:
        figures |= tracked.figures
    zones = None if run.zones is None else zones_part(run.zones, run.sources, run.time_zone)
    if zones is not None:
        figures |= zones.figures
    return Summary(
        sources=run.sources,
        streams=streams,
        unlike=differences,
        figures=figures,
        spreads=spreads,
        histograms={name: histograms[name] for name in DRAWN},
        kinds=kinds,
        status=status,
        sets=sets,
        densities=_densities(run, alike=not differences),
        outliers=outliers_of(run, streams),
        tracked=tracked,
        labels=labels_of(run),
        zones=zones,
        time_zone=run.time_zone,
    )


def _figures(
    run: Run,
    streams: Streams,
    spreads: Mapping[str, Spread],
    kinds: Mapping[str, Mapping[str, int]],
    status: Mapping[str, int],
    sets: Mapping[str, int],
) -> dict[str, float | None]:
    beams = sum(status.values())

    def share(count: int) -> float | None:
        return count / beams if beams else None

    durations: dict[int, float] = {}
    for stream in streams.all:
        durations[stream.source] = max(durations.get(stream.source, 0.0), stream.duration)
    rates = [stream.rate for stream in streams.all if stream.rate is not None]
    figures: dict[str, float | None] = {
        "logs": len(run.sources),
        "topics": len(streams.all),
        "sweeps": len(run.sweeps),
        "objects": int(run.objects_per_sweep.sum()),
        "agents": int(run.sweeps.numbers("agents").sum()),
        "beams": beams,
        **{f"{name}_share": share(status[name]) for name in STATUSES},
        "object_share": share(sets["O"] + sets["A"]),
        "agent_share": share(sets["A"]),
        "noise_share": share(sets["S"]),
        "duration": sum(durations.values()),
        "rate": float(np.median(rates)) if rates else None,
        "gaps": sum(stream.gaps for stream in streams.all),
        "missing_sweeps": sum(stream.missing for stream in streams.all),
        "longest_gap": max((stream.longest_gap for stream in streams.all), default=0.0),
        "backward": sum(stream.backward for stream in streams.all),
        "repeated": sum(stream.repeated for stream in streams.all),
        "damage": sum(len(source.damage) for source in run.sources),
        "observed": min((one.share for one in run.observed_in()), default=0.0),
    }
    for name, spread in spreads.items():
        figures |= {f"{name}.{statistic}": getattr(spread, statistic) for statistic in STATISTICS}
    for name, known in CATEGORIES.items():
        figures |= {f"{name}.{kind}": kinds[name].get(kind, 0) if run.knows(run.objects, name) else None for kind in known}
    return figures


def _densities(run: Run, alike: bool) -> tuple[Density, ...]:
    """Return maps of objects: in the sensor frame if all sensors are `alike`, and in the world frame of a single log."""
    own = run.is_object
    maps = []
    for frame, x, y in (("sensor", "x", "y"), ("world", "world_x", "world_y")):
        # Every log has a world of its own, and unlike sensors have no place in common.
        pooled = alike if frame == "sensor" else len(run.sources) == 1
        if pooled and run.objects.has_any(x):
            found = density(frame, partial(_numbers, run.objects, (x, y), own))
            maps += [found] if found is not None else []
    return tuple(maps)


def _numbers(rows: Rows, names: Sequence[str], own: Bool, which: int) -> Float64:
    """Return one of some columns (K,), NaN in rows that are not `own`."""
    numbers = rows.numbers(names[which])
    numbers[~own] = np.nan
    return numbers


@dataclass(frozen=True, slots=True)
class Comparison:
    """A run and its baseline."""

    baseline: Summary
    is_same: bool
    """True where both are of one recording: of two, sweeps have nothing to do with each other."""
    figures: dict[str, float | None]
    """`delta.NAME` and `percent.NAME` of every figure, and the names of `figures.COMPARED`, None of two recordings."""
    parameters: tuple[tuple[str, str, str], ...]
    """(name, here, in the baseline) of the parameters that differ."""
    changes: list[Record]
    """Sweeps with another number of objects, `now` and `before`, the greatest difference first, at most `SHOWN`."""

    @property
    def words(self) -> str:
        """Number of sweeps in which the two runs differ, in words."""
        if not self.is_same:
            return "Two recordings: their figures are compared, and no sweeps; lidarcli diff tells what was moved"
        compared, changed, added, removed = (
            self.figures[name] for name in ("compared_sweeps", "changed_sweeps", "added_sweeps", "removed_sweeps")
        )
        return (
            f"Sweeps in both runs: {number(compared)}, {number(changed)} of them ({share(changed or 0, compared or 0)}) "
            "with another number of objects; "
            f"only here: {number(added)}; only in the baseline: {number(removed)}"
        )


def compare(run: Run, summary: Summary, base_run: Run, baseline: Summary) -> Comparison:
    """Compare two runs, sweep by sweep those of one recording.

    Sweeps are matched by log, topic and index; of one log each, the names of the logs may differ.
    """
    rows, base_rows = _identities(run, base_run)
    here, there = run.objects_per_sweep, base_run.objects_per_sweep
    _, own, theirs = np.intersect1d(rows, base_rows, return_indices=True)
    is_same = _are_same(run, base_run, own, theirs)
    difference = here[own] - there[theirs]
    changed = np.flatnonzero(difference)
    figures: dict[str, float | None] = {
        "compared_sweeps": len(own),
        "changed_sweeps": len(changed),
        "added_sweeps": len(run.sweeps) - len(own),
        "removed_sweeps": len(base_run.sweeps) - len(own),
    }
    if not is_same:
        figures, changed = dict.fromkeys(figures), changed[:0]
    for name, value in summary.figures.items():
        other = baseline.figures.get(name)
        change = figures[DELTA + name] = None if value is None or other is None else value - other
        figures[PERCENT + name] = 100.0 * change / abs(other) if change and other else 0.0 if change == 0 else None
    best = changed[np.argsort(-np.abs(difference[changed]), kind="stable")[:SHOWN]]
    first = own[best]
    changes = run.sweeps.records(
        first,
        ("topic", "sweep"),
        log=[run.sources[source].log for source in run.sweeps.source[first]],
        before=there[theirs[best]].astype(np.int64).tolist(),
        now=here[first].astype(np.int64).tolist(),
    )
    parameters, before = _settings(run.sources), _settings(base_run.sources)
    differing = sorted(name for name in {*parameters, *before} if parameters.get(name) != before.get(name))
    rows_of_them = tuple((name, parameters.get(name, "-"), before.get(name, "-")) for name in differing)
    return Comparison(baseline, is_same, figures, rows_of_them, changes)


def _are_same(run: Run, base_run: Run, own: Int64, theirs: Int64) -> bool:
    """Return whether two runs are of one recording, whose sweeps have the same stamps, beams, and ranges by their checksum.

    Raises
    ------
    OptionError
        They are of the same clouds, read as sweeps with other numbers of beams.
    """
    if not len(run.sweeps) or not len(base_run.sweeps):
        return True
    of_stamps, of_beams = (
        (run.sweeps.integers(name)[own], base_run.sweeps.integers(name)[theirs]) for name in ("stamp", "beams")
    )
    later = np.abs(of_stamps[0] - of_stamps[1]) > SAME_STAMP
    unlike = later | (of_beams[0] != of_beams[1])
    source, other = run.sweeps.source[own], base_run.sweeps.source[theirs]
    is_same = len(own) > 0
    for at in np.unique(source).tolist():
        of_it = np.flatnonzero(source == at)
        log, its = run.sources[at], base_run.sources[int(other[of_it[0]])]
        differs = [name for name in AS_READ if log.parameters.get(name) != its.parameters.get(name)]
        if 2 * np.count_nonzero(unlike[of_it]) > len(of_it):
            first = of_it[unlike[of_it]][0]
            if not later[of_it].any() and CLOUD_BINS in differs:
                raise OptionError(
                    f"--baseline: the clouds of {log.log} were read with other numbers of beams (--bins): "
                    f"{of_beams[0][first]:,} here, {of_beams[1][first]:,} in the baseline; read both alike"
                )
            is_same = False
        # Of one log that is read otherwise the ranges are others.
        is_same &= bool(differs) or same_recording(log.recording, its.recording) is not False
    return is_same


def _identities(run: Run, base_run: Run) -> list[Int64]:
    """Return (S,) a number for each sweep of both runs, equal where log, topic and index are."""
    single = len(run.sources) == len(base_run.sources) == 1
    logs: dict[str, int] = {}
    sides = []
    for one in (run, base_run):
        number = np.array([0 if single else logs.setdefault(source.log, len(logs)) for source in one.sources], np.int32)
        sides.append(replace(one.sweeps, source=number[one.sweeps.source]))
    return places(*sides)


def _settings(sources: Sequence[Origin]) -> dict[str, str]:
    """Return the version and the parameters of runs in words."""
    values: dict[str, set[str]] = {}
    for source in sources:
        for name, value in {"lidarcli": source.version, **source.parameters}.items():
            values.setdefault(name, set()).add(str(value))
    return {name: " | ".join(sorted(found)) for name, found in values.items()}


def rate(summary: Summary) -> str:
    """Return the rate of sweeps; from the least to the greatest where sensors are unlike."""
    if summary.unlike.rates:
        return f"{span(summary.unlike.rates)} Hz"
    return quantity("rate", summary.figures["rate"])


def differences(unlike: Unlike) -> str:
    """Return the differences of sensors in words; empty where they are alike."""
    parts = [f"{span(unlike.rates)} Hz"] if unlike.rates else []
    parts += [f"{span(unlike.beams)} beams"] if unlike.beams else []
    if unlike.frames:
        more = f" and {len(unlike.frames) - 3:,} more" if len(unlike.frames) > 3 else ""
        named = ", ".join(name or "(no name)" for name in unlike.frames[:3])
        parts.append(f"frames {named}{more}")
    return "; ".join(parts)


def has_agents(summary: Summary) -> bool:
    """Return True if there were tracks, or the tables have agents."""
    return summary.tracked is not None or bool(summary.figures["agents"])


def beams_by_set(summary: Summary) -> dict[str, int]:
    """Return the beams by set; without agents where they were not looked for."""
    return {
        words if name == "S" else f"on {words}": summary.sets[name] for name, words in beams_on(has_agents(summary)).items()
    }
