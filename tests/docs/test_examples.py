"""The commands of README and docs do what these pages say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.running import run_page
from tests.places import ROOT
from tools import examples
from tools.make_docs import WITH_EXAMPLES

pytestmark = pytest.mark.slow
ELSEWHERE = {"README.md": "test_readme", "docs/paper.md": "test_paper_page", "docs/reports.md": "test_reports_page"}
"""Pages whose examples also make pictures, and the module that runs them and compares these."""


@pytest.mark.parametrize("page", [page for page in WITH_EXAMPLES if page not in ELSEWHERE])
def test_the_examples_of_a_page(page: str, tmp_path: Path) -> None:
    assert len(run_page(page, tmp_path)) >= 3


@pytest.mark.parametrize(
    ("command", "calls"),
    [
        ("lidarcli info a.mcap -o b-1.csv", [["lidarcli", "info", "a.mcap", "-o", "b-1.csv"]]),
        ("set -e\nlidarcli a \\\n  b   # c | d\npython e.py\n", [["lidarcli", "a", "b"], ["python", "e.py"]]),
        ("python -c 'a |\nb'", [["python", "-c", "a |\nb"]]),
        ('lidarcli report --check "a <= 3; b"', [["lidarcli", "report", "--check", "a <= 3; b"]]),
        *((f"lidarcli a{more}", None) for more in (" | b", "; b", " > b", " 2>&1", " *.b", " $b", ' "$b"', " || b")),
        ("A=1 lidarcli a", None),
        ("ls", None),
    ],
)  # fmt: skip
def test_what_needs_a_shell(command: str, calls: list[list[str]] | None) -> None:
    assert examples.plain_calls(command) == calls


@pytest.mark.parametrize(
    "command",
    [
        "lidarcli -q info missing.mcap; echo $?",
        "lidarcli info samples/room.mcap | grep beams | tail -n 1",
        "lidarcli detect samples/room.mcap -o out 2>&1 | head -n 2",
        "lidarcli detect samples/room.mcap -o out | cat",
        "lidarcli info samples/hall --format json",
        "lidarcli -q info samples/room.mcap missing.mcap",
        "python -c 'import sys, time; print(sys.argv, time.tzname)'",
    ],
)
def test_a_command_does_here_what_it_does_in_a_shell(command: str, tmp_path: Path) -> None:
    found = []
    for name in ("here", "shell"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "samples").symlink_to(ROOT / "samples")
        found.append((examples.outcome if name == "here" else examples.in_shell)(command, folder))
    assert found[0] == found[1]
    assert found[0][1]


def test_blocks_are_told_apart(tmp_path: Path) -> None:
    page = (
        "Text `$ no command`.\n\n```txt note.txt\nhello\n```\n\n```console\n$ cat note.txt\nhello\n"
        "$ seq 3\n1\n...\n3\n$ echo \\\n> two\nfour\n```\n\n```sh\ntest -e note.txt\nfalse\ntrue\n```\n"
    )
    done = list(examples.run(page, tmp_path))
    assert [(one.got, one.code, one.holds) for one in done] == [
        ("hello\n", 0, True),
        ("1\n2\n3\n", 0, True),
        ("two\n", 0, False),
        ("", 1, False),
    ]
    healthy = page.replace("false\n", "")
    assert examples.renewed(healthy, tmp_path) == healthy.replace("\nfour\n", "\ntwo\n")
