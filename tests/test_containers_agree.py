"""One simulated scene, written in every container and CSV layout, gives the same objects wherever it is read from."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

import lidarcli
from lidarcli.simulate.csv_writer import LAYOUTS
from lidarcli.simulate.generate import simulate_blocks
from lidarcli.simulate.load import load_scene
from lidarcli.simulate.mcap_writer import COMPRESSIONS, ENCODINGS
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import RangeRules, RawSweeps, normalise
from tests.places import SAMPLES

SCENE = SAMPLES / "people.toml"
SWEEPS = 12
SOURCE = ["log", "topic", "frame_id"]
"""Columns that say where a row comes from."""
INEXACT = ("json", "protobuf")
"""foxglove.LaserScan states the last bearing instead of the increment."""
BEARING_ERROR = 1e-9
"""[rad], and the metres that follow from it, where a container states the last bearing, or each, but no increment."""


@dataclass(frozen=True)
class Case:
    """A way to write the scene, and what is lost on it."""

    name: str
    options: dict[str, Any] = field(default_factory=dict)
    exact: bool = True
    """Whether angle_min and the increment come back as they were."""
    geometry: bool = True
    """Whether the container holds any geometry at all."""


def cases() -> list[Case]:
    """Every container, encoding, compression and CSV layout."""
    found = [
        Case("run.mcap", {"encoding": encoding, "compression": compression}, encoding not in INEXACT)
        for encoding in ENCODINGS
        for compression in COMPRESSIONS
    ]
    found += [Case("run.bag", {"compression": compression}) for compression in ("none", "bz2", "lz4")]
    found += [Case("run", {"compression": packed}) for packed in ("none", "zstd", "zstd-message")]
    found += [Case("run", {"container": "ros2-mcap"}), Case("run.db3")]
    for layout in LAYOUTS:
        name = "run" if layout == "per-sweep" else "run.csv"
        options = {"layout": layout, "container": "csv"}
        inexact, bare = layout in ("long", "per-sweep"), layout in ("wide", "drow")
        found.append(Case(name, options, not inexact, geometry=not bare))
    found.append(Case("run.csv.gz"))
    found += [Case("run.log", exact=False), Case("run.clf.gz", exact=False)]
    return found


@pytest.fixture(scope="module")
def sweeps() -> list[RawSweeps]:
    """People walking through a view of 270°, some beams lost, some too close."""
    return [block.raw for block in simulate_blocks(load_scene(SCENE), SWEEPS, size=5)]


@pytest.fixture(scope="module")
def expected(sweeps: list[RawSweeps]) -> pa.Table:
    """The objects of the sweeps as they are in memory, read from nowhere."""
    first, start = 0, int(sweeps[0].time_ns[0])
    batches = []
    for raw in sweeps:
        batches.append(normalise(raw, np.arange(first, first + len(raw)), RangeRules(), start))
        first += len(raw)
    return lidarcli.detect(batches)


@pytest.mark.parametrize(
    "case", cases(), ids=lambda case: "-".join([case.name, *map(str, case.options.values())])
)
def test_the_objects_are_the_same(
    case: Case, sweeps: list[RawSweeps], expected: pa.Table, tmp_path: Path
) -> None:
    assert expected.num_rows > 5 * SWEEPS
    path = tmp_path / case.name
    write_log(path, sweeps, **case.options)
    told = {}
    if not case.geometry:
        first = sweeps[0]
        told = {
            "angle_min": first.angle_min[0],
            "angle_increment": first.angle_increment[0],
            "range_max": float(first.range_max[0]),
        }
    table = lidarcli.detect(path, **told)
    assert table.num_rows == expected.num_rows
    for name in expected.column_names:
        if name in SOURCE:
            continue
        same(name, values(table[name]), values(expected[name]), case.exact)


def values(column: pa.ChunkedArray) -> pa.Array:
    """One array, without a dictionary."""
    array = column.combine_chunks()
    return pc.cast(array, array.type.value_type) if pa.types.is_dictionary(array.type) else array


def same(name: str, got: pa.Array, want: pa.Array, exact: bool) -> None:
    """Equal to the last bit, or, for floats read with inexact bearings, very nearly."""
    if pa.types.is_list(want.type):
        same(f"{name} offsets", pc.list_value_length(got), pc.list_value_length(want), True)
        same(name, pc.list_flatten(got), pc.list_flatten(want), exact)
    elif pa.types.is_struct(want.type):
        for part in want.type:
            same(f"{name}.{part.name}", got.field(part.name), want.field(part.name), exact)
    elif pa.types.is_floating(want.type) and not exact:
        assert got.is_null().equals(want.is_null()), name
        difference = np.abs(numbers(got) - numbers(want))
        assert difference.max(initial=0.0) < BEARING_ERROR, name
    elif pa.types.is_floating(want.type):
        assert got.is_null().equals(want.is_null()), name
        bits = f"i{want.type.bit_width // 8}"
        np.testing.assert_array_equal(numbers(got).view(bits), numbers(want).view(bits), name)
    else:
        assert got.equals(want), name


def numbers(array: pa.Array) -> np.ndarray[Any, Any]:
    """Floats with 0 for null."""
    return pc.fill_null(array, 0.0).to_numpy(zero_copy_only=False)
