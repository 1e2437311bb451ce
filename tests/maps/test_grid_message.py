"""The map as a message: rosbags reads it as what it is, its topic is latched."""

from __future__ import annotations

import io

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_typestore

from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.maps.grids import MAP_TYPE, occupancy_cdr, write_occupancy_mcap
from lidarcli.ros.messages import ros2_definition

STORE = get_typestore(Stores.ROS2_HUMBLE)
STAMP_NS = 1_700_000_000_123_456_789


def some_grid(frame_id: str = "map", height: int = 5, width: int = 7) -> Occupancy:
    cells = np.random.default_rng(2).choice(np.array([-1, 0, 100], np.int8), (height, width))
    return Occupancy(0.05, -12.35, 8.5, cells, frame_id)


def written(grid: Occupancy, stamp_ns: int = STAMP_NS, topic: str = "/map") -> bytes:
    file = io.BytesIO()
    write_occupancy_mcap(file, grid, stamp_ns, topic)
    return file.getvalue()


# The name of the frame moves what follows, which has to be aligned all the same.
@pytest.mark.parametrize("frame_id", ["", "m", "ma", "map", "odom", "world", "straße/map"])
@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (64, 3)])
def test_rosbags_reads_the_message(frame_id: str, shape: tuple[int, int]) -> None:
    grid = some_grid(frame_id, *shape)
    data = occupancy_cdr(grid, STAMP_NS)
    message: object = STORE.deserialize_cdr(data, MAP_TYPE)
    assert bytes(STORE.serialize_cdr(message, MAP_TYPE)) == data
    assert message.header.frame_id == frame_id
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert message.info.map_load_time == message.header.stamp
    assert message.info.resolution == pytest.approx(0.05, rel=1e-7)
    assert (message.info.height, message.info.width) == shape
    position, turn = message.info.origin.position, message.info.origin.orientation
    assert (position.x, position.y, position.z) == (-12.35, 8.5, 0)
    assert (turn.x, turn.y, turn.z, turn.w) == (0, 0, 0, 1)
    assert message.data.tolist() == grid.cells.ravel().tolist()


def test_the_file() -> None:
    reader = make_reader(io.BytesIO(written(some_grid(), topic="/site/map")), validate_crcs=True)
    assert (reader.get_header().profile, reader.get_header().library) == ("ros2", "lidarcli")
    ((schema, channel, message),) = reader.iter_messages()
    assert (schema.name, schema.encoding, schema.data.decode()) == (MAP_TYPE, "ros2msg", ros2_definition(MAP_TYPE))
    assert (channel.topic, channel.message_encoding) == ("/site/map", "cdr")
    assert (message.log_time, message.publish_time) == (STAMP_NS, STAMP_NS)
    assert message.data == occupancy_cdr(some_grid(), STAMP_NS)
    (chunk,) = reader.get_summary().chunk_indexes
    assert chunk.compression == "zstd"


def test_the_topic_is_latched() -> None:
    reader = make_reader(io.BytesIO(written(some_grid())))
    ((_, channel, _),) = reader.iter_messages()
    (qos,) = parse_qos(channel.metadata["offered_qos_profiles"])
    assert qos.durability is QosDurability.TRANSIENT_LOCAL
    assert qos.reliability is QosReliability.RELIABLE
    assert qos.depth == 1
    assert qos.deadline == (9_223_372_036, 854_775_807)
    # Tells rosbag2 that policies are numbers.
    (metadata,) = reader.iter_metadata()
    assert (metadata.name, metadata.metadata) == ("rosbag2", {"ROS_DISTRO": "", "serialized_metadata": ""})


@pytest.mark.parametrize(
    ("stamp_ns", "sec", "nanosec"),
    [(-1, 0, 0), (0, 0, 0), (1 << 62, 2_147_483_647, 999_999_999), (1_999_999_999, 1, 999_999_999)],
)
def test_stamps_that_ros_cannot_hold_are_the_nearest(stamp_ns: int, sec: int, nanosec: int) -> None:
    ((_, _, record),) = make_reader(io.BytesIO(written(some_grid(), stamp_ns))).iter_messages()
    message = STORE.deserialize_cdr(record.data, MAP_TYPE)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (sec, nanosec)
    assert record.log_time == sec * 1_000_000_000 + nanosec
