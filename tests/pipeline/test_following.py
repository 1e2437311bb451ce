"""Things followed over a log: rows wait for their answers, and come out as if they had not."""

from __future__ import annotations

import errno
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.errors import OutputError
from lidarcli.formalism.matching.catalogue import Catalogue, Thing
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects import detection, tracking
from lidarcli.pipeline.objects.detection import BatchDetector, DetectOptions, TrackOptions
from lidarcli.pipeline.objects.tracking import LogTracker
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from lidarcli.tabular import SCHEMAS
from tests.pipeline.in_memory import SCAN, SOURCE, Opens, block
from tests.pipeline.patient import PATIENCE, Patient
from tests.places import SAMPLES
from tests.sweeping import BOX, START, STEP, raw_sweeps, round_room

TRACKING = TrackOptions(TrackParameters())
CATALOGUE = Catalogue((Thing("pallet", length=1.2, width=0.8), Thing("person", legs=2)))
OTHER_BOX = (200, 230, 1.5)
CHANGED = {
    "objects": {"set", "thing", "track", "vx", "vy", "moving", "agent_score", "label", "label_score"},
    "sweeps": {"objects", "agents", "object_beams", "agent_beams"},
    "beams": {"set"},
}
"""Table → columns that tracking fills in or changes."""


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> list[Patient]:
    """Every tracker that is made is one whose answers are known."""
    made: list[Patient] = []

    def make(parameters: TrackParameters, catalogue: Catalogue | None, **_: Any) -> Patient:
        assert catalogue in (None, CATALOGUE)
        made.append(Patient(parameters))
        return made[-1]

    monkeypatch.setattr(tracking, "Tracker", make)
    return made


def two_boxes(topic: str, first: int, sweeps: int) -> RawSweeps:
    """Sweeps of the round room with two boxes in it."""
    stamps = START + STEP * np.arange(first, first + sweeps)
    return raw_sweeps(round_room(sweeps, 360, BOX, OTHER_BOX), topic=topic, stamp_ns=stamps)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """Two topics that alternate, 300 sweeps each, and a chunk that is damaged."""
    path = tmp_path_factory.mktemp("followed") / "run.mcap"
    blocks = [two_boxes(topic, first, 20) for first in range(0, 300, 20) for topic in ("/rear", "/front")]
    write_log(path, blocks, chunk_size=50_000, compression="none")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(200)
    path.write_bytes(data)
    return Source(str(path), "run")


def tables(folder: Path) -> dict[str, pa.Table]:
    return {path.name.split(".")[1]: pq.read_table(path) for path in folder.iterdir()}


def followed(**options: Any) -> DetectOptions:
    """In batches that have to wait for several others."""
    return DetectOptions(read=ReadOptions(batch_size=16), tracking=TRACKING, **options)


def counted(table: pa.Table, *columns: str) -> Counter[tuple[object, ...]]:
    return Counter(zip(*(table[name].to_pylist() for name in columns), strict=True))


def test_every_table_tells_the_same(
    source: Source, tmp_path: Path, patient: list[Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Patient, "label", 1)
    summary = detect_to_files(source, tmp_path, followed(beams=True, catalogue=CATALOGUE))
    found = tables(tmp_path)
    assert {name: table.schema for name, table in found.items()} == {
        name: SCHEMAS[name].with_metadata(found[name].schema.metadata) for name in found
    }
    assert summary.exit_code == 3
    assert [tracker.most for tracker in patient] == [1 + PATIENCE // 16 + 1] * 2
    sweeps = summary.sweeps
    assert 300 < sweeps < 600
    named = counted(found["objects"], "object", "track", "set", "vx", "vy", "moving", "label", "label_score")
    assert named == {(1, 1, "O", 0.0, 0.0, False, None, None): sweeps, (2, 2, "A", 0.0, 1.0, True, "person", 0.75): sweeps}
    assert counted(found["sweeps"], "objects", "agents", "object_beams", "agent_beams", "noise_beams") == {
        (1, 1, 20, 30, 310): sweeps
    }
    # Def. 4: the sets of the beams sum to those of the sweeps, and an agent's beams are its object's.
    assert counted(found["beams"], "set") == {("O",): 20 * sweeps, ("A",): 30 * sweeps, ("S",): 310 * sweeps}
    assert counted(found["beams"], "object", "set") == {
        (1, "O"): 20 * sweeps,
        (2, "A"): 30 * sweeps,
        (None, "S"): 310 * sweeps,
    }
    assert (summary.objects, summary.agents, summary.things, summary.moved) == (sweeps, sweeps, 4, 2)
    assert list(summary.by_set.items()) == [("O", 20 * sweeps), ("A", 30 * sweeps), ("S", 310 * sweeps)]
    things = found["tracks"].to_pylist()
    assert [(row["topic"], row["track"], row["set"], row["label"]) for row in things] == [
        ("/front", 1, "O", None),
        ("/front", 2, "A", "person"),
        ("/rear", 1, "O", None),
        ("/rear", 2, "A", "person"),
    ]
    assert [row["moved_at"] and row["moved_at"].value for row in things[:2]] == [None, START]
    assert {(row["log"], row["frame_id"], row["shape"], row["end"], row["length"]) for row in things} == {
        ("run", "laser", "round", "lost", None)
    }
    assert summary.notes[-2:] == [
        f"2 things in {sum(1 for name in found['sweeps']['topic'].to_pylist() if name == topic)} sweeps of {topic}"
        for topic in ("/front", "/rear")
    ]


def test_what_does_not_change_is_that_of_detect(
    source: Source, tmp_path: Path, patient: list[Patient], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Patient, "label", 1)
    detect_to_files(source, tmp_path / "tracked", followed(beams=True))
    detect_to_files(source, tmp_path / "detected", DetectOptions(beams=True))
    tracked, detected = tables(tmp_path / "tracked"), tables(tmp_path / "detected")
    assert {*tracked} - {*detected} == {"tracks", "trajectories"}
    for name, table in detected.items():
        same = [column for column in table.column_names if column not in CHANGED[name]]
        assert tracked[name].select(same).equals(table.select(same))
        for column in CHANGED[name]:
            assert not tracked[name][column].equals(table[column]), column


@pytest.mark.parametrize("beams", [False, True])
def test_the_same_bytes_for_any_batch_size_and_jobs(
    source: Source, tmp_path: Path, patient: list[Patient], monkeypatch: pytest.MonkeyPatch, beams: bool
) -> None:
    monkeypatch.setattr(detection, "ALONE", 1)
    monkeypatch.setattr(detection, "BLOCK", 1)
    written = set()
    for jobs, size in ((1, 768), (1, 7), (3, 64)):
        folder = tmp_path / f"{jobs}-{size}"
        read = ReadOptions(batch_size=size)
        options = DetectOptions(read=read, beams=beams, jobs=jobs, cores=jobs, tracking=TRACKING)
        detect_to_files(source, folder, options)
        written.add(tuple(path.read_bytes() for path in sorted(folder.iterdir())))
    assert len(written) == 1
    assert len(written.pop()) == 4 + beams


def test_rows_wait_no_longer_than_they_must(patient: list[Patient]) -> None:
    """A log of any length: so many batches wait for the look-ahead, and no more."""
    options = DetectOptions(tracking=TRACKING)
    tables = "objects", "sweeps"
    follow = LogTracker("run", tables, options)
    batch = next(iter(lidarcli.read(SAMPLES / "room.mcap", end=1.0)))
    (one,) = BatchDetector("run", tables, options).detect([batch]).detected
    rows = list(follow.take([one] * 100))
    assert patient[0].most == PATIENCE // 10 + 1
    assert len(rows) == 2 * (100 - PATIENCE // 10)
    rest = list(follow.flush())
    assert [table for table, _, _ in rest] == ["objects", "sweeps"] * (PATIENCE // 10) + ["tracks"]


def test_what_waits_for_the_end_may_wait_on_disk(source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    detect_to_files(source, tmp_path / "memory", followed(beams=True))
    monkeypatch.setattr(tracking, "MAX_BYTES", 100_000)
    detect_to_files(source, tmp_path / "disk", followed(beams=True))
    for path in (tmp_path / "memory").iterdir():
        assert path.read_bytes() == (tmp_path / "disk" / path.name).read_bytes()


def test_a_disk_without_room_is_one_line(source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tracking, "MAX_BYTES", 0)
    monkeypatch.setattr(tracking.pickle, "dump", full)
    with pytest.raises(OutputError, match=r"a temporary file in .*No space left on device"):
        detect_to_files(source, tmp_path, followed())
    assert list(tmp_path.iterdir()) == []


def test_rows_of_a_pipe_do_not_wait_for_its_end() -> None:
    """Of a log that is read once, bodies are judged by the sweeps so far."""
    batch = next(iter(lidarcli.read(SAMPLES / "room.mcap")))
    options = DetectOptions(tracking=TrackOptions())
    follow = LogTracker("run", ("objects",), options)
    parts = [batch.rows(np.arange(begin, begin + 10)) for begin in range(0, 100, 10)]
    made = BatchDetector("run", ("objects",), options).detect(parts * 8).detected
    rows = list(follow.take(made))
    assert 0 < len(rows) < len(made)
    assert len(rows) + len(list(follow.flush())) == len(made) + 2


def test_a_log_without_objects_gives_whole_empty_tables(tmp_path: Path, opened: Opens) -> None:
    opened(raw_sweeps(round_room(4)), topics=[SCAN])
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions(beams=True, tracking=TrackOptions()))
    assert (summary.sweeps, summary.objects, summary.things, summary.moved) == (4, 0, 0, 0)
    found = tables(tmp_path)
    assert {name: table.num_rows for name, table in found.items()} == {
        "objects": 0,
        "sweeps": 4,
        "tracks": 0,
        "trajectories": 0,
        "beams": 1440,
    }
    assert all(found[name].schema.equals(SCHEMAS[name]) for name in found)


def test_an_error_of_the_tracker_leaves_no_file(tmp_path: Path, opened: Opens, monkeypatch: pytest.MonkeyPatch) -> None:
    opened(block(), topics=[SCAN])

    def fail(self: Patient) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr(Patient, "finish", fail)
    monkeypatch.setattr(tracking, "Tracker", Patient)
    with pytest.raises(MemoryError):
        detect_to_files(SOURCE, tmp_path, DetectOptions(tracking=TRACKING))
    assert list(tmp_path.iterdir()) == []


def test_track_in_python_gives_the_tables_of_the_files(source: Source, tmp_path: Path, patient: list[Patient]) -> None:
    with pytest.warns(UserWarning, match="run.mcap: "):
        found = lidarcli.track(source.path, start=1.0)
    detect_to_files(source, tmp_path, DetectOptions(read=ReadOptions(start=1.0), tracking=TrackOptions()))
    assert found._fields == ("objects", "sweeps", "tracks")
    for name, table in found._asdict().items():
        written = pq.read_table(tmp_path / f"run.{name}.parquet")
        assert table.equals(written)
        assert written.schema.metadata.items() <= table.schema.metadata.items()
    assert found.tracks.num_rows == 4


def test_track_batches_in_python(patient: list[Patient]) -> None:
    """Several topics and logs: each is followed by itself, and comes out in the order of its topics."""
    batches = []
    for log in ("one", "two"):
        for topic in ("/b", "/a"):
            batch = lidarcli.formalism.sweep(two_boxes("", 0, 3).ranges, angle_increment=np.pi / 180)
            batches.append(replace(batch, log=log, topic=topic))
    found = lidarcli.track([batches[k] for k in (0, 2, 1, 3)], max_width=1.0)
    assert len(patient) == 4
    rows = found.tracks.to_pylist()
    assert [(row["log"], row["topic"], row["track"]) for row in rows] == [
        (log, topic, track) for log in ("one", "two") for topic in ("/a", "/b") for track in (1, 2)
    ]
    assert found.objects["track"].to_pylist() == [1, 2] * 12
    assert found.sweeps["agents"].to_pylist() == [1] * 12
    told = json.loads(found.sweeps.schema.metadata[b"lidarcli.parameters"])
    assert (told["max_width"], told["tracking"]) == (1.0, {"agent_score": 0.55, "memory": True})
