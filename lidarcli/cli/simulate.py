"""`lidarcli simulate`: a log with known truth from a scene file."""

from typing import Annotated

import click

from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, counted_bar
from lidarcli.display import counted
from lidarcli.option_forms import Argument, File, options_of
from lidarcli.options import Overwrite, Simulating, output


class SimulateCommand(Overwrite, Simulating, total=False):
    """Options of `simulate`."""

    scene: Annotated[str, Argument("SCENE.toml", File("SCENE.toml"))]
    output: Annotated[
        str,
        output("LOG"),
        "Log to write: .mcap, .bag, .db3, .csv, .csv.gz, or a name without suffix for a ROS 2 bag folder.",
    ]


@command(
    SimulateCommand,
    examples="""\
  lidarcli simulate samples/room.toml -o room.mcap
  lidarcli simulate samples/room.toml -o room.bag --compression lz4 --sweeps 9
  lidarcli simulate samples/room.toml -o room.csv --layout wide --seed 7
  lidarcli simulate samples/people.toml -o people3d.mcap --clouds
  lidarcli simulate samples/people.toml -o people --duration 2.5
  lidarcli simulate hall.toml -o run.mcap --map map.yaml --map-resolution 0.1""",
)
def simulate(say: Messages, told: SimulateCommand) -> int:
    """Ray-cast a scene into a log, with the truth beside it.

    Writes LOG, <log>.truth.parquet (one row per sweep and visible entity) and
    <log>.truth-beams.parquet (the entity of every beam).
    """
    if told["sweeps"] is not None and told["duration"] is not None:
        raise click.UsageError("--sweeps and --duration exclude each other")

    from lidarcli.simulation import simulate as run

    scene = told["scene"]
    with counted_bar(scene, None, "sweeps", say) as progress:
        result = run(
            scene,
            told["output"],
            overwrite=told["overwrite"],
            progress=progress,
            **{field: told[field] for field in options_of(Simulating)},  # type: ignore[literal-required]
        )
    say.info(f"{scene}: {counted(result.sweeps, 'sweep')}")
    written = (result.log, result.truth, result.truth_beams, result.true_map)
    say.wrote(filter(None, written))
    say.notes(result.notes)
    return 0
