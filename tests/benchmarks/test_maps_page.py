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
    WITHOUT_AGENTS,
    Figures,
    Made,
    Matched,
    Recorded,
    Rolled,
    Speed,
    Way,
    as_json,
)
from benchmarks.maps.measuring import measure_way
from benchmarks.maps.page import coarse, page, summary
from benchmarks.maps.program import make_map
from benchmarks.maps.prose import REPORTING, TUNING
from benchmarks.maps.real import PICTURES, measure_recordings, picture_name
from benchmarks.maps.recordings import RESOLUTION, new_sweeps
from benchmarks.maps.rules import maps_once, once
from benchmarks.maps.scenes import KINDS, ROLLING, drive, fastest_turn, length, walkers
from benchmarks.maps.scoring import Score
from benchmarks.scenes.clearance import outline, to_segments
from lidarcli.choices import MIN_MOVE
from tests.places import REAL_LOGS, ROOT, needs_real_logs

PAGE = ROOT / "docs" / "maps.md"
HEADINGS = (
    "In short",
    "The drives",
    "Maps with true poses",
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
    matched = [Matched(way.name, way.metres, 0.012 * way.seed, 0.2, some(0.94999)) for way in ways]
    rolled = [Rolled("rooms 1", name, 1.0, some(0.9), 20, 0.05, 0.1) for name in (INSTANT, DESKEWED, SKEWED)]
    return Figures("make maps", 80_000, ways, made, matched, rolled, **others)  # type: ignore[arg-type]


SPEED = Speed(per_second=6_400.0, iterate=11.4, cells=2.6e8, gb_per_km2=5.9)
RECORDED = Recorded("some/log", 100, 20, 5.0, 10.0, 7.5, 1234, 5678)


def lines(text: str, begin: str) -> list[list[str]]:
    """The cells of the rows of tables that begin with this."""
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith(f"| {begin}")
    ]


def test_the_page_has_every_part() -> None:
    text = page(figures(speed=SPEED, recorded=[RECORDED]), "")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == list(HEADINGS)
    assert "{" not in text
    assert max(map(len, (line for line in text.splitlines() if not line.startswith(("|", "!"))))) <= 124
    assert lines(text, "some/log") == [["some/log", "100 / 20", "5.0 m", "10.0 x 7.5 m", "1,234", "5,678"]]
    assert all(f"(images/maps/{picture_name(log)})" in text for log in PICTURES)


def test_what_is_wanted_is_judged_by_the_worst_drive_and_never_rounded_up() -> None:
    text = page(figures(speed=SPEED), "")
    found = {row[0]: row[2:] for row in (*lines(text, "corridors:"), *lines(text, "rooms:"))}
    assert found["corridors: F1, true poses, worst drive"] == ["0.980", "**missed**"]
    assert found["rooms: F1, true poses, worst drive"] == ["0.995", "reached"]
    assert found["corridors: cells that people left, all 2 drives"] == ["1", "**missed**"]
    assert found["rooms: cells that people left, all 1 drives"] == ["0", "reached"]
    assert found["rooms: F1, `--pose match`, worst drive"] == ["0.949", "**missed**"]
    assert found["corridors: error of that path, worst drive"] == ["2.4 cm", "reached"]
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
    assert lines(text, "lidarcli --without-agents, every") == [
        ["lidarcli --without-agents, every sweep", "1", "0", "1.000", "0.500"]
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
    prose = [line for line in fresh.splitlines() if line.strip() and not re.search(r"^\||\d\.\d{3}", line)]
    assert set(prose) <= set(text.splitlines())
    assert all(len(lines(text, f"{kind}: ")) == 4 for kind in KINDS)
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
    assert matched.rms < 0.05
    assert matched.score.f1 > 0.97
    grid = make_map(tmp_path / "rooms-0.mcap", "--pose-delay", "0")
    mine = maps_once(driven.beams, new_sweeps(driven, MIN_MOVE), RESOLUTION)[once(2, 0.25)]
    # Poses in a log are rounded: a few beams end in the cell beside.
    assert grid.occupied == pytest.approx(mine.occupied, rel=0.01)
    assert (grid.x, grid.y) == (mine.x, mine.y)


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
