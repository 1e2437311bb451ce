"""Files for viewers: MCAP of ROS 2 and bags of ROS 1, a layout of Foxglove and Lichtblick, and an .rviz file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lidarcli.maps.grids import MAP_TYPE
from lidarcli.overlays.markers import MARKER_TYPE
from lidarcli.ros.messages import (
    ALL,
    ROS1,
    SCAN,
    TF,
    Outgoing,
    add_channel,
    bag_writer,
    offered,
    ros2_definition,
    start_ros2,
)

OBJECTS, MAP = "/lidarcli/objects", "/lidarcli/map"
FRAME = "laser"
"""The frame of a sensor whose log names none."""
MCAP, BAG, RRD = ".mcap", ".bag", ".rrd"
SUFFIXES = (MCAP, BAG, RRD)
LATEST_NS = (1 << 32) * 1_000_000_000 - 1
"""Latest record time [ns]: bags of ROS 1 count seconds in 32 bits."""
LAYOUT, RVIZ = ".layout.json", ".rviz"
PANEL = "3D!lidarcli"
BEAMS, BACKGROUND = "#FFFFFF", "#101010"
FREE, OCCUPIED, NOTHING = "#3A3A3AFF", "#8A6D1BFF", "#00000000"
"""Colours of a map, on which beams and objects are clear."""
POINT = 4
"""Size of a beam's end [pixels]."""


def topic_name(text: str) -> str:
    """Return the topic of a log of any kind as a valid topic of ROS.

    >>> topic_name("front scan"), topic_name("/2d/scan")
    ('/front_scan', '/_2d/scan')
    """
    parts = [re.sub(r"[^A-Za-z0-9_]", "_", part) for part in text.split("/") if part]
    return "".join(f"/{'_' * part[:1].isdigit()}{part}" for part in parts) or "/scan"


def topics_of_objects(topics: Iterable[str]) -> dict[str, str]:
    """Return topic of sweeps → topic of its markers. Each needs its own: a message deletes all markers of its topic.

    >>> topics_of_objects(["/scan"])
    {'/scan': '/lidarcli/objects'}
    >>> topics_of_objects(["/front", "/rear"])
    {'/front': '/lidarcli/objects/front', '/rear': '/lidarcli/objects/rear'}
    """
    names = sorted(set(topics))
    if len(names) == 1:
        return {names[0]: OBJECTS}
    named: dict[str, str] = {}
    for name in names:
        wanted = f"{OBJECTS}{topic_name(name)}"
        others = (f"{wanted}_{number}" for number in range(2, len(names) + 2))
        named[name] = next(one for one in (wanted, *others) if one not in named.values())
    return named


class McapFile:
    """MCAP of profile ros2: every message in CDR, every topic with the definition of its type."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb")
        self._writer = start_ros2(self._file)
        self._channels: dict[tuple[str, str], tuple[int, list[int]]] = {}

    def write(self, message: Outgoing) -> None:
        """Append a message."""
        key = (message.topic, message.type)
        known = self._channels.get(key)
        if known is None:
            depth, latched = _offer(*key)
            channel = add_channel(self._writer, *key, ros2_definition(message.type), offered(depth, latched=latched))
            known = self._channels[key] = channel, [0]
        channel, count = known
        log_ns, stamp_ns = _within(message.record_ns), _within(message.stamp_ns)
        self._writer.add_message(channel, log_ns, message.data, stamp_ns, count[0] & 0xFFFFFFFF)
        count[0] += 1

    def finish(self) -> None:
        """Write the index, and close the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def abandon(self) -> None:
        """Let go of a file; what is not in it by now will not be."""
        with suppress(OSError):
            self._file.close()


class BagFile:
    """A bag of ROS 1, packed by lz4."""

    def __init__(self, path: Path) -> None:
        self._writer = bag_writer(path, "lz4")
        self._writer.open()
        self._connections: dict[tuple[str, str], Any] = {}

    def write(self, message: Outgoing) -> None:
        """Append a message."""
        key = (message.topic, message.type)
        if key not in self._connections:
            _, latched = _offer(*key)
            self._connections[key] = self._writer.add_connection(*key, typestore=ROS1, latching=1 if latched else None)
        self._writer.write(self._connections[key], _within(message.record_ns), message.data)

    def finish(self) -> None:
        """Write the index, and close the file."""
        self._writer.close()

    def abandon(self) -> None:
        """Let go of a file; what is not in it by now will not be."""
        if self._writer.bio is not None:
            with suppress(OSError):
                self._writer.bio.close()


def overlay_file(path: Path) -> McapFile | BagFile:
    """Create a file of the format that its suffix names."""
    return McapFile(path) if path.suffix.lower() == MCAP else BagFile(path)


def _within(time_ns: int) -> int:
    """Return the nearest time that files can hold [ns]."""
    return time_ns if 0 <= time_ns <= LATEST_NS else min(max(time_ns, 0), LATEST_NS)


def _offer(topic: str, kind: str) -> tuple[int, bool]:
    """Return the number of messages of a topic that are kept, and True if late subscribers get them."""
    if kind == MAP_TYPE:
        return 1, True
    if kind == TF and topic.endswith("tf_static"):
        # Each of several nodes publishes its own frames.
        return ALL, True
    return (5 if kind in (MARKER_TYPE, SCAN) else 100), False


@dataclass(frozen=True, slots=True)
class ViewerScene:
    """Content of a scene."""

    frame: str
    """Fixed frame: the world frame of the log, else the frame of a sensor."""
    objects: tuple[str, ...]
    """Topics of markers."""
    scans: tuple[str, ...]
    map: str | None = None
    hidden: frozenset[str] = frozenset()
    """Topics among these that are not shown at first: another topic of the same sensor shows as much."""


def layout_json(scene: ViewerScene) -> bytes:
    """Return a layout with one 3D panel; topics that it does not name are hidden there."""
    topics: dict[str, dict[str, Any]] = {topic: {"showOutlines": False} for topic in scene.objects}
    for topic in scene.scans:
        # Without a field there is no flat colour.
        topics[topic] = {"pointSize": POINT, "colorMode": "flat", "flatColor": BEAMS, "colorField": "intensity"}
    if scene.map is not None:
        topics[scene.map] = {"colorMode": "custom", "minColor": FREE, "maxColor": OCCUPIED}
        topics[scene.map] |= {"unknownColor": NOTHING, "invalidColor": NOTHING}
    topics = {topic: {"visible": topic not in scene.hidden} | shown for topic, shown in topics.items()}
    layout = json.loads(Path(__file__).with_name("layout.json").read_text("utf-8"))
    panel = layout["configById"][PANEL]
    panel |= {"followTf": scene.frame, "topics": topics}
    panel["scene"]["backgroundColor"] = BACKGROUND
    return (json.dumps(layout, indent=2) + "\n").encode()


def rviz_config(scene: ViewerScene, *, is_ros2: bool) -> bytes:
    """Return the settings of RViz of ROS 2 or ROS 1."""
    plugins, common = ("rviz_default_plugins", "rviz_common") if is_ros2 else ("rviz", "rviz")
    displays = [f"    - Class: {plugins}/Grid\n      Name: Grid\n      Enabled: true\n      Plane Cell Count: 20\n"]
    if scene.map is not None:
        displays.append(
            f"    - Class: {plugins}/Map\n      Name: Map\n      Enabled: true\n      Alpha: 0.3\n"
            + _topic(scene.map, "Topic", is_ros2, latched=True)
        )
    for topic in scene.scans:
        displays.append(
            f"    - Class: {plugins}/LaserScan\n      Name: {_text(topic)}\n      Enabled: {_enabled(scene, topic)}\n"
            f"      Style: Points\n      Size (Pixels): {POINT}\n      Color Transformer: FlatColor\n"
            f"      Color: {_decimal(BEAMS)}\n" + _topic(topic, "Topic", is_ros2, reliable=False)
        )
    for topic in scene.objects:
        displays.append(
            f"    - Class: {plugins}/MarkerArray\n      Name: {_text(topic)}\n      Enabled: {_enabled(scene, topic)}\n"
            + _topic(topic, "Topic" if is_ros2 else "Marker Topic", is_ros2)
        )
    tools = "".join(f"    - Class: {plugins}/{name}\n" for name in ("Interact", "MoveCamera", "FocusCamera", "Measure"))
    text = (
        # No other panel: without the state of the window, which only RViz writes, a second one takes the room of the view.
        f"Panels:\n  - Class: {common}/Displays\n    Name: Displays\n"
        'Visualization Manager:\n  Class: ""\n'
        f"  Displays:\n{''.join(displays)}"
        f"  Enabled: true\n  Global Options:\n    Background Color: {_decimal(BACKGROUND)}\n"
        f"    Fixed Frame: {_text(scene.frame)}\n    Frame Rate: 30\n  Name: root\n"
        f"  Tools:\n{tools}"
        f"  Views:\n    Current:\n      Class: {plugins}/TopDownOrtho\n      Name: Current View\n      Angle: 0\n"
        "      Scale: 60\n      Target Frame: <Fixed Frame>\n      X: 0\n      Y: 0\n"
        "Window Geometry:\n  Height: 720\n  Width: 1200\n"
    )
    return text.encode()


def _enabled(scene: ViewerScene, topic: str) -> str:
    return "false" if topic in scene.hidden else "true"


def _topic(topic: str, key: str, is_ros2: bool, *, latched: bool = False, reliable: bool = True) -> str:
    """Return the topic of a display; a reliable subscription gets nothing from a sensor that offers best effort."""
    if not is_ros2:
        return f"      {key}: {_text(topic)}\n"
    return (
        f"      {key}:\n        Value: {_text(topic)}\n        Depth: 5\n        History Policy: Keep Last\n"
        f"        Reliability Policy: {'Reliable' if reliable else 'Best Effort'}\n"
        f"        Durability Policy: {'Transient Local' if latched else 'Volatile'}\n"
    )


def _decimal(colour: str) -> str:
    """Return a colour as RViz writes it.

    >>> _decimal("#FF8000")
    '255; 128; 0'
    """
    return "; ".join(map(str, bytes.fromhex(colour[1:])))


def _text(value: str) -> str:
    """Return a text as YAML has it between quotation marks, as JSON does."""
    return json.dumps(value, ensure_ascii=True)
