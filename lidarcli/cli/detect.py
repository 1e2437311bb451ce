"""`lidarcli detect` and `track`: objects of every sweep as tables below a folder, as one file, or as a stream on stdout."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from lidarcli.cli.commands import command, log_options
from lidarcli.cli.messages import (
    MessageWriter,
    Total,
    chosen_logs,
    print_read,
    print_reads,
    progress_bar,
    show,
    standard_output,
)
from lidarcli.display.screen import one_line
from lidarcli.display.texts import counted
from lidarcli.files.stores import Place, absolute, is_url, place
from lidarcli.options.choices import TABLE_BY_SUFFIX
from lidarcli.options.common import ManyLogs, Stamped, output
from lidarcli.options.forms import Option, Text
from lidarcli.options.objects import Detecting, Tracking
from lidarcli.options.values import MANY, OUTPUT, STDOUT

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import MissingInput, Source
    from lidarcli.pipeline.objects.detection import DetectOptions
    from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome
    from lidarcli.pipeline.runs.table_folder import FolderStep, TableFolder

OTHER_FILES = (".json", ".txt", ".tsv", ".gz", ".zst", ".feather", ".xlsx", ".db", ".sqlite", ".html", ".png")
"""Suffixes of files that nobody means as the name of a folder."""


class TableGroup(ManyLogs, Stamped, total=False):
    """The logs and the tables of `detect` and `track`."""

    output: Annotated[
        str,
        output("DIR", default=".", shown="the current directory"),
        "Folder for the tables; or one file for the objects of all logs: .parquet, .csv, .ndjson or .arrow; - for stdout.",
    ]
    format: Annotated[
        str | None,
        Option(OUTPUT, ("ndjson", "csv", "arrow", "parquet", "json"), shown="ndjson"),
        "Format of -o -; json, with a folder: print the summary as JSON (docs/ci.md).",
    ]
    resume: Annotated[
        bool,
        Option(MANY, None, False, rare=True),
        "Skip logs that were done with the same parameters and version; repeat what failed or has changed (docs/fleet.md).",
    ]
    partition: Annotated[
        str | None,
        Option(MANY, ("table", "date"), shown="DIR/<log>.objects.parquet", rare=True),
        "A folder for each table, DIR/objects/<log>.parquet; date: and for each day, DIR/objects/date=YYYY-MM-DD/.",
    ]
    cluster: Annotated[
        str | None,
        Option(MANY, Text("ADDRESS"), shown="this machine", rare=True),
        "Send the logs to the workers of this Dask cluster, such as tls://host:8786; local:N starts N workers here "
        "(docs/fleet.md).",
    ]


class DetectCommand(TableGroup, Detecting, total=False):
    """Options of `detect`."""


@command(
    DetectCommand,
    changed={field: {"rare": False} for field in ("profile", "walls")},
    examples="""\
  lidarcli detect run.mcap
  lidarcli detect bags/ -o tables --jobs 4 --overwrite
  lidarcli detect run.bag --topic /front_scan --start 10 --end 20 --beams
  lidarcli detect run.mcap --profile paper --range 0.1 12 -o -
  lidarcli detect run.bag --topic '/scan*' --start 2026-11-22T10:00:00Z
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
def detect(messages: MessageWriter, options: DetectCommand) -> int:
    """Find the objects of every sweep, without following them.

    Writes one row per object to DIR/<log>.objects.parquet and one per sweep to
    DIR/<log>.sweeps.parquet. Sub-folders of LOG are mirrored below DIR.
    """
    return find(messages, options, follow=False)


class TrackCommand(TableGroup, Tracking, total=False):
    """Options of `track`."""


@command(
    TrackCommand,
    examples="""\
  lidarcli track run.mcap
  lidarcli track bags/ -o tables --jobs 4 --overwrite
  lidarcli track run.mcap --background empty.background.parquet
  lidarcli track run.bag --pose /amcl_pose --agent-score 0.8
  lidarcli track --join run_0.bag run_1.bag run_2.bag --no-trajectories
  cat run.mcap | lidarcli track - -o - | jq -c 'select(.set == "A")'""",
)
def track(messages: MessageWriter, options: TrackCommand) -> int:
    """Find who and what moved: when, how far and how fast.

    Finds objects as `lidarcli detect` does, with the same options, and follows them as
    tracks. A track that moves by itself is an agent (set A). Writes one row per track to
    DIR/<log>.tracks.parquet and its place in each sweep to
    DIR/<log>.trajectories.parquet, beside the tables of objects and sweeps.
    """
    return find(messages, options, follow=True)


def find(messages: MessageWriter, options: Mapping[str, Any], *, follow: bool) -> int:
    """Find objects as `detect` and `track` do, and write them; return the exit code.

    Parameters
    ----------
    options : values of `TableGroup`, and of `Tracking` where objects are followed, else of `Detecting`
    follow : True for tracks
    """
    target = options["output"]
    one_file = _one_file(target)
    is_one = target == STDOUT or one_file
    if is_one and options["beams"]:
        raise click.UsageError("--beams writes a file: give -o DIR")
    if target != STDOUT and options["format"] not in (None, "json"):
        raise click.UsageError("--format is for the stream of -o -, or json for the summary; tables are Parquet")
    if target == STDOUT and options["format"] == "json":
        raise click.UsageError("--format json is the summary, for -o DIR; objects as JSON are --format ndjson")
    if is_one and (options["resume"] or options["partition"] or options["cluster"] is not None):
        raise click.UsageError("--resume, --partition and --cluster are for tables in a folder: give -o DIR")

    from lidarcli.pipeline.api.options import detect_options, memory_of, tracking_of

    parsed = detect_options(
        options,
        log_options(options),
        tracking_of(options) if follow else memory_of(options),
        beams=options["beams"],
        overwrite=options["overwrite"] or options["resume"],
        layout=options["partition"],
    )
    kind = one_file or (options["format"] or "ndjson" if target == STDOUT else None)
    return _into_folder(messages, options, parsed) if kind is None else _into_one(messages, options, kind, parsed)


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


def _into_folder(messages: MessageWriter, options: Mapping[str, Any], parsed: "DetectOptions") -> int:
    """Write the tables of every log below a folder; return the exit code."""
    from lidarcli.pipeline.detecting import detect_files
    from lidarcli.pipeline.inputs.search import refuse_clashes
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.runs.table_folder import TableFolder

    address = options["cluster"]
    folder = place(options["output"])
    sources = _begin(messages, options, parsed)
    refuse_clashes(sources)
    if address is not None and any(isinstance(each, Source) and each.is_stdin for each in sources):
        raise click.UsageError("--cluster reads no standard input: its workers are elsewhere")
    tables = TableFolder(folder, parsed)
    steps = tables.plan(sources, resume=options["resume"], overwrite=options["overwrite"])
    if options["dry_run"]:
        return _print_plan(tables, steps, parsed)
    if address is not None and not parsed.overwrite:
        steps = tables.refused(steps)
    total = Total()
    for step in steps:
        if step.done is not None:
            show(step.done, messages)
            total.add(step.done)
    left = [step.source for step in steps if step.done is None]
    with progress_bar(left, messages) as report:
        if address is None or not left:
            outcomes = detect_files(left, folder, parsed, report)
        else:
            outcomes = _on_cluster(messages, left, folder, parsed, report, address)
        for outcome in outcomes:
            show(outcome, messages, alone=len(steps) == 1)
            messages.notes(tables.remove_other_days(outcome))
            total.add(outcome)
    total.show(messages)
    return messages.end(total.exit_code([step.source for step in steps]))


def _into_one(messages: MessageWriter, options: Mapping[str, Any], kind: str, parsed: "DetectOptions") -> int:
    """Write the objects of all logs to standard output or one file, in one format; return the exit code."""
    from lidarcli.pipeline.detecting import detect_file, detect_stream

    output = options["output"]
    sources = _begin(messages, options, parsed)
    if options["dry_run"]:
        return print_reads(sources, [] if output == STDOUT else [output])
    total = Total()
    # Data that scrolls by on the terminal leaves no place for a bar.
    bar = nullcontext() if output == STDOUT and standard_output().isatty() else progress_bar(sources, messages)
    with bar as report:
        results = (
            detect_stream(sources, standard_output().buffer, kind, parsed, report)
            if output == STDOUT
            else detect_file(sources, place(output), kind, parsed, report)
        )
        for outcome in results:
            show(outcome, messages, alone=len(sources) == 1)
            total.add(outcome)
    total.show(messages)
    return messages.end(total.exit_code(sources))


def _begin(messages: MessageWriter, options: Mapping[str, Any], parsed: "DetectOptions") -> "list[Source | MissingInput]":
    """Return the logs of a run, after what is said before it."""
    messages.begin(options, finds=True)
    sources = chosen_logs(messages, options)
    shown = ", ".join(f"{name}={value}" for name, value in parsed.as_dict().items())
    messages.detail(f"{counted(len(sources), 'log')}; {shown}")
    return sources


def _on_cluster(
    messages: MessageWriter,
    sources: "Sequence[Source | MissingInput]",
    folder: Place,
    parsed: "DetectOptions",
    report: "LogProgress | None",
    address: str,
) -> "Iterator[Outcome]":
    """Yield the outcome of each log on a cluster (`OutputError` where only the machine of a worker has its tables)."""
    from lidarcli.errors import OutputError
    from lidarcli.pipeline.detecting import detect_to_files
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.runs import cluster

    # The working directory of a worker is another.
    elsewhere = folder.absolute() if isinstance(folder, Path) else folder
    file = parsed.poses.file
    poses = replace(parsed.poses, file=str(Path(file).absolute())) if file and not is_url(file) else parsed.poses
    work = partial(detect_to_files, folder=elsewhere, options=replace(parsed, jobs=1, cores=1, poses=poses, overwrite=True))
    with cluster.connected(address) as client:
        where, workers, threads = cluster.size_of(client)
        if (warning := cluster.danger(where)) is not None:
            messages.error(f"--cluster: {warning}")
        messages.info(f"cluster {where}: {counted(workers, 'worker')}, {counted(threads, 'thread')}")
        for outcome in cluster.outcomes(client, sources, work):
            if report is not None and isinstance(outcome.source, Source):
                report(outcome.source, outcome.source.size)
            yield outcome
            for name in outcome.summary.outputs if outcome.summary is not None else ():
                if not is_url(name) and not Path(name).exists():
                    raise OutputError(
                        f"{name}: a worker has written it, and it is not here; give -o the URL of a store, or a folder "
                        "that all machines share"
                    )


def _print_plan(tables: "TableFolder", steps: "Sequence[FolderStep]", parsed: "DetectOptions") -> int:
    """Print what would be done, a line for each file; return the exit code that can be foreseen."""
    from lidarcli.errors import OutputError
    from lidarcli.pipeline.inputs.sources import MissingInput
    from lidarcli.pipeline.runs.over_logs import exit_code

    codes = []
    for source, done in ((step.source, step.done) for step in steps):
        code = print_read(source, "read" if done is None else "skip")
        for name in () if done is not None or isinstance(source, MissingInput) else tables.outputs(source):
            is_there = tables.is_there(absolute(name))
            refused = is_there and not parsed.overwrite
            code = code or (OutputError.exit_code if refused else 0)
            state = " (exists; refused without --overwrite)" if refused else " (is replaced)" if is_there else ""
            click.echo(f"write  {one_line(name)}{state}")
        codes.append(code)
    return exit_code(codes)
