"""Tables in memory: `report`, `plot` and `export` take what other functions return, as they take the files of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.simulation.writers import write_log
from tests.pipeline.in_memory import block
from tests.places import SAMPLES

ROOM, PEOPLE = SAMPLES / "room.mcap", SAMPLES / "people.csv.gz"
ZONE = '[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 2.5 }\n'


@pytest.fixture(scope="module")
def tracked() -> Any:
    return lidarcli.track(PEOPLE)


@pytest.fixture(scope="module")
def frames() -> Any:
    return lidarcli.tables(PEOPLE)


@pytest.fixture
def files(tracked: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The same tables as files in the current directory."""
    monkeypatch.chdir(tmp_path)
    for name, table in {**tracked._asdict(), "trajectories": tracked.trajectories}.items():
        pq.write_table(table, f"people.{name}.parquet")
    return "people.objects.parquet"


@pytest.mark.parametrize(
    "of",
    [
        lambda tracked, frames: tracked,
        lambda tracked, frames: frames,
        lambda tracked, frames: [*tracked, tracked.trajectories],
        lambda tracked, frames: [frames.sweeps, tracked.objects, frames.tracks, frames.trajectories],
    ],
)
def test_a_report_is_that_of_the_files(tracked: Any, frames: Any, files: str, of: Callable[[Any, Any], Any]) -> None:
    checks = ["objects where r_min < 2 == 0", "agents_at_once.max <= 3"]
    expected = lidarcli.report(files, check=checks)
    found = lidarcli.report(of(tracked, frames), check=checks)
    assert found.figures["tracks"] == len(frames.tracks) > 3
    assert found.as_dict() == expected.as_dict()
    assert str(found) == str(expected)


@pytest.mark.slow
def test_a_notebook_shows_the_same_page(tracked: Any, frames: Any, files: str) -> None:
    expected = lidarcli.report(files, log=PEOPLE)._repr_html_()
    assert lidarcli.report(frames, log=PEOPLE)._repr_html_() == expected
    # Without a log the beams table tells of the beams.
    assert len(lidarcli.report(lidarcli.tables(PEOPLE, beams=True))._repr_html_()) > 0.9 * len(expected)


def test_paths_and_tables_mix(files: str) -> None:
    room = lidarcli.detect(ROOM)
    mixed = lidarcli.report([files, room], baseline=[room, files])
    assert mixed.figures["sweeps"] == 80 + 100
    assert mixed.figures["delta.objects"] == 0


@pytest.mark.slow
def test_tables_of_several_logs_are_those_of_each(tracked: Any) -> None:
    both = lidarcli.tables([PEOPLE, ROOM])
    told = lidarcli.report(both).as_dict()
    assert told == lidarcli.report([tracked, lidarcli.track(ROOM)]).as_dict()
    assert told["figures"]["sweeps"] == 180
    assert lidarcli.report(both.objects).figures["sweeps"] == 180


@pytest.mark.slow
def test_damage_stays_with_its_log(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    write_log(cut, [block(sweeps=200, first=k) for k in (0, 200)], chunk_size=10_000)
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    with pytest.warns(UserWarning, match=r"cut\.mcap: "):
        frames = lidarcli.tables([ROOM, cut])
    with pytest.warns(UserWarning, match=r"^cut: damaged when its tables were made \(cut: "):
        report = lidarcli.report(frames, check="sweeps > 0")
    assert not report.holds
    assert report.figures["damage"] == 1
    with pytest.warns(UserWarning, match=r"^cut: damaged"):
        assert not lidarcli.report(frames.objects, check="sweeps > 0").holds
    assert lidarcli.report(frames, check=["sweeps > 0", "damage <= 1"]).holds


def test_a_log_without_objects_and_one_without_sweeps() -> None:
    none = lidarcli.track(ROOM, max_width=0.01)
    assert none.objects.num_rows == none.tracks.num_rows == 0
    report = lidarcli.report(none, check=["objects == 0", "sweeps == 100", "tracks == 0"])
    assert report.holds
    empty = pa.Table.from_batches([], none.sweeps.schema)
    assert lidarcli.report([none.objects, empty]).figures["sweeps"] == 0


def test_events_of_zones(tracked: Any, tmp_path: Path) -> None:
    zones = tmp_path / "near.toml"
    zones.write_text(ZONE)
    found = lidarcli.zones(PEOPLE, zones=zones)
    report = lidarcli.report(found, check=["zones.near.events == 1", "events where points >= 10 == 1"])
    assert report.holds
    assert lidarcli.report([*found]).figures == report.figures
    # Tables of one log belong together in any order.
    for mixed in ([tracked, found], [*found, *tracked]):
        figures = lidarcli.report(mixed).figures
        assert (figures["zones.near.events"], figures["tracks"], figures["sweeps"]) == (1, 6, 80)


def test_changes_are_those_of_the_file(tmp_path: Path) -> None:
    """In the second run nothing changes: the metadata alone tell of it."""
    empty = SAMPLES / "room_empty.mcap"
    found = lidarcli.diff(empty, empty, ROOM, output=tmp_path / "changes.parquet")
    checks = ["new == 5", "gone == 0"]
    expected = lidarcli.report(tmp_path / "changes.parquet", check=checks)
    frame = found.changes.to_pandas()
    frame.attrs = {key.decode(): note.decode() for key, note in found.changes.schema.metadata.items()}
    for given in (found, found.changes, frame, OfAnother(found.changes)):
        report = lidarcli.report(given, check=checks)
        assert report.holds
        assert report.as_dict() == expected.as_dict()
    # Beside the tables of a log, and beside another table of the same name.
    together = lidarcli.report([lidarcli.detect(ROOM, end=1), found])
    assert (together.figures["sweeps"], together.figures["new"]) == (10, 5)
    assert lidarcli.report([found, tmp_path / "changes.parquet"]).figures["new"] == 10
    assert lidarcli.export(found.changes, tmp_path / "changes.csv") == found.changes.num_rows
    with pytest.raises(UnreadableError, match=r"^changes.parquet \(in memory\): no column why"):
        lidarcli.report(found.changes.drop_columns("why"))
    with pytest.raises(OptionError, match=r"^--tracks: give what track returns, not a table of changes$"):
        lidarcli.plot(ROOM, tracks=found.changes)
    with pytest.raises(UnreadableError, match=r"^changes.parquet: this is the changes table of lidarcli diff"):
        lidarcli.report(lidarcli.detect(ROOM, end=1), baseline=found.changes)


@pytest.mark.slow
def test_paths_in_a_picture_are_those_of_the_files(tracked: Any, frames: Any, files: str) -> None:
    def lines(tables: Any) -> list[Any]:
        figure = lidarcli.plot(PEOPLE, 60, tracks=tables, view="scene")
        # No number, where a line is broken, equals none.
        return [np.nan_to_num(line.get_xydata(), nan=np.inf).tolist() for line in figure.axes[0].lines]

    expected = lines(files)
    assert expected
    for tables in (tracked, frames, lidarcli.tables([ROOM, PEOPLE])):
        assert lines(tables) == expected
    batch = next(lidarcli.read(PEOPLE))
    assert lidarcli.plot(batch, 60, tracks=tracked, view="scene")


class OfAnother:
    """A table of a library that hands out Arrow streams."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        self.columns = table.column_names

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._table.__arrow_c_stream__(requested_schema)


def test_tables_of_other_libraries(tracked: Any, tmp_path: Path) -> None:
    found = lidarcli.report([OfAnother(table) for table in tracked])
    assert found.as_dict() == lidarcli.report(tracked).as_dict()
    assert lidarcli.export(OfAnother(tracked.tracks), tmp_path / "tracks.csv") == tracked.tracks.num_rows


def test_one_track_or_column_is_a_list_of_one(tracked: Any, tmp_path: Path) -> None:
    out = tmp_path / "tracks.csv"
    track = tracked.tracks["track"][0].as_py()
    for only, count in ((track, 1), ([track], 1), (str(track), 1), (None, tracked.tracks.num_rows)):
        assert lidarcli.export(tracked.tracks, out, True, only=only) == count
    with pytest.raises(OptionError, match=r"^the table: no track 99 in it \(--only\)$"):
        lidarcli.export(tracked.tracks, out, True, only=99)
    with pytest.raises(OptionError, match=r"^the table: no column 5; it has log, "):
        lidarcli.export(tracked.tracks, out, True, columns=5)


def test_what_is_no_table(tracked: Any, frames: Any) -> None:
    kinds = r"^tables are named by their paths, or are what detect, track, tables, zones and diff return, .*, not int$"
    for call in (lambda: lidarcli.report(3), lambda: lidarcli.plot(PEOPLE, tracks=3), lambda: lidarcli.export(3, "x.csv")):
        with pytest.raises(TypeError, match=kinds):
            call()
    with pytest.raises(OptionError, match=r"^a table with the columns a is none of lidarcli: no column log or"):
        lidarcli.report(pd.DataFrame({"a": [1]}))
    with pytest.raises(OptionError, match=r"^column log is int64, not text: it names "):
        lidarcli.report(pd.DataFrame({"log": [1], "topic": [2]}))
    with pytest.raises(OptionError, match=r"^two objects tables hold rows of people: name one of them$"):
        lidarcli.report([tracked.objects, frames.objects])
    with pytest.raises(TypeError, match=r"^tables of one kind are exported at a time"):
        lidarcli.export(tracked, "x.csv")
    twice = tracked.objects.append_column("log", tracked.objects["log"])
    with pytest.raises(OptionError, match=r"^a table in memory has 2 columns log, not one$"):
        lidarcli.report([twice, tracked.sweeps])


def test_some_rows_do_not_tell_of_sweeps_without_any(tracked: Any, frames: Any) -> None:
    for some in (frames.objects.query("set == 'A'"), tracked.objects.slice(0, 9), tracked.tracks):
        with pytest.raises(OptionError, match=r"^no sweeps table of people among those in memory: give what "):
            lidarcli.report(some)
    report = lidarcli.report([frames.objects.query("set == 'A'"), frames.sweeps])
    assert report.figures["sweeps"] == 80
    with pytest.raises(OptionError, match=r"^no trajectories table of people among those in memory: "):
        lidarcli.plot(PEOPLE, tracks=lidarcli.track(PEOPLE, trajectories=False))
    narrow = lidarcli.tables(ROOM, columns="brief")
    with pytest.raises(UnreadableError, match=r"^room\.sweeps\.parquet \(in memory\): no column agent_beams, "):
        lidarcli.report(narrow)


def test_values_that_no_table_holds(tracked: Any, frames: Any) -> None:
    odd = frames.objects.assign(beams="many")
    with pytest.raises(UnreadableError, match=r"^people\.objects\.parquet: column beams is text, not int32$"):
        lidarcli.report([odd, frames.sweeps])
    mixed = frames.objects.assign(why=[3, *["text"] * (len(frames.objects) - 1)])
    with pytest.raises(OptionError, match=r"^a DataFrame that is no table: "):
        lidarcli.report([mixed, frames.sweeps])


def test_sweeps_of_objects_that_a_function_returned_are_remembered(tmp_path: Path) -> None:
    objects = lidarcli.detect(ROOM, max_width=0.01)
    assert lidarcli.report(objects).figures["sweeps"] == 100
    with pytest.raises(OptionError, match=r"^no sweeps table "):
        lidarcli.report(objects.slice(0))
    pq.write_table(objects, tmp_path / "copy.parquet")
    assert pq.read_table(tmp_path / "copy.parquet").equals(objects, check_metadata=True)
