"""Copies of ROS 1 bags: connections stay as they are; chunks and index are made anew."""

from __future__ import annotations

import bz2
import struct
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import BinaryIO

from lidarcli.copying.copies import Copy
from lidarcli.logs.base import MULTI_ECHO
from lidarcli.logs.laserscan import locate
from lidarcli.logs.rosbag1 import MAGIC, Op, Rosbag1Log
from lidarcli.ros.messages import lz4_frame

CHUNK = 768 << 10
"""Bytes of a chunk before it is packed."""
HEAD = 4096
"""Bytes of the record at the begin, with its padding."""

_PACK: dict[str, Callable[[bytes], bytes]] = {"none": bytes, "bz2": bz2.compress, "lz4": lz4_frame}
_SECOND_NS = 1_000_000_000


def copy_bag(log: Rosbag1Log, out: BinaryIO, copy: Copy) -> None:
    """Write a bag once more; messages whose connection nothing tells are damage, and left out."""
    reading = log.raw_records(copy.report)
    bag = _Bag(out)
    for block in reading.blocks():
        # Chunks are packed as the first one is.
        bag.codec = next((codec for codec in reading.codecs if codec in _PACK), "none")
        for row, number in enumerate(block.connection.tolist()):
            connection = reading.connections.get(number)
            if number < 0 or connection is None or not connection.record:
                continue
            start, length = int(block.starts[row]), int(block.lengths[row])
            data = block.data[start : start + length].tobytes()
            if connection.read_as:
                where = partial(locate, encoding="ros1", several=connection.read_as == MULTI_ECHO)
                data = copy.edit(connection.topic, data, where)
            bag.message(number, connection.record, int(block.time_ns[row]), data)
            copy.messages[connection.topic, connection.type] += 1
    for number, connection in sorted(reading.connections.items()):
        bag.connection(number, connection.record)
    bag.finish()


def _record(data: bytes, **fields: bytes) -> bytes:
    """Return a record with its header."""
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    header = b"".join(len(part).to_bytes(4, "little") + part for part in parts)
    return b"".join(len(part).to_bytes(4, "little") + part for part in (header, data))


def _op(op: Op) -> bytes:
    return bytes([op])


def _u32(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}I", *values)


def _time(time_ns: int) -> bytes:
    return _u32(*divmod(time_ns, _SECOND_NS))


class _Bag:
    """A bag that is written: the library's own writer numbers connections anew, and writes headers of its own."""

    def __init__(self, out: BinaryIO) -> None:
        self.codec = "none"
        self._out = out
        self._connections: dict[int, bytes] = {}
        self._chunk: list[bytes] = []
        self._size = 0
        self._entries: dict[int, list[tuple[int, int]]] = {}
        self._infos: list[bytes] = []
        out.write(MAGIC + bytes(HEAD))
        self._at = len(MAGIC) + HEAD

    def message(self, number: int, connection: bytes, time_ns: int, data: bytes) -> None:
        """Write a message, behind its connection."""
        self.connection(number, connection)
        self._entries.setdefault(number, []).append((time_ns, self._size))
        self._put(_record(data, conn=_u32(number), op=_op(Op.MESSAGE), time=_time(time_ns)))
        if self._size >= CHUNK:
            self._flush()

    def connection(self, number: int, record: bytes) -> None:
        """Write a connection, once."""
        if record and number not in self._connections:
            self._connections[number] = record
            self._put(record)

    def finish(self) -> None:
        """Write the index, and the record at the begin that tells where it is."""
        self._flush()
        index = self._at
        self._out.write(b"".join(self._connections.values()) + b"".join(self._infos))
        told = {
            "chunk_count": _u32(len(self._infos)),
            "conn_count": _u32(len(self._connections)),
            "index_pos": struct.pack("<Q", index),
            "op": _op(Op.BAG),
        }
        padding = b" " * (HEAD - len(_record(b"", **told)))
        self._out.seek(len(MAGIC))
        self._out.write(_record(padding, **told))

    def _put(self, record: bytes) -> None:
        self._chunk.append(record)
        self._size += len(record)

    def _flush(self) -> None:
        if not self._size:
            return
        plain = b"".join(self._chunk)
        entries, start = self._entries, self._at
        self._chunk, self._size, self._entries = [], 0, {}
        whole = _record(_PACK[self.codec](plain), compression=self.codec.encode(), op=_op(Op.CHUNK), size=_u32(len(plain)))
        indexes = [
            _record(
                b"".join(_time(time_ns) + _u32(offset) for time_ns, offset in mine),
                conn=_u32(number),
                count=_u32(len(mine)),
                op=_op(Op.INDEX),
                ver=_u32(1),
            )
            for number, mine in entries.items()
        ]
        data = b"".join([whole, *indexes])
        self._out.write(data)
        self._at += len(data)
        times = [time_ns for mine in entries.values() for time_ns, _ in mine] or [0]
        counts = Counter({number: len(mine) for number, mine in entries.items()})
        self._infos.append(
            _record(
                b"".join(_u32(*pair) for pair in counts.items()),
                chunk_pos=struct.pack("<Q", start),
                count=_u32(len(counts)),
                end_time=_time(max(times)),
                op=_op(Op.CHUNK_INFO),
                start_time=_time(min(times)),
                ver=_u32(1),
            )
        )
