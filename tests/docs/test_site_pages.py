"""The pages for newcomers say what the project says elsewhere: versions, extras, figures, words of the tables."""

from __future__ import annotations

import re
import tomllib

import pytest

from lidarcli import __version__
from lidarcli.formalism.detection import SHAPES, VISIBILITIES
from tests.places import ROOT
from tools import reference


def page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


GLOSSARY = re.findall(r"^\| \*\*(.+?)\*\* \| (.*) \|$", page("glossary"), re.MULTILINE)
"""(word, the other cells) of each row."""
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_extras_that_can_be_installed_are_listed() -> None:
    table = page("install").split("## Extras")[1].split("\n## ")[0]
    listed = dict(re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", table, re.MULTILINE))
    assert set(listed) == set(PROJECT["optional-dependencies"])
    for extra in ("fleet", "rerun"):
        (requirement,) = PROJECT["optional-dependencies"][extra]
        assert re.split("[><=;]", requirement)[0] in listed[extra]


def test_the_least_python_is_that_of_the_package() -> None:
    (least,) = re.findall(r"It needs Python ([\d.]+) or newer", page("install"))
    assert PROJECT["requires-python"] == f">={least}"


def test_the_version_to_cite_is_this_one() -> None:
    assert re.findall(r"version = \{(.+)\}", page("citing")) == [__version__]


@pytest.mark.parametrize(
    ("source", "section", "row", "columns"),
    [
        ("accuracy", "## Objects", "robust", (0, 1)),
        ("accuracy", "## Objects", "fixed 0.3 m", (0, 1)),
        ("accuracy", "## Objects", "Dietmayer", (0, 1)),
        ("accuracy", "## Objects", "0.1 m + 0.00628 r", (0, 1)),
        ("accuracy", "## On real logs", "detect", (0, 1)),
        ("tracking", "## Rigid bodies", "lidarcli", (0,)),
        ("tracking", "## Rigid bodies", "leg_tracker rules", (0,)),
        ("tracking", "## Rigid bodies", "obstacle_detector rules", (0,)),
        ("tracking", "## Rigid bodies", "datmo rules", (0,)),
        ("tracking", "## Persons", "lidarcli", (0,)),
        ("tracking", "## Persons", "leg_tracker rules", (0,)),
        ("tracking", "## Persons", "obstacle_detector rules", (0,)),
        ("tracking", "## Persons", "datmo rules", (0,)),
    ],
)
def test_the_comparison_has_the_figures_of_the_pages_that_are_measured(
    source: str, section: str, row: str, columns: tuple[int, ...]
) -> None:
    text = page(source).split(f"{section}\n")[1].split("\n## ")[0]
    (cells,) = [
        [cell.strip() for cell in line.strip("|").split("|")][1:]
        for line in text.splitlines()
        if re.match(rf"\| \**{re.escape(row)}\** \|", line)
    ][:1]
    for column in columns:
        assert f" {cells[column]} " in page("comparison").replace(";", " ")


def test_the_glossary_knows_the_words_of_the_tables() -> None:
    shape, visibility = (dict(GLOSSARY)[word].split(" | ")[0] for word in ("shape", "visibility"))
    assert set(re.findall(r"`(\w+)`", shape)) == {*SHAPES} - {"wall"}
    assert set(re.findall(r"`(\w+)`", visibility)) == {*VISIBILITIES}


def test_the_glossary_has_the_numbers_of_the_definitions() -> None:
    assert set(re.findall(r"Def\. (\d)", page("glossary"))) == set("1234567")


def test_no_word_is_explained_twice() -> None:
    words = [word for word, _ in GLOSSARY]
    assert len(words) > 50
    assert len(set(words)) == len(words)


def test_the_columns_and_options_of_the_glossary_are_there() -> None:
    sections = re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page("tables"), re.MULTILINE | re.DOTALL)
    columns = {f"{table}.{name}" for table, text in sections for name in re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)}
    options = {name for _, name in reference.option_names()}
    named = {name for _, row in GLOSSARY for name in re.findall(r"`([^`]+)`", f"{row} | ".split(" | ")[1])}
    assert len(named) > 60
    assert named <= columns | options
