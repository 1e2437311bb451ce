"""Text that is no CSV is refused by its name, and CSV is never taken for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from lidarcli.cli import run
from lidarcli.logs.csv.table import other_format
from tests.logs.csv_sweeps import sweeps
from tests.text_logs import LAYOUTS, write_csv

BEAMS = "convert it to CSV with a column per beam (`time,r0,r1,...` in the first line)"
POSES = "it holds poses, no ranges"
RECORD = "record with `ros2 bag record` or `rosbag record`, or print with `ros2 topic echo --csv --full-length`"
TUM = "".join(f"{1000 + row}.5 {row} 0.5 0 0 0 0.6 0.8\n" for row in range(9))

TEXTS = {
    "# timestamp tx ty tz qx qy qz qw\n" + TUM: ("a trajectory (TUM)", POSES),
    TUM: ("a trajectory (TUM)", POSES),
    "version https://git-lfs.github.com/spec/v1\noid sha256:ab\nsize 3\n": (
        "a pointer of Git LFS, not the file itself",
        "fetch it with `git lfs pull`",
    ),
    '{"ranges": [1.0, 2.0]}\n': ("JSON", BEAMS),
    '[{"ranges": [1.0, 2.0]}]\n': ("JSON", BEAMS),
    "[[1.0, 2.0],\n [1.0, 2.0]]\n": ("JSON", BEAMS),
    "<?xml version='1.0'?>\n<scan/>\n": ("XML or HTML", "look whether a download has failed"),
    "<!DOCTYPE html>\n<html>Not found</html>\n": ("XML or HTML", "look whether a download has failed"),
    "header: \n  seq: 1\n  stamp: \n    secs: 5\nangle_min: -1.5\nranges: [1.0, 2.0]\n---\n": ("YAML", RECORD),
    "---\nheader:\n  stamp: 1\n": ("YAML", RECORD),
    "ranges: [1.0, 2.0]\n---\n": ("YAML", RECORD),
    "sensor_msgs.msg.LaserScan(header=std_msgs.msg.Header(), ranges=[1.0])\n": (
        "ROS messages as Python prints them",
        RECORD,
    ),
    "angle_min: -1.5\nangle_max: 1.5\nranges:\n- 1.0\n- 2.0\n": ("YAML", RECORD),
}


@pytest.mark.parametrize("text", TEXTS)
def test_it_is_named_with_the_way_out(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, way_out = TEXTS[text]
    path = tmp_path / "log.txt"
    path.write_bytes(text.encode())
    assert run(["info", str(path), "--fov", "180", "--degrees"]) == 3
    assert capsys.readouterr() == ("", f"lidarcli: {path}: {name}, which lidarcli does not read: {way_out}\n")


@pytest.mark.parametrize("layout", [name for name in LAYOUTS if name != "per-sweep"])
def test_no_layout_of_ours_is_one(layout: str, tmp_path: Path) -> None:
    write_csv(tmp_path / "run.csv", [sweeps(3, 9)], layout)
    text = (tmp_path / "run.csv").read_bytes()
    for start in (b"", b"# recorded by hand\n\n", b"\n"):
        assert other_format(start + text) is None


@pytest.mark.parametrize(
    "text",
    [
        b"sync,t,r0\n1,2,3\n",
        b"PARAM\n1,2\n",
        b"time: s,r0,r1\n1,2,3\n",
        b"note: by hand\ntime,r0,r1,r2\n1,2,3,4\n",
        b"12:30:01 1 2 3\n12:30:02 1 2 3\n",
        b"[1.0, 2.0, 3.0]\n[1.0, 2.0, 3.0]\n",
        b"ply,x\n1,2\n",
        b"-1,2\n-1,3\n",
        b"hello\n",
    ],
)
def test_what_is_not_plain_is_left_to_the_readers_of_csv(text: bytes) -> None:
    assert other_format(text) is None


def test_messages_that_a_node_has_logged() -> None:
    yaml = "[INFO] [1621498.12]: header: \n  seq: 12\n  stamp: \n    secs: 5\nranges: [1.0, 2.0, inf]\n"
    python = "[INFO] [16.1] [node]: sensor_msgs.msg.LaserScan(header=std_msgs.msg.Header(), ranges=[1.0, 2.0])\n"
    for text, name in ((yaml, "YAML"), (python, "ROS messages as Python prints them")):
        found = other_format(text.encode())
        assert found is not None
        assert found.name == name
    assert other_format(b"time,header,ranges\n1,a,2\n") is None
