"""Write a log of the benchmark's scene, in the container that the name of the log asks for."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.well_known import SchemaEncoding
from mcap.writer import Writer

from lidarcli.simulate.generate import simulate_blocks
from lidarcli.simulate.load import load_scene
from lidarcli.simulate.scene import Sensor
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import TURN

IMAGE = 250_000
"""Bytes of an image; what its sweeps take is a share of it."""


def with_beams(sensor: Sensor, beams: int) -> Sensor:
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
            "/camera",
            "cdr",
            writer.register_schema("sensor_msgs/msg/CompressedImage", SchemaEncoding.ROS2, b""),
        )
        scans: dict[str, int] = {}
        owed = 0.0
        for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
            assert schema is not None
            if channel.topic not in scans:
                own = writer.register_schema(schema.name, schema.encoding, schema.data)
                scans[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, own)
            writer.add_message(
                scans[channel.topic], message.log_time, message.data, message.publish_time, message.sequence
            )
            owed += len(message.data) * (1.0 / share - 1.0)
            while owed >= IMAGE:
                writer.add_message(image, message.log_time, rng.bytes(IMAGE), message.publish_time)
                owed -= IMAGE
        writer.finish()  # type: ignore[no-untyped-call]
    plain.unlink()


def main() -> None:
    """Parse the arguments and write the log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("sweeps", type=int)
    parser.add_argument("log", type=Path)
    parser.add_argument("--jitter", type=int, default=0, help="by how much the beam count varies")
    parser.add_argument("--beams", type=int, help="instead of the scene's")
    parser.add_argument("--compression", help="of the container; by default zstd for MCAP, none elsewhere")
    parser.add_argument("--share", type=float, help="of the bytes of an MCAP log; images are the rest")
    arguments = parser.parse_args()
    scene = load_scene(arguments.scene)
    sensor = with_beams(scene.sensor, arguments.beams or scene.sensor.beams)
    scene = replace(scene, sensor=replace(sensor, beams_jitter=arguments.jitter))
    blocks = (block.raw for block in simulate_blocks(scene, arguments.sweeps))
    write_log(arguments.log, blocks, compression=arguments.compression)
    if arguments.share:
        add_images(arguments.log, arguments.share)


if __name__ == "__main__":
    main()
