"""A log that is written in another way, at another time or with other names tells the same but for what was changed."""

from __future__ import annotations

import os
import warnings
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pytest

import lidarcli
from lidarcli.pipeline.api import options as api
from tests.metamorphic.changes import CHANGES, Change
from tests.metamorphic.recordings import ODOMETRY, TRANSFORMS, Messages, messages_of, write_mcap
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.test_containers_agree import same, values

pytestmark = pytest.mark.slow

LOGS = {
    "room.mcap": 1.5,
    "corridor.bag": 1.0,
    "hall": 1.5,
    "reflectors.mcap": 1.0,
    "people.csv.gz": 1.5,
    "drive.db3": 4.0,
    "two_lasers.zip": 1.0,
}
"""Sample → seconds of it."""
REAL = {
    "obstacle_detector/scans_demo.bag": 2.0,
    "leg_tracker/negative_2.bag": 1.0,
    "datmo/parallel.bag": 2.0,
    "robots_ii/mylaserdata_20151128.bag": 2.0,
    "turtlebot/topics.bag": 2.0,
    "pr2/mylaserdata.bag": 2.0,
    "ros2_selfdriving/full_bag_nav": 4.0,
    "my_gazebo_tutorials/20_53_49": 2.0,
}
WHOLE = ["corridor.bag", "hall", "reflectors.mcap", "two_lasers.zip", *[*REAL][1:]]
"""Logs of the long suite alone."""
ZONES = """
[[zone]]
name = "near"
circle = { x = 0.2, y = 0.1, radius = 2.2 }
count = "things"
"""
MOVING = """
[[zone]]
name = "ahead"
frame = "robot"
polygon = [[0.3, -0.6], [1.9, -0.6], [1.9, 0.6], [0.3, 0.6]]
hold = 0.3

[[zone]]
name = "door"
frame = "world"
line = [[-1.0, -1.5], [2.0, -1.0]]
"""

STILL = ("datmo/parallel.bag",)
"""Recordings whose poses do not lead to the sensor."""
FAULTS = {
    (
        "pr2/mylaserdata.bag",
        "transforms twice",
    ): "the rate of poses, and how long the ends hold, count poses of one stamp twice"
}
"""What differs although nothing was changed that counts."""
SAID = ("sweeps", "beams", "closure", "rate", "span", "beams_by_status", "pose_verdict", "pose_drift", "beam_order")

Found = dict[str, Any]


@cache
def log_of(name: str) -> Messages:
    """The messages of a stretch of a log."""
    if name in REAL:
        return messages_of(REAL_LOGS / name, REAL[name])
    if not name.endswith(".zip"):
        return messages_of(SAMPLES / name, LOGS[name])
    with TemporaryDirectory() as folder, zipfile.ZipFile(SAMPLES / name) as packed:
        (member,) = packed.namelist()
        return messages_of(Path(packed.extract(member, folder)), LOGS[name])


@cache
def expected(name: str, **options: Any) -> Found:
    """The tables of a log as it was."""
    with TemporaryDirectory() as folder:
        return found_in(write_mcap(Path(folder) / "run.mcap", log_of(name)), name, Path(folder), **options)


def found_in(log: Path | list[Path], name: str, folder: Path, batch_size: int | None = None, **options: Any) -> Found:
    """All tables of a log by name, its map where poses lead to it, and what `info` says of its sweeps."""
    zones = folder / "zones.toml"
    moves = name not in STILL and any(message.type in (TRANSFORMS, ODOMETRY) for message in log_of(name))
    zones.write_text(ZONES + MOVING * moves)
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patching:
        warnings.simplefilter("ignore")
        if batch_size is not None:
            read = api.read_options
            patching.setattr(api, "read_options", lambda values: replace(read(values), batch_size=batch_size))
        objects, sweeps, tracks = lidarcli.track(log, **options)
        watched = lidarcli.zones(log, zones=zones, **options)
        found = {"objects": objects, "sweeps": sweeps, "tracks": tracks, "detected": lidarcli.detect(log, **options)}
        found |= {"events": watched.events, "zones": watched.zones}
        if moves:
            grid = lidarcli.map(log, **options)
            found["map"] = grid.resolution, grid.x, grid.y, grid.cells.tolist()
        (said,) = lidarcli.info(log, join=options.get("join", False))
    found["info"] = [{word: scan[word] for word in SAID} for scan in said["scans"]]
    return found


def check(name: str, change: Change, folder: Path) -> None:
    """All is as it was but for what the change says."""
    log = log_of(name)
    was = expected(name, **change.against)
    now = found_in(change.make(log, folder), name, folder, **change.options)
    assert now.keys() == was.keys()
    for table, want in was.items():
        got = now[table]
        if not isinstance(want, pa.Table):
            assert change.against or got == want
            continue
        assert (got.column_names, got.num_rows) == (want.column_names, want.num_rows), table
        if change.against:
            want = renumbered(want, was["sweeps"])
        for column in got.column_names:
            if column != "log":
                wanted = changed(column, values(want[column]), change, change.shift(log))
                same(f"{table}.{column}", values(got[column]), wanted, change.error)


def renumbered(table: pa.Table, sweeps: pa.Table) -> pa.Table:
    """The table with sweeps and times that count from the first that was read."""
    for column in {"t", "sweep", "first_sweep", "last_sweep"} & {*table.column_names}:
        first = pc.min(sweeps["t" if column == "t" else "sweep"])
        moved = pc.subtract(table[column], first)
        table = table.set_column(table.column_names.index(column), column, moved)
    return table


def changed(column: str, was: pa.Array, change: Change, shift: int) -> pa.Array:
    """A column of the log as it was, with what was changed."""
    if pa.types.is_timestamp(was.type):
        return pc.add(was, pa.scalar(shift, pa.duration("ns")))
    if column in ("topic", "frame_id"):
        renamed = change.topic if column == "topic" else change.frame
        return pa.array([None if each is None else renamed(each) for each in was.to_pylist()], was.type)
    return was


def cases(logs: dict[str, float]) -> list[Any]:
    """Every change of every log that it is one of."""
    marks = {name: [pytest.mark.whole] if name in WHOLE else [] for name in logs}
    return [
        pytest.param(
            name,
            change,
            marks=[*marks[name], *([pytest.mark.xfail(reason=FAULTS[name, change])] if (name, change) in FAULTS else [])],
        )
        for name in logs
        for change, made in CHANGES.items()
        if made.of(log_of(name))
    ]


@pytest.mark.parametrize(("name", "change"), cases(LOGS))
def test_a_sample_tells_the_same(name: str, change: str, tmp_path: Path) -> None:
    check(name, CHANGES[change], tmp_path)


@needs_real_logs
@pytest.mark.parametrize(("name", "change"), cases(REAL) if os.environ.get("LIDARCLI_REAL_LOGS") else [])
def test_a_recording_tells_the_same(name: str, change: str, tmp_path: Path) -> None:
    check(name, CHANGES[change], tmp_path)
