"""People by line, direction and interval of time, each number with its interval."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from lidarcli.formalism.counting import interval
from lidarcli.options.times import LONGEST, SECOND_NS, TimeZone
from lidarcli.pipeline.zones.events import ZoneEvents
from lidarcli.reports.people import people_cells
from lidarcli.sweeps.types import Float64, Int64
from lidarcli.sweeps.zone import UNSEEN, Line
from lidarcli.tabular.schemas import DIRECTIONS

SHOWN = 24
"""Most intervals of which there is a line of text."""


def counts_of(one: ZoneEvents, interval_ns: int) -> list[dict[str, Any]]:
    """Return the rows of the table of counts of a line: one per interval and direction.

    Intervals begin at multiples of their length where stamps are dates, else at the first sweep; the first and the last one
    are cut at the ends of the log."""
    stamps = one.columns["stamp"]
    assert stamps is not None
    if not isinstance(one.zone.shape, Line) or one.one_sided is None or not len(stamps):
        return []
    first, last = int(stamps.min()), int(stamps.max())
    begin = first // interval_ns * interval_ns if first > LONGEST * SECOND_NS else first
    edges = np.array([first, *range(begin + interval_ns, last, interval_ns), last])
    observed, (times, agents) = _observed(one, edges), one.at_once
    seen = [(event["start"], event["direction"]) for event in one.events if "direction" in event]
    counts, unsure = (
        Counter((int(np.searchsorted(edges[1:-1], stamp, side="right")), way) for stamp, way in some)
        for some in (seen, one.unsure)
    )
    among = np.searchsorted(times, [*edges[:-1], last + 1])
    rows = []
    for k, (start, end) in enumerate(pairwise(edges.tolist())):
        now = agents[among[k] : among[k + 1]]
        share, at_once = float(observed[k]), float(now.mean()) if len(now) else 0.0
        for way in DIRECTIONS:
            count, more = counts[k, way], unsure[k, way]
            row = {"topic": one.topics[0].topic, "zone": one.zone.name, "start": start, "end": end, "direction": way}
            row |= {"count": count, **interval(count, more, share, at_once)._asdict(), "unsure": more}
            rows.append(row | {"observed": share, "agents": at_once})
    return rows


def _observed(one: ZoneEvents, edges: Int64) -> Float64:
    """Return (K,) the share of each interval in which the line was observed: from sweep to sweep, without gaps."""
    stamps, observed = one.columns["stamp"], one.columns["observed"]
    assert stamps is not None
    assert observed is not None
    steps = np.diff(stamps)
    longest = max(UNSEEN * SECOND_NS, 1.5 * float(np.median(steps))) if len(steps) else 0.0
    so_far = np.concatenate([[0], np.cumsum(np.where(observed[:-1] & (steps <= longest), steps, 0))])
    shares: Float64 = np.diff(np.interp(edges - edges[0], stamps - edges[0], so_far)) / np.maximum(np.diff(edges), 1)
    return shares


def lines_of(rows_of: Mapping[str, Sequence[Mapping[str, Any]]], zone: TimeZone) -> Iterator[tuple[str, str]]:
    """Yield heads and words: people through each line by interval, and in all."""
    cells = people_cells({("", name): rows for name, rows in rows_of.items()}, zone)
    columns = [[name, *cells[name]] for name in ("zone", "from", *DIRECTIONS, "observed")]
    widths = [max(map(len, column)) for column in columns]
    lines = ["  ".join(map(str.ljust, line, widths)) for line in zip(*columns, strict=True)]
    shown = [line for line, name in zip(lines, columns[1], strict=True) if name == "all"]
    left = len(lines) - 1 - len(shown) - SHOWN
    several = [*lines[: SHOWN + 1], f"and {left:,} more intervals in the table of counts", *shown] if left > 0 else lines
    yield from zip(["  people   ", *[" " * 11] * (len(several) - 1)], several, strict=True)
