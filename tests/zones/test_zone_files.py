"""Zone files in TOML: what is read, and each refusal as one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lidarcli.errors import LidarcliError, OptionError
from lidarcli.pipeline.inputs.zones import read_zones
from lidarcli.sweeps.masks import Circle, Mask, Mount, Polygon
from lidarcli.sweeps.zone import HOLD, Line, Zone
from tools.fuzz.mutate import mutate
from tools.fuzz.words import mutate_words

FULL = """[[zone]]
name = "stop"
frame = "robot"
polygon = [[0.6, 0.4], [0.6, -0.4], [-0.3, -0.4], [-0.3, 0.4]]
topic = "/scan"
action = "stop"
count = "agents"
min_points = 3
trigger = 2
hold = 1.5
[[zone]]
name = "door"
frame = "world"
line = [[2.0, 0.0], [2.0, 1.2]]
[[zone]]
name = "near_2-a"
circle = { x = 0.1, y = 0, radius = 0.5 }
action = "approach"
time_before_collision = 3
simulation_time_step = 0.2
[[mask]]
circle = { x = -0.2, y = 0, radius = 0.15 }
[[mount]]
frame = "laser"
parent = "base_link"
x = 0.2
"""
CIRCLE = '[[zone]]\nname = "a"\ncircle = { x = 0, y = 0, radius = 1 }\n'


def test_every_key_is_read(tmp_path: Path) -> None:
    (tmp_path / "z.toml").write_text(FULL)
    read = read_zones([str(tmp_path / "z.toml")])
    assert read.zones == (
        Zone(
            "stop",
            Polygon(((0.6, 0.4), (0.6, -0.4), (-0.3, -0.4), (-0.3, 0.4))),
            "robot",
            "stop",
            "agents",
            min_points=3,
            trigger=2,
            hold=1.5,
            topics=("/scan",),
        ),
        Zone("door", Line((2.0, 0.0), (2.0, 1.2)), "world", hold=HOLD),
        Zone("near_2-a", Circle(0.1, 0.0, 0.5), action="approach", hold=HOLD, time_before_collision=3.0, time_step=0.2),
    )
    assert read.masks.masks == (Mask(Circle(-0.2, 0.0, 0.15)),)
    assert read.masks.mounts == (Mount("laser", "base_link", 0.2, 0.0, 0.0),)
    assert (read.notes, read.robot) == ((), "")


def zone(**keys: str) -> str:
    """A zone with some keys in place of its own; an empty one is left out."""
    told = {"name": '"a"', "circle": "{ x = 0, y = 0, radius = 1 }"} | keys
    return "[[zone]]\n" + "".join(f"{key} = {value}\n" for key, value in told.items() if value)


def polygon(corners: str) -> str:
    return zone(circle="", polygon=corners)


def line(points: str, **keys: str) -> str:
    return zone(circle="", line=points, **keys)


PLACE = "z.toml: [[zone]] number 1: "
REFUSALS = {
    "": "z.toml: no [[zone]] in this file",
    "[[mask]]\ncircle = { x = 0, y = 0, radius = 1 }\n": "z.toml: no [[zone]] in this file",
    CIRCLE + "[[zone]]\n": "z.toml: [[zone]] number 2: 'polygon' is missing: a zone is a polygon, circle or line",
    CIRCLE * 2: "z.toml: [[zone]] number 2: 'a' is there twice",
    CIRCLE + "[[mask]]\n": "z.toml: [[mask]] number 1: 'circle' is missing: a mask is a circle, polygon or sector",
    CIRCLE + '[[mount]]\nframe = "a"\nparent = "a"\n': "z.toml: [[mount]] number 1: 'parent' leads back to "
    "where it began, by the frames a",
    zone(name='"a b"'): "the name 'a b' must be of letters, digits, _ and - only",
    zone(
        colour='"red"'
    ): "unknown key 'colour'; known keys: polygon, circle, line, name, frame, topic, action, count, min_points, trigger, "
    "hold, time_before_collision, simulation_time_step",
    zone(line="[[0, 0], [1, 0]]"): "'line' and 'circle' exclude each other: a zone has one shape",
    polygon("[[0, 0], [1, 0], [1, 1e7]]"): "'polygon' must hold numbers between -1e+06 and 1e+06, not 10000000.0",
    polygon(f"[{'[0, 0], ' * 101}]"): "'polygon' has more than 100 corners",
    polygon("[[0, 0], [1, 1], [1, 0], [0, 1]]"): "'polygon' crosses itself: the edges from corner 1 to 2 and from 3 to 4",
    polygon(
        "[[0, 1], [1, 1], [0, 0], [1, 0], [1, 0.5], [-1, 0.5]]"
    ): "'polygon' crosses itself: the edges from corner 2 to 3 and from 5 to 6",
    polygon("[[0, 0], [1, 0], [2, 0]]"): "'polygon' has no area: its corners lie on one line",
    line("[[0, 0], [1, 0], [2, 0]]"): "'line' must be two points, not 3",
    line("[[0, 1], [0.0, 1]]"): "'line' has no length: both points are the same",
    line("[[0, 1], [1, 1]]", action='"approach"'): "'action' cannot be approach with a line, which has no inside",
    line("[[0, 1], [1, 1]]", hold="1"): "'hold' and 'line' exclude each other: paths that cross a line count, not points",
    zone(action='"halt"'): "'action' must be one of stop, slowdown, limit, approach, none, not 'halt'",
    zone(hold="-1"): "'hold' must be at least 0 and at most 3600.0, not -1",
    zone(topic="['/a']"): "'topic' must be a text, not a list",
    zone(time_before_collision="1"): "'time_before_collision' is for action approach, not none",
    zone(action='"stop"', simulation_time_step="1"): "'simulation_time_step' is for action approach, not stop",
    zone(
        action='"approach"', simulation_time_step="0.001"
    ): "'simulation_time_step' must be at least 0.002: no more than 1,000 times are tested",
}


@pytest.mark.parametrize("text", REFUSALS)
def test_each_refusal_is_a_line(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("z.toml").write_text(text)
    with pytest.raises(OptionError) as err:
        read_zones(["z.toml"])
    line = REFUSALS[text]
    assert str(err.value) == (line if line.startswith("z.toml") else PLACE + line)


def test_files_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.toml").write_text(FULL)
    Path("b.toml").write_text(CIRCLE)
    read = read_zones(["a.toml", "b.toml"])
    assert [each.name for each in read.zones] == ["stop", "door", "near_2-a", "a"]
    assert len(read.masks.masks) == len(read.masks.mounts) == 1
    with pytest.raises(OptionError, match=r"^b\.toml: \[\[zone\]\] number 1: 'a' is there twice$"):
        read_zones(["b.toml", "b.toml"])
    Path("c.toml").write_text(CIRCLE)
    with pytest.raises(OptionError, match=r"^c\.toml: \[\[zone\]\] number 1: 'a' is there twice, in b\.toml too$"):
        read_zones(["b.toml", "c.toml"])


@pytest.mark.slow
def test_mutated_files_are_read_or_refused(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        data = mutate_words(FULL, random).encode("utf-8", "replace")
        if not random.integers(3):
            data = mutate(data, random)
        (tmp_path / "z.toml").write_bytes(data)
        try:
            read_zones([str(tmp_path / "z.toml")])
        except LidarcliError:
            refused += 1
    assert refused > 60
