"""Mask files (TOML): read, and written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.files.configfiles import Fields, read_toml
from lidarcli.sweeps.masks import Circle, Mask, Masks, Mount, Polygon, Sector, Shape
from lidarcli.sweeps.range_rules import FARTHEST

AUTO = "auto"
"""In place of a file: learn the mask from each log."""
MOST = 1000
"""Most tables of each kind."""
MAX_CORNERS = 100
MASK_SHAPES = ("circle", "polygon", "sector")
DECIMALS = 6
"""Of what is written: micrometres, and far less than the step between two beams."""


def read_masks(file: str) -> Masks:
    """Read a mask file; what is wrong with it is one line with file, table and key (`OptionError`, `UnreadableError`)."""
    return replace(masks_of(file, read_toml(file, "mask")), path=file)


def masks_of(file: str, tables: Mapping[str, Any]) -> Masks:
    """Return the masks of the tables of a file; errors as of `read_masks`."""
    top = Fields(file, "the file", tables)
    masks, mounts = numbered(top, "mask"), numbered(top, "mount")
    top.done()
    if not (masks or mounts):
        raise OptionError(f"{file}: no [[mask]] in this file")
    return Masks(tuple(map(mask_of, masks)), mounts_of(mounts))


def numbered(top: Fields, kind: str) -> list[Fields]:
    """Return the tables [[kind]] of a file, none where it has none."""
    if not top.has(kind):
        return []
    return [
        Fields(top.file, f"[[{kind}]] number {number}", item) for number, item in enumerate(top.items(kind, 0, MOST), 1)
    ]


def mask_of(fields: Fields) -> Mask:
    """Return the mask of a table [[mask]]."""
    fields.has(*MASK_SHAPES, "topic", "frame")
    fields.done()
    shape = one_shape(fields, "mask", MASK_SHAPES)
    topic = fields.text("topic") if fields.has("topic") else ""
    frame = fields.text("frame") if fields.has("frame") else ""
    if frame and shape == "sector":
        fields.fail("frame", "and 'sector' exclude each other: its bearings are those of the sensor")
    return Mask(shape_of(fields, shape), topic, frame)


def one_shape(fields: Fields, what: str, shapes: Sequence[str]) -> str:
    """Return the one shape that a table has; refuse one that has none, or two."""
    given = [shape for shape in shapes if fields.has(shape)]
    if not given:
        fields.fail(shapes[0], f"is missing: a {what} is a {', '.join(shapes[:-1])} or {shapes[-1]}")
    if len(given) > 1:
        fields.fail(given[1], f"and '{given[0]}' exclude each other: a {what} has one shape")
    return given[0]


def shape_of(fields: Fields, kind: str) -> Shape:
    """Return the shape of a key of `MASK_SHAPES`."""
    if kind == "polygon":
        corners = fields.points(kind, 3)
        if len(corners) > MAX_CORNERS:
            fields.fail(kind, f"has more than {MAX_CORNERS:,} corners")
        return Polygon(tuple((x, y) for x, y in corners))
    inner = fields.table(kind)
    if kind == "circle":
        shape: Shape = Circle(inner.number("x"), inner.number("y"), inner.number("radius", above=0))
    else:
        begin, end = (inner.number(key, low=-360, high=360) for key in ("from", "to"))
        nearest = inner.number("nearest", 0.0, low=0)
        farthest = inner.number("farthest", FARTHEST, low=nearest)
        shape = Sector(math.radians(begin), math.radians(end), nearest, farthest)
    inner.done()
    return shape


def mounts_of(tables: Sequence[Fields]) -> tuple[Mount, ...]:
    """Return the places of the tables [[mount]] of a file; refuse mounts that lead back to where they began."""
    mounts = tuple(map(_mount, tables))
    left = dict(enumerate((mount.frame.lstrip("/"), mount.parent.lstrip("/")) for mount in mounts))
    # What leads to a frame without a mount is in no circle.
    before = len(left) + 1
    while len(left) < before:
        before, frames = len(left), {frame for frame, _ in left.values()}
        left = {number: pair for number, pair in left.items() if pair[1] in frames}
    for number in left:
        tables[number].fail("parent", f"leads back to where it began, by the frames {', '.join(sorted(frames))}")
    return mounts


def _mount(fields: Fields) -> Mount:
    """Return the place of a table [[mount]]."""
    mount = Mount(
        fields.text("frame"),
        fields.text("parent"),
        fields.number("x", 0.0),
        fields.number("y", 0.0),
        math.radians(fields.number("yaw", 0.0, low=-360, high=360)),
        fields.flag("upside_down", False),
    )
    fields.done()
    return mount


def plain(masks: Masks) -> dict[str, list[dict[str, Any]]]:
    """Return the tables of a file of these masks, for the metadata of tables."""
    tables = {
        "mask": [_mask_table(mask) for mask in masks.masks],
        "mount": [
            {
                "frame": mount.frame,
                "parent": mount.parent,
                "x": round(mount.x, DECIMALS),
                "y": round(mount.y, DECIMALS),
                "yaw": round(math.degrees(mount.yaw), DECIMALS),
                **({"upside_down": True} if mount.upside_down else {}),
            }
            for mount in masks.mounts
        ],
    }
    return {kind: table for kind, table in tables.items() if table}


def _mask_table(mask: Mask) -> dict[str, Any]:
    names = {name: value for name in ("topic", "frame") if (value := getattr(mask, name))}
    match mask.shape:
        case Circle(x, y, radius):
            return names | {"circle": {"x": round(x, DECIMALS), "y": round(y, DECIMALS), "radius": round(radius, DECIMALS)}}
        case Polygon(corners):
            return names | {"polygon": [[round(x, DECIMALS), round(y, DECIMALS)] for x, y in corners]}
        case Sector(begin, end, nearest, farthest):
            table = {"from": math.degrees(begin), "to": math.degrees(end), "nearest": nearest, "farthest": farthest}
            return names | {"sector": {key: round(value, DECIMALS) for key, value in table.items()}}


def mask_text(masks: Masks, proposed: Masks) -> str:
    """Return the text of a mask file, empty without a mask and a mount; proposed masks are comments in it."""
    tables = plain(masks)
    blocks = [_block("mask", table, "") for table in tables.get("mask", [])]
    if proposed.masks:
        head = "# The sensor stood: what follows looks like the robot itself. Remove the # where it is.\n"
        blocks += [head, *(_block("mask", table, "# ") for table in plain(proposed)["mask"])]
    blocks += [_block("mount", table, "") for table in tables.get("mount", [])]
    return "\n".join(blocks)


def _block(kind: str, table: Mapping[str, Any], comment: str) -> str:
    lines = [f"[[{kind}]]", *(f"{key} = {_value(value)}" for key, value in table.items())]
    return "".join(f"{comment}{line}\n" for line in lines)


def _value(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_value(one)}' for key, one in value.items())} }}"
    # Lists, numbers and texts look the same in JSON, but for a character that only TOML has to escape.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
