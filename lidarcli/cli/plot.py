"""`lidarcli plot`: sweeps as pictures."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import click

from lidarcli.cli.commands import command, log_options
from lidarcli.cli.messages import MessageWriter, counted_bar, progress_bar, standard_output
from lidarcli.errors import OptionError
from lidarcli.files.stores import Place, place
from lidarcli.options.choices import ANIMATED_DPI, ANIMATIONS, FRAMES_PER_SECOND, IMAGES, LAST_SWEEP, MAX_COUNT, VIEWS, Look
from lidarcli.options.common import OneLog, Overwrite, output
from lidarcli.options.forms import Number, Option, Text, options_of
from lidarcli.options.groups import LOOK, PICTURE, PLOT_RULES, Plotting
from lidarcli.options.reading import WindowGroup
from lidarcli.options.values import STDOUT, SWEEP, parse_numbers

if TYPE_CHECKING:
    from lidarcli.logs.batches import ReadOptions
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.plotting import Drawn, PlotOptions
    from lidarcli.pipeline.reading.one_log import Progress

MAP = "map"
"""View of the whole run in the world."""
MAX_FRAMES = 50.0
"""Greatest number of frames per second: viewers of GIF files show no more."""


def _indices(text: str) -> tuple[int, ...]:
    """Indices of sweeps, `0,50,100`, or `0:100:10` as Python counts: each once, in the order given."""
    found: dict[int, None] = {}
    for part in text.split(","):
        try:
            numbers = [int(number) for number in part.split(":")]
        except ValueError:
            raise OptionError(f"'{part}' is neither a number nor START:STOP nor START:STOP:STEP") from None
        if min(numbers) < 0 or len(numbers) > 3 or (len(numbers) == 3 and not numbers[2]):
            raise OptionError(f"'{part}' is no number of a sweep, nor a range of them")
        more = range(*numbers) if len(numbers) > 1 else numbers
        if max(numbers) > LAST_SWEEP:
            raise OptionError(f"'{part[:40]}' goes beyond {LAST_SWEEP:,}")
        if len(found) + len(more) > MAX_COUNT:
            raise OptionError(f"'{part}' is too many sweeps")
        found |= dict.fromkeys(more)
    if not found:
        raise OptionError(f"'{text}' holds no sweep")
    return tuple(found)


class PlotCommand(OneLog, Overwrite, WindowGroup, Plotting, total=False):
    sweep: Annotated[int | None, Option(PICTURE, SWEEP, shown="0", unless=("sweeps", "at")), "Sweep to draw."]
    sweeps: Annotated[
        tuple[int, ...] | None,
        Option(PICTURE, Text("LIST", _indices), shown="with --animate all", unless=("sweep", "at")),
        "Sweeps to draw, 0,50,100 or 0:100:10; each gets a file, FIG-N.png.",
    ]
    output: Annotated[
        str | None,
        output("FIG", shown="LOG-N.png here"),
        "File to write: .png, .svg, .pdf, with --animate .gif or .mp4; - for a PNG on stdout.",
    ]
    animate: Annotated[
        bool, Option(PICTURE, None, False), "One moving picture of --sweeps, or of those from --start to --end."
    ]
    only: Annotated[
        tuple[int, ...],
        Option(PICTURE, Text("LIST", parse_numbers), (), shown="all"),
        "With --view map --tracks: numbers of the tracks to draw, 4,6,10.",
    ]
    density: Annotated[
        bool, Option(PICTURE, None, False), "With --view map --tracks: how long agents were where, in place of their paths."
    ]
    fps: Annotated[
        float | None,
        Option(LOOK, Number("NUMBER", 0.1, MAX_FRAMES), shown=f"{FRAMES_PER_SECOND:g}", rare=True),
        "Sweeps per second of --animate.",
    ]


@command(
    PlotCommand,
    changed={
        "view": {
            "value": (*VIEWS, MAP),
            "help": f"{options_of(Plotting)['view'].help} map: the run in the world and the path of the "
            "sensor, with --sweep its points, with --tracks what stands and moved.",
        },
        "tracks": {"help": f"{options_of(Plotting)['tracks'].help} Given LOG itself, its things are followed first."},
        "max_width": {"shown": "2; paper: no limit", "rare": True},
        **{field: {"rare": True} for field in ("start", "end", "pose")},
        "dpi": {"shown": f"200; with --animate {ANIMATED_DPI}", "help": "Pixels per inch of PNG and of animations."},
    },
    examples="""\
  lidarcli plot run.mcap
  lidarcli plot run.mcap --sweep 50 -o sweep.png
  lidarcli plot run.mcap --at 2026-11-22T10:00:00Z
  lidarcli plot run.mcap --view scene --width 89 --no-title -o fig.pdf
  lidarcli plot run.bag --topic /front_scan --sweeps 0,50,100 -o front.svg
  lidarcli plot run.mcap --sweep 50 --profile paper --view sweep -o s.png
  lidarcli plot run.mcap --sweep 9 --background empty.parquet -o change.png
  lidarcli plot run.mcap --sweep 80 --tracks run.tracks.parquet -o paths.png
  lidarcli plot run.mcap --sweep 80 --zones nav2.yaml -o zones.png
  lidarcli plot run.mcap --view map --tracks run.tracks.parquet -o map.png
  lidarcli plot run.mcap --view map --tracks run.tracks.parquet --density
  lidarcli plot run.mcap --sweeps 0:100:2 --animate --fps 20 --overwrite""",
    rules=PLOT_RULES,
)
def plot(messages: MessageWriter, options: Mapping[str, Any]) -> int:
    """Draw one sweep, a map of the run, or an animation.

    Without -o the picture is LOG-0.png in the current directory, LOG-map.png or LOG.gif.
    Only the log up to the last sweep drawn is read; with --view map, all of it.
    """
    output, view, animate = options["output"], options["view"], options["animate"]
    sweeps = _chosen_sweeps(options)
    read = log_options({**options, "start": None, "end": None}).read
    look = Look(*(options[field] for field in ("width", "dpi", "title", "legend", "vertices", "fps")))
    _refuse_output(output, animate, sweeps, look)

    from lidarcli.errors import UnreadableError
    from lidarcli.files.newfiles import refuse
    from lidarcli.options.times import as_time
    from lidarcli.pipeline import plotting
    from lidarcli.pipeline.api.options import plot_options
    from lidarcli.pipeline.inputs.search import files_of, one_log
    from lidarcli.pipeline.runs.over_logs import progress_of

    wanted = replace(plot_options(options, None, sweeps), tracks=options["tracks"])
    source = one_log(options["log"], options["join"])
    if options["at"] is not None:
        time = as_time(options["at"], wanted.time_zone)
        wanted = replace(wanted, sweeps=(plotting.sweep_at(source, time, wanted.topic, wanted.opening),))
    elif view == MAP and options["sweep"] is None and options["sweeps"] is None:
        wanted = replace(wanted, sweeps=None)
    paths = _outputs(output, source, wanted.sweeps, animate, view == MAP)
    if output != STDOUT:
        refuse(paths, options["overwrite"], [*files_of([source]), *_files_read(options, wanted)])
    with progress_bar([source], messages) as progress:
        drawn = _draw(source, options, wanted, read, progress_of(source, progress))
    messages.notes(drawn.notes)
    pictures: Sequence[Any] = drawn.pictures
    if output == STDOUT:
        standard_output().buffer.write(plotting.picture_bytes(pictures[0], view, ".png", look))
    else:
        with counted_bar(paths[0].name, len(pictures), "frames" if animate else "pictures", messages) as report:
            if animate:
                notes = plotting.write_animation(paths[0], pictures, view, options["overwrite"], look, report)
            else:
                notes = plotting.write_pictures(paths, pictures, view, options["overwrite"], look, report)
        messages.wrote(paths)
        messages.notes(notes)
    for line in drawn.damage:
        messages.error(source.label, line)
    return UnreadableError.exit_code if drawn.damage else 0


def _chosen_sweeps(options: Mapping[str, Any]) -> tuple[int, ...] | None:
    """Return the sweeps to draw: the first one by default, of an animation all (None)."""
    if options["sweep"] is not None:
        return (options["sweep"],)
    sweeps: tuple[int, ...] | None = options["sweeps"]
    return (0,) if sweeps is None and not options["animate"] else sweeps


def _refuse_output(output: str | None, animate: bool, sweeps: tuple[int, ...] | None, look: Look) -> None:
    """Refuse a suffix that such a picture cannot have, or several pictures on standard output."""
    known, suffix = ANIMATIONS if animate else IMAGES, "" if output is None else place(output).suffix.lower()
    if output not in (None, STDOUT) and suffix not in known:
        still = " or --animate" if suffix in ANIMATIONS else ""
        raise click.UsageError(f"{output}: the suffix has to be one of {', '.join(known)}{still}")
    if output == STDOUT and (animate or len(sweeps or ()) != 1):
        raise click.UsageError("standard output takes one picture; give -o FIG")
    if look.dpi is not None and suffix in (".svg", ".pdf"):
        raise click.UsageError("--dpi is for .png and animations; .svg and .pdf have no pixels")


def _files_read(options: Mapping[str, Any], wanted: "PlotOptions") -> list[str]:
    """Return the files that are read in addition to the log."""
    files = [wanted.background, options["mask"], wanted.poses.file, *options["zones"]]
    if options["tracks"] and options["tracks"] not in options["log"]:
        from lidarcli.pipeline.inputs.tables import table_files

        files += map(str, table_files([options["tracks"]]))
    return [file for file in files if file]


def _draw(
    source: "Source", options: Mapping[str, Any], wanted: "PlotOptions", read: "ReadOptions", progress: "Progress | None"
) -> "Drawn[Any]":
    """Return the pictures; tracks of the log itself are found first."""
    from lidarcli.files.newfiles import scratch_folder
    from lidarcli.pipeline import plotting
    from lidarcli.pipeline.api.options import detect_options, tracking_of

    with ExitStack() as stack:
        if options["tracks"] in options["log"]:
            every = {**options, "topic": None, "start": None, "end": None, "background": None, "catalogue": None, "jobs": 0}
            detect = detect_options(every, log_options(every), tracking_of())
            tracks = plotting.followed(source, wanted.zones, detect, stack.enter_context(scratch_folder()), progress)
            wanted = replace(wanted, tracks=tracks)
        if options["view"] != MAP:
            return plotting.take_pictures(source, wanted, progress)
        from lidarcli.pipeline.mapping import MapOptions

        parsed = MapOptions(read, wanted.opening, wanted.poses, parameters=wanted.parameters)
        return plotting.take_map(
            source, parsed, wanted.sweeps, wanted.tracks, options["only"], options["density"], progress
        )


def _outputs(
    output: str | None, source: "Source", wanted: tuple[int, ...] | None, animate: bool, in_world: bool
) -> list[Place]:
    """The files to write: by default named after the log, in the current directory."""
    log = source.name.rpartition("/")[2]
    ending = ".gif" if animate else "-map.png" if in_world else ".png"
    path = place(f"{log}{ending}" if output is None else output)
    # A name that is given is that of a single picture.
    if animate or wanted is None or (output is not None and len(wanted) == 1):
        return [path]
    return [path.with_name(f"{path.stem}-{index}{path.suffix}") for index in wanted]
