"""Trajectories as TUM text: every way to write them that people have, and what is none in one line."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.errors import UnreadableError
from lidarcli.pose import tracks
from lidarcli.pose.tracks import PoseMotion, PoseTrack, read_trajectory, trajectory_lines

HERE = "0 0 0 0 0 0 1"
S = 1_000_000_000
MOST = tracks.MAX_NS


def read(folder: Path, text: str | bytes) -> PoseTrack:
    path = folder / "run.tum"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_trajectory(path)[0]


def stamps(track: PoseTrack) -> list[int]:
    return [int(stamp) for stamp in track.stamp_ns]


def places(track: PoseTrack) -> list[float]:
    return [float(x) for x in track.motion.position[:, 0]]


@pytest.mark.parametrize(
    "text",
    [
        "1 1 2 3 0 0 0 1\n2 4 5 6 0 0 1 0\n",
        "1 1 2 3 0 0 0 1\n2 4 5 6 0 0 1 0",
        "# timestamp x y z qx qy qz qw\n\n1 1 2 3 0 0 0 1\n  \t\n  # more\n2 4 5 6 0 0 1 0\n#",
        "1,1,2,3,0,0,0,1\n2, 4, 5, 6, 0, 0, 1, 0\n",
        "1\t1\t2\t3\t0\t0\t0\t1\n\t 2  4   5 6 0 0 1 0  \n",
        "1 1 2 3 0 0 0 1\r\n2 4 5 6 0 0 1 0\r\n",
        "1 1 2 3 0 0 0 1\r2 4 5 6 0 0 1 0\r",
        b"\xef\xbb\xbf1 1 2 3 0 0 0 1\n2 4 5 6 0 0 1 0\n",
        b"\xef\xbb\xbf# caf\xe9\r\n1 1 2 3 0 0 0 1\n2 4 5 6 0 0 1 0\n",
        "1.0e0 1e0 +2 3. 0 -0 0 1\n2.000000000 4 5 6 0 0 1 0\n",
        "1 1 2 3 0 0 0 7\n2 4 5 6 0 0 0.5 0\n",
    ],
)
def test_ways_to_write_two_poses(tmp_path: Path, text: str | bytes) -> None:
    track = read(tmp_path, text)
    assert stamps(track) == [1 * S, 2 * S]
    assert np.array_equal(track.motion.position, [[1, 2, 3], [4, 5, 6]])
    assert np.array_equal(track.motion.rotation, [[0, 0, 0, 1], [0, 0, 1, 0]])
    assert (track.topic, track.type, track.parent, track.child) == ("run.tum", "tum", "world", "")
    assert (track.static, track.messages, track.jumps_back) == (False, 2, 0)


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("1700000000.1234567894", 1_700_000_000_123_456_789),
        ("1700000000.1234567896", 1_700_000_000_123_456_790),
        ("1700000000", 1_700_000_000 * S),
        ("1.7e9", 1_700_000_000 * S),
        ("-12.000000001", -12_000_000_001),
        ("-0", 0),
        ("0.0000000001", 0),
        ("4611686018.427387904", MOST),
        ("-4611686018.427387904", -MOST),
        ("1e-400", 0),
    ],
)
def test_stamps_are_exact(tmp_path: Path, text: str, stamp: int) -> None:
    assert stamps(read(tmp_path, f"{text} {HERE}\n")) == [stamp]


def test_a_file_that_is_none(tmp_path: Path) -> None:
    for path, cause in ((tmp_path / "none.tum", "No such file or directory"), (tmp_path, "Is a directory")):
        with pytest.raises(UnreadableError) as caught:
            read_trajectory(path)
        assert str(caught.value) == f"{path}: {cause}"


numbers = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(st.integers(-(10**18), 10**18), numbers, numbers, st.floats(-4, 4)), min_size=1, max_size=9))
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, float, float, float]]
) -> None:
    rows = sorted({row[0]: row for row in rows}.values())
    stamp = np.array([row[0] for row in rows], np.int64)
    yaw = np.array([row[3] for row in rows])
    position = np.array([[x, y, 0.0] for _, x, y, _ in rows])
    rotation = np.column_stack([np.zeros(len(rows)), np.zeros(len(rows)), np.sin(yaw / 2), np.cos(yaw / 2)])
    text = trajectory_lines(stamp, PoseMotion(position, rotation))
    for line in text.splitlines():
        assert len(line.split(" ")) == 8
        assert Decimal(line.split(" ")[0]) * S in {Decimal(int(one)) for one in stamp}
    track = read(tmp_path_factory.mktemp("tum"), text)
    assert stamps(track)[0] == stamp[0]
    assert stamps(track)[-1] == stamp[-1]
    motion = track.at(stamp)
    assert np.abs(motion.position - position).max() < 1e-6
    same = np.abs(np.sum(motion.rotation * rotation, axis=1))
    assert same == pytest.approx(np.ones(len(rows)), abs=1e-8)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (f"1700000000000000000 {HERE}", "(nanoseconds, as in EuRoC files, whose qw comes first: write seconds)"),
        ("1700000000000000000,1,2,0,1,0,0,0", "(nanoseconds, as in EuRoC files, whose qw comes first: write seconds)"),
        ("1 0 0 1 0 1 0 2 0 0 1 0", "(KITTI files tell no times)"),
    ],
)
def test_other_forms_are_named(tmp_path: Path, line: str, why: str) -> None:
    with pytest.raises(UnreadableError) as caught:
        read(tmp_path, f"{line}\n")
    assert str(caught.value).endswith(f"is no pose {why}; lines are timestamp x y z qx qy qz qw")
