"""`lidarcli track`: everything that `detect` does, and things followed from sweep to sweep."""

from lidarcli.cli.commands import command
from lidarcli.cli.detect import Tables, find
from lidarcli.cli.messages import Messages
from lidarcli.options import Tracking


class TrackCommand(Tables, Tracking, total=False):
    """Options of `track`."""


@command(
    TrackCommand,
    examples="""\
  lidarcli track run.mcap
  lidarcli track bags/ -o tables --jobs 4 --no-trajectories --overwrite
  lidarcli track --join run_0.bag run_1.bag run_2.bag
  lidarcli track run.mcap --background empty.background.parquet
  lidarcli track run.bag --pose /amcl_pose --significance 1e-7
  cat run.mcap | lidarcli track - -o - | jq -c 'select(.set == "A")'""",
)
def track(say: Messages, told: TrackCommand) -> int:
    """Find objects, and follow things from sweep to sweep.

    Does everything that `lidarcli detect` does, with the same options. In the same pass
    it finds which objects are one thing, how fast it is, and which things move by
    themselves (agents, set A). Beside the tables of objects and sweeps it writes
    one row per thing to DIR/<log>.tracks.parquet, and where each thing was in every
    sweep to DIR/<log>.trajectories.parquet.
    """
    return find(say, told, follow=True)
