"""`lidarcli.overlay`: objects and tracks to be played in step with their log."""

from __future__ import annotations

from os import fspath
from pathlib import Path
from typing import Unpack

from lidarcli.choices import SIGNIFICANCE
from lidarcli.errors import warn
from lidarcli.options import OVERLAY_RULES, AnyPath, Overlaying, Paths
from lidarcli.pipeline.api.options import (
    LogOptions,
    Progress,
    Values,
    detect_options,
    log_options,
    path_text,
    paths_of,
    several,
    tracking_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.inputs.zones import read_zones
from lidarcli.pipeline.overlaying import OverlayOptions, refuse_overlay, write_overlay
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.stores import place


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


def overlay_options(told: Values, logs: LogOptions, *, overwrite: bool = False) -> OverlayOptions:
    """Return what is shown, and how it is found."""
    objects, map_file = told["objects"], told["map"]
    return OverlayOptions(
        detect_options(told, logs, tracking_of({"significance": SIGNIFICANCE, "memory": True})),
        None if objects is None else path_text(objects),
        told["with_log"],
        None if map_file is None else Path(map_file),
        read_zones(several(told["zones"])) if told["zones"] else None,
        told["layout"],
        overwrite,
    )
