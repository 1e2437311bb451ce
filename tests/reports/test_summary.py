"""The figures of a run against values computed by hand and by slow loops."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from lidarcli.reports import figures
from lidarcli.reports.columns import Origin, Rows, Run
from lidarcli.reports.figures import density, nice_edges
from lidarcli.reports.report import Report
from lidarcli.reports.run import RunPart
from lidarcli.reports.summary import summarise
from lidarcli.reports.text import as_text as render
from tests.reports.runs import START, TENTH, run_of, sweep, thing


def test_every_figure_has_its_name() -> None:
    assert list(summarise(run_of([sweep(0)])).figures) == figures.names()


def test_numbers_of_single_precision_are_the_decimals_that_they_stand_for() -> None:
    values = [0.08, -12.345678, 1 / 3, 1e-9, None, 7654321.5, 300.3]
    rows = Rows.join([pa.table({"r": pa.array(values, pa.float32()), "t": pa.array(values)})])
    single = [np.nan if value is None else float(np.float32(value)) for value in values]
    exact = [0.08, -12.345678, single[2], single[3], np.nan, 7654321.5, 300.3]
    np.testing.assert_array_equal(rows.numbers("r"), exact)
    np.testing.assert_array_equal(rows.numbers("r").astype(np.float32), np.array(single, np.float32))
    np.testing.assert_array_equal(rows.numbers("t"), [np.nan if value is None else value for value in values])


def test_figures_of_a_small_run() -> None:
    counts = [2, 0, 1, 3]
    objects = [thing(k, n + 1, width=0.1 * (n + 1)) for k, count in enumerate(counts) for n in range(count)]
    run = run_of([sweep(k, count) for k, count in enumerate(counts)], [*objects, thing(0, 9, set="S", shape="wall")])
    found = summarise(run)
    wanted = {
        "logs": 1,
        "topics": 1,
        "sweeps": 4,
        "objects": 6,
        "beams": 400,
        "valid_share": 0.99,
        "no_return_share": 0.01,
        "object_share": 30 / 400,
        "noise_share": 370 / 400,
        "duration": 0.3,
        "rate": 10.0,
        "gaps": 0,
        "longest_gap": 0.0,
        "objects_per_sweep.mean": 1.5,
        "objects_per_sweep.min": 0,
        "objects_per_sweep.max": 3,
        "objects_per_sweep.std": np.std(counts),
        "objects_per_sweep.p95": np.percentile(counts, 95),
        "width.mean": np.mean([0.1, 0.2, 0.1, 0.1, 0.2, 0.3]),
        "width.max": 0.3,
        "noise.p50": 0.01,
        "d_th.mean": 0.1,
        "shape.prismatic": 6,
        "visibility.full": 6,
        "difference.mean": None,
    }
    for name, value in wanted.items():
        assert found.figures[name] == (value if value is None else pytest.approx(value)), name
    assert found.kinds["shape"] == {"prismatic": 6}
    assert found.status == {"valid": 396, "no_return": 4, "too_close": 0, "invalid": 0, "masked": 0}
    assert found.sets == {"O": 30, "A": 0, "S": 370}
    assert found.histograms["objects_per_sweep"].counts.tolist() == [1, 1, 1, 1]
    assert all(one.counts.sum() == 6 for name, one in found.histograms.items() if name != "objects_per_sweep")


def test_clock_faults() -> None:
    steps = [1, 1, 3, 1, -2, 1, 0, 1]
    stamps = START + TENTH * np.concatenate([[0], np.cumsum(steps)])
    run = run_of([sweep(k, stamp=int(stamp)) for k, stamp in enumerate(stamps)])
    stream = summarise(run).streams.all[0]
    assert (stream.gaps, stream.missing, stream.backward, stream.repeated) == (1, 2, 1, 1)
    assert stream.longest_gap == pytest.approx(0.3)
    assert stream.rate == pytest.approx(10.0)
    assert stream.duration == pytest.approx(0.6)


def test_every_tenth_sweep_has_no_gaps() -> None:
    stream = summarise(run_of([sweep(k) for k in range(0, 100, 10)])).streams.all[0]
    assert (stream.gaps, stream.rate) == (0, pytest.approx(10.0))


def test_topics_and_frames_have_clocks_of_their_own() -> None:
    rows = [sweep(k, topic=topic, frame_id=frame) for topic, frame in (("/a", "x"), ("/b", "x")) for k in range(3)]
    rows += [sweep(3 + k, topic="/b", frame_id="y", stamp=START + TENTH * 50 * k) for k in range(2)]
    streams = summarise(run_of(rows)).streams.all
    assert [(one.topic, one.frame_id, one.sweeps, one.gaps, one.backward) for one in streams] == [
        ("/a", "x", 3, 0, 0),
        ("/b", "x", 3, 0, 0),
        ("/b", "y", 2, 0, 0),
    ]


def test_logs_add_up() -> None:
    one = run_of([sweep(0, 1), sweep(5, 2)], [thing(0, 1), thing(5, 1), thing(5, 2)])
    other = run_of([sweep(0, 1, log="b")], [thing(0, 1, log="b", shape="round")])
    sources = (Origin("a", "run"), Origin("b", "b", damage=("byte 5: cut",)))
    run = Run(
        sources, Rows.join([one.sweeps.table, other.sweeps.table]), Rows.join([one.objects.table, other.objects.table])
    )
    found = summarise(run)
    assert [found.figures[name] for name in ("logs", "sweeps", "objects", "damage")] == [2, 3, 4, 1]
    assert found.figures["duration"] == pytest.approx(0.5)
    assert found.kinds["shape"] == {"prismatic": 3, "round": 1}
    assert [stream.log for stream in found.streams.all] == ["run", "b"]


def test_sweeps_that_stand_out() -> None:
    rows = [sweep(k, 2) for k in range(10)]
    rows[4] |= {"objects": 7}
    rows[6] |= {"objects": 0, "valid": 40}
    for row in rows[8:]:
        row["stamp"] += 10 * TENTH
    found = {(one.kind, one.sweep, one.words) for one in summarise(run_of(rows)).outliers}
    assert found >= {
        ("most_objects", 4, "7"),
        ("fewest_objects", 6, "0"),
        ("most_lost", 6, "60.0 %"),
        ("longest_gap", 8, "1.1 s"),
    }


def test_nothing_stands_out_where_all_sweeps_are_alike() -> None:
    run = run_of([sweep(k, 2, valid=100, no_return=0) for k in range(5)])
    assert summarise(run).outliers == []


def test_the_course_has_the_means_of_its_bins() -> None:
    objects = [k % 7 for k in range(250)]
    run = run_of([sweep(k, count, noise=None if k < 3 else 0.02) for k, count in enumerate(objects)])
    course = summarise(run).streams.all[0].course
    assert len(course.seconds) == 100
    begins = [*course.sweep.tolist(), 250]
    for index, (low, high) in enumerate(pairwise(begins)):
        assert course.objects_mean[index] == pytest.approx(np.mean(objects[low:high]))
        assert course.objects_max[index] == max(objects[low:high])
        assert course.seconds[index] == pytest.approx(low / 10)
    assert np.isnan(course.noise[0])
    assert course.noise[-1] == pytest.approx(0.02)


def test_a_map_counts_points_in_their_cells() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-2, 3, 500), rng.uniform(0, 1, 500)
    found = density("sensor", lambda axis: (x, y)[axis].copy())
    assert found is not None
    slow = np.zeros_like(found.counts)
    for a, b in zip(x, y, strict=True):
        i, j = int(np.floor((a - found.x0) / found.cell)), int(np.floor((b - found.y0) / found.cell))
        if 0 <= i < slow.shape[0] and 0 <= j < slow.shape[1]:
            slow[i, j] += 1
    assert np.abs(slow - found.counts).sum() <= 2
    assert found.counts.sum() >= 490


@pytest.mark.parametrize("values", [[0.0], [3.0, 3.0], [-5.0, -2.0], [1e-9, 2e-9], [], [np.nan]])
def test_edges_hold_the_values(values: list[float]) -> None:
    edges = nice_edges(np.array(values))
    assert len(edges) >= 2
    assert (np.diff(edges) > 0).all()
    there = [value for value in values if np.isfinite(value)]
    assert not there or edges[0] <= min(there) <= max(there) <= edges[-1] + 1e-12


def test_an_empty_run() -> None:
    found = summarise(run_of([]))
    assert found.figures["sweeps"] == 0
    assert found.figures["valid_share"] is None
    assert found.outliers == []
    assert found.densities == ()


def standing(kind: str, *rows: dict[str, Any]) -> list[tuple[str, int, str]]:
    found = summarise(run_of(rows)).outliers
    return [(one.topic, one.sweep, one.words) for one in found if one.kind == kind]


def test_sweeps_that_stand_out_are_apart() -> None:
    """Of sweeps that are alike without a break only the first stands out, and none is next to another."""
    counts = [2] * 30 + [9] * 20 + [2] * 30 + [7, 8, 7] + [2] * 37
    rows = [sweep(k, count) for k, count in enumerate(counts)]
    assert standing("most_objects", *rows) == [("/scan", 30, "9"), ("/scan", 81, "8")]
    # Ties that are far from each other are all of them news.
    rows = [sweep(k, 9 if k in (10, 11, 60, 90) else 2) for k in range(100)]
    assert standing("most_objects", *rows) == [("/scan", 10, "9"), ("/scan", 60, "9"), ("/scan", 90, "9")]
    assert standing("fewest_objects", *rows) == []


def test_of_several_topics_each_has_one_sweep_that_stands_out() -> None:
    rows = [
        sweep(k, (5 + number if k % 7 == number else 2), topic=topic)
        for number, topic in enumerate(("/a", "/b", "/c", "/d"))
        for k in range(50)
    ]
    assert standing("most_objects", *rows) == [("/d", 3, "8"), ("/c", 2, "7"), ("/b", 1, "6")]


def test_sweeps_that_stand_out_fit_a_terminal_whatever_logs_are_called() -> None:
    long = "a_log_whose_name_is_longer_than_half_of_a_terminal_is"
    runs = [
        run_of([sweep(k, 9 if k == number + 3 else 2, log=log) for k in range(9)]) for number, log in enumerate((long, "b"))
    ]
    # The other log goes on over midnight.
    (rest,) = [run_of([sweep(k, 8 if k == 1 else 2, log="b", stamp=START + k * 10**14) for k in range(2)])]
    tables = [run.sweeps.table for run in runs]
    tables[1] = pa.concat_tables([tables[1].slice(0, 8), rest.sweeps.table.slice(1)]).unify_dictionaries()
    run = Run((Origin("a", long), Origin("b", "b")), Rows.join(tables), Rows.join([run.objects.table for run in runs]))
    text = render(Report((RunPart(summarise(run)),)))
    lines = text[text.index("Sweeps that stand out") :].splitlines()
    assert max(map(len, lines)) <= 80
    first, other = lines.index(f"{long} /scan"), lines.index("b /scan")
    assert lines[first + 1].split() == ["value", "sweep", "2023-11-14"]
    assert lines[first + 2].split() == ["most", "objects", "9", "3", "22:13:20.300Z"]
    assert lines[other + 1].split() == ["value", "sweep", "stamp"]
    assert lines[other + 2].split() == ["most", "objects", "9", "4", "2023-11-14T22:13:20.400Z"]
