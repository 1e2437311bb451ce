"""`lidarcli plot`: sweeps as pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import click

from lidarcli.cli.commands import command, usage_errors
from lidarcli.cli.messages import MessageWriter, counted_bar, progress_bar, standard_output
from lidarcli.options.choices import MAP
from lidarcli.options.common import OneLog, Overwrite, output
from lidarcli.options.groups import PLOT_RULES, Plotting, SweepGroup
from lidarcli.options.values import STDOUT


class PlotCommand(OneLog, Overwrite, SweepGroup, Plotting, total=False):
    output: Annotated[
        str | None,
        output("FIG", shown="LOG-N.png here"),
        "File to write: .png, .svg, .pdf, with --animate .gif or .mp4; - for a PNG on stdout.",
    ]


@command(
    PlotCommand,
    changed={
        "max_width": {"shown": "2; paper: no limit", "rare": True},
        **{field: {"rare": True} for field in ("start", "end", "pose")},
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

    from lidarcli.errors import UnreadableError
    from lidarcli.pipeline.api import drawing
    from lidarcli.pipeline.api.options import plot_options
    from lidarcli.pipeline.inputs.search import one_log
    from lidarcli.pipeline.plotting import picture_bytes, write_pictures
    from lidarcli.pipeline.runs.over_logs import progress_of

    with usage_errors():
        drawing.refuse_suffix(output, options)
        wanted, look = replace(plot_options(options), tracks=options["tracks"]), drawing.look_of(options)
    if output == STDOUT and (animate or len(wanted.sweeps or (0,)) != 1):
        raise click.UsageError("standard output takes one picture; give -o FIG")
    source = one_log(options["log"], options["join"])
    wanted = drawing.at_its_time(source, options, wanted)
    log = source.name.rpartition("/")[2]
    name = f"{log}{'.gif' if animate else '-map.png' if view == MAP else '.png'}"
    paths = drawing.refused(output, source, options, wanted, options["overwrite"], name)
    with progress_bar([source], messages) as progress:
        drawn = drawing.draw_log(source, options, wanted, progress_of(source, progress))
    messages.notes(drawn.notes)
    pictures: Sequence[Any] = drawn.pictures
    if output == STDOUT:
        standard_output().buffer.write(picture_bytes(pictures[0], view, ".png", look))
    else:
        with counted_bar(paths[0].name, len(pictures), "frames" if animate else "pictures", messages) as report:
            notes = write_pictures(paths, pictures, view, options["overwrite"], look, report)
        messages.wrote(paths)
        messages.notes(notes)
    for line in drawn.damage:
        messages.error(source.label, line)
    return UnreadableError.exit_code if drawn.damage else 0
