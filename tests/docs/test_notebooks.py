"""The notebooks run without a warning, and are kept with the outputs of today.

`python -m tests.docs.test_notebooks` writes these anew.
"""

from __future__ import annotations

import base64
import io
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import nbformat
import pytest
from PIL import Image

from tests.places import ROOT
from tests.waiting import HANG

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
STRICT = "import warnings\nwarnings.simplefilter('error')\n%matplotlib inline"
LARGE = 50_000
"""[bytes] Greatest HTML of an output that is kept: the page of a report is not."""


def outputs(cell: Any) -> str:
    """What a cell shows as text."""
    data = [each.get("data", {}).get("text/plain", each.get("text", "")) for each in cell.outputs]
    return "\n".join(data)


def kinds(cell: Any) -> set[str]:
    """The forms in which a cell shows something."""
    return {kind for each in cell.outputs for kind in each.get("data", {})}


def run(path: Path, home: Path) -> Any:
    """The notebook after a run."""
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(STRICT))
    environment = {"IPYTHONDIR": str(home), "JUPYTER_RUNTIME_DIR": str(home), "PYTHONPATH": str(ROOT)}
    kept = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    limits = dict.fromkeys(("timeout", "startup_timeout", "iopub_timeout"), int(HANG))
    client = NotebookClient(notebook, **limits, resources={"metadata": {"path": str(path.parent)}})
    client.execute(env=kept | environment)
    del notebook.cells[0]
    return notebook


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    """The code cells of each notebook after a run."""
    found = {path.stem: run(path, tmp_path_factory.mktemp("jupyter")) for path in NOTEBOOKS}
    return {name: [cell for cell in notebook.cells if cell.cell_type == "code"] for name, notebook in found.items()}


@pytest.mark.whole
def test_the_kept_outputs_are_those_of_today(ran: dict[str, list[Any]]) -> None:
    for path in NOTEBOOKS:
        kept = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
        assert [outputs(cell) for cell in kept] == [outputs(cell) for cell in ran[path.stem]], (
            "-m tests.docs.test_notebooks"
        )


def test_notebooks_are_small_and_have_outputs() -> None:
    for path in NOTEBOOKS:
        assert path.stat().st_size < 200_000
        code = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
        assert all(cell.execution_count for cell in code)
        assert any("image/png" in kinds(cell) for cell in code)


@pytest.mark.whole
def test_the_first_look_shows_what_it_says(ran: dict[str, list[Any]]) -> None:
    cells = ran["first-look"]
    assert "'sweeps': 100" in outputs(cells[1])
    assert "SweepBatch /scan: 100 sweeps x 361 beams" in outputs(cells[2])
    assert "text/html" in kinds(cells[2])
    assert [sum("image/png" in each.get("data", {}) for each in cell.outputs) for cell in cells] == [
        *(0, 0, 0, 1, 1, 0, 0, 1, 0)
    ]
    assert len(outputs(cells[5]).splitlines()) == 6
    (shown,) = cells[8].outputs
    assert shown["data"]["text/html"].startswith("<iframe srcdoc=")
    assert outputs(cells[8]) == "<report on room: 100 sweeps, 499 objects, 1 of 1 checks hold>"


@pytest.mark.whole
def test_the_people_are_those_of_the_truth(ran: dict[str, list[Any]]) -> None:
    cells = ran["people"]
    assert outputs(cells[2]) == "3"
    true, found = (outputs(cells[at]).splitlines() for at in (3, 4))
    speeds = sorted(float(line.split()[-1]) for line in true[2:])
    assert speeds == [0.0, 0.81, 1.1, 1.24]
    assert [float(line.split()[-1]) for line in found[1:]] == pytest.approx(speeds[1:], abs=0.02)
    at_once = [int(line.split()[-1]) for line in outputs(cells[7]).splitlines()[2:]]
    assert at_once == [2, 2, 2, 3, 3, 3, 3, 3]
    assert sum("image/png" in kinds(cell) for cell in cells) == 3


@pytest.mark.whole
def test_many_logs_are_in_one_table(ran: dict[str, list[Any]]) -> None:
    cells = ran["many-logs"]
    assert {line.split()[0] for line in outputs(cells[3]).splitlines()[2:]} == {
        *("corridor", "drive", "hall", "people", "reflectors", "room")
    }
    assert len(outputs(cells[4]).splitlines()) == 4


@pytest.mark.whole
def test_the_paper_is_as_by_hand(ran: dict[str, list[Any]]) -> None:
    """Figures 3, 5, 6, 7 and 8, and what the definitions say of the box of Fig. 3."""
    cells = ran["paper"]
    told = "\n".join(outputs(cell) for cell in cells)
    (mean, by_hand) = re.findall(r"mean of \|s\|: ([\d.]+) m, by hand ([\d.]+) m", told)[0]
    assert mean == by_hand == "0.027243"
    for line in (
        "the same as by hand: True",
        "by 0.3 m, at degrees: [26 36]",
        "{'O': 10, 'S': 351}",
        "P_i at 26 deg, 1.57 m, s = -1.30 m\nP_f at 35 deg, 1.45 m, then s = 1.76 m",
        "V: [(26, 1.569), (29, 1.39), (35, 1.45)]",
        "F: [[26, 29], [29, 35]]",
    ):
        assert line in told
    assert sum("image/png" in kinds(cell) for cell in cells) == 6
    assert (ROOT / "docs" / "notebooks" / "paper.ipynb").stat().st_size < 200_000


def with_few_colours(picture: str) -> str:
    """Return a picture, both as a notebook has it, in half as many bytes."""
    small = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        few = image.convert("RGB").quantize(128, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        few.save(small, "png", optimize=True)
    return base64.b64encode(small.getvalue()).decode()


def main() -> None:
    """Write the outputs anew, without what is too large to keep."""
    for path in NOTEBOOKS:
        with tempfile.TemporaryDirectory() as home:
            notebook = run(path, Path(home))
        number = 0
        for cell in notebook.cells:
            if cell.cell_type == "code":
                number += 1
                cell.execution_count = number
                cell.metadata.pop("execution", None)
                for each in cell.outputs:
                    if "execution_count" in each:
                        each["execution_count"] = number
                    data = each.get("data", {})
                    if len(data.get("text/html", "")) > LARGE:
                        del data["text/html"]
                    if "image/png" in data:
                        data["image/png"] = with_few_colours(data["image/png"])
        nbformat.write(notebook, path)


if __name__ == "__main__":
    main()
