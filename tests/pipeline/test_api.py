"""The functions of the package for Python: `detect`, `read`, and what they warn of and refuse."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism import Parameters
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
        (
            lambda: lidarcli.read(path, start=float("nan")),
            OptionError,
            "--start: nan is neither a number of seconds nor a text such as 2min or 2026-11-22T10:00:00Z",
        ),
        (
            lambda: lidarcli.read(path, end=datetime(2026, 11, 22, tzinfo=UTC)),
            OptionError,
            "--end: datetime.datetime(2026, 11, 22, 0, 0, tzinfo=datetime.timezone.utc) is neither a number of seconds "
            "nor a text such as 2min or 2026-11-22T10:00:00Z",
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
    for options, words in (
        ({"no_return": "none"}, "--no-return: 'none' is neither a number nor one of"),
        ({"range_unit": "km"}, "--range-unit: 'km' is not one of m, cm, mm"),
        ({"fov": 1.0, "angle_increment": 1.0}, "--angle-increment and --fov exclude each other"),
    ):
        with pytest.raises(OptionError, match=re.escape(words)):
            lidarcli.read(room, **options)


@pytest.mark.parametrize(
    ("call", "told", "words"),
    [
        (lidarcli.map, {"resolution": 0}, "--resolution: 0 is below 0.001"),
        (lidarcli.map, {"resolution": "5 cm"}, "--resolution: '5 cm' is no number"),
        (lidarcli.map, {"voxel": float("nan")}, "--voxel: nan is not a finite number"),
        (lidarcli.map, {"min_hits": 1.5}, "--min-hits: 1.5 is no whole number"),
        (lidarcli.plot, {"dpi": 1}, "--dpi: 1 is below 30"),
        (lidarcli.plot, {"output": "room.gif"}, "room.gif: the suffix has to be one of .png, .svg, .pdf"),
    ],
)
def test_numbers_have_the_limits_of_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Callable[..., object], told: dict[str, Any], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OptionError, match=f"^{re.escape(words)}$"):
        call(SAMPLES / "room.mcap", **told)
    assert list(tmp_path.iterdir()) == []


def test_angles_are_radians_unless_they_are_said_to_be_degrees(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time,r0,r1,r2\n1,1234,500,inf\n")
    (batch,) = lidarcli.read(path, fov=180, degrees=True, range_unit="mm", range_max=5)
    assert batch.bearings()[0].tolist() == pytest.approx([-np.pi / 2, 0, np.pi / 2])
    assert batch.ranges[0, :2].tolist() == pytest.approx([1.234, 0.5])
    (other,) = lidarcli.read(path, fov=np.pi, range_unit="mm", range_max=5)
    np.testing.assert_array_equal(batch.bearings(), other.bearings())
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
    with pytest.raises(OptionError, match=r"^--removed is for --background FILE$"):
        lidarcli.detect(SAMPLES / "room.mcap", removed=True)
    told = lidarcli.detect(SAMPLES / "room.mcap", background=learned, station_angle=90.0, end=0.5)
    how = json.loads(told.schema.metadata[b"lidarcli.parameters"])["background"]
    assert how["station_angle"] == pytest.approx(np.pi / 2)


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
