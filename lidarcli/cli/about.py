"""Commands about the program itself: `--version`, `lidarcli config` and `lidarcli completion`."""

import json
from dataclasses import asdict, dataclass
from typing import Annotated, TypedDict

import click

from lidarcli import compiled
from lidarcli._version import __version__
from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages
from lidarcli.cli.options import ORIGINS, DeclaredOption
from lidarcli.cli.settings import commands, options, strange_variables, unknown_variables
from lidarcli.option_forms import Argument, Text
from lidarcli.options import TextOrJson
from lidarcli.screen import one_line

LIBRARIES = ("numpy", "pyarrow", "mcap", "rosbags", "pandas", "matplotlib", "click", "rich")
EXTRAS = ("distributed", "rerun-sdk")
SHELLS = ("bash", "zsh", "fish")
VARIABLE = "_LIDARCLI_COMPLETE"
"""Variable by which a shell asks for completions."""


def version_text() -> str:
    """The version of lidarcli on a line of its own, then whether it is compiled, the system and the libraries."""
    import platform
    import textwrap

    def line(name: str, words: str) -> str:
        head = f"  {name:<11}"
        return textwrap.fill(words, 79, initial_indent=head, subsequent_indent=" " * len(head))

    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return "\n".join(
        (
            f"lidarcli {__version__}",
            line("core", compiled.about_core()),
            line("system", system),
            line("libraries", ", ".join(_found(LIBRARIES))),
            line("optional", ", ".join(_found(EXTRAS)) or "none"),
        )
    )


def _found(names: tuple[str, ...]) -> list[str]:
    """Those that are installed, with their versions."""
    from importlib.metadata import PackageNotFoundError, version

    found = []
    for name in names:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return found


@dataclass(frozen=True, slots=True)
class Setting:
    """The value of one option of a command, and its origin."""

    command: str
    option: str
    value: str | None
    origin: str


class ConfigCommand(TextOrJson, total=False):
    """Options of `config`."""

    command: Annotated[tuple[str, ...], Argument("[COMMAND]", Text("COMMAND"), several=True, required=False)]


@command(
    ConfigCommand,
    examples="""\
  lidarcli config
  lidarcli config background build
  lidarcli config detect --format json
  lidarcli --config lab.toml config detect""",
)
def config(say: Messages, told: ConfigCommand) -> int:
    """Show the settings in force, each with its origin.

    Without COMMAND: what the settings file and the environment set, for every command.
    With COMMAND: all options of it, also those that have their default.

    An option is taken from the command line, else from the environment
    (LIDARCLI_DETECT_JOBS=2), else from the settings file, else it has its default.
    """
    ctx = click.get_current_context()
    asked = " ".join(told["command"])
    there = [each for each in commands(ctx) if f"{each[0]} ".startswith(f"{asked} " if asked else "")]
    if not there:
        raise click.UsageError(f"there is no command '{asked}'")
    settings = []
    for line in strange_variables(ctx):
        say.error(line)
    for name, one, below in there:
        settings += [_setting(name, each, below) for each in options(one)]
    for line in dict.fromkeys(line for _, _, below in there for line in unknown_variables(below)):
        say.error(line)
    shown = [each for each in settings if asked or each.origin != "default"]
    file = ctx.find_root().meta.get(ORIGINS)
    if told["format"] == "json":
        click.echo(json.dumps([asdict(each) for each in shown], indent=2, ensure_ascii=False))
        return 0
    if file is None:
        say.info("settings file: none")
    if not shown:
        say.info("every option has its default; lidarcli config COMMAND shows them")
    for line in _table([(each.command, f"--{each.option}", _shown(each), each.origin) for each in shown]):
        click.echo(one_line(line))
    return 0


def _setting(command: str, each: DeclaredOption, ctx: click.Context) -> Setting:
    """The value of an option without the command line."""
    value = each.setting(ctx)
    origin = each.origin(ctx)
    if origin is None:
        return Setting(command, each.key, _default(each), "default")
    items = value if isinstance(value, list | tuple) else [value]
    return Setting(command, each.key, " ".join(_word(item) for item in items), origin)


def _default(each: DeclaredOption) -> str | None:
    """The default as help shows it; None if there is none."""
    if each.required:
        return "required"
    shown = each.declared.default_words(each.key)
    return shown or ("false" if each.is_flag else None)


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _shown(setting: Setting) -> str:
    return "-" if setting.value is None else setting.value


def _table(rows: list[tuple[str, str, str, str]]) -> list[str]:
    """Rows as columns of equal width; the last one is as long as it is."""
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    return ["  ".join([*(text.ljust(width) for text, width in zip(row, widths, strict=False)), row[3]]) for row in rows]


class CompletionCommand(TypedDict, total=False):
    """Options of `completion`."""

    shell: Annotated[str, Argument("SHELL", SHELLS)]


@command(
    CompletionCommand,
    examples="""\
  source <(lidarcli completion bash)
  echo 'source <(lidarcli completion bash)' >> ~/.bashrc
  lidarcli completion zsh > ~/.zfunc/_lidarcli
  lidarcli completion fish | source""",
)
def completion(say: Messages, told: CompletionCommand) -> int:
    """Print the completion script for SHELL: bash, zsh or fish.

    docs/install.md says where each shell wants it.
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(told["shell"])
    assert kind is not None  # SHELLS are those that click knows
    click.echo(kind(click.get_current_context().find_root().command, {}, "lidarcli", VARIABLE).source())
    return 0
