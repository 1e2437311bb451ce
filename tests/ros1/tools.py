"""The programs of ROS 1, where they are installed: on Debian `apt-get install python3-rosbag python3-rosmaster`."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.waiting import wait_until

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
needs_master = pytest.mark.skipif(
    missing("rosbag", "rosmaster") or not imports("rospy"), reason="rosbag, rosmaster and rospy of ROS 1 are not installed"
)


@contextmanager
def started(*command: object, environment: dict[str, str] | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is ended with the context."""
    process = subprocess.Popen([*map(str, command)], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def master() -> Iterator[dict[str, str]]:
    """A ROS master of our own; the environment of the programs that are to find it."""
    with tempfile.TemporaryDirectory() as home, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        environment = os.environ | {
            "HOME": home,
            "ROS_HOME": home,
            "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
            "ROS_IP": "127.0.0.1",
        }
        with started("rosmaster", "--core", "-p", port, environment=environment) as core:
            wait_until(lambda: _answers(port), core)
            yield environment


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
