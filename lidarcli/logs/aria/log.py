"""ARIA logs: `.2d`, also packed with gzip; a tag and its data on each line."""

from __future__ import annotations

from collections.abc import Collection

from lidarcli.logs.aria.lines import Index
from lidarcli.logs.aria.poses import TOPICS, PoseDecoder
from lidarcli.logs.aria.sweeps import SweepDecoder
from lidarcli.logs.base import LASERSCAN, ReadReport, Topic
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS
from lidarcli.logs.text import TextLog


class AriaLog(TextLog):
    """An ARIA log."""

    format = "aria"
    _index: Index | None = None

    def topics(self) -> list[Topic] | None:
        """Sweeps and poses by the tags of all lines, which are read for it once; None of a stream."""
        self._index = self._index or self._indexed(Index.of)
        if self._index is None:
            return None
        found = [Topic(sensor.topic, LASERSCAN, self.format, n) for sensor, n in self._index.sweeps.items()]
        for word, lines in self._index.poses.items():
            topic, kind, _ = TOPICS[word]
            found.append(Topic(topic, kind, self.format, lines))
        if mounts := len({sensor.frame for sensor in self._index.sweeps} & self._index.mounted):
            found.append(Topic(MOUNTS, MOUNT_TYPE, self.format, mounts))
        return found

    def _sweeps(self, topics: Collection[str] | None, report: ReadReport) -> SweepDecoder:
        return SweepDecoder(self._options, report, topics)

    def _poses(self, types: Collection[str], report: ReadReport) -> PoseDecoder:
        return PoseDecoder(types, report)
