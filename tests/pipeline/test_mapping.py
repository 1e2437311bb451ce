"""One map of several logs: the same bytes whoever counts, in whichever order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lidarcli.errors import OptionError
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.mapping import GrowingMap, MapOptions, MapRun
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.pipeline.runs import over_logs
from lidarcli.simulation import simulate
from tests.places import SAMPLES

TOGETHER = ("grid.pgm", "grid.yaml", "grid.mcap")


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drives")
    for seed in (1, 2, 3):
        simulate(SAMPLES / "drive.toml", folder / f"drive{seed}.mcap", sweeps=60, seed=seed)
    return folder


def make(folder: Path, logs: list[str], out: Path, options: MapOptions) -> list[over_logs.Outcome]:
    out.mkdir()
    with MapRun(find_logs([str(folder / log) for log in logs]), [out / "grid.yaml", out / "grid.mcap"], options) as run:
        done = list(run.outcomes())
        run.finish()
    return done


LOGS = ["drive1.mcap", "drive2.mcap", "drive3.mcap"]


@pytest.mark.slow
def test_processes_and_the_order_of_logs_make_no_difference(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(drives, LOGS, tmp_path / "one", MapOptions(jobs=1))
    make(drives, LOGS[::-1], tmp_path / "turned", MapOptions(jobs=1))
    monkeypatch.setattr(over_logs, "WORTH_A_PROCESS", 1)
    done = make(drives, LOGS, tmp_path / "two", MapOptions(jobs=2))
    assert [Path(one.label).name for one in done] == LOGS
    assert [one.exit_code for one in done] == [0, 0, 0]
    for name in TOGETHER:
        alone = (tmp_path / "one" / name).read_bytes()
        assert (tmp_path / "two" / name).read_bytes() == alone
        assert (tmp_path / "turned" / name).read_bytes() == alone


@pytest.mark.slow
def test_processes_refuse_what_one_refuses(drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(over_logs, "WORTH_A_PROCESS", 1)
    for jobs in (1, 2):
        with pytest.raises(OptionError, match=r"the map would reach over \d+ x \d+ m, more than 1e-05 km²"):
            make(drives, LOGS, tmp_path / str(jobs), MapOptions(max_size=1e-5, jobs=jobs))
        assert not list((tmp_path / str(jobs)).iterdir())


def test_the_size_of_batches_makes_no_difference(drives: Path) -> None:
    grids = []
    for size in (1, 7, 1000):
        mapping = GrowingMap(MapOptions(read=ReadOptions(batch_size=size)))
        mapping.add(*find_logs([str(drives / LOGS[0])]))  # type: ignore[arg-type]
        grids.append((mapping.occupancy(), mapping.counts))
    for grid, counts in grids[1:]:
        assert np.array_equal(grid.cells, grids[0][0].cells)
        assert (grid.x, grid.y, counts.sweeps) == (grids[0][0].x, grids[0][0].y, grids[0][1].sweeps)


def test_paths_that_are_matched_lie_in_worlds_of_their_own(drives: Path) -> None:
    options = MapOptions(poses=PoseOptions("match"), read=ReadOptions(end=1.0))
    with MapRun(find_logs([str(drives / log) for log in LOGS[:2]]), [], options) as run:
        run.add(find_logs([str(drives / LOGS[0])])[0])  # type: ignore[arg-type]
        with pytest.raises(OptionError, match="each sensor in a world of its own"):
            run.add(find_logs([str(drives / LOGS[1])])[0])  # type: ignore[arg-type]
