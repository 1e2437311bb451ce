"""Zones in a report: their figures, checks of them, and what tables and bands show of their events."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.reports.checks import Check, Verdict, count_events, parse_check, verdict_of
from lidarcli.reports.columns import Rows, Watched
from lidarcli.reports.figures import STATISTICS, ZONES, Spread, zone_names
from lidarcli.sweeps import Bool

if TYPE_CHECKING:
    import pyarrow as pa

OF_AREAS = ("events", "share", "nearest", "points.max", "ttc.min", "duration.")
"""Figures that a line has not: nothing occupies it."""
OF_LINES = ("in", "out")
"""Figures that an area has not: it is entered from all sides."""


def zone_figures(
    events: pa.Table, zones: pa.Table, lines: Collection[str] | None = None
) -> dict[str, float | None]:
    """Return the figures `zones.NAME.X` of tables of events and of zones, summed over their logs.

    Parameters
    ----------
    events, zones : tables as `schemas.EVENTS` and `schemas.ZONES` have them, of one log or of several in turn
    lines : the zones that are lines, where that is known: a line has no `OF_AREAS`, and an area no `OF_LINES`

    Returns
    -------
    Every name of `figures.zone_names` of each zone → value; None where there is nothing to measure, as in all of a zone
    that was never in view.
    """
    watched = Watched(Rows.join([events]), Rows.join([zones]))
    if lines is not None:
        shapes: dict[str, dict[str, Any]] = {
            name: {"line": []} if name in lines else {} for name in watched.names
        }
        watched = replace(watched, shapes=shapes)
    return figures_of(watched)


def figures_of(watched: Watched) -> dict[str, float | None]:
    """Return the figures of all zones."""
    found: dict[str, float | None] = {}
    for name in watched.names:
        shape, values = watched.shapes.get(name), _values(watched, name)
        missing = () if shape is None else OF_AREAS if "line" in shape else OF_LINES
        for full in zone_names(name):
            plain = full.removeprefix(f"{ZONES}{name}.")
            found[full] = None if plain.startswith(missing) else values[plain]
    return found


def of_zone(rows: Rows, zone: str, *kinds: str) -> Bool:
    """Return (K,) the rows of a zone; of events those of some kinds."""
    chosen = rows.are("zone", zone)
    if kinds:
        chosen = chosen & np.any([rows.are("kind", kind) for kind in kinds], axis=0)
    return chosen


def _values(watched: Watched, zone: str) -> dict[str, float | None]:
    """Return the figures of a zone without the beginning of their names."""
    events, rows = watched.events, watched.zones
    mine = of_zone(rows, zone)
    seen, agents = Spread.of(rows.numbers("seen")[mine]), Spread.of(rows.numbers("agents")[mine])
    if not seen.max:
        return dict.fromkeys(name.removeprefix(f"{ZONES}{zone}.") for name in zone_names(zone))
    alarms, visits = of_zone(events, zone, "occupied", "approach"), of_zone(events, zone, "visit")
    crossings = of_zone(events, zone, "crossing")
    duration = events.numbers("duration")
    values: dict[str, float | None] = {
        "events": int(alarms.sum()),
        "share": Spread.of(rows.numbers("active")[mine]).mean,
        "nearest": Spread.of(rows.numbers("nearest")[mine]).min,
        "points.max": Spread.of(rows.numbers("points")[mine]).max,
        "ttc.min": Spread.of(rows.numbers("ttc")[mine]).min,
        # Without tracks nobody knows who went across.
        **{
            way: int((crossings & events.are("direction", way)).sum()) if agents.count else None
            for way in OF_LINES
        },
        "seen": seen.mean,
    }
    spreads = {
        "duration": Spread.of(duration[alarms]),
        "agents_at_once": agents,
        "dwell": Spread.of(duration[visits]),
    }
    for name, spread in spreads.items():
        values |= {f"{name}.{statistic}": getattr(spread, statistic) for statistic in STATISTICS}
    return values


def parse_zone_check(expression: str, zones: Collection[str]) -> Check:
    """Understand a check of zones alone: their figures, and rows of events.

    Raises
    ------
    OptionError
        Bad syntax, or a figure or zone that does not exist; the message names what is near.

    >>> parse_zone_check("zones.left-door.in between 30 and 34", ["left-door"]).expected
    'between 30 and 34'
    """
    return parse_check(expression, only=(), rows=("events",), zones=zones)


def judge_zones(check: Check, values: Mapping[str, float | None], watched: Watched) -> Verdict:
    """Hold a check against the figures of zones, or against the rows of their events."""
    found = values.get(check.name) if check.condition is None else count_events(check.condition, watched)
    return verdict_of(check, found)
