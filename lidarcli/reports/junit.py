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
    suite = ET.SubElement(root, "testsuite", {"name": clean(report.title), **counts, "skipped": "0"})
    properties = ET.SubElement(suite, "properties")
    figures = dict(report.summary.figures) | (report.comparison.figures if report.comparison else {})
    for name, value in figures.items():
        if value is not None:
            ET.SubElement(properties, "property", {"name": name, "value": number(value, 6).replace(",", "")})
    for verdict in report.verdicts:
        case = ET.SubElement(suite, "testcase", {"classname": "lidarcli.report", "name": verdict.expression})
        if not verdict.holds:
            message = f"expected {verdict.expected}, found {verdict.words}"
            failure = ET.SubElement(case, "failure", {"message": message, "type": "check"})
            failure.text = f"{verdict.expression}\n{message}"
    for problem in report.problems:
        case = ET.SubElement(suite, "testcase", {"classname": "lidarcli.report", "name": "read the tables"})
        ET.SubElement(case, "error", {"message": clean(problem), "type": "unreadable"})
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def clean(text: str) -> str:
    """Text without the characters that XML cannot hold."""
    return _NOT_XML.sub("�", text)
