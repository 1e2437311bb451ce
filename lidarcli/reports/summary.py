"""The figures of a run and of its tracks: everything that a report in any format shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Origin, Rows, Run
from lidarcli.reports.figures import (
    CATEGORIES,
    SPREADS,
    STATISTICS,
    TRACK_CATEGORIES,
    TRACK_SPREADS,
    Density,
    Histogram,
    Spread,
    bearing_edges,
    density,
    histogram,
    nice_edges,
)
from lidarcli.reports.streams import Standing, Streams, Unlike, standing_out, streams_of, unlike_of
from lidarcli.reports.zones import Zoned, zoned_of
from lidarcli.sweeps import STATUSES, Bool, Float64, Int64

STATIC_SHARE = 0.001
"""Greatest share of the beams in set A of a structured scene: errors of the tracking stay below."""
MOBILE_SHARE = 0.25
"""Greatest share of the beams in set A of a semi-structured scene: agents fill a quarter of the view."""
KEPT = 100
"""Most tracks that are kept one by one, for the tables of the report."""
TRACK_COLUMNS = (
    *("topic", "frame_id", "track", "set", "shape", "label", "first_sweep", "first_stamp", "sweeps"),
    *("duration", "hidden", "length", "width", "distance", "speed_mean", "speed_max", "end"),
)
"""Columns of the tracks table that a summary reads."""
_NUMBERS = ("duration", "hidden", "length", "width", "distance", "speed_mean", "speed_max")
_WHOLE = ("track", "first_sweep", "first_stamp", "sweeps")
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


@dataclass(frozen=True, slots=True)
class Track:
    """A track, as a row of a table for people."""

    stream: int | None
    """Its stream of sweeps; None where there is none of its topic."""
    log: str
    topic: str
    number: int
    set: str
    shape: str
    label: str
    first_sweep: int
    start: float
    """Time from the first sweep of its stream to its first sight [s]."""
    duration: float
    sweeps: int
    hidden: float
    length: float
    width: float
    distance: float
    speed_mean: float
    speed_max: float
    end: str

    @property
    def is_agent(self) -> bool:
        """True if the track moves."""
        return self.set == "A"


@dataclass(frozen=True, slots=True)
class Label:
    """A name of the catalogue, and the numbers of its tracks and objects."""

    name: str
    tracks: int | None
    """None where nothing was tracked."""
    objects: int
    """Rows of the objects table."""


@dataclass(frozen=True, slots=True)
class Tracked:
    """The tracks of a run."""

    figures: dict[str, float | None]
    """Every name of `figures.track_names()` → value."""
    spreads: dict[str, Spread]
    kinds: dict[str, dict[str, int]]
    """`tracks.shape`, `tracks.end` → name → tracks; only names that occur."""
    agent_share: float | None
    """Share of the beams of the tracked sweeps in set A; None without beams."""
    tracks: tuple[Track, ...]
    """By stream and number; of more than `KEPT` the agents and those that were seen most."""

    @property
    def scene(self) -> str | None:
        """The paper's name (§2) of such a scene, by the share of A."""
        return None if self.agent_share is None else scene_of(self.agent_share)

    def most(self, count: int) -> tuple[Track, ...]:
        """Return the `count` tracks to look at first, in their order: agents, then what was seen most."""
        best = sorted(self.tracks, key=lambda one: (not one.is_agent, -one.sweeps))[:count]
        return tuple(one for one in self.tracks if one in best)


def scene_of(agent_share: float) -> str:
    """Return the paper's name (§2) of a scene with this share of its beams on agents.

    >>> [scene_of(share) for share in (0.0, 0.03, 0.4)]
    ['structured', 'semi-structured', 'unstructured']
    """
    if agent_share <= STATIC_SHARE:
        return "structured"
    return "semi-structured" if agent_share <= MOBILE_SHARE else "unstructured"


def tracked_of(run: Run, streams: Streams) -> Tracked | None:
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
    figures: dict[str, float | None] = {"tracks": len(rows), "tracks.agents": int(is_agent.sum())}
    for name, spread in spreads.items():
        figures |= {f"{name}.{statistic}": getattr(spread, statistic) for statistic in STATISTICS}
    for name, known in TRACK_CATEGORIES.items():
        figures |= {f"{name}.{kind}": kinds[name].get(kind, 0) for kind in known}
    return Tracked(
        figures=figures,
        spreads=spreads,
        kinds=kinds,
        agent_share=_agent_share(run),
        tracks=_kept(run, rows, is_agent, streams),
    )


def labels_of(run: Run) -> tuple[Label, ...]:
    """Return the names of the catalogue that occur, by name."""
    objects = run.objects.counts("label", run.is_object)
    tracks = {} if run.tracks is None else run.tracks.counts("label")
    return tuple(
        Label(name, None if run.tracks is None else tracks.get(name, 0), objects.get(name, 0))
        for name in sorted({*objects, *tracks})
    )


def _agent_share(run: Run) -> float | None:
    tracked = np.array([source.tracked for source in run.sources], bool)[run.sweeps.source]
    beams = float(run.sweeps.numbers("beams")[tracked].sum())
    return float(run.sweeps.numbers("agent_beams")[tracked].sum()) / beams if beams else None


def _kept(run: Run, rows: Rows, is_agent: Bool, streams: Streams) -> tuple[Track, ...]:
    """Return the tracks that are shown one by one."""
    best = np.lexsort((-rows.numbers("sweeps"), ~is_agent))[:KEPT]
    # The table is in order of topic and track.
    order = np.sort(best)
    words = {name: _texts(rows, name, order) for name in ("topic", "frame_id", "set", "shape", "label", "end")}
    numbers = {name: rows.numbers(name)[order].tolist() for name in _NUMBERS}
    whole = {name: rows.integers(name)[order].tolist() for name in _WHOLE}
    found = []
    for k, source in enumerate(rows.source[order].tolist()):
        stream = _stream_of(streams, source, words["topic"][k], words["frame_id"][k])
        start = whole["first_stamp"][k] if stream is None else streams.all[stream].start_ns
        found.append(
            Track(
                stream=stream,
                log=run.sources[source].log,
                number=whole["track"][k],
                first_sweep=whole["first_sweep"][k],
                sweeps=whole["sweeps"][k],
                start=(whole["first_stamp"][k] - start) * 1e-9,
                topic=words["topic"][k],
                set=words["set"][k],
                shape=words["shape"][k],
                label=words["label"][k],
                end=words["end"][k],
                **{name: numbers[name][k] for name in _NUMBERS},
            )
        )
    return tuple(found)


def _texts(rows: Rows, name: str, order: Int64) -> Sequence[str]:
    """Return a column of names, empty for null."""
    codes, names = rows.words(name)
    return ["" if code < 0 else names[code] for code in codes[order].tolist()]


def _stream_of(streams: Streams, source: int, topic: str, frame: str) -> int | None:
    """Return the stream that a track belongs to."""
    mine = [k for k, one in enumerate(streams.all) if (one.source, one.topic) == (source, topic)]
    exact = [k for k in mine if streams.all[k].frame_id == frame]
    return next(iter([*exact, *mine]), None)


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
    standing: tuple[Standing, ...]
    tracked: Tracked | None
    """None without tracks tables."""
    labels: tuple[Label, ...]
    """Names of the catalogue that occur."""
    zoned: Zoned | None
    """None without tables of zones."""


def values_of(run: Run, streams: Streams) -> dict[str, Float64]:
    """Return the values of every figure that has one per sweep or per object."""
    sweeps = run.sweeps
    beams = sweeps.numbers("beams")
    lost = np.divide(beams - sweeps.numbers("valid"), beams, out=np.full(len(sweeps), np.nan), where=beams > 0)
    values = {"objects_per_sweep": run.objects_per_sweep, "lost_share": lost, "step": streams.step}
    values |= {name: sweeps.numbers(column) for name, column in OF_SWEEPS.items()}
    mine = run.is_object
    all_mine = bool(mine.all())
    for name, column in OF_OBJECTS.items():
        numbers = run.objects.numbers(column) if run.objects.has_any(column) else np.empty(0)
        values[name] = numbers if all_mine or not len(numbers) else numbers[mine]
    return values


def edges_of(*values: Mapping[str, Float64]) -> dict[str, Float64]:
    """Return edges of the histograms that suit all of the runs."""
    edges = {name: nice_edges(np.concatenate([one[name] for one in values])) for name in DRAWN}
    edges["bearing"] = bearing_edges()
    most = max((one["objects_per_sweep"].max(initial=0.0) for one in values), default=0.0)
    stride = max(1, int(np.ceil((most + 1) / 40)))
    edges["objects_per_sweep"] = np.arange(0, most + 1 + stride, stride) - 0.5
    return edges


def summarise(run: Run, edges: Mapping[str, Float64] | None = None) -> Summary:
    """Sum up a run; `edges` of histograms that have to match those of another run."""
    streams = streams_of(run)
    values = values_of(run, streams)
    edges = edges or edges_of(values)
    spreads = {name: Spread.of(values[name]) for name in SPREADS}
    mine = run.is_object
    kinds = {name: run.objects.counts(name, mine) for name in CATEGORIES if name != "change"}
    # What has gone is no object of the sweep, but one of the changes.
    kinds["change"] = run.objects.counts("change")
    status = {name: int(np.nansum(run.sweeps.numbers(name))) for name in STATUSES}
    sets = {letter: int(run.sweeps.numbers(f"{name}_beams").sum()) for name, letter in SET_COLUMNS.items()}
    tracked = tracked_of(run, streams)
    differences = unlike_of(streams.all)
    figures = _figures(run, streams, spreads, kinds, status, sets)
    if tracked is not None:
        figures |= tracked.figures
    zoned = None if run.zones is None else zoned_of(run.zones, [source.log for source in run.sources])
    if zoned is not None:
        figures |= zoned.figures
    return Summary(
        sources=run.sources,
        streams=streams,
        unlike=differences,
        figures=figures,
        spreads=spreads,
        histograms={name: histogram(name, SPREADS[name].unit, values[name], edges[name]) for name in DRAWN},
        kinds=kinds,
        status=status,
        sets=sets,
        densities=_densities(run, alike=not differences),
        standing=standing_out(run, streams),
        tracked=tracked,
        labels=labels_of(run),
        zoned=zoned,
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
        figures |= {f"{name}.{kind}": kinds[name].get(kind, 0) for kind in known}
    return figures


def _densities(run: Run, alike: bool) -> tuple[Density, ...]:
    """Return maps of objects: in the sensor frame if all sensors are `alike`, and in the world frame of a single log."""
    mine = run.is_object
    maps = []
    for frame, x, y in (("sensor", "x", "y"), ("world", "world_x", "world_y")):
        # Every log has a world of its own, and unlike sensors have no place in common.
        pooled = alike if frame == "sensor" else len(run.sources) == 1
        if pooled and run.objects.has_any(x):
            found = density(frame, run.objects.numbers(x)[mine], run.objects.numbers(y)[mine])
            maps += [found] if found is not None else []
    return tuple(maps)
