"""The command line: parses options, calls the pipeline, turns errors into exit codes."""

from lidarcli.cli.commands import run

__all__ = ["run"]
