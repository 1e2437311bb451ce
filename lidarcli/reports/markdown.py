"""A report as Markdown, for a comment on a pull request."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from lidarcli.reports.bars import resample, spark
from lidarcli.reports.report import Judged, Report
from lidarcli.reports.streams import KINDS
from lidarcli.reports.summary import Summary
from lidarcli.reports.text import STREAMS
from lidarcli.reports.text_tracks import SHOWN_OF_TRACK, TRACKS
from lidarcli.reports.wording import (
    SHOWN_STATISTICS,
    beams_by_set,
    compared_rows,
    kind_counts,
    number,
    origin,
    quantity,
    rate,
    settings,
    share,
    spreads,
    stamp,
    track_cells,
    track_kinds,
    track_spreads,
    tracked_words,
    visible,
)

SPARK = 60


def render(report: Report) -> str:
    """The verdict and the key figures in sight, the rest folded."""
    summary = report.summary
    lines = [*beginning(report), *_comparison(report), *_overview(summary), *_tracked(summary)]
    lines += _standing(summary)
    for title, part in (
        ("Figures", _spreads(summary)),
        ("Objects and beams by kind", _kinds(summary)),
        ("Tracks", _tracks(summary)),
        ("Over time", _courses(summary)),
        ("Logs and parameters", _sources(summary)),
    ):
        body = [*part]
        if body:
            lines += ["<details>", f"<summary>{title}</summary>", "", *body, "</details>", ""]
    return "\n".join(lines).rstrip() + "\n"


def brief(report: Judged) -> str:
    """The checks and what the report says in a line, of reports of every kind."""
    lines = [*beginning(report), *(f"{text(line)}\n" for line in report.lines)]
    return "\n".join(lines).rstrip() + "\n"


def beginning(report: Judged) -> Iterator[str]:
    """The heading, what could not be read, what to know before the figures are believed, the checks."""
    yield f"## lidarcli report: {text(report.title)}"
    yield ""
    for kind, problem in report.told_problems:
        yield f"**{kind.capitalize()}:** {text(problem)}\n"
    for warning in report.warnings:
        yield f"**Warning:** {text(warning)}\n"
    yield from _checks(report)


def text(value: object) -> str:
    """Text of a log where Markdown and HTML could read commands: they are spelled out.

    >>> text("a|b <script> `x`")
    'a\\\\|b &lt;script&gt; \\\\`x\\\\`'
    """
    plain = visible(" ".join(str(value).split()))
    plain = plain.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    for mark in "\\`*_[]|~#@!":
        plain = plain.replace(mark, "\\" + mark)
    return plain


def code(value: object) -> str:
    """Text as code: in a table a bar has to be escaped even there."""
    plain = visible(" ".join(str(value).split())).replace("`", "'")
    return "`" + plain.replace("|", "\\|") + "`"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], right: int | None = 1) -> list[str]:
    """The lines of a table; columns from `right` on are flush right."""
    marks = ["---:" if right is not None and index >= right else "---" for index in range(len(head))]
    lines = [head, marks, *rows]
    return [*("| " + " | ".join(line) + " |" for line in lines), ""]


def _checks(report: Judged) -> list[str]:
    if not report.verdicts:
        return []
    rows = [
        ["passed" if one.holds else "**failed**", code(one.expression), one.words] for one in report.verdicts
    ]
    return [f"**{report.judgement}.**", "", *table(["", "check", "found"], rows, 2)]


def _overview(summary: Summary) -> list[str]:
    names = ("sweeps", "duration", "rate", "gaps", "objects", "objects_per_sweep.mean", "valid_share")
    words = ("sweeps", "duration", "rate", "gaps", "objects", "objects per sweep", "beams with a range")
    values = [rate(summary) if name == "rate" else quantity(name, summary.figures[name]) for name in names]
    return table(words, [values], 0)


def _comparison(report: Report) -> Iterator[str]:
    comparison = report.comparison
    if comparison is None:
        return
    here, there, delta = report.summary.figures, comparison.baseline.figures, comparison.figures
    yield "### Compared with the baseline"
    yield ""
    yield from table(["figure", "baseline", "here", "difference"], [*compared_rows(here, there, delta)])
    for name, mine, other in comparison.parameters:
        yield f"- {text(name)}: {code(other)} in the baseline, {code(mine)} here"
    yield f"- {comparison.words}"
    yield ""
    if comparison.changes:
        rows = [
            [text(one.log), text(one.topic), str(one.sweep), str(one.before), str(one.now)]
            for one in comparison.changes
        ]
        yield from table(["log", "topic", "sweep", "before", "now"], rows, 2)


def _standing(summary: Summary) -> list[str]:
    if not summary.standing:
        return []
    rows = [
        [KINDS[one.kind], one.words, str(one.sweep), text(one.log), text(one.topic), stamp(one.stamp_ns)]
        for one in summary.standing
    ]
    return [
        "### Sweeps that stand out",
        "",
        *table(["", "value", "sweep", "log", "topic", "stamp"], rows, None),
    ]


def _spreads(summary: Summary) -> list[str]:
    found = [*spreads(summary), *(track_spreads(summary.tracked) if summary.tracked is not None else [])]
    rows = [[code(name), *cells] for name, cells in found]
    return table(["", *SHOWN_STATISTICS], rows) if rows else []


def _kinds(summary: Summary) -> Iterator[str]:
    for name in ("shape", "visibility", "change"):
        counts = kind_counts(summary, name)
        if counts:
            total = sum(counts.values())
            rows = [[kind, f"{count:,}", share(count, total)] for kind, count in counts.items()]
            yield from table([name, "objects", "share"], rows)
    beams = sum(summary.status.values())
    counts = {**summary.status, **beams_by_set(summary)}
    rows = [[name.replace("_", " "), f"{count:,}", share(count, beams)] for name, count in counts.items()]
    yield from table(["beams", "number", "share"], rows)


def _tracked(summary: Summary) -> list[str]:
    """The tracks in a line, and what bears a name of the catalogue."""
    lines: list[str] = []
    if summary.tracked is not None:
        words = tracked_words(summary.tracked)
        lines += table([*words], [[*words.values()]], None)
    if summary.labels:
        rows = [[text(one.name), number(one.tracks), number(one.objects)] for one in summary.labels]
        lines += table(["label", "tracks", "objects"], rows)
    return lines


def _tracks(summary: Summary) -> Iterator[str]:
    tracked = summary.tracked
    if tracked is None:
        return
    for name in tracked.kinds:
        counts = track_kinds(tracked, name)
        if counts:
            total = sum(counts.values())
            rows = [[kind, f"{count:,}", share(count, total)] for kind, count in counts.items()]
            yield from table([name.removeprefix("tracks."), "tracks", "share"], rows)
    shown = [(one, track_cells(one)) for one in tracked.most(TRACKS)]
    if shown:
        rows = [
            [text(one.log), text(one.topic), *(text(cells[name]) for name in SHOWN_OF_TRACK)]
            for one, cells in shown
        ]
        yield from table(["log", "topic", *SHOWN_OF_TRACK], rows, None)
        if more := int(tracked.figures["tracks"] or 0) - len(shown):
            yield f"and {more:,} more tracks"
            yield ""


def _courses(summary: Summary) -> Iterator[str]:
    streams = summary.streams.all
    rows = [
        [
            text(one.name),
            f"{one.sweeps:,}",
            number(one.rate),
            number(one.beams),
            number(one.gaps),
            number(one.backward),
            code(spark(resample(one.course.objects_mean, SPARK))),
            number(max((x for x in one.course.objects_mean.tolist() if math.isfinite(x)), default=None), 3),
        ]
        for one in streams[:STREAMS]
    ]
    if rows:
        yield from table(
            [
                "log and topic",
                "sweeps",
                "rate [Hz]",
                "beams",
                "gaps",
                "backward stamps",
                "objects per sweep",
                "most",
            ],
            rows,
        )
    if len(streams) > STREAMS:
        yield f"and {len(streams) - STREAMS:,} more topics"
        yield ""


def _sources(summary: Summary) -> Iterator[str]:
    rows = [[text(one.log), text(origin(one)), text(settings(one))] for one in summary.sources[:STREAMS]]
    yield from table(["log", "format", "parameters"], rows, None)
    if len(summary.sources) > STREAMS:
        yield f"and {len(summary.sources) - STREAMS:,} more logs"
        yield ""
    for source in summary.sources:
        for line in source.damage:
            yield f"- damage in {text(source.log)}: {text(line)}"
            yield ""
