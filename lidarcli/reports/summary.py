"""The figures of a run: everything that a report in any format shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Origin, Run
from lidarcli.reports.distributions import Density, Histogram, bearing_edges, density, histogram, nice_edges
from lidarcli.reports.figures import CATEGORIES, SPREADS, STATISTICS, Spread
from lidarcli.reports.streams import Standing, Streams, Unlike, standing_out, streams_of, unlike_of
from lidarcli.reports.tracks import Label, Tracked, labels_of, tracked_of
from lidarcli.sweeps import STATUSES, Float64

SET_COLUMNS = {"object": "O", "agent": "A", "noise": "S"}
DRAWN = ("range", "bearing", "width", "objects_per_sweep")
"""Figures with a histogram."""
OF_OBJECTS = {
    "range": "r_min",
    "bearing": "theta_min",
    "width": "width",
    "box_length": "box_length",
    "box_width": "box_width",
    "beams_per_object": "beams",
    "intensity": "intensity",
    "difference": "difference",
}
"""Figure → column of the objects table."""
OBJECT_COLUMNS = (
    "set",
    "shape",
    "visibility",
    "change",
    "x",
    "y",
    "world_x",
    "world_y",
    "label",
    *OF_OBJECTS.values(),
)
"""Columns of the objects table that a summary reads."""
TRACKED_COLUMNS = ("topic", "sweep", "track")
"""Further columns of the objects table that a summary reads where there are tracks."""
SWEEP_COLUMNS = (
    *("log", "topic", "frame_id", "sweep", "stamp", "beams", *STATUSES),
    *("nearest", "d_mean", "d_th", "noise", "objects", "agents", *(f"{name}_beams" for name in SET_COLUMNS)),
)
"""Columns of the sweeps table that a summary reads."""


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of a run."""

    sources: tuple[Origin, ...]
    streams: Streams
    unlike: Unlike
    """In what the sensors are unlike, whose sweeps the figures pool."""
    figures: dict[str, float | None]
    """Every name of `figures.names()` → value, with tracks tables also those of `figures.track_names()`; None where
    there is nothing to measure."""
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


def values_of(run: Run, streams: Streams) -> dict[str, Float64]:
    """Return the values of every figure that has one per sweep or per object."""
    sweeps = run.sweeps
    beams = sweeps.numbers("beams")
    lost = np.divide(
        beams - sweeps.numbers("valid"), beams, out=np.full(len(sweeps), np.nan), where=beams > 0
    )
    values = {
        "objects_per_sweep": run.objects_per_sweep,
        "agents_per_sweep": sweeps.numbers("agents"),
        "lost_share": lost,
        "step": streams.step,
        "nearest": sweeps.numbers("nearest"),
        "noise": sweeps.numbers("noise"),
        "d_th": sweeps.numbers("d_th"),
        "d_mean": sweeps.numbers("d_mean"),
    }
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
    status = {name: int(run.sweeps.numbers(name).sum()) for name in STATUSES}
    sets = {letter: int(run.sweeps.numbers(f"{name}_beams").sum()) for name, letter in SET_COLUMNS.items()}
    tracked = tracked_of(run, streams)
    differences = unlike_of(streams.all)
    figures = _figures(run, streams, spreads, kinds, status, sets)
    if tracked is not None:
        figures |= tracked.figures
    return Summary(
        sources=run.sources,
        streams=streams,
        unlike=differences,
        figures=figures,
        spreads=spreads,
        histograms={name: histogram(name, SPREADS[name][0], values[name], edges[name]) for name in DRAWN},
        kinds=kinds,
        status=status,
        sets=sets,
        densities=_densities(run, alike=not differences),
        standing=standing_out(run, streams),
        tracked=tracked,
        labels=labels_of(run),
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
