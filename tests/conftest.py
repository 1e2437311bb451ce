"""Small logs and the command line, for all tests; ctrl-C works in them wherever they run."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from lidarcli.cli import run
from lidarcli.simulate.writers import write_log
from tests.sweeping import room_sweeps


def pytest_configure() -> None:
    """Let ctrl-C work again where it is ignored, as below `nohup` and in many schedulers.

    All processes that tests start would ignore it, too, also those that are to be interrupted.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `run.mcap`, `two.mcap` with two topics, `cut.mcap`, which is damaged."""
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / "run.mcap", [room_sweeps()])
    halves = [
        room_sweeps(topic).rows(part)
        for part in (slice(0, 9), slice(9, None))
        for topic in ("/rear", "/front")
    ]
    write_log(folder / "two.mcap", halves)
    many = room_sweeps(count=400)
    write_log(
        folder / "cut.mcap", [many.rows(slice(k, k + 50)) for k in range(0, 400, 50)], chunk_size=20_000
    )
    data = (folder / "cut.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(data[: len(data) // 2])
    return folder


@pytest.fixture(scope="session")
def large(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """An uncompressed MCAP file larger than the buffers of a pipe."""
    path = tmp_path_factory.mktemp("large") / "large.mcap"
    write_log(path, [room_sweeps(count=400)], compression="none", chunk_size=50_000)
    return path.read_bytes()


@dataclass(frozen=True)
class Ran:
    """What a command said."""

    code: int
    out: str
    err: str


@pytest.fixture
def lidarcli(capfd: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """Run the command line in this process."""

    def call(*arguments: object) -> Ran:
        code = run([str(argument) for argument in arguments])
        return Ran(code, *capfd.readouterr())

    return call


def process(*arguments: object, **settings: object) -> subprocess.CompletedProcess[bytes]:
    """Run the command line as a process of its own."""
    command = [sys.executable, "-m", "lidarcli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, check=False, **settings)  # type: ignore[call-overload,no-any-return]


@pytest.fixture(name="process")
def _process() -> Callable[..., subprocess.CompletedProcess[bytes]]:
    return process


@pytest.fixture
def nothing_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Temporary files go to a folder of their own, which is empty afterwards."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    yield
    assert list(folder.iterdir()) == []
