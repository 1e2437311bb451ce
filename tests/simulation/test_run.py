"""One call makes a log and its truth, whole or not at all."""

import pyarrow.parquet as pq
import pytest

from lidarcli.errors import OptionError, OutputError
from lidarcli.simulation import run, simulate
from lidarcli.simulation.run import truth_paths

TEXT = """
[scene]
name = "small"
sweeps = 7
[sensor]
beams = 45
fov = 360
rate = 20
noise = 0.01
[[box]]
x = 2
y = 0
length = 1
width = 1
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(TEXT)
    return path


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(("options", "sweeps"), [({}, 7), ({"sweeps": 3}, 3), ({"sweeps": 0}, 0), ({"duration": 0.5}, 10)])
def test_how_many_sweeps(scene, tmp_path, options, sweeps):
    result = simulate(scene, tmp_path / "log.mcap", **options)
    assert (result.scene, result.sweeps, result.log.name) == ("small", sweeps, "log.mcap")
    assert pq.read_table(result.truth_beams).num_rows == sweeps * 45
    assert pq.read_table(result.truth)["entity"].to_pylist() == [0] * sweeps
    assert names(tmp_path) == ["log.mcap", "log.truth-beams.parquet", "log.truth.parquet", "small.toml"]


def test_the_same_run_gives_the_same_bytes(scene, tmp_path):
    written = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        result = simulate(scene, tmp_path / folder / "log.bag", seed=5)
        written.append([path.read_bytes() for path in (result.log, result.truth, result.truth_beams)])
    assert written[0] == written[1]
    other = simulate(scene, tmp_path / "log.bag", seed=6)
    assert other.log.read_bytes() != written[0][0]


def test_existing_files_are_refused_and_replaced_on_demand(scene, tmp_path):
    log = tmp_path / "log.mcap"
    (tmp_path / "log.truth.parquet").write_text("mine")
    with pytest.raises(OutputError) as caught:
        simulate(scene, log)
    assert str(caught.value) == (
        f"{tmp_path}/log.truth.parquet exists; use --overwrite to replace it, or -o to write elsewhere"
    )
    assert names(tmp_path) == ["log.truth.parquet", "small.toml"]
    simulate(scene, log, overwrite=True)
    first = log.read_bytes()
    simulate(scene, log, overwrite=True, seed=1)
    assert log.read_bytes() != first
    assert len(names(tmp_path)) == 4


def test_a_bag_folder_is_replaced_and_any_other_folder_is_not(scene, tmp_path):
    bag = tmp_path / "bag"
    simulate(scene, bag)
    assert names(bag) == ["bag.db3", "metadata.yaml"]
    simulate(scene, bag, container="ros2-mcap", overwrite=True)
    assert names(bag) == ["bag.mcap", "metadata.yaml"]
    (bag / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError) as caught:
        simulate(scene, bag, overwrite=True)
    assert (
        str(caught.value) == f"{bag} is a folder that holds more than a ROS 2 bag and its metadata.yaml; it is not replaced"
    )
    assert (bag / "thesis.tex").read_text() == "mine"


def test_nothing_is_left_when_it_fails_half_way(scene, tmp_path, monkeypatch):
    def broken(*args, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("lidarcli.simulation.truth.TruthWriter.write", broken)
    with pytest.raises(OutputError) as caught:
        simulate(scene, tmp_path / "log.mcap")
    assert str(caught.value) == f"cannot write {tmp_path}/log.mcap: No space left on device"
    assert names(tmp_path) == ["small.toml"]


def test_a_log_is_not_simulated_into_a_store(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OptionError, match=r"^s3://bucket/log\.mcap: a simulated log is not written into a store"):
        simulate(scene, "s3://bucket/log.mcap")
    assert names(tmp_path) == ["small.toml"]


def test_the_truth_stands_under_the_stem_of_the_log(tmp_path):
    found = [truth_paths(tmp_path / name)[0].name for name in ("a.mcap", "a.csv.gz", "a.b.bag", "folder")]
    assert found == ["a.truth.parquet", "a.truth.parquet", "a.b.truth.parquet", "folder.truth.parquet"]
    assert run.simulate is simulate
