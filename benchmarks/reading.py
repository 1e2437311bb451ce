"""How fast logs of each format become sweeps, beside a script that reads an MCAP message by message.

Processor time of this process, of which a busy machine changes least; the least of several rounds.
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from benchmarks.overlaying import least
from lidarcli.logs.base import POINTCLOUD2, OpenOptions, ReadReport, Slice
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.ros.messages import ROS2, ros2_definition
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from lidarcli.system.machine import keep_freed_memory

BEAMS = 181
COLUMNS, RINGS = 1024, 64
WALL = 5.0
"""Half the side of the square room that is seen [m]."""
LOGS = {
    "MCAP": ("run.mcap", "mcap"),
    "ROS 1 bag": ("run.bag", "bag"),
    "ROS 2 bag (.db3)": ("run.db3", "db3"),
    "CARMEN": ("run.clf", "carmen"),
    "CSV (rostopic)": ("run.csv", "csv"),
    "JSON lines": ("run.jsonl", "jsonl"),
    "RPLIDAR text": ("run.txt", "rplidar"),
}
"""Format → the log that is written, and its container."""


def room(sweeps: int, beams: int, fov: float) -> RawSweeps:
    """A square room with some noise."""
    bearing = np.linspace(-fov / 2, fov / 2, beams)
    wall = WALL / np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing)))
    noise = np.random.default_rng(0).normal(0.0, 0.01, (sweeps, beams))
    stamps = 1_700_000_000_000_000_000 + 100_000_000 * np.arange(sweeps)
    return RawSweeps(
        topic="/scan",
        frame_ids=("laser",),
        frame=np.zeros(sweeps, np.int32),
        stamp_ns=stamps,
        record_ns=stamps,
        angle_min=np.full(sweeps, bearing[0]),
        angle_increment=np.full(sweeps, bearing[1] - bearing[0]),
        range_min=np.full(sweeps, 0.1, np.float32),
        range_max=np.full(sweeps, 30.0, np.float32),
        beams=np.full(sweeps, beams, np.int32),
        ranges=(wall + noise).round(3).astype(np.float32),
    )


def read(path: Path, part: Slice | None = None) -> int:
    """Sweeps of a log."""
    with open_source(Source(str(path), "run"), OpenOptions(slice=part)) as log:
        return sum(len(block) for block in log.scans(None, ReadReport()))


def by_script(path: Path) -> int:
    """Sweeps of an MCAP, one message after the other, through a library."""
    count = 0
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            scan: Any = ROS2.deserialize_cdr(message.data, "sensor_msgs/msg/LaserScan")
            count += len(scan.ranges) > 0
    return count


def clouds(folder: Path, count: int) -> Path:
    """A log of clouds of 64 x 1,024 points, each of 16 bytes, in a room all around the sensor."""
    ranges = room(1, COLUMNS, 2 * np.pi * (1 - 1 / COLUMNS)).ranges[0]
    bearing = np.linspace(-np.pi, np.pi, COLUMNS, endpoint=False)
    height = WALL * np.tan(np.radians(np.linspace(-22.5, 22.5, RINGS)))
    points = np.zeros((RINGS, COLUMNS, 4), np.float32)
    points[..., 0], points[..., 1] = ranges * np.cos(bearing), ranges * np.sin(bearing)
    points[..., 2] = height[:, None]
    types = ROS2.types
    fields = [
        types["sensor_msgs/msg/PointField"](name, 4 * place, 7, 1)
        for place, name in enumerate(("x", "y", "z", "intensity"))
    ]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1_700_000_000, 0), "lidar")
    data = points.reshape(-1).view(np.uint8)
    cloud = types[POINTCLOUD2](header, RINGS, COLUMNS, fields, False, 16, 16 * COLUMNS, data, True)
    message = bytes(ROS2.serialize_cdr(cloud, POINTCLOUD2))
    path = folder / "clouds.mcap"
    with path.open("xb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="lidarcli")
        schema = writer.register_schema(POINTCLOUD2, "ros2msg", ros2_definition(POINTCLOUD2).encode())
        channel = writer.register_channel("/points", "cdr", schema)
        for number in range(count):
            writer.add_message(channel, number * 100_000_000, message, number * 100_000_000, number)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def main() -> None:
    """Write the logs, read them, print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=5_000)
    parser.add_argument("--clouds", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    # As the command line does.
    keep_freed_memory()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        raw = room(asked.sweeps, BEAMS, np.pi)
        found: dict[str, float] = {}
        for name, (log, container) in LOGS.items():
            path = folder / log
            write_log(path, [raw], container=container)
            found[f"{name}, {BEAMS} beams"] = asked.sweeps / least(asked.rounds, partial(read, path))
        script = asked.sweeps / least(asked.rounds, lambda: by_script(folder / "run.mcap"))
        path = clouds(folder, asked.clouds)
        for low, high in ((-0.1, 0.1), (-10.0, 10.0)):
            part = Slice(low, high, 720)
            rate = asked.clouds / least(asked.rounds, partial(read, path, part))
            found[f"PointCloud2, {RINGS} x {COLUMNS:,} points, {low:g} to {high:g} m"] = rate
    print("| format | sweeps/s | times a script for MCAP |\n|---|---|---|")
    for name, rate in found.items():
        print(f"| {name} | {rate:,.0f} | {'-' if name.startswith('PointCloud2') else f'{rate / script:.2f}'} |")
    print(f"| a script: mcap and rosbags, message by message | {script:,.0f} | 1 |")


if __name__ == "__main__":
    main()
