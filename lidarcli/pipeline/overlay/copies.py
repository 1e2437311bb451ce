"""Messages of a log that an overlay copies, in the order of their recording."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence

from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, POSE_TYPES, SCAN_TYPES, Log, ReadReport
from lidarcli.overlays.viewers import topic_name
from lidarcli.pose.messages import TRANSFORMS
from lidarcli.ros.messages import ROS2, SCAN, TF, Outgoing, cdr_scans, ros1_scans
from lidarcli.sweeps.types import RawSweeps

WINDOW = 4096
"""Messages that are sorted at a time: more than come of one topic at a stretch."""
ROS = ("cdr", "ros1")
"""Encodings of messages that can be copied; others are encoded again."""


def scan_encodings(log: Log) -> dict[str, str]:
    """Return the encoding of each topic of sweeps; a log without an index is read once for it."""
    topics = log.topics()
    if topics is not None:
        return {one.name: one.encoding if one.type in SCAN_TYPES else "sliced" for one in topics if one.is_scan}
    return {message.topic: message.encoding for message in log.messages(SCAN_TYPES, ReadReport())}


def transform_topics(log: Log, *, of_ros: bool) -> frozenset[str]:
    """Return the topics of transforms, all or those that can be copied; of a log without an index those that ROS uses."""
    topics = log.topics()
    if topics is None:
        return frozenset({"/tf", "/tf_static"})
    transforming = [topic for topic in topics if topic.type in TRANSFORMS]
    return frozenset(topic.name for topic in transforming if topic.encoding in ROS or not of_ros)


def frames_in_transforms(log: Log, frames: Collection[str]) -> set[str]:
    """Return those of the frames that transforms of the log name."""
    names: dict[str, tuple[bytes, bytes]] = {}
    for frame in frames:
        # As ROS 1 and ROS 2 write it; old transforms have no leading slash.
        name = frame.removeprefix("/").encode()
        names[frame] = len(name).to_bytes(4, "little") + name, (len(name) + 1).to_bytes(4, "little") + name + b"\0"
    found: set[str] = set()
    for message in log.messages(TRANSFORMS, ReadReport()):
        if message.encoding not in ROS:
            continue
        found |= {frame for frame, forms in names.items() if any(form in message.data for form in forms)}
        if len(found) == len(names):
            break
    return found


class Copies:
    """Copies messages of a log, and counts those that cannot be copied."""

    def __init__(self, topics: Collection[str], is_ros2: bool) -> None:
        """`topics`: those of the sweeps that are wanted; `is_ros2`: whether for ROS 2, else for ROS 1."""
        self._topics = topics
        self._is_ros2 = is_ros2
        self._left_out: Counter[tuple[str, str]] = Counter()

    def of(self, log: Log, report: ReadReport) -> Iterator[Outgoing]:
        """Yield scans, transforms, odometry and poses in log order."""
        convert = ROS2.ros1_to_cdr if self._is_ros2 else ROS2.cdr_to_ros1
        for message in log.messages({LASERSCAN, MULTI_ECHO} | POSE_TYPES, report):
            if message.type in SCAN_TYPES and message.topic not in self._topics:
                continue
            if message.encoding not in ROS:
                if message.type in POSE_TYPES:
                    self._left_out[message.topic, message.type] += 1
                continue
            kind = TF if message.type == "tf/msg/tfMessage" else message.type
            try:
                is_alike = (message.encoding == "cdr") == self._is_ros2
                data = message.data if is_alike else bytes(convert(message.data, kind))
            # The library raises errors of many kinds for messages that are not what they say.
            except Exception:
                report.refused[message.topic, f"its {kind} cannot be copied: it is damaged"] += 1
                continue
            yield Outgoing(message.topic, kind, message.record_ns, message.record_ns, data)

    def written_anew(self, raw: RawSweeps) -> Iterator[Outgoing]:
        """Yield sweeps of a log that is not of ROS, as LaserScan."""
        data = cdr_scans(raw) if self._is_ros2 else ros1_scans(raw)
        return of_sweeps(topic_name(raw.topic), SCAN, raw, data)

    def notes(self) -> list[str]:
        """Return a line for each topic that was left out."""
        return [
            f"{topic} ({kind}) is not copied: {number:,} messages that are not of ROS"
            for (topic, kind), number in sorted(self._left_out.items())
        ]


def of_sweeps(topic: str, kind: str, raw: RawSweeps, data: Sequence[bytes]) -> Iterator[Outgoing]:
    """Yield a message for each of some sweeps, recorded when the sweep was."""
    times = raw.record_ns.tolist()
    # Header stamps may go back where record times do not, and a file of messages has one order.
    return (Outgoing(topic, kind, at, at, one) for at, one in zip(times, data, strict=True))


def in_order(messages: Iterable[Outgoing]) -> Iterator[Outgoing]:
    """Yield messages by record time, within a window of `WINDOW` messages; equal times keep their order."""
    heap: list[tuple[int, int, Outgoing]] = []
    for number, message in enumerate(messages):
        heapq.heappush(heap, (message.record_ns, number, message))
        if len(heap) > WINDOW:
            yield heapq.heappop(heap)[2]
    yield from (message for _, _, message in sorted(heap))
