"""Imports run one way, and each library stays in its room (docs/architecture.md)."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import lidarcli

PACKAGE = Path(lidarcli.__file__).parent
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.name != "__main__.py")

GROUND = {"_version", "choices", "errors", "native"}
OPTIONS = {"option_forms", "options"}
CORE = GROUND | {"display", "findings", "masks", "palette", "range_rules", "sweeps", "times", "zone"}
MAY_IMPORT = {
    "errors": set[str](),
    "palette": {"choices"},
    "_version": set[str](),
    "choices": set[str](),
    "option_forms": {"choices", "errors"},
    "options": {"choices", "errors", "formalism", "range_rules", "option_forms", "times"},
    "interrupts": set[str](),
    "newfiles": {"errors", "machine", "ros", "stores"},
    "screen": {"display", "stores"},
    "stores": {"errors"},
    "foxglove": set[str](),
    "configfiles": {"display", "errors"},
    "compiled": set[str](),
    "machine": set[str](),
    "times": {"errors"},
    "native": set[str](),
    "ranges": {"native"},
    "display": set[str](),
    "findings": {"sweeps"},
    "sweeps": {"display"},
    "masks": {"errors", "sweeps"},
    "zone": {"masks", "sweeps"},
    "range_rules": {"errors", "masks", "ranges", "sweeps"},
    "logs": CORE | {"foxglove", "newfiles", "ros"},
    "pose": CORE | {"foxglove", "formalism", "logs", "ros"},
    "formalism": CORE,
    "tabular": CORE | {"formalism", "machine", "newfiles", "stores"},
    "ros": CORE,
    "simulation": CORE | {"formalism", "foxglove", "maps", "newfiles", "ros", "stores", "tabular", "configfiles"},
    "reports": CORE | {"formalism", "tabular"},
    "maps": CORE | {"configfiles", "formalism", "newfiles", "ros", "tabular"},
    "overlays": CORE | {"formalism", "maps", "ros", "tabular"},
    "copying": CORE | {"logs", "ros"},
    "mending": CORE | {"ros"},
    "pipeline": CORE
    | OPTIONS
    | {"logs", "pose", "formalism", "tabular", "reports", "maps", "overlays", "copying", "mending", "ros"}
    | {"simulation", "screen", "compiled", "interrupts", "machine", "newfiles", "stores", "configfiles"},
    "cli": CORE
    | OPTIONS
    | {
        "compiled",
        "interrupts",
        "logs",
        "machine",
        "newfiles",
        "formalism",
        "simulation",
        "pipeline",
        "screen",
        "stores",
        "configfiles",
    },
    "__init__": {"_version", "compiled", "errors", "formalism", "pipeline", "simulation", "sweeps"},
}
"""Room → the rooms below it that it may import."""

ROOMS = {
    "pipeline": ("inputs", "reading", "objects", "runs"),
    "formalism": ("segmentation", "surfaces", "objects", "forest", "features", "description"),
}
"""Rooms within rooms, each of which may import those before it; the files beside them may import all of them."""
SHARED = {"detection", "parameters"}
"""What the rooms of the formalism may import beside them."""

ROOMS_OF = {
    "click": {"cli"},
    "rich": {"reports", "screen"},
    "matplotlib": {"reports"},
    "jinja2": {"reports"},
    "pandas": {"pipeline", "sweeps"},
    "mcap": {"logs", "simulation", "ros", "copying"},
    "rosbags": {"simulation", "ros", "mending"},
    "sqlite3": {"logs", "simulation", "copying"},
    "pyarrow": {"tabular", "pipeline", "logs", "simulation", "reports", "maps", "overlays", "stores"},
    "distributed": {"pipeline"},
    "rerun": {"overlays"},
    "PIL": {"maps", "reports"},
    "ruamel": {"maps", "configfiles"},
}


def room(path: Path) -> str:
    return path.parts[0].removesuffix(".py")


@cache
def imported(path: Path) -> set[str]:
    """Full names of the modules that a file imports, wherever it does so."""
    names: set[str] = set()
    for node in ast.walk(ast.parse((PACKAGE / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


LINES = {
    "cli": 3_113,
    "formalism": 16_484,
    "logs": 11_578,
    "overlays": 1_157,
    "pipeline": 17_491,
    "pose": 3_032,
    "reports": 7_026,
    "ros": 315,
    "simulation": 2_340,
    "tabular": 1_990,
    "lidarcli": 6_785,
}
"""Most lines of Python of each room, and of the files beside them: lower them as code goes; who raises one says why."""
MAX_FILES = 196
"""One more for the sensors of a robot (`robots`), one for what merges them (`merging`)."""


def test_imports_run_one_way() -> None:
    wrong = []
    for path in MODULES:
        here, names = room(path), imported(path)
        own = {name.split(".")[1] for name in names if name.startswith("lidarcli.")} - {here}
        wrong += [f"{path} may not import {name}" for name in sorted(own - MAY_IMPORT.get(here, CORE))]
    assert wrong == []


def test_libraries_stay_in_their_rooms() -> None:
    wrong = []
    for path in MODULES:
        libraries = {name.split(".")[0] for name in imported(path)} & set(ROOMS_OF)
        wrong += [
            f"{path} may not import {name}, which belongs to {ROOMS_OF[name]}"
            for name in sorted(libraries)
            if room(path) not in ROOMS_OF[name]
        ]
    assert wrong == []


def test_inner_rooms_stand_on_each_other() -> None:
    wrong = []
    for outer, names in ROOMS.items():
        for number, name in enumerate(names):
            below = {*names[: number + 1], *SHARED}
            mine = [path for path in MODULES if path.parts[:2] in ((outer, name), (outer, f"{name}.py"))]
            assert mine, f"there is no room {outer}/{name}"
            for path in mine:
                own = {full.split(".")[2] for full in imported(path) if full.startswith(f"lidarcli.{outer}.")}
                wrong += [f"{path} may not import {outer}.{other}" for other in sorted(own - below)]
    assert wrong == []


def test_formalism_imports_numpy_alone() -> None:
    names = {name.split(".")[0] for path in MODULES if room(path) == "formalism" for name in imported(path)}
    standard = {
        "__future__",
        "array",
        "collections",
        "dataclasses",
        "enum",
        "functools",
        "itertools",
        "math",
        "os",
        "sys",
        "threading",
        "typing",
    }
    assert names - standard <= {"numpy", "lidarcli"}


def test_no_file_of_a_killed_run_stays_in_the_temporary_folder() -> None:
    """What has a name there stands in a `scratch_folder`, which the next run clears away."""
    named = re.compile(r"\b(?:TemporaryDirectory|NamedTemporaryFile|mkdtemp|mkstemp)\(([^)]*)\)")
    found = {
        (str(path), words)
        for path in MODULES
        for words in named.findall((PACKAGE / path).read_text("utf-8"))
        if "dir=" not in words
    }
    assert found == set()


def test_rooms_keep_to_their_budget() -> None:
    lines = dict.fromkeys(LINES, 0)
    for path in MODULES:
        lines[path.parts[0] if len(path.parts) > 1 else "lidarcli"] += (PACKAGE / path).read_text("utf-8").count("\n")
    over = [
        f"{room} has {count:,} lines, {count - LINES[room]} too many"
        for room, count in lines.items()
        if count > LINES[room]
    ]
    assert over == [], "look first for what can go; who raises a budget in LINES says why in the commit"
    assert len(MODULES) <= MAX_FILES
