"""docs/overlay.md says what the code says: namespaces, markers, numbers, topics."""

from __future__ import annotations

import re

from lidarcli.overlays import objects, viewers
from lidarcli.overlays.markers import Kind
from lidarcli.overlays.viewers import LAYOUT, RVIZ
from tests.places import ROOT

PAGE = (ROOT / "docs" / "overlay.md").read_text(encoding="utf-8")
ROS_NAMES = {
    Kind.OUTLINE: "LINE_STRIP",
    Kind.PATH: "LINE_STRIP",
    Kind.ZONE: "LINE_STRIP",
    Kind.CUBE: "CUBE",
    Kind.CYLINDER: "CYLINDER",
    Kind.LABEL: "TEXT_VIEW_FACING",
    Kind.ARROW: "ARROW",
}
"""As visualization_msgs/Marker calls its types."""


def test_every_namespace_is_told_with_its_markers() -> None:
    told = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", PAGE, re.MULTILINE))
    assert told.keys() == {kind.value[1].decode() for kind in Kind}
    for kind in Kind:
        assert ROS_NAMES[kind] in told[kind.value[1].decode()]


def test_numbers_and_names_are_those_of_the_code() -> None:
    assert f"{objects.HEIGHT} m high" in PAGE
    assert f"add {objects.PART:,} each" in PAGE
    for name in (viewers.OBJECTS, viewers.MAP, *viewers.SUFFIXES):
        assert f"`{name}`" in PAGE or f"`{name}/" in PAGE
    assert f"drive.overlay{LAYOUT}" in PAGE
    assert f"drive.overlay{RVIZ}" in PAGE
