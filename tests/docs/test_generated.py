"""The references are what the code says today, and every option is shown at work somewhere."""

from __future__ import annotations

import re

from tests.places import ROOT
from tools import reference
from tools.make_docs import PAGES
from tools.site import PAGES as PAGES_OF_THE_SITE

OPTIONS = sorted({name for _, name in reference.option_names()})
MAX_BYTES = 332_000
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
    """All of docs/ in 332 kB: who says more of one thing says less of another."""
    assert sum(page.stat().st_size for page in (ROOT / "docs").rglob("*.md")) <= MAX_BYTES


def test_links_between_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "samples").glob("*.md")]
    for page in pages:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.relative_to(ROOT)} links to {target}"
