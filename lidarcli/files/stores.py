"""Places of files: a path of this machine, or the URL of an object in a store; and requests to stores.

The file systems are those of pyarrow, so are the ways in which they find credentials; lidarcli sees none of these. Logs are
copied to this machine, outputs are put whole.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from os import PathLike, fspath
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from lidarcli.display.credentials import SECRETS, blotted, without_users
from lidarcli.errors import LidarcliError, OptionError, OutputError, UnreadableError
from lidarcli.system.records import dataclass, replace

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import fs

SCHEMES = ("s3", "gs", "az", "abfs", "abfss")
"""Stores that are read and written; `az` and `abfs` are two spellings of one."""

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://([^/]*)/?(.*)", re.DOTALL)
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

    def __str__(self) -> str:
        return f"{self.scheme}://{self.bucket}/{self.key}"

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
        """Return another name in the same folder."""
        return self.parent / name

    def with_suffix(self, suffix: str) -> Url:
        """Return the URL with another suffix."""
        return replace(self, key=str(PurePosixPath(self.key).with_suffix(suffix)))

    def has_magic(self) -> bool:
        """Return True for a pattern."""
        return _MAGIC.search(self.key) is not None

    def exists(self) -> bool:
        """Return True if an object of this name exists."""
        return head(self) is not None

    def is_file(self) -> bool:
        """As `exists`: a store has no folders."""
        return self.exists()

    def is_dir(self) -> bool:
        """Return True if there are objects below this name, or may be (a whole bucket)."""
        return not self.key or is_folder(self)


@dataclass(frozen=True, slots=True)
class State:
    """Identity of the content of a log, known without reading it."""

    size: int
    """Bytes."""
    mtime_ns: int
    """Nanoseconds since 1970."""


Place = Path | Url


def is_url(text: str | PathLike[str]) -> bool:
    """Return True for the name of an object in a store.

    >>> is_url("s3://logs/run.mcap"), is_url("run.mcap"), is_url("http://host/run.mcap")
    (True, False, False)
    """
    scheme, mark, _ = fspath(text).partition("://")
    return bool(mark) and scheme.lower() in SCHEMES


def place(text: str | PathLike[str] | Url) -> Place:
    """Return the path or the URL that a name stands for.

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
        scheme, mark, _ = fspath(text).partition("://")
        # It would be a path with a folder named `http:`.
        if mark and scheme.isalnum() and len(scheme) > 1:
            known = ", ".join(f"{each}://" for each in SCHEMES)
            raise OptionError(f"{fspath(text)}: {scheme}:// is not supported; give a path, or a URL of {known}")
        return Path(text)
    _refuse_bytes(fspath(text))
    found = _URL.fullmatch(fspath(text))
    assert found is not None
    scheme, bucket, key = found[1].lower(), found[2], found[3]
    secret = re.search(SECRETS, key)
    if without_users(fspath(text)) != fspath(text) or (secret and secret[0][0] in "?&"):
        raise OptionError(
            f"{scheme}://...: credentials do not belong in a URL; the store takes them from its own configuration "
            "and environment (docs/fleet.md)"
        )
    if not bucket:
        raise OptionError(f"{fspath(text)}: names no bucket, as in {scheme}://BUCKET/NAME")
    key = key.strip("/") if not key.startswith("/") else key
    if key.startswith("/") or "//" in key:
        raise OptionError(f"{scheme}://{bucket}/{key}: names with an empty part (//) cannot be read or written")
    return Url(scheme, bucket, key)


def _refuse_bytes(name: str) -> None:
    """Refuse names that no store has: they are UTF-8 there."""
    if any("\ud800" <= char <= "\udfff" for char in name):
        raise OptionError(f"{name}: is not UTF-8, as names in a store have to be")


def absolute(name: str | PathLike[str] | Url) -> str:
    """Return the absolute name of a place."""
    where = place(name)
    return str(where if isinstance(where, Url) else where.absolute())


CONNECT_S = 10.0
REQUEST_S = 60.0
"""[s] A store that does not answer for so long is asked again, `ATTEMPTS` times in all."""
ATTEMPTS = 4
PIECE = 8 << 20
"""Bytes that are asked for at once: one request each."""
ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
"""Environment variables that name another store than Amazon's."""

_AWS = r"AWS Error ([A-Z_]+)"
_CAUSES = {
    "NO_SUCH_BUCKET": "there is no such bucket",
    "ACCESS_DENIED": "access denied; credentials come from the environment or the store's own configuration",
    "NETWORK_CONNECTION": "the store cannot be reached",
    "INVALID_ACCESS_KEY_ID": "the store does not know these credentials",
    "SIGNATURE_DOES_NOT_MATCH": "the store refuses these credentials",
}


def head(url: Url) -> State | None:
    """Return size and time of an object; None if it does not exist."""
    from pyarrow import fs

    with _errors(url, UnreadableError):
        info = _system(url).get_file_info(_path(url))
    return State(info.size or 0, _mtime(info)) if info.type == fs.FileType.File else None


def listing(folder: Url) -> Iterator[tuple[Url, State]]:
    """Yield all objects below a folder, by name."""
    from pyarrow import fs

    with _errors(folder, UnreadableError):
        selector = fs.FileSelector(_path(folder), recursive=True, allow_not_found=True)
        infos = _system(folder).get_file_info(selector)
    base = _path(folder).rstrip("/") + "/"
    for info in sorted(infos, key=lambda info: str(info.path)):
        below = info.path.removeprefix(base)
        if info.type == fs.FileType.File and below and not info.path.endswith("/"):
            yield folder / below, State(info.size or 0, _mtime(info))


def has_bucket(url: Url) -> bool:
    """Return True if the bucket of an object exists, or if the store keeps that secret."""
    import pyarrow as pa
    from pyarrow import fs

    root = replace(url, key="")
    try:
        return bool(_system(url).get_file_info(_path(root)).type != fs.FileType.NotFound)
    except PermissionError:
        return True
    except (OSError, pa.ArrowException) as err:
        if (code := re.search(_AWS, str(err))) is not None and code[1] == "ACCESS_DENIED":
            return True
        raise _named(url, err, UnreadableError, "") from None


def is_folder(url: Url) -> bool:
    """Return True if there are objects below this name, but none of this name."""
    from pyarrow import fs

    with _errors(url, UnreadableError):
        return bool(_system(url).get_file_info(_path(url)).type == fs.FileType.Directory)


def open_object(url: Url) -> pa.NativeFile:
    """Open an object for random access; nothing of it is kept in memory."""
    with _errors(url, UnreadableError):
        try:
            return _system(url).open_input_file(_path(url))
        except FileNotFoundError as err:
            raise UnreadableError(f"{url}: no such object") from err


def read_object(url: Url) -> bytes:
    """Read a small object into memory."""
    with open_object(url) as file, _errors(url, UnreadableError):
        return bytes(file.read())


def fetch(url: Url, path: Path) -> None:
    """Copy an object into a file of this machine (`UnreadableError` where it is not there or breaks off)."""
    with open_object(url) as file, path.open("wb") as copy:
        size = file.size()
        with _errors(url, UnreadableError):
            from shutil import copyfileobj

            # Reads `PIECE` by `PIECE`, so that ctrl-C need not wait.
            copyfileobj(file, copy, PIECE)
        if copy.tell() != size:
            raise UnreadableError(f"{url}: ends at byte {copy.tell():,} of {size:,}: it was replaced meanwhile")


def put(path: Path, url: Url) -> None:
    """Put a file of this machine into a store under its final name, where it appears whole or not at all.

    No interrupt may come between opening and writing (`newfiles.NewFiles`): a stream that is let go of is closed, and
    what there is of it by then would appear.
    """
    with _errors(url, OutputError, "cannot write "):
        import pyarrow as pa

        # One write of all of it is sent in parts, of which few are in memory; nothing is mapped of an empty file.
        data = pa.py_buffer(b"")
        if path.stat().st_size:
            with pa.memory_map(os.fsdecode(path)) as file:
                data = file.read_buffer()
        stream = _system(url).open_output_stream(_path(url), compression=None)
        stream.write(data)
        # A small object is sent only now, and what is wrong with it comes out here.
        stream.close()


def remove(where: Place) -> None:
    """Remove a file or an object."""
    if isinstance(where, Url):
        with _errors(where, OutputError, "cannot remove "):
            _system(where).delete_file(_path(where))
        return
    try:
        where.unlink()
    except OSError as err:
        raise OutputError(f"cannot remove {where}: {err.strerror or err}") from err


def _path(url: Url) -> str:
    container = url.bucket.rpartition("@")[2] if url.scheme in ("s3", "gs") else url.bucket.partition("@")[0]
    return f"{container}/{url.key}" if url.key else container


def _system(url: Url) -> fs.FileSystem:
    return _system_of(url.scheme, url.bucket)


@cache
def _system_of(scheme: str, bucket: str) -> fs.FileSystem:
    """Return the file system of a bucket, set up by the environment variables of the stores."""
    try:
        return {"s3": _s3, "gs": _gcs}.get(scheme, _azure)(bucket)
    except ImportError as err:
        raise OptionError(f"{scheme}://{bucket}: this build of pyarrow has no such store") from err


def _s3(bucket: str) -> Any:
    from pyarrow import fs

    settings: dict[str, Any] = {}
    if endpoint := _env(*ENDPOINTS):
        settings["endpoint_override"] = endpoint
    region = _env("AWS_REGION", "AWS_DEFAULT_REGION")
    if region is None and not endpoint:
        try:
            region = fs.resolve_s3_region(bucket.rpartition("@")[2])
        except OSError as err:
            raise _named(Url("s3", bucket, ""), err, UnreadableError, "") from err
    if region:
        settings["region"] = region
    return fs.S3FileSystem(
        allow_delayed_open=True,
        connect_timeout=CONNECT_S,
        request_timeout=REQUEST_S,
        retry_strategy=fs.AwsStandardS3RetryStrategy(max_attempts=ATTEMPTS),
        anonymous=bucket.startswith("anonymous@"),
        **settings,
    )


def _gcs(bucket: str) -> Any:
    from pyarrow.fs import GcsFileSystem

    emulator = _env("STORAGE_EMULATOR_HOST")
    if emulator is None:
        return GcsFileSystem(anonymous=bucket.startswith("anonymous@"))
    scheme, _, host = emulator.rpartition("://")
    return GcsFileSystem(anonymous=True, endpoint_override=host.rstrip("/"), scheme=scheme or "http")


def _azure(bucket: str) -> Any:
    from pyarrow.fs import AzureFileSystem

    connection = (_env("AZURE_STORAGE_CONNECTION_STRING") or "").split(";")
    connection_values = dict(part.split("=", 1) for part in connection if "=" in part)
    account = bucket.partition("@")[2].partition(".")[0] or connection_values.get("AccountName")
    account = account or _env("AZURE_STORAGE_ACCOUNT", "AZURE_STORAGE_ACCOUNT_NAME")
    if not account:
        raise OptionError(
            f"az://{bucket}: names no account: set AZURE_STORAGE_ACCOUNT, or write "
            "abfs://CONTAINER@ACCOUNT.dfs.core.windows.net/NAME"
        )
    settings: dict[str, Any] = {}
    if key := connection_values.get("AccountKey") or _env("AZURE_STORAGE_KEY", "AZURE_STORAGE_ACCOUNT_KEY"):
        import base64

        try:
            base64.b64decode(key, validate=True)
        except ValueError as err:
            # The library would end the process.
            raise OptionError(f"az://{bucket}: the key of the account is not one: it is no Base64") from err
        settings["account_key"] = key
    if sas := connection_values.get("SharedAccessSignature") or _env("AZURE_STORAGE_SAS_TOKEN"):
        settings = {"sas_token": sas}
    scheme, _, rest = connection_values.get("BlobEndpoint", "").partition("://")
    authority = rest.partition("/")[0]
    if authority and not authority.startswith(f"{account}."):
        for service in ("blob", "dfs"):
            settings |= {f"{service}_storage_authority": authority, f"{service}_storage_scheme": scheme}
    return AzureFileSystem(account, **settings)


def _env(*names: str) -> str | None:
    return next((value for name in names if (value := os.environ.get(name))), None)


def _mtime(info: fs.FileInfo) -> int:
    return int(info.mtime_ns or 0)


@contextmanager
def _errors(url: Url, kind: type[LidarcliError], before: str = "") -> Iterator[None]:
    """Turn an error of a store into one line without secrets."""
    import pyarrow as pa

    try:
        yield
    except FileNotFoundError:
        raise
    except (OSError, pa.ArrowException) as err:
        raise _named(url, err, kind, before) from None


def _named(url: Url, err: Exception, kind: type[LidarcliError], before: str) -> LidarcliError:
    words = str(err).splitlines()[0] if str(err) else type(err).__name__
    code = re.search(_AWS, words)
    cause = _CAUSES.get(code[1]) if code else None
    if code and code[1] == "NETWORK_CONNECTION" and (endpoint := _env(*ENDPOINTS)):
        cause = f"{cause}: nobody answers at {endpoint.rpartition('@')[2]} ({' or '.join(ENDPOINTS)})"
    if cause is None:
        cause = blotted(words.partition(" (Request ID")[0])
    return kind(f"{before}{url}: {cause}")
