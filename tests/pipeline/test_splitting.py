"""One log over several threads, several logs over processes: the same bytes; short logs start neither."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism import Parameters
from lidarcli.logs.base import Log
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.building import BackgroundBuilder, BuildOptions
from lidarcli.pipeline.detecting import detect_files, detect_stream, detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects import detection
from lidarcli.pipeline.objects.detection import BatchDetector, BatchPart, DetectOptions, ParallelDetection
from lidarcli.pipeline.objects.subtracting import BackgroundOptions
from lidarcli.pipeline.reading import path_check
from lidarcli.pipeline.reading.needs import NO_POSES
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs import over_logs, processes
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import SweepBatch
from lidarcli.system import machine
from lidarcli.system.machine import Threads
from tests.descendants import descendants, gone
from tests.places import SAMPLES
from tests.sweeping import raw_sweeps, round_room
from tests.waiting import HANG, endless, wait_until

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


@pytest.fixture(scope="module", autouse=True)
def paths_are_checked_once() -> Iterator[None]:
    """The pass that checks the poses of `source` takes most of a run and knows of no jobs: it runs once per choice."""
    known: dict[object, object] = {}
    check = path_check.check_paths

    def checked(log: Log, sources: Any, choice: TopicChoice, rules: RangeRules, **options: Any) -> Any:
        asked = (sources is None, choice.wanted, rules, *sorted(options.items()))
        if asked not in known:
            known[asked] = check(log, sources, choice, rules, **options)
        return known[asked]

    with pytest.MonkeyPatch.context() as patching:
        patching.setattr(path_check, "check_paths", checked)
        yield


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Threads that are called after the first batch, and batches handed out one by one; counts of both."""
    counts = Counter[str]()
    monkeypatch.setattr(detection, "ALONE", 1)
    monkeypatch.setattr(detection, "BLOCK", 1)

    class Counted(Threads):
        def __init__(self, name: str, count: int = 1) -> None:
            counts["started"] += count
            super().__init__(name, count)

        def submit(self, *arguments: Any, **options: Any) -> Any:
            counts["taken"] += 1
            return super().submit(*arguments, **options)

    monkeypatch.setattr(detection, "Threads", Counted)
    return counts


def files(source: Source, folder: Path, options: DetectOptions) -> tuple[dict[str, bytes], RunSummary]:
    """The bytes of every table, and the summary without what differs from run to run."""
    summary = detect_to_files(source, folder, options)
    tables = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    return tables, replace(summary, seconds=0.0, outputs=[])


def background(source: Source) -> BackgroundOptions:
    """What the log itself teaches of its scene."""
    building = BackgroundBuilder(BuildOptions())
    building.add(source)
    return BackgroundOptions("drive.background.parquet", tuple(building.sensors()))


OPTIONS: dict[str, Callable[[Source], DetectOptions]] = {
    "beams": lambda source: DetectOptions(beams=True),
    "every third": lambda source: DetectOptions(read=ReadOptions(every=3, batch_size=64)),
    "part": lambda source: DetectOptions(read=ReadOptions(start=30.0, end=200.0, batch_size=100)),
    "paper": lambda source: DetectOptions(parameters=Parameters.for_profile("paper")),
    "no poses": lambda source: DetectOptions(poses=NO_POSES, read=ReadOptions(topics=("rear", "left"), batch_size=64)),
    "background": lambda source: DetectOptions(background=background(source)),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_the_same_bytes(source: Source, tmp_path: Path, eager: Counter[str], name: str) -> None:
    options = replace(OPTIONS[name](source), cores=4)
    expected = files(source, tmp_path / "1", replace(options, jobs=1))
    assert expected[1].damage
    assert expected[1].sweeps > 200
    assert eager["started"] == 0
    for jobs in (2, 3, 0):
        assert files(source, tmp_path / str(jobs), replace(options, jobs=jobs)) == expected
    assert eager["started"] == 2 + 3 + 4
    assert eager["taken"] > 3


@pytest.mark.parametrize("kind", ["ndjson", "csv", "arrow", "parquet"])
def test_the_same_stream(source: Source, eager: Counter[str], kind: str) -> None:
    def stream(jobs: int) -> bytes:
        out = BytesIO()
        outcomes = list(detect_stream([source, source], out, kind, DetectOptions(jobs=jobs, cores=2)))
        assert [outcome.exit_code for outcome in outcomes] == [3, 3]
        return out.getvalue()

    assert stream(2) == stream(1)
    assert eager["taken"] > 3


def test_an_error_in_a_thread_is_one_of_the_run(
    source: Source, tmp_path: Path, eager: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    make = BatchDetector.detect

    def breaks(self: BatchDetector, batches: Any) -> BatchPart:
        if threading.current_thread() is not threading.main_thread():
            raise MemoryError("too much")
        return make(self, batches)

    monkeypatch.setattr(BatchDetector, "detect", breaks)
    with pytest.raises(MemoryError, match="too much"):
        detect_to_files(source, tmp_path, DetectOptions(cores=2))
    assert eager["taken"] > 0
    assert list(tmp_path.iterdir()) == []
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("detect")] == []


@pytest.fixture(scope="module")
def long_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Work for several seconds (with `--beams`), in a file that is quickly made and large enough for a process."""
    rows, beams = 250, 1800
    boxes = [(first, first + 30, 2.0) for first in range(100, beams - 100, 100)]
    ranges = round_room(rows, beams, *boxes)
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    write_log(path, [raw_sweeps(ranges)] * 40, compression="none")
    return path


def threads(pid: int) -> set[int]:
    """Threads of a process."""
    try:
        return {int(task.name) for task in Path(f"/proc/{pid}/task").iterdir()}
    except OSError:
        return set()


def begun(process: subprocess.Popen[bytes], helpers: Callable[[int], set[int]], count: int) -> set[int]:
    """The processes or threads that a process has started, once there are `count` of them."""
    wait_until(lambda: len(helpers(process.pid)) >= count, process)
    return helpers(process.pid)


@pytest.fixture
def detect(long_log: Path, tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """`detect --beams --jobs 2` of logs that are long and come to no end."""
    started = []
    with ExitStack() as stack:

        def start(*names: str) -> subprocess.Popen[bytes]:
            logs = [tmp_path / name for name in names]
            stack.enter_context(endless(long_log, *logs))
            options = ["-o", str(tmp_path / "out"), "--beams", "--jobs", "2"]
            command = [sys.executable, "-m", "lidarcli", "detect", *map(str, logs), *options]
            started.append(subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True))
            return started[-1]

        yield start
        for process in started:
            process.kill()
            process.communicate()


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")


@needs_proc
@pytest.mark.parametrize("writing", [False, True])
def test_an_interrupt_leaves_no_process(detect: Any, tmp_path: Path, writing: bool) -> None:
    """Ctrl-C reaches the whole group of processes: while workers come up, and while they work."""
    process = detect("long.mcap", "other.mcap")
    # Two workers and the tracker of resources.
    pids = begun(process, descendants, 2)
    if writing:
        wait_until(lambda: len(list((tmp_path / "out").glob(".*.part"))) == 2, process)
    pids |= descendants(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=HANG)
    assert (process.returncode, err.decode()) == (130, "lidarcli: interrupted\n")
    assert [*(tmp_path / "out").glob("**/*")] == []
    wait_until(lambda: gone(pids))


@needs_proc
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize(("number", "code", "said"), [("SIGINT", 130, "interrupted"), ("SIGTERM", -15, "terminated")])
def test_an_interrupt_while_threads_help(
    detect: Any, tmp_path: Path, count: int, number: str, code: int, said: str
) -> None:
    """As soon as so many threads are there, one of which reads."""
    process = detect("long.mcap")
    begun(process, threads, count)
    process.send_signal(signal.Signals[number])
    _, err = process.communicate(timeout=HANG)
    assert (process.returncode, err.decode()) == (code, f"lidarcli: {said}\n")
    assert not [*(tmp_path / "out").glob("*")]


@needs_proc
@pytest.mark.parametrize("writing", [False, True])
def test_workers_end_with_their_parent(detect: Any, tmp_path: Path, writing: bool) -> None:
    process = detect("long.mcap", "other.mcap")
    pids = begun(process, descendants, 3)
    if writing:
        wait_until(lambda: len(list((tmp_path / "out").glob(".*.part"))) == 2, process)
    process.kill()
    wait_until(lambda: gone(pids))


def _none_wanted(*arguments: object) -> None:
    raise AssertionError("help was called for")


def test_short_logs_need_no_help(source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "start_workers", _none_wanted)
    monkeypatch.setattr(detection, "Threads", _none_wanted)
    options = DetectOptions(jobs=8, cores=8)
    outcomes = list(detect_files([source, replace(source, name="again")], tmp_path, options))
    assert [outcome.exit_code for outcome in outcomes] == [3, 3]


def detecting(ahead: int | None = None, counted: int = 0, threads: int = 2) -> ParallelDetection:
    """The detection of a log of which so many sweeps were read, and so many are still to come."""
    stand_in: Any = SimpleNamespace(ahead=lambda: ahead, summary=RunSummary(sweeps=counted))
    return ParallelDetection(BatchDetector("run", ("objects",), DetectOptions()), stand_in, threads)


def parts_of(work: ParallelDetection, batches: Iterable[SweepBatch]) -> Iterator[BatchPart]:
    for batch in batches:
        yield from work.take(batch)
    yield from work.flush()


def batch_of(sweeps: int, beams: int = 360) -> SweepBatch:
    from lidarcli.formalism import sweep

    one = sweep([4.0] * 100 + [2.0] * 20 + [4.0] * (beams - 120), angle_min=-3.0, angle_increment=0.01)
    return one.rows(np.zeros(sweeps, np.int64))


@pytest.mark.parametrize(("ahead", "counted", "calls"), [(18_600, 100, True), (18_500, 100, False), (None, 100, False)])
def test_threads_are_called_for_what_lies_ahead(
    monkeypatch: pytest.MonkeyPatch, ahead: int | None, counted: int, calls: bool
) -> None:
    """2,000,000 ranges are 18,519 sweeps of 108 beams, as a hundred that were read had them."""
    monkeypatch.setattr(detection, "Threads", _none_wanted)
    with detecting(ahead, counted) as work:
        if calls:
            with pytest.raises(AssertionError, match="help was called for"):
                list(work.take(batch_of(30)))
        else:
            assert len(list(work.take(batch_of(30)))) == 1


def test_a_live_source_is_not_kept_waiting(eager: Counter[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Where every batch is taken as long in coming, its part is out before the next one is asked for."""
    monkeypatch.setattr(detection, "PATIENCE", -HANG)
    monkeypatch.setattr(detection, "BLOCK", 10**9)
    asked = Counter[str]()

    def batches() -> Iterator[SweepBatch]:
        for _ in range(4):
            asked["batches"] += 1
            yield batch_of(5)

    with detecting(10**9) as work:
        for number, part in enumerate(parts_of(work, batches()), 1):
            assert asked["batches"] == number
            assert part.counts.objects == 5
    assert (eager["started"], eager["taken"]) == (2, 0)


def test_parts_keep_their_order(eager: Counter[str]) -> None:
    """However fast the one or the other is."""
    batches = [replace(batch_of(3), sweep=np.arange(3 * k, 3 * k + 3)) for k in range(60)]
    with detecting(10**9, threads=3) as work:
        sweeps = [
            sweep for part in parts_of(work, batches) for _, _, rows in part.rows for sweep in rows["sweep"].to_pylist()
        ]
    assert sweeps == list(range(180))
    assert eager["taken"] > 3


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
def test_logs_at_the_same_time(sizes: list[int], jobs: int, expected: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Source, "size", property(lambda source: int(source.path)))
    assert over_logs.logs_at_once([Source(str(size), f"log{k}") for k, size in enumerate(sizes)], jobs) == expected


def test_processes_are_shared_between_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def side_by_side(sources: Any, work: Any, jobs: int) -> Iterator[Any]:
        asked.append((jobs, work.keywords["work"].keywords["options"].jobs))
        yield from ((source, False) for source in sources)

    monkeypatch.setattr("lidarcli.pipeline.runs.processes.side_by_side", side_by_side)
    sources = [Source(f"fifo{k}", f"log{k}") for k in range(3)]
    for jobs in (2, 3, 8):
        list(detect_files(sources, tmp_path, DetectOptions(jobs=jobs)))
    assert asked == [(2, 1), (3, 1), (3, 2)]


@pytest.mark.parametrize(
    ("quota", "expected"), [("max 100000", 6), ("150000 100000", 2), ("100 100000", 1), ("900000 100000", 6)]
)
def test_cores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quota: str, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(6)), raising=False)
    monkeypatch.setattr(machine, "_QUOTA", tmp_path / "cpu.max")
    assert machine.cores() == 6
    (tmp_path / "cpu.max").write_text(f"{quota}\n")
    assert machine.cores() == expected


def test_sweeps_without_beams_do_not_pile_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detection, "ALONE", 1)
    empty = replace(batch_of(1, 120), beams=np.zeros(1, np.int32), ranges=np.empty((1, 0), np.float32))
    empty = replace(empty, status=np.empty((1, 0), np.uint8)).rows(np.zeros(40_000, np.int64))
    taken = Counter[str]()

    def batches() -> Iterator[SweepBatch]:
        yield batch_of(30)
        for _ in range(40):
            taken["batches"] += 1
            yield empty

    with detecting(10_000, 30) as work:
        parts = parts_of(work, batches())
        next(parts)
        next(parts)
        assert taken["batches"] < 40
        list(parts)


def test_a_system_without_threads_to_give_does_without(
    source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eager: Counter[str]
) -> None:
    monkeypatch.setattr("lidarcli.pipeline.reading.one_log.WORTH_A_THREAD", 0)
    expected, _ = files(source, tmp_path / "with", DetectOptions(jobs=2, cores=2))
    start = threading.Thread.start

    def refuse(thread: threading.Thread) -> None:
        if thread.name.startswith(("detect", "read")):
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", refuse)
    eager["taken"] = 0
    found, _ = files(source, tmp_path / "without", DetectOptions(jobs=2, cores=2))
    assert found == expected
    assert eager["taken"] == 0
