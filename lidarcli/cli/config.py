"""`lidarcli config`: the settings in force, each with its origin."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

import click

from lidarcli.cli.grouped import ORIGINS, GroupedCommand, GroupedOption, Refused
from lidarcli.cli.messages import Messages, one_line
from lidarcli.cli.options import text_or_json
from lidarcli.cli.settings import commands, options, strange_variables, unknown_variables

_DEFAULT = re.compile(r"\[default: ([^]]*)\]")


@dataclass(frozen=True, slots=True)
class Setting:
    """What one option of a command is set to, and by what."""

    command: str
    option: str
    value: str | None
    origin: str
    refused: str | None = None
    """Why the value may not be used; None where it may."""


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  lidarcli config
  lidarcli config detect
  lidarcli config background build --format json
  lidarcli --config lab.toml config detect""",
)
@click.argument("words", metavar="[COMMAND]...", nargs=-1)
@text_or_json()
@click.pass_context
def config(ctx: click.Context, words: tuple[str, ...], kind: str) -> int:
    """Show the settings in force, each with its origin.

    Without COMMAND: what lidarcli.toml and the environment set, for every command.
    With COMMAND: all options of it, also those that have their default.

    An option is taken from the command line, else from the environment
    (LIDARCLI_DETECT_JOBS=2), else from lidarcli.toml, else it has its default.
    """
    say = ctx.ensure_object(Messages)
    parts = tuple(part for word in words for part in word.split())
    there = [each for each in commands(ctx) if each[0][: len(parts)] == parts]
    if not there:
        raise click.UsageError(f"there is no command '{' '.join(parts)}'")
    settings = []
    for line in strange_variables(ctx):
        say.error(line)
    for names, command, below in there:
        settings += [_setting(" ".join(names), each, below) for each in options(command)]
        for line in unknown_variables(below):
            say.error(line)
    shown = [each for each in settings if parts or each.origin != "default"]
    file = ctx.find_root().meta.get(ORIGINS)
    if kind == "json":
        click.echo(json.dumps([_row(each) for each in shown], indent=2, ensure_ascii=False))
        return 0
    if file is None:
        say.info("settings file: none")
    if not shown:
        say.info("every option has its default; lidarcli config COMMAND shows them")
    for line in _table([(each.command, f"--{each.option}", _shown(each), _origin(each)) for each in shown]):
        click.echo(one_line(line))
    return 0


def _setting(command: str, each: GroupedOption, ctx: click.Context) -> Setting:
    """What an option is set to where the command line says nothing."""
    value = each.setting(ctx)
    origin = each.origin(ctx)
    if origin is None:
        return Setting(command, each.key, _default(each), "default")
    refused = None
    if isinstance(value, Refused):
        value, refused = value.value, value.cause
    items = value if isinstance(value, list | tuple) else [value]
    return Setting(command, each.key, " ".join(_word(item) for item in items), origin, refused)


def _default(each: GroupedOption) -> str | None:
    """The default as help shows it; None where there is none."""
    if each.required:
        return "required"
    told = _DEFAULT.search(each.help or "")
    if told:
        return told[1]
    if isinstance(each.show_default, str):
        return each.show_default
    if each.is_flag:
        return "false"
    return _word(each.default) if isinstance(each.default, str | int | float) else None


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _row(setting: Setting) -> dict[str, Any]:
    return {
        "command": setting.command,
        "option": setting.option,
        "value": setting.value,
        "origin": setting.origin,
        "refused": setting.refused,
    }


def _shown(setting: Setting) -> str:
    return "-" if setting.value is None else setting.value


def _origin(setting: Setting) -> str:
    return setting.origin if setting.refused is None else f"{setting.origin}, refused: {setting.refused}"


def _table(rows: list[tuple[str, str, str, str]]) -> list[str]:
    """Rows as columns of equal width; the last one is as long as it is."""
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    return [
        "  ".join([*(text.ljust(width) for text, width in zip(row, widths, strict=False)), row[3]])
        for row in rows
    ]
