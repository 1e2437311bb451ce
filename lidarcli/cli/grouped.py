"""Commands and options as all of lidarcli has them: help in groups, hints for typing errors, settings from elsewhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, NoReturn, TypeVar

import click
from click.core import ParameterSource

from lidarcli.errors import OptionError

OTHER = "Other"
OUTPUT = "Output"
ORIGINS = "lidarcli.origins"
"""Where the context keeps the name of the settings file, for words about values that come from it."""

TYPED = "lidarcli.typed"
"""Where the context keeps which of -v and -q stand on the command line."""

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Refused:
    """A value that a settings file may not set: the command that would use it ends with the message."""

    value: Any
    cause: str
    message: str


class GroupedOption(click.Option):
    """An option that is listed under a heading of its command's help, and may be set in a file and in the environment."""

    def __init__(
        self,
        *arguments: Any,
        heading: str = "Options",
        is_output: bool = False,
        unless: Sequence[str] = (),
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        self.heading = heading
        self.is_output = is_output or self.key == "output"
        """Whether a path is where something is written, not where it is read."""
        self.unless = unless
        """Parameters whose place it has: one of them on the command line goes before a setting from elsewhere."""

    @property
    def key(self) -> str:
        """What the option is called in `lidarcli.toml`: its long name without the dashes."""
        return max((name.lstrip("-") for name in self.opts), key=len)

    def variable(self, ctx: click.Context) -> str | None:
        """The environment variable of the option, None where it has none."""
        if not self.allow_from_autoenv or ctx.auto_envvar_prefix is None:
            return None
        # One variable names the settings file, for the whole program.
        if self.key == "config" and ctx.parent is not None:
            return None
        return f"{ctx.auto_envvar_prefix}_{self.key.upper().replace('-', '_')}"

    def resolve_envvar_value(self, ctx: click.Context) -> str | None:
        """The value in the environment: an empty one counts as none."""
        name = self.variable(ctx)
        return os.environ.get(name) or None if name else None

    def handle_parse_result(
        self, ctx: click.Context, opts: Mapping[str, Any], args: list[str]
    ) -> tuple[Any, list[str]]:
        """The value, or a usage error that also says which variable or file a wrong value comes from."""
        with self._origin_told(ctx):
            return super().handle_parse_result(ctx, opts, args)

    def consume_value(self, ctx: click.Context, opts: Mapping[str, Any]) -> tuple[Any, ParameterSource]:
        """The value and where it comes from; what the command line says instead of it goes before a setting."""
        value, source = self._found_value(ctx, opts)
        if not isinstance(value, Refused):
            return value, source
        if not ctx.resilient_parsing:
            raise OptionError(value.message)
        return self.default, ParameterSource.DEFAULT

    def _found_value(self, ctx: click.Context, opts: Mapping[str, Any]) -> tuple[Any, ParameterSource]:
        """The same, also of a value that may not be used."""
        value, source = super().consume_value(ctx, opts)
        elsewhere = source in (ParameterSource.ENVIRONMENT, ParameterSource.DEFAULT_MAP)
        if elsewhere and any(opts.get(name) for name in self.unless):
            return self.default, ParameterSource.DEFAULT
        return value, source

    def setting(self, ctx: click.Context) -> Any:
        """The value where the command line says nothing, also a `Refused` one; None where nobody else says something."""
        value, source = self._found_value(ctx, {})
        ctx.set_parameter_source(str(self.name), source)
        if source is ParameterSource.DEFAULT:
            return None
        if isinstance(value, Refused):
            return value
        with self._origin_told(ctx):
            self.type_cast_value(ctx, value)
        return value

    @contextmanager
    def _origin_told(self, ctx: click.Context) -> Iterator[None]:
        """Let a usage error say where the wrong value comes from."""
        try:
            yield
        except click.BadParameter as err:
            origin = self.origin(ctx)
            if origin is None:
                raise
            message = f"{err.message.rstrip('.')} (set in {origin})."
            raise click.BadParameter(message, err.ctx, err.param, err.param_hint) from err

    def origin(self, ctx: click.Context) -> str | None:
        """The variable or the file that the value comes from; None for the command line and for defaults."""
        source = ctx.get_parameter_source(self.name or "")
        if source is ParameterSource.ENVIRONMENT:
            return self.variable(ctx)
        if source is ParameterSource.DEFAULT_MAP:
            return str(ctx.meta[ORIGINS])
        return None


def option(*names: str, **settings: Any) -> Callable[[F], F]:
    """`click.option` with a `heading`."""
    return click.option(*names, cls=GroupedOption, **settings)


def shared_options() -> list[GroupedOption]:
    """The options that are taken before and after a command's name."""

    def louder(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
        from lidarcli.cli.messages import Messages

        say = ctx.ensure_object(Messages)
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
            say.verbose, say.quiet = name == "verbose", name == "quiet"

    def configured(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
        from lidarcli.cli.settings import use_settings

        if not ctx.resilient_parsing:
            use_settings(ctx, value)

    return [
        GroupedOption(
            ["-v", "--verbose"],
            heading=OTHER,
            is_flag=True,
            expose_value=False,
            callback=louder,
            help="Say more on stderr.",
        ),
        GroupedOption(
            ["-q", "--quiet"],
            heading=OTHER,
            is_flag=True,
            expose_value=False,
            callback=louder,
            help="Only errors on stderr.",
        ),
        GroupedOption(
            ["--config"],
            heading=OTHER,
            metavar="FILE",
            type=click.Path(),
            is_eager=True,
            expose_value=False,
            callback=configured,
            help="Settings file (docs/settings.md), or 'none' for no file.  "
            "[default: lidarcli.toml here or in a folder above]",
        ),
    ]


def own_parameters(command: click.Command) -> list[click.Parameter]:
    """The parameters of a command that not every command has."""
    shared = {each.name for each in shared_options()}
    return [each for each in command.params if each.name not in shared]


class _Shared(click.Command):
    """What commands and groups have in common."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.params.extend(shared_options())

    def get_help_option(self, ctx: click.Context) -> click.Option | None:
        """`--help`, which no environment variable stands for."""
        found = super().get_help_option(ctx)
        if found is not None:
            found.allow_from_autoenv = False
        return found


class GroupedCommand(_Shared):
    """A command whose help lists its options by heading."""

    def invoke(self, ctx: click.Context) -> Any:
        """Tell of the settings, then do the work."""
        from lidarcli.cli.settings import tell_settings

        tell_settings(ctx)
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section per heading, in the order in which they appear."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                sections.setdefault(getattr(parameter, "heading", OTHER), []).append(record)
        # click puts its own --help first.
        if OTHER in sections:
            sections[OTHER] = sections.pop(OTHER)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records, col_max=26)


class Commands(_Shared, click.Group):
    """A group of commands that knows what a mistyped one was meant to be."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command of that name, or a usage error with the nearest one; `help COMMAND` is `COMMAND --help`."""
        name = args[0]
        if not ctx.resilient_parsing and name == "help":
            if args[1:]:
                return self.resolve_command(ctx, [*args[1:], "--help"])
            click.echo(ctx.get_help())
            ctx.exit()
        if not ctx.resilient_parsing and not name.startswith("-") and self.get_command(ctx, name) is None:
            self._refuse(ctx, name)
        return super().resolve_command(ctx, args)

    def _refuse(self, ctx: click.Context, name: str) -> NoReturn:
        known = self.list_commands(ctx)
        near = get_close_matches(name, known, 1)
        hint = f"Did you mean '{near[0]}'?" if near else f"There are {', '.join(known)}."
        ctx.fail(f"No such command '{name}'. {hint}")
