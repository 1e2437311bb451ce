"""One beam per row in several layers is refused; times of a column without a unit tell it by their steps."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.csv.beam_rows import BACK, DOUBLED, TURNS
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.logs.watched import CsvLog

FOV = OpenOptions(fov=2 * np.pi)
Table = Sequence[Sequence[object]] | np.ndarray


def text_of(table: Table, names: str = "", separator: str = ",") -> bytes:
    lines = [separator.join(f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in row) for row in table]
    return "\n".join([*([names] if names else []), *lines, ""]).encode()


def read(text: bytes, options: OpenOptions = FOV) -> tuple[RawSweeps, CsvLog]:
    with CsvLog(io.BytesIO(text), options) as log:
        return concatenate(list(log.scans())), log


def refusal(text: bytes, options: OpenOptions = FOV) -> str:
    with pytest.raises(UnreadableError) as error:
        CsvLog(io.BytesIO(text), options)
    message = str(error.value)
    assert "\n" not in message
    return message.partition(": ")[2]


@pytest.mark.parametrize(
    ("step", "unit", "note"),
    [
        (1, 10**9, ""),
        (9, 10**9, ""),
        (100, 10**6, "times are milliseconds"),
        (25, 10**6, "times are milliseconds"),
        (100_000, 10**3, "times are microseconds"),
        (25_000, 10**3, "times are microseconds"),
        (100_000_000, 1, ""),
    ],
)
@pytest.mark.parametrize("start", [0, 12_345])
def test_whole_times_tell_their_unit_by_their_steps(step: int, unit: int, note: str, start: int) -> None:
    times = [start + step * row for row in range(9)]
    got, log = read(text_of([[t, 1, 2, 3] for t in times], "time,r0,r1,r2"))
    assert got.stamp_ns.tolist() == [t * unit for t in times]
    assert ("times are" in log.report.notes[0]) == bool(note)
    assert note in log.report.notes[0]


def layered(names: str, key: bool) -> bytes:
    rows = []
    for sweep in range(2):
        for layer in (-2, 0, 2, 4):
            for angle in range(0, 360, 2):
                rows.append([*([sweep] if key else []), layer, angle, 3.5])
    return text_of(rows, names)


@pytest.mark.parametrize(
    "name", ["elevation_deg", "layer", "ring", "channel", "laser_id", "vertical_angle", "Elevation (rad)"]
)
def test_a_column_of_layers_is_refused(name: str) -> None:
    message = refusal(layered(f"sweep,{name},azimuth_deg,range", True))
    assert message == (
        f"one beam per row, in several layers (column '{name}' holds '-2', '0', '2', ...); lidarcli reads scans of one"
        " plane: keep the rows of one layer"
    )
    one = text_of([[s, 2, a, 3.5] for s in range(2) for a in range(0, 360, 2)], f"sweep,{name},azimuth_deg,range")
    got, log = read(one)
    assert (got.beams.tolist(), log.report.damage, log.report.refused.total()) == ([180, 180], [], 0)


def keyed(bearings: Any) -> bytes:
    rows = [[sweep, round(float(angle), 4), 2.5] for sweep in range(2) for angle in bearings]
    good = [[sweep, angle, 2.5] for sweep in (2, 3) for angle in range(0, 360, 2)]
    return text_of(rows + good, "sweep,angle_deg,range")


@pytest.mark.parametrize(
    ("bearings", "cause"),
    [
        (np.tile(np.arange(0, 360, 2), 4), TURNS),
        (np.arange(0, 1355, 0.25), TURNS),
        (np.tile(np.arange(-100, 101, 2), 4), TURNS),
        (np.tile(np.arange(-60, 61, 2), 4), BACK),
        (np.repeat(np.arange(0, 360, 2), 4), DOUBLED),
    ],
    ids=["turns", "on", "wide", "narrow", "interleaved"],
)
def test_layers_under_one_key_are_no_sweep(bearings: np.ndarray, cause: str) -> None:
    got, log = read(keyed(bearings))
    assert got.beams.tolist() == [180, 180]
    assert log.report.refused == {("/scan", cause): 2}


@pytest.mark.parametrize("start", [0, 100, 357])
def test_a_turn_that_overlaps_its_start_is_a_sweep(start: float) -> None:
    random = np.random.default_rng(2)
    bearings = (start + np.arange(0, 368, 1.0) + random.uniform(-0.3, 0.3, 368)) % 360
    got, log = read(keyed(bearings))
    assert len(got) == 4
    assert log.report.refused.total() == 0
