"""Scans among parsed messages: which type a message has, by its fields, and its numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidarcli.choices import ECHOES
from lidarcli.logs.base import ReadReport
from lidarcli.logs.blocks import as_singles, keep_sound, pad_intensities, pad_rows
from lidarcli.logs.foxglove import STAMP, RefusedError, Sweep, decode_fields
from lidarcli.logs.times import DATE, S, to_ns
from lidarcli.sweeps import RawSweeps

NOT_SCAN = "not a LaserScan"
_BILLION = 1_000_000_000
_CAMEL = {"startAngle": "start_angle", "endAngle": "end_angle", "frameId": "frame_id"}
"""Names as protobuf has them in JSON."""
_DECIMAL_STAMP = re.compile(rb'"stamp"\s*:\s*(\d{1,12}\.\d{1,9})')


class Scan(NamedTuple):
    """One message as a sweep."""

    sweep: Sweep
    record_ns: int
    increment: float
    range_min: float = 0.0
    range_max: float = np.inf
    time_increment: float = 0.0
    scan_time: float = 0.0
    angle_max: float = np.nan
    """As told beside the increment."""


def is_scan(message: Any) -> bool:
    """Whether a parsed message has the fields of a LaserScan, of ROS or of foxglove."""
    if not isinstance(message, dict) or "ranges" not in message:
        return False
    return "angle_increment" in message or "start_angle" in message or "startAngle" in message


def scan_of(message: Mapping[str, Any], line: bytes, record_ns: int, echo: str = ECHOES[0]) -> Scan:
    """The sweep of a message for which `is_scan` holds; `line` is its text. RefusedError where it can be none."""
    if "angle_increment" not in message:
        fields = {_CAMEL.get(name, name): value for name, value in message.items()}
        if isinstance(time := fields.get("timestamp"), str):
            fields["timestamp"] = _stamp(_of_text(time.encode(), DATE))
        sweep = decode_fields(fields)
        return Scan(sweep, record_ns, (sweep.angle_max - sweep.angle_min) / max(len(sweep.ranges) - 1, 1))
    try:
        header = message.get("header") or {}
        ranges, intensities = _chosen(message["ranges"], message.get("intensities"), echo)
        first, step = float(message["angle_min"]), float(message["angle_increment"])
        told = {
            "timestamp": _header_stamp(header.get("stamp"), line),
            "frame_id": header.get("frame_id", ""),
            "start_angle": first,
            "end_angle": first,
            "ranges": ranges,
            "intensities": intensities,
        }
        others = [
            # What writes infinity as null means it so here, too.
            float(default if message.get(name) is None else message[name])
            for name, default in (
                ("range_min", 0.0),
                ("range_max", np.inf),
                ("time_increment", 0.0),
                ("scan_time", 0.0),
                ("angle_max", np.nan),
            )
        ]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise RefusedError(NOT_SCAN) from None
    try:
        return Scan(decode_fields(told), record_ns, step, *others)
    except RefusedError:
        raise RefusedError(NOT_SCAN) from None


def _chosen(ranges: Any, intensities: Any, echo: str) -> tuple[list[Any], Any]:
    """Ranges and intensities of the beams; of a MultiEchoLaserScan those of one echo each."""
    if not any(isinstance(value, dict) for value in ranges):
        return list(ranges), intensities
    echoes = [_echoes(value) for value in ranges]
    strengths = [_echoes(value) for value in intensities or ()]
    strengths += [[]] * (len(echoes) - len(strengths))
    which = [_which(many, strong, echo) for many, strong in zip(echoes, strengths, strict=False)]
    return (
        [many[at] if many else None for many, at in zip(echoes, which, strict=True)],
        [strong[at] if at < len(strong) else None for strong, at in zip(strengths, which, strict=False)]
        if any(strengths)
        else None,
    )


def _echoes(value: Any) -> list[Any]:
    return list(value.get("echoes") or []) if isinstance(value, dict) else [value]


def _which(ranges: Sequence[Any], intensities: Sequence[Any], echo: str) -> int:
    """Which of the echoes of a beam counts."""
    if echo == "last":
        return max(len(ranges) - 1, 0)
    if echo == "strongest":
        known = np.array([_strength(each) for each in intensities[: len(ranges)]])
        return 0 if np.isnan(known).all() else int(np.nanargmax(known))
    return 0


def _strength(value: Any) -> float:
    """An intensity, NaN where it is none: that costs no sweep."""
    try:
        return np.nan if value is None else float(value)
    except (TypeError, ValueError, OverflowError):
        return np.nan


def _header_stamp(stamp: Any, line: bytes) -> dict[str, int]:
    """A stamp as foxglove has it: of ROS 2, of ROS 1, or as one number, which JSON would round."""
    if isinstance(stamp, dict):
        whole: Any = stamp.get("sec", stamp.get("secs", 0))
        rest: Any = stamp.get("nanosec", stamp.get("nsecs", stamp.get("nsec", 0)))
        return {"sec": int(whole), "nsec": int(rest)}
    if isinstance(stamp, str):
        return _stamp(_of_text(stamp.encode(), DATE))
    if stamp is None:
        return {}
    exact = _DECIMAL_STAMP.search(line)
    return _stamp(_of_text(exact[1] if exact else str(stamp).encode(), S))


def _of_text(text: bytes, unit: int) -> int:
    times, bad = to_ns([text], unit)
    if bad is not None:
        raise RefusedError(NOT_SCAN)
    return int(times[0])


def _stamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // _BILLION, "nsec": time_ns % _BILLION}


def block_of(topic: str, scans: Sequence[Scan], report: ReadReport) -> RawSweeps | None:
    """Scans of one topic as a block; those that can be no sweep are counted."""
    kept = [scan for scan in scans if -(2**63) <= scan.sweep.stamp_ns < 2**63]
    if len(kept) < len(scans):
        report.refused[(topic, STAMP)] += len(scans) - len(kept)
    if not kept:
        return None
    names = {name: code for code, name in enumerate(dict.fromkeys(scan.sweep.frame_id for scan in kept))}
    sweeps = [scan.sweep for scan in kept]
    told = np.array([scan[3:] for scan in kept], np.float64)
    others = as_singles(told)
    block = RawSweeps(
        topic=topic,
        frame_ids=tuple(names),
        frame=np.array([names[sweep.frame_id] for sweep in sweeps], np.int32),
        stamp_ns=np.array([sweep.stamp_ns for sweep in sweeps], np.int64),
        record_ns=np.array([scan.record_ns for scan in kept], np.int64),
        angle_min=np.array([sweep.angle_min for sweep in sweeps]),
        angle_increment=np.array([scan.increment for scan in kept]),
        range_min=others[:, 0],
        range_max=others[:, 1],
        beams=np.array([len(sweep.ranges) for sweep in sweeps], np.int32),
        ranges=pad_rows([sweep.ranges for sweep in sweeps]),
        intensities=pad_intensities(
            [sweep.intensities[: len(sweep.ranges)] for sweep in sweeps],
            max(len(sweep.ranges) for sweep in sweeps),
        ),
        time_increment=others[:, 2],
        scan_time=others[:, 3],
        angle_max=told[:, 4],
    )
    return keep_sound(block, None, report)
