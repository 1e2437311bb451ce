"""Windows of a path against the distance field of a map: known shifts, moved things, unmapped rooms, walls in between."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from lidarcli.formalism.localisation import Field, field_of, intervals_of, judge, states_of
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.options.choices import MAP_STATES
from lidarcli.sweeps.types import TURN, Float64
from lidarcli.system import compiled
from tests.places import ROOT

SIZE, SIDE = 160, 0.05
"""A room of 8 x 8 m, with a box on the left and a niche on top, so that nothing in it is symmetric."""
BOX = (1.0, 2.0, 1.5, 3.2)


def grid(known: float = 8.0, box: tuple[float, float, float, float] = BOX) -> Occupancy:
    """The map of the room, unknown beyond `known` along x."""
    x, y = np.meshgrid((np.arange(SIZE) + 0.5) * SIDE, (np.arange(SIZE) + 0.5) * SIDE)
    wall = (x < 0.1) | (x > 7.9) | (y < 0.1) | (y > 7.9) | ((x > 5) & (y > 6.5))
    wall |= (x > box[0]) & (x < box[2]) & (y > box[1]) & (y < box[3])
    cells = np.where(wall, OCCUPIED, FREE).astype(np.int8)
    cells[x > known] = UNKNOWN
    return Occupancy(SIDE, 0.0, 0.0, cells)


def window(x: float, y: float, yaw: float = 0.0, told: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Float64:
    """(4, P) points of a window that a sensor sees at x, y, by poses that are wrong by `told`."""
    true = grid()
    theta = np.linspace(0.0, TURN, 120, endpoint=False)
    r = np.full(len(theta), np.nan)
    for step in np.arange(0.1, 12.0, 0.01):
        i, j = ((y + step * np.sin(yaw + theta)) / SIDE).astype(int), ((x + step * np.cos(yaw + theta)) / SIDE).astype(int)
        hit = np.isnan(r) & (true.cells[i.clip(0, SIZE - 1), j.clip(0, SIZE - 1)] == OCCUPIED)
        r[hit] = step
    a = yaw + told[2] + theta
    at_x, at_y = x + told[0], y + told[1]
    return np.stack([at_x + r * np.cos(a), at_y + r * np.sin(a), np.full(len(r), at_x), np.full(len(r), at_y)])


def found_of(field: Field, *windows: Float64) -> Float64:
    found = np.empty((len(windows), field.columns))
    counts = np.array([0, *(each.shape[1] for each in windows)], np.int64)
    judge(field, np.ascontiguousarray(np.concatenate(windows, axis=1)), np.cumsum(counts), found)
    return found


def states(found: Float64) -> list[str]:
    return [MAP_STATES[code] for code in states_of(np.full(len(found), 120), found)[0]]


@pytest.mark.parametrize("told", [(0.3, 0.0, 0.0), (0.0, -0.5, 0.0), (1.0, 0.2, 0.0), (0.0, 0.0, 0.26), (-0.4, 0.3, -0.1)])
def test_a_known_error_is_found_to_two_centimetres(told: tuple[float, float, float]) -> None:
    found = found_of(field_of(grid()), window(3.0, 4.0, 0.3, told))
    assert states(found) == ["off"]
    # The correction turns about the sensor.
    assert found[0, 4:7] == pytest.approx(np.negative(told), abs=0.02)
    assert found[0, 8:] == pytest.approx([3.0 + told[0], 4.0 + told[1]])


def test_a_right_path_fits_also_where_something_was_moved() -> None:
    places = [window(3.0, 4.0), window(4.5, 2.0, 1.0), window(6.5, 5.5, 2.0)]
    found = found_of(field_of(grid()), *places)
    assert states(found) == ["fits"] * 3
    assert (found[:, 0] > 0.97).all()
    moved = found_of(field_of(grid(box=(2.2, 1.0, 2.7, 2.2))), *places)
    assert states(moved) == ["fits"] * 3
    assert (moved[:2, 0] < 0.97).all()


def test_unmapped_ground_is_unknown_and_a_far_place_lost() -> None:
    half = field_of(grid(known=3.0))
    assert states(found_of(half, window(6.5, 3.0))) == ["unknown"]
    assert states(found_of(field_of(grid()), window(2.5, 5.0, 0.0, (3.5, -2.0, 2.0)))) == ["lost"]
    few = found_of(half, window(2.0, 4.0))
    assert states_of(np.array([39]), few)[0].tolist() == [MAP_STATES.index("unknown")]


def test_intervals_have_two_windows_with_corrections_alike() -> None:
    off, lost = MAP_STATES.index("off"), MAP_STATES.index("lost")
    state = np.array([0, off, off, 0, off, 0, 0, lost, 0, lost, 0, 0, off, 0], np.int8)
    found = np.zeros((14, 10))
    assert [part.tolist() for part in intervals_of(np.arange(14), state, found)] == [[1, 2, 4], [7, 9]]
    found[2, 4] = 2.0
    assert [part.tolist() for part in intervals_of(np.arange(14), state, found)] == [[7, 9]]
    assert intervals_of(np.arange(0), state[:0], found[:0]) == []
    # Alone is enough where it explains much more.
    found[12, 2] = 0.4
    assert [part.tolist() for part in intervals_of(np.arange(14), state, found)] == [[7, 9], [12]]


@pytest.mark.slow
@pytest.mark.skipif(not compiled.is_there(), reason="the core was not compiled")
def test_the_compiled_field_gives_the_bits_of_its_source() -> None:
    words = (
        "from tests.formalism.test_localisation import *\n"
        "print(found_of(field_of(grid()), window(3.0, 4.0, 0.3, (0.3, 0, 0)), window(3.0, 4.0, 0.2)).tobytes().hex())"
    )
    one, other = (
        subprocess.run(
            [sys.executable, "-c", words],
            cwd=ROOT,
            env=os.environ | {"LIDARCLI_COMPILED": core},
            capture_output=True,
            check=True,
        ).stdout
        for core in ("yes", "no")
    )
    assert one == other != b""
