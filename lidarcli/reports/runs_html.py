"""A report on runs as one HTML file."""

from __future__ import annotations

from collections.abc import Iterator

from lidarcli.reports.html import check_cards, page
from lidarcli.reports.runs import BAD, RunsReport, RunsSummary, left_out, overview, shown
from lidarcli.reports.wording import number, share
from lidarcli.tabular.runs import OUTCOMES

MESSAGES, LOGS = 200, 100
"""Messages of an outcome and logs of a message that a page shows."""


def render(report: RunsReport) -> str:
    """The page. Every text of a log is escaped by the template engine."""
    summary = report.summary
    return page(
        "runs.html",
        report=report,
        cards=[*_cards(summary), *check_cards(report)],
        overview=overview(summary),
        alarming=tuple(BAD),
        versions=summary.versions,
        bad=[(title, [*_rows(summary, outcome)]) for outcome, title in BAD.items()],
    )


def _cards(summary: RunsSummary) -> Iterator[tuple[str, str, str]]:
    figures = summary.figures
    yield "logs", number(figures["logs"]), f"{number(figures['bytes'])} bytes"
    for name in OUTCOMES:
        yield name, number(figures[name]), share(figures[name] or 0, len(summary.logs))


def _rows(summary: RunsSummary, outcome: str) -> Iterator[tuple[str, str, str]]:
    """URL, exit code and message of each log."""
    groups = summary.groups(outcome)
    for group, logs, more in shown(groups, MESSAGES, LOGS):
        for log in logs:
            yield log.url, str(log.exit_code), group.message
        if more:
            yield more, str(group.exit_code), group.message
    if rest := left_out(groups, MESSAGES):
        yield rest, "", ""
