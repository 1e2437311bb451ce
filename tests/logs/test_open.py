"""Opening: the content decides which reader takes a log, and what is none is refused with one line."""

from __future__ import annotations

import gzip
import io
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import zstandard

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log, registry
from lidarcli.logs.base import ReadReport
from lidarcli.logs.registry import FORMATS
from lidarcli.sweeps.types import concatenate
from tests.logs import mcap_samples
from tests.places import ROOT, SAMPLES

KNOWN = ", ".join(known.name for known in FORMATS)
CSV = b"".join(f"{i}.0,{i}.5,{i}.6,{i}.7\n".encode() for i in range(1, 9))


def sweeps(source: Any) -> int:
    with open_log(source) as log:
        return sum(map(len, log.scans(None, ReadReport())))


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run.csv", "run"])
def test_content_decides_not_the_suffix(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(mcap_samples.sample(5))
    for source in (path, str(path)):
        with open_log(source) as log:
            assert (log.path, log.format) == (str(path), "mcap")
            assert sum(map(len, log.scans(None, ReadReport()))) == 5


@pytest.mark.parametrize("sample", ["room.mcap", "corridor.bag"])
def test_standard_input(sample: str, monkeypatch: pytest.MonkeyPatch) -> None:
    data = (SAMPLES / sample).read_bytes()
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))
    with open_log("-") as log:
        assert log.path == "-"
        assert sum(map(len, log.scans(None, ReadReport()))) == sweeps(SAMPLES / sample)


class Trickle(io.RawIOBase):
    """A pipe that gives a few bytes at a time."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        self._rest = io.BytesIO(data)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self._rest.read(min(len(buffer), 7))
        buffer[: len(data)] = data
        return len(data)


def test_a_pipe_that_trickles() -> None:
    assert sweeps(Trickle(mcap_samples.sample(20))) == 20


def test_compressed_parts_of_a_ros2_bag(tmp_path: Path) -> None:
    path = tmp_path / "drive.db3.zstd"
    path.write_bytes(zstandard.compress((SAMPLES / "drive.db3").read_bytes()))
    assert sweeps(path) == sweeps(SAMPLES / "drive.db3")


def refusal(source: Any) -> str:
    with pytest.raises(UnreadableError) as caught:
        open_log(source)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_what_is_not_there_or_empty(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    assert refusal(path) == f"{path}: cannot be opened: No such file or directory"
    path.write_bytes(b"")
    assert refusal(path) == f"{path}: is empty"
    assert refusal(io.BytesIO(b"")) == "-: is empty"
    link = tmp_path / "link"
    link.symlink_to("link")
    assert refusal(link).startswith(f"{link}: cannot be opened: ")
    assert refusal("a\0b") == "'a\\x00b': cannot be the name of a file"
    folder = tmp_path / "folder"
    folder.mkdir()
    assert refusal(folder) == f"{folder}: a folder without a log; lidarcli reads {KNOWN}"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_no_permission(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"x")
    path.chmod(0)
    assert refusal(path) == f"{path}: cannot be opened: Permission denied"


@pytest.mark.parametrize("data", [b"\x7fELF\x02\x01\x01" + bytes(99), b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", bytes(5000)])
def test_what_is_no_log(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    assert refusal(path) == f"{path}: not a log lidarcli knows; it reads {KNOWN}"
    assert refusal(io.BytesIO(data)) == f"-: not a log lidarcli knows; it reads {KNOWN}"


def test_a_packed_log_of_another_kind(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap.gz"
    path.write_bytes(gzip.compress(mcap_samples.sample(2), mtime=0))
    assert refusal(path) == f"{path}: a log packed with gzip; unpack it first (gunzip)"


def test_a_database_on_a_pipe(tmp_path: Path) -> None:
    data = (SAMPLES / "drive.db3").read_bytes()
    assert refusal(io.BytesIO(data)) == (
        "-: a ROS 2 bag (folder, .db3, compressed) cannot be read from a pipe; give the name of its file instead"
    )


def test_a_named_pipe_is_a_stream(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    writer = threading.Thread(target=lambda: path.write_bytes(mcap_samples.sample(7)))
    writer.start()
    with open_log(path) as log:
        assert (log.path, log.size) == (str(path), None)
        assert sum(map(len, log.scans(None, ReadReport()))) == 7
    writer.join()


def test_a_named_pipe_without_a_writer_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "PIPE_WAIT_S", 0.05)
    path = tmp_path / "pipe"
    os.mkfifo(path)
    assert refusal(path) == f"{path}: nobody has written to this pipe for 0.05 s"


def test_a_folder_of_one_mcap_without_metadata(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    shutil.copy(SAMPLES / "room.mcap", folder / "bag_0.mcap")
    assert sweeps(folder) == sweeps(SAMPLES / "room.mcap")


def test_a_log_costs_only_the_libraries_of_its_container(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(mcap_samples.sample(3))
    program = (
        "import sys; from lidarcli.logs import open_log\n"
        "from lidarcli.logs.base import ReadReport\n"
        "with open_log(sys.argv[1]) as log: print(sum(map(len, log.scans(None, ReadReport()))))\n"
        "print(sorted({'pandas', 'pyarrow', 'rosbags', 'sqlite3', 'click', 'rich'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.stdout == "3\n[]\n"


@pytest.mark.parametrize(
    ("head", "name"),
    [
        (b"\x89MCAP0\r\n", "MCAP"),
        (b"\x89MCAP0\n", "MCAP"),
        (b"#ROSBAG V2.0\n", "ROS 1 bag"),
        (b"#ROSRECORD V1.2\n", "ROS 1 bag"),
        (b"SQLite format 3\0", "ROS 2 bag (folder, .db3, compressed)"),
        (b"\x28\xb5\x2f\xfd", "ROS 2 bag (folder, .db3, compressed)"),
        (CSV, FORMATS[-1].name),
        (gzip.compress(CSV, mtime=0), FORMATS[-1].name),
        ("\ufeffé,1\n".encode("utf-16-le"), FORMATS[-1].name),
        ("FLASER 1 2.0 0 0 0 0 0 0 1 nohost 1\n".encode("utf-16"), "CARMEN log (also .gz)"),
        ("é".encode("latin-1") + b",1\n", FORMATS[-1].name),
    ],
)
def test_the_first_format_that_claims_a_beginning(head: bytes, name: str) -> None:
    known = next(known for known in FORMATS if known.sniff(head))
    assert known.name == name


def test_a_pattern_is_one_log(tmp_path: Path) -> None:
    for number in range(3):
        lines = (f"{-1 + beam / 10},{2 + number}.5" for beam in range(20))
        (tmp_path / f"sweep_{number}.csv").write_text("theta,r\n" + "\n".join(lines) + "\n")
    pattern = str(tmp_path / "sweep_*.csv")
    with open_log(pattern) as log:
        assert log.path == pattern
        raw = concatenate(list(log.scans(None, ReadReport())))
    assert raw.ranges[:, 0].tolist() == [2.5, 3.5, 4.5]
    assert refusal(str(tmp_path / "none_*.csv")) == f"{tmp_path}/none_*.csv: no file matches this pattern"


def test_a_pattern_of_other_logs(tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).write_bytes(mcap_samples.sample(2))
    pattern = str(tmp_path / "*.mcap")
    assert refusal(pattern) == (f"{pattern}: only files of one sweep each (CSV) make one log; name other logs one by one")
