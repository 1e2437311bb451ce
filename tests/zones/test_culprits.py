"""Who was in a zone: the line of text, the figures and the picture that is proposed name the same thing."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lidarcli.simulation import scene as make
from tests.zones.runs import scans, scene_of, sweeps_of, walker, write_bag

pytestmark = pytest.mark.slow
ZONE = """
[[zone]]
name = "stop"
circle = { x = 0.0, y = 0.0, radius = 1.5 }
action = "stop"
min_points = 12
"""


@pytest.fixture
def passed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A person passes a sensor at 1.2 m, between boxes; at the edge of the zone few points are in it."""
    monkeypatch.chdir(tmp_path)
    boxes = [make.box(3.0, 2.0, 0.4, 0.4), make.box(-2.0, -2.0, 0.5, 0.3), make.box(3.0, -3.0, 0.3, 0.3)]
    scene = scene_of(walker((1.2, -4.0), (1.2, 4.0)), *boxes, sweeps=80)
    (tmp_path / "stop.toml").write_text(ZONE)
    return write_bag(tmp_path / "a.bag", scans(sweeps_of(scene)))


def test_the_picture_that_is_proposed_marks_who_was_there(lidarcli: Callable[..., Any], passed: Path) -> None:
    ran = lidarcli("zones", passed.name, "--zones", "stop.toml", "-o", "out")
    (number,) = {*re.findall(r"agent (\d+)", ran.err)}
    (look,) = re.findall(r"  look     lidarcli (.*)", ran.err)
    assert lidarcli(*shlex.split(look), "--view", "scene", "-o", "look.svg").code == 0
    picture = Path("look.svg").read_text()
    assert f"{number} in stop" in picture
    assert "track with most points in a zone" in picture
    # The same from tables that are there.
    lidarcli("-q", "track", passed.name, "-o", "tables")
    ran = lidarcli("zones", passed.name, "--zones", "stop.toml", "--objects", "tables/a.objects.parquet")
    (look,) = re.findall(r"  look     lidarcli (.*)", ran.err)
    assert "--tracks tables/a.objects.parquet" in look
    lidarcli(*shlex.split(look), "--view", "scene", "-o", "again.svg")
    assert f"{number} in stop" in Path("again.svg").read_text()
    assert "--tracks" not in lidarcli("zones", passed.name, "--zones", "stop.toml", "--no-objects").err


def test_a_zone_has_one_nearest_point(lidarcli: Callable[..., Any], passed: Path) -> None:
    ran = lidarcli("zones", passed.name, "--zones", "stop.toml", "-o", "out")
    (told,) = re.findall(r"stop  1 event, .*, nearest (\d\.\d\d) m; 1 by agents", ran.err)
    figures = lidarcli("report", "out/a.events.parquet", "--format", "json").out
    (nearest,) = {*re.findall(r'"zones\.stop\.nearest": ([\d.]+)', figures)}
    assert f"{float(nearest):.2f}" == told
    assert f" {told} m " in lidarcli("report", "out/a.events.parquet").out
