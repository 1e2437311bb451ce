"""Standard error as a screen: text that stays on its line, and progress bars, for commands and for Python."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from lidarcli.display.credentials import blotted
from lidarcli.display.texts import visible
from lidarcli.system.records import dataclass, field

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

LONGEST_LINE = 1000
"""A longer line [characters] loses its middle: a log may hold names of any length."""


def one_line(text: str) -> str:
    """A visible text of at most `LONGEST_LINE`, without credentials that somebody has typed into a URL."""
    text = blotted(text)
    if not text.isprintable():
        text = visible(text[:LONGEST_LINE])
    return text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE // 2]} ... {text[-LONGEST_LINE // 4 :]}"


@dataclass(slots=True)
class Screen:
    """Standard error, with a bar below the lines."""

    write: Callable[[str], None] = field(default=lambda line: print(line, file=sys.stderr))
    """Takes one line; a progress bar puts its own in here while it is on the screen."""
    bar: Progress | None = None
    """The progress bar on the screen, which can be taken off it and put back."""


# Progress bars: only for work that takes long, gone when it is done.

PATIENCE = 0.5
"""Work shorter than this [s] shows no bar: one that comes and goes at once only disturbs."""
LONGEST_NAME = 18
"""Characters of a name in front of a bar, of the 80 of a line."""


class Count(Protocol):
    """A function that takes the number of things done, and of all things once that is known."""

    def __call__(self, done: int, total: int | None = None, /) -> None: ...


@contextmanager
def byte_bar(screen: Screen) -> Iterator[Callable[[int, int | None, str], None]]:
    """A bar by bytes read: yields what is called with their number, that of all, and the name of what is read."""
    from rich.progress import DownloadColumn, TransferSpeedColumn

    with _bar("", None, (DownloadColumn(), TransferSpeedColumn()), screen) as show:
        yield show


@contextmanager
def count_bar(description: str, total: int | None, unit: str, screen: Screen) -> Iterator[Count]:
    """A bar by things done, such as sweeps: yields what the work calls with their number.

    `description` names what is worked on, `total` is the number of all things, None until the work reports it, and `unit`
    what is counted, in the plural.
    """
    from rich.progress import MofNCompleteColumn, ProgressColumn, Task
    from rich.text import Text

    class Speed(ProgressColumn):
        """Things per second."""

        def render(self, task: Task) -> Text:
            if not task.speed:
                return Text(unit)
            return Text(f"{task.speed:,.{0 if task.speed >= 10 else 1}f} {unit}/s")

    with _bar(description, total, (MofNCompleteColumn(), Speed()), screen) as show:
        # Without a new one the bar keeps the total that it has.
        yield lambda done, total=None, /: show(done, total, description)


@contextmanager
def _bar(
    description: str, total: int | None, columns: Sequence[ProgressColumn], screen: Screen
) -> Iterator[Callable[[int, int | None, str], None]]:
    """A bar that comes up after `PATIENCE`: yields what is called with things done, of how many, and their name."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, Task, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Left(TimeRemainingColumn):
        """Time that is left, once it is known."""

        def render(self, task: Task) -> Text:
            return Text() if task.time_remaining is None else super().render(task).append(" left")

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=10),
        TaskProgressColumn(text_format_no_percentage=""),
        *columns,
        Left(),
        console=console,
        transient=True,
    )
    task = bar.add_task(_short(description), total=total)
    begun = time.monotonic()
    quiet_write = screen.write

    def show(done: int, total: int | None, name: str) -> None:
        bar.update(task, completed=done, total=total, description=_short(name))
        if screen.bar is None and time.monotonic() - begun >= PATIENCE:
            screen.write = lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True)
            screen.bar = bar
            bar.start()

    try:
        yield show
    finally:
        if screen.bar is bar:
            bar.stop()
        screen.write, screen.bar = quiet_write, None


def _short(name: str) -> str:
    """A name that leaves room for the bar: its end, by which logs differ.

    >>> _short("2026-01-31/robot-7/run.mcap")
    '...obot-7/run.mcap'
    """
    line = one_line(name)
    return line if len(line) <= LONGEST_NAME else f"...{line[3 - LONGEST_NAME :]}"
