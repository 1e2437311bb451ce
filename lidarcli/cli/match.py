"""`lidarcli match`: the same standing things in several runs."""

from typing import Annotated

import click

from lidarcli.choices import MATCH_BY
from lidarcli.cli.commands import command
from lidarcli.cli.detect import FILES
from lidarcli.cli.messages import Messages
from lidarcli.option_forms import Argument, File, Option
from lidarcli.options import Overwrite, output
from lidarcli.stores.url import place


class MatchCommand(Overwrite, total=False):
    """Options of `match`."""

    tracks: Annotated[tuple[str, ...], Argument("TRACKS...", File("TRACKS"), several=True)]
    output: Annotated[str, output("FILE"), "File to write: .parquet, .csv, .ndjson or .arrow."]
    by: Annotated[
        str,
        Option("Places", MATCH_BY, MATCH_BY[-1]),
        "Take places as they are, or align runs by the arrangement of their objects; auto: as they are if the poses of all "
        "runs are in one world frame that is no odometry.",
    ]


@command(
    MatchCommand,
    examples="""\
  lidarcli match mon.tracks.parquet tue.tracks.parquet -o things.parquet
  lidarcli match tables/ -o things.csv --overwrite
  lidarcli match lap?.tracks.parquet --by constellation -o things.parquet""",
)
def match(say: Messages, told: MatchCommand) -> int:
    """Match stationary objects across runs, and report which moved.

    TRACKS is a tracks table of `lidarcli track`, a folder to search, or a pattern;
    runs are taken in this order. Writes one row for each thing and run that has it,
    with how far it was moved since the run before.
    """
    kind = FILES.get(place(told["output"]).suffix.lower())
    if kind is None:
        raise click.BadParameter(
            f"'{told['output']}' is none of {', '.join(FILES)}.", param_hint="'--output'"
        )

    from lidarcli.pipeline.matching import match_tables, refuse_matches, write_matches

    tracks, path = told["tracks"], place(told["output"])
    refuse_matches(path, tracks, told["overwrite"])
    result = match_tables(tracks, told["by"])
    for run in result.runs:
        say.info(run.words)
    notes = [*result.notes, *write_matches(result, path, kind, told["overwrite"])]
    say.notes(notes)
    say.wrote([path])
    return 0
