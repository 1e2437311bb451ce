"""Point clouds: others read the same points, and a grid keeps the first in each cell."""

from __future__ import annotations

import io
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from lidarcli.maps.clouds import CloudPoints, CloudWriter, ParquetWriter, PcdWriter, PlyWriter, VoxelFilter
from lidarcli.tabular.schemas import CLOUD

SIZES = (3, 0, 1, 1000, 9)


def some_points(count: int, first: int = 0, topic: str = "/scan", sets: bool = True, offset: float = 0.0) -> CloudPoints:
    random = np.random.default_rng(first)
    return CloudPoints(
        "hall",
        topic,
        np.arange(first, first + count) // 4,
        (np.arange(first, first + count) % 4).astype(np.int32),
        1_700_000_000_000_000_000 + np.arange(first, first + count) * 1_000,
        random.normal(offset, 10, count),
        random.normal(offset, 10, count),
        (np.arange(count) % 4 - 1).astype(np.int8) if sets else None,
    )


def batches(sizes: tuple[int, ...] = SIZES) -> list[CloudPoints]:
    return [some_points(size, sum(sizes[:k])) for k, size in enumerate(sizes)]


def write(writer: CloudWriter, points: list[CloudPoints]) -> None:
    for part in points:
        writer.write(part)
    writer.finish()


def coordinates(points: list[CloudPoints]) -> NDArray[np.float64]:
    x, y = (np.concatenate([getattr(part, name) for part in points]) for name in "xy")
    return np.stack([x, y, np.zeros(len(x))], axis=1)


def ply(file: BinaryIO) -> tuple[dict[str, list[list[str]]], bytes]:
    """Header lines by their first word, and what follows, as the format is described."""
    lines: dict[str, list[list[str]]] = {}
    assert file.readline() == b"ply\n"
    while (line := file.readline()) != b"end_header\n":
        assert line.endswith(b"\n")
        word, *rest = line.decode("ascii")[:-1].split(" ")
        lines.setdefault(word, []).append(rest)
    return lines, file.read()


def pcd(file: BinaryIO) -> tuple[dict[str, list[str]], bytes]:
    lines: dict[str, list[str]] = {}
    while "DATA" not in lines:
        line = file.readline().decode("ascii")
        assert line.endswith("\n")
        if not line.startswith("#"):
            word, *rest = line[:-1].split(" ")
            lines[word] = rest
    return lines, file.read()


@pytest.mark.parametrize("sizes", [(), (0,), (9,), (10,), SIZES])
def test_ply(sizes: tuple[int, ...]) -> None:
    file, points = io.BytesIO(), batches(sizes)
    write(PlyWriter(file), points)
    assert file.tell() == len(file.getvalue())
    file.seek(0)
    lines, data = ply(file)
    assert lines["format"] == [["binary_little_endian", "1.0"]]
    assert lines["element"] == [["vertex", str(sum(sizes))]]
    assert lines["property"] == [["double", "x"], ["double", "y"], ["double", "z"]]
    assert set(lines) == {"format", "comment", "element", "property"}
    expected = coordinates(points) if points else np.zeros((0, 3))
    assert np.frombuffer(data, "<f8").reshape(-1, 3).tolist() == expected.tolist()


@pytest.mark.parametrize("sizes", [(), (0,), (9,), (10,), SIZES])
def test_pcd(sizes: tuple[int, ...]) -> None:
    file, points = io.BytesIO(), batches(sizes)
    write(PcdWriter(file), points)
    file.seek(0)
    lines, data = pcd(file)
    count = str(sum(sizes))
    assert lines == {
        "VERSION": ["0.7"],
        "FIELDS": ["x", "y", "z"],
        "SIZE": ["4", "4", "4"],
        "TYPE": ["F", "F", "F"],
        "COUNT": ["1", "1", "1"],
        "WIDTH": [count],
        "HEIGHT": ["1"],
        "VIEWPOINT": ["0", "0", "0", "1", "0", "0", "0"],
        "POINTS": [count],
        "DATA": ["binary"],
    }
    expected = coordinates(points) if points else np.zeros((0, 3))
    assert np.frombuffer(data, "<f4").reshape(-1, 3).tolist() == expected.astype(np.float32).tolist()


@pytest.mark.parametrize("writer", [PlyWriter, PcdWriter, ParquetWriter])
def test_what_is_abandoned_is_not_whole(writer: type[CloudWriter]) -> None:
    left, whole = io.BytesIO(), io.BytesIO()
    for file, end in ((left, "abandon"), (whole, "finish")):
        cloud = writer(file)  # type: ignore[call-arg]
        cloud.write(some_points(60_000))
        getattr(cloud, end)()
    assert left.getvalue() != whole.getvalue()
    # Whoever opened the file closes it.
    assert not left.closed


def test_parquet() -> None:
    file = io.BytesIO()
    first, second = some_points(5), some_points(4, 5, "/rear", sets=False)
    writer = ParquetWriter(file)
    writer.write(first)
    writer.write(second)
    writer.finish({b"lidarcli.version": b"1"})
    table = pq.read_table(io.BytesIO(file.getvalue()))
    assert table.schema.equals(CLOUD.with_metadata({b"lidarcli.version": b"1"}), check_metadata=True)
    assert table["log"].to_pylist() == ["hall"] * 9
    assert table["topic"].to_pylist() == ["/scan"] * 5 + ["/rear"] * 4
    assert table["sweep"].to_pylist() == [0, 0, 0, 0, 1, 1, 1, 1, 2]
    assert table["beam"].to_pylist() == [0, 1, 2, 3, 0, 1, 2, 3, 0]
    assert table["stamp"].cast(pa.int64()).to_pylist() == [*first.stamp_ns, *second.stamp_ns]
    assert table["x"].to_pylist() == [*first.x, *second.x]
    assert table["y"].to_pylist() == [*first.y, *second.y]
    assert table["set"].to_pylist() == [None, "O", "A", "S", None, None, None, None, None]


def kept_slowly(x: NDArray[np.float64], y: NDArray[np.float64], size: float) -> list[bool]:
    seen: set[tuple[float, float]] = set()
    kept = []
    for cell in zip((x / size).tolist(), (y / size).tolist(), strict=True):
        key = (np.floor(cell[0]), np.floor(cell[1]))
        kept.append(key not in seen)
        seen.add(key)
    return kept


@pytest.mark.parametrize("size", [0.05, 0.7, 30.0])
@pytest.mark.parametrize("batch", [1, 7, 1024, 5000])
def test_the_first_in_each_cell_is_kept(size: float, batch: int) -> None:
    points = some_points(5000)
    x, y = np.round(points.x, 1), np.round(points.y, 1)
    grid = VoxelFilter(size)
    kept = np.concatenate([grid.keep(x[k : k + batch], y[k : k + batch]) for k in range(0, len(x), batch)])
    assert kept.dtype == np.bool_
    assert kept.tolist() == kept_slowly(x, y, size)
    assert grid.cells == kept.sum()
    assert not grid.keep(x, y).any()
