"""CARMEN logs: `.log`, `.clf`, `.gfs`, also packed with gzip; one message per line."""

from __future__ import annotations

from collections.abc import Collection

from lidarcli.logs.base import LASERSCAN, ReadReport, Topic
from lidarcli.logs.carmen.lines import Index
from lidarcli.logs.carmen.poses import CORRECTED, TRUE, TYPES, PoseDecoder
from lidarcli.logs.carmen.sweeps import SweepDecoder
from lidarcli.logs.carmen.words import LASERS, ODOM, TRUEPOS
from lidarcli.logs.planar import MOUNTS, ODOMETRY
from lidarcli.logs.text import TextLog


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

    def _sweeps(self, topics: Collection[str] | None, report: ReadReport) -> SweepDecoder:
        return SweepDecoder(self._options, report, topics)

    def _poses(self, types: Collection[str], report: ReadReport) -> PoseDecoder:
        """Where sweeps tell the poses of the robot, lines that tell nothing else are passed over."""
        self.topics()
        return PoseDecoder(types, report, with_odom=self._index is None or not self._index.posed)
