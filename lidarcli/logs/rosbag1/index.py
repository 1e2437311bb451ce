"""The index section at the end of a ROS 1 bag: what the bag says it holds. Reading never depends on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import BinaryIO

import numpy as np

from lidarcli.logs.base import ros_type
from lidarcli.logs.rosbag1.feeds import read_at
from lidarcli.logs.rosbag1.records import MAGIC, MAX_HEADER, Op, Record, parse, parse_fields

MAX_INDEX = 256 << 20
"""Longest index section that is read [bytes]."""


class State(Enum):
    """What became of the index."""

    GOOD = "good"
    OPEN = "the bag was not closed properly and has no index"
    CUT = "the bag is cut off before its index"
    BROKEN = "the index is broken"


@dataclass(frozen=True, slots=True)
class Connection:
    """A publisher of a topic."""

    topic: str
    type: str


@dataclass(frozen=True, slots=True)
class Index:
    """Connections of a bag and how many messages of which one each chunk holds."""

    state: State
    encryptor: str = ""
    connections: dict[int, Connection] = field(default_factory=dict)
    chunks: dict[int, bytes] = field(default_factory=dict)
    """Position of each chunk → its (connection, count) pairs of u32."""

    def chunk_counts(self, position: int) -> dict[int, int] | None:
        """Connection → messages of the chunk at a position; None where the index does not know it."""
        pairs = self.chunks.get(position)
        return None if pairs is None else dict(np.frombuffer(pairs, "<u4").reshape(-1, 2).tolist())

    def counts(self) -> dict[int, int]:
        """Connection → messages of the whole bag."""
        pairs = np.frombuffer(b"".join(self.chunks.values()), "<u4").reshape(-1, 2)
        connections, inverse = np.unique(pairs[:, 0], return_inverse=True)
        totals = np.zeros(len(connections), np.int64)
        np.add.at(totals, inverse, pairs[:, 1].astype(np.int64))
        return dict(zip(connections.tolist(), totals.tolist(), strict=True))


def connection_of(record: Record, data: bytes) -> Connection:
    """Topic and type of a connection record; the type is empty where its data is broken."""
    fields = parse_fields(data) or {}
    kind = fields.get(b"type")
    name = data[kind.start : kind.end].decode("utf-8", "replace") if kind else ""
    return Connection(record.value(b"topic").decode("utf-8", "replace"), ros_type(name))


def read_index(file: BinaryIO, size: int) -> Index:
    """Read the bag's header and its index section."""
    bag = parse(read_at(file, len(MAGIC), 8 + MAX_HEADER), 0)
    if bag is None or bag.op != Op.BAG:
        return Index(State.BROKEN)
    encryptor = bag.value(b"encryptor").decode("utf-8", "replace") if b"encryptor" in bag.fields else ""
    position = bag.number(b"index_pos")
    if position == 0:
        return Index(State.OPEN, encryptor)
    if position >= size:
        return Index(State.CUT, encryptor)
    if size - position > MAX_INDEX:
        return Index(State.BROKEN, encryptor)
    data = read_at(file, position, size - position)
    connections: dict[int, Connection] = {}
    chunks: dict[int, bytes] = {}
    at = 0
    while (record := parse(data, at)) is not None and record.end <= len(data):
        body = data[record.data_start : record.end]
        if record.op == Op.CONNECTION:
            connections[record.number(b"conn")] = connection_of(record, body)
        elif record.op == Op.CHUNK_INFO and len(body) == 8 * record.number(b"count"):
            chunks[record.number(b"chunk_pos")] = body
        else:
            break
        at = record.end
    whole = (
        at == len(data)
        and bag.fields.keys() >= {b"conn_count", b"chunk_count"}
        and bag.number(b"conn_count") == len(connections)
        and bag.number(b"chunk_count") == len(chunks)
    )
    if whole:
        return Index(State.GOOD, encryptor, connections, chunks)
    cut = record is not None and record.end > len(data)
    return Index(State.CUT if cut or at == len(data) else State.BROKEN, encryptor, connections)
