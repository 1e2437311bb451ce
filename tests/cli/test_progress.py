"""Progress bars, seen through a pseudo terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import termios
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

import pytest

from lidarcli.cli import run
from lidarcli.cli.messages import MessageWriter, counted_bar
from tests.places import ROOT
from tests.reports.runs import sweep, write_run

STEERING = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


@dataclass
class Screen:
    """What a terminal was sent."""

    text: str = ""

    @property
    def plain(self) -> str:
        """Without what steers it."""
        return STEERING.sub("", self.text)

    @property
    def widest(self) -> int:
        """Columns of its longest line."""
        return max(map(len, re.split("[\r\n]+", self.plain)))


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("lidarcli.display.screen.PATIENCE", 0.0)


@contextmanager
def terminal() -> Iterator[Screen]:
    """Standard error is a terminal of 80 columns; what it was sent is known afterwards."""
    screen = Screen()
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    found: list[bytes] = []

    def listen() -> None:
        # Where the other end is closed Linux tells of an error.
        with suppress(OSError):
            while data := os.read(master, 4096):
                found.append(data)

    listener = Thread(target=listen)
    listener.start()
    try:
        with os.fdopen(slave, "w", encoding="utf-8") as stream, redirect_stderr(stream):
            yield screen
    finally:
        listener.join()
        os.close(master)
        screen.text = b"".join(found).decode()


def is_looked_at(say: MessageWriter) -> bool:
    with counted_bar("room", 200, "sweeps", say) as count:
        return count is not None


def test_a_counted_bar() -> None:
    say = MessageWriter()
    with terminal() as screen, counted_bar("room.toml", 200, "sweeps", say) as count:
        assert count is not None
        count(50)
        say.info("a line above the bar")
    assert (say.bar, say.write) == (None, MessageWriter().write)
    assert re.search(r"room\.toml [━╸╺]+ +25% +50/200 sweeps", screen.plain)
    assert "a line above the bar" in screen.plain
    # In the end the line of the bar is taken back.
    assert screen.text.endswith("\x1b[1A\x1b[2K")
    assert screen.widest <= 80


def test_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_looked_at(MessageWriter())
    with terminal() as screen:
        assert is_looked_at(MessageWriter())
        assert not is_looked_at(MessageWriter(quiet=True))
        monkeypatch.setenv("TERM", "dumb")
        assert not is_looked_at(MessageWriter())
    assert screen.text == ""


@pytest.mark.parametrize("quiet", [False, True])
def test_simulate(tmp_path: Path, quiet: bool) -> None:
    scene = str(ROOT / "samples" / "room.toml")
    words = ["simulate", scene, "-o", str(tmp_path / "a.mcap"), "--sweeps", "600"]
    with terminal() as screen:
        assert run([*(["-q"] if quiet else []), *words]) == 0
    assert bool(re.search(r"mples/room\.toml [━╸╺]+ +85% 512/600 ", screen.plain)) == (not quiet)
    assert (screen.text == "") == quiet


def test_report(tmp_path: Path) -> None:
    for name in "ab":
        write_run(tmp_path, [sweep(0, log=name)], name=name)
    out = str(tmp_path / "a.txt")
    with terminal() as screen:
        assert run(["report", str(tmp_path), "-o", out]) == 0
    assert re.search(r"^report [━╸╺]+ +20% 1/5 steps ", screen.plain)
    assert screen.plain.endswith(f"  wrote    {out}\r\n")


def test_detect(tmp_path: Path) -> None:
    with terminal() as screen:
        assert run(["detect", str(ROOT / "samples" / "room.mcap"), "-o", str(tmp_path)]) == 0
    assert re.search(r"room [━╸╺]+ +\d+% +[\d.]+/126\.5 kB .* left", screen.plain)


def test_plot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    log = str(ROOT / "samples" / "room.mcap")
    for name, unit, more in (("a.gif", "frames", ["--animate"]), ("a-0.png", "pictures", [])):
        out = name.replace("-0", "")
        words = ["plot", log, "--sweeps", "0:4", "--view", "scene", "--width", "50", "-o", out, *more]
        with terminal() as screen:
            assert run(words) == 0
        # First the log is read, then every picture is a step.
        assert re.search(r"room [━╸╺]+ +\d+% +[\d.]+/126\.5 kB", screen.plain)
        assert re.search(rf"{name} [━╸╺]+ +\d+% +[1-4]/4 [\d.]* ?{unit}", screen.plain)
        assert screen.widest <= 80
