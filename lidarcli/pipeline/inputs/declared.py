"""Files that users write: masks, zones and catalogues in TOML, and zones in parameters of Nav2; masks are also written."""

from __future__ import annotations

import ast
import json
import math
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import count
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lidarcli.display.texts import clipped, visible
from lidarcli.errors import OptionError
from lidarcli.files.configfiles import LARGEST, MAX_DEPTH, Fields, read_toml, read_yaml
from lidarcli.formalism.detection import MAX_INTENSITY
from lidarcli.formalism.matching.catalogue import KINDS as THING_SHAPES
from lidarcli.formalism.matching.catalogue import Catalogue, Thing
from lidarcli.sweeps.masks import CLOSE, Circle, Mask, Masks, Mount, Polygon, Sector, Shape, same_name
from lidarcli.sweeps.range_rules import FARTHEST
from lidarcli.sweeps.types import TURN
from lidarcli.sweeps.zone import (
    ACTIONS,
    COUNTS,
    HOLD,
    MIN_POINTS,
    ROBOT,
    SENSOR,
    TIME_BEFORE_COLLISION,
    TIME_STEP,
    TIMEOUT,
    Case,
    Line,
    Zone,
    Zones,
    crossing_edges,
    on_one_line,
)

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
    fields.has(*MASK_SHAPES, "topic", "frame")
    fields.done()
    shape = _shape_key(fields, "mask", MASK_SHAPES)
    topic = fields.text("topic") if fields.has("topic") else ""
    frame = fields.text("frame") if fields.has("frame") else ""
    if frame and shape == "sector":
        fields.fail("frame", "and 'sector' exclude each other: its bearings are those of the sensor")
    return Mask(shape_of(fields, shape), topic, frame)


def _shape_key(fields: Fields, what: str, shapes: Sequence[str]) -> str:
    """Return the one shape that a table has; refuse one that has none, or two."""
    given = [shape for shape in shapes if fields.has(shape)]
    if not given:
        fields.fail(shapes[0], f"is missing: a {what} is a {', '.join(shapes[:-1])} or {shapes[-1]}")
    if len(given) > 1:
        fields.fail(given[1], f"and '{given[0]}' exclude each other: a {what} has one shape")
    return given[0]


def shape_of(fields: Fields, kind: str) -> Shape:
    """Return the shape that a key of `MASK_SHAPES` tells."""
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
    """Return the places that the tables [[mount]] of a file tell; refuse mounts that lead back to where they began."""
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
    blocks: dict[str, str] = {}
    for topic, filters in chains.items():
        stem = re.sub("[^0-9A-Za-z]+", "_", topic).strip("_")
        several = (f"{stem}{'_' * bool(n)}{n or ''}_filter_chain" for n in count())
        node = NODE if len(chains) == 1 else next(name for name in several if name not in blocks)
        named = "" if len(chains) == 1 else f" -r __node:={node}"
        remap = shlex.quote(visible(f"scan:={topic}"))
        lines = [
            f"# ros2 run laser_filters {NODE} --ros-args -r {remap}{named} --params-file FILE",
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
        blocks[node] = "".join(f"{line}\n" for line in lines)
    return "\n".join(blocks.values())


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


MAX_POINTS = 1_000_000
"""Greatest number of points or sweeps that a zone asks for."""
LONGEST = 3600.0
"""Greatest time that a zone tells [s]."""
MAX_STEPS = 1000
"""Most times that `approach` tests."""
_PARAMETERS = "ros__parameters"
_SCAN = "scan"
_SOURCES = (_SCAN, "pointcloud", "range", "polygon", "costmap")
_MIN_CORNERS, _MIN_EXCLUDED = 4, 3
_ALL_NODES = ("**",)
_POINTS = re.compile(r"\s*\[(?:[\s,]*\[[^\[\]]*\])*[\s,]*\]\s*")
_POINT = re.compile(r"\[([^\[\]]*)\]")

_Named = tuple[tuple[str, ...], Any]
"""Names that lead to a node, and its parameters."""


@dataclass(slots=True)
class _Node:
    """A node that watches polygons."""

    fields: Fields
    namespace: str
    """Empty, or `/name`."""
    robot: str
    notes: list[str]
    sources: dict[str, tuple[str, float] | None]
    """Name → topic and timeout [s] of its scans; None for a source that is not read."""
    masks: list[Mask]
    footprint: Callable[[], Polygon | None]
    """Returns that of a costmap."""

    def topic(self, name: str) -> str:
        """Return the full name of a topic."""
        return name if name.startswith("/") else f"{self.namespace}/{name}"


def read_nav2(file: str) -> Zones:
    """Read the zones of every node that has `polygons`; exclusion zones are masks. Errors are as of `read_zones`."""
    zones: list[Zone] = []
    masks: list[Mask] = []
    notes: list[str] = []
    robot = ""
    nodes = [*_nodes(file, read_yaml(file, "zone file"))]
    for path, parameters in _monitors(nodes):
        fields = Fields(file, "/".join(path) or "the file", parameters)
        base = fields.text("base_frame_id", "base_footprint")
        if robot and not same_name(robot, base):
            fields.fail("base_frame_id", f"is {base}, of another node {robot}: leave one out")
        robot = robot or base
        namespace = "".join(f"/{name}" for name in [name for name in path if "*" not in name][:-1])
        node = _Node(fields, namespace, base, notes, {}, masks, partial(_footprint, file, nodes, path[:-1]))
        _read_sources(node)
        zones += _zones(node)
    if not robot:
        raise OptionError(f"{file}: no node with {_PARAMETERS} that has 'polygons': no zones of Nav2")
    if not zones:
        raise OptionError(f"{file}: none of the polygons can be judged: {'; '.join(notes)}")
    return Zones(tuple(zones), Masks(tuple(masks)), tuple(f"{file}: {note}" for note in notes), robot)


def approach_times(fields: Fields) -> tuple[float, float]:
    """Return how far ahead `approach` looks, and in which steps [s]."""
    ahead = fields.number("time_before_collision", TIME_BEFORE_COLLISION, low=0, high=LONGEST)
    step = fields.number("simulation_time_step", TIME_STEP, above=0, high=LONGEST)
    if ahead > MAX_STEPS * step:
        fields.fail(
            "simulation_time_step", f"must be at least {ahead / MAX_STEPS:g}: no more than {MAX_STEPS:,} times are tested"
        )
    return ahead, step


def _nodes(file: str, values: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[_Named]:
    """Yield the parameters of nodes, wherever they are, with the names that lead to them."""
    for name, value in values.items():
        if not isinstance(value, dict):
            continue
        if name == _PARAMETERS:
            parameters: dict[str, Any] = {}
            _put(file, parameters, value)
            yield tuple(part for part in "/".join(path).split("/") if part), parameters
        else:
            yield from _nodes(file, value, (*path, name))


def _put(file: str, table: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Put parameters into a table: in a name, a dot leads into a table inside, as for ROS."""
    for name, value in values.items():
        *outer, last = name.split(".", MAX_DEPTH)
        inner = table
        for part in [*outer, *([last] if isinstance(value, dict) else [])]:
            inner = inner.setdefault(part, {})
            if not isinstance(inner, dict):
                raise OptionError(f"{file}: parameter '{clipped(part)}' is a value and has others inside")
        if isinstance(value, dict):
            _put(file, inner, value)
        elif inner.setdefault(last, value) is not value:
            raise OptionError(f"{file}: parameter '{clipped(name)}' is there twice, with a dot and without")


def _inside(fields: Fields, name: str) -> Fields:
    """Return the table of a name, which `_put` has put where its dots lead."""
    return reduce(Fields.table, name.split(".", MAX_DEPTH), fields)


def _monitors(nodes: Sequence[_Named]) -> Iterator[_Named]:
    """Yield the parameters of nodes that watch polygons; those of `/**` count where a node tells nothing.

    `/**` is a node of its own where no other one has polygons.
    """
    shared: dict[str, Any] = {}
    for path, parameters in nodes:
        if path == _ALL_NODES:
            shared |= parameters
    found = [
        (path, shared | parameters)
        for path, parameters in nodes
        if path != _ALL_NODES and not parameters.keys().isdisjoint({"polygons", "observation_sources"})
    ]
    yield from [each for each in found if "polygons" in each[1]] or ([(_ALL_NODES, shared)] if "polygons" in shared else [])


def _footprint(file: str, nodes: Sequence[_Named], namespace: tuple[str, ...]) -> Polygon | None:
    """Return the padded footprint of a costmap of one namespace, as Nav2 publishes it; None where no costmap tells it."""
    for name in ("local_costmap", "global_costmap"):
        for path, parameters in nodes:
            if path[-1:] != (name,) or (path[: len(namespace)] != namespace and "**" not in {*path, *namespace}):
                continue
            fields = Fields(file, "/".join(path), parameters)
            padding = fields.number("footprint_padding", 0.01)
            if parameters.get("footprint") not in (None, "", "[]"):
                corners = np.array(_polygon(fields, _MIN_EXCLUDED, "footprint").corners)
            elif fields.has("robot_radius"):
                angles = np.arange(16) * 2 * math.pi / 16
                corners = fields.number("robot_radius", above=0) * np.column_stack([np.cos(angles), np.sin(angles)])
            else:
                continue
            return Polygon(tuple((float(x), float(y)) for x, y in corners + padding * np.sign(corners)))
    return None


def _read_sources(node: _Node) -> None:
    """Read what the node observes."""
    fields = node.fields
    if not fields.has("observation_sources"):
        node.notes.append("no observation_sources: every scan topic counts")
        return
    timeout = _timeout(fields)
    unread = []
    for name in _names(fields, "observation_sources"):
        source = _inside(fields, name)
        kind = source.text("type", _SCAN, _SOURCES)
        node.sources[name] = None
        if not source.flag("enabled", True):
            node.notes.append(f"source {name} is not enabled: it does not count")
        elif kind != _SCAN:
            unread.append(f"{name} ({kind})")
        else:
            topic = node.topic(source.text("topic", "scan"))
            node.sources[name] = (topic, source.number("source_timeout", timeout, low=0, high=LONGEST))
            _read_exclusions(node, source, topic)
    if unread:
        node.notes.append(f"only scans are read, not {', '.join(unread)}: the list of events is incomplete")


def _read_exclusions(node: _Node, source: Fields, topic: str) -> None:
    """Read the areas in which the points of a source do not count."""
    if not source.has("exclusion_zones"):
        return
    for name in _names(source, "exclusion_zones"):
        fields = _inside(node.fields, name)
        kind = fields.text("type", "polygon", ("polygon", "circle"))
        shape = Circle(0.0, 0.0, fields.number("radius", above=0)) if kind == "circle" else _polygon(fields, _MIN_EXCLUDED)
        if not fields.flag("enabled", False):
            node.notes.append(f"exclusion zone {name} is not enabled, which is the default: its points count")
            continue
        if fields.has("min_height", "max_height"):
            node.notes.append(f"exclusion zone {name} has heights, which are not used: it is taken at every height")
        frame = fields.values.get("frame_id") or node.robot
        if not isinstance(frame, str):
            fields.fail("frame_id", "must be a text")
        node.masks.append(Mask(shape, topic, ROBOT if same_name(frame, node.robot) else frame))


def _zones(node: _Node) -> Iterator[Zone]:
    """Yield the zones of a node that can be judged."""
    fields = node.fields
    working = fields.flag("enabled", True)
    if not working:
        node.notes.append(f"{fields.place} is not enabled: its polygons are not judged")
    for name in _names(fields, "polygons"):
        polygon = _inside(fields, name)
        zone = _nav2_zone(node, polygon, name)
        if not polygon.flag("enabled", True):
            node.notes.append(f"{name} is not enabled: it is not judged")
        elif node.sources and not zone.topics:
            node.notes.append(f"{name} has no source of scans: it is not judged")
        elif working:
            yield zone


def _nav2_zone(node: _Node, polygon: Fields, name: str) -> Zone:
    kind = polygon.text("type", None, ("polygon", "circle", "velocity_polygon"))
    action = polygon.text("action_type", None, ACTIONS)
    shape: Circle | Polygon | None = None
    cases: tuple[Case, ...] = ()
    shape_topic = ""
    if kind == "circle":
        shape = Circle(0.0, 0.0, polygon.number("radius", above=0))
    elif kind == "velocity_polygon":
        cases = tuple(_cases(node, polygon, name))
    elif polygon.has("points"):
        shape = _polygon(polygon, _MIN_CORNERS)
        _note_crossing(node, name, shape)
    elif action == "approach":
        shape_topic = polygon.text("footprint_topic", "local_costmap/published_footprint")
    elif polygon.has("polygon_sub_topic"):
        shape_topic = polygon.text("polygon_sub_topic")
    else:
        polygon.fail("points", "is missing, and so is 'polygon_sub_topic'")
    ahead, step = approach_times(polygon) if action == "approach" else (TIME_BEFORE_COLLISION, TIME_STEP)
    topics, timeout = _topics(node, polygon, name)
    # `approach` has no delay.
    trigger, release = (
        1 if action == "approach" else polygon.whole(f"{kind}_consecutive_points", 1, low=1, high=MAX_POINTS)
        for kind in ("trigger", "release")
    )
    least = polygon.whole("min_points", MIN_POINTS, low=1, high=MAX_POINTS)
    if polygon.has("max_points"):
        least = polygon.whole("max_points", low=0, high=MAX_POINTS) + 1
    return Zone(
        name=name,
        shape=shape,
        frame=ROBOT,
        action=action,  # type: ignore[arg-type]
        min_points=least,
        trigger=trigger,
        release=release,
        topics=topics,
        timeout=timeout,
        cases=cases,
        shape_topic=shape_topic and node.topic(shape_topic),
        footprint=node.footprint() if shape_topic and action == "approach" else None,
        velocity_topic=node.topic(node.fields.text("cmd_vel_in_topic", "cmd_vel_smoothed")),
        time_before_collision=ahead,
        time_step=step,
    )


def _topics(node: _Node, polygon: Fields, name: str) -> tuple[tuple[str, ...], float]:
    """Return the scan topics of a polygon, and from which age on their sweeps do not count [s]."""
    names = _names(polygon, "sources_names") if polygon.has("sources_names") else list(node.sources)
    if node.sources and (unknown := [each for each in names if each not in node.sources]):
        polygon.fail("sources_names", f"has '{unknown[0]}', which is not in observation_sources")
    sources = [source for each in names if (source := node.sources.get(each)) is not None]
    topics = tuple(dict.fromkeys(topic for topic, _ in sources))
    timeouts = sorted({timeout or math.inf for _, timeout in sources} or {_timeout(node.fields)})
    if len(timeouts) > 1 and polygon.flag("enabled", True):
        node.notes.append(
            f"{name}: the shortest source_timeout of its sources, {timeouts[0]:g} s, is taken for all of them"
        )
    return topics, timeouts[0] if math.isfinite(timeouts[0]) else 0.0


def _timeout(fields: Fields) -> float:
    return fields.number("source_timeout", TIMEOUT, low=0, high=LONGEST)


def _cases(node: _Node, polygon: Fields, name: str) -> Iterator[Case]:
    """Yield the polygons of a velocity polygon."""
    holonomic = polygon.flag("holonomic", False)
    for case in _names(polygon, "velocity_polygons"):
        fields = _inside(polygon, case)
        shape = _polygon(fields, _MIN_CORNERS)
        _note_crossing(node, f"{name}.{case}", shape)
        direction = None
        if holonomic:
            direction = (fields.number("direction_start_angle", -math.pi), fields.number("direction_end_angle", math.pi))
        linear = fields.number("linear_min"), fields.number("linear_max")
        yield Case(case, shape, linear, (fields.number("theta_min"), fields.number("theta_max")), direction)


def _note_crossing(node: _Node, name: str, shape: Polygon) -> None:
    if (crossing := crossing_edges(shape)) is not None:
        node.notes.append(
            f"{name} crosses or touches itself (edges {crossing[0]} and {crossing[1]}): only what the even-odd "
            "rule calls inside counts, as in Nav2"
        )


def _names(fields: Fields, key: str) -> list[str]:
    """Return a list of names."""
    names = [str(name) for name in fields.items(key, 1, MOST) if isinstance(name, str) and name]
    if len(names) < len(fields.items(key, 1, MOST)):
        fields.fail(key, "must be a list of names")
    return names


def _polygon(fields: Fields, least: int, key: str = "points") -> Polygon:
    """Return the polygon of a key, a text "[[x, y], ...]", each number rounded to a float32 as Nav2 does."""
    text = fields.values.get(key)
    if not isinstance(text, str):
        fields.fail(key, 'must be a text as "[[0.5, 0.3], [0.5, -0.3], [0.0, -0.3], [0.0, 0.3]]"')
    corners = []
    for corner in _POINT.findall(text) if _POINTS.fullmatch(text) else [""]:
        try:
            x, y = (float(np.float32(part)) for part in corner.replace(",", " ").split())
        except ValueError:
            fields.fail(key, 'must be pairs of numbers as "[[0.5, 0.3], [0.5, -0.3], ...]"')
        if not (abs(x) <= LARGEST and abs(y) <= LARGEST):
            fields.fail(key, f"must hold finite numbers between {-LARGEST:g} and {LARGEST:g}")
        corners.append((x, y))
    if not least <= len(corners) <= MAX_CORNERS:
        fields.fail(key, f"must be {least} to {MAX_CORNERS} corners, not {len(corners)}")
    return Polygon(tuple(corners))


ZONE_SHAPES = ("polygon", "circle", "line")
_APPROACH_KEYS = ("time_before_collision", "simulation_time_step")
_AREA_KEYS = ("min_points", "trigger", "hold")
_KEYS = ("name", "frame", "topic", "action", "count", *_AREA_KEYS, *_APPROACH_KEYS)
_NAME = re.compile(r"[A-Za-z0-9_-]+")


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
            if not _NAME.fullmatch(zone.name):
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
    fields.has(*ZONE_SHAPES, *_KEYS)
    fields.done()
    shape = _shape_key(fields, "zone", ZONE_SHAPES)
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


MAX_THING = 100.0
"""[m] No thing of interest is larger."""
TOLERANCE = 0.02
"""[m] As far as nothing else is said."""
MAX_LEGS = 8
SIZES = {
    "prismatic": (("length", "width"),),
    "round": (("diameter",),),
    "legged": (("legs", "spacing"),),
    "irregular": (("length", "width"), ("diameter",)),
}
"""Shape → the keys that tell its size, one group or another."""
ALL_SIZES = (("length", "width"), ("diameter",), ("legs", "spacing"))


def read_catalogue(path: str | PathLike[str]) -> Catalogue:
    """Read a catalogue; whatever is wrong with it is one line that names the file, the thing and the key.

    Raises
    ------
    UnreadableError
        There is no such file, or it is no TOML.
    OptionError
        An entry does not say what a thing is.
    """
    file = fspath(path)
    top = Fields(file, "the catalogue", read_toml(file, "catalogue"))
    tables = numbered(top, "thing")
    top.done()
    if not tables:
        raise OptionError(f"{file}: no [[thing]] in this catalogue")
    things: dict[str, Thing] = {}
    for fields in tables:
        thing = _thing(fields)
        fields.done()
        if thing.name in things:
            first = [*things].index(thing.name) + 1
            fields.fail("name", f"is '{thing.name}' as that of number {first}: names must be unique")
        things[thing.name] = thing
    return Catalogue(tuple(things.values()), path=file)


def _thing(fields: Fields) -> Thing:
    """Return the thing of one entry. Unknown keys are refused before missing ones: they may be misspelt."""
    name = fields.text("name")
    shape = fields.text("shape", choices=THING_SHAPES) if fields.has("shape") else None
    keys = [key for group in ALL_SIZES for key in group]
    given = [key for key in keys if fields.has(key)]
    is_lit = fields.has("intensity_min", "intensity_max")
    fields.has("tolerance", "moves")
    fields.done()
    group = _size_keys(fields, shape, given) if given or not is_lit else ()
    length = width = diameter = None
    legs = 0
    spacing: tuple[float, ...] = ()
    if group == ("length", "width"):
        length, width = (fields.number(key, above=0, high=MAX_THING) for key in group)
    elif group == ("diameter",):
        diameter = fields.number("diameter", above=0, high=MAX_THING)
    elif group:
        legs = fields.whole("legs", low=2, high=MAX_LEGS)
        spacing = _spacing(fields, legs)
    least, most = (
        fields.number(key, low=0, high=MAX_INTENSITY, largest=MAX_INTENSITY) if fields.has(key) else None
        for key in ("intensity_min", "intensity_max")
    )
    if least is not None and most is not None and least > most:
        fields.fail("intensity_min", f"is above intensity_max: {least:g} and {most:g}")
    return Thing(
        name=name,
        shape=shape,
        length=length,
        width=width,
        diameter=diameter,
        legs=legs,
        spacing=spacing,
        tolerance=fields.number("tolerance", TOLERANCE, low=0, high=MAX_THING),
        moves=fields.flag("moves", True),
        intensity_min=least,
        intensity_max=most,
    )


def _size_keys(fields: Fields, shape: str | None, given: list[str]) -> tuple[str, ...]:
    """Return the keys that tell the size of a thing: all of one group that its shape has, and no others."""
    groups = ALL_SIZES if shape is None else SIZES[shape]
    of = f"a {shape} thing" if shape != "irregular" else "an irregular thing"
    of = "a thing" if shape is None else of
    choices = ", or ".join(" and ".join(group) for group in groups)
    if not given:
        fields.fail(groups[0][0], f"is missing: the size of {of} is {choices}")
    group = next((group for group in groups if given[0] in group), None)
    if group is None:
        fields.fail(given[0], f"is no size of {of}: that is {choices}")
    for key in given:
        if key not in group:
            fields.fail(key, f"and '{given[0]}' exclude each other: the size of {of} is {choices}")
    for key in group:
        if key not in given:
            fields.fail(key, f"is missing: the size of {of} is {choices}")
    return group


def _spacing(fields: Fields, legs: int) -> tuple[float, ...]:
    """Return the distances of the axes of the legs: one of two legs, two of more."""
    spacing = fields.numbers("spacing", above=0, high=MAX_THING)
    wanted = 1 if legs == 2 else 2
    if len(spacing) != wanted:
        of = "two legs is one number, as [0.3]" if wanted == 1 else "more legs is two numbers, as [0.55, 0.45]"
        fields.fail("spacing", f"of {of}")
    return tuple(spacing)
