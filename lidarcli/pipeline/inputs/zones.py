"""Zone files (TOML, or YAML of Nav2), and the footprint of a robot."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.files.configfiles import Fields, read_toml
from lidarcli.pipeline.inputs.masks import mask_of, mounts_of, numbered, one_shape, shape_of
from lidarcli.pipeline.inputs.nav2_zones import LONGEST, MAX_POINTS, approach_times, read_nav2
from lidarcli.sweeps.masks import Circle, Masks, Polygon, same_name
from lidarcli.sweeps.zone import ACTIONS, COUNTS, HOLD, MIN_POINTS, SENSOR, Line, Zone, Zones, crossing_edges, on_one_line

ZONE_SHAPES = ("polygon", "circle", "line")
_APPROACH_KEYS = ("time_before_collision", "simulation_time_step")
_AREA_KEYS = ("min_points", "trigger", "hold")


def read_zones(files: Sequence[str]) -> Zones:
    """Read zone files (TOML, or YAML of Nav2) as one; each error is a line with file, table and key."""
    read = [_read(file) for file in files]
    named = [(file, each) for file, each in zip(files, read, strict=True) if each.robot]
    for file, each in named[1:]:
        if not same_name(each.robot, named[0][1].robot):
            raise OptionError(
                f"{file}: the robot is {each.robot}, in {named[0][0]} it is {named[0][1].robot}: leave one out"
            )
    owners: dict[str, str] = {}
    for file, each in zip(files, read, strict=True):
        for number, zone in enumerate(each.zones, 1):
            place = f"{file}: " if _is_yaml(file) else f"{file}: [[zone]] number {number}: "
            if not re.fullmatch(r"[A-Za-z0-9_-]+", zone.name):
                raise OptionError(f"{place}the name '{zone.name}' must be of letters, digits, _ and - only")
            if zone.name in owners:
                other = owners[zone.name]
                raise OptionError(f"{place}'{zone.name}' is there twice{'' if other == file else f', in {other} too'}")
            owners[zone.name] = file
    return Zones(
        tuple(zone for each in read for zone in each.zones),
        Masks(
            tuple(mask for each in read for mask in each.masks.masks),
            tuple(mount for each in read for mount in each.masks.mounts),
        ),
        tuple(note for each in read for note in each.notes),
        named[0][1].robot if named else "",
    )


def _is_yaml(file: str) -> bool:
    return Path(file).suffix.lower() in {".yaml", ".yml"}


def _read(file: str) -> Zones:
    if _is_yaml(file):
        return read_nav2(file)
    top = Fields(file, "the file", read_toml(file, "zone file"))
    zones, masks, mounts = (numbered(top, kind) for kind in ("zone", "mask", "mount"))
    top.done()
    if not zones:
        raise OptionError(f"{file}: no [[zone]] in this file")
    return Zones(tuple(map(_zone, zones)), Masks(tuple(map(mask_of, masks)), mounts_of(mounts)))


def _zone(fields: Fields) -> Zone:
    fields.has(*ZONE_SHAPES, "name", "frame", "topic", "action", "count", *_AREA_KEYS, *_APPROACH_KEYS)
    fields.done()
    shape = one_shape(fields, "zone", ZONE_SHAPES)
    action = fields.text("action", "none", ACTIONS)
    if shape == "line":
        if action == "approach":
            fields.fail("action", "cannot be approach with a line, which has no inside")
        for key in _AREA_KEYS:
            if fields.has(key):
                fields.fail(key, "and 'line' exclude each other: paths that cross a line count, not points")
    if action != "approach":
        for key in _APPROACH_KEYS:
            if fields.has(key):
                fields.fail(key, f"is for action approach, not {action}")
    ahead, step = approach_times(fields)
    return Zone(
        name=fields.text("name"),
        shape=_line(fields) if shape == "line" else _area(fields, shape),
        frame=fields.text("frame", SENSOR),
        action=action,  # type: ignore[arg-type]
        count=fields.text("count", COUNTS[0], COUNTS),  # type: ignore[arg-type]
        min_points=fields.whole("min_points", MIN_POINTS, low=1, high=MAX_POINTS),
        trigger=fields.whole("trigger", 1, low=1, high=MAX_POINTS),
        hold=fields.number("hold", HOLD, low=0, high=LONGEST),
        topics=(fields.text("topic"),) if fields.has("topic") else (),
        time_before_collision=ahead,
        time_step=step,
    )


def _area(fields: Fields, kind: str) -> Circle | Polygon:
    shape = shape_of(fields, kind)
    assert isinstance(shape, Circle | Polygon)
    if isinstance(shape, Polygon):
        if on_one_line(shape):
            fields.fail(kind, "has no area: its corners lie on one line")
        if (crossing := crossing_edges(shape)) is not None:
            first, second = crossing
            count = len(shape.corners)
            fields.fail(
                kind,
                f"crosses itself: the edges from corner {first} to {first % count + 1} and from {second} to "
                f"{second % count + 1}",
            )
    return shape


def _line(fields: Fields) -> Line:
    points = fields.points("line", 2)
    if len(points) != 2:
        fields.fail("line", f"must be two points, not {len(points)}")
    (x, y), (other_x, other_y) = points
    if (x, y) == (other_x, other_y):
        fields.fail("line", "has no length: both points are the same")
    return Line((x, y), (other_x, other_y))


def parse_footprint(value: str | Sequence[Sequence[float]]) -> Polygon:
    """Return the polygon of points (K, 2) [m], or of a text such as [[x, y], ...]."""
    if not isinstance(value, str | Sequence | np.ndarray):
        raise TypeError(f"footprint is [[x, y], ...] or such a text, not {type(value).__name__}")
    try:
        points: Any = ast.literal_eval(value) if isinstance(value, str) else value
        corners = tuple((float(x), float(y)) for x, y in points)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise OptionError(f"--footprint: '{value}' is not [[x, y], ...]") from None
    if len(corners) < 3:
        raise OptionError(f"--footprint: '{value}' has fewer than 3 corners")
    if not np.isfinite(corners).all():
        raise OptionError(f"--footprint: '{value}' has numbers that are not finite")
    shape = Polygon(corners)
    if on_one_line(shape):
        raise OptionError(f"--footprint: '{value}' has no area: its corners lie on one line")
    if crossing_edges(shape) is not None:
        raise OptionError(f"--footprint: '{value}' crosses itself")
    return shape
