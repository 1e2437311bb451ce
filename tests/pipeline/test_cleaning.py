"""Beams that `clean` takes, against the truth of simulated scenes and the marks of public recordings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.highlevel import AnyReader

import lidarcli
from benchmarks.scenes.moving import Kind, moving_scene
from benchmarks.scenes.random import SENSORS
from lidarcli.cli import run
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.mapping.grid import compare
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline.cleaned_beams import REASONS, _beside, _came_along, _Paths, _Reach, _sets_out, _Track, doubted
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Odometry, Scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps import Bool, Closure, Float64, Int64
from lidarcli.tabular.schemas import SCHEMAS
from tests.pipeline import drawn
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.sweeping import raw_sweeps, room_sweeps, round_room

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
@pytest.mark.parametrize(("kind", "seed"), [("crossing", 1), ("hall", 0), ("room", 7)])
def test_who_walks_slowly_is_gone_from_the_first_sight_on(kind: Kind, seed: int, tmp_path: Path) -> None:
    """The tracks of these scenes know of motion only when somebody is off by a body's size."""
    found = cleaned(moving_scene(kind, seed, SENSOR), tmp_path, seed)
    gone, moving, wrong, others = found.counts
    assert gone >= 0.98 * moving > 10_000
    assert wrong <= 0.005 * others


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("people", 3), ("room", 104)])
def test_who_stops_under_another_track_is_gone(kind: Kind, seed: int, tmp_path: Path) -> None:
    found = cleaned(moving_scene(kind, seed, SENSOR), tmp_path, seed)
    gone, moving, wrong, others = found.counts
    assert gone >= 0.98 * moving > 10_000
    assert wrong <= 0.005 * others


def paths_of(*places: Float64, first: tuple[int, ...] = (), sd: float = 0.02) -> _Paths:
    """Tracks 1, 2, ... at places (S, 2) from their first sweeps on, at 10 Hz."""
    starts = first or (0,) * len(places)
    sweep = np.concatenate([begin + np.arange(len(each)) for begin, each in zip(starts, places, strict=True)])
    track = np.repeat(np.arange(1, len(places) + 1), [len(each) for each in places])
    x, y = np.concatenate(places).T
    never = np.zeros(len(x), np.bool_)
    return _Paths(track, sweep, sweep * 100_000_000, x, y, np.full(len(x), sd), never, never)


def along(seconds: Float64) -> Float64:
    """Places (S, 2) on the way of who walks at 0.5 m/s from the time 0 on."""
    return np.column_stack([0.5 * np.maximum(seconds, 0.0), np.zeros(len(seconds))])


def test_an_agent_sets_out_where_its_path_leaves_its_place() -> None:
    stood = paths_of(along(np.arange(40) / 10 - 3.0))
    assert 30 <= _sets_out(stood, slice(0, 38)) <= 33
    walked = paths_of(along(np.arange(20) / 10))
    assert _sets_out(walked, slice(0, 15)) == 0
    # A path that drifts by 2 cm/s, as the view of a thing changes.
    drifts = paths_of(along(np.arange(60) / 250))
    assert _sets_out(drifts, slice(0, 60)) == 59
    assert _sets_out(stood, slice(0, 0)) == 0


@pytest.mark.parametrize(
    ("x", "first", "count", "came"),
    [
        (2.5, 52, 90, True),
        (2.5, 50, 90, True),
        (2.5, 0, 140, False),
        (4.0, 52, 90, False),
        (1.0, 18, 5, True),
        (1.0, 18, 30, False),
        (2.5, 70, 90, False),
    ],
)
def test_what_came_along_with_an_agent_is_part_of_it(x: float, first: int, count: int, came: bool) -> None:
    """Somebody walks for 5 s and ends at 2.45 m; a thing is seen from a sweep on, in so many sweeps."""
    thing = np.tile([x, 0.0], (count, 1))
    paths = paths_of(along(np.arange(50) / 10), thing, first=(0, first))
    rows: Int64 = np.arange(50)
    agents = _Reach(rows, np.full(50, 0.45))
    ends = _Reach(rows[-1:], np.array([0.45]))
    assert _came_along(_Track(2, False, 0, 0.1), paths, agents, ends, np.zeros(1, np.int64)) == came


def tables_of(folder: Path, **tables: dict[str, Any]) -> TableSet:
    """Tables with some columns of theirs."""
    for name, columns in tables.items():
        schema = pa.schema([SCHEMAS[name].field(column) for column in columns])
        arrays = [pa.array(values).cast(one.type) for values, one in zip(columns.values(), schema, strict=True)]
        pq.write_table(pa.Table.from_arrays(arrays, schema=schema), folder / f"run.{name}.parquet")
    return TableSet(f"{folder}/run.", ".parquet")


@pytest.mark.parametrize(
    ("drives", "seen", "says"),
    [
        (True, 100, ["/scan: 50% of the beams on agents always end at the same places before the sensor: "]),
        (False, 100, []),
        (False, 20, ["/scan: 50% of the beams on agents are on what was hidden for most of its time: "]),
    ],
)
def test_agents_that_may_be_none_are_told(drives: bool, seen: int, says: list[str], tmp_path: Path) -> None:
    """One agent before the sensor, seen in some sweeps, and one that walks."""
    way = 0.05 * np.arange(100)
    sweeps = np.arange(seen)
    before, world = np.full(seen, 0.3), 0.3 + drives * way[sweeps]
    pair = tables_of(
        tmp_path,
        objects={
            "topic": ["/scan"] * (seen + 100),
            "track": [1] * seen + [2] * 100,
            "set": ["A"] * (seen + 100),
            "beams": [100 // seen * 4] * seen + [4] * 100,
            "box_x": np.append(before, way),
            "box_y": np.zeros(seen + 100),
            "world_x": np.append(world, 2.0 * way),
            "world_y": np.zeros(seen + 100),
        },
        tracks={
            "topic": ["/scan"] * 2,
            "track": [1, 2],
            "first_sweep": [0, 0],
            "last_sweep": [99, 99],
            "duration": [9.9, 9.9],
            "sweeps": [seen, 100],
        },
    )
    told = doubted(pair)
    assert len(told) == len(says)
    assert all(line.startswith(begin) for line, begin in zip(told, says, strict=True))


@pytest.mark.slow
def test_a_note_on_a_path_names_its_topic_where_there_are_several(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "run.bag", tmp_path / "out.bag"
    both = [replace(block, topic=topic) for block in drawn.driven() for topic in ("/front", "/rear")]
    write_log(log, both, poses=drawn.told(drawn.round_about(np.arange(drawn.SWEEPS) / drawn.SENSOR.rate)))
    assert run(["clean", str(log), "-o", str(out)]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if "fit the sweeps" in line]
    assert [line.split()[1] for line in notes] == ["/front:", "/rear:"]


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
    assert _beside(batch, chosen, margin).tolist() == wanted.tolist()  # type: ignore[arg-type]


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
def test_what_is_removed_may_be_a_list(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    write_log(log, [room_sweeps(count=80)])
    for number, words in enumerate((["temporary"], ("temporary", "agents"), "temporary,agents")):
        table = lidarcli.clean(log, tmp_path / f"{number}.mcap", remove=words, margin=0)
        assert taken(table, "temporary") == [30] * 40 + [0] * 40


@pytest.mark.parametrize("odd", [3, None, ["agents", 3], {"agents": True}])
def test_what_is_removed_is_words(odd: Any, tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", [room_sweeps()])
    with pytest.raises(TypeError, match=r"^remove is a list of words, or one text, not "):
        lidarcli.clean(tmp_path / "run.mcap", tmp_path / "out.mcap", remove=odd)
    with pytest.raises(OptionError, match="'people' is not one of agents, temporary"):
        lidarcli.clean(tmp_path / "run.mcap", tmp_path / "out.mcap", remove=["agents", "people"])


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


def test_a_range_that_no_message_can_be_asked_to_say(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    write_log(log, [room_sweeps()], encoding="protobuf")
    with pytest.raises(OptionError, match="tells no range_max"):
        lidarcli.clean(log, tmp_path / "out.mcap", value="above")


@needs_real_logs
@pytest.mark.slow
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
