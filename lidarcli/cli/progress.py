"""Progress bars on stderr: only on a terminal, only for work that takes long, gone when it is done."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from lidarcli.cli.messages import Messages, one_line

if TYPE_CHECKING:
    from rich.progress import ProgressColumn

    from lidarcli.pipeline.inputs.sources import Nothing, Source

PATIENCE = 0.5
"""Work shorter than this [s] shows no bar: one that comes and goes at once only disturbs."""
LONGEST_NAME = 18
"""Characters of a name in front of a bar, of the 80 of a line."""


class Count(Protocol):
    """What work calls with the number of things done, and of all things once that is known."""

    def __call__(self, done: int, total: int | None = None, /) -> None: ...


@contextmanager
def progress_bar(
    sources: Sequence[Source | Nothing], say: Messages
) -> Iterator[Callable[[Source, int], None] | None]:
    """A bar by bytes read: yields what the pipeline calls with a log and the position in it, None where nobody looks."""
    if not _is_seen(say):
        yield None
        return
    from rich.progress import DownloadColumn, TransferSpeedColumn

    from lidarcli.pipeline.inputs.sources import Source

    sizes = {source: source.size for source in sources if isinstance(source, Source)}
    total = sum(sizes.values()) if all(sizes.values()) else None
    read: dict[Source, int] = {}
    with _bar("", total, (DownloadColumn(), TransferSpeedColumn()), say) as show:

        def report(source: Source, position: int) -> None:
            read[source] = position
            show(sum(read.values()), total, source.name)

        yield report


@contextmanager
def counted_bar(description: str, total: int | None, unit: str, say: Messages) -> Iterator[Count | None]:
    """A bar by things done, such as sweeps: yields what the work calls with their number, None where nobody looks.

    Parameters
    ----------
    description : what is worked on
    total : number of all things, None where the work will tell
    unit : what is counted, in the plural
    """
    if not _is_seen(say):
        yield None
        return
    from rich.progress import MofNCompleteColumn, ProgressColumn, Task
    from rich.text import Text

    class Speed(ProgressColumn):
        """Things per second."""

        def render(self, task: Task) -> Text:
            if not task.speed:
                return Text(unit)
            return Text(f"{task.speed:,.{0 if task.speed >= 10 else 1}f} {unit}/s")

    with _bar(description, total, (MofNCompleteColumn(), Speed()), say) as show:
        known = total

        def report(done: int, total: int | None = None, /) -> None:
            nonlocal known
            known = known if total is None else total
            show(done, known, description)

        yield report


def _is_seen(say: Messages) -> bool:
    """Whether somebody looks at a terminal that can take a line back."""
    on_terminal = sys.stderr is not None and sys.stderr.isatty()
    return on_terminal and not say.quiet and os.environ.get("TERM") != "dumb"


@contextmanager
def _bar(
    description: str, total: int | None, columns: Sequence[ProgressColumn], say: Messages
) -> Iterator[Callable[[int, int | None, str], None]]:
    """A bar that comes up after `PATIENCE`: yields what is called with things done, of how many, and the name beside it."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=10),
        TaskProgressColumn(text_format_no_percentage=""),
        *columns,
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        transient=True,
    )
    task = bar.add_task(_short(description), total=total)
    begun = time.monotonic()
    quiet_write = say.write

    def show(done: int, total: int | None, name: str) -> None:
        bar.update(task, completed=done, total=total, description=_short(name))
        if say.bar is None and time.monotonic() - begun >= PATIENCE:
            say.write = lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True)
            say.bar = bar
            bar.start()

    try:
        yield show
    finally:
        if say.bar is bar:
            bar.stop()
        say.write, say.bar = quiet_write, None


def _short(name: str) -> str:
    """A name that leaves room for the bar: its end, which tells logs apart.

    >>> _short("2026-01-31/robot-7/run.mcap")
    '...obot-7/run.mcap'
    """
    line = one_line(name)
    return line if len(line) <= LONGEST_NAME else f"...{line[3 - LONGEST_NAME :]}"
