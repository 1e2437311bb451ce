"""A terminal as a picture: what the README shows of a command whose result is text."""

from __future__ import annotations

import re
import textwrap
from html import escape
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"
COLUMNS = 84
WIDTH, LINE, MARGIN = 740, 20, 18
"""Pixels of the picture, of a line, and of the margin around all lines."""


def findings_picture() -> str:
    """docs/images/findings.svg: the first findings of the README."""
    (told,) = re.findall(
        r"^(\$ lidarcli info \S+ --deep.*?)^(?:\$ |```$)", README.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    return terminal_picture(re.sub(r" \| .*", "", told, count=1))


def terminal_picture(told: str) -> str:
    """Return text as an SVG of a terminal; commands are bold."""
    lines = [
        (part, line.startswith("$ "))
        for line in told.rstrip().splitlines()
        for part in textwrap.wrap(line, COLUMNS, subsequent_indent=" " * 13, replace_whitespace=False)
    ]
    height = 2 * MARGIN + LINE * len(lines)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}">',
            f'<rect x="1" y="1" width="{WIDTH - 2}" height="{height - 2}" rx="8" fill="#f6f8fa" stroke="#d0d7de"/>',
            '<g font-family="ui-monospace, Menlo, Consolas, DejaVu Sans Mono, monospace" font-size="14" fill="#1f2328">',
            *(
                f'<text x="{MARGIN}" y="{MARGIN + LINE * (number + 0.75):g}" xml:space="preserve" '
                f'font-weight="{700 if is_command else 400}">{escape(part, quote=False)}</text>'
                for number, (part, is_command) in enumerate(lines)
            ),
            "</g>",
            "</svg>",
            "",
        ]
    )
