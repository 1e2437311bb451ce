"""The logs in samples/ are what the scenes beside them make today."""

import tomllib
from zipfile import ZipFile

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lidarcli.simulation import simulate
from tests.places import SAMPLES
from tools import two_lasers

LOGS = [
    ("room", "room.mcap", {}),
    ("room_empty", "room_empty.mcap", {"seed": 1}),
    ("corridor", "corridor.bag", {"compression": "lz4"}),
    ("hall", "hall", {}),
    ("drive", "drive.db3", {}),
    ("people", "people.csv.gz", {}),
    ("reflectors", "reflectors.mcap", {}),
]


def scans(path):
    """Topics and times of all messages, and the ranges of the sweeps."""
    if path.suffix == ".gz":
        table = pd.read_csv(path)
        ranges = table[[name for name in table.columns if name.startswith("field.ranges")]].to_numpy()
        return [table["%time"].tolist(), table["field.header.frame_id"].tolist()], ranges
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        found = [(c, time, data) for c, time, data in reader.messages()]
        ranges = [reader.deserialize(d, c.msgtype).ranges for c, _, d in found if c.topic == "/scan"]
    return [(c.topic, time, len(data)) for c, time, data in found], np.stack(ranges)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "log", "options"), LOGS, ids=[log for _, log, _ in LOGS])
def test_a_sample_is_up_to_date(tmp_path, scene, log, options):
    """Up to the last bit, which another processor may round the other way."""
    made = simulate(SAMPLES / f"{scene}.toml", tmp_path / log, **options)
    headers, ranges = scans(made.log)
    kept_headers, kept_ranges = scans(SAMPLES / log)
    assert headers == kept_headers
    np.testing.assert_allclose(ranges, kept_ranges, rtol=1e-6)
    for path in (made.truth, made.truth_beams):
        table, kept = pq.read_table(path), pq.read_table(SAMPLES / path.name)
        assert table.schema.equals(kept.schema)
        for name in table.column_names:
            kind = table.schema.field(name).type
            if pa.types.is_floating(kind):
                columns = [np.array(t[name].to_pylist(), float) for t in (table, kept)]
                np.testing.assert_allclose(*columns, atol=1e-9 if pa.types.is_float64(kind) else 1e-6)
            else:
                assert table[name].equals(kept[name])


def test_samples_are_small_and_documented():
    readme = (SAMPLES / "README.md").read_text(encoding="utf-8")
    script = (SAMPLES / "make.sh").read_text(encoding="utf-8")
    for path in SAMPLES.rglob("*"):
        assert path.stat().st_size < 1_000_000, path.name
    without_log = {SAMPLES / f"{name}.toml" for name in ("box", "office", "crooked", "monday", "tuesday")}
    scenes = set(SAMPLES.glob("*.toml")) - set(SAMPLES.glob("*.*.toml")) - without_log
    assert all(f"lidarcli simulate samples/{scene.name}" in readme for scene in without_log)
    for scene in sorted(scenes):
        command = next(line for line in readme.splitlines() if line.startswith(f"lidarcli simulate samples/{scene.name}"))
        # The script works inside samples/, and takes the number of sweeps from the scene.
        inside = command.removeprefix("lidarcli ").replace("samples/", "").replace(" --sweeps 100", "")
        assert inside in script.splitlines()


def test_the_crooked_office_is_the_office_with_two_faults():
    office, crooked = (tomllib.loads((SAMPLES / f"{name}.toml").read_text("utf-8")) for name in ("office", "crooked"))
    assert crooked["robot"].pop("mount") == {"x": 0.18, "yaw": 3.0, "told": False}
    assert crooked["robot"]["odometry"].pop("delay") == 0.2
    assert crooked["scene"].pop("name") == "crooked"
    del office["scene"]["name"]
    assert crooked == office


def test_the_log_of_two_lasers_is_the_one_that_its_tool_draws():
    with ZipFile(SAMPLES / "two_lasers.zip") as packed:
        assert packed.read("two_lasers.bag") == two_lasers.draw()


def test_the_room_shows_its_five_objects_in_every_sweep():
    table = pq.read_table(SAMPLES / "room.truth.parquet")
    visible = np.array(table["wall"]) == np.False_
    counts = np.bincount(np.array(table["sweep"])[visible])
    assert counts.tolist() == [5] * 100
    kinds = np.array(table["kind"].to_pylist())[visible][:5].tolist()
    assert kinds == ["box", "box", "box", "ladder", "plant"]
