"""Recordings that are joined: their order, and what does not go together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace

import numpy as np
import pytest

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import LASERSCAN, POSE_TYPES, Log, Message, ReadReport, Topic
from lidarcli.logs.joined import JoinedLog, Numbered, Part, numbered
from lidarcli.sweeps.types import RawSweeps
from tests.fake_log import FakeLog
from tests.sweeping import room_sweeps

SECOND = 10**9
TF = "tf2_msgs/msg/TFMessage"


class Recording(FakeLog):
    """A log of some format whose messages and sweeps are what a test says."""

    def __init__(self, begin: float | None, format: str = "mcap", **more: object) -> None:
        super().__init__([] if begin is None else [at(begin)], **more)  # type: ignore[arg-type]
        self.format = format


def at(seconds: float, topic: str = "/scan") -> RawSweeps:
    """20 sweeps of 1.9 s, recorded from a time on."""
    sweeps = room_sweeps(topic)
    return replace(sweeps, record_ns=sweeps.record_ns - sweeps.record_ns[0] + int(seconds * SECOND))


def part(name: str, log: FakeLog, size: int = 1234) -> Part:
    def opened(_: ReadReport) -> AbstractContextManager[Log]:
        return nullcontext(log)

    log.size = None if log.size is None else size
    return Part(f"bags/{name}", name, size, opened)


def broken(name: str) -> Part:
    @contextmanager
    def opened(_: ReadReport) -> Iterator[Log]:
        raise UnreadableError(f"bags/{name}: is empty")
        yield

    return Part(f"bags/{name}", name, 7, opened)


def names(log: JoinedLog) -> list[str]:
    return [each.name for each in log.parts]


def notes_of(log: JoinedLog) -> list[str]:
    report = ReadReport()
    for _ in log.scans(None, report):
        pass
    return report.notes


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("run_0.bag", Numbered("run", "run", 0, ".bag")),
        ("RUN_3.BAG.active", Numbered("RUN", "RUN", 3, ".bag")),
        ("b.v2_10.db3.zstd", Numbered("b.v2", "b.v2", 10, ".db3")),
        ("hall_2024-01-01-10-00-00_1.bag", Numbered("hall_2024-01-01-10-00-00", "hall", 1, ".bag")),
        ("2024-01-01-10-00-00_0.bag", Numbered("2024-01-01-10-00-00", "", 0, ".bag")),
        ("rosbag2_2024_01_01-10_00_00_0.mcap", Numbered(*["rosbag2_2024_01_01-10_00_00"] * 2, 0, ".mcap")),
        ("run_1", Numbered("run", "run", 1, "")),
        ("run.bag", None),
        ("run_0a.bag", None),
        ("_0.bag", None),
        ("run_12345678901.bag", None),
    ],
)
def test_names_of_parts(name: str, expected: Numbered | None) -> None:
    assert numbered(name) == expected


def test_the_order_is_that_of_time_and_sweeps_go_on() -> None:
    log = JoinedLog("run", [part("b.bag", Recording(10)), part("c.bag", Recording(20)), part("a.bag", Recording(0))])
    assert names(log) == ["a.bag", "b.bag", "c.bag"]
    report = ReadReport()
    times = np.concatenate([block.record_ns for block in log.scans(None, report)])
    assert len(times) == 60
    assert (np.diff(times) > 0).all()
    assert (report.notes, report.damage) == ([], [])
    assert (log.size, log.position, log.format) == (3 * 1234, 3 * 1234, "mcap")


def test_a_part_without_sweeps_is_placed_by_its_poses_and_one_without_either_stays_behind_the_one_before_it() -> None:
    pose = Message("/tf", TF, "cdr", 15 * SECOND, b"")
    log = JoinedLog(
        "run",
        [
            part("poses.bag", Recording(None, messages=[pose])),
            part("late.bag", Recording(20)),
            part("nothing.bag", Recording(None)),
            part("early.bag", Recording(10)),
        ],
    )
    assert names(log) == ["early.bag", "poses.bag", "late.bag", "nothing.bag"]
    assert list(log.messages(POSE_TYPES, ReadReport())) == [pose]


def test_what_is_latched_and_repeated_with_its_old_time_does_not_move_a_part() -> None:
    old = Message("/tf_static", TF, "cdr", 0, b"")
    log = JoinedLog("run", [part("b.bag", Recording(20, messages=[old])), part("a.bag", Recording(10))])
    assert names(log) == ["a.bag", "b.bag"]


def test_topics_are_those_of_all_parts() -> None:
    scan, other = Topic("/scan", LASERSCAN, "cdr", 3), Topic("/rear", LASERSCAN, "cdr", 2)
    same = replace(scan, encoding="ros1")
    log = JoinedLog("run", [part("a.bag", Recording(0, topics=[scan])), part("b.bag", Recording(5, topics=[same, other]))])
    assert log.topics() == [replace(scan, messages=6), other]


def test_damage_names_its_part_and_the_rest_is_read() -> None:
    log = JoinedLog("run", [part("a.bag", Recording(0, damage="cut off")), broken("b.bag"), part("c.bag", Recording(20))])
    report = ReadReport()
    assert sum(len(block) for block in log.scans(None, report)) == 40
    assert [(each.place, each.cause) for each in report.damage] == [
        ("a.bag: byte 99", "cut off"),
        ("b.bag", "the whole file is lost: is empty"),
    ]


def test_where_no_part_can_be_read_there_is_no_log() -> None:
    with pytest.raises(UnreadableError, match=r"^none of its parts can be read; a\.bag: is empty$"):
        JoinedLog("run", [broken("a.bag"), broken("b.bag")])


def test_parts_that_overlap_are_told_once_for_each_topic() -> None:
    two = Recording(1)
    two._blocks = [at(1), at(2.9), at(0, "/rear")]
    log = JoinedLog("run", [part("a.bag", Recording(0)), part("b.bag", two), part("c.bag", Recording(2.5), 99)])
    assert notes_of(log) == [
        "b.bag begins 0.9 s before a.bag ends (/scan): they overlap",
        "c.bag begins 2.3 s before b.bag ends (/scan): they overlap",
    ]


def test_a_copy_is_told() -> None:
    log = JoinedLog("run", [part("a.bag", Recording(0)), part("copy.bag", Recording(0))])
    assert notes_of(log) == [
        "a.bag and copy.bag begin at the same time and are of the same size: one recording twice?",
        "copy.bag begins 1.9 s before a.bag ends (/scan): they overlap",
    ]


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((0, 1, 2), []),
        ((0, 2), ["missing by their numbers: 1 part, the first is number 1"]),
        ((1, 2), ["missing by their numbers: 1 part, the first is number 0"]),
        ((0, 1, 999_999_999), ["missing by their numbers: 999,999,997 parts, the first is number 2"]),
    ],
)
def test_missing_numbers_are_told(numbers: tuple[int, ...], words: list[str]) -> None:
    log = JoinedLog("run", [part(f"run_{k}.bag", Recording(10 * at)) for at, k in enumerate(numbers)])
    assert notes_of(log) == words


@pytest.mark.parametrize("formats", [("mcap", "ros1 bag"), ("ros2 bag (mcap)", "json lines")])
def test_messages_of_ros_are_joined_from_any_container(formats: tuple[str, str]) -> None:
    log = JoinedLog("run", [part(f"{k}.bag", Recording(10 * k, form)) for k, form in enumerate(formats)])
    assert log.format == "+".join(formats)


@pytest.mark.parametrize(
    ("formats", "words"),
    [
        (("mcap", "csv (wide)"), "1.x is csv (wide) and 0.x is mcap: CSV is joined with CSV of the same layout"),
        (("csv (wide)", "csv (rostopic echo -p)"), "0.x is csv (wide) and 1.x is csv (rostopic echo -p): CSV"),
        (("csv (one file per sweep)",) * 2, "0.x holds one sweep: name the folder of such files"),
        (("carmen", "carmen"), "0.x is a carmen log, which says at its beginning what holds for all of it"),
    ],
)
def test_what_does_not_go_together_is_refused(formats: tuple[str, str], words: str) -> None:
    with pytest.raises(OptionError) as refused:
        JoinedLog("run", [part(f"{k}.x", Recording(10 * k, form)) for k, form in enumerate(formats)])
    assert str(refused.value).startswith(words)


def test_several_recordings_are_told() -> None:
    names = ("run_2026-11-22-10-00-00_0.bag", "run_2026-11-22-10-05-00_1.bag", "run_2026-11-23-09-00-00_0.bag")
    log = JoinedLog("run", [part(name, Recording(10 * at)) for at, name in enumerate(names)])
    assert notes_of(log) == ["several parts have one number: they look like parts of several recordings"]


def test_a_pipe_is_refused() -> None:
    pipe = Recording(0)
    pipe.size = None
    with pytest.raises(OptionError, match=r"^bags/pipe: a pipe is read only once, and cannot be joined$"):
        JoinedLog("run", [part("a.bag", Recording(0)), part("pipe", pipe)])
