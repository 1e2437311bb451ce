"""`lidarcli detect`: objects of every sweep as tables, or as a stream on stdout."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lidarcli.cli.messages import Messages, standard_output
from lidarcli.cli.object_options import object_options
from lidarcli.cli.options import (
    LOGS,
    MOST,
    GroupedCommand,
    Number,
    csv_geometry,
    csv_options,
    option,
    range_options,
    range_rules,
    read_options,
    reading_options,
)

if TYPE_CHECKING:
    from lidarcli.pipeline.detecting import DetectOptions
    from lidarcli.pipeline.many import Outcome

OUTPUT, BACKGROUND = "Output", "Background"
STDOUT = "-"
FILES = {".parquet": "parquet", ".csv": "csv", ".ndjson": "ndjson", ".jsonl": "ndjson", ".arrow": "arrow"}
"""Suffix of an output that is a file → its format."""
OTHER_FILES = (".json", ".txt", ".tsv", ".gz", ".zst", ".feather", ".xlsx", ".db", ".sqlite", ".html", ".png")
"""Suffixes of files that nobody means as the name of a folder."""


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli detect run.mcap
  lidarcli detect bags/ -o tables --jobs 4 --overwrite
  lidarcli detect run.bag --topic /front_scan --start 10 --end 20 --beams
  lidarcli detect run.mcap --profile paper --range 0.1 12 -o -
  lidarcli detect run.mcap --pose /amcl_pose
  lidarcli detect run.mcap --background empty.background.parquet --removed
  lidarcli detect scan.csv --angle-min -135 --fov 270 --degrees
  cat run.mcap | lidarcli detect - -o - --format csv | head""",
)
@LOGS
@option(
    "-o",
    "--output",
    heading=OUTPUT,
    metavar="DIR",
    default=".",
    show_default="the current directory",
    help="Folder for <log>.objects.parquet and <log>.sweeps.parquet; or one file for the objects of all logs: .parquet, "
    ".csv, .ndjson or .arrow; - streams the objects to stdout.",
)
@option(
    "--format",
    "kind",
    heading=OUTPUT,
    type=click.Choice(["ndjson", "csv", "arrow", "parquet"]),
    default=None,
    help="Format of the stream of -o -.  [default: ndjson]",
)
@option("--beams", heading=OUTPUT, is_flag=True, help="Also write <log>.beams.parquet, one row per beam.")
@option("--overwrite", heading=OUTPUT, is_flag=True, help="Replace files that exist.")
@option(
    "--jobs",
    heading=OUTPUT,
    type=click.IntRange(min=1, max=MOST),
    metavar="N",
    help="Processes to use at most: long logs are split, many go side by side.  [default: as many as pay]",
)
@reading_options
@object_options(walls="Also rows for walls, with the corners of the room.", no_limit="paper or --background")
@option(
    "--background",
    heading=BACKGROUND,
    metavar="FILE",
    type=click.Path(),
    help="Only what differs from this background is an object (docs/background.md); --threshold METRES is then the "
    "least difference.",
)
@option("--removed", heading=BACKGROUND, is_flag=True, help="Also what has gone, as rows of change removed.")
@option("--any-frame", heading=BACKGROUND, is_flag=True, help="Take it for a sensor of another name, too.")
@option(
    "--station-distance",
    "distance",
    heading=BACKGROUND,
    type=Number("METRES", above=0),
    help="How far a sweep may be from a station.  [default: as it was built]",
)
@option(
    "--station-angle",
    "angle",
    heading=BACKGROUND,
    type=Number("DEGREES", above=0),
    help="How far it may be turned away from it.  [default: as it was built]",
)
@range_options
@csv_options
@click.pass_obj
def detect(
    say: Messages,
    /,
    logs: tuple[str, ...],
    output: str,
    kind: str | None,
    beams: bool,
    overwrite: bool,
    jobs: int | None,
    topics: tuple[str, ...],
    start: float | None,
    end: float | None,
    every: int,
    pose: str | None,
    pose_delay: float,
    background: str | None,
    removed: bool,
    any_frame: bool,
    distance: float | None,
    angle: float | None,
    no_return: Any,
    limits: tuple[float, float] | None,
    angle_min: float | None,
    angle_increment: float | None,
    fov: float | None,
    range_max: float | None,
    degrees: bool,
    range_unit: str,
    **parameters: Any,
) -> int:
    """Find the objects of every sweep of every LaserScan topic.

    Writes one row per object to DIR/<log>.objects.parquet and one per sweep to
    DIR/<log>.sweeps.parquet. A log found below a folder keeps its place below DIR.
    """
    one_file = _one_file(output)
    if (output == STDOUT or one_file) and beams:
        raise click.UsageError("--beams writes a file: give -o DIR")
    if output != STDOUT and kind is not None:
        raise click.UsageError("--format is for the stream of -o -; tables are Parquet")
    read = read_options(topics, start, end, every, range_rules(no_return, limits))
    geometry = csv_geometry(angle_min, angle_increment, fov, range_max, degrees, range_unit)

    if background is None and (removed or any_frame or distance is not None or angle is not None):
        raise click.UsageError("--removed, --any-frame and --station-... are for --background FILE")

    from lidarcli.formalism import Parameters
    from lidarcli.pipeline.detecting import DetectOptions

    compared = None
    if background is not None:
        from lidarcli.pipeline.subtracting import BackgroundOptions

        compared = BackgroundOptions.of(
            background,
            removed=removed,
            any_frame=any_frame,
            distance=distance,
            angle=None if angle is None else math.radians(angle),
        )
        if parameters["max_width"] is None:
            # What differs from the background is no wall, however wide it is.
            parameters["max_width"] = math.inf
    options = DetectOptions(
        parameters=Parameters.for_profile(**parameters),
        read=read,
        csv=geometry,
        pose=pose,
        pose_delay=pose_delay,
        background=compared,
        beams=beams,
        overwrite=overwrite,
        jobs=jobs or 0,
    )
    return _detect(say, logs, output, kind or one_file or ("ndjson" if output == STDOUT else None), options)


def _one_file(output: str) -> str | None:
    """The format of an output that is a file; None where it is a folder, or standard output."""
    if os.path.isdir(output) or output.endswith(os.sep):  # noqa: PTH112 (never raises)
        return None
    suffix = Path(output).suffix.lower()
    if suffix in OTHER_FILES:
        raise click.UsageError(
            f"{output}: objects are written as {', '.join(FILES)}; a folder of such a name ends with {os.sep}"
        )
    return FILES.get(suffix)


def _detect(
    say: Messages, logs: tuple[str, ...], output: str, kind: str | None, options: DetectOptions
) -> int:
    """Tables below the folder `output`, or, of a `kind`, the objects alone as a stream or in one file."""
    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import show, show_total
    from lidarcli.pipeline.inputs import find_logs, refuse_clashes
    from lidarcli.pipeline.many import detect_file, detect_files, detect_stream, exit_code
    from lidarcli.pipeline.memory import keep_freed_memory

    keep_freed_memory()
    sources = find_logs(logs)
    if kind is None:
        refuse_clashes(sources)
    settings = ", ".join(f"{name}={value}" for name, value in options.as_dict().items())
    say.detail(f"{len(sources)} log{'' if len(sources) == 1 else 's'}; {settings}")
    outcomes: list[Outcome] = []
    # Data that scrolls by on the terminal leaves no place for a bar.
    bar = nullcontext() if output == STDOUT and standard_output().isatty() else progress_bar(sources, say)
    with bar as report:
        results: Iterator[Outcome]
        if kind is None:
            results = detect_files(sources, Path(output), options, report)
        elif output == STDOUT:
            results = detect_stream(sources, standard_output().buffer, kind, options, report)
        else:
            results = detect_file(sources, Path(output), kind, options, report)
        for outcome in results:
            show(outcome, say)
            outcomes.append(outcome)
    show_total(outcomes, say)
    return exit_code(outcome.exit_code for outcome in outcomes)
