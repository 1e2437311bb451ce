"""`lidarcli map`: one map of one or several logs."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lidarcli.choices import (
    CLOUDS,
    GREATEST_COUNT,
    MAP_RESOLUTION,
    MAP_RESOLUTIONS,
    MAX_MAP_KM2,
    MIN_MOVE,
    OCCUPIED_RATIO,
)
from lidarcli.cli.grouped import OUTPUT, GroupedCommand, option
from lidarcli.cli.many_logs import Chosen, many_logs, print_reads
from lidarcli.cli.messages import Messages
from lidarcli.cli.options import METRES, Number, Selection, opening_options, range_options, reading_options
from lidarcli.stores.url import place

if TYPE_CHECKING:
    from lidarcli.formalism.mapping.occupancy import Comparison
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.map_files import Mapped
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules

GRID, CLOUD, TRUTH = "Occupancy grid", "Point cloud", "Comparison"


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli map run.mcap -o room.yaml
  lidarcli map run.mcap -o room.yaml -o room.png --path -o cloud.ply
  lidarcli map monday.bag tuesday.bag -o site.yaml --pose /amcl_pose --jobs 2
  lidarcli map scans.csv -o scans.png --pose match
  lidarcli map run.mcap -o cloud.parquet --voxel 0.05 --min-move 0
  lidarcli map run.mcap -o room.yaml --without-agents --free-no-return 3
  lidarcli map run.mcap --compare truth.map.yaml --format json""",
)
@many_logs
@option(
    "-o",
    "--output",
    "outputs",
    heading=OUTPUT,
    metavar="FILE",
    multiple=True,
    type=click.Path(),
    help="File to write; may be repeated: .yaml (map_server, with a .pgm beside it), .png, .mcap "
    "(nav_msgs/OccupancyGrid), .ply, .pcd or .parquet (point cloud).  [default: none, beside --compare]",
)
@option("--path", heading=OUTPUT, is_flag=True, help="Draw the path of the sensor into the .png.")
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace files that exist.")
@option(
    "-j",
    "--jobs",
    heading=OUTPUT,
    type=click.IntRange(min=1, max=GREATEST_COUNT),
    metavar="N",
    help="Processes for several logs at most, where no point cloud is written.  [default: as many as pay]",
)
@reading_options
@option(
    "--resolution",
    heading=GRID,
    type=Number("METRES", least=MAP_RESOLUTIONS[0], most=MAP_RESOLUTIONS[1]),
    default=MAP_RESOLUTION,
    show_default=True,
    help="Side of a cell.",
)
@option(
    "--min-move",
    heading=GRID,
    type=METRES,
    default=MIN_MOVE,
    show_default=True,
    help="How far the sensor goes from one sweep that counts to the next; a turn by 10 degrees and 5 s count as well. "
    "0: every sweep counts.",
)
@option(
    "--min-hits",
    heading=GRID,
    type=click.IntRange(min=1, max=GREATEST_COUNT),
    metavar="N",
    help="Minimum hits for a cell to be occupied.  [default: 2; with --min-move 0: 4]",
)
@option(
    "--occupied-ratio",
    heading=GRID,
    type=Number("SHARE", least=0, most=1),
    default=OCCUPIED_RATIO,
    show_default=True,
    help="Minimum hit ratio: hits among the sweeps that hit or passed the cell.",
)
@option(
    "--free-no-return",
    heading=GRID,
    type=METRES,
    default=0.0,
    help="Take beams without a return as free up to here. Glass and black things return nothing either.  "
    "[default: 0, they say nothing]",
)
@option(
    "--without-agents",
    heading=GRID,
    is_flag=True,
    help="Leave out what moves, by following it as `lidarcli track` does.",
)
@option(
    "--max-size",
    heading=GRID,
    type=Number("KM2", above=0),
    default=MAX_MAP_KM2,
    show_default=True,
    help="Refuse a larger map; at 5 cm a km² takes about 6 GB, as far as it is seen.",
)
@option(
    "--voxel",
    heading=CLOUD,
    type=METRES,
    default=0.0,
    help="Keep one point for each square of this side.  [default: 0, all points]",
)
@option(
    "--compare",
    heading=TRUTH,
    metavar="TRUTH.yaml",
    type=click.Path(),
    help="Print how right the map is: precision, recall and F1 of its occupied cells (one cell of tolerance), and their "
    "mean distance.  [default: none]",
)
@option(
    "--format",
    "kind",
    heading=TRUTH,
    type=click.Choice(["text", "json"]),
    default=None,
    help="Of what --compare prints.  [default: text]",
)
@range_options
@opening_options
@click.pass_obj
def map(
    say: Messages,
    /,
    chosen: Chosen,
    dry_run: bool,
    outputs: tuple[str, ...],
    overwrite: bool,
    selection: Selection,
    poses: PoseOptions,
    jobs: int | None,
    compare: str | None,
    kind: str | None,
    rules: RangeRules,
    opening: OpenOptions,
    **options: Any,
) -> int:
    """Make one map of one or several logs whose sensors moved.

    Counts the cells that beams hit and pass, each at most once per sweep. Needs to know
    where the sensor was: by the log's poses, --poses FILE.tum, or --pose match.
    """
    if not outputs and compare is None:
        raise click.UsageError("nothing to write: give -o FILE, or --compare TRUTH.yaml")
    suffixes = {place(output).suffix.lower() for output in outputs}
    if options["path"] and ".png" not in suffixes:
        raise click.UsageError("--path is drawn into a picture: give -o FILE.png")
    if options["voxel"] and suffixes.isdisjoint(CLOUDS):
        raise click.UsageError(f"--voxel is for a point cloud: give -o with {', '.join(CLOUDS)}")
    if kind is not None and compare is None:
        raise click.UsageError("--format is for what --compare prints")

    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import show_reading
    from lidarcli.pipeline.map_files import MapRun
    from lidarcli.pipeline.mapping import MapOptions
    from lidarcli.pipeline.runs.over_logs import exit_code

    say.of_missing_core()
    sources = chosen.sources()
    told = MapOptions(
        read=selection.read(rules),
        opening=opening,
        poses=poses,
        overwrite=overwrite,
        jobs=jobs or 0,
        **options,
    )
    if dry_run:
        code = print_reads(sources)
        for output in outputs:
            click.echo(f"write  {output}")
        return code
    true = None if compare is None else Path(compare)
    codes = []
    with MapRun(sources, [place(output) for output in outputs], told, true) as run:
        with progress_bar(sources, say) as report:
            for outcome in run.outcomes(report):
                show_reading(outcome, say)
                codes.append(outcome.exit_code)
        mapped = None if run.is_empty else run.finish()
    if mapped is not None:
        _show(mapped, say)
        if mapped.comparison is not None:
            click.echo(_compared(mapped.comparison, kind or "text"))
    return exit_code(codes)


def _show(mapped: Mapped, say: Messages) -> None:
    """What the map holds, on stderr."""
    grid = mapped.grid
    height, width = grid.cells.shape
    size = f"{width * grid.resolution:.1f} x {height * grid.resolution:.1f} m"
    sweeps = f"{mapped.sweeps:,} sweep{'' if mapped.sweeps == 1 else 's'}"
    say.info(
        f"map of {sweeps} in {', '.join(mapped.worlds)}: {size}, {grid.occupied:,} cells of {grid.resolution:g} m "
        f"occupied, {grid.free:,} free"
    )
    for note in mapped.notes:
        say.info(f"  note     {note}")
    for path in mapped.outputs:
        say.info(f"  wrote    {path}")


def _compared(found: Comparison, kind: str) -> str:
    """How right the map is, for people or as JSON."""
    if kind == "json":
        values = {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in asdict(found).items()
        }
        return json.dumps(values, indent=2)
    rows = (
        ("occupied cells", f"{found.cells:,}"),
        ("of the true map", f"{found.true_cells:,}"),
        ("precision", f"{found.precision:.4f}"),
        ("recall", f"{found.recall:.4f}"),
        ("F1", f"{found.f1:.4f}"),
        ("mean distance", f"{found.mean_distance:.3f} m"),
    )
    return "\n".join(f"{name:18}{value}" for name, value in rows)
