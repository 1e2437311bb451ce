"""`foxglove.LaserScan` in JSON and in protobuf, message by message."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from lidarcli.logs.base import MAX_BEAMS, ReadReport
from lidarcli.logs.blocks import (
    ANGLE_MIN,
    IN_DEGREES,
    INCREMENT,
    INCREMENT_ZERO,
    TOO_MANY,
    Locate,
    Written,
    as_singles,
    in_degrees,
    pad_intensities,
    pad_rows,
    split_rows,
)
from lidarcli.ros.cursor import MAX_NAME, NAME_LONG
from lidarcli.sweeps import Float32, Int64, RawSweeps

NOT_JSON = "not JSON"
NOT_SCAN = "not a foxglove.LaserScan"
NOT_PROTOBUF = "not protobuf of its schema"
STAMP = "timestamp out of range"

ROWS = 256
VALUES = 1 << 20
"""Most sweeps, and about the most ranges, of a block."""

_FIELDS = frozenset({"timestamp", "frame_id", "start_angle", "end_angle", "ranges"})
_WORDS = {"nan": np.nan, "infinity": np.inf, "inf": np.inf, "-infinity": -np.inf, "-inf": -np.inf}


class Sweep(NamedTuple):
    """One decoded message."""

    frame_id: str
    stamp_ns: int
    angle_min: float
    angle_max: float
    ranges: Float32
    intensities: Float32
    """Empty where it has none."""


class RefusedError(ValueError):
    """A message that cannot be a sweep; the text is the cause."""


Decoder = Callable[[bytes], Sweep]


def decode_each(
    topic: str, messages: Iterable[tuple[int, bytes]], decoder: Decoder, report: ReadReport
) -> Iterator[RawSweeps]:
    """Yield blocks of sweeps from (record time, payload) pairs, in order; count refused messages."""
    sweeps: list[Sweep] = []
    times: list[int] = []
    values = 0
    for record_ns, data in messages:
        try:
            sweep = decoder(data)
            _check(sweep)
        except RefusedError as err:
            report.refused[(topic, str(err))] += 1
            continue
        sweeps.append(sweep)
        times.append(record_ns)
        values += len(sweep.ranges)
        if len(sweeps) >= ROWS or values >= VALUES:
            yield from _blocks(topic, sweeps, times)
            sweeps, times, values = [], [], 0
    if sweeps:
        yield from _blocks(topic, sweeps, times)


def _check(sweep: Sweep) -> None:
    if len(sweep.frame_id) > MAX_NAME:
        raise RefusedError(NAME_LONG)
    beams = len(sweep.ranges)
    if beams > MAX_BEAMS:
        raise RefusedError(TOO_MANY)
    if not np.isfinite(sweep.angle_min):
        raise RefusedError(ANGLE_MIN)
    if not np.isfinite(sweep.angle_max - sweep.angle_min):
        raise RefusedError(INCREMENT)
    if beams > 1 and sweep.angle_max == sweep.angle_min:
        raise RefusedError(INCREMENT_ZERO)
    if in_degrees(np.array([beams]), np.array([sweep.angle_max - sweep.angle_min]) / max(beams - 1, 1))[0]:
        raise RefusedError(IN_DEGREES)
    if not -(2**63) <= sweep.stamp_ns < 2**63:
        raise RefusedError(STAMP)


def _blocks(topic: str, sweeps: list[Sweep], times: list[int]) -> Iterator[RawSweeps]:
    beams = np.array([len(sweep.ranges) for sweep in sweeps], np.int32)
    for rows in split_rows(beams):
        some = sweeps[rows]
        names = {name: code for code, name in enumerate(dict.fromkeys(sweep.frame_id for sweep in some))}
        start = np.array([sweep.angle_min for sweep in some])
        end = np.array([sweep.angle_max for sweep in some])
        yield RawSweeps(
            topic=topic,
            frame_ids=tuple(names),
            frame=np.array([names[sweep.frame_id] for sweep in some], np.int32),
            stamp_ns=np.array([sweep.stamp_ns for sweep in some], np.int64),
            record_ns=np.array(times[rows], np.int64),
            angle_min=start,
            angle_increment=np.where(beams[rows] > 1, (end - start) / np.maximum(beams[rows] - 1, 1), 0.0),
            range_min=np.zeros(len(some), np.float32),
            range_max=np.full(len(some), np.inf, np.float32),
            beams=beams[rows],
            ranges=pad_rows([sweep.ranges for sweep in some]),
            intensities=pad_intensities(
                [sweep.intensities[: len(sweep.ranges)] for sweep in some], int(beams[rows].max())
            ),
        )


def decode_json(data: bytes) -> Sweep:
    """Decode a message in JSON. A range may be null or a word (`"NaN"`, `"Infinity"`) where the writer had no number."""
    try:
        fields = json.loads(data)
    except (ValueError, RecursionError):
        raise RefusedError(NOT_JSON) from None
    return decode_fields(fields)


def decode_fields(fields: Any) -> Sweep:
    """Decode a message whose JSON has been parsed."""
    try:
        stamp = fields.get("timestamp") or {}
        return Sweep(
            str(fields.get("frame_id", "")),
            int(stamp.get("sec", 0)) * 1_000_000_000 + int(stamp.get("nsec", 0)),
            float(fields["start_angle"]),
            float(fields["end_angle"]),
            _floats(fields["ranges"]),
            _intensities(fields.get("intensities")),
        )
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise RefusedError(NOT_SCAN) from None


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
    if not set(message.DESCRIPTOR.fields_by_name) >= _FIELDS:
        return None

    has_intensities = "intensities" in message.DESCRIPTOR.fields_by_name

    def decode_one(data: bytes) -> Sweep:
        try:
            fields: Any = message.FromString(data)
        except DecodeError:
            raise RefusedError(NOT_PROTOBUF) from None
        try:
            ranges = as_singles(np.array(fields.ranges, np.float64))
            stamp = fields.timestamp
            return Sweep(
                str(fields.frame_id),
                int(stamp.seconds) * 1_000_000_000 + int(stamp.nanos),
                float(fields.start_angle),
                float(fields.end_angle),
                ranges,
                _intensities([*fields.intensities] if has_intensities else None),
            )
        except (AttributeError, TypeError, ValueError):
            raise RefusedError(NOT_SCAN) from None

    field = message.DESCRIPTOR.fields_by_name["ranges"]
    kind = {field.TYPE_DOUBLE: "<f8", field.TYPE_FLOAT: "<f4"}.get(field.type, "")

    def locate(data: bytes) -> Written | None:
        try:
            sweep = decode_one(data)
            _check(sweep)
        except RefusedError:
            return None
        place = _places(data, field.number, kind)
        # What is written in another way is left as it is.
        beams = len(sweep.ranges)
        beam = np.arange(beams) if len(place) == beams else np.zeros(0, np.int64)
        return Written(sweep.stamp_ns, beams, 0.0, np.inf, beam, place[: len(beam)], kind)

    return decode_one, locate


_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
"""Wire types of protobuf."""


def _places(data: bytes, field: int, kind: str) -> Int64:
    """Return the positions of the numbers of a repeated field in a message that has been decoded [bytes]."""
    width = int(kind[-1]) if kind else 0
    found: list[Int64] = []
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(data):
        tag = varint()
        number, wire = tag >> 3, tag & 7
        if wire == _VARINT:
            varint()
            continue
        if wire not in (_FIXED64, _BYTES, _FIXED32):
            # Groups, which nobody writes any more.
            return np.zeros(0, np.int64)
        length = {_FIXED64: 8, _FIXED32: 4}.get(wire) or varint()
        if number == field and width:
            found.append(np.arange(at, at + length, width))
        at += length
    return np.concatenate([np.zeros(0, np.int64), *found])
