"""`lidarcli simulate`: a log with known truth from a scene file."""

import math
from typing import Annotated

import click

from lidarcli.choices import CONTAINERS, MAP_RESOLUTION
from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, counted_bar
from lidarcli.display import counted
from lidarcli.option_forms import Argument, File, Number, Option, Text
from lidarcli.options import WIDTH, Overwrite, output

RUN, LOG = "Run", "Log"
COUNT = Number("N", 0, math.inf, whole=True)


class SimulateCommand(Overwrite, total=False):
    """Options of `simulate`."""

    scene: Annotated[str, Argument("SCENE.toml", File("SCENE.toml"))]
    output: Annotated[
        str,
        output("LOG"),
        "Log to write: .mcap, .bag, .db3, .csv, .csv.gz, .log or .clf (CARMEN), .2d (ARIA), .txt (RPLIDAR), .jsonl, or a "
        "name without suffix for a ROS 2 bag folder.",
    ]
    container: Annotated[
        str | None, Option(LOG, CONTAINERS, shown="by suffix"), "Format, where the name does not say it."
    ]
    compression: Annotated[
        str | None,
        Option(LOG, Text("NAME"), shown="zstd for mcap, else none"),
        "none, lz4, zstd (mcap); none, bz2, lz4 (bag); none, zstd, zstd-message (ros2).",
    ]
    encoding: Annotated[
        str | None,
        Option(LOG, Text("NAME"), shown="cdr"),
        "Messages of an mcap: cdr, cdr-idl, ros1, json, protobuf.",
    ]
    layout: Annotated[
        str | None, Option(LOG, Text("NAME"), shown="rostopic"), "Layout of a csv (docs/formats.md)."
    ]
    clouds: Annotated[
        bool,
        Option(LOG, None, False),
        "Write point clouds with a floor and a ceiling instead of LaserScan, to be read by --slice.",
    ]
    map: Annotated[
        str | None,
        Option(LOG, File("FILE.yaml", is_output=True), shown="none"),
        "Also write the true map of the run, without noise and without what moves, in map_server format (.yaml + .pgm), "
        "for diff TRUTH.yaml MAP.yaml.",
    ]
    map_resolution: Annotated[
        float | None, Option(LOG, WIDTH, shown=f"{MAP_RESOLUTION:g}"), "Side of the cells of that map."
    ]
    sweeps: Annotated[
        int | None, Option(RUN, COUNT, shown="from the scene", unless=("duration",)), "Number of sweeps."
    ]
    duration: Annotated[
        float | None,
        Option(RUN, Number("SECONDS", 0, math.inf), shown="from the scene", unless=("sweeps",)),
        "Length of the run, instead of --sweeps.",
    ]
    seed: Annotated[
        int, Option(RUN, COUNT, 0), "Seed of noise and lost beams; the same seed gives the same bytes."
    ]


@command(
    SimulateCommand,
    examples="""\
  lidarcli simulate samples/room.toml -o room.mcap
  lidarcli simulate samples/room.toml -o room.bag --compression lz4 --sweeps 9
  lidarcli simulate samples/room.toml -o room.csv --layout long --seed 7
  lidarcli simulate samples/people.toml -o people3d.mcap --clouds
  lidarcli simulate samples/people.toml -o people --duration 2.5
  lidarcli simulate samples/drive.toml -o drive.log --sweeps 40
  lidarcli simulate samples/drive.toml -o drive.2d --sweeps 40
  lidarcli simulate samples/room.toml -o run.log --container player --seed 7
  lidarcli simulate hall.toml -o run.mcap --map map.yaml --map-resolution 0.1""",
)
def simulate(say: Messages, told: SimulateCommand) -> int:
    """Ray-cast a scene into a log, with the truth beside it.

    Writes LOG, <log>.truth.parquet (one row per sweep and visible entity) and
    <log>.truth-beams.parquet (the entity of every beam).
    """
    if told["sweeps"] is not None and told["duration"] is not None:
        raise click.UsageError("--sweeps and --duration exclude each other")
    if told["map"] is None and told["map_resolution"] is not None:
        raise click.UsageError("--map-resolution is that of --map: name its file, too")

    from lidarcli.simulate import simulate as run

    scene, resolution = told["scene"], told["map_resolution"]
    same = (
        "sweeps",
        "duration",
        "seed",
        "container",
        "compression",
        "encoding",
        "layout",
        "clouds",
        "overwrite",
    )
    with counted_bar(scene, None, "sweeps", say) as progress:
        result = run(
            scene,
            told["output"],
            map_file=told["map"],
            map_resolution=MAP_RESOLUTION if resolution is None else resolution,
            progress=progress,
            **{field: told[field] for field in same},  # type: ignore[literal-required]
        )
    say.info(f"{scene}: {counted(result.sweeps, 'sweep')}")
    written = (result.log, result.truth, result.truth_beams, result.true_map)
    say.wrote(filter(None, written))
    say.notes(result.notes)
    return 0
