"""docs/formalism.md says what the code says: functions, defaults and constants."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from functools import reduce

import lidarcli
from lidarcli.formalism import Parameters, definitions
from tests.places import ROOT

PAGE = (ROOT / "docs" / "formalism.md").read_text(encoding="utf-8")
DERIVED = {
    "COS_SQUARE",
    "SIN_TWICE",
    "SIN_CORNER_TURN",
    "SIN_BLUNT",
    "TO_SIGMA",
    "RIGHT_ANGLE",
    "QUARTER_TURN",
    "TURN",
    "ORIGIN_CELLS",
}
"""Functions of other constants."""


def section(title: str) -> str:
    """The text under a heading, up to the next one."""
    match = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert match is not None, title
    return match.group(1)


def table(title: str) -> list[list[str]]:
    """The cells of the table in a section, without its head."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[2:]]


def test_every_constant_is_explained() -> None:
    """The site lists them as the source explains them; whole numbers without a docstring are codes."""
    program = "import json; from tools.constants import constants as found; print(json.dumps(found()))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env=os.environ | {"LIDARCLI_COMPILED": "no"},
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [row for rows in json.loads(done.stdout).values() for row in rows]
    unsaid = {name.strip("`") for names, value, words in rows if "." in value and not words for name in names.split(", ")}
    assert unsaid <= DERIVED
    assert ["`NOISE_GAIN`", "3.5"] in [row[:2] for row in rows]
    assert len(rows) > 200


def test_every_parameter_is_documented_with_its_defaults() -> None:
    spell = {"inf": "no limit", "False": "off", "`adaptive`": "`adaptive`", "0.0": "0"}
    documented = [(row[0].strip("`"), row[3], row[4]) for row in table("Parameters")]
    expected = []
    for field in fields(Parameters):
        if field.name == "profile":
            continue
        values = [getattr(Parameters.for_profile(profile), field.name) for profile in ("robust", "paper")]
        text = [f"`{value}`" if isinstance(value, str) else str(value) for value in values]
        expected.append((field.name, *(spell.get(value, value) for value in text)))
    assert documented == expected


def test_every_function_of_the_definitions_can_be_called() -> None:
    """And every attribute is there, of the package that everybody imports."""
    rows = table("Definitions and functions")
    named = [name for row in rows for name in re.findall(r"`([A-Za-z_.]+)(?:\(.*\))?`", row[2])]
    assert len(named) >= len(rows) > 15
    for name in named:
        assert reduce(getattr, name.split("."), lidarcli) is not None, name
    assert {*definitions.__all__} <= {*named}


def test_the_files_of_the_steps_are_there() -> None:
    home = ROOT / "lidarcli" / "formalism"
    steps = section("Definitions and functions").split("Behind them")[1]
    over_time = re.findall(r"`(?:tracking/)?(\w+)`", section("Steps over time"))
    files = [*(home / name for name in re.findall(r"`(\w+)`", steps)), *(home / "tracking" / name for name in over_time)]
    assert len(files) > 14
    assert [path for path in files if not path.with_suffix(".py").exists()] == []


def test_the_links_within_the_page_lead_somewhere() -> None:
    anchors = {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-")
        for heading in re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    }
    links = set(re.findall(r"\]\(#([^)]+)\)", PAGE))
    assert len(links) >= 6
    assert links <= anchors
