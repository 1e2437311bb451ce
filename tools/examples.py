"""The examples in the Markdown pages: run them, compare what they print, write it anew.

A fenced block whose info string names a file (` ```toml room.toml `) is that file. A `console` block holds
commands after `$ ` (and `> `) and what they print, where `...` stands for any text. A `sh` block holds commands to
run, output aside.
"""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FENCE = re.compile(
    r"^```(?P<language>[a-z]+)(?: (?P<file>\S+))?\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
COMMAND = re.compile(
    r"^\$ (?P<command>[^\n]*(?:\n> [^\n]*)*)\n(?P<output>(?:(?!\$ )[^\n]*\n)*)", re.MULTILINE
)
ENVIRONMENT = {"COLUMNS": "80", "LC_ALL": "C.UTF-8", "TZ": "UTC"}
SECONDS = 120
VOLATILE = re.compile(r"(?<=, )[\d,]+(?= sweeps/s)|(?<=  size        )[\d,]+(?= bytes)")
"""What differs from machine to machine: pages have `...` there."""


@dataclass(frozen=True, slots=True)
class Example:
    """A command of a page, what the page says it prints (None where it does not say), and where that stands."""

    command: str
    want: str | None
    span: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Done:
    """An example that has run."""

    example: Example
    code: int
    got: str

    @property
    def holds(self) -> bool:
        """Whether it succeeded and printed what the page says."""
        want = self.example.want
        same = want is None or doctest.OutputChecker().check_output(want, self.got, doctest.ELLIPSIS)
        return same and self.code == 0


def examples(markdown: str) -> Iterator[Example | tuple[str, str]]:
    """The examples of a page in order, and the files between them as (name, text)."""
    for fence in FENCE.finditer(markdown):
        body, start = fence["body"], fence.start("body")
        if fence["file"]:
            yield fence["file"], body
        elif fence["language"] == "console":
            for match in COMMAND.finditer(body):
                span = start + match.start("output"), start + match.end("output")
                yield Example(match["command"].replace("\n> ", "\n"), match["output"], span)
        elif fence["language"] == "sh":
            yield Example("set -e\n" + body, None, fence.span())


def run(markdown: str, folder: Path) -> Iterator[Done]:
    """Run the examples of a page in `folder`."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for item in examples(markdown):
        if isinstance(item, tuple):
            (folder / item[0]).write_text(item[1], encoding="utf-8")
            continue
        done = subprocess.run(
            ["bash", "-c", item.command],
            cwd=folder,
            env={**os.environ, **ENVIRONMENT, "PATH": path},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=SECONDS,
            check=False,
        )
        yield Done(item, done.returncode, done.stdout)


def renewed(markdown: str, folder: Path) -> str:
    """The page with what its examples print today; what still holds stays as it is."""
    stale = [done for done in run(markdown, folder) if not done.holds]
    for done in stale:
        if done.code:
            raise SystemExit(f"{done.example.command}\nexit code {done.code}\n{done.got}")
    for done in reversed(stale):
        start, end = done.example.span
        markdown = markdown[:start] + VOLATILE.sub("...", done.got) + markdown[end:]
    return markdown
