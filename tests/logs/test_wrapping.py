"""Logs of text: line ends, encodings, packing, blanks and separators change nothing of what is read."""

from __future__ import annotations

import gzip
import io
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.csv import CsvLog
from lidarcli.logs.csv.beam_rows import LISTED, SAVED
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.logs.csv_sweeps import sweeps
from tests.logs.test_carmen import HEADER
from tests.logs.test_carmen import LINES as CARMEN
from tests.logs.test_csv import opening
from tests.logs.test_jsonlines import laser, line
from tests.logs.test_rplidar import SPELLINGS, TURNS
from tests.text_logs import LAYOUTS, write_csv

Wrap = Callable[[bytes], bytes]
LAYOUTS_OF_ROWS = [layout for layout in LAYOUTS if layout != "per-sweep"]
TEXTS = ("carmen", "json lines", *SPELLINGS, *LAYOUTS_OF_ROWS)
BLANKS: dict[str, Wrap] = {
    "tabs": lambda text: text.replace(b" ", b"\t").replace(b"\nFLASER\t", b"\n  FLASER \t "),
    "blanks at ends": lambda text: text.replace(b"\n", b"  \n\n"),
}
BLANKS_OF_BEAMS: dict[str, Wrap] = {
    "fewer blanks": lambda text: text.replace(b" \n", b"\n").replace(b"   theta", b"theta"),
    "more blanks": lambda text: text.replace(b" ", b"  ").replace(b"\t", b" \t"),
}
WRAPS: dict[str, Wrap] = {
    "crlf": lambda text: text.replace(b"\n", b"\r\n"),
    "cr": lambda text: text.replace(b"\n", b"\r"),
    "bom": lambda text: b"\xef\xbb\xbf" + text,
    "utf16": lambda text: text.decode().encode("utf-16"),
    "no end": lambda text: text.rstrip(b" \n"),
    "gzip": lambda text: gzip.compress(text, mtime=0),
    "gzip members": lambda text: gzip.compress(text[:999], mtime=0) + gzip.compress(text[999:], mtime=0) + bytes(100),
    "comments": lambda text: b"# recorded by hand\n\n" + text.replace(b"\n", b"\n\n# remark\n", 3),
}
UNMARKED: dict[str, Wrap] = {"utf16 unmarked": lambda text: text.decode().encode("utf-16-be")}
SEPARATORS: dict[str, Wrap] = {
    "semicolon": lambda text: text.replace(b",", b";"),
    "tab": lambda text: text.replace(b",", b"\t"),
    "space": lambda text: text.replace(b",", b" "),
    "spaces": lambda text: text.replace(b",", b"   "),
    "comma and space": lambda text: text.replace(b",", b", "),
    "trailing": lambda text: text.replace(b"\n", b",\n"),
    "decimal comma": lambda text: text.replace(b",", b";").replace(b".", b","),
    "quoted": lambda text: b'"' + text.replace(b",", b'","').replace(b"\n", b'"\n"').removesuffix(b'"'),
}
OWN: dict[str, dict[str, Wrap]] = {
    "carmen": BLANKS | {"no header": lambda text: text.removeprefix(HEADER.encode())},
    "json lines": {
        "spaces": lambda text: b"".join(json.dumps(json.loads(each)).encode() + b"\n\n" for each in text.splitlines())
    },
    **dict.fromkeys(SPELLINGS, BLANKS_OF_BEAMS),
    **{layout: (SEPARATORS if layout != "list" else {}) | UNMARKED for layout in LAYOUTS_OF_ROWS},
}
CASES = [
    pytest.param(text, name, wrap, marks=[pytest.mark.slow] if text in LAYOUTS and wrap in WRAPS.values() else [])
    for text in TEXTS
    for name, wrap in (WRAPS | OWN.get(text, {})).items()
    # A line that is no JSON is damage, and a comment in the head of a saved turn is no name of a column.
    if name != "comments" or text not in ("json lines", SAVED)
]


@cache
def text_of(kind: str) -> bytes:
    """A log as it is written, in the simplest way."""
    if kind == "carmen":
        return (HEADER + "".join(f"{each} 12.5 nohost 0.5\n" for each in CARMEN.values())).encode()
    if kind == "json lines":
        return (line(laser()) * 5).encode()
    if kind in SPELLINGS:
        text = SPELLINGS[kind](TURNS)
        return (text.replace(", ", ",") if kind == LISTED else text).encode()
    with TemporaryDirectory() as folder:
        write_csv(Path(folder) / "run.csv", [sweeps()], kind)
        return (Path(folder) / "run.csv").read_bytes()


def read(kind: str, data: bytes) -> tuple[str, dict[str, RawSweeps]]:
    """Format and sweeps, by topic, of a log of which nothing is lost."""
    blocks: dict[str, list[RawSweeps]] = {}
    is_csv, stream = kind in LAYOUTS, io.BytesIO(data)
    with CsvLog(stream, opening(kind)) if is_csv else open_log(stream) as log:
        for block in log.scans(None, report := ReadReport()):
            blocks.setdefault(block.topic, []).append(block)
        assert (report.damage, report.refused) == ([], {})
        assert (log.topics() is None) == (kind in ("carmen", "json lines"))
        return log.format, {topic: concatenate(some) for topic, some in blocks.items()}


@pytest.mark.parametrize(("kind", "name", "wrap"), CASES)
def test_wrapping_changes_nothing(kind: str, name: str, wrap: Wrap) -> None:
    (known, want), (form, got) = read(kind, text_of(kind)), read(kind, wrap(text_of(kind)))
    assert (form, got.keys()) == (known, want.keys())
    for topic, block in want.items():
        assert len(block) > 0
        for field in ("ranges", "beams", "stamp_ns", "angle_min", "angle_increment"):
            np.testing.assert_array_equal(getattr(got[topic], field), getattr(block, field), field)
