"""Tracks tables in, one table of matches out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.pipeline.matching import match_tables
from lidarcli.tabular.schemas import MATCHES
from tests.pipeline.tracks_tables import ROOM, turned, write_tracks

LATER: list[dict[str, Any]] = [
    {**ROOM[0], "y": 2.4},
    *ROOM[1:4],
    {"x": -2.5, "y": -2.0, "length": 1.2, "width": 0.9},
]
"""The first box was moved by 3.8 m, the smallest one is gone, and a larger one has come."""


def rows(table: pa.Table, *names: str) -> list[tuple[Any, ...]]:
    values = [table[name].to_pylist() for name in names]
    rounded = [[round(v, 6) + 0.0 if isinstance(v, float) else v for v in column] for column in values]
    return list(zip(*rounded, strict=True))


@pytest.fixture
def monday(tmp_path: Path) -> str:
    return str(write_tracks(tmp_path / "monday.tracks.parquet", "monday", ROOM, "map"))


def test_by_position_in_one_world(monday: str, tmp_path: Path) -> None:
    tuesday = write_tracks(tmp_path / "tuesday.tracks.parquet", "tuesday", LATER, "/map")
    result = match_tables([monday, str(tuesday)])
    assert result.table.schema.equals(MATCHES)
    assert rows(result.table, "thing", "log", "track", "x", "y", "moved") == [
        (1, "monday", 1, 2.0, -1.4, None),
        (1, "tuesday", 1, 2.0, 2.4, 3.8),
        (2, "monday", 2, 2.5, 0.8, None),
        (2, "tuesday", 2, 2.5, 0.8, 0.0),
        (3, "monday", 3, 0.9, 2.1, None),
        (3, "tuesday", 3, 0.9, 2.1, 0.0),
        (4, "monday", 4, -1.5, 1.7, None),
        (4, "tuesday", 4, -1.5, 1.7, 0.0),
        (5, "monday", 5, -1.9, -0.9, None),
        (6, "tuesday", 5, -2.5, -2.0, None),
    ]
    assert [score is None for score in result.table["score"].to_pylist()] == [
        moved is None for moved in result.table["moved"].to_pylist()
    ]
    assert result.notes == ["matched by position, in the frame map"]
    assert [run.words for run in result.runs] == [
        "monday /scan: 5 things, 0 known, 0 of them moved by more than 0.3 m",
        "tuesday /scan: 5 things, 4 known, 1 of them moved by more than 0.3 m",
    ]
    told = json.loads(result.table.schema.metadata[b"lidarcli.parameters"])
    assert told == {"by": "auto", "matched_by": "position"}


@pytest.mark.parametrize("world", [None, "odom"])
def test_by_constellation_where_the_frames_need_not_agree(world: str | None, tmp_path: Path) -> None:
    monday = write_tracks(tmp_path / "monday.tracks.parquet", "monday", ROOM, world)
    later = turned(LATER, -0.7, 1.0, 0.5)
    tuesday = write_tracks(tmp_path / "tuesday.tracks.parquet", "tuesday", later, world)
    result = match_tables([str(monday), str(tuesday)])
    assert rows(result.table, "thing", "track", "moved")[1::2][:4] == [
        (1, 1, 3.8),
        (2, 2, 0.0),
        (3, 3, 0.0),
        (4, 4, 0.0),
    ]
    # In the coordinates of the first run.
    assert rows(result.table, "x", "y")[1] == (2.0, 2.4)
    assert "turned by 40.1 deg" in result.runs[1].words
    named = world or "the sensor's own"
    assert result.notes == [
        f"matched by constellation: the frame of the places is {named}, which need not be the same place"
    ]
    forced = match_tables([str(monday), str(tuesday)], "position")
    assert max(forced.table["moved"].drop_null().to_pylist()) > 1
    assert forced.notes == [
        f"matched by position, in the frame {named}, which need not be the same place (--by constellation)"
    ]


def test_what_has_moved_within_a_run_is_no_standing_thing(monday: str, tmp_path: Path) -> None:
    agent = {**ROOM[0], "set": "A", "moved_at": 1}
    tuesday = write_tracks(tmp_path / "tuesday.tracks.parquet", "tuesday", [agent, *ROOM[1:]], "map")
    table = match_tables([monday, str(tuesday)]).table
    assert rows(table, "log", "track")[:3] == [("monday", 1), ("monday", 2), ("tuesday", 2)]
    assert len(table) == 9


def test_three_runs_and_a_folder(tmp_path: Path) -> None:
    for day in "abc":
        write_tracks(tmp_path / "runs" / f"{day}.tracks.parquet", day, ROOM, "map")
    result = match_tables([str(tmp_path / "runs")])
    assert rows(result.table, "thing", "log") == [(thing, day) for thing in range(1, 6) for day in "abc"]
    pattern = match_tables([str(tmp_path / "runs" / "[ab].*.parquet")])
    assert len(pattern.table) == 10


def test_logs_of_one_name_are_called_by_their_tables(tmp_path: Path) -> None:
    files = [write_tracks(tmp_path / day / "run.tracks.parquet", "run", ROOM[:2], "map") for day in "ab"]
    table = match_tables([*map(str, files)]).table
    assert rows(table, "log")[:2] == [(str(files[0]),), (str(files[1]),)]


def test_another_place_is_not_matched(monday: str, tmp_path: Path) -> None:
    other = [{"x": 3.0 * i, "y": (-1.0) ** i, "length": 1.0 + 0.1 * i, "width": 0.2} for i in range(4)]
    elsewhere = write_tracks(tmp_path / "other.tracks.parquet", "other", other)
    result = match_tables([monday, str(elsewhere)])
    assert result.table["moved"].null_count == len(result.table) == 9
    assert result.runs[1].words == (
        "other /scan: 4 things, none matched: nothing tells how it lies beside the runs before"
    )


def test_tables_without_a_row(monday: str, tmp_path: Path) -> None:
    empty = write_tracks(tmp_path / "empty.tracks.parquet", "empty", [], "map")
    assert len(match_tables([monday, str(empty)]).table) == 5
    assert (
        len(match_tables([str(empty), str(write_tracks(tmp_path / "e.tracks.parquet", "e", []))]).table) == 0
    )


def test_what_is_refused(monday: str, tmp_path: Path) -> None:
    with pytest.raises(
        OptionError, match="one run has nothing to be matched with; give the tracks of two or more"
    ):
        match_tables([monday, monday])
    with pytest.raises(UnreadableError, match="no such file or folder"):
        match_tables([monday, str(tmp_path / "none.parquet")])
    with pytest.raises(UnreadableError, match=r"no tracks tables match this pattern"):
        match_tables([str(tmp_path / "x*.parquet")])
    (tmp_path / "folder").mkdir()
    with pytest.raises(
        UnreadableError, match=r"no \*.tracks.parquet in this folder; write some with lidarcli track"
    ):
        match_tables([str(tmp_path / "folder")])
    many = write_tracks(tmp_path / "many.tracks.parquet", "many", ROOM[:1] * 2001)
    with pytest.raises(
        OptionError, match="many: 2,001 standing things of /scan are more than can be matched"
    ):
        match_tables([monday, str(many)])
    (tmp_path / "text.parquet").write_text("no table")
    with pytest.raises(UnreadableError, match="cannot be read as Parquet"):
        match_tables([monday, str(tmp_path / "text.parquet")])
    pa.parquet.write_table(pa.table({"x": [1.0]}), tmp_path / "x.parquet")
    with pytest.raises(UnreadableError, match="not a table of lidarcli track: no column frame_id"):
        match_tables([monday, str(tmp_path / "x.parquet")])


def test_every_column_has_a_unit_and_a_meaning() -> None:
    units = {field.name: field.metadata[b"unit"] for field in MATCHES}
    assert units == {
        "thing": b"1",
        "log": b"",
        "topic": b"",
        "track": b"1",
        "x": b"m",
        "y": b"m",
        "moved": b"m",
        "score": b"1",
    }
    assert all(field.metadata[b"description"] for field in MATCHES)
