"""A `lidarcli.toml` that was found and not named: whom it has to belong to, and what it may not set.

Whoever sends a folder, or may write into one above the working directory, could put such a file there.
"""

from __future__ import annotations

import glob
import os
import shlex
import stat
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath
from typing import Any

import click

from lidarcli.cli.grouped import GroupedOption, Refused

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
        _refuse_owner("the link", file.lstat())
    for folder in {file.parent, real.parent}:
        found = folder.stat()
        _refuse_owner(f"the folder {folder}", found)
        # In a folder such as /tmp nobody but the owner of a file may replace it.
        if not found.st_mode & stat.S_ISVTX:
            _refuse_writers(f"the folder {folder}", found)


def why_refused(folder: Path, option: GroupedOption, value: Any) -> str | None:
    """Why a file that was found in a folder may not set an option to a value; None where it may."""
    cause = NAMED_ONLY.get(option.key)
    for item in value if isinstance(value, list) else [value]:
        if cause is None and isinstance(item, str) and item != "-":
            cause = _why_no_output(folder, item) if option.is_output else _why_no_input(folder, option, item)
    return cause


def refusal(file: str, place: str, option: GroupedOption, value: Any, cause: str) -> Refused:
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


def _why_no_input(folder: Path, option: GroupedOption, name: str) -> str | None:
    """Why nothing is to be read from there: it would be shown to whoever sees the messages, or to another machine."""
    if not isinstance(option.type, click.Path):
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
    """What a pattern names."""
    if glob.has_magic(name):
        from lidarcli.pipeline.inputs.files import matching

        yield from map(Path, matching(str(base / name))[0])


def _refuse_owner(what: str, found: os.stat_result) -> None:
    if found.st_uid not in (0, os.geteuid()):
        raise PassedOverError(f"{what} belongs to {_user(found.st_uid)}")


def _refuse_writers(what: str, found: os.stat_result) -> None:
    _refuse_owner(what, found)
    if found.st_mode & stat.S_IWOTH:
        raise PassedOverError(f"everybody may write {what}")
    if found.st_mode & stat.S_IWGRP and not _is_private(found.st_gid):
        raise PassedOverError(f"a group of users may write {what}")


def _is_private(group: int) -> bool:
    """Whether a group is the user's alone, which many systems make: then files are writable for it by default."""
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
