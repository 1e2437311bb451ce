"""Every sweep gets its pose: from logs in every container to the columns of the tables and the notes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.logs.base import LASERSCAN, Message, ReadReport, Topic
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.needs import NO_POSES, PoseOptions
from lidarcli.pipeline.reading.path_choice import CheckedPath
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.simulation.generate import SimulatedPoses, simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Scene, load_scene
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import RawSweeps, SweepBatch, SweepPoses
from tests.fake_log import FakeLog
from tests.places import SAMPLES
from tests.pose.pose_messages import ODOMETRY, SECOND, odometry, pose_stamped, tf
from tests.sweeping import START, raw_sweeps
from tests.text_logs import write_log


def drive() -> tuple[Scene, SimulatedPoses]:
    """The scene of a robot that drives around, and what it believes of its way."""
    scene = load_scene(SAMPLES / "drive.toml")
    poses = simulate_odometry(scene, 12, seed=0)
    assert poses is not None
    return scene, poses


def scanned(scene: Scene, count: int = 12) -> list[RawSweeps]:
    return [block.raw for block in simulate_blocks(scene, count, 0)]


def poses_of(path: Path, pose: str | None = None) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(S, 3) x, y, yaw of the sweeps as `read` gives them."""
    parts = [batch.poses for batch in lidarcli.read(path, pose=pose)]
    assert all(part is not None for part in parts)
    return np.concatenate([np.column_stack([p.x, p.y, p.yaw]) for p in parts if p is not None])


def test_poses_between_those_of_the_log(tmp_path: Path) -> None:
    """Odometry at 7 Hz along a line while turning at a constant rate; sweeps at 5 Hz, some of them outside."""
    scene, poses = drive()
    stamps = START + 350_000_000 + np.arange(12, dtype=np.int64) * SECOND // 7

    def truth(stamp_ns: np.ndarray[tuple[int], np.dtype[np.int64]]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        seconds = (stamp_ns - START) / SECOND
        return np.column_stack([1 + 2 * seconds, -seconds, 3.0 + seconds])

    rows = replace(poses, stamp_ns=stamps, poses=truth(stamps))
    write_log(tmp_path / "run.mcap", scanned(scene), poses=rows)
    found = poses_of(tmp_path / "run.mcap")
    sweeps = START + np.arange(12) * 200_000_000
    # 79 ms after the last pose it still holds; 150 ms before the first one nothing is known.
    inside = (sweeps >= stamps[0]) & (sweeps <= stamps[-1] + 100_000_000)
    assert inside.tolist() == [False] * 2 + [True] * 9 + [False]
    np.testing.assert_array_equal(np.isnan(found).all(axis=1), ~inside)
    expected = truth(np.minimum(sweeps, stamps[-1]))[inside]
    np.testing.assert_allclose(found[inside, :2], expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(found[inside, 2] - expected[:, 2]), 1, atol=1e-12)

    summary = detect_to_files(Source(str(tmp_path / "run.mcap"), "run"), tmp_path, DetectOptions())
    assert summary.notes == [
        "poses from /tf and /tf_static (odom > base_link > laser): unchecked: only 5 steps of its sweeps can be compared; "
        "also available: /odom (--pose TOPIC)",
        "poses from /tf are unchecked: only 5 steps of its sweeps can be compared",
        "3 of 12 sweeps of frame laser have no pose: they are outside the span of /tf",
    ]
    assert summary.exit_code == 0
    sweeps_table = pq.read_table(tmp_path / "run.sweeps.parquet")
    for name, column in zip(("pose_x", "pose_y", "pose_yaw"), found.T, strict=True):
        values = [None if np.isnan(value) else value for value in column]
        assert sweeps_table[name].to_pylist() == values
    objects = pq.read_table(tmp_path / "run.objects.parquet").to_pylist()
    assert {row["world_x"] is None for row in objects if not inside[row["sweep"]]} == {True}
    for row in objects:
        if inside[row["sweep"]]:
            x, y, yaw = found[row["sweep"]]
            assert row["world_x"] == pytest.approx(x + np.cos(yaw) * row["box_x"] - np.sin(yaw) * row["box_y"])
            assert row["world_y"] == pytest.approx(y + np.sin(yaw) * row["box_x"] + np.cos(yaw) * row["box_y"])
            assert abs(np.sin(row["world_yaw"] - yaw - row["box_yaw"])) < 1e-6
            assert -np.pi / 2 < row["world_yaw"] <= np.pi / 2


# --- one log in memory ------------------------------------------------------------------------------------


class PosesLog(FakeLog):
    """A log in memory with sweeps that nobody reads here and some pose messages."""

    def __init__(self, messages: Sequence[Message] = (), size: int | None = 1234, damage: str = "") -> None:
        names = dict.fromkeys((message.topic, message.type) for message in messages)
        topics = [Topic("/scan", LASERSCAN, "cdr", 40), *(Topic(*name, "cdr", 9) for name in names)]
        super().__init__((), None if size is None else topics, messages, size=size)
        self.damage = damage

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        if self.damage:
            report.add_damage("byte 7", self.damage)
        return super().messages(types, report)


def posing_of(log: PosesLog, options: PoseOptions | None = None) -> PoseAttacher:
    """The poses of a log in memory, of which nobody reads the sweeps."""
    return PoseAttacher.of(log, options or PoseOptions(), TopicChoice(None, log.topics()), ReadOptions())


def batch_of(count: int = 40, stamp_ns: int = START, record_ns: int = START, frame: str = "laser") -> SweepBatch:
    """Sweeps at 10 Hz."""
    steps = np.arange(count) * 100_000_000
    raw = raw_sweeps(
        np.ones((count, 4)),
        frame_ids=(frame,),
        stamp_ns=stamp_ns + steps,
        record_ns=record_ns + steps,
        angle_min=0.0,
        angle_increment=0.1,
    )
    return normalise(raw, np.arange(count), RangeRules())


def cut(batch: SweepBatch, size: int) -> Iterator[SweepBatch]:
    names = ("frame", "sweep", "stamp_ns", "record_ns", "angle_min", "angle_increment", "range_min", "range_max")
    for first in range(0, len(batch), size):
        rows = slice(first, first + size)
        arrays = {name: getattr(batch, name)[rows] for name in (*names, "beams", "ranges", "status", "closure")}
        yield replace(batch, **arrays)


def posed(messages: list[Message], batch: SweepBatch | None = None) -> tuple[SweepPoses | None, list[str]]:
    """The poses of some sweeps by a log with these messages, and the notes."""
    posing = posing_of(PosesLog(messages))
    poses = posing.attach(batch or batch_of()).poses
    return poses, posing.notes()


def test_two_sensors_have_a_chain_each() -> None:
    front, rear = batch_of(3, frame="front"), batch_of(3, frame="/rear")
    both = replace(front, frame_ids=("front", "/rear"), frame=np.array([0, 1, 0], np.int32))
    messages = [odometry(START + k * SECOND, "odom", "base_link", (k, 0, 0)) for k in range(2)]
    messages += [tf(START + k * SECOND, "odom", "base_link", (k, 0, 0)) for k in range(2)]
    messages += [
        tf(0, "base_link", "front", (1, 0, 0), "/tf_static"),
        tf(0, "base_link", "rear", (-1, 0, np.pi), "/tf_static"),
    ]
    poses, notes = posed(messages, both)
    assert poses is not None
    np.testing.assert_allclose(poses.x, [1.0, -0.9, 1.2])
    np.testing.assert_allclose(np.cos(poses.yaw), [1, -1, 1])
    assert notes == [
        "poses from /tf and /tf_static (odom > base_link > rear); also available: /odom (--pose TOPIC)",
        "poses from /tf and /tf_static (odom > base_link > front); also available: /odom (--pose TOPIC)",
    ]
    assert len(rear) == 3


def test_clocks_that_differ_are_not_mixed() -> None:
    far = 93 * 86400 * SECOND
    messages = [
        odometry(START - far + k * SECOND, "odom", "laser", (k, 0, 0))._replace(record_ns=START + k * SECOND)
        for k in range(6)
    ]
    poses, notes = posed(messages)
    assert poses is not None
    assert np.isnan(poses.x).all()
    assert notes[1] == (
        "40 of 40 sweeps of frame laser have no pose: the clock of /odom is 8,035,200.00 s behind that of the sweeps"
    )
    # Recorded at other times, it is no fault of a clock.
    _, notes = posed([message._replace(record_ns=message.record_ns - far) for message in messages])
    assert notes[1] == (
        "40 of 40 sweeps of frame laser have no pose: they are outside the span of /odom, "
        "whose poses begin 8,035,200.00 s before the sweeps"
    )


def test_a_leaning_sensor_and_a_clock_that_jumps_are_noted() -> None:
    lean = np.deg2rad(30)
    tilted = (0, 0, 0, np.sin(lean / 2), 0, 0, np.cos(lean / 2))
    messages = [tf(START + k * SECOND, "map", "laser", tilted) for k in (0, 2, 4, 1, 3)]
    _, notes = posed(messages)
    assert notes == [
        "poses from /tf (map > laser)",
        "frame laser leans by up to 30 degrees: its poses are their projection",
        "stamps of /tf jump back once: poses there may mix two runs",
    ]


def test_quaternions_that_are_written_w_first_are_noted() -> None:
    yaws = np.linspace(-1.0, 1.0, 6)
    right = [(k, 0, 0, 0, 0, np.sin(yaw / 2), np.cos(yaw / 2)) for k, yaw in enumerate(yaws)]
    wrong = [(x, y, z, w, qx, qy, qz) for x, y, z, qx, qy, qz, w in right]
    joint = [(0, 0, 0, *turn) for _, _, _, *turn in wrong]
    straight = [(k, 0, 0, 1, 0, 0, 0) for k in range(6)]
    hanging = [(k, 0, 0, np.cos(yaw / 2), np.sin(yaw / 2), 0, 0) for k, yaw in enumerate(yaws / 100)]
    told = []
    for poses in (right, wrong, joint, straight, hanging):
        _, notes = posed([tf(START + k * SECOND, "map", "laser", pose) for k, pose in enumerate(poses)])
        told.append([note for note in notes if "w first" in note])
    note = (
        "quaternions of /tf roll or hang head down, and never turn: they are probably written w first, and x y z w is "
        "the order; the sensor seems to hang head down until that is mended"
    )
    assert told == [[], [note], [], [note], []]


def test_poses_that_jump_and_could_not_be_checked_do_not_fit_unless_they_are_named() -> None:
    messages = [tf(START + k * SECOND, "map", "laser", (k, 0, 0, 0, 0, 0, 1)) for k in range(6)]
    posing = posing_of(PosesLog(messages))
    checked = posing.paths.get(("/scan", "laser"), CheckedPath("told"))
    unknown, cases = np.nan, ((False, False, True), (True, False, False), (True, True, True))
    for drift, jumps, named, fits in (*((unknown, *case) for case in cases), (0.01, True, False, True)):
        chain = posing.found.sources.chain("laser") if posing.found is not None else None
        posing.paths = {("/scan", "laser"): replace(checked, drift=drift, jumps=jumps, chain=chain)}
        posing.named = named
        batch = posing.attach(batch_of())
        assert batch.fits is not None
        assert (batch.fits == fits).all()
        assert batch.rows(np.arange(2)).fits is not None


def test_bad_poses_are_noted_and_do_not_end_the_run() -> None:
    messages = [odometry(START + k * SECOND, "odom", "laser", (k, 0, 0)) for k in range(6)]
    messages.append(Message("/odom", ODOMETRY, "cdr", START, b"\0\1\0\0"))
    messages.append(pose_stamped(START, "map", (np.nan, 0, 0), "/pose"))
    _, notes = posed(messages)
    assert notes == [
        "poses from /odom (odom > laser)",
        "1 of /odom left out: shorter than its type",
        "1 of /pose left out: its pose is not finite",
    ]


def test_no_pass_without_poses_on_a_pipe_or_unasked() -> None:
    plain, pipe = PosesLog(), PosesLog([odometry(START, "odom", "laser", (0, 0, 0))], size=None)
    unasked = PosesLog([odometry(START, "odom", "laser", (0, 0, 0))])
    pipe.format = "mcap"
    assert posing_of(plain).notes() == []
    assert posing_of(plain).attach(batch_of()).poses is None
    assert posing_of(unasked, NO_POSES).notes() == []
    assert posing_of(pipe, NO_POSES).notes() == []
    assert posing_of(pipe).notes() == [
        "poses, if there are any, are not used: a pipe is read only once; give the file's name for them"
    ]
    pipe.format = "json lines"
    assert posing_of(pipe).notes() == []
    assert (plain.passes, pipe.passes, unasked.passes) == (0, 0, 0)


def test_a_mount_that_is_missing_is_named() -> None:
    """As in the second part of a recording, whose first one holds /tf_static."""
    messages = [tf(START + k * SECOND, "odom", "base_link", (0, 0, 0)) for k in range(4)]
    _, notes = posed(messages)
    assert notes == [
        "no pose for frame laser: nothing leads from it to a fixed frame: base_link > laser is missing; in the first part? "
        "--join reads it"
    ]
