"""Manifests of runs in a folder of tables: rows that name any outputs, sizes and times, before `--resume`."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli._version import __version__
from lidarcli.tabular.schemas import RUNS
from tools.fuzz.commands import judge_commands
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, put
from tools.fuzz.target import Random, Target

OUTPUTS = (
    *("{out}/run.objects.parquet", "{out}/run.sweeps.parquet", "{out}/../victims/thesis", "{victims}/thesis"),
    *("{victims}/folder/inside", "{victims}/new", "s3://b/x?endpoint_override=127.0.0.1:1&scheme=http"),
    *("https://me:pass@host/x", "s3://AK:SK@b/x", "", "-", "\x1b[31m", "a" * 3000, "\\xe9"),
)
KNOWN: tuple[tuple[str, ...], ...] = ((), OUTPUTS[3:4], OUTPUTS[6:7], OUTPUTS[:2], OUTPUTS[:1], (OUTPUTS[0],) * 2)
ODD: dict[str, tuple[Any, ...]] = {
    "outcome": ("ok", "ok", "damaged", "failed", "odd"),
    "exit_code": (0, 0, 3, 70, -1),
    "parameters": ("", "0" * 32, "\x07"),
    "version": (__version__, __version__, "0"),
    "ended": (0, 1 << 62, -1),
    "mtime": (0, 1 << 62, None),
    "size": (0, 1, 1 << 52, None),
    "message": (None, "\x1b[31m", "a" * 3000),
}


def write(place: Place, number: int, random: Random) -> None:
    """The tables of a log where an earlier run would have put them, and a manifest of it."""
    put(place)
    for table in ("objects", "sweeps"):
        data = (place.input / f"run.{table}.parquet").read_bytes()
        (place.out / f"run.{table}.parquet").write_bytes(data)
    names = KNOWN[number] if number < len(KNOWN) else _some(random)
    outputs = [name.format(out=place.out, victims=place.victims) for name in names]
    row: dict[str, Any] = {
        **dict.fromkeys(RUNS.names),
        "log": "run",
        "url": str(place.input / LOG),
        "parameters": "",
        "version": __version__,
        "outcome": "ok",
        "exit_code": 0,
        "outputs": outputs,
        "ended": 1 << 60,
        "size": (place.input / LOG).stat().st_size,
        "output_sizes": [int(random.integers(0, 3000)) for _ in outputs],
    }
    if number >= len(KNOWN):
        row |= {name: pool[int(random.integers(len(pool)))] for name, pool in ODD.items() if random.integers(2)}
    folder = place.out / "_lidarcli"
    folder.mkdir()
    table = pa.Table.from_pylist([row] * int(random.integers(1, 3)), RUNS)
    pq.write_table(table, folder / "run-20260101T000000.000Z-00000000.parquet")
    resume = ["detect", f"in/{LOG}", "-o", "out", "--resume"]
    place.note(commands=[[*resume, "--dry-run"], resume, resume])


def _some(random: Random) -> list[str]:
    return [OUTPUTS[int(random.integers(len(OUTPUTS)))] for _ in range(int(random.integers(4)))]


def manifest_targets() -> list[Target]:
    """Manifests."""
    return [Target("manifests", write, judge_commands, weight=10, known=len(KNOWN))]
