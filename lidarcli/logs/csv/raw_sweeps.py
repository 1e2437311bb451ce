"""What all CSV layouts share on the way from cells to `RawSweeps`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.blocks import as_singles, given_geometries, limits_in_metres
from lidarcli.logs.csv.layouts import Columns
from lidarcli.logs.numbers import not_a_number
from lidarcli.logs.times import seconds_and_nanoseconds, to_ns
from lidarcli.sweeps import Bool, Float32, Float64, Int32, Int64, RawSweeps

GEOMETRY = (
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
)
NO_TIME = "the time cannot be read"


def bad_cell(report: ReadReport, line: int, cell: bytes) -> None:
    """Record a row that is dropped for a cell that is no number; only what is kept is put into words."""
    if len(report.damage) < ReadReport.MAX_DAMAGE:
        report.add_damage(f"line {line}", not_a_number(cell))
    else:
        report.damage_more += 1


def read_times(
    scan: Columns, column: Callable[[int], Sequence[bytes]], rows: int
) -> tuple[Int64, Int64, Bool | None]:
    """Header stamp and record time [ns] of each row, and the rows whose times cannot be read (None: no such row).

    Where a file has only one of the two, it stands for both.
    """
    fields, units = scan.fields, scan.units
    bad: Bool | None = None
    found: dict[str, Int64] = {}
    if "seconds" in fields:
        found["stamp"], bad = seconds_and_nanoseconds(
            column(fields["seconds"]), column(fields["nanoseconds"])
        )
    for name in ("stamp", "record"):
        if name not in units or name in found:
            continue
        found[name], wrong = to_ns(column(fields[name]), units[name])
        if wrong is not None:
            bad = wrong if bad is None else bad | wrong
    none = np.zeros(rows, np.int64)
    stamp = found.get("stamp", found.get("record", none))
    return stamp, found.get("record", stamp), bad


def encode_frames(names: Sequence[bytes]) -> tuple[Int32, tuple[str, ...]]:
    """The frame of each row as an index, and the distinct frames."""
    distinct = {name: code for code, name in enumerate(dict.fromkeys(names))}
    if len(distinct) == 1:
        codes = np.zeros(len(names), np.int32)
    else:
        codes = np.fromiter((distinct[name] for name in names), np.int32, len(names))
    # Spellings that differ by spaces alone are one frame to people, two codes here: harmless.
    return codes, tuple(name.strip(b" \"'").decode("utf-8", "replace") for name in distinct)


def fill_geometry(
    scan: Columns, known: dict[str, Float64], beams: Int64, options: OpenOptions
) -> tuple[Float64, Float64, Float32, Float32]:
    """angle_min, angle_increment [rad], range_min and range_max [m] of each row: the file's, else the options'."""
    rows = len(beams)
    if "angle_min" in known and "angle_increment" in known:
        first, step = known["angle_min"], known["angle_increment"]
    elif scan.to_last:
        first, step = known["angle_min"], (known["angle_max"] - known["angle_min"]) / np.maximum(beams - 1, 1)
    elif scan.geometry is not None:
        first, step = np.full(rows, scan.geometry[0]), np.full(rows, scan.geometry[1])
    else:
        first, step = given_geometries(options, beams)
    far = np.inf if options.range_max is None else options.range_max
    least = known.get("range_min", np.full(rows, scan.nearest))
    most = known.get("range_max", np.full(rows, np.inf))
    range_min, range_max = limits_in_metres(least, most, options.range_scale)
    return first, step, range_min, range_max if "range_max" in known else as_singles(np.full(rows, far))


def build(
    scan: Columns,
    times: tuple[Int64, Int64],
    frame: tuple[Int32, tuple[str, ...]],
    known: dict[str, Float64],
    beams: Int64,
    ranges: Float32,
    options: OpenOptions,
    intensities: Float32 | None = None,
) -> RawSweeps:
    """A block from its columns; `known` is the geometry that the file gives."""
    first, step, range_min, range_max = fill_geometry(scan, known, beams, options)
    return RawSweeps(
        topic=scan.topic,
        frame_ids=frame[1],
        frame=frame[0],
        stamp_ns=times[0],
        record_ns=times[1],
        angle_min=first,
        angle_increment=step,
        range_min=range_min,
        range_max=range_max,
        beams=beams.astype(np.int32),
        ranges=ranges,
        time_increment=_times(known, "time_increment"),
        scan_time=_times(known, "scan_time"),
        intensities=intensities,
        angle_max=known.get("angle_max"),
    )


def _times(known: dict[str, Float64], name: str) -> Float32 | None:
    """A column of seconds, where the file has it."""
    return as_singles(known[name]) if name in known else None


def number_type(options: OpenOptions) -> type[np.floating]:
    """Ranges are parsed as float32, or as float64 where they are scaled before they are rounded."""
    return np.float32 if options.range_scale == 1.0 else np.float64
