"""A `lidarcli.toml` that was found and not named: whom it has to belong to, and what it may not set.

Whoever sends a folder, or may write into one above the working directory, could put such a file there.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path, PureWindowsPath
from typing import Any

import click

from lidarcli.cli.grouped import GroupedOption
from lidarcli.errors import OptionError

NAMED_ONLY = {
    "cluster": "whoever answers there runs the work",
    "files-from": "a list names files and URLs anywhere",
    "overwrite": "files would be replaced",
    "resume": "tables would be replaced",
}
"""Options that such a file cannot set → why."""


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


def refuse_value(place: str, folder: Path, option: GroupedOption, value: Any) -> None:
    """Refuse what a found file may not set, as an `OptionError`.

    Parameters
    ----------
    place : how a message calls the value
    folder : of the file
    """
    cause = NAMED_ONLY.get(option.key)
    for item in value if isinstance(value, list) else [value]:
        if cause is None and isinstance(item, str):
            cause = _why_no_output(folder, item) if option.is_output else _why_no_input(option, item)
    if cause is not None:
        raise OptionError(
            f"{place} is not taken from a file that was not named ({cause}): use the file with --config FILE, write "
            f"--{option.key} on the command line, or use no file with --config none"
        )


def _why_no_output(folder: Path, name: str) -> str | None:
    """Why nothing is to be written under this name; None where it is below the folder of the file."""
    # Windows has all ways of naming a place elsewhere: C:\, C:, \\host\, .. with either slash.
    path = PureWindowsPath(name)
    if "://" in name or path.anchor or ".." in path.parts or name.startswith("~"):
        return f"{name} is not below the working directory"
    try:
        inside = Path(name).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        # Links in a circle, and what is no name.
        inside = False
    return None if inside else f"{name} leads out of {folder} by a link"


def _why_no_input(option: GroupedOption, name: str) -> str | None:
    """Why nothing is to be read from there: another machine would be sent the user's credentials."""
    if isinstance(option.type, click.Path) and ("://" in name or name.startswith(("\\\\", "//"))):
        return "it is on another machine, which would see who asks"
    return None


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
