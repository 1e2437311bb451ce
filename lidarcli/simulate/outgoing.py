"""The messages of a log in the order in which they are written: poses before the sweep of the same time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from lidarcli.ros.messages import Outgoing
from lidarcli.simulate.messages import Encoding
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import RawSweeps


def outgoing(
    blocks: Iterable[RawSweeps], poses: SimulatedPoses | None, encoding: Encoding
) -> Iterator[Outgoing]:
    """Encode sweeps block by block, merging in the poses."""
    pose = 0
    if poses is not None and len(poses) and poses.odometry.tf:
        first = int(poses.stamp_ns[0])
        yield Outgoing("/tf_static", encoding.tf_type, first, first, encoding.mounting(poses))
    for block in blocks:
        records, stamps = block.record_ns.tolist(), block.stamp_ns.tolist()
        for record_ns, stamp_ns, data in zip(records, stamps, encoding.scans(block), strict=True):
            while poses is not None and pose < len(poses) and poses.stamp_ns[pose] <= record_ns:
                yield from _pose(poses, pose, encoding)
                pose += 1
            yield Outgoing(block.topic, encoding.scan_type, record_ns, stamp_ns, data)


def _pose(poses: SimulatedPoses, row: int, encoding: Encoding) -> Iterator[Outgoing]:
    stamp_ns = int(poses.stamp_ns[row])
    odometry = encoding.odometry(poses, row)
    yield Outgoing(poses.odometry.topic, encoding.odometry_type, stamp_ns, stamp_ns, odometry)
    if poses.odometry.tf:
        yield Outgoing("/tf", encoding.tf_type, stamp_ns, stamp_ns, encoding.transform(poses, row))
