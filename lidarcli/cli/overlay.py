"""`lidarcli overlay`: objects and tracks to be played in step with their log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from lidarcli.choices import GREATEST_COUNT, SIGNIFICANCE
from lidarcli.cli.grouped import OUTPUT, GroupedCommand, GroupedOption, option
from lidarcli.cli.messages import Messages
from lidarcli.cli.object_options import OBJECTS, THINGS, catalogue_option, object_options
from lidarcli.cli.options import (
    ECHO,
    INPUTS,
    POSES,
    RANGES,
    SELECT,
    Selection,
    opening_options,
    range_options,
    reading_options,
)
from lidarcli.stores.url import place

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules

OF_FINDING = (SELECT, POSES, OBJECTS, THINGS, RANGES, ECHO)
"""Headings of options that say how objects are found."""


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli overlay run.mcap -o run.overlay.mcap
  lidarcli overlay run.mcap -o run.overlay.mcap --objects run.objects.parquet
  lidarcli overlay run.bag -o run.shown.mcap --with-log --map room.yaml
  lidarcli overlay run.bag -o run.overlay.bag --no-layout
  ros2 bag play -i run.mcap -i run.overlay.mcap""",
)
@click.argument("log", metavar="LOG", type=INPUTS)
@option(
    "-o",
    "--output",
    heading=OUTPUT,
    metavar="FILE",
    required=True,
    type=click.Path(),
    help="File to write: .mcap (ROS 2, for Foxglove, Lichtblick and RViz) or .bag (ROS 1).",
)
@option(
    "--objects",
    heading=OUTPUT,
    metavar="TABLE",
    type=click.Path(),
    help="Show what is in <log>.objects.parquet, as detect or track have written it, with the sweeps table beside.  "
    "[default: find and follow, as track does]",
)
@option(
    "--with-log",
    heading=OUTPUT,
    is_flag=True,
    help="Copy scans, transforms, odometry and poses into the same file, for viewers that open one file only.",
)
@option(
    "--map",
    "drawn",
    heading=OUTPUT,
    metavar="FILE.yaml",
    type=click.Path(),
    help="Show this map, too, in the world frame of the log.  [default: none]",
)
@option(
    "--layout/--no-layout",
    heading=OUTPUT,
    default=True,
    help="Whether to write settings of viewers beside it: NAME.layout.json and NAME.rviz.  [default: layout]",
)
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace files that exist.")
@option(
    "-j",
    "--jobs",
    heading=OUTPUT,
    type=click.IntRange(min=1, max=GREATEST_COUNT),
    metavar="N",
    help="Processors to use at most.  [default: as many as pay]",
)
@reading_options
@object_options(walls="Show walls, too.", no_limit="paper")
@catalogue_option
@range_options
@opening_options
@click.pass_context
def overlay(
    ctx: click.Context,
    /,
    log: str,
    output: str,
    objects: str | None,
    with_log: bool,
    drawn: str | None,
    layout: bool,
    overwrite: bool,
    jobs: int | None,
    selection: Selection,
    poses: PoseOptions,
    catalogue: str | None,
    rules: RangeRules,
    opening: OpenOptions,
    **parameters: Any,
) -> int:
    """Write objects and tracks as markers that viewers play in step with the log.

    One visualization_msgs/MarkerArray per sweep on /lidarcli/objects: outlines, bodies,
    labels and velocities. Open the file together with the log, or give --with-log.
    """
    say: Messages = ctx.obj
    if objects is not None:
        _refuse_finding(ctx)

    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import show_reading
    from lidarcli.formalism import Parameters
    from lidarcli.formalism.parameters import TrackParameters
    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.inputs.catalogue import read_catalogue
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.objects.following import TrackOptions
    from lidarcli.pipeline.objects.options import DetectOptions
    from lidarcli.pipeline.overlaying import OverlayOptions, refuse_overlay, write_overlay
    from lidarcli.pipeline.runs.over_logs import outcome_of, progress_of

    keep_freed_memory()
    say.of_missing_core()
    source, path = one_log(log), place(output)
    found = DetectOptions(
        parameters=Parameters.for_profile(**parameters),
        read=selection.read(rules),
        opening=opening,
        poses=poses,
        catalogue=None if catalogue is None else read_catalogue(catalogue),
        tracking=TrackOptions(TrackParameters(significance=SIGNIFICANCE, memory=True)),
        jobs=jobs or 0,
    )
    options = OverlayOptions(
        found, objects, with_log, None if drawn is None else Path(drawn), layout, overwrite
    )
    refuse_overlay(path, source, options)
    with progress_bar([source], say) as report:
        outcome = outcome_of(source, lambda one: write_overlay(one, path, options, progress_of(one, report)))
        show_reading(outcome, say)
    if outcome.summary is not None:
        for written in outcome.summary.outputs:
            say.info(f"  wrote    {written}")
    return outcome.exit_code


def _refuse_finding(ctx: click.Context) -> None:
    """Refuse options of finding objects beside a table of objects that have been found."""
    for parameter in ctx.command.params:
        said = (
            parameter.name is not None
            and ctx.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
        )
        if said and isinstance(parameter, GroupedOption) and parameter.heading in OF_FINDING:
            raise click.UsageError(
                f"{parameter.opts[0]} is for finding objects, and --objects names some that have been found"
            )
