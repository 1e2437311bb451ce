"""`lidarcli track`: files, streams, summary; what it shares with `detect`, and what it has beside."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from lidarcli.pipeline.objects import tracking
from lidarcli.pipeline.runs import over_logs
from lidarcli.tabular import SCHEMAS
from tests.pipeline.patient import Patient
from tests.places import SAMPLES

Run = Callable[..., Any]
TABLES = ("objects", "sweeps", "tracks", "trajectories")


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second object is an agent."""
    monkeypatch.setattr(tracking, "Tracker", Patient)


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.parquet"))


def test_tables_and_summary(logs: Path, tmp_path: Path, lidarcli: Run, patient: None) -> None:
    ran = lidarcli("track", logs / "run.mcap", "-o", tmp_path, "--beams")
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{logs / 'run.mcap'}: 20 sweeps, 30 objects (10 of agents), 2 tracks (1 agent)")
    assert lines[2] == "  on       agents 300 (4.2%), other objects 400 (5.6%), walls and rest 6,500 (90.3%)"
    assert lines[5:] == [
        "  note     2 things in 20 sweeps of /scan",
        f"  wrote    {tmp_path}/run.{{objects,sweeps,tracks,trajectories,beams}}.parquet",
    ]
    for table in (*TABLES, "beams"):
        assert pq.read_schema(tmp_path / f"run.{table}.parquet").equals(SCHEMAS[table])
    objects = pq.read_table(tmp_path / "run.objects.parquet")
    assert Counter(zip(objects["track"].to_pylist(), objects["set"].to_pylist(), strict=True)) == {
        (1, "O"): 20,
        (2, "A"): 10,
    }
    assert objects["t"].to_pylist()[-1] == 1.9


def test_detect_does_not_import_the_tracker(logs: Path, tmp_path: Path) -> None:
    code = (
        f"import sys; from lidarcli.cli import run; run(['-q', 'detect', {str(logs / 'run.mcap')!r}, '-o', "
        f"{str(tmp_path)!r}]); print(sorted(name for name in sys.modules if 'track' in name))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    # The columns of what is found are declared there, and nothing else of tracking is there.
    assert ran.stdout == "['lidarcli.formalism.tracking', 'lidarcli.formalism.tracking.results']\n"


def test_several_logs_by_processes_give_the_same_bytes(
    logs: Path, tmp_path: Path, lidarcli: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    for jobs in ("1", "2"):
        if jobs == "2":
            monkeypatch.setattr(over_logs, "WORTH_A_PROCESS", 1)
        ran = lidarcli("track", logs / "run.mcap", logs / "two.mcap", "-o", tmp_path / jobs, "--jobs", jobs, "--beams")
        assert ran.code == 0
        assert ran.err.splitlines()[-1].startswith("2 logs: 60 sweeps, 90 objects (0 of agents), ")
    assert len(names(tmp_path / "1")) == 2 * (len(TABLES) + 1)
    for name in names(tmp_path / "1"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_a_background_leaves_what_differs(tmp_path: Path, lidarcli: Run, patient: None) -> None:
    background = tmp_path / "b.parquet"
    assert lidarcli("-q", "background", "build", SAMPLES / "room_empty.mcap", "-o", background).code == 0
    ran = lidarcli("track", SAMPLES / "room.mcap", "--background", background, "--walls", "--end", "0.5", "-o", tmp_path)
    assert ran.code == 0
    assert "  note     compared with b.parquet: 25 appeared" in ran.err.splitlines()
    rows = pq.read_table(tmp_path / "room.objects.parquet").to_pylist()
    assert {row["change"] for row in rows if row["track"] is not None} == {"appeared"}
    assert {row["set"] for row in rows if row["track"] is None} == {"S"}
    assert len({row["track"] for row in rows} - {None}) == 5


def test_one_file_holds_the_objects_of_all_logs(logs: Path, tmp_path: Path, lidarcli: Run, patient: None) -> None:
    path = tmp_path / "all.csv"
    ran = lidarcli("track", logs / "run.mcap", logs / "two.mcap", "-o", path)
    assert ran.code == 0
    assert f"  wrote    {path}" in ran.err.splitlines()
    assert [item.name for item in tmp_path.iterdir()] == [path.name]
    rows = [row["moving"] for row in csv.DictReader(io.StringIO(path.read_text()))]
    assert Counter(rows) == {"False": 60, "True": 30}


def test_sweeps_that_decide_alone_are_told(tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("-v", "track", SAMPLES / "drive.db3", "--pose", "none", "-o", tmp_path)
    alone = "  note     /scan: 150 of 150 sweeps decide alone what is a thing: no path tells where the sensor is"
    assert alone in ran.err.splitlines()
    with_poses = lidarcli("-v", "track", SAMPLES / "drive.db3", "-o", tmp_path, "--overwrite")
    assert "decide alone" not in with_poses.err


def test_a_table_of_who_moved(tmp_path: Path, lidarcli: Run) -> None:
    """Of one log the agents, farthest first; of several only with -v."""
    log = SAMPLES / "people.csv.gz"
    words = ("track", log, "-o", tmp_path, "--overwrite")
    lines = lidarcli(*words).err.splitlines()
    at = next(at for at, line in enumerate(lines) if line.startswith("  agents   track"))
    rows = pq.read_table(tmp_path / "people.tracks.parquet").to_pandas()
    agents = rows[rows["set"] == "A"].sort_values("distance", ascending=False)
    shown = [line.split() for line in lines[at + 1 : at + 1 + len(agents)]]
    assert [int(each[0]) for each in shown] == agents.track.tolist()
    assert [float(each[5]) for each in shown] == pytest.approx(agents.distance.tolist(), abs=0.05)
    assert [float(each[7]) for each in shown] == pytest.approx(agents.speed_mean.tolist(), abs=0.05)
    assert [float(each[9]) for each in shown] == pytest.approx(agents.speed_max.tolist(), abs=0.05)
    assert all(len(line) <= 80 for line in lines[at : at + 1 + len(agents)])
    both = (*words, SAMPLES / "drive.db3")
    assert "  agents   track" not in lidarcli(*both).err
    assert "  agents   track" in lidarcli("-v", *both).err


def test_notes_wrap_between_words(tmp_path: Path, lidarcli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("-v", "track", SAMPLES / "drive.db3", "-o", tmp_path, "--overwrite")
    (whole,) = (line for line in lidarcli(*words).err.splitlines() if "poses from" in line)
    monkeypatch.setenv("COLUMNS", "60")
    lines = lidarcli(*words).err.splitlines()
    at = next(at for at, line in enumerate(lines) if "poses from" in line)
    first, *more = lines[at : at + 3]
    assert max(len(first), *map(len, more)) <= 60
    assert all(line.startswith(" " * 11) and line[11] != " " for line in more)
    assert " ".join([first, *(line.strip() for line in more)]) == whole
    assert any("--pose TOPIC" in line for line in more)
