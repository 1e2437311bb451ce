"""Write a log of a scene, or of a recording that is repeated, in the container that the name of the log asks for."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.well_known import SchemaEncoding
from mcap.writer import Writer

from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import SceneSensor, load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import TURN, RawSweeps, concatenate

BLOCK = 512
"""Sweeps of a block that is written."""
IMAGE = 250_000
"""Bytes of an image; what its sweeps take is a share of it."""


def with_beams(sensor: SceneSensor, beams: int) -> SceneSensor:
    """The same sensor with other beams: those of 1081 look over 270°, all others over a closed full turn."""
    if beams == sensor.beams:
        return sensor
    view = 0.75 * TURN if beams == 1081 else TURN
    return replace(sensor, beams=beams, angle_min=-0.5 * view, angle_increment=view / (beams - 1))


def add_images(log: Path, share: float) -> None:
    """Write an MCAP log again with images between its messages, which then are `share` of the bytes."""
    rng = np.random.default_rng(1)
    plain = log.with_suffix(".plain")
    log.rename(plain)
    with plain.open("rb") as source, log.open("wb") as target:
        writer = Writer(target)
        writer.start("ros2")
        image = writer.register_channel(
            "/camera", "cdr", writer.register_schema("sensor_msgs/msg/CompressedImage", SchemaEncoding.ROS2, b"")
        )
        scans: dict[str, int] = {}
        owed = 0.0
        for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
            assert schema is not None
            if channel.topic not in scans:
                own = writer.register_schema(schema.name, schema.encoding, schema.data)
                scans[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, own)
            writer.add_message(scans[channel.topic], message.log_time, message.data, message.publish_time, message.sequence)
            owed += len(message.data) * (1.0 / share - 1.0)
            while owed >= IMAGE:
                writer.add_message(image, message.log_time, rng.bytes(IMAGE), message.publish_time)
                owed -= IMAGE
        writer.finish()  # type: ignore[no-untyped-call]
    plain.unlink()


def to_and_fro(recording: Path, sweeps: int) -> Iterator[RawSweeps]:
    """Yield the sweeps of the first topic of a recording forwards, backwards and so on: nothing in them ever jumps.

    Stamps go on evenly, by the median step of the recording.
    """
    with open_log(str(recording)) as log:
        blocks = list(log.scans(None, ReadReport()))
    topic = min(block.topic for block in blocks)
    once = concatenate([block for block in blocks if block.topic == topic])
    step, turn = int(np.median(np.diff(once.stamp_ns))), 2 * (len(once) - 1)
    for first in range(0, sweeps, BLOCK):
        number = np.arange(first, min(first + BLOCK, sweeps))
        stamp_ns = once.stamp_ns[0] + number * step
        rows = np.minimum(number % turn, -number % turn)
        yield replace(once.rows(rows), stamp_ns=stamp_ns, record_ns=stamp_ns)


def simulated(path: Path, sweeps: int, beams: int | None, jitter: int, blank: bool) -> Iterator[RawSweeps]:
    """Yield the sweeps of a scene, seen by its sensor or one with other beams; `blank`: every other one sees nothing."""
    scene = load_scene(path)
    sensor = replace(with_beams(scene.sensor, beams or scene.sensor.beams), beams_jitter=jitter)
    for block in simulate_blocks(replace(scene, sensor=sensor), sweeps):
        if blank:
            block.raw.ranges[1::2] = np.inf
        yield block.raw


def main() -> None:
    """Parse the arguments and write the log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path, help="scene (.toml) or recording")
    parser.add_argument("sweeps", type=int)
    parser.add_argument("log", type=Path)
    parser.add_argument("--jitter", type=int, default=0, help="by how much the beam count of a scene varies")
    parser.add_argument("--beams", type=int, help="instead of the scene's")
    parser.add_argument("--blank", action="store_true", help="every other sweep of a scene sees nothing")
    parser.add_argument("--compression", help="of the container; by default zstd for MCAP, none elsewhere")
    parser.add_argument("--share", type=float, help="of the bytes of an MCAP log; images are the rest")
    arguments = parser.parse_args()
    poses = None
    if arguments.source.suffix == ".toml":
        poses = simulate_odometry(load_scene(arguments.source), arguments.sweeps)
        blocks = simulated(arguments.source, arguments.sweeps, arguments.beams, arguments.jitter, arguments.blank)
    else:
        blocks = to_and_fro(arguments.source, arguments.sweeps)
    write_log(arguments.log, blocks, poses=poses, compression=arguments.compression)
    if arguments.share:
        add_images(arguments.log, arguments.share)


if __name__ == "__main__":
    main()
