"""Settings from `lidarcli.toml` and from the environment, for the options that the command line leaves out."""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import date
from difflib import get_close_matches
from functools import reduce
from typing import Annotated, Any, TypedDict

import click

from lidarcli import compiled
from lidarcli._version import __version__
from lidarcli.cli.commands import ORIGINS, DeclaredOption, command
from lidarcli.cli.messages import Messages
from lidarcli.errors import OptionError
from lidarcli.option_forms import Argument, File, Text
from lidarcli.options import TextOrJson
from lidarcli.screen import one_line

NAME = "lidarcli.toml"
NONE = "none"
"""As the name of a settings file: use none, also where LIDARCLI_CONFIG names one."""

PREFIX = "LIDARCLI"
NOT_OPTIONS = frozenset({"LIDARCLI_COMPILED", "LIDARCLI_BUILD", "LIDARCLI_REAL_LOGS", "LIDARCLI_CONFIG"})
"""Variables that do not stand for an option of a command."""


NOT_SHARED = frozenset({"format", "output"})
"""Options whose values mean something else in each command."""


def use_settings(ctx: click.Context, named: str | None) -> None:
    """Let the options of this command, or of those below it, have their defaults from a settings file.

    `named` is the file of --config or LIDARCLI_CONFIG; no file is searched for.

    Raises
    ------
    UnreadableError
        The file cannot be read, or is no TOML.
    OptionError
        A key is no option, or its value is of the wrong kind.
    """
    if named is None:
        return
    if named == NONE:
        ctx.meta[ORIGINS] = None
        ctx.find_root().default_map = ctx.default_map = None
        return
    ctx.meta[ORIGINS] = named
    _use(ctx, _default_maps(ctx, named))


def _use(ctx: click.Context, tree: dict[str, Any]) -> None:
    """Let the values of a file be the defaults of all commands."""
    if ctx.parent is None:
        ctx.default_map = tree
        return
    _use(ctx.parent, tree)
    ctx.default_map = (ctx.parent.default_map or {}).get(str(ctx.info_name), {})


def commands(ctx: click.Context) -> Iterator[tuple[str, click.Command, click.Context]]:
    """Every command with its name, such as `background build`, and a context of its own."""
    yield from _below(ctx.find_root(), "")


def _below(ctx: click.Context, words: str) -> Iterator[tuple[str, click.Command, click.Context]]:
    if not isinstance(ctx.command, click.Group):
        yield words, ctx.command, ctx
        return
    for name in ctx.command.list_commands(ctx):
        command = ctx.command.get_command(ctx, name)
        assert command is not None, "it is listed"
        yield from _below(click.Context(command, ctx, name), f"{words} {name}".lstrip())


def settable(command: click.Command) -> list[DeclaredOption]:
    """The options of a command that may be set elsewhere."""
    return [each for each in command.params if isinstance(each, DeclaredOption) and each.key != "config"]


def unknown_variables(ctx: click.Context) -> list[str]:
    """Words for the variables of the environment that look like an option of this command, or its group, and are none."""
    while ctx.parent is not None and ctx.parent.parent is not None:
        ctx = ctx.parent
    prefix, command = f"{ctx.auto_envvar_prefix}_", ctx.info_name
    known = [
        variable.removeprefix(prefix)
        for _, one, below in _below(ctx, "")
        for each in settable(one)
        if (variable := each.variable(below))
    ]
    words = []
    for variable in sorted(os.environ):
        name = variable.removeprefix(prefix)
        if name != variable and name not in known:
            near = get_close_matches(name, known, 1)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"see lidarcli {command} --help"
            words.append(f"{variable}: {command} has no such option; {hint}")
    return words


def strange_variables(ctx: click.Context) -> list[str]:
    """Words for the variables of the environment that look like an option of some command, and of which there is none."""
    root = ctx.find_root()
    known = [f"{PREFIX}_{name.split()[0].upper()}" for name, _, _ in commands(ctx)]
    own = [name for each in settable(root.command) if (name := each.variable(root))]
    strange = [
        name
        for name in sorted(os.environ)
        if name.startswith(f"{PREFIX}_")
        and name not in {*NOT_OPTIONS, *own}
        and not any(name.startswith(f"{prefix}_") for prefix in known)
    ]
    return [f"{name}: lidarcli has no such command or option" for name in strange]


def show_settings(ctx: click.Context) -> None:
    """Tell of the settings that are in force, and of files and variables that do nothing."""
    if ctx.info_name == "completion":
        # A shell asks whenever it starts, wherever that is.
        return
    messages = ctx.ensure_object(Messages)
    if file := ctx.meta.get(ORIGINS):
        messages.info(f"settings from {file}")
    elif ORIGINS not in ctx.meta and os.path.exists(NAME):  # noqa: PTH110 (Path raises where nobody may look)
        messages.info(f"{NAME} here is not used: name it with --config {NAME}")
    for line in unknown_variables(ctx):
        messages.info(f"lidarcli: {line}")


def _default_maps(ctx: click.Context, file: str) -> dict[str, Any]:
    """The file's values as the default maps of all commands, as `click` nests them; all of the file is checked."""
    from lidarcli.configfiles import read_toml

    settings = read_toml(file, "settings file")
    shared = {key: value for key, value in settings.items() if not isinstance(value, Mapping)}
    for_all = _by_option(file, "", shared)
    for key in sorted(NOT_SHARED & for_all.keys()):
        raise OptionError(f"{file}: '{key}' is not the same in every command: set it below [detect] or another one")
    found: dict[str, dict[str, Any]] = {}
    every: set[str] = set()
    # A key such as `background = "room.parquet"` is an option, not the tables of the commands.
    tables = _by_command(file, {key: settings[key] for key in settings.keys() - shared}, ctx)
    for name, one, _ in commands(ctx):
        table = tables.get(name, {})
        header = name.replace(" ", ".")
        known = {each.key: each for each in settable(one)}
        every |= known.keys()
        for key in table:
            if _spelled(key) not in known:
                if isinstance(table[key], Mapping):
                    raise OptionError(f"{file}: [{header}.{key}]: no such command")
                _refuse(file, f"[{header}]", key, known)
        own = _by_option(file, header, table)
        common = {
            key: value
            for key, value in for_all.items()
            if key in known and not (isinstance(value, list) and takes_one(known[key]))
        }
        values = {
            str(known[key].name): _typed(file, header if key in own else "", known[key], value)
            for key, value in (common | own).items()
            if key in known
        }
        found[name] = values
    for key in shared:
        if _spelled(key) not in every:
            if key in found:
                raise OptionError(f"{file}: '{key}' is a command: its options stand below a line [{key}]")
            _refuse(file, "", key, every)
    for key in (each for each in tables if each not in found):
        near = get_close_matches(key, found, 1)
        hint = f"; did you mean [{near[0].replace(' ', '.')}]?" if near else ""
        raise OptionError(f"{file}: [{key.replace(' ', '.')}]: no such command{hint}")
    tree: dict[str, Any] = {}
    for name, values in found.items():
        *groups, last = name.split()
        reduce(lambda inner, group: inner.setdefault(group, {}), groups, tree)[last] = values
    return tree


def _by_command(file: str, tables: Mapping[str, Mapping[str, Any]], ctx: click.Context) -> dict[str, Any]:
    """The tables of a file by the names of commands; a group such as [background] has tables alone."""
    found: dict[str, Any] = {}
    for key, table in tables.items():
        below = [name.replace(" ", ".") for name, _, _ in commands(ctx) if name.startswith(f"{key} ")]
        for inner, value in table.items() if below else ():
            if not isinstance(value, Mapping):
                places = " or ".join(f"[{name}]" for name in below)
                raise OptionError(f"{file}: [{key}]: no option '{inner}': options stand below {places}")
            found[f"{key} {inner}"] = value
        if not below:
            found[key] = table
    return found


def _refuse(file: str, place: str, key: str, known: Any) -> None:
    """Refuse a key that is no option."""
    near = get_close_matches(_spelled(key), sorted(known), 1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise OptionError(f"{': '.join(filter(None, (file, place)))}: no option '{key}'{hint}")


def _spelled(key: str) -> str:
    """A key as options are spelled: `max_width`, as in Python, is `max-width`."""
    return key.replace("_", "-")


def takes_one(option: DeclaredOption) -> bool:
    """Return True for an option that is neither repeated nor takes several values."""
    is_list = option.multiple or option.nargs != 1 or getattr(option.type, "name", "") == "list"
    return not is_list


def _by_option(file: str, command: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a table by the names of their options, each of which is set once."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if _spelled(key) in found:
            raise OptionError(f"{_place(file, command, key)} is set twice, with - and with _")
        found[_spelled(key)] = value
    return found


def _place(file: str, command: str, key: str) -> str:
    """The place of a value, for messages; no command where it is set for all."""
    return f"{file}: {f'[{command}]: ' if command else ''}'{key}'"


def _typed(file: str, command: str, option: DeclaredOption, value: Any) -> Any:
    """A value of the file as click takes it: texts as they would be typed, lists of them, or true and false."""
    place = _place(file, command, option.key)
    if option.is_flag:
        if not isinstance(value, bool):
            raise OptionError(f"{place} must be true or false")
        return value
    items = [
        item.isoformat() if isinstance(item, date) else item for item in (value if isinstance(value, list) else [value])
    ]
    if not all(isinstance(item, str | int | float) and not isinstance(item, bool) for item in items):
        raise OptionError(f"{place} must be a text, a number or a list of them")
    typed = [_text(file, option, item) for item in items]
    if option.multiple or option.nargs != 1:
        return typed
    if isinstance(value, list) and takes_one(option):
        raise OptionError(f"{place} takes one value, not a list")
    return ",".join(typed)


def _text(file: str, option: DeclaredOption, item: str | float) -> str:
    """One value as it would be typed; the path of an input is meant from the folder of the file."""
    form = option.declared.value
    is_path = isinstance(form, File) and not form.is_output and item not in ("-", *form.words)
    if not isinstance(item, str) or not is_path or "://" in item:
        return str(item)
    return os.path.join(os.path.dirname(file), item)  # noqa: PTH118, PTH120 (keeps what Path would tidy away)


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
def config(messages: Messages, options: ConfigCommand) -> int:
    """Show the settings in force, each with its origin.

    Without COMMAND: what the settings file and the environment set, for every command.
    With COMMAND: all options of it, also those that have their default.

    An option is taken from the command line, else from the environment
    (LIDARCLI_DETECT_JOBS=2), else from the settings file, else it has its default.
    """
    ctx = click.get_current_context()
    asked = " ".join(options["command"])
    there = [each for each in commands(ctx) if f"{each[0]} ".startswith(f"{asked} " if asked else "")]
    if not there:
        raise click.UsageError(f"there is no command '{asked}'")
    settings = []
    for line in strange_variables(ctx):
        messages.error(line)
    for name, one, below in there:
        settings += [_setting(name, each, below) for each in settable(one)]
    for line in dict.fromkeys(line for _, _, below in there for line in unknown_variables(below)):
        messages.error(line)
    shown = [each for each in settings if asked or each.origin != "default"]
    file = ctx.find_root().meta.get(ORIGINS)
    if options["format"] == "json":
        click.echo(json.dumps([asdict(each) for each in shown], indent=2, ensure_ascii=False))
        return 0
    if file is None:
        messages.info("settings file: none")
    if not shown:
        messages.info("every option has its default; lidarcli config COMMAND shows them")
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
def completion(messages: Messages, options: CompletionCommand) -> int:
    """Print the completion script for SHELL: bash, zsh or fish.

    docs/install.md says where each shell wants it.
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(options["shell"])
    assert kind is not None  # SHELLS are those that click knows
    click.echo(kind(click.get_current_context().find_root().command, {}, "lidarcli", VARIABLE).source())
    return 0
