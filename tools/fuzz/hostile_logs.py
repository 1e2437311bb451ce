"""MCAP and CSV files whose size says nothing of the work or the memory they ask for."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import zstandard
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from tools.fuzz.libraries import ROS2, SCAN, scan_cdr, stamp_of
from tools.fuzz.logs import judge_log
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target

_GIBIBYTE = 1 << 30
_FOOTER = struct.pack("<BQQQI", 2, 20, 0, 0, 0)
_MAGIC = b"\x89MCAP0\r\n"


def _mcap(
    fill: Callable[[McapWriter, int], Any],
    schema: tuple[str, bytes] = ("ros2msg", b""),
    compression: CompressionType = CompressionType.NONE,
) -> bytes:
    """A file with the topic /scan and one sweep, and what `fill` adds to it."""
    file = io.BytesIO()
    writer = McapWriter(file, compression=compression, use_statistics=False)
    writer.start(profile="ros2", library="hostile")
    kind, text = schema
    definition = text or ROS2.generate_msgdef(SCAN, ros_version=2)[0].encode()
    number = writer.register_schema(SCAN, kind, definition)
    channel = writer.register_channel("/scan", "cdr", number)
    writer.add_message(channel, stamp_of(0), scan_cdr(0), stamp_of(0))
    fill(writer, channel)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def _nothing(writer: McapWriter, channel: int) -> None:
    """Add nothing."""


def _idl(text: bytes) -> Callable[[], bytes]:
    return lambda: _mcap(_nothing, ("ros2idl", text))


def _msg(text: bytes) -> Callable[[], bytes]:
    return lambda: _mcap(_nothing, ("ros2msg", text))


def _chunk(size: int, packed: bytes) -> bytes:
    content = struct.pack("<QQQII", 0, 2**62, size, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(content)) + content


def _packed(*parts: tuple[bytes, int]) -> bytes:
    """Parts so many times one after the other, by zstd, without holding them."""
    packer = zstandard.ZstdCompressor(level=3).compressobj(size=sum(len(part) * many for part, many in parts))
    out = []
    for part, many in parts:
        for _ in range(many):
            out.append(packer.compress(part))
    return b"".join([*out, packer.flush()])


def _zeros(gibibytes: int, chunks: int) -> Callable[[], bytes]:
    """Chunks of zeros: every byte of them is the beginning of a record that means nothing."""

    def make() -> bytes:
        packed = _packed((bytes(1 << 20), gibibytes << 10))
        return _before_end(_chunk(gibibytes * _GIBIBYTE, packed) * chunks)

    return make


def _empty_messages() -> bytes:
    """A chunk of millions of messages without a byte."""
    block = struct.pack("<BQHIQQ", 5, 22, 1, 0, stamp_of(1), stamp_of(1)) * 10_000
    many = 1700
    return _before_end(_chunk(len(block) * many, _packed((block, many))))


def _before_end(records: bytes) -> bytes:
    """Records before the summary of a sound file."""
    plain = _mcap(_nothing)
    end = plain.index(struct.pack("<BQI", 15, 4, 0)[:9])
    return plain[:end] + records + struct.pack("<BQI", 15, 4, 0) + _FOOTER + _MAGIC


def _many_topics(topics: int) -> Callable[[], bytes]:
    def fill(writer: McapWriter, channel: int) -> None:
        for number in range(topics):
            other = writer.register_channel(f"/scan_{number}", "cdr", 1)
            for turn in range(2):
                writer.add_message(other, stamp_of(turn), scan_cdr(turn, 2), stamp_of(turn))

    return lambda: _mcap(fill, compression=CompressionType.ZSTD)


def _many_beams(sweeps: int, beams: int) -> Callable[[], bytes]:
    def fill(writer: McapWriter, channel: int) -> None:
        for number in range(sweeps):
            writer.add_message(channel, stamp_of(number), _flat_scan(beams), stamp_of(number))

    return lambda: _mcap(fill, compression=CompressionType.ZSTD)


@cache
def _flat_scan(beams: int) -> bytes:
    """A sweep whose beams all have the same range."""
    data = bytearray(scan_cdr(0, 2))
    # The ranges are behind their count, the last but one array; the intensities are empty.
    head = data[: -4 - 8 - 4]
    return bytes(head + struct.pack("<I", beams) + np.ones(beams, "<f4").tobytes() + struct.pack("<I", 0))


def _plotjuggler(topics: int) -> Callable[[], bytes]:
    def make() -> bytes:
        names = [f"/scan_{number}/ranges[{beam}]" for number in range(topics) for beam in range(4)]
        rows = [",".join([str(1_700_000_000 + row / 10), *["1.5"] * len(names)]) for row in range(3)]
        return "\n".join([",".join(["__time", *names]), *rows, ""]).encode()

    return make


def _columns(many: int) -> Callable[[], bytes]:
    return lambda: (",".join(["time", *[f"range_{n}" for n in range(many)]]) + "\n" + "1," * many + "1\n").encode()


KNOWN: dict[str, tuple[str, Callable[[], bytes]]] = {
    "idl structs": ("run.mcap", _idl(b"struct LaserScan {" * 30_000)),
    "idl quotes": ("run.mcap", _idl(b'"' + b'\\"' * 60_000)),
    "idl comments": ("run.mcap", _idl(b"/*" * 100_000)),
    "idl modules": ("run.mcap", _idl(b"module a {" * 50_000)),
    "idl slashes": ("run.mcap", _idl(b"//" * 100_000 + b"struct LaserScan")),
    "msg lines": ("run.mcap", _msg(b"=" * 200_000 + b"\nMSG: a/b\n" + b"float32 a\n" * 20_000)),
    "msg spaces": ("run.mcap", _msg(b"float32" + b" " * 300_000 + b"a")),
    "plotjuggler 250": ("run.csv", _plotjuggler(250)),
    "plotjuggler 1000": ("run.csv", _plotjuggler(1000)),
    "columns": ("run.csv", _columns(60_000)),
    "topics 1000": ("run.mcap", _many_topics(1000)),
    "topics 4000": ("run.mcap", _many_topics(4000)),
    "one chunk of zeros": ("run.mcap", _zeros(1, 1)),
    "three chunks of zeros": ("run.mcap", _zeros(1, 3)),
    "empty messages": ("run.mcap", _empty_messages),
    "beams": ("run.mcap", _many_beams(100, 1_000_000)),
}
_CHEAP = 10
"""The first so many of `KNOWN` are small enough to be mutated."""


@cache
def _bytes(name: str) -> bytes:
    return KNOWN[name][1]()


def write(place: Place, number: int, random: Random) -> None:
    """Each known one as it is, then the cheaper ones with bytes changed."""
    names = list(KNOWN)
    drawn = number >= len(names)
    name = names[int(random.integers(_CHEAP))] if drawn else names[number]
    data = mutate(_bytes(name), random) if drawn else _bytes(name)
    (place.input / KNOWN[name][0]).write_bytes(data)
    place.note(log=KNOWN[name][0], kind=name)


def judge(place: Place) -> list[str]:
    """As any other log."""
    given = place.noted()
    return [f"{given['kind']}: {problem}" for problem in judge_log(place, place.input / given["log"])]


def hostile_log_targets() -> list[Target]:
    """Work and memory."""
    return [Target("logs-crafted", write, judge, weight=1, known=len(KNOWN))]
