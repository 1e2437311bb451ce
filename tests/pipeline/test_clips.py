"""Parts of logs: messages as they are, what counts from before at their begin, one log around each event."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError, OutputError, UnreadableError
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps import RawSweeps
from tests.copying.reading import Message, messages
from tests.pipeline.drawn import round_about, scene_of, sweeps_of, told
from tests.places import SAMPLES

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
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
    with pytest.raises(OptionError, match="no sweep lies between --start and --end"):
        lidarcli.clean(log, tmp_path / "none.mcap", remove="none", start=100)


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
    lidarcli.clean(log, tmp_path / "part.mcap", start=1, end=2)
    whole, part = messages(tmp_path / "whole.mcap"), messages(tmp_path / "part.mcap")
    assert parts(part) == parts(whole[20:40])
