"""Mask files: TOML → `Masks` and back; docs/formats.md lists the keys."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.masks import Circle, Mask, Masks, Mount, Polygon, Sector, Shape
from lidarcli.range_rules import FARTHEST
from lidarcli.tomlfiles import Fields, read_toml

AUTO = "auto"
"""In place of a file: learn the mask from each log."""
MOST = 1000
"""Most tables of each kind."""
MOST_CORNERS = 100
SHAPES = ("circle", "polygon", "sector")
DECIMALS = 6
"""Of what is written: micrometres, and far less than the step between two beams."""


def read_masks(file: str) -> Masks:
    """Read a mask file; whatever is wrong with it is one line that names the file, the table and the key.

    Raises
    ------
    UnreadableError
        There is no such file, or it is no TOML.
    OptionError
        A table does not say what is masked, or where something is mounted.
    """
    return replace(masks_of(file, read_toml(file, "mask")), path=file)


def masks_of(file: str, tables: Mapping[str, Any]) -> Masks:
    """Return the masks that the tables of a file tell; errors as of `read_masks`."""
    top = Fields(file, "the file", tables)
    found: dict[str, list[Fields]] = {"mask": [], "mount": []}
    for kind, tables_of in found.items():
        if top.has(kind):
            tables_of += [
                Fields(file, f"[[{kind}]] number {number}", item)
                for number, item in enumerate(top.items(kind, 0, MOST), 1)
            ]
    top.done()
    if not found["mask"]:
        raise OptionError(f"{file}: no [[mask]] in this file")
    return Masks(tuple(map(_mask, found["mask"])), tuple(map(_mount, found["mount"])))


def _mask(fields: Fields) -> Mask:
    given = [shape for shape in SHAPES if fields.has(shape)]
    fields.has("topic", "frame")
    fields.done()
    if len(given) != 1:
        fields.fail(
            given[1] if given else SHAPES[0],
            f"and '{given[0]}' exclude each other: a mask has one shape"
            if given
            else f"is missing: a mask is a {', '.join(SHAPES[:-1])} or {SHAPES[-1]}",
        )
    topic = fields.text("topic") if fields.has("topic") else ""
    frame = fields.text("frame") if fields.has("frame") else ""
    if frame and given == ["sector"]:
        fields.fail("frame", "and 'sector' exclude each other: its bearings are those of the sensor")
    return Mask(_shape(fields, given[0]), topic, frame)


def _shape(fields: Fields, kind: str) -> Shape:
    if kind == "polygon":
        corners = fields.points(kind, 3)
        if len(corners) > MOST_CORNERS:
            fields.fail(kind, f"has more than {MOST_CORNERS:,} corners")
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


def _mount(fields: Fields) -> Mount:
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
    """Return the tables of a file that tells these masks, for the metadata of tables."""
    tables = {
        "mask": [_mask_table(mask) for mask in masks.masks],
        "mount": [
            {
                "frame": mount.frame,
                "parent": mount.parent,
                "x": _short(mount.x),
                "y": _short(mount.y),
                "yaw": _short(math.degrees(mount.yaw)),
                **({"upside_down": True} if mount.upside_down else {}),
            }
            for mount in masks.mounts
        ],
    }
    return {kind: told for kind, told in tables.items() if told}


def _mask_table(mask: Mask) -> dict[str, Any]:
    names = {name: value for name in ("topic", "frame") if (value := getattr(mask, name))}
    match mask.shape:
        case Circle(x, y, radius):
            return names | {"circle": {"x": _short(x), "y": _short(y), "radius": _short(radius)}}
        case Polygon(corners):
            return names | {"polygon": [[_short(x), _short(y)] for x, y in corners]}
        case Sector(begin, end, nearest, farthest):
            told = {
                "from": math.degrees(begin),
                "to": math.degrees(end),
                "nearest": nearest,
                "farthest": farthest,
            }
            return names | {"sector": {key: _short(value) for key, value in told.items()}}


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
    # Lists, numbers and texts look the same in JSON.
    return json.dumps(value, ensure_ascii=False)


def _short(value: float) -> float:
    return round(value, DECIMALS)
