"""Columnar decoding of `sensor_msgs/LaserScan`, in CDR (ROS 2) and in ROS 1 serialisation.

Messages are never turned into objects: the fields of all messages of a block are gathered at once from the
bytes they lie in. What a message declares is compared with its end before anything of that size is allocated.
A message that cannot be a sweep is refused and counted, its neighbours go on.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import LASERSCAN, MAX_BEAMS, MULTI_ECHO, OpenOptions, ReadReport
from lidarcli.logs.blocks import BLOCK_ROWS, ScanLayout, pad_intensities, pad_rows, split_rows, unsound
from lidarcli.ros.cursor import ENCAPSULATION, MAX_NAME, NAME_LONG
from lidarcli.sweeps.types import Bool, Float32, Int32, Int64, RawSweeps, UInt8, record
from lidarcli.system.records import dataclass, field, fields, replace

SHORT = "shorter than a LaserScan"
FRAME_BEYOND = "frame_id longer than the message"
RANGES_BEYOND = "more ranges declared than the message holds"

# Plain CDR and plain XCDR2 (both ids in use): without 8-byte members a LaserScan looks the same in both.
_BIG_ENDIAN_CDR = np.isin(np.arange(256), (0x00, 0x06, 0x10))
_LITTLE_ENDIAN_CDR = np.isin(np.arange(256), (0x01, 0x07, 0x11))


@record
class _Heads:
    """Fields before the ranges, of the K messages that have not been refused."""

    row: NDArray[np.intp]
    start: Int64
    end: Int64
    big: Bool
    stamp_ns: Int64
    frame_length: Int64
    at: Int64
    """Position of the first float [bytes]."""
    geometry: Float32
    """(K, 7) angle_min, angle_max, angle_increment, time_increment, scan_time, range_min, range_max"""
    beams: Int64

    def __len__(self) -> int:
        return len(self.row)

    def take(self, index: slice | Bool) -> _Heads:
        """Return the messages of `index`."""
        return _Heads(*(getattr(self, field.name)[index] for field in fields(self)))


def decode_blocks(
    topic: str,
    buffer: UInt8,
    offsets: Int64,
    lengths: Int64,
    record_ns: Int64,
    encoding: str,
    report: ReadReport,
    echo: str | None = None,
) -> Iterator[RawSweeps]:
    """Decode the messages at `offsets` of `buffer` into blocks of bounded size, in their order.

    `encoding` is `cdr` or `ros1`; `echo` is the one to take of each beam of a MultiEchoLaserScan. A block ends where it is
    full, or where padding would outweigh its sweeps (one sweep of 100,000 beams among sweeps of 361).
    """
    for first in range(0, len(offsets), BLOCK_ROWS):
        part = slice(first, first + BLOCK_ROWS)
        heads = _read_heads(topic, buffer, offsets[part], lengths[part], encoding, report)
        if echo is not None:
            heads, echoes = _echoes(topic, buffer, heads, report, echo)
        for rows in split_rows(heads.beams):
            some = heads.take(rows)
            if echo is not None:
                ranges, intensities = _padded(echoes[rows])
            else:
                ranges = _gather(buffer, some.at + 32, some.beams, some.big)
                intensities = _gather_intensities(buffer, some)
            yield _block(topic, buffer, some, record_ns[part][some.row], ranges, intensities)


@dataclass(slots=True)
class Locator:
    """Finds the ranges in the messages of a topic, as `decode_blocks` reads them."""

    encoding: str
    """`cdr` or `ros1`."""
    several: bool
    """True for a MultiEchoLaserScan, of which every echo is located."""
    _known: tuple[int, bytes, bytes, str, ScanLayout] | None = None
    """Length, encapsulation, and what is between stamp and ranges, of a LaserScan; form of its stamp, and its layout."""

    def __call__(self, message: bytes) -> ScanLayout | None:
        """Return where the ranges of a message are; None where it is no sweep."""
        if self._known is not None:
            length, mark, head, form, layout = self._known
            # Most messages of a sensor differ in stamps and measured values alone.
            if len(message) == length and message.startswith(mark) and message.startswith(head, 12):
                seconds, nanoseconds = struct.unpack_from(form, message, 4)
                return layout._replace(stamp_ns=seconds * 1_000_000_000 + nanoseconds)
        buffer = np.frombuffer(message, np.uint8)
        first, length = np.zeros(1, np.int64), len(message)
        heads = _read_heads("", buffer, first, first + length, self.encoding, ReadReport())
        if not len(heads):
            return None
        at, beams, order = int(heads.at[0]) + 32, int(heads.beams[0]), ">" if heads.big[0] else "<"
        stamp_ns, (least, most) = int(heads.stamp_ns[0]), heads.geometry[0, 5:7].tolist()
        beam = np.arange(beams)
        layout = ScanLayout(stamp_ns, beams, least, most, beam, at + 4 * beam, f"{order}f4")
        if not self.several:
            is_cdr = self.encoding == "cdr"
            self._known = length, message[: 4 * is_cdr], message[12:at], f"{order}{'i' if is_cdr else 'I'}I", layout
            return layout
        words = np.frombuffer(message, f"{order}u4", (length - at) // 4, at).astype(np.uint32)
        found = _starts(words, beams)
        if found is None:
            return None
        starts = found[0]
        echoes = words[starts].astype(np.int64)
        beam = np.repeat(beam, echoes)
        entry = starts[beam] + 1 + np.arange(len(beam)) - np.repeat(np.cumsum(echoes) - echoes, echoes)
        return layout._replace(beam=beam, place=at + 4 * entry)


def _windows(buffer: UInt8, at: Int64, width: int) -> UInt8:
    """Return (K, width) the bytes from each of `at` on, by one gather of whole rows."""
    if not len(at) or not width:
        return np.empty((len(at), width), np.uint8)
    views = np.ndarray((len(buffer) - width + 1,), f"V{width}", buffer, strides=(1,))
    rows: UInt8 = views[at].view(np.uint8).reshape(len(at), width)
    return rows


def _words(rows: UInt8, big: Bool) -> NDArray[np.uint32]:
    """Return bytes as 32-bit words, each row in its own byte order."""
    words: NDArray[np.uint32] = rows.view("<u4").astype(np.uint32, copy=False)
    if big.any():
        words[big] = words[big].byteswap()
    return words


def _read_heads(topic: str, buffer: UInt8, offsets: Int64, lengths: Int64, encoding: str, report: ReadReport) -> _Heads:
    """Read and check all that stands before the ranges; a message that fails is refused and counted."""

    def check(heads: _Heads, *causes: tuple[Bool, str]) -> _Heads:
        refused = np.zeros(len(heads), np.bool_)
        for bad, cause in causes:
            fresh = bad & ~refused
            if fresh.any():
                report.refused[(topic, cause)] += int(fresh.sum())
                refused |= fresh
        return heads.take(~refused) if refused.any() else heads

    many = len(offsets)
    heads = _Heads(
        row=np.arange(many),
        start=offsets,
        end=offsets + lengths,
        big=np.zeros(many, np.bool_),
        stamp_ns=np.zeros(many, np.int64),
        frame_length=np.zeros(many, np.int64),
        at=offsets,
        geometry=np.zeros((many, 7), np.float32),
        beams=np.zeros(many, np.int64),
    )
    outside = (lengths < 48) | (lengths > len(buffer)) | (offsets < 0) | (heads.end > len(buffer))
    heads = check(heads, (outside, SHORT))

    if encoding == "cdr":
        marks = _windows(buffer, heads.start, 2)
        big = _BIG_ENDIAN_CDR[marks[:, 1]]
        heads = replace(heads, big=big)
        plain = (marks[:, 0] == 0) & (big | _LITTLE_ENDIAN_CDR[marks[:, 1]])
        heads = check(heads, (~plain, ENCAPSULATION))

    words = _words(_windows(buffer, heads.start, 16), heads.big)
    name = words[:, 3].astype(np.int64)
    seconds = words[:, 1].astype(np.int64) if encoding == "ros1" else words[:, 1].view(np.int32).astype(np.int64)
    # CDR aligns what follows the name, counted from the end of its 4-byte encapsulation; ROS 1 does not.
    at = heads.start + 16 + (name if encoding == "ros1" else (name + 3) & ~3)
    heads = replace(heads, stamp_ns=seconds * 1_000_000_000 + words[:, 2], frame_length=name, at=at)
    heads = check(heads, (at + 32 > heads.end, FRAME_BEYOND), (name > MAX_NAME, NAME_LONG))

    words = _words(_windows(buffer, heads.at, 32), heads.big)
    beams = words[:, 7].astype(np.int64)
    geometry = words[:, :7].view(np.float32)
    heads = replace(heads, geometry=geometry, beams=beams)
    return check(
        heads,
        # A list of echoes has at least its own count: four bytes per beam hold for both types.
        ((heads.at + 32 + 4 * beams > heads.end) & (beams <= MAX_BEAMS), RANGES_BEYOND),
        *unsound(beams, geometry[:, 0], geometry[:, 2], report),
    )


def _gather_intensities(buffer: UInt8, heads: _Heads) -> Float32 | None:
    """Return (K, B) the intensities, NaN where a sweep has fewer of them than ranges; None where no sweep has any."""
    at = heads.at + 32 + 4 * heads.beams
    there = at + 4 <= heads.end
    if not there.any():
        return None
    count = np.zeros(len(heads), np.int64)
    count[there] = _words(_windows(buffer, at[there], 4), heads.big[there])[:, 0]
    count[at + 4 + 4 * count > heads.end] = 0
    count = np.minimum(count, heads.beams)
    if not count.any():
        return None
    values = _gather(buffer, at + 4, count, heads.big)
    width = int(heads.beams.max())
    if values.shape[1] == width:
        return values
    wide = np.full((len(heads), width), np.nan, np.float32)
    wide[:, : values.shape[1]] = values
    return wide


def _gather(buffer: UInt8, at: Int64, count: Int64, big: Bool) -> Float32:
    """Return (K, B) `count` floats from each of `at` on, short rows padded with NaN."""
    width = int(count.max(initial=0))
    # A window as wide as the widest sweep reads past a short message's end, which does no harm inside the
    # buffer; the few rows for which it would not fit are copied one by one.
    inside = at + 4 * width <= len(buffer)
    if inside.all():
        words = _windows(buffer, at, 4 * width)
    else:
        words = np.empty((len(at), 4 * width), np.uint8)
        words[inside] = _windows(buffer, at[inside], 4 * width)
        for row in np.flatnonzero(~inside).tolist():
            size = 4 * int(count[row])
            words[row, :size] = buffer[at[row] : at[row] + size]
    values: Float32 = _words(words, big).view(np.float32)
    if (count != width).any():
        values[np.arange(width) >= count[:, None]] = np.nan
    return values


def _frames(buffer: UInt8, heads: _Heads) -> tuple[Int32, tuple[str, ...]]:
    """Return the frame of each message as an index, and the distinct frame names."""
    names: dict[str, int] = {}
    codes = np.zeros(len(heads), np.int32)
    lengths = heads.frame_length
    uniform = len(heads) > 0 and bool((lengths == lengths[0]).all())
    for length in [int(lengths[0])] if uniform else np.unique(lengths).tolist():
        rows = np.flatnonzero(heads.frame_length == length)
        raw = _windows(buffer, heads.start[rows] + 16, length)
        if not length or (raw == raw[0]).all():
            distinct, inverse = raw[:1], np.zeros(len(rows), np.intp)
        else:
            views, inverse = np.unique(raw.view(f"V{length}")[:, 0], return_inverse=True)
            distinct = views.view(np.uint8).reshape(len(views), length)
        decoded = (row.tobytes().split(b"\0")[0].decode("utf-8", "replace") for row in distinct)
        known = np.array([names.setdefault(name, len(names)) for name in decoded], np.int32)
        codes[rows] = known[inverse]
    return codes, tuple(names)


def _block(
    topic: str, buffer: UInt8, heads: _Heads, record_ns: Int64, ranges: Float32, intensities: Float32 | None
) -> RawSweeps:
    frame, frame_ids = _frames(buffer, heads)
    # What is no number may be one of those that signal.
    with np.errstate(invalid="ignore"):
        angle_max = heads.geometry[:, 1].astype(np.float64)
    return RawSweeps(
        topic=topic,
        frame_ids=frame_ids,
        frame=frame,
        stamp_ns=heads.stamp_ns,
        record_ns=record_ns,
        angle_min=heads.geometry[:, 0].astype(np.float64),
        angle_increment=heads.geometry[:, 2].astype(np.float64),
        range_min=heads.geometry[:, 5].copy(),
        range_max=heads.geometry[:, 6].copy(),
        beams=heads.beams.astype(np.int32),
        ranges=ranges,
        time_increment=heads.geometry[:, 3].copy(),
        scan_time=heads.geometry[:, 4].copy(),
        intensities=intensities,
        angle_max=angle_max,
    )


def _echoes(topic: str, buffer: UInt8, heads: _Heads, report: ReadReport, echo: str) -> tuple[_Heads, list[Echoes]]:
    """Choose one echo of every beam, message by message."""
    echoes = []
    whole = np.ones(len(heads), np.bool_)
    starts, ends = (heads.at + 32).tolist(), heads.end.tolist()
    for row, (start, end, beams, big) in enumerate(
        zip(starts, ends, heads.beams.tolist(), heads.big.tolist(), strict=True)
    ):
        words = np.frombuffer(buffer[start:end].tobytes(), ">u4" if big else "<u4", (end - start) // 4)
        chosen = choose(words.astype(np.uint32), beams, echo)
        if chosen is None:
            whole[row] = False
            continue
        echoes.append(chosen)
    if not whole.all():
        report.refused[(topic, RANGES_BEYOND)] += int((~whole).sum())
        heads = heads.take(whole)
    return heads, echoes


def _padded(echoes: list[Echoes]) -> tuple[Float32, Float32 | None]:
    """Return (K, B) ranges and intensities, the latter None where no sweep has any."""
    ranges = pad_rows([each.ranges for each in echoes])
    return ranges, pad_intensities([each.intensities for each in echoes], ranges.shape[1])


Words = NDArray[np.uint32]
Places = NDArray[np.intp]

_NOWHERE = np.zeros(0, np.intp)


class Echoes(NamedTuple):
    """One echo of each of B beams, NaN for a beam that has none."""

    ranges: Float32
    intensities: Float32
    """(B,) empty where the message has none."""


def choose(words: Words, beams: int, echo: str) -> Echoes | None:
    """Return one echo of each beam: `first`, `last`, or `strongest` (the first without intensities).

    Parameters
    ----------
    words : what stands behind the number of beams, up to the end of the message
    beams : as many entries as the message declares

    Returns
    -------
    None where the echoes pass the end of the message; intensities that do are none
    """
    found = _starts(words, beams)
    if found is None:
        return None
    starts, end = found
    strength = _NOWHERE
    if end < len(words) and 0 < words[end] <= len(words) - end - 1:
        entries = min(int(words[end]), beams)
        behind = _starts(words[end + 1 :], entries)
        if behind is not None:
            strength = behind[0] + end + 1
    count = words[starts].astype(np.intp)
    strengths = np.zeros(beams, np.intp)
    strengths[: len(strength)] = words[strength]
    place = np.zeros(beams, np.intp)
    place[: len(strength)] = strength
    which = np.zeros(beams, np.intp)
    if echo == "last":
        which = np.maximum(count - 1, 0)
    elif echo == "strongest":
        which = _strongest(words, place, np.minimum(count, strengths))
    values = np.append(words, np.uint32(0)).view(np.float32)
    nothing = np.float32(np.nan)
    ranges = np.where(count > 0, values[np.minimum(starts + 1 + which, len(words))], nothing)
    if not strengths.any():
        return Echoes(ranges, np.empty(0, np.float32))
    has_both = (count > 0) & (which < strengths)
    return Echoes(ranges, np.where(has_both, values[np.where(has_both, place + 1 + which, -1)], nothing))


def _starts(words: Words, beams: int) -> tuple[Places, int] | None:
    """Return the position of the count of each entry, and the end of the list; None if it passes the end."""
    if not beams:
        return _NOWHERE, 0
    if not len(words):
        return None
    step = int(words[0]) + 1
    if step * beams <= len(words):
        at = np.arange(beams) * step
        if (words[at] == words[0]).all():
            return at, step * beams
    counts = words.tolist()
    starts = []
    place = 0
    for _ in range(beams):
        if place >= len(counts):
            return None
        starts.append(place)
        place += 1 + counts[place]
    return (np.array(starts, np.intp), place) if place <= len(counts) else None


def _strongest(words: Words, place: Places, count: Places) -> Places:
    """Return (B,) the index of the strongest of the first `count` echoes; the first without intensities."""
    which = np.zeros(len(count), np.intp)
    several = np.flatnonzero(count > 1)
    values = words.view(np.float32)
    # A beam of very many echoes does not make the others as wide as itself.
    for echoes in np.unique(count[several]).tolist():
        rows = several[count[several] == echoes]
        strengths = values[place[rows, None] + 1 + np.arange(echoes)]
        which[rows] = np.argmax(np.where(np.isnan(strengths), -np.inf, strengths), axis=1)
    return which


TOGETHER = 64
"""Messages of one topic that are decoded where they lie; fewer are gathered first."""
ROWS = 512
"""Gathered messages of a topic are decoded when there are this many."""


@dataclass(slots=True)
class MessageBatcher:
    """Scattered messages of one LaserScan topic, in log order, gathered until decoding pays."""

    topic: str
    type: str
    encoding: str
    report: ReadReport
    echo: str = OpenOptions().echo
    rows: int = ROWS
    parts: list[bytes] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    size: int = 0

    def add(self, message: bytes, record_ns: int) -> bool:
        """Take one message; True when the block is full and wants `flush`."""
        self.parts.append(message)
        self.times.append(record_ns)
        self.size += len(message)
        return len(self.parts) >= self.rows or self.size >= 4 << 20

    def take(self, buffer: UInt8, offsets: Int64, lengths: Int64, record_ns: Int64) -> Iterator[RawSweeps]:
        """Decode messages where they lie if they are many, else gather them."""
        if len(offsets) >= TOGETHER:
            yield from self.decode(buffer, offsets, lengths, record_ns)
            return
        for start, length, time_ns in zip(offsets.tolist(), lengths.tolist(), record_ns.tolist(), strict=True):
            if self.add(buffer[start : start + length].tobytes(), time_ns):
                yield from self.flush()

    def decode(self, buffer: UInt8, offsets: Int64, lengths: Int64, record_ns: Int64) -> Iterator[RawSweeps]:
        """Decode messages that lie together already, after those that were gathered before."""
        yield from self.flush()
        yield from decode_blocks(
            self.topic,
            buffer,
            offsets,
            lengths,
            record_ns,
            self.encoding,
            self.report,
            self.echo if self.type == MULTI_ECHO else None,
        )

    def flush(self) -> Iterator[RawSweeps]:
        """Decode what has been gathered."""
        parts, times = self.parts, self.times
        if not parts:
            return
        self.parts, self.times, self.size = [], [], 0
        lengths = np.array(list(map(len, parts)), np.int64)
        buffer = np.frombuffer(b"".join(parts), np.uint8)
        yield from self.decode(buffer, np.cumsum(lengths) - lengths, lengths, np.array(times, np.int64))


_SCALARS = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
EXPECTED = {LASERSCAN: ("Header", "float32[]"), MULTI_ECHO: ("Header", "LaserEcho[]")}
# What is left open goes on to the end, and nothing is gone back over: a schema may be a megabyte of anything.
_NO_CODE = r'(?s)"(?:[^"\\]|\\.)*+"?|//[^\n]*+|/\*(?:[^*]|\*(?!/))*+(?:\*/)?'
_ANNOTATION = r"@\w++\s*+\([^)]*+\)?"
_BESIDE_TYPES = r"\b\w++::|(?<=<)\s++|(?<!\s)\s++(?=[<>])"
_IDL_NAMES = {"float": "float32", "sequence<float>": "float32[]", "sequence<LaserEcho>": "LaserEcho[]"}


def differs(type_name: str, encoding: str, text: str) -> str | None:
    """Return the first field in which a definition differs from the standard; None if it agrees or is empty.

    >>> differs(LASERSCAN, "ros2msg", "std_msgs/Header header\\nfloat64 angle_min")
    "field 2 is 'float64 angle_min', not 'float32 angle_min'"
    """
    header, ranges = EXPECTED[type_name]
    expected = [(header, "header"), *(("float32", name) for name in _SCALARS), (ranges, "ranges")]
    # Behind the definition of a message stand those of its parts.
    part = re.search(rf"^MSG: {type_name.replace('/msg/', '/(?:msg/)?')}\s*$", text, re.MULTILINE)
    found = _fields(encoding, text[part.end() :] if part else text, type_name)
    if not found:
        return None
    for place, (kind, name) in enumerate(expected):
        found_kind, found_name = found[place] if place < len(found) else ("nothing", "")
        found_kind = found_kind.rsplit("/", 1)[-1]
        if (found_kind, found_name) != (kind, name):
            return f"field {place + 1} is '{f'{found_kind} {found_name}'.strip()}', not '{kind} {name}'"
    return None


def scan_type(kind: str, encoding: str = "", text: str = "") -> str:
    """Return the type as which messages are read: a LaserScan where they begin with one; empty where they are no sweeps.

    >>> scan_type("sick/msg/ExtendedLaserScan", "ros2msg", "sensor_msgs/LaserScan laser_scan\\nbool[] intrusion")
    'sensor_msgs/msg/LaserScan'
    """
    if kind in EXPECTED:
        return kind
    if not text:
        # Some logs have no definitions; this is the one type of the kind that drivers publish.
        return LASERSCAN if kind.endswith("/ExtendedLaserScan") else ""
    begins = _fields(encoding, text, kind)[:1] if "LaserScan" in text else []
    names = ["LaserScan"] if encoding == "ros2idl" else ["sensor_msgs/LaserScan", LASERSCAN]
    return LASERSCAN if begins and begins[0][0] in names else ""


def _fields(encoding: str, text: str, kind: str) -> list[tuple[str, str]]:
    """Return types and names of the fields of a message; in .msg, definitions of its parts follow a line of '='."""
    fields = []
    if encoding == "ros2idl":
        struct = re.search(rf"\bstruct\s++{re.escape(kind.rsplit('/', 1)[-1])}\s*+\{{([^}}]*+)", re.sub(_NO_CODE, "", text))
        for member in re.sub(_ANNOTATION, "", struct[1]).split(";") if struct else ():
            words = re.sub(_BESIDE_TYPES, "", member).split()
            if len(words) >= 2:
                named = "".join(words[:-1])
                fields.append((_IDL_NAMES.get(named, named), words[-1]))
        return fields
    for raw in text.splitlines():
        line = raw.split("#", 1)[0].strip()
        if line.startswith("=="):
            break
        words = line.split()
        if len(words) >= 2 and "=" not in line:
            fields.append((words[0], words[1]))
    return fields
