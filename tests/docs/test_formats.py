"""docs/formats.md: every row has its tests, and its examples are read as it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lidarcli.files import configfiles
from lidarcli.logs import base, batches, open_log, rosbag2_sqlite, text, unpacking
from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.csv.layouts import LAYOUTS
from lidarcli.maps import grids
from lidarcli.options import choices
from lidarcli.ros import bag_metadata
from tests.docs.format_tests import ROWS
from tests.places import ROOT

PAGE = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
EXAMPLES = dict(re.findall(r"^### (.+?)\n.*?^```csv\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def test_the_tests_that_are_named_exist() -> None:
    named = {test for tests in ROWS.values() for row in tests.values() for test in row}
    assert len(named) > 100
    for path, name in sorted(test.split("::") for test in named):
        assert f"\ndef {name}(" in (ROOT / "tests" / path).read_text(encoding="utf-8"), f"{path} has no {name}"


@pytest.mark.parametrize(("title", "least"), [("Containers", 5), ("Damaged and unusual logs", 40), ("Outputs", 10)])
def test_every_row_has_its_tests(title: str, least: int) -> None:
    table = section(title)
    lines = [line for line in table.splitlines() if line.startswith("| ") and "**" not in line]
    said = [line.strip("|").split(" | ")[0].strip() for line in lines[1:]]
    assert len(said) >= least
    assert said == list(ROWS[title])
    assert all(ROWS[title].values())


def test_the_bounds_are_those_of_the_code() -> None:
    table = PAGE.split("## Bounds")[1].split("\n## ")[0]
    said = {
        row.split(" | ")[0].removeprefix("| "): row.split(" | ")[1].rstrip(" |")
        for row in table.splitlines()
        if " | " in row
    }
    small = unpacking.SMALL >> 20
    assert said == {
        "what": "bound",
        "a sweep": f"{base.MAX_BEAMS:,} beams",
        "LaserScan topics of a log": f"{batches.MAX_TOPICS:,} (`--topic` chooses among more)",
        "what a log unpacks to, whatever its compression": f"{small} MiB, and {unpacking.MAX_RATIO:,} times what is packed",
        "a chunk of an MCAP, which is held as a whole": (
            f"{unpacking.MAX_CHUNK >> 30} GiB; compressed {small} MiB and {unpacking.CHUNK_RATIO} times what is packed"
        ),
        "a message of a ROS bag": f"{base.MAX_MESSAGE >> 20} MiB",
        "messages of a ROS 2 database together": "the bytes of its file",
        "steps of SQLite for one statement": (
            f"{rosbag2_sqlite.STEPS:,}, and {rosbag2_sqlite.STEPS_PER_BYTE} for each byte of the file"
        ),
        "a text in the schema and the topics of a database": f"{rosbag2_sqlite.MAX_TEXT >> 10} KiB",
        "`metadata.yaml`": f"{bag_metadata.MAX_METADATA >> 20} MiB",
        "a line of a text log": f"{text.MAX_LINE >> 20} MiB",
        "damaged places that are named one by one": str(base.ReadReport.MAX_DAMAGE),
        "pixels of a map": (
            f"one for each byte of its image; at least {grids.MAX_PACKED_PIXELS:,}, at most {grids.MAX_PIXELS:,}"
        ),
        "numbers of files in YAML and TOML": (
            f"-{configfiles.LARGEST:,.0f} to {configfiles.LARGEST:,.0f} where nothing else is said; "
            f"origins of maps within {grids.FARTHEST:,.0f} m; "
            f"cells of a map {1000 * choices.MAP_RESOLUTIONS[0]:g} mm to {choices.MAP_RESOLUTIONS[1]:g} m"
        ),
    }


def test_the_example_of_a_carmen_log_is_read(tmp_path: Path) -> None:
    example = re.search(r"^## CARMEN\n.*?^```text\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert example is not None
    (tmp_path / "run.log").write_text(example[1], encoding="utf-8")
    with open_log(tmp_path / "run.log") as log:
        [block] = log.scans(None, ReadReport())
    assert (log.format, block.topic, block.frame_ids) == ("carmen", "/front_laser", ("front_laser",))
    assert block.ranges.tolist() == [pytest.approx([2.1, 2.0, 2.1, 2.0, 2.1])]
    assert block.stamp_ns.tolist() == [12_500_000_000]


def test_the_example_of_json_lines_is_read(tmp_path: Path) -> None:
    [example] = re.findall(r"^```text\n(.*?)^```$", section("JSON lines"), re.MULTILINE | re.DOTALL)
    (tmp_path / "run.jsonl").write_text(example, encoding="utf-8")
    with open_log(tmp_path / "run.jsonl") as log:
        [block] = log.scans(None, ReadReport())
    assert (log.format, block.topic, block.frame_ids) == ("json lines", "/scan", ("laser",))
    assert block.ranges.tolist() == [pytest.approx([2.1, float("nan"), 2.1], nan_ok=True)]
    assert block.stamp_ns.tolist() == [1_700_000_000_000_000_007]


@pytest.mark.parametrize("number", range(5))
def test_the_examples_of_rplidar_text_are_read(number: int, tmp_path: Path) -> None:
    examples = re.findall(r"^```text\n(.*?)^```$", section("RPLIDAR"), re.MULTILINE | re.DOTALL)
    assert len(examples) == 5
    (tmp_path / "run.txt").write_text(examples[number], encoding="utf-8")
    report = ReadReport()
    with open_log(tmp_path / "run.txt") as log:
        blocks = list(log.scans(None, report))
    assert log.format.startswith("csv (RPLIDAR")
    assert (report.damage, report.refused) == ([], {})
    assert sum(map(len, blocks)) == (2 if number in (0, 3) else 1)
    for block in blocks:
        assert block.ranges.tolist() == [pytest.approx([2.1, 2.0, 2.1])] * len(block)
        # From the left, over the front, to the right.
        assert block.angle_min.tolist() == [pytest.approx(0.5, abs=1e-3)] * len(block)
        assert block.angle_increment.tolist() == [pytest.approx(-0.5, abs=1e-3)] * len(block)


def section(title: str) -> str:
    """The text of a section of the page."""
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def test_every_layout_has_an_example() -> None:
    assert list(EXAMPLES) == list(LAYOUTS)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_example_is_read_as_its_layout(layout: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(EXAMPLES[layout], encoding="utf-8")
    told = OpenOptions(angle_min=-0.5, angle_increment=0.5) if layout == "plain wide" else OpenOptions()
    with open_log(path, opening=told) as log:
        assert log.format == f"csv ({layout})"
        blocks = list(log.scans(None, ReadReport()))
    for block in blocks:
        assert block.ranges.tolist() == [pytest.approx([2.1, 2.0, 2.1])] * len(block)
        assert block.angle_min.tolist() == [-0.5] * len(block)
        assert block.angle_increment.tolist() == [0.5] * len(block)
    assert sum(map(len, blocks)) == (2 if layout == "long form" else 1)
