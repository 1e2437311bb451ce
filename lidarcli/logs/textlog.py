"""What the readers of text logs share: a file or a stream, packed or not, read block by block, as often as it can be."""

from __future__ import annotations

import os
import stat
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Protocol, Self, TypeVar

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import POSE_TYPES, Message, OpenOptions, ReadReport
from lidarcli.logs.text import TextBlock, TextSource
from lidarcli.sweeps import RawSweeps

Index = TypeVar("Index")


class Sweeps(Protocol):
    """Lines in, sweeps out."""

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]: ...


class Poses(Protocol):
    """Lines in, poses out, and in the end what the whole log tells."""

    def feed(self, block: TextBlock) -> Iterator[Message]: ...

    def finish(self) -> Iterator[Message]: ...


class TextLog(ABC):
    """A log from a file or from a stream of its text: the part of a `Log` that does not look at the text."""

    def __init__(self, source: str | os.PathLike[str] | BinaryIO, options: OpenOptions | None = None) -> None:
        self._options = options or OpenOptions()
        self._stream: BinaryIO | None = None
        self._once = not isinstance(source, str | os.PathLike)
        self._used = False
        self.size: int | None = None
        if isinstance(source, str | os.PathLike):
            self.path = os.fspath(source)
        else:
            self.path, self._stream = "-", source
        self._text = self._open()
        self.compression = self._text.compression

    @property
    def position(self) -> int:
        """Where the last pass stands [bytes]."""
        return self._text.position

    @abstractmethod
    def _sweeps(self, topics: Collection[str] | None, report: ReadReport) -> Sweeps:
        """What makes sweeps of lines, for one pass."""

    @abstractmethod
    def _poses(self, types: Collection[str], report: ReadReport) -> Poses:
        """What makes poses of lines, for one pass."""

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Blocks of sweeps in the order of the file within each topic."""
        decoder = self._sweeps(topics, report)
        for block in self._blocks(report):
            yield from decoder.feed(block)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Poses."""
        if not POSE_TYPES.intersection(types):
            return
        decoder = self._poses(types, report)
        for block in self._blocks(report):
            yield from decoder.feed(block)
        yield from decoder.finish()

    def close(self) -> None:
        """Release the file, if it is ours."""
        if self._stream is not None and not self._once:
            self._stream.close()
            self._stream = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _indexed(self, index: Callable[[Iterable[TextBlock]], Index]) -> Index | None:
        """An index of the whole text, which is read for it apart from all passes; None of a stream."""
        if self._once:
            return None
        try:
            with Path(self.path).open("rb") as file:
                return index(TextSource(file, self.size).blocks())
        except OSError as err:
            raise UnreadableError(f"{self.path}: cannot be read: {err.strerror or err}") from err

    def _blocks(self, report: ReadReport) -> Iterator[TextBlock]:
        """The blocks from the first one on; a stream has them once."""
        if self._used:
            if self._once:
                raise UnreadableError(f"{self.path}: a stream can be read only once")
            self.close()
            self._text = self._open()
        self._used = True
        self._text.report_to(report)
        return self._text.blocks()

    def _open(self) -> TextSource:
        try:
            if self._stream is None:
                self._stream = Path(self.path).open("rb")  # noqa: SIM115 (closed by close)
                status = os.fstat(self._stream.fileno())
                if stat.S_ISREG(status.st_mode):
                    self.size = status.st_size
                else:
                    self._once = True
            return TextSource(self._stream, self.size)
        except OSError as err:
            raise UnreadableError(f"{self.path}: cannot be read: {err.strerror or err}") from err
