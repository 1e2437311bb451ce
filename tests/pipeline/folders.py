"""Folders of several logs."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.places import SAMPLES


def logs_apart(folder: Path) -> Path:
    """A folder of three unrelated logs, one of which knows where the sensor was."""
    (folder / "deep").mkdir(parents=True)
    for name, place in (("drive.db3", "drive.db3"), ("room.mcap", "run 1.mcap"), ("corridor.bag", "deep/c.bag")):
        shutil.copy(SAMPLES / name, folder / place)
    return folder
