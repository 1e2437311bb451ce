"""Output files that get their names only when they are whole, even if other runs write into the same folder."""

from __future__ import annotations

import os
import re
import stat
import time
import zlib
from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from errno import EDQUOT, EFBIG, ENOSPC
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Self, cast

from lidarcli.errors import OptionError, OutputError, UnreadableError
from lidarcli.files.stores import Place, Url
from lidarcli.ros.bag_metadata import is_one_bag
from lidarcli.system.machine import Threads

try:
    import fcntl
except ImportError:
    # Windows has no such locks: runs into one folder are then kept apart by their names alone.
    fcntl = None  # type: ignore[assignment]

LOCK_WAIT_S = 1.0
"""Time to wait for a lock [s]: publishing takes milliseconds, so a lock held for longer belongs to another program."""
_TAKEN: set[str] = set()
"""Folders whose lock another program holds all the time, as `flock DIR lidarcli ... -o DIR` does."""
_HOST = f"{zlib.crc32(os.uname().nodename.encode() if hasattr(os, 'uname') else b''):08x}"
"""Mark of this host: locks of a shared folder may not reach other hosts, so each clears away its own files."""
_SCRATCH = re.compile(rf"\.lidarcli-{_HOST}-[0-9a-f]{{16}}\.part")

_PARTS = (".mcap", ".db3", ".zstd", ".bag")
"""Ends of the names of files that are read, or reported, as parts of the bag in whose folder they are."""

Inode = tuple[int, int]
Identity = tuple[int, int, int, int]

_READ: ContextVar[dict[Inode, str] | None] = ContextVar("read", default=None)


class NewFiles:
    """Files of this machine or of stores that get their names together; leaving the context without `publish` leaves none.

    Until they are published they are in a folder of their own next to their final places, whose name nobody can foresee
    and which nobody else may enter: no link that was planted is written through, and no other run writes the same file.
    What a killed run left behind is cleared away by the next one. Objects of a store are written on this machine first; of
    two runs that write the same object the last one stays, as a whole.

    Parameters
    ----------
    paths : where the files belong; folders are made
    overwrite : whether files that are there may be replaced
    bag : as of `refuse`
    """

    def __init__(self, paths: Sequence[Place], overwrite: bool = True, bag: Place | None = None) -> None:
        self.paths = tuple(paths)
        self._overwrite = overwrite
        self._bag = bag
        self._scratch: dict[Place, Path] = {}
        """Folder of outputs → folder of their parts."""
        self._before: dict[Path, Identity | None] = {}
        self._stack = ExitStack()

    def part(self, path: Place) -> Path:
        """Return the place to write the file that will be `path`."""
        return self._scratch[path.parent] / path.name

    def open(self) -> None:
        """Make folders for the parts. The caller has seen to `close` before, because an interrupt may come any time.

        Raises
        ------
        OutputError
            A file is there that may not be replaced, or a folder cannot be written.
        """
        local = [path for path in self.paths if isinstance(path, Path)]
        refuse(local, self._overwrite, bag=self._bag)
        self._before = {path: _identity(path) for path in local}
        for folder in dict.fromkeys(path.parent for path in self.paths):
            here = folder if isinstance(folder, Path) else None
            self._scratch[folder] = self._stack.enter_context(scratch_folder(here))

    def publish(self) -> list[str]:
        """Give all files their names at once; a line for each that another run has written meanwhile.

        Raises
        ------
        OutputError
            Another run has written a file that may not be replaced, or a name cannot be given.
        """
        if objects := [path for path in self.paths if isinstance(path, Url)]:
            # Not in this thread, where an interrupt would come between two files.
            thread = Threads("put")
            try:
                thread.submit(self._put, objects).result()
            finally:
                thread.close()
        notes = []
        for folder in dict.fromkeys(path.parent for path in self._before):
            paths = [path for path in self._before if path.parent == folder]
            with _locked(folder):
                for path in paths:
                    now = _identity(path)
                    if now is None or now == self._before[path]:
                        continue
                    if not self._overwrite:
                        raise OutputError(
                            f"{path} exists: another run has written it meanwhile; use --overwrite to replace it"
                        )
                    notes.append(f"replaced {path}, which another run has written meanwhile")
                refuse(paths, overwrite=True, bag=self._bag)
                for path in paths:
                    self._place(path)
        return notes

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
        for folder in self._scratch:
            if isinstance(folder, Path):
                refuse_lost(error, folder)
        if isinstance(error, OSError) and error.filename is None and error.errno in (ENOSPC, EDQUOT, EFBIG):
            raise unwritable(self.paths[0], error) from error

    def _put(self, objects: Sequence[Url]) -> None:
        # Runs that put nothing into a store should not wait for this import.
        from lidarcli.files.stores import put

        for path in objects:
            put(self.part(path), path)

    def _place(self, path: Path) -> None:
        part = self.part(path)
        with writing(path):
            # A folder takes the place of none but an empty one, and a file never that of a folder.
            if path.is_dir() and not path.is_symlink():
                path.rename(part.with_name(f"{path.name}.replaced"))
            elif part.is_dir() and os.path.lexists(path):
                path.unlink()
            part.replace(path)


@contextmanager
def scratch_folder(folder: Path | None = None) -> Iterator[Path]:
    """A folder below another one, which is made, that nobody else may enter and that is gone afterwards.

    Without another one it is below the temporary folder. What a killed run left behind is cleared away by the next one that
    comes here. `OutputError` where it cannot be made.
    """
    if folder is None:
        from tempfile import gettempdir

        folder = Path(gettempdir())
    scratch = folder / f".lidarcli-{_HOST}-{os.urandom(8).hex()}.part"
    lock: int | None = None
    try:
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            with _locked(folder) as alone:
                if alone:
                    _clear(folder)
                scratch.mkdir(mode=0o700)
                lock = _lock(scratch)
        # Whoever may enter it is this process: there is nobody to wait for.
        _TAKEN.add(str(scratch))
        yield scratch
    finally:
        _TAKEN.discard(str(scratch))
        try:
            _remove(scratch)
        finally:
            # Once more, where an interrupt has struck in it.
            _remove(scratch)
            if lock is not None:
                os.close(lock)


def _remove(scratch: Path) -> None:
    """Remove a folder with what is in it, most often nothing, as far as that can be done."""
    try:
        scratch.rmdir()
    except FileNotFoundError:
        pass
    except OSError:
        from shutil import rmtree

        rmtree(scratch, ignore_errors=True)


def write_whole(path: Place, data: bytes, overwrite: bool = True, devices: bool = False) -> list[str]:
    """Write one file that has its name only when it is whole; notes as of `NewFiles.publish`, `devices` as of `refuse`."""
    if devices and _is_device(path):
        with writing(path):
            cast("Path", path).write_bytes(data)
        return []
    with NewFiles([path], overwrite) as files:
        with writing(path):
            files.part(path).write_bytes(data)
        return files.publish()


@contextmanager
def reading(files: Iterable[str]) -> Iterator[None]:
    """Treat files as inputs of all that is written meanwhile, in addition to those that `refuse` is given."""
    token = _READ.set(_identified(files))
    try:
        yield
    finally:
        _READ.reset(token)


def refuse(
    outputs: Iterable[Place],
    overwrite: bool,
    inputs: Iterable[str | Path] = (),
    bag: Place | None = None,
    devices: bool = False,
) -> None:
    """Refuse outputs before any work is done for them.

    Parameters
    ----------
    overwrite : whether files that are there may be replaced
    inputs : what is read; an output is none of it, by whatever name, holds none of it, and is no further part of a bag
    bag : the output that is the folder of a ROS 2 bag; it may replace such a folder, and nothing else may replace any
    devices : whether /dev/null and the like are taken

    Raises
    ------
    OptionError
        An output has no name, or two outputs have one name.
    OutputError
        One exists and may not be replaced, is or holds an input, is no regular file, or stands where nothing can be
        written.
    """
    inputs = [*inputs]
    sources = _identified(inputs)
    never = ChainMap(sources, _READ.get() or {})
    taken: dict[str, Place] = {}
    real = cache(os.path.realpath)
    for path in outputs:
        refuse_nameless(path)
        name = str(path) if isinstance(path, Url) else os.path.join(real(path.parent), path.name)  # noqa: PTH118 (cheap)
        if isinstance(path, Url):
            if str(path) in map(str, inputs):
                raise OutputError(f"{path} is an input of this run; write elsewhere with -o")
            try:
                exists = not overwrite and path.exists()
            except UnreadableError as err:
                raise OutputError(f"cannot write {err}") from err
            if exists:
                raise exists_already(path)
        elif devices and _is_device(path):
            continue
        else:
            _refuse_file(path, overwrite, never, path == bag)
            if path == bag or path.suffix.lower() in _PARTS:
                above = _identified(Path(name).parents)
                if held := next((sources[key] for key in above if key in sources), None):
                    raise OutputError(f"{path} would be a part of {held}, which is read; write elsewhere with -o")
        if name in taken:
            raise OptionError(f"{path} is to be written twice; give each output a name of its own")
        taken[name] = path
    for folder, path in {Path(name).parent: path for name, path in reversed(taken.items())}.items():
        if other := next((taken[str(each)] for each in (folder, *folder.parents) if str(each) in taken), None):
            raise OptionError(f"{path} and {other} are in each other's way; give each a place of its own")


def refuse_nameless(path: Place) -> None:
    """Refuse `.`, `..` and `/` as the name of an output (`OptionError`)."""
    if path.name in ("", ".."):
        raise OptionError(f"{path} is a folder by any name; give a name of its own to what is to be written")


def _refuse_file(path: Path, overwrite: bool, never: Mapping[Inode, str], is_bag: bool) -> None:
    """Refuse an output of this machine, as `refuse` does."""
    found = _stat(path)
    if found is not None and (source := never.get((found.st_dev, found.st_ino))):
        raise OutputError(f"{path} is an input of this run ({source}); write elsewhere with -o")
    if os.path.lexists(path) and not overwrite:
        raise exists_already(path)
    if found is not None and stat.S_ISDIR(found.st_mode):
        if not is_bag:
            raise OutputError(f"{path} is a folder; it is not replaced")
        with writing(path):
            held = [*path.iterdir()]
            # What is a link, or a folder itself, is not looked into: then nothing is replaced.
            plain = all(stat.S_ISREG(each.lstat().st_mode) for each in held)
        if not plain or any(key in never for key in _identified(held)) or (held and not is_one_bag(path)):
            raise OutputError(
                f"{path} is a folder that holds more than a ROS 2 bag and its metadata.yaml; it is not replaced"
            )
    elif found is not None and not stat.S_ISREG(found.st_mode):
        raise OutputError(f"{path} is a device or a pipe; it is not replaced")
    _refuse_place(path.parent)


def _identified(paths: Iterable[str | Path]) -> dict[Inode, str]:
    """Return those of some files that there are, by what is the same whatever their names."""
    return {(found.st_dev, found.st_ino): str(path) for path in paths if (found := _stat(path))}


def exists_already(path: Place | str) -> OutputError:
    """Return the error of an output that may not be replaced."""
    return OutputError(f"{path} exists; use --overwrite to replace it, or -o to write elsewhere")


def unwritable(path: Place | str, err: OSError) -> OutputError:
    """Return the error of an output that the system refuses, as one line."""
    # Arrow puts words of its own before those of the system.
    reason = os.strerror(err.errno) if err.errno else err.strerror or str(err).splitlines()[0]
    return OutputError(f"cannot write {path}: {reason}")


@contextmanager
def writing(path: Place | str, nameless: bool = False) -> Iterator[None]:
    """Raise errors of the system as of `unwritable`; with `nameless` those alone that name no file, as one that is read."""
    try:
        yield
    except OSError as err:
        if nameless and err.filename is not None:
            raise
        raise unwritable(path, err) from err


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
    with writing(folder):
        is_folder = stat.S_ISDIR(there.stat().st_mode)
    if not is_folder:
        raise OutputError(f"cannot write below {there}: it is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {folder}: Permission denied")


def _is_device(path: Place) -> bool:
    """Return whether a name is that of a terminal, of /dev/null or the like, which is never replaced."""
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
    """Lock a folder and return its handle, None where there are no locks; `BlockingIOError` where another run has it."""
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
            is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()
            with suppress(BlockingIOError):
                if is_own and (lock := _lock(scratch)) is not None:
                    _remove(scratch)
                    os.close(lock)
