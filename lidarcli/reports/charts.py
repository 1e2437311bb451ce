"""The charts of the HTML report, drawn by matplotlib as SVG with real text."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.reports import chart_axes
from lidarcli.reports.chart_maps import places
from lidarcli.reports.drawing import project_style
from lidarcli.reports.map_picture import MapPicture, map_figure
from lidarcli.reports.page_colours import themed
from lidarcli.reports.report import Report
from lidarcli.reports.spread import Spread
from lidarcli.reports.summary import Summary
from lidarcli.reports.walls import Walls
from lidarcli.reports.wording import kind_counts, quantity, track_kinds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CHART_SIZE = (4.2, 2.5)
"""[inch] About what a phone shows without scaling."""
WIDE_SIZE = (6.4, 4.2)
OVERVIEW_SIZE = 7.0
"""Longest side of the run from above [inch]."""
SVG_STYLE: dict[str, Any] = {"svg.fonttype": "none", "svg.image_inline": True}
LINES = 6
"""Streams in one chart; more cannot be told apart."""
SAME, ALIKE = 1e-3, 0.25
"""Up to this share of themselves values are the same, or about the same."""
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
"""Figure that may be constant → how it is called then."""


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart and what it is called."""

    title: str
    svg: str
    wide: bool = False
    """Whether it takes the room of two."""


@dataclass(frozen=True, slots=True)
class Constant:
    """What needs no chart."""

    name: str
    """The figure."""
    title: str
    words: str


def charts(report: Report, walls: Mapping[str, Walls] | None = None) -> Iterator[Chart]:
    """All charts for which there is something to draw: what is constant is none, but one of `constants`.

    Parameters
    ----------
    walls : frame → surfaces, to be drawn below the maps
    """
    summary = report.summary
    streams = summary.streams.all[:LINES]
    steady = {one.name for one in constants(report)}
    for name, title, draw in (
        ("objects_per_sweep", "Objects over time", chart_axes.objects),
        ("agents", "Agents over time", chart_axes.agents),
        ("d_th", "Threshold over time", partial(chart_axes.course, name="d_th")),
        ("noise", "Noise over time", partial(chart_axes.course, name="noise")),
    ):
        there = name != "agents" or any(np.nansum(stream.course.agents_max) for stream in streams)
        if streams and there and name not in steady:
            yield _chart(title, partial(draw, streams=streams))
    if sum(summary.status.values()):
        yield _chart("Beams", partial(chart_axes.beams, summary=summary))
    baseline = report.comparison.baseline.histograms if report.comparison else {}
    for name in TITLES:
        one = summary.histograms[name]
        if one.counts.sum() and name not in steady:
            title, label = TITLES[name]
            yield _chart(title, partial(chart_axes.bars, one=one, other=baseline.get(name), label=label))
    for title, counts in _kinds(summary):
        if len(counts) > 1:
            yield _chart(title, partial(chart_axes.kinds, counts=counts))
    for found in summary.densities:
        below = (walls or {}).get(found.frame)
        yield _chart(
            f"Where objects were, {found.frame} frame", partial(places, found=found, walls=below), wide=True
        )


def constants(report: Report) -> list[Constant]:
    """What a chart would show as one flat line or one bar.

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
    """A figure that is the same all the time, or noise that is about the same; None for others."""
    low, high = spread.min, spread.max
    assert low is not None
    assert high is not None
    if high - low <= SAME * abs(high):
        return f"{quantity(name, spread.mean)} always"
    if name == "noise" and (spread.p95 or 0.0) - (spread.p05 or 0.0) <= ALIKE * (spread.p50 or 0.0):
        return f"{quantity(name, spread.p05)} to {quantity(name, spread.p95)} (5 % and 95 % of the sweeps)"
    return None


def _kinds(summary: Summary) -> Iterator[tuple[str, dict[str, int]]]:
    """Parts of a whole by kind: objects, and tracks."""
    for name in ("shape", "visibility", "change"):
        if counts := kind_counts(summary, name):
            yield f"Objects by {name}", counts
    if summary.tracked is not None:
        for name in summary.tracked.kinds:
            if counts := track_kinds(summary.tracked, name):
                yield name.replace(".", " by ").capitalize(), counts


def overview_chart(picture: MapPicture) -> Chart:
    """The run from above."""
    with project_style({**SVG_STYLE, "axes.grid": False}):
        return _as_chart("The run from above", map_figure(picture, OVERVIEW_SIZE), wide=True)


def _chart(title: str, draw: Callable[[Axes], None], wide: bool = False) -> Chart:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with project_style(SVG_STYLE):
        figure = Figure(figsize=WIDE_SIZE if wide else CHART_SIZE, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure.add_subplot())
        return _as_chart(title, figure, wide)


def _as_chart(title: str, figure: Figure, wide: bool) -> Chart:
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Chart(title, _inline(out.getvalue(), title), wide)


def _inline(svg: str, title: str) -> str:
    """The SVG as a part of a page: no prologue, ids of its own, a width that follows the page."""
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
