"""docs/cookbook.md: DuckDB, pandas and, where it is shown, polars give the answers of the page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd
import polars as pl
import pytest

from tests.places import ROOT
from tools import examples

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "cookbook.md").read_text(encoding="utf-8")
SECTIONS = {part.splitlines()[0]: part for part in PAGE.split("\n## ")[1:]}
QUESTIONS = [title for title, part in SECTIONS.items() if "```sql" in part and "COPY" not in part]
TASKS = re.findall(r"^\| [^|]+ \| `(lidarcli [^`]+)`", SECTIONS["Typical tasks"], re.MULTILINE)
Rows = list[tuple[Any, ...]]


def blocks(language: str, part: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", part, re.MULTILINE | re.DOTALL)


def shown(title: str) -> tuple[list[str], Rows]:
    """The names and rows of the answer that a section shows: the table after its last query."""
    lines = [line for line in SECTIONS[title].rpartition("```\n")[2].splitlines() if line.startswith("|")]
    names, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return names, [tuple(value(cell) for cell in row) for row in rows]


def value(cell: str) -> Any:
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return None if cell == "" else cell


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the commands of the page have run."""
    folder = tmp_path_factory.mktemp("cookbook")
    (folder / "samples").symlink_to(ROOT / "samples")
    done = list(examples.run(PAGE, folder))
    assert len(done) == 3
    for example in done:
        assert example.holds, f"$ {example.example.command}\n{example.got}"
    return folder


def by_python(library: str, part: str) -> dict[str, Any]:
    """The names that are set once the blocks of a library have run: first those that read the tables."""
    names: dict[str, Any] = {}
    for text in (SECTIONS["The tables to ask"], part):
        for block in blocks("python", text):
            if block.startswith(f"# {library}\n"):
                exec(block, names)
    return names


def written(names: list[str], rows: Rows) -> str:
    """An answer as the page shows it, for whoever has to renew it."""
    cells = [names, *[["" if cell is None else str(cell) for cell in row] for row in rows]]
    lines = ["| " + " | ".join(line) + " |" for line in cells]
    return "\n".join(["", lines[0], "|" + "---|" * len(names), *lines[1:]])


def plain(cell: Any) -> Any:
    """A cell without the type of its library: whole numbers are whole, missing ones None."""
    if cell is None or (isinstance(cell, float) and cell != cell):
        return None
    if isinstance(cell, str):
        return cell
    return int(cell) if float(cell) == int(cell) else round(float(cell), 6)


ANSWERED = [
    (title, by)
    for title in QUESTIONS
    for by in ("duckdb", "pandas", "polars")
    if by == "duckdb" or f"# {by}\n" in SECTIONS[title]
]


@pytest.mark.parametrize(("title", "by"), ANSWERED)
def test_an_answer(title: str, by: str, tables: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tables)
    part = SECTIONS[title]
    if by == "duckdb":
        (query,) = blocks("sql", part)
        relation = duckdb.sql(query)
        names, rows = relation.columns, relation.fetchall()
    else:
        answer = by_python(by, part)["answer"]
        assert isinstance(answer, pd.DataFrame if by == "pandas" else pl.DataFrame)
        names = list(answer.columns)
        rows = list(answer.itertuples(index=False)) if by == "pandas" else answer.rows()
    got = [tuple(plain(cell) for cell in row) for row in rows]
    assert (names, got) == shown(title), written(names, got)
    assert got


@pytest.mark.filterwarnings("default")  # of the libraries, about each other
@pytest.mark.parametrize("library", ["pedpy", "movingpandas", "trackeval"])
def test_paths_of_people_in_other_libraries(library: str, tables: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip(library)
    monkeypatch.chdir(tables)
    names: dict[str, Any] = {}
    for block in blocks("python", SECTIONS["People in PedPy, MovingPandas, TrackEval, evo"]):
        if not block.startswith("# ") or block.startswith(f"# {library}\n"):
            exec(block, names)
    if library == "trackeval":
        assert 0.3 < names["answer"] <= 1.0
    else:
        assert len(names["answer"]) == names["agents"].track.nunique()
        assert min(dict(names["answer"]).values()) > 0.0


def test_the_typical_tasks(tables: Path) -> None:
    assert len(TASKS) == 11
    before = {path.name for path in tables.iterdir()}
    done = list(examples.run("".join(f"```sh\n{command}\n```\n" for command in TASKS), tables))
    assert len(done) == len(TASKS)
    for one in done:
        assert one.holds, f"{one.example.command}{one.got}"
    assert {path.name for path in tables.iterdir()} - before == {
        "yard-1234.png",
        "yard-1200.png",
        "news",
        "differences.html",
        "runs.html",
        *("yard.shown.mcap", "yard.shown.layout.json", "yard.shown.rviz"),
        "part",
        "yard.csv",
        "night",
    }
    night = {path.name.removesuffix(".objects.parquet") for path in (tables / "night").glob("*.objects.parquet")}
    assert night == {"corridor", "drive", "hall", "people", "reflectors", "room", "room_empty"}
