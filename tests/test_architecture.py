"""Imports run one way, and each library stays in its room (docs/architecture.md)."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import lidarcli

PACKAGE = Path(lidarcli.__file__).parent
SOURCES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))
MODULES = [path for path in SOURCES if path.name != "__main__.py"]

MAY_IMPORT = {
    "errors": "",
    "_version": "",
    "system": "",
    "options": "errors system",
    "display": "options system",
    "sweeps": "display errors options system",
    "ros": "sweeps system",
    "formalism": "display errors options sweeps system",
    "files": "display errors ros system",
    "logs": "display errors files options ros sweeps system",
    "tabular": "_version errors files formalism options sweeps system",
    "pose": "display errors formalism logs options ros sweeps",
    "copying": "errors logs options ros sweeps",
    "reports": "_version display errors formalism options sweeps tabular",
    "maps": "display errors files formalism options ros sweeps tabular",
    "overlays": "display errors formalism maps options ros sweeps tabular",
    "simulation": "_version errors files formalism maps options ros sweeps tabular",
    "pipeline": "_version copying display errors files formalism logs maps options overlays pose reports ros simulation "
    "sweeps system tabular",
    "cli": "_version display errors files logs options pipeline simulation sweeps system",
    "__main__": "cli system",
}
"""Room → the rooms that it imports from, no more and no fewer; what is imported for types alone does not count."""

ROOMS = {
    "pipeline": ("inputs", "reading", "objects", "runs"),
    "formalism": (
        "segmentation",
        "surfaces",
        "objects",
        "forest",
        "outline",
        "circle_fit",
        "features",
        "verdict",
        "description",
    ),
}
"""Rooms within rooms, each of which may import those before it; the files beside them may import all of them."""
SHARED = {"detection", "parameters"}
"""What the rooms of the formalism may import beside them."""

ROOMS_OF = {
    "click": {"cli"},
    "rich": {"reports", "display"},
    "matplotlib": {"reports"},
    "jinja2": {"reports"},
    "pandas": {"pipeline", "sweeps"},
    "mcap": {"logs", "simulation", "ros", "copying"},
    "rosbags": {"simulation", "ros", "copying"},
    "sqlite3": {"logs", "simulation", "copying"},
    "pyarrow": {"tabular", "pipeline", "logs", "simulation", "reports", "maps", "overlays", "files"},
    "distributed": {"pipeline"},
    "rerun": {"overlays"},
    "PIL": {"maps", "reports"},
    "ruamel": {"maps", "files"},
}


def room(path: Path) -> str:
    return path.parts[0].removesuffix(".py")


def module_name(path: Path) -> str:
    return ".".join(("lidarcli", *path.with_suffix("").parts)).removesuffix(".__init__")


@cache
def imported(path: Path, types: bool = True) -> set[str]:
    """Full names that a file imports, wherever it does so; without `types` not those for type checkers alone."""
    tree = ast.parse((PACKAGE / path).read_text(encoding="utf-8"))
    ifs = [node for node in ast.walk(tree) if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    unused = set() if types else {inner for node in ifs for inner in ast.walk(node)}
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import) and node not in unused:
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node not in unused:
            assert node.level == 0, f"{path}: relative import"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


NAMES = {module_name(path) for path in SOURCES} - {"lidarcli"}


def modules_in(names: set[str]) -> set[str]:
    """The modules of the package that hold what these names stand for."""
    return {name if name in NAMES else name.rpartition(".")[0] for name in names} & NAMES


def room_imports() -> dict[str, set[str]]:
    """Each room → those that it imports from; the names that the package itself offers are none."""
    rooms = {room(path): set[str]() for path in SOURCES if path.name != "__init__.py" or len(path.parts) > 1}
    for path in SOURCES:
        names = {name.split(".")[1] for name in imported(path, types=False) if name.startswith("lidarcli.")}
        rooms.get(room(path), set()).update(names - {room(path)})
    return rooms


LINES = {
    "cli": 3_092,
    "copying": 782,
    "display": 525,
    "files": 1_187,
    "formalism": 17_207,
    "logs": 12_075,
    "maps": 523,
    "options": 1_637,
    "overlays": 1_183,
    "pipeline": 19_410,
    "pose": 3_184,
    "reports": 7_981,
    "ros": 414,
    "simulation": 2_310,
    "sweeps": 2_028,
    "system": 475,
    "tabular": 2_043,
    "lidarcli": 157,
}
"""Most lines of Python of each room, and of the files beside them: lower them as code goes; who raises one says why."""
MAX_FILE_LINES = 600
MAX_FILES = 282
"""A file has one subject, so there are more of them than before; who adds one says why an existing one cannot hold it."""


def test_a_room_imports_what_the_list_says() -> None:
    found = {room: " ".join(sorted(others)) for room, others in room_imports().items()}
    assert found == {room: " ".join(sorted(others.split())) for room, others in MAY_IMPORT.items()}


def test_the_picture_of_the_rooms_shows_the_imports() -> None:
    """Each room of docs/architecture.md stands right above the highest of those that it imports from."""
    imports = room_imports()

    def floor(room: str) -> int:
        return 1 + max(map(floor, imports[room]), default=-1)

    floors: dict[int, set[str]] = {}
    for each in imports:
        floors.setdefault(floor(each), set()).add(each)
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text("utf-8")
    picture = page.partition("```text\n")[2].partition("```")[0].splitlines()
    assert [set(line.split()) for line in picture] == [floors[number] for number in sorted(floors, reverse=True)]


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Not even for types, nor within functions."""
    graph = {module_name(path): modules_in(imported(path)) for path in SOURCES}
    # A room of many files is imported with any of them, and holds nothing.
    while leaves := {name for name, others in graph.items() if not others & graph.keys()}:
        graph = {name: others for name, others in graph.items() if name not in leaves}
    while tops := graph.keys() - set().union(*graph.values()):
        graph = {name: others for name, others in graph.items() if name not in tops}
    assert sorted(graph) == []


def test_the_root_holds_rooms() -> None:
    loose = {path.name for path in PACKAGE.iterdir() if path.is_file() and path.suffix != ".pyc"}
    assert loose == {"__init__.py", "__main__.py", "_version.py", "errors.py", "py.typed"}


def test_no_file_is_long() -> None:
    lengths = {str(path): (PACKAGE / path).read_text("utf-8").count("\n") for path in SOURCES}
    assert {name: lines for name, lines in lengths.items() if lines > MAX_FILE_LINES} == {}


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
