"""`lidarcli plot`: sweeps as pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from lidarcli.choices import VIEWS, Look
from lidarcli.cli.grouped import GroupedCommand, option
from lidarcli.cli.messages import Messages, standard_output
from lidarcli.cli.object_options import object_options
from lidarcli.cli.options import INPUTS, STDOUT, TIME, opening_options, pose_options, range_options
from lidarcli.cli.plot_options import (
    LAST,
    Sweeps,
    look_options,
    outputs,
    refuse_look,
    refuse_suffix,
    wanted_sweeps,
)
from lidarcli.stores.url import Place

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.mapping import MapOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules
    from lidarcli.times import Instant

PICTURE = "Picture"
WITH_TRACKS = ("all", "scene")
"""Views with the scene, in which tracks are drawn."""


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli plot run.mcap
  lidarcli plot run.mcap --sweep 50 -o sweep.png
  lidarcli plot run.mcap --at 2026-11-22T10:00:00Z
  lidarcli plot run.mcap --view scene --width 89 --no-title -o fig.pdf
  lidarcli plot run.bag --topic /front_scan --sweeps 0,50,100 -o front.svg
  lidarcli plot run.mcap --sweep 50 --profile paper --view difference -o s.png
  lidarcli plot run.mcap --sweep 9 --background empty.parquet -o change.png
  lidarcli plot run.mcap --sweep 80 --tracks run.tracks.parquet -o paths.png
  lidarcli plot run.mcap --map --tracks run.tracks.parquet -o map.png
  lidarcli plot run.mcap --sweeps 0:100:2 --animate --fps 20 --overwrite""",
)
@click.argument("log", metavar="LOG", type=INPUTS)
@option(
    "--sweep",
    unless=("sweeps", "at"),
    heading=PICTURE,
    type=click.IntRange(min=0, max=LAST),
    metavar="N",
    help="Sweep to draw.  [default: 0]",
)
@option(
    "--sweeps",
    unless=("sweep", "at"),
    heading=PICTURE,
    type=Sweeps(),
    metavar="LIST",
    help="Sweeps to draw, 0,50,100 or 0:100:10; each gets a file, FIG-N.png.  "
    "[default: with --animate all, else --sweep]",
)
@option(
    "--at",
    unless=("sweep", "sweeps", "animate"),
    heading=PICTURE,
    type=TIME,
    help="Draw the sweep nearest to this time: seconds after the first sweep (10, 2min), or date and time "
    "(2026-11-22T10:00:00Z).  [default: none]",
)
@option(
    "-o",
    "--output",
    heading=PICTURE,
    metavar="FIG",
    type=click.Path(),
    help="File to write: .png, .svg, .pdf, with --animate .gif or .mp4; - for a PNG on standard output.  "
    "[default: LOG-N.png, LOG-map.png or LOG.gif in the current directory]",
)
@option(
    "--view",
    heading=PICTURE,
    type=click.Choice(VIEWS),
    default="all",
    show_default=True,
    help="The scene from above, r(theta) with s(theta), the difference, polar, or scene and curves.",
)
@option(
    "--map",
    "in_world",
    heading=PICTURE,
    is_flag=True,
    help="The run from above in the world instead: map and path of the sensor; with --sweep its points and boxes, with "
    "--tracks what stands and what moved.",
)
@option("--animate", heading=PICTURE, is_flag=True, help="One moving picture of the sweeps.")
@option(
    "--start",
    heading=PICTURE,
    type=TIME,
    help="With --animate and without --sweeps: start at this time, given like --at.  [default: 0]",
)
@option("--end", heading=PICTURE, type=TIME, help="With --start: end before this time.  [default: the end]")
@option("--overwrite", heading=PICTURE, is_flag=True, help="Replace files that exist.")
@option(
    "--topic",
    heading=PICTURE,
    metavar="NAME",
    help="LaserScan topic to draw.  [default: the first by name]",
)
@option(
    "--background",
    heading=PICTURE,
    metavar="FILE",
    type=click.Path(),
    help="Background to compare with (docs/background.md): also r_w, r_e and their difference.  [default: none]",
)
@option(
    "--tracks",
    heading=PICTURE,
    metavar="FILE",
    type=click.Path(),
    help="Tracks table (its objects table in the same folder): paths up to the sweep, numbers, velocities.  "
    "[default: none]",
)
@look_options
@pose_options(delay=True)
@object_options(walls="Also draw walls, with the corners of the room.", no_limit="paper")
@range_options
@opening_options
@click.pass_obj
def plot(
    say: Messages,
    /,
    log: str,
    sweep: int | None,
    sweeps: tuple[int, ...] | None,
    output: str | None,
    view: str,
    in_world: bool,
    animate: bool,
    start: float | Instant | None,
    end: float | Instant | None,
    at: float | Instant | None,
    overwrite: bool,
    topic: str | None,
    background: str | None,
    tracks: str | None,
    look: Look,
    poses: PoseOptions,
    rules: RangeRules,
    opening: OpenOptions,
    **parameters: Any,
) -> int:
    """Draw sweeps as in the paper: scene with boxes, r(theta), s(theta).

    Without -o the picture is LOG-0.png in the current directory, and so on. Only the log
    up to the last of these sweeps is read; with --map, all of it.
    """
    if at is not None and (sweep is not None or sweeps is not None or animate):
        raise click.UsageError("--at names one sweep: it excludes --sweep, --sweeps and --animate")
    wanted = wanted_sweeps(sweep, sweeps, animate)
    refuse_suffix(output, animate)
    if (start, end) != (None, None) and (not animate or wanted is not None):
        raise click.UsageError("--start and --end are for --animate without --sweep and --sweeps")
    if output == STDOUT and (animate or len(wanted or ()) != 1):
        raise click.UsageError("standard output takes one picture; give -o FIG")

    if not in_world and background is None and poses != type(poses)():
        raise click.UsageError("--pose, --poses, --pose-delay and --no-deskew are for --map and --background")
    if in_world:
        _refuse_beside_map(view, animate, background)
        wanted = None if sweep is None and sweeps is None and at is None else wanted
    if tracks is not None and view not in WITH_TRACKS:
        raise click.UsageError(f"--tracks are drawn in the scene; give --view {' or '.join(WITH_TRACKS)}")

    from lidarcli.pipeline.inputs.search import files_of, one_log

    source = one_log(log)
    if at is not None:
        from lidarcli.pipeline.plotting import sweep_at

        wanted = (sweep_at(source, at, topic, opening),)
    paths = outputs(output, source, wanted, animate, in_world)
    refuse_look(look, paths, view, animate, in_world)

    from lidarcli.cli.progress import counted_bar
    from lidarcli.errors import UnreadableError
    from lidarcli.formalism import Parameters
    from lidarcli.newfiles import refuse
    from lidarcli.pipeline.inputs.tables import table_files
    from lidarcli.pipeline.plotting import (
        PlotOptions,
        picture_bytes,
        take_pictures,
        write_animation,
        write_pictures,
    )

    if output != STDOUT:
        others = [str(table) for table in table_files([tracks] if tracks else [])]
        others += [file for file in (background, poses.file) if file]
        refuse(paths, overwrite, [*files_of([source]), *others])
    found_with = Parameters.for_profile(**parameters)
    if in_world:
        from lidarcli.logs.batches import ReadOptions
        from lidarcli.pipeline.mapping import MapOptions

        read = ReadOptions(topics=frozenset({topic}) if topic else None, rules=rules)
        options = MapOptions(read, opening, poses, parameters=found_with, overwrite=overwrite)
        return _draw_map(say, source, paths, wanted, tracks, options, look)
    drawn = take_pictures(
        source, PlotOptions(wanted, topic, found_with, rules, opening, background, tracks, poses, start, end)
    )
    for note in drawn.notes:
        say.info(f"  note     {note}")
    if output == STDOUT:
        standard_output().buffer.write(picture_bytes(drawn.pictures[0], view, ".png", look))
    else:
        if animate:
            with counted_bar(paths[0].name, len(drawn.pictures), "frames", say) as report:
                notes = write_animation(paths[0], drawn.pictures, view, overwrite, look, report)
        else:
            notes = write_pictures(paths, drawn.pictures, view, overwrite, look)
        for path in paths:
            say.info(f"  wrote    {path}")
        for note in notes:
            say.info(f"  note     {note}")
    for line in drawn.damage:
        say.error(log, line)
    return UnreadableError.exit_code if drawn.damage else 0


def _refuse_beside_map(view: str, animate: bool, background: str | None) -> None:
    """Refuse what --map has no place for."""
    if view != VIEWS[0] or animate or background is not None:
        raise click.UsageError("--map is a picture of its own, without --view, --animate and --background")


def _draw_map(
    say: Messages,
    source: Source,
    paths: list[Place],
    sweeps: tuple[int, ...] | None,
    tracks: str | None,
    options: MapOptions,
    look: Look,
) -> int:
    """Draw the run from above; the exit code."""
    from lidarcli.errors import UnreadableError
    from lidarcli.pipeline.plotting import map_bytes, take_map, write_maps

    try:
        drawn = take_map(source, options, sweeps, tracks)
    except UnreadableError as err:
        raise UnreadableError(f"{source.label}: {str(err).removeprefix(f'{source.path}: ')}") from err
    for note in drawn.notes:
        say.info(f"  note     {note}")
    if str(paths[0]) == STDOUT:
        standard_output().buffer.write(map_bytes(drawn.pictures[0], ".png", look))
    else:
        notes = write_maps(paths, drawn.pictures, options.overwrite, look)
        for path in paths:
            say.info(f"  wrote    {path}")
        for note in notes:
            say.info(f"  note     {note}")
    for line in drawn.damage:
        say.error(source.label, line)
    return UnreadableError.exit_code if drawn.damage else 0
