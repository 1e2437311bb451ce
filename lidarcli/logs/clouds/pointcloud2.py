"""`sensor_msgs/PointCloud2` in CDR and in ROS 1 serialisation: where its points lie, without a look at them."""

from __future__ import annotations

from lidarcli.logs.clouds.cloud import BadCloudError, Cloud, Layout, PointField
from lidarcli.ros.cursor import BadMessageError, Cursor

MANY_FIELDS = "more than 1,000 fields declared"

_MAX_FIELDS = 1000
_KINDS = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
"""Types of numbers as numpy spells them, by their number in PointField."""


def decode(data: bytes, encoding: str) -> Cloud:
    """One message, `cdr` or `ros1`.

    Raises
    ------
    BadCloudError
        It is cut off, has no coordinates, or declares more points than it holds.
    """
    try:
        return _decode(Cursor(data, encoding))
    except BadMessageError as err:
        raise BadCloudError(str(err)) from None


def _decode(cursor: Cursor) -> Cloud:
    stamp_ns = cursor.stamp_ns()
    frame_id = cursor.text()
    rows, columns = cursor.word(), cursor.word()
    count = cursor.word()
    if count > _MAX_FIELDS:
        raise BadCloudError(MANY_FIELDS)
    fields: dict[str, PointField] = {}
    for _ in range(count):
        name = cursor.text()
        offset, kind = cursor.word(), cursor.byte()
        cursor.word()  # how many numbers there are: the first counts
        if 0 < kind < len(_KINDS):
            fields.setdefault(name, PointField(offset, _KINDS[kind]))
    order = ">" if cursor.byte() else "<"
    point_step, row_step = cursor.word(), cursor.word()
    size = cursor.word()
    start = cursor.skip(size)
    layout = Layout.of((rows, columns), (row_step, point_step), order, fields, size)
    return Cloud(frame_id, stamp_ns, cursor.data, start, layout)
