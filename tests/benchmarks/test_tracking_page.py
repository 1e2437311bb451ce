"""docs/tracking.md is what `make tracking` writes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.page import BEGIN, END, KEPT, NEVER
from benchmarks.tracking.__main__ import Part, main, measure, write
from benchmarks.tracking.bodies import Bodies
from benchmarks.tracking.cells import QUICK
from benchmarks.tracking.figures import Figures, Log, as_json, rigid, summarise
from benchmarks.tracking.methods import NAMES, ORACLE
from benchmarks.tracking.metrics import Agreement
from benchmarks.tracking.page import page, summary
from benchmarks.tracking.real import measure_cars, measure_legs
from benchmarks.tracking.scoring import Score, Share
from tests.places import REAL_LOGS, needs_real_logs

ROOM, PEOPLE = QUICK[0], QUICK[-1]


@pytest.fixture(scope="module")
def figures() -> Figures:
    """One room and one log with people by all methods."""
    logs = [measure(Part(cell, 3, tuple(NAMES))) for cell in (ROOM, PEOPLE)]
    return Figures("make tracking", 70_000, 1, logs)


def log(hota: float, *, cell: int, standing: Share) -> Log:
    """A log of a method with these figures."""
    agreement = Agreement(hota, 1.0, 1.0, 1.0, 1.0, switches=1, entities=4, tracks=5)
    errors = np.array([hota])
    one = Score(
        agreement, agreement, errors, errors, errors, Share(1, 2), standing, sweeps=10, seconds=1e-3, bodies=Bodies()
    )
    return Log(QUICK[cell], 0, {"some": one}, 1e-4)


def test_means_are_of_logs_and_the_worst_of_cells() -> None:
    logs = [
        log(0.9, cell=0, standing=Share(1, 10)),
        log(0.7, cell=0, standing=Share(0, 10)),
        log(1.0, cell=1, standing=Share(3, 20)),
        log(0.8, cell=1, standing=Share(0, 0)),
    ]
    one = summarise(logs, "some")
    assert (one.hota, one.hota_worst) == (pytest.approx(0.85), pytest.approx(0.8))
    assert (one.switches, one.tracks) == (25.0, 125.0)
    assert (one.standing_in_a, one.standing_worst) == (pytest.approx(0.1), pytest.approx(0.15))
    assert one.speed_rms == pytest.approx(np.sqrt((0.81 + 0.49 + 1 + 0.64) / 4))
    assert (one.speed_median, one.microseconds) == (pytest.approx(0.85), pytest.approx(100.0))


@pytest.mark.whole
def test_the_page_has_every_method_and_part(figures: Figures) -> None:
    text = page(figures, "")
    for heading in ("Rigid bodies", "Persons", "Condition by condition", "Cost", "Real recordings", "Limits"):
        assert f"\n## {heading}\n" in text
    assert "begins with seed 70,000." in " ".join(text.split())
    for name in ("**lidarcli**", "leg_tracker rules", "SORT rules", "*truth about each object*"):
        assert re.search(rf"^\| {re.escape(name)} \| 0\.\d{{3}} ", text, re.MULTILINE)
    assert NEVER in text
    assert "{" not in text


@pytest.mark.whole
def test_the_truth_is_best(figures: Figures) -> None:
    rooms = figures.of(rigid)
    best = summarise(rooms, ORACLE).hota
    assert best > 0.95
    assert all(summarise(rooms, name).hota <= best for name in figures.methods)
    assert figures.cells == [ROOM, PEOPLE]
    assert rooms == figures.logs[:1]


@pytest.mark.whole
def test_figures_of_real_recordings_are_kept(figures: Figures) -> None:
    before = f"outdated\n{BEGIN}\n\nfigures of real recordings\n\n{END}\noutdated\n"
    text = page(figures, before)
    assert text.partition(BEGIN)[2].partition(END)[0] == f"\n\nfigures of real recordings\n\n{KEPT}\n\n"
    assert "outdated" not in text


@pytest.mark.whole
def test_the_terminal_says_the_same(figures: Figures) -> None:
    shown, text = summary(figures), page(figures, "")
    lines = [line for line in shown.splitlines() if line.startswith("| ")]
    assert len(lines) > 30
    assert set(lines) <= set(text.splitlines())


@pytest.mark.whole
def test_the_json_holds_every_cell(figures: Figures) -> None:
    cells = json.loads(as_json(figures))["cells"]
    assert len(cells) == 2 * len(NAMES)
    assert {cell["method"] for cell in cells} == set(NAMES)
    assert all(0 <= cell["hota"] <= 1 for cell in cells)


@pytest.mark.whole
def test_the_image_is_small_and_the_same_again(figures: Figures, tmp_path: Path) -> None:
    write(figures, tmp_path / "tracking.md")
    image = tmp_path / "images" / "tracking.png"
    first = image.read_bytes()
    assert 1_000 < len(first) < 100_000
    write(figures, tmp_path / "tracking.md")
    assert image.read_bytes() == first


@pytest.mark.whole
def test_nonsense_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["benchmarks.tracking", "--seeds", "0"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.endswith("error: --seeds is 1 to 100, --jobs at least 1\n")


@needs_real_logs
@pytest.mark.whole
def test_real_recordings() -> None:
    cars = [car for car in measure_cars(REAL_LOGS) if car.method == "datmo"]
    assert [car.log for car in cars] == ["overtake_ego.bag", "parallel.bag"]
    for car in cars:
        assert car.rows > 130
        assert 0.2 < car.rms < 0.4
        assert 1 <= car.tracks <= 5
    legs = {one.method: one for one in measure_legs(REAL_LOGS)}
    assert legs["leg_tracker"].labels == 1052
    assert legs["leg_tracker"].matched > 0.98
