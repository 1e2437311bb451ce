"""A report on runs for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from lidarcli.reports.runs import BAD, RunsReport, RunsSummary, left_out, overview, shown
from lidarcli.reports.text import check_parts, printed
from lidarcli.reports.text_parts import grid, heading, share_bar
from lidarcli.reports.wording import visible
from lidarcli.tabular.runs import OUTCOMES

if TYPE_CHECKING:
    from rich.console import RenderableType


def render(report: RunsReport, colour: bool = False) -> str:
    """The report as text; `colour` for a terminal."""
    return printed(_parts(report), colour)


def _parts(report: RunsReport) -> Iterator[RenderableType]:
    summary = report.summary
    yield from check_parts(report)
    yield heading(report.title.capitalize())
    total = len(summary.logs)
    counts = [[name, share_bar(int(summary.figures[name] or 0), total)] for name in OUTCOMES]
    yield grid([*counts, *(list(row) for row in overview(summary).items())])
    for outcome, title in BAD.items():
        yield from _bad(summary, outcome, title)


def _bad(summary: RunsSummary, outcome: str, title: str) -> Iterator[RenderableType]:
    from rich.text import Text

    groups = summary.groups(outcome)
    if groups:
        yield heading(title)
    for group, logs, more in shown(groups):
        yield Text(visible(group.words))
        yield grid([[" ", words] for words in [*(log.url for log in logs), more] if words])
    if rest := left_out(groups):
        yield Text(rest)
