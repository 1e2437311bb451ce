"""`make site`: it builds without a warning, leads to every page, and loads nothing from elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import lidarcli
from tests.places import ROOT
from tools import reference

pytestmark = pytest.mark.whole
for needed in ("sphinx", "furo", "myst_parser", "sphinx_copybutton"):
    pytest.importorskip(needed)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, str]:
    """The pages and style sheets of the built site."""
    folder = tmp_path_factory.mktemp("site")
    (options,) = re.findall(r"-m sphinx (.+) -c docs build/pages", (ROOT / "Makefile").read_text(encoding="utf-8"))
    # Broken links and references are warnings, which are errors.
    assert {"-W", "--keep-going", "-n"} <= set(options.split())
    source = folder.parent / "pages"
    for command in (["tools.site", str(source)], ["sphinx", *options.split(), "-c", "docs", str(source), str(folder)]):
        built = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=ROOT,
            env=os.environ | {"LIDARCLI_COMPILED": "no"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (built.returncode, built.stderr) == (0, "")
    found = [path for path in sorted(folder.rglob("*")) if path.suffix in (".html", ".css")]
    return {path.relative_to(folder): path.read_text(encoding="utf-8") for path in found}


def test_no_page_loads_anything_from_elsewhere(pages: dict[Path, str]) -> None:
    elements = re.compile(r'<(?:script|img|link|source|iframe|video|object)\b[^>]*?(?:src|href|data)="([^"]*)"')
    sheets = re.compile(r"(?:url\(|@import)\s*[\"']?([^\"')]+)")
    loaded = [
        address for path, text in pages.items() for address in (sheets if path.suffix == ".css" else elements).findall(text)
    ]
    assert len(loaded) > 100
    assert [address for address in loaded if re.match(r"(\w+:)?//", address.strip())] == []


def test_every_page_of_docs_is_in_the_navigation(pages: dict[Path, str]) -> None:
    reached = set(re.findall(r'<a class="reference internal" href="([^"#]+)"', pages[Path("index.html")]))
    wanted = {f"docs/{page.stem}.html" for page in (ROOT / "docs").glob("*.md")}
    assert wanted | {"samples/README.html", "CHANGELOG.html", "CONTRIBUTING.html"} <= reached


def test_every_public_name_and_every_command_can_be_linked_to(pages: dict[Path, str]) -> None:
    public = {
        name for name in lidarcli.__all__ if callable(getattr(lidarcli, name)) or isinstance(getattr(lidarcli, name), type)
    }
    assert public <= set(re.findall(r'id="lidarcli\.(\w+)"', pages[Path("docs/reference.html")]))
    for name, _ in reference.commands():
        assert f"<h1>lidarcli {name}" in pages[Path(f"docs/commands/{reference.page_of(name)}").with_suffix(".html")]
