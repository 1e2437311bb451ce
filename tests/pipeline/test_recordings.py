"""Tables go together by the recording that they are of, not by their names."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.sweeping import START, STEP, raw_sweeps, round_room
from tests.text_logs import write_log

Run = Callable[..., Any]
DAYS = 10 * 86_400 * 10**9
ZONE = '[[zone]]\nname = "near"\nframe = "sensor"\ncircle = { x = 0, y = 0, radius = 2.5 }\n'


def walked(path: Path, start: int = START, distance: float = 2.0) -> Path:
    """4 s in a round room, in which somebody walks around the sensor at a distance [m]."""
    ranges = round_room(40)
    for number in range(40):
        ranges[number, 60 + 3 * number : 72 + 3 * number] = distance
    ranges += np.random.default_rng(1).normal(0.0, 0.005, ranges.shape).astype(np.float32)
    path.parent.mkdir(exist_ok=True)
    write_log(path, [raw_sweeps(ranges, stamp_ns=start + STEP * np.arange(40))])
    return path


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of one name with their tables: of two days, and one with the stamps of the first."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("logs")
    (folder / "zones.toml").write_text(ZONE)
    for name, start, distance in (("monday", START, 2.0), ("friday", START + DAYS, 2.0), ("twin", START, 3.0)):
        log = str(walked(folder / name / "run.mcap", start, distance))
        assert run(["-q", "track", log, "-o", str(folder / name)]) == 0
        assert run(["-q", "zones", log, "--zones", str(folder / "zones.toml"), "-o", str(folder / name)]) == 0
    words = ["-q", "zones", str(folder / "monday" / "run.mcap"), "--zones", str(folder / "zones.toml"), "--end", "1s"]
    assert run([*words, "-o", str(folder / "part")]) == 0
    return folder


def mixed(logs: Path, folder: Path, notes: bool = True, **kinds: str) -> Path:
    """Tables of several logs in one folder, with their metadata or without."""
    for kind, name in kinds.items():
        shutil.copy(logs / name / f"run.{kind}.parquet", folder)
        if not notes:
            path = folder / f"run.{kind}.parquet"
            pq.write_table(pq.read_table(path).replace_schema_metadata(None), path)
    return folder


@pytest.mark.parametrize(
    ("zones", "events", "tracks", "words"),
    [
        ("friday", "friday", "monday", "run.zones.parquet: does not belong to run.sweeps.parquet: is of another recording"),
        ("twin", "twin", "monday", "run.zones.parquet: does not belong to run.sweeps.parquet: is of another recording"),
        ("monday", "twin", "monday", "run.events.parquet: does not belong to run.zones.parquet: is of another recording"),
        ("monday", "monday", "twin", "run.tracks.parquet: does not belong to run.sweeps.parquet: is of another recording"),
        ("part", "part", "monday", "is of another part of the log: make both with the same --start, --end"),
        ("monday", "monday", "monday", ""),
    ],
)
def test_a_report_takes_no_tables_of_two_recordings(
    logs: Path, zones: str, events: str, tracks: str, words: str, lidarcli: Run, tmp_path: Path
) -> None:
    folder = mixed(logs, tmp_path, sweeps="monday", objects="monday", tracks=tracks, zones=zones, events=events)
    ran = lidarcli("report", folder, "--check", "zones.near.events >= 0", "--check", "tracks >= 0", "--brief")
    assert (ran.code, words in " ".join(ran.err.split())) == (3 if words else 0, True)


def test_without_metadata_stamps_tell(logs: Path, lidarcli: Run, tmp_path: Path) -> None:
    folder = mixed(logs, tmp_path, False, sweeps="monday", objects="monday", zones="friday", events="friday")
    ran = lidarcli("report", folder, "--check", "zones.near.events >= 0")
    assert (ran.code, "has sweeps of other stamps: it is of another log" in ran.err) == (3, True)
    mixed(logs, tmp_path, False, zones="monday", events="monday")
    assert lidarcli("report", folder, "--check", "zones.near.events >= 0").code == 0


def test_metadata_tell_the_recording_whatever_is_read_of_it(logs: Path, lidarcli: Run, tmp_path: Path) -> None:
    def recording(path: Path) -> Any:
        return json.loads(pq.read_schema(path).metadata[b"lidarcli.source"])["recording"]

    found = {name: recording(logs / name / "run.sweeps.parquet") for name in ("monday", "friday", "twin")}
    assert len({json.dumps(each) for each in found.values()}) == 3
    assert recording(logs / "part" / "run.zones.parquet") == found["monday"]
    words = ("--start", 1, "--every", 3, "--range", 0.5, 5, "-o", tmp_path)
    assert lidarcli("-q", "detect", logs / "monday" / "run.mcap", *words).code == 0
    assert recording(tmp_path / "run.objects.parquet") == found["monday"]


@pytest.mark.slow
@pytest.mark.parametrize("view", ["scene", "map"])
def test_pictures_take_the_tracks_of_their_log(logs: Path, view: str, lidarcli: Run, tmp_path: Path) -> None:
    tracks = logs / "monday" / "run.tracks.parquet"
    more = ("--sweep", 20) if view == "scene" else ("--pose", "match")
    words = ("--view", view, *more, "--tracks", tracks, "-o", tmp_path / "a.png", "--overwrite")
    ran = lidarcli("plot", logs / "friday" / "run.mcap", *words)
    assert (ran.code, "not of this log" in ran.err) == (3, True)
    ran = lidarcli("plot", logs / "twin" / "run.mcap", *words)
    assert (ran.code, "of another recording" in ran.err) == (0, True)
    ran = lidarcli("plot", logs / "monday" / "run.mcap", *words)
    assert (ran.code, "recording" in ran.err) == (0, False)


@pytest.mark.parametrize("command", ["zones", "overlay"])
def test_objects_of_another_recording_with_the_same_stamps_are_told(
    logs: Path, command: str, lidarcli: Run, tmp_path: Path
) -> None:
    objects = logs / "monday" / "run.objects.parquet"
    more = ("--zones", logs / "zones.toml") if command == "zones" else ("-o", tmp_path / "out.mcap", "--overwrite")
    for name, code, told in (("twin", 0, True), ("monday", 0, False), ("friday", 3, False)):
        ran = lidarcli(command, logs / name / "run.mcap", "--objects", objects, *more)
        assert (ran.code, "of another recording with the same stamps" in ran.err) == (code, told)
    (tmp_path / "mixed").mkdir()
    folder = mixed(logs, tmp_path / "mixed", sweeps="monday", objects="monday", tracks="monday", trajectories="twin")
    ran = lidarcli(command, logs / "monday" / "run.mcap", "--objects", folder / "run.objects.parquet", *more)
    assert (ran.code, "run.trajectories.parquet: does not belong to" in ran.err) == (3, True)


def test_a_page_shows_the_log_of_its_tables(logs: Path, lidarcli: Run, tmp_path: Path) -> None:
    for name, code in (("twin", 3), ("friday", 3), ("monday", 0)):
        words = ("--log", logs / name / "run.mcap", "-o", tmp_path / "a.html", "--overwrite")
        ran = lidarcli("report", logs / "monday" / "run.objects.parquet", *words)
        assert (ran.code, "of another recording" in ran.err) == (code, code == 3)


def test_rows_of_two_recordings_of_one_name_are_told(logs: Path, lidarcli: Run, tmp_path: Path) -> None:
    first, second = (logs / name / "run.tracks.parquet" for name in ("monday", "twin"))
    assert "are of two recordings, both run.mcap" in lidarcli("export", first, second, "-o", tmp_path / "a.csv").err
    assert "two recordings" not in lidarcli("export", first, "-o", tmp_path / "b.csv").err
    ran = lidarcli("export", first, "--only", "99", "-o", tmp_path / "c.csv")
    assert (ran.code, "no track 99 in it" in ran.err, (tmp_path / "c.csv").exists()) == (2, True, False)


def test_a_baseline_of_another_recording_is_compared_by_figures(logs: Path, lidarcli: Run) -> None:
    tables = {name: logs / name / "run.objects.parquet" for name in ("monday", "friday", "twin")}
    for name in ("friday", "twin"):
        ran = lidarcli("report", tables[name], "--baseline", tables["monday"], "--check", "percent.sweeps == 0")
        assert (ran.code, "Two recordings: their figures are compared" in " ".join(ran.out.split())) == (0, True)
    ran = lidarcli("report", tables["monday"], "--baseline", tables["monday"], "--check", "changed_sweeps == 0")
    assert (ran.code, "Sweeps in both runs: 40" in ran.out) == (0, True)
