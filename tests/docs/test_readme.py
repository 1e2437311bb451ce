"""README.md: its commands run in its order where `make demo` has been, and draw its pictures, these for a narrow page.

`python -m tests.docs.test_readme` writes the pictures anew.
"""

from __future__ import annotations

import re
import tempfile
from contextlib import ExitStack
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from PIL import Image

from lidarcli.options.choices import Look
from lidarcli.reports import map_picture
from tests.docs.running import run_page
from tests.docs.test_paper_page import LIKENESS, reduced
from tests.docs.test_reports_page import frames
from tests.places import ROOT
from tools import examples

README = (ROOT / "README.md").read_text(encoding="utf-8")
IMAGES = ROOT / "docs" / "images" / "first"
NARROW, WIDE = 69, 106
"""[mm] 260 and 400 pixels of a page: text has nearly the size of that around it."""
LOOKS = {
    "near.png": f"--width {NARROW} --no-title --no-legend",
    "people.gif": f"--width {NARROW} --no-title --no-legend --sweeps 0:80:2",
    "changes.png": "",
    "lost.png": "",
    "office.png": f"--width {WIDE} --no-title",
}
"""Picture of a command → what the command gets beside its own options."""
ROWS = re.findall(r"^\| \*\*.*", README, re.MULTILINE)


@pytest.mark.slow
def test_the_commands_of_the_page_run_in_its_order(tmp_path: Path) -> None:
    told = {one.example.command: one.got for one in run_page("README.md", tmp_path)}
    assert len(told) >= 15
    files = [file for row in ROWS for file in re.findall(r" -o (\S+?)(?=[ `])", row)]
    assert len(files) == 6
    assert all((tmp_path / "demo" / file).stat().st_size for file in files)
    for row in ROWS:
        commands, answer = row.split(" | ")
        printed = " ".join(told[command] for command in examples.IN_ROW.findall(commands))
        numbers = re.findall(r"\d[\d.:]*\d|\d", answer)
        assert [number for number in numbers if not re.search(rf"\b{number}\b", f"{printed} 0")] == []


def test_the_page_is_short_and_every_question_has_a_command_and_an_answer() -> None:
    assert README.count("\n") <= 150
    assert len(ROWS) == 7
    assert all(re.fullmatch(r"\| \*\*[^|]+\?\*\* [^|]+<br>`lidarcli [^|]+` \| [^|]+ \|", row) for row in ROWS)
    shown = dict(re.findall(r'<img src="docs/images/first/([\w.]+)" width="(\d+)"', README))
    assert shown == dict.fromkeys(("near.png", "people.gif", "changes.png"), "260") | dict.fromkeys(
        ("office.png", "lost.png"), "400"
    )


def drawn(folder: Path) -> dict[str, Path]:
    """Draw the pictures of the page as wide as they are shown there; name → file."""
    home = examples.demo(folder)
    in_page = re.findall(r"`(lidarcli [^`]+)`|^\$ (lidarcli .+)", README, re.MULTILINE)
    draw, wide = map_picture.draw_map, Look(width=WIDE, title=False)
    with ExitStack() as stack:
        # `poses` and `diff` have no options for the size of their pictures.
        stack.enter_context(patch.object(map_picture, "draw_map", lambda one, suffix, look=wide: draw(one, suffix, look)))
        stack.enter_context(patch.object(map_picture, "PANEL", 2.0))
        stack.enter_context(patch.object(map_picture, "_change_entries", lambda _: {}))
        for line in map("".join, in_page):
            (name,) = [name for name in LOOKS if f" -o {name}" in line] or [""]
            if name or " track " in line:
                code, told = examples.outcome(f"{line} {LOOKS.get(name, '')}".strip(), home)
                assert code == 0, told
    for name in LOOKS:
        if name.endswith(".png"):
            (home / name).write_bytes(reduced(home / name))
    return {name: home / name for name in LOOKS}


@pytest.mark.whole
def test_the_commands_make_the_pictures(tmp_path: Path) -> None:
    for name, now in drawn(tmp_path).items():
        today, before = frames(now), frames(IMAGES / name)
        assert today.shape == before.shape, f"{name}: run `python -m tests.docs.test_readme`"
        assert np.abs(today - before).mean() < LIKENESS, f"{name}: run `python -m tests.docs.test_readme`"


def test_pictures_are_as_wide_as_twice_their_place() -> None:
    """Sharp on a fine screen, and no larger than that."""
    for name in LOOKS:
        with Image.open(IMAGES / name) as image:
            assert 320 <= image.width <= 850, name
        assert (IMAGES / name).stat().st_size < 300_000, name


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        for name, now in drawn(Path(folder)).items():
            (IMAGES / name).write_bytes(now.read_bytes())
