"""`lidarcli export`, `poses`, `simulate`, `clean`, `overlay` and `map`: files made of tables, of logs and of a scene."""

from typing import TYPE_CHECKING, Annotated, Any

import click

from lidarcli.cli.commands import command, log_options, usage_errors
from lidarcli.cli.messages import (
    MessageWriter,
    chosen_logs,
    counted_bar,
    of_one_log,
    print_reads,
    progress_bar,
    show_reading,
    standard_output,
)
from lidarcli.display.texts import counted
from lidarcli.files.stores import Place, place
from lidarcli.options.choices import CLOUDS
from lidarcli.options.common import CHECK, Jobs, ManyLogs, OneLog, Overwrite, Reported, TextOrJson, output
from lidarcli.options.forms import Argument, File, Option, OptionRule, options_of
from lidarcli.options.groups import OVERLAY_RULES, Cleaning, Exporting, MappingGroup, Overlaying, Simulating
from lidarcli.options.reading import ReadingGroup
from lidarcli.options.values import CHECKS, INPUT, OUTPUT, STDOUT

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.mapping import Mapped
    from lidarcli.pipeline.trajectories import PathOptions


class ExportCommand(Overwrite, Exporting, total=False):
    tables: Annotated[tuple[str, ...], Argument("TABLE...", File("TABLE"), several=True)]
    output: Annotated[str, output("FILE"), "File to write: .csv, .ndjson, .arrow, .parquet or .tum; - for standard output."]
    format: Annotated[
        str | None, Option(OUTPUT, ("csv", "ndjson", "arrow", "parquet"), shown="csv"), "Format of the stream of -o -."
    ]


@command(
    ExportCommand,
    examples="""\
  lidarcli export run.objects.parquet -o run.csv
  lidarcli export run.tracks.parquet -o - --columns track,set,speed_mean
  lidarcli export 'tables/*.objects.parquet' -o all.ndjson --overwrite
  lidarcli export run.trajectories.parquet --only 4 -o person.tum
  lidarcli export run.beams.parquet -o - --format arrow > beams.arrow""",
    rules=[
        OptionRule(("format",), ("output=-",), "is for the stream of -o -; a file has the format of its suffix", needs=True)
    ],
)
def export(messages: MessageWriter, options: ExportCommand) -> int:
    """Convert tables to CSV, NDJSON, Arrow or Parquet.

    TABLE is any Parquet table that lidarcli wrote, a folder to search, or a
    pattern. Several tables of one kind are written one after the other.
    """
    output, kind = options["output"], options["format"]
    from lidarcli.pipeline.exporting import chosen, export_file, export_stream, format_of

    form = (kind or "csv") if output == STDOUT else format_of(place(output))
    only = [int(one) for one in options["only"]]  # type: ignore[union-attr]
    wanted = chosen(options["tables"], [*options["columns"]], options["stamps"], only)
    for problem in wanted.problems:
        messages.error(str(problem))
    if output == STDOUT:
        _, notes = export_stream(wanted, standard_output().buffer, form)
    else:
        rows, notes = export_file(wanted, place(output), form, options["overwrite"])
    messages.notes(notes)
    if output != STDOUT:
        messages.info(f"  wrote    {output} ({rows:,} rows)")
    return wanted.problems[0].exit_code if wanted.problems else 0


class PosesCommand(OneLog, Reported, ReadingGroup, total=False):
    output: Annotated[
        str | None,
        output("FILE", shown="none, with --map"),
        "File to write: .tum or .txt (lines of timestamp x y z qx qy qz qw), .parquet, with --map also .png (picture).",
    ]
    map: Annotated[
        str | None,
        Option(CHECKS, File("FILE.yaml"), shown="none"),
        "Map of map_server: also tell when the path was off it, or the robot lost (docs/poses.md).",
    ]
    relocate: Annotated[
        bool,
        Option(OUTPUT, None, False),
        "Write poses that are off as the map corrects them, and leave out those of a lost robot.",
    ]
    check: Annotated[
        tuple[str, ...], CHECK, "Condition that must hold, else exit code 1: lost == 0 (docs/poses.md); may be repeated."
    ]


@command(
    PosesCommand,
    examples="""\
  lidarcli poses run.mcap -o run.tum
  lidarcli poses run.mcap -o odometry.tum --pose /odom
  lidarcli poses scans.csv -o scans.tum --pose match
  lidarcli poses run.bag -o run.poses.parquet
  lidarcli poses run.mcap --map site.yaml --check "lost == 0"
  lidarcli poses run.mcap --map site.yaml --relocate -o corrected.tum
  evo_traj tum run.tum --plot""",
    rules=[OptionRule(("relocate", "check"), ("map",), "is for --map FILE.yaml", needs=True)],
)
def poses(messages: MessageWriter, options: PosesCommand) -> int:
    """Write the path of the sensor, and judge it by a map.

    The path is a file that evo reads. With --map: was the robot lost? Each half second,
    how many beams the map explains, and the correction of the pose that explains more.
    """
    logs = log_options(options)

    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.trajectories import PathOptions, refuse_path, write_path

    messages.begin(options)
    source, path = one_log(options["log"], options["join"]), place(options["output"]) if options["output"] else None
    parsed = PathOptions(*logs, options["overwrite"], options["stamps"])
    if (site := options["map"]) is not None:
        return _localise(messages, source, path, parsed, options, site)
    if path is None:
        raise click.UsageError("Missing option '-o' / '--output': where to write the path, or --map to judge it.")
    refuse_path(path, source, parsed)
    return of_one_log(messages, source, lambda one, progress: write_path(one, path, parsed, progress))


def _localise(
    messages: MessageWriter, source: "Source", path: "Place | None", parsed: "PathOptions", options: PosesCommand, file: str
) -> int:
    """Judge the path of a log by a map."""
    from lidarcli.pipeline.localising import LocalisedPath, localise, parse_checks, read_site, refuse_judged

    with usage_errors():
        checks = parse_checks(options["check"])
        if options["relocate"] and path is None:
            raise click.UsageError("--relocate writes the corrected path: name its file with -o")
    if path is not None:
        refuse_judged(path, source, parsed, file)
    site = read_site(file)

    def shown(run: LocalisedPath) -> list[str]:
        for verdict in run.verdicts:
            if not verdict.holds:
                messages.error(f"check failed: {verdict.failure}")
        for line in run.unobserved:
            messages.error("incomplete", line)
        return run.lines

    relocate = options["relocate"]
    return of_one_log(messages, source, lambda one, bar: localise(one, path, parsed, site, relocate, checks, bar), shown)


class SimulateCommand(Overwrite, Simulating, total=False):
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
def simulate(messages: MessageWriter, options: SimulateCommand) -> int:
    """Make a log from a scene, with the truth beside it.

    Writes LOG, <log>.truth.parquet (one row per sweep and visible entity) and
    <log>.truth-beams.parquet (the entity of every beam).
    """
    from lidarcli.simulation import simulate as run

    scene = options["scene"]
    with counted_bar(scene, None, "sweeps", messages) as progress:
        result = run(
            scene,
            options["output"],
            overwrite=options["overwrite"],
            progress=progress,
            **{field: options[field] for field in options_of(Simulating)},  # type: ignore[literal-required]
        )
    messages.info(f"{scene}: {counted(result.sweeps, 'sweep')}")
    written = (result.log, result.truth, result.truth_beams, result.true_map)
    messages.wrote(filter(None, written))
    messages.notes(result.notes)
    return 0


class CleanCommand(Reported, Cleaning, total=False):
    log: Annotated[str, Argument("LOG", INPUT)]
    output: Annotated[
        str,
        output("FILE"),
        "Log to write, in the container of LOG; beside it the table NAME.cleaned.parquet. With --clips a folder.",
    ]


@command(
    CleanCommand,
    examples="""\
  lidarcli clean run.mcap -o run.clean.mcap
  lidarcli clean run.bag -o run.clean.bag --remove agents,temporary
  lidarcli clean run.bag -o run.clean.bag --mask robot.toml
  lidarcli clean run.mcap -o run.clean.mcap --value inf --margin 2
  lidarcli clean run.bag -o run.mended.bag --mend
  lidarcli clean run.bag -o merged.bag --merge /scan
  lidarcli clean run.mcap -o part.mcap --start 10 --end 20
  lidarcli clean run.mcap -o clips --clips run.events.parquet
  lidarcli map run.clean.mcap -o room.yaml""",
)
def clean(messages: MessageWriter, options: CleanCommand) -> int:
    """Copy a log without what moves, with faults mended, or cut.

    MCAP, ROS 1 and ROS 2 bags, each to its own kind. All messages stay as they are, in
    their order; beams on agents say NaN. --mend corrects what other programs refuse, and
    takes no one out; a part is cut as it is: give --remove agents to do both.
    """
    from lidarcli.pipeline.api.options import clean_options
    from lidarcli.pipeline.clean.log import clean_log
    from lidarcli.pipeline.inputs.search import one_log

    with usage_errors():
        parsed = clean_options(options, overwrite=options["overwrite"])
    messages.begin(options, finds=True)
    source, path = one_log((options["log"],), False), place(options["output"])
    return of_one_log(messages, source, lambda one, progress: clean_log(one, path, parsed, progress), lambda run: run.lines)


class OverlayCommand(OneLog, Overwrite, TextOrJson, Overlaying, total=False):
    output: Annotated[
        str, output("FILE"), "File to write: .mcap (ROS 2: Foxglove, RViz), .bag (ROS 1) or .rrd (rerun, an extra)."
    ]


@command(
    OverlayCommand,
    changed={"max_width": {"shown": "2; paper: no limit"}},
    examples="""\
  lidarcli overlay run.mcap -o run.overlay.mcap
  lidarcli overlay run.mcap -o run.overlay.mcap --objects run.objects.parquet
  lidarcli overlay run.bag -o run.shown.mcap --with-log --map room.yaml
  lidarcli overlay run.mcap -o run.overlay.mcap --zones nav2.yaml
  lidarcli overlay run.bag -o run.overlay.bag --no-layout
  lidarcli overlay run.mcap -o run.rrd
  ros2 bag play -i run.mcap -i run.overlay.mcap""",
    rules=OVERLAY_RULES,
)
def overlay(messages: MessageWriter, options: OverlayCommand) -> int:
    """Write objects and tracks for Foxglove, RViz or rerun.

    One visualization_msgs/MarkerArray per sweep on /lidarcli/objects: outlines, bodies,
    labels and velocities. Open the file together with the log, or give --with-log.
    """
    logs = log_options(options)

    from lidarcli.pipeline.api.options import overlay_options
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.overlay.files import refuse_overlay, write_overlay

    parsed = overlay_options(options, logs, overwrite=options["overwrite"])
    messages.begin(options, finds=True)
    source, path = one_log(options["log"], options["join"]), place(options["output"])
    refuse_overlay(path, source, parsed)
    return of_one_log(messages, source, lambda one, progress: write_overlay(one, path, parsed, progress))


class MapCommand(ManyLogs, Reported, Jobs, MappingGroup, total=False):
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
def map(messages: MessageWriter, options: MapCommand) -> int:
    """Make a map of the logs of a sensor that drove around.

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
    own = {field: options[field] for field in options_of(MappingGroup).keys() - options_of(ReadingGroup).keys()}  # type: ignore[literal-required]
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


def _show(mapped: "Mapped", messages: MessageWriter) -> dict[str, Any]:
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
