"""The commands of docs/reports.md do what the page says, and draw its pictures.

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

PAGE = (ROOT / "docs" / "reports.md").read_text(encoding="utf-8")
IMAGES = ROOT / "docs" / "images" / "plot"
SHOWN = re.findall(r"!\[[^\]]+\]\(images/plot/([\w-]+\.(?:png|gif))\)", PAGE)
MOST_BYTES = 400_000


def reduce_pictures(folder: Path) -> None:
    """Reduce the PNG files that the page shows to the colours that it shows them with."""
    for name in SHOWN:
        if name.endswith(".png"):
            (folder / name).write_bytes(reduced(folder / name))


def frames(path: Path) -> np.ndarray:
    """(N, H, W, 3) some frames of a picture."""
    with Image.open(path) as image:
        found = []
        for number in range(0, getattr(image, "n_frames", 1), 10):
            image.seek(number)
            found.append(np.asarray(image.convert("RGB"), dtype=float))
    return np.array(found)


def test_every_picture_is_there_and_small() -> None:
    assert sorted(SHOWN) == ["corridor.png", "people.gif", "people.png"]
    assert sorted(path.name for path in IMAGES.iterdir()) == sorted(SHOWN)
    assert max((IMAGES / name).stat().st_size for name in SHOWN) < MOST_BYTES


@pytest.mark.whole
def test_the_commands_do_what_they_say_and_make_the_pictures(tmp_path: Path) -> None:
    assert run_page("docs/reports.md", tmp_path) >= 3
    reduce_pictures(tmp_path)
    for name in SHOWN:
        today, shown = frames(tmp_path / name), frames(IMAGES / name)
        assert today.shape == shown.shape, f"{name}: run `python -m tests.docs.test_reports_page`"
        assert np.abs(today - shown).mean() < LIKENESS, f"{name}: run `python -m tests.docs.test_reports_page`"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        run_page("docs/reports.md", Path(name))
        reduce_pictures(Path(name))
        IMAGES.mkdir(exist_ok=True)
        for shown in SHOWN:
            (IMAGES / shown).write_bytes((Path(name) / shown).read_bytes())
