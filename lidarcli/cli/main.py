"""The whole command line: all commands by their names, and errors as exit codes. Nothing heavy at import."""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Mapping, Sequence
from importlib import import_module

import click

from lidarcli.cli.commands import Commands
from lidarcli.cli.declared import DeclaredOption
from lidarcli.cli.messages import MessageWriter
from lidarcli.display.credentials import blotted
from lidarcli.errors import OUT_OF_MEMORY, LidarcliError, OutputError, UnreadableError, is_short_of_memory
from lidarcli.options.forms import Option
from lidarcli.system.interrupts import Terminated

COMMANDS = (
    *("info", "track", "zones", "diff", "detect", "background", "map", "poses", "clean"),
    *("plot", "overlay", "report", "export", "simulate", "config", "completion"),
)
"""Names of the commands, those that answer first; each is in the module of its name, or in that of `HOMES`."""
HOMES = {
    "track": "detect",
    **dict.fromkeys(("config", "completion"), "about"),
    **dict.fromkeys(("diff", "zones", "report"), "checking"),
    **dict.fromkeys(("clean", "overlay", "poses", "export", "simulate", "map"), "writing"),
}


class LazyCommands(Commands):
    """A group that imports a command only when somebody asks for it."""

    superseded: Mapping[str, str] = {"match": "give lidarcli diff RUN RUN..., which takes the same tables, and logs"}

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"lidarcli.cli.{HOMES.get(cmd_name, cmd_name)}"), cmd_name)
        return command


def _print_version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from lidarcli.cli.about import version_text

        click.echo(version_text())
        ctx.exit()


@click.group(
    cls=LazyCommands,
    params=[
        DeclaredOption(
            "version",
            Option(
                "Options", None, False, short="-V", help="Show the version of lidarcli and of its dependencies, and exit."
            ),
            is_eager=True,
            expose_value=False,
            allow_from_autoenv=False,
            callback=_print_version,
        )
    ],
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80, "auto_envvar_prefix": "LIDARCLI"},
    epilog="Exit codes: 0 done, 1 a check fails, 2 usage, 3 some input unreadable, 4 no LaserScan, "
    "5 output refused, 70 internal error, 130 interrupted.",
)
def cli() -> None:
    """Ask a 2D LiDAR log what happened: who came close, what moved, what changed.

    LOG is an MCAP file, a ROS 1 or ROS 2 bag, a text log (CSV, CARMEN and
    others), a folder to search, or - for standard input.
    """


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; its exit code. The one place where errors become exit codes."""
    messages = MessageWriter()
    try:
        code = _invoke(sys.argv[1:] if arguments is None else list(arguments))
        _flush()
    except click.ClickException as err:
        words = io.StringIO()
        err.show(words)
        click.echo(blotted(words.getvalue()), err=True, nl=False)
        return err.exit_code
    except Terminated:
        messages.error("terminated")
        raise
    except (KeyboardInterrupt, click.Abort):
        messages.error("interrupted")
        return 130
    except BrokenPipeError:
        # Whoever read our output has had enough (`| head`). Python must not find out again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except LidarcliError as err:
        messages.error(str(err))
        return err.exit_code
    except Exception as err:
        if is_short_of_memory(err):
            messages.error(OUT_OF_MEMORY)
            return UnreadableError.exit_code
        # What becomes of files the commands say themselves; what has no name is standard output.
        if isinstance(err, OSError) and err.filename is None:
            messages.error(f"cannot write standard output: {err.strerror or err}")
            return OutputError.exit_code
        messages.bug(traceback.format_exc())
        return LidarcliError.exit_code
    return code


def _invoke(arguments: list[str]) -> int:
    """Parse and run. click's own `main` answers a closed pipe and ctrl-C in another manner."""
    if "_LIDARCLI_COMPLETE" in os.environ:
        cli.main(arguments, prog_name="lidarcli")
    try:
        with cli.make_context("lidarcli", arguments) as ctx:
            code = cli.invoke(ctx)
    except click.exceptions.Exit as err:
        return err.exit_code
    return code if isinstance(code, int) else 0


def _flush() -> None:
    """Find out now whether standard output takes what is left of it; one that is closed takes nothing."""
    if sys.stdout is not None:
        sys.stdout.flush()
