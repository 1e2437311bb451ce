"""One echo of each beam, against a reader that goes through a message field by field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.errors import OptionError
from lidarcli.logs import laserscan
from lidarcli.logs.base import LASERSCAN, MULTI_ECHO
from lidarcli.options.choices import ECHOES
from lidarcli.tabular.reading import file_metadata
from tests.logs.scan_messages import scan
from tests.logs.test_laserscan import intensities_of, read
from tests.logs.test_odd_logs import WRITERS, written

NAN = float("nan")

SECOND = [[1.0, 9.0], [2.0, 8.0], [3.0, 7.0]]
STRENGTHS = [[10.0, 20.0], [40.0, 30.0], [NAN, 5.0]]


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_first_last_and_strongest(encoding: str) -> None:
    uniform = scan([], encoding=encoding, echoes=SECOND, strengths=STRENGTHS)
    mixed = scan([], encoding=encoding, echoes=[[3.0], [], [4.0, 5.0, 6.0]], strengths=[[1.0], [], [2.0, 9.0, 4.0]])
    plain = scan([], encoding=encoding, echoes=[[3.0, 4.0]])
    expected: dict[str, tuple[Any, Any]] = {
        "first": ([[1, 2, 3], [3, NAN, 4], [3, NAN, NAN]], [[10, 40, NAN], [1, NAN, 2], [NAN, NAN, NAN]]),
        "last": ([[9, 8, 7], [3, NAN, 6], [4, NAN, NAN]], [[20, 30, 5], [1, NAN, 4], [NAN, NAN, NAN]]),
        "strongest": ([[9, 2, 7], [3, NAN, 5], [3, NAN, NAN]], [[20, 40, 5], [1, NAN, 9], [NAN, NAN, NAN]]),
    }
    for echo in ECHOES:
        raw, report = read([uniform, mixed, plain], encoding, echo=echo)
        assert raw is not None
        assert raw.beams.tolist() == [3, 3, 1]
        np.testing.assert_array_equal(raw.ranges, np.float32(expected[echo][0]))
        np.testing.assert_array_equal(intensities_of(raw), np.float32(expected[echo][1]))
        assert not report.refused


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_echoes_beyond_the_message_are_refused_intensities_are_not(encoding: str) -> None:
    mixed = scan([], encoding=encoding, echoes=[[3.0], [], [4.0, 5.0, 6.0]])
    empty = scan([], encoding=encoding, echoes=[])
    lying = scan([], encoding=encoding, echoes=[[1.0, 2.0]], strengths=[[5.0, 6.0]])
    lying = lying[:-12] + b"\xff\xff\xff\xff" + lying[-8:]
    raw, report = read([mixed, mixed[:-18], empty, lying], encoding, echo="strongest")
    assert raw is not None
    assert raw.beams.tolist() == [3, 0, 1]
    np.testing.assert_array_equal(raw.ranges[0], np.float32([3, NAN, 4]))
    assert raw.ranges[2, 0] == 1.0
    assert raw.intensities is None
    assert report.refused == {("/scan", laserscan.RANGES_BEYOND): 1}


def test_every_cut_of_a_message_is_refused_or_has_all_ranges() -> None:
    whole = scan([], echoes=SECOND, strengths=STRENGTHS)
    needed = len(whole) - 4 * (1 + 3 + 6)
    for end in range(len(whole) + 1):
        raw, report = read([whole[:end]], echo="last")
        assert (raw is not None) == (end >= needed)
        assert sum(report.refused.values()) == (end < needed)
        if raw is not None:
            assert raw.ranges.tolist() == [[9.0, 8.0, 7.0]]


@pytest.mark.parametrize("name", WRITERS)
def test_every_container_takes_the_option(name: str, tmp_path: Path) -> None:
    message = scan([], encoding=WRITERS[name][0], echoes=SECOND, strengths=STRENGTHS)
    plain = scan([4.0, 5.0, 6.0], encoding=WRITERS[name][0])
    path = written(name, tmp_path, {"/echoes": (MULTI_ECHO, [message] * 3), "/scan": (LASERSCAN, [plain] * 3)})
    for echo, ranges in (("first", [1, 2, 3]), ("last", [9, 8, 7]), ("strongest", [9, 2, 7])):
        batches = {batch.topic: batch for batch in lidarcli.read(path, echo=echo)}
        np.testing.assert_array_equal(batches["/echoes"].ranges, np.float32([ranges] * 3))
        np.testing.assert_array_equal(batches["/scan"].ranges, np.float32([[4, 5, 6]] * 3))
    (batch,) = lidarcli.read(path, topic="/echoes")
    assert batch.ranges[0].tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(OptionError, match="--echo: 'loudest' is not one of first, last, strongest"):
        list(lidarcli.read(path, echo="loudest"))


def test_tables_tell_of_an_echo_that_is_not_the_first(tmp_path: Path) -> None:
    from lidarcli.cli import run

    message = scan([], echoes=SECOND, strengths=STRENGTHS)
    path = written("run.mcap", tmp_path, {"/echoes": (MULTI_ECHO, [message] * 3)})
    told = {}
    for echo in ECHOES:
        folder = tmp_path / echo
        assert run(["detect", str(path), "-o", str(folder), "--echo", echo, "--profile", "paper", "-q"]) == 0
        told[echo] = file_metadata(folder / "run.sweeps.parquet")["lidarcli.parameters"]
    assert "echo" not in told["first"]
    assert '"echo": "last"' in told["last"].replace('":"', '": "')
    assert '"echo": "strongest"' in told["strongest"].replace('":"', '": "')
