"""`detect` killed, interrupted or out of space at many moments: no partial file has its final name, and a rerun works."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.simulation.writers import write_log
from tests.interrupting import ENDS, MOMENTS, STARTS, ended, left
from tests.sweeping import BOX, raw_sweeps, round_room
from tests.waiting import HANG, endless, wait_until

pytestmark = pytest.mark.slow

SWEEPS = 6_000
TABLES = ("beams", "objects", "sweeps")
FINAL = [f"run.{table}.parquet" for table in TABLES]
SCRATCH = re.compile(r"\.lidarcli-[0-9a-f]{8}-[0-9a-f]{16}\.part")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of two topics."""
    rows, beams = SWEEPS // 2, 180
    ranges = round_room(rows, beams, BOX)
    ranges += np.random.default_rng(1).normal(0, 0.01, ranges.shape).astype(np.float32)
    both = [raw_sweeps(ranges, topic=topic) for topic in ("/a", "/b")]
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    write_log(path, [block.rows(slice(k, k + 200)) for k in range(0, rows, 200) for block in both])
    return path


@pytest.fixture(scope="module")
def whole(log: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The tables of a run that nobody disturbed."""
    out = tmp_path_factory.mktemp("whole")
    done = detect(log, out)
    assert (done.wait(), said(done)) == (0, "")
    return {name: (out / name).read_bytes() for name in FINAL}


def words(log: Path, out: Path, *options: str) -> list[str]:
    return ["-q", "detect", str(log), "--beams", "-o", str(out), *options]


def detect(log: Path, out: Path, *options: str, **settings: Any) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "lidarcli", *words(log, out, *options)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, **settings)


def said(process: subprocess.Popen[bytes]) -> str:
    _, err = process.communicate()
    return err.decode()


@contextmanager
def writing(log: Path, out: Path, *options: str, **settings: Any) -> Iterator[subprocess.Popen[bytes]]:
    """`detect` while it writes tables, to which no end comes."""
    pipe = log.with_name("pipe") / log.name
    with endless(log, pipe):
        process = detect(pipe, out, *options, **settings)
        wait_until(lambda: [*out.glob(".*.part")], process)
        yield process


def test_killed_at_any_moment(log: Path, whole: dict[str, bytes], tmp_path: Path) -> None:
    """What killed runs leave behind is in nobody's way: they all write to one folder."""
    for moment in MOMENTS:
        assert ended(moment, signal.SIGKILL, *words(log, tmp_path)).returncode == -signal.SIGKILL
        # That of the run before, if this one did not get far enough to clear it away.
        assert all(SCRATCH.fullmatch(path.name) for path in tmp_path.iterdir())
    with writing(log, tmp_path) as process:
        process.kill()
        assert said(process) == ""
    (scratch,) = tmp_path.iterdir()
    assert SCRATCH.fullmatch(scratch.name)
    again = detect(log, tmp_path)
    assert (again.wait(), said(again)) == (0, "")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == whole


@pytest.mark.parametrize("moment", MOMENTS)
def test_interrupted_at_any_moment(log: Path, tmp_path: Path, moment: str) -> None:
    ran = ended(moment, signal.SIGINT, *words(log, tmp_path))
    assert (ran.returncode, ran.stderr) == (130, "lidarcli: interrupted\n")
    assert left(tmp_path) == []


@pytest.mark.parametrize("moment", ENDS)
def test_interrupted_while_it_clears_away(log: Path, whole: dict[str, bytes], tmp_path: Path, moment: str) -> None:
    ran = ended(moment, signal.SIGINT, *words(log, tmp_path))
    assert (ran.returncode, ran.stderr) == (130, "lidarcli: interrupted\n")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == whole


def test_interrupted_while_it_writes(log: Path, tmp_path: Path) -> None:
    with writing(log, tmp_path) as process:
        process.send_signal(signal.SIGINT)
        assert (said(process), process.returncode) == ("lidarcli: interrupted\n", 130)
    assert left(tmp_path) == []


@pytest.mark.parametrize("jobs", ["1", "3"])
def test_terminated_while_it_writes(jobs: str, log: Path, tmp_path: Path) -> None:
    """As `kill` and systemd do it, which tell the whole group: everything is cleared away first."""
    with writing(log, tmp_path, "--jobs", jobs, start_new_session=True) as process:
        os.killpg(process.pid, signal.SIGTERM)
        assert (said(process), process.returncode) == ("lidarcli: terminated\n", -signal.SIGTERM)
    assert left(tmp_path) == []


@pytest.mark.parametrize("moment", STARTS)
def test_interrupted_while_several_logs_get_their_workers(log: Path, tmp_path: Path, moment: str) -> None:
    one, other = tmp_path / "one.mcap", tmp_path / "other.mcap"
    with endless(log, one, other):
        ran = ended(moment, signal.SIGINT, *words(one, tmp_path / "out", str(other), "--jobs", "2"))
    assert (ran.returncode, ran.stderr) == (130, "lidarcli: interrupted\n")
    assert left(tmp_path / "out") == []


@pytest.mark.parametrize("logs", [1, 2])
def test_workers_end_with_the_process_that_gave_them_work(logs: int, log: Path, tmp_path: Path) -> None:
    pipes = [tmp_path / f"run{number}.mcap" for number in range(logs)]
    out = tmp_path / "out"
    with endless(log, *pipes):
        process = detect(pipes[0], out, *map(str, pipes[1:]), "--jobs", "2")
        wait_until(lambda: [*out.glob(".*.part")], process)
        process.kill()
        # The workers share this end of the pipe: it closes when the last of them is gone.
        process.communicate(timeout=HANG)
    assert process.returncode == -signal.SIGKILL


@pytest.mark.parametrize("blocks", [1, 8, 100, 400])
def test_no_room_for_a_file(log: Path, tmp_path: Path, blocks: int) -> None:
    """A limit on the size of files, met at the first bytes, in a row group, or while the second topic waits."""
    command = ["sh", "-c", 'ulimit -f $0; exec "$@"', str(blocks), sys.executable, "-m", "lidarcli", "-q"]
    ran = subprocess.run(
        [*command, "detect", str(log), "--beams", "-o", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 5
    assert ran.stderr.startswith(f"lidarcli: {log}: cannot write ")
    assert len(ran.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@contextmanager
def mounted(folder: Path, options: str) -> Iterator[None]:
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", str(folder)], capture_output=True, check=False)
    if done.returncode:
        pytest.skip("only root may mount a disk")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("size", ["8k", "64k", "400k"])
def test_full_disk(log: Path, tmp_path: Path, size: str) -> None:
    with mounted(tmp_path, f"size={size}"):
        process = detect(log, tmp_path)
        err = said(process)
        assert process.returncode == 5
        assert err.startswith(f"lidarcli: {log}: cannot write ")
        assert err.endswith(": No space left on device\n")
        assert list(tmp_path.iterdir()) == []
    process = detect(log, tmp_path)
    assert (process.wait(), said(process)) == (0, "")
    assert pq.read_metadata(tmp_path / "run.sweeps.parquet").num_rows == SWEEPS


def test_a_killed_overlay_leaves_nothing_that_stays(log: Path, tmp_path: Path) -> None:
    """Its tables lie beside what it writes, where the next run clears them away, and not in the temporary folder."""
    out, temporary, pipe = tmp_path / "out", tmp_path / "temporary", log.with_name("pipe") / log.name
    temporary.mkdir()
    environment = os.environ | {"TMPDIR": str(temporary)}
    command = [sys.executable, "-m", "lidarcli", "-q", "overlay", "-o", str(out / "run.overlay.mcap")]
    with endless(log, pipe):
        killed = subprocess.Popen([*command, str(pipe)], stderr=subprocess.PIPE, env=environment)
        wait_until(lambda: [*out.glob(".*.part/tables/.*.part")], killed)
        killed.kill()
        killed.communicate()
    assert [*temporary.iterdir()] == []
    assert [path.name for path in out.iterdir() if not SCRATCH.fullmatch(path.name)] == []
    write_log(tmp_path / "run.mcap", [raw_sweeps(round_room(5, 180, BOX))])
    again = [*command, "--no-layout", str(tmp_path / "run.mcap")]
    done = subprocess.run(again, capture_output=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert [path.name for path in out.iterdir()] == ["run.overlay.mcap"]
    assert [*temporary.iterdir()] == []


def test_nobody_listens_to_standard_error(log: Path, tmp_path: Path) -> None:
    """As after `2>&1 | head -1`: verdict, outputs and exit code are the same."""
    command = [sys.executable, "-m", "lidarcli", "zones", str(log), "--zones", str(tmp_path / "zones.toml")]
    (tmp_path / "zones.toml").write_text('[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 20 }\n')
    verdict = tmp_path / "checks.xml"
    listening, speaking = os.pipe()
    os.close(listening)
    options = ["--check", "zones.near.events == 0", "-o", str(verdict)]
    with os.fdopen(speaking, "w") as deaf:
        done = subprocess.run([*command, *options], stdout=subprocess.DEVNULL, stderr=deaf, check=False)
    assert done.returncode == 1
    assert "<failure" in verdict.read_text()
