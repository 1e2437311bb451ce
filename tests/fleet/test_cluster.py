"""Runs on a Dask cluster: the same bytes as here, whatever becomes of the workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.fleet import KILLER, workers_of
from lidarcli.pipeline.runs import cluster
from tests.conftest import Ran
from tests.descendants import descendants, gone
from tests.fleet.conftest import tables
from tests.places import SAMPLES
from tests.waiting import HANG, wait_until

distributed = pytest.importorskip("distributed")
pytestmark = [pytest.mark.whole, pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")]

CommandLine = Callable[..., Ran]


@pytest.fixture
def preload(tmp_path: Path) -> dict[str, str]:
    """The environment of a run whose workers die of `killer.mcap`."""
    path = tmp_path / "killer.py"
    path.write_text(KILLER)
    return {**os.environ, "DASK_DISTRIBUTED__WORKER__PRELOAD": repr([str(path)])}


def begin(*arguments: object, env: dict[str, str]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "lidarcli", *map(str, arguments)]
    return subprocess.Popen(command, env=env, stderr=subprocess.PIPE, stdout=subprocess.PIPE)


def test_a_worker_that_is_killed_and_a_log_that_kills(
    bags: Path, small: bytes, tmp_path: Path, preload: dict[str, str], lidarcli: CommandLine
) -> None:
    for number in range(60):
        (bags / f"more{number}.mcap").write_bytes(small)
    assert lidarcli("detect", bags, "-o", tmp_path / "here").code == 0
    (bags / "killer.mcap").write_bytes(small)
    out = tmp_path / "there"
    process = begin("detect", bags, "-o", out, "--cluster", "local:2", env=preload)
    wait_until(lambda: len([*out.glob("*.sweeps.parquet")]) >= 5, process)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    _, said = process.communicate(timeout=HANG)
    lines = [line for line in said.decode().splitlines() if line.startswith("lidarcli:")]
    assert lines == [
        f"lidarcli: {bags}/killer.mcap: ends every worker that reads it (out of memory?); try it alone, without --cluster"
    ]
    assert process.returncode == 3
    assert tables(out) == tables(tmp_path / "here")
    again = lidarcli("detect", bags, "-o", out, "--resume")
    assert (again.code, "67 logs, 66 done before" in again.err) == (0, True)


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Start a scheduler and a worker as processes of their own; its address."""
    started: list[subprocess.Popen[bytes]] = []

    def start(*workers: dict[str, str]) -> str:
        file = tmp_path / "scheduler.json"
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
        place = ["--host", "tcp://127.0.0.1", "--port", "0", "--scheduler-file", str(file)]
        started.append(subprocess.Popen([*command, *place], stderr=subprocess.DEVNULL))
        wait_until(lambda: file.exists() and file.read_text(), started[-1])
        address: str = json.loads(file.read_text())["address"]
        for extra in workers:
            started.append(
                subprocess.Popen(
                    [
                        *(sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1"),
                        *("--no-dashboard", "--local-directory", str(tmp_path / "scratch")),
                    ],
                    env={**os.environ, **extra},
                    stderr=subprocess.DEVNULL,
                )
            )
        return address

    yield start
    for process in started:
        process.terminate()
    for process in started:
        process.wait(HANG)


def test_a_cluster_that_was_there(
    scheduler: Callable[..., str],
    bags: Path,
    tmp_path: Path,
    lidarcli: CommandLine,
    process: Callable[..., subprocess.CompletedProcess[bytes]],
) -> None:
    address = scheduler({}, {})
    (tmp_path / "elsewhere").mkdir()
    assert lidarcli("track", bags, "-o", tmp_path / "here").code == 0
    ran = process("track", "bags", "-o", "there", "--cluster", address, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert f"cluster {address}: " in ran.stderr.decode()
    assert tables(tmp_path / "there") == tables(tmp_path / "here")


def test_a_port_that_anybody_reaches_is_warned_of() -> None:
    assert cluster.danger("tcp://127.0.0.1:8786") is None
    assert cluster.danger("tls://10.0.0.1:8786") is None
    assert "whoever reaches this port runs code" in (cluster.danger("tcp://10.0.0.1:8786") or "")


def test_other_workers_are_refused(
    scheduler: Callable[..., str], bags: Path, tmp_path: Path, process: Callable[..., subprocess.CompletedProcess[bytes]]
) -> None:
    address = scheduler({"LIDARCLI_COMPILED": "no"})
    ran = process("detect", bags, "-o", tmp_path / "out", "--cluster", address)
    assert ran.returncode == 2
    said = ran.stderr.decode()
    assert "workers have to be of the same build: tcp://" in said
    assert "core not compiled, here compiled" in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_a_cluster_of_our_own(bags: Path, tmp_path: Path, large_log: Path) -> None:
    out = tmp_path / "out"
    running = begin("detect", large_log, "-o", out, "--cluster", "local:1", env={**os.environ})
    wait_until(lambda: [*out.glob(".lidarcli-*.part/*")], running)
    pids = descendants(running.pid)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=HANG)
    assert (running.returncode, said.decode().splitlines()[-1]) == (130, "lidarcli: interrupted")
    wait_until(lambda: gone(pids))
    assert [*out.glob("*.parquet")] == []


@pytest.fixture(scope="session")
def large_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log whose work takes some seconds."""
    from lidarcli.simulation.writers import write_log
    from tests.sweeping import room_sweeps

    path = tmp_path_factory.mktemp("large") / "long.mcap"
    sweeps = room_sweeps(count=2000)
    write_log(path, [sweeps] * 40, compression="none", chunk_size=1_000_000)
    return path


@pytest.mark.parametrize(
    ("address", "cause"),
    [
        ("local:none", "write local:N"),
        ("tcp://127.0.0.1:1", "cannot be reached"),
        ("nonsense://x:1", "write tls://HOST:PORT"),
        ("", "write tls://HOST:PORT"),
        ("tls://127.0.0.1:1", "Dask's configuration names no certificates for tls://"),
    ],
)
def test_an_address_that_is_none(
    address: str, cause: str, bags: Path, process: Callable[..., subprocess.CompletedProcess[bytes]]
) -> None:
    environment = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"}
    ran = process("detect", bags, "-o", bags / "out", "--cluster", address, env=environment)
    assert ran.returncode == 2
    (line,) = ran.stderr.decode().splitlines()
    assert line.startswith(f"lidarcli: --cluster {address}: {cause}")


@pytest.mark.parametrize("arguments", [("-o", "-"), ("-o", "all.parquet"), ("-o", "out", "--jobs", "2")])
def test_what_a_cluster_is_not_for(arguments: tuple[str, ...], lidarcli: CommandLine) -> None:
    ran = lidarcli("detect", "x.mcap", *arguments, "--cluster", "local:1")
    assert ran.code == 2
    assert "--cluster" in ran.err


def test_who_uses_none_of_it_does_not_wait_for_it(bags: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from lidarcli.cli import run; run(sys.argv[1:]); "
        "print([name for name in ('distributed', 'dask') if name in sys.modules])"
    )
    command = [sys.executable, "-c", code, "detect", str(bags / "one.mcap"), "-o", str(tmp_path / "out")]
    ran = subprocess.run(command, capture_output=True, check=True)
    assert ran.stdout.decode() == "[]\n"


def test_what_is_compared_with_a_background_is_sent_along(tmp_path: Path, lidarcli: CommandLine) -> None:
    background = tmp_path / "empty.background.parquet"
    assert lidarcli("background", "build", SAMPLES / "room_empty.mcap", "-o", background).code == 0
    command = ("detect", SAMPLES / "room.mcap", "--background", background)
    assert lidarcli(*command, "-o", tmp_path / "here").code == 0
    assert lidarcli(*command, "-o", tmp_path / "there", "--cluster", "local:1").code == 0
    assert tables(tmp_path / "there") == tables(tmp_path / "here")
