"""Pages of docs/ say what the code says: columns, keys, words, suffixes, extras; and what they refer to is there."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lidarcli import __version__
from lidarcli.cli.info import as_json
from lidarcli.formalism.detection import SHAPES, VISIBILITIES
from lidarcli.formalism.tracking.results import ENDS
from lidarcli.logs.base import Topic
from lidarcli.logs.clock import ClockInfo
from lidarcli.logs.joined import Part
from lidarcli.options import choices
from lidarcli.overlays import objects, viewers
from lidarcli.overlays.markers import Kind
from lidarcli.pipeline import mapping
from lidarcli.pipeline.inputs import catalogue
from lidarcli.pipeline.inspecting import LogInfo, ScanInfo, Span
from lidarcli.pipeline.reading.found_poses import PoseInfo
from lidarcli.reports import figures
from lidarcli.sweeps.findings import IDS, Finding, Fix
from lidarcli.sweeps.types import Closure, Status
from lidarcli.tabular import SCHEMAS
from tests.fake_log import FakeLog
from tests.pipeline.test_following import CHANGED
from tests.places import REAL_LOGS, ROOT, SAMPLES, needs_real_logs
from tools import examples, reference
from tools.make_docs import PAGES
from tools.site import PAGES as PAGES_OF_THE_SITE

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


GLOSSARY = re.findall(r"^\| \*\*\[(.+?)\]\((\w+)\.md.*?\)\*\* \| (.*) \|$", page("glossary"), re.MULTILINE)
"""(word, the page that explains it, the other cells) of each row."""


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
    words = {word: cells for word, _, cells in GLOSSARY}
    assert 20 < len(words) == len(GLOSSARY) <= 30
    shape, visibility = (words[word].split(" | ")[0] for word in ("shape", "visibility"))
    assert {*re.findall(r"`(\w+)`", shape)} == {*SHAPES} - {"wall"}
    assert {*re.findall(r"`(\w+)`", visibility)} == {*VISIBILITIES}
    sections = re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page("tables"), re.MULTILINE | re.DOTALL)
    cells = [(table, cell) for table, text in sections for cell in re.findall(r"^\| (`.*?`) \|", text, re.MULTILINE)]
    columns = {f"{table}.{name}" for table, cell in cells for name in re.findall(r"`(\w+)`", cell)}
    named = {name for *_, row in GLOSSARY for name in re.findall(r"`([^`]+)`", f"{row} | ".split(" | ")[1])}
    assert named <= columns | {name for _, name in reference.option_names()}


def test_each_word_of_the_glossary_is_set_off_where_it_is_explained() -> None:
    for word, name, _ in GLOSSARY:
        forms = [word, f"{word}s", f"{word[:-2]}ices", f"{word[:-1]}ies"]
        assert re.search(rf"(\*|`)({'|'.join(forms)})\.?\1", page(name), re.IGNORECASE), f"{word} in {name}.md"


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
    cells = {name: row.split("|")[:3] for name, row in re.findall(r"^\| \*\*(\w+)[^|]*\*\* \|(.*)", moves, re.MULTILINE)}
    shares = {name: [float(re.findall(r": ([\d.]+) %", cell)[0]) for cell in cells[name][:2]] for name in ("all", "parked")}
    counts = {name: re.findall(r"(\d+) of (\d+)", row[2])[0] for name, row in cells.items()}
    ((right, found),) = re.findall(r"nine do \((\d+) %\), .*? nine \((\d+) %\)", section)
    assert [float(right), float(found)] == pytest.approx(shares["all"], abs=0.56)
    assert shares["all"] == pytest.approx([90, 90], abs=5)
    ((moving, tracks, outdoors, others),) = re.findall(r"tracks (\d+) of (\d+) move: (\d+) of the other (\d+)", section)
    assert (moving, tracks) == counts["all"]
    assert int(others) == int(tracks) - int(moving)
    assert int(outdoors) == int(counts["outdoors"][1]) - int(counts["outdoors"][0])
    ((parked, found),) = re.findall(r"parked, all (\d+) of its tracks move, and it finds (\d+) %", section)
    assert (parked, parked) == counts["parked"]
    assert float(found) == pytest.approx(shares["parked"][1], abs=0.56)


@needs_real_logs
@pytest.mark.slow
def test_the_zones_of_a_public_recording(tmp_path: Path) -> None:
    text = page("zones").replace("```console", "```py").replace("```sh", "```py").replace("```text\n$", "```console\n$")
    (tmp_path / "test-bag").symlink_to(REAL_LOGS / "comprobo24" / "test-bag")
    done = list(examples.run(text, tmp_path))
    assert len(done) == 4
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


OPTIONS = sorted({name for _, name in reference.option_names()})
MAX_BYTES = 328_000
SHORT = {"--output": "-o", "--verbose": "-v", "--quiet": "-q"}


def test_no_generated_page_is_stale() -> None:
    assert [name for name in PAGES if (ROOT / name).read_text(encoding="utf-8") != PAGES[name]()] == [], "run `make docs`"


def test_the_exit_codes_of_the_readme_are_those_of_the_command_line() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = text.partition("## Exit codes")[2].partition("\n## ")[0].split("|---|---|\n")[1]
    assert rows.strip().splitlines() == [f"| {code} | {words} |" for code, words in reference.exit_codes().items()]


def command_lines() -> str:
    """Every line of the documentation, the pages of the site included, in which lidarcli is called."""
    pages = [ROOT / "README.md", ROOT / "samples" / "README.md", *(ROOT / "docs").rglob("*.md")]
    commands = [page() for name, page in PAGES_OF_THE_SITE.items() if "/commands/" in name]
    text = "\n".join([*(page.read_text(encoding="utf-8") for page in pages), *commands]).replace("\\\n", " ")
    fences = re.findall(r"^```.*?\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = [line for fence in fences for line in fence.splitlines()]
    return "\n".join(line for line in lines if re.search(r"\blidarcli (-\S+ )*[a-z-]", line))


def test_every_option_has_an_example() -> None:
    lines = command_lines()
    names = {option: "|".join(re.escape(name) for name in (option, SHORT.get(option)) if name) for option in OPTIONS}
    assert [option for option in OPTIONS if not re.search(rf" (?:{names[option]})\b", lines)] == []


def test_the_readme_names_no_command_that_is_not_there() -> None:
    commands = {name.split()[0] for name, _ in reference.commands()}
    called = set(re.findall(r"\blidarcli (?:-[vq] )?([a-z]+)\b", command_lines()))
    assert called <= commands


def test_the_pages_of_docs_are_in_its_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    pages = {page.name for page in (ROOT / "docs").glob("*.md")} - {"README.md"}
    assert pages == set(re.findall(r"\]\((\w+\.md)\)", index))


def test_the_pages_stay_short() -> None:
    """All of docs/ in 328 kB: who says more of one thing says less of another."""
    assert sum(page.stat().st_size for page in (ROOT / "docs").rglob("*.md")) <= MAX_BYTES


def test_links_between_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "samples").glob("*.md")]
    for page in pages:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.relative_to(ROOT)} links to {target}"


INFO_PAGE = (ROOT / "docs" / "info.md").read_text(encoding="utf-8")
KEY = re.compile(r"^\| `([\w.\[\]]+)` \|([^|]+)\|([^|]*)\|([^|]*)\|$|^Of each .*, `(\w+\[\])`:$", re.MULTILINE)


def rows_of_keys() -> Iterator[tuple[str, ...]]:
    """Yield the rows of keys, each with the list above whose table it stands."""
    above = ""
    for *cells, below in KEY.findall(INFO_PAGE):
        above = f"{below}." if below else above
        if not below:
            yield (above + cells[0], *(cell.strip() for cell in cells[1:]))


ROWS = [*rows_of_keys()]
"""(key, type, unit, meaning) of each row of a key; rows of rules have five cells."""
KINDS: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "string or null": (str, type(None)),
    "integer": (int,),
    "integer or null": (int, type(None)),
    "number": (int, float),
    "number or null": (int, float, type(None)),
    "boolean": (bool,),
    "list": (list,),
    "list of strings": (list,),
    "pair": (list,),
    "pair of integers": (list,),
    "object": (dict,),
    "object or null": (dict, type(None)),
}


def info(unknown: bool = False) -> LogInfo:
    """A log with something of everything; with all that may be unknown unknown."""
    clock = ClockInfo(None, None, None, 0, 0.0, 2, None) if unknown else ClockInfo(5, 10**9, 10.0, 1, 0.5, 0, 0.25)
    scan = ScanInfo(
        topic="/scan",
        frame_id="laser",
        sweeps=2,
        beams=Span(300, 360),
        view=Span(5.0, 6.0),
        angle_min=Span(-3.0, -2.0),
        increment=Span(0.01, 0.02),
        closure=tuple(item.name.lower() for item in Closure),
        range_min=Span(0.1, 0.2),
        range_max=Span(12.0, float("inf") if unknown else 30.0),
        clock=clock,
        by_status={status.name.lower(): 3 for status in Status if status != Status.PADDING},
        pose="" if unknown else "/tf (map > laser)",
    )
    mended = Finding("units", "error", "/scan", "laser", "far", fix=Fix("option", "--range-unit mm"))
    return LogInfo(
        path="run.mcap",
        format="mcap",
        compression="zstd",
        size=None if unknown else 99,
        parts=(Part("bags/run_0.mcap", "run_0.mcap", 99, lambda _: nullcontext(FakeLog())),),
        topics=(Topic("/scan", "sensor_msgs/msg/LaserScan", "cdr", None if unknown else 2),),
        scans=(scan,),
        pose_topics=("/tf",),
        pose_sources=(PoseInfo("/tf", "tf2_msgs/msg/TFMessage", 9, None if unknown else 2.0, 1, 2, (("map", "laser"),)),),
        dropped=(("/scan", "angle_increment is zero", 1),),
        findings=(mended, replace(mended, fix=None)) if unknown else (mended,),
        notes=("a note",),
        damage=("byte 5: cut off",),
    )


def keys(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every key below a value as the page writes it, and what it holds."""
    if isinstance(value, dict):
        for key, item in value.items():
            name = f"{path}.{key}" if path else key
            yield name, item
            yield from keys(item, name)
    elif isinstance(value, list):
        for item in value:
            yield from keys(item, f"{path}[]")


@pytest.mark.parametrize("unknown", [False, True])
def test_every_key_is_described_and_no_other(unknown: bool) -> None:
    (log,) = json.loads(as_json([info(unknown)]))
    written = dict(keys(log))
    described = {key: kind for key, kind, _, _ in ROWS}
    assert len(described) == len(ROWS)
    assert sorted(written) == sorted(described)
    for key, value in written.items():
        kind = described[key]
        assert type(value) in KINDS[kind], key
        if kind == "list of strings":
            assert {type(item) for item in value} == {str}, key
        if kind.startswith("pair"):
            assert len(value) == 2, key


def test_every_rule_is_explained() -> None:
    assert tuple(re.findall(r"^\| `(\w+)` \| (?:always|`--deep`|`--map`) \|", INFO_PAGE, re.MULTILINE)) == IDS


CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGE = ROOT / "lidarcli"


def test_the_targets_that_are_named_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    pages = [CONTRIBUTING, (ROOT / "README.md").read_text(encoding="utf-8")]
    named = {name for page in pages for name in re.findall(r"(?:^|`)make ([a-z][a-z-]*)", page, re.MULTILINE)}
    assert len(named) > 10
    assert named <= targets


def test_the_map_of_rooms_is_true() -> None:
    table = ARCHITECTURE.split("| room | holds |")[1].split("\n\n")[0]
    named = {name for row in table.splitlines()[2:] for name in re.findall(r"`([^`]+)`", row.split("|")[1])}
    for name in named:
        assert (PACKAGE / (name if name.endswith("/") else f"{name}.py")).exists(), name
    there = {f"{path.name}/" for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    there |= {path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("__")}
    assert there <= named


def test_the_files_that_are_named_are_there() -> None:
    for page in (CONTRIBUTING, ARCHITECTURE):
        named = {name for name in re.findall(r"`((?:\w+/)*\w+\.py|(?:\w+/)+)(?:::\w+)?`", page) if "/" in name}
        assert len(named) > 10
        for name in named:
            homes = (ROOT, PACKAGE, PACKAGE / "formalism")
            assert any((home / name).exists() for home in homes), name


def test_a_change_takes_at_most_two_files() -> None:
    table = ARCHITECTURE.split("| to change or add |")[1].split("\n\n")[0]
    rows = [row.split("|") for row in table.splitlines()[2:]]
    assert len(rows) >= 10
    for row in rows:
        assert 1 <= len(re.findall(r"`[\w/]+(?:\.py|/)`", row[2])) <= 2, row[1]
        assert row[3].strip()
