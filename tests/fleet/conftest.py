"""Logs for runs over many of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from lidarcli.simulation.writers import write_log
from tests.sweeping import room_sweeps


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of a few sweeps."""
    path = tmp_path_factory.mktemp("small") / "small.mcap"
    write_log(path, [room_sweeps(count=5)])
    return path.read_bytes()


@pytest.fixture
def bags(tmp_path: Path, small: bytes) -> Path:
    """A folder of six logs, two of which have one name."""
    folder = tmp_path / "bags"
    for name in ("a/run", "b/run", "one", "two", "three", "four"):
        path = folder / f"{name}.mcap"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(small)
    return folder


def tables(folder: Path) -> dict[str, bytes]:
    """The tables below a folder, by their names."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*.parquet"))}
