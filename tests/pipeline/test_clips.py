"""Parts of logs: messages as they are, what counts from before at their begin, one log around each event."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError, OutputError, UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.ros.messages import SCAN, TF, cdr_scans, ros2_definition
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import Float64, RawSweeps
from tests.copying.reading import Message, messages, ranges
from tests.pipeline.drawn import round_about, scene_of, sweeps_of, told
from tests.places import SAMPLES
from tests.pose.pose_messages import Maker
from tests.sweeping import room_sweeps

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
MAKER = Maker("cdr")
KINDS = ("mcap", "bag", "db3")


@cache
def driven() -> list[RawSweeps]:
    return sweeps_of(scene_of())


def drive(path: Path) -> Path:
    """20 s of a drive at 10 Hz, with odometry and transforms."""
    write_log(path, driven(), poses=told(round_about(np.arange(200) * 0.1), tf=True))
    return path


def record_ns(message: Message) -> int:
    """When it was recorded: in a bag two words, in a database the second column, in an MCAP the log time."""
    first, second, *_ = message.head
    if isinstance(first, bytes):
        return int.from_bytes(first[:4], "little") * SECOND + int.from_bytes(first[4:], "little")
    return int(str(second if isinstance(message.head[2], tuple) else first))


def parts(found: list[Message]) -> list[tuple[str, bytes]]:
    return [(each.topic, each.data) for each in found]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", KINDS)
def test_a_part_has_the_messages_of_its_time_and_the_static_transforms(suffix: str, tmp_path: Path) -> None:
    log = drive(tmp_path / f"run.{suffix}")
    out = tmp_path / f"part.{suffix}"
    lidarcli.clean(log, out, remove="none", start="5s", end=7.5)
    whole, found = messages(log), messages(out)
    first, last = START + 5 * SECOND, START + 74 * SECOND // 10
    wanted = [each for each in whole if each.topic != "/tf_static" and first <= record_ns(each) <= last]
    assert (found[0].topic, found[0].data) == (whole[0].topic, whole[0].data) == ("/tf_static", whole[0].data)
    assert parts(found[1:]) == parts(wanted)
    assert [record_ns(each) for each in found[1:]] == [record_ns(each) for each in wanted]
    assert record_ns(found[0]) == first
    assert sum(each.topic == "/scan" for each in found) == 25
    (scan,) = lidarcli.info(out)[0]["scans"]
    assert scan["pose"] is not None


@pytest.mark.parametrize(
    ("suffix", "options"), [("db3", {"compression": "zstd-message"}), ("mcap", {"container": "ros2-mcap"})]
)
def test_a_part_of_a_folder_is_one_file(suffix: str, options: dict[str, str], tmp_path: Path) -> None:
    log, out = tmp_path / "run", tmp_path / f"part.{suffix}"
    write_log(log, driven(), poses=told(round_about(np.arange(200) * 0.1), tf=True), **options)
    with pytest.raises(OptionError, match=f"has to have the suffix .{suffix}"):
        lidarcli.clean(log, tmp_path / "part", remove="none", start=19)
    lidarcli.clean(log, out, remove="none", start=19)
    plain = drive(tmp_path / f"plain.{suffix}")
    lidarcli.clean(plain, tmp_path / f"other.{suffix}", remove="none", start=19)
    assert parts(messages(out)) == parts(messages(tmp_path / f"other.{suffix}"))
    assert len(messages(out)) == 31


def test_with_a_topic_other_sweeps_are_left_out_of_a_part(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    write_log(log, [each for raw in driven()[:40] for each in (raw, replace(raw, topic="/rear"))])
    lidarcli.clean(log, tmp_path / "part.mcap", remove="none", start=1, end=2, topic="/rear")
    assert [each.topic for each in messages(tmp_path / "part.mcap")] == ["/rear"] * 10
    lidarcli.clean(log, tmp_path / "both.mcap", remove="none", start=1, end=2)
    assert len(messages(tmp_path / "both.mcap")) == 20
    with pytest.raises(
        OptionError, match="no sweep lies between --start and --end: those of the log lie between 2023-11-14T"
    ):
        lidarcli.clean(log, tmp_path / "none.mcap", remove="none", start=100)
    lidarcli.clean(log, tmp_path / "day.mcap", remove="none", start="23:13:21", end="23:13:22", time_zone="+01:00")
    assert len(messages(tmp_path / "day.mcap")) == 20


def table(path: Path, rows: int = 3, **columns: object) -> Path:
    """A table with a stamp every second."""
    stamps = pa.array([START + (2 + row) * SECOND for row in range(rows)], pa.timestamp("ns", "UTC"))
    pq.write_table(pa.table({"stamp": stamps} | columns), path)
    return path


@pytest.mark.parametrize("suffix", ["mcap", "bag", "db3"])
def test_a_log_for_each_row_of_any_table(suffix: str, tmp_path: Path) -> None:
    log, rows = drive(tmp_path / f"run.{suffix}"), table(tmp_path / "t.parquet", 17, log=["run"] * 16 + ["other"])
    lidarcli.clean(log, tmp_path / "clips", remove="none", clips=rows, around="250ms")
    made = sorted((tmp_path / "clips").iterdir())
    assert [path.name for path in made] == [f"run.20231114T2213{22 + row}Z.{suffix}" for row in range(16)]
    for row, path in enumerate(made):
        found = messages(path)
        assert found[0].topic == "/tf_static"
        times = [record_ns(each) - START for each in found if each.topic == "/scan"]
        assert times == [(2 + row) * SECOND + step * SECOND // 10 for step in range(-2, 3)]
    # One more than are written in a pass over the log.
    more = table(tmp_path / "more.parquet", 17)
    lidarcli.clean(log, tmp_path / "again", remove="none", clips=more, around=0.25)
    for path in made:
        assert parts(messages(tmp_path / "again" / path.name)) == parts(messages(path))


def test_clips_that_cannot_be(tmp_path: Path) -> None:
    log = drive(tmp_path / "run.mcap")
    for columns, words in (
        ({"x": [1.0]}, "no columns start and end, and no stamp: nothing tells when to cut"),
        ({"stamp": pa.array(np.arange(1001) * SECOND + START, pa.timestamp("ns", "UTC"))}, "more than 1,000 rows"),
    ):
        pq.write_table(pa.table(columns), tmp_path / "t.parquet")
        with pytest.raises(OptionError, match=words):
            lidarcli.clean(log, tmp_path / "clips", remove="none", clips=tmp_path / "t.parquet")
    pq.write_table(pa.table({"start": ["soon"], "end": ["later"]}), tmp_path / "t.parquet")
    with pytest.raises(UnreadableError, match="start and end are no times that can be read"):
        lidarcli.clean(log, tmp_path / "clips", remove="none", clips=tmp_path / "t.parquet")
    zones = pa.array(["door"])
    stamp = pa.array([START], pa.timestamp("ns", "UTC"))
    pq.write_table(pa.Table.from_arrays([stamp, zones, zones], ["stamp", "zone", "zone"]), tmp_path / "t.parquet")
    with pytest.raises(UnreadableError, match="column zone is there 2 times"):
        lidarcli.clean(log, tmp_path / "clips", remove="none", clips=tmp_path / "t.parquet")
    rows = table(tmp_path / "t.parquet")
    lidarcli.clean(log, tmp_path / "clips", remove="none", clips=rows)
    with pytest.raises(OutputError, match="exists; use --overwrite"):
        lidarcli.clean(log, tmp_path / "clips", remove="none", clips=rows)
    assert run(["clean", str(log), "-o", str(tmp_path / "c"), "--clips", str(rows), "--start", "3"]) == 2
    assert run(["clean", str(log), "-o", str(tmp_path / "c"), "--clips", str(rows), "--around", "-1"]) == 2


@pytest.mark.slow
def test_zones_cuts_its_events(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, zones, clips = tmp_path / "people.mcap", tmp_path / "z.toml", tmp_path / "clips"
    assert run(["-q", "simulate", str(SAMPLES / "people.toml"), "-o", str(log)]) == 0
    zones.write_text(
        '[[zone]]\nname = "stop"\nframe = "sensor"\ncircle = { x = 1.5, y = 1.0, radius = 0.7 }\nmin_points = 4\n'
    )
    words = ["zones", str(log), "--zones", str(zones), "--clips", str(clips), "--around", "300ms"]
    assert run([*words, "-o", str(tmp_path / "t")]) == 0
    (event,) = pq.read_table(tmp_path / "t" / "people.events.parquet").to_pylist()
    (clip,) = clips.iterdir()
    assert clip.name == "people.stop-20231114T221323.95Z.mcap"
    times = [record_ns(each) for each in messages(clip)]
    assert times[0] >= event["start"].value - 300_000_000
    assert parts(messages(clip)) == parts([each for each in messages(log) if times[0] <= record_ns(each) <= times[-1]])
    assert run(words) == 5
    capsys.readouterr()


@pytest.mark.slow
def test_a_part_without_people_is_told_by_the_whole_log(tmp_path: Path) -> None:
    log = tmp_path / "people.mcap"
    assert run(["-q", "simulate", str(SAMPLES / "people.toml"), "-o", str(log)]) == 0
    lidarcli.clean(log, tmp_path / "whole.mcap")
    lidarcli.clean(log, tmp_path / "part.mcap", start=1, end=2, remove="agents")
    whole, part = messages(tmp_path / "whole.mcap"), messages(tmp_path / "part.mcap")
    assert parts(part) == parts(whole[20:40])


RECORDED = {
    "starts anew": lambda number: START + number % 40 * 100_000_000,
    "goes on": lambda number: START + number * 100_000_000,
    "stands": lambda number: START,
    "steps": lambda number: START + number * 37 % 80 * 100_000_000,
}


def two_runs(path: Path, recorded: Callable[[int], int]) -> Path:
    """Two runs of 4 s whose stamps start anew, each sweep with the number of its place as its first range."""
    raw = room_sweeps(count=80)
    raw.ranges[:, 0] = np.arange(80) / 100.0 + 1.0
    stamps = np.tile(raw.stamp_ns[:40], 2)
    whole = replace(raw, stamp_ns=stamps, record_ns=np.array([recorded(number) for number in range(80)]))
    write_log(path, [whole.rows(slice(number, number + 1)) for number in range(80)])
    return path


def numbers(path: Path) -> list[int]:
    return [round((ranges(each)[1][0] - 1.0) * 100) for each in messages(path) if each.topic == "/scan"]


@pytest.mark.parametrize("how", RECORDED)
@pytest.mark.parametrize("suffix", KINDS)
def test_a_part_has_the_sweeps_that_are_meant_whatever_the_recorder_says(suffix: str, how: str, tmp_path: Path) -> None:
    log = two_runs(tmp_path / f"run.{suffix}", RECORDED[how])
    lidarcli.clean(log, tmp_path / f"second.{suffix}", remove="none", run=2, start=1, end=2)
    assert numbers(tmp_path / f"second.{suffix}") == [*range(50, 60)]
    # A row that names a sweep is of its run, another one of all that have sweeps then.
    rows = table(tmp_path / "t.parquet", 1, topic=["/scan"], sweep=[60])
    lidarcli.clean(log, tmp_path / "one", remove="none", clips=rows, around=0.25)
    lidarcli.clean(log, tmp_path / "both", remove="none", clips=table(tmp_path / "u.parquet", 1), around=0.25)
    assert [numbers(path) for path in (tmp_path / "one").iterdir()] == [[58, 59, 60, 61, 62]]
    made = {path.name: numbers(path) for path in sorted((tmp_path / "both").iterdir())}
    assert made == {f"run.20231114T221322Z-run{run + 1}.{suffix}": [*range(18 + 40 * run, 23 + 40 * run)] for run in (0, 1)}


def ranges_of(path: Path) -> Float64:
    """(S, B) of a log with one topic."""
    with open_log(str(path)) as log:
        return np.concatenate([block.ranges for block in log.scans(None, ReadReport())])


def words_of(log: Path) -> list[tuple[str, bytes]]:
    return [(each.topic, each.data) for each in messages(log) if each.topic != "/scan"]


def with_words(path: Path, before: Sequence[tuple[str, bytes]], recorded: Callable[[int], int]) -> Path:
    """80 sweeps, each after a message with its number; `before` come first."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        scan = writer.register_schema(SCAN, "ros2msg", ros2_definition(SCAN).encode())
        transforms = writer.register_schema(TF, "ros2msg", ros2_definition(TF).encode())
        latched = {"offered_qos_profiles": "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"}
        topics = dict.fromkeys(["/scan", "/word", *(topic for topic, _ in before)])
        kinds = {"/scan": scan, "/tf_static": transforms}
        of = {
            name: writer.register_channel(name, "cdr", kinds.get(name, 0), latched if name == "/mode" else {})
            for name in topics
        }
        for topic, data in before:
            writer.add_message(of[topic], START - SECOND, data, START)
        for number, data in enumerate(cdr_scans(room_sweeps(count=80))):
            writer.add_message(of["/word"], recorded(number), b"%d" % number, START)
            writer.add_message(of["/scan"], recorded(number) + 1, data, START)
        writer.finish()
    return path


@pytest.mark.parametrize("how", RECORDED)
def test_other_messages_come_with_the_sweeps_around_them(how: str, tmp_path: Path) -> None:
    log = with_words(tmp_path / "run.mcap", [], RECORDED[how])
    lidarcli.clean(log, tmp_path / "part.mcap", remove="none", start=2, end=4)
    assert words_of(tmp_path / "part.mcap") == [("/word", b"%d" % number) for number in range(21, 40)]


def test_the_newest_of_what_counts_until_the_next_comes_first(tmp_path: Path) -> None:
    def transforms(number: int, *frames: str) -> tuple[str, bytes]:
        return "/tf_static", MAKER.transforms(*((START + number, "base_link", frame, (0.0, 0.0, 0.0)) for frame in frames))

    old = [transforms(number, "laser", *(["mast"] if number % 2 else [])) for number in range(1500)]
    said = [*old, transforms(1500, "camera"), ("/mode", b"old"), ("/mode", b"new"), ("/map", b"map"), ("/other", b"gone")]
    log = with_words(tmp_path / "run.mcap", said, RECORDED["goes on"])
    lidarcli.clean(log, tmp_path / "part.mcap", remove="none", start=2, end=4)
    wanted = [old[1499], said[1500], ("/mode", b"new"), ("/map", b"map")]
    assert words_of(tmp_path / "part.mcap")[:4] == wanted
    assert words_of(tmp_path / "part.mcap")[4][0] == "/word"


@pytest.mark.parametrize(
    ("name", "values"), [("zone", [5]), ("zone", [b"x"]), ("zone", [[1]]), ("log", [1.5]), ("topic", [1]), ("sweep", ["a"])]
)
def test_columns_of_other_types_are_refused(name: str, values: list[object], tmp_path: Path) -> None:
    log, rows = two_runs(tmp_path / "run.mcap", RECORDED["goes on"]), table(tmp_path / "t.parquet", 1, **{name: values})
    with pytest.raises(OptionError, match=f"column {name} is .*, not (text|integers)"):
        lidarcli.clean(log, tmp_path / "clips", remove="none", clips=rows)


def test_a_row_without_sweeps_around_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, rows = two_runs(tmp_path / "run.mcap", RECORDED["goes on"]), table(tmp_path / "t.parquet", 9)
    assert (
        run(["clean", str(log), "-o", str(tmp_path / "c"), "--remove", "none", "--clips", str(rows), "--around", "0.1"])
        == 0
    )
    assert "6 rows of" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_what_is_told_of_a_part_is_of_the_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = tmp_path / "people.mcap", tmp_path / "part.mcap"
    assert run(["-q", "simulate", str(SAMPLES / "people.toml"), "-o", str(log)]) == 0
    capsys.readouterr()
    words = ["clean", str(log), "-o", str(out), "--start", "2s", "--end", "3s", "--mend", "limits", "--range", "0.2", "20"]
    assert run([*words, "--remove", "agents", "--format", "json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["logs"]
    (batch,) = lidarcli.read(out)
    rows = pq.read_table(tmp_path / "part.cleaned.parquet")
    lost = int(np.isnan(ranges_of(out)).sum() - np.isnan(ranges_of(log)[40:60]).sum())
    assert (told["sweeps"], rows.num_rows, rows["sweep"].to_pylist()) == (20, 20, [*range(40, 60)])
    assert sum(told["removed"].values()) == lost == sum(sum(rows[name].to_pylist()) for name in ("agents", "margin"))
    assert (sum(told["beams"].values()), told["mended"]) == (int(batch.beams.sum()), {"/scan": {"limits": 20}})
    assert json.loads(rows.schema.metadata[b"lidarcli.parameters"])["start"] == 2.0
    assert run([*words[:8], "--overwrite", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["logs"][0]["sweeps"] == 20
