"""`lidarcli diff`: what changed from run to run."""

import json
from typing import Annotated

import click

from lidarcli.cli.commands import command, log_options, usage_errors
from lidarcli.cli.messages import Messages, progress_bar
from lidarcli.display import no_command
from lidarcli.option_forms import Argument, File, Option, Text
from lidarcli.options import GATES, Diffing, Overwrite, TextOrJson, output
from lidarcli.screen import one_line
from lidarcli.stores import place


class DiffCommand(Overwrite, TextOrJson, Diffing, total=False):
    """Options of `diff`."""

    runs: Annotated[tuple[str, ...], Argument("RUN...", File("RUN"), several=True)]
    output: Annotated[
        tuple[str, ...],
        output("FILE", shown="none", several=True),
        "File to write; may be repeated: .parquet or .csv (table of changes), .png (picture).",
    ]
    check: Annotated[
        tuple[str, ...],
        Option(GATES, Text("EXPR", has_blanks=True), (), shown="none", several=True),
        "Condition that must hold, else the exit code is 1; may be repeated: gone == 0 (docs/diff.md).",
    ]


@command(
    DiffCommand,
    examples="""\
  lidarcli diff monday.mcap tuesday.mcap -o changes.parquet -o changes.png
  lidarcli diff site.yaml today.mcap --check "gone == 0" --check "new <= 2"
  lidarcli diff monday.tracks.parquet tuesday.tracks.parquet -o changes.csv
  lidarcli diff empty.background.parquet today.bag --align as-is
  lidarcli diff monday.bag tuesday.bag wednesday.bag --min-score 0.95
  lidarcli diff truth.map.yaml room.yaml --format json""",
)
def diff(messages: Messages, options: DiffCommand) -> int:
    """Find what changed from run to run: moved, new, gone.

    RUN is a log, a tracks table of `lidarcli track`, a background, or a map (.yaml of
    map_server). Each is compared with the last one before it that saw the place.
    Only what was in view can have gone: the rest is uncertain, with the reason.
    """
    logs = log_options(options)

    from lidarcli.errors import CHECK_FAILED, UnreadableError
    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.api.options import diff_options
    from lidarcli.pipeline.differing import diff_inputs, inputs_of, judged, parse_checks, refuse_outputs, write_changes

    outputs = [place(each) for each in options["output"]]
    with usage_errors():
        parsed = diff_options(options, logs, overwrite=options["overwrite"])
        checks = parse_checks(options["check"])
        inputs = inputs_of(options["runs"])
        refuse_outputs(outputs, inputs, parsed)
    keep_freed_memory()
    messages.of_missing_core()
    with progress_bar([one.source for one in inputs if one.source is not None], messages) as report:
        found = diff_inputs(inputs, parsed, report)
    if options["format"] == "json":
        click.echo(json.dumps(found.as_dict(), indent=2))
    else:
        for line in found.lines:
            click.echo(no_command(one_line(line)))
    for line in found.damage:
        messages.error(line)
    messages.notes([*found.notes, *write_changes(found, outputs, options["overwrite"])])
    messages.wrote(outputs)
    verdicts = judged(found, checks)
    for verdict in verdicts:
        if not verdict.holds:
            messages.error(f"check failed: {verdict.failure}")
    if not all(verdict.holds for verdict in verdicts):
        return CHECK_FAILED
    return UnreadableError.exit_code if found.damage else 0
