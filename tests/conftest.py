"""Small logs and the command line, for all tests; and the same surroundings for them wherever they run."""

from __future__ import annotations

import faulthandler
import gc
import os
import pickle
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import IO, Any

import pytest
from hypothesis import HealthCheck, settings

from lidarcli.cli import run
from lidarcli.logs.base import Log
from lidarcli.logs.mcap import McapLog
from lidarcli.logs.rosbag1 import Rosbag1Log
from lidarcli.logs.rosbag2_sqlite import SqliteLog
from lidarcli.pipeline.reading import path_check
from lidarcli.simulation.writers import write_log
from tests.sweeping import room_sweeps
from tests.waiting import HANG

OF_A_USER = re.compile(
    r"LIDARCLI_(?!COMPILED$|BUILD$|BOUNDS$|REAL_LOGS$)|AWS_|AZURE_|GOOGLE_|STORAGE_EMULATOR|DASK_|MPL|MATPLOTLIBRC$"
    r"|XDG_CONFIG|(NO|FORCE|CLI)_?COLOR|PY_COLORS$|COLUMNS$|LINES$|TZ$|SOURCE_DATE_EPOCH$|PYTHONWARNINGS$|GITHUB_"
)
"""Variables with which a user or a CI changes what programs do and show."""
settings.register_profile(
    "steady", derandomize=True, database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")


def pytest_configure(config: pytest.Config) -> None:
    """Let tests see no settings of the user, and let ctrl-C work.

    It is ignored below `nohup` and in many schedulers. All processes that tests start would ignore it, too, also those
    that are to be interrupted.
    """
    for name in filter(OF_A_USER.match, list(os.environ)):
        del os.environ[name]
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Tests catch what is written to the stream itself.
    config.stash[HANGS] = os.fdopen(os.dup(2), "w")


HANGS = pytest.StashKey[IO[str]]()


@pytest.fixture(autouse=True)
def wide_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no sentence wrap: tests of what is said are none of where it is cut."""
    monkeypatch.setenv("COLUMNS", "1000")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Keep what is collected out of the sight of the garbage collector, which would look at it again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_unconfigure() -> None:
    """Show it again: libraries look at what is left when a process ends."""
    gc.unfreeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """End a process of tests that hangs, and say where: nothing else measures the time of a test."""
    faulthandler.dump_traceback_later(HANG, exit=True, file=item.config.stash[HANGS])
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `run.mcap`, `two.mcap` with two topics, `cut.mcap`, which is damaged."""
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / "run.mcap", [room_sweeps()])
    halves = [room_sweeps(topic).rows(part) for part in (slice(0, 9), slice(9, None)) for topic in ("/rear", "/front")]
    write_log(folder / "two.mcap", halves)
    many = room_sweeps(count=400)
    write_log(folder / "cut.mcap", [many.rows(slice(k, k + 50)) for k in range(0, 400, 50)], chunk_size=20_000)
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
    """Run the command line in this process; it ends with the exit code that is expected, where one is."""

    def call(*arguments: object, code: int | None = None) -> Ran:
        ran = Ran(run([str(argument) for argument in arguments]), *capfd.readouterr())
        assert code in (None, ran.code), ran.err
        return ran

    return call


def process(*arguments: object, **settings: object) -> subprocess.CompletedProcess[bytes]:
    """Run the command line as a process of its own."""
    command = [sys.executable, "-m", "lidarcli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, check=False, **settings)  # type: ignore[call-overload,no-any-return]


@pytest.fixture(name="process")
def _process() -> Callable[..., subprocess.CompletedProcess[bytes]]:
    return process


@pytest.fixture(scope="module")
def paths_checked_once() -> Iterator[None]:
    """The pass that checks the poses of a log takes most of many commands: it runs once for each content and choice.

    Of one file whose bytes alone say what is in it; for tests that change nothing within the pass.
    """
    known: dict[bytes, Any] = {}
    check = path_check.check_paths

    def checked(log: Log, *given: Any, **options: Any) -> Any:
        if type(log) not in (McapLog, Rosbag1Log, SqliteLog) or not Path(log.path).is_file():
            return check(log, *given, **options)
        asked = sha256(Path(log.path).read_bytes() + pickle.dumps((given, sorted(options.items())))).digest()
        if asked not in known:
            known[asked] = check(log, *given, **options)
        return known[asked]

    with pytest.MonkeyPatch.context() as patching:
        patching.setattr(path_check, "check_paths", checked)
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of sweeps are empty files, for tests of their names and of what is said beside them."""
    monkeypatch.setattr("lidarcli.pipeline.plotting.draw", lambda picture, view, suffix, look: b"")


@pytest.fixture
def nothing_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Temporary files go to a folder of their own, which is empty afterwards."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    yield
    assert list(folder.iterdir()) == []
