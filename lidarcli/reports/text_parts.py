"""The pieces that a report for the terminal is made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from lidarcli.reports.bars import bar
from lidarcli.reports.wording import share, visible

if TYPE_CHECKING:
    from rich.console import RenderableType

WIDTH = 80
BAR = 28


def heading(text: str) -> RenderableType:
    """A heading after a blank line."""
    from rich.text import Text

    return Text(f"\n{text}", style="bold")


def grid(rows: Sequence[Sequence[str]], right: Sequence[int] = (), head: Sequence[str] = ()) -> Any:
    """A table without lines; columns in `right` are flush right, the last one wraps."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=bool(head), pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    columns = len(head or rows[0])
    for index in range(columns):
        last = index == columns - 1
        table.add_column(
            head[index] if head else "",
            justify="right" if index in right else "left",
            overflow="fold",
            no_wrap=not last and index != 0,
        )
    for row in rows:
        table.add_row(*(Text(visible(cell)) for cell in row))
    return table


def share_bar(count: int, total: int) -> str:
    """A bar, the share in per cent, and the count."""
    part = count / total if total else 0.0
    return f"{bar(part, BAR)} {share(count, total):>7} {count:>12,}"
