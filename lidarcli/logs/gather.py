"""Gather messages that lie scattered in a log into blocks that are worth decoding by column."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import MULTI_ECHO, OpenOptions, ReadReport
from lidarcli.logs.laserscan import decode_blocks
from lidarcli.sweeps import Int64, RawSweeps, UInt8

ROWS = 512
BYTES = 4 << 20
"""A topic's messages are decoded when this many, or this many bytes, have come together."""


@dataclass(slots=True)
class Gather:
    """The scattered messages of one LaserScan topic, in log order, until there are enough of them."""

    topic: str
    type: str
    encoding: str
    report: ReadReport
    echo: str = OpenOptions().echo
    """Which one to take of each beam of a MultiEchoLaserScan."""
    rows: int = ROWS
    parts: list[bytes] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    size: int = 0

    def add(self, message: bytes, record_ns: int) -> bool:
        """Take one message; True when the block is full and wants `flush`."""
        self.parts.append(message)
        self.times.append(record_ns)
        self.size += len(message)
        return len(self.parts) >= self.rows or self.size >= BYTES

    def extend(self, messages: Sequence[bytes], record_ns: Sequence[int]) -> bool:
        """Take some messages; True when the block is full and wants `flush`."""
        self.parts.extend(messages)
        self.times.extend(record_ns)
        self.size += sum(map(len, messages))
        return len(self.parts) >= self.rows or self.size >= BYTES

    def decode(self, buffer: UInt8, offsets: Int64, lengths: Int64, record_ns: Int64) -> Iterator[RawSweeps]:
        """Decode messages that lie together already, after those that were gathered before."""
        yield from self.flush()
        yield from decode_blocks(
            self.topic,
            buffer,
            offsets,
            lengths,
            record_ns,
            self.encoding,
            self.report,
            self.echo if self.type == MULTI_ECHO else None,
        )

    def flush(self) -> Iterator[RawSweeps]:
        """Decode what has been gathered."""
        parts, times = self.parts, self.times
        if not parts:
            return
        self.parts, self.times, self.size = [], [], 0
        lengths = np.array(list(map(len, parts)), np.int64)
        buffer = np.frombuffer(b"".join(parts), np.uint8)
        yield from self.decode(buffer, np.cumsum(lengths) - lengths, lengths, np.array(times, np.int64))
