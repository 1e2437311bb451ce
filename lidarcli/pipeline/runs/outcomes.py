"""Outcome of the work on one log: what was done, or the reason for which there is nothing."""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from lidarcli.errors import OUT_OF_MEMORY, LidarcliError, UnreadableError, is_short_of_memory
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.one_log import RunSummary

INTERNAL_ERROR = 70
Work = Callable[[Source], RunSummary]
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


@dataclass(frozen=True, slots=True)
class Failure:
    """Reason for which there is no result for one input."""

    error: str
    exit_code: int
    trace: str | None = None


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
    finally:
        # Readers refer to themselves; over many logs such garbage would wait, as the command line looks for it rarely.
        gc.collect(1)


def outcome_of(source: Source | MissingInput, work: Work) -> Outcome:
    """Do the work for one input and return its outcome."""
    result = attempt(source, work)
    if isinstance(result, Failure):
        return Outcome(source.label, result.exit_code, error=result.error, trace=result.trace, source=source)
    return Outcome(source.label, result.exit_code, summary=result, source=source)


def exit_code(codes: Iterable[int]) -> int:
    """Return the exit code of a run over several logs: the first that is not zero."""
    return next((code for code in codes if code), 0)
