"""Sweeps as CSV, in each layout that the reader knows: for `simulate -o run.csv` and for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.simulate.text_logs import (
    intensity_texts,
    number_or_word,
    only_topic,
    seconds,
    shortest,
    texts,
    write_lines,
)
from lidarcli.sweeps import RawSweeps

_S = 1_000_000_000
_GEOMETRY = (
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
)


def write_csv(path: Path, blocks: Iterable[RawSweeps], layout: str = "rostopic") -> None:
    """Write sweeps of one topic to `path` (of several topics in layout `plotjuggler`).

    A path that ends in `.gz` is compressed; for layout `per-sweep` it is a folder, made if need be. Ranges and
    geometry are the shortest decimals that read back as the same float32.
    """
    if layout not in LAYOUTS:
        raise OptionError(f"'{layout}' is no CSV layout: choose from {', '.join(LAYOUTS)}")
    if layout != "plotjuggler":
        blocks = only_topic(blocks, "this CSV layout", "use plotjuggler")
    if layout == "per-sweep":
        _write_files(path, blocks)
    else:
        write_lines(path, LAYOUTS[layout](blocks))


def _rostopic(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    first = True
    for block in blocks:
        for row, ranges in enumerate(texts(block)):
            if first:
                names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
                names += [f"field.{name}" for name in _GEOMETRY]
                names += [f"field.ranges{i}" for i in range(len(ranges))]
                yield ",".join(names + [f"field.intensities{i}" for i in range(len(ranges))])
                seq, first = 0, False
            head = [str(block.record_ns[row]), str(seq), str(block.stamp_ns[row]), _frame(block, row)]
            yield ",".join(head + _geometry(block, row) + ranges + intensity_texts(block, row, "0.0"))
            seq += 1


def _ros2(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for block in blocks:
        for row, ranges in enumerate(texts(block)):
            whole, rest = divmod(int(block.stamp_ns[row]), _S)
            head = [str(whole), str(rest), _frame(block, row)]
            yield ",".join(head + _geometry(block, row) + ranges + intensity_texts(block, row, "0.0"))


def _plotjuggler(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    kept = list(blocks)
    widths: dict[str, int] = {}
    bright = {block.topic for block in kept if block.intensities is not None}
    for block in kept:
        widths[block.topic] = max(widths.get(block.topic, 0), block.ranges.shape[1])
    names = ["__time"]
    for topic, width in widths.items():
        names += [f"{topic}/{name}" for name in _GEOMETRY] + [f"{topic}/header/stamp"]
        names += [f"{topic}/{name}[{i}]" for name in _arrays(topic in bright) for i in range(width)]
    yield ",".join(names)
    sizes = {
        topic: len(_GEOMETRY) + 1 + width * len(_arrays(topic in bright)) for topic, width in widths.items()
    }
    for block in kept:
        for row, ranges in enumerate(texts(block)):
            cells = [seconds(int(block.record_ns[row]))]
            for topic, size in sizes.items():
                own = [*_geometry(block, row), seconds(int(block.stamp_ns[row]))]
                if topic == block.topic and topic in bright:
                    # In the order of their names, as the program writes them.
                    own += _filled(intensity_texts(block, row), widths[topic])
                own += ranges
                cells += own + [""] * (size - len(own)) if topic == block.topic else [""] * size
            yield ",".join(cells)


def _arrays(is_bright: bool) -> list[str]:
    return [*(["intensities"] if is_bright else []), "ranges"]


def _filled(cells: list[str], width: int) -> list[str]:
    return cells + [""] * (width - len(cells))


def _bagpy(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    kept = list(blocks)
    width = max((block.ranges.shape[1] for block in kept), default=0)
    is_bright = any(block.intensities is not None for block in kept)
    names = ["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id", *_GEOMETRY]
    arrays = ["ranges", *(["intensities"] if is_bright else [])]
    yield ",".join(names + [f"{name}_{i}" for name in arrays for i in range(width)])
    seq = 0
    for block in kept:
        for row, ranges in enumerate(texts(block)):
            whole, rest = divmod(int(block.stamp_ns[row]), _S)
            head = [
                seconds(int(block.record_ns[row])),
                str(seq),
                str(whole),
                str(rest),
                _frame(block, row),
            ]
            cells = head + _geometry(block, row) + _filled(ranges, width)
            yield ",".join(cells + (_filled(intensity_texts(block, row), width) if is_bright else []))
            seq += 1


def _mcap(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    """As `mcap cat --format=csv`: the fields of the first message in the order of the alphabet, float32 as float64."""
    kept = list(blocks)
    width = max((block.ranges.shape[1] for block in kept), default=0)
    arrays = _arrays(any(block.intensities is not None for block in kept))
    sorted_names = sorted(
        ("header.frame_id", "header.stamp.nanosec", "header.stamp.sec", *_GEOMETRY, *arrays)
    )
    names = ["log_time", "publish_time", "sequence"]
    for name in sorted_names:
        names += [f"{name}.{i}" for i in range(width)] if name in arrays else [name]
    yield ",".join(names)
    sequence = 0
    for block in kept:
        for row, beams in enumerate(block.beams.tolist()):
            whole, rest = divmod(int(block.stamp_ns[row]), _S)
            told = {"ranges": block.ranges, "intensities": block.intensities}
            cells = dict(zip(_GEOMETRY, _geometry(block, row), strict=True))
            cells |= {"header.frame_id": _frame(block, row), "header.stamp.sec": str(whole)}
            cells["header.stamp.nanosec"] = str(rest)
            for name in arrays:
                values = () if (all_rows := told[name]) is None else all_rows[row, :beams].tolist()
                cells[name] = ",".join(_filled([str(number_or_word(value)) for value in values], width))
            times = [f"{np.datetime64(int(block.record_ns[row]), 'ns')}Z"] * 2
            yield ",".join([*times, str(sequence), *(cells[name] for name in sorted_names)])
            sequence += 1


def _list(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    yield ",".join(["time", "header", *_GEOMETRY, "ranges", "intensities"])
    for block in blocks:
        for row, ranges in enumerate(texts(block)):
            whole, rest = divmod(int(block.stamp_ns[row]), _S)
            date = str(np.datetime64(int(block.record_ns[row]), "ns")).replace("-", "/").replace("T", " ")
            header = f"{{'stamp': {{'secs': {whole}, 'nsecs': {rest}}}, 'frame_id': '{_frame(block, row)}'}}"
            cells = [date, f'"{header}"', *_geometry(block, row), *_quoted(block, row, ranges)]
            yield ",".join(cells)


def _quoted(block: RawSweeps, row: int, ranges: list[str]) -> list[str]:
    """Ranges and intensities as lists in quotes."""
    return [f'"[{", ".join(values)}]"' for values in (ranges, intensity_texts(block, row))]


def _wide(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    first = True
    for block in blocks:
        for row, ranges in enumerate(texts(block)):
            if first:
                yield ",".join(["time"] + [f"r{i}" for i in range(len(ranges))])
                first = False
            yield ",".join([seconds(int(block.stamp_ns[row])), *ranges])


def _drow(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    seq = 0
    for block in blocks:
        for row, ranges in enumerate(texts(block)):
            yield ",".join([str(seq), seconds(int(block.stamp_ns[row])), *ranges])
            seq += 1


def _long(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    yield "sweep,stamp,angle,range"
    sweep = 0
    for block in blocks:
        for row, ranges in enumerate(texts(block)):
            head = f"{sweep},{block.stamp_ns[row]}"
            for angle, value in zip(_bearings(block, row), ranges, strict=True):
                yield f"{head},{angle},{value}"
            sweep += 1


def _write_files(folder: Path, blocks: Iterable[RawSweeps]) -> None:
    """One file per sweep, named by its stamp in seconds; stamps that are not distinct get running numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = list(blocks)
    stamps = [int(stamp) for block in kept for stamp in block.stamp_ns]
    distinct = all(a < b for a, b in pairwise(stamps))
    number = 0
    for block in kept:
        for row, ranges in enumerate(texts(block)):
            name = seconds(stamps[number]) if distinct else f"sweep_{number:06d}"
            rows = [f"{a},{r}" for a, r in zip(_bearings(block, row), ranges, strict=True)]
            (folder / f"{name}.csv").write_text("\n".join(["theta,r", *rows]) + "\n")
            number += 1


LAYOUTS: dict[str, Callable[[Iterable[RawSweeps]], Iterator[str]]] = {
    "rostopic": _rostopic,
    "ros2": _ros2,
    "plotjuggler": _plotjuggler,
    "bagpy": _bagpy,
    "mcap": _mcap,
    "list": _list,
    "wide": _wide,
    "drow": _drow,
    "long": _long,
    "per-sweep": _long,
}
"""Names of the layouts, as `write_csv` takes them."""


def _geometry(block: RawSweeps, row: int) -> list[str]:
    beams = int(block.beams[row])
    last = block.angle_min[row] + (beams - 1) * block.angle_increment[row]
    times = (block.time_increment, block.scan_time)
    told = [0.0 if each is None else each[row] for each in times]
    values = [block.angle_min[row], last, block.angle_increment[row], *told]
    return shortest(np.array([*values, block.range_min[row], block.range_max[row]], np.float32))


def _bearings(block: RawSweeps, row: int) -> list[float]:
    angles = block.angle_min[row] + block.angle_increment[row] * np.arange(int(block.beams[row]))
    bearings: list[float] = angles.tolist()
    return bearings


def _frame(block: RawSweeps, row: int) -> str:
    return block.frame_ids[int(block.frame[row])]
