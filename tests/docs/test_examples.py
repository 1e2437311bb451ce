"""The commands of the README and of the tutorial do what these pages say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.places import ROOT
from tools import examples
from tools.make_docs import WITH_EXAMPLES

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("page", WITH_EXAMPLES)
def test_the_examples_of_a_page(page: str, tmp_path: Path) -> None:
    (tmp_path / "samples").symlink_to(ROOT / "samples")
    done = list(examples.run((ROOT / page).read_text(encoding="utf-8"), tmp_path))
    assert len(done) >= 3
    for example in done:
        assert example.holds, f"$ {example.example.command}\n{example.got}\nexit code {example.code}"


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
