"""People through lines by interval of time, as cells of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lidarcli.display.texts import times_of_day
from lidarcli.formalism.counting import in_all
from lidarcli.options.times import SECOND_NS, TimeZone, is_date
from lidarcli.reports.columns import Rows
from lidarcli.reports.wording import bar, percent, sure
from lidarcli.tabular.schemas import DIRECTIONS

WHOLE = -1
"""Begin of the row of all intervals together."""
People = Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]
"""Log and line → the rows of its table of counts."""


def people_cells(people: People, zone: TimeZone, several: bool = False) -> dict[str, list[str]]:
    """Return heading → cells of the people by line and interval, and in all, with a bar for each number of an interval."""
    found: list[tuple[str, ...]] = []
    for (log, name), rows in people.items():
        starts: dict[int, list[Mapping[str, Any]]] = {}
        for row in rows:
            starts.setdefault(row["start"], []).append(row)
        heads = dict(zip(starts, _begins([*starts], rows[0]["start"], zone), strict=True)) | {WHOLE: "all"}
        most = max(sum(row["count"] for row in both) for both in starts.values())
        starts[WHOLE] = [in_all([row for row in rows if row["direction"] == way]) for way in DIRECTIONS]
        for begin, both in starts.items():
            length = bar(sum(row["count"] for row in both) / max(most, 1), 16).rstrip()
            words = [sure(row["count"], row["low"], row["high"]) for row in both]
            length = "" if begin == WHOLE else length
            observed = percent(both[0]["observed"]).replace(".0 %", " %")
            found.append((name, heads[begin], *words, length, observed, log if several else ""))
    names = ("zone", "from", *DIRECTIONS, "people", "observed", "log")
    return dict(zip(names, map(list, zip(*found, strict=True)), strict=True))


def _begins(stamps: Sequence[int], first_ns: int, zone: TimeZone) -> list[str]:
    """Return the begins of intervals in words: time of day, with the date where they are of several, else seconds."""
    if not is_date(first_ns):
        return [f"{(stamp - first_ns) / SECOND_NS:,.1f} s" for stamp in stamps]
    return [each.partition(".")[0] for each in times_of_day(stamps, zone)[1]]


def people_in(rows: Rows | None, logs: Sequence[str]) -> People:
    """Return the rows of the table of counts, by log and line."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    if rows is not None:
        columns = {name: rows.table[name].to_pylist() for name in rows.table.column_names if name not in ("start", "end")}
        columns |= {name: rows.integers(name).tolist() for name in ("start", "end")}
        for source, values in zip(rows.source.tolist(), zip(*columns.values(), strict=True), strict=True):
            row = dict(zip(columns, values, strict=True))
            found.setdefault((logs[source], row["zone"]), []).append(row)
    return found
