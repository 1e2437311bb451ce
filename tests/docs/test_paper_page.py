"""docs/paper.md: its commands print what it says and make its pictures, and its numbers are those of today.

`python -m tests.docs.test_paper_page` writes the pictures anew.
"""

from __future__ import annotations

import io
import re
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import lidarcli
from tests.docs.running import run_page
from tests.places import ROOT, SAMPLES
from tools import examples

PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
IMAGES = ROOT / "docs" / "images" / "paper"
SHOWN = re.findall(r"!\[[^\]]+\]\(images/paper/([\w-]+\.png)\)", PAGE)
COLOURS = 256
"""The pictures of the page have no more, which makes them half as large."""
LIKENESS = 0.5
"""Mean difference of two pictures, of 255 levels, up to which they are the same; other sweeps differ by more."""
CHOSEN = {"min_beams": 2, "group_gap": 0.6}
"""The options of Fig. 8."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which every command of the page has run, and done what the page says."""
    path = tmp_path_factory.mktemp("paper")
    assert len(run_page("docs/paper.md", path)) >= 3
    return path


@pytest.fixture(scope="module")
def room() -> pd.DataFrame:
    """The objects of the five-object room, with the options of Fig. 8."""
    return lidarcli.detect(SAMPLES / "room.mcap", **CHOSEN).to_pandas()


def number(row: str) -> str:
    """What the table says we have."""
    (cells,) = re.findall(rf"^\| {re.escape(row)} \| (.*) \|$", PAGE, re.MULTILINE)
    return str(cells.replace(r"\|", "").split(" | ")[1])


def reduced(path: Path) -> bytes:
    """A picture as the page shows it: with fewer colours."""
    small = io.BytesIO()
    with Image.open(path) as image:
        image.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            small, "png", optimize=True
        )
    return small.getvalue()


def pixels(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB"), dtype=float)


@pytest.mark.whole
def test_the_commands_make_the_pictures(folder: Path) -> None:
    assert {path.name for path in folder.glob("*.png")} == set(SHOWN)
    for name in SHOWN:
        today, shown = pixels(reduced(folder / name)), pixels((IMAGES / name).read_bytes())
        assert today.shape == shown.shape, f"{name}: run `python -m tests.docs.test_paper_page`"
        assert np.abs(today - shown).mean() < LIKENESS, f"{name}: run `python -m tests.docs.test_paper_page`"


def test_five_objects(room: pd.DataFrame) -> None:
    """Fig. 8."""
    right = int((room.groupby("sweep").size() == 5).sum())
    assert number("objects, Fig. 8") == f"5 in {right} of 100 sweeps"
    paper = lidarcli.detect(SAMPLES / "room.mcap", profile="paper").num_rows
    assert number("the same by the mean of \\|s\\|").startswith(f"{paper / 100:.1f} on average")
    sweep = room[room["sweep"] == 50]
    vertices, legs = (sweep["vertices"].map(len).sum(), sweep.query("shape == 'legged'")["vertices"].map(len).sum())
    assert number("vertices, Fig. 8e") == f"{vertices} in sweep 50, {legs} of them of the ladder"


def test_categories(room: pd.DataFrame) -> None:
    """In the order of bearings: the smaller box, two boxes, the ladder, the plant."""
    shapes = room.groupby(room.groupby("sweep").cumcount())["shape"].value_counts().unstack(fill_value=0)
    assert number("boxes told as prismatic") == f"{shapes.loc[:2, 'prismatic'].sum()} of 300"
    assert number("ladder told as a ladder") == f"{shapes.loc[3, 'legged']} of 100 (`legged`)"
    plant = number("plant told as a plant")
    assert plant == f"{shapes.loc[4, 'irregular']} of 100 (`irregular`); by all sweeps right"


def main() -> None:
    """Write the pictures of the page."""
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "samples").symlink_to(SAMPLES)
        failed = [done.example.command for done in examples.run(PAGE, Path(name)) if not done.holds]
        for shown in SHOWN:
            (IMAGES / shown).write_bytes(reduced(Path(name) / shown))
    sys.exit("\n".join(["does not print what the page says:", *failed]) if failed else None)


if __name__ == "__main__":
    main()
