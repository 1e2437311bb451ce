"""The errors a user can meet, each with its exit code (docs/cli.md lists them). Imports nothing of the package."""

from collections.abc import Iterator
from contextlib import contextmanager

OUT_OF_MEMORY = "not enough memory; allow more, take --jobs 1, or read a part of the log with --start and --end or --every"
"""Message where `is_short_of_memory`; the exit code is that of an `UnreadableError`, since the log could not be read."""
CHECK_FAILED = 1


def is_short_of_memory(err: Exception) -> bool:
    """Return whether an error means that there is no more memory, also for a library that is loaded."""
    signs = ("failed to map segment", "Cannot allocate memory")
    return isinstance(err, MemoryError) or (isinstance(err, ImportError) and any(sign in str(err) for sign in signs))


class LidarcliError(Exception):
    """Root of every error that is not a bug. The message is one line: file, place, cause, way out."""

    exit_code = 70


class OptionError(LidarcliError):
    """An option or a value that cannot be used (a usage error)."""

    exit_code = 2


class UnreadableError(LidarcliError):
    """An input that cannot be read, in whole or in part: the rest is processed; checks of the rest alone do not pass."""

    exit_code = 3


@contextmanager
def unreadable(name: object) -> Iterator[None]:
    """Raise errors of the system as an `UnreadableError` on what is read."""
    try:
        yield
    except OSError as err:
        raise UnreadableError(f"{name}: cannot be read: {err.strerror or err}") from err


class NoScanError(LidarcliError):
    """An input without LaserScan, or without the topic that was asked for."""

    exit_code = 4


class OutputError(LidarcliError):
    """An output that exists already or cannot be written."""

    exit_code = 5


def warn(line: str) -> None:
    """Warn a user of the Python functions, at the line outside of the package that led here."""
    import sys
    import warnings

    package = __name__.partition(".")[0]
    level, outside = 1, 1
    frame = sys._getframe(0).f_back
    while frame is not None:
        level += 1
        if frame.f_globals.get("__name__", "").partition(".")[0] == package:
            outside = level
        frame = frame.f_back
    warnings.warn(line, stacklevel=outside + 1)
