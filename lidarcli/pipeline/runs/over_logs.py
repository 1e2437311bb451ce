"""Work over several logs, of which a bad one never stops the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.one_log import Progress, RunSummary
from lidarcli.pipeline.runs.outcomes import Outcome, outcome_of

WORTH_A_PROCESS = 16 << 20
"""Bytes of logs beside the largest one from which on worker processes pay."""

STORED = 2 << 20
"""Bytes that a log in a store counts at least: its requests take time however small it is."""

LogProgress = Callable[[Source, int], None]
"""Progress: the log, and the position in it [bytes]."""


class LogWork(Protocol):
    """Work on one log that tells its progress."""

    def __call__(self, source: Source, /, *, progress: Progress | None = None) -> RunSummary: ...


def over_logs(
    sources: Sequence[Source | MissingInput], work: LogWork, report: LogProgress | None = None, at_once: int = 1
) -> Iterator[Outcome]:
    """Do the work for one log after the other, or for several at the same time in worker processes.

    Parameters
    ----------
    sources : inputs of the run
    work : what to do with a log; for worker processes a function of a module, or a `partial` of one
    report : hears of the progress of each log, of one in a worker process when it is done
    at_once : logs at the same time, as of `logs_at_once`

    Returns
    -------
    The outcome of each input, in their order.
    """
    if at_once < 2:
        for source in sources:
            yield outcome_of(source, lambda log: work(log, progress=progress_of(log, report)))
        return
    # Most runs need no process and should not wait for this import.
    from lidarcli.pipeline.runs.processes import side_by_side

    for source, outcome in zip(sources, side_by_side(sources, work, at_once), strict=True):
        if report is not None and isinstance(source, Source):
            report(source, source.size)
        yield outcome


def progress_of(source: Source, report: LogProgress | None) -> Callable[[int], None] | None:
    """Return the progress of one log, for the work on it."""
    return None if report is None else lambda position: report(source, position)


def summed(sources: Sequence[Source | MissingInput], show: Callable[[int, int | None, str], object]) -> LogProgress:
    """Return the progress of several logs that tells `show` of the bytes read, of all (None: not known), and the log."""
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
