"""`lidarcli.plot` and `lidarcli.overlay`: sweeps as pictures, and objects to be played in step with their log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import fspath
from pathlib import Path
from typing import Unpack

from lidarcli.choices import SIGNIFICANCE, TRAIL, VIEWS, Look
from lidarcli.errors import OptionError, warn
from lidarcli.formalism import Parameters
from lidarcli.options import (
    OVERLAY_RULES,
    PLOT_RULES,
    AnyPath,
    Delay,
    Joining,
    Overlaying,
    Paths,
    Plotting,
    Poses,
    Ranges,
    Tables,
)
from lidarcli.pipeline.api.options import (
    LogOptions,
    Progress,
    Values,
    detect_options,
    log_options,
    parameters_of,
    path_text,
    paths_of,
    refuse_reading,
    several,
    tracking_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.inputs.tables import TableSet, tables_of
from lidarcli.pipeline.inputs.zones import read_zones
from lidarcli.pipeline.overlaying import OverlayOptions, refuse_overlay, write_overlay
from lidarcli.pipeline.plotting import PlotOptions, picture_of, sweep_at, take_pictures, write_pictures
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.reports.picture import Axes, Figure, Picture, figure_of
from lidarcli.stores.url import place
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular.reading import HeldTable
from lidarcli.times import as_time

_LOOK = ("width", "dpi", "title", "legend", "vertices")


@with_keywords(PLOT_RULES)
def plot(
    log: Paths | SweepBatch,
    sweep: int = 0,
    output: AnyPath | None = None,
    parameters: Parameters | None = None,
    axes: Axes | Sequence[Axes] | None = None,
    **options: Unpack[Plotting],
) -> Figure:
    """One sweep with its objects, as `lidarcli plot` draws it.

    Parameters
    ----------
    log : one log as of `read`, with `join` its parts, of which no more than the sweep needs is read; or a batch of `read`
    sweep : index of the sweep within its topic
    output : picture to write, replaced where it exists: .png, .svg or .pdf; by default none
    parameters : replaces the keywords from `profile` to `walls`
    axes : matplotlib axes to draw on, one for each panel of the view (`scene`: 1, `sweep`: 2, `all`: 3; with
        a background 2 more); by default a figure of its own

    Returns
    -------
    matplotlib.figure.Figure
        The figure; a notebook shows it. It belongs to no window: give `axes` of a figure that has one.

    Raises
    ------
    UnreadableError, NoScanError
        As of `read`.
    OptionError
        As of `read`, the sweep is not there, or there are not as many axes as panels.
    OutputError
        The picture cannot be written.
    """
    if options["view"] not in VIEWS:
        raise OptionError(f"--view: '{options['view']}' is not one of {', '.join(VIEWS)}")
    picture = _picture(log, sweep, parameters, options)
    look = Look(**{name: options[name] for name in _LOOK})  # type: ignore[literal-required]
    if output is not None:
        for note in write_pictures([place(fspath(output))], [picture], options["view"], True, look):
            warn(note)
    return figure_of(picture, options["view"], [axes] if isinstance(axes, Axes) else axes, look)


class _OfLogs(Joining, Poses, Delay, Ranges):
    """Options for reading the log of which a sweep is drawn."""


def plot_options(options: Values, parameters: Parameters | None, sweeps: tuple[int, ...] | None) -> PlotOptions:
    """Return what is drawn of some sweeps, None for all, and how it is found; without tracks."""
    read, opening, poses = log_options({**options, "topic": None, "start": None, "end": None})
    return PlotOptions(
        sweeps=sweeps,
        topic=options["topic"],
        parameters=parameters_of(parameters, options),
        rules=read.rules,
        opening=opening,
        background=None if options["background"] is None else fspath(options["background"]),
        trail=TRAIL if options["trail"] is None else options["trail"],
        poses=poses,
        start=options.get("start"),
        end=options.get("end"),
        zones=read_zones(several(options["zones"])) if options["zones"] else None,
    )


def _picture(log: Paths | SweepBatch, sweep: int, parameters: Parameters | None, options: Values) -> Picture:
    wanted = plot_options(options, parameters, (sweep,))
    if isinstance(log, SweepBatch):
        refuse_reading(options, _OfLogs, "topic", "at")
        if options["zones"]:
            raise TypeError("zones are drawn into the sweep of a log, not of a batch")
        return picture_of(log, sweep, replace(wanted, tracks=_tracks(options["tracks"], log.log)))
    source = one_log(paths_of(log), options["join"])
    wanted = replace(wanted, tracks=_tracks(options["tracks"], source.name))
    if (at := options["at"]) is not None:
        if sweep:
            raise OptionError("--at names one sweep: give either at or sweep")
        try:
            time = as_time(at)
        except OptionError as err:
            raise OptionError(f"--at: {err}") from None
        wanted = replace(wanted, sweeps=(sweep_at(source, time, wanted.topic, wanted.opening),))
    drawn = take_pictures(source, wanted)
    for line in drawn.damage:
        warn(f"{source.label}: {line}")
    return drawn.pictures[0]


def _tracks(tables: Tables | None, log: str) -> str | TableSet | None:
    """Return the tables of the log that is drawn: of those of several logs its own."""
    if tables is None:
        return None
    given = tables_of(tables)
    found = [each for each in given if not isinstance(each, HeldTable)]
    if len(found) < len(given):
        raise OptionError("--tracks: give what track returns, not a table of changes")
    mine = [each for each in found if isinstance(each, TableSet) and each.log == log]
    if len(found) != 1 and len(mine) != 1:
        raise OptionError(f"--tracks: give the tables of {log or 'one log'}, not those of {len(found)} logs")
    return found[0] if len(found) == 1 else mine[0]


@with_keywords(OVERLAY_RULES)
def overlay(
    log: Paths, output: AnyPath, overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Overlaying]
) -> list[str]:
    """Write objects and tracks as markers that viewers play in step with the log.

    Parameters
    ----------
    log : one log as of `read`, with `join` its parts
    output : file to write: .mcap (ROS 2) or .bag (ROS 1)
    overwrite : True to replace files that exist

    Returns
    -------
    list of str
        The files that were written: the overlay, and beside it settings of viewers.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`; also where the tables or the map cannot be read, or the suffix names no overlay.
    OutputError
        A file exists, or cannot be written.
    """
    how = overlay_options(options, log_options(options), overwrite=overwrite)
    source, path = one_log(paths_of(log), options["join"]), place(fspath(output))
    refuse_overlay(path, source, how)
    with watched(progress, [source]) as report:
        summary = write_overlay(source, path, how, progress_of(source, report))
    for line in summary.damage:
        warn(f"{source.label}: {line}")
    return summary.outputs


def overlay_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> OverlayOptions:
    """Return what is shown, and how it is found."""
    objects, map_file = options["objects"], options["map"]
    return OverlayOptions(
        detect_options(options, logs, tracking_of({"significance": SIGNIFICANCE, "memory": True})),
        None if objects is None else path_text(objects),
        options["with_log"],
        None if map_file is None else Path(map_file),
        read_zones(several(options["zones"])) if options["zones"] else None,
        options["layout"],
        overwrite,
    )
