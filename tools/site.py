"""The source of the site (`make site`): the pages of the repository, and those that are made of the code.

`python -m tools.site FOLDER` fills the folder with copies of the files of the repository and with the generated pages.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import lidarcli
from tools.constants import constants_page
from tools.reference import as_page, command_page, commands, page_of, truth_page

ROOT = Path(__file__).parent.parent
COPIED = ("CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "SECURITY.md", "action.yml")
KINDS = {"Functions": "autofunction", "Classes": "autoclass", "Errors": "autoexception"}
"""Heading of the page of the functions → its directive of Sphinx."""


def reference_page() -> str:
    """docs/reference.md of the site: the public names of the package, written by Sphinx from their docstrings."""
    kinds: dict[str, list[str]] = {heading: [] for heading in KINDS}
    for name in sorted(lidarcli.__all__, key=str.lower):
        public = getattr(lidarcli, name)
        if isinstance(public, type):
            kinds["Errors" if issubclass(public, BaseException) else "Classes"].append(name)
        elif callable(public):
            kinds["Functions"].append(name)
    lines = ["# Python functions", "", "[Python](python.md) shows them at work.", ""]
    for heading, names in kinds.items():
        lines += [f"## {heading}", "", "```{eval-rst}"]
        lines += [f".. {KINDS[heading]}:: lidarcli.{name}\n" for name in names] + ["```", ""]
    return as_page(lines)


PAGES: dict[str, Callable[[], str]] = {
    "docs/constants.md": constants_page,
    "docs/reference.md": reference_page,
    "docs/truth.md": truth_page,
    **{f"docs/commands/{page_of(name)}": partial(command_page, name, command) for name, command in commands()},
}


def assemble(folder: Path) -> None:
    """Fill `folder`, which is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("docs", "samples"):
        shutil.copytree(ROOT / name, folder / name)
    for name in COPIED:
        shutil.copy(ROOT / name, folder / name)
    shutil.copy(ROOT / "README.md", folder / "index.md")
    (folder / "docs" / "commands").mkdir()
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
