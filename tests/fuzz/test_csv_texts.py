"""A seeded mutator: whatever is done to a CSV, reading it raises nothing but errors of our own, and quickly."""

from __future__ import annotations

import gzip
import io
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from lidarcli.errors import LidarcliError
from lidarcli.logs.base import OpenOptions
from lidarcli.sweeps.range_rules import RangeRules, normalise
from tests.logs.watched import CsvLog
from tests.sweeping import STEP, raw_sweeps
from tests.text_logs import LAYOUTS, write_csv

CASES = 240
WORDS = (b"nan", b"inf", b"-", b"", b"null", b"1e999", b"-1e400", b"9" * 400, b"0x1", b'"', b"'", b"[", b"]", b"(", b")")
WORDS += (b",", b";", b"\t", b" ", b"\n", b"\r", b"\0", b"#", b"%time", b"\xff\xfe", b"\xef\xbb\xbf", b"ranges0", b"...")
WORDS += (b"2024-02-31 25:61:61", b"1714555596445048407", b"-9223372036854775809", b"e", b".", b"\xe2\x82\xac", b"\x01")


def sample(layout: str, tmp_path: Path) -> bytes:
    """A small log of the layout."""
    random = np.random.default_rng(5)
    raw = raw_sweeps(
        random.uniform(0, 9, (9, 17)),
        frame_ids=("laser", "base, link"),
        frame=np.arange(9) % 2,
        stamp_ns=np.arange(9) * STEP,
        record_ns=np.arange(9) * STEP + 7,
        angle_min=-1.0,
        angle_increment=0.125,
        range_max=8.0,
    )
    path = tmp_path / layout
    write_csv(path, [raw], layout)
    return b"".join(file.read_bytes() for file in ([path] if path.is_file() else sorted(path.iterdir())))


def mutate(data: bytes, random: np.random.Generator) -> bytes:
    """One to eight changes: bytes, words, cells, lines, cuts, wrappings."""
    for _ in range(random.integers(1, 9)):
        at, size = sorted(random.integers(0, len(data) + 1, 2).tolist())
        kind = random.integers(0, 9)
        word = WORDS[random.integers(0, len(WORDS))]
        lines = data.split(b"\n")
        pick = int(random.integers(0, len(lines)))
        if kind == 0:
            data = data[:at] + bytes([random.integers(0, 256)]) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + word + data[at:]
        elif kind == 2:
            data = data[:size]
        elif kind == 3:
            data = data[:at] + data[size:]
        elif kind == 4:
            cells = lines[pick].split(b",")
            cells[random.integers(0, len(cells))] = word
            lines[pick] = b",".join(cells)
            data = b"\n".join(lines)
        elif kind == 5:
            lines.insert(pick, lines[random.integers(0, len(lines))] * int(random.integers(1, 3)))
            data = b"\n".join(lines)
        elif kind == 6:
            data = data.replace(WORDS[random.integers(0, len(WORDS))] or b"1", word)
        elif kind == 7:
            data = data.replace(b",", word, int(random.integers(1, 400)))
        elif len(lines) > 2:
            data = b"\n".join(lines[pick:])
    wrapping = random.integers(0, 12)
    if wrapping == 0:
        data = gzip.compress(data, mtime=0)[: int(random.integers(1, 400))]
    elif wrapping == 1:
        data = data.decode("utf-8", "replace").encode("utf-16")[: int(random.integers(1, 4000))]
    return data


def check(data: bytes, columns: tuple[str, ...] = ()) -> None:
    """Read it all; what is read must also pass the border between logs and everything else."""
    with suppress(LidarcliError), CsvLog(io.BytesIO(data), OpenOptions(fov=3.0, columns=columns)) as log:
        log.topics()
        for block in log.scans():
            assert len(block) > 0
            assert block.ranges.dtype == np.float32
            assert len(block.ranges) == len(block)
            assert block.ranges.shape[1] >= block.beams.max()
            normalise(block, np.arange(len(block)), RangeRules())


@pytest.mark.parametrize("layout", LAYOUTS)
def test_mutated_logs(layout: str, tmp_path: Path) -> None:
    data = sample(layout, tmp_path)
    random = np.random.default_rng(sum(layout.encode()))
    for _ in range(CASES // len(LAYOUTS) + 1):
        check(mutate(data, random), ("seq", "time", "ranges") if layout == "drow" else ())
