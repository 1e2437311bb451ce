"""A report as workflow commands of GitHub Actions: the checks as annotations on the page of a run."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from lidarcli.reports.report import Judged
from lidarcli.reports.wording import visible


def render(report: Judged, text: str = "") -> str:
    """One command a line, what is wrong first: of each kind the page shows the first ten of a step.

    `text`, the report for the terminal, follows in a fold of the step's log.
    """
    return "\n".join([*_annotations(report), *(_folded(report.title, text) if text else ())]) + "\n"


def command(kind: str, title: str, message: str) -> str:
    r"""A workflow command with its title.

    >>> command("error", "checks: a, b", "100 %\nof it")
    '::error title=checks%3A a%2C b::100 %25%0Aof it'
    """
    return f"::{kind} title={_escaped(title).replace(':', '%3A').replace(',', '%2C')}::{_escaped(message)}"


def _escaped(text: str) -> str:
    """Text that ends no line and looks like no escape; what would steer a terminal is spelled out."""
    return visible(text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A"))


def _annotations(report: Judged) -> Iterator[str]:
    for kind, problem in report.told_problems:
        yield command("error", f"lidarcli: {kind}", problem)
    for one in report.verdicts:
        if not one.holds:
            words = f"{one.expression}: expected {one.expected}, found {one.words}"
            yield command("error", "lidarcli: check failed", words)
    for warning in report.warnings:
        yield command("warning", "lidarcli", warning)
    yield command("notice", "lidarcli report", "\n".join(filter(None, (report.judgement, *report.lines))))
    for one in report.verdicts:
        if one.holds:
            yield command("notice", "lidarcli: check passed", f"{one.expression}: found {one.words}")


def _folded(title: str, text: str) -> Iterator[str]:
    """Lines in which nothing is a command until a word comes that they cannot hold: their own digest."""
    word = hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()
    yield f"::group::{_escaped(title)}"
    yield f"::stop-commands::{word}"
    yield text.rstrip("\n")
    yield f"::{word}::"
    yield "::endgroup::"
