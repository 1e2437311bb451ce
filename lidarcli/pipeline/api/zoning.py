"""`lidarcli.zones`: events of zones, and what is in them in every sweep."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
import pyarrow as pa

from lidarcli.choices import SIGNIFICANCE
from lidarcli.errors import OptionError, warn
from lidarcli.masks import Polygon
from lidarcli.options import ZONE_RULES, Paths, Zoning
from lidarcli.pipeline.api.options import (
    LogOptions,
    Progress,
    Values,
    detect_options,
    log_options,
    path_text,
    several,
    sources_of,
    tracking_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.detecting import ErrorCollector
from lidarcli.pipeline.inputs.zones import read_zones
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.pipeline.zoning import ZoneOptions, ZoneTables, refuse_options, watch
from lidarcli.zone import crossing_edges, on_one_line


@with_keywords(ZONE_RULES)
def zones(log: Paths, *, progress: Progress = False, **options: Unpack[Zoning]) -> ZoneTables:
    """Tell who or what was in a zone, when, and how near: an offline check of a recording, no safety function.

    Parameters
    ----------
    log : logs as of `read`, each of which is a log of its own in the tables

    Returns
    -------
    ZoneTables
        `events`, one row per event, and `zones`, one row per sweep and zone, each a pyarrow.Table as the command line
        writes it (docs/zones.md).

    Raises
    ------
    OptionError
        A zone file does not say what a zone is, or zones that need objects are watched without.
    UnreadableError, NoScanError
        As of `read`; also where nothing leads to the frame of a zone, or poses contradict the sweeps.
    """
    if not options["zones"]:
        raise TypeError("zones() needs zones=FILE")
    how = zone_options(options, log_options(options))
    sources = sources_of(log, options["join"])
    failed = ErrorCollector(len(sources))
    found: list[ZoneTables] = []
    with watched(progress, sources) as report:
        for source in sources:
            with failed.noted(source):
                summary = watch(source, how, progress=progress_of(source, report))
                found.append(summary.tables)
                for line in summary.damage:
                    warn(f"{source.label}: {line}")
    failed.conclude()
    if len(found) == 1:
        return found[0]
    events, rows = (pa.concat_tables(tables) for tables in zip(*found, strict=True))
    return ZoneTables(events.unify_dictionaries(), rows.unify_dictionaries())


def zone_options(told: Values, logs: LogOptions, *, overwrite: bool = False) -> ZoneOptions:
    """Return which zones are watched, and how."""
    names = several(told["zones"])
    tracking = tracking_of({"significance": SIGNIFICANCE, "memory": True})
    options = ZoneOptions(
        zones=read_zones(names),
        files=tuple(names),
        detect=detect_options(told, logs, tracking),
        objects=None if told["objects"] is None else path_text(told["objects"]),
        find=not told["no_objects"],
        footprint=None if told["footprint"] is None else _footprint(told["footprint"]),
        overwrite=overwrite,
    )
    refuse_options(options)
    return options


def _footprint(told: str | Sequence[Sequence[float]]) -> Polygon:
    """Return the polygon of points (K, 2) [m], or of a text such as [[x, y], ...]."""
    if not isinstance(told, str | Sequence | np.ndarray):
        raise TypeError(f"footprint is [[x, y], ...] or such a text, not {type(told).__name__}")
    try:
        points: Any = ast.literal_eval(told) if isinstance(told, str) else told
        corners = tuple((float(x), float(y)) for x, y in points)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise OptionError(f"--footprint: '{told}' is not [[x, y], ...]") from None
    if len(corners) < 3:
        raise OptionError(f"--footprint: '{told}' has fewer than 3 corners")
    if not np.isfinite(corners).all():
        raise OptionError(f"--footprint: '{told}' has numbers that are not finite")
    shape = Polygon(corners)
    if on_one_line(shape):
        raise OptionError(f"--footprint: '{told}' has no area: its corners lie on one line")
    if crossing_edges(shape) is not None:
        raise OptionError(f"--footprint: '{told}' crosses itself")
    return shape
