"""`lidarcli detect` and `track`: their tables, for several kinds of logs, masks, intensities and units of stamps."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.ipc
import pyarrow.parquet as pq
import pytest

import lidarcli
import lidarcli as package
from lidarcli.cli import run
from lidarcli.pipeline.objects import tracking
from lidarcli.pipeline.runs import over_logs
from lidarcli.simulation.writers import write_log
from lidarcli.tabular import OBJECTS, SCHEMAS
from lidarcli.tabular.columns import restamped
from tests.pipeline.patient import Patient
from tests.places import SAMPLES
from tests.sweeping import START, STEP, raw_sweeps, round_room
from tests.tabular.writing import shortest
from tests.waiting import HANG

Run = Callable[..., Any]


def test_tables_and_summary(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("detect", logs / "run.mcap", "-o", tmp_path / "out", "--beams")
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{logs / 'run.mcap'}: 20 sweeps, 30 objects")
    assert lines[1:3] == [
        "  beams    7,200: valid 7,180 (99.7%), no return 20 (0.3%)",
        "  on       objects 700 (9.7%), walls and rest 6,500 (90.3%)",
    ]
    names = ["run.objects.parquet", "run.sweeps.parquet", "run.beams.parquet"]
    assert lines[3:] == [f"  wrote    {tmp_path}/out/run.{{objects,sweeps,beams}}.parquet"]
    objects = pq.read_table(tmp_path / "out" / names[0])
    assert objects.schema.equals(OBJECTS)
    assert objects["beam_i"].to_pylist() == [40, 200] * 10 + [40] * 10
    assert pq.read_table(tmp_path / "out" / names[2]).num_rows == 7200


def test_options_reach_the_tables(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    options = "--profile paper --threshold 0.5 --min-beams 2 --max-width 3 --max-gap 1 --group-gap 0.1 --walls"
    options += " --topic /scan --start 0.5 --end 1.5 --every 2 --range 0.5 10 --no-return zero,50"
    assert lidarcli("-q", "detect", logs / "run.mcap", "-o", tmp_path, *options.split()).code == 0
    table = pq.read_table(tmp_path / "run.sweeps.parquet")
    assert table["sweep"].to_pylist() == [6, 8, 10, 12, 14]
    assert json.loads(table.schema.metadata[b"lidarcli.parameters"]) == {
        "profile": "paper",
        "threshold": 0.5,
        "min_beams": 2,
        "max_width": 3.0,
        "min_thing": 0.3,
        "max_gap": 1,
        "group_gap": 0.1,
        "walls": True,
        "topics": ["/scan"],
        "start": 0.5,
        "end": 1.5,
        "every": 2,
        "range": [0.5, 10.0],
        "no_return": ["zero", 50.0],
    }
    source = json.loads(table.schema.metadata[b"lidarcli.source"])
    assert source.pop("recording").keys() == {"/scan"}
    assert source == {"format": "mcap", "name": "run.mcap", "size": (logs / "run.mcap").stat().st_size}


def test_logs_below_a_folder_keep_their_place(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    tree, out = tmp_path / "tree", tmp_path / "out"
    for name in ("run.mcap", "a/run.mcap", "a/b/run.mcap"):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_bytes((logs / "run.mcap").read_bytes())
    (tree / "bad.bag").write_bytes(b"\0\1\2" * 99)
    ran = lidarcli("detect", tree, "-o", out, "--jobs", "2", code=3)
    found = sorted(path.relative_to(out).as_posix() for path in out.rglob("*.objects.parquet"))
    assert found == ["a/b/run.objects.parquet", "a/run.objects.parquet", "run.objects.parquet"]
    assert pq.read_table(out / "a/b/run.objects.parquet")["log"].to_pylist()[0] == "a/b/run"
    said = [line for line in ran.err.splitlines() if not line.startswith(" ")]
    assert [line.removeprefix("lidarcli: ").split(":")[0] for line in said[:-1]] == [
        str(tree / name) for name in ("a/b/run.mcap", "a/run.mcap", "bad.bag", "run.mcap")
    ]
    assert said[-1] == "4 logs, 1 with errors: 60 sweeps, 90 objects"


def expected_rows(logs: Path, tmp_path: Path, lidarcli: Run, log: str) -> list[dict[str, Any]]:
    assert lidarcli("-q", "detect", logs / log, "-o", tmp_path).code == 0
    rows: list[dict[str, Any]] = pq.read_table(next(tmp_path.glob("*.objects.parquet"))).to_pylist()
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("log", ["run.mcap", "two.mcap"])
@pytest.mark.parametrize("kind", ["arrow", "parquet", "ndjson", "csv"])
def test_streams_equal_the_table(logs: Path, tmp_path: Path, lidarcli: Run, process: Run, log: str, kind: str) -> None:
    expected = expected_rows(logs, tmp_path, lidarcli, log)
    files = pq.read_table(next(tmp_path.glob("*.objects.parquet")))
    ran = process("-q", "detect", logs / log, "-o", "-", "--format", kind)
    assert (ran.returncode, ran.stderr) == (0, b"")
    if kind == "arrow":
        assert pa.ipc.open_stream(ran.stdout).read_all().to_pylist() == expected
    elif kind == "parquet":
        table = pq.read_table(io.BytesIO(ran.stdout))
        assert table.to_pylist() == expected
        assert table.schema.equals(files.schema, check_metadata=True)
    elif kind == "ndjson":
        rows = [json.loads(line) for line in ran.stdout.splitlines()]
        assert [{**row, "stamp": None} for row in rows] == [{**row, "stamp": None} for row in shortest(files)]
    else:
        lines = list(csv.DictReader(io.StringIO(ran.stdout.decode())))
        assert [(row["topic"], int(row["sweep"]), float(row["x"])) for row in lines] == [
            (row["topic"], row["sweep"], row["x"]) for row in shortest(files)
        ]


def test_standard_input_equals_the_file(logs: Path, tmp_path: Path, lidarcli: Run, process: Run) -> None:
    expected = expected_rows(logs, tmp_path, lidarcli, "two.mcap")
    data = (logs / "two.mcap").read_bytes()
    ran = process("-q", "detect", "-", "-o", "-", "--format", "arrow", input=data)
    assert (ran.returncode, ran.stderr) == (0, b"")
    rows = pa.ipc.open_stream(ran.stdout).read_all().to_pylist()
    assert {row["log"] for row in rows} == {"stdin"}
    assert [{**row, "log": "two"} for row in rows] == expected


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ndjson", "csv", "arrow", "parquet"])
def test_closed_pipe_ends_quietly(logs: Path, kind: str) -> None:
    """The reader takes a few bytes and goes away."""
    reader, writer = os.pipe()
    command = [sys.executable, "-m", "lidarcli", "-q", "detect", *[str(logs / "run.mcap")], "-o", "-"]
    running = subprocess.Popen([*command, "--format", kind], stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    os.close(reader)
    _, err = running.communicate(timeout=HANG)
    assert (running.returncode, err) == (0, b"")


TABLES = ("objects", "sweeps", "tracks", "trajectories")


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second object is an agent."""
    monkeypatch.setattr(tracking, "Tracker", Patient)


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.parquet"))


def test_tables_and_summary_of_tracks(logs: Path, tmp_path: Path, lidarcli: Run, patient: None) -> None:
    ran = lidarcli("track", logs / "run.mcap", "-o", tmp_path, "--beams")
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{logs / 'run.mcap'}: 20 sweeps, 30 objects (10 of agents), 2 tracks (1 agent)")
    assert lines[2] == "  on       agents 300 (4.2%), other objects 400 (5.6%), walls and rest 6,500 (90.3%)"
    assert lines[5:] == [
        "  people   0: agents that went 2 m or more, each person once",
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
        ran = lidarcli(
            "track", logs / "run.mcap", logs / "two.mcap", "-o", tmp_path / jobs, "--jobs", jobs, "--beams", code=0
        )
        assert ran.err.splitlines()[-1].startswith("2 logs: 60 sweeps, 90 objects (0 of agents), ")
    assert len(names(tmp_path / "1")) == 2 * (len(TABLES) + 1)
    for name in names(tmp_path / "1"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_a_background_leaves_what_differs(tmp_path: Path, lidarcli: Run, patient: None) -> None:
    background = tmp_path / "b.parquet"
    assert lidarcli("-q", "background", "build", SAMPLES / "room_empty.mcap", "-o", background).code == 0
    ran = lidarcli(
        "track", SAMPLES / "room.mcap", "--background", background, "--walls", "--end", "0.5", "-o", tmp_path, code=0
    )
    assert "  note     compared with b.parquet: 25 appeared" in ran.err.splitlines()
    rows = pq.read_table(tmp_path / "room.objects.parquet").to_pylist()
    assert {row["change"] for row in rows if row["track"] is not None} == {"appeared"}
    assert {row["set"] for row in rows if row["track"] is None} == {"S"}
    assert len({row["track"] for row in rows} - {None}) == 5


def test_one_file_holds_the_objects_of_all_logs(logs: Path, tmp_path: Path, lidarcli: Run, patient: None) -> None:
    path = tmp_path / "all.csv"
    ran = lidarcli("track", logs / "run.mcap", logs / "two.mcap", "-o", path, code=0)
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
    at = next(at for at, line in enumerate(lines) if line.startswith("  agents track"))
    rows = pq.read_table(tmp_path / "people.tracks.parquet").to_pandas()
    agents = rows[rows["set"] == "A"].sort_values("distance", ascending=False)
    shown = [line.split() for line in lines[at + 1 : at + 1 + len(agents)]]
    assert [int(each[0]) for each in shown] == agents.track.tolist()
    assert [each[3] for each in shown] == [f"{stamp:%H:%M:%S.%f}"[:-5] for stamp in agents.first_stamp]
    assert [float(each[6]) for each in shown] == pytest.approx(agents.distance.tolist(), abs=0.05)
    assert [float(each[8]) for each in shown] == pytest.approx(agents.speed_mean.tolist(), abs=0.05)
    assert [float(each[10]) for each in shown] == pytest.approx(agents.speed_max.tolist(), abs=0.05)
    assert all(len(line) <= 80 for line in lines[at : at + 1 + len(agents)])
    both = (*words, SAMPLES / "drive.db3")
    assert "  agents track" not in lidarcli(*both).err
    assert "  agents track" in lidarcli("-v", *both).err


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


US = pa.timestamp("us", "UTC")
ZONE = '[[zone]]\nname = "near"\nframe = "sensor"\ncircle = {x = 0.0, y = 0.0, radius = 2.5}\n'
FOLLOWED = ("objects", "sweeps", "tracks", "trajectories", "beams")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`run.mcap`, in which a box goes round for 40 sweeps, with stamps between the microseconds; `zones.toml`."""
    folder = tmp_path_factory.mktemp("stamps")
    ranges = round_room(40)
    for sweep in range(40):
        ranges[sweep, 40 + 3 * sweep : 60 + 3 * sweep] = 2.0
    write_log(folder / "run.mcap", [raw_sweeps(ranges, stamp_ns=START + 789 + STEP * np.arange(40))])
    (folder / "zones.toml").write_text(ZONE)
    return folder


@pytest.fixture(scope="module")
def tables(scene: Path) -> Path:
    """A folder with `ns` and `us`: the tables of `track`, each with its stamps."""
    from lidarcli.cli import run

    for unit in ("ns", "us"):
        words = ["-q", "track", str(scene / "run.mcap"), "--beams", "-o", str(scene / unit), "--stamps", unit]
        assert run(words) == 0
    return scene


def kinds(schema: pa.Schema) -> set[str]:
    return {str(field.type) for field in schema if pa.types.is_timestamp(field.type)}


def test_only_the_stamps_differ(tables: Path) -> None:
    for name in FOLLOWED:
        ns, us = (pq.read_table(tables / unit / f"run.{name}.parquet") for unit in ("ns", "us"))
        assert us.cast(restamped(ns, "us").schema).equals(restamped(ns, "us"))
        assert kinds(ns.schema) == ({"timestamp[ns, tz=UTC]"} if name != "beams" else set())
        assert kinds(us.schema) == ({str(US)} if name != "beams" else set())
        for fine, coarse in zip(ns.schema, us.schema, strict=True):
            assert coarse.metadata == fine.metadata | ({b"unit": b"us"} if fine.type != coarse.type else {})
    stamps = us.schema.metadata, pq.read_table(tables / "us" / "run.sweeps.parquet")["stamp"]
    assert json.loads(stamps[0][b"lidarcli.parameters"])["stamps"] == "us"
    assert stamps[1].cast(pa.int64()).to_pylist()[1] == (START + STEP) // 1000
    # Readers that know nothing of Arrow's schema see it as well.
    column = pq.ParquetFile(tables / "us" / "run.sweeps.parquet").schema.column(4)
    assert "timeUnit=microseconds" in str(column.logical_type)


@pytest.mark.parametrize(
    ("words", "files"),
    [
        (("detect", "-o", "out"), ("out/run.objects.parquet", "out/run.sweeps.parquet")),
        (("detect", "-o", "out", "--partition", "table"), ("out/objects/run.parquet",)),
        (("detect", "-o", "one.parquet"), ("one.parquet",)),
        (("background", "subtract", "--background", "b.parquet", "-o", "out"), ("out/run.sweeps.parquet",)),
        (("zones", "--zones", "zones.toml", "-o", "out"), ("out/run.events.parquet", "out/run.zones.parquet")),
        (("clean", "--pose", "none", "-o", "c.mcap"), ("c.cleaned.parquet",)),
        (("poses", "--pose", "match", "-o", "poses.parquet"), ("poses.parquet",)),
        (("map", "--pose", "match", "-o", "cloud.parquet"), ("cloud.parquet",)),
    ],
)
def test_every_command_that_writes_tables_has_it(
    scene: Path,
    tmp_path: Path,
    lidarcli: Run,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    files: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("zones.toml").write_text(ZONE)
    package.background(scene / "run.mcap", "b.parquet")
    ran = lidarcli("-q", *words, "--stamps", "us", scene / "run.mcap")
    assert (ran.code, ran.err) == (0, "")
    for file in files:
        assert kinds(pq.read_schema(file)) == {str(US)}


def test_our_commands_read_them(tables: Path, tmp_path: Path, lidarcli: Run) -> None:
    """What they make of tables in microseconds is what they make of those in nanoseconds."""
    log = tables / "run.mcap"

    def read_by(*words: Any) -> list[str]:
        found = []
        for unit in ("ns", "us"):
            ran = lidarcli(*(tables / unit / each[1:] if str(each)[0] == "@" else each for each in words))
            assert ran.code == 0, ran.err
            found.append(re.sub(r"\b(ns|us)/", "", ran.out + ran.err))
        return found

    one, other = (
        re.sub(r'\s+"stamps": "us",', "", each) for each in read_by("report", "@run.objects.parquet", "--format", "json")
    )
    assert '"objects":' in one
    assert other == re.sub(r"00789(?=Z|,)", "00000", one)
    ns, us = tables / "ns" / "run.objects.parquet", tables / "us" / "run.objects.parquet"
    assert lidarcli("report", us, "--baseline", ns, "--check", "delta.objects == 0").code == 0
    zones = ("zones", log, "--zones", tables / "zones.toml", "--overwrite", "-o", tmp_path)
    written = []
    for file in (ns, us):
        assert lidarcli(*zones, "--objects", file).code == 0
        written.append([pq.read_table(tmp_path / f"run.{name}.parquet") for name in ("events", "zones")])
    assert written[0] == written[1]
    drawn = []
    for file in (ns, us):
        assert lidarcli("overlay", log, "--objects", file, "-o", tmp_path / "o.mcap", "--overwrite").code == 0
        drawn.append((tmp_path / "o.mcap").read_bytes())
    assert drawn[0] == drawn[1]
    assert len({*read_by("diff", "@run.tracks.parquet", "@run.tracks.parquet", "--align", "as-is")}) == 1


def test_a_run_with_other_stamps_is_done_again(scene: Path, tmp_path: Path, lidarcli: Run) -> None:
    words = ("detect", scene / "run.mcap", "-o", tmp_path, "--resume")
    assert "done before" not in lidarcli(*words).err
    assert "done before" not in lidarcli(*words, "--stamps", "us").err
    assert "done before" in lidarcli(*words, "--stamps", "us").err


@pytest.fixture
def parked(tmp_path: Path) -> Path:
    """A log of a sensor that stands, with a post before it."""
    ranges = np.full((20, 360), 4.0, np.float32)
    ranges[:, 90:96] = 0.3
    write_log(tmp_path / "parked.mcap", [raw_sweeps(ranges)])
    return tmp_path / "parked.mcap"


def test_what_a_parked_sensor_sees_is_proposed(lidarcli: Run, parked: Path, tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    ran = lidarcli("info", parked, "--mask", "auto", "-o", file, code=0)
    assert "nothing is masked: the sensor drove 0.0 m and turned by 0 degrees" in ran.out
    assert "6 beams at 0.26 to 0.34 m look like the robot itself: --mask FILE masks them" in ran.out
    assert f"wrote    {file}" in ran.err
    assert file.read_text() == (
        "# The sensor stood: what follows looks like the robot itself. Remove the # where it is.\n\n"
        "# [[mask]]\n"
        '# topic = "/scan"\n'
        "# sector = { from = -90.500006, to = -84.500006, nearest = 0.2625, farthest = 0.3425 }\n"
    )
    assert lidarcli("info", parked, "--mask", file).code == 2
    file.write_text("".join(line[2:] for line in file.read_text().splitlines(keepends=True)[2:]))
    assert "masked    120 beams (1.67%)" in lidarcli("info", parked, "--mask", file).out
    ran = lidarcli("detect", parked, "--mask", file, "-o", tmp_path)
    assert "masked 120 (1.7%)" in ran.err


LOG = SAMPLES / "reflectors.mcap"


@pytest.fixture
def gate_tables(tmp_path: Path) -> Path:
    assert run(["-q", "track", str(LOG), "-o", str(tmp_path / "lit")]) == 0
    return tmp_path / "lit"


@pytest.mark.parametrize(
    ("check", "code"),
    [
        ("intensity.max == 3100", 0),
        ("intensity.p95 <= 800", 1),
        ("intensity.p50 between 100 and 200", 0),
        ("objects where intensity > 1000 == 120", 0),
        ("objects where intensity < 100 and shape == round >= 61", 1),
        ("objects where intensity is null == 0", 0),
    ],
)
def test_checks_of_a_report(check: str, code: int, gate_tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["-q", "report", str(gate_tables), "--check", check]) == code
    assert "intensity " in capfd.readouterr().out


def test_an_overlay_takes_the_echo_of_its_tables(tmp_path: Path) -> None:
    log, shown = tmp_path / "run.jsonl", tmp_path / "shown.mcap"
    data = {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 0}, "frame_id": "laser"},
        "angle_min": -0.2,
        "angle_max": 0.2,
        "angle_increment": 0.1,
        "range_min": 0.1,
        "range_max": 9.0,
        "ranges": [{"echoes": [1.5, 2.5]}] * 5,
    }
    told = {"topic": "/scan", "sequence": 0, "log_time": "2023-11-14T22:13:20Z", "publish_time": "2023-11-14T22:13:20Z"}
    log.write_text(json.dumps(told | {"data": data}) + "\n")
    assert run(["-q", "detect", str(log), "-o", str(tmp_path), "--echo", "last"]) == 0
    gate_tables = str(tmp_path / "run.objects.parquet")
    assert run(["-q", "overlay", str(log), "--objects", gate_tables, "--with-log", "-o", str(shown)]) == 0
    (batch,) = lidarcli.read(shown)
    assert batch.ranges.tolist() == [[2.5] * 5]
