"""`lidarcli detect`: objects of every sweep as tables, or as a stream on stdout; `track` uses its parts."""

import os
from collections.abc import Mapping
from typing import Annotated, Any

import click

from lidarcli.choices import TABLE_BY_SUFFIX
from lidarcli.cli.commands import command, log_options
from lidarcli.cli.messages import Messages
from lidarcli.cli.runs import into_folder, into_one, refuse_no_logs
from lidarcli.option_forms import Option, Text
from lidarcli.options import MANY, OUTPUT, STDOUT, Beams, Detecting, ManyLogs, Stamped, output
from lidarcli.stores.url import place

OTHER_FILES = (".json", ".txt", ".tsv", ".gz", ".zst", ".feather", ".xlsx", ".db", ".sqlite", ".html", ".png")
"""Suffixes of files that nobody means as the name of a folder."""


class Tables(ManyLogs, Stamped, Beams, total=False):
    """The logs and the tables of `detect` and `track`."""

    output: Annotated[
        str,
        output("DIR", default=".", shown="the current directory"),
        "Folder for the tables, <log>.objects.parquet and so on; or one file for the objects of all logs: .parquet, .csv, "
        ".ndjson or .arrow; - streams the objects to stdout.",
    ]
    format: Annotated[
        str | None,
        Option(OUTPUT, ("ndjson", "csv", "arrow", "parquet", "json"), shown="ndjson"),
        "Format of the stream of -o -; json, beside files: print the summary as JSON (docs/ci.md).",
    ]
    resume: Annotated[
        bool,
        Option(MANY, None, False),
        "Skip logs that were done with the same parameters and version; repeat what failed or has changed (docs/fleet.md).",
    ]
    partition: Annotated[
        str | None,
        Option(MANY, ("table", "date"), shown="DIR/<log>.objects.parquet"),
        "A folder for each table, DIR/objects/<log>.parquet; date: and for each day, DIR/objects/date=YYYY-MM-DD/.",
    ]
    cluster: Annotated[
        str | None,
        Option(MANY, Text("ADDRESS"), shown="this machine"),
        "Send the logs to the workers of this Dask cluster, such as tls://host:8786; local:N starts N workers here "
        "(docs/fleet.md).",
    ]


class DetectCommand(Tables, Detecting, total=False):
    """Options of `detect`."""


@command(
    DetectCommand,
    examples="""\
  lidarcli detect run.mcap
  lidarcli detect bags/ -o tables --jobs 4 --overwrite
  lidarcli detect run.bag --topic /front_scan --start 10 --end 20 --beams
  lidarcli detect run.bag --topic '/scan*' --start 2026-11-22T10:00:00Z
  lidarcli detect run.mcap --profile paper --range 0.1 12 -o -
  lidarcli detect run.mcap --pose /amcl_pose
  lidarcli detect run.mcap --background empty.background.parquet --removed
  lidarcli detect run.bag --background hall.parquet --any-frame
  lidarcli detect run.mcap --catalogue things.toml
  lidarcli detect run.mcap --memory --min-thing 0.5 --explain
  lidarcli detect scan.csv --angle-min -135 --fov 270 --degrees
  lidarcli detect bags/ -o tables --dry-run
  lidarcli detect 's3://robots/2026/*/*.mcap' -o s3://robots/tables/ --resume
  lidarcli detect --files-from new.txt --base s3://robots/ --shard 3/8
  lidarcli detect bags/ -o tables --cluster local:4 --partition date
  cat run.mcap | lidarcli detect - -o - --format csv | head""",
)
def detect(say: Messages, told: DetectCommand) -> int:
    """Find the objects of every sweep of every LaserScan topic.

    Writes one row per object to DIR/<log>.objects.parquet and one per sweep to
    DIR/<log>.sweeps.parquet. Sub-folders of LOG are mirrored below DIR.
    """
    return find(say, told, follow=False)


def find(say: Messages, told: Mapping[str, Any], *, follow: bool) -> int:
    """Find objects as `detect` and `track` do, and write them; return the exit code.

    Parameters
    ----------
    told : values of `Tables`, and of `Tracking` where things are followed, else of `Detecting`
    follow : True for tracks
    """
    output = told["output"]
    one_file = _one_file(output)
    is_one = output == STDOUT or one_file
    refuse_no_logs(told)
    if is_one and told["beams"]:
        raise click.UsageError("--beams writes a file: give -o DIR")
    if output != STDOUT and told["format"] not in (None, "json"):
        raise click.UsageError("--format is for the stream of -o -, or json for the summary; tables are Parquet")
    if output == STDOUT and told["format"] == "json":
        raise click.UsageError("--format json is the summary, for -o DIR; objects as JSON are --format ndjson")
    if is_one and (told["resume"] or told["partition"] or told["cluster"] is not None):
        raise click.UsageError("--resume, --partition and --cluster are for tables in a folder: give -o DIR")

    from lidarcli.pipeline.api.options import detect_options, memory_of, tracking_of

    options = detect_options(
        told,
        log_options(told),
        tracking_of(told) if follow else memory_of(told),
        beams=told["beams"],
        overwrite=told["overwrite"] or told["resume"],
        layout=told["partition"],
    )
    kind = one_file or (told["format"] or "ndjson" if output == STDOUT else None)
    return into_folder(say, told, options) if kind is None else into_one(say, told, kind, options)


def _one_file(output: str) -> str | None:
    """The format of an output that is a file; None for a folder or standard output."""
    if os.path.isdir(output) or output.endswith(os.sep):  # noqa: PTH112 (never raises)
        return None
    suffix = place(output).suffix.lower()
    if suffix in OTHER_FILES:
        raise click.UsageError(
            f"{output}: objects are written as {', '.join(TABLE_BY_SUFFIX)}; a folder of such a name ends with {os.sep}"
        )
    return TABLE_BY_SUFFIX.get(suffix)
