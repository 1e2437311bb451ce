"""One log over several processes: the same bytes, whatever happens to them; short logs start none."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism import Parameters
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline import cores, many, parts_split, parts_workers, processes
from lidarcli.pipeline.building import Building, BuildOptions
from lidarcli.pipeline.detecting import DetectOptions, detect_to_files
from lidarcli.pipeline.inputs import Source
from lidarcli.pipeline.many import detect_files, detect_stream
from lidarcli.pipeline.parts import Maker, Recipe
from lidarcli.pipeline.parts_split import Splitting
from lidarcli.pipeline.parts_workers import Answer, Helpers
from lidarcli.pipeline.subtracting import BackgroundOptions
from lidarcli.pipeline.summary import RunSummary
from lidarcli.simulate.generate import simulate_blocks
from lidarcli.simulate.load import load_scene
from lidarcli.simulate.odometry import simulate_odometry
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import SweepBatch
from tests.places import SAMPLES
from tests.sweeping import raw_sweeps, round_room

pytestmark = pytest.mark.slow

SWEEPS = 1500
TOPICS = ("/rear", "/front", "/rear", "/left")
DRIVE = SAMPLES / "drive.toml"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """A robot's log: three topics that alternate, beams that come and go, poses, and a chunk that is damaged."""
    scene = load_scene(DRIVE)
    scene = replace(scene, sensor=replace(scene.sensor, beams_jitter=3))
    blocks = [
        replace(block.raw, topic=topic)
        for topic, block in zip(TOPICS * SWEEPS, simulate_blocks(scene, SWEEPS, size=60), strict=False)
    ]
    path = tmp_path_factory.mktemp("jobs") / "drive.mcap"
    write_log(path, blocks, chunk_size=100_000, poses=simulate_odometry(scene, SWEEPS))
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(200)
    path.write_bytes(data)
    return Source(str(path), "drive")


@dataclass
class Seen:
    """What the workers had to do."""

    started: int = 0
    taken: int = 0


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> Seen:
    """Workers that are called after the first batch, and batches that are handed out one by one."""
    seen = Seen()
    monkeypatch.setattr(parts_split, "ALONE", 1)
    monkeypatch.setattr(parts_split, "BLOCK", 1)
    start, take = Helpers._start, Helpers.take

    def started(self: Helpers) -> None:
        seen.started += 1
        start(self)
        if self._pool is not None:
            wait(self._up)

    def taken(self: Helpers, batches: list[SweepBatch]) -> Any:
        task = take(self, batches)
        seen.taken += task is not None
        return task

    monkeypatch.setattr(Helpers, "_start", started)
    monkeypatch.setattr(Helpers, "take", taken)
    return seen


def files(source: Source, folder: Path, options: DetectOptions) -> tuple[dict[str, bytes], RunSummary]:
    """The bytes of every table, and the summary without what differs from run to run."""
    summary = detect_to_files(source, folder, options)
    tables = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    return tables, replace(summary, seconds=0.0, outputs=[], remark=None)


def background(source: Source) -> BackgroundOptions:
    """What the log itself teaches of its scene."""
    building = Building(BuildOptions())
    building.add(source)
    return BackgroundOptions("drive.background.parquet", tuple(building.sensors()))


OPTIONS: dict[str, Callable[[Source], DetectOptions]] = {
    "beams": lambda source: DetectOptions(beams=True),
    "every third": lambda source: DetectOptions(read=ReadOptions(every=3, batch_size=64)),
    "part": lambda source: DetectOptions(read=ReadOptions(start=30.0, end=200.0, batch_size=100)),
    "paper": lambda source: DetectOptions(parameters=Parameters.for_profile("paper")),
    "no poses": lambda source: DetectOptions(
        pose="none", read=ReadOptions(topics=("rear", "left"), batch_size=64)
    ),
    "background": lambda source: DetectOptions(background=background(source)),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_the_same_bytes(source: Source, tmp_path: Path, eager: Seen, name: str) -> None:
    options = OPTIONS[name](source)
    expected = files(source, tmp_path / "1", options)
    assert expected[1].damage
    assert expected[1].sweeps > 200
    assert eager.started == 0
    for jobs in (2, 3):
        assert files(source, tmp_path / str(jobs), replace(options, jobs=jobs)) == expected
    assert eager.started == 2
    assert eager.taken > 3


@pytest.mark.parametrize("kind", ["ndjson", "csv", "arrow", "parquet"])
def test_the_same_stream(source: Source, eager: Seen, kind: str) -> None:
    def stream(jobs: int) -> bytes:
        out = BytesIO()
        outcomes = list(detect_stream([source, source], out, kind, DetectOptions(jobs=jobs)))
        assert [outcome.exit_code for outcome in outcomes] == [3, 3]
        return out.getvalue()

    assert stream(2) == stream(1)
    assert eager.taken > 3


def test_without_shared_memory(
    source: Source, tmp_path: Path, eager: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = files(source, tmp_path / "1", DetectOptions())

    def full(size: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(parts_workers, "SharedFile", full)
    assert files(source, tmp_path / "2", DetectOptions(jobs=2)) == expected
    assert eager.taken > 0


def test_slots_that_are_too_small(
    source: Source, tmp_path: Path, eager: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = files(source, tmp_path / "1", DetectOptions())
    monkeypatch.setattr(parts_workers, "SLOT", 400_000)
    assert files(source, tmp_path / "2", DetectOptions(jobs=2)) == expected
    monkeypatch.setattr(parts_workers, "SLOT", 4096)
    assert files(source, tmp_path / "3", DetectOptions(jobs=2)) == expected


# --- workers that die -------------------------------------------------------------------------------------

MARK, FATAL = "LIDARCLI_TEST_MARK", "LIDARCLI_TEST_FATAL"
REAL = parts_workers._make


def _dies_once(parcel: Any, slot: int | None) -> Answer:
    """The first part kills its worker; with `FATAL` in the environment every part does."""
    answer = REAL(parcel, slot)
    mark = Path(os.environ[MARK])
    if FATAL in os.environ or not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


def _dies_at_once(recipe: Recipe, path: str | None, size: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture
def deadly(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(parts_workers, "_make", _dies_once)
    monkeypatch.setenv(MARK, str(tmp_path / "mark"))
    # What is taken back from a worker before it dies is no loss, and on a busy machine that may be all.
    monkeypatch.setattr(Helpers, "last", lambda self: None)


@pytest.mark.usefixtures("deadly")
def test_a_dead_worker_costs_no_part(source: Source, tmp_path: Path, eager: Seen) -> None:
    options = DetectOptions(read=ReadOptions(batch_size=64))
    expected = files(source, tmp_path / "1", options)
    (outcome,) = detect_files([source], tmp_path / "2", replace(options, jobs=3))
    assert outcome.remark == "a worker process died; its part of the log was done again"
    assert {path.name: path.read_bytes() for path in sorted((tmp_path / "2").iterdir())} == expected[0]
    assert eager.started == 2


@pytest.mark.usefixtures("deadly", "eager")
def test_a_part_that_kills_every_worker(
    source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FATAL, "1")
    options = DetectOptions(read=ReadOptions(batch_size=32), jobs=3)
    (outcome,) = detect_files([source], tmp_path / "out", options)
    assert outcome.exit_code == 70
    assert re.fullmatch(
        r"sweeps \d+ to \d+ of /\w+: a worker process died twice of it, ended by the system \(out of memory\?\); "
        "try --jobs 1",
        outcome.error or "",
    )
    assert list((tmp_path / "out").iterdir()) == []


def test_workers_that_cannot_start(
    source: Source, tmp_path: Path, eager: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = files(source, tmp_path / "1", DetectOptions())
    monkeypatch.setattr(parts_workers, "_begin", _dies_at_once)
    (outcome,) = detect_files([source], tmp_path / "2", DetectOptions(jobs=2))
    assert outcome.remark == "worker processes could not be started; one process did all the work"
    assert {path.name: path.read_bytes() for path in sorted((tmp_path / "2").iterdir())} == expected[0]
    assert (eager.started, eager.taken) == (1, 0)


def _fails(parcel: Any, slot: int | None) -> Answer:
    raise ZeroDivisionError("oops")


def test_a_bug_in_a_worker(
    source: Source, tmp_path: Path, eager: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts_workers, "_make", _fails)
    (outcome,) = detect_files([source], tmp_path / "out", DetectOptions(jobs=2))
    assert (outcome.exit_code, outcome.error) == (70, "internal error: ZeroDivisionError: oops")
    assert outcome.trace is not None
    assert "in _fails" in outcome.trace
    assert list((tmp_path / "out").iterdir()) == []


# --- the end ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Work for several seconds (with `--beams`), in a file that is quickly made."""
    rows, beams = 250, 1800
    boxes = [(first, first + 30, 2.0) for first in range(100, beams - 100, 100)]
    ranges = round_room(rows, beams, *boxes)
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    write_log(path, [raw_sweeps(ranges)] * 40, compression="lz4")
    return path


def descendants(pid: int) -> set[int]:
    """Processes that a process has started, and those that these have."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if stat[0] != "Z":
            parents[int(folder.name)] = int(stat[1])
    found = {pid}
    while more := {child for child, parent in parents.items() if parent in found} - found:
        found |= more
    return found - {pid}


def gone(pids: set[int]) -> bool:
    """Whether processes end within some seconds."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        running = {pid for pid in pids if Path(f"/proc/{pid}").exists()}
        states = {(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]) for pid in running}
        if states <= {"Z"}:
            return True
        time.sleep(0.02)
    return False


@pytest.fixture
def running(
    long_log: Path, tmp_path: Path
) -> Iterator[tuple[subprocess.Popen[bytes], Callable[[int], set[int]]]]:
    """`detect --jobs 2` of a long log, and what waits for its workers (one and the tracker of resources)."""
    options = ["-o", str(tmp_path / "out"), "--beams", "--jobs", "2"]
    command = [sys.executable, "-m", "lidarcli", "detect", str(long_log), *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True)

    def workers(count: int) -> set[int]:
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline and process.poll() is None:
            if len(found := descendants(process.pid)) >= count:
                return found
            time.sleep(0.005)
        raise AssertionError("no workers were started")

    yield process, workers
    process.kill()
    process.communicate()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("later", [0.0, 0.1, 0.6])
def test_interrupt(running: Any, tmp_path: Path, later: float) -> None:
    """Ctrl-C reaches the whole group of processes: while workers come up, and while they work."""
    process, workers = running
    pids = workers(2)
    time.sleep(later)
    pids |= descendants(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert (process.returncode, err.decode()) == (130, "lidarcli: interrupted\n")
    assert list((tmp_path / "out").iterdir()) == []
    assert gone(pids)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_workers_end_with_their_parent(running: Any) -> None:
    process, workers = running
    pids = workers(2)
    time.sleep(0.5)
    opened = [Path(fd).resolve() for fd in Path(f"/proc/{process.pid}/fd").iterdir()]
    (shared,) = {path for path in opened if path.name.startswith("lidarcli-")}
    assert shared.exists()
    process.kill()
    assert gone(pids)
    assert not shared.exists()


# --- when it pays -----------------------------------------------------------------------------------------


def _none_wanted(*arguments: object) -> None:
    raise AssertionError("a process was started")


def test_short_logs_start_no_process(source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "start", _none_wanted)
    options = DetectOptions(jobs=8)
    outcomes = list(detect_files([source, replace(source, name="again")], tmp_path, options))
    assert [outcome.exit_code for outcome in outcomes] == [3, 3]


def reading(batches: Iterator[SweepBatch], ahead: int | None = None, counted: int = 0) -> tuple[Any, Recipe]:
    """A stand-in for the sweeps of a log."""
    summary = RunSummary(sweeps=counted)
    stand_in = SimpleNamespace(batches=lambda progress: batches, ahead=lambda: ahead, summary=summary)
    return stand_in, Recipe("run", ("objects",), Parameters())


def batch_of(sweeps: int, beams: int = 360) -> SweepBatch:
    from lidarcli.formalism import sweep

    one = sweep([4.0] * 100 + [2.0] * 20 + [4.0] * (beams - 120), angle_min=-3.0, angle_increment=0.01)
    return one.rows(np.zeros(sweeps, np.int64))


@pytest.mark.parametrize(
    ("ahead", "counted", "calls"),
    [(112_000, 100, True), (110_000, 100, False), (None, 100, False)],
)
def test_workers_are_called_for_what_lies_ahead(
    monkeypatch: pytest.MonkeyPatch, ahead: int | None, counted: int, calls: bool
) -> None:
    """12,000,000 ranges are 111,111 sweeps of 108 beams, as a hundred that were read had them."""
    monkeypatch.setattr(processes, "start", _none_wanted)
    stand_in, recipe = reading(iter([batch_of(30)]), ahead, counted)
    with Splitting(stand_in, recipe, 2) as work:
        if calls:
            with pytest.raises(AssertionError, match="a process was started"):
                list(work.parts(None))
        else:
            assert len(list(work.parts(None))) == 1


def test_of_a_pipe_what_lies_behind_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "start", _none_wanted)
    monkeypatch.setattr(parts_split, "ALONE", 100_000)
    # Nothing is waited for, however busy the machine is.
    monkeypatch.setattr(Splitting, "_timed", lambda self, batches: ((batch, 0.0) for batch in batches))
    stand_in, recipe = reading(iter([batch_of(256)] * 2))
    with Splitting(stand_in, recipe, 2) as work:
        parts = work.parts(None)
        next(parts)
        with pytest.raises(AssertionError, match="a process was started"):
            next(parts)


def test_a_live_source_is_not_kept_waiting(eager: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every batch that was long in coming is out before the next one is asked for."""
    monkeypatch.setattr(parts_split, "PATIENCE", 0.05)
    monkeypatch.setattr(parts_split, "BLOCK", 10**9)
    asked = Counter[str]()

    def slowly() -> Iterator[SweepBatch]:
        for _ in range(4):
            asked["batches"] += 1
            yield batch_of(5)
            time.sleep(0.1)

    stand_in, recipe = reading(slowly(), 10**9)
    with Splitting(stand_in, recipe, 2) as work:
        for number, part in enumerate(work.parts(None), 1):
            assert asked["batches"] == number
            assert part.found.objects == 5
    assert (eager.started, eager.taken) == (1, 0)


def test_parts_keep_their_order(eager: Seen) -> None:
    """However fast the one or the other is."""
    batches = [replace(batch_of(3), sweep=np.arange(3 * k, 3 * k + 3)) for k in range(60)]
    stand_in, recipe = reading(iter(batches), 10**9)
    with Splitting(stand_in, recipe, 3) as work:
        sweeps = [
            sweep
            for part in work.parts(None)
            for _, _, rows in part.rows
            for sweep in rows["sweep"].to_pylist()
        ]
    assert sweeps == list(range(180))
    assert eager.taken > 3


def test_finished_parts_that_wait_are_few(eager: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker that stands still holds up the others once enough is waiting for it."""
    monkeypatch.setattr(parts_split, "WINDOW", 2)
    monkeypatch.setattr(parts_workers, "DEPTH", 1)
    read = 0

    def batches() -> Iterator[SweepBatch]:
        nonlocal read
        for _ in range(20):
            read += 1
            yield batch_of(2)

    stand_in, recipe = reading(batches(), 10**9)
    with Splitting(stand_in, recipe, 2) as work:
        parts = work.parts(None)
        next(parts)
        monkeypatch.setattr(Helpers, "settle", lambda self: None)
        next(parts)
        # One at work in the worker, four behind it, and the one that was too many.
        assert read == 6


@pytest.mark.parametrize(
    ("sizes", "jobs", "expected"),
    [
        ([100, 100], 8, 1),
        ([1 << 30, 100, 100], 8, 1),
        ([1 << 30, 1 << 24], 8, 2),
        ([1 << 23, 1 << 23, 1 << 23], 2, 2),
        ([1 << 30, 1 << 30], 1, 1),
        ([0, 0], 2, 2),
        ([1 << 30], 8, 1),
    ],
)
def test_logs_at_the_same_time(
    sizes: list[int], jobs: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Source, "size", property(lambda source: int(source.path)))
    assert many._at_once([Source(str(size), f"log{k}") for k, size in enumerate(sizes)], jobs) == expected


def test_processes_are_shared_between_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def side_by_side(sources: Any, folder: Path, options: DetectOptions, jobs: int) -> Iterator[Any]:
        asked.append((jobs, options.jobs))
        return iter(sources)

    monkeypatch.setattr("lidarcli.pipeline.workers.side_by_side", side_by_side)
    sources = [Source(f"fifo{k}", f"log{k}") for k in range(3)]
    for jobs in (2, 3, 8):
        list(detect_files(sources, tmp_path, DetectOptions(jobs=jobs)))
    assert asked == [(2, 1), (3, 1), (3, 2)]


@pytest.mark.parametrize(
    ("quota", "expected"), [("max 100000", 6), ("150000 100000", 2), ("100 100000", 1), ("900000 100000", 6)]
)
def test_cores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quota: str, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(6)), raising=False)
    monkeypatch.setattr(cores, "_QUOTA", tmp_path / "cpu.max")
    assert cores.cores() == 6
    (tmp_path / "cpu.max").write_text(f"{quota}\n")
    assert cores.cores() == expected


def test_maker_counts_as_the_whole_run_does(source: Source) -> None:
    maker = Maker(Recipe("run", ("objects", "sweeps"), Parameters()))
    part = maker.make([batch_of(3), batch_of(4)])
    assert [(table, topic, rows.num_rows) for table, topic, rows in part.rows] == [
        ("objects", "/scan", 3),
        ("sweeps", "/scan", 3),
        ("objects", "/scan", 4),
        ("sweeps", "/scan", 4),
    ]
    assert (part.found.objects, part.found.by_set["O"], part.counted) == (7, 140, None)
