"""The charts of the HTML report as values that the viewer draws: series over time, histograms, where objects were."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lidarcli.reports.figures import Density, Histogram, Spread, plain
from lidarcli.reports.ground import Walls
from lidarcli.reports.run import RunPart
from lidarcli.reports.summary import Stream, Summary
from lidarcli.reports.wording import quantity
from lidarcli.sweeps import Float64, Int64

LINES = 6
"""Streams in one chart; more cannot be told apart."""
COLOURS = ("blue", "vermilion", "green", "purple", "orange", "ink")
DASHES = ((), (6, 3), (6, 3, 1, 3), (1, 2), (5, 2), (2, 2))
HEAT = 5
"""Steps from pale to dark of a map."""
OVER_TIME = {
    "objects_per_sweep": ("Objects over time", "objects per sweep"),
    "agents_at_once": ("Agents over time", "agents in view"),
    "d_th": ("Threshold over time", "[m]"),
    "noise": ("Noise over time", "[m]"),
}
"""Figure of a series → title and axis."""
TITLES = {
    "objects_per_sweep": ("Objects per sweep", "objects"),
    "range": ("Range of objects", "nearest point [m]"),
    "bearing": ("Bearing of objects", "bearing [deg]"),
    "width": ("Width of objects", "chord [m]"),
}
"""Figure of a histogram → title and axis."""
MOST_CELLS = 60
"""Most cells along a side of a map."""
WIDEST = 1.5
"""Longest side of a map by its shortest."""


class Key(NamedTuple):
    """An entry of the legend of a chart."""

    words: str
    colour: str
    """Name of a colour of the page."""
    form: str = ""
    """Class of its mark: a square, or `stem` for a line."""


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart, and what is said of it for those who do not see it."""

    title: str
    words: str
    keys: Sequence[Key]
    values: dict[str, Any]
    """Values that `charts.js` draws."""
    aspect: float | None = None
    """Width by height of a map."""


def charts(run: RunPart, walls: Mapping[str, Walls]) -> Iterator[Chart]:
    """Yield the charts that have something to show.

    Parameters
    ----------
    walls : frame → surfaces, to be drawn below the maps
    """
    summary = run.summary
    streams = summary.streams.all[:LINES]
    has_agents = any(np.nansum(stream.course.agents_max) for stream in streams)
    for name in OVER_TIME:
        if streams and (name != "agents_at_once" or has_agents):
            yield _over_time(name, summary, streams)
    baseline = run.comparison.baseline.histograms if run.comparison else {}
    for name in TITLES:
        if summary.histograms[name].counts.sum():
            yield _histogram(summary.histograms[name], baseline.get(name), summary.spreads[name])
    for found in summary.densities:
        yield _map(found, walls.get(found.frame))


def _words(title: str, name: str, spread: Spread) -> str:
    least, greatest = (quantity(name, value) for value in (spread.min, spread.max))
    return f"{title}: {quantity(name, spread.mean)} on average, {least} to {greatest}"


def _over_time(name: str, summary: Summary, streams: Sequence[Stream]) -> Chart:
    """Return a series of each stream; of objects and agents of a single stream also the least and the most."""
    title, label = OVER_TIME[name]
    is_count = name in ("objects_per_sweep", "agents_at_once")
    one = streams[0].course
    series, keys = [], []
    colours: Sequence[str] = ("vermilion",) if name == "agents_at_once" and len(streams) == 1 else COLOURS
    if is_count and len(streams) == 1:
        is_agents = name == "agents_at_once"
        low, high = (np.zeros_like(one.seconds), one.agents_max) if is_agents else (one.objects_min, one.objects_max)
        colour = "bar-agents" if is_agents else "bar-objects"
        series.append({"form": "band", "colour": colour, "x": plain(one.seconds), "low": plain(low), "y": plain(high)})
        keys.append(Key("most" if is_agents else "least to most", colour))
    for stream, colour, dash in zip(streams, colours, DASHES, strict=False):
        course = stream.course
        values = {
            "objects_per_sweep": course.objects_mean,
            "agents_at_once": course.agents_mean,
            "d_th": course.d_th,
            "noise": course.noise,
        }[name]
        form = "steps" if is_count else "line"
        series.append({"form": form, "colour": colour, "dash": dash, "x": plain(course.seconds), "y": plain(values)})
        keys.append(Key("mean" if len(streams) == 1 else stream.name, colour, "stem"))
    spread = summary.tracked.spreads[name] if summary.tracked is not None and name == "agents_at_once" else None
    end = max(float(np.max(stream.course.seconds, initial=0.0)) for stream in streams)
    values_of = {"x": "time [s]", "y": label, "span": [0.0, end or 1.0], "whole_y": is_count, "series": series}
    return Chart(title, _words(title, name, spread or summary.spreads[name]), keys, values_of)


def _histogram(one: Histogram, other: Histogram | None, spread: Spread) -> Chart:
    """Return a histogram, with that of a baseline over it."""
    title, label = TITLES[one.name]
    is_turn, is_count = one.unit == "rad", one.name == "objects_per_sweep"
    edges = one.edges * (180 / math.pi if is_turn else 1.0)
    series = [{"form": "bars", "colour": "blue", "x": plain(edges), "y": plain(one.counts)}]
    keys: list[Key] = []
    if other is not None:
        # Shares, because the runs may differ in length.
        mine, others = (counts / max(counts.sum(), 1) for counts in (one.counts, other.counts))
        series = [
            {"form": "bars", "colour": "sky", "x": plain(edges), "y": plain(mine)},
            {"form": "outline", "colour": "vermilion", "x": plain(edges), "y": plain(others)},
        ]
        keys = [Key("here", "sky"), Key("baseline", "vermilion", "stem")]
    counted = ("sweeps" if is_count else "objects") if other is None else "share"
    values: dict[str, Any] = {"x": label, "y": counted, "span": [float(edges[0]), float(edges[-1])], "series": series}
    values |= {"step": 90.0 if is_turn else None, "whole_x": is_count, "whole_y": other is None}
    return Chart(title, _words(title, one.name, spread), keys, values)


def _map(found: Density, walls: Walls | None) -> Chart:
    """Return how often each cell had an object, in a few steps from pale to dark, over the walls."""
    counts, cell = _coarse(found, walls)
    ix, iy = np.nonzero(counts)
    number = counts[ix, iy]
    level = np.ceil(HEAT * np.sqrt(number / number.max(initial=1))).astype(np.int64)
    keys = []
    for step in range(1, HEAT + 1):
        if len(mine := number[level == step]):
            low, high = int(mine.min()), int(mine.max())
            keys.append(Key(f"{low:,}" if low == high else f"{low:,} to {high:,}", f"heat-{step}"))
    keys = [
        key._replace(words=f"{key.words} objects in a cell of {cell:g} m") if not k else key for k, key in enumerate(keys)
    ]
    values: dict[str, Any] = {"x0": found.x0, "y0": found.y0, "cell": cell, "ix": plain(ix), "iy": plain(iy)}
    values |= {"level": plain(level), "sensor": found.frame == "sensor"}
    corners = [np.array([found.x0, found.y0]), np.array([found.x0, found.y0]) + cell * np.array(counts.shape)]
    corners += [np.zeros(2)] if found.frame == "sensor" else []
    if walls is not None and len(walls.x):
        centres = np.column_stack([walls.x, walls.y])
        corners += [centres.min(axis=0) - walls.cell / 2, centres.max(axis=0) + walls.cell / 2]
        values["walls"] = {"cell": walls.cell, "x": _short(walls.x), "y": _short(walls.y)}
        keys.append(Key("walls and rest", "grey"))
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    width, height = (high - low).tolist()
    title = f"Where objects were, {found.frame} frame"
    words = f"{title}: {int(number.sum()):,} objects in {len(number):,} cells, {number.max(initial=0):,} at most in one"
    values["limits"] = [*low.tolist(), *high.tolist()]
    return Chart(title, words, keys, values, min(max(width / height, 1 / WIDEST), WIDEST))


def _short(values: Float64) -> list[float]:
    """Return places to the millimetre."""
    return [float(value) for value in np.round(values, 3)]


def _coarse(found: Density, walls: Walls | None) -> tuple[Int64, float]:
    """Return the counts of cells and their side [m]; cells are joined where far walls would make them too small to see."""
    nx, ny = found.counts.shape
    extent = max(nx, ny) * found.cell
    if walls is not None and len(walls.x):
        extent = max(extent, float(np.ptp(walls.x)), float(np.ptp(walls.y)))
    block = max(1, math.ceil(extent / MOST_CELLS / found.cell - 1e-9))
    along_x = np.add.reduceat(found.counts, np.arange(0, nx, block), axis=0)
    counts: Int64 = np.add.reduceat(along_x, np.arange(0, ny, block), axis=1)
    return counts, block * found.cell
