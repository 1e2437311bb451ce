"""A report as Markdown, for a comment on a pull request."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

from lidarcli.display import visible
from lidarcli.reports.document import MARKDOWN, Bands, Block, Code, Document, Drawing, Facts, Listing, Notes, Shares, Table
from lidarcli.reports.terminal import band_lines
from lidarcli.reports.wording import share


def render(report: Document) -> str:
    """Return the verdict and the key figures in sight, the rest folded."""
    lines = [*_beginning(report)]
    sections = [section for section in report.sections().values() if MARKDOWN in section.formats]
    for section in sections:
        if not section.fold:
            lines += [f"### {section.title}", ""] if section.title else []
            lines += [line for block in section.blocks for line in _lines(block)]
    for title, folded in groupby((one for one in sections if one.fold), lambda one: one.fold):
        lines += ["<details>", f"<summary>{title}</summary>", ""]
        lines += [line for section in folded for block in section.blocks for line in _lines(block)]
        lines += ["</details>", ""]
    return "\n".join(lines).rstrip() + "\n"


def brief(report: Document) -> str:
    """Return the checks and the summary."""
    lines = [*_beginning(report), *(f"{_text(line)}\n" for line in report.lines)]
    return "\n".join(lines).rstrip() + "\n"


def _beginning(report: Document) -> Iterator[str]:
    """Yield the heading, problems, warnings and checks."""
    yield f"## lidarcli report: {_text(report.title)}"
    yield ""
    for kind, problem in report.named_problems:
        yield f"**{kind.capitalize()}:** {_text(problem)}\n"
    for warning in report.warnings:
        yield f"**Warning:** {_text(warning)}\n"
    if report.verdicts:
        rows = [
            ["passed" if one.holds else "**failed**", _text(Code(one.expression)), one.words] for one in report.verdicts
        ]
        yield from (f"**{report.judgement}.**", "", *_table(["", "check", "found"], rows, (2,)))


def _lines(block: Block) -> Iterator[str]:
    match block:
        case Table():
            yield from _table(block.head, [[*map(_text, row)] for row in block.rows], block.right)
        case Facts():
            yield from _table([name for name, _ in block.rows], [[_text(value) for _, value in block.rows]])
        case Shares():
            rows = [[_text(kind), f"{count:,}", share(count, block.total)] for kind, count in block.counts.items()]
            yield from _table([block.kind, block.unit, "share"], rows, (1, 2))
        case Bands():
            yield from _fenced(band_lines(block))
        case Drawing():
            yield from _fenced(block.lines)
        case Notes():
            yield from (f"- {''.join(map(_text, parts))}" for parts in block.lines)
            yield ""
        case Listing():
            for words, names in block.groups:
                yield f"- {_text(words)}"
                yield from (f"  - {_text(name)}" for name in names)
    if isinstance(block, Table) and block.more:
        yield from (block.more, "")
    if isinstance(block, Listing):
        yield from ([f"- {block.more}"] if block.more else [])
        yield ""


def _text(value: object) -> str:
    """Return text of a log with escapes where Markdown and HTML could read commands; `Code` as code.

    >>> _text("a|b <script> `x`"), _text(Code("a|b"))
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
