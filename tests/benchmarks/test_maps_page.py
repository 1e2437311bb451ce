"""docs/maps.md is what `make maps` writes, from drives that are what it says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.page import BEGIN, END, KEPT, NEVER
from benchmarks.maps.__main__ import main
from benchmarks.maps.figures import (
    DESKEWED,
    EVERY,
    INSTANT,
    MOVED,
    OURS,
    SKEWED,
    TOLD,
    WITHOUT_AGENTS,
    Figures,
    Made,
    Matched,
    PathError,
    Recorded,
    Rolled,
    Speed,
    Way,
    as_json,
)
from benchmarks.maps.measuring import measure_way
from benchmarks.maps.page import coarse, page, summary
from benchmarks.maps.paths import errors_over, follow, measure_loop, measure_straight, way_of
from benchmarks.maps.program import make_map, run
from benchmarks.maps.prose import REPORTING, TUNING
from benchmarks.maps.real import PICTURES, measure_recordings, picture_name
from benchmarks.maps.real_paths import KNOWN, measure_real_paths
from benchmarks.maps.recordings import RESOLUTION, new_sweeps
from benchmarks.maps.rules import maps_once, once
from benchmarks.maps.scenes import KINDS, ROLLING, drive, fastest_turn, length, walkers
from benchmarks.maps.scoring import Score
from benchmarks.scenes.clearance import outline, to_segments
from lidarcli.choices import MIN_MOVE
from tests.places import REAL_LOGS, ROOT, SAMPLES, needs_real_logs

PAGE = ROOT / "docs" / "maps.md"
HEADINGS = (
    "In short",
    "The drives",
    "Maps with true poses",
    "Maps by matched paths",
    "Paths from the sweeps themselves",
    "Sweeps that take their time",
    "Without what moves",
    "Speed and memory",
    "Real recordings",
    "Limits",
)


def some(f1: float, ghosts: int = 0) -> Score:
    """A score with these figures."""
    return Score(1.0, 0.5, f1, ghosts, cells=100, true_cells=100)


def some_path(log: str, **others: float) -> PathError:
    """Errors of a path of 72 m with these figures."""
    told: dict[str, float] = {"rms": float("nan"), "median": 0.002, "slides": 0.0, "unplaced": 0.0, "lost": 2, **others}
    return PathError(log, 361, 360.0, 72.4, 5.0, p95=0.004, length=0.9876, heading=0.01, milliseconds=0.234, **told)


def figures(**others: object) -> Figures:
    """Two drives of one kind and one of another, by two rules."""
    ways = [
        Way(kind, seed, 70.2, 1200, 300, 16, 5000, 0.99, 0.9)
        for kind, seed in (("corridors", 1), ("corridors", 2), ("rooms", 1))
    ]
    f1 = {"corridors 1": 0.98, "corridors 2": 0.9996, "rooms 1": 0.995}
    made = [
        Made(way.name, rule, taken, some(f1[way.name] - (rule == "Karto") / 10, ghosts=way.seed - 1))
        for way in ways
        for taken in (EVERY, MOVED)
        for rule in (OURS, WITHOUT_AGENTS, "Karto")
    ]
    matched = [Matched(way.name, some(f1[way.name] - 0.0295 * (way.seed - 1))) for way in ways]
    rolled = [Rolled("rooms 1", name, 1.0, some(0.9), 20, 0.05, 0.1) for name in (INSTANT, DESKEWED, SKEWED)]
    loops = [
        some_path("corridors 1", rms=0.01),
        some_path(f"corridors 1, {TOLD}", rms=0.051),
        some_path("rooms 1", rms=0.05, median=0.0101),
    ]
    straight = [some_path("straight corridor 1", slides=0.9499, unplaced=0.0125)]
    return Figures("make maps", 80_000, ways, made, matched, rolled, loops, straight, **others)  # type: ignore[arg-type]


SPEED = Speed(per_second=6_400.0, iterate=11.4, cells=2.6e8, gb_per_km2=5.9)
RECORDED = Recorded("some/log", 100, 20, 5.0, 10.0, 7.5, 1234, 5678)


def lines(text: str, begin: str) -> list[list[str]]:
    """The cells of the rows of tables that begin with this."""
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith(f"| {begin}")
    ]


def test_the_page_has_every_part() -> None:
    text = page(figures(speed=SPEED, recorded=[RECORDED]), "")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == list(HEADINGS)
    assert "{" not in text
    assert max(map(len, (line for line in text.splitlines() if not line.startswith(("|", "!"))))) <= 124
    assert lines(text, "some/log") == [["some/log", "100 / 20", "5.0 m", "10.0 x 7.5 m", "1,234", "5,678"]]
    assert all(f"(images/maps/{picture_name(log)})" in text for log in PICTURES)
    numbers = ["361, 360°", "72 m", "0.20 % / 0.40 %", "0.988", "0.57°", "–", "95.0 %", "1.2 %", "2", "0.23"]
    assert lines(text, "straight corridor 1") == [["straight corridor 1", *numbers]]
    assert "*Not at hand in this run: my_gazebo_tutorials, datmo, datmo_more, carmen_ple.*" in text


def test_what_is_wanted_is_judged_by_the_worst_drive_and_never_rounded_up() -> None:
    text = page(figures(speed=SPEED), "")
    found = {row[0]: row[2:] for row in (*lines(text, "corridors:"), *lines(text, "rooms:"))}
    assert found["corridors: F1, true poses, worst drive"] == ["0.980", "**missed**"]
    assert found["rooms: F1, true poses, worst drive"] == ["0.995", "reached"]
    assert found["corridors: cells that people left, all 2 drives"] == ["1", "**missed**"]
    assert found["rooms: cells that people left, all 1 drives"] == ["0", "reached"]
    assert found["corridors: F1, `--pose match`, worst drive"] == ["0.970", "reached"]
    assert found["rooms: F1, `--pose match`, worst drive"] == ["0.995", "reached"]
    assert found["rooms: error of the path over 5 m, median, worst drive"] == ["1.01 %", "**missed**"]
    assert [row[1:] for row in lines(text, "F1 that")] == [["≤ 0.01", "0.030", "**missed**"]]
    assert [row[1:] for row in lines(text, "loops of 72 to 72 m")] == [["3 of 3", "2 of 3", "**missed**"]]
    assert [row[1:] for row in lines(text, "straight corridors:")] == [["≥ 95 %", "94.9 %", "**missed**"]]
    assert lines(text, "recordings whose") == []
    real = [some_path("datmo/some, motion capture", median=share, lost=0) for share in (0.01, 0.02)]
    real.append(some_path("datmo/lost, motion capture", median=0.01))
    assert [row[1:] for row in lines(page(figures(real_paths=real), ""), "recordings whose")] == [
        ["3 of 3", "1 of 3", "**missed**"]
    ]
    assert lines(text, "sweeps per second") == [
        ["sweeps per second, every one counts", "≥ 5,000", "about 6,000", "reached"]
    ]


def test_rules_are_means_of_the_drives_of_a_kind_and_ghosts_sums() -> None:
    text = page(figures(), "")
    both = ["1.000", "0.500", "0.989", "1"]
    assert lines(text, "**lidarcli**") == [
        ["**lidarcli**", *both, *both],
        ["**lidarcli**", *["1.000", "0.500", "0.995", "0"] * 2],
    ]
    assert len(lines(text, "Karto")) == 2
    assert lines(text, "lidarcli --without agents, every") == [
        ["lidarcli --without agents, every sweep", "1", "0", "1.000", "0.500"]
    ]
    # 100 cells where half of 100 true ones are there: two for each, and each metre has 20.
    assert [row[3] for row in lines(text, "rooms 1, sweeps")] == ["40.0"] * 3


def test_figures_of_real_recordings_are_kept() -> None:
    assert NEVER in page(figures(), "")
    before = f"outdated\n{BEGIN}\n\nfigures of real recordings\n\n{END}\noutdated\n"
    text = page(figures(), before)
    assert text.partition(BEGIN)[2].partition(END)[0] == f"\n\nfigures of real recordings\n\n{KEPT}\n\n"
    assert "outdated" not in text


def test_the_terminal_and_the_json_say_the_same() -> None:
    one = figures(speed=SPEED, recorded=[RECORDED])
    rows = [line for line in summary(one).splitlines() if line.startswith("| ")]
    assert len(rows) > 30
    assert set(rows) <= set(page(one, "").splitlines())
    assert json.loads(as_json(one))["speed"]["cells"] == 2.6e8


@pytest.mark.parametrize(
    ("value", "text"), [(6_400.0, "6,000"), (11.4, "10"), (5.9, "6"), (0.34, "0.3"), (0.0, "0"), (-1.0, "0")]
)
def test_times_are_told_with_one_digit(value: float, text: str) -> None:
    assert coarse(value) == text


def test_the_page_in_the_repository_is_of_this_code() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == list(HEADINGS)
    fresh = page(figures(speed=SPEED, recorded=[RECORDED]), text)
    changes = r"^\||^\*Not at hand|\d\.\d{3}"
    prose = [line for line in fresh.splitlines() if line.strip() and not re.search(changes, line)]
    assert set(prose) <= set(text.splitlines())
    assert [len(lines(text, f"{kind}: ")) for kind in KINDS] == [3, 4]
    assert len(lines(text, "**lidarcli**")) == len(KINDS)
    for image in re.findall(r"\((images/maps/[^)]*)\)", text):
        assert 1_000 < (PAGE.parent / image).stat().st_size < 80_000


@pytest.mark.whole
@pytest.mark.parametrize("kind", KINDS)
def test_drives_are_what_the_page_says(kind: str) -> None:
    scene = drive(kind, TUNING)  # type: ignore[arg-type]
    seconds = np.arange(scene.sweeps) / scene.sensor.rate
    poses = scene.sensor_poses(seconds)
    assert poses[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert 60.0 < length(scene) < 80.0
    assert np.hypot(*poses[-1, :2]) < 0.2
    people = walkers(scene)
    assert 10 <= len(people) <= 16
    standing = np.vstack([outline(entity) for entity in scene.entities if entity.motion.still])
    assert to_segments(poses[:, :2], standing).min() > 0.3
    for person in people:
        legs = person.feet(seconds)
        assert legs is not None
        # Nobody walks through a wall, a thing or the robot, or stands for long.
        assert to_segments(legs.reshape(-1, 2)[::7], standing).min() > 0.15
        assert np.hypot(*(person.poses(seconds)[:, :2] - poses[:, :2]).T).min() > 0.7
        assert person.motion.route is not None
        assert max(point.wait for point in person.motion.route.waypoints) <= 3.0
    fast = drive(kind, TUNING, ROLLING, 1.0)  # type: ignore[arg-type]
    assert 45.0 < np.degrees(fastest_turn(fast)) < 75.0
    assert fast.path.speeds(seconds).max() == pytest.approx(1.0)


@pytest.mark.whole
def test_a_drive_is_measured_and_the_rule_of_the_program_is_that_of_its_counts(tmp_path: Path) -> None:
    way, made, matched, driven = measure_way("rooms", TUNING, tmp_path)
    assert (way.name, way.sweeps, way.people) == ("rooms 0", 1200, 16)
    assert 0.99 < way.twice <= way.once <= 1.0
    ours = {one.taken: one.score for one in made if one.rule == OURS}
    assert min(one.f1 for one in ours.values()) > 0.98
    assert ours[MOVED].f1 > max(
        one.score.f1 for one in made if one.taken == MOVED and one.rule in ("gmapping", "Karto", "OctoMap")
    )
    assert matched.score.f1 > 0.97
    grid = make_map(tmp_path / "rooms-0.mcap", "--pose-delay", "0")
    mine = maps_once(driven.beams, new_sweeps(driven, MIN_MOVE), RESOLUTION)[once(2, 0.25)]
    # Poses in a log are rounded: a few beams end in the cell beside.
    assert grid.occupied == pytest.approx(mine.occupied, rel=0.01)
    assert (grid.x, grid.y) == (mine.x, mine.y)


def test_errors_are_those_over_a_stretch_of_the_true_way() -> None:
    # A step of 0.5 m, none while the pose is not known, then on.
    true = np.column_stack([np.arange(21) * 0.5, np.zeros(21), np.zeros(21)])
    true[4] = np.nan
    assert way_of(true)[[0, 3, 5, 20]] == pytest.approx([0.0, 1.5, 2.5, 10.0])
    turn = 0.02
    found = 1.1 * true @ np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0, 0, 1]])
    found[:, 2] = turn + 0.01 * true[:, 0]
    found[7] = np.nan
    off, turned, length = errors_over(true, found, 5.0)
    # From sweeps 0 to 10, without the two that are not known, to the first that is so far on.
    assert len(off) == 9
    assert length == pytest.approx(1.1)
    assert turned == pytest.approx(0.05)
    # The step begins at a heading that is wrong by what it has turned so far.
    assert off[0] == pytest.approx(0.5)
    assert off[-1] == pytest.approx(np.hypot(5.5 * np.cos(0.05) - 5.0, 5.5 * np.sin(0.05)))


@pytest.mark.slow
def test_the_path_is_that_of_the_program(tmp_path: Path) -> None:
    log = SAMPLES / "drive.db3"
    followed = follow(log)
    run("poses", str(log), "-o", str(tmp_path / "path.tum"), "--pose", "match")
    told = np.loadtxt(tmp_path / "path.tum", usecols=(0, 1, 2))
    assert followed.stamp_ns / 1e9 == pytest.approx(told[:, 0])
    assert followed.poses[:, :2] == pytest.approx(told[:, 1:], abs=1e-6)
    assert followed.path.poses == pytest.approx(followed.poses)


@pytest.mark.whole
def test_paths_are_measured(tmp_path: Path) -> None:
    free, told = measure_loop("corridors", TUNING, tmp_path)
    assert (free.log, told.log) == ("corridors 0", f"corridors 0, {TOLD}")
    for path in (free, told):
        assert (path.beams, round(path.view), path.over, path.lost) == (361, 360, 5.0, 0)
        assert path.median < path.p95 < 0.01
        assert path.rms < 0.05
    free, told = measure_straight(TUNING, tmp_path)
    # Only the sweep with which the map begins is not flagged; without told steps the others have no pose.
    assert free.slides > 0.99
    assert free.unplaced == pytest.approx(free.slides)
    assert told.unplaced == 0.0
    assert 0.9 < told.length < 1.1


def test_nonsense_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["benchmarks.maps", "--seeds", "0"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.endswith("error: --seeds is 1 to 100\n")
    assert REPORTING != TUNING


@needs_real_logs
@pytest.mark.whole
def test_real_recordings() -> None:
    found = {one.log: one for one in measure_recordings(REAL_LOGS)}
    assert {"comprobo24/test-bag", "datmo/overtake_ego", "my_gazebo_tutorials/20_53_49"} <= set(found)
    car = found["datmo/overtake_ego"]
    assert car.sweeps == 135
    assert car.metres == pytest.approx(7.3, abs=0.1)
    assert car.occupied > 500


@needs_real_logs
@pytest.mark.whole
def test_paths_of_real_recordings() -> None:
    found = {one.log: one for one in measure_real_paths(REAL_LOGS, KNOWN[:2])}
    assert {"my_gazebo_tutorials/20_46_08, Gazebo", "datmo/parallel, motion capture"} <= set(found)
    assert found["my_gazebo_tutorials/20_46_08, Gazebo"].metres == pytest.approx(3.4, abs=0.1)
    assert found["my_gazebo_tutorials/20_46_08, Gazebo"].median < 0.01
    car = found["datmo/parallel, motion capture"]
    assert car.metres == pytest.approx(15.6, abs=0.2)
    # The other way round, or with another mount, it would be off by more.
    assert car.p95 < 0.15
