"""`lidarcli overlay`: objects and tracks to be played in step with their log."""

from pathlib import Path
from typing import Annotated

from lidarcli.choices import SIGNIFICANCE
from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, progress_bar, show_reading
from lidarcli.cli.options import log_options, refuse_finding
from lidarcli.option_forms import File, Option
from lidarcli.options import (
    ECHO,
    OBJECTS,
    OUTPUT,
    POSES,
    RANGES,
    SELECT,
    THINGS,
    Delay,
    Jobs,
    Joining,
    Objects,
    OneLog,
    Overwrite,
    Poses,
    Ranges,
    Things,
    Topics,
    output,
)
from lidarcli.stores.url import place

OF_FINDING = (SELECT, POSES, OBJECTS, THINGS, RANGES, ECHO)
"""Headings of options that say how objects are found."""


class OverlayCommand(
    OneLog, Joining, Overwrite, Jobs, Topics, Poses, Delay, Objects, Things, Ranges, total=False
):
    """Options of `overlay`."""

    output: Annotated[
        str,
        output("FILE"),
        "File to write: .mcap (ROS 2, for Foxglove, Lichtblick and RViz), .bag (ROS 1) or .rrd (rerun, an extra).",
    ]
    objects: Annotated[
        str | None,
        Option(OUTPUT, File("TABLE"), shown="find and follow, as track does"),
        "Show what is in <log>.objects.parquet, as detect or track have written it, with the sweeps table beside.",
    ]
    with_log: Annotated[
        bool,
        Option(OUTPUT, None, False),
        "Copy scans, transforms, odometry and poses into the same file, for viewers that open one file only (not .rrd).",
    ]
    map: Annotated[
        str | None,
        Option(OUTPUT, File("FILE.yaml"), shown="none"),
        "Show this map, too, in the world frame of the log.",
    ]
    zones: Annotated[
        tuple[str, ...],
        Option(OUTPUT, File("FILE"), (), shown="none", several=True),
        "Show the zones of this file, too (docs/zones.md), brighter while they are occupied; may be repeated.",
    ]
    layout: Annotated[
        bool,
        Option(OUTPUT, None, True, both=True),
        "Also write settings of viewers: NAME.layout.json and NAME.rviz (not for .rrd).",
    ]


@command(
    OverlayCommand,
    changed={"max_width": {"shown": "2; paper: no limit"}},
    examples="""\
  lidarcli overlay run.mcap -o run.overlay.mcap
  lidarcli overlay run.mcap -o run.overlay.mcap --objects run.objects.parquet
  lidarcli overlay run.bag -o run.shown.mcap --with-log --map room.yaml
  lidarcli overlay run.mcap -o run.overlay.mcap --zones nav2.yaml
  lidarcli overlay run.bag -o run.overlay.bag --no-layout
  lidarcli overlay run.mcap -o run.rrd
  ros2 bag play -i run.mcap -i run.overlay.mcap""",
)
def overlay(say: Messages, told: OverlayCommand) -> int:
    """Write objects and tracks as markers that viewers play in step with the log.

    One visualization_msgs/MarkerArray per sweep on /lidarcli/objects: outlines, bodies,
    labels and velocities. Open the file together with the log, or give --with-log.
    """
    logs = log_options(told)
    if told["objects"] is not None:
        refuse_finding(OF_FINDING)

    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.api.options import detect_options, tracking_of
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.overlaying import OverlayOptions, refuse_overlay, write_overlay
    from lidarcli.pipeline.runs.outcomes import outcome_of
    from lidarcli.pipeline.runs.over_logs import progress_of

    zones = None
    if told["zones"]:
        from lidarcli.pipeline.inputs.zones import read_zones

        zones = read_zones(told["zones"])
    keep_freed_memory()
    say.of_missing_core()
    source, path = one_log(told["log"], told["join"]), place(told["output"])
    options = OverlayOptions(
        detect_options(told, logs, tracking_of({"significance": SIGNIFICANCE, "memory": True})),
        told["objects"],
        told["with_log"],
        None if told["map"] is None else Path(told["map"]),
        zones,
        told["layout"],
        told["overwrite"],
    )
    refuse_overlay(path, source, options)
    with progress_bar([source], say) as report:
        outcome = outcome_of(source, lambda one: write_overlay(one, path, options, progress_of(one, report)))
        show_reading(outcome, say)
    if outcome.summary is not None:
        say.wrote(outcome.summary.outputs)
    return outcome.exit_code
