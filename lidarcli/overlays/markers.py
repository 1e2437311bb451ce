"""Messages for viewers as bytes, many at once: visualization_msgs/MarkerArray and tf2_msgs/TFMessage.

CDR of ROS 2 aligns its numbers, ROS 1 packs them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps.types import Bool, Float32, Float64, Int32, Int64, record

Structured = NDArray[np.void]
MARKER_TYPE = "visualization_msgs/msg/MarkerArray"
LAST_SECOND = (1 << 31) - 1
"""Latest stamp of ROS 2 [s]."""
SECOND = 1_000_000_000
"""Nanoseconds."""


class MessageLayout(NamedTuple):
    """Bytes of one kind of message, or of a part of one, with the offsets of the numbers that differ."""

    dtype: np.dtype[Any]
    template: bytes
    """Bytes that all have in common; 0 at the fields."""

    def filled(self, count: int) -> Structured:
        """Return (count,) copies of the template, whose fields are to be set."""
        return np.frombuffer(bytearray(self.template * count), self.dtype)


@dataclass(slots=True)
class LayoutBuilder:
    """Puts a layout together, member after member.

    In CDR every number begins at a multiple of its size, counted from the end of the message's four bytes of encapsulation,
    and texts end with a zero. ROS 1 has neither.
    """

    cdr: bool
    start: int = 0
    """Offset of the first byte from the same origin; only its remainder by 8 matters."""
    _bytes: bytearray = field(default_factory=bytearray)
    _fields: list[tuple[str, str, int]] = field(default_factory=list)

    def number(self, code: str, *values: float) -> None:
        """Add numbers that are equal in all messages; `code` is that of `struct`."""
        self._align(struct.calcsize(f"<{code}"))
        self._bytes += struct.pack(f"<{len(values)}{code}", *values)

    def field(self, name: str, code: str, shape: tuple[int, ...] = ()) -> None:
        """Add a field of numbers that differ."""
        size = struct.calcsize(f"<{code}")
        self._align(size)
        self._fields.append((name, f"{shape}<{np.dtype(code).str[1:]}", len(self._bytes)))
        self._bytes += bytes(size * int(np.prod(shape)))

    def text(self, value: bytes) -> None:
        """Add a text that is equal in all messages."""
        self.number("I", len(value) + self.cdr)
        self._bytes += value + bytes(self.cdr)

    def text_field(self, name: str, length: int) -> None:
        """Add a field of text of `length` bytes."""
        self.number("I", length + self.cdr)
        if length:
            self._fields.append((name, f"S{length}", len(self._bytes)))
        self._bytes += bytes(length + self.cdr)

    def layout(self) -> MessageLayout:
        """Return the layout of all members so far."""
        names, formats, offsets = zip(*self._fields, strict=True)
        dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": len(self._bytes)})
        return MessageLayout(dtype, bytes(self._bytes))

    def _align(self, size: int) -> None:
        if self.cdr:
            self._bytes += bytes(-(self.start + len(self._bytes)) % size)


def scatter(buffer: NDArray[np.uint8], places: NDArray[np.int64], items: Structured) -> None:
    """Put each of the `items` into the buffer where its first byte belongs."""
    size = items.dtype.itemsize
    # One window of this size begins at every byte: putting an item there is one copy of memory.
    windows = np.ndarray((len(buffer) - size + 1,), f"V{size}", buffer.data, strides=(1,))
    windows[places] = items.view(f"V{size}")


class Kind(Enum):
    """Kind of a marker: its `type` in the message, and its namespace, by which a viewer hides what is not wanted."""

    ARROW = (0, b"velocity")
    CUBE = (1, b"body")
    CYLINDER = (3, b"body")
    OUTLINE = (4, b"outline")
    PATH = (4, b"path")
    ZONE = (4, b"zones")
    LABEL = (9, b"label")


@record
class Markers:
    """M markers of one kind, alike in the number of their points and the length of their text."""

    kind: Kind
    message: Int64
    """(M,) index of the message of each marker."""
    id: Int32
    """(M,)"""
    position: Float64
    """(M, 3) metres."""
    yaw: Float64
    """(M,) direction of the marker's x axis [rad]."""
    scale: Float64
    """(M, 3) metres, above 0."""
    colour: Float32
    """(M, 4) red, green, blue, alpha, each 0 to 1."""
    points: Float64 | None = None
    """(M, P, 2) metres, of an outline, a path or a zone."""
    text: NDArray[np.bytes_] | None = None
    """(M,) of a label, all of one length."""

    @property
    def length(self) -> int:
        """Points, or bytes of the text."""
        if self.points is not None:
            return int(self.points.shape[1])
        return 0 if self.text is None else self.text.dtype.itemsize


def marker_arrays(stamp_ns: Int64, frame: str, groups: Sequence[Markers], *, cdr: bool) -> list[bytes]:
    """Return S messages, each of which first deletes all markers of its topic and then adds its own.

    Parameters
    ----------
    stamp_ns : (S,) stamp of each message [ns]; what ROS cannot hold becomes the nearest that it can
    frame : the frame of all markers
    groups : the markers; those of a message follow each other in the order of the groups
    cdr : whether for ROS 2, else for ROS 1
    """
    messages = len(stamp_ns)
    if not messages:
        return []
    name = frame.encode("utf-8", "replace")
    forms = [(Kind.CUBE, 0, True), *((group.kind, group.length, False) for group in groups)]
    message = np.concatenate([np.arange(messages), *(group.message for group in groups)])
    form = np.repeat(np.arange(len(forms)), [messages, *(len(group.message) for group in groups)])
    order = np.argsort(message, kind="stable")
    # What begins a message lies before its first marker: in CDR also four bytes on the encoding.
    head = 8 if cdr else 4
    shifts = (0, 4) if cdr else (0,)
    layouts = [[_layout(cdr, name, *each, shift) for shift in shifts] for each in forms]
    sizes = np.array([[layout.dtype.itemsize for layout in each] for each in layouts])
    # A marker begins at a multiple of four; where it ends, hence where the next begins, does not depend on where it began,
    # for all that is not of fixed length in it comes after numbers of eight bytes.
    ends = (sizes + np.array(shifts)) % 8
    assert (ends == ends[:, :1]).all()
    spaces = -ends[:, 0] % 4 if cdr else np.zeros(len(forms), np.int64)
    here = form[order]
    is_first = here == 0
    shift = np.zeros(len(order), np.int64)
    if cdr:
        after = ((ends[:, 0] + spaces) % 8) // 4
        shift[1:] = after[here[:-1]]
        shift[is_first] = 1
    size = sizes[here, shift]
    taken = size + spaces[here] + head * is_first
    start = np.cumsum(taken) - taken
    place = start + head * is_first
    buffer = np.zeros(int(taken.sum()), np.uint8)
    counts = np.bincount(message, minlength=messages)
    heads = np.zeros((messages, head // 4), "<u4")
    if cdr:
        heads[:, 0] = 0x00000100
    heads[:, -1] = counts
    scatter(buffer, start[is_first], heads.view(f"V{head}")[:, 0])
    seconds, nanoseconds = within_ros(stamp_ns)
    for number, each in enumerate(layouts):
        own = here == number
        for half, layout in enumerate(each):
            found = np.flatnonzero(own & (shift == half))
            if not len(found):
                continue
            items = layout.filled(len(found))
            which = message[order[found]]
            items["seconds"], items["nanoseconds"] = seconds[which], nanoseconds[which]
            if number:
                # Stable sorting keeps the markers of a group in their order.
                first = int(np.searchsorted(form, number))
                _set_marker(items, groups[number - 1], order[found] - first)
            scatter(buffer, place[found], items)
    ends_at = (place + size)[np.append(np.flatnonzero(is_first)[1:] - 1, len(order) - 1)]
    whole = buffer.tobytes()
    return [whole[begin:end] for begin, end in zip(start[is_first].tolist(), ends_at.tolist(), strict=True)]


def within_ros(stamp_ns: Int64) -> tuple[Int64, Int64]:
    """Return seconds and nanoseconds; a stamp that ROS cannot hold becomes the nearest that it can."""
    seconds, nanoseconds = np.divmod(np.clip(stamp_ns, 0, LAST_SECOND * SECOND), SECOND)
    return seconds, nanoseconds


def _set_marker(items: Structured, group: Markers, rows: Int64) -> None:
    """Fill in the `rows` of a group."""
    items["id"] = group.id[rows]
    items["position"] = group.position[rows]
    items["turn"][:, 0] = np.sin(0.5 * group.yaw[rows])
    items["turn"][:, 1] = np.cos(0.5 * group.yaw[rows])
    items["scale"] = group.scale[rows]
    items["colour"] = group.colour[rows]
    if group.points is not None:
        items["points"][:, :, :2] = group.points[rows]
    if group.text is not None:
        items["text"] = group.text[rows]


@lru_cache(maxsize=4096)
def _layout(cdr: bool, frame: bytes, kind: Kind, length: int, deletes: bool, shift: int) -> MessageLayout:
    """Return a marker that begins `shift` bytes after a multiple of eight; with `deletes` it deletes all markers."""
    builder = LayoutBuilder(cdr, shift)
    if not cdr:
        builder.number("I", 0)  # Header.seq
    builder.field("seconds", "i")
    builder.field("nanoseconds", "I")
    builder.text(frame)
    number, namespace = kind.value
    builder.text(b"" if deletes else namespace)
    if deletes:
        builder.number("i", 0, number, 3)  # action: DELETEALL
        # Viewers look at these numbers in every marker: a quaternion of zeros is an error, and so is a scale of 0.
        builder.number("d", 0, 0, 0, 0, 0, 0, 1, 1, 1, 1)
        builder.number("f", 1, 1, 1, 1)
    else:
        builder.field("id", "i")
        builder.number("i", number, 0)  # action: ADD
        builder.field("position", "d", (3,))
        builder.number("d", 0, 0)
        builder.field("turn", "d", (2,))
        builder.field("scale", "d", (3,))
        builder.field("colour", "f", (4,))
    builder.number("i", 0)  # lifetime: until it is deleted
    builder.number("I", 0)
    builder.number("B", 0)  # frame_locked
    points = length if kind in (Kind.OUTLINE, Kind.PATH, Kind.ZONE) else 0
    builder.number("I", points)
    if points:
        builder.field("points", "d", (points, 3))
    builder.number("I", 0)  # colors
    if cdr:  # Members of a texture, which ROS 2 has since Humble.
        builder.text(b"")  # texture_resource
        builder.number("I", 0, 0)  # texture.header.stamp
        builder.text(b"")  # texture.header.frame_id
        builder.text(b"")  # texture.format
        builder.number("I", 0)  # texture.data
        builder.number("I", 0)  # uv_coordinates
    builder.text_field("text", length if kind is Kind.LABEL else 0)
    builder.text(b"")  # mesh_resource
    if cdr:
        builder.text(b"")  # mesh_file.filename
        builder.number("I", 0)  # mesh_file.data
    builder.number("B", 0)  # mesh_use_embedded_materials
    return builder.layout()


def transforms(stamp_ns: Int64, world: str, frame: str, pose: Float64, upside_down: Bool, *, cdr: bool) -> list[bytes]:
    """Return S messages, each with the pose of a sensor in the world.

    Parameters
    ----------
    stamp_ns : (S,) [ns]
    world, frame : parent and child
    pose : (S, 3) x, y [m], yaw [rad]
    upside_down : (S,) whether the sensor hangs head down
    cdr : whether for ROS 2, else for ROS 1
    """
    builder = LayoutBuilder(cdr)
    builder.number("I", 1)
    if not cdr:
        builder.number("I", 0)  # Header.seq
    builder.field("seconds", "i")
    builder.field("nanoseconds", "I")
    builder.text(world.encode("utf-8", "replace"))
    builder.text(frame.encode("utf-8", "replace"))
    builder.field("position", "d", (3,))
    builder.field("turn", "d", (4,))
    items = builder.layout().filled(len(stamp_ns))
    items["seconds"], items["nanoseconds"] = within_ros(stamp_ns)
    items["position"][:, :2] = pose[:, :2]
    items["turn"] = quaternions(pose[:, 2], upside_down)
    head = b"\0\1\0\0" if cdr else b""
    return [head + item.tobytes() for item in items]


def quaternions(yaw: Float64, upside_down: Bool) -> Float64:
    """Return (N, 4) x, y, z, w of turns by `yaw` (N,) [rad], of what hangs head down where `upside_down` (N,)."""
    sin, cos = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    zero = np.zeros_like(sin)
    upright = np.column_stack([zero, zero, sin, cos])
    # Turned by half a turn about its own x axis first.
    hanging = np.column_stack([cos, sin, zero, zero])
    return np.where(upside_down[:, None], hanging, upright)
