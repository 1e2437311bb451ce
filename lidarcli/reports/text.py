"""A report for the terminal: 80 columns, readable without colour."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lidarcli.reports.bars import resample, shade, spark
from lidarcli.reports.figures import SPREADS
from lidarcli.reports.report import Judged, Report
from lidarcli.reports.streams import KINDS, Stream
from lidarcli.reports.summary import Summary
from lidarcli.reports.text_parts import WIDTH, grid, heading, share_bar
from lidarcli.reports.text_tracks import track_parts
from lidarcli.reports.wording import (
    COMPARED,
    SHOWN_STATISTICS,
    agents,
    beams_by_set,
    clock,
    compared_rows,
    has_agents,
    kind_counts,
    number,
    origin,
    origins,
    percent,
    quantity,
    settings,
    spreads,
    stamp,
    visible,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

SPARK = 54
STREAMS = 12
"""Streams shown; the JSON holds all."""


def render(report: Report, colour: bool = False) -> str:
    """The report as text; `colour` for a terminal."""
    return printed(_parts(report), colour)


def brief(report: Judged, colour: bool = False) -> str:
    """The checks and what the report says in a line, of reports of every kind."""
    from rich.text import Text

    lines = [Text(visible(line)) for line in report.lines]
    return printed([*check_parts(report), *([Text()] if report.verdicts else []), *lines], colour)


def printed(parts: Iterable[RenderableType], colour: bool) -> str:
    """The parts one below the other, in 80 columns."""
    from rich.console import Console

    out = io.StringIO()
    console = Console(
        file=out,
        width=WIDTH,
        force_terminal=colour,
        no_color=not colour,
        color_system="standard" if colour else None,
        highlight=False,
        markup=False,
        emoji=False,
        legacy_windows=False,
    )
    for part in parts:
        console.print(part)
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    return "\n".join(lines).strip("\n") + "\n"


def _parts(report: Report) -> Iterator[RenderableType]:
    summary = report.summary
    yield from check_parts(report)
    yield from _comparison(report)
    yield from _sources(summary)
    yield from _overview(summary)
    yield from _streams(summary)
    yield from _spreads(summary)
    yield from _kinds(summary)
    yield from track_parts(summary)
    yield from _histograms(summary)
    yield from _maps(summary)
    yield from _standing(summary)


def check_parts(report: Judged) -> Iterator[RenderableType]:
    """What could not be read, what to know before the figures are believed, and a line for each check."""
    from rich.text import Text

    for kind, problem in report.told_problems:
        yield Text(visible(f"{kind}: {problem}"), style="red")
    for warning in report.warnings:
        yield Text(visible(f"warning: {warning}"), style="yellow")
    if not report.verdicts:
        return
    yield heading(report.judgement)
    for verdict in report.verdicts:
        mark = "ok  " if verdict.holds else "FAIL"
        line = Text(mark, style="green" if verdict.holds else "bold red")
        line.append(visible(f"  {verdict.expression}  (found {verdict.words})"), style="none")
        yield line


def _sources(summary: Summary) -> Iterator[RenderableType]:
    sources, streams = summary.sources, summary.streams.all
    yield heading("Logs" if len(sources) > 1 else "Log")
    if len(streams) > 1:
        yield from _one_by_one(streams)
    if len(sources) > 1:
        yield grid([["formats", origins(sources)]])
    else:
        yield grid([[source.log, origin(source)] for source in sources])
    for text in dict.fromkeys(settings(source) for source in sources):
        yield grid([["parameters", text]])
    for source in sources:
        for line in source.damage:
            yield grid([["damage", f"{source.log}: {line}"]])


def _one_by_one(streams: Sequence[Stream]) -> Iterator[RenderableType]:
    """A line for each log and topic, whose figures are pooled below."""
    rows = [
        [
            f"{one.log} {one.topic}",
            f"{one.sweeps:,}",
            quantity("duration", one.duration),
            quantity("rate", one.rate),
            number(one.beams),
            number(one.gaps),
            number(one.objects),
        ]
        for one in streams[:STREAMS]
    ]
    head = ["log and topic", "sweeps", "duration", "rate", "beams", "gaps", "objects"]
    yield grid(rows, right=range(1, 7), head=head)
    if len(streams) > STREAMS:
        yield grid([[f"and {len(streams) - STREAMS:,} more, all of them in --format json"]])


def _overview(summary: Summary) -> Iterator[RenderableType]:
    figures = summary.figures
    yield heading("Overview")
    rows = [
        ["sweeps", f"{number(figures['sweeps'])} in {quantity('duration', figures['duration'])}"],
        [
            "objects",
            f"{number(figures['objects'])}, on average {number(figures['objects_per_sweep.mean'], 3)} per sweep",
        ],
        *([["agents", agents(summary)]] if has_agents(summary) else []),
        ["clock", clock(summary)],
    ]
    total = sum(summary.status.values())
    rows.append(["beams", f"{total:,}"])
    rows += [
        [f"  {name.replace('_', ' ')}", share_bar(count, total)] for name, count in summary.status.items()
    ]
    rows += [[f"  {name}", share_bar(count, total)] for name, count in beams_by_set(summary).items()]
    yield grid(rows)


def _streams(summary: Summary) -> Iterator[RenderableType]:
    from rich.text import Text

    streams = summary.streams.all
    yield heading("Over time")
    for stream in streams[:STREAMS]:
        yield Text(visible(f"{stream.name}, {stream.sweeps:,} sweeps from {stamp(stream.start_ns)}"))
        yield from _course(stream)
    if len(streams) > STREAMS:
        yield grid([[f"and {len(streams) - STREAMS:,} more topics"]])


def _course(stream: Stream) -> Iterator[RenderableType]:
    course = stream.course
    for name, values, unit in (
        ("objects", course.objects_mean, ""),
        ("d_th", course.d_th, " m"),
        ("noise", course.noise, " m"),
        ("lost", course.lost_share, ""),
        *([("agents", course.agents_mean, "")] if np.nansum(course.agents_max) else []),
    ):
        top = max((value for value in values.tolist() if math.isfinite(value)), default=None)
        most = percent(top) if name == "lost" and top is not None else f"{number(top, 3)}{unit}"
        line = spark(resample(values, SPARK))
        from rich.text import Text

        yield Text(f"  {name:<8}{line:<{SPARK}}  max {most}", no_wrap=True)


def _spreads(summary: Summary) -> Iterator[RenderableType]:
    rows = [[name, *cells] for name, cells in spreads(summary)]
    if rows:
        yield heading("Figures")
        yield grid(rows, right=range(1, 7), head=["", *SHOWN_STATISTICS])


def _kinds(summary: Summary) -> Iterator[RenderableType]:
    for name in ("shape", "visibility", "change"):
        counts = kind_counts(summary, name)
        if counts:
            yield heading(f"Objects by {name}")
            total = sum(counts.values())
            yield grid([[f"{kind:<11}", share_bar(count, total)] for kind, count in counts.items()])


def _histograms(summary: Summary) -> Iterator[RenderableType]:
    drawn = [one for one in summary.histograms.values() if one.counts.sum()]
    if not drawn:
        return
    from rich.text import Text

    yield heading("Distributions")
    for one in drawn:
        factor, unit = (180 / math.pi, "deg") if one.unit == "rad" else (1.0, one.unit)
        unit = "" if unit == "1" else f" {unit}"
        # The edges of whole numbers lie between them.
        half = 0.5 if one.name == "objects_per_sweep" else 0.0
        low, high = one.edges[0] * factor + half, one.edges[-1] * factor - half
        line = "".join(
            mark if count else "·" for mark, count in zip(spark(one.counts), one.counts, strict=True)
        )
        yield Text(f"  {one.name:<18}{number(low):>6} {line} {number(high)}{unit}", no_wrap=True)


def _maps(summary: Summary) -> Iterator[RenderableType]:
    from rich.text import Text

    for one in summary.densities:
        lines = shade(one, WIDTH - 4, 20)
        nx, ny = one.counts.shape
        span = f"x {number(one.x0)} to {number(one.x0 + nx * one.cell)} m, y {number(one.y0)} to "
        logs = len(summary.sources)
        several = f", {logs:,} logs over each other" if logs > 1 else ""
        yield heading(
            f"Where objects were{several} ({one.frame} frame, {span}{number(one.y0 + ny * one.cell)} m, y up)"
        )
        for line in lines:
            yield Text(f"  {line}", no_wrap=True)


def _standing(summary: Summary) -> Iterator[RenderableType]:
    from rich.text import Text

    if not summary.standing:
        return
    yield heading("Sweeps that stand out")
    several = len(summary.sources) > 1
    rows = [
        [
            KINDS[one.kind],
            one.words,
            str(one.sweep),
            *([one.log] if several else []),
            one.topic,
            stamp(one.stamp_ns),
        ]
        for one in summary.standing
    ]
    head = ["", "value", "sweep", *(["log"] if several else []), "topic", "stamp"]
    yield grid(rows, right=(1, 2), head=head)
    yield Text("To see one: lidarcli plot LOG --topic TOPIC --sweep N -o sweep.png")


def _comparison(report: Report) -> Iterator[RenderableType]:
    from rich.text import Text

    comparison = report.comparison
    if comparison is None:
        return
    here, there, delta = report.summary.figures, comparison.baseline.figures, comparison.figures
    yield heading("Compared with the baseline")
    kinds = [name for name in here if name.split(".")[0] in ("shape", "visibility") and name not in SPREADS]
    rows = [list(row) for row in compared_rows(here, there, delta, [*COMPARED, *kinds])]
    yield grid(rows, right=(1, 2, 3), head=["", "baseline", "here", "difference"])
    for name, mine, other in comparison.parameters:
        yield grid([["parameter", f"{name}: {other} in the baseline, {mine} here"]])
    yield Text(comparison.words)
    if comparison.changes:
        rows = [
            [one.log, one.topic, str(one.sweep), str(one.before), str(one.now), f"{one.difference:+d}"]
            for one in comparison.changes
        ]
        yield heading("Sweeps whose number of objects changed most")
        yield grid(rows, right=(2, 3, 4, 5), head=["log", "topic", "sweep", "before", "now", "change"])
