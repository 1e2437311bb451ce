"""Runs over many logs: which ones, and their tables below a folder, or their objects as one stream or file."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lidarcli.cli.messages import Messages, Total, progress_bar, show, standard_output
from lidarcli.display import counted
from lidarcli.options import STDOUT
from lidarcli.screen import one_line
from lidarcli.stores.url import Place, is_url, place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lidarcli.pipeline.inputs.sources import MissingInput, Source
    from lidarcli.pipeline.objects.options import DetectOptions
    from lidarcli.pipeline.runs.cluster import Cluster
    from lidarcli.pipeline.runs.folder_run import FolderRun, Plan
    from lidarcli.pipeline.runs.outcomes import Outcome

    Report = Callable[[Source, int], None] | None


def refuse_no_logs(told: Mapping[str, Any]) -> None:
    """Refuse `ManyLogs` that name no log, or standard input twice (usage errors)."""
    logs, files_from = told["logs"], told["files_from"]
    if not logs and files_from is None:
        raise click.MissingParameter(param_hint="'LOG...'", param_type="argument")
    if STDOUT in logs and files_from == STDOUT:
        raise click.UsageError("standard input is either a log or the list of --files-from")


def chosen_logs(say: Messages, told: Mapping[str, Any]) -> list[Source | MissingInput]:
    """Return the logs that `ManyLogs` names, with notes on those in parts; see `search.choose`."""
    from lidarcli.pipeline.inputs.search import choose

    return choose(told["logs"], told["files_from"], told["base"], told["shard"], told["join"], say.note)


def print_reads(sources: Iterable[Source | MissingInput], writes: Iterable[str] = ()) -> int:
    """Print what would be read and written, a line each; return the exit code."""
    from lidarcli.pipeline.runs.outcomes import exit_code

    code = exit_code([print_read(source) for source in sources])
    for output in writes:
        click.echo(f"write  {one_line(output)}")
    return code


def print_read(source: Source | MissingInput, verb: str = "read") -> int:
    """Print what would be done with one log; the exit code of that."""
    from lidarcli.pipeline.inputs.sources import MissingInput

    if isinstance(source, MissingInput):
        click.echo(f"fail   {one_line(f'{source.label}: {source.error}')}")
        return source.error.exit_code
    size = f" ({source.size:,} bytes)" if source.size else ""
    click.echo(f"{verb:6} {one_line(source.label)}{size}")
    return 0


def keeps_manifest(told: Mapping[str, Any], several_stored: bool) -> bool:
    """Return True if the run writes a manifest of outcomes beside its tables, as for a fleet.

    A run over logs that are named on the command line, or over one log, writes its tables and nothing else.
    """
    many = told["files_from"] is not None or told["shard"] is not None or several_stored
    asked = told["resume"] or told["cluster"] is not None or told["partition"] is not None
    return not told["dry_run"] and (many or asked)


def into_folder(say: Messages, told: Mapping[str, Any], options: DetectOptions) -> int:
    """Write the tables of every log below a folder; return the exit code."""
    from lidarcli.pipeline.inputs.search import refuse_clashes
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.runs.folder_run import FolderRun
    from lidarcli.pipeline.runs.manifest import refuse_folder

    output, address = told["output"], told["cluster"]
    folder = place(output)
    sources = _begin(say, told, options)
    refuse_clashes(sources)
    if address is not None and any(isinstance(each, Source) and each.is_stdin for each in sources):
        raise click.UsageError("--cluster reads no standard input: its workers are elsewhere")
    refuse_folder(folder)
    keeps = keeps_manifest(told, is_url(output) and len(sources) > 1)
    with FolderRun(folder, options, keeps) as run, ExitStack() as stack:
        plan = run.plan(sources, told["resume"], told["overwrite"])
        for note in plan.notes:
            say.note(note)
        if told["dry_run"]:
            return _print_plan(run, plan, options)
        if address is not None and not options.overwrite:
            run.refuse_existing(plan)
        total = Total()
        for outcome in plan.skipped:
            show(outcome, say)
            total.add(outcome)
        left = plan.left
        cluster = _cluster(say, address, stack) if address is not None and left else None
        report = stack.enter_context(progress_bar(left, say))
        for outcome in _outcomes(left, folder, options, report, cluster):
            show(outcome, say)
            say.notes(run.record(outcome))
            total.add(outcome)
            if cluster is not None and not cluster.is_local:
                refuse_elsewhere(outcome)
        total.show(say)
        if run.manifest is not None:
            say.detail(f"  manifest {run.manifest}")
    return say.end(total.exit_code([step.source for step in plan.steps]))


def into_one(say: Messages, told: Mapping[str, Any], kind: str, options: DetectOptions) -> int:
    """Write the objects of all logs to standard output or one file, in one format; return the exit code."""
    from lidarcli.pipeline.detecting import detect_file, detect_stream

    output = told["output"]
    sources = _begin(say, told, options)
    if told["dry_run"]:
        return print_reads(sources, [] if output == STDOUT else [output])
    total = Total()
    # Data that scrolls by on the terminal leaves no place for a bar.
    bar = nullcontext() if output == STDOUT and standard_output().isatty() else progress_bar(sources, say)
    with bar as report:
        results = (
            detect_stream(sources, standard_output().buffer, kind, options, report)
            if output == STDOUT
            else detect_file(sources, place(output), kind, options, report)
        )
        for outcome in results:
            show(outcome, say)
            total.add(outcome)
    total.show(say)
    return say.end(total.exit_code(sources))


def _begin(say: Messages, told: Mapping[str, Any], options: DetectOptions) -> list[Source | MissingInput]:
    """Return the logs of a run, after what is said before it."""
    from lidarcli.machine import keep_freed_memory

    keep_freed_memory()
    say.of_missing_core()
    say.begin(told)
    sources = chosen_logs(say, told)
    settings = ", ".join(f"{name}={value}" for name, value in options.as_dict().items())
    say.detail(f"{counted(len(sources), 'log')}; {settings}")
    return sources


def _outcomes(
    sources: Sequence[Source | MissingInput], folder: Place, options: DetectOptions, report: Report, cluster: Cluster | None
) -> Iterator[Outcome]:
    """Yield the outcome of each log, here or on a cluster."""
    if cluster is None:
        from lidarcli.pipeline.detecting import detect_files

        yield from detect_files(sources, folder, options, report)
        return
    from lidarcli.pipeline.detecting import detect_to_files
    from lidarcli.pipeline.inputs.sources import Source

    # The working directory of a worker is another.
    there = folder.absolute() if isinstance(folder, Path) else folder
    file = options.poses.file
    poses = replace(options.poses, file=str(Path(file).absolute())) if file and not is_url(file) else options.poses
    each = replace(options, jobs=1, cores=1, poses=poses, overwrite=True)
    work = partial(detect_to_files, folder=there, options=each)
    for outcome in cluster.outcomes(sources, work):
        if report is not None and isinstance(outcome.source, Source):
            report(outcome.source, outcome.source.size)
        yield outcome


def _cluster(say: Messages, address: str, stack: ExitStack) -> Cluster:
    # Who uses no cluster does not wait for this import.
    from lidarcli.pipeline.runs.cluster import Cluster

    cluster = stack.enter_context(Cluster(address))
    if cluster.warning is not None:
        say.error(f"--cluster: {cluster.warning}")
    say.info(f"cluster {cluster.about}")
    return cluster


def refuse_elsewhere(outcome: Outcome) -> None:
    """Refuse tables that only the machine of a worker has."""
    from lidarcli.errors import OutputError

    outputs = outcome.summary.outputs if outcome.summary is not None else []
    for output in outputs:
        if not is_url(output) and not Path(output).exists():
            raise OutputError(
                f"{output}: a worker has written it, and it is not here; give -o the URL of a store, or a folder that "
                "all machines share"
            )


def _print_plan(run: FolderRun, plan: Plan, options: DetectOptions) -> int:
    """Print what would be done, a line for each file; the exit code that can be foreseen."""
    from lidarcli.errors import OutputError
    from lidarcli.pipeline.runs.outcomes import exit_code

    codes = []
    for step, outputs in run.dry(plan):
        code = print_read(step.source, "read" if step.done is None else "skip")
        for output, is_there in outputs:
            refused = is_there and not options.overwrite
            code = code or (OutputError.exit_code if refused else 0)
            state = " (exists; refused without --overwrite)" if refused else " (is replaced)" if is_there else ""
            click.echo(f"write  {one_line(output)}{state}")
        codes.append(code)
    return exit_code(codes)
