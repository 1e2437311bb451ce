"""`lidarcli.learn`: the background of a scene."""

from __future__ import annotations

import math
from os import fspath
from typing import Unpack

from lidarcli.errors import warn
from lidarcli.formalism.background.model import Background
from lidarcli.pipeline.api.keywords import AnyPath, Learning, Paths
from lidarcli.pipeline.api.options import opening_options, pose_options, read_options
from lidarcli.pipeline.api.signatures import with_keywords
from lidarcli.pipeline.api.sources import sources_of
from lidarcli.pipeline.building import Building, BuildOptions, refuse_nothing, refuse_output
from lidarcli.stores.url import place


@with_keywords
def learn(log: Paths, output: AnyPath | None = None, **options: Unpack[Learning]) -> tuple[Background, ...]:
    """The background of every sensor of one or more logs of a scene without objects of interest.

    Parameters
    ----------
    log : as of `read`
    output : background table to write, replaced where it exists; by default none

    Returns
    -------
    tuple of Background
        One for each sensor; all of them are what `detect(..., background=)` takes.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    OutputError
        The table cannot be written.
    """
    building = Building(
        BuildOptions(
            read=read_options(options),
            opening=opening_options(options),
            poses=pose_options(options),
            distance=options["station_distance"],
            angle=math.radians(options["station_angle"]),
        )
    )
    sources = sources_of(log)
    if output is not None:
        refuse_output(place(fspath(output)), sources, overwrite=True)
    for source in sources:
        for line in building.add(source).damage:
            warn(f"{source.path}: {line}")
    sensors = building.sensors()
    refuse_nothing(sensors)
    if output is not None:
        for note in building.write(place(fspath(output)), sensors):
            warn(note)
    return tuple(sensors)
