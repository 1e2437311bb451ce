"""A progress bar by things done, such as frames, on stderr and only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from lidarcli.cli.messages import Messages, one_line


@contextmanager
def counted_bar(
    description: str, total: int, unit: str, say: Messages
) -> Iterator[Callable[[int], None] | None]:
    """Yields what takes how many of `total` are done, or None when nobody would see it.

    Shows the description, the share done, the rate as `unit`/s, and the time that is left.
    """
    if say.quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.completed:,}/{task.total:,} {task.fields[unit]}", markup=False),
        TextColumn("{task.fields[rate]}", markup=False),
        TextColumn("left"),
        TimeRemainingColumn(compact=True),
    )
    console = Console(stderr=True)
    quiet_write = say.write
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(one_line(description), total=total, unit=unit, rate="")
        say.write = lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True)
        say.bar = bar

        def report(done: int) -> None:
            speed = bar.tasks[task].speed
            bar.update(task, completed=done, rate="" if speed is None else f"{speed:,.1f} {unit}/s")

        try:
            yield report
        finally:
            say.write, say.bar = quiet_write, None
