"""docs/map.md says what the code says: constants, suffixes, defaults."""

from __future__ import annotations

import re
from pathlib import Path

from lidarcli import choices
from lidarcli.formalism.mapping import grid
from lidarcli.maps import FREE_THRESHOLD, OCCUPIED_THRESHOLD
from lidarcli.pipeline import mapping
from tests.docs.constants import constants
from tests.places import ROOT

PAGE = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
MODULES = ("mapping.grid",)
CODES = {f"grid.{name}" for name in ("UNKNOWN", "FREE", "OCCUPIED", "SKIPPED", "HIT", "CLEAR")}
"""What a cell may be, and what a beam tells of cells."""


def test_every_constant_is_named_with_its_value() -> None:
    rows = re.findall(r"^\| `(\w+\.[A-Z_]+[A-Z0-9_]*)` \| ([^|]+) \|", PAGE, re.MULTILINE)
    told = {name: float(value) for name, value in rows}
    here = {name: value for name, value in constants(MODULES).items() if name not in CODES}
    assert told.keys() == here.keys()
    assert {name: round(value, 4) for name, value in told.items()} == {
        name: round(value, 4) for name, value in here.items()
    }
    assert grid.MAP_MARGIN == grid.TOLERANCE == 1
    assert grid.PAUSE_NS == 5e9


def test_every_suffix_is_told() -> None:
    told = set(re.findall(r"`(\.\w+)`", "".join(re.findall(r"^\| (`\.[^|]*) \|", PAGE, re.MULTILINE))))
    assert told == {*mapping.GRIDS, *mapping.WRITERS}
    assert {Path(f"x{suffix}").suffix for suffix in told} == told


def test_the_defaults_are_told() -> None:
    assert f"`--resolution` metres ({choices.MAP_RESOLUTION})" in PAGE
    assert f"`--min-hits` sweeps hit it ({mapping.MIN_HITS})" in PAGE
    assert f"`--occupied-ratio` ({choices.OCCUPIED_RATIO})" in PAGE
    assert f"each {choices.MIN_MOVE} m of the way" in PAGE
    assert f"a cell needs {mapping.MIN_HITS_OF_ALL} hits by default" in PAGE
    assert f"`--max-size` km² ({choices.MAX_MAP_KM2})" in PAGE
    assert f"thresholds {OCCUPIED_THRESHOLD} and {FREE_THRESHOLD}" in PAGE
    # 12 bytes a cell while counting, and one of the grid.
    per_km2 = (grid.CELL_BYTES + 1) * 1e6 / choices.MAP_RESOLUTION**2 / 1e9
    assert f"{per_km2:.1f} GB for a km²" in PAGE
