"""One log to read, or an input in which there is none."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lidarcli.errors import UnreadableError

STDIN = "-"


@dataclass(frozen=True, slots=True)
class Source:
    """One log to read: where it is, and its name, which outputs carry (`run`, or `trip/run` below a folder)."""

    path: str
    name: str
    files: tuple[str, ...] = ()
    """The files of a log that a pattern names, one sweep each."""

    @property
    def label(self) -> str:
        """How messages call it: as the user wrote it."""
        return "standard input" if self.is_stdin else self.path

    @property
    def is_stdin(self) -> bool:
        """Whether it is the standard input of this process."""
        return self.path == STDIN

    @property
    def size(self) -> int:
        """Bytes on disk; 0 where unknown."""
        path = Path(self.path)
        try:
            files = [Path(file) for file in self.files] or ([*path.iterdir()] if path.is_dir() else [path])
            return sum(file.stat().st_size for file in files if file.is_file())
        except OSError:
            return 0


@dataclass(frozen=True, slots=True)
class Nothing:
    """An input in which there is no log to open, and why."""

    path: str
    error: UnreadableError

    @property
    def label(self) -> str:
        """How messages call it: as the user wrote it."""
        return self.path
