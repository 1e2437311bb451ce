"""docs/accuracy.md is what `make accuracy` writes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.accuracy.page import BEGIN, END, KEPT, NEVER, table
from tests.places import ROOT
from tests.waiting import HANG

pytestmark = pytest.mark.whole


def accuracy(*arguments: str, folder: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = {"LIDARCLI_REAL_LOGS": folder} if folder else {}
    command = [sys.executable, "-m", "benchmarks.accuracy", *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=HANG, check=False)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a tiny run, written over a page that holds figures of real recordings."""
    folder = tmp_path_factory.mktemp("page")
    target = folder / "accuracy.md"
    target.write_text(f"outdated\n{BEGIN}\n\nfigures of real recordings\n\n{END}\noutdated\n", encoding="utf-8")
    options = ["--seeds", "7", "--scenes", "1", "--jobs", "1"]
    done = accuracy(*options, "--page", str(target), "--json", str(folder / "figures.json"))
    assert done.returncode == 0, done.stderr
    return target


def test_the_page_names_its_command_and_seeds(written: Path) -> None:
    text = written.read_text(encoding="utf-8")
    assert 'make accuracy ACCURACY="--seeds 7 --scenes 1"' in text
    assert "what is reported here begins with seed 7." in " ".join(text.split())
    for heading in (
        "# Accuracy",
        "## Objects",
        "## Shapes",
        "## A cylinder",
        "## On real logs",
        "### Scenes like real buildings",
        "## Limits",
    ):
        assert f"{heading}\n" in text
    assert "outdated" not in text


def test_figures_of_real_recordings_are_kept(written: Path) -> None:
    text = written.read_text(encoding="utf-8")
    kept = text.partition(BEGIN)[2].partition(END)[0]
    assert kept == f"\n\nfigures of real recordings\n\n{KEPT}\n\n"


def test_the_images_are_small(written: Path) -> None:
    images = sorted((written.parent / "images").iterdir())
    assert [image.name for image in images] == ["accuracy-scenes.png", "accuracy.png"]
    assert all(1_000 < image.stat().st_size < 100_000 for image in images)


def test_the_json_holds_every_cell(written: Path) -> None:
    figures = json.loads((written.parent / "figures.json").read_text(encoding="utf-8"))
    plain = [cell for cell in figures["cells"] if cell["scenes"] == "plain"]
    assert len({(cell["kind"], cell["sensor"], cell["noise"]) for cell in plain}) == 27 + 12
    assert {cell["method"] for cell in plain} >= {"robust", "paper", "Dietmayer", "DBSCAN(0.3, 3)"}
    assert all(0 <= cell["f1"] <= 1 for cell in plain)
    assert len(figures["boxes"]) == 9
    assert len(figures["cylinder"]) == 9


def test_nonsense_is_refused() -> None:
    done = accuracy("--scenes", "0")
    assert done.returncode == 2
    assert "--scenes and --jobs are at least 1" in done.stderr


def test_the_page_in_the_docs_is_a_whole_run() -> None:
    text = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    assert "\nmake accuracy\n" in text, "written with other seeds or fewer scenes"
    assert NEVER not in text
    for image in re.findall(r"\]\((images/.*?)\)", text):
        assert (ROOT / "docs" / image).stat().st_size < 100_000
    assert not re.search(r"[0-9] (ms|µs|sweeps/s)\b", text), "no timings: they differ from machine to machine"


def test_tables() -> None:
    assert table(["a", "b"], [["x", "1"]]) == "| a | b |\n| --- | ---: |\n| x | 1 |\n"
