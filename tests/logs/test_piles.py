"""Ranges that pile up at the most that a log holds are no return; walls far away are none."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.piles import WINDOW, WINDOW_VALUES
from lidarcli.simulation.writers import write_mcap
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Float32, RawSweeps, Status, SweepBatch
from tests.fake_log import FakeLog
from tests.sweeping import raw_sweeps
from tests.text_logs import write_carmen, write_csv

SWEEPS, BEAMS = 300, 180
NO_RETURN = Status.NO_RETURN.value


def driven(values: tuple[float, ...] = (50.0,), share: float = 0.1, sweeps: int = SWEEPS, seed: int = 1) -> Any:
    """(S, B) ranges [m] of a sensor that is driven about: here and there nothing comes back, wherever it looks."""
    rng = np.random.default_rng(seed)
    ranges = np.round(2.0 + 10.0 * rng.random((sweeps, BEAMS)), 2)
    nothing = rng.random((sweeps, BEAMS)) < share
    ranges[nothing] = rng.choice(values, nothing.sum())
    return ranges.astype(np.float32)


def judged(*blocks: RawSweeps, **options: Any) -> tuple[list[SweepBatch], ReadReport]:
    """The batches of a log of these blocks, and what reading it has met."""
    report = ReadReport()
    return list(read_batches(FakeLog(blocks), ReadOptions(**options), report)), report


def far(ranges: Float32, **columns: Any) -> RawSweeps:
    return raw_sweeps(ranges, range_max=80.0, angle_increment=np.pi / BEAMS, **columns)


def statuses(batches: list[SweepBatch]) -> Any:
    return np.concatenate([batch.status for batch in batches])


@pytest.mark.parametrize(
    "values", [(50.0,), (51.14, 51.15), (51.06, 51.11), (32.76,), (65.533,), (30.0,), (13.0 - 1e-4,)], ids=str
)
def test_a_pile_at_the_most_that_a_log_holds_is_no_return(values: tuple[float, ...]) -> None:
    ranges = driven(values)
    batches, report = judged(far(ranges))
    piled = ranges > 12.5
    assert (statuses(batches)[piled] == NO_RETURN).all()
    assert (statuses(batches)[~piled] == Status.VALID.value).all()
    assert report.no_return == {"/scan": pytest.approx(min(values), abs=1e-5)}
    [note] = report.doubted()
    value = f"{min(values):g} m" if len(values) == 1 else f"{values[0]:g} to {values[1]:g} m"
    assert note == (f"/scan: {piled.mean():.1%} of the beams end at {value}, the most there is: taken as no return")


def test_stray_values_about_a_pile_do_not_hide_it() -> None:
    ranges = driven()
    ranges[::50, 7] = 50.3
    ranges[5::60, 99] = 49.7
    batches, report = judged(far(ranges))
    assert report.no_return == {"/scan": 50.0}
    assert (statuses(batches) == NO_RETURN).tolist() == (ranges >= 50.0).tolist()


def test_a_second_pile_below_the_first_is_one_too() -> None:
    ranges = driven((30.0, 50.0))
    batches, report = judged(far(ranges))
    assert report.no_return == {"/scan": 30.0}
    assert "30 to 50 m" in report.doubted()[0]
    assert (statuses(batches) == NO_RETURN).tolist() == (ranges >= 30.0).tolist()


def test_whoever_names_what_is_no_return_gets_that() -> None:
    ranges = driven()
    words = RangeRules().no_return - {"pile"}
    batches, report = judged(far(ranges), rules=RangeRules(words))
    assert (statuses(batches) == Status.VALID.value).all()
    assert not report.no_return
    assert not report.doubts
    for rules in (RangeRules(markers=(50.0,)), RangeRules(limits=(0.0, 50.0)), RangeRules(limits=(0.0, 40.0))):
        batches, report = judged(far(ranges), rules=rules)
        assert (statuses(batches) == NO_RETURN).tolist() == (ranges >= 50.0).tolist()
        assert not report.doubts


@pytest.mark.parametrize("size", [pytest.param(1, marks=pytest.mark.slow), 7, 1000])
def test_neither_blocks_nor_batches_matter(size: int) -> None:
    """A pile that comes late counts from its window of sweeps on."""
    ranges = np.concatenate([driven(share=0.0, sweeps=2 * WINDOW), driven(seed=2)])
    ranges[40::300, 3] = 50.0
    whole = far(ranges)
    blocks = [whole.rows(slice(at, at + size)) for at in range(0, len(whole), size)]
    batches, report = judged(*blocks, batch_size=max(size, 5))
    expected, told = judged(whole)
    assert statuses(batches).tolist() == statuses(expected).tolist()
    assert report == told
    piled = (ranges == 50.0) & (np.arange(len(ranges)) >= 2 * WINDOW)[:, None]
    assert (statuses(batches) == NO_RETURN).tolist() == piled.tolist()
    assert report.doubted()[0].startswith(f"/scan: from sweep {2 * WINDOW} on, 3.6% ")


def test_sweeps_that_are_left_out_do_not_matter() -> None:
    whole = far(np.concatenate([driven(), driven(share=0.0, seed=2)]))
    every, report = judged(whole, every=100, start=2.0)
    assert report.no_return == {"/scan": 50.0}
    expected = statuses(judged(whole)[0])
    assert statuses(every).tolist() == expected[100::100].tolist()


def test_each_topic_has_its_own() -> None:
    first, second = far(driven((50.0,)), topic="/a"), far(driven((30.0,), seed=3), topic="/b")
    _, report = judged(first, second)
    assert report.no_return == {"/a": 50.0, "/b": 30.0}
    assert len(report.doubted()) == 2


def test_windows_are_bounded_by_their_ranges() -> None:
    """Sweeps of many beams wait in no greater number than there is room for."""
    beams = WINDOW_VALUES // 40
    ranges = np.random.default_rng(1).uniform(2.0, 10.0, (81, beams)).astype(np.float32)
    ranges[40:, ::7] = 50.0
    ranges[41::3, ::7] = 5.0
    _, report = judged(raw_sweeps(ranges, range_max=80.0))
    assert report.doubted()[0].startswith("/scan: from sweep 40 on, ")


def noisy(ranges: Any, sigma: float, step: float, seed: int = 1) -> Float32:
    noise = np.random.default_rng(seed).normal(0.0, sigma, np.shape(ranges))
    return (np.round((ranges + noise) / step) * step).astype(np.float32)


def square(yaw: Any, side: float = 8.0) -> Any:
    """(S, B) ranges from the middle of a square room, by the direction of the sensor (S,)."""
    bearing = np.asarray(yaw)[:, None] + np.linspace(0.0, 2 * np.pi, BEAMS, endpoint=False)
    return 0.5 * side / np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing)))


def tank(sigma: float, step: float) -> Float32:
    """A standing sensor in a round tank; somebody walks about in it, and in the end stands still."""
    ranges = noisy(np.full((SWEEPS, BEAMS), 2.0), sigma, step)
    for sweep in range(SWEEPS):
        first = min(sweep, 200) % (BEAMS - 20)
        ranges[sweep, first : first + 20] = 1.2
    return ranges


def wall(sigma: float, step: float) -> Float32:
    """A parked sensor before a wall far away, and things that come and go between."""
    bearing = np.linspace(-0.6, 0.6, BEAMS)
    ranges = noisy(np.tile(18.0 / np.cos(bearing), (SWEEPS, 1)), sigma, step)
    hidden = np.random.default_rng(2).random((SWEEPS, BEAMS)) < 0.3
    ranges[hidden] = 3.0
    return ranges


@pytest.mark.parametrize("step", [1e-6, 0.001, 0.01])
@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.005, 0.01])
@pytest.mark.parametrize(
    "room",
    [
        tank,
        wall,
        lambda sigma, step: noisy(square(np.zeros(SWEEPS)), sigma, step),
        lambda sigma, step: noisy(square(0.01 * np.arange(SWEEPS)), sigma, step),
        lambda sigma, step: noisy(square(np.arange(SWEEPS) * np.pi / BEAMS), sigma, step),
    ],
    ids=["tank", "wall", "parked", "turning", "turning by beams"],
)
def test_walls_are_no_pile(room: Callable[[float, float], Float32], sigma: float, step: float) -> None:
    batches, report = judged(far(room(sigma, step)))
    assert not report.no_return
    assert not report.doubts
    assert (statuses(batches) == Status.VALID.value).all()


def test_a_few_sweeps_are_not_enough() -> None:
    _, report = judged(far(driven(sweeps=15)))
    assert not report.no_return


def test_one_beam_is_not_enough() -> None:
    """A beam that always tells the same, as of a part of the robot that some program has cut out."""
    ranges = driven(share=0.0)
    ranges[::2, -1] = 50.0
    _, report = judged(far(ranges))
    assert not report.no_return


def around(ranges: Float32) -> RawSweeps:
    return replace(far(ranges), angle_increment=np.full(len(ranges), 2 * np.pi / BEAMS))


def hall(yaw: Any, end: float = 20.0, half: float = 2.0) -> Any:
    """(S, B) ranges in a straight hall that is longer than a sensor sees, by the direction of the sensor (S,)."""
    bearing = np.asarray(yaw)[:, None] + np.linspace(0.0, 2 * np.pi, BEAMS, endpoint=False)
    return np.minimum(half / np.maximum(np.abs(np.sin(bearing)), 1e-9), end)


@pytest.mark.parametrize("step", [1e-6, 0.001, 0.01])
@pytest.mark.parametrize("limit", [5.6, 12.0])
@pytest.mark.parametrize("turn", [0.0, 0.002])
def test_arcs_about_the_sensor_are_a_pile(turn: float, limit: float, step: float) -> None:
    """Where nothing comes and goes: no wall keeps its distance over so wide a view."""
    ranges = np.minimum(noisy(hall(turn * np.arange(60)), 0.01, step), np.float32(limit))
    batches, report = judged(around(ranges))
    assert report.no_return == {"/scan": pytest.approx(limit)}
    assert (statuses(batches) == NO_RETURN).tolist() == (ranges == np.float32(limit)).tolist()


@pytest.mark.parametrize("sigma", [0.0, 0.002])
@pytest.mark.parametrize("step", [1e-6, 0.001, 0.01])
@pytest.mark.parametrize("end", [5.6, 12.0, 30.0])
def test_the_end_of_a_hall_is_no_pile(end: float, step: float, sigma: float) -> None:
    bearing = np.linspace(0.0, 2 * np.pi, BEAMS, endpoint=False)
    ends = end / np.maximum(np.abs(np.cos(bearing)), 1e-9)
    ranges = noisy(np.minimum(hall(np.zeros(60), 1e3), ends), sigma, step)
    batches, report = judged(around(ranges))
    assert not report.doubts
    assert (statuses(batches) == Status.VALID.value).all()


def test_what_a_few_sweeps_pass_is_nearly_the_most() -> None:
    ranges = driven()
    ranges[::50, 7] = 50.3
    assert ", nearly the most there is: " in judged(far(ranges))[1].doubted()[0]


def along(value: float = 29.0, beam: int = 45, sweeps: int = 60, speed: float = 0.05) -> Float32:
    """A sensor that is driven along a room, with a beam that always tells the same."""
    bearing = np.linspace(0.0, 2 * np.pi, BEAMS, endpoint=False)
    ahead = 8.0 - speed * np.arange(sweeps)[:, None]
    front = np.where(np.cos(bearing) > 0, ahead, 16.0 - ahead) / np.maximum(np.abs(np.cos(bearing)), 1e-9)
    ranges = noisy(np.minimum(front, 3.0 / np.maximum(np.abs(np.sin(bearing)), 1e-9)), 0.01, 0.001)
    ranges[:, beam] = value
    return ranges


@pytest.mark.parametrize("beam", [0, 45, BEAMS - 1])
def test_a_beam_that_tells_the_same_wherever_the_robot_goes_is_no_return(beam: int) -> None:
    ranges = along(beam=beam)
    batches, report = judged(far(ranges))
    assert (statuses(batches) == NO_RETURN).tolist() == (ranges == 29.0).tolist()
    assert report.no_return == {}
    assert report.doubted() == [f"/scan: beam {beam} is 29 m wherever the robot goes: taken as no return"]
    batches, report = judged(far(ranges), rules=RangeRules(RangeRules().no_return - {"pile"}))
    assert (statuses(batches) == Status.VALID.value).all()
    assert not report.doubts


def test_a_beam_counts_from_the_window_on_in_which_it_is_found() -> None:
    ranges = along(sweeps=2 * WINDOW, speed=0.01)
    ranges[:WINDOW:2, 45] = 3.0
    batches, report = judged(*(far(ranges).rows(slice(at, at + 100)) for at in range(0, len(ranges), 100)))
    assert (statuses(batches) == NO_RETURN).nonzero()[0].tolist() == [*range(WINDOW, 2 * WINDOW)]
    assert report.doubted()[0].startswith(f"/scan: from sweep {WINDOW} on, beam 45 is 29 m ")


@pytest.mark.parametrize(
    "ranges",
    [
        along(speed=0.0),
        along(value=0.4),
        along(value=3.0),
        along(beam=slice(20, 60, 8)),  # type: ignore[arg-type]
        np.tile(along()[:1], (60, 1)),
        along(sweeps=36),
    ],
    ids=["parked", "of the robot", "the wall", "many", "constant", "short"],
)
def test_what_stays_the_same_may_be_measured(ranges: Float32) -> None:
    batches, report = judged(far(ranges))
    # Sweeps that are equal to the last bit are of a sensor that hangs.
    hangs = bool((ranges == ranges[0]).all())
    assert [each.id for each in report.findings()] == ["observed"] * hangs
    assert (statuses(batches) == Status.VALID.value).all()


def test_a_limit_of_the_log_that_takes_measurements_away_is_told() -> None:
    ranges = driven(share=0.0)
    _, report = judged(raw_sweeps(ranges, range_max=8.0))
    share = float(np.mean(ranges[np.r_[:256:4, 256:300:4]] > 8.0))
    assert report.doubted() == [
        f"/scan: {share:.1%} of the beams are beyond the greatest range of 8 m that the log tells, but look like "
        "measurements; --range 0 12 takes them"
    ]
    _, report = judged(raw_sweeps(ranges, range_max=8.0), rules=RangeRules(limits=(0.0, 8.0)))
    assert not report.doubts
    _, report = judged(raw_sweeps(ranges, range_max=11.9))
    assert not report.doubts


def test_one_value_beyond_the_limit_is_what_a_driver_writes() -> None:
    ranges = driven((81.91,))
    batches, report = judged(far(ranges))
    assert not report.doubts
    assert (statuses(batches) == NO_RETURN).tolist() == (ranges > 80).tolist()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("piles") / "run.mcap"
    write_mcap(path, [far(driven())])
    return path


@pytest.mark.slow
def test_every_way_to_read_a_log_says_the_same(log: Path, tmp_path: Path) -> None:
    piled = int(np.count_nonzero(driven() == 50.0))
    with pytest.warns(UserWarning, match="end at 50 m"):
        batches = list(lidarcli.read(log))
    assert np.count_nonzero(statuses(batches) == NO_RETURN) == piled
    assert lidarcli.info(log)[0]["scans"][0]["beams_by_status"]["no_return"] == piled
    assert run(["-q", "detect", str(log), "-o", str(tmp_path)]) == 0
    table = pq.read_table(tmp_path / "run.sweeps.parquet")
    assert sum(table["no_return"].to_pylist()) == piled
    assert json.loads(table.schema.metadata[b"lidarcli.source"])["no_return_from"] == {"/scan": 50.0}


@pytest.mark.parametrize("name", ["run.csv", "run.log"])
def test_any_container_has_piles(name: str, tmp_path: Path) -> None:
    block = replace(far(driven((30.0,))), range_min=np.zeros(SWEEPS, np.float32))
    path = tmp_path / name
    write_csv(path, [block]) if name.endswith("csv") else write_carmen(path, [block])
    with pytest.warns(UserWarning, match="end at 30 m"):
        batches = list(lidarcli.read(path))
    assert (statuses(batches) == NO_RETURN).tolist() == (block.ranges == 30.0).tolist()
