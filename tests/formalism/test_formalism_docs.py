"""docs/formalism.md says what the code says: functions, defaults and constants."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import lidarcli
from lidarcli import formalism
from lidarcli.formalism import Detection, Parameters
from lidarcli.sweeps import SweepBatch
from tests.places import ROOT

PAGE = (ROOT / "docs" / "formalism.md").read_text(encoding="utf-8")
DERIVED = re.compile(
    r"(?!measurement)\w+\.((SIN|COS|TAN)_\w+|ROOT_2|\w*TO_SIGMA|SECOND_DIFFERENCE_GAIN|NAN|INFINITY|TINY)"
    r"|segmentation\.(SINGLE_\w+|GUESS_\w+|FEW_VALUES|INFINITE)|kalman\.QUARTER_TURN|(tracks|features)\.RIGHT_ANGLE|smoothing\.LIVELINESSES"
)
"""Functions of other constants, factors of the normal distribution, and what only saves time."""
CODES = {"native", "forest"}
"""Modules whose numbers are the layout of arrays, or trees that a script has grown, not constants of the method."""
MARKS = {
    "detect": {"OBJECTS_AT_FIRST", "VERTICES_AT_FIRST", "MOST_KEPT"},
    "segmentation": {"NEVER"},
    "keyframes": {"NO_RETURN"},
    "measurement": {"HIDDEN", "OPEN", "OWN", "NO_RANGE", "FREE_RANGE", "MOST_RANGE", "AT_LEAST"},
    "kalman": {"DELAY", "AHEAD", "LEFT"},
    "scan_matching": {"COLUMNS", "TURN"},
    "smoothing": {"STATE", "SQUARE", "GAIN", "KEPT"},
    "tracks": {"PARTS_MASK", "PARTLY_BIT", "MOST_ROWS"},
}
"""Codes of modules that have constants, too."""
BACKGROUND = {"background", "learning", "subtraction"}
"""The subtraction of a background has a page of its own, docs/background.md."""
MAPS = {path.stem for path in (Path(formalism.__file__).parent / "mapping").glob("*.py")}
"""So have maps, docs/map.md."""
THINGS = {"catalogue", "ground", "alignment", "differences"}
"""And things of interest and what changed, docs/catalogue.md and docs/diff.md."""
PATHS = {"path_agreement", "localisation"}
"""And the path of the sensor, docs/poses.md."""


def section(title: str) -> str:
    """The text under a heading, up to the next one."""
    match = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert match is not None, title
    return match.group(1)


def table(title: str) -> list[list[str]]:
    """The cells of the table in a section, without its head."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[2:]]


def sources() -> dict[str, Path]:
    """The files of the formalism by the name of their module; a compiled module tells too little of itself.

    Of two files of one name the one in the deeper folder has the name of that before its own.
    """
    found: dict[str, Path] = {}
    for path in sorted(Path(formalism.__file__).parent.rglob("*.py"), key=lambda path: len(path.parts)):
        if path.stem != "__init__":
            found[f"{path.parent.name}.{path.stem}" if path.stem in found else path.stem] = path
    return found


def is_copied(value: ast.expr | None) -> bool:
    """Whether a value is that of another module, or one of a row of codes."""
    if isinstance(value, ast.Tuple):
        return all(is_copied(each) for each in value.elts)
    if isinstance(value, ast.Call):
        return isinstance(value.func, ast.Name) and value.func.id == "range"
    return isinstance(value, ast.Attribute)


def assigned(path: Path) -> set[str]:
    """The names in capitals that a file assigns itself."""
    return {
        node.id
        for statement in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(statement, ast.Assign | ast.AnnAssign) and not is_copied(statement.value)
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id.isupper()
    }


def numbers(value: object) -> list[float]:
    """A number, or all that are in a table; nothing of anything else."""
    if isinstance(value, list):
        return [each for part in value for each in numbers(part)]
    return [float(value)] if isinstance(value, int | float) else []


def constants() -> dict[str, list[float]]:
    """Every number that a module of the formalism names in capitals, asked of the source; those of a table in a row."""
    codes = assigned(sources()["detection"]) - {"MOST_INTENSITY"}
    names = {
        name: sorted(assigned(path) - codes - MARKS.get(name, set()))
        for name, path in sources().items()
        if name not in CODES | BACKGROUND | THINGS | MAPS | PATHS
    }
    wanted = [(module_of(sources()[name]), name, list(values)) for name, values in names.items() if values]
    program = (
        "import importlib, json\n"
        f"for module, name, values in {wanted!r}:\n"
        "    found = importlib.import_module(module)\n"
        "    for value in values:\n"
        "        print(json.dumps([f'{name}.{value}', getattr(found, value)], default=str))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"LIDARCLI_COMPILED": "no"},
        capture_output=True,
        text=True,
        check=True,
    )
    pairs = [json.loads(line) for line in done.stdout.splitlines()]
    return {name: found for name, value in pairs if (found := numbers(value))}


def module_of(path: Path) -> str:
    """The full name of the module in a file."""
    return ".".join(("lidarcli", *path.relative_to(Path(lidarcli.__file__).parent).with_suffix("").parts))


def test_every_constant_is_documented_with_its_value() -> None:
    titles = ("Constants", "Constants of tracking", "Constants of scan matching", "Constants of zones")
    rows = [row for title in titles for row in table(title)]
    documented = {row[0].strip("`"): [float(value) for value in row[1].split(",")] for row in rows}
    assert len(documented) == len(rows)
    assert documented == {name: value for name, value in constants().items() if not DERIVED.fullmatch(name)}


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


def test_every_function_of_the_definitions_exists() -> None:
    known = {
        name: {node.name for node in ast.parse(path.read_text(encoding="utf-8")).body if hasattr(node, "name")}
        for name, path in sources().items()
    }
    for row in [*table("Definitions and functions"), *table("Steps over time")]:
        named = re.findall(r"`([A-Za-z_.]+)`", row[2])
        assert named, row
        for name in named:
            if name.startswith("SweepBatch."):
                assert hasattr(SweepBatch, name.partition(".")[2]), name
            elif "." not in name or name.startswith("Detection."):
                assert name.rpartition(".")[2] in {field.name for field in fields(Detection)}, name
            else:
                module, _, attribute = name.partition(".")
                assert attribute in known[module], name


def test_the_links_within_the_page_lead_somewhere() -> None:
    anchors = {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-")
        for heading in re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    }
    links = set(re.findall(r"\]\(#([^)]+)\)", PAGE))
    assert len(links) >= 6
    assert links <= anchors
