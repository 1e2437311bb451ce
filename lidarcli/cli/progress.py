"""A progress bar by bytes read, on stderr and only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from lidarcli.cli.messages import Messages, one_line

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Nothing, Source


@contextmanager
def progress_bar(
    sources: Sequence[Source | Nothing], say: Messages
) -> Iterator[Callable[[Source, int], None] | None]:
    """Yields what the pipeline calls with a log and the position in it, or None when nobody would see it."""
    if say.quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    from lidarcli.pipeline.inputs.sources import Source

    sizes = {source: source.size for source in sources if isinstance(source, Source)}
    total = sum(sizes.values()) if all(sizes.values()) else None
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    quiet_write = say.write
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)
        say.write = lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True)
        say.bar = bar
        done: dict[Source, int] = {}

        def report(source: Source, position: int) -> None:
            done[source] = position
            bar.update(task, completed=sum(done.values()), description=one_line(source.name))

        try:
            yield report
        finally:
            say.write, say.bar = quiet_write, None
