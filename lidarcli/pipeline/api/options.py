"""What the keywords of the Python functions say, as the options that the rooms take."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from os import PathLike, fspath
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.formalism.parameters import Parameters
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.options import open_options, range_rules
from lidarcli.pipeline.api.keywords import AnyPath, Objects, Paths
from lidarcli.pipeline.inputs.catalogue import read_catalogue
from lidarcli.pipeline.objects.subtracting import BackgroundOptions
from lidarcli.pipeline.reading.pose_sources import PoseOptions
from lidarcli.range_rules import RangeRules, parse_no_return

GivenPaths = Mapping[str, Any]
"""Keywords with their values; all those of a group are there."""
OBJECTS = tuple(Objects.__annotations__)
"""Names of the keywords that say what an object is."""
OPENING = ("angle_min", "angle_increment", "fov", "range_max", "degrees", "range_unit", "echo")
"""Names of those that say what a log may need to be told."""


def several(values: Paths) -> list[str]:
    """Paths as text, from one or several (`TypeError` where these are none, such as a table in memory)."""
    if isinstance(values, str | PathLike):
        return [fspath(values)]
    # A data frame would give the names of its columns one by one.
    if not isinstance(values, Iterable) or hasattr(values, "columns"):
        raise TypeError(
            f"tables, logs and outputs are named by their paths, not given as {type(values).__name__}"
        )
    return [path_text(each) for each in values]


def path_text(value: Any) -> str:
    """The path of a file as text (`TypeError` where it is none)."""
    if not isinstance(value, str | PathLike):
        raise TypeError(f"a file is named by its path, not given as {type(value).__name__}")
    return fspath(value)


def read_options(told: GivenPaths) -> ReadOptions:
    """Which sweeps to read, and how ranges are judged."""
    return ReadOptions(topics(told["topic"]), told["start"], told["end"], told["every"], rules=rules(told))


def topics(names: str | Iterable[str] | None) -> frozenset[str] | None:
    """Names of topics; none means all."""
    named = [names] if isinstance(names, str) else names or []
    return frozenset(name for name in named if name) or None


def rules(told: GivenPaths) -> RangeRules:
    """How ranges are judged."""
    no_return = told["no_return"]
    text = no_return if isinstance(no_return, str) else ",".join(map(str, no_return))
    return range_rules(told["range"], parse_no_return(text))


def opening_options(told: GivenPaths) -> OpenOptions:
    """What a log may need to be told."""
    return open_options(
        **{name: told[name] for name in OPENING},
        heights=told["slice"],
        bins=told["bins"],
        limits=told["range"],
    )


def pose_options(told: GivenPaths) -> PoseOptions:
    """Where poses come from, and how they are used."""
    file = None if told["poses"] is None else fspath(told["poses"])
    return PoseOptions(told["pose"], file, told.get("pose_delay"), told["deskew"])


def background_options(told: GivenPaths) -> BackgroundOptions | None:
    """What to compare sweeps with, and how."""
    background, angle = told["background"], told["station_angle"]
    how = {
        "removed": told["removed"],
        "any_frame": told["any_frame"],
        "distance": told["station_distance"],
        "angle": None if angle is None else math.radians(angle),
    }
    if background is None:
        if any(value not in (None, False) for value in how.values()):
            raise OptionError("removed, any_frame, station_distance and station_angle are for a background")
        return None
    if isinstance(background, str | PathLike):
        return BackgroundOptions.of(fspath(background), **how)
    if not background:
        raise OptionError("a background of no sensor: nothing can be compared with it")
    return BackgroundOptions("the background", tuple(background), **how)


def catalogue_of(catalogue: AnyPath | Catalogue | None) -> Catalogue | None:
    """Things of interest, from a file or as they are."""
    return read_catalogue(catalogue) if isinstance(catalogue, str | PathLike) else catalogue


def parameters_of(parameters: Parameters | None, told: GivenPaths, *, subtracted: bool = False) -> Parameters:
    """The parameters as such, or from their keywords."""
    given = {name: told[name] for name in OBJECTS}
    if parameters is not None:
        if not isinstance(parameters, Parameters):
            raise TypeError(f"parameters have to be Parameters, not {type(parameters).__name__}")
        asked = sorted(name for name, value in given.items() if value not in (None, False, "robust"))
        if asked:
            raise TypeError(f"give either parameters or {', '.join(asked)}")
        return parameters
    # What differs from a background is no wall, however wide it is.
    if subtracted and given["max_width"] is None:
        given["max_width"] = math.inf
    return Parameters.for_profile(**given)
