"""Several logs, one after the other: one bad log never stops the rest."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeVar

from lidarcli.errors import LidarcliError, UnreadableError
from lidarcli.logs.base import CsvOptions
from lidarcli.newfiles import NewFiles, refuse
from lidarcli.pipeline.detecting import DetectOptions, detect_to_files, detect_to_stream
from lidarcli.pipeline.inputs import Nothing, Source
from lidarcli.pipeline.summary import RunSummary
from lidarcli.sweeps import RangeRules
from lidarcli.tables.metadata import table_metadata
from lidarcli.tables.schemas import OBJECTS
from lidarcli.tables.stream import FORMATS, CountingOutput

if TYPE_CHECKING:
    from lidarcli.pipeline.inspecting import LogInfo

INTERNAL_ERROR = 70
WORTH_A_PROCESS = 16 << 20
"""Bytes of logs whose work outweighs the start of processes; beside a large log, small ones are no reason for it."""

Report = Callable[[Source, int], None]
"""Progress: the log, and the position in it [bytes]."""

Work = Callable[[Source], RunSummary]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one input."""

    label: str
    """The input as the user wrote it, or the log found below it."""
    exit_code: int
    summary: RunSummary | None = None
    error: str | None = None
    trace: str | None = None
    """Traceback of an internal error."""
    remark: str | None = None
    """What happened on the way and was mended."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why there is no result for one input."""

    error: str
    exit_code: int
    trace: str | None = None


def attempt(source: Source | Nothing, work: Callable[[Source], T]) -> T | Failure:
    """Do the work for one input, and turn what goes wrong into a `Failure` so that the others go on."""
    if isinstance(source, Nothing):
        return Failure(str(source.error), source.error.exit_code)
    try:
        return work(source)
    except LidarcliError as err:
        return Failure(str(err).removeprefix(f"{source.path}: "), err.exit_code)
    except BrokenPipeError:
        raise
    except OSError as err:
        return Failure(err.strerror or str(err), UnreadableError.exit_code)
    except Exception as err:
        return Failure(f"internal error: {type(err).__name__}: {err}", INTERNAL_ERROR, traceback.format_exc())


def outcome_of(source: Source | Nothing, work: Work) -> Outcome:
    """The outcome of the work for one input."""
    result = attempt(source, work)
    if isinstance(result, Failure):
        return Outcome(source.label, result.exit_code, error=result.error, trace=result.trace)
    return Outcome(source.label, result.exit_code, summary=result)


def detect_files(
    sources: Sequence[Source | Nothing], folder: Path, options: DetectOptions, report: Report | None = None
) -> Iterator[Outcome]:
    """Write the tables of every log below `folder`, one after the other or several at the same time."""
    jobs = options.jobs or options.cores
    at_once = _at_once(sources, jobs)
    if at_once < 2:
        for source in sources:
            yield outcome_of(
                source, lambda log: detect_to_files(log, folder, options, _progress(log, report))
            )
        return
    from lidarcli.pipeline.workers import side_by_side

    each = replace(options, jobs=options.jobs // at_once, cores=options.cores // at_once)
    for source, outcome in zip(sources, side_by_side(sources, folder, each, at_once), strict=True):
        if report is not None and isinstance(source, Source):
            report(source, source.size)
        yield outcome


def _at_once(sources: Sequence[Source | Nothing], jobs: int) -> int:
    """How many logs to process at the same time, so that it pays and `jobs` processes are enough."""
    logs = [source for source in sources if isinstance(source, Source)]
    # Standard input belongs to this process and cannot be handed to another.
    if any(source.is_stdin for source in logs):
        return 1
    # A log of unknown size, a pipe, may be long.
    sizes = sorted(source.size or WORTH_A_PROCESS for source in logs)
    return min(jobs, len(logs)) if sum(sizes[:-1]) >= WORTH_A_PROCESS else 1


def detect_stream(
    sources: Sequence[Source | Nothing],
    out: IO[bytes],
    kind: str,
    options: DetectOptions,
    report: Report | None = None,
    name: str = "standard output",
) -> Iterator[Outcome]:
    """Write the objects of all logs to one stream of `kind` (ndjson, csv, arrow, parquet), log after log.

    `name` is what errors call the stream.
    """
    guard = CountingOutput(out, name)
    parameters = options.as_dict()
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    try:
        stream = FORMATS[kind](guard, OBJECTS, table_metadata(parameters))

        def work(log: Source) -> RunSummary:
            summary, origin = detect_to_stream(log, stream, options, _progress(log, report))
            described.append(origin)
            damage.extend(summary.damage)
            return summary

        for source in sources:
            yield outcome_of(source, work)
        origin = described[0] if len(described) == 1 else described
        stream.finish(table_metadata(parameters, origin, damage))
    except BaseException:
        # An unfinished stream must not get an end that makes it look whole.
        guard.discard()
        raise


def detect_file(
    sources: Sequence[Source | Nothing],
    path: Path,
    kind: str,
    options: DetectOptions,
    report: Report | None = None,
) -> Iterator[Outcome]:
    """The same into one file, which appears when it is whole, and only if anything could be read."""
    refuse([path], options.overwrite, options.inputs(sources))
    # The last log that could be read, and those after it, wait: it also tells what became of the file.
    waiting: list[Outcome] = []
    with NewFiles([path], options.overwrite) as new:
        with new.part(path).open("wb") as out:
            for outcome in detect_stream(sources, out, kind, options, report, str(path)):
                if outcome.summary is not None:
                    yield from waiting
                    waiting = []
                waiting.append(outcome)
        if waiting and (last := waiting[0].summary) is not None:
            last.notes += new.publish()
            last.outputs.append(str(path))
    yield from waiting


def inspect_logs(
    sources: Sequence[Source | Nothing], csv: CsvOptions, rules: RangeRules, report: Report | None = None
) -> Iterator[tuple[Source | Nothing, LogInfo | Failure]]:
    """What is in every log, log after log."""
    from lidarcli.pipeline.inspecting import inspect_log

    for source in sources:
        yield source, attempt(source, lambda log: inspect_log(log, csv, rules, _progress(log, report)))


def _progress(source: Source, report: Report | None) -> Callable[[int], None] | None:
    return None if report is None else lambda position: report(source, position)


def exit_code(codes: Iterable[int]) -> int:
    """The exit code of a run over several logs: the first that is not zero."""
    return next((code for code in codes if code), 0)
