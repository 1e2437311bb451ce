"""The path of each sensor of a log: the delays that are found, the limits, sensors that stand, and the order of beams."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
from lidarcli.pipeline.reading import path_check
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.pose.tracks import planar
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Odometry, Scene, load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import TURN, Float64, RawSweeps
from tests.pipeline.drawn import (
    SENSOR,
    SWEEPS,
    away,
    checked,
    round_about,
    scene_of,
    stamps,
    standing,
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


def test_poses_that_fit_are_left_alone(drive: Scene, tmp_path: Path) -> None:
    log = written(tmp_path / "right.mcap", drive, 0.0)
    alone, as_told = lidarcli.track(log), lidarcli.track(log, pose_delay=0.0)
    assert facts(alone.objects)["pose_verdict"] == {"/scan": "told"}
    assert facts(alone.objects)["pose_delay"] == {"/scan": 0.0}
    assert alone.objects.equals(as_told.objects)
    assert alone.tracks.equals(as_told.tracks)


def test_a_delay_that_is_given_is_kept(late: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for options, parameter, found in (
        ((), None, LATE),
        (("--pose-delay", "0"), 0.0, LATE),
        (("--pose-delay", "0.1"), 0.1, 0.15),
    ):
        assert run(["track", str(late), "-o", str(tmp_path), "--overwrite", *options]) == 0
        said = capfd.readouterr().err
        assert ("they were named" in said) == bool(options)
        assert f"{found:.2f} s late" in said
        for table in ("objects", "sweeps", "tracks"):
            schema = pq.read_schema(tmp_path / f"late.{table}.parquet")
            assert json.loads(schema.metadata[b"lidarcli.parameters"]).get("pose_delay") == parameter
            poses = json.loads(schema.metadata[b"lidarcli.source"])["poses"]["laser"]
            assert poses["pose_delay"]["/scan"] == pytest.approx(found, abs=0.011)


# --- topics and limits --------------------------------------------------------------------------------------


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


@pytest.mark.slow
def test_batches_and_processors_make_no_difference(late: Path, tmp_path: Path) -> None:
    outputs = []
    for batch, jobs in ((768, 1), (64, 2)):
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
    source, tracking = Source(str(tmp_path / name), "run"), TrackOptions(TrackParameters())
    runs = [(tracking, PoseOptions("/odom", delay=0.0)), (tracking, PoseOptions("match"))]
    runs += [(each, PoseOptions(pose)) for pose in ("/odom", "none") for each in (tracking, None)]
    said = [
        detect_to_files(source, tmp_path / f"tables-{number}", DetectOptions(poses=poses, tracking=each)).damage
        for number, (each, poses) in enumerate(runs)
    ]
    assert len(said[0]) == 1
    assert said == [said[0]] * len(runs)
    assert inspect_log(source).damage == tuple(said[0])


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


@pytest.mark.parametrize(("way", "passes"), [(standing, 0), (stop_and_go, 1)])
def test_where_a_sensor_stands_one_pass_is_enough(
    way: Callable[[Float64], Float64], passes: int, tmp_path: Path, looks: list[object]
) -> None:
    """As long as it does: where it moves both passes are made anew, and the tables are those of two passes."""
    log = write(tmp_path / "run.mcap", None, scene_of(way))
    two = lidarcli.track(log)
    looks.clear()
    detect_to_files(Source(str(log), "run"), tmp_path / "out", DetectOptions(tracking=TrackOptions(TrackParameters())))
    assert len(looks) == passes
    for name, table in (("objects", two.objects), ("sweeps", two.sweeps), ("tracks", two.tracks)):
        found = pq.read_table(tmp_path / "out" / f"run.{name}.parquet")
        assert found.equals(table.cast(found.schema))
        assert json.loads(found.schema.metadata[b"lidarcli.source"]) == json.loads(
            table.schema.metadata[b"lidarcli.source"]
        )
    assert len([*(tmp_path / "out").iterdir()]) == 4


def test_where_the_path_is_not_known_there_are_no_poses(tmp_path: Path) -> None:
    sweeps = sweeps_of(scene_of())
    for sweep in sweeps[60:75]:
        sweep.ranges[:] = np.inf
    write_log(tmp_path / "run.mcap", sweeps)
    ((_, path),) = checked(tmp_path / "run.mcap").items()
    assert path.verdict == "matched"
    assert path.notes == ("matched path of /scan: 15 of 200 sweeps fit nowhere",)
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


# --- recordings ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@needs_real_logs
@pytest.mark.filterwarnings("ignore:.* repeats .*:UserWarning")
@pytest.mark.parametrize(
    ("log", "verdict", "delay"),
    [
        ("comprobo24/drive_square", "corrected", -0.34),
        ("ros_behaviors_fsm/teleop", "corrected", -0.35),
        ("my_gazebo_tutorials/20_53_49", "told", 0.0),
    ],
)
def test_verdicts_on_real_logs(log: str, verdict: str, delay: float) -> None:
    """The driver of the first two stamps a sweep when it has arrived."""
    tables = lidarcli.track(REAL_LOGS / log, memory=False)
    (poses,) = json.loads(tables.tracks.schema.metadata[b"lidarcli.source"])["poses"].values()
    assert poses["pose_verdict"]["/scan"] == verdict
    assert poses["pose_delay"]["/scan"] == pytest.approx(delay, abs=0.06)
