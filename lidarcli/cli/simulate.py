"""`lidarcli simulate`: a log with known truth from a scene file."""

from __future__ import annotations

import math

import click

from lidarcli.choices import CONTAINERS, MAP_RESOLUTION
from lidarcli.cli.grouped import GroupedCommand, option
from lidarcli.cli.messages import Messages
from lidarcli.cli.options import Number

RUN, LOG = "Run", "Log"


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
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
@click.argument("scene", metavar="SCENE.toml", type=click.Path())
@option(
    "-o",
    "--output",
    heading=LOG,
    metavar="LOG",
    required=True,
    type=click.Path(),
    help="Log to write: .mcap, .bag, .db3, .csv, .csv.gz, .log or .clf (CARMEN), .2d (ARIA), .txt (RPLIDAR), .jsonl, or a "
    "name without suffix for a ROS 2 bag folder.",
)
@option(
    "--container",
    heading=LOG,
    type=click.Choice(CONTAINERS),
    help="Format, where the name does not say it.  [default: by suffix]",
)
@option(
    "--compression",
    heading=LOG,
    metavar="NAME",
    help="none, lz4, zstd (mcap); none, bz2, lz4 (bag); none, zstd, zstd-message (ros2).  "
    "[default: zstd for mcap, else none]",
)
@option(
    "--encoding",
    heading=LOG,
    metavar="NAME",
    help="Messages of an mcap: cdr, cdr-idl, ros1, json, protobuf.  [default: cdr]",
)
@option(
    "--layout", heading=LOG, metavar="NAME", help="Layout of a csv (docs/formats.md).  [default: rostopic]"
)
@option(
    "--clouds",
    heading=LOG,
    is_flag=True,
    help="Write point clouds with a floor and a ceiling instead of LaserScan, to be read by --slice.",
)
@option(
    "--map",
    "map_file",
    is_output=True,
    heading=LOG,
    metavar="FILE.yaml",
    type=click.Path(),
    help="Also write the true map of the run, without noise and without what moves, as map_server has it: the .yaml and "
    "a .pgm beside it, for map --compare.  [default: none]",
)
@option(
    "--map-resolution",
    heading=LOG,
    type=Number("METRES", above=0),
    help=f"Side of its cells.  [default: {MAP_RESOLUTION:g}]",
)
@option("--overwrite", heading=LOG, is_flag=True, help="Replace files that exist.")
@option(
    "--sweeps",
    unless=("duration",),
    heading=RUN,
    type=click.IntRange(min=0),
    metavar="N",
    help="Number of sweeps.  [default: from the scene]",
)
@option(
    "--duration",
    unless=("sweeps",),
    heading=RUN,
    type=Number("SECONDS", least=0, most=math.inf),
    help="Length of the run, instead of --sweeps.  [default: from the scene]",
)
@option(
    "--seed",
    heading=RUN,
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Seed of noise and lost beams; the same seed gives the same bytes.",
)
@click.pass_obj
def simulate(
    say: Messages,
    /,
    scene: str,
    output: str,
    container: str | None,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    clouds: bool,
    map_file: str | None,
    map_resolution: float | None,
    overwrite: bool,
    sweeps: int | None,
    duration: float | None,
    seed: int,
) -> int:
    """Ray-cast a scene into a log, with the truth beside it.

    Writes LOG, <log>.truth.parquet (one row per sweep and visible entity) and
    <log>.truth-beams.parquet (the entity of every beam).
    """
    if sweeps is not None and duration is not None:
        raise click.UsageError("--sweeps and --duration exclude each other")
    if map_file is None and map_resolution is not None:
        raise click.UsageError("--map-resolution is that of --map: name its file, too")

    from lidarcli.cli.progress import counted_bar
    from lidarcli.simulate import simulate as run

    with counted_bar(scene, None, "sweeps", say) as progress:
        result = run(
            scene,
            output,
            sweeps=sweeps,
            duration=duration,
            seed=seed,
            container=container,
            compression=compression,
            encoding=encoding,
            layout=layout,
            clouds=clouds,
            overwrite=overwrite,
            map_file=map_file,
            map_resolution=MAP_RESOLUTION if map_resolution is None else map_resolution,
            progress=progress,
        )
    say.info(f"{scene}: {result.sweeps:,} sweep{'' if result.sweeps == 1 else 's'}")
    written = (result.log, result.truth, result.truth_beams, result.true_map)
    for path in filter(None, written):
        say.info(f"  wrote    {path}")
    for note in result.notes:
        say.info(f"  note     {note}")
    return 0
