"""Reports for CI servers: JUnit XML with a test case per check, and workflow commands of GitHub Actions."""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

from lidarcli.display import visible
from lidarcli.reports.document import Case, Document
from lidarcli.reports.wording import number

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(report: Document) -> str:
    """Return one suite: its properties are the figures, its cases those of the report and the checks.

    A table that could not be read is an error.
    """
    cases = [*report.cases, *_checks(report)]
    counts = {
        "tests": str(len(cases) + len(report.problems)),
        "failures": str(sum(case.failure is not None for case in cases)),
        "errors": str(len(report.problems)),
    }
    root = ET.Element("testsuites", {"name": "lidarcli report", **counts})
    suite = _part(root, "testsuite", name=report.title, **counts, skipped="0")
    properties = _part(suite, "properties")
    for name, value in report.figures.items():
        if value is not None:
            _part(properties, "property", name=name, value=number(value, 6).replace(",", ""))
    for one in cases:
        time = {} if one.seconds is None else {"time": f"{one.seconds:.6f}"}
        case = _part(suite, "testcase", classname=one.classname, name=one.name, **time)
        if one.failure is not None:
            failure = _part(case, "failure", message=one.failure, type=one.kind)
            failure.text = clean(f"{one.name}\n{one.failure}")
    for problem in report.problems:
        case = _part(suite, "testcase", classname="lidarcli.report", name="read the tables")
        _part(case, "error", message=problem, type="unreadable")
    if report.warnings:
        _part(suite, "system-out").text = clean("\n".join(f"warning: {line}" for line in report.warnings))
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _checks(report: Document) -> list[Case]:
    return [
        Case(verdict.expression, failure=None if verdict.holds else f"expected {verdict.expected}, found {verdict.words}")
        for verdict in report.verdicts
    ]


def _part(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """Return a new element below another; all texts of checks and logs come in here."""
    return ET.SubElement(parent, tag, {name: clean(text) for name, text in attributes.items()})


def clean(text: str) -> str:
    r"""Return text with escapes for the characters that XML cannot hold.

    >>> clean("bad\udcff\x01")
    'bad\\udcff\\x01'
    """
    return _NOT_XML.sub(lambda found: repr(found[0])[1:-1], text)


def as_github(report: Document, text: str = "") -> str:
    """Return one command per line, errors first: of each kind the page shows the first ten of a step.

    `text`, the report for the terminal, follows in a fold of the step's log.
    """
    return "\n".join([*_annotations(report), *(_folded(report.title, text) if text else ())]) + "\n"


def command(kind: str, title: str, message: str) -> str:
    r"""Return a workflow command with its title.

    >>> command("error", "checks: a, b", "100 %\nof it")
    '::error title=checks%3A a%2C b::100 %25%0Aof it'
    """
    return f"::{kind} title={_escaped(title).replace(':', '%3A').replace(',', '%2C')}::{_escaped(message)}"


def _escaped(text: str) -> str:
    """Return text without ends of lines and escapes; characters that would steer a terminal are spelled out."""
    return visible(text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A"))


def _annotations(report: Document) -> Iterator[str]:
    for kind, problem in report.named_problems:
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
    """Yield a fold in which no line is a command until a word comes that the text cannot hold: its own digest."""
    word = hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()
    yield f"::group::{_escaped(title)}"
    yield f"::stop-commands::{word}"
    yield text.rstrip("\n")
    yield f"::{word}::"
    yield "::endgroup::"
