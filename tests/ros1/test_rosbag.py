"""ROS 1's own rosbag checks, reads and plays every kind of bag that is written."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.cli import run
from lidarcli.logs.rosbag1_records import CODECS, MAGIC, Op, parse
from lidarcli.ros import messages
from lidarcli.ros.messages import ROS1
from lidarcli.simulation.writers import write_log
from tests.overlays.reading import read_back
from tests.places import SAMPLES
from tests.ros1.tools import HERE, PYTHON, needs_rosbag
from tests.sweeping import room_sweeps

DRIVE = SAMPLES / "drive.db3"
ROSLZ4 = 0x64
"""The only flags of a frame that roslz4 takes: version 1, independent blocks, a checksum of the content at its end."""
WRITTEN: dict[str, tuple[object, ...]] = {
    "plain": ("simulate", SAMPLES / "drive.toml", "--sweeps", 12),
    "bz2": ("simulate", SAMPLES / "drive.toml", "--sweeps", 12, "--compression", "bz2"),
    "lz4": ("simulate", SAMPLES / "drive.toml", "--sweeps", 12, "--compression", "lz4"),
    "clouds": ("simulate", SAMPLES / "drive.toml", "--sweeps", 3, "--clouds", "--compression", "lz4"),
    "overlay": ("overlay", DRIVE),
    "with-log": ("overlay", DRIVE, "--with-log"),
    "with-map": ("overlay", DRIVE, "--with-log", "--map", "room.yaml"),
    "clean": ("clean", SAMPLES / "corridor.bag"),
    "mended": ("clean", SAMPLES / "corridor.bag", "--remove", "none", "--mend", "order,frames,no-return"),
    "cut": ("clean", SAMPLES / "corridor.bag", "--remove", "none", "--start", "1", "--end", "3"),
    "of-csv": ("overlay", SAMPLES / "people.csv.gz", "--with-log"),
}
"""Name of a bag → the command that writes it."""
KINDS = [*WRITTEN, "sample"]


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A bag of every kind, by its name."""
    folder = tmp_path_factory.mktemp("bags")
    assert run(["-q", "map", str(DRIVE), "-o", str(folder / "room.yaml")]) == 0
    found = {"sample": SAMPLES / "corridor.bag"}
    for name, command in WRITTEN.items():
        found[name] = folder / f"{name}.bag"
        words = [str(folder / word) if word == "room.yaml" else str(word) for word in command]
        assert run(["-q", *words, "-o", str(found[name])]) == 0
    return found


def chunks(bag: Path) -> Iterator[tuple[str, bytes]]:
    """How each chunk of a bag is packed, and its bytes."""
    data = bag.read_bytes()
    at = len(MAGIC)
    while at < len(data):
        record = parse(data, at)
        assert record is not None
        if record.op == Op.CHUNK:
            yield record.value(b"compression").decode(), data[record.data_start : record.end]
        at = record.end


def assert_rosbag_unpacks(bag: Path, packed: str) -> None:
    """Assert that every chunk is packed like this, in a way that ROS 1 unpacks."""
    found = list(chunks(bag))
    assert {codec for codec, _ in found} == {packed}
    for _, data in found:
        if packed != "none":
            assert data.startswith(CODECS[packed])
        if packed == "lz4":
            assert data[len(CODECS["lz4"])] == ROSLZ4


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_chunk_is_packed_as_rosbag_unpacks_it(bags: dict[str, Path], kind: str) -> None:
    assert_rosbag_unpacks(bags[kind], {"plain": "none", "bz2": "bz2"}.get(kind, "lz4"))


@pytest.mark.parametrize("packed", messages.BAG_COMPRESSIONS)
def test_sweeps_are_packed_as_rosbag_unpacks_them(tmp_path: Path, packed: str) -> None:
    write_log(tmp_path / "run.bag", [room_sweeps()], compression=packed)
    assert_rosbag_unpacks(tmp_path / "run.bag", packed)


def values(field: Any) -> list[Any]:
    """The values of a field that rosbags has read, one after the other, as tests/ros1/values.py has them."""
    if is_dataclass(field):
        # Its other attributes are the constants of the type.
        _, named = ROS1.fielddefs[field.__msgtype__]  # type: ignore[attr-defined]
        return [value for name, _ in named for value in values(getattr(field, name))]
    if isinstance(field, np.ndarray):
        return list(field.tolist())
    if isinstance(field, list):
        return [value for each in field for value in values(each)]
    return [field]


def alike(ours: list[Any], theirs: list[Any]) -> bool:
    """Whether values are the same, NaN too."""
    return len(ours) == len(theirs) and all(
        a == b or (isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b))
        for a, b in zip(ours, theirs, strict=True)
    )


@needs_rosbag
@pytest.mark.whole
@pytest.mark.parametrize("kind", KINDS)
def test_rosbag_finds_nothing_wrong(bags: dict[str, Path], kind: str) -> None:
    done = subprocess.run(["rosbag", "check", str(bags[kind])], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@needs_rosbag
@pytest.mark.whole
@pytest.mark.parametrize("kind", KINDS)
def test_rosbag_reads_the_same_values(bags: dict[str, Path], kind: str) -> None:
    command = [PYTHON, str(HERE / "values.py"), str(bags[kind])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    theirs = [json.loads(line) for line in done.stdout.splitlines()]
    ours = read_back(bags[kind])
    assert len(ours) == len(theirs) > 0
    for mine, (topic, kind_, record_ns, data, told) in zip(ours, theirs, strict=True):
        assert (mine.topic, mine.type.replace("/msg/", "/"), mine.record_ns) == (topic, kind_, record_ns)
        assert mine.data.hex() == data
        assert alike(values(mine.message), told)
