"""`lidarcli match`: the same standing things in several runs."""

from __future__ import annotations

import click

from lidarcli.choices import MATCH_BY
from lidarcli.cli.detecting import FILES
from lidarcli.cli.grouped import OUTPUT, GroupedCommand, option
from lidarcli.cli.messages import Messages
from lidarcli.stores.url import place


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli match mon.tracks.parquet tue.tracks.parquet -o things.parquet
  lidarcli match tables/ -o things.csv --overwrite
  lidarcli match lap?.tracks.parquet --by constellation -o things.parquet""",
)
@click.argument("tracks", metavar="TRACKS...", nargs=-1, required=True, type=click.Path())
@option(
    "-o",
    "--output",
    heading=OUTPUT,
    metavar="FILE",
    required=True,
    type=click.Path(),
    help="File to write: .parquet, .csv, .ndjson or .arrow.",
)
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace a file that exists.")
@option(
    "--by",
    heading="Places",
    type=click.Choice(MATCH_BY),
    default=MATCH_BY[-1],
    show_default=True,
    help="Take places as they are, or align runs by the arrangement of their objects; "
    "auto: as they are where the poses of all runs are in one world frame that is no odometry.",
)
@click.pass_obj
def match(say: Messages, /, tracks: tuple[str, ...], output: str, overwrite: bool, by: str) -> int:
    """Match stationary objects across runs, and report which moved.

    TRACKS is a tracks table of `lidarcli track`, a folder to search, or a pattern;
    runs are taken in this order. Writes one row for each thing and run that has it,
    with how far it was moved since the run before.
    """
    kind = FILES.get(place(output).suffix.lower())
    if kind is None:
        raise click.BadParameter(f"'{output}' is none of {', '.join(FILES)}.", param_hint="'--output'")

    from lidarcli.pipeline.matching import match_tables, refuse_matches, write_matches

    path = place(output)
    refuse_matches(path, tracks, overwrite)
    result = match_tables(tracks, by)
    for run in result.runs:
        say.info(run.words)
    notes = [*result.notes, *write_matches(result, path, kind, overwrite)]
    for note in notes:
        say.info(f"  note     {note}")
    say.info(f"  wrote    {path}")
    return 0
