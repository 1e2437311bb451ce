"""ROS 2 bags: a folder with its storage files, or one bare SQLite file; packed by zstd or not, whole or damaged."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path, PureWindowsPath

from lidarcli.display.texts import Routine
from lidarcli.errors import LidarcliError, UnreadableError, unreadable
from lidarcli.files.newfiles import scratch_folder
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.logs.joined import Part, PartedLog, natural
from lidarcli.logs.registry import BINARY_SUFFIXES, TEXT_SUFFIXES, is_storage
from lidarcli.logs.rosbag2_sqlite import Known, SqliteLog
from lidarcli.logs.unpacking import is_zstd, unpack_file
from lidarcli.ros.bag_metadata import METADATA, named_files

_PACKED = re.compile(r"\.(zstd|zst)$", re.IGNORECASE)


def read_folder(folder: Path) -> tuple[list[Path], list[str], list[str]]:
    """Return the storage files of a bag in the order of the metadata, notes on it, and files that it alone names."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    there = {path.name: path for path in files if is_storage(path.name)}
    # Old bags put the folder's name before the file's; nothing outside of the folder is ever read.
    listed, cause = named_files(folder / METADATA)
    named = dict.fromkeys(PureWindowsPath(name).name for name in listed)
    notes: list[str] = [Routine(f"{cause}, the storage files were read without it")] if cause else []
    # Bags are packed, unpacked and renamed without anybody changing the metadata: of packed and plain twins one counts.
    twins: dict[str, list[str]] = {}
    for name in there:
        twins.setdefault(_content(name), []).append(name)
    chosen = {key: next((name for name in alike if name in named), min(alike, key=len)) for key, alike in twins.items()}
    ordered = [chosen[key] for key in dict.fromkeys(map(_content, named)) if key in chosen]
    missing = [name for name in named if _content(name) not in chosen]
    unnamed = sorted({*chosen.values()} - {*ordered}, key=natural)
    if unnamed and named:
        notes.append(f"{METADATA} does not name {', '.join(unnamed)}: read as well")
    logs = (*BINARY_SUFFIXES, *TEXT_SUFFIXES)
    others = [path.name for path in files if path.name not in there and path.name.lower().endswith(logs)]
    if others:
        notes.append(f"no part of this bag, and not read: {', '.join(others)}")
    names = sorted(chosen.values(), key=natural) if unnamed else ordered
    return [there[name] for name in names], notes, missing


def _content(name: str) -> str:
    """Return the name of a file without its compression suffix."""
    return _PACKED.sub("", name).lower()


class Rosbag2Log(PartedLog):
    """A ROS 2 bag: its files are read one after the other, as one stream."""

    def __init__(self, path: str | Path, options: OpenOptions | None = None) -> None:
        self._options = options or OpenOptions()
        self._unpacked: tuple[Path, Path, str] | None = None
        """File that is unpacked, what it unpacks to, and what is wrong with it."""
        self._stack = ExitStack()
        where = Path(path)
        with unreadable(path):
            is_folder = where.is_dir()
            files, notes, missing = read_folder(where) if is_folder else ([where], [], [])
            parts = [
                Part(str(file), file.name, file.stat().st_size, partial(self._storage, file, Known())) for file in files
            ]
        if not parts:
            raise UnreadableError(f"{path}: no .db3 or .mcap file in this folder, hence no ROS 2 bag")
        super().__init__(str(path), parts, names_parts=is_folder)
        self._opening.notes += notes
        for name in missing:
            self._opening.add_damage(name, f"{METADATA} names this file, but it is not there")
        kinds = {"mcap" if _is_mcap(file) else "sqlite3" for file in files}
        self.format = f"ros2 bag ({'+'.join(sorted(kinds, reverse=True))})"
        try:
            self._probe()
        except LidarcliError:
            self.close()
            raise

    def close(self) -> None:
        """Delete what was unpacked."""
        self._unpacked = None
        self._stack.close()

    def _probe(self) -> None:
        """Open the first file that can be opened; where none can, the first error is the log's."""
        first: UnreadableError | None = None
        for part in self.parts:
            try:
                with part.open(ReadReport()) as storage:
                    self._codecs.add(storage.compression)
                return
            except UnreadableError as err:
                first = first or err
        if first is not None:
            raise first

    @contextmanager
    def _storage(self, file: Path, known: Known, report: ReadReport) -> Iterator[Log]:
        """Open a storage file; the report takes what unpacking the file has met."""
        path = self._plain(file, report)
        if _is_mcap(file):
            from lidarcli.logs.mcap import McapLog

            opened: Log = McapLog(str(path), self._options)
        else:
            opened = SqliteLog(path, str(file), self._options, known)
        with opened as storage:
            yield storage

    def _plain(self, file: Path, report: ReadReport) -> Path:
        """Return the file itself, or what it unpacks to; the last one unpacked is kept until the log is closed."""
        with unreadable(file):
            if not is_zstd(file):
                return file
            self._codecs.add("zstd")
            if self._unpacked is None or self._unpacked[0] != file:
                self.close()
                plain = self._stack.enter_context(scratch_folder()) / ("bag.mcap" if _is_mcap(file) else "bag.db3")
                self._unpacked = (file, plain, unpack_file(file, plain))
        file, plain, cause = self._unpacked
        if cause:
            report.add_damage(file.name, cause)
        return plain


def _is_mcap(file: Path) -> bool:
    """Return True if the name of a storage file is that of an MCAP."""
    return ".mcap" in "".join(file.suffixes[-2:]).lower()
