"""Where a file is: a path of this machine, or the URL of an object. Imports nothing of the stores themselves."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path, PurePosixPath

from lidarcli.errors import OptionError

SCHEMES = ("s3", "gs", "az", "abfs", "abfss")
"""Stores that are read and written; `az` and `abfs` are two spellings of one."""

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://([^/]*)/?(.*)", re.DOTALL)
_OPTIONS = re.compile(r"\?((?:(?:endpoint_override|scheme|region)=[^&]*&?)+)$")
_SECRETS = re.compile(
    r"(?i)([?&](?:x-amz-[a-z-]+|[\w-]*(?:sig|signature|token|secret|password|key)(?:[_-]?id)?)="
    r"|\b(?:sig|signature|token|secret|password|accountkey)=)[^&;:\s\"']+"
)
"""Credentials in the query of a URL, and as stores name them in their messages."""

_USER = re.compile(r"([A-Za-z][A-Za-z0-9+.-]{0,30}):(//?)([^\s/@:]{0,2000}+(?::[^\s@]{0,2000}+)?)@")
"""A URL up to the end of its user; a password may hold slashes, and a path has lost one. Lengths have limits: a log may
hold names of any length, and without it the time to search them grows with the square of theirs."""

_MAGIC = re.compile(r"[*?[]")


@dataclass(frozen=True, slots=True)
class Url:
    """An object of a store, or the folder that its name begins with. Names as of `pathlib.Path` do the same."""

    scheme: str
    """One of `SCHEMES`."""
    bucket: str
    """As it was written; with its account for Azure (`container@account.dfs.core.windows.net`)."""
    key: str
    """Name of the object in the bucket, without a slash at its ends."""
    options: str = ""
    """`endpoint_override`, `scheme` and `region`, as in a query of a URL."""

    def __str__(self) -> str:
        query = f"?{self.options}" if self.options else ""
        return f"{self.scheme}://{self.bucket}/{self.key}{query}"

    def __truediv__(self, name: str) -> Url:
        _refuse_bytes(name)
        return replace(self, key=f"{self.key}/{name}".strip("/"))

    @property
    def name(self) -> str:
        """Last part of the key; the bucket where there is none."""
        return self.key.rpartition("/")[2] or self.bucket

    @property
    def suffix(self) -> str:
        """End of the name from its last dot on."""
        return PurePosixPath(self.name).suffix

    @property
    def parent(self) -> Url:
        """The folder it is in."""
        return replace(self, key=self.key.rpartition("/")[0])

    @property
    def stem(self) -> str:
        """The name without its suffix."""
        return PurePosixPath(self.name).stem

    def with_name(self, name: str) -> Url:
        """The same folder, another name."""
        return self.parent / name

    def with_suffix(self, suffix: str) -> Url:
        """The same with another suffix."""
        return replace(self, key=str(PurePosixPath(self.key).with_suffix(suffix)))

    def has_magic(self) -> bool:
        """Whether it is a pattern."""
        return _MAGIC.search(self.key) is not None

    def exists(self) -> bool:
        """Whether there is an object of this name."""
        from lidarcli.stores.store import head

        return head(self) is not None

    def is_file(self) -> bool:
        """The same: a store has no folders."""
        return self.exists()

    def is_dir(self) -> bool:
        """Whether there are objects below this name, or may be: it names a whole bucket."""
        from lidarcli.stores.store import is_folder

        return not self.key or is_folder(self)


@dataclass(frozen=True, slots=True)
class State:
    """What tells one content of a log from the next, without reading it."""

    size: int
    """Bytes."""
    mtime_ns: int
    """Nanoseconds since 1970."""
    etag: str = ""
    """The store's mark of the content, where it is known."""


Place = Path | Url


def is_url(text: str | PathLike[str]) -> bool:
    """Whether a name is that of an object in a store.

    >>> is_url("s3://logs/run.mcap"), is_url("run.mcap"), is_url("http://host/run.mcap")
    (True, False, False)
    """
    scheme, mark, _ = fspath(text).partition("://")
    return bool(mark) and scheme.lower() in SCHEMES


def blotted(text: str) -> str:
    """The same text without credentials, for whoever reads a message.

    >>> blotted("https://me:pass@host/x?aws_secret_access_key=K: no such file")
    'https://...@host/x?aws_secret_access_key=...: no such file'
    """
    return _SECRETS.sub(r"\1...", _USER.sub(_without_user, text))


def _without_user(found: re.Match[str]) -> str:
    scheme, name = found[1].lower(), found[3]
    # Nobody in particular, and the container of an account of Azure, are no secret.
    known = scheme in ("s3", "gs") if name == "anonymous" else scheme in ("az", "abfs", "abfss")
    return found[0] if known and ":" not in name else f"{found[1]}:{found[2]}...@"


def _refuse_scheme(text: str) -> None:
    """Refuse what is meant as a URL and would be taken for a path, with a folder named `http:`."""
    scheme, mark, _ = text.partition("://")
    if mark and scheme.isalnum() and len(scheme) > 1:
        known = ", ".join(f"{each}://" for each in SCHEMES)
        raise OptionError(f"{text}: {scheme}:// is not supported; give a path, or a URL of {known}")


def place(text: str | PathLike[str] | Url) -> Place:
    """The path or the URL that a name stands for.

    >>> place("s3://logs/2026/run.mcap").name
    'run.mcap'

    Raises
    ------
    OptionError
        A URL names no bucket, no object that could be read, or holds credentials, which are not repeated in the message.
    """
    if isinstance(text, Url):
        return text
    if not is_url(text):
        _refuse_scheme(fspath(text))
        return Path(text)
    _refuse_bytes(fspath(text))
    found = _URL.fullmatch(fspath(text))
    assert found is not None
    scheme, bucket, key = found[1].lower(), found[2], found[3]
    secret = _SECRETS.search(key)
    named = fspath(text).partition("?")[0]
    if _USER.sub(_without_user, named) != named or (secret and secret[0][0] in "?&"):
        raise OptionError(
            f"{scheme}://...: credentials do not belong in a URL; the store takes them from its own configuration "
            "and environment (docs/fleet.md)"
        )
    if not bucket:
        raise OptionError(f"{fspath(text)}: names no bucket, as in {scheme}://BUCKET/NAME")
    options = _OPTIONS.search(key)
    key = key[: options.start()] if options else key
    asked = options[1].strip("&") if options else ""
    if "@" in asked:
        raise OptionError(f"{scheme}://{bucket}/...: an endpoint is named without credentials")
    key = key.strip("/") if not key.startswith("/") else key
    if key.startswith("/") or "//" in key:
        raise OptionError(
            f"{scheme}://{bucket}/{key}: names with an empty part (//) cannot be read or written"
        )
    return Url(scheme, bucket, key, asked)


def _refuse_bytes(name: str) -> None:
    """Refuse names that no store has: they are UTF-8 there."""
    if any("\ud800" <= char <= "\udfff" for char in name):
        raise OptionError(f"{name}: is not UTF-8, as names in a store have to be")


def absolute(name: str | PathLike[str] | Url) -> str:
    """The same place for whoever has another working directory."""
    where = place(name)
    return str(where if isinstance(where, Url) else where.absolute())
