"""The command line: commands made of declared groups of options, by their names, and errors as exit codes.

Nothing heavy at import.
"""

from __future__ import annotations

import io
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from inspect import cleandoc
from itertools import chain
from typing import TYPE_CHECKING, Any, NoReturn

import click
from click.core import ParameterSource

from lidarcli._version import __version__
from lidarcli.cli.declared import ORIGINS, OTHER, DeclaredOption, click_type
from lidarcli.cli.messages import MessageWriter
from lidarcli.display.credentials import blotted
from lidarcli.display.texts import nearest
from lidarcli.errors import OUT_OF_MEMORY, LidarcliError, OptionError, OutputError, UnreadableError, is_short_of_memory
from lidarcli.options.common import RULES
from lidarcli.options.forms import File, Option, OptionRule, arguments_of, options_of, refuse_combinations
from lidarcli.options.values import STDOUT
from lidarcli.system import compiled
from lidarcli.system.interrupts import Terminated

if TYPE_CHECKING:
    from lidarcli.pipeline.api.options import LogOptions


@contextmanager
def usage_errors() -> Iterator[None]:
    """Turn an `OptionError` whose words begin with an option into a usage error; any other is on what a file says."""
    try:
        yield
    except OptionError as err:
        name, mark, words = str(err).partition(": ")
        if not name.startswith("--"):
            raise
        if mark and " " not in name:
            raise click.BadParameter(f"{words}.", param_hint=f"'{name}'") from err
        raise click.UsageError(str(err)) from err


def log_options(options: Mapping[str, Any]) -> LogOptions:
    """Return how a command reads its logs."""
    from lidarcli.pipeline.api.options import log_options

    with usage_errors():
        return log_options(options)


TYPED = "lidarcli.typed"
"""Key of the context's `meta` for which of -v and -q are on the command line."""
SHOWS_ALL = "lidarcli.help_all"
"""Key of the context's `meta` that is set while `--help-all` prints."""

Work = Callable[[MessageWriter, Any], int]
"""Body of a command: it gets the values of the arguments and options by their fields, and returns the exit code."""


def command(
    group: type, *, examples: str, changed: Mapping[str, Mapping[str, Any]] | None = None, rules: Sequence[OptionRule] = ()
) -> Callable[[Work], Callable[[], DeclaredCommand]]:
    """Put a function that returns the command in place of its body: making one takes as long as imports of many modules.

    Parameters
    ----------
    group : arguments and options of the command
    examples : lines for the end of the help
    changed : field -> what its option has in this command otherwise than declared
    rules : combinations of its options that are refused, in addition to `RULES`
    """

    def decorate(work: Work) -> Callable[[], DeclaredCommand]:
        return cache(partial(made, work))

    def made(work: Work) -> DeclaredCommand:
        options = options_of(group)
        options |= {field: replace(options[field], **otherwise) for field, otherwise in (changed or {}).items()}
        options = dict(sorted(options.items(), key=lambda item: item[1].short != "-o"))
        return DeclaredCommand(
            work.__name__,
            params=[*_arguments(group), *(DeclaredOption(*item) for item in options.items())],
            callback=partial(
                _run,
                work,
                options,
                [
                    field
                    for field, each in (options | arguments_of(group)).items()
                    if isinstance(each.value, File) and not each.value.is_output
                ],
                (*RULES, *rules),
            ),
            help=cleandoc(work.__doc__ or ""),
            epilog=f"Examples:\n\n\b\n{examples}",
        )

    return decorate


def _arguments(group: type) -> list[click.Parameter]:
    return [
        click.Argument(
            [field],
            metavar=each.metavar,
            type=click_type(each.value),
            nargs=-1 if each.several else 1,
            required=each.required,
        )
        for field, each in arguments_of(group).items()
    ]


def _run(work: Work, options: Mapping[str, Option], read: list[str], rules: Sequence[OptionRule], /, **values: Any) -> int:
    """Call the body of a command with the values by their fields; no file that they name, or settings, is written."""
    from lidarcli.files.newfiles import reading

    for field in [field for field, option in options.items() if option.is_negated]:
        values[field] = not values.pop(f"no_{field}")
    ctx = click.get_current_context()

    def is_typed(field: str) -> bool:
        name = f"no_{field}" if options[field].is_negated else field
        return ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE

    if "files_from" in values:
        if not values["logs"] and values["files_from"] is None:
            raise click.MissingParameter(param_hint="'LOG...'", param_type="argument")
        if STDOUT in values["logs"] and values["files_from"] == STDOUT:
            raise click.UsageError("standard input is either a log or the list of --files-from")
    with usage_errors():
        refuse_combinations(rules, options, values, is_typed)
    named = [values[field] if isinstance(values[field], tuple) else (values[field],) for field in read]
    with reading(filter(None, [ctx.meta.get(ORIGINS), *chain(*named)])):
        return work(ctx.ensure_object(MessageWriter), values)


def _set_loudness(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Take `-v` or `-q`."""
    messages = ctx.ensure_object(MessageWriter)
    name = str(parameter.name)
    if not value:
        return
    typed: set[str] = ctx.meta.setdefault(TYPED, set())
    if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
        typed.add(name)
    if len(typed) > 1:
        raise click.UsageError("--verbose and --quiet exclude each other")
    if not typed or name in typed:
        # What is typed goes before a setting from elsewhere.
        messages.verbose, messages.quiet = name == "verbose", name == "quiet"


def _configure(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
    """Take `--config`."""
    if not ctx.resilient_parsing:
        from lidarcli.cli.settings import use_settings

        use_settings(ctx, value)


def _show_all(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the help with every option, and end."""
    if value and not ctx.resilient_parsing:
        ctx.meta[SHOWS_ALL] = True
        click.echo(ctx.get_help())
        ctx.exit()


def shared_options() -> list[click.Option]:
    """Return the options that are taken before and after a command's name."""
    louder = partial(DeclaredOption, expose_value=False, callback=_set_loudness)
    return [
        louder("verbose", Option(OTHER, None, False, short="-v", help="Say more on stderr.")),
        louder("quiet", Option(OTHER, None, False, short="-q", help="Only errors on stderr.")),
        DeclaredOption(
            "config",
            Option(OTHER, File("FILE"), shown="none", help="Settings file (docs/settings.md), or 'none' for no file."),
            is_eager=True,
            expose_value=False,
            callback=_configure,
        ),
    ]


class _Shared(click.Command):
    """Base of commands and groups."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.params.extend(shared_options())

    def get_help_option(self, ctx: click.Context) -> click.Option | None:
        """Return `--help`, which no environment variable sets."""
        found = super().get_help_option(ctx)
        if found is not None:
            found.allow_from_autoenv = False
        return found


class DeclaredCommand(_Shared):
    """A command whose help lists its options by heading."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.params.append(
            click.Option(
                ["--help-all"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                allow_from_autoenv=False,
                callback=_show_all,
                help="Show this message with the options that only some logs need, and exit.",
            )
        )

    def invoke(self, ctx: click.Context) -> Any:
        """Show the settings, then do the work."""
        from lidarcli.cli.settings import show_settings

        show_settings(ctx)
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section per heading, in the order in which they appear."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and (SHOWS_ALL in ctx.meta or not getattr(parameter, "is_rare", True)):
                sections.setdefault(getattr(parameter, "heading", OTHER), []).append(record)
        # click puts its own --help first.
        if OTHER in sections:
            sections[OTHER] = sections.pop(OTHER)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records, col_max=26)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples; without `--help-all` the first ones, and how many options it shows besides."""
        lines = (self.epilog or "").splitlines()
        if SHOWS_ALL not in ctx.meta:
            more = sum(getattr(each, "is_rare", False) for each in self.params)
            # A headline of three lines, and four commands.
            lines[3 + 4 :] = ["", f"{ctx.command_path} --help-all shows {more} more options."]
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text("\n".join(lines))


class Commands(_Shared, click.Group):
    """A group of commands that knows what a mistyped one was meant to be."""

    superseded: Mapping[str, str] = {}
    """Command that there was -> words for what does its work now."""
    otherwise = ""
    """Words on the command that is meant where its name is left out."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse; an option of a command whose name is left out is refused with that name."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as err:
            raise click.UsageError(f"{err.format_message()} {self.otherwise}".rstrip(), ctx) from None

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command of that name, or raise a usage error with the nearest; `help COMMAND` is `COMMAND --help`."""
        name = args[0]
        if not ctx.resilient_parsing and name == "help":
            if args[1:]:
                return self.resolve_command(ctx, [*args[1:], "--help"])
            click.echo(ctx.get_help())
            ctx.exit()
        if not ctx.resilient_parsing and not name.startswith("--") and self.get_command(ctx, name) is None:
            self._refuse(ctx, name)
        return super().resolve_command(ctx, args)

    def _refuse(self, ctx: click.Context, name: str) -> NoReturn:
        if name in self.superseded:
            ctx.fail(f"The command '{name}' is gone: {self.superseded[name]}")
        if ctx.parent is None and name and (not name.isalpha() or os.path.lexists(name)):
            ctx.fail(
                f"A command comes first. To see what is in it: lidarcli info {shlex.quote(name)}\n"
                "Who moved: lidarcli track LOG. Who came close: lidarcli zones LOG --zones FILE. More: lidarcli --help"
            )
        known = self.list_commands(ctx)
        near = nearest(name, known)
        meant = " ".join([*ctx.command_path.split()[1:], *near])
        hint = f"Did you mean '{meant}'?" if near else self.otherwise or f"There are {', '.join(known)}."
        ctx.fail(f"No such command '{name}'. {hint}")


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
        command: click.Command = getattr(import_module(f"lidarcli.cli.{HOMES.get(cmd_name, cmd_name)}"), cmd_name)()
        return command


def version_text() -> str:
    """The version of lidarcli on a line of its own, then whether it is compiled, the system and the libraries."""
    import platform
    import textwrap

    def line(name: str, words: str) -> str:
        head = f"  {name:<11}"
        return textwrap.fill(words, 79, initial_indent=head, subsequent_indent=" " * len(head))

    libraries = _found("numpy", "pyarrow", "mcap", "rosbags", "pandas", "matplotlib", "click", "rich")
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return "\n".join(
        (
            f"lidarcli {__version__}",
            line("core", compiled.about_core()),
            line("system", system),
            line("libraries", ", ".join(libraries)),
            line("optional", ", ".join(_found("distributed", "rerun-sdk")) or "none"),
        )
    )


def _found(*names: str) -> list[str]:
    """Those that are installed, with their versions."""
    from importlib.metadata import PackageNotFoundError, version

    found = []
    for name in names:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return found


def _print_version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
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
    messages, code = MessageWriter(), 0
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
        return code
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
