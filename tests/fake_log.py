"""A log in memory."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from lidarcli.logs.base import Message, ReadReport, Topic
from lidarcli.sweeps.types import RawSweeps


class FakeLog:
    """A log that holds the given blocks and messages."""

    path = "run.fake"
    format = "fake"
    compression = "none"

    def __init__(
        self,
        blocks: Sequence[RawSweeps] = (),
        topics: list[Topic] | None = None,
        messages: Sequence[Message] = (),
        *,
        damage: str | None = None,
        size: int | None = 1234,
    ) -> None:
        self.size = size
        self.position = 0
        self.met = ReadReport()
        """What a pass over the sweeps meets."""
        self.asked: Any = "nothing"
        """The topics that the last reader of sweeps named."""
        self.passes = 0
        """How often the messages have been read."""
        self._blocks = blocks
        self._topics = topics
        self._messages = messages
        if damage:
            self.met.add_damage("byte 99", damage)

    def topics(self) -> list[Topic] | None:
        return self._topics

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        self.asked = topics
        report.add(self.met)
        return self._scans(topics)

    def _scans(self, topics: Collection[str] | None) -> Iterator[RawSweeps]:
        for block in self._blocks:
            self.position += 100
            if topics is None or block.topic in topics:
                yield block

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        self.passes += 1
        return iter([message for message in self._messages if message.type in types])

    def close(self) -> None: ...

    def __enter__(self) -> FakeLog:
        return self

    def __exit__(self, *exc: object) -> None: ...
