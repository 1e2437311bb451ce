"""The golden tables: what `detect` finds in the first sweeps of every sample, kept to be compared (`make golden`)."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.cli import run

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "tests" / "golden"
SAMPLES = ("room.mcap", "corridor.bag", "hall", "people.csv.gz", "drive.db3")
PROFILES = ("robust", "paper")
SECONDS = {"robust": "0.15", "paper": "0.05"}
"""Two sweeps at 10 Hz, or one: to the letter, noise breaks walls into many objects."""
DECIMALS = 5
CASES = [(sample, profile) for sample in SAMPLES for profile in PROFILES]


def golden_path(sample: str, profile: str) -> Path:
    """The file that holds the expected rows of a sample."""
    return FOLDER / f"{sample.split('.')[0]}.{profile}.ndjson"


def rows(sample: str, profile: str, folder: Path) -> list[dict[str, Any]]:
    """The rows of the sweeps table, then those of the objects table, without nulls; `folder` takes the tables."""
    log = str(ROOT / "samples" / sample)
    options = ["--profile", profile, "--end", SECONDS[profile], "--walls", "--overwrite"]
    code = run(["-q", "detect", log, "-o", str(folder), *options])
    if code:
        raise SystemExit(f"{log}: exit code {code}")
    name = sample.split(".")[0]
    return [
        {"table": table, **row}
        for table in ("sweeps", "objects")
        for row in _plain(pq.read_table(folder / f"{name}.{table}.parquet"))
    ]


def expected(sample: str, profile: str) -> list[dict[str, Any]]:
    """The rows that are kept of a sample."""
    return [json.loads(line) for line in golden_path(sample, profile).read_text("utf-8").splitlines()]


def differences(found: list[dict[str, Any]], wanted: list[dict[str, Any]]) -> list[str]:
    """A line for each row that is another; numbers are the same within the rounding of the golden tables."""
    numbers = [[row["table"] for row in rows] for rows in (found, wanted)]
    if numbers[0] != numbers[1]:
        return [f"{len(found)} rows instead of {len(wanted)}"]
    return [
        f"{want['table']}, sweep {want['sweep']}, object {want.get('object')}: {row} instead of {want}"
        for row, want in zip(found, wanted, strict=True)
        if not alike(row, want)
    ]


def alike(one: Any, other: Any) -> bool:
    """Equal, but for numbers within the rounding of the golden tables."""
    if isinstance(one, float) and isinstance(other, float):
        return one == other or abs(one - other) <= 2 * 10**-DECIMALS
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(alike, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(alike(one[name], other[name]) for name in one)
    return bool(one == other)


def _plain(table: pa.Table) -> Iterator[dict[str, Any]]:
    stamps = table["stamp"].cast(pa.int64()).to_pylist()
    for stamp, row in zip(stamps, table.drop_columns(["stamp", "log"]).to_pylist(), strict=True):
        yield {"stamp_ns": stamp, **{name: _rounded(value) for name, value in row.items() if value is not None}}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DECIMALS)
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return value


def main() -> None:
    """Write every golden table."""
    FOLDER.mkdir(exist_ok=True)
    for sample, profile in CASES:
        with tempfile.TemporaryDirectory() as folder:
            lines = [json.dumps(row) + "\n" for row in rows(sample, profile, Path(folder))]
        golden_path(sample, profile).write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
