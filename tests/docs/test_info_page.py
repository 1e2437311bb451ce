"""docs/info.md: every key of `info --format json` is there with its type, and no other."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest

from lidarcli.cli.info import as_json
from lidarcli.logs.base import Topic
from lidarcli.logs.clock import ClockInfo
from lidarcli.logs.joined import Part
from lidarcli.pipeline.inspecting import LogInfo, ScanInfo, Span
from lidarcli.pipeline.reading.found_poses import PoseInfo
from lidarcli.sweeps.findings import IDS, Finding, Fix
from lidarcli.sweeps.types import Closure, Status
from tests.fake_log import FakeLog
from tests.places import ROOT

PAGE = (ROOT / "docs" / "info.md").read_text(encoding="utf-8")
ROWS = [
    tuple(cell.strip() for cell in match)
    for match in re.findall(r"^\| `([\w.\[\]]+)` \|([^|]+)\|([^|]*)\|([^|]*)\|$", PAGE, re.MULTILINE)
]
"""(key, type, unit, meaning) of each row of a key; rows of rules have five cells."""
KINDS: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "string or null": (str, type(None)),
    "integer": (int,),
    "integer or null": (int, type(None)),
    "number": (int, float),
    "number or null": (int, float, type(None)),
    "boolean": (bool,),
    "list": (list,),
    "list of strings": (list,),
    "pair": (list,),
    "pair of integers": (list,),
    "object": (dict,),
    "object or null": (dict, type(None)),
}


def info(unknown: bool = False) -> LogInfo:
    """A log with something of everything; with all that may be unknown unknown."""
    clock = ClockInfo(None, None, None, 0, 0.0, 2, None) if unknown else ClockInfo(5, 10**9, 10.0, 1, 0.5, 0, 0.25)
    scan = ScanInfo(
        topic="/scan",
        frame_id="laser",
        sweeps=2,
        beams=Span(300, 360),
        view=Span(5.0, 6.0),
        angle_min=Span(-3.0, -2.0),
        increment=Span(0.01, 0.02),
        closure=tuple(item.name.lower() for item in Closure),
        range_min=Span(0.1, 0.2),
        range_max=Span(12.0, float("inf") if unknown else 30.0),
        clock=clock,
        by_status={status.name.lower(): 3 for status in Status if status != Status.PADDING},
        pose="" if unknown else "/tf (map > laser)",
    )
    mended = Finding("units", "error", "/scan", "laser", "far", fix=Fix("option", "--range-unit mm"))
    return LogInfo(
        path="run.mcap",
        format="mcap",
        compression="zstd",
        size=None if unknown else 99,
        parts=(Part("bags/run_0.mcap", "run_0.mcap", 99, lambda _: nullcontext(FakeLog())),),
        topics=(Topic("/scan", "sensor_msgs/msg/LaserScan", "cdr", None if unknown else 2),),
        scans=(scan,),
        pose_topics=("/tf",),
        pose_sources=(PoseInfo("/tf", "tf2_msgs/msg/TFMessage", 9, None if unknown else 2.0, 1, 2, (("map", "laser"),)),),
        dropped=(("/scan", "angle_increment is zero", 1),),
        findings=(mended, replace(mended, fix=None)) if unknown else (mended,),
        notes=("a note",),
        damage=("byte 5: cut off",),
    )


def keys(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every key below a value as the page writes it, and what it holds."""
    if isinstance(value, dict):
        for key, item in value.items():
            name = f"{path}.{key}" if path else key
            yield name, item
            yield from keys(item, name)
    elif isinstance(value, list):
        for item in value:
            yield from keys(item, f"{path}[]")


@pytest.mark.parametrize("unknown", [False, True])
def test_every_key_is_described_and_no_other(unknown: bool) -> None:
    (log,) = json.loads(as_json([info(unknown)]))
    written = dict(keys(log))
    described = {key: kind for key, kind, _, _ in ROWS}
    assert len(described) == len(ROWS)
    assert sorted(written) == sorted(described)
    for key, value in written.items():
        kind = described[key]
        assert type(value) in KINDS[kind], key
        if kind == "list of strings":
            assert {type(item) for item in value} == {str}, key
        if kind.startswith("pair"):
            assert len(value) == 2, key


def test_every_rule_is_explained() -> None:
    assert tuple(re.findall(r"^\| `(\w+)` \| (?:always|`--deep`|`--map`) \|", PAGE, re.MULTILINE)) == IDS
