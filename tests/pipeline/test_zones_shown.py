"""Zones in pictures and overlays: where they lie before the sensor, and which beams count in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.detection import SETS
from lidarcli.logs import open_log
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.plotting import PlotOptions, take_pictures
from lidarcli.pipeline.zones.frames import Frames
from lidarcli.pipeline.zones.shown import Showing, ShownZone
from lidarcli.sweeps.masks import Circle, Masks, Mount, Polygon
from lidarcli.sweeps.types import SweepBatch, UInt8
from lidarcli.sweeps.zone import ROBOT, WORLD, Case, Line, Zone, Zones
from tests.overlays.reading import read_back
from tests.overlays.silent import LATE, silenced
from tests.places import SAMPLES
from tests.sweeping import START

Run = Callable[..., Any]
AT = 1.5 * math.cos(math.radians(35)), 1.5 * math.sin(math.radians(35))
"""The middle of the box that stands in the first ten of twenty sweeps: 30 beams, a degree apart, at 1.5 m."""
BOX = Circle(*AT, 0.2)
"""It holds the beams that are no more than 7 degrees away: a chord of 0.2 m spans 7.6 degrees at 1.5 m."""
INSIDE = 15
LEFT = Mount("laser", "base_link", 0.2, 0.0, math.pi / 2)


@pytest.fixture(scope="module")
def room(logs: Path) -> Iterator[tuple[Log, SweepBatch]]:
    with open_log(logs / "run.mcap") as log:
        [batch] = read_batches(log, ReadOptions(), ReadReport())
        yield log, batch


def shown(
    room: tuple[Log, SweepBatch], *zones: Zone, masks: Masks | None = None, sets: UInt8 | None = None
) -> tuple[dict[str, ShownZone], list[str]]:
    """The zones by name, and the notes."""
    log, batch = room
    told = Zones(zones, masks or Masks())
    showing = Showing(told, Frames.of(log, told))
    return {one.zone.name: one for one in showing.of(batch, sets)}, showing.notes()


def counts(one: ShownZone) -> list[int]:
    return np.count_nonzero(one.beams, axis=1).tolist()


def test_a_zone_is_occupied_while_enough_beams_end_in_it(room: tuple[Log, SweepBatch]) -> None:
    found, notes = shown(room, Zone("box", BOX), Zone("more", BOX, min_points=INSIDE + 1))
    assert counts(found["box"]) == counts(found["more"]) == [INSIDE] * 10 + [0] * 10
    assert np.flatnonzero(found["box"].beams[0]).tolist() == [*range(208, 223)]
    assert found["box"].occupied.tolist() == [True] * 10 + [False] * 10
    assert not found["more"].occupied.any()
    assert found["box"].corners.shape == (20, 64, 2)
    assert notes == []


def test_a_zone_of_the_robot_comes_through_its_mounts(room: tuple[Log, SweepBatch]) -> None:
    # The laser looks to the left of the robot, 0.2 m ahead of its middle.
    seen_by_robot = Circle(0.2 - AT[1], AT[0], 0.2)
    for frame in (ROBOT, "base_link"):
        found, _ = shown(room, Zone("box", seen_by_robot, frame), masks=Masks(mounts=(LEFT,)))
        assert counts(found["box"]) == [INSIDE] * 10 + [0] * 10
        assert found["box"].corners.mean(axis=1) == pytest.approx(np.tile(AT, (20, 1)))


def test_what_counts(room: tuple[Log, SweepBatch]) -> None:
    things, agents = Zone("things", BOX, count="things"), Zone("agents", BOX, count="agents")
    other = Zone("other", BOX, topics=("/other",))
    found, notes = shown(room, things, agents, other)
    assert [counts(one)[0] for one in found.values()] == [0, 0, 0]
    assert notes == [
        "zone things counts things, and nobody knows which beams are on them",
        "zone agents counts agents, and nobody knows which beams are on them",
    ]
    sets = np.full(room[1].ranges.shape, SETS.index("S"), np.uint8)
    sets[:, 208:212], sets[:, 212:214] = SETS.index("O"), SETS.index("A")
    found, notes = shown(room, things, agents, other, sets=sets)
    assert [counts(one)[0] for one in found.values()] == [6, 2, 0]
    assert notes == []


def test_a_line_is_drawn_and_never_occupied(room: tuple[Log, SweepBatch]) -> None:
    found, _ = shown(room, Zone("door", Line((1.0, -1.0), (1.0, 1.0))))
    assert found["door"].corners[3].tolist() == [[1.0, -1.0], [1.0, 1.0]]
    assert not found["door"].occupied.any()


def test_zones_that_cannot_be_placed_are_left_out_with_a_note(room: tuple[Log, SweepBatch]) -> None:
    case = Case("slow", Polygon(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))), (0.0, 1.0), (-1.0, 1.0))
    found, notes = shown(
        room,
        Zone("arm", BOX, "gripper"),
        Zone("hall", BOX, WORLD),
        Zone("fast", None, cases=(case,)),
        Zone("told", None, shape_topic="/footprint"),
        Zone("box", BOX),
    )
    assert [*found] == ["box"]
    assert notes[0].startswith(
        "zone arm is not drawn: nothing leads from frame laser to gripper; add to the zone file (Nav2: to one for --mask), "
        "a line each: [[mount]]"
    )
    assert notes[1:] == [
        "zone hall is not drawn: nothing tells where the sensor is in the world",
        "zone fast is not drawn: its shape depends on the velocity",
        "zone told is not drawn: /footprint tells its shape",
    ]


def test_pictures_name_zones_and_their_points(logs: Path) -> None:
    zones = Zones((Zone("box", BOX, action="stop"), Zone("free", Circle(0.0, 0.0, 0.5))))
    source = Source(str(logs / "run.mcap"), "run")
    first, last = take_pictures(source, PlotOptions((3, 15), zones=zones)).pictures
    assert [one.words for one in first.zones] == ["box (stop): 15 points", "free"]
    assert [one.words for one in last.zones] == ["box (stop)", "free"]
    assert np.count_nonzero(first.zones[0].beams) == INSIDE


def test_a_zone_outside_of_the_picture_is_told(logs: Path) -> None:
    far, across = Line((90.0, -1.0), (90.0, 1.0)), Line((1.0, -90.0), (1.0, 90.0))
    zones = Zones((Zone("far", far), Zone("across", across)))
    drawn = take_pictures(Source(str(logs / "run.mcap"), "run"), PlotOptions((3, 15), zones=zones))
    assert [note for note in drawn.notes if "zone" in note] == ["zone far lies outside of the picture"]


ZONES = f"""\
[[zone]]
name = "box"
circle = {{ x = {AT[0]}, y = {AT[1]}, radius = 0.2 }}
action = "stop"
[[zone]]
name = "door"
line = [[3.0, -1.0], [3.0, 1.0]]
[[zone]]
name = "arm"
frame = "gripper"
circle = {{ x = 1.0, y = 0.0, radius = 0.2 }}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "zones.toml"
    path.write_text(ZONES, encoding="utf-8")
    return path


def test_what_plot_refuses_of_zones(lidarcli: Run, logs: Path, tmp_path: Path, file: Path) -> None:
    for view in ("sweep", "map"):
        ran = lidarcli("plot", logs / "run.mcap", "--view", view, "--zones", file, "-o", tmp_path / "p.png")
        assert (ran.code, "--zones" in ran.err) == (2, True)
    ran = lidarcli("plot", logs / "run.mcap", "--zones", tmp_path / "no.toml", "-o", tmp_path / "p.png")
    assert ran.code == 3
    assert ran.err == f"lidarcli: {tmp_path}/no.toml: cannot read the zone file: No such file or directory\n"


def test_overlays_show_zones_bright_while_they_are_occupied(lidarcli: Run, logs: Path, tmp_path: Path, file: Path) -> None:
    out = tmp_path / "o.mcap"
    ran = lidarcli("overlay", logs / "run.mcap", "--zones", file, "-o", out, "--no-layout")
    assert ran.code == 0
    assert "zone arm is not drawn" in ran.err
    messages = [each.message for each in read_back(out, "/lidarcli/objects")]
    assert len(messages) == 20
    for k, message in enumerate(messages):
        box, door = (marker for marker in message.markers if marker.ns == "zones")
        assert (box.type, box.header.frame_id, len(box.points), len(door.points)) == (4, "laser", 65, 3)
        assert (box.points[0].x, box.points[0].y) == pytest.approx((AT[0] + 0.2, AT[1]))
        assert (door.points[1].x, door.points[1].y) == (3.0, 1.0)
        assert box.color.a == pytest.approx(1.0 if k < 10 else 0.35)
        assert box.scale.x == pytest.approx(0.06 if k < 10 else 0.02)
        # Vermilion, as of the action.
        assert (box.color.r, box.color.g, box.color.b) == pytest.approx((1.0, 0.541, 0.239), abs=0.001)
        assert (door.color.a, door.scale.x) == pytest.approx((0.35, 0.02))


@pytest.mark.parametrize(("timeout", "silent"), [(0.5, [1_500]), (1.5, [])])
def test_overlays_tell_while_a_topic_is_silent(lidarcli: Run, tmp_path: Path, timeout: float, silent: list[int]) -> None:
    log, zones, kept = silenced(tmp_path, timeout)
    out = tmp_path / "o.mcap"
    ran = lidarcli("overlay", log, "--zones", zones, "-o", out, "--no-layout", "--pose", "none")
    assert ran.code == 0
    found = [(each.record_ns, each.message) for each in read_back(out, "/lidarcli/objects")]
    assert len(found) == kept + len(silent)
    told = [(at, marker) for at, message in found for marker in message.markers if marker.text == "no /scan"]
    assert [(at - START - LATE) // 10**6 for at, _ in told] == silent
    assert all((marker.type, marker.header.frame_id) == (9, "laser") for _, marker in told)


@pytest.mark.slow
def test_a_zone_of_the_world_stays_there_while_the_robot_drives(lidarcli: Run, tmp_path: Path) -> None:
    (tmp_path / "hall.toml").write_text(
        '[[zone]]\nname = "hall"\nframe = "world"\nline = [[1.0, 2.0], [3.0, 2.5]]\n', encoding="utf-8"
    )
    log = SAMPLES / "drive.db3"
    assert lidarcli("-q", "track", log, "-o", tmp_path).code == 0
    out, tables = tmp_path / "o.mcap", tmp_path / "drive.objects.parquet"
    ran = lidarcli("overlay", log, "--objects", tables, "--zones", tmp_path / "hall.toml", "-o", out, "--no-layout")
    assert ran.code == 0
    poses = pq.read_table(tmp_path / "drive.sweeps.parquet").to_pandas()
    messages = [each.message for each in read_back(out, "/lidarcli/objects")]
    assert len(messages) == len(poses)
    for message, x, y, yaw in zip(messages, poses.pose_x, poses.pose_y, poses.pose_yaw, strict=True):
        [line] = [marker for marker in message.markers if marker.ns == "zones"]
        for point, corner in zip(line.points, [(1.0, 2.0), (3.0, 2.5), (1.0, 2.0)], strict=True):
            there = (
                x + math.cos(yaw) * point.x - math.sin(yaw) * point.y,
                y + math.sin(yaw) * point.x + math.cos(yaw) * point.y,
            )
            assert there == pytest.approx(corner, abs=1e-9)
