"""Zones in parameters of Nav2's Collision Monitor (YAML)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import numpy as np

from lidarcli.display.texts import clipped
from lidarcli.errors import OptionError
from lidarcli.files.configfiles import LARGEST, MAX_DEPTH, Fields, read_yaml
from lidarcli.pipeline.inputs.masks import MAX_CORNERS, MOST
from lidarcli.sweeps.masks import Circle, Mask, Masks, Polygon, same_name
from lidarcli.sweeps.zone import (
    ACTIONS,
    MIN_POINTS,
    ROBOT,
    TIME_BEFORE_COLLISION,
    TIME_STEP,
    TIMEOUT,
    Case,
    Zone,
    Zones,
    crossing_edges,
)

MAX_POINTS = 1_000_000
"""Greatest number of points or sweeps that a zone asks for."""
LONGEST = 3600.0
"""Greatest time of a zone [s]."""
MAX_STEPS = 1000
"""Most times that `approach` tests."""
_PARAMETERS = "ros__parameters"
_MIN_CORNERS, _MIN_EXCLUDED = 4, 3
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
    """Yield the parameters of nodes that watch polygons; those of `/**` count where a node has none of its own.

    `/**` is a node of its own where no other one has polygons.
    """
    shared: dict[str, Any] = {}
    for path, parameters in nodes:
        if path == ("**",):
            shared |= parameters
    found = [
        (path, shared | parameters)
        for path, parameters in nodes
        if path != ("**",) and not parameters.keys().isdisjoint({"polygons", "observation_sources"})
    ]
    yield from [each for each in found if "polygons" in each[1]] or ([(("**",), shared)] if "polygons" in shared else [])


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
        kind = source.text("type", "scan", ("scan", "pointcloud", "range", "polygon", "costmap"))
        node.sources[name] = None
        if not source.flag("enabled", True):
            node.notes.append(f"source {name} is not enabled: it does not count")
        elif kind != "scan":
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
    """Yield the zones of a node that can be evaluated."""
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
