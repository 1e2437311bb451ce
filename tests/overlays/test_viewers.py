"""Settings of viewers name what is in the file, and are what the viewers read."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from ruamel.yaml import YAML

from lidarcli.overlays.viewers import OBJECTS, PANEL, Scene, layout_json, rviz_config, topic_name, topics_of_objects

SCENE = Scene("odom", ("/lidarcli/objects/front", "/lidarcli/objects/rear"), ("/front", "/rear"), "/lidarcli/map")
TOPICS = {*SCENE.objects, *SCENE.scans, "/lidarcli/map"}


def displays(scene: Scene, *, is_ros2: bool) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    config = YAML(typ="safe").load(rviz_config(scene, is_ros2=is_ros2))
    manager = config["Visualization Manager"]
    return manager["Global Options"], manager["Displays"]


def test_a_layout_shows_every_topic() -> None:
    layout = json.loads(layout_json(SCENE))
    assert set(layout) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    assert layout["layout"] == PANEL
    assert PANEL.startswith("3D!")
    panel = layout["configById"][PANEL]
    assert panel["followTf"] == "odom"
    assert panel["followMode"] in ("follow-pose", "follow-position", "follow-none")
    assert {name for name, shown in panel["topics"].items() if shown["visible"]} == TOPICS


def test_beams_of_a_layout_are_white_above_a_dark_map() -> None:
    """Foxglove and Lichtblick take a flat colour only with a field, and draw maps white by default."""
    topics = json.loads(layout_json(SCENE))["configById"][PANEL]["topics"]
    for name in SCENE.scans:
        assert topics[name]["colorField"]
        assert (topics[name]["colorMode"], topics[name]["flatColor"]) == ("flat", "#FFFFFF")
    grid = topics["/lidarcli/map"]
    assert grid["colorMode"] == "custom"
    assert max(bytes.fromhex(grid["minColor"][1:7])) < 80
    assert grid["unknownColor"][-2:] == grid["invalidColor"][-2:] == "00"


def test_what_is_hidden_can_be_shown_by_one_click() -> None:
    scene = replace(SCENE, hidden=frozenset({"/rear", "/lidarcli/objects/rear"}))
    topics = json.loads(layout_json(scene))["configById"][PANEL]["topics"]
    assert {name for name, shown in topics.items() if not shown["visible"]} == scene.hidden
    assert set(topics) == TOPICS
    for is_ros2 in (True, False):
        _, shown = displays(scene, is_ros2=is_ros2)
        assert {each["Name"] for each in shown if not each["Enabled"]} == scene.hidden


def test_rviz_of_ros2_shows_every_topic_as_it_is_offered() -> None:
    options, shown = displays(SCENE, is_ros2=True)
    assert options["Fixed Frame"] == "odom"
    topics = {each["Topic"]["Value"]: each for each in shown if "Topic" in each}
    assert set(topics) == TOPICS
    assert {each["Class"].split("/")[0] for each in shown} == {"rviz_default_plugins"}
    assert all(each["Enabled"] is True for each in shown)
    assert topics["/lidarcli/map"]["Topic"]["Durability Policy"] == "Transient Local"
    assert topics["/front"]["Topic"]["Reliability Policy"] == "Best Effort"
    assert topics["/lidarcli/objects/front"]["Class"] == "rviz_default_plugins/MarkerArray"


def test_rviz_of_ros1_shows_every_topic() -> None:
    options, shown = displays(SCENE, is_ros2=False)
    assert options["Fixed Frame"] == "odom"
    assert {each["Marker Topic"] for each in shown if each["Class"] == "rviz/MarkerArray"} == {*SCENE.objects}
    assert {each["Topic"] for each in shown if "Topic" in each} == TOPICS - {*SCENE.objects}


@pytest.mark.parametrize("name", ['a"b', "x: y", "{z}", "ä\n", "'"])
def test_a_strange_name_stays_what_it_is(name: str) -> None:
    scene = Scene(name, (OBJECTS,), (name,))
    options, shown = displays(scene, is_ros2=True)
    assert options["Fixed Frame"] == name
    assert name in {each["Topic"]["Value"] for each in shown if "Topic" in each}
    assert json.loads(layout_json(scene))["configById"][PANEL]["followTf"] == name


def test_each_of_several_topics_has_markers_of_its_own() -> None:
    assert topics_of_objects(["/scan"]) == {"/scan": "/lidarcli/objects"}
    named = topics_of_objects(["/a b", "/a_b", "/a-b", "c"])
    assert len(set(named.values())) == 4
    assert named["c"] == "/lidarcli/objects/c"
    assert topic_name("") == "/scan"


@pytest.mark.parametrize("is_ros2", [True, False])
def test_rviz_leaves_the_window_to_the_view(is_ros2: bool) -> None:
    """Without a state of the window, a panel beside the displays takes all the room that the view has."""
    config = YAML(typ="safe").load(rviz_config(SCENE, is_ros2=is_ros2))
    assert [panel["Name"] for panel in config["Panels"]] == ["Displays"]
    assert "QMainWindow State" not in config["Window Geometry"]


@pytest.mark.parametrize("is_ros2", [True, False])
def test_beams_are_clear_on_the_map(is_ros2: bool) -> None:
    """Free space, which RViz draws nearly white, stays darker than half of the white of beams."""
    options, shown = displays(SCENE, is_ros2=is_ros2)
    (alpha,) = (each["Alpha"] for each in shown if each["Name"] == "Map")
    ground = max(int(part) for part in options["Background Color"].split(";"))
    assert 16 + 40 < alpha * 255 + (1 - alpha) * ground < 127
