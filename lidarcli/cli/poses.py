"""`lidarcli poses`: the sensor's path as a file."""

from typing import Annotated

from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, progress_bar, show_reading
from lidarcli.cli.options import log_options
from lidarcli.options import OneLog, Reading, Reported, output
from lidarcli.stores import place


class PosesCommand(OneLog, Reported, Reading, total=False):
    """Options of `poses`."""

    output: Annotated[
        str, output("FILE"), "File to write: .tum or .txt (lines of timestamp x y z qx qy qz qw), or .parquet."
    ]


@command(
    PosesCommand,
    examples="""\
  lidarcli poses run.mcap -o run.tum
  lidarcli poses run.mcap -o odometry.tum --pose /odom
  lidarcli poses scans.csv -o scans.tum --pose match
  lidarcli poses run.bag -o run.poses.parquet
  evo_traj tum run.tum --plot""",
)
def poses(say: Messages, told: PosesCommand) -> int:
    """Write where the sensor was at each sweep, as evo reads it."""
    logs = log_options(told)

    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.runs.over_logs import outcome_of, progress_of
    from lidarcli.pipeline.trajectories import PathOptions, refuse_path, write_path

    say.begin(told)
    source, path = one_log(told["log"], told["join"]), place(told["output"])
    options = PathOptions(*logs, told["overwrite"], told["stamps"])
    refuse_path(path, source, options)
    with progress_bar([source], say) as report:
        outcome = outcome_of(source, lambda one: write_path(one, path, options, progress_of(one, report)))
        show_reading(outcome, say)
    return say.end(outcome.exit_code)
