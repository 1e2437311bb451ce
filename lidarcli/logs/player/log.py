"""Player logs, as the writelog driver of Player/Stage writes them, also packed with gzip; one message per line."""

from __future__ import annotations

from collections.abc import Collection

from lidarcli.logs.base import LASERSCAN, ReadReport, Topic
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, ODOMETRY_TYPE, POSE_TYPE
from lidarcli.logs.player.lines import Index
from lidarcli.logs.player.poses import PoseDecoder, path_topic
from lidarcli.logs.player.sweeps import SweepDecoder
from lidarcli.logs.text import TextLog


class PlayerLog(TextLog):
    """A Player log."""

    format = "player"
    _index: Index | None = None

    def topics(self) -> list[Topic] | None:
        """Sweeps and poses by the beginnings of all lines, which are read for it once; None of a stream."""
        self._index = self._index or self._indexed(Index.of)
        if self._index is None:
            return None
        names, counts = self._index.names, dict[tuple[str, str], int]()
        sensors, mounted = set[str](), set[str]()
        for device, lines in self._index.lines.items():
            told = []
            if device.scan is not None:
                told.append((names.topic(device), LASERSCAN))
                sensors.add(names.frame(device))
            if device.odometry is not None:
                told.append((names.topic(device), ODOMETRY_TYPE))
            if (path := path_topic(names, device)) is not None:
                told.append((path, POSE_TYPE))
            if device.mount is not None:
                mounted.add(names.frame(device))
            for topic in told:
                counts[topic] = counts.get(topic, 0) + lines
        if mounts := len(sensors & mounted):
            counts[MOUNTS, MOUNT_TYPE] = mounts
        return [Topic(*topic, self.format, lines) for topic, lines in counts.items()]

    def _sweeps(self, topics: Collection[str] | None, report: ReadReport) -> SweepDecoder:
        return SweepDecoder(self._options, report, topics)

    def _poses(self, types: Collection[str], report: ReadReport) -> PoseDecoder:
        return PoseDecoder(types, report)
