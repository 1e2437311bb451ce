"""The charts of the HTML report, drawn by matplotlib as SVG with real text."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.ticker import MaxNLocator

from lidarcli import palette
from lidarcli.choices import beams_on
from lidarcli.palette import HEAT, themed
from lidarcli.reports.changes import RunPair
from lidarcli.reports.drawing import new_figure, project_style
from lidarcli.reports.figures import Density, Histogram, Spread
from lidarcli.reports.ground import Walls
from lidarcli.reports.map_picture import WALLS, MapPicture, Sight, changes_figure, draw_walls, map_figure, squares
from lidarcli.reports.picture import printable
from lidarcli.reports.report import Report
from lidarcli.reports.streams import Stream
from lidarcli.reports.summary import Summary
from lidarcli.reports.wording import beams_by_set, has_agents, kind_counts, quantity, track_kinds
from lidarcli.sweeps import Float64, Int64

CHART_SIZE = (4.2, 2.5)
"""Size of a chart [inch]: about the width of a phone."""
WIDE_SIZE = (6.4, 4.2)
ABOUT = (0.1, 0.17, 0.87, 0.79)
"""Left, low, width and height of the axes of a chart, by its size: where they are about, so that their ticks are right."""
EDGE = 0.04
"""Margin of a chart [inch]."""
OVERVIEW_SIZE = 7.0
"""Longest side of the run from above [inch]."""
SVG_STYLE: dict[str, Any] = {"svg.fonttype": "none", "svg.image_inline": True}
LINES = 6
"""Streams in one chart; more cannot be told apart."""
SAME, ALIKE = 1e-3, 0.25
"""Greatest relative difference of values that count as equal, and as about equal."""
TITLES = {
    "objects_per_sweep": ("Objects per sweep", "objects"),
    "range": ("Range of objects", "nearest point [m]"),
    "bearing": ("Bearing of objects", "bearing [deg]"),
    "width": ("Width of objects", "chord [m]"),
}
"""Histogram → title and axis."""
STEADY = {name: title for name, (title, _) in TITLES.items() if name != "bearing"} | {
    "d_th": "Threshold d_th",
    "noise": "Noise σ of the ranges",
}
"""Figure that may be constant → its title then."""
CYCLE = (palette.BLUE, palette.VERMILION, palette.GREEN, palette.PURPLE, palette.ORANGE, palette.BLACK)
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
STATUS_COLOURS = (palette.BLUE, palette.LIGHT, palette.ORANGE, palette.PURPLE, palette.BLACK)
"""Colours of beams by status, in their order."""
MOST_CELLS = 60
"""Most cells along a side of the picture."""
SIDE, LEAST, WIDEST = 3.4, 2.6, 1.5
"""Side of a square map, least width [inch], and the longest sides by the shortest."""
GREYS = (0.15, 1.0, int(palette.COLOURS["pressed"][0][1:3], 16) / 255)
"""Greys of occupied, free and unknown cells of a map; the last one is a colour of the page, and turns dark with it."""
SEAM = 0.06
"""Margin of a cell by its side: cells can be told apart."""


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart and its title."""

    title: str
    svg: str
    wide: bool = False
    """True if the chart is twice as wide."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A figure that needs no chart."""

    name: str
    """Name of the figure."""
    title: str
    words: str


def charts(report: Report, walls: Mapping[str, Walls] | None = None) -> Iterator[Chart]:
    """Yield the charts that have something to show; a figure that is constant is one of `constants` instead.

    Parameters
    ----------
    walls : frame → surfaces, to be drawn below the maps
    """
    summary = report.summary
    streams = summary.streams.all[:LINES]
    steady = {one.name for one in constants(report)}
    for name, title, draw in (
        ("objects_per_sweep", "Objects over time", objects_over_time),
        ("agents", "Agents over time", agents_over_time),
        ("d_th", "Threshold over time", partial(course_over_time, name="d_th")),
        ("noise", "Noise over time", partial(course_over_time, name="noise")),
    ):
        there = name != "agents" or any(np.nansum(stream.course.agents_max) for stream in streams)
        if streams and there and name not in steady:
            yield _chart(title, partial(draw, streams=streams))
    if sum(summary.status.values()):
        yield _chart("Beams", partial(beam_bars, summary=summary))
    baseline = report.comparison.baseline.histograms if report.comparison else {}
    for name in TITLES:
        one = summary.histograms[name]
        if one.counts.sum() and name not in steady:
            title, label = TITLES[name]
            yield _chart(title, partial(histogram_bars, one=one, other=baseline.get(name), label=label))
    for title, counts in _kinds(summary):
        if len(counts) > 1:
            yield _chart(title, partial(kind_bars, counts=counts))
    for found in summary.densities:
        below = (walls or {}).get(found.frame)
        yield _chart(f"Where objects were, {found.frame} frame", partial(object_map, found=found, walls=below), wide=True)


def constants(report: Report) -> list[Constant]:
    """Return the figures that a chart would show as one flat line or one bar.

    A figure of a comparison is never one: the baseline's may be another.
    """
    summary = report.summary
    found = []
    for name, title in STEADY.items():
        spread = summary.spreads[name]
        if report.comparison is None and spread.count > 1:
            words = _steady(name, spread)
            found += [Constant(name, title, words)] if words else []
    for title, counts in _kinds(summary):
        if len(counts) == 1:
            ((kind, count),) = counts.items()
            found.append(Constant(title, title, f"all {count:,} {kind.replace('_', ' ')}"))
    return found


def _steady(name: str, spread: Spread) -> str | None:
    """Return the value of a constant figure, or the range of noise that hardly varies, in words; None for others."""
    low, high = spread.min, spread.max
    assert low is not None
    assert high is not None
    if high - low <= SAME * abs(high):
        return f"{quantity(name, spread.mean)} always"
    if name == "noise" and (spread.p95 or 0.0) - (spread.p05 or 0.0) <= ALIKE * (spread.p50 or 0.0):
        return f"{quantity(name, spread.p05)} to {quantity(name, spread.p95)} (5 % and 95 % of the sweeps)"
    return None


def _kinds(summary: Summary) -> Iterator[tuple[str, dict[str, int]]]:
    """Yield title and counts by kind, of objects and of tracks."""
    for name in ("shape", "visibility", "change"):
        if counts := kind_counts(summary, name):
            yield f"Objects by {name}", counts
    if summary.tracked is not None:
        for name in summary.tracked.kinds:
            if counts := track_kinds(summary.tracked, name):
                yield name.replace(".", " by ").capitalize(), counts


def overview_chart(picture: MapPicture) -> Chart:
    """Return the run from above as a chart."""
    with project_style({**SVG_STYLE, "axes.grid": False}):
        return _as_chart("The run from above", map_figure(picture, OVERVIEW_SIZE, greys=GREYS), wide=True)


def changes_chart(number: int, pair: RunPair) -> Chart:
    """Return the changes of run `number` from above as a chart, without the ground, which tables do not hold."""
    with project_style({**SVG_STYLE, "axes.grid": False}):
        return _as_chart(f"Changes of run {number}", changes_figure([pair], [Sight()]), wide=True)


def _chart(title: str, draw: Callable[[Axes], None], wide: bool = False) -> Chart:
    with project_style(SVG_STYLE):
        figure = new_figure(*(WIDE_SIZE if wide else CHART_SIZE))
        axes = figure.add_subplot()
        draw(axes)
        if wide:
            layout = figure.get_layout_engine()
            assert layout is not None  # all figures here are made with one
            layout.execute(figure)
        else:
            _fill(figure, axes)
        return _as_chart(title, figure, wide)


def _fill(figure: Figure, axes: Axes) -> None:
    """Let axes fill a chart but for the words around them; in a third of the time that a layout of matplotlib takes."""
    figure.set_layout_engine(None)
    axes.set_position(ABOUT)
    inner, outer = axes.get_window_extent(), axes.get_tightbbox()
    assert outer is not None  # they are visible
    (width, height), edge = figure.bbox.size, EDGE * figure.dpi
    left, low = edge + inner.x0 - outer.x0, edge + inner.y0 - outer.y0
    right, high = edge + outer.x1 - inner.x1, edge + outer.y1 - inner.y1
    across, along = width - left - right, height - low - high
    axes.set_position((left / width, low / height, across / width, along / height))


def _as_chart(title: str, figure: Figure, wide: bool) -> Chart:
    """Return a figure that is laid out as a chart."""
    out = io.StringIO()
    figure.set_layout_engine(None)
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Chart(title, _inline(out.getvalue(), title), wide)


def _inline(svg: str, title: str) -> str:
    """Return the SVG as a part of a page: no prologue, ids of its own, a width that follows the page."""
    body = svg[svg.index("<svg") :]
    prefix = "c" + re.sub(r"\W", "", title)
    body = re.sub(r"<metadata>.*?</metadata>", "", body, count=1, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{prefix}-', body)
    body = re.sub(r'(xlink:href="|url\()#', rf"\1#{prefix}-", body)
    body = re.sub(r'(<svg[^>]*?) (width="[^"]*")', r"\1", body, count=1)
    body = re.sub(r'(<svg[^>]*?) (height="[^"]*")', r"\1", body, count=1)
    # A hundredth of a point is finer than any screen.
    body = re.sub(r'\bd="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), body)
    return themed(body).replace("<svg", f'<svg role="img" aria-label="{title}"', 1)


def objects_over_time(axes: Axes, streams: tuple[Stream, ...]) -> None:
    """Draw objects per sweep over time; of a single stream also the least and the most."""
    for k, stream in enumerate(streams):
        course = stream.course
        if len(streams) == 1:
            _band(axes, course.seconds, course.objects_min, course.objects_max, palette.SKY, "least to most")
        _steps(axes, streams, k, course.objects_mean)
    _finish(axes, "objects per sweep")


def agents_over_time(axes: Axes, streams: tuple[Stream, ...]) -> None:
    """Draw agents in view over time; of a single stream also the most."""
    for k, stream in enumerate(streams):
        course, colour = stream.course, None
        if len(streams) == 1:
            zero = np.zeros_like(course.agents_max)
            _band(axes, course.seconds, zero, course.agents_max, palette.ORANGE, "most", 0.35)
            colour = palette.SET_STYLES["A"][0]
        _steps(axes, streams, k, course.agents_mean, colour)
    _finish(axes, "agents in view")


def _band(axes: Axes, x: Float64, low: Float64, high: Float64, colour: str, label: str, alpha: float = 0.4) -> None:
    axes.fill_between(x, low, high, step="post", color=colour, alpha=alpha, lw=0, label=label)


def _steps(axes: Axes, streams: tuple[Stream, ...], k: int, values: Float64, colour: str | None = None) -> None:
    label = "mean" if len(streams) == 1 else printable(streams[k].name)
    style: dict[str, Any] = {"color": colour or CYCLE[k], "ls": DASHES[k], "lw": 1.2, "drawstyle": "steps-post"}
    axes.plot(streams[k].course.seconds, values, label=label, **style)


def _finish(axes: Axes, label: str) -> None:
    axes.set(xlabel="time [s]", ylabel=label, ylim=(0, None))
    _whole(axes.yaxis)
    axes.legend(frameon=False, loc="best", fontsize=6.5)


def course_over_time(axes: Axes, streams: tuple[Stream, ...], name: str) -> None:
    """Draw `d_th` or `noise` over time [m]."""
    for k, stream in enumerate(streams):
        values = stream.course.d_th if name == "d_th" else stream.course.noise
        axes.plot(stream.course.seconds, values, color=CYCLE[k], ls=DASHES[k], lw=1.2, label=printable(stream.name))
    axes.set(xlabel="time [s]", ylabel="[m]", ylim=(0, None))
    if len(streams) > 1:
        axes.legend(frameon=False, loc="best", fontsize=6.5)


def beam_bars(axes: Axes, summary: Summary) -> None:
    """Draw two bars of all beams: by status, and by set."""
    status = {name.replace("_", " "): count for name, count in summary.status.items()}
    sets = beams_by_set(summary)
    colours = [palette.SET_STYLES[name][0] for name in beams_on(has_agents(summary))]
    for place, rows, paints in ((1.0, status, STATUS_COLOURS), (0.0, sets, colours)):
        there = [(name, count, paint) for (name, count), paint in zip(rows.items(), paints, strict=True) if count]
        total, left = sum(rows.values()) or 1, 0.0
        handles: list[Artist] = []
        for _, count, paint in there:
            handles += axes.barh(place, count / total, 0.34, left=left, color=paint)
            left += count / total
        # The words of a bar stand below it.
        words = axes.legend(
            handles,
            [f"{name} {count / total:.1%} ({count:,})" for name, count, _ in there],
            loc="upper left",
            bbox_to_anchor=(0.0, (place + 0.37) / 1.75),
            ncols=2,
            frameon=False,
            fontsize=6.5,
            handlelength=0.9,
            columnspacing=1.0,
            borderaxespad=0.2,
        )
        if place:
            # The next one would take its place.
            axes.add_artist(words)
    axes.set(xlim=(0, 1), ylim=(-0.55, 1.2))
    axes.set_axis_off()


def kind_bars(axes: Axes, counts: dict[str, int]) -> None:
    """Draw a bar for each kind."""
    colours = [palette.SHAPE_COLOURS.get(name, palette.BLUE) for name in counts]
    _horizontal(axes, {name.replace("_", " "): count for name, count in counts.items()}, colours, sum(counts.values()))


def _horizontal(axes: Axes, rows: dict[str, int], colours: list[str], total: int) -> None:
    places = np.arange(len(rows))[::-1]
    values = np.array([*rows.values()], float) / max(total, 1)
    axes.barh(places, np.minimum(values, 1.35), color=colours, height=0.7)
    axes.set_yticks(places, [*rows])
    for place, value, count in zip(places, values, rows.values(), strict=True):
        # Counts that another program has changed may be more than there are.
        axes.text(min(value, 1.0) + 0.01, place, f"{value:.1%}  {count:,}", va="center", fontsize=6.5)
    axes.set_xlim(0, 1.35)
    # A few bars do not fill the chart.
    axes.set_ylim(len(rows) - 0.4 - max(len(rows), 5), len(rows) - 0.4)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    axes.grid(axis="y", visible=False)


def histogram_bars(axes: Axes, one: Histogram, other: Histogram | None, label: str) -> None:
    """Draw a histogram, with that of a baseline over it."""
    factor = 180 / math.pi if one.unit == "rad" else 1.0
    edges = one.edges * factor
    if other is None:
        axes.stairs(one.counts, edges, fill=True, color=palette.BLUE)
    else:
        # Shares, because the runs may differ in length.
        mine, theirs = one.counts / max(one.counts.sum(), 1), other.counts / max(other.counts.sum(), 1)
        axes.stairs(mine, edges, fill=True, color=palette.SKY, label="here")
        axes.stairs(theirs, edges, color=palette.VERMILION, lw=1.4, label="baseline")
        axes.legend(frameon=False, fontsize=6.5)
    ylabel = ("sweeps" if one.name == "objects_per_sweep" else "objects") if other is None else "share"
    axes.set(xlabel=label, ylabel=ylabel, xlim=(edges[0], edges[-1]))
    if one.unit == "rad":
        axes.set_xticks(range(-180, 181, 90))
    if one.name == "objects_per_sweep":
        _whole(axes.xaxis)


def _whole(axis: Any) -> None:
    axis.set_major_locator(MaxNLocator(integer=True, nbins=6))


def object_map(axes: Axes, found: Density, walls: Walls | None) -> None:
    """Draw how often each cell had an object, in a few steps from pale to dark."""
    draw_walls(axes, walls)
    counts, cell = _coarse(found, walls)
    ix, iy = np.nonzero(counts)
    number = counts[ix, iy]
    level = np.ceil(len(HEAT) * np.sqrt(number / number.max(initial=1))).astype(np.int64) - 1
    for step, colour in enumerate(HEAT):
        mine = level == step
        if mine.any():
            corner = np.column_stack([found.x0 + ix[mine] * cell, found.y0 + iy[mine] * cell])
            shape = squares(corner + SEAM * cell, (1 - 2 * SEAM) * cell)
            low, high = int(number[mine].min()), int(number[mine].max())
            label = f"{low:,}" if low == high else f"{low:,} to {high:,}"
            axes.add_patch(PathPatch(shape, facecolor=colour, lw=0, zorder=3, label=label))
    if found.frame == "sensor":
        axes.plot(0, 0, marker=(3, 0, -90), color=palette.VERMILION, ms=6, ls="none", zorder=4)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    nx, ny = counts.shape
    axes.update_datalim([(found.x0, found.y0), (found.x0 + nx * cell, found.y0 + ny * cell)])
    axes.autoscale_view()
    width, height = (high - low for low, high in (axes.get_xlim(), axes.get_ylim()))
    figure = axes.get_figure(root=True)
    assert figure is not None
    across = SIDE * min(max(width / height, 1 / WIDEST), WIDEST)
    handles, labels = axes.get_legend_handles_labels()
    # What the title is about comes first.
    order = sorted(range(len(labels)), key=lambda k: labels[k] == WALLS)
    legend = figure.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        title=f"objects in a cell of {cell:g} m",
        loc="outside lower left",
        ncols=3,
        frameon=False,
        fontsize=7,
        title_fontsize=7,
        alignment="left",
    )
    rows = -(-len(legend.get_texts()) // 3)
    figure.set_size_inches(max(across, LEAST) + 0.6, across * height / width + 0.65 + 0.14 * rows)


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
