"""One simulated scene, written in every container and CSV layout, gives the same objects wherever it is read from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

import lidarcli
from lidarcli.simulation.generate import simulate_blocks
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.writers import MCAP_COMPRESSIONS
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import RawSweeps, SweepBatch
from tests.places import SAMPLES
from tests.text_logs import LAYOUTS, write_log

SCENE = SAMPLES / "people.toml"
SWEEPS = 12
SOURCE = ["log", "topic", "frame_id"]
"""Columns that say where a row comes from."""
INEXACT = ("json", "protobuf")
"""foxglove.LaserScan states the last bearing instead of the increment."""
BEARING_ERROR = 1e-9
"""[rad], and the metres that follow from it, where a container states the last bearing, or each, but no increment."""
ENCODINGS = ("cdr", "ros1", "json", "protobuf")
CLOUD_ERROR = 1e-4
"""[m], [rad] and what follows from it where coordinates of points are rounded to float32."""


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
        for compression in MCAP_COMPRESSIONS
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
    found += [Case("run.mcap", {"encoding": encoding, "clouds": True}) for encoding in ENCODINGS]
    found += [Case(name, {"clouds": True}) for name in ("run.bag", "run", "run.db3")]
    found += [Case("run.jsonl"), Case("run.jsonl.gz")]
    found += [Case("run.log", exact=False), Case("run.clf.gz", exact=False)]
    return found


@pytest.fixture(scope="module")
def sweeps() -> list[RawSweeps]:
    """People walking through a view of 270°, some beams lost, some too close."""
    return [block.raw for block in simulate_blocks(load_scene(SCENE), SWEEPS, size=5)]


@pytest.fixture(scope="module")
def expected(sweeps: list[RawSweeps]) -> pa.Table:
    """The objects of the sweeps as they are in memory, read from nowhere."""
    return lidarcli.detect(batches(sweeps))


def batches(sweeps: list[RawSweeps]) -> list[SweepBatch]:
    """Sweeps as `detect` takes them."""
    first, start = 0, int(sweeps[0].time_ns[0])
    found = []
    for raw in sweeps:
        found.append(normalise(raw, np.arange(first, first + len(raw)), RangeRules(), start))
        first += len(raw)
    return found


@pytest.fixture(scope="module")
def expected_of_clouds(sweeps: list[RawSweeps]) -> pa.Table:
    """The same, but that a cloud has no point where a beam has no range, whatever the reason."""
    bare = []
    for raw in sweeps:
        with np.errstate(invalid="ignore"):
            seen = (raw.ranges >= raw.range_min[:, None]) & (raw.ranges < raw.range_max[:, None])
        bare.append(replace(raw, ranges=np.where(seen, raw.ranges, np.float32(np.inf))))
    return lidarcli.detect(batches(bare))


@pytest.mark.parametrize("case", cases(), ids=lambda case: "-".join([case.name, *map(str, case.options.values())]))
def test_the_objects_are_the_same(
    case: Case, sweeps: list[RawSweeps], expected: pa.Table, expected_of_clouds: pa.Table, tmp_path: Path
) -> None:
    assert expected.num_rows > 5 * SWEEPS
    path = tmp_path / case.name
    write_log(path, sweeps, **case.options)
    told: dict[str, Any] = {}
    first = sweeps[0]
    error = 0.0 if case.exact else BEARING_ERROR
    if "clouds" in case.options:
        told = {
            "slice": (-0.1, 0.1),
            "bins": int(first.beams[0]),
            "angle_min": first.angle_min[0],
            "angle_increment": first.angle_increment[0],
            "range": (float(first.range_min[0]), float(first.range_max[0])),
        }
        expected, error = expected_of_clouds, CLOUD_ERROR
    if not case.geometry:
        told = {
            "angle_min": first.angle_min[0],
            "angle_increment": first.angle_increment[0],
            "range_max": float(first.range_max[0]),
            "columns": "seq,time,ranges" if case.options["layout"] == "drow" else (),
        }
    table = lidarcli.detect(path, **told)
    assert table.num_rows == expected.num_rows
    for name in expected.column_names:
        if name in SOURCE:
            continue
        want = values(expected[name])
        same(name, values(table[name]), want, error)


def test_rplidar_text_agrees_but_for_what_it_rounds(sweeps: list[RawSweeps], expected: pa.Table, tmp_path: Path) -> None:
    """It has quarters of millimetres, no limits and no times, and its beams run the other way round."""
    for name in ("run.txt", "run.txt.gz"):
        write_log(tmp_path / name, sweeps)
        with pytest.warns(UserWarning, match="have one stamp"):
            table = lidarcli.detect(tmp_path / name)
        assert table.num_rows == expected.num_rows
        for column in ("sweep", "shape", "beams", "set"):
            same(column, values(table[column]), values(expected[column]), 0.0)
        for column in ("x", "y", "r_min", "width", "box_length"):
            got, want = numbers(values(table[column])), numbers(values(expected[column]))
            assert np.abs(got - want).max() < (5e-3 if column in ("width", "box_length") else 2e-4), column
    # Sweeps that are rounded and turned round by hand give the same in every column.
    turned = lidarcli.detect(batches([_rounded(raw) for raw in sweeps]))
    for name in expected.column_names:
        if name not in (*SOURCE, "stamp", "t"):
            same(name, values(table[name]), values(turned[name]), 1e-6)


def _rounded(raw: RawSweeps) -> RawSweeps:
    """Clockwise, in quarters of a millimetre."""
    seen = np.isfinite(raw.ranges) & (raw.ranges > 0)
    quarters = np.round(np.where(seen, raw.ranges.astype(np.float64), 0.0) * 4000)
    return replace(
        raw,
        ranges=(quarters / 4000).astype(np.float32)[:, ::-1],
        angle_min=raw.angle_min + (raw.beams - 1) * raw.angle_increment,
        angle_increment=-raw.angle_increment,
        range_min=np.zeros_like(raw.range_min),
        range_max=np.full_like(raw.range_max, np.inf),
    )


def values(column: pa.ChunkedArray) -> pa.Array:
    """One array, without a dictionary."""
    array = column.combine_chunks()
    return pc.cast(array, array.type.value_type) if pa.types.is_dictionary(array.type) else array


def same(name: str, got: pa.Array, want: pa.Array, error: float) -> None:
    """Equal to the last bit or, for floats read with an error, very nearly."""
    if pa.types.is_list(want.type):
        same(f"{name} offsets", pc.list_value_length(got), pc.list_value_length(want), 0.0)
        same(name, pc.list_flatten(got), pc.list_flatten(want), error)
    elif pa.types.is_struct(want.type):
        for part in want.type:
            same(f"{name}.{part.name}", got.field(part.name), want.field(part.name), error)
    elif pa.types.is_floating(want.type) and error:
        assert got.is_null().equals(want.is_null()), name
        difference = np.abs(numbers(got) - numbers(want))
        assert difference.max(initial=0.0) < error, name
    elif pa.types.is_floating(want.type):
        assert got.is_null().equals(want.is_null()), name
        bits = f"i{want.type.bit_width // 8}"
        np.testing.assert_array_equal(numbers(got).view(bits), numbers(want).view(bits), name)
    else:
        assert got.equals(want), name


def numbers(array: pa.Array) -> np.ndarray[Any, Any]:
    """Floats with 0 for null."""
    return pc.fill_null(array, 0.0).to_numpy(zero_copy_only=False)
