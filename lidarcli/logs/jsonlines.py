"""Messages as `mcap cat --json` (or `--format=ndjson`) prints them: one per line, of any topics."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidarcli.choices import ECHOES
from lidarcli.logs.base import MAX_BEAMS, ReadReport, Topic
from lidarcli.logs.beginnings import JSON_LINE
from lidarcli.logs.blocks import TOO_MANY, as_singles, keep_sound, pad_intensities, pad_rows, split_rows
from lidarcli.logs.foxglove import NOT_JSON, ROWS, STAMP, VALUES, RefusedError, Sweep, decode_fields
from lidarcli.logs.text import TextBlock, TextLog
from lidarcli.logs.times import DATE, S, time_unit, to_ns
from lidarcli.sweeps import RawSweeps

_SAMPLE = 100
"""Lines by whose times the unit is found."""
_MOST_NAMES = 4096
"""Most topics that are remembered."""
_NO_MESSAGE = "no message of `mcap cat --json`"
_CUT = "the file ends within this line: its message is dropped"


class JsonLinesLog(TextLog):
    """Printed messages from a file or from a stream."""

    format = "json lines"

    def topics(self) -> list[Topic] | None:
        """Return None: nothing lists the topics."""
        return None

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        decoder = _Decoder(topics, report, self._options.echo)
        for block in blocks:
            yield from decoder.feed(block)


class _Decoder:
    """Decodes lines; scans of each topic wait until they fill a block, or until the block of text ends."""

    def __init__(self, topics: Collection[str] | None, report: ReadReport, echo: str) -> None:
        self._topics = topics
        self._echo = echo
        self._report = report
        self._unit: int | None = None
        self._names: dict[bytes, str] = {}
        self._others: set[str] = set()
        """Topics whose first message is no scan."""
        self._scanned: set[str] = set()
        """Topics of which a message was a scan."""
        self._waiting: dict[str, list[Scan]] = {}
        self._rows = self._values = 0

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block, in blocks of each topic."""
        lines = block.text.split(b"\n")[:-1]
        if self._unit is None:
            times = [match[2] for line in lines[:_SAMPLE] if (match := JSON_LINE.match(line))]
            self._unit = time_unit("", times) if times else None
        for number, line in enumerate(lines, block.line):
            if not line.strip():
                continue
            last = block.cut and number == block.line + block.lines - 1
            if (cause := self._take(line)) is not None:
                self._report.add_damage(f"line {number}", _CUT if last else cause)
            if self._values >= VALUES or self._rows >= ROWS:
                yield from self._flush()
        yield from self._flush()

    def _flush(self) -> Iterator[RawSweeps]:
        """Yield the waiting scans as blocks."""
        for topic, scans in self._waiting.items():
            counts = np.array([len(scan.sweep.ranges) for scan in scans], np.int32)
            for rows in split_rows(counts):
                if (block := block_of(topic, scans[rows], self._report)) is not None:
                    yield block
        self._waiting, self._rows, self._values = {}, 0, 0

    def _take(self, line: bytes) -> str | None:
        """Keep the scan of a line; return the cause where the line is no message."""
        match = JSON_LINE.match(line)
        if match is None or self._unit is None:
            return _NO_MESSAGE
        topic = self._name(match[1])
        if topic is None:
            return NOT_JSON
        if topic in self._others or (self._topics is not None and topic not in self._topics):
            return None
        record, bad = to_ns([match[2]], self._unit)
        try:
            whole = json.loads(line)
        except (ValueError, RecursionError):
            return NOT_JSON
        if "data" not in whole:
            return _NO_MESSAGE
        if bad is not None:
            return "the time cannot be read"
        message = whole["data"]
        if is_scan(message):
            self._keep(topic, message, line, int(record[0]))
        elif topic in self._scanned:
            self._report.refused[(topic, NOT_SCAN)] += 1
        elif len(self._others) < _MOST_NAMES:
            self._others.add(topic)
        return None

    def _keep(self, topic: str, message: Any, line: bytes, record_ns: int) -> None:
        try:
            scan = scan_of(message, line, record_ns, self._echo)
            if len(scan.sweep.ranges) > MAX_BEAMS:
                raise RefusedError(TOO_MANY)
        except RefusedError as err:
            self._report.refused[(topic, str(err))] += 1
            return
        self._scanned.add(topic)
        self._waiting.setdefault(topic, []).append(scan)
        self._rows += 1
        self._values += len(scan.sweep.ranges)

    def _name(self, text: bytes) -> str | None:
        """Return the topic that a piece of JSON names; None where it names none."""
        if text not in self._names:
            if len(self._names) >= _MOST_NAMES:
                self._names.clear()
            try:
                self._names[text] = str(json.loads(text))
            except ValueError:
                return None
        return self._names[text]


NOT_SCAN = "not a LaserScan"
_BILLION = 1_000_000_000
_CAMEL = {"startAngle": "start_angle", "endAngle": "end_angle", "frameId": "frame_id"}
"""Names of protobuf in JSON → names of the fields."""
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
    """Last bearing of the message, beside the increment."""


def is_scan(message: Any) -> bool:
    """Tell whether a parsed message has the fields of a LaserScan, of ROS or of foxglove."""
    if not isinstance(message, dict) or "ranges" not in message:
        return False
    return "angle_increment" in message or "start_angle" in message or "startAngle" in message


def scan_of(message: Mapping[str, Any], line: bytes, record_ns: int, echo: str = ECHOES[0]) -> Scan:
    """Return the sweep of a message for which `is_scan` holds; `line` is its text. RefusedError where it can be none."""
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
    """Return ranges and intensities of the beams; of a MultiEchoLaserScan those of one echo each."""
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
    """Return the index of the echo that counts."""
    if echo == "last":
        return max(len(ranges) - 1, 0)
    if echo == "strongest":
        known = np.array([_strength(each) for each in intensities[: len(ranges)]])
        return 0 if np.isnan(known).all() else int(np.nanargmax(known))
    return 0


def _strength(value: Any) -> float:
    """Return an intensity, NaN where it is none: that costs no sweep."""
    try:
        return np.nan if value is None else float(value)
    except (TypeError, ValueError, OverflowError):
        return np.nan


def _header_stamp(stamp: Any, line: bytes) -> dict[str, int]:
    """Return a stamp as foxglove has it: of ROS 2, of ROS 1, or as one number, which JSON would round."""
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
    """Make a block of scans of one topic; those that can be no sweep are counted."""
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
