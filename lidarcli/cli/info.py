"""`lidarcli info`: what is in a log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from lidarcli.cli.grouped import OUTPUT, GroupedCommand, option
from lidarcli.cli.many_logs import Chosen, many_logs, print_reads
from lidarcli.cli.messages import Messages
from lidarcli.cli.options import opening_options, pose_options, range_options, text_or_json

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli info run.mcap
  lidarcli info bags/ --brief
  lidarcli info bags/ --format json | jq '.[].scans[].rate'
  lidarcli info ranges.csv --fov 270 --degrees --range-unit mm""",
)
@many_logs
@text_or_json("Text for people, or JSON for programs: a list with one object per log.")
@option(
    "--brief",
    heading=OUTPUT,
    is_flag=True,
    help="One line per log: format, time span, and each topic with its sweeps, beams and rate.",
)
@pose_options(delay=False)
@range_options
@opening_options
@click.pass_obj
def info(
    say: Messages,
    /,
    chosen: Chosen,
    dry_run: bool,
    kind: str,
    brief: bool,
    poses: PoseOptions,
    rules: RangeRules,
    opening: OpenOptions,
) -> int:
    """Show what is in a log: topics, sweeps, geometry, time, poses, damage.

    Reads every log from end to end.
    """
    if brief and kind != "text":
        raise click.UsageError(f"--brief is for text; leave it out for {kind}")

    from lidarcli.cli.info_text import as_json, as_line, as_text
    from lidarcli.cli.progress import progress_bar
    from lidarcli.errors import NoScanError
    from lidarcli.logs.options import clouds_hint, no_scan_topic
    from lidarcli.pipeline.inspecting import LogInfo, inspect_logs
    from lidarcli.pipeline.runs.over_logs import Failure, exit_code

    sources = chosen.sources()
    if dry_run:
        return print_reads(sources)
    found: list[LogInfo] = []
    codes = []
    with progress_bar(sources, say) as report:
        for source, result in inspect_logs(sources, opening, rules, poses, report):
            codes.append(result.exit_code)
            if isinstance(result, Failure):
                if result.trace:
                    say.bug(result.trace)
                say.error(source.label, result.error)
                continue
            for line in result.damage:
                say.error(source.label, line)
            if result.exit_code == NoScanError.exit_code:
                say.error(source.label, no_scan_topic() + clouds_hint(result.topics))
            found.append(result)
            if kind == "text":
                with say.paused():
                    between = "\n" if len(found) > 1 else ""
                    click.echo(as_line(result) if brief else between + as_text(result))
    if kind == "json":
        click.echo(as_json(found))
    return exit_code(codes)
