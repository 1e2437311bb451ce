"""Several runs one after the other: a table of their figures, and a chart of each, with the limits of checks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidarcli.display.texts import moment
from lidarcli.options.times import TimeZone
from lidarcli.reports.checks import Check, OneRun
from lidarcli.reports.document import Notes, ReportTable, Section, Trend
from lidarcli.reports.wording import NONE, counted, number, quantities, quantity

SHOWN, COLUMNS = 30, 5
"""Most runs, the latest, and most figures of the table; charts have all of them."""
TOLD = (
    *("sweeps", "objects_per_sweep.mean", "tracks.people", "agents_at_once.max", "nearest.min"),
    *("valid_share", "gaps", "damage"),
)
"""Figures that are told without a check, and for each zone its events."""


def trends(runs: Sequence[OneRun], checks: Sequence[Check], zone: TimeZone) -> Section | None:
    """Return charts and table of runs, by their first stamps; None of a single one."""
    if len(runs) < 2:
        return None
    runs = sorted(runs, key=lambda one: (one.start_ns is None, one.start_ns or 0))
    starts = [NONE if one.start_ns is None else moment(one.start_ns, zone)[:16].replace("T", " ") for one in runs]
    of_zones = (name for one in runs for name in one.figures if name.startswith("zones.") and name.endswith(".events"))
    each = [check for check in checks if check.is_of_each and not check.condition]
    columns: list[tuple[bool, Trend, list[str]]] = []
    same = []
    for name in dict.fromkeys((*(check.name for check in each), *TOLD, *of_zones)):
        values, limits = [one.figures.get(name) for one in runs], [check for check in each if check.name == name]
        fails = [any(value is None or not one.admits(value) for one in limits) for value in values]
        cells = quantities(name, values)
        if len({*values}) > 1 or any(fails):
            words = [f"{start} {one.log}: {cell}" for start, one, cell in zip(starts, runs, cells, strict=True)]
            chart = _trend(name, limits, [*zip(values, fails, words, strict=True)], (starts[0], starts[-1]))
            marked = [f"! {cell}" if failing else cell for cell, failing in zip(cells, fails, strict=True)]
            columns.append((not any(fails), chart, [*marked, chart.limit]))
        elif values[0] is not None:
            same.append(f"{name} {cells[0]}")
    columns.sort(key=lambda one: one[0])
    names, told = [chart.name for _, chart, _ in columns], [cells for *_, cells in columns[:COLUMNS]]
    rows = [*zip([*starts, ""], [*(one.log for one in runs), "limit"], *told, strict=True)][-SHOWN - 1 :]
    left = len(runs) - SHOWN
    more = f"and {counted(left, 'earlier run')}, all of them in --format json" if left > 0 else ""
    head = ("start", "log", *names[:COLUMNS])
    table = ReportTable(head, rows if any(rows[-1][2:]) else rows[:-1], range(2, len(head)), more)
    notes = [(f"On the page also: {', '.join(names[COLUMNS:])}",)] if names[COLUMNS:] else []
    notes += [(f"The same in all: {', '.join(same)}",)] if same else []
    return Section("Run by run", [*(chart for _, chart, _ in columns), table, Notes(notes)], fold="Run by run")


def _trend(
    name: str, limits: Sequence[Check], runs: Sequence[tuple[float | None, bool, str]], ends: tuple[str, str]
) -> Trend:
    """Return the chart of a figure: of each run its value, whether a check of it fails, and words."""
    edges = [edge for one in limits for edge in {one.low, one.high}]
    y = np.array([*edges, *(value for value, *_ in runs)], np.float64)
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    room = 0.06 * (high - low) or 1.0
    places = ((y - low + room) / (high - low + 2.0 * room)).tolist()
    x = np.linspace(0.0, 1.0, len(runs)).tolist()
    points = [
        (x[k], places[len(edges) + k], fails, words) for k, (value, fails, words) in enumerate(runs) if value is not None
    ]
    signs = (f"{number(one.low)} to " * (one.sign == "between") or f"{one.sign} " for one in limits)
    limit = ", ".join(sign + quantity(name, one.high) for sign, one in zip(signs, limits, strict=True))
    return Trend(name, limit, points, places[: len(edges)], (quantity(name, low), quantity(name, high), *ends))
