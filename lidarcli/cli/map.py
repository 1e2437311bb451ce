"""`lidarcli map`: one map of one or several logs."""

from typing import TYPE_CHECKING, Annotated, Any

import click

from lidarcli.choices import CLOUDS
from lidarcli.cli.commands import command, log_options
from lidarcli.cli.messages import Messages, chosen_logs, print_reads, progress_bar, show_reading
from lidarcli.display import counted
from lidarcli.option_forms import options_of
from lidarcli.options import Jobs, ManyLogs, Mapping, Reading, Reported, output
from lidarcli.stores import place

if TYPE_CHECKING:
    from lidarcli.pipeline.mapping import Mapped


class MapCommand(ManyLogs, Reported, Jobs, Mapping, total=False):
    """Options of `map`."""

    output: Annotated[
        tuple[str, ...],
        output("FILE", several=True),
        "File to write; may be repeated: .yaml (map_server, with a .pgm beside it), .png, .mcap "
        "(nav_msgs/OccupancyGrid), .ply, .pcd or .parquet (point cloud).",
    ]


@command(
    MapCommand,
    examples="""\
  lidarcli map run.mcap -o room.yaml
  lidarcli map run.mcap -o room.yaml -o room.png -o cloud.ply
  lidarcli map monday.bag tuesday.bag -o site.yaml --pose /amcl_pose --jobs 2
  lidarcli map scans.csv -o scans.png --pose match
  lidarcli map run.mcap -o cloud.parquet --voxel 0.05 --min-move 0
  lidarcli map run.mcap -o room.yaml --without agents --free-no-return 3""",
)
def map(messages: Messages, options: MapCommand) -> int:
    """Make one map of one or several logs whose sensors moved.

    Counts the cells that beams hit and pass, each at most once per sweep. Needs to know
    where the sensor was: by the log's poses, --poses FILE.tum, or --pose match.
    Several logs are read by as many processes, unless a point cloud is written.
    """
    outputs = options["output"]
    suffixes = {place(output).suffix.lower() for output in outputs}
    if options["voxel"] and suffixes.isdisjoint(CLOUDS):
        raise click.UsageError(f"--voxel is for a point cloud: give -o with {', '.join(CLOUDS)}")

    from lidarcli.pipeline.mapping import MapOptions, MapRun
    from lidarcli.pipeline.runs.over_logs import exit_code

    messages.of_missing_core()
    logs = log_options(options)
    messages.begin(options)
    sources = chosen_logs(messages, options)
    own = {field: options[field] for field in options_of(Mapping).keys() - options_of(Reading).keys()}  # type: ignore[literal-required]
    own |= {"overwrite": options["overwrite"], "stamps": options["stamps"]}
    parsed = MapOptions(*logs, jobs=options["jobs"] or 0, **own)
    if options["dry_run"]:
        return print_reads(sources, outputs)
    codes = []
    with MapRun(sources, [place(output) for output in outputs], parsed) as run:
        with progress_bar(sources, messages) as report:
            for outcome in run.outcomes(report):
                show_reading(outcome, messages)
                codes.append(outcome.exit_code)
        mapped = None if run.is_empty else run.finish()
    return messages.end(exit_code(codes), map=None if mapped is None else _show(mapped, messages))


def _show(mapped: "Mapped", messages: Messages) -> dict[str, Any]:
    """Write a summary of the map to stderr; return it as plain values."""
    grid = mapped.grid
    height, width = grid.cells.shape
    size = f"{width * grid.resolution:.1f} x {height * grid.resolution:.1f} m"
    messages.info(
        f"map of {counted(mapped.sweeps, 'sweep')} in {', '.join(mapped.worlds)}: {size}, "
        f"{grid.occupied:,} cells of {grid.resolution:g} m occupied, {grid.free:,} free"
    )
    messages.notes(mapped.notes)
    messages.wrote(mapped.outputs)
    cells = {"width": width, "height": height, "occupied": grid.occupied, "free": grid.free}
    return {"sweeps": mapped.sweeps, "worlds": [*mapped.worlds], "resolution": grid.resolution, **cells}
