"""`lidarcli poses`: the sensor's path as a file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from lidarcli.cli.grouped import OUTPUT, GroupedCommand, option
from lidarcli.cli.messages import Messages
from lidarcli.cli.options import INPUTS, Selection, opening_options, range_options, reading_options
from lidarcli.stores.url import place

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli poses run.mcap -o run.tum
  lidarcli poses run.mcap -o odometry.tum --pose /odom
  lidarcli poses scans.csv -o scans.tum --pose match
  lidarcli poses run.bag -o run.poses.parquet
  evo_traj tum run.tum --plot""",
)
@click.argument("log", metavar="LOG", type=INPUTS)
@option(
    "-o",
    "--output",
    heading=OUTPUT,
    metavar="FILE",
    required=True,
    type=click.Path(),
    help="File to write: .tum or .txt (lines of timestamp x y z qx qy qz qw), or .parquet.",
)
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace a file that exists.")
@reading_options
@range_options
@opening_options
@click.pass_obj
def poses(
    say: Messages,
    /,
    log: str,
    output: str,
    overwrite: bool,
    selection: Selection,
    poses: PoseOptions,
    rules: RangeRules,
    opening: OpenOptions,
) -> int:
    """Write where the sensor was at each sweep, as evo and others read it."""
    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import show_reading
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.runs.over_logs import outcome_of, progress_of
    from lidarcli.pipeline.trajectories import PathOptions, refuse_path, write_path

    source, path = one_log(log), place(output)
    options = PathOptions(selection.read(rules), opening, poses, overwrite)
    refuse_path(path, source, options)
    with progress_bar([source], say) as report:
        outcome = outcome_of(source, lambda one: write_path(one, path, options, progress_of(one, report)))
        show_reading(outcome, say)
    if outcome.summary is not None:
        say.info(f"  wrote    {path}")
    return outcome.exit_code
