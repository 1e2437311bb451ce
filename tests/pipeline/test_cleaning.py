"""Beams that `clean` takes, against the truth of simulated scenes and the marks of public recordings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import lidarcli
from benchmarks.scenes.moving import Kind, moving_scene
from benchmarks.scenes.random import SENSORS
from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.formalism.mapping.grid import compare
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline.clean.beams import REASONS, neighbours
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Odometry, Scene
from lidarcli.sweeps.types import Bool, Closure, Float64
from tests.pipeline import drawn
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.sweeping import raw_sweeps, room_sweeps, round_room
from tests.text_logs import write_log

SENSOR = replace(SENSORS["1081"], noise=0.01, lost=0.003, lost_as="mixed", mixed_pixels=0.3)
SLOWEST = 0.02
"""[m/s]; what is faster has begun to move."""


def ranges(log: Path) -> Float64:
    """(S, B) of a log with one topic."""
    with open_log(str(log)) as opened:
        return np.concatenate([block.ranges for block in opened.scans(None, ReadReport())])


def taken(table: Any, reason: str) -> list[int]:
    return list(table[reason].to_pylist())


class Cleaned(NamedTuple):
    """A scene, its log and the copy of it."""

    scene: Scene
    log: Path
    copy: Path
    moving: Bool
    """(S, B) beams on what has begun to move by then."""
    other: Bool
    """(S, B) beams on what never moves, and not beside such beams."""
    gone: Bool

    @property
    def counts(self) -> Any:
        """Beams that are gone and all, on what moves and on others."""
        return np.array([np.count_nonzero(each) for each in self._masks])

    @property
    def _masks(self) -> tuple[Bool, ...]:
        return self.gone & self.moving, self.moving, self.gone & self.other, self.other


def speeds(scene: Scene) -> Float64:
    """(S, E) of each entity, and 0 for none of them."""
    seconds = np.arange(scene.sweeps) / scene.sensor.rate
    found = [np.hypot(*each.velocities(seconds)[:, :2].T) for each in scene.entities]
    return np.column_stack([*found, np.zeros(len(seconds))])


def write(scene: Scene, log: Path, seed: int) -> Any:
    """Write a scene, and return the entity (S, B) of each beam, -1 for none."""
    blocks = list(simulate_blocks(scene, scene.sweeps, seed))
    poses = simulate_odometry(scene, scene.sweeps, seed) if scene.odometry else None
    write_log(log, [block.raw for block in blocks], poses=poses)
    return np.concatenate([block.entity for block in blocks])


def cleaned(scene: Scene, folder: Path, seed: int, **options: Any) -> Cleaned:
    log, copy = folder / f"{scene.name}.mcap", folder / f"{scene.name}.clean.mcap"
    entity = write(scene, log, seed)
    lidarcli.clean(log, copy, **options)
    before, after = ranges(log), ranges(copy)
    valid = np.isfinite(before) & (before < scene.sensor.range_max) & (before >= scene.sensor.range_min)
    begun = np.maximum.accumulate(speeds(scene) > SLOWEST, axis=0)
    moving = valid & np.take_along_axis(begun, np.where(entity < 0, len(scene.entities), entity), 1)
    beside = moving | np.roll(moving, 1, axis=1) | np.roll(moving, -1, axis=1)
    ever = np.append(begun[-1][:-1], False)
    return Cleaned(scene, log, copy, moving, valid & ~beside & ~ever[entity], np.isfinite(before) & np.isnan(after))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kinds", "remove", "least"),
    [(("crossing",), "agents", 0.98), (("people", "room", "crossing"), "agents,temporary", 0.98)],
)
def test_beams_on_people_are_gone_and_others_stay(
    kinds: tuple[Kind, ...], remove: str, least: float, tmp_path: Path
) -> None:
    runs = [cleaned(moving_scene(kind, seed, SENSOR), tmp_path, seed, remove=remove) for kind in kinds for seed in (30, 31)]
    gone, moving, wrong, others = np.sum([each.counts for each in runs], axis=0)
    assert moving > 10_000
    assert gone >= least * moving
    assert wrong <= 0.005 * others


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"),
    [pytest.param("crossing", 1, marks=pytest.mark.xfail(reason="97.9 %", strict=True)), ("hall", 0), ("room", 7)],
)
def test_who_walks_slowly_is_gone_from_the_first_sight_on(kind: Kind, seed: int, tmp_path: Path) -> None:
    """The tracks of these scenes know of motion only when somebody is off by a body's size."""
    found = cleaned(moving_scene(kind, seed, SENSOR), tmp_path, seed)
    gone, moving, wrong, others = found.counts
    assert gone >= 0.98 * moving > 10_000
    assert wrong <= 0.005 * others


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"), [pytest.param("people", 3, marks=pytest.mark.xfail(reason="92.1 %", strict=True)), ("room", 104)]
)
def test_who_stops_under_another_track_is_gone(kind: Kind, seed: int, tmp_path: Path) -> None:
    found = cleaned(moving_scene(kind, seed, SENSOR), tmp_path, seed)
    gone, moving, wrong, others = found.counts
    assert gone >= 0.98 * moving > 10_000
    assert wrong <= 0.005 * others


@pytest.mark.slow
def test_the_map_is_that_of_the_room_without_people(tmp_path: Path) -> None:
    scene = replace(moving_scene("people", 30, SENSOR), odometry=Odometry())
    found = cleaned(scene, tmp_path, 30)
    stands = (speeds(scene) <= SLOWEST).all(axis=0)[:-1]
    calm = replace(scene, entities=tuple(each for each, still in zip(scene.entities, stands, strict=True) if still))
    write(calm, tmp_path / "calm.mcap", 30)
    raw, clean, true = (lidarcli.map(log) for log in (found.log, found.copy, tmp_path / "calm.mcap"))
    assert compare(clean, true).f1 >= 0.99 > compare(raw, true).f1


@pytest.mark.slow
def test_a_log_that_is_cleaned_again_hardly_changes(tmp_path: Path) -> None:
    found = cleaned(moving_scene("people", 31, SENSOR), tmp_path, 31)
    table = lidarcli.clean(found.copy, tmp_path / "again.mcap")
    more = sum(sum(taken(table, reason)) for reason in REASONS)
    assert np.count_nonzero(found.gone) > 5000
    assert more < 0.001 * found.gone.size


@pytest.mark.slow
def test_what_leaves_its_place_is_temporary(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    write_log(log, [room_sweeps(count=80)])
    assert sum(taken(lidarcli.clean(log, tmp_path / "a.mcap"), "agents")) == 0
    table = lidarcli.clean(log, tmp_path / "b.mcap", remove="agents,temporary", margin=0)
    assert taken(table, "temporary") == [30] * 40 + [0] * 40
    assert (ranges(tmp_path / "b.mcap")[:40, 200:230] != ranges(log)[:40, 200:230]).all()
    assert taken(table, "agents") == taken(table, "margin") == [0] * 80


@pytest.mark.parametrize("margin", [0, 1, 3, 29, 1_000_000])
def test_a_margin_is_as_wide_as_told_and_goes_on_around_a_full_turn(margin: int) -> None:
    chosen = np.zeros((4, 40), np.bool_)
    chosen[0, [0, 20]] = chosen[1, [2, 38]] = chosen[2, 29] = True
    beams, turns = np.array([40, 40, 30, 40]), np.array([False, True, True, True])
    wanted = chosen.copy()
    for row, beam in np.argwhere(chosen):
        for beside in range(beam - min(margin, 40), beam + min(margin, 40) + 1):
            if turns[row] or 0 <= beside < beams[row]:
                wanted[row, beside % beams[row]] = True
    closure = np.where(turns, Closure.CLOSED, Closure.OPEN)
    batch = SimpleNamespace(beams=beams, closure=closure)
    assert neighbours(batch, chosen, margin).tolist() == wanted.tolist()  # type: ignore[arg-type]


@pytest.mark.parametrize("margin", [0, 1, 3])
def test_the_robot_itself_is_what_a_mask_tells(margin: int, tmp_path: Path) -> None:
    log, mask = tmp_path / "run.mcap", tmp_path / "robot.toml"
    values = round_room(5)
    values[:, :4] = values[:, -6:] = 0.3
    write_log(log, [raw_sweeps(values)])
    mask.write_text("[[mask]]\ncircle = { x = -0.3, y = 0.0, radius = 0.2 }\n")
    table = lidarcli.clean(log, tmp_path / "out.mcap", mask=mask, margin=margin)
    assert taken(table, "body") == [10] * 5
    assert taken(table, "margin") == [2 * margin] * 5
    gone = np.flatnonzero(np.isnan(ranges(tmp_path / "out.mcap")[0]))
    assert gone.tolist() == [*range(4 + margin), *range(354 - margin, 360)]


@pytest.mark.slow
@pytest.mark.parametrize("beams", [360, 0])
def test_a_log_without_any_range_is_copied(beams: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = tmp_path / "run.mcap", tmp_path / "OUT.MCAP"
    write_log(log, [raw_sweeps(np.full((40, beams), np.inf, np.float32))])
    assert run(["clean", str(log), "-o", str(out)]) == 0
    told = capsys.readouterr().err
    assert f"40 sweeps; 0 of {40 * beams:,} beams" in told
    assert "  note     no beam of /scan has a range: nothing moves there\n" in told
    assert (ranges(out) == np.inf).all()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["OUT.MCAP", "OUT.cleaned.parquet", "run.mcap"]


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run"])
@pytest.mark.parametrize("wrong", [{"angle_min": np.nan}, {"angle_min": 1e30}, {"angle_increment": 0.0}], ids=str)
def test_a_log_of_which_no_sweep_can_be_read_is_no_copy(
    name: str, wrong: dict[str, float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / name, tmp_path / name.replace("run", "out")
    write_log(log, [raw_sweeps(round_room(5), topic="/b", **wrong)])
    why = "no LaserScan{} in the part that could be read; topic /b: 5 messages left out: "
    for words in ([], ["--topic", "/b"], ["--remove", "temporary"], ["--mend", "found"]):
        assert run(["clean", str(log), "-o", str(out), *words]) == 3
        assert why.format(" topic /b" if "--topic" in words else "") in " ".join(capsys.readouterr().err.split())
    with pytest.raises(UnreadableError, match="5 messages left out"):
        lidarcli.clean(log, out)
    assert [each.name for each in tmp_path.iterdir()] == [name]
    # Other commands tell the reason, too.
    sound = tmp_path / "sound.mcap"
    write_log(sound, [raw_sweeps(round_room(5))])
    for words in (
        ["map", str(log), "-o", str(tmp_path / "map.png")],
        ["poses", str(log), "-o", str(tmp_path / "path.tum")],
        ["diff", str(log), str(sound)],
        ["diff", str(sound), str(log), "--align", "as-is"],
    ):
        assert run(words) == 3
        told = " ".join(capsys.readouterr().err.split())
        assert f"{name}: no " in told
        assert "topic /b: 5 messages left out: " in told


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("0", "0 becomes range_max in AMCL and gmapping: beams free what is beyond walls"),
        ("3", "3 m is a range that the sensor can measure: programs take it for a wall"),
        ("0.01", None),
        ("40", None),
        ("above", None),
        ("NaN", None),
        ("INF", "inf says that nothing is there: costmaps with inf_is_valid free beams beyond walls"),
    ],
)
def test_what_a_value_does_is_told(
    value: str, says: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, mask = tmp_path / "run.mcap", tmp_path / "robot.toml"
    write_log(log, [raw_sweeps(round_room(5), range_min=0.1, range_max=30.0)])
    mask.write_text("[[mask]]\nsector = { from = 0, to = 9 }\n")
    told = ["--value", value, "--mask", str(mask)]
    assert run(["clean", str(log), "-o", str(tmp_path / "out.mcap"), *told]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("  note     ")]
    assert notes == ([] if says is None else [f"  note     {says}"])


@pytest.mark.slow
def test_a_sensor_that_moves_without_a_path_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "out.db3"
    with pytest.raises(UnreadableError, match=r"no poses .*seems to move; nothing written"):
        lidarcli.clean(SAMPLES / "drive.db3", out, pose="none")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.slow
def test_poses_that_contradict_the_sweeps_are_refused(tmp_path: Path) -> None:
    seconds = np.arange(drawn.SWEEPS) / drawn.SENSOR.rate
    wrong = drawn.round_about(1.7 * seconds + 3.0)
    wrong[:, 2] = -2.0 * wrong[:, 2]
    log = drawn.write(tmp_path / "run.mcap", drawn.told(wrong))
    out = tmp_path / "out.mcap"
    with pytest.raises(UnreadableError, match="contradict the sweeps of /scan; nothing written"):
        lidarcli.clean(log, out, pose="/odom")
    assert not out.exists()


@pytest.mark.slow
def test_only_the_statuses_of_beams_change_in_what_info_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = tmp_path / "run.mcap", tmp_path / "out.mcap"
    write_log(log, [room_sweeps(count=80)])
    lidarcli.clean(log, out, remove="temporary")
    told = []
    for path in (log, out):
        capsys.readouterr()
        assert run(["info", str(path), "--format", "json"]) == 0
        (one,) = json.loads(capsys.readouterr().out)
        statuses = [scan.pop("beams_by_status") for scan in one["scans"]]
        told.append({name: value for name, value in one.items() if name not in ("path", "size", "findings")})
        assert sum(statuses[0].values()) == 80 * 360
    assert told[0] == told[1]


@needs_real_logs
@pytest.mark.slow
@pytest.mark.xfail(reason="92.8 %: who stands at first is no agent yet", strict=True)
def test_marked_legs_lie_on_no_beam_that_is_left(tmp_path: Path) -> None:
    clear = marked = 0
    for number in (1, 2, 3, 6):
        log, out = REAL_LOGS / "leg_tracker" / f"positive_{number}_extracted.bag", tmp_path / f"{number}.bag"
        lidarcli.clean(log, out)
        with AnyReader([out]) as reader:
            scans, marks = (
                [
                    reader.deserialize(data, one.msgtype)
                    for one, _, data in reader.messages([each for each in reader.connections if each.topic == topic])
                ]
                for topic in ("/training_scan", "/leg_cluster_positions")
            )
        for scan, legs in zip(scans, marks, strict=True):
            bearing = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            x, y = scan.ranges * np.cos(bearing), scan.ranges * np.sin(bearing)
            left = [np.hypot(x - leg.position.x, y - leg.position.y) < 0.1 for leg in legs.poses]
            marked += bool(left)
            clear += bool(left) and not np.any(left)
    assert marked > 600
    assert clear >= 0.95 * marked
