"""Reports for programs: JSON by the schema of docs/reports.md, JUnit XML, and workflow commands of GitHub Actions."""

from __future__ import annotations

import hashlib
import json
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from lidarcli._version import __version__
from lidarcli.display.texts import visible
from lidarcli.reports.checks import CheckVerdict
from lidarcli.reports.figures import plain_fields, plain_numbers
from lidarcli.reports.report import Report
from lidarcli.reports.wording import number

TYPES = {"failure": {"type": "check"}, "error": {"type": "unreadable"}}
"""What JUnit calls a case that does not pass → its type."""
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_json(report: Report) -> str:
    """Return one JSON object; numbers have nine digits, null stands for what cannot be measured."""
    return json.dumps(as_dict(report), ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def as_dict(report: Report) -> dict[str, Any]:
    """Return the report as plain values."""
    first = report.parts[0]
    found: dict[str, Any] = {
        "schema": first.schema,
        "lidarcli": __version__,
        "holds": report.holds,
        "checks": [verdict.as_dict() for verdict in report.verdicts],
        "problems": list(report.problems),
        "warnings": list(report.warnings),
        "sources": [
            {
                "log": source.log,
                "format": source.format,
                "size": source.size,
                "lidarcli": source.version,
                "parameters": source.parameters,
                "damage": list(source.damage),
            }
            for source in first.sources
        ],
        "figures": {name: value for part in report.parts for name, value in plain_numbers(part.figures).items()},
    }
    runs = [{**plain_fields(one, "log", "start_ns"), "figures": plain_numbers(one.figures)} for one in report.runs]
    found |= {"runs": runs} if runs else {}
    for part in reversed(report.parts):
        found |= {**(part.opening.values if part is first else {}), **part.as_dict()}
    return found


def as_junit(
    command: str,
    title: str,
    verdicts: Sequence[CheckVerdict],
    figures: Mapping[str, float | None],
    problems: Sequence[str],
    lines: Sequence[str] = (),
    skipped: Sequence[str] = (),
    logs: Sequence[str] = (),
) -> str:
    """Return one suite on what a `command` found: its properties are the figures, its cases the `logs` and the checks.

    Each of the `problems`, for which not all was read or checked, begins with the name of a log, whose case is an error;
    without errors and failures the exit code is 0. Checks that were `skipped` have their cases, too.
    """
    read: dict[str, list[str]] = {log: [] for log in logs}
    for problem in problems:
        named = [log for log in read if problem.startswith((f"{log}: ", f"{log} and "))]
        read.setdefault(max(named, key=len, default=problem.partition(": ")[0]), []).append(problem)
    cases = [(f"{log}: read", "error" if whys else "", "\n".join(whys)) for log, whys in read.items()]
    for one in verdicts:
        for log, each in one.logs or [("", one)]:
            why = f"expected {each.expected}, found {each.words}"
            cases.append((f"{log}: " * bool(log) + one.expression, "" if each.holds else "failure", why))
        unread = (log for log in logs if one.logs and read[log] and log not in dict(one.logs))
        cases += [(f"{log}: {one.expression}", "skipped", f"not run: {read[log][0]}") for log in unread]
    cases += [(expression, "skipped", f"not run: {problems[0]}") for expression in skipped]
    tags = Counter(tag for _, tag, _ in cases)
    counts = {"tests": str(len(cases)), "failures": str(tags["failure"]), "errors": str(tags["error"])}
    root = ET.Element("testsuites", {"name": f"lidarcli {command}", **counts})
    suite = _part(root, "testsuite", name=title, **counts, skipped=str(tags["skipped"]))
    properties = _part(suite, "properties")
    for name, value in figures.items():
        if value is not None:
            _part(properties, "property", name=name, value=number(value, 6).replace(",", ""))
    for name, tag, why in cases:
        case = _part(suite, "testcase", classname=f"lidarcli.{command}", name=name)
        if tag:
            part = _part(case, tag, message=why.partition("\n")[0], **TYPES.get(tag, {}))
            part.text = clean(f"{name}\n{why}")
    if lines:
        _part(suite, "system-out").text = clean("\n".join(lines))
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _part(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """Return a new element below another; all texts of checks and logs come in here."""
    return ET.SubElement(parent, tag, {name: clean(text) for name, text in attributes.items()})


def clean(text: str) -> str:
    r"""Return text with escapes for the characters that XML cannot hold.

    >>> clean("bad\udcff\x01")
    'bad\\udcff\\x01'
    """
    return _NOT_XML.sub(lambda found: repr(found[0])[1:-1], text)


def as_github(report: Report, text: str = "") -> str:
    """Return one command per line, errors first: of each kind the page shows the first ten of a step.

    `text`, the report for the terminal, follows in a fold of the step's log.
    """
    lines = [*_annotations(report)]
    if text:
        # In the fold no line is a command until a word comes that the text cannot hold: its own digest.
        word = hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()
        fold = (f"::group::{_escaped(report.title)}", f"::stop-commands::{word}", text.rstrip("\n"))
        lines += [*fold, f"::{word}::", "::endgroup::"]
    return "\n".join(lines) + "\n"


def command(kind: str, title: str, message: str) -> str:
    r"""Return a workflow command with its title.

    >>> command("error", "checks: a, b", "100 %\nof it")
    '::error title=checks%3A a%2C b::100 %25%0Aof it'
    """
    return f"::{kind} title={_escaped(title).replace(':', '%3A').replace(',', '%2C')}::{_escaped(message)}"


def _escaped(text: str) -> str:
    """Return text without ends of lines and escapes; characters that would steer a terminal are spelled out."""
    return visible(text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A"))


def _annotations(report: Report) -> Iterator[str]:
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
