"""Mask files: TOML → `Masks` and back; docs/formats.md lists the keys."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from lidarcli.configfiles import Fields, read_toml
from lidarcli.errors import OptionError
from lidarcli.masks import CLOSE, Circle, Mask, Masks, Mount, Polygon, Sector, Shape, same_name
from lidarcli.range_rules import FARTHEST
from lidarcli.sweeps import TURN

AUTO = "auto"
"""In place of a file: learn the mask from each log."""
MOST = 1000
"""Most tables of each kind."""
MOST_CORNERS = 100
SHAPES = ("circle", "polygon", "sector")
DECIMALS = 6
"""Of what is written: micrometres, and far less than the step between two beams."""


def read_masks(file: str) -> Masks:
    """Read a mask file; what is wrong with it is one line with file, table and key (`OptionError`, `UnreadableError`)."""
    return replace(masks_of(file, read_toml(file, "mask")), path=file)


def masks_of(file: str, tables: Mapping[str, Any]) -> Masks:
    """Return the masks that the tables of a file tell; errors as of `read_masks`."""
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
    """Return the mask that a table [[mask]] tells."""
    given = [shape for shape in SHAPES if fields.has(shape)]
    fields.has("topic", "frame")
    fields.done()
    refuse_shapes(fields, "mask", SHAPES, given)
    topic = fields.text("topic") if fields.has("topic") else ""
    frame = fields.text("frame") if fields.has("frame") else ""
    if frame and given == ["sector"]:
        fields.fail("frame", "and 'sector' exclude each other: its bearings are those of the sensor")
    return Mask(shape_of(fields, given[0]), topic, frame)


def refuse_shapes(fields: Fields, what: str, shapes: Sequence[str], given: Sequence[str]) -> None:
    """Refuse a table that has no shape, or two."""
    if len(given) != 1:
        fields.fail(
            given[1] if given else shapes[0],
            f"and '{given[0]}' exclude each other: a {what} has one shape"
            if given
            else f"is missing: a {what} is a {', '.join(shapes[:-1])} or {shapes[-1]}",
        )


def shape_of(fields: Fields, kind: str) -> Shape:
    """Return the shape that a key of `SHAPES` tells."""
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


def mounts_of(tables: Sequence[Fields]) -> tuple[Mount, ...]:
    """Return the places that the tables [[mount]] of a file tell; refuse mounts that lead back to where they began."""
    mounts = tuple(map(_mount, tables))
    left = dict(enumerate((mount.frame.lstrip("/"), mount.parent.lstrip("/")) for mount in mounts))
    # What leads to a frame without a mount is in no circle.
    before = len(left) + 1
    while len(left) < before:
        before, frames = len(left), {frame for frame, _ in left.values()}
        left = {number: pair for number, pair in left.items() if pair[1] in frames}
    if left:
        parents = {frame: (parent, number) for number, (frame, parent) in left.items()}
        here = next(iter(parents))
        chain: list[str] = []
        while here not in chain:
            chain.append(here)
            here = parents[here][0]
        circle = " > ".join([*chain[chain.index(here) :], here])
        tables[parents[here][1]].fail("parent", f"leads back to the frame itself: {circle}")
    return mounts


def _mount(fields: Fields) -> Mount:
    """Return the place that a table [[mount]] tells."""
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
    return {kind: table for kind, table in tables.items() if table}


def _mask_table(mask: Mask) -> dict[str, Any]:
    names = {name: value for name in ("topic", "frame") if (value := getattr(mask, name))}
    match mask.shape:
        case Circle(x, y, radius):
            return names | {"circle": {"x": _short(x), "y": _short(y), "radius": _short(radius)}}
        case Polygon(corners):
            return names | {"polygon": [[_short(x), _short(y)] for x, y in corners]}
        case Sector(begin, end, nearest, farthest):
            table = {"from": math.degrees(begin), "to": math.degrees(end), "nearest": nearest, "farthest": farthest}
            return names | {"sector": {key: _short(value) for key, value in table.items()}}


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


def _short(value: float) -> float:
    return round(value, DECIMALS)


NODE = "scan_to_scan_filter_chain"
"""Program of laser_filters, and the name of its node."""


class View(NamedTuple):
    """Bearings of the beams of a topic, from the least to the greatest [rad]."""

    topic: str
    low: float
    high: float


def filter_text(masks: Masks, views: Sequence[View]) -> str:
    """Return the parameters of a node for each topic with a mask, as YAML (`OptionError` for masks that are no sectors)."""
    chains = {}
    for view in views:
        mine = [mask.shape for mask in masks.masks if not mask.topic or same_name(mask.topic, view.topic)]
        if filters := [each for shape in mine for each in _filters(shape, view)]:
            chains[view.topic] = filters
    blocks = []
    for topic, filters in chains.items():
        node = NODE if len(chains) == 1 else f"{re.sub('[^0-9A-Za-z]+', '_', topic).strip('_')}_filter_chain"
        named = "" if len(chains) == 1 else f" -r __node:={node}"
        lines = [
            f"# ros2 run laser_filters {NODE} --ros-args -r scan:={topic}{named} --params-file FILE",
            f"{node}:",
            "  ros__parameters:",
        ]
        for number, parameters in enumerate(filters, 1):
            lines += [
                f"    filter{number}:",
                f"      name: mask{number}",
                "      type: laser_filters/LaserScanSectorFilter",
                "      params:",
                *(f"        {key}: {value}" for key, value in parameters.items()),
            ]
        blocks.append("".join(f"{line}\n" for line in lines))
    return "\n".join(blocks)


def _filters(shape: object, view: View) -> Iterator[dict[str, str]]:
    """Yield the parameters of the filters for one mask of a sensor."""
    if not isinstance(shape, Sector):
        raise OptionError("laser_filters takes sectors of bearings; write other masks to a .toml file")
    width = shape.end - shape.begin if 0.0 <= shape.end - shape.begin <= TURN else (shape.end - shape.begin) % TURN
    # A filter knows nothing of turns; a mask and a sensor may count their bearings from different ones.
    first = shape.begin + TURN * np.ceil((view.low - shape.begin - width - CLOSE) / TURN)
    while first <= view.high + CLOSE:
        # A filter takes what lies between its limits, and a mask these, too.
        yield {
            "angle_min": f"{first - CLOSE:.10f}",
            "angle_max": f"{first + width + CLOSE:.10f}",
            "range_min": _beyond(shape.nearest, -np.inf),
            "range_max": _beyond(shape.farthest, np.inf),
        }
        first += TURN


def _beyond(edge: float, side: float) -> str:
    """Return a limit between a range [m] and the next float32 to a side."""
    value = np.float32(edge)
    return f"{0.5 * (float(value) + float(np.nextafter(value, np.float32(side)))):#.10g}"
