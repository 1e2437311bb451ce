"""What `detect` and `track` share: their options, and what is done with them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from lidarcli.choices import GREATEST_COUNT
from lidarcli.cli.finding import Asked, into_folder, into_one
from lidarcli.cli.grouped import OUTPUT, F, option
from lidarcli.cli.many_logs import MANY, Chosen
from lidarcli.cli.messages import Messages
from lidarcli.cli.object_options import OBJECTS, catalogue_option, object_options
from lidarcli.cli.options import STDOUT, Number, Selection, opening_options, range_options, reading_options
from lidarcli.stores.url import place

if TYPE_CHECKING:
    from lidarcli.logs.base import OpenOptions
    from lidarcli.pipeline.objects.following import TrackOptions
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions
    from lidarcli.pipeline.reading.pose_sources import PoseOptions
    from lidarcli.range_rules import RangeRules

BACKGROUND = "Background"
FILES = {".parquet": "parquet", ".csv": "csv", ".ndjson": "ndjson", ".jsonl": "ndjson", ".arrow": "arrow"}
"""Suffix of an output that is a file → its format."""
OTHER_FILES = (".json", ".txt", ".tsv", ".gz", ".zst", ".feather", ".xlsx", ".db", ".sqlite", ".html", ".png")
"""Suffixes of files that nobody means as the name of a folder."""


def detection_options(*, tables: str, memory: bool) -> Callable[[F], F]:
    """Every option of `detect` after the logs, and what `find` takes.

    `tables` names the files that are written; with `memory` things are judged by all sweeps unless somebody asks otherwise.
    """

    def decorate(command: F) -> F:
        for add in reversed(
            (
                option(
                    "-o",
                    "--output",
                    heading=OUTPUT,
                    metavar="DIR",
                    default=".",
                    show_default="the current directory",
                    help=f"Folder for {tables}; or one file for the objects of all logs: .parquet, "
                    ".csv, .ndjson or .arrow; - streams the objects to stdout.",
                ),
                option(
                    "--format",
                    "kind",
                    heading=OUTPUT,
                    type=click.Choice(["ndjson", "csv", "arrow", "parquet"]),
                    default=None,
                    help="Format of the stream of -o -.  [default: ndjson]",
                ),
                option(
                    "--beams",
                    heading=OUTPUT,
                    is_flag=True,
                    help="Also write <log>.beams.parquet, one row per beam.",
                ),
                option(
                    "--explain",
                    heading=OUTPUT,
                    is_flag=True,
                    help="Also fill the column why: what speaks for and against each object being a thing.",
                ),
                option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace files that exist."),
                option(
                    "-j",
                    "--jobs",
                    heading=OUTPUT,
                    type=click.IntRange(min=1, max=GREATEST_COUNT),
                    metavar="N",
                    help="Maximum number of processors: threads share a long log, processes share many logs.  "
                    "[default: automatic]",
                ),
                option(
                    "--resume",
                    heading=MANY,
                    is_flag=True,
                    help="Skip logs that were done with the same parameters and version; repeat what failed or has changed "
                    "(docs/fleet.md).",
                ),
                option(
                    "--partition",
                    "layout",
                    heading=MANY,
                    type=click.Choice(["table", "date"]),
                    default=None,
                    help="A folder for each table, DIR/objects/<log>.parquet; date: and for each day, "
                    "DIR/objects/date=YYYY-MM-DD/.  [default: DIR/<log>.objects.parquet]",
                ),
                option(
                    "--cluster",
                    heading=MANY,
                    metavar="ADDRESS",
                    help="Send the logs to the workers of this Dask cluster, such as tls://host:8786; local:N starts N "
                    "workers here (docs/fleet.md).  [default: this machine]",
                ),
                reading_options,
                object_options(
                    walls="Also write rows for walls, with the corners of the room.",
                    no_limit="paper or --background",
                ),
                option(
                    "--memory/--no-memory",
                    heading=OBJECTS,
                    default=memory,
                    help="Decide what is a thing, and its shape, by all sweeps that saw it, or by each sweep alone.  "
                    f"[default: {'memory' if memory else 'no-memory'}]",
                ),
                option(
                    "--background",
                    heading=BACKGROUND,
                    metavar="FILE",
                    type=click.Path(),
                    help="Find only what differs from this background (docs/background.md); --threshold METRES is then the "
                    "smallest difference.  [default: none]",
                ),
                option(
                    "--removed",
                    heading=BACKGROUND,
                    is_flag=True,
                    help="Also report objects that have disappeared, as rows whose change is removed.",
                ),
                option(
                    "--any-frame",
                    heading=BACKGROUND,
                    is_flag=True,
                    help="Accept a background that was recorded under another frame_id.",
                ),
                option(
                    "--station-distance",
                    "distance",
                    heading=BACKGROUND,
                    type=Number("METRES", above=0),
                    help="How far a sweep may be from a viewpoint of the background.  [default: as it was built]",
                ),
                option(
                    "--station-angle",
                    "angle",
                    heading=BACKGROUND,
                    type=Number("DEGREES", above=0),
                    help="How far a sweep may be turned away from that viewpoint.  [default: as it was built]",
                ),
                catalogue_option,
                range_options,
                opening_options,
            )
        ):
            command = add(command)
        return command

    return decorate


def find(
    say: Messages,
    /,
    chosen: Chosen,
    dry_run: bool,
    resume: bool,
    layout: str | None,
    cluster: str | None,
    output: str,
    kind: str | None,
    beams: bool,
    explain: bool,
    overwrite: bool,
    jobs: int | None,
    selection: Selection,
    poses: PoseOptions,
    background: str | None,
    removed: bool,
    any_frame: bool,
    distance: float | None,
    angle: float | None,
    catalogue: str | None,
    rules: RangeRules,
    opening: OpenOptions,
    tracking: Callable[[], TrackOptions] | None = None,
    **parameters: Any,
) -> int:
    """What `detect` and `track` do with the options that they share.

    `tracking` says how things are followed, where they are; it is asked once all options are found in order.
    """
    one_file = _one_file(output)
    if (output == STDOUT or one_file) and beams:
        raise click.UsageError("--beams writes a file: give -o DIR")
    if output != STDOUT and kind is not None:
        raise click.UsageError("--format is for the stream of -o -; tables are Parquet")
    if (output == STDOUT or one_file) and (resume or layout or cluster is not None):
        raise click.UsageError("--resume, --partition and --cluster are for tables in a folder: give -o DIR")
    if cluster is not None and jobs:
        raise click.UsageError("--jobs is for this machine, --cluster for others")
    compared = _background(background, removed, any_frame, distance, angle)

    from lidarcli.formalism import Parameters
    from lidarcli.pipeline.inputs.catalogue import read_catalogue
    from lidarcli.pipeline.objects.options import DetectOptions

    if compared is not None and parameters["max_width"] is None:
        # What differs from the background is no wall, however wide it is.
        parameters["max_width"] = math.inf
    options = DetectOptions(
        parameters=Parameters.for_profile(**parameters),
        read=selection.read(rules),
        opening=opening,
        poses=poses,
        background=compared,
        catalogue=None if catalogue is None else read_catalogue(catalogue),
        tracking=None if tracking is None else tracking(),
        beams=beams,
        explain=explain,
        overwrite=overwrite or resume,
        layout=layout,
        jobs=jobs or 0,
    )
    kind = kind or one_file or ("ndjson" if output == STDOUT else None)
    if kind is not None:
        return into_one(say, chosen, output, kind, options, dry_run)
    return into_folder(say, chosen, output, options, Asked(dry_run, resume, overwrite, cluster))


def _background(
    file: str | None, removed: bool, any_frame: bool, distance: float | None, angle: float | None
) -> BackgroundOptions | None:
    """What to compare sweeps with, and how."""
    if file is None:
        if removed or any_frame or distance is not None or angle is not None:
            raise click.UsageError("--removed, --any-frame and --station-... are for --background FILE")
        return None
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions

    return BackgroundOptions.of(
        file,
        removed=removed,
        any_frame=any_frame,
        distance=distance,
        angle=None if angle is None else math.radians(angle),
    )


def _one_file(output: str) -> str | None:
    """The format of an output that is a file; None where it is a folder, or standard output."""
    if os.path.isdir(output) or output.endswith(os.sep):  # noqa: PTH112 (never raises)
        return None
    suffix = place(output).suffix.lower()
    if suffix in OTHER_FILES:
        raise click.UsageError(
            f"{output}: objects are written as {', '.join(FILES)}; a folder of such a name ends with {os.sep}"
        )
    return FILES.get(suffix)
