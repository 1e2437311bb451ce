"""The notebooks run from the first cell to the last, without a warning, and are kept without outputs."""

from __future__ import annotations

import os
from typing import Any

import nbformat
import pytest

from tests.places import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
SECONDS = 120
STRICT = "import warnings\nwarnings.simplefilter('error')\n%matplotlib inline"


def outputs(cell: Any) -> str:
    """What a cell shows as text."""
    data = [each.get("data", {}).get("text/plain", each.get("text", "")) for each in cell.outputs]
    return "\n".join(data)


def kinds(cell: Any) -> set[str]:
    """The forms in which a cell shows something."""
    return {kind for each in cell.outputs for kind in each.get("data", {})}


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    """The code cells of each notebook after a run."""
    from nbclient import NotebookClient

    home = tmp_path_factory.mktemp("jupyter")
    environment = {"IPYTHONDIR": str(home), "JUPYTER_RUNTIME_DIR": str(home), "PYTHONPATH": str(ROOT)}
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            patch.setenv(name, value)
        patch.delenv("MPLBACKEND", raising=False)
        for path in NOTEBOOKS:
            notebook = nbformat.read(path, as_version=4)
            notebook.cells.insert(0, nbformat.v4.new_code_cell(STRICT))
            client = NotebookClient(notebook, timeout=SECONDS, resources={"metadata": {"path": str(path.parent)}})
            client.execute(env=dict(os.environ))
            found[path.stem] = [cell for cell in notebook.cells if cell.cell_type == "code"][1:]
    return found


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
