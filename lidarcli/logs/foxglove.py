"""Scans in JSON and in protobuf, message by message: `foxglove.LaserScan`, and LaserScan of ROS.

`JsonLinesLog` reads what `mcap cat --json` (or `--format=ndjson`) and `pymcap-cli cat` print, and no other JSON lines.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import MAX_BEAMS, ReadReport, Topic
from lidarcli.logs.blocks import TOO_MANY, Locate, ScanLayout, as_singles, keep_sound, pad_intensities, pad_rows, split_rows
from lidarcli.logs.cells import DATE, S, time_unit, to_ns
from lidarcli.logs.laserscan import choose
from lidarcli.logs.text import JSON_LINE, TextBlock, TextLog
from lidarcli.options.choices import ECHOES
from lidarcli.ros.cursor import MAX_NAME, NAME_LONG
from lidarcli.sweeps.types import Float32, RawSweeps

NOT_JSON = "not JSON"
NOT_SCAN = "not a LaserScan"
SHORTENED = "the ranges are abbreviated (pymcap-cli cat: --bytes ints)"
NOT_PROTOBUF = "not protobuf of its schema"
STAMP = "timestamp out of range"
LAYERED = "a scan of several layers"

ROWS = 256
VALUES = 1 << 20
"""Most sweeps, and about the most ranges, of a block."""

_FIELDS = (
    frozenset({"timestamp", "frame_id", "start_angle", "end_angle", "ranges"}),
    frozenset({"header", "angle_min", "angle_increment", "ranges"}),
    frozenset({"header", "angle_min", "angle_step", "ranges"}),
)
"""Fields of a scan, of foxglove, of ROS and of Gazebo."""
_WORDS = {"nan": np.nan, "infinity": np.inf, "inf": np.inf, "-infinity": -np.inf, "-inf": -np.inf}


class RefusedError(ValueError):
    """A message that cannot be a sweep; the text is the cause."""


class Scan(NamedTuple):
    """One decoded message."""

    frame_id: str
    stamp_ns: int
    record_ns: int
    angle_min: float
    increment: float
    ranges: Float32
    intensities: Float32
    range_min: float = 0.0
    range_max: float = np.inf
    time_increment: float = 0.0
    scan_time: float = 0.0
    angle_max: float = np.nan
    """Last bearing of the message, where it also has an increment."""


Decoder = Callable[[bytes, int], Scan]
"""Decodes a message and the time [ns] at which it was recorded; raises `RefusedError`."""


def decode_each(
    topic: str, messages: Iterable[tuple[int, bytes]], decoder: Decoder, report: ReadReport
) -> Iterator[RawSweeps]:
    """Yield blocks of sweeps from (record time, payload) pairs, in order; count refused messages."""
    scans: list[Scan] = []
    values = 0
    for record_ns, data in messages:
        try:
            scans.append(decoder(data, record_ns))
        except RefusedError as err:
            report.refused[(topic, str(err))] += 1
            continue
        values += len(scans[-1].ranges)
        if len(scans) >= ROWS or values >= VALUES:
            yield from blocks_of(topic, scans, report)
            scans, values = [], 0
    yield from blocks_of(topic, scans, report)


def blocks_of(topic: str, scans: Sequence[Scan], report: ReadReport) -> Iterator[RawSweeps]:
    """Yield scans of one topic as blocks; those that can be no sweep are counted."""
    for rows in split_rows(np.array([len(scan.ranges) for scan in scans], np.int32)):
        if (block := _block(topic, scans[rows], report)) is not None:
            yield block


def _block(topic: str, scans: Sequence[Scan], report: ReadReport) -> RawSweeps | None:
    names = {name: code for code, name in enumerate(dict.fromkeys(scan.frame_id for scan in scans))}
    numbers = np.array([scan[7:] for scan in scans], np.float64)
    others = as_singles(numbers)
    beams = [len(scan.ranges) for scan in scans]
    block = RawSweeps(
        topic=topic,
        frame_ids=tuple(names),
        frame=np.array([names[scan.frame_id] for scan in scans], np.int32),
        stamp_ns=np.array([scan.stamp_ns for scan in scans], np.int64),
        record_ns=np.array([scan.record_ns for scan in scans], np.int64),
        angle_min=np.array([scan.angle_min for scan in scans]),
        angle_increment=np.array([scan.increment for scan in scans]),
        range_min=others[:, 0],
        range_max=others[:, 1],
        beams=np.array(beams, np.int32),
        ranges=pad_rows([scan.ranges for scan in scans]),
        intensities=pad_intensities([scan.intensities[: len(scan.ranges)] for scan in scans], max(beams)),
        time_increment=others[:, 2],
        scan_time=others[:, 3],
        angle_max=numbers[:, 4],
    )
    return keep_sound(block, None, report)


def decode_json(data: bytes, record_ns: int, echo: str = ECHOES[0]) -> Scan:
    """Decode a message in JSON. A range may be null or a word (`"NaN"`, `"Infinity"`) where the writer had no number."""
    try:
        message = scan_in(json.loads(data))
    except (ValueError, RecursionError):
        raise RefusedError(NOT_JSON) from None
    if message is None:
        raise RefusedError(NOT_SCAN)
    return scan_of(message, data, record_ns, echo)


_SPELLED = {"startAngle": "start_angle", "endAngle": "end_angle", "frameId": "frame_id", "angleMin": "angle_min"} | {
    **dict.fromkeys(("angle_step", "angleStep"), "angle_increment"),
    "angleMax": "angle_max",
    "rangeMin": "range_min",
    "rangeMax": "range_max",
    "verticalCount": "vertical_count",
}
_BEARINGS = frozenset({"angle_increment", "start_angle", "startAngle", "angle_step", "angleStep"})
_ABBREVIATED = re.compile(r"<[\d,]+ bytes>")
_DECIMAL_STAMP = re.compile(rb'"(?:time)?stamp"\s*:\s*(\d{1,12}\.\d{1,9})')


def scan_in(message: Any) -> dict[str, Any] | None:
    """Return a parsed message that has the fields of a LaserScan, of ROS or of foxglove, or the one that it begins with."""
    for each in (message, next(iter(message.values()), None) if isinstance(message, dict) else None):
        if isinstance(each, dict) and "ranges" in each and not _BEARINGS.isdisjoint(each):
            return each
    return None


def scan_of(message: Mapping[str, Any], line: bytes, record_ns: int, echo: str = ECHOES[0]) -> Scan:
    """Return the sweep of a message that `scan_in` found; `line` is its text. RefusedError where it can be none."""
    fields = {_SPELLED.get(name, name): value for name, value in message.items()}
    of_ros = "angle_increment" in fields
    if isinstance(fields["ranges"], str) and _ABBREVIATED.fullmatch(fields["ranges"]):
        raise RefusedError(SHORTENED)
    try:
        header = (fields.get("header") or {}) if of_ros else fields
        ranges, intensities = _beams(fields["ranges"], fields.get("intensities"), echo)
        first = float(fields["angle_min" if of_ros else "start_angle"])
        if of_ros:
            step = float(fields["angle_increment"])
        else:
            step = (float(fields["end_angle"]) - first) / max(len(ranges) - 1, 1)
        others = [
            # What writes infinity as null means it so here, too.
            float(default if fields.get(name) is None else fields[name])
            for name, default in Scan._field_defaults.items()
        ]
        stamp_ns = stamp_of(header.get("stamp" if of_ros else "timestamp"), line)
        frame_id = str(header.get("frame_id") or fields.get("frame") or "")
        layers = int(fields.get("vertical_count") or 1)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise RefusedError(NOT_SCAN) from None
    for bad, cause in (
        (layers > 1, LAYERED),
        (len(frame_id) > MAX_NAME, NAME_LONG),
        (len(ranges) > MAX_BEAMS, TOO_MANY),
        (not -(2**63) <= stamp_ns < 2**63, STAMP),
    ):
        if bad:
            raise RefusedError(cause)
    return Scan(frame_id, stamp_ns, record_ns, first, step, ranges, intensities, *others)


def _beams(ranges: Any, intensities: Any, echo: str) -> tuple[Float32, Float32]:
    """Return ranges and intensities of the beams; of a MultiEchoLaserScan those of one echo each."""
    if not any(isinstance(value, dict) for value in ranges):
        return _floats(list(ranges)), _intensities(intensities)
    # As they stand in a message of ROS.
    words = [*_words(ranges, _number), np.array([len(intensities or ())]), *_words(intensities or (), _strength)]
    chosen = choose(np.concatenate(words).astype(np.uint32), len(ranges), echo)
    if chosen is None:
        raise ValueError("a message of its own lists has all of them")
    return chosen


def _words(entries: Iterable[Any], number: Callable[[Any], float]) -> Iterator[NDArray[np.uint32]]:
    """Yield the number of echoes of each beam, and these as 32-bit words."""
    for entry in entries:
        echoes = [number(value) for value in ((entry.get("echoes") or ()) if isinstance(entry, dict) else (entry,))]
        with np.errstate(over="ignore"):
            yield np.array([len(echoes), *np.array(echoes, np.float32).view(np.uint32)], np.uint32)


def _strength(value: Any) -> float:
    """Return an intensity, NaN where it is none: that costs no sweep."""
    try:
        return np.nan if value is None else float(value)
    except (TypeError, ValueError, OverflowError):
        return np.nan


def stamp_of(stamp: Any, line: bytes) -> int:
    """Return a stamp [ns] of ROS 2, of ROS 1, of protobuf, as text, or as one number, which JSON would round.

    `line` is the text of the message. ValueError, TypeError or OverflowError where it is no stamp.
    """
    if isinstance(stamp, dict):
        whole, rest = (
            int(next((stamp[name] for name in names if name in stamp), 0))
            for names in (("sec", "secs", "seconds"), ("nanosec", "nsecs", "nsec", "nanos"))
        )
        return whole * 1_000_000_000 + rest
    if stamp is None:
        return 0
    exact = None if isinstance(stamp, str) else _DECIMAL_STAMP.search(line)
    text, unit = (stamp, DATE) if isinstance(stamp, str) else (exact[1].decode() if exact else str(stamp), S)
    times, bad = to_ns([text.encode()], unit)
    if bad[0]:
        raise ValueError(f"{text} is no time")
    return int(times[0])


def _intensities(values: Any) -> Float32:
    """Return the intensities of a message; empty, at no cost to the sweep, if they are no list of numbers."""
    try:
        return _floats(values or [])
    except (KeyError, TypeError, ValueError, OverflowError):
        return np.empty(0, np.float32)


def _floats(values: Any) -> Float32:
    if not isinstance(values, list):
        raise TypeError("ranges is no list")
    if not all(isinstance(value, float) for value in values):
        values = [_number(value) for value in values]
    with np.errstate(over="ignore"):
        return np.array(values, np.float32)


def _number(value: Any) -> float:
    if value is None:
        return np.nan
    if isinstance(value, str):
        return _WORDS[value.strip().lower().lstrip("+")]
    return float(value)


def protobuf_decoder(name: str, schema: bytes) -> tuple[Decoder, Locate] | None:
    """Return a decoder and a locator for the type `name` of a FileDescriptorSet; None if it does not fit."""
    # Most logs hold no protobuf and need not wait for the import.
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from google.protobuf.message import DecodeError

    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(schema)
        waiting = {file.name: file for file in files.file}
        pool = descriptor_pool.DescriptorPool()
        while waiting:
            # A file can be added once all that it imports has been; without progress imports are missing or in a ring.
            ready = [file for file in waiting.values() if not waiting.keys() & set(file.dependency)]
            if not ready:
                return None
            for file in ready:
                pool.Add(waiting.pop(file.name))
        message = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    except (DecodeError, TypeError, KeyError, ValueError):
        return None
    if not any(set(message.DESCRIPTOR.fields_by_name) >= fields for fields in _FIELDS):
        return None

    def parse(data: bytes) -> Any:
        try:
            return message.FromString(data)
        except DecodeError:
            raise RefusedError(NOT_PROTOBUF) from None

    def decode_one(data: bytes, record_ns: int) -> Scan:
        return scan_of(_plain(parse(data)), b"", record_ns)

    field = message.DESCRIPTOR.fields_by_name["ranges"]
    kind = {field.TYPE_DOUBLE: "<f8", field.TYPE_FLOAT: "<f4"}.get(field.type, "")

    def locate(data: bytes) -> ScanLayout | None:
        try:
            scan = decode_one(data, 0)
            [_] = blocks_of("", [scan], ReadReport())
        except ValueError:
            return None
        # All ranges stand together behind the head of their field; what is written in another way is left as it is.
        values = parse(data).ranges
        numbers = np.array(values, kind or "<f4")
        alone = message(ranges=values).SerializePartialToString()
        at = data.find(alone) if kind and alone.endswith(numbers.tobytes()) else -1
        beam = np.arange(len(numbers) if at >= 0 else 0)
        place = at + len(alone) - numbers.nbytes + numbers.itemsize * beam
        return ScanLayout(scan.stamp_ns, len(scan.ranges), scan.range_min, scan.range_max, beam, place, kind)

    return decode_one, locate


def _plain(message: Any) -> dict[str, Any]:
    """Return a message of protobuf as its JSON would be parsed."""
    plain: dict[str, Any] = {}
    for name in message.DESCRIPTOR.fields_by_name:
        value = getattr(message, name)
        if not hasattr(value, "DESCRIPTOR"):
            plain[name] = value if isinstance(value, bool | int | float | str | bytes) else [*value]
        elif message.HasField(name):
            plain[name] = _plain(value)
    return plain


_NO_MESSAGE = "no message of `mcap cat --json`"
_CUT = "the file ends within this line: its message is dropped"


class JsonLinesLog(TextLog):
    """Lines that `mcap cat --json` or `pymcap-cli cat` prints, of a file or a stream: a message per line, of any topics."""

    format = "json lines"

    def topics(self) -> list[Topic] | None:
        """Return None: nothing lists the topics."""
        return None

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        decoder = _LineDecoder(topics, report, self._options.echo)
        for block in blocks:
            yield from decoder.feed(block)


class _LineDecoder:
    """Decodes lines; scans of each topic wait until they fill a block, or until the block of text ends."""

    def __init__(self, topics: Collection[str] | None, report: ReadReport, echo: str) -> None:
        self._topics = topics
        self._echo = echo
        self._report = report
        self._unit: int | None = None
        self._others: set[str] = set()
        """Topics whose first message is no scan."""
        self._scanned: set[str] = set()
        self._waiting: dict[str, list[Scan]] = {}
        self._rows = self._values = 0

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block, in blocks of each topic."""
        lines = block.text.split(b"\n")[:-1]
        if self._unit is None:
            times = [match[2] for line in lines[:100] if (match := re.match(JSON_LINE, line))]
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
            yield from blocks_of(topic, scans, self._report)
        self._waiting, self._rows, self._values = {}, 0, 0

    def _take(self, line: bytes) -> str | None:
        """Keep the scan of a line; return the cause where the line is no message."""
        match = re.match(JSON_LINE, line)
        if match is None or self._unit is None:
            return _NO_MESSAGE
        record, bad = to_ns([match[2]], self._unit)
        try:
            topic = str(json.loads(match[1]))
            if topic in self._others or (self._topics is not None and topic not in self._topics):
                return None
            whole = json.loads(line)
        except (ValueError, RecursionError):
            return NOT_JSON
        key = next((key for key in ("data", "message") if key in whole), None)
        if key is None:
            return _NO_MESSAGE
        if bad[0]:
            return "the time cannot be read"
        message = scan_in(whole[key])
        if message is not None:
            self._keep(topic, message, line, int(record[0]))
        elif topic in self._scanned:
            self._report.refused[(topic, NOT_SCAN)] += 1
        elif len(self._others) < 4096:
            self._others.add(topic)
        return None

    def _keep(self, topic: str, message: Any, line: bytes, record_ns: int) -> None:
        try:
            scan = scan_of(message, line, record_ns, self._echo)
        except RefusedError as err:
            self._report.refused[(topic, str(err))] += 1
            return
        self._scanned.add(topic)
        self._waiting.setdefault(topic, []).append(scan)
        self._rows += 1
        self._values += len(scan.ranges)
