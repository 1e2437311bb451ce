"""The sensors of a robot, written as one LaserScan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rosbags.convert.converter import convert
from rosbags.typesys import Stores, get_typestore

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Entity, Scene, super_ellipse
from lidarcli.sweeps.types import SweepBatch
from tests.copying.reading import messages
from tests.robots import CORNERS, SIDES, Carried, robot_log, robot_messages
from tests.zones.runs import PARKED, scene_of, walker, write_bag

HALL = make.wall([[-6.0, -5.0], [6.0, -5.0], [6.0, 3.0], [3.0, 3.0], [3.0, 5.0], [-6.0, 5.0], [-6.0, -5.0]])
THINGS = (make.box(-4.5, 3.5, 0.8, 0.5), make.box(5.0, 1.5, 0.5, 0.5))
ROUND = Course(super_ellipse(1.2, 0.9, 2.5), speed=0.5)
SWEEPS = 40


def drawn(path: Course = ROUND, *people: Entity) -> Scene:
    return scene_of(*THINGS, *people, room=(HALL,), sweeps=SWEEPS, path=path)


def sweeps_of(log: Path, topic: str) -> SweepBatch:
    (batch,) = lidarcli.read(log, topic=[topic])
    return batch


def in_container(bag: Path, storage: str) -> Path:
    """The same log in a folder of ROS 2."""
    folder = bag.with_suffix("")
    ros1, ros2 = (get_typestore(store) for store in (Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE))
    convert([bag], folder, storage, 8, None, "file", ros1, ros2, (), (), (), ())
    return folder


@pytest.mark.parametrize("carried", [CORNERS, SIDES], ids=["corners", "sides"])
@pytest.mark.parametrize("path", [PARKED, ROUND], ids=["stands", "drives"])
def test_one_sensor_in_the_middle_would_see_the_same(path: Course, carried: Sequence[Carried], tmp_path: Path) -> None:
    log = robot_log(tmp_path / "run.bag", drawn(path), carried)
    lidarcli.clean(log, tmp_path / "out.bag", remove="none", merge="/scan")
    alone = robot_log(tmp_path / "alone.bag", drawn(path), (Carried("middle", (0.0, 0.0, 0.0), CORNERS[0].sensor),))
    made, wanted = sweeps_of(tmp_path / "out.bag", "/scan"), sweeps_of(alone, "/middle")
    assert made.frame_ids == ("base_link",)
    assert made.beams.tolist() == [720] * SWEEPS
    np.testing.assert_array_equal(made.stamp_ns, wanted.stamp_ns)
    # The first sweeps may come before those of the others; 270 degrees of the turn are seen from the middle.
    seen, alike = made.ranges[1:, 90 : 90 + 541], wanted.ranges[1:]
    off = np.abs(seen - alike)
    assert np.isfinite(seen).mean() > 0.95
    assert np.nanmedian(off) < 0.02
    # Slanted walls between beams, and edges that are seen from elsewhere.
    assert np.nanquantile(off, 0.9) < 0.15


@pytest.mark.parametrize("storage", ["ros1", "mcap", "sqlite3"])
def test_all_other_messages_stay(storage: str, tmp_path: Path) -> None:
    log = robot_log(tmp_path / "run.bag", drawn())
    suffix = {"ros1": ".bag", "mcap": ".mcap", "sqlite3": ".db3"}[storage]
    if storage != "ros1":
        log = in_container(log, storage)
    out = tmp_path / f"out{suffix}"
    lidarcli.clean(log, out, remove="none", merge="/scan", merge_frame="front")
    whole = messages(next(log.glob(f"*{suffix}")) if log.is_dir() else log)
    found = [(each.topic, each.data) for each in messages(out)]
    assert [each for each in found if each[0] != "/scan"] == [(each.topic, each.data) for each in whole]
    # Each comes after the sweep whose stamp it has.
    topics = [topic for topic, _ in found]
    assert [topics[at - 1] for at, topic in enumerate(topics) if topic == "/scan"] == ["/front"] * SWEEPS
    made = sweeps_of(out, "/scan")
    assert made.frame_ids == ("front",)
    np.testing.assert_array_equal(made.stamp_ns, sweeps_of(log, "/front").stamp_ns)


def test_what_is_left_out_is_not_merged(tmp_path: Path) -> None:
    log = robot_log(tmp_path / "run.bag", drawn(ROUND, walker((-4.5, 2.4), (4.0, 2.6))))
    removed = lidarcli.clean(log, tmp_path / "calm.bag", remove="agents", merge="/scan")
    lidarcli.clean(log, tmp_path / "all.bag", merge="/scan")
    calm, every = (sweeps_of(tmp_path / f"{name}.bag", "/scan").ranges for name in ("calm", "all"))
    assert sum(removed["agents"].to_pylist()) > 500
    assert pq.read_table(tmp_path / "calm.cleaned.parquet").equals(removed)
    # Nothing, or what another sensor sees behind.
    assert np.count_nonzero(np.isfinite(every) & ~(calm < every + 0.3)) > 250
    same = np.isfinite(every) & np.isfinite(calm)
    assert (calm[same] >= every[same]).all()


def test_it_says_why_nothing_is_merged(tmp_path: Path) -> None:
    log = robot_log(tmp_path / "run.bag", drawn())
    with pytest.raises(OptionError, match="the log has a topic /front; give another name"):
        lidarcli.clean(log, tmp_path / "out.bag", merge="/front")
    with pytest.raises(OptionError, match="--merge-frame mast: nothing tells where front of /front is in it"):
        lidarcli.clean(log, tmp_path / "out.bag", merge="/scan", merge_frame="mast")
    bare = robot_log(tmp_path / "bare.bag", drawn(), told=False)
    with pytest.raises(OptionError, match="no sensors of one robot: followed apart: nothing tells where"):
        lidarcli.clean(bare, tmp_path / "out.bag", merge="/scan")
    assert not (tmp_path / "out.bag").exists()


def test_merged_sweeps_without_a_sensor_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = robot_messages(drawn(PARKED))
    late = max(one.record_ns for each in told for one in each) - 1_000_000_000
    log = write_bag(
        tmp_path / "run.bag", *([one for one in each if "rear" not in one.topic or one.record_ns < late] for each in told)
    )
    words = ["clean", str(log), "-o", str(tmp_path / "out.bag"), "--remove", "none", "--merge", "/scan"]
    assert run(words) == 0
    made = sweeps_of(tmp_path / "out.bag", "/scan").ranges
    halves = int((np.isnan(made).mean(axis=1) > 0.2).sum())
    assert halves > 5
    assert f"{halves} sweeps of /scan without /rear" in " ".join(capsys.readouterr().err.split())
    # Of a part only its own sweeps count.
    assert run([*words, "--overwrite", "--end", "2s"]) == 0
    assert "without /rear" not in " ".join(capsys.readouterr().err.split()).replace("1 sweep of /scan without", "")


def test_what_no_sensor_makes_is_not_merged(tmp_path: Path) -> None:
    fine = CORNERS[0]._replace(sensor=replace(CORNERS[0].sensor, angle_increment=3e-8))
    log = robot_log(tmp_path / "run.bag", drawn(PARKED), (fine, CORNERS[1]))
    with pytest.raises(OptionError, match="more than 100,000 of a turn"):
        lidarcli.clean(log, tmp_path / "out.bag", remove="none", merge="/scan")
    for name, words in (("", "an empty text names nothing"), ("/", "give the topic a name"), (" ", "")):
        with pytest.raises(OptionError, match=f"--merge: .*{words}"):
            lidarcli.clean(log, tmp_path / "out.bag", remove="none", merge=name)
