"""`lidarcli clean`: a log without what moves in it."""

from typing import Annotated

from lidarcli.cli.commands import command, usage_errors
from lidarcli.cli.messages import Messages, of_one_log
from lidarcli.option_forms import Argument
from lidarcli.options import INPUT, Cleaning, Reported, output
from lidarcli.stores import place


class CleanCommand(Reported, Cleaning, total=False):
    """Options of `clean`."""

    log: Annotated[str, Argument("LOG", INPUT)]
    output: Annotated[
        str, output("FILE"), "Log to write, in the container of LOG; beside it the table NAME.cleaned.parquet."
    ]


@command(
    CleanCommand,
    examples="""\
  lidarcli clean run.mcap -o run.clean.mcap
  lidarcli clean run.bag -o run.clean.bag --remove agents,temporary
  lidarcli clean run.bag -o run.clean.bag --mask robot.toml
  lidarcli clean run.mcap -o run.clean.mcap --value inf --margin 2
  lidarcli map run.clean.mcap -o room.yaml""",
)
def clean(say: Messages, told: CleanCommand) -> int:
    """Write a log once more without what moves in it, for maps.

    MCAP, ROS 1 bags and ROS 2 bags, each to its own kind. All messages stay as they are,
    in their order; of LaserScan messages the beams on agents say NaN.
    """
    from lidarcli.machine import keep_freed_memory
    from lidarcli.pipeline.api.cleaning import clean_options
    from lidarcli.pipeline.cleaning import clean_log
    from lidarcli.pipeline.inputs.search import one_log

    with usage_errors():
        options = clean_options(told, overwrite=told["overwrite"])
    keep_freed_memory()
    say.of_missing_core()
    say.begin(told)
    source, path = one_log((told["log"],), False), place(told["output"])
    return of_one_log(
        say,
        source,
        lambda one, progress: clean_log(one, path, options, progress),
        lambda run: [run.line, f"  copied   {run.copied}"],
    )
