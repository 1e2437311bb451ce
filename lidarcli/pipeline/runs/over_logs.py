"""Work over several logs, of which a bad one never stops the rest: the outcome of each."""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from typing import Any, Protocol, TypeVar

from lidarcli.errors import OUT_OF_MEMORY, LidarcliError, UnreadableError, is_short_of_memory
from lidarcli.logs.registry import no_scan_topic
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.one_log import Progress, RunSummary
from lidarcli.system.records import dataclass, field, replace

INTERNAL_ERROR = 70
DIED_TWICE = "its worker process died twice, ended by the system (out of memory?); try it alone with --jobs 1"
WORTH_A_PROCESS = 16 << 20
"""Bytes of logs in addition to the largest one from which on worker processes pay."""
STORED = 2 << 20
"""Bytes that a log in a store counts at least: its requests take time however small it is."""

Work = Callable[[Source], RunSummary]
LogProgress = Callable[[Any, int], None]
"""Progress: the log, and the position in it [bytes]."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one input."""

    label: str
    """The input as the user wrote it, or the log found below it."""
    exit_code: int
    summary: RunSummary | None = None
    error: str | None = None
    trace: str | None = None
    """Traceback of an internal error."""
    remark: str | None = None
    """Note on trouble that was overcome."""
    source: Source | MissingInput | None = field(default=None, compare=False)
    """The input it is about."""
    skipped: bool = False
    """True where it was done before, and nothing was read now."""

    @property
    def problems(self) -> list[str]:
        """Reasons for which not all was read, one line each."""
        run = self.summary
        return [self.error or ""] if run is None else [*run.damage, *(no_scan_topic([one]) for one in run.missing_topics)]


@dataclass(frozen=True, slots=True)
class Failure:
    """Reason for which there is no result for one input."""

    error: str
    exit_code: int
    trace: str | None = None


class LogWork(Protocol):
    """Work on one log that reports its progress."""

    def __call__(self, source: Source, /, *, progress: Progress | None = None) -> RunSummary: ...


def over_logs(
    sources: Sequence[Source | MissingInput], work: LogWork, report: LogProgress | None = None, at_once: int = 1
) -> Iterator[Outcome]:
    """Do the work for one log after the other, or for several at once in worker processes; yield the outcomes in order.

    For worker processes the work is a function of a module, or a `partial` of one, and `report` takes the progress of a log
    when it is done.
    """
    if at_once < 2:
        for source in one_by_one(sources):
            yield outcome_of(source, partial(work, progress=progress_of(source, report)))
        return
    # Most runs need no process and should not wait for this import.
    from lidarcli.pipeline.runs.processes import side_by_side

    with closing(side_by_side(sources, partial(outcome_of, work=work), at_once)) as outcomes:
        for source, (outcome, is_second_try) in zip(sources, outcomes, strict=True):
            if report is not None and isinstance(source, Source):
                report(source, source.size)
            if outcome is None:
                outcome = Outcome(source.label, INTERNAL_ERROR, error=DIED_TWICE, source=source)
            elif is_second_try:
                outcome = replace(outcome, remark="a worker process died; this log was done again")
            yield outcome


def one_by_one(sources: Iterable[T]) -> Iterator[T]:
    """Yield the inputs; what one has left is cleared away before the next."""
    for number, source in enumerate(sources):
        if number:
            # Readers refer to themselves; such garbage would wait, as the command line looks for it rarely.
            gc.collect(1)
        yield source


def outcome_of(source: Source | MissingInput, work: Work) -> Outcome:
    """Do the work for one input and return its outcome."""
    result = attempt(source, work)
    if isinstance(result, Failure):
        return Outcome(source.label, result.exit_code, error=result.error, trace=result.trace, source=source)
    return Outcome(source.label, result.exit_code, summary=result, source=source)


def attempt(source: Source | MissingInput, work: Callable[[Source], T]) -> T | Failure:
    """Do the work for one input, and turn its errors into a `Failure`, so that the other inputs are done."""
    if isinstance(source, MissingInput):
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
        if is_short_of_memory(err):
            return Failure(OUT_OF_MEMORY, UnreadableError.exit_code)
        return Failure(f"internal error: {type(err).__name__}: {err}", INTERNAL_ERROR, traceback.format_exc())


def exit_code(codes: Iterable[int]) -> int:
    """Return the exit code of a run over several logs: the first that is not zero."""
    return next((code for code in codes if code), 0)


def progress_of(source: Source | MissingInput, report: LogProgress | None) -> Progress | None:
    """Return the progress of one log, for the work on it."""
    return None if report is None else partial(report, source)


def summed(sources: Sequence[Source | MissingInput], show: Callable[[int, int | None, str], object]) -> LogProgress:
    """Return the progress of several logs: `show` gets the bytes read, those of all (None: not known), and the log."""
    sizes = [source.size for source in sources if isinstance(source, Source)]
    total = sum(sizes) if all(sizes) else None
    read: dict[Source, int] = {}

    def report(source: Source, position: int) -> None:
        read[source] = position
        show(sum(read.values()), total, source.name)

    return report


def logs_at_once(sources: Sequence[Source | MissingInput], jobs: int) -> int:
    """Return the number of logs to process at the same time: more than one only where it pays, and at most `jobs`."""
    logs = [source for source in sources if isinstance(source, Source)]
    # Standard input belongs to this process and cannot be handed to another.
    if any(source.is_stdin for source in logs):
        return 1
    # A log of unknown size, a pipe, may be long; one in a store keeps waiting however small it is.
    sizes = sorted(max(source.size or WORTH_A_PROCESS, STORED * (source.url is not None)) for source in logs)
    return min(jobs, len(logs)) if sum(sizes[:-1]) >= WORTH_A_PROCESS else 1
