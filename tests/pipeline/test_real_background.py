"""A background learned from a public recording of people itself; `LIDARCLI_REAL_LOGS` names the folder of the logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import lidarcli
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.objects.subtracting import BackgroundOptions
from lidarcli.pipeline.reading.needs import NO_POSES
from lidarcli.sweeps.types import Float64
from tests.places import REAL_LOGS, needs_real_logs
from tests.pose.pose_messages import ROS1

FOLDER = REAL_LOGS / "leg_tracker"
LOG = FOLDER / "demo_stationary_simple_environment.bag"

pytestmark = [needs_real_logs, pytest.mark.slow]


def test_the_walls_vanish_and_the_people_remain() -> None:
    """The figures and the picture of docs/background.md."""
    (sensor,) = lidarcli.background(LOG)
    assert (len(sensor), sensor.grid.beams, int(sensor.sweeps[0])) == (1, 512, 1265)
    assert np.isinf(sensor.r_e).mean() == pytest.approx(0.69, abs=0.01)
    assert np.nanmedian(sensor.spread) < 0.01
    alone, against = lidarcli.detect(LOG), lidarcli.detect(LOG, background=[sensor])
    assert (against.num_rows, alone.num_rows) == (5932, 12525)
    assert against.num_rows / 1265 > 4.0
    for table, most, least in ((alone, 1.0, 0.4), (against, 0.03, 0.0)):
        # Objects within 15 cm of the surfaces of the background.
        x, y = table["x"].to_numpy(), table["y"].to_numpy()
        theta, r_e = sensor.grid.bearings, sensor.r_e[0]
        wall = np.column_stack([r_e * np.cos(theta), r_e * np.sin(theta)])[np.isfinite(r_e)]
        near = np.array([np.hypot(*(wall - point).T).min() < 0.15 for point in np.column_stack([x, y])])
        assert least <= near.mean() <= most


def labelled_legs(path: Path) -> list[Float64]:
    """(K, 2) positions of the legs in each sweep of a labelled log."""
    with AnyReader([path], default_typestore=ROS1) as reader:
        mine = [one for one in reader.connections if one.topic == "/leg_cluster_positions"]
        arrays = [reader.deserialize(data, one.msgtype).poses for one, _, data in reader.messages(mine)]
    return [np.array([(pose.position.x, pose.position.y) for pose in poses]).reshape(-1, 2) for poses in arrays]


def sweep_of(path: Path) -> dict[bytes, int]:
    """Ranges of a sweep -> its number."""
    batches = list(lidarcli.read(path))
    rows = zip(np.concatenate([batch.ranges for batch in batches]), np.concatenate([b.sweep for b in batches]), strict=True)
    return {ranges.tobytes(): int(sweep) for ranges, sweep in rows}


@pytest.mark.parametrize(("number", "legs", "found"), [(1, 324, 316), (3, 309, 304)])
def test_people_who_stand_in_most_sweeps_do_not_become_the_background(number: int, legs: int, found: int) -> None:
    """A parked sensor among people. Of the misses all but three are labels on a part of the robot 1.06 m away."""
    raw, labelled = FOLDER / f"positive_{number}_raw.bag", FOLDER / f"positive_{number}_extracted.bag"
    (sensor,) = lidarcli.background(raw)
    table = lidarcli.detect(raw, background=[sensor])
    sweeps, places = table["sweep"].to_numpy(), np.column_stack([table["x"], table["y"]])
    numbers = sweep_of(raw)
    total = near = on_robot = 0
    for ranges, positions in zip(sweep_of(labelled), labelled_legs(labelled), strict=True):
        objects = places[sweeps == numbers[ranges]]
        for leg in positions:
            total += 1
            near += bool((np.hypot(*(objects - leg).T) < 0.25).any())
            beam = np.abs(sensor.grid.bearings - np.arctan2(leg[1], leg[0])).argmin()
            on_robot += bool(abs(sensor.r_e[0, beam] - np.hypot(*leg)) < 0.05 and sensor.support[0, beam] > 0.9)
    assert (total, near) == (legs, found)
    assert near / (total - on_robot) > 0.99


def notes_against(background: str, log: str, folder: Path) -> list[str]:
    """What is told of a log that is compared with the background of another."""
    file = folder / "b.parquet"
    lidarcli.background(REAL_LOGS / background, file, pose="none")
    options = DetectOptions(background=BackgroundOptions.of(file, any_frame=True), poses=NO_POSES)
    return detect_to_files(Source(str(REAL_LOGS / log), "log"), folder, options).notes


PARKED = ("leg_tracker/positive_1_raw.bag", "leg_tracker/demo_stationary_simple_environment.bag")
MOVED = ("leg_tracker/negative_2.bag", "comprobo24/drive_square", "scan_tools/laser_scan_matcher_demo.bag")


@pytest.mark.parametrize("log", [*PARKED, *MOVED])
def test_a_sensor_that_moved_is_told_from_one_among_people(log: str) -> None:
    """Beams that find no range again: 7 % at most with the one, all with the other."""
    sensors = lidarcli.background(REAL_LOGS / log, pose="none")
    assert {sensor.seems_moved for sensor in sensors} == {log in MOVED}


@pytest.mark.parametrize(
    ("background", "log", "share"),
    [
        (PARKED[0], PARKED[0], None),
        (PARKED[0], "leg_tracker/positive_3_raw.bag", None),
        (PARKED[1], PARKED[1], None),
        (PARKED[0], PARKED[1], "99%"),
        (PARKED[1], PARKED[0], "100%"),
    ],
)
def test_a_background_of_another_place_is_told(background: str, log: str, share: str | None, tmp_path: Path) -> None:
    told = [note for note in notes_against(background, log, tmp_path) if "differ from" in note]
    assert [note.split()[0] for note in told] == ([] if share is None else [share])
