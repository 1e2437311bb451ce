"""What `overlay --with-log` takes over from a log: scans and poses as they are, or as the messages of the other ROS."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import count

from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, POSE_TYPES, SCAN_TYPES, Log, Message, ReadReport
from lidarcli.overlays.files import topic_name
from lidarcli.poses.rows import TRANSFORMS
from lidarcli.ros.definitions import ROS2, SCAN, TF
from lidarcli.ros.outgoing import Outgoing
from lidarcli.ros.scans import cdr_scans, ros1_scans
from lidarcli.sweeps import RawSweeps

WINDOW = 4096
"""Messages among which those of several topics are put in order: more than come of one topic at a stretch."""
_ROS = ("cdr", "ros1")
SLICED = "sliced"
"""In the place of an encoding: sweeps that are made of point clouds, which no message of the log holds."""
_OLD_TF = "tf/msg/tfMessage"


def scan_encodings(log: Log) -> dict[str, str]:
    """Topic of sweeps → how its messages are encoded; where the log has no index, by reading it once."""
    topics = log.topics()
    if topics is not None:
        return {topic.name: SLICED if topic.sliced else topic.encoding for topic in topics if topic.is_scan}
    return {message.topic: message.encoding for message in log.messages(SCAN_TYPES, ReadReport())}


def is_ros(encoding: str) -> bool:
    """Whether messages can be copied; what is not is written anew."""
    return encoding in _ROS


def transform_topics(log: Log, *, of_ros: bool) -> frozenset[str]:
    """Topics of transforms, all or those that can be copied; a log without an index has them where ROS has them."""
    topics = log.topics()
    if topics is None:
        return frozenset({"/tf", "/tf_static"})
    transforming = [topic for topic in topics if topic.type in TRANSFORMS]
    return frozenset(topic.name for topic in transforming if is_ros(topic.encoding) or not of_ros)


def frames_told(log: Log, frames: Collection[str]) -> set[str]:
    """Those of the frames that transforms of the log speak of."""
    names = {frame: _spelled(frame) for frame in frames}
    told: set[str] = set()
    for message in log.messages(TRANSFORMS, ReadReport()):
        if not is_ros(message.encoding):
            continue
        told |= {frame for frame, forms in names.items() if any(form in message.data for form in forms)}
        if len(told) == len(names):
            break
    return told


def _spelled(frame: str) -> tuple[bytes, bytes]:
    """A frame as it stands in messages of ROS 1 and of ROS 2; old transforms have it without its leading slash."""
    name = frame.removeprefix("/").encode()
    return len(name).to_bytes(4, "little") + name, (len(name) + 1).to_bytes(4, "little") + name + b"\0"


class Copies:
    """Messages of a log that are copied, and what could not be."""

    def __init__(self, topics: Collection[str], is_ros2: bool) -> None:
        """`topics`: those of the sweeps that are wanted; `is_ros2`: whether for ROS 2, else for ROS 1."""
        self._topics = topics
        self._is_ros2 = is_ros2
        self._left_out: Counter[tuple[str, str]] = Counter()

    def of(self, log: Log, report: ReadReport) -> Iterator[Outgoing]:
        """Scans, transforms, odometry and poses in log order."""
        for message in log.messages({LASERSCAN, MULTI_ECHO} | POSE_TYPES, report):
            if message.type in SCAN_TYPES and message.topic not in self._topics:
                continue
            if not is_ros(message.encoding):
                if message.type in POSE_TYPES:
                    self._left_out[message.topic, message.type] += 1
                continue
            kind = TF if message.type == _OLD_TF else message.type
            try:
                data = self._data(message, kind)
            # The library raises errors of many kinds for messages that are not what they say.
            except Exception:
                report.refused[message.topic, f"its {kind} cannot be copied: it is damaged"] += 1
                continue
            yield Outgoing(message.topic, kind, message.record_ns, message.record_ns, data)

    def written_anew(self, raw: RawSweeps) -> Iterator[Outgoing]:
        """Sweeps of a log that is not of ROS, as LaserScan."""
        data = cdr_scans(raw) if self._is_ros2 else ros1_scans(raw)
        return of_sweeps(topic_name(raw.topic), SCAN, raw, data)

    def notes(self) -> list[str]:
        """What was left out, a line for each topic."""
        return [
            f"{topic} ({kind}) is not copied: {number:,} messages that are not of ROS"
            for (topic, kind), number in sorted(self._left_out.items())
        ]

    def _data(self, message: Message, kind: str) -> bytes:
        if (message.encoding == "cdr") == self._is_ros2:
            return message.data
        turned = ROS2.ros1_to_cdr if self._is_ros2 else ROS2.cdr_to_ros1
        return bytes(turned(message.data, kind))


def of_sweeps(topic: str, kind: str, raw: RawSweeps, data: Sequence[bytes]) -> Iterator[Outgoing]:
    """A message for each of some sweeps, recorded when the sweep was."""
    times = zip(raw.record_ns.tolist(), raw.time_ns.tolist(), data, strict=True)
    return (Outgoing(topic, kind, *each) for each in times)


def in_order(messages: Iterable[Outgoing]) -> Iterator[Outgoing]:
    """Messages by record time, as far as a window of `WINDOW` of them reaches; of equal times as they come."""
    heap: list[tuple[int, int, Outgoing]] = []
    for number, message in zip(count(), messages, strict=False):
        entry = (message.record_ns, number, message)
        if len(heap) < WINDOW:
            heapq.heappush(heap, entry)
        else:
            yield heapq.heappushpop(heap, entry)[2]
    for _, _, message in sorted(heap):
        yield message
