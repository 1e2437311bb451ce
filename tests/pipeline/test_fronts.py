"""The command line and the functions for Python take the same options: they refuse alike, and write the same bytes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from tests.places import SAMPLES

ROOM, DRIVE, PEOPLE = SAMPLES / "room.mcap", SAMPLES / "drive.db3", SAMPLES / "people.csv.gz"
Front = Callable[..., tuple[int, str]]


def words_of(options: dict[str, Any]) -> list[str]:
    """Keywords as the command line has them: a tuple takes several words, a list repeats the option."""
    words: list[str] = []
    for name, value in options.items():
        spelled = name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{'' if value else 'no-'}{spelled}")
            continue
        for one in value if isinstance(value, list) else [value]:
            words += [f"--{spelled}", *map(str, one if isinstance(one, tuple) else (one,))]
    return words


@pytest.fixture(params=["command", "python"])
def front(request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str]) -> Front:
    """Call a command or a function with the same options; returns the exit code, and what it says of an error."""

    def by_command(name: str, *inputs: object, **options: Any) -> tuple[int, str]:
        command = ["background", "build"] if name == "background" else [name]
        code = run(["-q", *command, *map(str, inputs), *words_of(options)])
        return code, capfd.readouterr().err.strip()

    def by_python(name: str, *inputs: object, **options: Any) -> tuple[int, str]:
        try:
            getattr(lidarcli, name)(*inputs, **options)
        except lidarcli.LidarcliError as err:
            return err.exit_code, str(err)
        return 0, ""

    return by_command if request.param == "command" else by_python


TO_FIND = "is for finding objects, and --objects names some that have been found"


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("detect", {"threshold": "big"}, "'big' is (neither|not) adaptive"),
        ("detect", {"profile": "fast"}, "'fast' is not one of "),
        ("detect", {"min_beams": 0}, "--min-beams.*: 0 is below 1"),
        ("detect", {"every": 10**20}, "--every.*: 1.* is above 1000000"),
        ("detect", {"range_max": 1e308}, "--range-max.*: 1e.308 is above 1e.06"),
        ("detect", {"start": "1e300"}, "--start.*: '1e300' is more than 1e.09 seconds"),
        ("detect", {"start": 5, "end": 5}, "--start 5 is not before --end 5"),
        ("detect", {"no_return": "zero,1e308"}, "--no-return.*: 1e.308 is no range"),
        ("detect", {"no_return": "none"}, "--no-return.*: 'none' is neither a number nor one of"),
        ("detect", {"range_unit": "km"}, "--range-unit.*: 'km' is not one of "),
        ("detect", {"fov": 12.6}, "--fov.*: 12.6 radians are more than two turns; --degrees says that angles are degrees"),
        ("detect", {"angle_increment": 0}, "--angle-increment.*: 0 is no step from beam to beam"),
        ("detect", {"range": (5, 1)}, "--range"),
        ("detect", {"fov": 3, "angle_increment": 1}, "--angle-increment and --fov exclude each other"),
        ("detect", {"pose": "/odom", "poses": "a.tum"}, "--pose and --poses exclude each other"),
        ("detect", {"any_frame": True}, "--any-frame is for --background FILE"),
        ("detect", {"removed": True}, "--removed is for --background FILE"),
        ("map", {"output": "m.yaml", "resolution": 0}, "--resolution.*: 0 is below 0.001"),
        ("zones", {"zones": "z.toml", "objects": "o.parquet", "max_width": 1}, f"--max-width {TO_FIND}"),
        (
            "zones",
            {"zones": "z.toml", "no_objects": True, "catalogue": "c.toml"},
            "--catalogue is for finding objects, and --no-objects finds none",
        ),
        ("zones", {"zones": "z.toml", "no_objects": True, "objects": "o.parquet"}, "--objects and --no-objects exclude"),
        ("overlay", {"output": "o.mcap", "objects": "o.parquet", "max_width": 1}, f"--max-width {TO_FIND}"),
        ("overlay", {"output": "o.mcap", "objects": "o.parquet", "topic": "/scan"}, f"--topic {TO_FIND}"),
        ("overlay", {"output": "o.txt"}, r"o\.txt: the suffix of an overlay has to be one of"),
        ("poses", {"output": "a.csv"}, r"a\.csv: the suffix of a trajectory has to be one of"),
        ("plot", {"output": "room.gif"}, r"room\.gif: the suffix has to be one of \.png, \.svg, \.pdf"),
        ("plot", {"dpi": 1}, "--dpi.*: 1 is below 30"),
        ("plot", {"deskew": False}, "--no-deskew is for --view map"),
        ("plot", {"trail": 1}, "--trail is for the paths of --tracks"),
        ("plot", {"tracks": "t.parquet", "view": "sweep"}, "--tracks is drawn in the scene"),
        ("plot", {"zones": "z.toml", "view": "sweep"}, "--zones is drawn in the scene"),
        ("plot", {"vertices": True, "view": "sweep"}, "--vertices is for the scene"),
    ],
)
def test_options_are_refused_in_the_same_words(
    front: Front, name: str, options: dict[str, Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, err = front(name, ROOM, **options)
    assert (code, re.search(words, err.splitlines()[-1]) is not None) == (2, True), err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("detect", {}),
        *(("track", {}), ("background", {"output": "b.parquet"}), ("map", {"output": "m.yaml"}), ("info", {})),
        *(("poses", {"output": "p.tum"}), ("clean", {"output": "c.mcap"}), ("overlay", {"output": "o.mcap"})),
        *(("plot", {}), ("report", {"output": "r.html"}), ("export", {"output": "e.csv"})),
    ],
)
@pytest.mark.parametrize(
    ("named", "code", "words"), [("no.mcap", 3, "no.mcap: no "), ("", 2, "an empty text names nothing")]
)
def test_what_is_not_there_is_named(
    front: Front, name: str, options: dict[str, Any], named: str, code: int, words: str, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    found, err = front(name, named, **options)
    assert (found, words in err) == (code, True), err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "given", "output", "options"),
    [
        ("poses", DRIVE, "a.parquet", {}),
        ("poses", DRIVE, "a.tum", {"every": 3}),
        ("simulate", SAMPLES / "room.toml", "a.mcap", {"sweeps": 3, "seed": 7}),
        ("background", SAMPLES / "room_empty.mcap", "a.parquet", {"station_angle": 10.0, "station_distance": 0.5}),
        ("plot", ROOM, "a.svg", {"sweep": 34, "view": "scene", "max_width": 1.0}),
        ("clean", ROOM, "a.mcap", {"remove": "none", "mend": "stamps", "pose": "none"}),
        pytest.param("map", DRIVE, "a.pgm", {"resolution": 0.1, "min_move": 0.2}, marks=pytest.mark.slow),
        pytest.param("overlay", PEOPLE, "a.mcap", {"end": 1, "max_width": 1.5}, marks=pytest.mark.slow),
        pytest.param("diff", (SAMPLES / "room_empty.mcap", ROOM), "a.csv", {"min_score": 0.9}, marks=pytest.mark.slow),
    ],
)
def test_files_are_the_same(name: str, given: Any, output: str, options: dict[str, Any], tmp_path: Path) -> None:
    inputs = given if isinstance(given, tuple) else (given,)
    folders = [tmp_path / name for name in ("python", "command")]
    files = [folder / output for folder in folders]
    named = [file.with_suffix(".yaml") if file.suffix == ".pgm" else file for file in files]
    for folder in folders:
        folder.mkdir()
    getattr(lidarcli, name)(*inputs, output=named[0], **options)
    command = ["background", "build"] if name == "background" else [name]
    assert run(["-q", *command, *map(str, inputs), "-o", str(named[1]), *words_of(options)]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert [each.name for each in folders[0].iterdir() if "cleaned" not in each.name] == [
        each.name for each in folders[1].iterdir() if "cleaned" not in each.name
    ]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("detect", {"start": 0.1, "topic": ["/sc*"], "range": (0.1, 4.0), "no_return": "inf,zero", "end": "1500ms"}),
        ("detect", {"profile": "paper", "threshold": 0.5, "min_beams": 2, "walls": True, "every": 2}),
        ("detect", {"background": SAMPLES / "room_empty.mcap", "removed": True, "station_angle": 90.0, "end": 0.5}),
        ("track", {"end": "2023-11-14T22:13:21Z", "agent_score": 0.8, "memory": False, "explain": True}),
    ],
)
def test_tables_are_the_same(name: str, options: dict[str, Any], tmp_path: Path) -> None:
    if log := options.get("background"):
        options = {**options, "background": tmp_path / "b.parquet"}
        lidarcli.background(log, options["background"])
    made = getattr(lidarcli, name)(ROOM, **options)
    assert run(["-q", name, str(ROOM), "-o", str(tmp_path), *words_of(options)]) == 0
    for kind, table in {"objects": made}.items() if name == "detect" else made._asdict().items():
        assert table.equals(pq.read_table(tmp_path / f"room.{kind}.parquet"), check_metadata=True)


def test_info_is_what_the_command_prints(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["-q", "info", str(ROOM), str(DRIVE), "--format", "json"]) == 0
    assert lidarcli.info([ROOM, DRIVE]) == json.loads(capfd.readouterr().out)
    (room,) = lidarcli.info(ROOM, range=(0.1, 4.0))
    assert room["scans"][0]["beams_by_status"]["no_return"] > 0
