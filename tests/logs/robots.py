"""What the tests of robots' text logs share: a log from a text, its one block, and where a sensor was by it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from lidarcli.logs import open_log
from lidarcli.logs.base import OpenOptions
from lidarcli.pipeline.reading.posing import PoseOptions, find_poses
from lidarcli.pose.tracks import planar
from lidarcli.sweeps import RawSweeps, concatenate
from tests.logs.watched import AriaLog, PlayerLog

Reader = TypeVar("Reader", AriaLog, PlayerLog)


class Opener(Generic[Reader]):
    """Opens texts as logs, and closes them in the end."""

    def __init__(self, reader: Callable[[Path, OpenOptions | None], Reader]) -> None:
        self._reader = reader
        self._opened: list[Reader] = []

    def __call__(
        self, folder: Path, text: str | bytes, name: str = "run.log", options: OpenOptions | None = None
    ) -> Reader:
        path = folder / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        self._opened.append(self._reader(path, options))
        return self._opened[-1]

    def close(self) -> None:
        """Close all that is open."""
        while self._opened:
            self._opened.pop().close()


def only(log: AriaLog | PlayerLog) -> RawSweeps:
    """All sweeps of a log with one topic, and nothing that was lost."""
    block = concatenate(list(log.scans()))
    assert (log.report.damage, log.report.refused) == ([], {})
    return block


def pose_of(path: Path, frame: str, at: float, source: str | None = None) -> list[float]:
    """x, y and yaw of a sensor frame at a time."""
    with open_log(path) as log:
        found = find_poses(log, PoseOptions(source=source))
        assert found is not None
        way = found.sources.chain(frame)
        assert way is not None
        here = planar(way.at(np.array([round(at * 1e9)])))
    return [float(here.x[0]), float(here.y[0]), float(here.yaw[0])]
