"""The program as users run it: a map or the objects of a log."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.maps.grids import read_map

LIDARCLI = str(Path(sys.executable).with_name("lidarcli"))


def run(*arguments: str) -> None:
    """Run a command; a failure ends the benchmark with what it said."""
    done = subprocess.run((LIDARCLI, "-q", *arguments), capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"lidarcli {' '.join(arguments)}: exit code {done.returncode}\n{done.stderr}")


def make_map(log: Path, *options: str) -> Occupancy:
    """The map of a log."""
    with tempfile.TemporaryDirectory(prefix="lidarcli-maps-") as folder:
        target = Path(folder) / "map.yaml"
        run("map", str(log), "-o", str(target), *options)
        return read_map(target)


def find_objects(log: Path, *options: str) -> tuple[pa.Table, pa.Table]:
    """The objects of a log, and its beams."""
    with tempfile.TemporaryDirectory(prefix="lidarcli-maps-") as folder:
        run("detect", str(log), "-o", folder, "--beams", *options)
        tables = (Path(folder) / f"{log.stem}.{kind}.parquet" for kind in ("objects", "beams"))
        objects, beams = (pq.read_table(path) for path in tables)
        return objects, beams
