"""CARMEN logs: `.log`, `.clf`, `.gfs`, also packed with gzip; one message per line."""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import LASERSCAN, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.carmen.lines import Index
from lidarcli.logs.carmen.poses import CORRECTED, ENCODING, MOUNTS, ODOMETRY, TRUE, TYPES, PoseDecoder
from lidarcli.logs.carmen.sweeps import SweepDecoder
from lidarcli.logs.carmen.words import LASERS, ODOM, TRUEPOS
from lidarcli.logs.text import TextBlock, TextSource
from lidarcli.sweeps import RawSweeps


class CarmenLog:
    """A CARMEN log from a file or from a stream of its text."""

    format = "carmen"

    def __init__(self, source: str | os.PathLike[str] | BinaryIO, options: OpenOptions | None = None) -> None:
        self._options = options or OpenOptions()
        self._stream: BinaryIO | None = None
        self._once = not isinstance(source, str | os.PathLike)
        self._used = False
        self._index: Index | None = None
        self.size: int | None = None
        if isinstance(source, str | os.PathLike):
            self.path = os.fspath(source)
        else:
            self.path, self._stream = "-", source
        self._text = self._open()
        self.compression = self._text.compression

    def topics(self) -> list[Topic] | None:
        """Sweeps and poses by the first words of all lines, which are read for it once; None of a stream."""
        if self._once:
            return None
        if self._index is None:
            try:
                with Path(self.path).open("rb") as file:
                    self._index = Index.of(TextSource(file, self.size).blocks())
            except OSError as err:
                raise UnreadableError(f"{self.path}: cannot be read: {err.strerror or err}") from err
        counts = self._index.lines
        found = [
            Topic(laser.topic, LASERSCAN, ENCODING, counts[word])
            for word, laser in LASERS.items()
            if counts[word]
        ]
        posed = sum(counts[word] for word in self._index.posed)
        told = {
            ODOMETRY: posed or counts[ODOM],
            CORRECTED: posed,
            TRUE: counts[TRUEPOS],
            MOUNTS: None if found and (posed or counts[ODOM]) else 0,
        }
        return found + [
            Topic(name, TYPES[name], ENCODING, count) for name, count in told.items() if count != 0
        ]

    @property
    def position(self) -> int:
        """Where the last pass stands [bytes]."""
        return self._text.position

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Blocks of sweeps in the order of the file within each topic."""
        decoder = SweepDecoder(self._options, report, topics)
        for block in self._start_over(report):
            yield from decoder.feed(block)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Poses; where sweeps tell those of the robot, lines that tell nothing else are passed over."""
        if not set(types).intersection(TYPES.values()):
            return
        self.topics()
        with_odom = self._index is None or not self._index.posed
        decoder = PoseDecoder(types, report, with_odom)
        for block in self._start_over(report):
            yield from decoder.feed(block)
        yield from decoder.finish()

    def close(self) -> None:
        """Release the file, if it is ours."""
        if self._stream is not None and not self._once:
            self._stream.close()
            self._stream = None

    def __enter__(self) -> CarmenLog:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

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

    def _start_over(self, report: ReadReport) -> Iterator[TextBlock]:
        """The blocks from the first one on; a stream has them once."""
        if self._used:
            if self._once:
                raise UnreadableError(f"{self.path}: a stream can be read only once")
            self.close()
            self._text = self._open()
        self._used = True
        self._text.report_to(report)
        return self._text.blocks()
