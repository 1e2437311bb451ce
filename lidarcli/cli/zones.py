"""`lidarcli zones`: who or what was in a zone, when, and how near."""

from typing import Annotated

import click

from lidarcli.cli.commands import command, log_options, usage_errors
from lidarcli.cli.messages import Messages, Total, chosen_logs, print_reads, progress_bar, show
from lidarcli.display import counted
from lidarcli.option_forms import Option, Text
from lidarcli.options import GATES, STDOUT, ZONE_RULES, ManyLogs, Reported, Zoning, output
from lidarcli.stores import place


class ZonesCommand(Zoning, ManyLogs, Reported, total=False):
    """Options of `zones`."""

    output: Annotated[
        str | None,
        output("DIR", shown="none, nothing is written"),
        "Folder for the tables <log>.events.parquet and <log>.zones.parquet.",
    ]
    check: Annotated[
        tuple[str, ...],
        Option(GATES, Text("EXPR", has_blanks=True), (), shown="none", several=True),
        "Condition that must hold, else the exit code is 1; may be repeated: zones.NAME.events == 0 (docs/zones.md).",
    ]


@command(
    ZonesCommand,
    examples="""\
  lidarcli zones run.mcap --zones nav2.yaml -o tables
  lidarcli zones run.mcap --zones zones.toml --check "zones.stop.events == 0"
  lidarcli zones run.mcap --zones doors.toml --check "zones.door.in >= 30"
  lidarcli zones run.bag --zones zones.toml --mask robot.toml --no-objects
  lidarcli zones run.bag --zones zones.toml --objects run.objects.parquet
  lidarcli zones run.db3 --zones nav2.yaml \\
    --footprint '[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]]'""",
    rules=ZONE_RULES,
)
def zones(messages: Messages, options: ZonesCommand) -> int:
    """Find who or what was in a zone, when, and how near.

    Zones are polygons, circles and lines in the frame of the sensor, the robot or the
    world, of a TOML file or of Nav2's Collision Monitor, whose rules they follow. All
    valid beams count by default: a wall that is too near is an event, too.
    An offline check of a recording, no safety function.
    """
    if options["output"] == STDOUT:
        raise click.UsageError("-o is the name of a folder; there is no standard output of tables")
    logs = log_options(options)

    from lidarcli.errors import CHECK_FAILED, UnreadableError
    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.api.options import zone_options
    from lidarcli.pipeline.zoning import ZoneSummary, judge, refuse_outputs, understand, watch_files

    with usage_errors():
        zoning = zone_options(options, logs, overwrite=options["overwrite"])
        checks = understand(zoning, options["check"])
    messages.begin(options)
    sources = chosen_logs(messages, options)
    if zoning.objects is not None and len(sources) != 1:
        raise click.UsageError(f"--objects is for one log, and these are {len(sources):,}")
    folder = None if options["output"] is None else place(options["output"])
    outputs = refuse_outputs(sources, folder, zoning)
    if options["dry_run"]:
        return print_reads(sources, outputs)
    keep_freed_memory()
    messages.of_missing_core()
    total = Total()
    failed, tables = False, []

    def lines_of(run: ZoneSummary) -> list[str]:
        where = f"{counted(run.sweeps, 'sweep')} of {', '.join(sorted(run.topics))}"
        return [f"{where}, {counted(len(zoning.zones.zones), 'zone')}", *(f"  {line}" for line in run.lines)]

    with progress_bar(sources, messages) as report:
        for outcome in watch_files(sources, folder, zoning, report):
            total.add(outcome)
            show(outcome, messages, lines_of)
            if isinstance(outcome.summary, ZoneSummary):
                tables += [outcome.summary.tables] if checks else []
            else:
                failed = True
    verdicts, unobserved = ([], ()) if failed else judge(checks, tables)
    for line in unobserved:
        messages.error("incomplete", line)
    for verdict in verdicts:
        if not verdict.holds:
            messages.error(f"check failed: {verdict.failure}")
    code = total.exit_code(sources) or (UnreadableError.exit_code if unobserved else 0)
    if not all(verdict.holds for verdict in verdicts):
        code = CHECK_FAILED
    return messages.end(code, checks=[verdict.as_dict() for verdict in verdicts])
