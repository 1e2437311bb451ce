"""`make site`: it builds without a warning, leads to every page, and loads nothing from elsewhere."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import pytest

from tests.places import ROOT

pytestmark = pytest.mark.whole
for needed in ("sphinx", "furo", "myst_parser", "sphinx_copybutton"):
    pytest.importorskip(needed)

LOADED = {"script": "src", "img": "src", "link": "href", "source": "src", "iframe": "src", "video": "src", "object": "data"}
"""Elements for which a browser asks, and the attribute that says what for."""


class Element(NamedTuple):
    """An element of a page."""

    tag: str
    attributes: dict[str, str]


class Elements(HTMLParser):
    """All elements of a page."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.found: list[Element] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append(Element(tag, {name: value or "" for name, value in attrs}))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site."""
    folder = tmp_path_factory.mktemp("site")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    ((options,),) = [re.findall(r"-m sphinx (.+) -c docs \. build/site", makefile)]
    command = [sys.executable, "-m", "sphinx", *options.split(), "-c", "docs", ".", str(folder)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (built.returncode, built.stderr) == (0, "")
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, list[Element]]:
    return {page: Elements(page).found for page in sorted(site.rglob("*.html"))}


def is_elsewhere(address: str) -> bool:
    return re.match(r"(\w+:)?//", address.strip()) is not None


def test_the_build_is_strict() -> None:
    (line,) = re.findall(r"-m sphinx .*", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert {"-W", "--keep-going", "-n"} <= set(line.split())


def test_no_page_loads_anything_from_elsewhere(site: Path, pages: dict[Path, list[Element]]) -> None:
    loaded = [
        element.attributes[LOADED[element.tag]]
        for elements in pages.values()
        for element in elements
        if LOADED.get(element.tag) in element.attributes
    ]
    assert len(loaded) > 100
    assert [address for address in loaded if is_elsewhere(address)] == []
    sheets = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert len(sheets) >= 3
    for sheet in sheets:
        addresses = re.findall(r"(?:url\(|@import)\s*[\"']?([^\"')]+)", sheet)
        assert [address for address in addresses if is_elsewhere(address)] == []


def test_every_page_of_docs_is_in_the_navigation(site: Path, pages: dict[Path, list[Element]]) -> None:
    reached = {
        unquote(element.attributes["href"])
        for element in pages[site / "README.html"]
        if element.tag == "a" and "reference internal" in element.attributes.get("class", "")
    }
    wanted = {f"docs/{page.stem}.html" for page in (ROOT / "docs").glob("*.md")}
    assert len(wanted) > 20
    assert wanted - reached == set()
    assert {"samples/README.html", "CHANGELOG.html", "CONTRIBUTING.html"} <= reached


def inner_links(pages: dict[Path, list[Element]]) -> Iterator[tuple[Path, str, Path, str]]:
    """Every link to a page of the site: from where, as it is written, to which page, to which place there."""
    for page, elements in pages.items():
        for element in elements:
            address = unquote(element.attributes.get("href", ""))
            if element.tag != "a" or not address or is_elsewhere(address) or address.startswith("mailto:"):
                continue
            file, _, anchor = address.partition("#")
            yield page, address, (page.parent / file).resolve() if file else page.resolve(), anchor


def test_links_lead_to_pages_and_places_that_are_there(pages: dict[Path, list[Element]]) -> None:
    places = {
        page.resolve(): {element.attributes["id"] for element in elements if "id" in element.attributes}
        for page, elements in pages.items()
    }
    links = list(inner_links(pages))
    assert len(links) > 1000
    broken = [
        f"{page.name}: {address}"
        for page, address, target, anchor in links
        if not target.exists() or (target in places and anchor and anchor not in places[target])
    ]
    assert broken == []


def test_badges_are_left_out_and_pictures_stay() -> None:
    badge = runpy.run_path(str(ROOT / "docs" / "conf.py"))["BADGE"]
    line = (
        "[![ci](https://example.org/ci.svg)](https://example.org/ci) ![b](http://example.org/b.svg)![c](docs/images/c.png)"
    )
    assert badge.sub("", line) == " ![c](docs/images/c.png)"
