"""The path of each sensor of a log: the delays that are found, the limits, sensors that stand, and the order of beams."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from benchmarks.scenes.moving import moving_scene
from lidarcli.cli import run
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.options import TopicChoice
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.objects.tracking import TrackOptions
from lidarcli.pipeline.reading import path_check
from lidarcli.pipeline.reading.path_check import check_paths
from lidarcli.pipeline.reading.posing import PoseOptions, find_poses
from lidarcli.pose.tracks import planar
from lidarcli.range_rules import RangeRules
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Odometry, Scene, Sensor, load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps import TURN, Float64, RawSweeps
from tests.going import in_the_world
from tests.pipeline.drawn import (
    SENSOR,
    SWEEPS,
    away,
    checked,
    round_about,
    scene_of,
    stamps,
    standing,
    straight,
    sweeps_of,
    told,
    write,
)
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.pose.pose_messages import SECOND

LATE = 0.25


def written(path: Path, scene: Scene, late: float, *others: float, sweeps: int = 150) -> Path:
    """A run whose poses are `late` [s]; on topic /other<k> are the same sweeps with stamps that make it others[k]."""
    assert scene.odometry is not None
    scene = replace(scene, odometry=replace(scene.odometry, delay=late))
    blocks = [block.raw for block in simulate_blocks(scene, sweeps, 0)]
    for number, other in enumerate(others):
        shift = round((late - other) * SECOND)
        blocks += [
            replace(block, topic=f"/other{number}", stamp_ns=block.stamp_ns + shift)
            for block in blocks
            if block.topic == "/scan"
        ]
    write_log(path, blocks, poses=simulate_odometry(scene, sweeps, 0))
    return path


@pytest.fixture(scope="module")
def drive() -> Scene:
    return load_scene(SAMPLES / "drive.toml")


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive whose poses are told 0.25 s too late."""
    return written(tmp_path_factory.mktemp("paths") / "late.mcap", scene_of(odometry=Odometry()), LATE)


def facts(table: Any) -> dict[str, Any]:
    """What the metadata of a table tell of the poses of the laser."""
    found: dict[str, Any] = json.loads(table.schema.metadata[b"lidarcli.source"])["poses"]["laser"]
    return found


def path_of(log: Path) -> Float64:
    """(S, 3) the path to use of the only sensor, at its sweeps."""
    (path,) = checked(log).values()
    assert path.chain is not None
    there = planar(path.chain.at(path.stamp_ns))
    return np.column_stack([there.x, there.y, there.yaw])


# --- delays -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [-0.3, -0.2, -0.13, -0.05, 0.07, 0.18, 0.3])
def test_delays_of_the_sample_drive_are_found(late: float, drive: Scene, tmp_path: Path) -> None:
    exact = replace(drive, odometry=Odometry())
    (path,) = checked(written(tmp_path / "run.mcap", exact, late)).values()
    assert path.fit is not None
    assert path.verdict == "corrected"
    # Poses are drawn by a straight line between two that are 0.2 s apart.
    assert path.fit.delay == pytest.approx(late, abs=0.02)
    assert path.fit.mount == pytest.approx((0.0, 0.0, 0.0), abs=0.02)


@pytest.mark.parametrize("late", [-0.13, 0.2])
def test_delays_of_odometry_that_drifts_are_found(late: float, drive: Scene, tmp_path: Path) -> None:
    (path,) = checked(written(tmp_path / "run.mcap", drive, late)).values()
    assert path.fit is not None
    assert path.fit.delay == pytest.approx(late, abs=0.02)


def test_poses_that_fit_are_left_alone(drive: Scene, tmp_path: Path) -> None:
    log = written(tmp_path / "right.mcap", drive, 0.0)
    alone, as_told = lidarcli.track(log), lidarcli.track(log, pose_delay=0.0)
    assert facts(alone.objects)["pose_verdict"] == {"/scan": "accepted"}
    assert facts(alone.objects)["pose_delay"] == {"/scan": 0.0}
    assert alone.objects.equals(as_told.objects)
    assert alone.tracks.equals(as_told.tracks)


def test_at_a_constant_speed_there_is_no_delay(tmp_path: Path) -> None:
    line = scene_of(straight, odometry=Odometry())
    (path,) = checked(written(tmp_path / "run.mcap", line, LATE, sweeps=SWEEPS)).values()
    assert path.fit is not None
    assert (path.verdict, path.fit.delay) == ("accepted", 0.0)


def test_track_is_that_at_the_delay(late: Path) -> None:
    (path,) = checked(late).values()
    assert path.fit is not None
    alone, by_delay = lidarcli.track(late), lidarcli.track(late, pose_delay=path.fit.delay)
    for name in ("track", "set", "moving"):
        assert alone.objects[name].equals(by_delay.objects[name])
    # The mount that fits best is a few millimetres off.
    for name in ("world_x", "world_y"):
        here, there = (table.objects[name].to_numpy(zero_copy_only=False) for table in (alone, by_delay))
        np.testing.assert_allclose(here, there, atol=0.01)
    assert lidarcli.detect(late)["world_x"].equals(alone.objects["world_x"])


def test_what_stands_is_no_agent_though_poses_are_late(tmp_path: Path) -> None:
    scene = moving_scene("room", 704, Sensor(rate=10.0, noise=0.01), driving=True)
    still = tuple(one for one in scene.entities if one.motion.still)
    assert 2 <= len(still) < len(scene.entities)
    log = written(tmp_path / "run.mcap", replace(scene, entities=still, odometry=Odometry()), 0.3, sweeps=scene.sweeps)
    as_told, alone = lidarcli.track(log, pose_delay=0.0), lidarcli.track(log)
    assert "A" in as_told.tracks["set"].to_pylist()
    assert "A" not in alone.tracks["set"].to_pylist()


def test_a_delay_that_is_given_is_kept(late: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for options, parameter, found in (
        ((), None, LATE),
        (("--pose-delay", "0"), 0.0, LATE),
        (("--pose-delay", "0.1"), 0.1, 0.15),
    ):
        assert run(["track", str(late), "-o", str(tmp_path), "--overwrite", *options]) == 0
        said = capfd.readouterr().err
        assert ("they were named" in said) == bool(options)
        assert f"poses from /tf fit the sweeps if corrected (stamped {found:.2f} s later than the sweeps" in said
        for table in ("objects", "sweeps", "tracks"):
            schema = pq.read_schema(tmp_path / f"late.{table}.parquet")
            assert json.loads(schema.metadata[b"lidarcli.parameters"]).get("pose_delay") == parameter
            poses = json.loads(schema.metadata[b"lidarcli.source"])["poses"]["laser"]
            assert poses["pose_delay"]["/scan"] == pytest.approx(found, abs=0.011)


def test_the_start_and_the_end_do_not_change_it(late: Path) -> None:
    whole = facts(lidarcli.track(late).objects)
    assert whole["pose_delay"]["/scan"] == pytest.approx(LATE, abs=0.011)
    assert facts(lidarcli.track(late, start=4.0, end=8.0, every=3).objects) == whole


def test_poses_past_the_end_of_those_of_the_log_are_unknown(late: Path) -> None:
    parts = [batch.poses for batch in lidarcli.read(late)]
    x = np.concatenate([part.x for part in parts if part is not None])
    # The last pose holds for 0.1 s.
    assert np.isnan(x).tolist() == [False] * 148 + [True] * 2


# --- topics and limits --------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.* repeats .*:UserWarning")
def test_every_topic_has_its_own(tmp_path: Path) -> None:
    log = written(tmp_path / "three.mcap", scene_of(odometry=Odometry()), LATE, 0.0, -0.2, sweeps=100)
    found = checked(log)
    delays = {"/scan": LATE, "/other0": 0.0, "/other1": -0.2}
    assert found.keys() == {(topic, "laser") for topic in delays}
    for topic, delay in delays.items():
        fit = found[topic, "laser"].fit
        assert fit is not None
        assert fit.delay == pytest.approx(delay, abs=0.011)
    (alone,) = checked(log, topics={"/other1"}).items()
    assert (alone[0], alone[1].fit) == (("/other1", "laser"), found["/other1", "laser"].fit)
    assert facts(lidarcli.track(log).objects)["pose_delay"] == pytest.approx(delays, abs=0.011)


def test_only_the_first_topics_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = written(tmp_path / "two.mcap", scene_of(odometry=Odometry()), LATE, LATE, sweeps=60)
    monkeypatch.setattr(path_check, "MOST_MATCHED", 1)
    assert len(checked(log)) == 1


def test_who_needs_no_path_reads_once(late: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("a pass before")

    monkeypatch.setattr(path_check, "check_paths", never)
    lidarcli.detect(late, pose="none")
    lidarcli.detect(SAMPLES / "room.mcap", end=1.0)
    next(iter(lidarcli.read(SAMPLES / "room.mcap")))
    for command, log in ((lidarcli.track, late), (lidarcli.detect, late), (lidarcli.track, SAMPLES / "room.mcap")):
        with pytest.raises(AssertionError, match="a pass before"):
            command(log)


class Counted:
    """A log that counts the sweeps that are asked of it."""

    size = 1

    def __init__(self, path: Path) -> None:
        self.log = open_log(str(path))
        self.sweeps = 0

    def topics(self) -> Any:
        return self.log.topics()

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        for block in self.log.scans(topics, report):
            for row in range(len(block)):
                self.sweeps += 1
                yield block.rows(slice(row, row + 1))


@pytest.mark.parametrize(("enough", "way", "least", "most"), [(40, 1.0, 40, 80), (40, 3.0, 75, 110), (40, 100.0, 150, 150)])
def test_no_more_is_read_than_it_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, enough: int, way: float, least: int, most: int
) -> None:
    """So many sweeps and so long a way, or the end of the log; a sensor goes 0.4 m a second."""
    log = Counted(written(tmp_path / "run.mcap", scene_of(odometry=Odometry()), 0.0))
    monkeypatch.setattr(path_check, "ENOUGH", enough)
    monkeypatch.setattr(path_check, "ENOUGH_WAY", way)
    monkeypatch.setattr("lidarcli.logs.piles.WINDOW", 10)
    monkeypatch.setattr(path_check, "ReadOptions", partial(ReadOptions, batch_size=10))
    with log.log:
        poses = find_poses(log.log)
        assert poses is not None
        found = check_paths(log, poses.sources, TopicChoice(None, log.topics()), RangeRules())  # type: ignore[arg-type]
    assert {path.verdict for path in found.values()} == {"accepted"}
    assert least <= log.sweeps <= most


def test_of_a_sensor_that_stands_some_sweeps_are_matched(tmp_path: Path) -> None:
    still = replace(scene_of(standing), sweeps=1000)
    log = tmp_path / "run.mcap"
    write_log(log, (part for part in sweeps_of(still)))
    (path,) = checked(log).values()
    assert path.verdict == "none"
    assert path.still.all()
    assert path_check.PERIOD <= len(path.stamp_ns) < 1000


@pytest.mark.parametrize("size", [64])
@pytest.mark.slow
def test_batches_and_processors_make_no_difference(late: Path, tmp_path: Path, size: int) -> None:
    outputs = []
    for batch, jobs in ((768, 1), (size, 2)):
        folder = tmp_path / f"{batch}-{jobs}"
        options = DetectOptions(
            read=ReadOptions(batch_size=batch), tracking=TrackOptions(TrackParameters()), jobs=jobs, cores=2
        )
        detect_to_files(Source(str(late), "late"), folder, options)
        outputs.append({file.name: file.read_bytes() for file in sorted(folder.iterdir())})
    assert len(outputs[0]) == 4
    assert outputs[0] == outputs[1]


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run.db3"])
def test_damage_is_told_once(tmp_path: Path, drive: Scene, name: str) -> None:
    assert drive.odometry is not None
    scene = replace(drive, odometry=replace(drive.odometry, delay=LATE))
    blocks = [block.raw for block in simulate_blocks(scene, 150, 0)]
    one_by_one = [part.rows(slice(k, k + 1)) for part in blocks for k in range(len(part))]
    write_log(tmp_path / name, one_by_one, poses=simulate_odometry(scene, 150, 0), chunk_size=4000)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) * 4 // 5])
    said = [
        detect_to_files(
            Source(str(tmp_path / name), "run"),
            tmp_path / f"tables-{number}",
            DetectOptions(poses=poses, tracking=TrackOptions(TrackParameters())),
        )
        for number, poses in enumerate(
            (PoseOptions("/odom"), PoseOptions("/odom", delay=0.0), PoseOptions("none"), PoseOptions("match"))
        )
    ]
    assert len(said[0].damage) == 1
    assert all(one.damage == said[0].damage for one in said)


# --- standing -----------------------------------------------------------------------------------------------


def stop_and_go(seconds: Float64) -> Float64:
    """It stands for 6 s, goes 2 m in 6 s, and stands again."""
    x = np.clip((seconds - 6.0) / 3.0, 0.0, 2.0)
    return np.column_stack([x - 1.0, 0.0 * x, 0.0 * x])


def test_a_sensor_that_stops_stands_there(tmp_path: Path) -> None:
    log = write(tmp_path / "run.mcap", None, scene_of(stop_and_go))
    batches = list(lidarcli.read(log, pose="match"))
    still = np.concatenate([batch.still for batch in batches if batch.still is not None])
    assert len(still) == SWEEPS
    seconds = np.arange(SWEEPS) * 0.1
    # The window is 2 s long.
    assert still[(seconds < 5.0) | (seconds > 13.0)].all()
    assert not still[(seconds > 7.0) & (seconds < 11.0)].any()
    rows = batches[0].rows(np.array([70, 3]))
    assert rows.still is not None
    assert rows.still.tolist() == [False, True]
    ((_, _, whole),) = batches[0].by_frame()
    assert whole.still is batches[0].still


def test_where_the_path_is_not_known_there_are_no_poses(tmp_path: Path) -> None:
    sweeps = sweeps_of(scene_of())
    for sweep in sweeps[60:75]:
        sweep.ranges[:] = np.inf
    write_log(tmp_path / "run.mcap", sweeps)
    ((_, path),) = checked(tmp_path / "run.mcap").items()
    assert path.verdict == "matched"
    assert path.notes == ("no pose for 15 of 200 sweeps of /scan: they fit nowhere, or may slide along their walls",)
    assert path.chain is not None
    there = np.isfinite(path.chain.at(stamps()).position[:, 0])
    assert np.flatnonzero(~there).tolist() == list(range(60, 75))


# --- the order of the beams ---------------------------------------------------------------------------------

TAKES = 0.09
"""Duration of a sweep [s]."""
ROLLING = replace(SENSOR, time_increment=TAKES / 360)
LAST_FIRST = replace(ROLLING, angle_min=np.pi - TURN / 360, angle_increment=-TURN / 360)


def flipped(raw: RawSweeps) -> RawSweeps:
    """Sweeps whose arrays a driver has filled from their ends, as copies of the RPLIDAR driver do."""
    last = (raw.beams - 1) * raw.angle_increment
    ranges = raw.ranges[:, ::-1].copy()
    return replace(raw, ranges=ranges, angle_min=raw.angle_min + last, angle_increment=-raw.angle_increment)


def taken(path: Path, order: str, way: Callable[[Float64], Float64], header: float, *, poses: bool = False) -> Path:
    """A log whose beams are taken in this order while headers tell of another duration of a sweep [s]."""
    sensor = {"forward": ROLLING, "reverse": LAST_FIRST, "once": SENSOR}[order]
    sweeps = sweeps_of(scene_of(way, sensor))
    if order == "reverse":
        sweeps = [flipped(raw) for raw in sweeps]
    step, period = np.full(1, header / 360, np.float32), np.full(1, 0.1 if header else 0.0, np.float32)
    sweeps = [replace(raw, time_increment=step, scan_time=period) for raw in sweeps]
    write_log(path, sweeps, poses=told(way(np.arange(SWEEPS) * 0.1)) if poses else None)
    return path


@pytest.mark.parametrize(
    ("order", "header", "poses"),
    [
        ("forward", TAKES, False),
        ("reverse", TAKES, True),
        ("reverse", 0.0, False),
        ("once", TAKES, False),
        ("once", TAKES, True),
    ],
)
def test_the_order_of_the_beams_is_learned(tmp_path: Path, order: str, header: float, poses: bool) -> None:
    log = taken(tmp_path / "run.mcap", order, round_about, header, poses=poses)
    (path,) = checked(log).values()
    assert path.timing.order == order
    assert path.facts()["beam_order"] == order
    # Headers that tell nothing leave 0.9 of the time from sweep to sweep.
    assert path.timing.duration == pytest.approx(0.0 if header else 0.09)
    assert away(path_of(log), round_about).max() < (1e-6 if poses else 0.08)


@pytest.mark.parametrize("order", ["forward", "reverse", "once"])
def test_a_sensor_that_stands_leaves_the_order_to_the_headers(tmp_path: Path, order: str) -> None:
    (path,) = checked(taken(tmp_path / "run.mcap", order, standing, TAKES)).values()
    assert (path.timing.order, path.timing.duration) == ("auto", 0.0)
    assert "beam_order" not in path.facts()


@pytest.mark.parametrize("order", ["forward", "reverse", "once"])
def test_an_order_that_is_given_is_kept(tmp_path: Path, order: str) -> None:
    log = taken(tmp_path / "run.mcap", "reverse", round_about, TAKES)
    (path,) = checked(log, order=order).values()
    assert path.timing.order == order
    table = lidarcli.detect(log, beam_order=order, pose="match")
    assert facts(table)["beam_order"] == {"/scan": order}
    assert json.loads(table.schema.metadata[b"lidarcli.parameters"])["beam_order"] == order


def test_walls_are_sharp_by_the_order_that_was_learned(tmp_path: Path) -> None:
    log = taken(tmp_path / "run.mcap", "reverse", round_about, TAKES, poses=True)
    off = {}
    for order in ("auto", "forward", "reverse"):
        (batch,) = lidarcli.read(log, beam_order=order)
        points = np.vstack([in_the_world(batch, row) for row in range(0, SWEEPS, 10)])
        from_wall = np.abs(np.abs(points) - [4.0, 3.0]).min(axis=1)
        # A tenth of the points are of the two cylinders.
        off[order] = float(np.quantile(from_wall, 0.8))
    assert off["auto"] == off["reverse"] < 0.02
    assert off["forward"] > 0.04


# --- recordings ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@needs_real_logs
@pytest.mark.filterwarnings("ignore:.* repeats .*:UserWarning")
@pytest.mark.parametrize(
    ("log", "verdict", "delay"),
    [
        ("comprobo24/drive_square", "corrected", -0.34),
        ("ros_behaviors_fsm/teleop", "corrected", -0.35),
        ("my_gazebo_tutorials/20_53_49", "accepted", 0.0),
    ],
)
def test_verdicts_on_real_logs(log: str, verdict: str, delay: float) -> None:
    """The driver of the first two stamps a sweep when it has arrived."""
    tables = lidarcli.track(REAL_LOGS / log, memory=False)
    (poses,) = json.loads(tables.tracks.schema.metadata[b"lidarcli.source"])["poses"].values()
    assert poses["pose_verdict"]["/scan"] == verdict
    assert poses["pose_delay"]["/scan"] == pytest.approx(delay, abs=0.06)
