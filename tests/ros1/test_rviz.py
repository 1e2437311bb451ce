"""RViz of ROS 1 opens the settings that are written, and shows what is played."""

from __future__ import annotations

import os
import struct
import subprocess
import tempfile
import xmlrpc.client
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from lidarcli.cli import run
from lidarcli.overlays.viewers import BACKGROUND
from lidarcli.sweeps import UInt8
from tests.places import SAMPLES
from tests.ros1.tools import master, missing, needs_master, started
from tests.waiting import wait_until

DRIVE = SAMPLES / "drive.db3"
WIDTH, HEIGHT = 1280, 900
VIEW = slice(100, 660), slice(420, 1140)
"""Rows and columns of a window of 1200 x 720 pixels that the view has beside the displays, at the least."""
needs_rviz = pytest.mark.skipif(missing("rviz", "Xvfb"), reason="RViz or Xvfb is not installed")


@contextmanager
def screen() -> Iterator[tuple[str, Path]]:
    """A screen that nobody sees: its name, and the file that holds its pixels."""
    with tempfile.TemporaryDirectory() as folder:
        reading, writing = os.pipe()
        command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WIDTH}x{HEIGHT}x24", "-fbdir", folder]
        process = subprocess.Popen(
            [*command, "-nolisten", "tcp"], pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(writing)
        try:
            with os.fdopen(reading, encoding="ascii") as told:
                number = told.readline().strip()
            yield f":{number}", Path(folder) / "Xvfb_screen0"
        finally:
            process.terminate()
            process.wait()


def pixels(path: Path) -> UInt8:
    """(H, W, 3) red, green and blue of a screen, as Xvfb keeps it: an X window dump."""
    data = path.read_bytes()
    header = struct.unpack(">25I", data[:100])
    size, columns, rows, bits, line, colours = (header[k] for k in (0, 4, 5, 11, 12, 19))
    assert (columns, rows, bits) == (WIDTH, HEIGHT, 32)
    first = size + 12 * colours
    shown = np.frombuffer(data, np.uint8, line * rows, first).reshape(rows, line)[:, : 4 * columns]
    return shown.reshape(rows, columns, 4)[:, :, 2::-1]


def has_scene(shown: UInt8) -> bool:
    """Whether the view shows its background, free space of the map (grey), beams (white) and objects (coloured)."""
    part = shown[VIEW].astype(np.int64)
    least, most = part.min(axis=2), part.max(axis=2)
    background = (least == most) & (most == int(BACKGROUND[1:3], 16))
    free = (most - least < 8) & (most > 60) & (most < 128)
    coloured = most - least > 60
    return bool(background.mean() > 0.1 and free.mean() > 0.05 and (least == 255).sum() > 100 and coloured.sum() > 200)


@needs_master
@needs_rviz
@pytest.mark.whole
def test_rviz_shows_beams_map_and_objects(tmp_path: Path) -> None:
    grid, shown = tmp_path / "room.yaml", tmp_path / "drive.bag"
    assert run(["-q", "map", str(DRIVE), "-o", str(grid)]) == 0
    assert run(["-q", "overlay", str(DRIVE), "-o", str(shown), "--with-log", "--map", str(grid)]) == 0
    with screen() as (display, image), master() as found:
        environment = found | {
            "DISPLAY": display,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "QT_X11_NO_MITSHM": "1",
            "XDG_RUNTIME_DIR": found["HOME"],
        }
        with xmlrpc.client.ServerProxy(found["ROS_MASTER_URI"]) as server:
            server.setParam("/test", "/use_sim_time", True)
        play = ("rosbag", "play", "--clock", "--wait-for-subscribers", "--keep-alive", shown)
        # RViz listens to these alone.
        topics = ("--topics", "/scan", "/tf", "/tf_static", "/lidarcli/objects", "/lidarcli/map")
        with (
            started("rviz", "-d", shown.with_suffix(".rviz"), environment=environment) as rviz,
            started(*play, *topics, environment=environment),
        ):
            wait_until(lambda: has_scene(pixels(image)), rviz)
