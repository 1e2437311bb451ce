"""Numbers, stamps and lists as people read them; bars, courses and maps in block characters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.display import texts
from lidarcli.reports.figures import PERCENT, Density, unit_of
from lidarcli.sweeps.types import Float64, Int64

NONE = "-"
SCENES = {
    "structured": "hardly anything moves",
    "semi-structured": "most of what is seen stands",
    "unstructured": "much of what is seen moves",
}
"""The paper's names (§2) of scenes → what they mean."""
WORDS = {
    "sweep": "one LaserScan message: one turn of the sensor, or one pass over its view",
    "beam": "one direction of a sweep, in which one range is measured",
    "no return": "a beam whose light did not come back from within reach",
    "object": "one thing as one sweep sees it; the same thing in ten sweeps is ten objects, and two legs may be two",
    "walls and rest": "beams on no object: on the building, on what is too large for an object, or without a range",
    "box": "the rectangle around an object, turned as it stands",
    "shape": "prismatic: like a box; round; legged: of several narrow parts; irregular; unknown: too few beams to tell",
    "visibility": "full: both edges of the object are seen; start, end or both hidden: behind something nearer; "
    "cut: by the edge of the view",
    "track": "an object followed from sweep to sweep, also while it is hidden, with one number",
    "agent": "a track that was seen to move by itself: a person, a robot",
    "end": "why a track ends: left view; free: its place was seen empty; lost: nothing tells what became of it; end of log",
    "scene": "structured: at most 0.1 % of the beams are on agents; semi-structured: at most 25 %; unstructured: more",
    "sensor frame": "x is forward, y left, and the sensor the origin",
    "world frame": "the frame in which the path of the sensor is known",
    "d_th": "the threshold of the step s from one range to the next, beyond which an object begins or ends",
    "gap": "a step between two stamps of at least one and a half usual steps: sweeps are missing",
    "clock fault": "a stamp that is before or equal to that of the sweep before",
    "p05, p50, p95": "5 %, half and 95 % of the values are at most this",
}
"""Word → meaning, of those that a page explains."""
OF_TRACKS = frozenset({"track", "agent", "end", "scene"})
"""Words that a page without tracks has not."""


def number(value: float | None, digits: int = 3) -> str:
    """Return a number of few digits, with thousands set apart.

    >>> [number(value) for value in (None, 12345, 0.123456, 3.0, 999.6)]
    ['-', '12,345', '0.123', '3', '1,000']
    """
    if value is None or not math.isfinite(value):
        return NONE
    # What a computation leaves of nothing is nothing.
    value = 0.0 if abs(value) < 1e-12 else value
    if value == int(value) or abs(value) >= 10**digits - 0.5:
        return f"{value:,.0f}"
    return f"{value:.{digits}g}"


def column(values: Sequence[float | None], unit: str = "") -> list[str]:
    """Return the cells of a column with the same number of decimals.

    These are two where the greatest number is from 0.1 to 10, else as many as give it three digits, but at least one.
    Where it is a thousand or more there are none, and none in a column of whole numbers.

    >>> column([0.4983, 126.0, None], " s"), column([0.0115, 0.0094]), column([1234.5, 3.0]), column([10.0, 5.0])
    (['0.5 s', '126.0 s', '-'], ['0.0115', '0.0094'], ['1,234', '3'], ['10', '5'])
    """
    known = [abs(value) for value in values if value is not None and math.isfinite(value)]
    greatest = max(known, default=0.0)
    is_whole = greatest >= 1000.0 or all(value == int(value) for value in known)
    decimals = 0
    if not is_whole:
        decimals = 2 if 0.1 <= greatest < 10.0 else max(2 - math.floor(math.log10(greatest)), 1)
    return [NONE if value is None or not math.isfinite(value) else f"{value:,.{decimals}f}{unit}" for value in values]


def quantity(name: str, value: float | None) -> str:
    """Return a figure with its unit; a share in per cent."""
    if value is None:
        return NONE
    if _is_share(name):
        return f"{number(100 * value)} %"
    unit = unit_of(name)
    return number(value) + ("" if unit == "1" else f" {unit}")


def quantities(name: str, values: Sequence[float | None], with_unit: bool = True) -> list[str]:
    """Return values of one figure, with the same number of decimals unless they are counts; shares in per cent.

    >>> quantities("width.p50", [0.4, 1.25]), quantities("sweeps", [1200, 3.5])
    (['0.40 m', '1.25 m'], ['1,200', '3.5'])
    """
    if _is_share(name):
        return column([None if value is None else 100 * value for value in values], " %")
    unit = unit_of(name)
    if unit == "1":
        return [number(value) for value in values]
    return column(values, f" {unit}" if with_unit else "")


def _is_share(name: str) -> bool:
    return not name.startswith(PERCENT) and (name.endswith("_share") or name.startswith("lost_share."))


def share(count: float, total: float) -> str:
    """Return a part of a whole in per cent."""
    return percent(count / total) if total else NONE


def percent(part: float) -> str:
    """Return a part of one in per cent.

    >>> percent(0.0625)
    '6.2 %'
    """
    return f"{100 * part:.1f} %"


def short_label(label: str) -> str:
    """Return a label that leaves room for the other columns.

    >>> short_label("a pallet of the long kind")
    'a pallet...'
    """
    return label if len(label) <= 11 else f"{label[:8].rstrip()}..."


def course(layers: Sequence[tuple[str, Sequence[tuple[float, float]]]], width: int) -> str:
    """Return spans, in shares of a time, as a line of `width` characters, each layer with its mark over those before.

    >>> course([("▁", [(0.0, 0.05), (0.4, 1.0)]), ("█", [(0.2, 0.5)])], 10)
    '▁·████▁▁▁▁'
    """
    marks = ["·"] * width
    for mark, chosen in layers:
        for low, high in chosen:
            for k in range(min(int(low * width), width - 1), min(int(high * width), width - 1) + 1):
                marks[k] = mark
    return "".join(marks)


def counted(value: float | None, name: str) -> str:
    """Return a number and what it counts.

    >>> counted(1, "log"), counted(1200, "log")
    ('1 log', '1,200 logs')
    """
    return f"{NONE} {name}s" if value is None else texts.counted(int(value), name)


def sure(count: int, low: int, high: int | None) -> str:
    """Return a number with the interval in which the true one lies.

    >>> sure(12, 11, 14), sure(0, 0, None)
    ('12 (11-14)', '0 (0 or more)')
    """
    return f"{count:,} ({low:,} or more)" if high is None else f"{count:,} ({low:,}-{high:,})"


def in_unit(value: float | None, unit: str = "", form: str = "") -> str:
    """Return a number with its unit, by a format; empty where there is none.

    >>> in_unit(1.25, "m", ".1f"), in_unit(12345, "s"), in_unit(None, "m"), in_unit(float("nan"))
    ('1.2 m', '12,345 s', '', '')
    """
    if value is None or math.isnan(value):
        return ""
    return f"{format(value, form) if form else number(value)} {unit}".rstrip()


def span(values: Sequence[float]) -> str:
    """Return the least and the greatest value, or one number where both read the same.

    >>> span([20.0, 5.0, 10.0]), span([10.0, 10.0000001])
    ('5 to 20', '10')
    """
    return " to ".join(dict.fromkeys(number(value) for value in (min(values), max(values))))


def bar(part: float, width: int) -> str:
    """Return a bar of `width` cells for the whole.

    >>> bar(0.5, 4)
    '██  '
    """
    cells = round(part * width)
    # What there is must be visible.
    if part > 0 and not cells:
        return "▏".ljust(width)
    return "█" * min(cells, width) + " " * (width - min(cells, width))


def spark(values: Sequence[float] | NDArray[Any], low: float = 0.0) -> str:
    """Return one character per value, from `low` to the greatest; a blank for a value that is not finite.

    >>> spark([0, 1, 4, 8])
    '▁▁▄█'
    """
    numbers = np.asarray(values, float)
    top = np.nanmax(numbers) if np.isfinite(numbers).any() else 0.0
    # No share of a smaller difference can be computed.
    scale = 8 / (top - low) if top - low > 1e-300 else 0.0
    heights = np.clip(np.nan_to_num(np.ceil((numbers - low) * scale)), 1, 8).astype(int)
    return "".join(
        " " if not np.isfinite(value) else " ▁▂▃▄▅▆▇█"[height] for value, height in zip(numbers, heights, strict=True)
    )


def resample(values: Float64, width: int) -> Float64:
    """Return the means of at most `width` groups of values."""
    if len(values) <= width:
        return values
    return means_of(values, np.linspace(0, len(values), width, endpoint=False).astype(np.int64))


def means_of(values: Float64, begin: Int64) -> Float64:
    """Return (K,) means of groups that begin at these values, NaN where none of a group is finite."""
    there = np.isfinite(values)
    count = np.add.reduceat(there.astype(np.int64), begin)
    total = np.add.reduceat(np.where(there, values, 0.0), begin)
    means: Float64 = np.divide(total, count, out=np.full(len(begin), np.nan), where=count > 0)
    return means


def shade(one: Density, width: int, height: int) -> list[str]:
    """Return the map from above, x to the right and y up: one character per cell, which is twice as high as wide."""
    nx, ny = one.counts.shape
    # A character covers k cells across and 2 k cells up.
    k = max(1, -(-nx // width), -(-ny // (2 * height)))
    columns, lines = -(-nx // k), -(-ny // (2 * k))
    padded = np.zeros((columns * k, lines * 2 * k))
    padded[:nx, :ny] = one.counts
    blocks = padded.reshape(columns, k, lines, 2 * k).sum(axis=(1, 3))
    top = blocks.max()
    level = np.ceil(4 * np.sqrt(blocks / top)).astype(int) if top else blocks.astype(int)
    return ["".join(" ░▒▓█"[cell] for cell in level[:, line]) for line in range(lines - 1, -1, -1)]
