"""The folder in which a case lies: its input, the victims beside it, and where outputs and temporary files go."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

VICTIMS = ("thesis", "thesis.db3", "locked", "folder/inside", "pipe")
"""What must be as it was after every case, by name below `Place.victims`."""
_EPOCH_NS = 1_600_000_000_000_000_000
"""Time stamp of every victim, so that a file written again with the same bytes is noticed."""

Snapshot = dict[str, tuple[int, int, int, bytes]]
"""Name below a folder → mode, size, time of the last change [ns] and content, or where a link points to."""


@dataclass(frozen=True, slots=True)
class Place:
    """A folder with all that belongs to one case."""

    root: Path

    @property
    def input(self) -> Path:
        """Folder of the files that are read; a case changes none of them."""
        return self.root / "in"

    @property
    def victims(self) -> Path:
        """Files that no case has any business with: see `VICTIMS`."""
        return self.root / "victims"

    @property
    def out(self) -> Path:
        """Folder for outputs."""
        return self.root / "out"

    @property
    def scratch(self) -> Path:
        """The folder for temporary files: empty after every case."""
        return self.root / "scratch"

    def prepare(self) -> None:
        """Empty folders, and the victims as they have to be."""
        for folder in (self.input, self.victims, self.out, self.scratch):
            _remove(folder)
            folder.mkdir(parents=True)
        _make_victims(self.victims)
        self._note.unlink(missing_ok=True)

    def note(self, **values: Any) -> None:
        """What the judge has to know of the case, beside its files: which to open, which commands to run."""
        self._note.write_text(json.dumps(values), encoding="utf-8")

    def noted(self) -> dict[str, Any]:
        """What `note` was given."""
        found: dict[str, Any] = json.loads(self._note.read_text(encoding="utf-8"))
        return found

    @property
    def _note(self) -> Path:
        return self.root / "case.json"


def snapshot(folder: Path) -> Snapshot:
    """Everything below a folder, without following links or opening pipes; folders without their times."""
    return {str(path.relative_to(folder)): _one(path) for path in [folder, *sorted(folder.rglob("*"))]}


def differences(before: Snapshot, after: Snapshot) -> Iterator[str]:
    """What became of the files, one line each."""
    for name in sorted(before.keys() | after.keys()):
        if name not in after:
            yield f"removed {name}"
        elif name not in before:
            yield f"made {name}"
        elif before[name] != after[name]:
            yield f"changed {name}"


def _one(path: Path) -> tuple[int, int, int, bytes]:
    status = path.lstat()
    if stat.S_ISDIR(status.st_mode):
        return status.st_mode, 0, 0, b""
    if stat.S_ISLNK(status.st_mode):
        return status.st_mode, status.st_size, status.st_mtime_ns, os.fsencode(path.readlink())
    content = path.read_bytes() if stat.S_ISREG(status.st_mode) else b""
    return status.st_mode, status.st_size, status.st_mtime_ns, content


def _make_victims(folder: Path) -> None:
    thesis, database, locked, inside, pipe = (folder / name for name in VICTIMS)
    thesis.write_bytes(b"years of work\n" * 9)
    database.write_bytes(_database())
    locked.write_bytes(b"read only\n")
    inside.parent.mkdir()
    inside.write_bytes(b"inside\n")
    os.mkfifo(pipe)
    for path in (thesis, database, locked, inside, pipe):
        os.utime(path, ns=(_EPOCH_NS, _EPOCH_NS))
    locked.chmod(0o444)


@cache
def _database() -> bytes:
    connection = sqlite3.connect(":memory:")
    try:
        connection.execute("CREATE TABLE work (year INTEGER)")
        connection.execute("INSERT INTO work VALUES (1999)")
        connection.commit()
        return bytes(connection.serialize())
    finally:
        connection.close()


def _remove(folder: Path) -> None:
    """Also folders that a case has made unreadable."""
    if folder.is_symlink():
        folder.unlink()
    for below in [folder, *folder.rglob("*")]:
        if below.is_dir() and not below.is_symlink():
            below.chmod(0o755)
    shutil.rmtree(folder, ignore_errors=True)
