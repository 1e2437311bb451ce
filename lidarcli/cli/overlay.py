"""`lidarcli overlay`: objects and tracks to be played in step with their log."""

from typing import Annotated

from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, progress_bar, show_reading
from lidarcli.cli.options import log_options, refuse_finding
from lidarcli.options import OF_FINDING, OneLog, Overlaying, Overwrite, TextOrJson, output
from lidarcli.stores import place


class OverlayCommand(OneLog, Overwrite, TextOrJson, Overlaying, total=False):
    """Options of `overlay`."""

    output: Annotated[
        str,
        output("FILE"),
        "File to write: .mcap (ROS 2, for Foxglove, Lichtblick and RViz), .bag (ROS 1) or .rrd (rerun, an extra).",
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
    """Write objects and tracks as markers that viewers play.

    One visualization_msgs/MarkerArray per sweep on /lidarcli/objects: outlines, bodies,
    labels and velocities. Open the file together with the log, or give --with-log.
    """
    logs = log_options(told)
    if told["objects"] is not None:
        refuse_finding(OF_FINDING)

    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.api.overlaying import overlay_options
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.overlaying import refuse_overlay, write_overlay
    from lidarcli.pipeline.runs.over_logs import outcome_of, progress_of

    options = overlay_options(told, logs, overwrite=told["overwrite"])
    keep_freed_memory()
    say.of_missing_core()
    say.begin(told)
    source, path = one_log(told["log"], told["join"]), place(told["output"])
    refuse_overlay(path, source, options)
    with progress_bar([source], say) as report:
        outcome = outcome_of(source, lambda one: write_overlay(one, path, options, progress_of(one, report)))
        show_reading(outcome, say)
    return say.end(outcome.exit_code)
