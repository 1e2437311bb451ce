"""The functions of the package for Python: what they take, warn of and refuse."""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli.declared import DeclaredOption
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism import Parameters, definitions
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.simulation.writers import write_log
from lidarcli.tabular import OBJECTS
from tests.pipeline.folders import logs_apart
from tests.pipeline.in_memory import block
from tests.places import SAMPLES
from tools.reference import commands


def test_detect_batches_in_python() -> None:
    batch = lidarcli.formalism.sweep(block().ranges, angle_increment=np.pi / 180)
    table = lidarcli.detect(batch)
    assert table.num_rows == 4
    assert table["beam_i"].to_pylist() == [40] * 4
    assert lidarcli.detect([batch, batch]).num_rows == 8


def test_read_and_detect_a_log_in_python(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [block("/b"), block("/a")])
    batches = list(lidarcli.read(path, topic="/b", every=2))
    assert [(batch.topic, batch.sweep.tolist()) for batch in batches] == [("/b", [0, 2])]
    table = lidarcli.detect(path, Parameters.for_profile("robust"), start=0.1)
    assert table.schema.equals(OBJECTS)
    assert list(zip(table["topic"].to_pylist(), table["sweep"].to_pylist(), strict=True)) == [
        *(("/a", sweep) for sweep in (1, 2, 3)),
        *(("/b", sweep) for sweep in (1, 2, 3)),
    ]
    detect_to_files(Source(str(path), "run"), tmp_path, DetectOptions(read=ReadOptions(start=0.1)))
    assert table.equals(pq.read_table(tmp_path / "run.objects.parquet"), check_metadata=True)


def test_damage_is_a_warning_in_python(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    write_log(path, [block(sweeps=200, first=k) for k in (0, 200)], chunk_size=10_000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.warns(UserWarning, match=re.escape(f"{path}: byte ")):
        table = lidarcli.detect(path)
    assert 0 < table.num_rows < 400
    with pytest.warns(UserWarning, match="no sweep of /scan from 100 s on"):
        lidarcli.detect(SAMPLES / "room.mcap", start=100)
    with pytest.warns(UserWarning, match=re.escape(f"{path}: byte ")):
        assert sum(len(batch) for batch in lidarcli.read(path)) == table.num_rows


def test_options_of_reading_need_a_path() -> None:
    batch = lidarcli.formalism.sweep(block().ranges, angle_increment=np.pi / 180)
    with pytest.raises(TypeError, match=r"^only a log can be read with every$"):
        lidarcli.detect(batch, every=2)


def test_a_folder_of_logs_is_not_one_log_in_python(tmp_path: Path) -> None:
    """They came as one log, with the poses of one of them for all."""
    folder = logs_apart(tmp_path / "logs")
    table = lidarcli.detect(folder)
    rows = Counter(table["log"].to_pylist())
    assert set(rows) == {"deep/c", "drive", "run 1"}
    world = table["world_x"].is_null().to_pylist()
    posed = {log for log, null in zip(table["log"].to_pylist(), world, strict=True) if not null}
    assert posed == {"drive"}
    assert [entry["name"] for entry in json.loads(table.schema.metadata[b"lidarcli.source"])] == [
        "c.bag",
        "drive.db3",
        "run 1.mcap",
    ]
    batches = list(lidarcli.read(folder))
    assert Counter(batch.log for batch in batches).keys() == rows.keys()
    assert lidarcli.detect(batches)["log"].to_pylist() == table["log"].to_pylist()
    one, two = folder / "drive.db3", folder / "run 1.mcap"
    assert lidarcli.detect([one, two]).num_rows == rows["drive"] + rows["run 1"]
    # What opens one log says so of a folder of several.
    with pytest.raises(UnreadableError, match=r"logs: a folder of several logs; name one of them$"):
        open_log(folder)


def test_a_part_of_a_bag_among_other_logs_makes_no_bag(tmp_path: Path) -> None:
    """One file `NAME_0.db3` made one bag of all databases in its folder, and the other logs were not mentioned."""
    folder = logs_apart(tmp_path / "logs")
    (folder / "drive.db3").rename(folder / "drive_0.db3")
    assert [source.name for source in find_logs([str(folder)])] == ["deep/c", "drive_0", "run 1"]
    assert set(lidarcli.detect(folder)["log"].to_pylist()) == {"deep/c", "drive_0", "run 1"}
    # Beside a metadata.yaml it is a bag, and what is no part of it is told.
    bag = tmp_path / "bag"
    shutil.copytree(SAMPLES / "hall", bag)
    for name in ("c.bag", "t.csv"):
        (bag / name).touch()
    report = ReadReport()
    with open_log(bag) as log:
        assert list(log.messages((), report)) == []
        assert report.notes == ["no part of this bag, and not read: c.bag, t.csv"]


def test_one_bad_log_of_several_is_warned_of_in_python(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    write_log(folder / "run.mcap", [block()])
    (folder / "cut.mcap").write_bytes(b"\0\1\2nothing")
    (folder / "link.mcap").symlink_to(folder / "gone")
    words = rf"^{re.escape(str(folder))}/(cut\.mcap: not a log lidarcli knows|link\.mcap: cannot be opened: No such file)"
    for read in (lidarcli.detect, lambda path: list(lidarcli.read(path))):
        with pytest.warns(UserWarning, match=words) as caught:
            assert len(read(folder)) > 0
        assert len(caught) == 2
    with pytest.raises(UnreadableError, match=r"cut\.mcap: not a log lidarcli knows"):
        lidarcli.detect(folder / "cut.mcap")


def test_logs_of_one_name_stay_apart_in_python(tmp_path: Path) -> None:
    paths = [tmp_path / name / "run.mcap" for name in "ab"]
    for path in paths:
        path.parent.mkdir()
        write_log(path, [block()])
    assert set(lidarcli.detect(paths)["log"].to_pylist()) == set(map(str, paths))


def test_what_python_says_of_wrong_arguments(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [block("/scan")])
    assert lidarcli.detect(path, topic="/scan").num_rows == 4
    assert lidarcli.detect(path, max_width=0.1).num_rows == 0
    assert lidarcli.detect(path, profile="paper").schema.metadata[b"lidarcli.parameters"].count(b'"paper"') == 1
    for call, error, words in (
        (
            lambda: lidarcli.detect(path, max_widht=1),
            TypeError,
            "detect() has no option 'max_widht'; did you mean 'max_width'?",
        ),
        (lambda: lidarcli.detect(path, Parameters(), max_width=1), TypeError, "give either parameters or max_width"),
        (lambda: lidarcli.detect([1]), TypeError, "logs, files and outputs are named by their paths, not given as int"),
        *(
            (partial(call, log), TypeError, f"logs, files and outputs are named by their paths, not given as {kind}")
            for call in (lidarcli.track, lidarcli.detect, lidarcli.tables)
            for log, kind in ((None, "NoneType"), (5, "int"), ([None], "NoneType"))
        ),
        (lambda: lidarcli.detect(path, path), TypeError, "parameters have to be Parameters, not PosixPath"),
        (lambda: lidarcli.read(path, every=0), OptionError, "--every: 0 is below 1"),
        (lambda: lidarcli.map(path, resolution="5 cm"), OptionError, "--resolution: '5 cm' is no number"),
        (lambda: lidarcli.map(path, voxel=float("nan")), OptionError, "--voxel: nan is not a finite number"),
        (lambda: lidarcli.map(path, min_hits=1.5), OptionError, "--min-hits: 1.5 is no whole number"),
        (
            lambda: lidarcli.read(path, start=float("nan")),
            OptionError,
            "--start: nan is neither a number of seconds nor a text such as 2min, 14:02, 2026-11-22T10:00:00Z",
        ),
        (
            lambda: lidarcli.read(path, end=datetime(2026, 11, 22, tzinfo=UTC)),
            OptionError,
            "--end: datetime.datetime(2026, 11, 22, 0, 0, tzinfo=datetime.timezone.utc) is neither a number of seconds "
            "nor a text such as 2min, 14:02, 2026-11-22T10:00:00Z",
        ),
        (lambda: lidarcli.read(path, start=5, end=1), OptionError, "--start 5 is not before --end 1"),
        (
            lambda: lidarcli.detect(path, background=[]),
            OptionError,
            "a background of no sensor: nothing can be compared with it",
        ),
        (lambda: lidarcli.read(tmp_path / "no"), UnreadableError, f"{tmp_path}/no: no such file or folder"),
    ):
        with pytest.raises(error) as caught:
            call()
        assert str(caught.value) == words


def test_strings_and_lists_say_the_same(tmp_path: Path) -> None:
    """A string was taken for a list of its letters."""
    path = tmp_path / "run.mcap"
    write_log(path, [block("/a"), block("/b")])
    for topic in ("/a", "a", ["/a"], ("/a",), {"/a"}, (name for name in ["/a"])):
        assert set(lidarcli.detect(path, topic=topic)["topic"].to_pylist()) == {"/a"}
    for topic in (None, [], ["/a", "/b"]):
        assert set(lidarcli.detect(path, topic=topic)["topic"].to_pylist()) == {"/a", "/b"}
    with pytest.raises(lidarcli.NoScanError, match="no LaserScan topic /scan in this log"):
        lidarcli.detect(path, topic="/scan")
    for source in (path, str(path), [path], [str(path)], str(tmp_path), str(tmp_path / "*.mcap")):
        assert lidarcli.detect(source).num_rows == 8
        assert sum(len(batch) for batch in lidarcli.read(source)) == 8


def test_times_and_topics_are_told_as_on_the_command_line() -> None:
    room = SAMPLES / "room.mcap"
    (batch,) = lidarcli.read(room, start="2023-11-14T22:13:21Z", end="1500ms", topic="/sc*")
    assert (batch.sweep[0], batch.sweep[-1]) == (10, 14)
    assert lidarcli.detect(room, topic=["/sc*"], end="0.1s").num_rows == 5
    with pytest.raises(OptionError, match=r"^--start: "):
        lidarcli.read(room, start="tomorrow")


def test_ranges_are_judged_as_on_the_command_line(tmp_path: Path) -> None:
    room = SAMPLES / "room.mcap"

    def counts(**options: object) -> list[int]:
        status = next(lidarcli.read(room, **options)).status
        return np.bincount(status.ravel(), minlength=4).tolist()

    usual, near = counts(), counts(range=(0.1, 4.0))
    assert sum(usual) == sum(near)
    assert near[lidarcli.Status.NO_RETURN] > usual[lidarcli.Status.NO_RETURN]
    assert counts(range=[0.1, 4]) == near
    strict = counts(range=(0.1, 4.0), no_return="inf,zero")
    assert strict == counts(range=(0.1, 4.0), no_return=["inf", "zero"]) != near
    ranges = next(lidarcli.read(room)).ranges
    marked = counts(no_return=["inf", "zero", "max", "above", float(ranges[0, 0])])
    assert marked[lidarcli.Status.NO_RETURN] > usual[lidarcli.Status.NO_RETURN]


def test_angles_are_radians_unless_they_are_said_to_be_degrees(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time,r0,r1,r2\n1,1234,500,inf\n")
    (batch,) = lidarcli.read(path, fov=180, degrees=True, range_unit="mm", range_max=5)
    assert batch.bearings[0].tolist() == pytest.approx([-np.pi / 2, 0, np.pi / 2])
    assert batch.ranges[0, :2].tolist() == pytest.approx([1.234, 0.5])
    (other,) = lidarcli.read(path, fov=np.pi, range_unit="mm", range_max=5)
    np.testing.assert_array_equal(batch.bearings, other.bearings)
    empty = SAMPLES / "room_empty.mcap"
    (one,) = lidarcli.background(empty, station_angle=10.0, station_distance=0.5)
    assert (one.angle, one.distance) == (np.deg2rad(10.0), 0.5)


def test_a_background_and_how_it_is_compared() -> None:
    learned = lidarcli.background(SAMPLES / "room_empty.mcap")
    there, gone = (
        lidarcli.detect(SAMPLES / "room.mcap", background=learned, removed=removed, end=1.0) for removed in (False, True)
    )
    assert set(there["change"].to_pylist()) == {"appeared"}
    assert gone.num_rows >= there.num_rows


def test_why_an_object_is_a_thing_is_told_of_batches_too() -> None:
    room = SAMPLES / "room.mcap"
    (batch,) = lidarcli.read(room, end=1.0)
    told = lidarcli.detect(batch, explain=True)["why"].to_pylist()
    assert told == lidarcli.detect(room, end=1.0, explain=True)["why"].to_pylist()
    assert all(told)
    assert not any(lidarcli.detect(batch)["why"].to_pylist())


def test_warnings_name_the_line_that_called(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    write_log(folder / "run.mcap", [block()])
    (folder / "cut.mcap").write_bytes(b"\0\1\2nothing")
    for call in (
        lidarcli.detect,
        lidarcli.track,
        lidarcli.info,
        lambda path: [*lidarcli.read(path)],
        lambda path: lidarcli.detect(lidarcli.read(path)),
    ):
        with pytest.warns(UserWarning, match=r"cut\.mcap: not a log lidarcli knows") as caught:
            call(folder)
        assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.parametrize(
    ("options", "note"),
    [
        ({"angle_min": -1.0}, "no effect on this log: --angle-min"),
        ({"echo": "last"}, "no effect on this log: --echo"),
        ({"pose_delay": 0.1}, "no poses in this log: --pose-delay changes nothing"),
    ],
)
def test_options_that_change_nothing_are_warned_of(options: dict[str, Any], note: str, tmp_path: Path) -> None:
    path, zone = tmp_path / "run.mcap", tmp_path / "zone.toml"
    write_log(path, [block()])
    zone.write_text('[[zone]]\nname = "near"\ncircle = { x = 1.0, y = 0.0, radius = 0.5 }\n')
    for call in (
        lidarcli.detect,
        lidarcli.track,
        lambda *log, **more: [*lidarcli.read(*log, **more)],
        partial(lidarcli.zones, zones=zone, no_objects=True),
        partial(lidarcli.overlay, output=tmp_path / "shown.mcap", overwrite=True),
    ):
        with pytest.warns(UserWarning, match=rf"run\.mcap: {note}$") as caught:
            call(path, **options)
        assert len(caught) == 1
    with pytest.warns(UserWarning, match=r"no effect on this log: --columns$"):
        lidarcli.track(path, columns="2")


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


COMMANDS = (
    *("background", "clean", "detect", "diff", "export", "info", "map", "overlay"),
    *("plot", "poses", "report", "simulate", "track", "zones"),
)
FUNCTIONS = (*COMMANDS, "read", "tables")
READING = {*COMMANDS} - {"export", "plot", "report"}
"""Functions that tell how far they are."""
_TABLES = "tables are returned; `pyarrow.parquet.write_table` makes files that every command reads"
_CHECKS = "`report(result, check=...)` holds results against conditions"
SHELL = {
    **dict.fromkeys(("help-all", "verbose", "quiet"), "what is said on a terminal"),
    **dict.fromkeys(("config", "format", "brief"), "how the command line gets its values, and prints its results"),
    **dict.fromkeys(("files-from", "base", "shard", "dry-run"), "which of many logs: Python has lists"),
    **dict.fromkeys(("resume", "partition", "cluster"), "how many tables are written into a folder"),
    "init": "writes the file of checks for the command line",
}
"""Options that make sense in a shell alone, and why."""
SHELL_OF = {
    **{(each, name): _TABLES for each in ("detect", "track", "background subtract") for name in ("output", "overwrite")},
    **{(each, name): _CHECKS for each in ("diff", "zones") for name in ("check", "checks")},
    **{
        (each, "stamps"): "`export` and Arrow convert tables in memory"
        for each in ("detect", "track", "background subtract", "zones", "map", "poses", "clean")
    },
    ("map", "jobs"): "Python works in its own process",
    **dict.fromkeys(
        (("info", "check"), ("info", "output"), ("info", "overwrite")),
        "what is returned has the findings, and their fixes as text",
    ),
    ("poses", "check"): "the column map_state tells",
}
"""Those of one command."""
OWN = {"log", "tables", "scene", "before", "after", "parameters", "axes", "progress"}
"""What stands in the place of the arguments of a command, and what only Python has."""
REPLACE = {"background", "map", "plot", "report"}
"""Functions that replace files: cells of a notebook run again."""


def options_of(command: str) -> dict[str, click.Option]:
    return {
        max(option.opts, key=len).removeprefix("--"): option
        for option in dict(commands())[command].params
        if isinstance(option, click.Option)
    }


@pytest.mark.parametrize("command", [name for name, _ in commands() if name.split()[0] in COMMANDS])
def test_every_option_of_a_command_is_a_keyword_of_its_function_with_its_default(command: str) -> None:
    """`background subtract` is `detect(background=...)`."""
    function = "detect" if command == "background subtract" else command.split()[0]
    keywords = inspect.signature(getattr(lidarcli, function)).parameters
    options = {
        option.field: option
        for name, option in options_of(command).items()
        if isinstance(option, DeclaredOption) and name not in SHELL and (command, name) not in SHELL_OF
    }
    assert options.keys() - keywords.keys() == set()
    # The logs of a report are no argument of its command.
    assert keywords.keys() - options.keys() == keywords.keys() & OWN - ({"log"} if function == "report" else set())
    for name, option in options.items():
        if isinstance(option.default, int | float | str) and name != "output":
            default = keywords[name].default
            expected = function in REPLACE if name == "overwrite" else option.default != option.declared.is_negated
            assert default == (expected if isinstance(default, bool) else option.default), name
            assert type(default) in (bool, int, float, str, tuple)


def test_what_only_the_shell_has_is_there() -> None:
    known = {(command, name) for command, _ in commands() for name in options_of(command)}
    assert {*SHELL} <= {name for _, name in known}
    assert {*SHELL_OF} <= known
    assert {command.split()[0] for command, _ in commands()} - {*COMMANDS} == {"config", "completion"}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_keyword_is_in_the_signature_and_explained(name: str) -> None:
    function = getattr(lidarcli, name)
    words = inspect.getdoc(function)
    for parameter in inspect.signature(function).parameters.values():
        assert parameter.kind is not parameter.VAR_KEYWORD
        assert (parameter.kind is parameter.VAR_POSITIONAL) == (parameter.name == "after")
        assert re.search(rf"^{parameter.name} : \S", words, re.MULTILINE), parameter.name
    assert ("progress" in inspect.signature(function).parameters) == (name in {*READING, "tables"})
    assert "\nReturns\n-------\n" in words
    assert "\nRaises\n------\n" in words


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_name_is_told_with_the_nearest(name: str) -> None:
    """The internal class was named."""
    with pytest.raises(TypeError) as caught:
        getattr(lidarcli, name)("run.mcap", outptu=1, tpoic="/scan")
    assert str(caught.value) in (
        f"{name}() has no option 'outptu'; did you mean 'output'?",
        f"{name}() has no option 'outptu'; there are " + ", ".join(inspect.signature(getattr(lidarcli, name)).parameters),
    )
    if name != "report":
        with pytest.raises(TypeError, match=rf"^{name}\(\) has no option 'topcis'"):
            getattr(lidarcli, name)("run.mcap", topcis="/scan")


def test_the_public_names_are_there_and_typed() -> None:
    tree = ast.parse(Path(lidarcli.__file__).read_text(encoding="utf-8"))
    typed = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    told = {alias.name: node.module for node in typed.body for alias in node.names}
    assert told.pop("formalism") == "lidarcli"
    assert told == lidarcli._HOME
    assert {*told, "formalism", "__version__"} == {*lidarcli.__all__} == {*dir(lidarcli)}
    for name in lidarcli.__all__:
        assert getattr(lidarcli, name) is not None
    assert issubclass(lidarcli.UnreadableError, lidarcli.LidarcliError)
    assert lidarcli.Parameters(max_width=1.0) == lidarcli.formalism.Parameters(max_width=1.0)
    with pytest.raises(AttributeError, match=r"^module 'lidarcli' has no attribute 'nonsense'$"):
        _ = lidarcli.nonsense


def test_importing_the_package_imports_no_work() -> None:
    code = (
        "import sys, lidarcli; dir(lidarcli); "
        "print(sorted(m for m in sys.modules if m.startswith('lidarcli'))); "
        "lidarcli.detect; print([m for m in ('pandas', 'matplotlib', 'click', 'rich') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[1] == "[]"
    first = set(ast.literal_eval(done.stdout.splitlines()[0]))
    assert first <= {"lidarcli", "lidarcli._version", "lidarcli.system.compiled"}


def test_functions_stay_when_packages_of_like_names_are_imported() -> None:
    """`import lidarcli.poses.fit` made of a function a module that cannot be called."""
    code = (
        "import importlib, pkgutil, lidarcli; "
        "names = [each.name for each in pkgutil.iter_modules(lidarcli.__path__)]; "
        "[importlib.import_module(f'lidarcli.{name}') for name in names if name != '__main__']; "
        "from lidarcli.pose import fit; from lidarcli.simulation import run; "
        "print([name for name in lidarcli.__all__ if type(getattr(lidarcli, name)).__name__ == 'module'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "['formalism']\n"


def test_a_function_for_each_command() -> None:
    """Beside them only `read`, `tables` for data frames, and the paper's definitions of one batch."""
    functions = {name for name in lidarcli.__all__ if inspect.isfunction(getattr(lidarcli, name))}
    assert functions == {*FUNCTIONS, "read_catalogue", *definitions.__all__}
    assert {*COMMANDS} <= {name.removesuffix(" build") for name, _ in commands()}


@pytest.mark.parametrize(
    "call",
    [
        lambda: lidarcli.report([""]),
        *(lambda: lidarcli.report("t", baseline=""), lambda: lidarcli.diff("a.mcap", ""), lambda: lidarcli.clean("a", "")),
        *(lambda: lidarcli.track("a.mcap", columns=""), lambda: lidarcli.track(iter([""]))),
    ],
)
def test_an_empty_text_is_no_folder(call: Callable[[], object]) -> None:
    with pytest.raises(lidarcli.OptionError, match="an empty text names nothing"):
        call()
