"""Declared options and arguments as click has them; each knows where a value comes from that is not typed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click
from click.core import ParameterSource

from lidarcli.errors import OptionError
from lidarcli.options.forms import File, Number, Option, Text, Value

OTHER = "Other"
"""Heading of the options that every command has."""
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


class TextLines(Parsed):
    """Texts that may hold blanks: in the environment each has a line of its own."""

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
    return TextLines(value) if isinstance(value, Text) and value.has_blanks else Parsed(value)


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
        # One variable names the settings file, for the whole program; a group has nothing to set but its commands.
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
