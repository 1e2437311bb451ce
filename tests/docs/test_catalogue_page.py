"""docs/catalogue.md says what the code says: constants, keys, columns."""

from __future__ import annotations

import re

from lidarcli.pipeline.inputs import catalogue
from tests.docs.constants import constants
from tests.places import ROOT, SAMPLES

PAGE = (ROOT / "docs" / "catalogue.md").read_text(encoding="utf-8")
MODULES = ("matching.catalogue", "matching.evidence")


def test_every_constant_is_documented_with_its_value() -> None:
    rows = re.findall(r"^\| `(\w+\.\w+)` \| (-?[\d.]+) \|", PAGE, re.MULTILINE)
    assert {name: float(value) for name, value in rows} == {
        name: float(f"{value:.3g}") for name, value in constants(MODULES).items() if name not in NUMERICAL
    }


NUMERICAL = {"evidence.LEAST_LENGTH", "catalogue.LEAST_DENSITY"}
"""These keep numbers finite and arrays small, and decide nothing."""


def test_every_key_is_documented() -> None:
    keys = [key for group in catalogue.ALL_SIZES for key in group]
    for key in ("name", "shape", *keys, "tolerance", "moves", "intensity_min", "intensity_max"):
        assert re.search(rf"^\| .*`{key}`", PAGE, re.MULTILINE), key
    assert f"[m] ({catalogue.TOLERANCE})" in PAGE


def test_the_catalogues_of_the_page_are_those_of_the_samples() -> None:
    blocks = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    for block, scene in zip(blocks, ("room", "reflectors"), strict=True):
        sample = (SAMPLES / f"{scene}.catalogue.toml").read_text(encoding="utf-8")
        for thing in block.split("\n\n"):
            assert thing.strip() in sample
