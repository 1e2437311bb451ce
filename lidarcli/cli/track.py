"""`lidarcli track`: everything that `detect` does, and things followed from sweep to sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from lidarcli.choices import SIGNIFICANCE
from lidarcli.cli.detecting import detection_options, find
from lidarcli.cli.grouped import GroupedCommand, option
from lidarcli.cli.many_logs import many_logs
from lidarcli.cli.messages import Messages
from lidarcli.cli.options import Number

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.following import TrackOptions

TRACKING = "Tracking"


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli track run.mcap
  lidarcli track bags/ -o tables --jobs 4 --overwrite
  lidarcli track run.mcap --background empty.background.parquet
  lidarcli track run.bag --pose /amcl_pose --significance 1e-7
  cat run.mcap | lidarcli track - -o - | jq -c 'select(.set == "A")'""",
)
@many_logs
@detection_options(tables="<log>.objects.parquet, <log>.sweeps.parquet and <log>.tracks.parquet", memory=True)
@option(
    "--significance",
    heading=TRACKING,
    type=Number("P", least=1e-12, most=0.1),
    default=SIGNIFICANCE,
    show_default=True,
    help="Share of standing things that may be taken for moving by chance. Lower values detect slow movers later.",
)
@click.pass_obj
def track(say: Messages, /, significance: float, memory: bool, **asked: Any) -> int:
    """Find the objects of every sweep, and follow things from sweep to sweep.

    Does everything that `lidarcli detect` does, with the same options. In the same pass
    it finds which objects are one thing, how fast it is, and which things move by
    themselves (agents, set A). Writes one row per thing to DIR/<log>.tracks.parquet,
    beside the tables of objects and sweeps.
    """

    def tracking() -> TrackOptions:
        from lidarcli.formalism.parameters import TrackParameters
        from lidarcli.pipeline.objects.following import TrackOptions

        return TrackOptions(TrackParameters(significance=significance, memory=memory))

    return find(say, tracking=tracking, **asked)
