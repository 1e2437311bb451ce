"""Command lines run in this process, and what every one of them is held to."""

from __future__ import annotations

import io
import json
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli import cli
from tools.fuzz.logs import LONGEST, odd_lines
from tools.fuzz.place import Place, snapshot

DOCUMENTED = (0, 1, 2, 3, 4, 5)
"""Exit codes that an input may lead to (docs/cli.md)."""
TEXT = (".txt", ".md", ".html", ".json", ".xml", ".csv")
_FORMATS = {".json": "json", ".xml": "junit"}


@dataclass(frozen=True, slots=True)
class Ran:
    """How a command ended."""

    code: int
    out: bytes
    err: str


def run(arguments: Sequence[str]) -> Ran:
    """Run one command line as `python -m lidarcli` would, with nothing on its standard input."""
    out, err, stdin = _stream("strict"), _stream("backslashreplace"), sys.stdin
    sys.stdin = io.TextIOWrapper(io.BytesIO())
    try:
        with redirect_stdout(out), redirect_stderr(err):
            code = cli.run(arguments)
    finally:
        sys.stdin = stdin
    for stream in (out, err):
        stream.flush()
    return Ran(code, _bytes(out), _bytes(err).decode("utf-8"))


def judge_commands(place: Place) -> Iterator[str]:
    """Run the command lines that `Place.note` got as `commands`, which name files from the folder of the place on."""
    planted = snapshot(place.out)
    for arguments in place.noted()["commands"]:
        who = " ".join(arguments)[:200]
        yield from _judged(who, arguments, run(arguments))
    for name, found in snapshot(place.out).items():
        if planted.get(name) == found:
            continue
        path = place.out / name
        if path.name.startswith(".") and name not in planted:
            yield f"left {name}"
        elif stat.S_ISREG(found[0]):
            yield from _whole(path)


def _judged(who: str, arguments: Sequence[str], ran: Ran) -> Iterator[str]:
    if ran.code not in DOCUMENTED:
        yield f"{who}: exit {ran.code}: {ran.err[-2000:]}"
        return
    # What the user has typed may come back, a letter that cannot be printed as four.
    yield from odd_lines(who, ran.err.splitlines(), LONGEST + 4 * max(map(len, arguments)))
    if ran.code not in (0, 1) and not ran.err:
        yield f"{who}: exit {ran.code} without a word"
    if "--format" in arguments and ran.code in (0, 1) and ran.out:
        form = arguments[arguments.index("--format") + 1]
        yield from _parsed(who, form, ran.out)


def _whole(path: Path) -> Iterator[str]:
    """An output has its name only when it is whole."""
    if path.suffix == ".parquet":
        try:
            pq.read_table(path)
        except (pa.ArrowException, OSError) as err:
            yield f"{path.name} is no whole table: {err}"
    if path.suffix in TEXT:
        yield from _parsed(path.name, _FORMATS.get(path.suffix, "text"), path.read_bytes())


def _parsed(who: str, form: str, data: bytes) -> Iterator[str]:
    try:
        text = data.decode("utf-8")
        if form == "json":
            json.loads(text, parse_constant=_no_json)
        elif form == "junit":
            ElementTree.fromstring(text)
    except (ValueError, ElementTree.ParseError) as err:
        yield f"{who}: no whole {form}: {err}"
        return
    if form not in ("arrow", "parquet"):
        odd = sorted({letter for letter in text if ord(letter) < 32 and letter not in "\n\r\t"})
        if odd:
            yield f"{who}: control characters {odd!r}"


def _no_json(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _stream(errors: str) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors=errors, newline="", write_through=True)


def _bytes(stream: io.TextIOWrapper) -> bytes:
    buffer = stream.buffer
    assert isinstance(buffer, io.BytesIO)
    return buffer.getvalue()
