"""Settings from `lidarcli.toml` and from the environment, for the options that the command line leaves out."""

import os
from collections.abc import Collection, Iterator, Mapping
from datetime import date, time
from functools import reduce
from typing import Any

import click

from lidarcli.cli.declared import ORIGINS, DeclaredOption
from lidarcli.cli.messages import MessageWriter
from lidarcli.display.texts import nearest
from lidarcli.errors import OptionError
from lidarcli.options.forms import File

NAME = "lidarcli.toml"
NONE = "none"
"""As the name of a settings file: use none, also where LIDARCLI_CONFIG names one."""

NOT_SHARED = frozenset({"format", "output"})
"""Options whose values mean something else in each command."""


def use_settings(ctx: click.Context, named: str | None) -> None:
    """Let the options of this command, or of those below it, have their defaults from the file `named` (`OptionError`)."""
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


def commands(ctx: click.Context, words: str = "") -> Iterator[tuple[str, click.Command, click.Context]]:
    """Every command below a context with its name, such as `background build`, and a context of its own."""
    if not isinstance(ctx.command, click.Group):
        yield words, ctx.command, ctx
        return
    for name in ctx.command.list_commands(ctx):
        command = ctx.command.get_command(ctx, name)
        assert command is not None, "it is listed"
        yield from commands(click.Context(command, ctx, name), f"{words} {name}".lstrip())


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
        for _, one, below in commands(ctx)
        for each in settable(one)
        if (variable := each.variable(below))
    ]
    words = []
    for variable in sorted(os.environ):
        name = variable.removeprefix(prefix)
        if name != variable and name not in known:
            near = nearest(name, known)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"see lidarcli {command} --help"
            words.append(f"{variable}: {command} has no such option; {hint}")
    return words


def show_settings(ctx: click.Context) -> None:
    """Show the settings that are in force, and files and variables that do nothing."""
    if ctx.info_name == "completion":
        # A shell asks whenever it starts, wherever that is.
        return
    messages = ctx.ensure_object(MessageWriter)
    if file := ctx.meta.get(ORIGINS):
        messages.info(f"settings from {file}")
    elif ORIGINS not in ctx.meta and os.path.exists(NAME):  # noqa: PTH110 (Path raises where nobody may look)
        messages.info(f"{NAME} here is not used: name it with --config {NAME}")
    for line in unknown_variables(ctx):
        messages.info(f"lidarcli: {line}")


def _default_maps(ctx: click.Context, file: str) -> dict[str, Any]:
    """The file's values as the default maps of all commands, as `click` nests them; all of the file is checked."""
    from lidarcli.files.configfiles import read_toml

    settings = read_toml(file, "settings file")
    known = {name: {each.key: each for each in settable(one)} for name, one, _ in commands(ctx.find_root())}
    shared = {_spelled(key): value for key, value in settings.items() if not isinstance(value, Mapping)}
    tables: dict[str, Any] = {}
    for key, table in settings.items():
        if isinstance(table, Mapping):
            is_group = any(name.startswith(f"{key} ") for name in known)
            tables |= {f"{key} {name}": inner for name, inner in table.items()} if is_group else {key: table}
    for name, table in tables.items():
        if name not in known or not isinstance(table, Mapping):
            near = nearest(name, known)
            hint = f"; did you mean [{near[0].replace(' ', '.')}]?" if near else ""
            raise OptionError(f"{file}: [{name.replace(' ', '.')}]: no such command{hint}")
        _refuse_unknown(file, f"[{name.replace(' ', '.')}]", table, known[name])
    _refuse_unknown(file, "", shared, {key for options in known.values() for key in options})
    for key in sorted(NOT_SHARED & shared.keys()):
        raise OptionError(f"{file}: '{key}' is not the same in every command: set it below [detect] or another one")
    tree: dict[str, Any] = {}
    for name, options in known.items():
        own = {_spelled(key): value for key, value in tables.get(name, {}).items()}
        common = {
            key: value
            for key, value in shared.items()
            if key in options and not (isinstance(value, list) and takes_one(options[key]))
        }
        header = name.replace(" ", ".")
        values = {
            str(options[key].name): _typed(file, header if key in own else "", options[key], value)
            for key, value in (common | own).items()
        }
        *groups, last = name.split()
        reduce(lambda inner, group: inner.setdefault(group, {}), groups, tree)[last] = values
    return tree


def _refuse_unknown(file: str, place: str, table: Mapping[str, Any], known: Collection[str]) -> None:
    """Refuse keys that are no options."""
    for key in table:
        if _spelled(key) not in known:
            near = nearest(_spelled(key), sorted(known))
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise OptionError(f"{': '.join(filter(None, (file, place)))}: no option '{key}'{hint}")


def _spelled(key: str) -> str:
    """A key as options are spelled: `max_width`, as in Python, is `max-width`."""
    return key.replace("_", "-")


def takes_one(option: DeclaredOption) -> bool:
    """Return True for an option that is neither repeated nor takes several values."""
    return not option.multiple and option.nargs == 1 and getattr(option.type, "name", "") != "list"


def _typed(file: str, command: str, option: DeclaredOption, value: Any) -> Any:
    """A value of the file as click takes it: texts as they would be typed, lists of them, or true and false."""
    place = f"{file}: {f'[{command}]: ' if command else ''}'{option.key}'"
    if option.is_flag:
        if not isinstance(value, bool):
            raise OptionError(f"{place} must be true or false")
        return value
    items = [
        item.isoformat() if isinstance(item, date | time) else item
        for item in (value if isinstance(value, list) else [value])
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
