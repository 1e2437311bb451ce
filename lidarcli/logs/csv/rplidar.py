"""Text of tools for RPLIDAR sensors as rows of the long form: start of a sweep, quality, bearing, distance.

The sensor counts its bearings in degrees clockwise, seen from above, and its distances in millimetres; 0 is no return.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.csv.layouts import DEFAULT_TOPIC, PER_SWEEP, RPLIDAR, Layout, ScanColumns, unread_times
from lidarcli.logs.csv.table import Dialect, Head, Lines, read_lines
from lidarcli.logs.numbers import shown
from lidarcli.logs.text import TextBlock

PRINTED = "lines of theta, Dist, Q"
MEASURED = "lines of new_scan, quality, angle, distance"
LISTED = "lists of quality, angle, distance"
SAVED = "turns as frame_grabber saves them"

_NUMBER = rb"\d++(?:\.\d*+)?+"
_PRINTED = re.compile(
    rb"[ \t]*+(?:(S)[ \t]*+)?theta:[ \t]*+(%s)[ \t]++Dist:[ \t]*+(%s)[ \t]++Q:[ \t]*+(\d++)[ \t]*+" % (_NUMBER, _NUMBER)
)
_MEASURED = re.compile(rb"\s*\(?(?:True|False)[ \t,;]+\d+[ \t,;]+%s[ \t,;]+%s\)?\s*" % (_NUMBER, _NUMBER))
_NEW_SCAN = re.compile(rb"\W*new_scan\W+quality\W+angle\W+distance\W*", re.IGNORECASE)
_LISTED = re.compile(rb"\s*\[\(\d+(?:\.\d*)?, ?%s, ?%s\)(?:,|\])" % (_NUMBER, _NUMBER))
_BEAM = re.compile(rb"(\d+)[ \t,;]+(%s)[ \t,;]+(%s)" % (_NUMBER, _NUMBER))
_SAVED = re.compile(rb"\s*#\s*RPLIDAR\s+SCAN\s+DATA\b", re.IGNORECASE)
_NAMES = {b"angle": "angle", b"angule": "angle", b"distance": "distance", b"quality": "quality", b"time": "time"}
_WORD = re.compile(rb"[A-Za-z]+")
_MOST_BEFORE = 100
"""Most lines of other text before the first beam."""
_LEAST_MEDIAN = 100.0
"""Least median of the distances of returns [mm]."""
_MOST = 0.9
"""Least share of beams that a sensor can have measured; the others are damaged."""
_ENOUGH = 64 << 10
"""Bytes of a line by which it is recognised."""
_PUNCTUATION = bytes.maketrans(b"(),;\t", b"     ")


def recognise(lines: Sequence[bytes]) -> Layout | None:
    """Return the layout of a text that begins with `lines`, where a tool for RPLIDAR sensors has written it; else None."""
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    for number, line in numbered[:_MOST_BEFORE]:
        if _PRINTED.fullmatch(line):
            return _layout(PRINTED, number, 1, 2)
    if not numbered:
        return None
    if _SAVED.match(numbered[0][1]):
        return _saved(numbered)
    data = [(number, line) for number, line in numbered if line.lstrip()[:1] != b"#"]
    if not data:
        return None
    if len(data) > 1 and _NEW_SCAN.fullmatch(data[0][1]):
        data.pop(0)
    start, first = data[0]
    if _MEASURED.fullmatch(first) and _are_beams([line for _, line in data]):
        return _layout(MEASURED, start, 2, 3)
    if _LISTED.match(first) and _are_beams([line for _, line in data]):
        return _layout(LISTED, start, 2, 3)
    return None


def _layout(spelling: str, start: int, angle: int, distance: int, width: int = 4) -> Layout:
    notes = ["bearings run clockwise, distances are millimetres"]
    name = f"{RPLIDAR}, {PER_SWEEP}" if spelling == SAVED else RPLIDAR
    if spelling != SAVED:
        notes.append("no times: all stamps are 0")
    return Layout(
        name,
        Dialect(b" "),
        start,
        width=width,
        scans=(ScanColumns(DEFAULT_TOPIC, {}, first=distance),),
        angle=angle,
        degrees=True,
        clockwise=True,
        flag=0,
        spelling=spelling,
        scale=0.001,
        notes=(spelling, *notes),
    )


def _saved(numbered: Sequence[tuple[int, bytes]]) -> Layout | None:
    """Return the layout of saved turns, whose comments name the columns; None where they do not."""
    names: list[str] = []
    for number, line in numbered:
        if line.lstrip()[:1] != b"#":
            if not {"angle", "distance"} <= set(names):
                return None
            # Before the columns of the file stands the flag of a turn.
            names = ["", *names]
            rows = [[b"", *_plain(row).split()] for _, row in numbered if row.lstrip()[:1] != b"#"]
            head = Head("", Dialect(b" "), names, b"", number, [], rows, OpenOptions())
            layout = _layout(SAVED, number, names.index("angle"), names.index("distance"), len(names))
            fields = {"record": names.index("time")} if "time" in names else {}
            scan = replace(layout.scans[0], fields=fields, units=head.units(fields))
            return replace(layout, scans=(scan,), unread=unread_times(head, [scan]))
        words = [_NAMES.get(word.lower(), "") for word in _WORD.findall(line)]
        if words and all(words):
            names = words
    return None


def _are_beams(lines: Sequence[bytes]) -> bool:
    """Tell whether triples of numbers may be quality, angle and millimetres."""
    beams = [map(float, beam) for line in lines for beam in _BEAM.findall(line[:_ENOUGH])]
    quality, angle, distance = np.array([[*beam] for beam in beams], np.float64).T
    returns = distance[distance > 0]
    return bool(
        np.mean((quality <= 255.0) & (angle <= 361.0)) >= _MOST
        and (np.median(returns) > _LEAST_MEDIAN if len(returns) else True)
    )


def read_rows(block: TextBlock, layout: Layout, report: ReadReport) -> Lines:
    """Return the rows of a block: 1 where a sweep begins, else 0, and the numbers of a beam, set apart by spaces."""
    lines = read_lines(block, None, b"", layout.start, report)
    if layout.spelling == LISTED:
        return _listed(lines, report)
    if layout.spelling == PRINTED:
        text = _printed(lines.text)
    elif layout.spelling == MEASURED:
        text = _plain(lines.text).replace(b"True", b"1").replace(b"False", b"0")
    else:
        text = _begun(block, lines, _plain(lines.text))
    return Lines(text, lines.numbers, lines.cut)


def _plain(text: bytes) -> bytes:
    """Return numbers set apart by one space each."""
    text = text.translate(_PUNCTUATION)
    if b"  " in text or b" \n" in text or b"\n " in text or text[:1] == b" ":
        text = b"".join(b" ".join(line.split()) + b"\n" for line in text.split(b"\n")[:-1])
    return text


def _printed(text: bytes) -> bytes:
    # What the SDK prints has always the same blanks: nothing is looked for line by line.
    plain = text.replace(b"S  theta: ", b"1 ").replace(b"   theta: ", b"0 ").replace(b" Dist: ", b" ")
    plain = plain.replace(b" Q: ", b" ").replace(b" \n", b"\n")
    if b"t" not in plain and b"  " not in plain:
        return plain
    rows = []
    for line in text.split(b"\n")[:-1]:
        match = _PRINTED.fullmatch(line)
        flag = b"1" if match and match[1] else b"0"
        rows.append(b" ".join([flag, *match.group(2, 3, 4)]) if match else line)
    return b"".join(row + b"\n" for row in rows)


def _begun(block: TextBlock, lines: Lines, text: bytes) -> bytes:
    """Begin rows with 1 below a title, which stands before each sweep, else with 0."""
    rows = text.split(b"\n")[:-1]
    flags = [b"0 "] * len(rows)
    if b"#" in block.text:
        titles = [n for n, line in enumerate(block.text.split(b"\n"), block.line) if _SAVED.match(line)]
        for row in np.searchsorted(lines.numbers, titles).tolist():
            if row < len(flags):
                flags[row] = b"1 "
    return b"".join(flag + row + b"\n" for flag, row in zip(flags, rows, strict=True))


def _listed(lines: Lines, report: ReadReport) -> Lines:
    """Make a row of each beam of each list."""
    rows: list[bytes] = []
    counts = np.zeros(len(lines.numbers), np.int64)
    for at, (number, raw) in enumerate(zip(lines.numbers.tolist(), lines.text.split(b"\n"), strict=False)):
        line = raw.strip()
        if lines.cut and at == len(counts) - 1 and not line.endswith(b"]"):
            report.add_damage(f"line {number}", "the file ends within this line: its sweep is dropped")
        elif not line.startswith(b"[(") or not line.endswith(b")]"):
            if line not in (b"", b"[]"):
                report.add_damage(f"line {number}", f"{shown(line)} is no list of beams")
        else:
            beams = line[2:-2].replace(b" ", b"").split(b"),(")
            counts[at] = len(beams)
            rows.append(b"1 " + b"\n0 ".join(beams).replace(b",", b" ") + b"\n")
    return Lines(b"".join(rows), np.repeat(lines.numbers, counts), False)
