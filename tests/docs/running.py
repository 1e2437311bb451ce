"""Runs the examples of a page, for the tests of that page."""

from __future__ import annotations

from pathlib import Path

from tests.places import ROOT
from tools import examples


def run_page(page: str, folder: Path) -> list[examples.Done]:
    """Run all examples of a page in a folder, and return them.

    Raises
    ------
    AssertionError
        An example fails, or prints what the page does not say.
    """
    if page == "README.md":
        folder = examples.demo(folder)
    else:
        (folder / "samples").symlink_to(ROOT / "samples")
    done = list(examples.run((ROOT / page).read_text(encoding="utf-8"), folder))
    for one in done:
        assert one.holds, f"$ {one.example.command}\n{one.got}\nexit code {one.code}"
    return done
