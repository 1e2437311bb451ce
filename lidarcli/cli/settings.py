"""Settings from `lidarcli.toml` and from the environment, for the options that the command line leaves out."""

from __future__ import annotations

import glob
import os
import shlex
import stat
from collections.abc import Iterator, Mapping
from datetime import date
from difflib import get_close_matches
from functools import partial, reduce
from pathlib import Path, PureWindowsPath
from typing import Any

import click
from click.core import ParameterSource

from lidarcli.cli.messages import Messages
from lidarcli.cli.options import ORIGINS, DeclaredOption, Refused
from lidarcli.errors import LidarcliError, OptionError
from lidarcli.option_forms import File
from lidarcli.screen import one_line

NAME = "lidarcli.toml"
NONE = "none"
"""As the name of a settings file: use none, also where one could be found."""

FOUND = "lidarcli.found"
"""Key of the context's `meta` for the file that was found, and the reason if it is not used."""

PREFIX = "LIDARCLI"
NOT_OPTIONS = frozenset({"LIDARCLI_COMPILED", "LIDARCLI_BUILD", "LIDARCLI_REAL_LOGS", "LIDARCLI_CONFIG"})
"""Variables that do not stand for an option of a command."""


NOT_SHARED = frozenset({"format", "output"})
"""Options whose values mean something else in each command."""


def find_settings(folder: Path) -> Path | None:
    """The nearest `lidarcli.toml` in a folder or one above it."""
    return next((path for each in (folder, *folder.parents) if (path := each / NAME).is_file()), None)


def use_settings(ctx: click.Context, named: str | None) -> None:
    """Let the options of this command, or of those below it, have their defaults from a settings file.

    `named` is the file that was asked for; without one, the whole program uses the nearest `lidarcli.toml`.

    Raises
    ------
    UnreadableError
        The file cannot be read, or is no TOML.
    OptionError
        A key is no option, or its value is of the wrong kind.
    """
    root = ctx.find_root()
    if named is None:
        if ctx is root:
            _use_found(ctx)
        return
    for key in (FOUND, ORIGINS):
        ctx.meta.pop(key, None)
    if named == NONE:
        root.default_map = ctx.default_map = None
        return
    ctx.meta[ORIGINS] = named
    _use(ctx, _default_maps(ctx, named))


def _use_found(root: click.Context) -> None:
    """Use the nearest file. Errors in it are raised before the work, unless another file is named."""
    try:
        found = find_settings(Path.cwd())
    except OSError:
        # The working directory is gone, or nobody may look into it.
        return
    if found is None:
        return
    root.meta[ORIGINS] = str(found)
    try:
        refuse_owner(found)
        _use(root, _default_maps(root, str(found), found.parent))
    except (PassedOverError, LidarcliError, OSError) as err:
        del root.meta[ORIGINS]
        root.meta[FOUND] = found, err
    else:
        root.meta[FOUND] = found, None


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


def options(command: click.Command) -> list[DeclaredOption]:
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
        for each in options(one)
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
    own = [name for each in options(root.command) if (name := each.variable(root))]
    strange = [
        name
        for name in sorted(os.environ)
        if name.startswith(f"{PREFIX}_")
        and name not in {*NOT_OPTIONS, *own}
        and not any(name.startswith(f"{prefix}_") for prefix in known)
    ]
    return [f"{name}: lidarcli has no such command or option" for name in strange]


def tell_settings(ctx: click.Context) -> None:
    """Tell of the settings that are in force, or were passed over, and of variables that do nothing.

    Raises
    ------
    LidarcliError
        The settings that were found cannot be used, and nobody has named others.
    """
    if ctx.info_name == "completion":
        # A shell asks whenever it starts, wherever that is.
        return
    say = ctx.ensure_object(Messages)
    found, problem = ctx.meta.get(FOUND, (None, None))
    if isinstance(problem, PassedOverError | OSError):
        why = problem.strerror if isinstance(problem, OSError) else problem
        say.error(f"{found} is not used, defaults are: {why}; --config {shlex.quote(str(found))} uses it")
    elif problem is not None:
        raise problem
    elif found is not None:
        # Also where the file itself asks for quiet.
        if not _asked_to_be_quiet(ctx):
            say.write(one_line(f"settings from {found} (--config {NONE} ignores them)"))
    elif file := ctx.meta.get(ORIGINS):
        say.info(f"settings from {file}")
    for line in unknown_variables(ctx):
        say.info(f"lidarcli: {line}")


def _asked_to_be_quiet(ctx: click.Context) -> bool:
    """True if -q stands on the command line or in the environment."""
    asked = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
    each: click.Context | None = ctx
    while each is not None:
        if each.get_parameter_source("quiet") in asked:
            return ctx.ensure_object(Messages).quiet
        each = each.parent
    return False


def _default_maps(ctx: click.Context, file: str, found_in: Path | None = None) -> dict[str, Any]:
    """The file's values as the default maps of all commands, as `click` nests them; all of the file is checked.

    A file that was `found_in` a folder may not set everything: values that it may not set stand there as `Refused`.
    """
    from lidarcli.tomlfiles import read_toml

    judge = None if found_in is None else partial(refuse_owner, Path(file))
    settings = read_toml(file, "settings file", judge)
    shared = {key: value for key, value in settings.items() if not isinstance(value, Mapping)}
    for_all = _by_option(file, "", shared)
    for key in sorted(NOT_SHARED & for_all.keys()):
        raise OptionError(
            f"{file}: '{key}' is not the same in every command: set it below [detect] or another one"
        )
    found: dict[str, dict[str, Any]] = {}
    every: set[str] = set()
    # A key such as `background = "room.parquet"` is an option, not the tables of the commands.
    tables = _by_command(file, {key: settings[key] for key in settings.keys() - shared}, ctx)
    for name, command, _ in commands(ctx):
        table = tables.get(name, {})
        header = name.replace(" ", ".")
        known = {each.key: each for each in options(command)}
        every |= known.keys()
        for key in table:
            if _spelled(key) not in known:
                superseded = getattr(command, "superseded", {})
                if isinstance(table[key], Mapping):
                    raise OptionError(f"{file}: [{header}.{key}]: no such command")
                _refuse(file, f"[{header}]", key, known, superseded.get(f"--{_spelled(key)}"))
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
        if found_in is not None:
            for key, value in (common | own).items():
                if key in known and (cause := why_refused(found_in, known[key], value)) is not None:
                    where = _place(file, header if key in own else "", key)
                    values[str(known[key].name)] = refusal(file, where, known[key], value, cause)
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


def _refuse(file: str, place: str, key: str, known: Any, gone: str | None = None) -> None:
    """Refuse a key that is no option; `gone` says what does the work of one that there was."""
    near = get_close_matches(_spelled(key), sorted(known), 1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    if gone is not None:
        hint = f" any more: {gone}"
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
        item.isoformat() if isinstance(item, date) else item
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


# A file that was found and not named: whom it has to belong to, and what it may not set. Whoever sends a folder, or may
# write into one above the working directory, could put such a file there.

NAMED_ONLY = {
    "cluster": "whoever answers there runs the work",
    "files-from": "a list names files and URLs anywhere",
    "overwrite": "files would be replaced",
    "resume": "it decides which logs are skipped",
}
"""Options that such a file cannot set → why."""
_SHARES = ("\\\\", "//")
"""Names of files on other machines begin so."""


class PassedOverError(Exception):
    """A found file that is not used; the command goes on without it."""


def refuse_owner(file: Path, opened: os.stat_result | None = None) -> None:
    """Refuse a file that somebody else has made, or could write or replace, as ssh does.

    Parameters
    ----------
    file : as it was found; a link has to belong to the user, too
    opened : what the system says of the file that was opened; by default of the one that has the name now

    Raises
    ------
    PassedOverError
        With the cause.
    """
    if not hasattr(os, "geteuid"):
        # Windows has no such owner to ask for: there the folder of the user is what others may not write.
        if not file.resolve().is_relative_to(Path.home().resolve()):
            raise PassedOverError(f"it is not below {Path.home()}")
        return
    real = file.resolve()
    _refuse_writers("it", opened or real.stat())
    if file.is_symlink():
        _refuse_other_owner("the link", file.lstat())
    for folder in {file.parent, real.parent}:
        found = folder.stat()
        _refuse_other_owner(f"the folder {folder}", found)
        # In a folder such as /tmp nobody but the owner of a file may replace it.
        if not found.st_mode & stat.S_ISVTX:
            _refuse_writers(f"the folder {folder}", found)


def why_refused(folder: Path, option: DeclaredOption, value: Any) -> str | None:
    """Why a file that was found in a folder may not set an option to a value; None where it may."""
    cause = NAMED_ONLY.get(option.key)
    for item in value if isinstance(value, list) else [value]:
        if cause is None and isinstance(item, str) and item != "-":
            cause = _why_no_output(folder, item) if option.is_output else _why_no_input(folder, option, item)
    return cause


def refusal(file: str, place: str, option: DeclaredOption, value: Any, cause: str) -> Refused:
    """The refused value, and the line for whoever uses it; `place` is how a message calls it."""
    message = (
        f"{place} is not taken from a file that was not named ({cause}): use it with --config {shlex.quote(file)}, write "
        f"--{option.key} on the command line, or use no file with --config none"
    )
    return Refused(value, cause, message)


def _why_no_output(folder: Path, name: str) -> str | None:
    """Why nothing is to be written under this name; None where it is below the folder of the file."""
    if "://" in name or name.startswith("~"):
        return f"{name} is outside {folder}"
    return _why_outside(folder, Path.cwd(), name)


def _why_no_input(folder: Path, option: DeclaredOption, name: str) -> str | None:
    """Why nothing is to be read from there: it would be shown to whoever sees the messages, or to another machine."""
    form = option.declared.value
    if not isinstance(form, File) or name in form.words:
        return None
    if "://" in name or name.startswith(_SHARES):
        return "it is on another machine, which would see who asks"
    cause = _why_outside(folder, folder, name)
    if cause is None:
        try:
            mode = (folder / name).stat().st_mode
        except OSError:
            return None
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            cause = f"{name} is no regular file"
    return cause


def _why_outside(folder: Path, base: Path, name: str) -> str | None:
    """Why a name, as seen from `base`, is not below a folder; None where it is."""
    # Windows has further ways of naming a place elsewhere: C:\, C:, \\host\, with either slash.
    elsewhere = bool(PureWindowsPath(name).anchor) and not Path(name).is_absolute()
    try:
        inside = (
            not elsewhere
            and not name.startswith(_SHARES)
            and all(
                part.resolve().is_relative_to(folder.resolve()) for part in (base / name, *_named(base, name))
            )
        )
    except (OSError, ValueError, RuntimeError):
        # Links in a circle, and what is no name.
        inside = False
    return None if inside else f"{name} is outside {folder}"


def _named(base: Path, name: str) -> Iterator[Path]:
    """Yield the files that a pattern names."""
    if glob.has_magic(name):
        from lidarcli.pipeline.inputs.files import matching

        yield from map(Path, matching(str(base / name))[0])


def _refuse_other_owner(what: str, found: os.stat_result) -> None:
    if found.st_uid not in (0, os.geteuid()):
        raise PassedOverError(f"{what} belongs to {_user(found.st_uid)}")


def _refuse_writers(what: str, found: os.stat_result) -> None:
    _refuse_other_owner(what, found)
    if found.st_mode & stat.S_IWOTH:
        raise PassedOverError(f"everybody may write {what}")
    if found.st_mode & stat.S_IWGRP and not _is_private(found.st_gid):
        raise PassedOverError(f"a group of users may write {what}")


def _is_private(group: int) -> bool:
    """True for a group that the user alone is in; on many systems files are writable for it by default."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return user.pw_gid == group and found.gr_name == user.pw_name and not {*found.gr_mem} - {user.pw_name}


def _user(number: int) -> str:
    """The name of a user, or the number where nobody has it."""
    import pwd

    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"
