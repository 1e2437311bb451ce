"""What the charts of the HTML report hold, each drawn on its axes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.choices import beams_on
from lidarcli.reports import palette
from lidarcli.reports.distributions import Histogram
from lidarcli.reports.picture import printable
from lidarcli.reports.streams import Stream
from lidarcli.reports.summary import Summary
from lidarcli.reports.wording import beams_by_set, has_agents

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

CYCLE = (palette.BLUE, palette.VERMILION, palette.GREEN, palette.PURPLE, palette.ORANGE, palette.BLACK)
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
STATUS_COLOURS = (palette.BLUE, palette.LIGHT, palette.ORANGE, palette.PURPLE)
"""Colours of beams by status, in their order."""


def objects(axes: Axes, streams: tuple[Stream, ...]) -> None:
    """Objects per sweep over time."""
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


def agents(axes: Axes, streams: tuple[Stream, ...]) -> None:
    """Agents in view over time."""
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


def course(axes: Axes, streams: tuple[Stream, ...], name: str) -> None:
    """`d_th` or `noise` over time, in metres."""
    for k, stream in enumerate(streams):
        values = stream.course.d_th if name == "d_th" else stream.course.noise
        axes.plot(
            stream.course.seconds, values, color=CYCLE[k], ls=DASHES[k], lw=1.2, label=printable(stream.name)
        )
    axes.set(xlabel="time [s]", ylabel="[m]", ylim=(0, None))
    if len(streams) > 1:
        axes.legend(frameon=False, loc="best", fontsize=6.5)


def beams(axes: Axes, summary: Summary) -> None:
    """All beams twice, by what became of them and by what they are on: two bars of their own."""
    status = {name.replace("_", " "): count for name, count in summary.status.items()}
    sets = beams_by_set(summary)
    colours = [palette.SET_STYLES[name][0] for name in beams_on(has_agents(summary))]
    for place, rows, paints in ((1.0, status, STATUS_COLOURS), (0.0, sets, colours)):
        there = [
            (name, count, paint) for (name, count), paint in zip(rows.items(), paints, strict=True) if count
        ]
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


def kinds(axes: Axes, counts: dict[str, int]) -> None:
    """Parts of a whole, a bar each."""
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


def bars(axes: Axes, one: Histogram, other: Histogram | None, label: str) -> None:
    """A histogram, with a baseline's over it."""
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
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True, nbins=6))
