"""Damaged and hostile MCAPs: everything readable is read, the rest is named, nothing else happens."""

from __future__ import annotations

import io
import random
import re
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import IndexType

from lidarcli.logs import mcap_records, mcap_walk
from lidarcli.logs.base import ReadReport
from tests.logs import mcap_samples as samples
from tests.logs.mcap_samples import ranges_of, sample
from tests.logs.scan_messages import scan
from tests.logs.watched import McapLog

N = 30


def read(source: Any) -> tuple[list[int], ReadReport]:
    """Numbers of the sweeps that are read, checked to hold what was written."""
    with McapLog(source) as log:
        found: list[int] = []
        for block in log.scans():
            numbers = (block.record_ns // 10).tolist()
            found += numbers
            np.testing.assert_array_equal(block.ranges, np.stack([ranges_of(i) for i in numbers]))
        return found, log.report


def both(data: bytes, tmp_path: Path) -> list[tuple[list[int], ReadReport]]:
    """Read as a file and as a stream."""
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    return [read(path), read(io.BytesIO(data))]


def lines(report: ReadReport) -> list[str]:
    return [f"{damage.place}: {damage.cause}" for damage in report.damage]


def patched(data: bytes, place: int, new: bytes) -> bytes:
    return data[:place] + new + data[place + len(new) :]


def whole_before(data: bytes, cut: int) -> int:
    """Messages on /scan whose record ends before `cut`, by a slow walk (nothing compressed)."""
    count = 0
    for opcode, first, end in samples.records(data):
        if opcode == 6:
            start = first + 9 + 32 + 8
            inner = ((code, start + a, start + b) for code, a, b in samples.records(data[start:end], 0))
        else:
            inner = iter([(opcode, first, end)])
        count += sum(code == 5 and data[a + 9] == 1 and b <= cut for code, a, b in inner)
    return count


def after_chunks() -> list[int]:
    """How many messages on /scan there are up to the end of each chunk of a sample, compressed or not."""
    data = sample(N, compression="none")
    return [whole_before(data, end) for _, end in samples.chunks(data)]


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"index": IndexType.NONE}, {"use_chunking": False}, {"chatter": 2}])
def test_every_whole_message_before_a_cut_is_read(tmp_path: Path, options: dict[str, Any]) -> None:
    data = sample(N, compression="none", **options)
    cuts = sorted({*range(60, len(data), 61), *range(len(data) - 60, len(data))})
    for cut in cuts:
        for found, report in both(data[:cut], tmp_path):
            assert found == list(range(whole_before(data, cut))), cut
            assert report.damage, cut


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_the_whole_blocks_of_a_cut_chunk_are_read(tmp_path: Path, compression: str) -> None:
    noise = np.random.default_rng(1).random((300, 1000), np.float32)
    data = sample(300, compression=compression, chunk_size=1 << 24, payload=lambda i: scan(noise[i].tolist(), sec=i))
    [(first, end)] = samples.chunks(data)
    path = tmp_path / "run.mcap"
    path.write_bytes(data[: first + (end - first) // 2])
    with McapLog(path) as log:
        blocks = list(log.scans())
        ranges = np.concatenate([block.ranges for block in blocks])
        assert 90 < len(ranges) < 160
        np.testing.assert_array_equal(ranges, noise[: len(ranges)])
        [damage] = log.report.damage
    assert damage.cause == (
        f"the log is cut off here, inside the chunk at byte {first}: {len(ranges)} whole messages of it are read"
    )


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_a_flipped_bit_costs_its_chunk_alone(tmp_path: Path, compression: str) -> None:
    data = sample(N, compression=compression)
    rng = random.Random(2)
    places = samples.chunks(data)
    bounds = [0, *after_chunks()]
    for number, (first, end) in enumerate(places):
        place = rng.randrange(first + 60, end - 12)  # not in the end mark of lz4, which costs nothing
        broken = patched(data, place, bytes([data[place] ^ 1 << rng.randrange(8)]))
        lost = set(range(bounds[number], bounds[number + 1]))
        for found, report in both(broken, tmp_path):
            if not number and not found:
                # All that described the channel was in the lost chunk, and a stream has no summary.
                assert "its channel record is missing" in lines(report)[1]
                continue
            assert found == [i for i in range(N) if i not in lost]
            [line] = lines(report)
            assert line.startswith(f"chunk at byte {first}: the chunk cannot be read: ")
            assert line.endswith(f", {len(lost)} messages are lost")


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["none", "zstd"])
@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE])
def test_flipped_bits_in_a_chunk_record_cost_at_most_two_chunks(tmp_path: Path, compression: str, index: IndexType) -> None:
    data = sample(N, compression=compression, index=index)
    first, _ = samples.chunks(data)[3]
    for place in range(first, first + 49):
        for bit in (0, 3, 7):
            broken = patched(data, place, bytes([data[place] ^ 1 << bit]))
            for found, report in both(broken, tmp_path):
                assert found == sorted(set(found))
                assert len(found) >= N - 6
                assert report.damage or len(found) == N


@pytest.mark.parametrize(("place", "flipped"), [(8, 0x40), (4, 0x40), (4, 0x02), (3, 0x10), (3, 0x01), (2, 0x01)])
def test_a_flipped_length_outside_chunks_costs_its_message(tmp_path: Path, place: int, flipped: int) -> None:
    data = sample(N, use_chunking=False)
    messages = [first for opcode, first, _ in samples.records(data) if opcode == 5]
    broken = patched(data, messages[9] + place, bytes([flipped]))
    for found, report in both(broken, tmp_path):
        assert set(found) >= {i for i in range(N) if not 9 <= i <= 12}
        [line] = lines(report)
        assert re.search(r"; reading goes on at byte \d+$", line)


def test_what_a_lost_chunk_described_is_still_known(tmp_path: Path) -> None:
    data = sample(N, compression="none", repeat_channels=False, repeat_schemas=False, use_statistics=False)
    first, end = samples.chunks(data)[0]
    broken = patched(data, end - 1, bytes([data[end - 1] ^ 1]))
    for found, report in both(broken, tmp_path):
        assert found == list(range(whole_before(data, end), N))
        assert lines(report)[0].startswith(f"chunk at byte {first}: the chunk cannot be read: its checksum")


def index_records(data: bytes, channel: int = 1) -> list[int]:
    """Where the message index records of a channel begin."""
    return [
        place
        for opcode, place, _ in samples.records(data)
        if opcode == 7 and struct.unpack_from("<H", data, place + 9)[0] == channel
    ]


@pytest.mark.parametrize("lie", ["offset", "count", "channel", "garbage", "payload"])
def test_a_lying_index_loses_nothing(tmp_path: Path, lie: str) -> None:
    data = sample(N, chatter=3, compression="none")
    for place in index_records(data):
        if lie == "offset":
            data = patched(data, place + 23, struct.pack("<Q", 5))
        elif lie == "count":
            data = patched(data, place + 11, struct.pack("<I", 0))
        elif lie == "channel":
            data = patched(data, place + 9, struct.pack("<H", 2))
        elif lie == "garbage":
            data = patched(data, place + 23, b"\xff" * 8)
        else:
            offset = struct.unpack_from("<Q", data, place + 23)[0]
            data = patched(data, place + 23, struct.pack("<Q", offset + 31))
    for found, report in both(data, tmp_path):
        assert found == list(range(N))
        assert not report.damage


@pytest.mark.slow
def test_a_lying_summary_loses_nothing(tmp_path: Path) -> None:
    data = sample(N, chatter=8, chunk_size=800)
    path = tmp_path / "run.mcap"
    for place in [first for opcode, first, _ in samples.records(data) if opcode == 8][::5]:
        for field in (16, 24):  # where the chunk begins, how long it is
            value = struct.unpack_from("<Q", data, place + 9 + field)[0]
            for lie in (0, value - 3, value + 3, value + 1000, 2**63, 2**64 - 1):
                broken = patched(data, place + 9 + field, struct.pack("<Q", lie % 2**64))
                path.write_bytes(_without_summary_crc(broken))
                found, report = read(path)
                assert found == list(range(N))
                assert not report.damage


def _without_summary_crc(data: bytes) -> bytes:
    return patched(data, len(data) - 12, b"\0\0\0\0")


def test_a_damaged_summary_is_named_and_not_used(tmp_path: Path) -> None:
    data = sample(N)
    start = struct.unpack_from("<Q", data, len(data) - 28)[0]
    path = tmp_path / "run.mcap"
    path.write_bytes(patched(data, start + 20, bytes([data[start + 20] ^ 1])))
    found, report = read(path)
    assert found == list(range(N))
    assert lines(report) == [f"summary at byte {start}: its checksum does not hold; not used"]
    path.write_bytes(patched(data, len(data) - 28, struct.pack("<Q", 2**40)))
    found, report = read(path)
    assert found == list(range(N))
    assert lines(report) == [f"footer at byte {len(data) - 37}: its summary cannot begin at byte {2**40}; not used"]


def test_channels_that_are_described_only_in_the_summary(tmp_path: Path) -> None:
    data = sample(N, compression="none", use_chunking=False)
    parts = [data[:8]]
    ended = False
    for opcode, first, end in samples.records(data):
        ended |= opcode == 15
        if ended or opcode not in (3, 4):
            parts.append(data[first:end])
    short = b"".join(parts) + data[-8:]
    shift = len(data) - len(short)
    start = struct.unpack_from("<Q", data, len(data) - 28)[0] - shift
    short = _without_summary_crc(patched(short, len(short) - 28, struct.pack("<QQ", start, 0)))
    as_file, as_stream = both(short, tmp_path)
    assert as_file[0] == list(range(N))
    assert not as_file[1].damage
    assert as_stream[0] == []
    assert lines(as_stream[1]) == [
        f"channel 1: its channel record is missing: {N} messages are lost; "
        "given as a file instead of a stream, its summary may tell"
    ]


def chunk(content: bytes, *, size: int | None = None, compression: str = "", data: bytes | None = None) -> bytes:
    name = compression.encode()
    data = content if data is None else data
    body = struct.pack("<QQQII", 0, 0, len(content) if size is None else size, 0, len(name)) + name
    body += struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(body)) + body


def with_extra(extra: bytes) -> bytes:
    """A log whose third chunk is preceded by something else."""
    data = sample(N, index=IndexType.NONE, use_statistics=False, repeat_channels=False, repeat_schemas=False)
    place, _ = samples.chunks(data)[2]
    return data[:place] + extra + data[place:-37] + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + data[-8:]


def bomb_zstd(size: int) -> bytes:
    compressor = zstandard.ZstdCompressor().compressobj()
    block = bytes(1 << 20)
    return b"".join(compressor.compress(block) for _ in range(size >> 20)) + compressor.flush()


@pytest.mark.parametrize(
    ("extra", "cause"),
    [
        (chunk(b"x" * 50, size=2**60), "it declares 1152921504606846976 bytes, more than the 1073741824 that are believed"),
        (
            chunk(b"", size=1 << 29, compression="lz4", data=lz4.frame.compress(b"x" * 999)),
            "it declares 536870912 bytes, more than lz4 can make of ",
        ),
        (
            chunk(b"", size=9, compression="lz4", data=lz4.frame.compress(bytes(1 << 24))),
            "it declares 9 bytes and holds 10",
        ),
        (
            chunk(b"", size=9, compression="zstd", data=zstandard.compress(bytes(1 << 24))),
            "it declares 9 bytes and holds 16777216",
        ),
        (chunk(b"", size=9, compression="zstd", data=bomb_zstd(1 << 26)), "zstd: "),
        (chunk(b"", size=9, compression="zstd", data=b"no zstd"), "zstd: "),
        (chunk(b"", size=9, compression="snappy", data=b"x"), "its compression 'snappy' is not one of none, lz4, zstd"),
    ],
)
def test_a_hostile_chunk_is_refused_alone(tmp_path: Path, extra: bytes, cause: str) -> None:
    data = with_extra(extra)
    place = samples.chunks(data)[2][0]
    for found, report in both(data, tmp_path):
        assert found == list(range(N))
        [line] = lines(report)
        assert line.startswith(f"chunk at byte {place}: the chunk cannot be read: {cause}")


@pytest.mark.parametrize(
    ("compression", "pack"),
    [
        ("zstd", zstandard.compress),
        ("zstd", zstandard.ZstdCompressor(write_content_size=False).compress),
        ("lz4", lz4.frame.compress),
    ],
)
def test_a_chunk_of_several_frames_is_read_whole(tmp_path: Path, compression: str, pack: Callable[[bytes], bytes]) -> None:
    plain = {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False}
    data = sample(N, compression="none", index=IndexType.NONE, **plain)
    start, end = samples.chunks(data)[2]
    content = data[start + 9 + 32 + 8 : end]
    packed = b"".join(map(pack, (content[:99], b"", content[99:500], content[500:])))
    changed = data[:start] + chunk(content, compression=compression, data=packed) + data[end:-37]
    for found, report in both(changed + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + data[-8:], tmp_path):
        assert found == list(range(N))
        assert not report.damage
    # Less than the chunk declares is still lost.
    short = data[:start] + chunk(content, compression=compression, data=pack(content[:99])) + data[end:-37]
    for found, report in both(short + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + data[-8:], tmp_path):
        assert len(found) < N
        assert f"it declares {len(content)} bytes and holds 99" in lines(report)[0]


def test_a_bomb_stays_within_its_bound(tmp_path: Path) -> None:
    data = with_extra(chunk(b"", size=1 << 20, compression="zstd", data=bomb_zstd(1 << 30)))
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    tracemalloc.start()
    try:
        assert read(path)[0] == list(range(N))
        assert tracemalloc.get_traced_memory()[1] < 50 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "extra",
    [
        struct.pack("<BQ", 5, 2**60),
        struct.pack("<BQ", 4, 2**60) + b"x" * 40,
        struct.pack("<BQ", 6, 2**60) + b"x" * 90,
        struct.pack("<BQ", 6, 2**64 - 1) + b"x" * 90,
        struct.pack("<BQ", 9, 2**63) + b"x" * 90,
        bytes(1000),
        b"\xff" * 1000,
    ],
)
def test_a_record_that_cannot_be_is_passed(tmp_path: Path, extra: bytes) -> None:
    data = with_extra(extra)
    place = data.index(extra)
    for found, report in both(data, tmp_path):
        assert found == list(range(N))
        [line] = lines(report)
        assert line.startswith(f"byte {place}: ")
        assert line.endswith(f"; reading goes on at byte {place + len(extra)}")


def test_many_tiny_records_do_not_pile_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_records, "MAX_OTHERS", 100)
    tiny = struct.pack("<BQ", 0x33, 0) * 500
    for found, report in both(with_extra(chunk(tiny)), tmp_path):
        assert found == list(range(N))
        assert re.fullmatch(r"chunk at byte \d+: no record at byte 900 of its 4500", lines(report)[0])


def test_long_chunks_are_handed_on_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_records, "PART", 7)
    monkeypatch.setattr(mcap_walk, "PART", 7)
    for options in ({}, {"index": IndexType.NONE}, {"use_chunking": False}):
        for found, report in both(sample(N, chunk_size=1 << 20, **options), tmp_path):
            assert found == list(range(N))
            assert not report.damage


def test_a_log_that_grows_is_read_as_it_was(tmp_path: Path) -> None:
    data = sample(N, index=IndexType.NONE)
    cut = samples.chunks(data)[4][0]
    path = tmp_path / "run.mcap"
    path.write_bytes(data[:cut])
    with McapLog(path) as log:
        path.write_bytes(data)
        assert sum(map(len, log.scans())) == len(read(io.BytesIO(data[:cut]))[0])
        assert lines(log.report) == [f"byte {cut}: the log ends here without an end mark"]
