"""`lidarcli background`: learn a scene, show what was learned, find what differs from it."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING

import click

from lidarcli.choices import IMAGES, STATION_DEGREES, STATION_DISTANCE
from lidarcli.cli.detect import detect
from lidarcli.cli.grouped import OUTPUT, Commands, GroupedCommand, option, own_parameters
from lidarcli.cli.many_logs import Chosen, many_logs, print_reads
from lidarcli.cli.messages import Messages, one_line
from lidarcli.cli.options import (
    Number,
    Selection,
    opening_options,
    range_options,
    reading_options,
    text_or_json,
)
from lidarcli.stores.url import place

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules

STATIONS = "Viewpoints (stations) of a moving sensor"


@click.group(cls=Commands)
def background() -> None:
    """Learn a scene without objects of interest, and find what differs from it.

    docs/background.md shows it at work.
    """


@background.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli background build empty.mcap -o empty.background.parquet
  lidarcli background build mon.bag tue.bag -o hall.parquet --plot hall.png
  lidarcli background build lap.mcap -o route.parquet --pose /odom \\
    --station-distance 0.5 --station-angle 10""",
)
@many_logs
@option(
    "-o",
    "--output",
    heading=OUTPUT,
    metavar="FILE",
    required=True,
    type=click.Path(),
    help="Background table to write (Parquet).",
)
@option(
    "--plot",
    "figure",
    is_output=True,
    heading=OUTPUT,
    metavar="FIG",
    type=click.Path(),
    help="Also draw it: .png, .svg or .pdf.",
)
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace files that exist.")
@reading_options
@option(
    "--station-distance",
    "distance",
    heading=STATIONS,
    type=Number("METRES", above=0),
    default=STATION_DISTANCE,
    show_default=True,
    help="Sweeps up to this far from a viewpoint belong to it.",
)
@option(
    "--station-angle",
    "angle",
    heading=STATIONS,
    type=Number("DEGREES", above=0),
    default=STATION_DEGREES,
    show_default=True,
    help="Sweeps belong to a viewpoint if their heading differs by no more than this.",
)
@range_options
@opening_options
@click.pass_obj
def build(
    say: Messages,
    /,
    chosen: Chosen,
    dry_run: bool,
    output: str,
    figure: str | None,
    overwrite: bool,
    selection: Selection,
    poses: PoseOptions,
    distance: float,
    angle: float,
    rules: RangeRules,
    opening: OpenOptions,
) -> int:
    """Learn r_e, the range of the background, from logs of the scene.

    For every beam this is the farthest surface that enough sweeps agree on: people may
    walk through the scene in up to 30 % of the sweeps. Several logs make one background.
    Where a log has poses, every viewpoint gets a background of its own.
    """
    if figure and place(figure).suffix.lower() not in IMAGES:
        raise click.BadParameter(f"'{figure}' is none of {', '.join(IMAGES)}.", param_hint="'--plot'")

    from lidarcli.cli.background_text import learned_lines
    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import show_reading
    from lidarcli.pipeline.building import (
        Building,
        BuildOptions,
        draw_background,
        refuse_nothing,
        refuse_output,
        scene_notes,
    )
    from lidarcli.pipeline.runs.over_logs import exit_code

    path = place(output)
    sources = chosen.sources()
    refuse_output(path, sources, overwrite, [place(figure)] if figure else [])
    if dry_run:
        code = print_reads(sources)
        for target in (output, figure) if figure else (output,):
            click.echo(f"write  {target}")
        return code
    building = Building(
        BuildOptions(
            read=selection.read(rules),
            opening=opening,
            poses=poses,
            distance=distance,
            angle=math.radians(angle),
        )
    )
    codes = []
    with progress_bar(sources, say) as report:
        for outcome in building.add_all(sources, report):
            show_reading(outcome, say)
            codes.append(outcome.exit_code)
    sensors = building.sensors()
    if any(codes) and not sensors:
        return exit_code(codes)
    refuse_nothing(sensors)
    for note in [*building.notes(), *scene_notes(sensors)]:
        say.info(f"note: {note}")
    for line in learned_lines(sensors):
        say.info(line)
    notes = building.write(path, sensors, overwrite)
    say.info(f"  wrote    {path}")
    if figure:
        notes += draw_background(place(figure), sensors, overwrite)
        say.info(f"  wrote    {figure}")
    for note in notes:
        say.info(f"  note     {note}")
    return exit_code(codes)


@background.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli background info empty.background.parquet
  lidarcli background info lap.parquet --format json | jq .sensors""",
)
@click.argument("file", metavar="FILE", type=click.Path())
@text_or_json("For people, or JSON.")
def info(file: str, kind: str) -> int:
    """Show what a background knows: sensors, stations, beams, where it comes from."""
    from lidarcli.cli.background_text import as_json, as_text
    from lidarcli.pipeline.building import load

    sensors, metadata = load(place(file))
    if kind == "json":
        words = as_json(file, sensors, metadata)
    else:
        # Names come from a log and may hold anything.
        words = "\n".join(map(one_line, as_text(file, sensors, metadata).split("\n")))
    click.echo(words.encode("utf-8", "backslashreplace"))
    return 0


def _subtract() -> click.Command:
    """`detect` with a background that has to be there: the same options, the same work."""
    params = [copy.copy(parameter) for parameter in own_parameters(detect)]
    for parameter in params:
        if parameter.name == "background":
            parameter.required = True
    return GroupedCommand(
        "subtract",
        callback=detect.callback,
        params=params,
        help="""Find what differs from a background: r_w - r_e, sweep by sweep.

        The same as `lidarcli detect --background FILE`, and the same tables, with `difference` and
        `change` filled in. Everything else counts as walls and rest (set S).""",
        epilog="""Examples:

\b
  lidarcli background subtract run.mcap --background empty.background.parquet
  lidarcli background subtract run.mcap --background empty.parquet --removed
  lidarcli background subtract lap2.mcap --background lap.parquet \\
    --station-distance 0.4
  lidarcli background subtract run.bag --background hall.parquet --any-frame \\
    --threshold 0.3""",
    )


background.add_command(_subtract())
