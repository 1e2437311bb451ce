"""`lidarcli.plot`: a sweep as in the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import fspath
from typing import Unpack

from lidarcli.choices import VIEWS, Look
from lidarcli.errors import OptionError, warn
from lidarcli.formalism import Parameters
from lidarcli.pipeline.api.keywords import AnyPath, Delay, Plotting, Poses, Ranges, defaults_of
from lidarcli.pipeline.api.options import (
    GivenPaths,
    opening_options,
    parameters_of,
    path_text,
    pose_options,
    rules,
)
from lidarcli.pipeline.api.signatures import with_keywords
from lidarcli.pipeline.api.sources import path_of
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.plotting import PlotOptions, picture_of, sweep_at, take_pictures, write_pictures
from lidarcli.reports.drawing import Axes, Figure, figure_of
from lidarcli.reports.picture import Picture
from lidarcli.stores.url import place
from lidarcli.sweeps import SweepBatch
from lidarcli.times import as_time

_UNASKED = defaults_of(Poses) | defaults_of(Delay) | defaults_of(Ranges) | {"topic": None, "at": None}
"""What says nothing of how a log is read."""

_LOOK = ("width", "dpi", "title", "legend", "vertices")


@with_keywords
def plot(
    log: AnyPath | SweepBatch,
    sweep: int = 0,
    output: AnyPath | None = None,
    parameters: Parameters | None = None,
    axes: Axes | Sequence[Axes] | None = None,
    **options: Unpack[Plotting],
) -> Figure:
    """One sweep with its objects, as `lidarcli plot` draws it.

    Parameters
    ----------
    log : one log as of `read`, of which no more than the sweep needs is read; or a batch of `read`
    sweep : index of the sweep within its topic
    output : picture to write, replaced where it exists: .png, .svg or .pdf; by default none
    parameters : replaces the keywords from `profile` to `walls`
    axes : matplotlib axes to draw on, one for each panel of the view (`scene`: 1, `polar`: 1 that is polar, `sweep`: 2,
        `all`: 3); by default a figure of its own

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


def _picture(
    log: AnyPath | SweepBatch, sweep: int, parameters: Parameters | None, told: GivenPaths
) -> Picture:
    wanted = PlotOptions(
        sweeps=(sweep,),
        topic=told["topic"],
        parameters=parameters_of(parameters, told),
        rules=rules(told),
        opening=opening_options(told),
        background=None if told["background"] is None else fspath(told["background"]),
        tracks=None if told["tracks"] is None else path_text(told["tracks"]),
        poses=pose_options(told),
    )
    if isinstance(log, SweepBatch):
        if asked := [name for name, value in _UNASKED.items() if told[name] != value]:
            raise TypeError(f"only a log can be read with {', '.join(asked)}")
        return picture_of(log, sweep, wanted)
    source = one_log(path_of(log))
    if (at := told["at"]) is not None:
        if sweep:
            raise OptionError("--at names one sweep: give either at or sweep")
        try:
            time = as_time(at)
        except OptionError as err:
            raise OptionError(f"--at: {err}") from None
        wanted = replace(wanted, sweeps=(sweep_at(source, time, wanted.topic, wanted.opening),))
    drawn = take_pictures(source, wanted)
    for line in drawn.damage:
        warn(f"{source.path}: {line}")
    return drawn.pictures[0]
