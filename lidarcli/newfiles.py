"""Output files that get their names only when they are whole, even if other runs write into the same folder."""

from __future__ import annotations

import os
import re
import shutil
import stat
import tempfile
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self, cast

from lidarcli.errors import OutputError, UnreadableError
from lidarcli.machine import Beside
from lidarcli.stores.url import Place, Url

try:
    import fcntl
except ImportError:
    # Windows has no such locks: runs into one folder are then told apart by their names alone.
    fcntl = None  # type: ignore[assignment]

LOCK_WAIT_S = 1.0
"""Time to wait for a lock [s]: publishing takes milliseconds, so a lock held for longer belongs to another program."""
_TAKEN: set[str] = set()
"""Folders whose lock another program holds all the time, as `flock DIR lidarcli ... -o DIR` does."""
_HOST = f"{zlib.crc32(os.uname().nodename.encode() if hasattr(os, 'uname') else b''):08x}"
"""Mark of this host: locks of a shared folder may not reach other hosts, so each clears away its own files."""
_SCRATCH = re.compile(rf"\.lidarcli-{_HOST}-[0-9a-f]{{16}}\.part")

Identity = tuple[int, int, int, int]


class WholeFiles(ABC):
    """Files of one folder, or of a store, that get their names together; leaving the context without `publish` leaves none.

    Parameters
    ----------
    beside : the folder below which the parts stand until then, in one of their own
    """

    def __init__(self, beside: Path) -> None:
        self._beside = self._scratch = beside
        self._stack = ExitStack()

    def part(self, path: Place) -> Path:
        """Return the place to write the file that will be `path`."""
        return self._scratch / path.name

    def open(self) -> None:
        """Make the folder for the parts. The caller has seen to `close` before, because an interrupt may come any time.

        Raises
        ------
        OutputError
            A file is there that may not be replaced, or the folder cannot be written.
        """
        self._scratch = self._stack.enter_context(scratch_folder(self._beside))

    @abstractmethod
    def publish(self) -> list[str]:
        """Give all files their names at once; a line for each that another run has written meanwhile.

        Raises
        ------
        OutputError
            Another run has written a file that may not be replaced, or a name cannot be given.
        """

    def close(self) -> None:
        """Remove what has not been published."""
        self._stack.close()

    def __enter__(self) -> Self:
        try:
            self.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()
        refuse_lost(error, self._beside)


class NewFiles(WholeFiles):
    """Files of one folder of this machine.

    Until they are published they stand in a folder of their own beside their final places, whose name nobody can foresee
    and which nobody else may enter: no link that was planted is written through, and no other run writes the same file.
    What a killed run left behind is cleared away by the next one.

    Parameters
    ----------
    paths : where the files belong, all in one folder, which is made
    overwrite : whether files that are there may be replaced
    folders : whether folders may be replaced, too (a ROS 2 bag is one)
    """

    def __init__(self, paths: Sequence[Path], overwrite: bool = True, folders: bool = False) -> None:
        super().__init__(paths[0].parent)
        self.paths = tuple(paths)
        self._overwrite = overwrite
        self._folders = folders
        self._before: list[Identity | None] = []

    def open(self) -> None:
        refuse(self.paths, self._overwrite, folders=self._folders)
        self._before = [_identity(path) for path in self.paths]
        super().open()

    def publish(self) -> list[str]:
        notes = []
        with _locked(self._beside):
            for path, before in zip(self.paths, self._before, strict=True):
                now = _identity(path)
                if now is None or now == before:
                    continue
                if not self._overwrite:
                    raise OutputError(
                        f"{path} exists: another run has written it meanwhile; use --overwrite to replace it"
                    )
                notes.append(f"replaced {path}, which another run has written meanwhile")
            for path in self.paths:
                self._place(path)
        return notes

    def _place(self, path: Path) -> None:
        part = self.part(path)
        try:
            # A folder takes the place of none but an empty one, and a file never that of a folder.
            if path.is_dir() and not path.is_symlink():
                path.rename(self._scratch / f"{path.name}.replaced")
            elif part.is_dir() and os.path.lexists(path):
                path.unlink()
            part.replace(path)
        except OSError as err:
            raise unwritable(path, err) from err


class StoreFiles(WholeFiles):
    """Objects of a store, which are written on this machine first.

    What may not be replaced was refused before. Of two runs that write the same object the last one stays, as a whole.
    """

    def __init__(self, paths: Sequence[Url]) -> None:
        super().__init__(Path(tempfile.gettempdir()))
        self.paths = tuple(paths)

    def publish(self) -> list[str]:
        # Not in this thread, where an interrupt would come between two files.
        beside = Beside("put")
        try:
            beside.submit(self._put).result()
        finally:
            beside.close()
        return []

    def _put(self) -> None:
        # Runs that put nothing into a store should not wait for this import.
        from lidarcli.stores.url import put

        for path in self.paths:
            put(self.part(path), path)


@contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """A folder below another one, which is made, that nobody else may enter and that is gone afterwards.

    What a killed run left behind is cleared away by the next one that comes here. `OutputError` where it cannot be made.
    """
    scratch = folder / f".lidarcli-{_HOST}-{os.urandom(8).hex()}.part"
    lock: int | None = None
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with _locked(folder) as alone:
                if alone:
                    _clear(folder)
                scratch.mkdir(mode=0o700)
                lock = _lock(scratch)
        except OSError as err:
            raise unwritable(folder, err) from err
        yield scratch
    finally:
        with suppress(OSError):
            shutil.rmtree(scratch)
        if lock is not None:
            os.close(lock)


def new_files(paths: Sequence[Place], overwrite: bool = True) -> WholeFiles:
    """Return a context for files of one folder that get their names together, on this machine or in a store."""
    if isinstance(paths[0], Url):
        return StoreFiles(cast("Sequence[Url]", paths))
    return NewFiles(cast("Sequence[Path]", paths), overwrite)


def write_whole(path: Place, data: bytes, overwrite: bool = True, devices: bool = False) -> list[str]:
    """Write one file that has its name only when it is whole; notes as of `NewFiles.publish`, `devices` as of `refuse`."""
    if devices and _is_device(path):
        try:
            cast("Path", path).write_bytes(data)
        except OSError as err:
            raise unwritable(path, err) from err
        return []
    with new_files([path], overwrite) as files:
        try:
            files.part(path).write_bytes(data)
        except OSError as err:
            raise unwritable(path, err) from err
        return files.publish()


def refuse(
    outputs: Iterable[Place],
    overwrite: bool,
    inputs: Iterable[str | Path] = (),
    folders: bool = False,
    devices: bool = False,
) -> None:
    """Refuse outputs before any work is done for them; `folders` as of `NewFiles`, `devices` such as /dev/null are taken.

    Raises
    ------
    OutputError
        One exists and may not be replaced, is one of the `inputs` (by whatever name), is no regular file, or stands where
        nothing can be written.
    """
    inputs = [*inputs]
    sources = {(found.st_dev, found.st_ino): str(path) for path in inputs if (found := _stat(path))}
    for path in outputs:
        if isinstance(path, Url):
            _refuse_object(path, overwrite, inputs)
            continue
        found = _stat(path)
        if found is not None and (found.st_dev, found.st_ino) in sources:
            source = sources[found.st_dev, found.st_ino]
            raise OutputError(f"{path} is an input of this run ({source}); write elsewhere with -o")
        if devices and _is_device(path):
            continue
        if os.path.lexists(path) and not overwrite:
            raise exists_already(path)
        if found is not None and stat.S_ISDIR(found.st_mode) and not folders:
            raise OutputError(f"{path} is a folder; it is not replaced")
        if found is not None and not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
            raise OutputError(f"{path} is a device or a pipe; it is not replaced")
        _refuse_place(path.parent)


def _refuse_object(url: Url, overwrite: bool, inputs: Iterable[str | Path]) -> None:
    """Refuse an output in a store, as `refuse` does one of this machine."""
    if str(url) in map(str, inputs):
        raise OutputError(f"{url} is an input of this run; write elsewhere with -o")
    try:
        exists = not overwrite and url.exists()
    except UnreadableError as err:
        raise OutputError(f"cannot write {err}") from err
    if exists:
        raise exists_already(url)


def exists_already(path: Place | str) -> OutputError:
    """Return the error of an output that may not be replaced."""
    return OutputError(f"{path} exists; use --overwrite to replace it, or -o to write elsewhere")


def unwritable(path: Place | str, err: OSError) -> OutputError:
    """Return the error of an output that the system refuses, as one line."""
    # Arrow puts words of its own before those of the system.
    reason = os.strerror(err.errno) if err.errno else err.strerror or str(err).splitlines()[0]
    return OutputError(f"cannot write {path}: {reason}")


def refuse_lost(error: object, folder: Path) -> None:
    """Raise an `OutputError` for an error of the system whose cause is that somebody has removed an output folder."""
    if isinstance(error, OSError) and error.filename is not None and not folder.is_dir():
        lost = Path(os.fsdecode(error.filename))
        if lost == folder or folder in lost.parents:
            raise unwritable(folder, error) from error


def _refuse_place(folder: Path) -> None:
    """Refuse a folder in which nothing can be made, or which cannot be made."""
    there = folder
    while not os.path.lexists(there) and there != there.parent:
        there = there.parent
    try:
        is_folder = stat.S_ISDIR(there.stat().st_mode)
    except OSError as err:
        raise unwritable(folder, err) from err
    if not is_folder:
        raise OutputError(f"cannot write below {there}: it is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {folder}: Permission denied")


def _is_device(path: Place) -> bool:
    """Tell whether a name is that of a terminal, of /dev/null or the like, which is never replaced."""
    found = None if isinstance(path, Url) else _stat(path)
    return found is not None and stat.S_ISCHR(found.st_mode)


def _stat(path: str | Path) -> os.stat_result | None:
    try:
        return os.stat(path)  # noqa: PTH116 (names as they come)
    except (OSError, ValueError):
        return None


def _identity(path: Path) -> Identity | None:
    """Return what distinguishes one file of a name from the next; None without a file."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Keep other runs from making and publishing files in this folder; yields whether that was possible."""
    until = time.monotonic() + LOCK_WAIT_S
    lock = None
    while str(folder) not in _TAKEN:
        try:
            lock = _lock(folder)
            break
        except BlockingIOError:
            if time.monotonic() > until:
                _TAKEN.add(str(folder))
            time.sleep(0.02)
    try:
        yield lock is not None
    finally:
        if lock is not None:
            os.close(lock)


def _lock(folder: Path) -> int | None:
    """Lock a folder and return its handle; None where there are no locks (some network file systems).

    Raises
    ------
    BlockingIOError
        Another run has it.
    """
    if fcntl is None:
        return None
    handle = None
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as err:
        if handle is not None:
            os.close(handle)
        if isinstance(err, BlockingIOError):
            raise
        return None
    return handle


def _clear(folder: Path) -> None:
    """Remove the folders that killed runs have left: our own ones on which nobody holds a lock."""
    with suppress(OSError), os.scandir(folder) as entries:
        left = [Path(entry.path) for entry in entries if _SCRATCH.fullmatch(entry.name)]
        for scratch in left:
            found = scratch.lstat()
            mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()
            with suppress(BlockingIOError):
                if mine and (lock := _lock(scratch)) is not None:
                    shutil.rmtree(scratch, ignore_errors=True)
                    os.close(lock)
