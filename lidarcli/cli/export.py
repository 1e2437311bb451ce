"""`lidarcli export`: tables that are there, in another format."""

from typing import Annotated

import click

from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, standard_output
from lidarcli.option_forms import Argument, File, Option
from lidarcli.options import OUTPUT, STDOUT, Exporting, Overwrite, output
from lidarcli.stores import place


class ExportCommand(Overwrite, Exporting, total=False):
    """Options of `export`."""

    tables: Annotated[tuple[str, ...], Argument("TABLE...", File("TABLE"), several=True)]
    output: Annotated[str, output("FILE"), "File to write: .csv, .ndjson, .arrow or .parquet; - for standard output."]
    format: Annotated[
        str | None, Option(OUTPUT, ("csv", "ndjson", "arrow", "parquet"), shown="csv"), "Format of the stream of -o -."
    ]


@command(
    ExportCommand,
    examples="""\
  lidarcli export run.objects.parquet -o run.csv
  lidarcli export run.tracks.parquet -o - --columns track,set,speed_mean
  lidarcli export 'tables/*.objects.parquet' -o all.ndjson --overwrite
  lidarcli export run.beams.parquet -o - --format arrow > beams.arrow""",
)
def export(say: Messages, told: ExportCommand) -> int:
    """Write tables as CSV, NDJSON, Arrow or Parquet.

    TABLE is any Parquet table that lidarcli wrote, a folder to search, or a
    pattern. Several tables of one kind are written one after the other.
    """
    output, kind = told["output"], told["format"]
    if output != STDOUT and kind is not None:
        raise click.UsageError("--format is for the stream of -o -; a file has the format of its suffix")

    from lidarcli.pipeline.exporting import chosen, export_file, export_stream, format_of

    form = (kind or "csv") if output == STDOUT else format_of(place(output))
    wanted = chosen(told["tables"], [*told["columns"]], told["stamps"])
    for problem in wanted.problems:
        say.error(str(problem))
    if output == STDOUT:
        _, notes = export_stream(wanted, standard_output().buffer, form)
    else:
        rows, notes = export_file(wanted, place(output), form, told["overwrite"])
    say.notes(notes)
    if output != STDOUT:
        say.info(f"  wrote    {output} ({rows:,} rows)")
    return wanted.problems[0].exit_code if wanted.problems else 0
