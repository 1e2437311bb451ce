"""SECURITY.md states the bounds and refusals of the code."""

from __future__ import annotations

import re

from lidarcli import configfiles, maps
from lidarcli.logs import base, batches, text, unpacking
from lidarcli.logs import mcap_records as mcap
from tests.places import ROOT
from tools.fuzz import judge

PAGE = (ROOT / "SECURITY.md").read_text("utf-8")


def test_the_bounds_are_those_of_the_code() -> None:
    rows = re.findall(r"^\| (.+?) \| (.+?) \|$", PAGE, re.MULTILINE)
    small, ratio = unpacking.SMALL >> 20, unpacking.MAX_RATIO
    assert dict(rows) == {
        "what": "bound",
        "what a compressed log unpacks to": f"{small} MiB, and {ratio:,} times what is packed",
        "a compressed chunk of an MCAP, which is held as a whole": (
            f"{small} MiB, and {unpacking.CHUNK_RATIO} times what is packed; never more than {mcap.MAX_CHUNK >> 30} GiB"
        ),
        "a message of a ROS bag": f"{base.MAX_MESSAGE >> 20} MiB",
        "a line of a text log": f"{text.MAX_LINE >> 20} MiB",
        "beams of a sweep; LaserScan topics of a log": f"{base.MAX_BEAMS:,}; {batches.MAX_TOPICS:,}",
        "a scene, catalogue or other TOML file": f"{configfiles.MAX_BYTES:,} bytes, {configfiles.MAX_DEPTH} brackets deep",
        "pixels of a map that is read": (
            f"one for each byte of its image; at least {maps.MOST_PACKED_PIXELS:,}, at most {maps.MOST_PIXELS:,}"
        ),
    }


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
