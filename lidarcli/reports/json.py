"""A report as JSON: the schema of docs/reports.md."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from lidarcli._version import __version__
from lidarcli.display import stamp
from lidarcli.reports.changes import Change, Changed
from lidarcli.reports.changes_report import ChangesReport
from lidarcli.reports.columns import Origin
from lidarcli.reports.compare import Comparison
from lidarcli.reports.document import Document
from lidarcli.reports.figures import Histogram, plain_number
from lidarcli.reports.report import Report
from lidarcli.reports.runs import RunsReport
from lidarcli.reports.streams import Standing, Stream
from lidarcli.reports.summary import Summary
from lidarcli.reports.zone_report import ZonesReport
from lidarcli.reports.zones import Zoned
from lidarcli.tabular.runs import Entry

SCHEMA = "lidarcli.report/1"
"""The name of the schema; the number changes when a program that reads it may break."""
RUNS_SCHEMA = "lidarcli.runs/1"
"""Name of the schema of a report on runs."""
CHANGES_SCHEMA = "lidarcli.changes/1"
"""Name of the schema of a report on changes alone."""
ZONES_SCHEMA = "lidarcli.zones/1"
"""Name of the schema of a report on zones alone."""


def render(report: Report | RunsReport | ZonesReport | ChangesReport) -> str:
    """Return one JSON object; numbers have nine digits, null stands for what cannot be measured."""
    values = _runs(report) if isinstance(report, RunsReport) else as_dict(report)
    return json.dumps(values, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def as_dict(report: Report | ZonesReport | ChangesReport) -> dict[str, Any]:
    """Return the report as plain values."""
    if isinstance(report, ZonesReport):
        return _of_zones(report)
    if isinstance(report, ChangesReport):
        return {
            **_beginning(report, CHANGES_SCHEMA),
            "sources": _sources(report.changed.sources),
            **_with_changes({}, report.changed),
        }
    summary = report.summary
    return {
        **_beginning(report, SCHEMA),
        **_summary(summary),
        **_with_changes(summary.figures, report.changed),
        "comparison": None if report.comparison is None else _comparison(report.comparison),
    }


def _beginning(report: Document, schema: str) -> dict[str, Any]:
    """Return the beginning of reports of every kind."""
    return {
        "schema": schema,
        "lidarcli": __version__,
        "holds": report.holds,
        "checks": [verdict.as_dict() for verdict in report.verdicts],
        "problems": list(report.problems),
        "warnings": list(report.warnings),
    }


def _summary(summary: Summary) -> dict[str, Any]:
    return {
        "sources": _sources(summary.sources),
        "figures": _numbers(summary.figures),
        "beams": {"status": summary.status, "set": summary.sets},
        "objects": {name: {**dict.fromkeys(summary.kinds[name], 0), **summary.kinds[name]} for name in summary.kinds},
        "histograms": {name: _histogram(one) for name, one in summary.histograms.items()},
        "maps": [_fields(one, "frame", "x0", "y0", "cell", "counts") for one in summary.densities],
        "streams": [_stream(one) for one in summary.streams.all],
        "standing_out": [_standing(one) for one in summary.standing],
        **_tracks(summary),
    }


def _sources(sources: Sequence[Origin]) -> list[dict[str, Any]]:
    return [
        {
            "log": source.log,
            "format": source.format,
            "size": source.size,
            "lidarcli": source.version,
            "parameters": source.parameters,
            "damage": list(source.damage),
        }
        for source in sources
    ]


def _tracks(summary: Summary) -> dict[str, Any]:
    """Return tracks and labels where there are any."""
    found: dict[str, Any] = {}
    if (tracked := summary.tracked) is not None:
        found["tracks"] = {
            "scene": tracked.scene,
            "agent_share": plain_number(tracked.agent_share),
            **{name.removeprefix("tracks."): counts for name, counts in tracked.kinds.items()},
        }
    if summary.labels:
        found["labels"] = [asdict(label) for label in summary.labels]
    return found if summary.zoned is None else found | _zones(summary.zoned)


def _zones(zoned: Zoned) -> dict[str, Any]:
    """Return the zones, and the events to look at first."""
    names = ("log", "topic", "zone", "kind", "action", "sweep", "t", "duration", "cut", "points", "nearest", "ttc")
    return {
        "zones": [
            {**_fields(one, "name", "action"), "line": one.is_line, **_fields(one, "active", "by", "visits")}
            for one in zoned.zones
        ],
        "events": [
            {**_fields(one, *names), "set": one.set or None, "track": plain_number(one.track), "label": one.label or None}
            for one in zoned.events
        ],
    }


def _of_zones(report: ZonesReport) -> dict[str, Any]:
    return {
        **_beginning(report, ZONES_SCHEMA),
        "sources": _sources(report.sources),
        **_with_changes(report.zoned.figures, report.changed),
        "sweeps": report.zoned.sweeps,
        **_zones(report.zoned),
    }


def _with_changes(figures: dict[str, float | None], changed: Changed | None) -> dict[str, Any]:
    """Return figures with those of the changes, how the runs lie on each other, and the changes."""
    if changed is None:
        return {"figures": _numbers(figures)}
    return {
        "figures": _numbers(figures | changed.figures),
        "alignments": [
            {"log_a": one.before, "log_b": one.name, **_fields(one, "dx", "dy", "dyaw", "overlap", "rms")}
            for one in changed.pairs
        ],
        "changes": [
            {"log_b": one.name, **_fields(each, *(field.name for field in fields(Change)))}
            for one in changed.pairs
            for each in one.changes
        ],
    }


def _comparison(comparison: Comparison) -> dict[str, Any]:
    baseline = comparison.baseline
    return {
        "baseline": {
            "logs": [source.log for source in baseline.sources],
            "figures": _numbers(baseline.figures),
            "histograms": {name: _histogram(one) for name, one in baseline.histograms.items()},
        },
        "figures": _numbers(comparison.figures),
        "parameters": [{"name": name, "here": here, "baseline": there} for name, here, there in comparison.parameters],
        "changes": [asdict(change) for change in comparison.changes],
    }


def _histogram(one: Histogram) -> dict[str, Any]:
    return _fields(one, "unit", "edges", "counts")


def _stream(one: Stream) -> dict[str, Any]:
    columns = ["sweep", "seconds", "objects_mean", "objects_min", "objects_max"]
    columns += ["d_th", "noise", "lost_share"]
    if np.isfinite(one.course.agents_max).any():
        columns += ["agents_mean", "agents_max"]
    return {
        **_fields(one, "log", "topic", "frame_id", "sweeps", "beams", "objects"),
        "start": stamp(one.start_ns),
        **_fields(one, "start_ns", "end_ns", "duration", "rate", "gaps"),
        "missing_sweeps": one.missing,
        **_fields(one, "longest_gap", "backward", "repeated"),
        "course": _fields(one.course, *columns),
    }


def _standing(one: Standing) -> dict[str, Any]:
    names = _fields(one, "kind", "log", "topic", "sweep")
    return {**names, "stamp": stamp(one.stamp_ns), "value": plain_number(one.value)}


def _numbers(values: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return figures by their names, with nine digits."""
    return {name: plain_number(value) for name, value in values.items()}


def _fields(one: object, *names: str) -> dict[str, Any]:
    """Return some fields of a data class by name."""
    return {name: _plain(getattr(one, name)) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind in "iu" else [plain_number(each) for each in value.tolist()]
    return plain_number(value) if isinstance(value, float) else value


def _runs(report: RunsReport) -> dict[str, Any]:
    summary = report.summary
    first, last = summary.span or (None, None)
    return {
        **_beginning(report, RUNS_SCHEMA),
        "figures": _numbers(summary.figures),
        "versions": list(summary.versions),
        "first": None if first is None else stamp(first),
        "last": None if last is None else stamp(last),
        "logs": [_log(log) for log in summary.logs],
    }


def _log(log: Entry) -> dict[str, Any]:
    return {
        **_fields(log, "url", "log", "outcome", "exit_code", "message"),
        "lidarcli": log.version,
        **_fields(log, "size", "sweeps", "rows", "seconds"),
        "ended": stamp(log.ended),
    }
