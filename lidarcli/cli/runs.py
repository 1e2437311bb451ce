"""Runs over many logs: which ones, and their tables below a folder, or their objects as one stream or file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from lidarcli.cli.messages import Messages
from lidarcli.options import STDOUT
from lidarcli.screen import one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from lidarcli.pipeline.inputs.sources import MissingInput, Source

    Report = Callable[[Source, int], None] | None


def refuse_no_logs(options: Mapping[str, Any]) -> None:
    """Refuse `ManyLogs` that name no log, or standard input twice (usage errors)."""
    logs, files_from = options["logs"], options["files_from"]
    if not logs and files_from is None:
        raise click.MissingParameter(param_hint="'LOG...'", param_type="argument")
    if STDOUT in logs and files_from == STDOUT:
        raise click.UsageError("standard input is either a log or the list of --files-from")


def chosen_logs(messages: Messages, options: Mapping[str, Any]) -> list[Source | MissingInput]:
    """Return the logs that `ManyLogs` names, with notes on those in parts; see `search.choose`."""
    from lidarcli.pipeline.inputs.search import choose

    return choose(options["logs"], options["files_from"], options["base"], options["shard"], options["join"], messages.note)


def print_reads(sources: Iterable[Source | MissingInput], writes: Iterable[str] = ()) -> int:
    """Print what would be read and written, a line each; return the exit code."""
    from lidarcli.pipeline.runs.over_logs import exit_code

    code = exit_code([print_read(source) for source in sources])
    for output in writes:
        click.echo(f"write  {one_line(output)}")
    return code


def print_read(source: Source | MissingInput, verb: str = "read") -> int:
    """Print what would be done with one log; the exit code of that."""
    from lidarcli.pipeline.inputs.sources import MissingInput

    if isinstance(source, MissingInput):
        click.echo(f"fail   {one_line(f'{source.label}: {source.error}')}")
        return source.error.exit_code
    size = f" ({source.size:,} bytes)" if source.size else ""
    click.echo(f"{verb:6} {one_line(source.label)}{size}")
    return 0
