"""Settings of viewers name what is in the file, and are what the viewers read."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from ruamel.yaml import YAML

from lidarcli.overlays.viewers import OBJECTS, PANEL, ViewerScene, layout_json, rviz_config, topic_name, topics_of_objects

SCENE = ViewerScene("odom", ("/lidarcli/objects/front", "/lidarcli/objects/rear"), ("/front", "/rear"), "/lidarcli/map")
TOPICS = {*SCENE.objects, *SCENE.scans, "/lidarcli/map"}


def displays(scene: ViewerScene, *, is_ros2: bool) -> tuple[dict[str, Any], list[dict[str, Any]]]:
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
    scene = ViewerScene(name, (OBJECTS,), (name,))
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
