"""A report as JUnit XML: one test case per check, so that a CI server shows them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lidarcli.reports.report import Judged, Report
from lidarcli.reports.wording import number

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True)
class Case:
    """A test case."""

    name: str
    classname: str = "lidarcli.report"
    failure: str | None = None
    """What is wrong, None where nothing is."""
    kind: str = "check"
    """The kind of failure."""
    seconds: float | None = None
    """How long it took, where that is known."""


def render(report: Report) -> str:
    """One suite: its properties are the figures, its cases the checks, its errors the tables that could not be read."""
    figures = dict(report.summary.figures) | (report.comparison.figures if report.comparison else {})
    return document(report, figures)


def document(report: Judged, figures: Mapping[str, float | None], cases: Sequence[Case] = ()) -> str:
    """One suite of these cases, those of the checks, and what could not be read."""
    cases = [*cases, *_checks(report)]
    counts = {
        "tests": str(len(cases) + len(report.problems)),
        "failures": str(sum(case.failure is not None for case in cases)),
        "errors": str(len(report.problems)),
    }
    root = ET.Element("testsuites", {"name": "lidarcli report", **counts})
    suite = _part(root, "testsuite", name=report.title, **counts, skipped="0")
    properties = _part(suite, "properties")
    for name, value in figures.items():
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


def _checks(report: Judged) -> list[Case]:
    return [
        Case(
            verdict.expression,
            failure=None if verdict.holds else f"expected {verdict.expected}, found {verdict.words}",
        )
        for verdict in report.verdicts
    ]


def _part(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """An element below another; the one place where texts of checks and logs come in."""
    return ET.SubElement(parent, tag, {name: clean(text) for name, text in attributes.items()})


def clean(text: str) -> str:
    r"""Text with escapes for the characters that XML cannot hold.

    >>> clean("bad\udcff\x01")
    'bad\\udcff\\x01'
    """
    return _NOT_XML.sub(lambda found: repr(found[0])[1:-1], text)
