"""Changes to a log that change nothing of what happened, and what each of them changes of the tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag2 import CompressionMode, StoragePlugin

import lidarcli
from tests.metamorphic.recordings import (
    ODOMETRY,
    ROS2,
    SCAN,
    SECOND,
    TRANSFORMS,
    Message,
    Messages,
    batched,
    header,
    write_bag,
    write_mcap,
    write_ros2,
)


def kept(name: str) -> str:
    """The same name."""
    return name


@dataclass(frozen=True)
class Change:
    """A way to write a log, and how its tables differ from those of the log as it was."""

    make: Callable[[Messages, Path], Path | list[Path]]
    """Write the messages below a folder; the log, or its parts."""
    shift: Callable[[Messages], int] = lambda log: 0
    """[ns] that all stamps are later."""
    topic: Callable[[str], str] = kept
    frame: Callable[[str], str] = kept
    options: dict[str, Any] = field(default_factory=dict)
    """Keywords with which it is read."""
    against: dict[str, Any] = field(default_factory=dict)
    """Keywords with which the log is read as it was; sweeps and times then count from the part that is left."""
    of: Callable[[Messages], bool] = lambda log: True
    """Whether it is one of this log."""
    error: float = 0.0
    """By how much numbers may differ."""


def kinds_of(log: Messages) -> set[str]:
    """Types of messages of a log."""
    return {message.type for message in log}


def stays(log: Messages) -> bool:
    """Whether a log has one sensor and no poses.

    `--start` counts from the first sweep of each topic, that of `clean` from the first one of the log; and a part of a log
    has no poses from beyond its ends.
    """
    return len({message.topic for message in log}) == 1


Edit = Callable[[Message], Iterable[Message]]


def _whole(edit: Callable[[Messages], Iterable[Message]], **told: Any) -> Change:
    """The messages are changed as a whole, in an MCAP."""
    return Change(lambda log, out: write_mcap(out / "run.mcap", edit(log)), **told)


def _edited(edit: Edit, **told: Any) -> Change:
    """Each message becomes others, in an MCAP."""
    return _whole(lambda log: [new for old in log for new in edit(old)], **told)


def _mcap(**options: Any) -> Change:
    return Change(lambda log, out: write_mcap(out / "run.mcap", log, **options))


def _bag(**options: Any) -> Change:
    return Change(lambda log, out: write_bag(out / "run.bag", log, **options))


def _ros2(**options: Any) -> Change:
    return Change(lambda log, out: write_ros2(out / "run", log, **options))


def _database(log: Messages, out: Path) -> Path:
    """The database of a bag of ROS 2 without the file beside it."""
    (found,) = write_ros2(out / "run", log).glob("*.db3")
    return found


# Values of messages.


def _restamped(message: Message, stamped: Callable[[Any], Any]) -> Message:
    """The message with other headers."""
    value = message.value
    if message.type == TRANSFORMS:
        each = [replace(one, header=stamped(one.header)) for one in value.transforms]
        return message.of(replace(value, transforms=each))
    return message.of(replace(value, header=stamped(value.header)))


def _later(head: Any, shift: int) -> Any:
    stamp = head.stamp.sec * SECOND + head.stamp.nanosec
    # A stamp of zero means no time at all.
    return head if stamp == 0 else header(stamp + shift, head.frame_id)


def _shifted(shift: Callable[[Messages], int]) -> Change:
    """Everything happened so many nanoseconds later."""

    def moved(log: Messages) -> Iterator[Message]:
        later = shift(log)
        for message in log:
            new = _restamped(message, lambda head: _later(head, later))
            yield replace(new, time=message.time + later)

    return _whole(moved, shift=shift)


def _reframed(renamed: Callable[[str], str]) -> Change:
    """Frames have other names."""

    def edit(message: Message) -> list[Message]:
        new = _restamped(message, lambda head: replace(head, frame_id=renamed(head.frame_id)))
        value = new.value
        if message.type == TRANSFORMS:
            each = [replace(one, child_frame_id=renamed(one.child_frame_id)) for one in value.transforms]
            return [new.of(replace(value, transforms=each))]
        if message.type == ODOMETRY:
            return [new.of(replace(value, child_frame_id=renamed(value.child_frame_id)))]
        return [new]

    return _edited(edit, frame=renamed)


def _retopiced(renamed: Callable[[str], str], kinds: Sequence[str] = (SCAN, ODOMETRY)) -> Change:
    """Topics of some kinds of messages have another name."""

    def edit(message: Message) -> list[Message]:
        return [replace(message, topic=renamed(message.topic))] if message.type in kinds else [message]

    return _edited(edit, topic=renamed if SCAN in kinds else kept)


def _beside(others: Callable[[Message, int], Iterable[Message]], kinds: Sequence[str] = (SCAN,), **told: Any) -> Change:
    """Further messages after each of some kinds."""

    def edit(log: Messages) -> list[Message]:
        found: list[Message] = []
        for number, message in enumerate(log):
            found.append(message)
            if message.type in kinds:
                found.extend(others(message, number))
        return found

    return _whole(edit, **told)


def _words(message: Message, number: int) -> list[Message]:
    text = ROS2.types["std_msgs/msg/String"](f"sweep {number}" * (number % 7))
    return [Message("/a/chat", "std_msgs/msg/String", message.time, b"").of(text)]


def _image(message: Message, number: int) -> list[Message]:
    grey = np.full(4_000, number % 256, np.uint8)
    value = ROS2.types["sensor_msgs/msg/Image"](header(message.time, "camera"), 40, 100, "mono8", 0, 100, grey)
    return [Message("/camera/image", "sensor_msgs/msg/Image", message.time, b"").of(value)]


def _gripper(message: Message, number: int) -> list[Message]:
    """Transforms of an arm that nothing is fixed to."""
    types = ROS2.types
    place = types["geometry_msgs/msg/Transform"](
        types["geometry_msgs/msg/Vector3"](0.01 * number, 0.2, 0.3),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
    )
    one = types["geometry_msgs/msg/TransformStamped"](header(message.time, "wrist"), "gripper", place)
    return [Message("/tf", TRANSFORMS, message.time, b"").of(types[TRANSFORMS]([one]))]


def _again(message: Message, number: int) -> list[Message]:
    return [message]


def _said_again(log: Messages) -> list[Message]:
    """Static transforms once more after each sweep, as a late recorder gets them."""
    fixed = [message for message in log if message.topic.endswith("_static")]
    found: list[Message] = []
    for message in log:
        found.append(message)
        if message.type == SCAN:
            found.extend(replace(one, time=message.time) for one in fixed)
    return found


def _singly(message: Message) -> list[Message]:
    """Transforms of one message, each in one of its own."""
    if message.type != TRANSFORMS:
        return [message]
    value = message.value
    return [message.of(replace(value, transforms=[one])) for one in value.transforms]


# Orders of writing: record times tell when each message came.


def _swapped(log: Messages) -> list[Message]:
    """Neighbours of different topics in the other order."""
    found = [*log]
    for at in range(0, len(found) - 1, 2):
        if found[at].topic != found[at + 1].topic and found[at].time != found[at + 1].time:
            found[at], found[at + 1] = found[at + 1], found[at]
    return found


def _by_topic(log: Messages) -> list[Message]:
    """One topic after the other."""
    return sorted(log, key=lambda message: message.topic)


def _shuffled(log: Messages) -> list[Message]:
    order = np.random.default_rng(5).permutation(len(log))
    return [log[at] for at in order]


def _distinct(log: Messages) -> list[Message]:
    """Record times that tell the order."""
    return [replace(message, time=message.time + number) for number, message in enumerate(log)]


def _written(order: Callable[[Messages], list[Message]], write: Callable[..., Path], name: str, **options: Any) -> Change:
    return Change(lambda log, out: write(out / name, order(_distinct(log)), **options))


# Logs in parts, and what the project itself writes.


def _parts(write: Callable[[Path, Messages], Path], suffix: str, count: int) -> Change:
    def make(log: Messages, out: Path) -> list[Path]:
        parts = batched(log, count)
        return [write(out / f"run_{number}{suffix}", part) for number, part in enumerate(parts)]

    return Change(make, options={"join": True})


def _copied(
    write: Callable[[Path, Messages], Path],
    suffix: str,
    told: dict[str, Any] | None = None,
    order: Callable[[Messages], list[Message]] = list,
    **options: Any,
) -> Change:
    """What `clean` writes of it."""

    def make(log: Messages, out: Path) -> Path:
        source = write(out / f"run{suffix}", order(log))
        copy = out / f"copy{suffix}"
        lidarcli.clean(source, copy, remove="none", **options)
        return copy

    return Change(make, **told or {})


def _in_any_order(log: Messages) -> list[Message]:
    return _shuffled(_distinct(log))


_PART: dict[str, Any] = {"start": 0.5, "end": 1.2}
_CUT: dict[str, Any] = {"against": _PART, "of": stays, "error": 1e-9}
_ROUNDED = {"error": 1e-9}
_YEAR = 365 * 24 * 3600 * SECOND

CHANGES: dict[str, Change] = {
    "chunks of one message": _mcap(chunk_size=1),
    "one chunk": _mcap(chunk_size=1 << 30),
    "no chunks": _mcap(use_chunking=False),
    "no compression": _mcap(compression=CompressionType.NONE),
    "lz4": _mcap(compression=CompressionType.LZ4),
    "no index": _mcap(index=IndexType.NONE),
    "no summary": _mcap(use_statistics=False, use_summary_offsets=False, repeat_channels=False, repeat_schemas=False),
    "two channels of a topic": _mcap(twice=True),
    "bag": _bag(),
    "bag, bz2": _bag(compression="BZ2"),
    "bag, lz4": _bag(compression="LZ4", chunk=5_000),
    "bag, two connections of a topic": _bag(twice=True, chunk=3_000),
    "folder": _ros2(),
    "folder of an MCAP": _ros2(plugin=StoragePlugin.MCAP),
    "folder, files packed": _ros2(mode=CompressionMode.FILE),
    "folder, messages packed": _ros2(mode=CompressionMode.MESSAGE),
    "database": Change(_database),
    "a fraction later": _shifted(lambda log: 123_456_789),
    "a second later": _shifted(lambda log: SECOND),
    "a year later": _shifted(lambda log: _YEAR),
    "in 1975": _shifted(lambda log: 5 * _YEAR - log[0].time // SECOND * SECOND),
    "recorded late": _edited(lambda message: [replace(message, time=message.time + 300_000_000)]),
    "another frame": _reframed(lambda name: f"{name}_2" if re.search("laser|lidar|scan", name) else name),
    "frames of a robot": _reframed(lambda name: f"robot1/{name}"),
    "another topic": _retopiced(lambda name: f"{name}/raw", [SCAN]),
    "another odometry": _retopiced(lambda name: f"/wheels{name}", [ODOMETRY]),
    "topics of a robot": _retopiced(lambda name: f"/robot1{name}"),
    "words beside": _beside(_words),
    "images beside": _beside(_image),
    "an arm beside": _beside(_gripper),
    "transforms twice": _beside(_again, [TRANSFORMS], of=lambda log: TRANSFORMS in kinds_of(log)),
    "odometry twice": _beside(_again, [ODOMETRY], of=lambda log: ODOMETRY in kinds_of(log)),
    "transforms singly": _edited(_singly, of=lambda log: TRANSFORMS in kinds_of(log), **_ROUNDED),
    "static transforms again": _whole(_said_again, of=lambda log: TRANSFORMS in kinds_of(log)),
    "written with neighbours swapped": _written(_swapped, write_mcap, "run.mcap", chunk_size=2_000),
    "written topic by topic": _written(_by_topic, write_mcap, "run.mcap", chunk_size=2_000),
    "bag written topic by topic": _written(_by_topic, write_bag, "run.bag", chunk=2_000),
    "database written topic by topic": _written(_by_topic, write_ros2, "run"),
    "any order, mended": _copied(write_mcap, ".mcap", _ROUNDED, _in_any_order, mend=["stamps"]),
    "bag in any order, mended": _copied(write_bag, ".bag", _ROUNDED, _in_any_order, mend=["stamps"]),
    "two parts": _parts(write_mcap, ".mcap", 2),
    "bag in five parts": _parts(write_bag, ".bag", 5),
    "copied": _copied(write_mcap, ".mcap", mend=["angles"]),
    "bag copied": _copied(write_bag, ".bag", mend=["angles"]),
    "cut": _copied(write_mcap, ".mcap", _CUT, **_PART),
    "bag cut": _copied(write_bag, ".bag", _CUT, **_PART),
    "small batches": Change(lambda log, out: write_mcap(out / "run.mcap", log), options={"batch_size": 7}),
}
"""Name → change."""
