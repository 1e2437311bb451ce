"""Changes from run to run, in drawn scenes whose changes are known."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli as package
from lidarcli.errors import UnreadableError
from lidarcli.pipeline.differences.changes import Difference
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Entity, SceneSensor, super_ellipse
from lidarcli.tabular.schemas import CHANGES
from tests.diff.drawn import ODOMETRY, ROOM, SENSORS, closed, parked, write_run
from tests.places import REAL_LOGS, needs_real_logs

Run = Callable[..., Any]

WALLS = closed(ROOM)
BOXES = (
    make.box(2.5, -1.2, 0.6, 0.4, 0.3),
    make.box(-2.6, -1.6, 0.8, 0.5, 1.1),
    make.box(-2.2, 1.6, 0.5, 0.35, -0.5),
    make.box(0.3, 1.9, 0.7, 0.45, 0.8),
    make.box(0.6, -2.1, 0.45, 0.3, 0.2),
)
SCENE = (WALLS, *BOXES)
DRIVE = Course(super_ellipse(0.7, 0.5, 2.0), 0.4)


def counts(found: Difference) -> dict[str, int]:
    return dict(Counter(found.changes["status"].to_pylist()))


def rows(found: Difference, status: str) -> list[dict[str, Any]]:
    return [row for row in found.changes.to_pylist() if row["status"] == status]


def without(scene: tuple[Entity, ...], *gone: Entity) -> tuple[Entity, ...]:
    return tuple(each for each in scene if each not in gone)


@pytest.fixture(scope="module")
def monday(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_run(tmp_path_factory.mktemp("runs") / "monday.mcap", SCENE)


def test_a_run_with_itself(monday: str) -> None:
    found = package.diff(monday, monday)
    assert counts(found) == {"known": 5}
    assert found.changes.schema.equals(CHANGES)
    assert found.figures == {**dict.fromkeys(("moved", "new", "gone", "uncertain"), 0.0), "known": 5.0, "overlap": 1.0}
    assert max(found.changes["moved"].to_pylist()) == 0.0


@pytest.mark.slow
def test_a_box_half_a_metre_on(monday: str, tmp_path: Path) -> None:
    box = BOXES[0]
    tuesday = write_run(tmp_path / "t.mcap", (*without(SCENE, box), replace(box, x=box.x - 0.3, y=box.y + 0.4)), seed=1)
    found = package.diff(monday, tuesday)
    assert counts(found) == {"known": 4, "moved": 1}
    (moved,) = rows(found, "moved")
    assert moved["moved"] == pytest.approx(0.5, abs=0.03)
    assert (moved["x_b"], moved["y_b"]) == pytest.approx((box.x - 0.3, box.y + 0.4), abs=0.05)
    assert abs(moved["turned"]) < 0.05
    assert moved["score"] > 0.9


@pytest.mark.slow
def test_what_was_taken_is_gone_and_new_the_other_way_round(monday: str, tmp_path: Path) -> None:
    box = BOXES[1]
    tuesday = write_run(tmp_path / "t.mcap", without(SCENE, box), parked(0.3, -0.2, 0.7), seed=1)
    found, back = package.diff(monday, tuesday), package.diff(tuesday, monday)
    assert counts(found) == {"known": 4, "gone": 1}
    assert counts(back) == {"known": 4, "new": 1}
    ((gone,), (new,)) = rows(found, "gone"), rows(back, "new")
    assert (gone["x_a"], gone["y_a"]) == pytest.approx((box.x, box.y), abs=0.05)
    assert (gone["x_b"], gone["track_b"], gone["free_a"]) == (None, None, None)
    assert (gone["free_b"], gone["sweeps_b"]) == (pytest.approx(1.0, abs=0.2), pytest.approx(40, abs=2))
    # In the coordinates of the other run, whose sensor stood elsewhere.
    dx, dy = box.x - 0.3, box.y + 0.2
    cos, sin = math.cos(0.7), math.sin(0.7)
    assert (new["x_b"], new["y_b"]) == pytest.approx((cos * dx + sin * dy, cos * dy - sin * dx), abs=0.05)
    assert found.figures["overlap"] == pytest.approx(back.figures["overlap"])


@pytest.mark.slow
def test_what_is_behind_a_new_wall_is_hidden(monday: str, tmp_path: Path) -> None:
    screen = make.wall([[1.6, -2.6], [1.6, 0.2]])
    tuesday = write_run(tmp_path / "t.mcap", (*without(SCENE, BOXES[0]), screen), seed=1)
    found = package.diff(monday, tuesday)
    assert [(row["why"], row["kind"]) for row in rows(found, "uncertain")] == [("hidden", "thing")]
    (new,) = rows(found, "new")
    assert (new["kind"], new["length"]) == ("structure", pytest.approx(2.8, abs=0.3))
    assert (new["x_b"], new["y_b"]) == pytest.approx((1.6, -1.2), abs=0.2)


@pytest.mark.slow
def test_a_room_that_was_not_entered_is_out_of_view(tmp_path: Path) -> None:
    """Through the door of the first room nothing of the second one is seen."""
    door = (
        make.wall([[-3, -2], [3, -2], [3, 0.2]]),
        make.wall([[3, 1.0], [3, 2.5], [-3, 2.5], [-3, -2]]),
        make.wall([[3, 0.2], [3.4, 0.2], [3.4, -2.5], [8, -2.5], [8, 3.0], [3.4, 3.0], [3.4, 1.0], [3, 1.0]]),
    )
    mine = (make.box(-1.5, 1.2, 0.6, 0.4, 0.4), make.box(1.2, -1.1, 0.5, 0.3, 1.0))
    theirs = make.box(5.0, -1.8, 0.6, 0.5, 0.2)
    way = Course(np.array([[-0.5, 0.3], [0.0, 0.1], [2.0, 0.6], [5.5, 0.6], [5.5, 0.7], [2.0, 0.7]]), 1.0)
    both = write_run(tmp_path / "a.mcap", (*door, *mine, theirs), way, sweeps=120, odometry=ODOMETRY)
    one = write_run(tmp_path / "b.mcap", (*door, *mine), parked(-0.8, -0.4), odometry=ODOMETRY)
    found = package.diff(both, one)
    (unseen,) = rows(found, "uncertain")
    assert (unseen["why"], unseen["sweeps_b"]) == ("out of view", 0)
    assert (unseen["x_a"], unseen["y_a"]) == pytest.approx((theirs.x, theirs.y), abs=0.15)
    assert counts(found) == {"known": 2, "uncertain": 1}


@pytest.mark.slow
def test_of_two_like_boxes_that_were_both_moved_nobody_can_tell(tmp_path: Path) -> None:
    """Each of them is as far from both new places."""
    like = [make.box(*at, 0.5, 0.3, 0.4) for at in ((-1.5, -1.5), (1.5, -1.5), (-1.5, 1.5), (1.5, 1.5))]
    runs = [
        write_run(tmp_path / f"{name}.mcap", (WALLS, BOXES[1], *boxes), seed=seed)
        for seed, (name, boxes) in enumerate((("a", (like[0], like[3])), ("b", (like[1], like[2]))))
    ]
    found = package.diff(*runs, align="as-is")
    assert counts(found) == {"known": 1, "uncertain": 4}
    assert {row["why"] for row in rows(found, "uncertain")} == {"ambiguous"}
    assert max(row["score"] for row in rows(found, "uncertain")) <= 0.6


@pytest.mark.slow
def test_another_building_is_refused(monday: str, tmp_path: Path) -> None:
    hall = (closed(((-7, -1.2), (9, -1.2), (9, 1.5), (-7, 1.5))), make.box(3, 0.5, 0.4, 0.4, 0.1))
    other = write_run(tmp_path / "hall.mcap", hall)
    for runs in ((monday, other), (other, monday)):
        with pytest.raises(UnreadableError, match=r"do not lie on each other: \d+% of the structure at best, 60% "):
            package.diff(*runs)
    with pytest.raises(UnreadableError, match=r"as they are, that is \(--align search\)$"):
        package.diff(monday, other, align="as-is")


@pytest.mark.slow
def test_an_empty_rectangle_lies_in_two_ways(tmp_path: Path) -> None:
    rectangle = (closed(((-3, -2), (3, -2), (3, 2), (-3, 2))),)
    one, other = (
        write_run(tmp_path / f"{seed}.mcap", rectangle, where, seed=seed)
        for seed, where in enumerate((parked(), parked(0.8, -0.4, 1.2)))
    )
    with pytest.raises(UnreadableError, match="lie on each other in two ways: nothing tells which one is right"):
        package.diff(one, other)


@pytest.mark.slow
def test_a_sensor_that_was_driven_on_in_a_corridor(tmp_path: Path) -> None:
    """Nothing has changed, and the old place fits as well as the true one, which is 2 m or 3 m further on."""
    walls = make.wall([[-20, -1], [20, -1]]), make.wall([[-20, 1], [20, 1]])
    box = make.box(3.0, -0.7, 0.5, 0.4, 0.0)
    runs = [write_run(tmp_path / f"{x}.mcap", (*walls, box), parked(x), seed=x) for x in (0, 2)]
    with pytest.raises(UnreadableError, match="may slide on each other along their walls"):
        package.diff(*runs)
    assert counts(package.diff(runs[0], runs[0])) == {"known": 1}
    pillars = [make.box(x, 1.35, 0.3, 0.3, 0.0) for x in range(-9, 10, 3)]
    wide = make.wall([[-12, -1.5], [12, -1.5]]), make.wall([[-12, 1.5], [12, 1.5]])
    scene = *wide, *pillars, make.box(1.0, -0.5, 0.5, 0.4, 0.0)
    runs = [write_run(tmp_path / f"p{x}.mcap", scene, parked(x), seed=1) for x in (0, 3)]
    with pytest.raises(UnreadableError, match="lie on each other in two ways"):
        package.diff(*runs)
    # Exactly a period further on all is as it was, and the frames cannot tell.
    runs = [write_run(tmp_path / f"q{x}.mcap", scene[:-1], parked(x), seed=x) for x in (0, 3)]
    found = package.diff(*runs)
    assert {(row["status"], row["why"]) for row in found.changes.to_pylist()} == {("known", None)}
    (note,) = found.notes
    assert "in a second way, shifted by 3.0 m, as along a row of like pillars" in note
    moved = write_run(tmp_path / "moved.mcap", (*SCENE[:-1], replace(BOXES[4], x=-0.6)), seed=1)
    assert package.diff(write_run(tmp_path / "room.mcap", SCENE), moved).notes == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("yaw", "x", "y", "statuses"),
    [(0.5 * np.pi, 1.4, 1.4, ["known"]), (0.0, -1.0, 0.6, ["moved"]), (0.0, 1.4, 1.4, ["known"])],
)
def test_a_square_room_that_is_turned_has_no_moved_thing(
    tmp_path: Path, yaw: float, x: float, y: float, statuses: list[str]
) -> None:
    """The turn that explains all wins over the old place and a thing that was moved just so; half of it does not."""
    room = closed(((-3, -3), (3, -3), (3, 3), (-3, 3)))
    one = write_run(tmp_path / "one.mcap", (room, make.box(1.4, 1.4, 0.4, 0.4, 0.0)), seed=1)
    other = write_run(tmp_path / "other.mcap", (room, make.box(x, y, 0.4, 0.4, 0.0)), parked(yaw=yaw), seed=2)
    found = package.diff(one, other, align="search")
    assert [row["status"] for row in found.changes.to_pylist()] == statuses
    assert found.steps[0].motion.turn == pytest.approx(yaw, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.4, 0.4), (0.45, 0.3), (0.5, 0.3), (0.8, 0.5)])
def test_runs_that_are_exchanged_tell_the_mirror_image(size: tuple[float, float], monday: str, tmp_path: Path) -> None:
    """Also where a part of the place of a box was seen free, as another one stands there."""
    box = BOXES[0]
    tuesday = write_run(tmp_path / "t.mcap", (*without(SCENE, box), make.box(box.x, box.y, *size, 0.3)), seed=1)
    found, back = package.diff(monday, tuesday), package.diff(tuesday, monday)
    mirror = {"new": "gone", "gone": "new"}
    told = [(row["status"], row["why"], row["track_a"], row["track_b"]) for row in found.changes.to_pylist()]
    assert sorted(map(str, told)) == sorted(
        str((mirror.get(row["status"], row["status"]), row["why"], row["track_b"], row["track_a"]))
        for row in back.changes.to_pylist()
    )


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("turn", [math.pi / 2, -2.0])
def test_frames_that_are_turned(sensor: SceneSensor, turn: float, tmp_path: Path) -> None:
    box = BOXES[4]
    one = write_run(tmp_path / "a.mcap", SCENE, parked(0, 0, 0.2), sensor)
    other = write_run(tmp_path / "b.mcap", without(SCENE, box), parked(0.2, 0.1, 0.2 + turn), sensor, seed=1)
    found = package.diff(one, other)
    step = found.steps[0]
    assert (step.motion.angle - turn + math.pi) % math.tau - math.pi == pytest.approx(0.0, abs=0.02)
    cos, sin = math.cos(0.2), math.sin(0.2)
    assert (step.motion.x, step.motion.y) == pytest.approx((cos * 0.2 + sin * 0.1, cos * 0.1 - sin * 0.2), abs=0.03)
    assert {*counts(found)} <= {"known", "gone", "uncertain"}
    if sensor is not SENSORS[1]:
        # A view of 270 degrees leaves it out.
        assert counts(found)["gone"] == 1


@pytest.mark.slow
def test_a_localisation_that_is_off_is_put_right_and_told(tmp_path: Path) -> None:
    """By the poses of the second run all of the room lies 0.25 m farther on."""
    shifted = (
        closed([(x + 0.25, y) for x, y in ROOM]),
        *(replace(box, x=box.x + 0.25) for box in BOXES if box is not BOXES[3]),
    )
    one = write_run(tmp_path / "a.mcap", SCENE, odometry=ODOMETRY)
    other = write_run(tmp_path / "b.mcap", shifted, seed=1, odometry=ODOMETRY)
    found, back = package.diff(one, other), package.diff(other, one)
    assert counts(found) == {"known": 4, "gone": 1}
    assert counts(back) == {"known": 4, "new": 1}
    for each, way in ((found, -1.0), (back, 1.0)):
        motion = each.steps[0].motion
        assert (motion.x, motion.y, motion.angle) == pytest.approx((0.25 * way, 0.0, 0.0), abs=0.01)
        assert each.lines[0].startswith("shifted, in the frame map: 0.25 m, 0.0 degrees; 9")
        assert re.search(r"lie better on each other if shifted by 0.25 m, 0.0 degrees: 9\d% of the", each.notes[-1])
    asis = package.diff(one, other, align="as-is")
    assert asis.notes[-1] == found.notes[-1]
    assert asis.lines[0] == (
        "as they are, in the frame map; only 67% of the structure in place: a path may drift, so doubt each change"
    )
    # All of them by as much as the localisation is off.
    drifts = [row["moved"] for row in rows(asis, "uncertain") if row["why"] == "drift"]
    assert len(drifts) >= 4
    assert drifts == pytest.approx([0.25] * len(drifts), abs=0.05)
    assert counts(asis).get("moved", 0) == 0


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maps of the room, and of the room with a shelf."""
    folder = tmp_path_factory.mktemp("maps")
    shelf = make.wall([[-4.0, 0.0], [-3.6, 0.0], [-3.6, 1.0], [-4.0, 1.0]])
    for name, scene in (("room", SCENE), ("shelf", (*SCENE, shelf))):
        log = write_run(folder / f"{name}.mcap", scene, DRIVE, sweeps=120, odometry=ODOMETRY)
        package.map(log, folder / f"{name}.yaml", min_move=0.05)
    return folder


@pytest.mark.slow
def test_a_shelf_on_a_map(maps: Path) -> None:
    found = package.diff(maps / "room.yaml", maps / "shelf.yaml")
    assert counts(found) == {"new": 1}
    (new,) = rows(found, "new")
    assert (new["kind"], new["sweeps_a"], new["sweeps_b"]) == ("structure", None, None)
    assert (new["x_b"], new["y_b"]) == pytest.approx((-3.7, 0.5), abs=0.25)
    assert 0.9 < found.figures["precision"] < 1.0  # type: ignore[operator]
    same = package.diff(maps / "room.yaml", maps / "room.yaml")
    assert (counts(same), same.figures["f1"], same.figures["overlap"]) == ({}, 1.0, 1.0)


@pytest.mark.slow
def test_a_background_beside_a_log(monday: str, tmp_path: Path) -> None:
    background = tmp_path / "empty.background.parquet"
    package.background(monday, background)
    new = make.box(1.3, 0.3, 0.5, 0.4, 0.6)
    tuesday = write_run(tmp_path / "t.mcap", (*SCENE, new), seed=1)
    found = package.diff(background, tuesday)
    assert (counts(found)["new"], found.figures["gone"]) == (1, 0.0)
    assert (rows(found, "new")[0]["x_b"], rows(found, "new")[0]["y_b"]) == pytest.approx((1.3, 0.3), abs=0.05)


@pytest.mark.slow
def test_each_run_is_compared_with_the_last_that_saw_the_place(tmp_path: Path) -> None:
    """A box that came on Tuesday is known on Wednesday; one that a screen hid on Tuesday is known from Monday."""
    new, screen = make.box(-0.8, -1.3, 0.4, 0.3, 0.5), make.wall([[1.6, -2.6], [1.6, 0.2]])
    scenes = (SCENE, (*SCENE, new, screen), (*SCENE, new))
    runs = [
        write_run(tmp_path / f"{day}.mcap", scene, seed=seed)
        for seed, (day, scene) in enumerate(zip(("monday", "tuesday", "wednesday"), scenes, strict=True))
    ]
    found = package.diff(*runs)
    today = [row for row in found.changes.to_pylist() if row["log_b"] == "wednesday"]
    known = [row for row in today if row["status"] == "known"]
    assert Counter(row["status"] for row in today) == {"known": 6, "gone": 1}
    assert Counter(row["log_a"] for row in known) == {"tuesday": 5, "monday": 1}
    (gone,) = (row for row in today if row["status"] == "gone")
    assert (gone["kind"], gone["log_a"]) == ("structure", "tuesday")
    assert [step.name for step in found.steps] == ["tuesday", "wednesday"]
    told = [line for line in found.lines if not line.startswith(" ")]
    assert [line.split(":")[0] for line in told] == ["monday to tuesday", "tuesday to wednesday"]
    assert "  new 0.4 x 0.3 m at (-0.8, -1.3)" in found.lines[: found.lines.index(told[1])]


def test_tables_tell_no_free_space(monday: str, tmp_path: Path, lidarcli: Run) -> None:
    tuesday = write_run(tmp_path / "t.mcap", without(SCENE, BOXES[1]), seed=1)
    for log, name in ((monday, "a"), (tuesday, "b")):
        assert lidarcli("-q", "track", log, "-o", tmp_path / name).code == 0
    ran = lidarcli("diff", tmp_path / "a", tmp_path / "b" / "t.tracks.parquet", "-o", tmp_path / "c.csv")
    assert (ran.code, ran.out.splitlines()) == (
        0,
        ["aligned by things: 0.00 m, 0.0 degrees", "  known 4, uncertain 1 (1 no free space)"],
    )
    assert ran.err.splitlines() == [
        "  note     tables tell no free space; name the logs to learn what is gone, or new: checks of that fail",
        f"  wrote    {tmp_path / 'c.csv'}",
    ]
    # Nothing can be gone where nobody knows what is free, nor be new.
    same = (tmp_path / "a", tmp_path / "a" / "monday.tracks.parquet")
    for runs, check, code in (
        (same, "gone == 0", 1),
        (same, "new == 0", 1),
        (same, "known == 5", 0),
        ((monday, same[1]), "gone == 0", 1),
        ((monday, same[1]), "new == 0", 0),
    ):
        assert lidarcli("diff", *runs, "--check", check, "-o", tmp_path / "d.parquet", "--overwrite").code == code
        assert lidarcli("report", tmp_path / "d.parquet", "--check", check).code == code


def test_json_has_verdicts(monday: str, tmp_path: Path, lidarcli: Run) -> None:
    tuesday = write_run(tmp_path / "tuesday.mcap", without(SCENE, BOXES[1]), seed=1)
    words = ("diff", monday, tuesday, "--format", "json")
    for checks, code in (((), 0), (("gone == 1",), 0), (("gone == 1", "new > 0"), 1)):
        ran = lidarcli(*words, *(word for check in checks for word in ("--check", check)), code=code)
        found = json.loads(ran.out)
        assert (found["exit_code"], found["holds"]) == (code, not code)
        assert [(one["check"], one["holds"], one["found"]) for one in found["checks"]] == [
            *zip(checks, (True, False), (1, 0), strict=False)
        ]


def test_outputs_and_checks(monday: str, tmp_path: Path, lidarcli: Run) -> None:
    tuesday = write_run(tmp_path / "tuesday.mcap", without(SCENE, BOXES[1]), seed=1)
    names = ["c.parquet", "c.csv", "c.png"]
    words = ("diff", monday, tuesday, *(word for name in names for word in ("-o", tmp_path / name)))
    ran = lidarcli(*words, "--check", "gone == 0", "--check", "known >= 4", "--check", "overlap > 0.9")
    assert (ran.code, ran.out.splitlines()) == (
        1,
        [
            "aligned by structure: 0.00 m, 0.0 degrees; 97% of the structure in place",
            "  known 4, gone 1",
            "  gone 0.8 x 0.5 m at (-2.6, -1.6)",
        ],
    )
    assert ran.err.splitlines()[-1] == "lidarcli: check failed: gone is 1, expected == 0"
    table = pq.read_table(tmp_path / "c.parquet")
    assert table.schema.equals(CHANGES)
    (step,) = json.loads(table.schema.metadata[b"lidarcli.alignment"])
    assert [*step] == ["log_a", "log_b", "dx", "dy", "dyaw", "overlap", "rms"]
    ran = lidarcli("report", tmp_path / "c.parquet", "--format", "json", "--check", "gone == 0")
    assert (ran.code, ran.err) == (1, "lidarcli: check failed: gone is 1, expected == 0\n")
    figures = json.loads(table.schema.metadata[b"lidarcli.figures"])
    assert json.loads(ran.out)["figures"] == {name: pytest.approx(figures[name]) for name in figures}
    assert len((tmp_path / "c.csv").read_text().splitlines()) == 6
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert lidarcli(*words).code == 5
    ran = lidarcli("-q", "diff", monday, tuesday, "--format", "json")
    assert json.loads(ran.out)["figures"]["gone"] == 1
    for bad, cause in (
        (("diff", monday), "one run has nothing to be compared with; give two or more"),
        (("diff", monday, tuesday, "-o", "c.txt"), "c.txt: the suffix of an output has to be one of"),
        (("diff", monday, tuesday, "--check", "news == 0"), "unknown figure 'news'; did you mean new?"),
        (("diff", monday, "-"), "runs are compared by reading their logs twice"),
        (("match", monday, tuesday), "The command 'match' is gone: give lidarcli diff RUN RUN..."),
    ):
        ran = lidarcli(*bad)
        assert (ran.code, cause in ran.err) == (2, True), ran.err
    assert lidarcli("diff", monday, tmp_path / "none.mcap").code == 3


@needs_real_logs
@pytest.mark.slow
def test_a_real_room_twice() -> None:
    """Two recordings of one room with people: what flickered was once told as moved by 6 m."""
    folder = REAL_LOGS / "leg_tracker"
    found = package.diff(folder / "positive_1_raw.bag", folder / "positive_3_raw.bag")
    assert {*counts(found)} <= {"known", "uncertain"}
    assert counts(found)["known"] >= 10
    assert found.figures["overlap"] > 0.95  # type: ignore[operator]
