"""Every container is read back, through the libraries others use, as the sweeps that went in."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lidarcli.errors import OptionError, OutputError
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.scene import Course, Odometry, Scene, SceneSensor
from lidarcli.simulation.writers import container_of, write_log
from lidarcli.sweeps.types import concatenate
from tests.text_logs.foxglove import write_foxglove

SWEEPS = 12
ROOM = make.wall([[-2, -3], [30, -3], [30, 3], [-2, 3], [-2, -3]])
COURSE = Course(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.8)
PLAIN = Scene("plain", SceneSensor(beams=37, angle_increment=np.radians(10), noise=0.01, lost=0.1), (ROOM,))
CHANGING = replace(PLAIN, sensor=replace(PLAIN.sensor, beams_jitter=3, topic="scan", frame_id="/laser_1"))
DRIVEN = replace(PLAIN, path=COURSE, odometry=Odometry(noise=0.1))

ROSBAGS = [
    ("log.mcap", {}),
    ("log.mcap", {"compression": "none"}),
    ("log.mcap", {"compression": "lz4", "chunk_size": 2000}),
    ("log.bag", {}),
    ("log.bag", {"compression": "bz2"}),
    ("log.bag", {"compression": "lz4"}),
    ("folder", {}),
    ("folder", {"compression": "zstd"}),
    ("folder", {"compression": "zstd-message"}),
    ("folder", {"container": "ros2-mcap"}),
    ("folder", {"container": "ros2-mcap", "compression": "zstd"}),
    ("log.db3", {}),
]
CSVS = [("log.csv", {}), ("log.csv.gz", {}), ("log.csv", {"layout": "wide"})]
MCAPS = [{"encoding": name} for name in ("ros1", "json", "protobuf")]


def blocks(scene):
    return [block.raw for block in simulate_blocks(scene, SWEEPS, size=5)]


def same(messages, scene):
    """Compare decoded LaserScan messages with the sweeps of the scene."""
    raw, _, _ = simulate_sweep_arrays(scene, SWEEPS)
    assert len(messages) == SWEEPS
    for row, message in enumerate(messages):
        beams = raw.beams[row]
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == raw.stamp_ns[row]
        assert message.header.frame_id == scene.sensor.frame_id
        assert np.array_equal(message.ranges, raw.ranges[row, :beams], equal_nan=True)
        assert message.ranges.dtype == np.float32
        assert message.angle_min == np.float32(raw.angle_min[row])
        assert message.angle_increment == np.float32(raw.angle_increment[row])
        assert message.angle_max == pytest.approx(raw.angle_min[row] + (beams - 1) * raw.angle_increment[row])
        assert (message.range_min, message.range_max) == (np.float32(0.1), np.float32(12))
        assert len(message.intensities) == 0


@pytest.mark.parametrize("scene", [PLAIN, CHANGING], ids=["plain", "changing"])
@pytest.mark.parametrize(("name", "options"), ROSBAGS)
def test_rosbags_reads_it(tmp_path, scene, name, options):
    write_log(tmp_path / name, blocks(scene), **options)
    with AnyReader([tmp_path / name], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        assert [(c.topic, c.msgtype) for c in reader.connections] == [(scene.sensor.topic, "sensor_msgs/msg/LaserScan")]
        messages = list(reader.messages())
        same([reader.deserialize(data, connection.msgtype) for connection, _, data in messages], scene)
    raw = concatenate(blocks(scene))
    assert [time for _, time, _ in messages] == raw.record_ns.tolist()


@pytest.mark.parametrize("options", MCAPS)
def test_mcap_in_every_encoding(tmp_path, options):
    path = tmp_path / "log.mcap"
    encoding = options["encoding"]
    write = write_log if encoding == "ros1" else write_foxglove
    write(path, blocks(CHANGING), **options)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        entries = list(reader.iter_messages())
    schema, channel, _ = entries[0]
    data = [message.data for _, _, message in entries]
    assert schema is not None
    raw = concatenate(blocks(CHANGING))
    assert [message.log_time for *_, message in entries] == raw.record_ns.tolist()
    assert [message.sequence for *_, message in entries] == list(range(SWEEPS))
    if encoding == "ros1":
        assert (schema.name, schema.encoding, channel.message_encoding) == ("sensor_msgs/LaserScan", "ros1msg", "ros1")
        store = get_typestore(Stores.ROS1_NOETIC)
        same([store.deserialize_ros1(item, "sensor_msgs/msg/LaserScan") for item in data], CHANGING)
    else:
        assert (schema.name, channel.message_encoding) == ("foxglove.LaserScan", encoding)
        same_foxglove(data, schema.data, encoding)


def same_foxglove(data, schema, encoding):
    raw, _, _ = simulate_sweep_arrays(CHANGING, SWEEPS)
    if encoding == "protobuf":
        pool = DescriptorPool()
        for file in FileDescriptorSet.FromString(schema).file:
            pool.Add(file)
        kind = GetMessageClass(pool.FindMessageTypeByName("foxglove.LaserScan"))
        messages = [kind.FromString(item) for item in data]
        stamps = [message.timestamp.ToNanoseconds() for message in messages]
        fields = [(m.frame_id, m.start_angle, m.end_angle, list(m.ranges)) for m in messages]
        assert [field.name for field in kind.DESCRIPTOR.fields] == [
            "timestamp",
            "frame_id",
            "pose",
            "start_angle",
            "end_angle",
            "ranges",
            "intensities",
        ]
    else:
        assert set(json.loads(schema)["properties"]) == set(json.loads(data[0]))
        messages = [json.loads(item, parse_constant=pytest.fail) for item in data]
        stamps = [m["timestamp"]["sec"] * 10**9 + m["timestamp"]["nsec"] for m in messages]
        fields = [(m["frame_id"], m["start_angle"], m["end_angle"], m["ranges"]) for m in messages]
    assert stamps == raw.stamp_ns.tolist()
    for row, (frame, start, end, ranges) in enumerate(fields):
        beams = raw.beams[row]
        assert frame == "/laser_1"
        assert start == raw.angle_min[row]
        assert (end - start) / (beams - 1) == pytest.approx(raw.angle_increment[row], rel=1e-12)
        assert np.array_equal(np.float32([float(value) for value in ranges]), raw.ranges[row, :beams], equal_nan=True)


@pytest.mark.parametrize(("name", "options"), [("a.mcap", {}), ("a.bag", {}), ("a", {}), ("a.mcap", {"encoding": "ros1"})])
def test_poses_travel_along(tmp_path, name, options):
    poses = simulate_odometry(DRIVEN, SWEEPS, 3)
    assert poses is not None
    write_log(tmp_path / name, blocks(DRIVEN), poses=poses, **options)
    if options:
        with (tmp_path / name).open("rb") as file:
            topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
        assert topics == ["/tf_static", *["/odom", "/tf", "/scan"] * SWEEPS]
        return
    with AnyReader([tmp_path / name]) as reader:
        messages = [(c.topic, reader.deserialize(data, c.msgtype)) for c, _, data in reader.messages()]
    static = next(message for topic, message in messages if topic == "/tf_static").transforms[0]
    assert (static.header.frame_id, static.child_frame_id, static.transform.rotation.w) == ("base_link", "laser", 1)
    odometry = [message for topic, message in messages if topic == "/odom"]
    transforms = [message.transforms[0] for topic, message in messages if topic == "/tf"]
    for row in range(SWEEPS):
        pose, transform = odometry[row].pose.pose, transforms[row].transform
        x, y, yaw = poses.poses[row]
        assert (pose.position.x, pose.position.y) == (x, y)
        assert 2 * np.arctan2(pose.orientation.z, pose.orientation.w) == pytest.approx(yaw)
        assert (transform.translation.x, transform.translation.y) == (x, y)
        assert transform.rotation == pose.orientation
        assert odometry[row].header.frame_id == transforms[row].header.frame_id == "odom"
        assert odometry[row].child_frame_id == transforms[row].child_frame_id == "base_link"
        assert odometry[row].twist.twist.linear.x == 0.8
        assert odometry[row].header.stamp.nanosec == transforms[row].header.stamp.nanosec


def test_a_csv_by_suffix_holds_the_geometry(tmp_path):
    """The default layout is the one that needs no options to be read; the layouts have tests of their own."""
    write_log(tmp_path / "a.csv.gz", blocks(PLAIN))
    table = pd.read_csv(tmp_path / "a.csv.gz")
    raw = concatenate(blocks(PLAIN))
    assert table["field.header.stamp"].tolist() == raw.stamp_ns.tolist()
    assert np.float32(table["field.angle_increment"]).tolist() == np.float32(raw.angle_increment).tolist()
    ranges = table[[f"field.ranges{n}" for n in range(37)]].to_numpy(np.float32)
    assert np.array_equal(ranges, raw.ranges, equal_nan=True)


def digest(path: Path) -> str:
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    return hashlib.sha256(b"".join(f.name.encode() + f.read_bytes() for f in files if f.is_file())).hexdigest()


@pytest.mark.parametrize(("name", "options"), [*ROSBAGS, *CSVS, ("log.mcap", {"encoding": "ros1"})])
def test_same_sweeps_same_bytes(tmp_path, name, options):
    poses = simulate_odometry(DRIVEN, SWEEPS)
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        write_log(tmp_path / folder / name, blocks(DRIVEN), poses=poses, **options)
    assert digest(tmp_path / "first" / name) == digest(tmp_path / "second" / name)


def test_the_suffix_says_the_container():
    names = ("a.mcap", "A.BAG", "a.db3", "a.csv", "a.csv.gz", "folder", "folder/")
    assert [container_of(Path(name)) for name in names] == ["mcap", "bag", "db3", "csv", "csv", "ros2", "ros2"]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.dat", {}, "a.dat: no log format has the suffix '.dat'; use .mcap, .bag, .db3, .csv "
                      "(.csv also with .gz), or no suffix for a ROS 2 bag folder"),
        ("a.mcap", {"compression": "bz2"}, "a.mcap: compression 'bz2' is not one of none, lz4, zstd (mcap)"),
        ("a.bag", {"compression": "zstd"}, "a.bag: compression 'zstd' is not one of none, bz2, lz4 (bag)"),
        ("a.mcap", {"encoding": "xml"}, "a.mcap: encoding 'xml' is not one of cdr, ros1 (mcap)"),
        ("a.bag", {"encoding": "json"}, "a.bag: encoding 'json' does not apply to the container 'bag'"),
        ("a.bag", {"layout": "wide"}, "a.bag: layout 'wide' does not apply to the container 'bag'"),
        ("a", {"container": "tar"}, "a: container 'tar' is not one of mcap, bag, ros2, ros2-mcap, db3, csv"),
        ("a.csv", {"layout": "long"}, "a.csv: layout 'long' is not one of rostopic, wide (csv)"),
    ],
)  # fmt: skip
def test_options_that_do_not_fit(tmp_path, monkeypatch, name, options, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OptionError) as caught:
        write_log(name, [], **options)
    assert str(caught.value) == message
    assert list(tmp_path.iterdir()) == []


def test_an_existing_path_is_refused(tmp_path):
    (tmp_path / "a.mcap").write_text("mine")
    with pytest.raises(OutputError, match=r"a\.mcap: exists already$"):
        write_log(tmp_path / "a.mcap", [])
    assert (tmp_path / "a.mcap").read_text() == "mine"
