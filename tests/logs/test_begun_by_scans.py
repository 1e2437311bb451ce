"""Messages of other types that begin with a LaserScan, such as those of safety scanners."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as BagWriter

from lidarcli.cli import run
from lidarcli.errors import NoScanError
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.laserscan import scan_type
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.sweeps.types import concatenate
from tests.logs.mcap_samples import LASERSCAN_IDL, LASERSCAN_MSG, sample
from tests.logs.scan_messages import scan
from tests.logs.test_odd_logs import write_db3

EXTENDED = "sick_safetyscanners2_interfaces/msg/ExtendedLaserScan"
OTHER = "my_msgs/msg/Guarded"
STATUS = b"\x02\0\0\0\1\0"
"""Two truth values behind the scan."""
DEFINITION = (
    "# a scan, and more\nuint8 MOST=3\n\nsensor_msgs/LaserScan laser_scan # inside\nbool[] intrusion\n"
    + "=" * 80
    + "\nMSG: sensor_msgs/LaserScan\n"
    + LASERSCAN_MSG.decode()
)


def written(path: Path, kind: str, definition: str) -> Path:
    """A log of three messages; without a definition where the container allows that."""
    messages = [
        scan([1.0 + number, 2.0, 3.0], encoding="ros1" if path.suffix == ".bag" else "cdr", sec=number + 1) + STATUS
        for number in range(3)
    ]
    if path.suffix == ".mcap":
        data = sample(3, schema=(kind, "ros2msg", definition.encode()), payload=messages.__getitem__)
        path.write_bytes(data)
    elif path.suffix == ".bag":
        with BagWriter(path) as writer:
            connection = writer.add_connection("/scan", kind, msgdef=definition, md5sum="0" * 32)
            for number, message in enumerate(messages):
                writer.write(connection, number, message)
    else:
        write_db3(path, {"/scan": (kind, messages)})
        if definition:
            database = sqlite3.connect(path)
            database.execute(
                "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type, encoding, "
                "encoded_message_definition, type_description_hash)"
            )
            rows = [(None, "x", None), (kind, "ros2msg", definition)]
            database.executemany(
                "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition) VALUES (?, ?, ?)", rows
            )
            database.commit()
            database.close()
    return path


@pytest.mark.parametrize("kind", [EXTENDED, OTHER])
@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run.db3"])
def test_the_scan_inside_is_read(name: str, kind: str, tmp_path: Path) -> None:
    path = written(tmp_path / name, kind, DEFINITION)
    report = ReadReport()
    with open_log(path) as log:
        found = concatenate([*log.scans(None, report)])
    assert found.ranges.tolist() == [[1.0 + number, 2.0, 3.0] for number in range(3)]
    assert found.stamp_ns.tolist() == [number * 10**9 + 8 for number in (1, 2, 3)]
    assert (report.refused, report.damage) == ({}, [])
    info = inspect_log(Source(str(path), "run"))
    assert [(topic.name, topic.type, topic.is_scan) for topic in info.topics if topic.name == "/scan"] == [
        ("/scan", kind, True)
    ]


def test_a_database_without_definitions_has_the_type_of_the_drivers(tmp_path: Path) -> None:
    report = ReadReport()
    with open_log(written(tmp_path / "run.db3", EXTENDED, "")) as log:
        assert sum(map(len, log.scans(None, report))) == 3
    with pytest.raises(NoScanError, match="no LaserScan topic in this log"):
        inspect_log_of(written(tmp_path / "other.db3", OTHER, ""))


def inspect_log_of(path: Path) -> None:
    from lidarcli import detect

    detect(path)


def test_another_scan_inside_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = DEFINITION.replace("float32 angle_min", "float64 angle_min")
    path = written(tmp_path / "run.mcap", OTHER, other)
    assert run(["detect", str(path), "-o", str(tmp_path)]) == 3
    assert (
        "topic /scan: 3 messages left out: its definition is not the standard one: field 2 is 'float64 angle_min', "
        "not 'float32 angle_min'"
    ) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("encoding", "definition", "is_scan"),
    [
        ("ros2msg", "sensor_msgs/msg/LaserScan scan\n", True),
        ("ros2msg", "std_msgs/Header header\nsensor_msgs/LaserScan scan\n", False),
        ("ros2msg", "foxglove_msgs/LaserScan scan\n", False),
        ("ros2msg", "sensor_msgs/LaserScan[] scans\n", False),
        ("ros2idl", f"{LASERSCAN_IDL.decode()} struct Guarded {{ sensor_msgs::msg::LaserScan scan; }};", True),
        ("ros2idl", f"{LASERSCAN_IDL.decode()} struct Guarded {{ long x; sensor_msgs::msg::LaserScan scan; }};", False),
        ("ros2msg", "", False),
    ],
)
def test_the_first_field_tells(encoding: str, definition: str, is_scan: bool) -> None:
    assert bool(scan_type(OTHER, encoding, definition)) is is_scan


def test_clean_copies_what_stands_beside_the_scan(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    bearings = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    scene = [
        scan((4 + 0.3 * np.cos(3 * bearings)).astype(np.float32), sec=number, geometry=(0, 6.26, np.pi / 180, 0, 0, 0.1, 9))
        for number in range(12)
    ]
    messages = [message + STATUS for message in scene]
    path.write_bytes(sample(12, schema=(EXTENDED, "ros2msg", DEFINITION.encode()), payload=messages.__getitem__))
    assert run(["clean", str(path), "-o", str(tmp_path / "clean.mcap")]) == 0
    with open_log(tmp_path / "clean.mcap") as log:
        copied = [message.data for message in log.messages([EXTENDED], ReadReport())]
    assert copied == messages
