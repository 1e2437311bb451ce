"""`lidarcli.tables`: all tables as data frames, equal to what is written, whose types depend on the schema alone."""

from __future__ import annotations

import json

import pandas as pd
import pytest

import lidarcli
from tests.places import SAMPLES

ROOM = SAMPLES / "room.mcap"


def test_all_tables_as_data_frames() -> None:
    frames = lidarcli.tables(ROOM, end=2.0)
    assert [len(frame) for frame in frames[:3]] == [100, 20, 5]
    assert frames.beams is None
    told = lidarcli.track(ROOM, end=2.0)
    for frame, table in zip(frames[:3], told, strict=True):
        assert [*frame] == table.column_names
        expected = table.to_pandas()
        for name in ("topic", "sweep", "x", "width", "duration", "objects", "track"):
            if name in frame:
                assert frame[name].dropna().tolist() == expected[name].dropna().tolist()


def test_their_types_are_those_that_pandas_counts_with() -> None:
    seen = lidarcli.tables(ROOM, end=1.0, beams=True)
    empty = lidarcli.tables(ROOM, end=1.0, beams=True, max_width=0.01)
    assert (len(seen.beams), len(empty.objects), len(empty.sweeps)) == (3610, 0, 10)
    for frame, other in zip(seen, empty, strict=True):
        assert [*frame] == [*other]
        for name, kind in frame.dtypes.items():
            if not isinstance(kind, pd.CategoricalDtype):
                assert other[name].dtype == kind, name
    objects = seen.objects.dtypes
    assert objects["stamp"] == pd.DatetimeTZDtype("ns", "UTC")
    assert isinstance(objects["shape"], pd.CategoricalDtype)
    assert objects["track"] == pd.Int64Dtype()
    assert objects["moving"] == pd.BooleanDtype()
    assert seen.beams["object"].dtype == pd.Int32Dtype()


def test_trajectories_are_there_unless_they_are_left_out() -> None:
    found = lidarcli.tables(ROOM, end=1.0)
    # As before there were any, four tables are unpacked.
    objects, _, tracks, beams = found
    assert beams is None
    rows = found.trajectories
    assert rows["track"].nunique() == len(tracks) == 5
    assert len(rows) == (tracks["last_sweep"] - tracks["first_sweep"] + 1).sum()
    assert rows["parts"].sum() == objects["track"].notna().sum()
    assert {*rows["frame"]} == {"sensor"}
    assert lidarcli.tables(ROOM, end=1.0, trajectories=False).trajectories is None


def test_trajectories_of_track_are_those() -> None:
    found, frames = lidarcli.track(ROOM, end=1.0), lidarcli.tables(ROOM, end=1.0)
    assert found.trajectories.column_names == [*frames.trajectories]
    assert found.trajectories["x"].to_pylist() == frames.trajectories["x"].tolist()
    _, _, tracks = found
    assert tracks is found.tracks
    assert lidarcli.track(ROOM, end=1.0, trajectories=False).trajectories is None


def test_a_few_columns() -> None:
    whole = lidarcli.tables(ROOM, end=1.0, beams=True)
    brief = lidarcli.tables(ROOM, end=1.0, beams=True, columns="brief")
    assert len(brief.objects.columns) < 20 < len(whole.objects.columns)
    for few, all_of_it in zip((*brief, brief.trajectories), (*whole, whole.trajectories), strict=True):
        assert 3 < len(few.columns) < len(all_of_it.columns)
        pd.testing.assert_frame_equal(few, all_of_it[[*few.columns]])
    for columns in ("sweep, track ,x", ["sweep", "track", "x"]):
        some = lidarcli.tables(ROOM, end=1.0, columns=columns)
        assert [[*frame] for frame in (some.objects, some.sweeps, some.tracks)] == [
            ["sweep", "track", "x"],
            ["sweep"],
            ["track", "x"],
        ]
    with pytest.raises(lidarcli.OptionError, match=r"^--columns: no table has a column trck; did you mean track\?$"):
        lidarcli.tables(ROOM, end=1.0, columns="trck")


def test_data_frames_keep_what_the_tables_tell_of_the_run() -> None:
    frames = lidarcli.tables(ROOM, end=1.0, max_width=1.5)
    for frame in (*frames[:3], frames.trajectories, frames.objects.query("set == 'O'")):
        assert frame.attrs["lidarcli.version"] == lidarcli.__version__
        assert json.loads(frame.attrs["lidarcli.parameters"])["max_width"] == 1.5


def test_they_take_what_track_takes() -> None:
    batches = list(lidarcli.read(ROOM, end=1.0))
    assert lidarcli.tables(batches, beams=True).beams["sweep"].value_counts().to_dict() == dict.fromkeys(range(10), 361)
    whole, of_batches = lidarcli.tables(ROOM, end=1.0), lidarcli.tables(batches)
    assert of_batches.tracks["track"].tolist() == whole.tracks["track"].tolist()
    assert lidarcli.tables(ROOM, end=1.0, memory=False, min_beams=60).objects.empty
