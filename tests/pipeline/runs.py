"""Drawn logs of several runs: the clock starts anew in each, as of a simulation that is restarted while it is recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags import rosbag2
from rosbags.interfaces import Connection

from lidarcli.ros.messages import ROS1, ROS2, Outgoing, bag_writer
from lidarcli.simulation.generate import SimulatedPoses, relative
from lidarcli.simulation.scene import Scene
from lidarcli.simulation.writers import CDR, ENCODINGS, ROS1_BYTES, Encoding, outgoing, write_csv
from lidarcli.sweeps.types import Float64, RawSweeps
from tests.pipeline.drawn import ROOM, SENSOR, Drive, round_about, stamps, sweeps_of, told

Recorded = tuple[list[RawSweeps], SimulatedPoses | None]
"""Sweeps and odometry of a run."""
LATER = 100 * 1_000_000_000
"""Time of recording from one run to the next [ns]."""


def other_way(seconds: Float64) -> Float64:
    """As `round_about`, from the other side of the room on."""
    return round_about(seconds + 10.0)


def run_of(way: Callable[[Float64], Float64], sweeps: int, *, tf: bool = False) -> tuple[list[RawSweeps], SimulatedPoses]:
    """The sweeps of a run, and its odometry, which begins at its origin."""
    scene = Scene("drawn", SENSOR, ROOM, Drive(way), sweeps=sweeps)
    poses = way(np.arange(sweeps) * 0.1)
    return sweeps_of(scene), told(relative(poses, poses[[0]]), stamps(sweeps), tf=tf)


def two_runs(first: int = 150, second: int = 200, **some: bool) -> list[Any]:
    """Two runs of one robot in one room."""
    return [run_of(round_about, first, **some), run_of(other_way, second, **some)]


def messages_of(runs: Sequence[Recorded], encoding: Encoding, *, recorded: bool = True) -> Iterator[Outgoing]:
    """The messages of all runs; `recorded`: the times of recording go on."""
    for number, (blocks, poses) in enumerate(runs):
        for one in outgoing(blocks, poses, encoding):
            yield one._replace(record_ns=one.record_ns + recorded * number * LATER)


def write_runs(path: Path, runs: Sequence[Recorded], *, recorded: bool = True) -> Path:
    """Write a log by the suffix of its name: `.mcap`, `.bag`, `.csv`, or none for a ROS 2 bag."""
    if path.suffix == ".csv":
        write_csv(path, [block for blocks, _ in runs for block in blocks])
    elif path.suffix == ".mcap":
        how = ENCODINGS["cdr"]
        with path.open("xb") as file:
            writer = McapWriter(file)
            writer.start(how.profile)
            channels: dict[str, int] = {}
            for one in messages_of(runs, how.messages, recorded=recorded):
                if one.topic not in channels:
                    name, kind, text = how.schema_of(one.type)
                    channels[one.topic] = writer.register_channel(
                        one.topic, how.name, writer.register_schema(name, kind, text)
                    )
                writer.add_message(channels[one.topic], one.record_ns, one.data, one.stamp_ns)
            writer.finish()
    else:
        is_bag = path.suffix == ".bag"
        known: dict[str, Connection] = {}
        with bag_writer(path, "none") if is_bag else rosbag2.Writer(path, version=8) as bag:
            for one in messages_of(runs, ROS1_BYTES if is_bag else CDR, recorded=recorded):
                if one.topic not in known:
                    known[one.topic] = bag.add_connection(one.topic, one.type, typestore=ROS1 if is_bag else ROS2)
                bag.write(known[one.topic], one.record_ns, one.data)
    return path
