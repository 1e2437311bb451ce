"""The tracks in a report for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING

from lidarcli.reports.summary import Summary
from lidarcli.reports.text_parts import grid, heading, share_bar
from lidarcli.reports.tracks import Tracked
from lidarcli.reports.wording import (
    SHOWN_STATISTICS,
    number,
    track_cells,
    track_kinds,
    track_spreads,
    tracked_words,
    visible,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

TRACKS = 12
"""Tracks shown one by one."""
SHOWN_OF_TRACK = ("track", "kind", "shape", "label", "duration", "distance", "top speed", "end")
LONGEST_LABEL = 11
"""Characters of a label in 80 columns."""


def track_parts(summary: Summary) -> Iterator[RenderableType]:
    """Tracks, and what bears a name of the catalogue; nothing where there is neither."""
    yield from _tracks(summary)
    yield from _labels(summary)


def _tracks(summary: Summary) -> Iterator[RenderableType]:
    tracked = summary.tracked
    if tracked is None:
        return
    yield heading("Tracks")
    yield grid([[name, words] for name, words in tracked_words(tracked).items()])
    rows = [[name, *cells] for name, cells in track_spreads(tracked)]
    if rows:
        yield grid(rows, right=range(1, 7), head=["", *SHOWN_STATISTICS])
    for name in tracked.kinds:
        counts = track_kinds(tracked, name)
        if counts:
            yield heading(name.replace(".", " by ").capitalize())
            total = sum(counts.values())
            yield grid([[f"{kind:<11}", share_bar(count, total)] for kind, count in counts.items()])
    yield from _one_by_one(tracked)


def _one_by_one(tracked: Tracked) -> Iterator[RenderableType]:
    from rich.text import Text

    shown = tracked.most(TRACKS)
    if not shown:
        return
    total = int(tracked.figures["tracks"] or 0)
    yield heading("Track by track" + (f", {len(shown)} of {total:,}" if total > len(shown) else ""))
    groups = {name: list(group) for name, group in groupby(shown, lambda one: f"{one.log} {one.topic}")}
    for name, group in groups.items():
        if len(groups) > 1:
            yield Text(visible(name))
        rows = [track_cells(one) | {"label": _short(one.label)} for one in group]
        # Columns without a single entry are left out.
        head = [column for column in SHOWN_OF_TRACK if any(cells[column] for cells in rows)]
        right = [
            k for k, column in enumerate(head) if column in ("track", "duration", "distance", "top speed")
        ]
        yield grid([[cells[column] for column in head] for cells in rows], right=right, head=head)


def _short(label: str) -> str:
    """A label that leaves room for the other columns.

    >>> _short("a pallet of the long kind")
    'a pallet...'
    """
    return label if len(label) <= LONGEST_LABEL else f"{label[: LONGEST_LABEL - 3].rstrip()}..."


def _labels(summary: Summary) -> Iterator[RenderableType]:
    if summary.labels:
        yield heading("By label")
        rows = [[one.name, number(one.tracks), number(one.objects)] for one in summary.labels]
        yield grid(rows, right=(1, 2), head=["", "tracks", "objects"])
