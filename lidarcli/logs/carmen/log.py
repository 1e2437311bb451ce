"""CARMEN logs: `.log`, `.clf`, `.gfs`, also packed with gzip; one message per line."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from lidarcli.logs.base import LASERSCAN, Message, ReadReport, Topic
from lidarcli.logs.carmen.lines import Index
from lidarcli.logs.carmen.poses import CORRECTED, TRUE, TYPES, PoseDecoder
from lidarcli.logs.carmen.sweeps import SweepDecoder
from lidarcli.logs.carmen.words import LASERS, ODOM, TRUEPOS
from lidarcli.logs.planar import MOUNTS, ODOMETRY
from lidarcli.logs.textlog import TextLog
from lidarcli.sweeps import RawSweeps


class CarmenLog(TextLog):
    """A CARMEN log."""

    format = "carmen"
    _index: Index | None = None

    def topics(self) -> list[Topic] | None:
        """Sweeps and poses by the first words of all lines, which are read for it once; None of a stream."""
        self._index = self._index or self._indexed(Index.of)
        if self._index is None:
            return None
        counts = self._index.lines
        found = [
            Topic(laser.topic, LASERSCAN, self.format, counts[word])
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
            Topic(name, TYPES[name], self.format, count) for name, count in told.items() if count != 0
        ]

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Blocks of sweeps in the order of the file within each topic."""
        decoder = SweepDecoder(self._options, report, topics)
        for block in self._blocks(report):
            yield from decoder.feed(block)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Poses; where sweeps tell those of the robot, lines that tell nothing else are passed over."""
        if not set(types).intersection(TYPES.values()):
            return
        self.topics()
        with_odom = self._index is None or not self._index.posed
        decoder = PoseDecoder(types, report, with_odom)
        for block in self._blocks(report):
            yield from decoder.feed(block)
        yield from decoder.finish()
