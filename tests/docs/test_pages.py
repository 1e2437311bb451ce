"""Pages of docs/ say what the code says: columns, keys, words, suffixes, extras."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from lidarcli import __version__
from lidarcli.formalism.detection import SHAPES, VISIBILITIES
from lidarcli.formalism.tracking.results import ENDS
from lidarcli.options import choices
from lidarcli.overlays import objects, viewers
from lidarcli.overlays.markers import Kind
from lidarcli.pipeline import mapping
from lidarcli.pipeline.inputs import catalogue
from lidarcli.reports import figures
from lidarcli.tabular import SCHEMAS
from tests.pipeline.test_following import CHANGED
from tests.places import REAL_LOGS, ROOT, SAMPLES, needs_real_logs
from tools import examples, reference

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


GLOSSARY = re.findall(r"^\| \*\*(.+?)\*\* \| (.*) \|$", page("glossary"), re.MULTILINE)
"""(word, the other cells) of each row."""


def test_words_and_columns_are_those_of_the_code() -> None:
    assert all(f"\n| {word} | " in page("diff") for word in (*choices.CHANGE_STATUSES, *choices.CHANGE_WHYS))
    assert all(f"(`{end}`)" in page("track") for end in ENDS)
    rows = re.findall(r"^\| (\w+)[^|]* \| (`.*`) \|$", page("track"), re.MULTILINE)
    changed = {table: set(re.findall(r"`(\w+)`", columns)) for table, columns in rows}
    assert changed == CHANGED
    assert all(columns <= {*SCHEMAS[table].names} for table, columns in changed.items())
    for name, kinds in (figures.CATEGORIES | figures.TRACK_CATEGORIES).items():
        assert all(f"`{name}.{kind}`" in page("reports") for kind in kinds)
    for key in ("name", "shape", *(key for group in catalogue.ALL_SIZES for key in group), "tolerance", "moves"):
        assert re.search(rf"^\| .*`{key}`", page("catalogue"), re.MULTILINE), key


def test_files_and_defaults_are_those_of_the_code() -> None:
    suffixes = re.findall(r"`(\.\w+)`", "".join(re.findall(r"^\| (`\.[^|]*) \|", page("map"), re.MULTILINE)))
    assert {*suffixes} == {*mapping.GRIDS, *mapping.WRITERS}
    assert f"`--resolution` metres ({choices.MAP_RESOLUTION})" in page("map")
    assert f"`--occupied-ratio` ({choices.OCCUPIED_RATIO})" in page("map")
    assert f"{objects.HEIGHT} m high" in page("overlay")
    for name in (viewers.OBJECTS, viewers.MAP, *viewers.SUFFIXES):
        assert f"`{name}`" in page("overlay") or f"`{name}/" in page("overlay")
    assert {*dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", page("overlay"), re.MULTILINE))} == {
        kind.value[1].decode() for kind in Kind
    }


def test_the_catalogues_of_the_page_are_those_of_the_samples() -> None:
    blocks = re.findall(r"^```toml\n(.*?)^```$", page("catalogue"), re.MULTILINE | re.DOTALL)
    for block, scene in zip(blocks, ("room", "reflectors"), strict=True):
        sample = (SAMPLES / f"{scene}.catalogue.toml").read_text(encoding="utf-8")
        assert all(thing.strip() in sample for thing in block.split("\n\n"))


def test_what_is_installed_is_that_of_the_project() -> None:
    table = page("install").split("## Extras")[1].split("\n## ")[0]
    assert {*re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)} == {*PROJECT["optional-dependencies"]}
    assert [f">={least}" for least in re.findall(r"It needs Python ([\d.]+) or newer", page("install"))] == [
        PROJECT["requires-python"]
    ]
    assert re.findall(r"version = \{(.+)\}", page("citing")) == [__version__]


def test_the_glossary_knows_the_words_of_the_tables() -> None:
    words = dict(GLOSSARY)
    assert len(words) == len(GLOSSARY) > 50
    shape, visibility = (words[word].split(" | ")[0] for word in ("shape", "visibility"))
    assert {*re.findall(r"`(\w+)`", shape)} == {*SHAPES} - {"wall"}
    assert {*re.findall(r"`(\w+)`", visibility)} == {*VISIBILITIES}
    sections = re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page("tables"), re.MULTILINE | re.DOTALL)
    columns = {f"{table}.{name}" for table, text in sections for name in re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)}
    named = {name for _, row in GLOSSARY for name in re.findall(r"`([^`]+)`", f"{row} | ".split(" | ")[1])}
    assert named <= columns | {name for _, name in reference.option_names()}


def test_the_figures_of_the_readme_are_those_of_the_pages() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## How good it is\n")[1].split("\n## ")[0]
    section = " ".join(readme.split())
    real = page("accuracy").split("<!-- real recordings: begin -->")[1]
    for method, pattern in (
        ("detect", r"a recall of (\d+) % and a precision of (\d+) %"),
        ("track", r"has (\d+) % and (\d+) %"),
    ):
        ((precision, recall),) = re.findall(
            rf"^\| \**{method}\** \| (0\.\d{{3}}) \([^|]*\) \| (0\.\d{{3}}) \(", real, re.MULTILINE
        )
        ((*told,),) = re.findall(rf"`{method}`, .*?{pattern}", section)[:1]
        assert [float(each) for each in told] == pytest.approx([100 * float(recall), 100 * float(precision)], abs=0.56)
    moves = page("tracking").split("### Logs that nobody tuned on")[1].split("\n### ")[0]
    for group, pattern in (
        ("all", r"(\d+) % of the rows move and (\d+) % of the tracks; it says so of (\d+) %"),
        ("parked", r"parked these are (\d+) %, (\d+) % and (\d+) %"),
    ):
        rows, movers, tracks = re.findall(rf"^\| \*\*{group}\*\* \|(.*)", moves, re.MULTILINE)[0].split("|")[:3]
        measured = [float(re.findall(r": ([\d.]+) %", cell)[0]) for cell in (rows, tracks, movers)]
        assert [float(each) for each in re.findall(pattern, section)[0]] == pytest.approx(measured, abs=0.56)


@needs_real_logs
@pytest.mark.slow
def test_the_zones_of_a_public_recording(tmp_path: Path) -> None:
    text = page("zones").replace("```console", "```py").replace("```sh", "```py").replace("```text\n$", "```console\n$")
    (tmp_path / "test-bag").symlink_to(REAL_LOGS / "comprobo24" / "test-bag")
    done = list(examples.run(text, tmp_path))
    assert len(done) == 3
    assert [one.got for one in done if not one.holds] == []


@pytest.mark.slow
def test_the_examples_of_python_print_what_the_page_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import doctest

    (tmp_path / "samples").symlink_to(SAMPLES)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(>>> .*?)^```$", page("python"), re.MULTILINE | re.DOTALL)
    example = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, "docs/python.md", None, 0)
    assert len(example.examples) >= 12
    lines: list[str] = []
    doctest.DocTestRunner(verbose=False).run(example, out=lines.append)
    assert not lines, "".join(lines)
