"""Parameters of Nav2's Collision Monitor and Detector: what is read, noted and refused."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from lidarcli.errors import LidarcliError, OptionError, UnreadableError
from lidarcli.pipeline.inputs.zones import read_zones
from lidarcli.sweeps.masks import Circle, Mask, Polygon
from lidarcli.sweeps.zone import ROBOT, Case, Zone, Zones
from tools.fuzz.mutate import mutate
from tools.fuzz.words import mutate_words

MONITOR = """collision_monitor:
  ros__parameters:
    enabled: True
    base_frame_id: "base_link"
    odom_frame_id: "odom"
    cmd_vel_in_topic: "cmd_vel_raw"
    cmd_vel_out_topic: "cmd_vel"
    state_topic: "collision_monitor_state"
    transform_tolerance: 0.5
    source_timeout: 5.0
    base_shift_correction: True
    stop_pub_timeout: 2.0
    use_realtime_priority: false
    polygons: ["Halt", "Slow", "Limited", "Foot", "Cases", "Told", "Idle", "Cloudy"]
    Halt:
      type: "polygon"
      points: "[[0.5, 0.25], [0.5, -0.25], [0.0, -0.25], [0.0, 0.25]]"
      action_type: "stop"
      min_points: 6
      trigger_consecutive_points: 2
      release_consecutive_points: 3
      visualize: True
      polygon_pub_topic: "polygon_stop"
    Slow:
      type: "circle"
      radius: 1.5
      action_type: "slowdown"
      slowdown_ratio: 0.3
      max_points: 3
      sources_names: ["rear"]
    Limited:
      type: "polygon"
      points: "[[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]]"
      action_type: "limit"
      linear_limit: 0.4
      angular_limit: 0.5
      sources_names: ["front", "depth"]
    Foot:
      type: "polygon"
      action_type: "approach"
      time_before_collision: 1.5
      trigger_consecutive_points: 5
      simulation_time_step: 0.02
    Cases:
      type: "velocity_polygon"
      action_type: "stop"
      holonomic: true
      velocity_polygons: ["ahead", "rest"]
      ahead:
        points: "[[1.0, 0.5], [1.0, -0.5], [0.0, -0.5], [0.0, 0.5]]"
        linear_min: 0.0
        linear_max: 1
        theta_min: -1.0
        theta_max: 1.0
        direction_start_angle: -0.75
        direction_end_angle: 0.75
      rest:
        points: "[[.5, .5], [.5, -.5], [-.5, -.5], [-.5, .5]]"
        linear_min: -1.0
        linear_max: 1.0
        theta_min: -1.0
        theta_max: 1.0
    Told:
      type: "polygon"
      polygon_sub_topic: "/dynamic_polygon"
      action_type: "none"
    Idle:
      type: "circle"
      radius: 0.5
      action_type: "stop"
      enabled: false
    Cloudy:
      type: "circle"
      radius: 0.5
      action_type: "stop"
      sources_names: ["depth"]
    observation_sources: ["front", "rear", "depth", "sonar", "old"]
    front:
      type: "scan"
      topic: "scan"
      exclusion_zones: ["wheel", "arm", "later"]
    rear:
      topic: "/rear/scan"
      source_timeout: 0.0
    depth:
      type: "pointcloud"
      topic: "/depth/points"
      min_height: 0.1
    sonar: {type: range, topic: /sonar}
    old: {type: scan, topic: /old, enabled: no}
    wheel: {type: "circle", radius: 0.125, frame_id: "wheel_link", enabled: true}
    arm: {points: "[[0.25, 0.0], [0.5, 0.0], [0.5, 0.25]]", enabled: true, min_height: 0.1}
    later: {type: "circle", radius: 0.25}
"""

DETECTOR = """/robot1/collision_detector:
  ros__parameters:
    frequency: 10.0
    polygons: ["front"]
    front:
      type: "polygon"
      points: "[[0.5, 0.5], [0.5, -0.5], [0.0, -0.5], [0.0, 0.5]]"
      action_type: "none"
    observation_sources: ["scan"]
    scan:
      type: "scan"
      topic: "scan"
"""


def box(front: float, half: float, back: float) -> Polygon:
    return Polygon(((front, half), (front, -half), (back, -half), (back, half)))


def read_text(text: str) -> Zones:
    Path("nav2.yaml").write_text(text)
    return read_zones(["nav2.yaml"])


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_monitor_is_read() -> None:
    read = read_text(MONITOR)
    both = {"topics": ("/scan", "/rear/scan"), "velocity_topic": "/cmd_vel_raw", "timeout": 5.0, "frame": ROBOT}
    square = Polygon(((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5)))
    cases = (
        Case("ahead", box(1.0, 0.5, 0.0), (0.0, 1.0), (-1.0, 1.0), (-0.75, 0.75)),
        Case("rest", square, (-1.0, 1.0), (-1.0, 1.0), (-math.pi, math.pi)),
    )
    expected = (
        Zone("Halt", box(0.5, 0.25, 0.0), action="stop", min_points=6, trigger=2, release=3, **both),
        Zone("Slow", Circle(0.0, 0.0, 1.5), action="slowdown", **both | {"topics": ("/rear/scan",), "timeout": 0.0}),
        Zone("Limited", box(0.5, 0.5, -0.5), action="limit", **both | {"topics": ("/scan",)}),
        Zone(
            "Foot",
            None,
            action="approach",
            shape_topic="/local_costmap/published_footprint",
            time_before_collision=1.5,
            time_step=0.02,
            **both,
        ),
        Zone("Cases", None, action="stop", cases=cases, **both),
        Zone("Told", None, action="none", shape_topic="/dynamic_polygon", **both),
    )
    assert read.zones == expected
    assert {each.hold for each in read.zones} == {0.0}, "consecutive sweeps decide, no time"
    assert read.robot == "base_link"
    assert read.masks.masks == (
        Mask(Circle(0.0, 0.0, 0.125), "/scan", "wheel_link"),
        Mask(Polygon(((0.25, 0.0), (0.5, 0.0), (0.5, 0.25))), "/scan", ROBOT),
    )
    shortest = "the shortest source_timeout of its sources, 5 s, is taken for all of them"
    assert read.notes == (
        "nav2.yaml: exclusion zone arm has heights, which are not used: it is taken at every height",
        "nav2.yaml: exclusion zone later is not enabled, which is the default: its points count",
        "nav2.yaml: source old is not enabled: it does not count",
        "nav2.yaml: only scans are read, not depth (pointcloud), sonar (range): the list of events is incomplete",
        *(f"nav2.yaml: {name}: {shortest}" for name in ("Halt", "Foot", "Cases", "Told")),
        "nav2.yaml: Idle is not enabled: it is not judged",
        "nav2.yaml: Cloudy has no source of scans: it is not judged",
    )


def below(name: str, text: str) -> str:
    return f"{name}:\n" + "".join(f"  {line}\n" for line in text.splitlines())


def test_the_node_is_any_with_polygons() -> None:
    plain = DETECTOR.replace("/robot1/collision_detector", "any_name")
    assert read_text(plain.replace("any_name", '"/**"')).zones[0].topics == ("/scan",)
    assert read_text(below("robot1", plain)).zones[0].topics == ("/robot1/scan",)
    assert read_text(below('"/**"', plain)).zones[0].topics == ("/scan",)
    other = "controller_server:\n  ros__parameters:\n    polygon: 3\n"
    assert read_text(other + plain).zones == read_text(plain).zones
    two = DETECTOR + plain.replace("front", "back")
    assert [(each.name, each.topics) for each in read_text(two).zones] == [
        ("front", ("/robot1/scan",)),
        ("back", ("/scan",)),
    ]


def test_a_polygon_that_crosses_itself_is_noted() -> None:
    read = read_text(DETECTOR.replace("[0.5, 0.5], [0.5, -0.5]", "[0.5, -0.5], [0.5, 0.5]"))
    assert read.notes == (
        "nav2.yaml: front crosses or touches itself (edges 2 and 4): only what the even-odd rule calls inside "
        "counts, as in Nav2",
    )


def test_without_sources_every_topic_counts() -> None:
    read = read_text(DETECTOR[: DETECTOR.index("    observation_sources")])
    assert [each.topics for each in read.zones] == [()]
    assert read.notes == ("nav2.yaml: no observation_sources: every scan topic counts",)


def changed(old: str, new: str = "", text: str = DETECTOR) -> str:
    assert old in text
    return text.replace(old, new)


POINTS = 'points: "[[0.5, 0.5], [0.5, -0.5], [0.0, -0.5], [0.0, 0.5]]"'
NODE = "nav2.yaml: robot1/collision_detector"
PAIRS = "'points' must be pairs of numbers as \"[[0.5, 0.3], [0.5, -0.3], ...]\""
AS_TEXT = "'points' must be a text as \"[[0.5, 0.3], [0.5, -0.3], [0.0, -0.3], [0.0, 0.3]]\""
NO_NODE = "nav2.yaml: no node with ros__parameters that has 'polygons': no zones of Nav2"
BODY = DETECTOR + "      exclusion_zones: [body]\n    body: "
REFUSALS = {
    "a: 1\n": NO_NODE,
    changed("ros__parameters", "parameters"): NO_NODE,
    changed('["front"]', "front"): ": 'polygons' must be a list of 1 to 1,000 values",
    changed('["front"]', "[3]"): ": 'polygons' must be a list of names",
    changed('["front"]', "[front, rear]"): ", rear: 'type' is missing",
    changed('["front"]', "[front, front]"): "nav2.yaml: 'front' is there twice",
    changed("front", "front.left"): "nav2.yaml: the name 'front.left' must be of letters, digits, _ and - only",
    changed('"polygon"', '"square"'): ", front: 'type' must be one of polygon, circle, velocity_polygon, not 'square'",
    changed('"polygon"', '"velocity_polygon"'): ", front: 'velocity_polygons' is missing",
    changed('"none"', '"halt"'): ", front: 'action_type' must be one of stop, slowdown, limit, approach, none, not 'halt'",
    changed(POINTS, ""): ", front: 'points' is missing, and so is 'polygon_sub_topic'",
    changed(", [0.0, 0.5]]"): ", front: " + PAIRS,
    changed(", [0.0, 0.5]"): ", front: 'points' must be 4 to 100 corners, not 3",
    changed("[0.0, 0.5]", "[0.0, 0.5, 1.0]"): ", front: " + PAIRS,
    changed("[0.0, 0.5]", "[0.0, nan]"): ", front: 'points' must hold finite numbers between -1e+06 and 1e+06",
    changed(POINTS, "points: [[0.5, 0.5], [0.5, -0.5], [0.0, -0.5], [0.0, 0.5]]"): ", front: " + AS_TEXT,
    **{
        changed(
            POINTS, f"{POINTS}\n      min_points: {text}"
        ): f", front: 'min_points' must be a number, not the text '{text}'"
        for text in ("1_5", "0o17")
    },
    changed(
        POINTS, f"{POINTS}\n      sources_names: [lidar]"
    ): ", front: 'sources_names' has 'lidar', which is not in observation_sources",
    changed(POINTS, f"{POINTS}\n      enabled: false"): "nav2.yaml: none of the polygons can be judged: "
    "front is not enabled: it is not judged",
    changed("frequency: 10.0", "enabled: off"): "nav2.yaml: none of the polygons can be judged: "
    "robot1/collision_detector is not enabled: its polygons are not judged",
    changed(
        '"scan"\n      topic', '"radar"\n      topic'
    ): ", scan: 'type' must be one of scan, pointcloud, range, polygon, costmap, not 'radar'",
    BODY + "{type: box}\n": ", body: 'type' must be one of polygon, circle, not 'box'",
    BODY + '{points: "[[0, 0], [1, 0]]"}\n': ", body: 'points' must be 3 to 100 corners, not 2",
    changed(
        "theta_max: 1.0\n        direction", "direction", MONITOR
    ): "nav2.yaml: collision_monitor, Cases, ahead: 'theta_max' is missing",
    DETECTOR + MONITOR: "nav2.yaml: collision_monitor: 'base_frame_id' is base_link, of another node "
    "base_footprint: leave one out",
}


@pytest.mark.parametrize("text", REFUSALS)
def test_each_refusal_is_a_line(text: str) -> None:
    with pytest.raises(OptionError) as err:
        read_text(text)
    line = REFUSALS[text]
    assert str(err.value) == (line if line.startswith("nav2.yaml") else NODE + line)


UNREADABLE = {
    "": "nav2.yaml: not valid YAML of a zone file: it has no keys",
    "a: [1\nb: 2\n": "nav2.yaml: not valid YAML: line 2: while parsing a flow sequence, expected ',' or ']', but got ':'",
    "a: 1\n---\nb: 2\n": "nav2.yaml: not valid YAML: line 2: expected a single document in the stream, but found "
    "another document",
    "a: 1\na: 2\n": "nav2.yaml: line 2: key 'a' is there twice",
    "? [a]\n: 1\n": "nav2.yaml: line 1: a key that is no name",
    "a: &x [1]\nb: *x\n": "nav2.yaml: line 1: an anchor that is used twice, which ROS does not know",
    "a: " + "[" * 20 + "]" * 20: "nav2.yaml: line 1: more than 16 levels",
    "a" * 131_073: "nav2.yaml: larger than a zone file may be (131,072 bytes)",
    "\udcff": "nav2.yaml: byte 0: not UTF-8 text; a zone file is a YAML file",
}


@pytest.mark.parametrize("text", UNREADABLE, ids=range(len(UNREADABLE)))
def test_what_is_no_yaml_is_refused(text: str) -> None:
    Path("nav2.yaml").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(UnreadableError) as err:
        read_zones(["nav2.yaml"])
    assert str(err.value) == UNREADABLE[text]


def test_files_must_be_of_one_robot() -> None:
    Path("one.yaml").write_text(DETECTOR)
    Path("two.YML").write_text(changed("front", "back"))
    Path("own.toml").write_text('[[zone]]\nname = "a"\ncircle = { x = 0, y = 0, radius = 1 }\n')
    read = read_zones(["own.toml", "one.yaml", "two.YML"])
    assert [each.name for each in read.zones] == ["a", "front", "back"]
    assert read.robot == "base_footprint"
    Path("two.YML").write_text(MONITOR)
    with pytest.raises(OptionError) as err:
        read_zones(["own.toml", "one.yaml", "two.YML"])
    assert str(err.value) == "two.YML: the robot is base_link, in one.yaml it is base_footprint: leave one out"


@pytest.mark.slow
def test_mutated_files_are_read_or_refused() -> None:
    random = np.random.default_rng(6)
    refused = 0
    for _ in range(150):
        data = mutate_words(MONITOR, random).encode("utf-8", "replace")
        if not random.integers(3):
            data = mutate(data, random)
        Path("nav2.yaml").write_bytes(data)
        try:
            read_zones(["nav2.yaml"])
        except LidarcliError:
            refused += 1
    assert refused > 30


def test_parameters_of_all_nodes_tell_what_the_node_does_not() -> None:
    common = "/**:\n  ros__parameters: {base_frame_id: base_link, source_timeout: 3.0, scan: {topic: /front, type: scan}}\n"
    own = "      min_points: 7\n"
    for text in (common + DETECTOR + own, DETECTOR + own + common):
        read = read_text(text)
        (zone,) = read.zones
        assert (read.robot, zone.timeout, zone.topics) == ("base_link", 3.0, ("/robot1/scan",))
    # What the node tells itself goes before, key by key.
    assert read_text(common + DETECTOR.replace("    frequency", "    base_frame_id: laser\n    frequency")).robot == "laser"
    # Polygons under /** alone are those of one node.
    alone = DETECTOR.replace("/robot1/collision_detector", "/**")
    assert [each.topics for each in read_text(alone).zones] == [("/scan",)]


def test_numbers_are_those_of_ros() -> None:
    def radius(told: str) -> float:
        (zone,) = read_text(DETECTOR.replace('"polygon"', '"circle"\n      radius: ' + told)).zones
        assert isinstance(zone.shape, Circle)
        return zone.shape.radius

    assert [radius(told) for told in ("030", "0x1F", "08", "1e1", "+7", "0.25")] == [24.0, 31.0, 8.0, 10.0, 7.0, 0.25]
    assert [radius(told) for told in ("0x1p3", "0x.8", ".5e1", "!!float 3")] == [8.0, 0.5, 5.0, 3.0]
    for told in ("inf", "-Infinity", ".inf", "nan"):
        with pytest.raises(OptionError, match="'radius' must be finite"):
            radius(told)
    for told in (
        "1_5",
        "0o17",
        "1_0.5",
        "9" * 5000,
        "1E400",
        "1e-400",
        "0x1p9999",
        '"3"',
        '!!int "3"',
        "!!str 3",
        ".Nan",
        "~",
    ):
        with pytest.raises(OptionError, match="'radius'"):
            radius(told)


COSTMAP = """local_costmap:
  local_costmap:
    ros__parameters: {%s}
global_costmap: {global_costmap: {ros__parameters: {footprint: "[[1, 1], [1, -1], [-1, 0]]", footprint_padding: 0}}}
"""


@pytest.mark.parametrize(
    ("costmap", "corners"),
    [
        ('footprint: "[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]]"', [(0.31, 0.21), (0.31, -0.21), (-0.31, 0.0)]),
        (
            "robot_radius: 0.2, footprint_padding: 0.0",
            [(0.2 * math.cos(a), 0.2 * math.sin(a)) for a in np.arange(16) * math.pi / 8],
        ),
        ('footprint: "[]"', [(1.0, 1.0), (1.0, -1.0), (-1.0, 0.0)]),
    ],
)
def test_the_footprint_of_a_costmap_stands_for_its_topic(costmap: str, corners: list[tuple[float, float]]) -> None:
    monitor = MONITOR.replace("enabled: no", "enabled: false")
    by_name = {zone.name: zone.footprint for zone in read_text(monitor + COSTMAP % costmap).zones}
    assert by_name["Foot"] is not None
    np.testing.assert_allclose(by_name.pop("Foot").corners, corners, atol=1e-7)  # type: ignore[union-attr]
    assert set(by_name.values()) == {None}


def flat(values: dict[str, Any], start: str = "") -> Iterator[str]:
    """Lines of parameters, each by its whole name."""
    for key, value in values.items():
        yield from flat(value, f"{start}{key}.") if isinstance(value, dict) else [f"    {start}{key}: {json.dumps(value)}"]


def test_a_dot_in_a_name_leads_into_a_table() -> None:
    told = YAML(typ="safe", pure=True).load(MONITOR.replace("enabled: no", "enabled: false"))["collision_monitor"][
        "ros__parameters"
    ]
    spelled = "\n".join(["collision_monitor:", "  ros__parameters:", *flat(told), ""])
    assert "    Cases.ahead.points: " in spelled
    assert read_text(spelled).zones == read_text(MONITOR).zones
    for more, cause in {
        "Halt.type: circle": "nav2.yaml: parameter 'Halt.type' is there twice, with a dot and without",
        "Halt.type.deep: 3": "nav2.yaml: parameter 'type' is a value and has others inside",
    }.items():
        with pytest.raises(OptionError, match=cause):
            read_text(f"{MONITOR}\n    {more}\n")
    assert read_text(f"{MONITOR}\n    {'a.' * 400}: 3\n").zones == read_text(MONITOR).zones
