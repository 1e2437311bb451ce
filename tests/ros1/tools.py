"""The programs of ROS 1, where they are installed: on Debian `apt-get install python3-rosbag`."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

PYTHON = "/usr/bin/python3"
"""That of the system, which has the modules of ROS."""
HERE = Path(__file__).parent


def imports(module: str) -> bool:
    """Whether the system's Python has a module."""
    asked = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({module!r}) is None)"
    return Path(PYTHON).exists() and not subprocess.run([PYTHON, "-c", asked], check=False).returncode


def missing(*programs: str) -> bool:
    """Whether any of some programs is not there."""
    return any(shutil.which(name) is None for name in programs)


needs_rosbag = pytest.mark.skipif(missing("rosbag") or not imports("rosbag"), reason="rosbag of ROS 1 is not installed")
