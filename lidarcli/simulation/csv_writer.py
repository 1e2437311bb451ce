"""Sweeps as CSV, in each layout that the reader knows: for `simulate -o run.csv` and for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.simulation.text_logs import intensity_texts, number_or_word, only_topic, seconds, shortest, texts, write_lines
from lidarcli.sweeps import RawSweeps

_S = 1_000_000_000
_GEOMETRY = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")


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


def _sweeps(blocks: Iterable[RawSweeps]) -> Iterator[tuple[int, RawSweeps, int, list[str]]]:
    """Yield the number of each sweep, its block, its row there, and its ranges as text."""
    rows = ((block, row, ranges) for block in blocks for row, ranges in enumerate(texts(block)))
    for number, (block, row, ranges) in enumerate(rows):
        yield number, block, row, ranges


def _rostopic(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for number, block, row, ranges in _sweeps(blocks):
        if not number:
            names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
            names += [f"field.{name}" for name in _GEOMETRY]
            names += [f"field.ranges{i}" for i in range(len(ranges))]
            yield ",".join(names + [f"field.intensities{i}" for i in range(len(ranges))])
        head = [str(block.record_ns[row]), str(number), str(block.stamp_ns[row]), _frame(block, row)]
        yield ",".join(head + _geometry(block, row) + ranges + intensity_texts(block, row, "0.0"))


def _ros2(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for _, block, row, ranges in _sweeps(blocks):
        head = [*_stamp(block, row), _frame(block, row)]
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
    sizes = {topic: len(_GEOMETRY) + 1 + width * len(_arrays(topic in bright)) for topic, width in widths.items()}
    for _, block, row, ranges in _sweeps(kept):
        own = [*_geometry(block, row), seconds(int(block.stamp_ns[row]))]
        if block.topic in bright:
            # In the order of their names, as the program writes them.
            own += _filled(intensity_texts(block, row), widths[block.topic])
        own += ranges
        cells = [_filled(own if topic == block.topic else [], size) for topic, size in sizes.items()]
        yield ",".join([seconds(int(block.record_ns[row])), *chain.from_iterable(cells)])


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
    for number, block, row, ranges in _sweeps(kept):
        head = [seconds(int(block.record_ns[row])), str(number), *_stamp(block, row), _frame(block, row)]
        cells = head + _geometry(block, row) + _filled(ranges, width)
        yield ",".join(cells + (_filled(intensity_texts(block, row), width) if is_bright else []))


def _mcap(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    """As `mcap cat --format=csv`: the fields of the first message in the order of the alphabet, float32 as float64."""
    kept = list(blocks)
    width = max((block.ranges.shape[1] for block in kept), default=0)
    arrays = _arrays(any(block.intensities is not None for block in kept))
    sorted_names = sorted(("header.frame_id", "header.stamp.nanosec", "header.stamp.sec", *_GEOMETRY, *arrays))
    names = ["log_time", "publish_time", "sequence"]
    for name in sorted_names:
        names += [f"{name}.{i}" for i in range(width)] if name in arrays else [name]
    yield ",".join(names)
    for number, block, row, _ in _sweeps(kept):
        beams = int(block.beams[row])
        lists = {"ranges": block.ranges, "intensities": block.intensities}
        cells = dict(zip(_GEOMETRY, _geometry(block, row), strict=True))
        cells["header.frame_id"] = _frame(block, row)
        cells["header.stamp.sec"], cells["header.stamp.nanosec"] = _stamp(block, row)
        for name in arrays:
            values = () if (rows := lists[name]) is None else rows[row, :beams].tolist()
            cells[name] = ",".join(_filled([str(number_or_word(value)) for value in values], width))
        times = [f"{np.datetime64(int(block.record_ns[row]), 'ns')}Z"] * 2
        yield ",".join([*times, str(number), *(cells[name] for name in sorted_names)])


def _list(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    yield ",".join(["time", "header", *_GEOMETRY, "ranges", "intensities"])
    for _, block, row, ranges in _sweeps(blocks):
        whole, rest = _stamp(block, row)
        date = str(np.datetime64(int(block.record_ns[row]), "ns")).replace("-", "/").replace("T", " ")
        header = f"{{'stamp': {{'secs': {whole}, 'nsecs': {rest}}}, 'frame_id': '{_frame(block, row)}'}}"
        yield ",".join([date, f'"{header}"', *_geometry(block, row), *_quoted(block, row, ranges)])


def _quoted(block: RawSweeps, row: int, ranges: list[str]) -> list[str]:
    """Return ranges and intensities as lists in quotes."""
    return [f'"[{", ".join(values)}]"' for values in (ranges, intensity_texts(block, row))]


def _wide(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for number, block, row, ranges in _sweeps(blocks):
        if not number:
            yield ",".join(["time"] + [f"r{i}" for i in range(len(ranges))])
        yield ",".join([seconds(int(block.stamp_ns[row])), *ranges])


def _drow(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for number, block, row, ranges in _sweeps(blocks):
        yield ",".join([str(number), seconds(int(block.stamp_ns[row])), *ranges])


def _long(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    yield "sweep,stamp,angle,range"
    for number, block, row, ranges in _sweeps(blocks):
        head = f"{number},{block.stamp_ns[row]}"
        for angle, value in zip(_bearings(block, row), ranges, strict=True):
            yield f"{head},{angle},{value}"


def _write_files(folder: Path, blocks: Iterable[RawSweeps]) -> None:
    """One file per sweep, named by its stamp in seconds; stamps that are not distinct get running numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = list(blocks)
    stamps = [int(stamp) for block in kept for stamp in block.stamp_ns]
    distinct = all(a < b for a, b in pairwise(stamps))
    for number, block, row, ranges in _sweeps(kept):
        name = seconds(stamps[number]) if distinct else f"sweep_{number:06d}"
        rows = [f"{a},{r}" for a, r in zip(_bearings(block, row), ranges, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["theta,r", *rows]) + "\n")


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


def _stamp(block: RawSweeps, row: int) -> list[str]:
    """Return seconds and nanoseconds of the stamp of a sweep."""
    return [str(part) for part in divmod(int(block.stamp_ns[row]), _S)]
