"""`lidarcli overlay`: objects and tracks to be played in step with their log."""

from typing import Annotated

from lidarcli.cli.commands import command, log_options
from lidarcli.cli.messages import Messages, of_one_log
from lidarcli.options import OVERLAY_RULES, OneLog, Overlaying, Overwrite, TextOrJson, output
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
    rules=OVERLAY_RULES,
)
def overlay(say: Messages, told: OverlayCommand) -> int:
    """Write objects and tracks as markers that viewers play.

    One visualization_msgs/MarkerArray per sweep on /lidarcli/objects: outlines, bodies,
    labels and velocities. Open the file together with the log, or give --with-log.
    """
    logs = log_options(told)

    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.api.overlaying import overlay_options
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.overlaying import refuse_overlay, write_overlay

    options = overlay_options(told, logs, overwrite=told["overwrite"])
    keep_freed_memory()
    say.of_missing_core()
    say.begin(told)
    source, path = one_log(told["log"], told["join"]), place(told["output"])
    refuse_overlay(path, source, options)
    return of_one_log(say, source, lambda one, progress: write_overlay(one, path, options, progress))
