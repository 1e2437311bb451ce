"""`lidarcli export`: tables that are there, in another format."""

from __future__ import annotations

from typing import Any

import click

from lidarcli.cli.detecting import FILES
from lidarcli.cli.grouped import OUTPUT, GroupedCommand, option
from lidarcli.cli.messages import Messages, standard_output
from lidarcli.cli.options import STDOUT
from lidarcli.stores.url import place


class Columns(click.ParamType):  # type: ignore[type-arg]
    """Names of columns, comma separated."""

    name = "list"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The names."""
        if not isinstance(value, str):
            return value
        return tuple(name for part in value.split(",") if (name := part.strip()))


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli export run.objects.parquet -o run.csv
  lidarcli export run.tracks.parquet -o - --columns track,set,speed_mean
  lidarcli export 'tables/*.objects.parquet' -o all.ndjson --overwrite
  lidarcli export run.beams.parquet -o - --format arrow > beams.arrow""",
)
@click.argument("tables", metavar="TABLE...", nargs=-1, required=True, type=click.Path())
@option(
    "-o",
    "--output",
    heading=OUTPUT,
    metavar="FILE",
    required=True,
    type=click.Path(allow_dash=True),
    help="File to write: .csv, .ndjson, .arrow or .parquet; - for standard output.",
)
@option(
    "--format",
    "kind",
    heading=OUTPUT,
    type=click.Choice(["csv", "ndjson", "arrow", "parquet"]),
    help="Format of the stream of -o -.  [default: csv]",
)
@option(
    "--columns",
    heading=OUTPUT,
    metavar="LIST",
    type=Columns(),
    default="",
    help="Columns to write, comma separated, in this order.  [default: all]",
)
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace a file that exists.")
@click.pass_obj
def export(
    say: Messages,
    /,
    tables: tuple[str, ...],
    output: str,
    kind: str | None,
    columns: tuple[str, ...],
    overwrite: bool,
) -> int:
    """Write tables as CSV, NDJSON, Arrow or Parquet.

    TABLE is any Parquet table that lidarcli wrote, a folder to search, or a
    pattern. Several tables of one kind are written one after the other.
    """
    if output != STDOUT and kind is not None:
        raise click.UsageError("--format is for the stream of -o -; a file has the format of its suffix")
    form = (kind or "csv") if output == STDOUT else FILES.get(place(output).suffix.lower())
    if form is None:
        raise click.BadParameter(f"'{output}' is none of {', '.join(FILES)}.", param_hint="'--output'")

    from lidarcli.pipeline.exporting import chosen, export_file, export_stream

    wanted = chosen(tables, columns)
    for problem in wanted.problems:
        say.error(str(problem))
    if output == STDOUT:
        _, notes = export_stream(wanted, standard_output().buffer, form)
    else:
        rows, notes = export_file(wanted, place(output), form, overwrite)
    for note in notes:
        say.info(f"  note     {note}")
    if output != STDOUT:
        say.info(f"  wrote    {output} ({rows:,} rows)")
    return wanted.problems[0].exit_code if wanted.problems else 0
