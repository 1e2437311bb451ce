"""`lidarcli config` and `completion`: what is in force, and what shells complete."""

import json
from typing import Annotated, Any, TypedDict

import click

from lidarcli.cli.commands import command
from lidarcli.cli.declared import ORIGINS, DeclaredOption
from lidarcli.cli.messages import MessageWriter
from lidarcli.cli.settings import commands, settable, unknown_variables
from lidarcli.display.screen import one_line
from lidarcli.options.common import TextOrJson
from lidarcli.options.forms import Argument, Text

SHELLS = ("bash", "zsh", "fish")


class ConfigCommand(TextOrJson, total=False):
    command: Annotated[tuple[str, ...], Argument("[COMMAND]", Text("COMMAND"), several=True, required=False)]


@command(
    ConfigCommand,
    examples="""\
  lidarcli config
  lidarcli config background build
  lidarcli config detect --format json
  lidarcli --config lab.toml config detect""",
)
def config(messages: MessageWriter, options: ConfigCommand) -> int:
    """Show the settings in force, each with its origin.

    Without COMMAND: what the settings file and the environment set, for every command.
    With COMMAND: all options of it, also those that have their default.

    An option is taken from the command line, else from the environment
    (LIDARCLI_DETECT_JOBS=2), else from the settings file, else it has its default.
    """
    ctx = click.get_current_context()
    wanted = " ".join(options["command"])
    chosen = [each for each in commands(ctx.find_root()) if f"{each[0]} ".startswith(f"{wanted} " if wanted else "")]
    if not chosen:
        raise click.UsageError(f"there is no command '{wanted}'")
    rows = [_setting(name, each, below) for name, one, below in chosen for each in settable(one)]
    for line in dict.fromkeys(line for _, _, below in chosen for line in unknown_variables(below)):
        messages.error(line)
    rows = [row for row in rows if wanted or row["origin"] != "default"]
    if options["format"] == "json":
        click.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return 0
    if ctx.find_root().meta.get(ORIGINS) is None:
        messages.info("settings file: none")
    if not rows:
        messages.info("every option has its default; lidarcli config COMMAND shows them")
    cells = [(row["command"], f"--{row['option']}", row["value"] or "-", row["origin"]) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for *row, origin in cells:
        click.echo(one_line("  ".join([*(text.ljust(width) for text, width in zip(row, widths, strict=False)), origin])))
    return 0


def _setting(command: str, each: DeclaredOption, ctx: click.Context) -> dict[str, Any]:
    """The value of an option without the command line, and its origin."""
    value, origin = each.setting(ctx), each.origin(ctx)
    if origin is None:
        default = (
            "required" if each.required else each.declared.default_words(each.key) or ("false" if each.is_flag else None)
        )
        return {"command": command, "option": each.key, "value": default, "origin": "default"}
    items = value if isinstance(value, list | tuple) else [value]
    words = " ".join(str(item).lower() if isinstance(item, bool) else str(item) for item in items)
    return {"command": command, "option": each.key, "value": words, "origin": origin}


class CompletionCommand(TypedDict, total=False):
    shell: Annotated[str, Argument("SHELL", SHELLS)]


@command(
    CompletionCommand,
    examples="""\
  source <(lidarcli completion bash)
  echo 'source <(lidarcli completion bash)' >> ~/.bashrc
  lidarcli completion zsh > ~/.zfunc/_lidarcli
  lidarcli completion fish | source""",
)
def completion(messages: MessageWriter, options: CompletionCommand) -> int:
    """Print what bash, zsh or fish needs to complete commands.

    docs/install.md says where each shell wants it.
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(options["shell"])
    assert kind is not None  # SHELLS are those that click knows
    click.echo(kind(click.get_current_context().find_root().command, {}, "lidarcli", "_LIDARCLI_COMPLETE").source())
    return 0
