"""The commands of docs/zones.md, docs/reports.md and docs/diff.md do what the pages say, and draw their pictures.

`python -m tests.docs.test_reports_page` writes them anew.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.docs.running import run_page
from tests.docs.test_paper_page import LIKENESS, reduced
from tests.places import ROOT

SHOWN = {
    "docs/zones.md": ["images/zones.png"],
    "docs/reports.md": re.findall(
        r"\((images/plot/[\w-]+\.(?:png|gif))\)", (ROOT / "docs" / "reports.md").read_text(encoding="utf-8")
    ),
    "docs/diff.md": ["images/diff.png"],
}
"""Page → its pictures."""
MADE = {"images/diff.png": "changes.png", "images/zones.png": "near.png"}
"""Picture → its name in the commands, where that is another."""


def drawn(page: str, folder: Path) -> dict[Path, Path]:
    """Run the commands of a page; picture of the page → the one that was drawn now, with the colours of the page."""
    run_page(page, folder)
    found = {ROOT / "docs" / name: folder / MADE.get(name, Path(name).name) for name in SHOWN[page]}
    for path in found.values():
        if path.suffix == ".png":
            path.write_bytes(reduced(path))
    return found


def frames(path: Path) -> np.ndarray:
    """(N, H, W, 3) some frames of a picture."""
    with Image.open(path) as image:
        found = []
        for number in range(0, getattr(image, "n_frames", 1), 10):
            image.seek(number)
            found.append(np.asarray(image.convert("RGB"), dtype=float))
    return np.array(found)


@pytest.mark.whole
@pytest.mark.parametrize("page", SHOWN)
def test_the_commands_make_the_pictures(page: str, tmp_path: Path) -> None:
    for shown, now in drawn(page, tmp_path).items():
        today, before = frames(now), frames(shown)
        assert today.shape == before.shape, f"{shown.name}: run `python -m tests.docs.test_reports_page`"
        assert np.abs(today - before).mean() < LIKENESS, f"{shown.name}: run `python -m tests.docs.test_reports_page`"


if __name__ == "__main__":
    for each in SHOWN:
        with tempfile.TemporaryDirectory() as name:
            for shown, now in drawn(each, Path(name)).items():
                shown.write_bytes(now.read_bytes())
