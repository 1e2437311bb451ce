"""A report on runs for programs: JSON by the schema of docs/reports.md, and JUnit XML with a test case per log."""

from __future__ import annotations

from typing import Any

from lidarcli.reports import json, junit
from lidarcli.reports.runs import BAD, RunsReport
from lidarcli.reports.wording import stamp
from lidarcli.tabular.runs import Entry

SCHEMA = "lidarcli.runs/1"
"""The name of the schema; the number changes when a program that reads it may break."""


def as_json(report: RunsReport) -> str:
    """One JSON object with all logs."""
    summary = report.summary
    first, last = summary.span or (None, None)
    return json.written(
        {
            **json.beginning(report, SCHEMA),
            "figures": json.numbers(summary.figures),
            "versions": list(summary.versions),
            "first": None if first is None else stamp(first),
            "last": None if last is None else stamp(last),
            "logs": [_log(log) for log in summary.logs],
        }
    )


def _log(log: Entry) -> dict[str, Any]:
    return {
        "url": log.url,
        "log": log.log,
        "outcome": log.outcome,
        "exit_code": log.exit_code,
        "message": log.message,
        "lidarcli": log.version,
        **json.numbers({"size": log.size, "sweeps": log.sweeps, "rows": log.rows, "seconds": log.seconds}),
        "ended": stamp(log.ended),
    }


def as_junit(report: RunsReport) -> str:
    """One suite with a case per log; what failed or is damaged is a failure."""
    summary = report.summary
    cases = [
        junit.Case(log.url, "lidarcli.runs", _failure(log), log.outcome, log.seconds) for log in summary.logs
    ]
    return junit.document(report, summary.figures, cases)


def _failure(log: Entry) -> str | None:
    if log.outcome not in BAD:
        return None
    return f"{log.outcome}, exit code {log.exit_code}: {log.message or 'no message'}"
