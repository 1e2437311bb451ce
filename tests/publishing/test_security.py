"""SECURITY.md states the bounds and refusals of the code."""

from __future__ import annotations

import re

from tests.places import ROOT
from tools.fuzz import judge

PAGE = (ROOT / "SECURITY.md").read_text("utf-8")


def test_the_fuzzer_holds_what_is_promised() -> None:
    said = re.search(r"inputs below (\d+) MB to (\d+) s of processor time and (\d+) MB of memory", " ".join(PAGE.split()))
    assert said is not None
    assert [float(number) for number in said.groups()] == [judge.SMALL / 1e6, judge.SECONDS, judge.PEAK_MB]


def test_what_is_unpickled_comes_from_its_own_processes() -> None:
    """But for what a cluster answers, which Dask reads."""
    package = ROOT / "lidarcli"
    files = {
        word: {path.relative_to(package).as_posix() for path in package.rglob("*.py") if word in path.read_text("utf-8")}
        for word in ("pickle.load", "Unpickler")
    }
    own = {"pipeline/mapping.py", "pipeline/objects/tracking.py"}
    assert files == {"pickle.load": own, "Unpickler": set()}
    assert "a scheduler that you trust" in " ".join(PAGE.split())
    assert "a private folder below the temporary one (`map --jobs`)" in " ".join(PAGE.split())
    assert "a temporary file without a name (`track`" in " ".join(PAGE.split())


def test_reports_load_nothing_from_elsewhere() -> None:
    page = (ROOT / "lidarcli" / "reports" / "templates" / "page.html").read_text("utf-8")
    assert "Content-Security-Policy" in page
    assert "default-src 'none'" in page
