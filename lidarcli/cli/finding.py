"""Runs of `detect` and `track`: tables below a folder, or the objects alone as one stream or file."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lidarcli.cli.many_logs import Chosen, print_read, print_reads
from lidarcli.cli.messages import Messages, one_line, standard_output
from lidarcli.cli.options import STDOUT
from lidarcli.stores.url import Place, is_url, place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lidarcli.pipeline.inputs.sources import Nothing, Source
    from lidarcli.pipeline.objects.options import DetectOptions
    from lidarcli.pipeline.runs.cluster import Cluster
    from lidarcli.pipeline.runs.folder_run import FolderRun, Plan
    from lidarcli.pipeline.runs.over_logs import Outcome

    Report = Callable[[Source, int], None] | None


@dataclass(frozen=True, slots=True)
class Asked:
    """What was asked of a run over many logs."""

    dry_run: bool
    resume: bool
    overwrite: bool
    """Whether the user has said so."""
    cluster: str | None

    def keeps_manifest(self, chosen: Chosen, several_stored: bool, options: DetectOptions) -> bool:
        """Whether this is one of the runs whose outcomes are written down beside the tables: those of a fleet.

        A run over logs that are named here, or over one, writes its tables and nothing else.
        """
        many = chosen.files_from is not None or chosen.shard is not None or several_stored
        asked = self.resume or self.cluster is not None or options.layout is not None
        return not self.dry_run and (many or asked)


def into_folder(say: Messages, chosen: Chosen, output: str, options: DetectOptions, asked: Asked) -> int:
    """Tables of every log below the folder `output`; the exit code."""
    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import Total, show
    from lidarcli.pipeline.inputs.search import refuse_clashes
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.runs.folder_run import FolderRun
    from lidarcli.pipeline.runs.manifest import refuse_folder

    folder = place(output)
    sources = _begin(say, chosen, options)
    refuse_clashes(sources)
    if asked.cluster is not None and any(isinstance(each, Source) and each.is_stdin for each in sources):
        raise click.UsageError("--cluster reads no standard input: its workers are elsewhere")
    refuse_folder(folder)
    keeps = asked.keeps_manifest(chosen, is_url(output) and len(sources) > 1, options)
    with (
        FolderRun(folder, options, keeps) as run,
        ExitStack() as stack,
    ):
        plan = run.plan(sources, asked.resume, asked.overwrite)
        for note in plan.notes:
            say.info(f"note: {note}")
        if asked.dry_run:
            return _print_plan(run, plan, options)
        if asked.cluster is not None and not options.overwrite:
            run.refuse_existing(plan)
        total = Total()
        for outcome in plan.skipped:
            show(outcome, say)
            total.add(outcome)
        left = plan.left
        cluster = _cluster(say, asked.cluster, stack) if asked.cluster is not None and left else None
        report = stack.enter_context(progress_bar(left, say))
        for outcome in _outcomes(left, folder, options, report, cluster):
            show(outcome, say)
            for note in run.record(outcome):
                say.info(f"  note     {note}")
            total.add(outcome)
            if cluster is not None and not cluster.is_local:
                refuse_elsewhere(outcome)
        total.show(say)
        if run.manifest is not None:
            say.detail(f"  manifest {run.manifest}")
    return total.exit_code([step.source for step in plan.steps])


def into_one(
    say: Messages, chosen: Chosen, output: str, kind: str, options: DetectOptions, dry_run: bool
) -> int:
    """The objects of all logs as one stream to standard output, or in one file; the exit code."""
    from lidarcli.cli.progress import progress_bar
    from lidarcli.cli.summary import Total, show
    from lidarcli.pipeline.detecting import detect_file, detect_stream

    sources = _begin(say, chosen, options)
    if dry_run:
        code = print_reads(sources)
        if output != STDOUT:
            click.echo(f"write  {one_line(output)}")
        return code
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
    return total.exit_code(sources)


def _begin(say: Messages, chosen: Chosen, options: DetectOptions) -> list[Source | Nothing]:
    """The logs of a run, after what is said before it."""
    from lidarcli.machine import keep_freed_memory

    keep_freed_memory()
    say.of_missing_core()
    sources = chosen.sources()
    settings = ", ".join(f"{name}={value}" for name, value in options.as_dict().items())
    say.detail(f"{len(sources)} log{'' if len(sources) == 1 else 's'}; {settings}")
    return sources


def _outcomes(
    sources: Sequence[Source | Nothing],
    folder: Place,
    options: DetectOptions,
    report: Report,
    cluster: Cluster | None,
) -> Iterator[Outcome]:
    """What becomes of each log, here or on a cluster."""
    if cluster is None:
        from lidarcli.pipeline.detecting import detect_files

        yield from detect_files(sources, folder, options, report)
        return
    from lidarcli.pipeline.detecting import detect_to_files
    from lidarcli.pipeline.inputs.sources import Source

    # The working directory of a worker is another.
    there = folder.absolute() if isinstance(folder, Path) else folder
    file = options.poses.file
    poses = (
        replace(options.poses, file=str(Path(file).absolute()))
        if file and not is_url(file)
        else options.poses
    )
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
    from lidarcli.pipeline.runs.over_logs import exit_code

    codes = []
    for step, outputs in run.dry(plan):
        code = print_read(step.source, "read" if step.done is None else "skip")
        for output, is_there in outputs:
            refused = is_there and not options.overwrite
            code = code or (OutputError.exit_code if refused else 0)
            state = (
                " (exists; refused without --overwrite)" if refused else " (is replaced)" if is_there else ""
            )
            click.echo(f"write  {one_line(output)}{state}")
        codes.append(code)
    return exit_code(codes)
