"""Many files with one sweep each: which ones, in which order, at which time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from lidarcli.errors import UnreadableError
from lidarcli.logs.times import time_unit, to_ns
from lidarcli.sweeps import RawSweeps, concatenate

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".xy", ".scan", ".gz")
"""Files of a folder that are read; others (a README.md) are passed over."""

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_BLOCK_SWEEPS = 256
_BLOCK_VALUES = 1 << 20


def sweep_files(folder: Path) -> list[Path]:
    """The files of a folder that may hold a sweep each, in order."""
    try:
        files = [item for item in folder.iterdir() if item.name[:1] != "." and item.is_file()]
    except OSError as err:
        raise UnreadableError(f"{folder}: cannot be read: {err.strerror or err}") from err
    files = [
        item
        for item in files
        if item.suffix.lower() in SUFFIXES or not item.suffix.lower().strip(".0123456789")
    ]
    if not files:
        raise UnreadableError(f"{folder}: no file in it that could hold a sweep ({' '.join(SUFFIXES)})")
    return in_order(files)


def in_order(files: Sequence[Path]) -> list[Path]:
    """Files by the numbers in their names, so that `scan_9` comes before `scan_10`."""
    stems = [_stem(file.name) for file in files]
    if all(_NUMBER.fullmatch(stem) for stem in stems):
        return [file for _, _, file in sorted(zip(map(_exact, stems), stems, files, strict=True))]
    return sorted(files, key=lambda file: (_natural(_stem(file.name)), file.name))


def stamp_of_name(name: str) -> int:
    """A file's name as a time [ns] where it is a number, else 0.

    >>> stamp_of_name("1714555596.445048407.csv"), stamp_of_name("scan_7.csv")
    (1714555596445048407, 0)
    """
    stem = _stem(name)
    unit = time_unit("", [stem.encode()]) if _NUMBER.fullmatch(stem) else None
    return 0 if unit is None else int(to_ns([stem.encode()], unit)[0][0])


def join_blocks(blocks: Iterator[RawSweeps]) -> Iterator[RawSweeps]:
    """Join small blocks of one topic into larger ones, without letting a wide sweep widen many narrow ones."""
    waiting: list[RawSweeps] = []
    rows = width = 0
    for block in blocks:
        wider = max(width, block.ranges.shape[1])
        alike = wider <= 2 * min([wider, *(b.ranges.shape[1] for b in waiting[:1])])
        if waiting and (rows + len(block) > _BLOCK_SWEEPS or (rows + 1) * wider > _BLOCK_VALUES or not alike):
            yield concatenate(waiting)
            waiting, rows, wider = [], 0, block.ranges.shape[1]
        waiting.append(block)
        rows, width = rows + len(block), wider
    if waiting:
        yield concatenate(waiting)


def _stem(name: str) -> str:
    for suffix in (".gz", *SUFFIXES):
        if name.lower().endswith(suffix):
            name = name[: -len(suffix)]
    return name


def _exact(stem: str) -> tuple[int, str]:
    """Numbers as written, in the order of their values: `-` aside, whole part then fraction."""
    whole, _, fraction = stem.partition(".")
    return int(whole), fraction


def _natural(stem: str) -> list[tuple[int, int, str]]:
    parts = re.split(r"(\d+)", stem)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part]
