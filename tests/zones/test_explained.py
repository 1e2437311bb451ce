"""The robot's own stops, and the answer to why it stopped: as sentences, page, picture and film."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from lidarcli.simulation import scene as make
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Odometry
from tests.reports.browser import CHROMIUM, browser
from tests.zones.runs import odometry_of, rows, scans, scene_of, sweeps_of, times_of, twists, watched, write_bag, zone_file

pytestmark = pytest.mark.slow
Run = Callable[..., Any]
ROOM = (make.wall([[-2.0, 3.0], [9.0, 3.0], [9.0, -3.0], [-2.0, -3.0], [-2.0, 3.0]]),)
FREE = '[[zone]]\nname = "behind"\ncircle = { x = -1.0, y = 0.0, radius = 0.2 }\n'
STOP = '[[zone]]\nname = "stop"\naction = "stop"\ncircle = { x = 0.0, y = 0.0, radius = 0.9 }\n'


def drive(
    folder: Path, *boxes: Any, lost: Sequence[tuple[float, float]] = (), commands: float | None = 0.5, **odometry: Any
) -> Path:
    """A robot that drives 2 m ahead at 0.5 m/s, waits 3 s, drives 1.5 m to the left and stays there.

    `lost`: times [s] without sweeps; `commands`: the speed that is commanded while it drives and also until it stops; None
    without commands.
    """
    points = [Waypoint(0.0, 0.0, 0.5), Waypoint(2.0, 0.0, 0.5, 3.0), Waypoint(2.0, 1.5, 0.5, 0.0, "stop")]
    route = plan_route(points, acceleration=4.0, turn_rate=1.5)
    scene = scene_of(*boxes, room=ROOM, path=route, odometry=Odometry(**odometry), sweeps=160)
    times = times_of(scene)
    seconds = (times - times[0]) * 1e-9
    kept = [one for one in scans(sweeps_of(scene), odometry_of(scene)) if one.type != "sensor_msgs/msg/LaserScan"]
    shown = [one for one in scans(sweeps_of(scene)) if all(not a < (one.record_ns - times[0]) * 1e-9 < b for a, b in lost)]
    told = []
    if commands is not None:
        drives = route.speeds(seconds) > 0.1
        told = twists(times[drives], (commands, 0.0, 0.0)) + twists(times[~drives], (0.0, 0.0, 0.0))
    return write_bag(folder / "drive.bag", kept, shown, told)


def answer_of(lidarcli: Run, log: Path, zones: str, at: str, *more: Any) -> str:
    """What is answered on a time, as one line."""
    words = ("--zones", zone_file(log.parent, zones), "--explain", at, "-o", log.parent / "why.png", "--overwrite", *more)
    ran = lidarcli("zones", log, *words)
    assert ran.code == 0, ran.err
    (_, _, told) = ran.err.partition("  why      ")
    lines = [line.strip() for line in told.splitlines()]
    return " ".join(line for line in lines if not line.startswith(("note ", "wrote ")))


def test_stops_are_those_of_the_route(tmp_path: Path) -> None:
    log = drive(tmp_path, make.box(2.9, 0.0, 0.4, 0.4))
    events = watched(log, FREE, stops=True).events
    first, last = rows(events, kind="stop")
    # 2 m at 0.5 m/s with 0.125 s to speed up and to slow down.
    assert first["t"] == pytest.approx(4.125, abs=0.25)
    assert first["duration"] == pytest.approx(3.0, abs=0.4)
    assert (first["zone"], first["cut"], first["set"]) == ("", False, "O")
    assert first["nearest"] == pytest.approx(0.7, abs=0.02), "the near side of the box"
    assert first["speed"] == pytest.approx(0.5, abs=0.05)
    assert last["cut"]
    assert last["nearest"] == pytest.approx(1.5, abs=0.05), "the wall"
    assert last["set"] == "S"
    assert not rows(watched(log, FREE).events, kind="stop"), "only where they are asked for"


def test_odometry_counts_before_the_path_of_the_sweeps(tmp_path: Path) -> None:
    """It drifts so far that the path is matched from the sweeps; it stands where the robot stands."""
    log = drive(tmp_path, make.box(2.9, 0.0, 0.4, 0.4), yaw_noise=1.0)
    tables = watched(log, FREE, stops=True)
    assert b'"pose_verdict": {"/scan": "matched"}' in tables.events.schema.metadata[b"lidarcli.source"]
    first, _ = rows(tables.events, kind="stop")
    assert (first["t"], first["duration"]) == (pytest.approx(4.125, abs=0.25), pytest.approx(3.0, abs=0.4))


def test_a_parked_sensor_has_no_stops(tmp_path: Path, lidarcli: Run) -> None:
    log = write_bag(tmp_path / "parked.bag", scans(sweeps_of(scene_of(sweeps=40))))
    ran = lidarcli("zones", log, "--zones", zone_file(tmp_path, FREE), "--stops", "--pose", "none")
    assert "stops    none: the robot never stood between two drives" in ran.err


def test_beside_the_way_is_not_ahead(tmp_path: Path) -> None:
    log = drive(tmp_path, make.box(2.9, 0.75, 0.4, 0.4))
    first, _ = rows(watched(log, FREE, stops=True).events, kind="stop")
    assert first["nearest"] is None or first["nearest"] > 2.5
    first, _ = rows(watched(log, FREE, stops=True, footprint="[[0.3, 0.6], [0.3, -0.6], [-0.3, 0.0]]").events, kind="stop")
    assert first["nearest"] == pytest.approx(np.hypot(0.7, 0.55), abs=0.05), "of a wider robot it is"


def test_a_stop_for_what_is_in_a_zone(tmp_path: Path, lidarcli: Run) -> None:
    told = answer_of(lidarcli, drive(tmp_path, make.box(2.9, 0.0, 0.4, 0.4)), STOP, "5")
    assert re.match(r"At 4\.\d s \(22:13:2\d\.\d\) the robot, which drove 0\.5\d m/s, stood for 3\.\d s\.", told)
    assert re.search(r"Object \d+ was in stop 0\.\d\d m from the sensor with \d+ points at most\.", told)
    assert re.search(r"It was told to: /cmd_vel went from 0.50 m/s to a stand 0\.\d s before\.", told)
    assert told.endswith("Sensors, poses and transforms were sound.")


@pytest.mark.parametrize(
    ("commands", "words"), [(None, "The log has no commands"), (0.0, "It was told to: /cmd_vel commanded to stand")]
)
def test_a_stop_for_nothing_is_told_as_such(tmp_path: Path, lidarcli: Run, commands: float | None, words: str) -> None:
    told = answer_of(lidarcli, drive(tmp_path, commands=commands), FREE, "5")
    seen = re.findall(r"No zone was occupied. Ahead on its way: nothing seen within 3 m \((\d+) of (\d+) beams", told)
    # 81 of the 720 beams of a turn are within 20 degrees, and all of them end on the wall.
    assert [(int(one), int(all_of)) for one, all_of in seen] == [(81, 81)]
    assert words in told


def test_a_sensor_that_was_silent_is_the_answer(tmp_path: Path, lidarcli: Run) -> None:
    told = answer_of(lidarcli, drive(tmp_path, make.box(2.9, 0.0, 0.4, 0.4), lost=[(2.0, 6.0)]), STOP, "4.5")
    silent = "No sweep of /scan was new enough from 4.0 s (22:13:24.0) to 6.0 s (22:13:26.0)"
    assert f"{silent}: what was around it then, nobody saw." in told
    assert "Not sound then: no sweep of /scan for 4.0 s from 2.0 s (22:13:22.0) on" in told
    assert "No zone was occupied" not in told, "nobody knows"


def test_a_time_without_an_event_is_answered_and_one_outside_of_the_log_refused(tmp_path: Path, lidarcli: Run) -> None:
    log = drive(tmp_path)
    assert answer_of(lidarcli, log, FREE, "1.5").startswith("At 1.5 s (22:13:21.5) the robot drove 0.50 m/s.")
    ran = lidarcli("zones", log, "--zones", tmp_path / "zones.toml", "--explain", "99", "-o", tmp_path / "no.png")
    assert ran.code == 2
    assert "--explain 99.0: the log has sweeps from 0.0 s (22:13:20.0) to 15.9 s (22:13:35.9)" in ran.err
    assert not (tmp_path / "no.png").exists()


def test_explain_needs_an_output_of_its_own(tmp_path: Path, lidarcli: Run) -> None:
    log = drive(tmp_path)
    zones = zone_file(tmp_path, FREE)
    for more in ((), ("-o", tmp_path / "folder")):
        ran = lidarcli("zones", log, "--zones", zones, "--explain", "5", *more)
        assert (ran.code, "give -o why.html" in ran.err) == (2, True)
    assert lidarcli("zones", log, log, "--zones", zones, "--explain", "5", "-o", tmp_path / "a.png").code == 2


def test_the_worst_have_a_file_each(tmp_path: Path, lidarcli: Run) -> None:
    log = drive(tmp_path, make.box(2.9, 0.0, 0.4, 0.4))
    outputs = ("-o", tmp_path / "why.png", "-o", tmp_path / "why.gif")
    words = ("--zones", zone_file(tmp_path, STOP), "--explain", "worst", *outputs)
    assert lidarcli("zones", log, *words).code == 0
    assert sorted(path.name for path in tmp_path.glob("why*")) == ["why-1.gif", "why-1.png", "why-2.gif", "why-2.png"]
    with Image.open(tmp_path / "why-1.gif") as film:
        assert film.n_frames == 120
    assert lidarcli("zones", log, *words).code == 5, "none is replaced"


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_page_steps_through_the_film(tmp_path: Path, lidarcli: Run) -> None:
    log = drive(tmp_path, make.box(2.9, 0.0, 0.4, 0.4))
    path = tmp_path / "why.html"
    assert lidarcli("zones", log, "--zones", zone_file(tmp_path, STOP), "--explain", "5", "-o", path).code == 0
    with browser() as page:
        for width in (1280, 400):
            page.open(path, width)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        before = page.evaluate("document.getElementById('film').src.length + document.getElementById('words').textContent")
        page.evaluate("document.getElementById('forward').click()")
        after = page.evaluate("document.getElementById('film').src.length + document.getElementById('words').textContent")
        assert before != after
        assert page.evaluate("document.getElementById('film').naturalWidth") > 300
        assert page.complaints == []
        assert [one for one in page.requests if not one.startswith(("file:", "data:"))] == []
