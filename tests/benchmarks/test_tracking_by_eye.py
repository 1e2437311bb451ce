"""Set A against judgements by eye: the sums of a case small enough to count, and the judgements that are kept."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

from benchmarks.tracking.by_eye import LABELS, LOGS, InA, Judged, OneLog, intervals, measure_by_eye, score, shared
from benchmarks.tracking.page import page_by_eye
from benchmarks.tracking.scoring import Share

TOLD = ["topic", "sweep", "beam_i", "beam_f", "verdict", "track"]
ROWS = ["topic", "sweep", "t", "beam_i", "beam_f", "track"]


def judged(*rows: tuple[Any, ...]) -> pd.DataFrame:
    return pd.DataFrame(list(rows), columns=TOLD)


def in_a(*rows: tuple[Any, ...]) -> pd.DataFrame:
    return pd.DataFrame(list(rows), columns=ROWS)


def test_beams_in_common() -> None:
    assert shared((10, 19), (10, 19)) == 1.0
    assert shared((10, 19), (15, 24)) == pytest.approx(5 / 15)
    assert shared((10, 19), (20, 29)) == 0.0
    assert shared((350, 5), (350, 5)) == 1.0
    assert shared((350, 5), (351, 5)) == 0.0


def test_a_drawn_log_is_scored_by_row_and_by_track() -> None:
    """A walker in beams 10 to 19 and a chair in 50 to 59, in 20 sweeps; a track on each, and a brief one on nothing."""
    sweeps = range(20)
    told = judged(*(("/scan", k, 10, 19, "mover", 7) for k in sweeps), *(("/scan", k, 50, 59, "static", 8) for k in sweeps))
    walker = [("/scan", k, 0.1 * k, 11, 20, 1) for k in range(15)]
    chair = [("/scan", k, 0.1 * k, 50, 57, 2) for k in range(12)]
    brief = [("/scan", k, 0.1 * k, 80, 85, 3) for k in range(3)]
    rows = in_a(*walker, *chair, *brief)
    found = score(rows, told)
    assert found == InA(Share(15, 27), 3, Share(15, 20), Share(1, 2), 0, Share(1, 1))
    assert score(rows, told, still=True).rows == Share(15, 30)
    assert score(in_a(*chair), told) == InA(Share(0, 12), 0, Share(0, 20), Share(0, 1), 0, Share(0, 1))


def test_rows_of_another_topic_or_sweep_are_not_judged() -> None:
    told = judged(("/scan", 0, 10, 19, "mover", 1), ("/scan", 1, 30, 39, "unclear", 2))
    rows = in_a(("/rear", 0, 0.0, 10, 19, 1), ("/scan", 2, 2.0, 10, 19, 1), ("/scan", 1, 1.0, 30, 39, 1))
    assert score(rows, told) == InA(Share(), 3, Share(0, 1), Share(), 1, Share(0, 1))


def test_nothing_in_set_a() -> None:
    none = score(in_a(), judged())
    assert none.empty
    assert none == InA()


def test_intervals_draw_recordings_and_not_rows() -> None:
    """Two stretches of one recording are drawn together, and two recordings give no interval."""
    half = InA(Share(5, 10))
    stretch = OneLog("untouched", Judged("one.bag", stretch=(0, 9)), half)
    others = [OneLog("untouched", Judged(f"{name}.bag"), half) for name in ("two", "three")]
    assert intervals([stretch, stretch, others[0]])[0] is None
    low, high = intervals([stretch, *others])[0] or (0.0, 0.0)
    assert (low, high) == (0.5, 0.5)
    assert intervals([stretch, *others])[1] is None


@pytest.mark.parametrize("name", LOGS)
def test_the_kept_judgements_are_of_listed_logs(name: Any) -> None:
    table = pd.read_parquet(LABELS / f"movers_{name}.parquet")
    assert set(table["log"]) <= {each.name for each in LOGS[name]}
    assert set(table["verdict"]) == {"mover", "static", "unclear"}
    assert not table.duplicated(["log", "topic", "sweep", "beam_i", "beam_f"]).any()
    assert (LABELS / f"movers_{name}.parquet").stat().st_size < 150_000


def test_logs_that_are_not_there_are_left_out(tmp_path: Any) -> None:
    assert measure_by_eye(tmp_path / "data", ["untouched"], 1) == []


def test_the_page_says_all_of_it() -> None:
    text = page_by_eye(
        [OneLog("untouched", LOGS["untouched"][0], InA(Share(3, 4), 1, Share(3, 6), Share(1, 1), 0, Share(1, 2)))]
    )
    assert "3 of 4: 75.0 %" in text
    assert "1 of 13 logs and stretches were at hand" in text
