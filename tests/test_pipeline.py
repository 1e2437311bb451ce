"""The pipeline: which logs are meant, one log into tables, several logs, and what a log holds."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.errors import NoScanError, OptionError, OutputError, UnreadableError
from lidarcli.formalism import Parameters
from lidarcli.logs import open_log
from lidarcli.logs.base import LASERSCAN, CsvOptions, Message, ReadReport, Topic
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline import detecting, inspecting, workers
from lidarcli.pipeline.clock import Clock, Sample
from lidarcli.pipeline.detecting import DetectOptions, detect_to_files
from lidarcli.pipeline.inputs import Nothing, Source, find_logs, log_name, refuse_clashes
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.many import Outcome, detect_files, exit_code, outcome_of
from lidarcli.pipeline.summary import damage_lines
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import RawSweeps
from lidarcli.tables import OBJECTS
from tests.sweeping import START, STEP, raw_sweeps
from tests.unprivileged import lidarcli as lidarcli_command


def block(topic: str = "/scan", sweeps: int = 4, first: int = 0, beams: int = 360) -> RawSweeps:
    """Sweeps of a round room with one box in it."""
    ranges = np.full((sweeps, beams), 4.0, np.float32)
    ranges[:, 40:60] = 2.0
    stamps = START + STEP * np.arange(first, first + sweeps)
    return raw_sweeps(ranges, topic=topic, stamp_ns=stamps, record_ns=stamps + STEP // 2)


class FakeLog:
    """A log in memory."""

    format = "fake"
    compression = "none"
    size = 1234

    def __init__(
        self, blocks: list[RawSweeps], topics: list[Topic] | None, damage: str | None = None
    ) -> None:
        self.path = "run.fake"
        self.position = 0
        self.met = ReadReport()
        """What a pass over the sweeps meets."""
        self._blocks = blocks
        self._topics = topics
        if damage:
            self.met.add_damage("byte 99", damage)

    def topics(self) -> list[Topic] | None:
        return self._topics

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        report.add(self.met)
        for part in self._blocks:
            self.position += 100
            if topics is None or part.topic in topics:
                yield part

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        yield from ()

    def close(self) -> None: ...

    def __enter__(self) -> FakeLog:
        return self

    def __exit__(self, *exc: object) -> None: ...


Opens = Callable[..., FakeLog]


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Opens:
    """Make opening return a fake log."""

    def opens(*blocks: RawSweeps, topics: list[Topic] | None = None, damage: str | None = None) -> FakeLog:
        log = FakeLog(list(blocks), topics, damage)
        for module in (detecting, inspecting):
            monkeypatch.setattr(module, "open_source", lambda source, csv: log)
        return log

    return opens


SOURCE = Source("run.fake", "run")
SCAN = Topic("/scan", LASERSCAN, "cdr", 4)
CLOUD = Topic("/cloud", "sensor_msgs/msg/PointCloud2", "cdr", 7)


def asking(*topics: str) -> DetectOptions:
    return DetectOptions(read=ReadOptions(topics=frozenset(topics) if topics else None))


# --- which logs are meant ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("run.mcap", "run"),
        ("RUN.MCAP", "RUN"),
        ("x.csv.gz", "x"),
        ("a.bag.active", "a"),
        ("b.db3.zstd", "b"),
        ("trip.2024.bag", "trip.2024"),
        ("noext", "noext"),
        (".mcap", ".mcap"),
        ("scan.log", "scan"),
    ],
)
def test_log_names(name: str, expected: str) -> None:
    assert log_name(Path(name)) == expected


def test_folders_are_searched_and_logs_keep_their_place(tmp_path: Path) -> None:
    for name in (
        "b.mcap",
        "sub/a.bag",
        "sub/deep/c.CSV",
        "sub/readme.md",
        "sub/x.bag.active",
        "._b.mcap",
        ".trash/d.bag",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    bag = tmp_path / "sub" / "trip"
    bag.mkdir()
    for name in ("metadata.yaml", "trip_0.db3", "trip_1.db3", "scan.csv"):
        (bag / name).touch()
    (tmp_path / "sub" / "loop").symlink_to(tmp_path)
    os.mkfifo(tmp_path / "pipe.mcap")
    found = find_logs([str(tmp_path)])
    assert [source.name for source in found if isinstance(source, Source)] == [
        "b",
        "sub/a",
        "sub/deep/c",
        "sub/trip",
        "sub/x",
    ]
    assert found[3] == Source(str(bag), "sub/trip")


def test_a_bag_that_lost_its_metadata_is_one_log_but_loose_files_are_not(tmp_path: Path) -> None:
    lost, loose = tmp_path / "lost", tmp_path / "loose"
    lost.mkdir()
    loose.mkdir()
    for path in (lost / "run_0.db3", lost / "run_1.db3", loose / "a_0.db3", loose / "b_0.db3"):
        path.touch()
    assert [source.label for source in find_logs([str(lost)])] == [str(lost)]
    assert [Path(source.label).name for source in find_logs([str(loose)])] == ["a_0.db3", "b_0.db3"]


def test_files_with_one_sweep_each_are_one_log(tmp_path: Path) -> None:
    folder = tmp_path / "sweeps"
    folder.mkdir()
    text = "theta,r\n" + "".join(f"{k / 100},2.5\n" for k in range(100))
    for k in range(3):
        (folder / f"sweep_{k}.csv").write_text(text)
    (folder / "README.md").write_text("How these were made.\n")
    assert find_logs([str(tmp_path)]) == [Source(str(folder), "sweeps")]
    assert find_logs([str(folder)]) == [Source(str(folder), "sweeps")]
    pattern = str(folder / "*.csv")
    (source,) = find_logs([pattern])
    assert source == Source(pattern, "sweeps", tuple(str(folder / f"sweep_{k}.csv") for k in range(3)))
    assert inspect_log(source).scans[0].sweeps == 3
    assert inspect_log(Source(str(folder), "sweeps")).scans[0].sweeps == 3


def test_a_pattern_of_other_logs_is_several(tmp_path: Path) -> None:
    for name in ("b.mcap", "a.mcap"):
        (tmp_path / name).touch()
    assert [Path(source.label).name for source in find_logs([str(tmp_path / "*.mcap")])] == [
        "a.mcap",
        "b.mcap",
    ]


def test_what_is_no_log(tmp_path: Path) -> None:
    (tmp_path / "dangling.mcap").symlink_to("nowhere")
    inputs = [str(tmp_path / "absent.mcap"), str(tmp_path / "dangling.mcap"), str(tmp_path)]
    (tmp_path / "empty").mkdir()
    inputs[2] = str(tmp_path / "empty")
    errors = [str(source.error) for source in find_logs(inputs) if isinstance(source, Nothing)]
    assert errors == [
        "no such file or folder",
        "the link leads to nothing",
        "no log in this folder (searched for *.mcap *.bag *.active *.db3 *.csv *.csv.gz *.zstd)",
    ]


def test_standard_input_is_a_log() -> None:
    assert find_logs(["-"]) == [Source("-", "stdin")]
    assert Source("-", "stdin").label == "standard input"


def test_clashing_outputs_are_refused() -> None:
    sources = [Source("a/run.mcap", "run"), Source("b/run.bag", "run")]
    with pytest.raises(OptionError) as caught:
        refuse_clashes(sources)
    assert str(caught.value) == "a/run.mcap and b/run.bag would both write run.*; run them apart with -o"
    refuse_clashes([Source("a/run.mcap", "a/run"), Source("b/run.bag", "b/run")])


# --- one log ----------------------------------------------------------------------------------------------


def test_tables_of_one_log(tmp_path: Path, opened: Opens) -> None:
    opened(block(), topics=[SCAN, CLOUD])
    positions: list[int] = []
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions(beams=True), positions.append)
    assert (summary.sweeps, summary.objects, summary.beams) == (4, 4, 1440)
    assert summary.by_status == {"valid": 1440, "no_return": 0, "too_close": 0, "invalid": 0}
    assert summary.by_set == {"O": 80, "A": 0, "S": 1360}
    assert summary.exit_code == 0
    assert positions == [100]
    objects = pq.read_table(tmp_path / "run.objects.parquet").to_pylist()
    assert [(row["sweep"], row["object"], row["beam_i"], row["beam_f"]) for row in objects] == [
        (sweep, 1, 40, 59) for sweep in range(4)
    ]
    assert pq.read_table(tmp_path / "run.beams.parquet").num_rows == 1440
    metadata = pq.read_schema(tmp_path / "run.sweeps.parquet").metadata
    assert metadata[b"lidarcli.source"] == b'{"format": "fake", "name": "run.fake", "size": 1234}'
    assert b"lidarcli.damage" not in metadata
    assert summary.outputs == [
        str(tmp_path / f"run.{table}.parquet") for table in ("objects", "sweeps", "beams")
    ]


def test_parameters_are_in_the_metadata_and_nothing_else(tmp_path: Path) -> None:
    options = DetectOptions(
        parameters=Parameters.for_profile("paper"),
        read=ReadOptions(topics=frozenset({"/b", "/a"}), start=1.0, every=2),
        csv=CsvOptions(fov=1.5, range_scale=0.001),
    )
    assert options.as_dict() == {
        **Parameters.for_profile("paper").as_dict(),
        "topics": ["/a", "/b"],
        "start": 1.0,
        "end": None,
        "every": 2,
        "range": None,
        "no_return": ["above", "inf", "max", "zero"],
        "csv": {"fov": 1.5, "range_scale": 0.001},
    }


def test_damage_is_in_the_metadata_and_the_rest_in_the_tables(tmp_path: Path, opened: Opens) -> None:
    opened(block(), topics=[SCAN], damage="cut off")
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions())
    assert summary.damage == ["byte 99: cut off"]
    assert summary.exit_code == 3
    assert (
        pq.read_schema(tmp_path / "run.objects.parquet").metadata[b"lidarcli.damage"]
        == b'["byte 99: cut off"]'
    )
    assert pq.read_table(tmp_path / "run.sweeps.parquet").num_rows == 4


def test_messages_that_are_refused_count_as_damage(tmp_path: Path, opened: Opens) -> None:
    log = opened(block(), topics=[SCAN])
    log.met.refused["/scan", "NaN geometry"] = 2000
    log.met.refused["/rear", "NaN geometry"] = 1
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions())
    assert (summary.sweeps, summary.exit_code) == (4, 3)
    assert summary.damage == [
        "topic /rear: 1 message left out: NaN geometry",
        "topic /scan: 2,000 messages left out: NaN geometry",
    ]
    metadata = pq.read_schema(tmp_path / "run.sweeps.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"]) == summary.damage


def test_damage_lines_are_few_whatever_the_log_does() -> None:
    report = ReadReport()
    for index in range(100):
        report.refused[f"/topic{index:03}", "NaN geometry"] = 2
        report.add_damage(f"byte {index}", "broken")
    lines = damage_lines(report)
    assert len(lines) == 42
    assert lines[19:22] == [
        "byte 19: broken",
        "and 80 more damaged parts",
        "topic /topic000: 2 messages left out: NaN geometry",
    ]
    assert lines[41] == "and 160 more messages left out"


def test_topic_without_messages_gives_empty_tables(tmp_path: Path, opened: Opens) -> None:
    opened(topics=[replace(SCAN, messages=0)])
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions())
    assert (summary.sweeps, summary.exit_code) == (0, 0)
    assert pq.read_table(tmp_path / "run.objects.parquet").num_rows == 0


@pytest.mark.parametrize(
    ("topics", "asked", "message"),
    [
        ([CLOUD], (), "no LaserScan topic in this log (its topics: /cloud sensor_msgs/msg/PointCloud2)"),
        ([], (), "no LaserScan topic in this log (it has no topics)"),
        (None, (), "no LaserScan in it"),
        ([SCAN], ("/front",), "no LaserScan topic /front in this log (its LaserScan topics: /scan)"),
        ([SCAN, CLOUD], ("/cloud",), "topic /cloud is sensor_msgs/msg/PointCloud2, not a LaserScan"),
    ],
)
@pytest.mark.parametrize("damage", [None, "cut off"])
def test_no_scan(
    tmp_path: Path,
    opened: Opens,
    topics: list[Topic] | None,
    asked: tuple[str, ...],
    message: str,
    damage: str | None,
) -> None:
    opened(topics=topics, damage=damage)
    with pytest.raises(UnreadableError if damage else NoScanError) as caught:
        detect_to_files(SOURCE, tmp_path, asking(*asked))
    if damage:
        named = f" topic {asked[0]}" if asked else ""
        message = f"no LaserScan{named} in the part that could be read; byte 99: cut off"
    assert str(caught.value).removeprefix("run.fake: ") == message
    assert list(tmp_path.iterdir()) == []


def test_one_of_two_topics_missing(tmp_path: Path, opened: Opens) -> None:
    opened(block(), topics=[SCAN])
    summary = detect_to_files(SOURCE, tmp_path, asking("/scan", "/front"))
    assert (summary.sweeps, summary.missing_topics, summary.exit_code) == (4, ("/front",), 4)


@pytest.mark.parametrize("known", [True, False])
def test_one_of_two_topics_missing_where_topics_show_late(tmp_path: Path, opened: Opens, known: bool) -> None:
    opened(block(), topics=[SCAN] if known else None)
    summary = detect_to_files(SOURCE, tmp_path, asking("/scan", "/front"))
    assert (summary.sweeps, summary.missing_topics) == (4, ("/front",))


def test_a_leading_slash_makes_no_difference(tmp_path: Path, opened: Opens) -> None:
    opened(block("scan"), topics=[replace(SCAN, name="scan")])
    assert detect_to_files(SOURCE, tmp_path, asking("/scan")).sweeps == 4


@pytest.mark.parametrize("known", [True, False])
def test_topics_come_out_sorted(tmp_path: Path, opened: Opens, known: bool) -> None:
    blocks = [block("/b", 2), block("/a", 3), block("/b", 2, first=2), block("/a", 1, first=3)]
    topics = [replace(SCAN, name="/b"), replace(SCAN, name="/a")] if known else None
    opened(*blocks, topics=topics)
    detect_to_files(SOURCE, tmp_path, DetectOptions())
    rows = pq.read_table(tmp_path / "run.sweeps.parquet").to_pylist()
    assert [(row["topic"], row["sweep"]) for row in rows] == [
        *(("/a", sweep) for sweep in range(4)),
        *(("/b", sweep) for sweep in range(4)),
    ]


def test_existing_output_is_refused_before_the_log_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened: Opens
) -> None:
    (tmp_path / "run.sweeps.parquet").write_text("mine")
    monkeypatch.setattr(detecting, "open_source", lambda source, csv: pytest.fail("opened"))
    with pytest.raises(OutputError, match=r"run\.sweeps\.parquet exists"):
        detect_to_files(SOURCE, tmp_path, DetectOptions())
    opened(block(), topics=[SCAN])
    detect_to_files(SOURCE, tmp_path, DetectOptions(overwrite=True))
    assert pq.read_table(tmp_path / "run.sweeps.parquet").num_rows == 4


# --- several logs -----------------------------------------------------------------------------------------


def test_one_bad_log_does_not_stop_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def opens(source: Source, csv: CsvOptions) -> FakeLog:
        if source.path == "bad":
            raise UnreadableError("bad: byte 0: not a log")
        if source.path == "bug":
            raise ZeroDivisionError("oops")
        return FakeLog([block()], [SCAN])

    monkeypatch.setattr(detecting, "open_source", opens)
    sources = [Source(name, name) for name in ("bad", "bug", "good")]
    absent = Nothing("absent", UnreadableError("no such file or folder"))
    outcomes = list(detect_files([*sources, absent], tmp_path, DetectOptions()))
    assert [(outcome.label, outcome.exit_code, outcome.error) for outcome in outcomes] == [
        ("bad", 3, "byte 0: not a log"),
        ("bug", 70, "internal error: ZeroDivisionError: oops"),
        ("good", 0, None),
        ("absent", 3, "no such file or folder"),
    ]
    assert "Traceback" in (outcomes[1].trace or "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["good.objects.parquet", "good.sweeps.parquet"]


def test_system_errors_while_reading_are_no_bugs() -> None:
    def fails(source: Source) -> detecting.RunSummary:
        raise OSError(5, "Input/output error")

    assert outcome_of(SOURCE, fails) == Outcome("run.fake", 3, error="Input/output error")


def test_a_closed_pipe_is_not_the_fault_of_a_log() -> None:
    def fails(source: Source) -> detecting.RunSummary:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        outcome_of(SOURCE, fails)


def test_first_code_that_is_not_zero_wins() -> None:
    assert exit_code([0, 4, 3]) == 4
    assert exit_code([0, 0]) == 0


def _dies_once(source: Source | Nothing, folder: Path, options: DetectOptions) -> Outcome:
    """Stands in for the work of a worker: the log `dies` kills its process the first time, `fatal` every time."""
    mark = folder / f"{source.label}.tried"
    if source.label == "fatal" or (source.label == "dies" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(source.label, 0)


def test_a_dead_worker_costs_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_work", _dies_once)
    sources = [Source(name, name) for name in ("a", "dies", "b", "c")]
    outcomes = list(workers.side_by_side(sources, tmp_path, DetectOptions(), 2))
    assert [(outcome.label, outcome.exit_code) for outcome in outcomes] == [
        (name.path, 0) for name in sources
    ]
    assert outcomes[1].remark == "a worker process died; this log was done again"


def test_a_log_that_kills_every_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_work", _dies_once)
    sources = [Source(name, name) for name in ("a", "fatal", "b")]
    outcomes = list(workers.side_by_side(sources, tmp_path, DetectOptions(), 2))
    assert [(outcome.label, outcome.exit_code) for outcome in outcomes] == [("a", 0), ("fatal", 70), ("b", 0)]
    assert outcomes[1].error == (
        "its worker process died twice, ended by the system (out of memory?); try it alone with --jobs 1"
    )


# --- what is in a log -------------------------------------------------------------------------------------


def test_inspection(opened: Opens) -> None:
    wide = replace(block(sweeps=2, first=4, beams=361), angle_increment=np.full(2, 2 * np.pi / 360))
    odom = Topic("/odom", "nav_msgs/msg/Odometry", "cdr", 9)
    log = opened(block(), wide, topics=[replace(SCAN, messages=None), odom])
    log.met.refused["/scan", "NaN geometry"] = 2
    info = inspect_log(SOURCE)
    assert info.exit_code == 3
    assert info.damage == ("topic /scan: 2 messages left out: NaN geometry",)
    assert info.topics == (odom, replace(SCAN, messages=6))
    assert info.pose_topics == ("/odom",)
    assert info.dropped == (("/scan", "NaN geometry", 2),)
    (scan,) = info.scans
    assert (scan.topic, scan.frame_id, scan.sweeps) == ("/scan", "laser", 6)
    assert (scan.beams.low, scan.beams.high) == (360, 361)
    assert (scan.view.low, scan.view.high) == pytest.approx((2 * np.pi, 2 * np.pi))
    assert scan.closure == ("closed", "shared")
    assert scan.by_status == {"valid": 4 * 360 + 2 * 361, "no_return": 0, "too_close": 0, "invalid": 0}
    assert scan.clock.rate == pytest.approx(10)
    assert scan.clock.span == pytest.approx(0.5)
    assert scan.clock.offset == pytest.approx(0.05)
    assert scan.clock.monotonic


def test_two_publishers_on_one_topic_stay_apart(opened: Opens) -> None:
    one = block(sweeps=6)
    mixed = replace(one, frame_ids=("left", "right"), frame=np.arange(6, dtype=np.int32) % 2)
    opened(mixed, topics=[SCAN])
    scans = inspect_log(SOURCE).scans
    assert [(scan.frame_id, scan.sweeps, scan.clock.rate) for scan in scans] == [
        ("left", 3, pytest.approx(5)),
        ("right", 3, pytest.approx(5)),
    ]


def test_a_new_frame_in_every_sweep_is_no_way_to_fill_the_memory(
    opened: Opens, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inspecting, "MAX_SCANS", 3)
    one = block(sweeps=6)
    names = tuple(f"laser{k}" for k in range(6))
    mixed = replace(one, frame_ids=names, frame=np.arange(6, dtype=np.int32))
    opened(mixed, mixed, topics=[replace(SCAN, messages=None)])
    info = inspect_log(SOURCE)
    assert [(scan.frame_id, scan.sweeps) for scan in info.scans] == [(name, 2) for name in names[:3]]
    assert info.notes == ("6 sweeps are counted and no more: there are over 3 frames and topics",)
    assert info.topics == (replace(SCAN, messages=12),)


@pytest.mark.parametrize(("damage", "code"), [(None, 4), ("cut off", 3)])
def test_inspection_without_scans(opened: Opens, damage: str | None, code: int) -> None:
    opened(topics=[CLOUD], damage=damage)
    info = inspect_log(SOURCE)
    assert (info.exit_code, info.scans, info.topics) == (code, (), (CLOUD,))


def test_clock_that_jumps_and_stops() -> None:
    clock = Clock()
    seconds = np.array([10.0, 10.1, 9.6, 9.7, 9.8])
    stamps = (seconds * 1e9).astype(np.int64)
    first = block(sweeps=5)
    clock.add(replace(first, stamp_ns=stamps, record_ns=stamps + 7_000_000_000))
    clock.add(replace(block(sweeps=1), stamp_ns=np.array([0]), record_ns=np.array([9_900_000_000])))
    info = clock.info()
    assert (info.backward, info.zero_stamps, info.monotonic) == (1, 1, False)
    assert info.largest_backward == pytest.approx(0.5)
    assert info.rate == pytest.approx(10)
    assert info.offset == pytest.approx(7)
    assert info.span == pytest.approx(0.5)


def test_clock_does_not_depend_on_the_blocks() -> None:
    whole, parts = Clock(), Clock()
    sweeps = block(sweeps=20)
    whole.add(sweeps)
    for k in range(0, 20, 3):
        parts.add(sweeps.rows(slice(k, k + 3)))
    assert parts.info() == whole.info()


def test_sample_is_every_nth_value_whatever_the_pieces() -> None:
    values = np.arange(1000)
    for size in (1, 7, 64, 1000):
        sample = Sample(kept=100)
        for first in range(0, 1000, size):
            sample.add(values[first : first + size])
        assert np.concatenate(sample._parts).tolist() == values[:: sample._stride].tolist()
        assert sample._count <= 100
        assert sample.median() == pytest.approx(499.5, abs=8)
    assert Sample().median() is None


# --- Python -----------------------------------------------------------------------------------------------


def test_detect_batches_in_python() -> None:
    batch = lidarcli.formalism.sweep(block().ranges, angle_increment=np.pi / 180)
    table = lidarcli.detect(batch)
    assert table.num_rows == 4
    assert table["beam_i"].to_pylist() == [40] * 4
    assert lidarcli.detect([batch, batch]).num_rows == 8


def test_read_and_detect_a_log_in_python(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [block("/b"), block("/a")])
    batches = list(lidarcli.read(path, topics=["/b"], every=2))
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
        lidarcli.detect(Path(__file__).parent.parent / "samples" / "room.mcap", start=100)
    with pytest.warns(UserWarning, match=re.escape(f"{path}: byte ")):
        assert sum(len(batch) for batch in lidarcli.read(path)) == table.num_rows


def test_options_of_reading_need_a_path() -> None:
    batch = lidarcli.formalism.sweep(block().ranges, angle_increment=np.pi / 180)
    with pytest.raises(TypeError, match=r"^only a log can be read with every$"):
        lidarcli.detect(batch, every=2)


def test_what_may_not_be_looked_into_is_told(tmp_path: Path) -> None:
    folder = logs_apart(tmp_path / "logs")
    # Not a folder of its own name, so that its order among the logs shows.
    shut = folder / "deep"
    for mode, cause in ((0o000, "cannot be searched"), (0o400, "cannot be opened")):
        shut.chmod(mode)
        code, err = lidarcli_command("-q", "detect", folder, "-o", tmp_path / "out", "--overwrite")
        place = shut if mode == 0 else shut / "c.bag"
        assert (code, err) == (3, f"lidarcli: {place}: {cause}: Permission denied\n")
        assert sorted(path.name for path in (tmp_path / "out").glob("*.sweeps.parquet")) == [
            "drive.sweeps.parquet",
            "run 1.sweeps.parquet",
        ]
        assert lidarcli_command("-q", "info", folder)[0] == 3
        assert lidarcli_command("-q", "info", shut / "c.bag")[0] == 3
    shut.chmod(0o700)
    (folder / "drive.db3").chmod(0)
    code, err = lidarcli_command("-q", "info", folder / "drive.db3")
    assert (code, err) == (3, f"lidarcli: {folder}/drive.db3: cannot be opened: Permission denied\n")
    folder.chmod(0)
    assert lidarcli_command("-q", "info", folder) == (
        3,
        f"lidarcli: {folder}: cannot be searched: Permission denied\n",
    )
    folder.chmod(0o700)


def logs_apart(folder: Path) -> Path:
    """A folder of three unrelated logs, one of which knows where the sensor was."""
    samples = Path(__file__).parent.parent / "samples"
    (folder / "deep").mkdir(parents=True)
    for name, place in (
        ("drive.db3", "drive.db3"),
        ("room.mcap", "run 1.mcap"),
        ("corridor.bag", "deep/c.bag"),
    ):
        shutil.copy(samples / name, folder / place)
    return folder


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
    shutil.copytree(Path(__file__).parent.parent / "samples" / "hall", bag)
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
    assert lidarcli.detect(path, topics="/scan").num_rows == 4
    assert lidarcli.detect(path, max_width=0.1).num_rows == 0
    assert (
        lidarcli.detect(path, profile="paper").schema.metadata[b"lidarcli.parameters"].count(b'"paper"') == 1
    )
    for call, error, words in (
        (
            lambda: lidarcli.detect(path, max_widht=1),
            TypeError,
            "detect() has no option 'max_widht'; did you mean 'max_width'?",
        ),
        (
            lambda: lidarcli.detect(path, Parameters(), max_width=1),
            TypeError,
            "give either parameters or max_width",
        ),
        (lambda: lidarcli.detect([1]), TypeError, "a log is the path of a file or folder, not int"),
        (lambda: lidarcli.detect(path, path), TypeError, "parameters have to be Parameters, not PosixPath"),
        (
            lambda: lidarcli.read(path, every=0),
            OptionError,
            "--every: 0 is no whole number from 1 to 1,000,000",
        ),
        (
            lambda: lidarcli.read(path, every=2.5),
            OptionError,
            "--every: 2.5 is no whole number from 1 to 1,000,000",
        ),
        (
            lambda: lidarcli.read(path, start=float("nan")),
            OptionError,
            "--start: nan is no number of seconds",
        ),
        (lambda: lidarcli.read(path, start=5, end=1), OptionError, "--start 5 is not before --end 1"),
        (
            lambda: lidarcli.detect(path, background=[]),
            OptionError,
            "a background of no sensor: nothing can be compared with it",
        ),
        (lambda: lidarcli.read(tmp_path / "no"), UnreadableError, f"{tmp_path}/no: no such file or folder"),
        (
            lambda: lidarcli.detect([path, tmp_path / "no"]),
            UnreadableError,
            f"{tmp_path}/no: no such file or folder",
        ),
    ):
        with pytest.raises(error) as caught:
            call()
        assert str(caught.value) == words


@pytest.mark.parametrize(
    ("start", "end", "window"),
    [(100.0, None, "from 100 s on"), (7.0, 9.0, "from 7 s on and before 9 s"), (None, 0.0, "before 0 s")],
)
def test_a_window_beyond_the_log_is_told(
    tmp_path: Path, start: float | None, end: float | None, window: str
) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [block("/scan")])
    options = DetectOptions(read=ReadOptions(start=start, end=end))
    summary = detect_to_files(Source(str(path), "run"), tmp_path, options)
    assert (summary.sweeps, summary.exit_code) == (0, 0)
    assert summary.notes == [
        f"no sweep of /scan {window}: its sweeps lie between 0.0 and 0.3 s, counted from the first one"
    ]


def test_unknown_name_of_the_package() -> None:
    with pytest.raises(AttributeError, match=r"^module 'lidarcli' has no attribute 'nonsense'$"):
        _ = lidarcli.nonsense
