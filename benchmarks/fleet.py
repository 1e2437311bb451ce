"""`make fleet`: what runs over many logs cost; figures for docs/fleet.md.

- many: N small logs in an S3 store of this machine, two workers one of which is killed in the middle, and a log that kills
  whoever reads it: whether all other tables are those of a run without a cluster, byte by byte.
- speed: the same logs with `--jobs 2` and with `--cluster local:2`.
- memory: what the driver takes with few and with many logs whose work is nothing.
- requests: what a log in a store costs in requests and bytes.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LIDARCLI = [sys.executable, "-m", "lidarcli"]
CREDENTIALS = {"AWS_ACCESS_KEY_ID": "benchmark", "AWS_SECRET_ACCESS_KEY": "benchmark", "AWS_DEFAULT_REGION": "us-east-1"}
KILLER = """
import os

def dask_setup(worker):
    from lidarcli.pipeline import detecting

    real = detecting.open_source

    def open_source(source, csv=None):
        if source.name == "killer":
            os.kill(os.getpid(), 9)
        return real(source, csv)

    detecting.open_source = open_source
"""
"""What the workers of the first measurement load."""


REQUEST = re.compile(r'"(?:\x1b\[\d+m)*([A-Z]+) (\S+) HTTP')
"""What the server writes of a request: its method and path."""


@dataclass(frozen=True)
class Server:
    """An S3 store on this machine."""

    environment: dict[str, str]
    words: Path

    def asked(self) -> list[str]:
        """Methods and paths of all requests so far."""
        return [" ".join(found) for found in REQUEST.findall(self.words.read_text())]


@contextlib.contextmanager
def s3_server(folder: Path) -> Iterator[tuple[str, Path]]:
    """A server that is gone afterwards: its address, and the file in which it writes of requests."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = folder / "requests.txt"
    with words.open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], stdout=out, stderr=out
        )
    try:
        until = time.monotonic() + 60
        while True:
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port)).close()
                break
            if process.poll() is not None or time.monotonic() > until:
                raise SystemExit(f"the store does not come up: {words.read_text()}")
            time.sleep(0.05)
        yield f"http://127.0.0.1:{port}", words
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def store(folder: Path) -> Iterator[Server]:
    """A store that is gone afterwards, with a bucket `robots`."""
    with s3_server(folder) as (endpoint, words):
        environment = {**os.environ, **CREDENTIALS, "AWS_ENDPOINT_URL": endpoint}
        _system(environment).create_dir("robots")
        yield Server(environment, words)


def _system(environment: dict[str, str]) -> Any:
    import pyarrow.fs as fs

    return fs.S3FileSystem(
        endpoint_override=environment["AWS_ENDPOINT_URL"],
        access_key=environment["AWS_ACCESS_KEY_ID"],
        secret_key=environment["AWS_SECRET_ACCESS_KEY"],
        region=environment["AWS_DEFAULT_REGION"],
        allow_bucket_creation=True,
    )


def made(folder: Path, count: int, sweeps: int) -> Path:
    """A folder of logs of one scene."""
    from lidarcli.simulation.run import simulate

    scene = Path(__file__).parents[1] / "samples" / "room.toml"
    first = folder / "first.mcap"
    simulate(scene, first, sweeps=sweeps)
    logs = folder / "logs"
    logs.mkdir()
    for number in range(count):
        shutil.copy(first, logs / f"run{number:05}.mcap")
    return logs


def timed(*arguments: object, **settings: Any) -> tuple[float, subprocess.CompletedProcess[str]]:
    """Seconds of a run of the command line, and what it said."""
    started = time.perf_counter()
    ran = subprocess.run([*LIDARCLI, *map(str, arguments)], capture_output=True, text=True, check=False, **settings)
    return time.perf_counter() - started, ran


def many(folder: Path, count: int) -> dict[str, Any]:
    """Logs in a store, a worker that is killed, a log that kills."""
    logs = made(folder, count, 5)
    here = folder / "here"
    timed("-q", "detect", logs, "-o", here, "--jobs", 1)
    (folder / "killer.py").write_text(KILLER)
    with store(folder) as server:
        system = _system(server.environment)
        for log in [*sorted(logs.iterdir()), folder / "killer.mcap"]:
            data = (log if log.exists() else logs / "run00000.mcap").read_bytes()
            with system.open_output_stream(f"robots/logs/{log.name}", compression=None) as out:
                out.write(data)
        environment = {**server.environment, "DASK_DISTRIBUTED__WORKER__PRELOAD": repr([str(folder / "killer.py")])}
        command = ("detect", "s3://robots/logs/*.mcap", "-o", "s3://robots/tables", "--cluster", "local:2")
        started = time.perf_counter()
        run = subprocess.Popen([*LIDARCLI, "-q", *command], env=environment, stderr=subprocess.PIPE, text=True)
        while sum("PUT /robots/tables/" in line for line in server.asked()) < count // 2:
            if run.poll() is not None:
                break
            time.sleep(0.2)
        victims = workers_of(run.pid)
        if victims:
            os.kill(victims[0], signal.SIGKILL)
        said = run.communicate()[1]
        seconds = time.perf_counter() - started
        equal = 0
        for table in sorted(here.glob("*.parquet")):
            with system.open_input_stream(f"robots/tables/{table.name}", compression=None) as file:
                equal += bytes(file.read()) == table.read_bytes()
        before = len(server.asked())
        again_seconds, again = timed("detect", *command[1:4], "--resume", env=server.environment)
        asked = server.asked()[before:]
    return {
        "logs": count,
        "exit": run.returncode,
        "said": said.splitlines(),
        "workers killed": bool(victims),
        "equal tables": equal,
        "of": 2 * count,
        "seconds": seconds,
        "resume": {
            "exit": again.returncode,
            "seconds": again_seconds,
            "total": again.stderr.splitlines()[-1],
            "logs read": sorted({line.split("/")[-1] for line in asked if "/logs/" in line}),
            "requests": len(asked),
        },
    }


def workers_of(pid: int) -> list[int]:
    """Worker processes below a run."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == pid and b"spawn_main" in (entry / "cmdline").read_bytes():
                found.append(int(entry.name))
    return found


def speed(folder: Path, count: int, sweeps: int, rounds: int) -> dict[str, Any]:
    """Processes of one machine against workers of a cluster on it, one after the other in each round."""
    logs = made(folder, count, sweeps)
    pairs = []
    for _ in range(rounds):
        seconds = []
        for how in (("--jobs", "2"), ("--cluster", "local:2")):
            out = folder / "out"
            took, ran = timed("-q", "detect", logs, "-o", out, *how)
            assert ran.returncode == 0, ran.stderr
            shutil.rmtree(out)
            seconds.append(took)
        pairs.append(seconds)
    return {
        "logs": count,
        "sweeps": sweeps,
        "jobs 2 [s]": [pair[0] for pair in pairs],
        "cluster local:2 [s]": [pair[1] for pair in pairs],
        "ratio": sorted(pair[1] / pair[0] for pair in pairs),
    }


def memory(counts: list[int]) -> dict[str, Any]:
    """What the driver takes over logs whose work is nothing, each count in a process of its own."""
    found = {}
    for count in counts:
        ran = subprocess.run(
            [sys.executable, "-m", "benchmarks.fleet", "drive", str(count)], capture_output=True, text=True, check=True
        )
        found[f"{count} logs"] = json.loads(ran.stdout)
    return found


def drive(count: int) -> dict[str, float]:
    """The driver's part of a run over a cluster whose tasks do nothing."""
    from lidarcli.cli.messages import Total
    from lidarcli.pipeline.inputs.sources import Source
    from lidarcli.pipeline.runs import cluster

    def used() -> float:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

    sources = [Source(f"/logs/run{number:06}.mcap", f"run{number:06}") for number in range(count)]
    with cluster.connected("local:2") as client:
        total = Total()
        before = used()
        started = time.perf_counter()
        for outcome in cluster.outcomes(client, sources, nothing):
            total.add(outcome)
        seconds = time.perf_counter() - started
        return {"before [MB]": before, "after [MB]": used(), "seconds": seconds, "logs per second": count / seconds}


def nothing(source: object, progress: object = None) -> Any:
    """Work that is none, with a summary as large as a real one."""
    from lidarcli.pipeline.reading.one_log import RunSummary

    summary = RunSummary(sweeps=300, objects=1500, rows=1800, seconds=0.01)
    summary.outputs = [f"/tables/{getattr(source, 'name', '')}.{table}.parquet" for table in ("objects", "sweeps")]
    return summary


def requests(folder: Path, sweeps: int) -> dict[str, Any]:
    """Requests and bytes of one log in a store."""
    logs = made(folder, 1, sweeps)
    log = logs / "run00000.mcap"
    with store(folder) as server:
        system = _system(server.environment)
        with system.open_output_stream("robots/run.mcap", compression=None) as out:
            out.write(log.read_bytes())
        before = len(server.asked())
        seconds, ran = timed(
            "detect", "s3://robots/run.mcap", "-o", "s3://robots/tables", "--overwrite", env=server.environment
        )
        assert ran.returncode == 0, ran.stderr
        asked = server.asked()[before:]
    local, _ = timed("detect", log, "-o", folder / "out", "--overwrite")
    return {
        "bytes": log.stat().st_size,
        "tables": sum(path.stat().st_size for path in (folder / "out").iterdir()),
        "requests": {method: sum(line.startswith(method) for line in asked) for method in ("HEAD", "GET", "PUT", "POST")},
        "seconds": seconds,
        "seconds here": local,
    }


def main() -> None:
    """Measure, and print what was found as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("many", "speed", "memory", "requests", "drive", "all"))
    parser.add_argument("count", nargs="?", type=int)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    if asked.what == "drive":
        print(json.dumps(drive(asked.count)))
        return
    with tempfile.TemporaryDirectory(prefix="lidarcli-fleet-") as name:
        folder = Path(name)
        parts = {
            "many": lambda at: many(at, asked.count or 500),
            "speed": lambda at: speed(at, asked.count or 2000, 300, asked.rounds),
            "memory": lambda _: memory([100, asked.count or 5000]),
            "requests": lambda at: requests(at, asked.count or 20_000),
        }
        for what, part in parts.items():
            if asked.what in (what, "all"):
                (folder / what).mkdir()
                print(json.dumps({what: part(folder / what)}, indent=2), flush=True)


if __name__ == "__main__":
    main()
