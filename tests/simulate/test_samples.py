"""The logs in samples/ are what the scenes beside them make today."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lidarcli.simulate import simulate

SAMPLES = Path(__file__).parents[2] / "samples"
LOGS = [
    ("room", "room.mcap", {}),
    ("room_empty", "room_empty.mcap", {"seed": 1}),
    ("corridor", "corridor.bag", {"compression": "lz4"}),
    ("hall", "hall", {}),
    ("drive", "drive.db3", {}),
]


def messages(path):
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        return [(connection.topic, time, bytes(data)) for connection, time, data in reader.messages()]


@pytest.mark.parametrize(("scene", "log", "options"), LOGS, ids=[log for _, log, _ in LOGS])
def test_a_sample_is_up_to_date(tmp_path, scene, log, options):
    made = simulate(SAMPLES / f"{scene}.toml", tmp_path / log, **options)
    assert messages(made.log) == messages(SAMPLES / log)
    for table in (made.truth, made.truth_beams):
        assert pq.read_table(table).equals(pq.read_table(SAMPLES / table.name), check_metadata=False)


def test_samples_are_small_and_documented():
    readme = (SAMPLES / "README.md").read_text(encoding="utf-8")
    script = (SAMPLES / "make.sh").read_text(encoding="utf-8")
    for path in SAMPLES.rglob("*"):
        assert path.stat().st_size < 1_000_000, path.name
    for scene in sorted(SAMPLES.glob("*.toml")):
        command = next(
            line for line in readme.splitlines() if line.startswith(f"lidarcli simulate samples/{scene.name}")
        )
        # The script works inside samples/, and takes the number of sweeps from the scene.
        inside = command.removeprefix("lidarcli ").replace("samples/", "").replace(" --sweeps 100", "")
        assert inside in script.splitlines()


def test_the_room_shows_its_five_objects_in_every_sweep():
    table = pq.read_table(SAMPLES / "room.truth.parquet")
    visible = np.array(table["wall"]) == np.False_
    counts = np.bincount(np.array(table["sweep"])[visible])
    assert counts.tolist() == [5] * 100
    kinds = np.array(table["kind"].to_pylist())[visible][:5].tolist()
    assert kinds == ["box", "box", "box", "ladder", "plant"]
