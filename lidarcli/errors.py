"""The errors a user can meet, each with its exit code (docs/cli.md lists them). Imports nothing."""


class LidarcliError(Exception):
    """Root of every error that is not a bug. The message is one line: file, place, cause, way out."""

    exit_code = 70


class OptionError(LidarcliError):
    """An option or a value that cannot be used (a usage error)."""

    exit_code = 2


class UnreadableError(LidarcliError):
    """An input that cannot be read, in whole or in part."""

    exit_code = 3


class NoScanError(LidarcliError):
    """An input without LaserScan, or without the topic that was asked for."""

    exit_code = 4


class OutputError(LidarcliError):
    """An output that exists already or cannot be written."""

    exit_code = 5
