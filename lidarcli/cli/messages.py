"""Words for the user on stderr, one line per message; stdout carries data only."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Protocol, TextIO

import click

from lidarcli import compiled
from lidarcli.errors import OutputError
from lidarcli.stores.url import blotted


def _to_stderr(line: str) -> None:
    click.echo(line, err=True)


def standard_output() -> TextIO:
    """Where data goes; refused where it was closed."""
    if sys.stdout is None:
        raise OutputError("cannot write standard output: it is closed")
    return sys.stdout


def are_shown_together() -> bool:
    """Whether standard output and standard error go to the same place, such as a terminal: one of them is enough."""
    try:
        out, err = (os.fstat(stream.fileno()) for stream in (sys.stdout, sys.stderr))
    except (AttributeError, OSError, ValueError):
        return False
    return (out.st_dev, out.st_ino) == (err.st_dev, err.st_ino)


def coloured(stream: TextIO) -> bool:
    """Whether to colour what goes there: FORCE_COLOR says yes, NO_COLOR or TERM=dumb no, else a terminal is.

    Errors are plain everywhere: they are read by programs as well.
    """
    if os.environ.get("FORCE_COLOR"):
        return True
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return stream.isatty()


LONGEST_LINE = 1000
"""A longer line [characters] loses its middle: a log may hold names of any length."""


def one_line(text: str) -> str:
    r"""Text from a log or a file name, with escapes for what would break the line or steer the terminal.

    Credentials that somebody has typed into a URL are left out.

    >>> one_line("/scan\n\x1b[2J °")
    '/scan\\n\\x1b[2J °'
    """
    text = blotted(text)
    if not text.isprintable():
        text = "".join(char if char.isprintable() else repr(char)[1:-1] for char in text[:LONGEST_LINE])
    return (
        text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE // 2]} ... {text[-LONGEST_LINE // 4 :]}"
    )


class Bar(Protocol):
    """What can be taken off the screen and put back."""

    def stop(self) -> None: ...

    def start(self) -> None: ...


@dataclass(slots=True)
class Messages:
    """Writes to stderr as loudly as the user wants it."""

    quiet: bool = False
    verbose: bool = False
    write: Callable[[str], None] = field(default=_to_stderr)
    """Takes one line; a progress bar puts its own in here while it is on the screen."""

    bar: Bar | None = None
    """The progress bar on the screen."""

    def error(self, *parts: str) -> None:
        """`lidarcli: run.mcap: what is wrong`, always shown."""
        self.write(one_line(": ".join(["lidarcli", *parts])))

    def info(self, line: str) -> None:
        """A line of a summary."""
        if not self.quiet:
            self.write(one_line(line))

    def of_missing_core(self) -> None:
        """Why a detection takes so long, and how to mend it; not to those who asked for it."""
        if compiled.is_wanted() and not compiled.is_there():
            self.info(f"lidarcli: {compiled.MISSING}")

    def detail(self, line: str) -> None:
        """What only some want to know."""
        if self.verbose:
            self.write(one_line(line))

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Take the progress bar, if there is one, off the screen while stdout is written to."""
        if self.bar is None:
            yield
            return
        self.bar.stop()
        try:
            yield
        finally:
            self.bar.start()

    def bug(self, trace: str) -> None:
        """The traceback of a bug, and the request to report it."""
        self.write(trace.rstrip())
        self.write("lidarcli: this is a bug in lidarcli; please report it with the lines above")
