"""A report as JUnit XML: one test case per check, so that a CI server shows them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from lidarcli.reports.report import Report
from lidarcli.reports.wording import number

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def render(report: Report) -> str:
    """One suite: its properties are the figures, its cases the checks, its errors the tables that could not be read."""
    failed = sum(not verdict.holds for verdict in report.verdicts)
    counts = {
        "tests": str(len(report.verdicts) + len(report.problems)),
        "failures": str(failed),
        "errors": str(len(report.problems)),
    }
    root = ET.Element("testsuites", {"name": "lidarcli report", **counts})
    suite = _part(root, "testsuite", name=report.title, **counts, skipped="0")
    properties = _part(suite, "properties")
    figures = dict(report.summary.figures) | (report.comparison.figures if report.comparison else {})
    for name, value in figures.items():
        if value is not None:
            _part(properties, "property", name=name, value=number(value, 6).replace(",", ""))
    for verdict in report.verdicts:
        case = _part(suite, "testcase", classname="lidarcli.report", name=verdict.expression)
        if not verdict.holds:
            message = f"expected {verdict.expected}, found {verdict.words}"
            failure = _part(case, "failure", message=message, type="check")
            failure.text = clean(f"{verdict.expression}\n{message}")
    for problem in report.problems:
        case = _part(suite, "testcase", classname="lidarcli.report", name="read the tables")
        _part(case, "error", message=problem, type="unreadable")
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _part(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """An element below another; the one place where texts of checks and logs come in."""
    return ET.SubElement(parent, tag, {name: clean(text) for name, text in attributes.items()})


def clean(text: str) -> str:
    r"""Text with escapes for the characters that XML cannot hold.

    >>> clean("bad\udcff\x01")
    'bad\\udcff\\x01'
    """
    return _NOT_XML.sub(lambda found: repr(found[0])[1:-1], text)
