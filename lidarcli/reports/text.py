"""Reports for people as text: for the terminal, in 80 columns and readable without colour, and as Markdown."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from rich.console import Console, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from lidarcli.display.texts import no_command, visible
from lidarcli.reports.document import (
    MARKDOWN,
    TEXT,
    Bands,
    Block,
    Code,
    Drawing,
    NamedValues,
    Notes,
    ReportTable,
    Share,
    Shares,
)
from lidarcli.reports.report import Report
from lidarcli.reports.wording import bar, course, number, share

WIDTH = 80
COURSE, LONGEST_NAME = 48, 18
"""Characters of a band, and of its name at most."""
MARKS = {"limit": "▒", "approach": "▒", "slowdown": "▓", "stop": "█", "stale": "░"}
"""Kind of what went on → its mark in a band of several kinds, the most severe last; any other is full."""
KEY = "█ stop  ▓ slowdown  ▒ approach, limit  ░ no sweep for too long"


def as_text(report: Report, colour: bool = False, brief: bool = False) -> str:
    """Return the report as text, `brief` its checks and summary; `colour` for a terminal."""
    parts = [*_checks(report)]
    if brief:
        parts += [*([Text()] if report.verdicts else []), *map(_styled, report.lines)]
    for section in report.sections().values():
        if TEXT in section.formats and not brief:
            parts += [_heading(section.title)] if section.title else []
            parts += [part for block in section.blocks for part in _parts(block)]
    return _printed(parts, colour)


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


def _checks(report: Report) -> Iterator[RenderableType]:
    """Yield problems, warnings, and a line for each check."""
    for kind, problem in report.named_problems:
        yield _styled(f"{kind}: {problem}", style="red")
    for warning in report.warnings:
        yield _styled(f"warning: {warning}", style="yellow")
    if not report.verdicts:
        return
    yield _heading(report.judgement)
    for verdict in report.verdicts:
        mark = "ok  " if verdict.holds else "FAIL"
        line = _styled(mark, style="green" if verdict.holds else "bold red")
        line.append(visible(f"  {verdict.expression}  (found {verdict.words})"), style="none")
        yield line


def _parts(block: Block) -> Iterator[RenderableType]:
    match block:
        case ReportTable():
            yield _grid(block.rows, block.right, block.head)
            if block.more:
                yield _styled(block.more)
        case NamedValues():
            yield _grid(
                [
                    [name, _share_bar(value.part, value.whole) if isinstance(value, Share) else value]
                    for name, value in block.rows
                ]
            )
        case Shares():
            yield _grid([[f"{kind:<11}", _share_bar(count, block.total)] for kind, count in block.counts.items()])
        case Bands():
            yield from (_styled(f"  {line}", no_wrap=True) for line in band_lines(block))
        case Drawing():
            for line in block.lines:
                yield _styled(f"  {line}", no_wrap=True)
        case Notes():
            for parts in block.lines:
                yield _styled("".join(parts))


def _styled(text: str, style: str = "", no_wrap: bool = False) -> Text:
    """Return text, which may be that of a log or a table, without what steers a terminal."""
    return Text(visible(text), style=style, no_wrap=no_wrap)


def _heading(text: str) -> Text:
    """Return a heading after a blank line."""
    heading = Text("\n")
    return heading.append(visible(text), style="bold")


def _grid(rows: Sequence[Sequence[str]], right: Sequence[int] = (), head: Sequence[str] = ()) -> RichTable:
    """Return a table without lines; columns in `right` are flush right, the last one wraps."""
    columns = len(head or rows[0])
    wide = sum(max(len(visible(row[index])) for row in [*rows, *([head] if head else [])]) for index in range(columns))
    # A name stays whole as long as a narrower gap makes room for it, else that of a figure breaks at its dots.
    gap = 1 if head and wide + 2 * (columns - 1) > WIDTH else 2
    if head and wide + columns - 1 > WIDTH:
        head = [re.sub(r"(?<=[._])(?=\w)", "\n", name) for name in head]
    table = RichTable(box=None, show_header=bool(head), pad_edge=False, padding=(0, gap, 0, 0), header_style="dim")
    for index in range(columns):
        last = index == columns - 1
        table.add_column(
            head[index] if head else "",
            justify="right" if index in right else "left",
            overflow="fold",
            no_wrap=not last and index != 0,
        )
    for row in rows:
        table.add_row(*(_styled(cell) for cell in row))
    return table


def _share_bar(count: int, total: int) -> str:
    """Return a bar, the share in per cent, and the count."""
    part = count / total if total else 0.0
    return f"{bar(part, 28)} {share(count, total):>7} {count:>12,}"


def band_lines(block: Bands) -> list[str]:
    """Return bands below each other, each behind its name, with the time below them."""
    names = [visible(one.name) for one in block.bands]
    names = [name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…" for name in names]
    words = [visible(one.word)[:LONGEST_NAME] for one in block.bands]
    width, room = (max(map(len, texts), default=0) for texts in (names, words))
    lines = [visible(block.title)] if block.title else []
    for name, word, one in zip(names, words, block.bands, strict=True):
        # What a zone asks for stands beside it.
        layers = [("█" if kind == one.word else MARKS.get(kind, "█"), spans) for kind, spans in reversed(one.parts)]
        lines.append(f"{name:<{width}}  {word:<{room}}  {course([('▁', one.thin), *layers], COURSE)}")
    ends = [("0 s", f"{number(block.seconds)} s"), (block.clock(0.0), block.clock(1.0))]
    blank = " " * (width + 4 + room)
    lines += [f"{blank}{begin}{end:>{COURSE - len(begin)}}" for begin, end in ends if begin]
    kinds = {kind for one in block.bands for kind, spans in one.parts if kind != one.word and spans}
    return lines + ([KEY] if kinds & MARKS.keys() else [])


def as_markdown(report: Report, brief: bool = False) -> str:
    """Return the verdict and the key figures in sight, the rest folded; `brief` the verdict and the summary."""
    lines = [*_beginning(report)]
    lines += [f"{_escaped(line)}\n" for line in report.lines] if brief else []
    sections = [one for one in report.sections().values() if MARKDOWN in one.formats and not brief]
    for section in sections:
        if not section.fold:
            lines += [f"### {section.title}", ""] if section.title else []
            lines += [line for block in section.blocks for line in _lines(block)]
    for title, folded in groupby((one for one in sections if one.fold), lambda one: one.fold):
        lines += ["<details>", f"<summary>{title}</summary>", ""]
        lines += [line for section in folded for block in section.blocks for line in _lines(block)]
        lines += ["</details>", ""]
    return "\n".join(lines).rstrip() + "\n"


def _beginning(report: Report) -> Iterator[str]:
    """Yield the heading, problems, warnings and checks."""
    yield f"## lidarcli report: {_escaped(report.title)}"
    yield ""
    for kind, problem in report.named_problems:
        yield f"**{kind.capitalize()}:** {_escaped(problem)}\n"
    for warning in report.warnings:
        yield f"**Warning:** {_escaped(warning)}\n"
    if report.verdicts:
        rows = [
            ["passed" if one.holds else "**failed**", _escaped(Code(one.expression)), one.words] for one in report.verdicts
        ]
        yield from (f"**{report.judgement}.**", "", *_table(["", "check", "found"], rows, (2,)))


def _lines(block: Block) -> Iterator[str]:
    match block:
        case ReportTable():
            yield from _table(block.head, [[*map(_escaped, row)] for row in block.rows], block.right)
        case NamedValues():
            yield from _table([name for name, _ in block.rows], [[_escaped(value) for _, value in block.rows]])
        case Shares():
            rows = [[_escaped(kind), f"{count:,}", share(count, block.total)] for kind, count in block.counts.items()]
            yield from _table([block.kind, block.unit, "share"], rows, (1, 2))
        case Bands():
            yield from _fenced(band_lines(block))
        case Drawing():
            yield from _fenced(block.lines)
        case Notes():
            yield from (f"- {''.join(map(_escaped, parts))}" for parts in block.lines)
            yield ""
    if isinstance(block, ReportTable) and block.more:
        yield from (block.more, "")


def _escaped(value: object) -> str:
    """Return text of a log with escapes where Markdown and HTML could read commands; `Code` as code.

    >>> _escaped("a|b <script> `x`"), _escaped(Code("a|b"))
    ('a\\\\|b &lt;script&gt; \\\\`x\\\\`', '`a\\\\|b`')
    """
    plain = visible(re.sub(r"\s+", " ", str(value)))
    if isinstance(value, Code):
        # A bar has to be escaped even in code, where a table is around it.
        return "`" + plain.replace("`", "'").replace("|", "\\|") + "`"
    plain = plain.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    for mark in "\\`*_[]|~#@!":
        plain = plain.replace(mark, "\\" + mark)
    return plain


def _fenced(lines: Sequence[str]) -> list[str]:
    """Return lines as they are; none of them ends the fence."""
    return ["```", *(visible(line).replace("`", "'") for line in lines), "```", ""]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """Return the lines of a table; columns in `right` are flush right."""
    marks = ["---:" if index in right else "---" for index in range(len(head))]
    return [*("| " + " | ".join(line) + " |" for line in (head, marks, *rows)), ""]
