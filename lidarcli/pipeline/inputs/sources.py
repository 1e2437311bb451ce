"""One log to read, or an input in which there is none."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from lidarcli.errors import LidarcliError
from lidarcli.stores.url import State, Url, is_url, place

STDIN = "-"


@dataclass(frozen=True, slots=True)
class Source:
    """One log to read: where it is, and its name, which outputs carry (`run`, or `trip/run` below a folder)."""

    path: str
    name: str
    files: tuple[str, ...] = ()
    """The files of a log that a pattern names, one sweep each; in a store, also those of a folder that is one log."""
    found: State | None = field(default=None, compare=False)
    """Its state when the store listed it, or before a run began."""

    @property
    def url(self) -> Url | None:
        """Where it is, if that is in a store."""
        found = place(self.path) if is_url(self.path) else None
        return found if isinstance(found, Url) else None

    @property
    def is_pattern(self) -> bool:
        """Whether it was named by a pattern, which is no file or folder."""
        if not self.files or (url := self.url) is None:
            return bool(self.files)
        return not all(file.startswith(f"{url}/") for file in self.files)

    @property
    def file_name(self) -> str:
        """Name of its file or folder, without what is above."""
        return Path(self.path).absolute().name if (url := self.url) is None else url.name

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
        return 0 if (state := self.state()) is None else state.size

    def state(self) -> State | None:
        """Its size and last change; None where nobody can tell."""
        if self.found is not None or self.is_stdin or is_url(self.path):
            return self.found
        path = Path(self.path)
        try:
            files = [Path(file) for file in self.files] or ([*path.iterdir()] if path.is_dir() else [path])
            stats = [file.stat() for file in files if file.is_file()]
        except OSError:
            return None
        if not stats and not path.is_dir():
            return None
        return State(sum(it.st_size for it in stats), max((it.st_mtime_ns for it in stats), default=0))


@dataclass(frozen=True, slots=True)
class Nothing:
    """An input in which there is no log to open, and why."""

    path: str
    error: LidarcliError = field(compare=False)

    @property
    def label(self) -> str:
        """How messages call it: as the user wrote it."""
        return self.path
