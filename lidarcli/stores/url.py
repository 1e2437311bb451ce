"""Places of files: a path of this machine, or the URL of an object in a store; and requests to stores.

The file systems are those of pyarrow, so are the ways in which they find credentials; lidarcli sees none of these.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from os import PathLike, fspath
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from lidarcli.errors import LidarcliError, OptionError, OutputError, UnreadableError

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import fs

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
    etag: str = ""
    """The store's mark of the content, where it is known."""


Place = Path | Url


def is_url(text: str | PathLike[str]) -> bool:
    """Return True for the name of an object in a store.

    >>> is_url("s3://logs/run.mcap"), is_url("run.mcap"), is_url("http://host/run.mcap")
    (True, False, False)
    """
    scheme, mark, _ = fspath(text).partition("://")
    return bool(mark) and scheme.lower() in SCHEMES


def blotted(text: str) -> str:
    """Return a text without credentials.

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
        raise OptionError(f"{scheme}://{bucket}/{key}: names with an empty part (//) cannot be read or written")
    return Url(scheme, bucket, key, asked)


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

_AWS = re.compile(r"AWS Error ([A-Z_]+)")
_CAUSES = {
    "NO_SUCH_BUCKET": "there is no such bucket",
    "ACCESS_DENIED": "access denied; credentials come from the environment or the store's own configuration",
    "NETWORK_CONNECTION": "the store cannot be reached",
    "INVALID_ACCESS_KEY_ID": "the store does not know these credentials",
    "SIGNATURE_DOES_NOT_MATCH": "the store refuses these credentials",
}


def head(url: Url) -> State | None:
    """Return size and time of an object; None if it does not exist."""
    with _errors(url, UnreadableError):
        try:
            with _system(url).open_input_file(_path(url)) as file:
                about = {key.lower(): value for key, value in (file.metadata() or {}).items()}
                size = file.size()
        except FileNotFoundError:
            return None
        etag = about.get(b"etag", about.get("etag", b""))
        words = etag.decode() if isinstance(etag, bytes) else str(etag)
        # Google's store tells the time only to whoever lists.
        mtime = _http_date(about) or _mtime(_system(url).get_file_info(_path(url)))
        return State(size, mtime, words.strip('"'))


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
        if (code := _AWS.search(str(err))) is not None and code[1] == "ACCESS_DENIED":
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
        return bytes(file.read_at(file.size(), 0))


def put(path: Path, url: Url) -> None:
    """Put a file of this machine into a store under its final name, where it appears whole or not at all.

    No interrupt may come between opening and writing (`newfiles.NewFiles`): a stream that is let go of is closed, and
    what there is of it by then would appear.
    """
    with _errors(url, OutputError, "cannot write "):
        data = _mapped(path)
        stream = _system(url).open_output_stream(_path(url), compression=None)
        stream.write(data)
        # A small object is sent only now, and what is wrong with it comes out here.
        stream.close()


def remove(url: Url) -> None:
    """Remove an object."""
    with _errors(url, OutputError, "cannot remove "):
        _system(url).delete_file(_path(url))


def _mapped(path: Path) -> pa.Buffer:
    """Return the bytes of a file; one write of all of them is sent in parts, of which few are in memory."""
    import pyarrow as pa

    if not path.stat().st_size:
        return pa.py_buffer(b"")
    with pa.memory_map(os.fsdecode(path)) as file:
        return file.read_buffer()


def _path(url: Url) -> str:
    container = url.bucket.rpartition("@")[2] if url.scheme in ("s3", "gs") else url.bucket.partition("@")[0]
    return f"{container}/{url.key}" if url.key else container


def _system(url: Url) -> fs.FileSystem:
    return _made(url.scheme, url.bucket, url.options)


@cache
def _made(scheme: str, bucket: str, options: str) -> fs.FileSystem:
    """Return the file system of a bucket, set up by the URL and the environment variables of the stores."""
    from urllib.parse import parse_qsl

    asked = dict(parse_qsl(options))
    if scheme == "s3":
        return _s3(bucket, asked)
    if scheme == "gs":
        return _gcs(bucket, asked)
    return _azure(bucket)


def _s3(bucket: str, asked: dict[str, str]) -> Any:
    from pyarrow import fs

    endpoint = asked.get("endpoint_override") or _env(*ENDPOINTS)
    name = bucket.rpartition("@")[2]
    settings: dict[str, Any] = {
        "allow_delayed_open": True,
        "connect_timeout": CONNECT_S,
        "request_timeout": REQUEST_S,
        "retry_strategy": fs.AwsStandardS3RetryStrategy(max_attempts=ATTEMPTS),
        "anonymous": bucket.startswith("anonymous@"),
    }
    if endpoint:
        settings["endpoint_override"] = endpoint
    if "scheme" in asked:
        settings["scheme"] = asked["scheme"]
    region = asked.get("region") or _env("AWS_REGION", "AWS_DEFAULT_REGION")
    if region is None and not endpoint:
        try:
            region = fs.resolve_s3_region(name)
        except OSError as err:
            raise _named(Url("s3", bucket, ""), err, UnreadableError, "") from err
    return fs.S3FileSystem(**settings, **({"region": region} if region else {}))


def _gcs(bucket: str, asked: dict[str, str]) -> Any:
    try:
        from pyarrow.fs import GcsFileSystem
    except ImportError as err:
        raise OptionError(f"gs://{bucket}: this build of pyarrow has no Google Cloud Storage") from err
    emulator = _env("STORAGE_EMULATOR_HOST")
    settings: dict[str, Any] = {"anonymous": bucket.startswith("anonymous@") or bool(emulator)}
    endpoint = asked.get("endpoint_override") or emulator
    if endpoint:
        scheme, mark, host = endpoint.rpartition("://")
        settings |= {"endpoint_override": host.rstrip("/"), "scheme": asked.get("scheme") or (scheme if mark else "http")}
    return GcsFileSystem(**settings)


def _azure(bucket: str) -> Any:
    try:
        from pyarrow.fs import AzureFileSystem
    except ImportError as err:
        raise OptionError(f"az://{bucket}: this build of pyarrow has no Azure storage") from err
    told = dict(part.split("=", 1) for part in (_env("AZURE_STORAGE_CONNECTION_STRING") or "").split(";") if "=" in part)
    host = bucket.partition("@")[2]
    account = (
        host.partition(".")[0] or told.get("AccountName") or _env("AZURE_STORAGE_ACCOUNT", "AZURE_STORAGE_ACCOUNT_NAME")
    )
    if not account:
        raise OptionError(
            f"az://{bucket}: names no account: set AZURE_STORAGE_ACCOUNT, or write "
            "abfs://CONTAINER@ACCOUNT.dfs.core.windows.net/NAME"
        )
    key = told.get("AccountKey") or _env("AZURE_STORAGE_KEY", "AZURE_STORAGE_ACCOUNT_KEY")
    if key:
        import base64

        try:
            base64.b64decode(key, validate=True)
        except ValueError as err:
            # The library would end the process.
            raise OptionError(f"az://{bucket}: the key of the account is not one: it is no Base64") from err
    settings: dict[str, Any] = {"account_key": key} if key else {}
    if sas := told.get("SharedAccessSignature") or _env("AZURE_STORAGE_SAS_TOKEN"):
        settings = {"sas_token": sas}
    if endpoint := told.get("BlobEndpoint"):
        scheme, _, rest = endpoint.partition("://")
        authority = rest.partition("/")[0]
        if not authority.startswith(f"{account}."):
            settings |= {"blob_storage_authority": authority, "blob_storage_scheme": scheme}
            settings |= {"dfs_storage_authority": authority, "dfs_storage_scheme": scheme}
    return AzureFileSystem(account, **settings)


def _env(*names: str) -> str | None:
    return next((value for name in names if (value := os.environ.get(name))), None)


def _mtime(info: fs.FileInfo) -> int:
    return int(info.mtime_ns or 0)


def _http_date(about: dict[Any, Any]) -> int:
    """Return the time of the last change by the metadata of a store; 0 if unknown."""
    import datetime

    value = about.get(b"last-modified", about.get("last-modified", b""))
    text = value.decode() if isinstance(value, bytes) else str(value)
    try:
        return int(datetime.datetime.fromisoformat(text).timestamp()) * 1_000_000_000
    except ValueError:
        return 0


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
    code = _AWS.search(words)
    cause = _CAUSES.get(code[1]) if code else None
    if code and code[1] == "NETWORK_CONNECTION" and (endpoint := _env(*ENDPOINTS)):
        cause = f"{cause}: nobody answers at {endpoint.rpartition('@')[2]} ({' or '.join(ENDPOINTS)})"
    if cause is None:
        cause = blotted(words.partition(" (Request ID")[0])
    return kind(f"{before}{url}: {cause}")
