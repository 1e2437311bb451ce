"""The readers, each with the report of the last pass over it at hand."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from lidarcli.logs import carmen, csv, mcap, rosbag1, rosbag2
from lidarcli.logs.base import Message, ReadReport
from lidarcli.sweeps.types import RawSweeps


class _Watched:
    """Passes whose report is `report`, unless the caller brings one."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.report = ReadReport()

    def scans(self, topics: Collection[str] | None = None, report: ReadReport | None = None) -> Iterator[RawSweeps]:
        self.report = report or ReadReport()
        found: Iterator[RawSweeps] = super().scans(topics, self.report)  # type: ignore[misc]
        return found

    def messages(self, types: Collection[str], report: ReadReport | None = None) -> Iterator[Message]:
        self.report = report or ReadReport()
        found: Iterator[Message] = super().messages(types, self.report)  # type: ignore[misc]
        return found


class McapLog(_Watched, mcap.McapLog):
    """An MCAP."""


class Rosbag1Log(_Watched, rosbag1.Rosbag1Log):
    """A ROS 1 bag."""


class Rosbag2Log(_Watched, rosbag2.Rosbag2Log):
    """A ROS 2 bag."""


class CsvLog(_Watched, csv.CsvLog):
    """A CSV."""


class CarmenLog(_Watched, carmen.CarmenLog):
    """A CARMEN log."""
