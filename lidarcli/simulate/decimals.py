"""Numbers and times as text, and files of text: what the writers of text logs share."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.sweeps import Float32, RawSweeps

_S = 1_000_000_000


@contextmanager
def opened(path: Path) -> Iterator[IO[str]]:
    """A text file with bare newlines; the gzip header carries neither time nor name, so equal input gives equal bytes."""
    if path.suffix != ".gz":
        with path.open("w", encoding="utf-8", newline="") as out:
            yield out
        return
    with (
        path.open("wb") as raw,
        gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed,
        io.TextIOWrapper(packed, encoding="utf-8", newline="") as out,
    ):
        yield out


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines to a new text file, packed where its name ends in `.gz`."""
    with opened(path) as out:
        for line in lines:
            out.write(line)
            out.write("\n")


def only_topic(blocks: Iterable[RawSweeps], what: str, instead: str = "") -> Iterator[RawSweeps]:
    """The blocks of a log that has one topic; OptionError at the first one of a second topic, with what to do `instead`."""
    topic = None
    for block in blocks:
        if topic not in (None, block.topic):
            hint = f": {instead}" if instead else ""
            raise OptionError(f"{what} holds one topic, not {topic} and {block.topic}{hint}")
        topic = block.topic
        yield block


def finite(block: RawSweeps) -> RawSweeps:
    """The same with the greatest range in the place of infinity."""
    return replace(block, ranges=np.where(np.isposinf(block.ranges), block.range_max[:, None], block.ranges))


def texts(block: RawSweeps) -> Iterator[list[str]]:
    """The ranges of each sweep as shortest decimals."""
    for row, beams in zip(block.ranges, block.beams.tolist(), strict=True):
        yield shortest(row[:beams])


def intensity_texts(block: RawSweeps, row: int, otherwise: str | None = None) -> list[str]:
    """The intensities of a sweep as shortest decimals; where there are none, `otherwise` for each beam, or nothing."""
    beams = int(block.beams[row])
    if block.intensities is None:
        return [] if otherwise is None else [otherwise] * beams
    return shortest(block.intensities[row, :beams])


def shortest(values: Float32) -> list[str]:
    """The shortest decimals that read back as the same float32."""
    numbers: list[str] = values.astype("U").tolist()
    return numbers


def seconds(stamp_ns: int) -> str:
    """Nanoseconds as seconds with nine decimals.

    >>> seconds(-1_500_000_000)
    '-1.500000000'
    """
    sign, rest = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{rest // _S}.{rest % _S:09d}"


def number_or_word(value: float) -> float | str:
    """A float as JSON has it: a word, as in the JSON mapping of protobuf, for what is no number there."""
    if math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
