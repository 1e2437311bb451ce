"""Poses that are late: `track` finds by how much before it follows things, and uses the poses of that time."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from benchmarks.scenes.moving import moving_scene
from lidarcli.cli import run
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.tracker import _poses
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.options import TopicChoice
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.following import TrackOptions
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.pipeline.reading import one_log, pose_sources
from lidarcli.pipeline.reading.one_log import Reading
from lidarcli.pipeline.reading.pose_sources import (
    TRACKS,
    Delay,
    DelaySearch,
    PoseOptions,
    find_poses,
    first_delays,
)
from lidarcli.range_rules import RangeRules
from lidarcli.simulate.generate import simulate_blocks, simulate_odometry
from lidarcli.simulate.load import load_scene
from lidarcli.simulate.scene import Odometry, Scene, Sensor
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import RawSweeps, SweepBatch, SweepPoses
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.poses.pose_messages import SECOND

LATE = 0.3
TRACKED = ("track", "vx", "vy", "moving", "set")


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
def late(tmp_path_factory: pytest.TempPathFactory, drive: Scene) -> Path:
    """A drive whose poses are told 0.3 s too late."""
    return written(tmp_path_factory.mktemp("delays") / "late.mcap", drive, LATE)


def found_in(path: Path, topics: Collection[str] | None = None) -> dict[tuple[str, str], Delay]:
    """What the pass before finds."""
    with open_log(str(path)) as log:
        poses = find_poses(log)
        assert poses is not None
        return {**first_delays(log, poses.sources, TopicChoice(topics, log.topics()), RangeRules())}


def told(table: Any) -> tuple[Any, Any]:
    """`pose_delay` among the parameters of a table, and the delays by which things were followed."""
    metadata = table.schema.metadata
    source = json.loads(metadata[b"lidarcli.source"])
    parameters = json.loads(metadata[b"lidarcli.parameters"])
    return parameters.get("pose_delay"), source["poses"]["laser"].get("track_delay")


def test_things_are_followed_by_the_poses_that_fit(late: Path) -> None:
    alone, by_delay = (
        lidarcli.track(late, memory=False),
        lidarcli.track(late, memory=False, pose_delay=found_in(late)["/scan", "laser"].seconds),
    )
    for name in TRACKED:
        assert alone.objects[name].to_pylist() == by_delay.objects[name].to_pylist()
    found = lidarcli.detect(late)
    for name in set(found.column_names) - set(TRACKED):
        assert alone.objects[name].equals(found[name])
    assert not alone.objects["world_x"].equals(by_delay.objects["world_x"])


def test_what_stands_is_no_agent_though_poses_are_late(tmp_path: Path) -> None:
    scene = moving_scene("room", 704, Sensor(rate=10.0, noise=0.01), driving=True)
    still = tuple(one for one in scene.entities if one.motion.still)
    assert 2 <= len(still) < len(scene.entities)
    path = written(
        tmp_path / "run.mcap", replace(scene, entities=still, odometry=Odometry()), LATE, sweeps=scene.sweeps
    )
    as_told, alone = lidarcli.track(path, pose_delay=0.0), lidarcli.track(path)
    assert "A" in as_told.tracks["set"].to_pylist()
    assert "A" not in alone.tracks["set"].to_pylist()


def test_the_delay_is_told_and_a_delay_that_is_given_is_kept(
    late: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (best,) = found_in(late).values()
    assert best.seconds == pytest.approx(LATE, abs=0.0101)
    note = (
        f"  note     poses {best.seconds:.2f} s after the header stamps of /scan fit better: used for tracks "
        f"(--pose-delay {best.seconds:.2f} also for the world columns)"
    )
    for options, parameter, used in (
        ((), None, {"/scan": best.seconds}),
        (("--pose-delay", "0"), 0.0, None),
        (("--pose-delay", "0.1"), 0.1, None),
    ):
        assert run(["track", str(late), "-o", str(tmp_path), "--overwrite", *options]) == 0
        assert (note in capfd.readouterr().err.splitlines()) == (used is not None)
        for table in ("objects", "sweeps", "tracks"):
            assert told(pq.read_table(tmp_path / f"late.{table}.parquet")) == (parameter, used)
    assert told(lidarcli.track(late).tracks) == (None, {"/scan": best.seconds})
    assert told(lidarcli.track(late, pose_delay=0.0).tracks) == (0.0, None)


def test_poses_that_fit_are_taken_as_they_are(tmp_path: Path, drive: Scene) -> None:
    path = written(tmp_path / "right.mcap", drive, 0.0)
    alone, as_told = lidarcli.track(path), lidarcli.track(path, pose_delay=0.0)
    assert told(alone.objects) == (None, None)
    assert alone.objects.equals(as_told.objects)
    assert alone.tracks.equals(as_told.tracks)


def test_every_topic_has_its_own(tmp_path: Path, drive: Scene) -> None:
    path = written(tmp_path / "three.mcap", drive, LATE, 0.0, -0.2)
    found = found_in(path)
    assert found.keys() == {("/scan", "laser"), ("/other1", "laser")}
    assert found["/scan", "laser"].seconds == pytest.approx(LATE, abs=0.0101)
    assert found["/other1", "laser"].seconds == pytest.approx(-0.2, abs=0.0101)
    assert found_in(path, {"/other1"}) == {key: best for key, best in found.items() if key[0] == "/other1"}
    assert told(lidarcli.track(path).objects) == (
        None,
        {"/scan": found["/scan", "laser"].seconds, "/other1": found["/other1", "laser"].seconds},
    )


def test_the_start_and_the_end_do_not_change_it(late: Path) -> None:
    assert told(lidarcli.track(late, start=4.0, end=8.0, every=3).objects) == told(
        lidarcli.track(late).objects
    )


def test_who_does_not_follow_things_reads_once(
    late: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("a pass before")

    monkeypatch.setattr(one_log, "first_delays", never)
    lidarcli.detect(late)
    lidarcli.learn(late)
    lidarcli.track(late, pose_delay=0.0)
    lidarcli.track(late, pose="none")
    lidarcli.track(SAMPLES / "room.mcap", end=1.0)
    with pytest.raises(AssertionError, match="a pass before"):
        lidarcli.track(late)


@pytest.mark.slow
def test_batches_and_processors_make_no_difference(late: Path, tmp_path: Path) -> None:
    outputs = []
    for size, jobs in ((768, 1), (7, 1), (64, 2)):
        folder = tmp_path / f"{size}-{jobs}"
        options = DetectOptions(
            read=ReadOptions(batch_size=size), tracking=TrackOptions(TrackParameters()), jobs=jobs, cores=2
        )
        detect_to_files(Source(str(late), "late"), folder, options)
        outputs.append({file.name: file.read_bytes() for file in sorted(folder.iterdir())})
    assert len(outputs[0]) == 3
    assert outputs[0] == outputs[1] == outputs[2]


def test_poses_past_the_end_of_those_of_the_log_are_unknown(late: Path) -> None:
    with open_log(str(late)) as log, Reading(log, ReadOptions(), PoseOptions(), TRACKS) as sweeps:
        (batch,) = sweeps.batches(None)
    poses, true = batch.poses, batch.true_poses
    assert poses is not None
    assert true is not None
    # The poses begin two sweeps before the first one, and hold for 0.1 s after their last one.
    assert not np.isnan(poses.x).any()
    assert np.isnan(true.x).sum() <= 2
    assert np.isnan(true.x)[-1]
    # Poses and sweeps come 0.2 s apart: half a step more than one on.
    between = 0.5 * (poses.x[1:-2] + poses.x[2:-1])
    (best,) = found_in(late).values()
    np.testing.assert_allclose(true.x[:-3], between, atol=0.5 * abs(best.seconds - LATE) + 0.005)
    assert (_poses(batch)[:-3, 0] == true.x[:-3]).all()


def test_rows_keep_both_poses(late: Path) -> None:
    batch = next(iter(lidarcli.read(late)))
    assert batch.true_poses is None
    assert batch.poses is not None
    both = replace(
        batch,
        true_poses=SweepPoses(batch.poses.x + 1.0, batch.poses.y, batch.poses.yaw, batch.poses.upside_down),
    )
    picked = both.rows(np.array([5, 3]))
    assert picked.true_poses is not None
    assert picked.true_poses.x.tolist() == (batch.poses.x[[5, 3]] + 1.0).tolist()
    ((_, _, whole),) = both.by_frame()
    assert isinstance(whole, SweepBatch)
    assert whole.true_poses is both.true_poses


class Counted:
    """A log that counts the sweeps that are asked of it."""

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


@pytest.mark.parametrize(("enough", "most", "read"), [(30, 10_000, 30), (200, 60, 60), (200, 10_000, 150)])
def test_no_more_is_read_than_it_takes(
    late: Path, monkeypatch: pytest.MonkeyPatch, enough: int, most: int, read: int
) -> None:
    """A sample that is full, a limit, or the end of the log; of the sweeps that are judged together all are read."""
    monkeypatch.setattr("lidarcli.poses.delay.SWEEPS", enough)
    monkeypatch.setattr(pose_sources, "MOST_SWEEPS", most)
    monkeypatch.setattr("lidarcli.logs.piles.WINDOW", 30)
    log = Counted(late)
    with log.log:
        poses = find_poses(log.log)
        assert poses is not None
        first_delays(log, poses.sources, TopicChoice(None, log.topics()), RangeRules())  # type: ignore[arg-type]
    assert log.sweeps == read


def test_only_the_first_topics_are_looked_at(
    tmp_path: Path, drive: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "two.mcap", drive, LATE, LATE, sweeps=60)
    monkeypatch.setattr(pose_sources, "MAX_DELAYS", 1)
    with open_log(str(path)) as log:
        poses = find_poses(log)
        assert poses is not None
        search = DelaySearch(poses.sources)
        for block in log.scans(None, ReadReport()):
            search.add(block, RangeRules())
    assert len(search.best()) == 1


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
            tmp_path / str(delay),
            DetectOptions(poses=PoseOptions("/odom", delay=delay), tracking=TrackOptions(TrackParameters())),
        )
        for delay in (None, 0.0)
    ]
    assert said[0].damage == said[1].damage
    assert len(said[0].damage) == 1


@pytest.mark.slow
@needs_real_logs
@pytest.mark.parametrize(
    ("log", "delay"),
    [
        ("comprobo24/drive_square", {"/scan": -0.36}),
        ("ros_behaviors_fsm/teleop", {"/scan": -0.35}),
        ("datmo/parallel.bag", None),
    ],
)
def test_delays_of_real_logs(log: str, delay: dict[str, float] | None) -> None:
    tables = lidarcli.track(REAL_LOGS / log, memory=False)
    (poses,) = json.loads(tables.tracks.schema.metadata[b"lidarcli.source"])["poses"].values()
    assert poses.get("track_delay") == delay
    assert tables.objects["world_x"].equals(lidarcli.detect(REAL_LOGS / log)["world_x"])
