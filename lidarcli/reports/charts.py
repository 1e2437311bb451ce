"""The charts of the HTML report, drawn by matplotlib as SVG with real text."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.reports import palette
from lidarcli.reports.distributions import Density, Histogram
from lidarcli.reports.drawing import project_style
from lidarcli.reports.map_picture import MapPicture, map_figure
from lidarcli.reports.picture import printable
from lidarcli.reports.report import Report
from lidarcli.reports.streams import Stream
from lidarcli.reports.summary import Summary
from lidarcli.reports.wording import SET_WORDS, kind_counts, track_kinds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CHART_SIZE = (4.2, 2.5)
"""[inch] About what a phone shows without scaling."""
OVERVIEW_SIZE = 7.0
"""Longest side of the run from above [inch]."""
SVG_STYLE: dict[str, Any] = {"svg.fonttype": "none", "svg.image_inline": True}
LINES = 6
"""Streams in one chart; more cannot be told apart."""
CYCLE = (palette.BLUE, palette.VERMILION, palette.GREEN, palette.PURPLE, palette.ORANGE, palette.BLACK)
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
TITLES = {
    "range": ("Range of objects", "nearest point [m]"),
    "bearing": ("Bearing of objects", "bearing [deg]"),
    "width": ("Width of objects", "chord [m]"),
    "objects_per_sweep": ("Objects per sweep", "objects"),
}


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart and what it is called."""

    title: str
    svg: str


def charts(report: Report) -> Iterator[Chart]:
    """All charts for which there is something to draw."""
    summary = report.summary
    streams = summary.streams.all[:LINES]
    if streams:
        yield _chart("Objects over time", lambda axes: _objects(axes, streams))
        if any(np.nansum(stream.course.agents_max) for stream in streams):
            yield _chart("Agents over time", lambda axes: _agents(axes, streams))
        yield _chart("Threshold and noise over time", lambda axes: _thresholds(axes, streams))
    if sum(summary.status.values()):
        yield _chart("Beams by status and set", lambda axes: _beams(axes, summary))
    baseline = report.comparison.baseline.histograms if report.comparison else {}
    for name in ("objects_per_sweep", "range", "bearing", "width"):
        one = summary.histograms[name]
        if one.counts.sum():
            title, label = TITLES[name]
            other = baseline.get(name)
            yield _chart(title, partial(_bars, one=one, other=other, label=label))
    for name in ("shape", "visibility", "change"):
        counts = kind_counts(summary, name)
        if counts:
            yield _chart(f"Objects by {name}", partial(_kinds, counts=counts))
    if summary.tracked is not None:
        for name in summary.tracked.kinds:
            counts = track_kinds(summary.tracked, name)
            if counts:
                yield _chart(name.replace(".", " by ").capitalize(), partial(_kinds, counts=counts))
    for found in summary.densities:
        yield _chart(f"Where objects were, {found.frame} frame", partial(_map, found=found))


def overview_chart(picture: MapPicture) -> Chart:
    """The run from above."""
    with project_style({**SVG_STYLE, "axes.grid": False}):
        return _as_chart("The run from above", map_figure(picture, OVERVIEW_SIZE))


def _chart(title: str, draw: Callable[[Axes], None]) -> Chart:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with project_style(SVG_STYLE):
        figure = Figure(figsize=CHART_SIZE, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure.add_subplot())
        return _as_chart(title, figure)


def _as_chart(title: str, figure: Figure) -> Chart:
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Chart(title, _inline(out.getvalue(), title))


def _inline(svg: str, title: str) -> str:
    """The SVG as a part of a page: no prologue, ids of its own, a width that follows the page."""
    body = svg[svg.index("<svg") :]
    prefix = "c" + re.sub(r"\W", "", title)
    body = re.sub(r"<metadata>.*?</metadata>", "", body, count=1, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{prefix}-', body)
    body = re.sub(r'(xlink:href="|url\()#', rf"\1#{prefix}-", body)
    body = re.sub(r'(<svg[^>]*?) (width="[^"]*")', r"\1", body, count=1)
    body = re.sub(r'(<svg[^>]*?) (height="[^"]*")', r"\1", body, count=1)
    return body.replace("<svg", f'<svg role="img" aria-label="{title}"', 1)


def _objects(axes: Axes, streams: tuple[Stream, ...]) -> None:
    for k, stream in enumerate(streams):
        course = stream.course
        label = printable(stream.name)
        if len(streams) == 1:
            axes.fill_between(
                course.seconds,
                course.objects_min,
                course.objects_max,
                step="post",
                color=palette.SKY,
                alpha=0.4,
                lw=0,
                label="least to most",
            )
            label = "mean"
        axes.plot(
            course.seconds,
            course.objects_mean,
            color=CYCLE[k],
            ls=DASHES[k],
            lw=1.2,
            drawstyle="steps-post",
            label=label,
        )
    axes.set(xlabel="time [s]", ylabel="objects per sweep", ylim=(0, None))
    _whole(axes.yaxis)
    axes.legend(frameon=False, loc="best", fontsize=6.5)


def _agents(axes: Axes, streams: tuple[Stream, ...]) -> None:
    for k, stream in enumerate(streams):
        course = stream.course
        label = printable(stream.name) if len(streams) > 1 else "mean"
        if len(streams) == 1:
            axes.fill_between(
                course.seconds,
                0,
                course.agents_max,
                step="post",
                color=palette.ORANGE,
                alpha=0.35,
                lw=0,
                label="most",
            )
        colour = palette.SET_STYLES["A"][0] if len(streams) == 1 else CYCLE[k]
        axes.plot(
            course.seconds,
            course.agents_mean,
            color=colour,
            ls=DASHES[k],
            lw=1.2,
            drawstyle="steps-post",
            label=label,
        )
    axes.set(xlabel="time [s]", ylabel="agents in view", ylim=(0, None))
    _whole(axes.yaxis)
    axes.legend(frameon=False, loc="best", fontsize=6.5)


def _thresholds(axes: Axes, streams: tuple[Stream, ...]) -> None:
    for k, stream in enumerate(streams):
        course = stream.course
        # The colours are those of the chart of objects over time.
        first = k == 0
        axes.plot(course.seconds, course.d_th, color=CYCLE[k], lw=1.2, label="$d_{th}$" if first else None)
        axes.plot(
            course.seconds, course.noise, color=CYCLE[k], lw=1.0, ls=":", label="noise σ" if first else None
        )
    axes.set(xlabel="time [s]", ylabel="[m]", ylim=(0, None))
    axes.legend(frameon=False, loc="best", fontsize=6.5)


def _beams(axes: Axes, summary: Summary) -> None:
    total = sum(summary.status.values())
    rows = {
        **{name.replace("_", " "): count for name, count in summary.status.items()},
        **{SET_WORDS[name]: count for name, count in summary.sets.items()},
    }
    colours = [palette.BLUE] * len(summary.status) + [palette.GREEN] * len(summary.sets)
    _horizontal(axes, rows, colours, total)


def _kinds(axes: Axes, counts: dict[str, int]) -> None:
    colours = [palette.SHAPE_COLOURS.get(name, palette.BLUE) for name in counts]
    _horizontal(
        axes, {name.replace("_", " "): count for name, count in counts.items()}, colours, sum(counts.values())
    )


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


def _bars(axes: Axes, one: Histogram, other: Histogram | None, label: str) -> None:
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


def _map(axes: Axes, found: Density) -> None:
    nx, ny = found.counts.shape
    extent = (found.x0, found.x0 + nx * found.cell, found.y0, found.y0 + ny * found.cell)
    shown = np.ma.masked_equal(found.counts.T, 0)
    image = axes.imshow(
        shown, origin="lower", extent=extent, cmap="cividis_r", interpolation="nearest", aspect="equal"
    )
    if found.frame == "sensor":
        axes.plot(0, 0, marker=(3, 0, -90), color=palette.VERMILION, ms=5, ls="none")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.9)
    bar.set_label("objects")


def _whole(axis: Any) -> None:
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True, nbins=6))
