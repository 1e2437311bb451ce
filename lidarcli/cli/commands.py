"""The command line: declared options and commands as click has them, and errors as exit codes. Nothing heavy at import."""

from __future__ import annotations

import io
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from inspect import cleandoc
from itertools import chain
from typing import TYPE_CHECKING, Any, NoReturn

import click
from click.core import ParameterSource

from lidarcli.cli.messages import Messages
from lidarcli.display.credentials import blotted
from lidarcli.errors import OUT_OF_MEMORY, LidarcliError, OptionError, OutputError, UnreadableError, is_short_of_memory
from lidarcli.options.forms import File, Number, Option, Rule, Text, Value, arguments_of, options_of, refuse_combinations
from lidarcli.options.groups import RULES, STDOUT
from lidarcli.system.interrupts import Terminated

if TYPE_CHECKING:
    from lidarcli.pipeline.api.options import LogOptions

ORIGINS = "lidarcli.origins"
"""Key of the context's `meta` for the name of the settings file, which messages about its values name."""


class Parsed(click.ParamType):  # type: ignore[type-arg]
    """A number, or a text that is parsed."""

    def __init__(self, form: Number | Text) -> None:
        self.form = form
        self.name = "list" if isinstance(form, Text) and form.is_list else "text"
        self.metavar = form.metavar

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return self.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value, or raise a usage error that says what is wrong with it."""
        # A shell that completes a line has no time for the imports of a parser.
        if not isinstance(value, str) or (ctx and ctx.resilient_parsing):
            return value
        if isinstance(self.form, Text) and (words := Text.lost(value, is_alone=not self.form.is_list)):
            self.fail(f"{words}.", param, ctx)
        if self.form.parse is None:
            return value
        try:
            return self.form.parse(value)
        except OptionError as err:
            words = str(err)
            prefix = f"{param.opts[-1]}: " if param is not None else ""
            self.fail(f"{words.removeprefix(prefix)}.", param, ctx)


class Lines(Parsed):
    """Texts that may hold blanks: in the environment each stands on a line of its own."""

    envvar_list_splitter = "\n"


class Place(click.Path):
    """A path or URL. Whether it can be read is found out where it is opened, which says more than a usage error."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and (words := Text.lost(value, is_alone=isinstance(param, click.Option))):
            self.fail(f"{words}.", param, ctx)
        return value


def click_type(value: Value) -> click.ParamType:  # type: ignore[type-arg]
    """Return the type of an option or an argument that is no flag."""
    if isinstance(value, tuple):
        return click.Choice(value)
    if isinstance(value, File):
        return Place()
    assert value is not None, "a flag has no type"
    return Lines(value) if isinstance(value, Text) and value.has_blanks else Parsed(value)


class DeclaredOption(click.Option):
    """An option made from its declaration; it may be set in a file and in the environment."""

    def __init__(self, field: str, declared: Option, **settings: Any) -> None:
        """`settings` are those of click that no declaration has, such as a callback."""
        self.declared = declared
        self.heading = declared.heading
        self.is_rare = declared.rare or declared.heading == OTHER
        self.field = field
        name = field.replace("_", "-")
        names = [f"--{name}"]
        if declared.both:
            names = [f"--{name}/--no-{name}"]
        elif declared.is_negated:
            names, field = [f"--no-{name}"], f"no_{field}"
        value = declared.value
        if value is None:
            settings |= {"is_flag": True, "default": declared.default and not declared.is_negated}
        else:
            settings |= {"type": click_type(value), "multiple": declared.several}
            if not isinstance(value, tuple):
                settings["metavar"] = value.metavar
            if isinstance(value, Number):
                settings["nargs"] = value.count
            if declared.alone is not None:
                settings |= {"is_flag": False, "flag_value": declared.alone}
            if declared.default is not None and not declared.several:
                settings["default"] = declared.default
        shown = declared.default_words(name)
        words = declared.help
        if declared.is_negated:
            words = f"Do not {words[0].lower()}{words[1:]}"
        super().__init__(
            [*filter(None, [declared.short]), *names, field],
            help=f"{words}  [default: {shown}]" if shown else words,
            required=declared.required,
            **settings,
        )

    @property
    def key(self) -> str:
        """Name of the option in `lidarcli.toml`: its long name without the dashes."""
        return max((name.lstrip("-") for name in self.opts), key=len)

    def variable(self, ctx: click.Context) -> str | None:
        """Return the environment variable of the option, None if it has none."""
        if not self.allow_from_autoenv or ctx.auto_envvar_prefix is None:
            return None
        # One variable names the settings file, for the whole program; a group has nothing to set beside its commands.
        if ctx.parent is not None and (self.key == "config" or isinstance(ctx.command, click.Group)):
            return None
        return f"{ctx.auto_envvar_prefix}_{self.key.upper().replace('-', '_')}"

    def resolve_envvar_value(self, ctx: click.Context) -> str | None:
        """Return the value in the environment: an empty one counts as none."""
        name = self.variable(ctx)
        return os.environ.get(name) or None if name else None

    def handle_parse_result(self, ctx: click.Context, opts: Mapping[str, Any], args: list[str]) -> tuple[Any, list[str]]:
        """Return the value, or raise a usage error that also names the variable or file of a wrong value."""
        with self._origin_named(ctx):
            return super().handle_parse_result(ctx, opts, args)

    def consume_value(self, ctx: click.Context, opts: Mapping[str, Any]) -> tuple[Any, ParameterSource]:
        """Return the value and its source; an option that excludes this one goes before a setting of this one."""
        value, source = super().consume_value(ctx, opts)
        elsewhere = source in (ParameterSource.ENVIRONMENT, ParameterSource.DEFAULT_MAP)
        if elsewhere and any(opts.get(name) for name in self.declared.unless):
            return self.default, ParameterSource.DEFAULT
        return value, source

    def setting(self, ctx: click.Context) -> Any:
        """Return the value that a file or variable sets; None if neither does."""
        value, source = self.consume_value(ctx, {})
        ctx.set_parameter_source(str(self.name), source)
        if source is ParameterSource.DEFAULT:
            return None
        with self._origin_named(ctx):
            self.type_cast_value(ctx, value)
        return value

    @contextmanager
    def _origin_named(self, ctx: click.Context) -> Iterator[None]:
        """Let a usage error name the origin of the wrong value."""
        try:
            yield
        except click.BadParameter as err:
            origin = self.origin(ctx)
            if origin is None:
                raise
            message = f"{err.message.rstrip('.')} (set in {origin})."
            raise click.BadParameter(message, err.ctx, err.param, err.param_hint) from err

    def origin(self, ctx: click.Context) -> str | None:
        """Return the variable or the file that the value comes from; None for the command line and for defaults."""
        source = ctx.get_parameter_source(self.name or "")
        if source is ParameterSource.ENVIRONMENT:
            return self.variable(ctx)
        if source is ParameterSource.DEFAULT_MAP:
            return str(ctx.meta[ORIGINS])
        return None


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


OTHER = "Other"
TYPED = "lidarcli.typed"
"""Key of the context's `meta` for which of -v and -q stand on the command line."""
SHOWS_ALL = "lidarcli.help_all"
"""Key of the context's `meta` that is set while `--help-all` prints."""
LAST_EXAMPLE = 3 + 4
"""Lines of the examples that `--help` shows: a headline, and four commands."""

Work = Callable[[Messages, Any], int]
"""Body of a command: it gets the values of the arguments and options by their fields, and returns the exit code."""


def command(
    group: type, *, examples: str, changed: Mapping[str, Mapping[str, Any]] | None = None, rules: Sequence[Rule] = ()
) -> Callable[[Work], DeclaredCommand]:
    """Make a command of a function.

    Parameters
    ----------
    group : arguments and options of the command
    examples : lines for the end of the help
    changed : field -> what its option has in this command otherwise than declared
    rules : combinations of its options that are refused, beside `RULES`
    """

    def decorate(work: Work) -> DeclaredCommand:
        options = {
            field: replace(option, **(changed or {}).get(field, {}))
            for field, option in sorted(options_of(group).items(), key=lambda item: item[1].short != "-o")
        }
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


def _run(work: Work, options: Mapping[str, Option], read: list[str], rules: Sequence[Rule], /, **values: Any) -> int:
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
        return work(ctx.ensure_object(Messages), values)


def _set_loudness(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Take `-v` or `-q`."""
    messages = ctx.ensure_object(Messages)
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
        """Return `--help`, which no environment variable stands for."""
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
        """Tell of the settings, then do the work."""
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
            lines[LAST_EXAMPLE:] = ["", f"{ctx.command_path} --help-all shows {more} more options."]
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
        near = get_close_matches(name, known, 1)
        meant = " ".join([*ctx.command_path.split()[1:], *near])
        hint = f"Did you mean '{meant}'?" if near else self.otherwise or f"There are {', '.join(known)}."
        ctx.fail(f"No such command '{name}'. {hint}")


COMMANDS = (
    *("info", "track", "zones", "diff", "detect", "background", "map", "poses", "clean"),
    *("plot", "overlay", "report", "export", "simulate", "config", "completion"),
)
"""Names of the commands, those that answer first; each has a file of its name, unless `HOMES` tells another."""
HOMES = {
    "track": "detect",
    **dict.fromkeys(("config", "completion"), "settings"),
    **dict.fromkeys(("diff", "zones", "report"), "checking"),
    **dict.fromkeys(("clean", "overlay", "poses", "export", "simulate", "map"), "writing"),
}

SUPERSEDED = {"match": "give lidarcli diff RUN RUN..., which takes the same tables, and logs"}
"""Command that there was → words for what does its work now."""

INTERRUPTED = 130


class LazyCommands(Commands):
    """A group that imports a command only when somebody asks for it."""

    superseded = SUPERSEDED

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"lidarcli.cli.{HOMES.get(cmd_name, cmd_name)}"), cmd_name)
        return command


def _print_version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from lidarcli.cli.settings import version_text

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
    messages = Messages()
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
        return INTERRUPTED
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
    """Parse and run. click's own `main` answers a closed pipe and ctrl-C in its way, not in ours."""
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
