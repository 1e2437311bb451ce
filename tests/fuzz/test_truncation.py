"""Every container cut at many places: what is read is the beginning of the whole log, and all that is before the cut."""

from __future__ import annotations

import io
import re
import sqlite3
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.rosbag1 import Reader

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline.inputs.sources import Source, open_source
from tools.fuzz.containers import BEAMS, CONTAINERS, SWEEPS, Sample, sample_of
from tools.fuzz.logs import TOLD

pytestmark = pytest.mark.slow

CUTS = 45
WORDS = {b"FLASER": "/front_laser", b"RAWLASER1": "/raw_laser1", b"REMISSIONFLASER": "/front_laser_remission"}
"""Word of a line of a text log that is a sweep → its topic."""
TEXT_LOGS = {"carmen": b"FLASER", "carmen-raw": b"RAWLASER1", "carmen-gz": b"FLASER"}
TEXT_LOGS |= {"carmen-raw-lit": b"RAWLASER1", "carmen-remission": b"REMISSIONFLASER"}
"""Container → the word of its sweeps."""
TEXTS = ("csv", "carmen", "rplidar", "jsonl")
"""How the names of containers begin in which a cut between two lines cannot be seen."""

Sweep = tuple[int, str, bytes, bytes]
"""Stamp, frame, ranges and intensities."""
Ends = list[tuple[int, str]]
"""Where messages end that stand in the file as they are, and their topic."""


def read(path: Path) -> tuple[dict[str, list[Sweep]], ReadReport]:
    """The sweeps of each topic in the order of the log."""
    sweeps: dict[str, list[Sweep]] = {}
    report = ReadReport()
    with open_source(Source(str(path), "run"), TOLD) as log:
        for block in log.scans(None, report):
            unknown = np.full(block.ranges.shape, np.nan, np.float32)
            intensities = unknown if block.intensities is None else block.intensities
            for row, beams in enumerate(block.beams.tolist()):
                sweeps.setdefault(block.topic, []).append(
                    (
                        int(block.stamp_ns[row]),
                        block.frame_ids[block.frame[row]],
                        block.ranges[row, :beams].tobytes(),
                        intensities[row, :beams].tobytes(),
                    )
                )
        return sweeps, report


def mcap_ends(data: bytes) -> Ends:
    """Messages by a library: outside of compression each by its own last byte, otherwise by that of its chunk."""
    ends: Ends = []
    topics: dict[int, str] = {}
    stream = io.BytesIO(data)
    for record in StreamReader(stream, emit_chunks=True).records:
        inside = breakup_chunk(record) if isinstance(record, Chunk) else [record]
        for part in inside:
            if isinstance(part, Channel):
                topics[part.id] = part.topic
            elif isinstance(part, Message):
                at = data.find(part.data) if isinstance(record, Chunk) and not record.compression else -1
                ends.append((stream.tell() if at < 0 else at + len(part.data), topics[part.channel_id]))
    return ends


def bag_ends(data: bytes, folder: Path) -> Ends:
    (folder / "whole.bag").write_bytes(data)
    with Reader(folder / "whole.bag") as reader:
        messages = [(topic.topic, raw) for topic, _, raw in reader.messages()]
    return [(data.find(raw) + len(raw), topic) for topic, raw in messages if raw in data]


def sqlite_ends(data: bytes, folder: Path) -> Ends:
    """A page counts as a whole: its cells begin at its end."""
    (folder / "whole.db3").write_bytes(data)
    database = sqlite3.connect(folder / "whole.db3")
    rows = database.execute("SELECT m.data, t.name FROM messages m JOIN topics t ON m.topic_id = t.id").fetchall()
    database.close()
    return [(-(-(data.find(blob) + len(blob)) // 4096) * 4096, topic) for blob, topic in rows]


def csv_ends(text: bytes) -> Ends:
    """The last sweep of the long form is whole only with the next one's first line."""
    lines = [match.end() for match in re.finditer(b"\n", text)]
    heads = len(lines) - (SWEEPS * 24 if len(lines) > 100 else SWEEPS)
    rows = lines[heads:]
    return [(end, "/scan") for end in (rows[23::24] if len(rows) > SWEEPS else rows)]


def line_ends(text: bytes) -> Ends:
    """A line of a sweep is whole with its line end."""
    lines = re.finditer(rb"(?m)^((?:REMISSION)?FLASER|RAWLASER1) .*\n", text)
    return [(match.end(), WORDS[match[1]]) for match in lines]


def rplidar_ends(text: bytes) -> Ends:
    """A sweep is whole with the line of its last beam."""
    lines = [match.end() for match in re.finditer(b"\n", text)]
    return [(end, "/scan") for end in lines[BEAMS - 1 :: BEAMS]]


def jsonl_ends(text: bytes) -> Ends:
    """A message is whole with its line end."""
    return [(match.end(), match[1].decode()) for match in re.finditer(rb'(?m)^\{"topic":"([^"]*)".*\n', text)]


def text_ends(container: str, text: bytes) -> Ends:
    """Where the sweeps of a text end."""
    kinds = {"rplidar": rplidar_ends, "jsonl": jsonl_ends}
    if container in TEXT_LOGS:
        return line_ends(text)
    return kinds.get(container.partition("-")[0], csv_ends)(text)


def ends_of(container: str, sample: Sample, folder: Path) -> tuple[str, Callable[[int], int], Ends]:
    """The file to cut, from a cut to the bytes that are there before it, and where messages end in these."""
    name = next(name for name in sorted(sample.files, reverse=True) if not name.endswith(".yaml"))
    data = sample.files[name]
    if name.endswith(".mcap"):
        return name, int, mcap_ends(data)
    if name.endswith(".bag"):
        return name, int, bag_ends(data, folder)
    if name.endswith(".db3"):
        return name, int, sqlite_ends(data, folder)
    if name.endswith(".db3.zstd"):
        return name, lambda cut: 0, []
    if name.endswith(".gz"):
        text = zlib.decompressobj(wbits=31).decompress(data)
        ends = text_ends(container, text)
        return name, lambda cut: len(zlib.decompressobj(wbits=31).decompress(data[:cut])), ends
    if container == "csv-per-sweep":
        return name, int, [(0, "/scan")] * (SWEEPS - 1)
    return name, int, text_ends(container, data)


def cuts(container: str, size: int) -> list[int]:
    """Not within the first row of a CSV, which may have no other row to be compared with."""
    random = np.random.default_rng(CONTAINERS.index(container))
    first = 700 if container.startswith("csv") and container not in ("csv-per-sweep", "csv-gz") else 20
    return sorted({*random.integers(first, size, CUTS).tolist(), size - 1, size - 9})


def first_topic(container: str) -> str:
    return WORDS[TEXT_LOGS[container]] if container in TEXT_LOGS else "/scan"


@pytest.mark.parametrize("container", CONTAINERS)
def test_what_is_recovered_is_the_beginning_of_the_log(container: str, tmp_path: Path) -> None:
    sample = sample_of(container)
    for name, data in sample.files.items():
        (tmp_path / "log" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "log" / name).write_bytes(data)
    path = tmp_path / "log" / sample.log
    whole, report = read(path)
    assert {topic: len(found) for topic, found in whole.items()}[first_topic(container)] == SWEEPS
    assert (report.damage, report.refused) == ([], {})

    name, before, ends = ends_of(container, sample, tmp_path)
    data = sample.files[name]
    most = 0
    for cut in cuts(container, len(data)):
        (tmp_path / "log" / name).write_bytes(data[:cut])
        least = Counter(topic for end, topic in ends if end <= before(cut))
        found: dict[str, list[Sweep]] = {}
        try:
            found, report = read(path)
        except UnreadableError:
            assert not any(least[topic] for topic in whole), cut
        else:
            lost = sum(map(len, whole.values())) - sum(map(len, found.values()))
            assert report.damage or not lost or container.startswith(TEXTS), cut
        for topic, sweeps in whole.items():
            got = found.get(topic, [])
            assert least[topic] <= len(got), (cut, topic)
            # A cut within the last number of a text cannot be seen; a page is written from its end.
            # The beams of a turn that is cut are a sweep.
            sure = len(got) - (container.startswith(("csv", "rplidar")) and len(got) > least[topic])
            sure = least[topic] if name.endswith(".db3") else sure
            assert got[:sure] == sweeps[:sure], (cut, topic)
            if name.endswith(".db3"):
                assert got == [sweep for sweep in sweeps if sweep in got], (cut, topic)
        most = max(most, sum(map(len, found.values())))
    assert most > SWEEPS / 2 or container == "ros2-zstd"
