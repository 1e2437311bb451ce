"""A report for the terminal: 80 columns, readable without colour."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence

from rich.console import Console, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from lidarcli.display import no_command, visible
from lidarcli.reports.document import TEXT, Bands, Block, Document, Drawing, Facts, Listing, Notes, Share, Shares, Table
from lidarcli.reports.wording import bar, course, number, share

WIDTH = 80
BAR = 28
COURSE, LONGEST_NAME = 48, 18
"""Characters of a band, and of its name at most."""


def render(report: Document, colour: bool = False) -> str:
    """Return the report as text; `colour` for a terminal."""
    parts = [*_checks(report)]
    for section in report.sections().values():
        if TEXT in section.formats:
            parts += [_heading(section.title)] if section.title else []
            parts += [part for block in section.blocks for part in _parts(block)]
    return _printed(parts, colour)


def brief(report: Document, colour: bool = False) -> str:
    """Return the checks and the summary."""
    lines = [_text(line) for line in report.lines]
    return _printed([*_checks(report), *([Text()] if report.verdicts else []), *lines], colour)


def _printed(parts: Iterable[RenderableType], colour: bool) -> str:
    """Return the parts one below the other."""
    out = io.StringIO()
    console = Console(
        file=out,
        width=WIDTH,
        force_terminal=colour,
        no_color=not colour,
        color_system="standard" if colour else None,
        highlight=False,
        markup=False,
        emoji=False,
        legacy_windows=False,
    )
    for part in parts:
        console.print(part)
    # Whatever is in them, no line is a command for the page that shows the log of a CI server.
    lines = [no_command(line.rstrip()) for line in out.getvalue().splitlines()]
    return "\n".join(lines).strip("\n") + "\n"


def _checks(report: Document) -> Iterator[RenderableType]:
    """Yield problems, warnings, and a line for each check."""
    for kind, problem in report.named_problems:
        yield _text(f"{kind}: {problem}", style="red")
    for warning in report.warnings:
        yield _text(f"warning: {warning}", style="yellow")
    if not report.verdicts:
        return
    yield _heading(report.judgement)
    for verdict in report.verdicts:
        mark = "ok  " if verdict.holds else "FAIL"
        line = _text(mark, style="green" if verdict.holds else "bold red")
        line.append(visible(f"  {verdict.expression}  (found {verdict.words})"), style="none")
        yield line


def _parts(block: Block) -> Iterator[RenderableType]:
    match block:
        case Table():
            yield _grid(block.rows, block.right, block.head)
            if block.more:
                yield _text(block.more)
        case Facts():
            yield _grid(
                [
                    [name, _share_bar(value.part, value.whole) if isinstance(value, Share) else value]
                    for name, value in block.rows
                ]
            )
        case Shares():
            yield _grid([[f"{kind:<11}", _share_bar(count, block.total)] for kind, count in block.counts.items()])
        case Bands():
            yield from (_text(f"  {line}", no_wrap=True) for line in band_lines(block))
        case Drawing():
            for line in block.lines:
                yield _text(f"  {line}", no_wrap=True)
        case Notes():
            for parts in block.lines:
                yield _text("".join(parts))
        case Listing():
            for words, names in block.groups:
                yield _text(words)
                yield _grid([[" ", name] for name in names])
            if block.more:
                yield _text(block.more)


def _text(text: str, style: str = "", no_wrap: bool = False) -> Text:
    """Return text, which may be that of a log or a table, without what steers a terminal."""
    return Text(visible(text), style=style, no_wrap=no_wrap)


def _heading(text: str) -> Text:
    """Return a heading after a blank line."""
    heading = Text("\n")
    return heading.append(visible(text), style="bold")


def _grid(rows: Sequence[Sequence[str]], right: Sequence[int] = (), head: Sequence[str] = ()) -> RichTable:
    """Return a table without lines; columns in `right` are flush right, the last one wraps."""
    table = RichTable(box=None, show_header=bool(head), pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
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
        table.add_row(*(_text(cell) for cell in row))
    return table


def _share_bar(count: int, total: int) -> str:
    """Return a bar, the share in per cent, and the count."""
    part = count / total if total else 0.0
    return f"{bar(part, BAR)} {share(count, total):>7} {count:>12,}"


def band_lines(block: Bands) -> list[str]:
    """Return bands below each other, each behind its name, with the time below them."""
    names = [visible(one.name) for one in block.bands]
    names = [name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…" for name in names]
    words = [visible(one.word)[:LONGEST_NAME] for one in block.bands]
    width, room = (max(map(len, texts), default=0) for texts in (names, words))
    lines = [visible(block.title)] if block.title else []
    for name, word, one in zip(names, words, block.bands, strict=True):
        lines.append(f"{name:<{width}}  {word:<{room}}  {course(one.spans, one.thin, COURSE)}")
    return [*lines, f"{'':<{width + 2 + room}}  0 s{f'{number(block.seconds)} s':>{COURSE - 3}}"]
