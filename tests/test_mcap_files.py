"""MCAP files by every command that writes one: what their summary tells is there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.records import Footer, McapRecord, SummaryOffset
from mcap.stream_reader import StreamReader

from tests.conftest import Ran
from tests.places import SAMPLES

ROOM, DRIVE = SAMPLES / "room.mcap", SAMPLES / "drive.db3"


def records(path: Path) -> list[McapRecord]:
    with path.open("rb") as file:
        return [*StreamReader(file, validate_crcs=True).records]


@pytest.mark.parametrize(
    "command",
    [
        ("simulate", SAMPLES / "room.toml", "--sweeps", "3"),
        ("simulate", SAMPLES / "room.toml", "--sweeps", "0"),
        ("simulate", SAMPLES / "room.toml", "--sweeps", "3", "--compression", "none", "--encoding", "ros1"),
        pytest.param(("overlay", ROOM), marks=pytest.mark.slow),
        pytest.param(("map", DRIVE), marks=pytest.mark.slow),
        pytest.param(("clean", ROOM), marks=pytest.mark.slow),
        ("clean", ROOM, "--remove", "none", "--mend", "order", "--start", "1", "--end", "2"),
    ],
)
def test_no_summary_offset_is_that_of_a_group_without_records(
    command: tuple[object, ...], tmp_path: Path, lidarcli: Callable[..., Ran]
) -> None:
    out = tmp_path / "out.mcap"
    assert lidarcli("-q", *command, "-o", out).code == 0
    found = records(out)
    assert [one for one in found if isinstance(one, SummaryOffset) and not one.group_length] == []
    (footer,) = [one for one in found if isinstance(one, Footer)]
    assert footer.summary_start
