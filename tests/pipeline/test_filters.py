"""Masks as filters of laser_filters: read anew and applied by the rules of that package, they take out the same beams."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from lidarcli.errors import OptionError
from lidarcli.pipeline.inputs.laser_filters import View, filter_text
from lidarcli.pipeline.inputs.masks import mask_text, read_masks
from lidarcli.sweeps.masks import Circle, Mask, Masks, Mount, Sector
from lidarcli.sweeps.types import TURN, Bool, Float32, RawSweeps
from tests.sweeping import raw_sweeps


def chain(text: str, node: str) -> list[dict[str, Any]]:
    """The parameters of the filters of one node, in the order of their numbers."""
    filters = YAML(typ="safe").load(text)[node]["ros__parameters"]
    assert list(filters) == [f"filter{number}" for number in range(1, len(filters) + 1)]
    assert {each["type"] for each in filters.values()} == {"laser_filters/LaserScanSectorFilter"}
    assert len({each["name"] for each in filters.values()}) == len(filters)
    return [each["params"] for each in filters.values()]


def taken_out(filters: list[dict[str, float]], raw: RawSweeps) -> Bool:
    """(S, B) the beams that LaserScanSectorFilter sets beyond range_max: those within all of its limits, ends left out."""
    out = np.zeros(raw.ranges.shape, bool)
    for row in range(len(raw)):
        for told in filters:
            # The program adds up the increments, which a message has as float32.
            angle = float(np.float32(raw.angle_min[row]))
            width = told["angle_max"] - told["angle_min"]
            assert width > 0
            for beam in range(int(raw.beams[row])):
                value = float(raw.ranges[row, beam])
                inside = 0 < angle - told["angle_min"] < width
                out[row, beam] |= inside and told["range_min"] < value < told["range_max"]
                angle += float(np.float32(raw.angle_increment[row]))
    return out


def near(edges: list[float], rng: np.random.Generator, shape: tuple[int, int]) -> Float32:
    """(S, B) ranges at the limits of masks, just beside them and anywhere."""
    values = np.array(edges, np.float32)
    beside = [values, np.nextafter(values, np.float32(0)), np.nextafter(values, np.float32(99))]
    ranges: Float32 = rng.choice(np.concatenate([*beside, rng.uniform(0.05, 3.0, 9)]), shape).astype(np.float32)
    return ranges


@pytest.mark.parametrize("seed", range(8))
def test_filters_take_out_what_is_masked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    beams = 180
    step = float(np.float32(rng.choice([-1, 1]) * rng.choice([TURN / beams, 0.017, 0.026])))
    first = float(np.float32(rng.uniform(-TURN, TURN)))
    masks = []
    for _ in range(6):
        # Half a step beside beams, as masks are learned, but in any turn.
        one, two = np.sort(rng.integers(0, beams, 2))
        begin, end = sorted((first + (one - 0.5) * step, first + (two + 0.5) * step))
        turns = TURN * rng.integers(-1, 2)
        low = round(float(rng.uniform(0.0, 1.0)), 6)
        sector = Sector(begin + turns, end + turns, low, round(low + float(rng.uniform(0.0, 1.0)), 6))
        masks.append(Mask(sector, rng.choice(["", "/scan", "scan", "/other"])))
    edges = [edge for mask in masks for edge in (mask.shape.nearest, mask.shape.farthest)]  # type: ignore[union-attr]
    raw = raw_sweeps(near(edges, rng, (12, beams)), angle_min=first, angle_increment=step, range_min=0.0, range_max=30.0)
    last = first + (beams - 1) * step
    text = filter_text(Masks(tuple(masks)), [View("/scan", min(first, last), max(first, last))])
    masked = Masks(tuple(masks)).under(raw, raw.ranges)
    assert masked.any()
    np.testing.assert_array_equal(taken_out(chain(text, "scan_to_scan_filter_chain"), raw), masked)


def test_each_topic_has_a_node_of_its_own() -> None:
    masks = Masks((Mask(Sector(-0.1, 0.1, 0.2, 0.3), "/a/left_scan"), Mask(Sector(1.0, 1.1, 0.2, 0.3), "right")))
    views = [View("/a/left_scan", -1.5, 1.5), View("right", -1.5, 1.5), View("/clear", -1.5, 1.5)]
    text = filter_text(masks, views)
    assert list(YAML(typ="safe").load(text)) == ["a_left_scan_filter_chain", "right_filter_chain"]
    assert (
        "# ros2 run laser_filters scan_to_scan_filter_chain --ros-args -r scan:=/a/left_scan -r "
        "__node:=a_left_scan_filter_chain --params-file FILE\n"
    ) in text
    assert len(re.findall("LaserScanSectorFilter", text)) == 2


def test_other_masks_are_refused() -> None:
    with pytest.raises(OptionError, match=r"sectors of bearings; write other masks to a \.toml file"):
        filter_text(Masks((Mask(Circle(0.1, 0.0, 0.3)),)), [View("/scan", -1.5, 1.5)])


@pytest.mark.parametrize("masks", [(), (Mask(Sector(-0.1, 0.2, 0.2, 0.3), "/scan"),)])
def test_mounts_are_written_and_read_back(tmp_path: Path, masks: tuple[Mask, ...]) -> None:
    mounts = (Mount("laser", "base_link", -0.13, 0.0, 0.5), Mount("rear", "base_link", 0.1, 0.2, 3.0, True))
    (tmp_path / "robot.toml").write_text(mask_text(Masks(masks, mounts), Masks()))
    found = read_masks(str(tmp_path / "robot.toml"))
    assert len(found.masks) == len(masks)
    assert [(each.frame, each.parent, each.x, each.y, each.upside_down) for each in found.mounts] == [
        (each.frame, each.parent, each.x, each.y, each.upside_down) for each in mounts
    ]
    np.testing.assert_allclose([each.yaw for each in found.mounts], [0.5, 3.0], atol=1e-7)


def test_names_of_topics_stay_names() -> None:
    topics = ("/a-b", "/a_b", "/scan\nevil: {}\n# \x1b[31m; reboot")
    masks = Masks((Mask(Sector(0.0, 1.0, 0.0, 1.0)),))
    text = filter_text(masks, [View(topic, -TURN / 2, TURN / 2) for topic in topics])
    nodes = YAML(typ="safe").load(text)
    assert len(nodes) == len(topics)
    assert "evil" not in nodes
    assert all(line.isprintable() for line in text.split("\n"))
    assert len(shlex.split(next(line for line in text.splitlines() if "evil" in line)[1:])) == 11
