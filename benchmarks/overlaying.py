"""How fast `overlay --objects` is, beside a type store that builds the same messages one by one.

Processor time of this process, of which a busy machine changes least; the least of several rounds.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from mcap.reader import make_reader

from lidarcli.overlays.markers import MARKER_TYPE
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
from lidarcli.pipeline.overlay.files import write_overlay
from lidarcli.pipeline.overlay.messages import OverlayOptions
from lidarcli.ros.messages import ROS2
from lidarcli.system.machine import keep_freed_memory
from lidarcli.tabular.reading import read_columns
from lidarcli.tabular.schemas import OBJECTS

HERE = Path(__file__).parent
REFERENCE = 300
"""Messages that the type store builds."""


def least(rounds: int, work: Callable[[], object]) -> float:
    """Processor time of the fastest round [s]."""
    times = []
    for _ in range(rounds):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return min(times)


def main() -> None:
    """Make a log and its tables, time the overlay and the references, print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scene", type=Path, default=HERE / "scene_moving.toml")
    asked = parser.parse_args()
    # As the command line does.
    keep_freed_memory()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        log = folder / "long.mcap"
        make = (sys.executable, str(HERE / "make_log.py"), str(asked.scene), str(asked.sweeps), str(log))
        subprocess.run(make, check=True)
        source = Source(str(log), "long")
        detect_to_files(source, folder, DetectOptions(tracking=TrackOptions()))
        table = folder / "long.objects.parquet"
        out = folder / "overlay.mcap"
        options = OverlayOptions(DetectOptions(), objects=str(table), overwrite=True)
        whole = least(asked.rounds, lambda: write_overlay(source, out, options)) / asked.sweeps
        reading = least(asked.rounds, lambda: read_columns(table, "objects", OBJECTS)) / asked.sweeps
        messages: list[object] = []
        with out.open("rb") as file:
            for _, _, message in make_reader(file).iter_messages():
                if len(messages) == REFERENCE:
                    break
                messages.append(ROS2.deserialize_cdr(message.data, MARKER_TYPE))
        store = least(asked.rounds, lambda: [ROS2.serialize_cdr(each, MARKER_TYPE) for each in messages])
        store /= len(messages)
        objects = read_columns(table, "objects", OBJECTS, ["sweep"]).num_rows / asked.sweeps
        size = out.stat().st_size / asked.sweeps
    print(f"{asked.sweeps:,} sweeps, {objects:.1f} objects per sweep, {size:.0f} bytes per sweep in the overlay")
    print(f"overlay from tables   {1e6 * whole:8.1f} us per sweep, {1 / whole:,.0f} sweeps per second")
    print(f"reading the table     {1e6 * reading:8.1f} us per sweep, {reading / whole:.2f} times the overlay")
    print(f"type store, no file   {1e6 * store:8.1f} us per sweep, {store / whole:.1f} times the overlay")


if __name__ == "__main__":
    main()
