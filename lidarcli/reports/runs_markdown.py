"""A report on runs as Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from lidarcli.reports.markdown import beginning, table, text
from lidarcli.reports.runs import BAD, RunsReport, RunsSummary, left_out, overview, shown
from lidarcli.reports.wording import number
from lidarcli.tabular.runs import OUTCOMES


def render(report: RunsReport) -> str:
    """The verdict and the figures, then what failed or is damaged, and why."""
    summary = report.summary
    names = ("logs", *OUTCOMES)
    words = overview(summary)
    lines = [*beginning(report)]
    lines += table(names, [[number(summary.figures[name]) for name in names]], 0)
    lines += table([*words], [[text(value) for value in words.values()]], None)
    for outcome, title in BAD.items():
        lines += _bad(summary, outcome, title)
    return "\n".join(lines).rstrip() + "\n"


def _bad(summary: RunsSummary, outcome: str, title: str) -> Iterator[str]:
    groups = summary.groups(outcome)
    if not groups:
        return
    yield f"### {title}"
    yield ""
    for group, logs, more in shown(groups):
        yield f"- {text(group.words)}"
        yield from (f"  - {text(log.url)}" for log in logs)
        if more:
            yield f"  - {more}"
    if rest := left_out(groups):
        yield f"- {rest}"
    yield ""
