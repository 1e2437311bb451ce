"""The published foxglove schemas that logs are read and written by, as protobuf and as JSON schemas."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

SCAN = "foxglove.LaserScan"
CLOUD = "foxglove.PointCloud"
POSE = "foxglove.PoseInFrame"
TRANSFORM = "foxglove.FrameTransform"

NUMBER_KINDS = ("", "u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
"""Types of the numbers of a point by their number, as numpy spells them."""

STAMP = "google.protobuf.Timestamp"
NUMBER = "foxglove.PackedElementField.NumericType"
_NUMBER_NAMES = ("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64")
FIELDS: dict[str, tuple[tuple[str, str], ...]] = {
    "foxglove.Vector3": (("x", "double"), ("y", "double"), ("z", "double")),
    "foxglove.Quaternion": (("x", "double"), ("y", "double"), ("z", "double"), ("w", "double")),
    "foxglove.Pose": (("position", "foxglove.Vector3"), ("orientation", "foxglove.Quaternion")),
    SCAN: (
        ("timestamp", STAMP),
        ("frame_id", "string"),
        ("pose", "foxglove.Pose"),
        ("start_angle", "double"),
        ("end_angle", "double"),
        ("ranges", "double[]"),
        ("intensities", "double[]"),
    ),
    POSE: (("timestamp", STAMP), ("frame_id", "string"), ("pose", "foxglove.Pose")),
    TRANSFORM: (
        ("timestamp", STAMP),
        ("parent_frame_id", "string"),
        ("child_frame_id", "string"),
        ("translation", "foxglove.Vector3"),
        ("rotation", "foxglove.Quaternion"),
    ),
    "foxglove.PackedElementField": (("name", "string"), ("offset", "fixed32"), ("type", NUMBER)),
    CLOUD: (
        ("timestamp", STAMP),
        ("frame_id", "string"),
        ("pose", "foxglove.Pose"),
        ("point_stride", "fixed32"),
        ("fields", "foxglove.PackedElementField[]"),
        ("data", "bytes"),
    ),
}
"""Message type → its fields; their protobuf numbers count from 1."""


@cache
def descriptors() -> FileDescriptorSet:
    """All message types and what they import, as an MCAP schema holds them."""
    # Most logs hold no protobuf and need not wait for the import.
    from google.protobuf import descriptor_pb2, timestamp_pb2

    file = descriptor_pb2.FileDescriptorProto(name="foxglove.proto", package="foxglove", syntax="proto3")
    file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
    field_type = descriptor_pb2.FieldDescriptorProto
    plain = {
        "double": field_type.TYPE_DOUBLE,
        "string": field_type.TYPE_STRING,
        "fixed32": field_type.TYPE_FIXED32,
        "bytes": field_type.TYPE_BYTES,
    }
    for name, fields in FIELDS.items():
        message = file.message_type.add(name=name.partition(".")[2])
        for number, (field_name, kind) in enumerate(fields, 1):
            field = message.field.add(name=field_name, number=number, label=field_type.LABEL_OPTIONAL)
            if kind.endswith("[]"):
                field.label, kind = field_type.LABEL_REPEATED, kind[:-2]
            if kind in plain:
                field.type = plain[kind]
                continue
            field.type = field_type.TYPE_ENUM if kind == NUMBER else field_type.TYPE_MESSAGE
            field.type_name = f".{kind}"
            if kind == NUMBER:
                values = message.enum_type.add(name=kind.rpartition(".")[2])
                for value, value_name in enumerate(_NUMBER_NAMES):
                    values.value.add(name=value_name, number=value)
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    return descriptor_pb2.FileDescriptorSet(file=[stamp, file])


@cache
def classes() -> dict[str, Any]:
    """Message type → the class of its protobuf messages; a log's own schemas can only say the same."""
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    pool = DescriptorPool()
    for file in descriptors().file:
        pool.Add(file)
    return {name: GetMessageClass(pool.FindMessageTypeByName(name)) for name in FIELDS}
