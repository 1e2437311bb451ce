"""What Nav2's Collision Monitor did, by its own messages, beside the zones of its configuration."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lidarcli.simulation.writers import CDR, outgoing
from tests.sweeping import START, STEP, raw_sweeps, round_room

Run = Callable[..., Any]
KIND = "nav2_msgs/msg/CollisionMonitorState"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
TYPES.register(
    get_types_from_msg(
        "uint8 DO_NOTHING=0\nuint8 STOP=1\nuint8 SLOWDOWN=2\nuint8 APPROACH=3\nuint8 LIMIT=4\n"
        "uint8 action_type\nstring polygon_name\n",
        KIND,
    )
)
NAV2 = """
collision_monitor:
  ros__parameters:
    base_frame_id: laser
    source_timeout: 0.5
    observation_sources: [scan]
    scan: {type: scan, topic: /scan}
    polygons: [PolygonStop, PolygonSlow]
    PolygonStop: {type: circle, radius: 1.0, action_type: stop, min_points: 4}
    PolygonSlow: {type: circle, radius: 2.0, action_type: slowdown, min_points: 4}
"""
LATE = 200_000_000
"""Messages are recorded so long after the stamps of sweeps [ns]."""
BOX, BEYOND, LOST = slice(20, 31), slice(40, 51), slice(60, 75)
"""Sweeps in which a box is 0.8 m away, in which it is 1.5 m away, and those that are missing."""
TOLD = (
    *((2.05, 1, "PolygonStop"), (2.1, 1, "PolygonStop"), (3.1, 0, "")),
    *((4.1, 1, "PolygonStop"), (4.6, 0, "")),
    *((6.6, 1, "invalid source"), (7.5, 0, "")),
    *((8.0, 2, "Gone"), (8.2, 0, "")),
)
"""Time [s], action and polygon of each state."""


def log_of(folder: Path, plugin: StoragePlugin, told: Iterable[tuple[float, int, str]] = TOLD) -> Path:
    """Write sweeps of a sensor that stands, and states, into a bag of ROS 2."""
    ranges = round_room(100)
    ranges[BOX, 100:120], ranges[BEYOND, 100:120] = 0.8, 1.5
    kept = np.delete(np.arange(100), LOST)
    stamps = START + STEP * kept
    raw = raw_sweeps(ranges[kept], stamp_ns=stamps, record_ns=stamps + LATE)
    messages = [(each.record_ns, each.topic, each.type, each.data) for each in outgoing([raw], None, CDR)]
    state = TYPES.types[KIND]
    for seconds, action, polygon in told:
        data = bytes(TYPES.serialize_cdr(state(action_type=action, polygon_name=polygon), KIND))
        messages.append((START + round(seconds * 1e9) + LATE, "/collision_monitor_state", KIND, data))
    path = folder / f"bag_{plugin.name.lower()}"
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        known: dict[str, Any] = {}
        for at, topic, kind, data in sorted(messages):
            known[topic] = known.get(topic) or writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(known[topic], at, data)
    (folder / "nav2.yaml").write_text(NAV2)
    return path


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_why_nav2_stopped(tmp_path: Path, plugin: StoragePlugin, lidarcli: Run) -> None:
    """One command tells when it stopped, and whether the zones say the same."""
    log = log_of(tmp_path, plugin)
    ran = lidarcli("zones", log, "--zones", tmp_path / "nav2.yaml", "--no-objects")
    assert ran.code == 0
    lines = ran.err.splitlines()
    at = next(at for at, line in enumerate(lines) if line.startswith("  Nav2 "))
    assert lines[at : at + 5] == [
        "  Nav2     stop 3 times, slowdown once; the zones say the same 2 times",
        "                4.1 s  22:13:24.1  PolygonStop        0.5 s  stop      nothing was in it",
        "                2.0 s  22:13:22.0  PolygonStop        1.1 s  stop      the same",
        "                6.6 s  22:13:26.6  invalid source     0.9 s  stop      the same",
        "                8.0 s  22:13:28.0  Gone               0.2 s  slowdown  no zone of this name is judged",
    ]
    stale = "  note     /scan: no sweep for over 0.5 s, once from 6.4 s (22:13:26.4) on: Nav2 stops the robot then (invalid"
    assert sum(line.startswith(stale) for line in lines) == 1
    ran = lidarcli("zones", log, "--zones", tmp_path / "nav2.yaml", "--no-objects", "--format", "json")
    (told,) = json.loads(ran.out)["logs"]
    assert [(act["action"], act["otherwise"]) for act in told["nav2"]] == [
        ("stop", ""),
        ("stop", "nothing was in it"),
        ("stop", ""),
        ("slowdown", "no zone of this name is judged"),
    ]


def test_a_stop_that_nav2_did_not_make_is_told(tmp_path: Path, lidarcli: Run) -> None:
    log = log_of(tmp_path, StoragePlugin.MCAP, TOLD[3:])
    lines = lidarcli("zones", log, "--zones", tmp_path / "nav2.yaml", "--no-objects").err.splitlines()
    at = next(at for at, line in enumerate(lines) if line.startswith("  Nav2 "))
    assert "no stop once" in lines[at]
    assert any(" ".join(line.split()[3:]) == "PolygonStop 1.0 s no stop the zone says stop" for line in lines[at:])


def test_names_stay_whole_in_80_columns(tmp_path: Path, lidarcli: Run) -> None:
    log = log_of(tmp_path, StoragePlugin.SQLITE3)
    name = "FootprintApproach"
    (tmp_path / "nav2.yaml").write_text(NAV2.replace("PolygonSlow", name))
    assert lidarcli("-q", "zones", log, "--zones", tmp_path / "nav2.yaml", "-o", tmp_path).code == 0
    lines = lidarcli("report", tmp_path / f"{log.name}.events.parquet").out.splitlines()
    assert sum(line.startswith(f"{name} ") for line in lines) >= 3
    assert max(map(len, lines)) <= 80


def test_a_log_without_states_says_nothing_of_nav2(tmp_path: Path, lidarcli: Run) -> None:
    log = log_of(tmp_path, StoragePlugin.MCAP, ())
    assert "Nav2  " not in lidarcli("zones", log, "--zones", tmp_path / "nav2.yaml", "--no-objects").err


def test_the_worst_comes_first_and_can_be_seen(tmp_path: Path, lidarcli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zones that stop come first; the command that is told draws the nearest sweep."""
    log = log_of(tmp_path, StoragePlugin.SQLITE3)
    monkeypatch.chdir(tmp_path)
    words = ("zones", log, "--zones", "nav2.yaml", "--no-objects", "--pose", "none")
    lines = lidarcli(*words).err.splitlines()
    at = next(at for at, line in enumerate(lines) if line.startswith("  worst "))
    assert [line.split()[:7] for line in lines[at + 1 : at + 4]] == [
        ["2.0", "s", "22:13:22.0", "PolygonStop", "1.0", "s", "0.80"],
        ["2.0", "s", "22:13:22.0", "PolygonSlow", "1.0", "s", "0.80"],
        ["4.0", "s", "22:13:24.0", "PolygonSlow", "1.0", "s", "1.50"],
    ]
    (look,) = (line.removeprefix("  look     ") for line in lines if line.startswith("  look "))
    command = shlex.split(look)
    assert command[:3] == ["lidarcli", "plot", str(log)]
    assert command[command.index("--pose") + 1] == "none"
    assert command[command.index("--at") + 1] == "2.000"
    assert lidarcli(*command[1:], "-o", "near.png").code == 0
    assert Path("near.png").read_bytes().startswith(b"\x89PNG")
    # A line of options that are not typed would only be longer.
    assert "--no-objects" not in look
