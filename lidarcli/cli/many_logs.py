"""Options of commands that take many logs: which ones, one share of them, and what would be done."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from lidarcli.cli.grouped import F, option
from lidarcli.cli.options import INPUTS, gathered

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Nothing, Source

MANY = "Many logs"
MOST_SHARDS = 1_000_000


class Shard(click.ParamType):  # type: ignore[type-arg]
    """`I/N`: the I-th of N shares."""

    name = "share"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """(I, N), or a usage error."""
        if isinstance(value, tuple):
            return value
        number, _, count = str(value).partition("/")
        if not (number.isdecimal() and count.isdecimal()):
            self.fail(f"'{value}' is not I/N, as 1/8.", param, ctx)
        if not 1 <= int(number) <= int(count) <= MOST_SHARDS:
            self.fail(f"'{value}': shares are numbered from 1 to {count}.", param, ctx)
        return int(number), int(count)


@dataclass(frozen=True, slots=True)
class Chosen:
    """The logs of a command, as they were named."""

    logs: tuple[str, ...]
    files_from: str | None
    base: str | None
    shard: tuple[int, int] | None

    def sources(self) -> list[Source | Nothing]:
        """The logs; see `search.choose`."""
        from lidarcli.pipeline.inputs.search import choose

        return choose(self.logs, self.files_from, self.base, self.shard)


def _chosen(
    logs: tuple[str, ...], files_from: str | None, base: str | None, shard: tuple[int, int] | None
) -> Chosen:
    if not logs and files_from is None:
        raise click.MissingParameter(param_hint="'LOG...'", param_type="argument")
    if "-" in logs and files_from == "-":
        raise click.UsageError("standard input is either a log or the list of --files-from")
    return Chosen(logs, files_from, base, shard)


def many_logs(command: F) -> F:
    """LOG..., and what says more about which logs are meant: the command gets `chosen` and `dry_run`."""
    command = gathered(command, "chosen", _chosen)
    for decorate in (
        option(
            "--dry-run",
            heading=MANY,
            is_flag=True,
            help="Only print what would be read and written.",
        ),
        option(
            "--shard",
            heading=MANY,
            metavar="I/N",
            type=Shard(),
            help="Process only the I-th of N shares of the logs. The name of a log alone decides which share it is in.  "
            "[default: all]",
        ),
        option(
            "--base",
            heading=MANY,
            metavar="DIR",
            type=click.Path(),
            help="Mirror the sub-folders of this folder or URL below DIR.  [default: the folder or pattern that was given]",
        ),
        option(
            "--files-from",
            heading=MANY,
            metavar="FILE",
            type=click.Path(allow_dash=True),
            help="Also read the logs that this file lists, one per line; - for standard input.  [default: none]",
        ),
    ):
        command = decorate(command)
    return click.argument("logs", metavar="LOG...", nargs=-1, type=INPUTS)(command)


def print_reads(sources: Iterable[Source | Nothing]) -> int:
    """Print what would be read, a line each; the exit code."""
    from lidarcli.pipeline.runs.over_logs import exit_code

    return exit_code([print_read(source) for source in sources])


def print_read(source: Source | Nothing, verb: str = "read") -> int:
    """Print what would be done with one log; the exit code of that."""
    from lidarcli.cli.messages import one_line
    from lidarcli.pipeline.inputs.sources import Nothing

    if isinstance(source, Nothing):
        click.echo(f"fail   {one_line(f'{source.label}: {source.error}')}")
        return source.error.exit_code
    size = f" ({source.size:,} bytes)" if source.size else ""
    click.echo(f"{verb:6} {one_line(source.label)}{size}")
    return 0
