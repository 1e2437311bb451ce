"""Settings of viewers that show an overlay with its log: a layout of Foxglove and Lichtblick, and an .rviz file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

LAYOUT, RVIZ = ".layout.json", ".rviz"
PANEL = "3D!lidarcli"
BEAMS, BACKGROUND, GRID = "#FFFFFF", "#101010", "#FFFFFF20"
FREE, OCCUPIED, NOTHING = "#3A3A3AFF", "#8A6D1BFF", "#00000000"
"""Colours of a map, on which beams and objects are clear."""
POINT = 4
"""Size of a beam's end [pixels]."""
MAP_ALPHA = 0.3
"""Alpha of a map in RViz: on the dark background free space is then dark enough for white beams."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Content of a scene."""

    frame: str
    """Fixed frame: the world frame of the log, else the frame of a sensor."""
    objects: tuple[str, ...]
    """Topics of markers."""
    scans: tuple[str, ...]
    map: str | None = None
    hidden: frozenset[str] = frozenset()
    """Topics among these that are not shown at first: of another topic of the same sensor there is as much to be seen."""


def layout_json(scene: Scene) -> bytes:
    """Return a layout with one 3D panel; topics that it does not name are hidden there."""
    topics: dict[str, dict[str, Any]] = {topic: {"showOutlines": False} for topic in scene.objects}
    for topic in scene.scans:
        # Without a field there is no flat colour.
        topics[topic] = {"pointSize": POINT, "colorMode": "flat", "flatColor": BEAMS, "colorField": "intensity"}
    if scene.map is not None:
        topics[scene.map] = {
            "colorMode": "custom",
            "minColor": FREE,
            "maxColor": OCCUPIED,
            "unknownColor": NOTHING,
            "invalidColor": NOTHING,
        }
    topics = {topic: {"visible": topic not in scene.hidden} | shown for topic, shown in topics.items()}
    panel = {
        "cameraState": {
            "perspective": False,
            "distance": 12,
            "phi": 0,
            "thetaOffset": 0,
            "targetOffset": [0, 0, 0],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.5,
            "far": 5000,
        },
        "followMode": "follow-pose",
        "followTf": scene.frame,
        "scene": {
            "backgroundColor": BACKGROUND,
            # Names and lines of the frames of a robot would hide what is around it.
            "transforms": {"showLabel": False, "lineWidth": 0, "axisScale": 0.5, "enablePreloading": True},
        },
        "transforms": {},
        "topics": topics,
        "layers": {
            "grid": {
                "instanceId": "grid",
                "layerId": "foxglove.Grid",
                "label": "Grid",
                "visible": True,
                "frameLocked": True,
                "size": 20,
                "divisions": 20,
                "lineWidth": 1,
                "color": GRID,
                "position": [0, 0, 0],
                "rotation": [0, 0, 0],
                "order": 1,
            }
        },
        "publish": {},
        "imageMode": {},
    }
    layout = {
        "configById": {PANEL: panel},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": PANEL,
    }
    return (json.dumps(layout, indent=2) + "\n").encode()


def rviz_config(scene: Scene, *, is_ros2: bool) -> bytes:
    """Return the settings of RViz of ROS 2 or ROS 1."""
    plugins, common = ("rviz_default_plugins", "rviz_common") if is_ros2 else ("rviz", "rviz")
    displays = [f"    - Class: {plugins}/Grid\n      Name: Grid\n      Enabled: true\n      Plane Cell Count: 20\n"]
    if scene.map is not None:
        displays.append(
            f"    - Class: {plugins}/Map\n      Name: Map\n      Enabled: true\n      Alpha: {MAP_ALPHA}\n"
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


def _enabled(scene: Scene, topic: str) -> str:
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
