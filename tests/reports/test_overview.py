"""Pictures from above: the run by its tables, also in the HTML report, and a background."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidarcli import background
from lidarcli.formalism.background import Background
from lidarcli.reports.columns import Rows, Run
from lidarcli.reports.drawing import project_style
from lidarcli.reports.map_picture import MAX_POINTS, MapPicture, background_figure, draw_backgrounds, overview, paths_of
from lidarcli.tabular.schemas import SWEEPS
from tests.places import SAMPLES
from tests.reports.runs import run_of, sweep, table, thing, track
from tests.reports.test_world import driving

Words = Callable[..., Any]


def seen(run: Run) -> MapPicture:
    found = overview(run.sweeps, run.tracks, run.trajectories)
    assert found is not None
    return found


def placed(count: int = 6, **other: Any) -> list[dict[str, Any]]:
    """Sweeps of a sensor that drives along x."""
    return [sweep(k, pose_x=0.5 * k, pose_y=1.0, pose_yaw=0.0, **other) for k in range(count)]


def test_path_and_boxes() -> None:
    found = seen(driving())
    (path,) = found.paths
    assert path == pytest.approx(np.column_stack([0.3 * np.arange(5), 0.1 * np.arange(5)]))
    (box,) = found.boxes
    assert (box.x, box.y, box.yaw, box.length, box.width, box.name) == (2.1, 0.0, 0.5, 0.4, 0.2, "7")
    assert (found.agents, found.grid, found.snapshot) == ([], None, None)


def test_without_poses() -> None:
    for run in (run_of([sweep(0), sweep(1)], [thing(0, 1, track=1)], [track(1)]), run_of([])):
        assert paths_of(run.sweeps) == []
        assert overview(run.sweeps, run.tracks, run.trajectories) is None


def test_sweeps_without_a_pose_are_left_out_and_the_rest_is_in_order() -> None:
    sweeps = placed()
    sweeps[2] = sweep(2)
    (path,) = seen(run_of(sweeps[::-1])).paths
    assert path[:, 0].tolist() == [0.0, 0.5, 1.5, 2.0, 2.5]


def test_each_topic_has_its_path() -> None:
    sweeps = [*placed(topic="/front"), *(one | {"pose_y": 2.0} for one in placed(topic="/rear"))]
    found = seen(run_of([*sweeps, sweep(0, topic="/third")]))
    assert [path[:, 1].tolist() for path in found.paths] == [[1.0] * 6, [2.0] * 6]


def test_boxes_of_what_stands_long_enough() -> None:
    tracks = [
        track(1, label="pallet"),
        track(2, sweeps=4),
        track(3, sweeps=5),
        track(4, x=None),
        track(5, length=None),
        track(6, set="A"),
    ]
    found = seen(run_of(placed(20), [], tracks))
    assert [box.name for box in found.boxes] == ["1 pallet", "3"]
    # Of a short run half of its sweeps are enough.
    found = seen(run_of(placed(4), [], [track(1, sweeps=2), track(2, sweeps=1)]))
    assert [box.name for box in found.boxes] == ["1"]


def walking(number: int, y: float, sweeps: range, **other: Any) -> list[dict[str, Any]]:
    """Two legs of who walks along x."""
    return [
        thing(k, 10 * number + leg, set="A", track=number, world_x=0.1 * k + 0.2 * leg, world_y=y, **other)
        for k in sweeps
        for leg in (0, 1)
    ]


def test_ways_of_what_moved() -> None:
    objects = [*walking(2, 3.0, range(5)), *walking(5, 4.0, range(2, 4)), thing(0, 9, track=1, world_x=9.0, world_y=9.0)]
    objects.append(thing(5, 1, set="A", track=2))
    found = seen(run_of(placed(), objects, [track(1), track(2, set="A"), track(5, set="A"), track(8, set="A")]))
    assert [number for number, *_ in found.agents] == [2, 5]
    (_, early), (_, late) = found.agents
    # The middle of both legs, as the trajectories have it; without a place in the world there is no point.
    assert early == pytest.approx(np.column_stack([0.1 + 0.1 * np.arange(5), [3.0] * 5]))
    assert late[:, 0] == pytest.approx([0.3, 0.4])


def test_the_same_number_of_two_topics() -> None:
    sweeps = [*placed(topic="/front"), *placed(topic="/rear")]
    objects = [*walking(1, 3.0, range(3), topic="/front"), *walking(1, 5.0, range(4), topic="/rear")]
    tracks = [track(1, topic="/front", set="A"), track(1, topic="/rear", set="A")]
    found = seen(run_of(sweeps, objects, tracks))
    assert [(number, len(path), path[0, 1]) for number, path in found.agents] == [(1, 3, 3.0), (1, 4, 5.0)]
    # A topic of which there is no object.
    found = seen(run_of(sweeps, objects, [*tracks, track(1, topic="/third", set="A")]))
    assert len(found.agents) == 2


def test_long_ways_are_thinned_out() -> None:
    count = 3 * MAX_POINTS
    k = np.arange(count)
    sweeps = table(SWEEPS, [sweep(0)]).take([0] * count)
    for name, values in (("sweep", k), ("pose_x", 0.1 * k), ("pose_y", 0.0 * k)):
        at = sweeps.schema.get_field_index(name)
        sweeps = sweeps.set_column(at, sweeps.schema.field(at), [values])
    found = overview(Rows.join([sweeps]), None, None)
    assert found is not None
    ((x, _),) = (path.T for path in found.paths)
    assert (len(x), x[0], x[-1]) == (MAX_POINTS, 0.0, pytest.approx(0.1 * (count - 1)))
    assert np.diff(x).min() > 0


def page(lidarcli: Words, folder: Path, *tables: Path) -> str:
    out = folder / "report.html"
    assert lidarcli("report", *tables, "-o", out, "--overwrite") == (0, "")
    return out.read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "is_posed"), [("drive.db3", True), ("room.mcap", False)])
def test_the_report_has_a_map_where_there_are_poses(lidarcli: Words, tmp_path: Path, name: str, is_posed: bool) -> None:
    for command in ("detect", "track"):
        assert lidarcli(command, SAMPLES / name, "-o", tmp_path / command) == (0, "")
        tables = tmp_path / command / f"{name.partition('.')[0]}.objects.parquet"
        text = page(lidarcli, tmp_path, tables)
        found = re.findall(r'<section id="map">(.*?)</section>', text, re.DOTALL)
        assert [one.count("<svg") for one in found] == [1] * is_posed
        assert ["what stands" in one for one in found] == [command == "track"] * is_posed
        assert page(lidarcli, tmp_path, tables) == text


@pytest.mark.slow
def test_a_report_of_several_logs_has_none(lidarcli: Words, tmp_path: Path) -> None:
    """Every log has a world of its own."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.db3").write_bytes((SAMPLES / "drive.db3").read_bytes())
        assert lidarcli("track", tmp_path / f"{name}.db3", "-o", tmp_path / "tables", "--end", 3) == (0, "")
    text = page(lidarcli, tmp_path, tmp_path / "tables")
    assert '<section id="map">' not in text
    assert text.rstrip().endswith("</html>")
    assert '<section id="map">' in page(lidarcli, tmp_path, tmp_path / "tables" / "a.objects.parquet")


@pytest.mark.slow
def test_ids_of_the_page_are_each_there_once(lidarcli: Words, tmp_path: Path) -> None:
    """The picture is an SVG in the page: its ids must not be those of the other pictures."""
    assert lidarcli("track", SAMPLES / "drive.db3", "-o", tmp_path / "tables") == (0, "")
    text = page(lidarcli, tmp_path, tmp_path / "tables" / "drive.objects.parquet")
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert sorted(one for one in set(ids) if ids.count(one) > 1) == []


@pytest.fixture(scope="module")
def people() -> Background:
    (sensor,) = background(SAMPLES / "people.csv.gz")
    return sensor


def drawn(sensor: Background) -> Figure:
    with project_style():
        figure = background_figure([sensor])
        FigureCanvasAgg(figure).draw()
    return figure


def test_the_colour_bar_is_as_high_as_its_plot_and_shows_what_occurs(people: Background) -> None:
    axes = drawn(people).axes[0]
    (points,) = axes.collections
    support = people.support[np.isfinite(people.r_e)]
    assert (round(float(support.min()), 2), float(support.max())) == (0.4, 1.0)
    assert points.get_clim() == (0.4, 1.0)
    (bar,) = axes.child_axes
    assert bar.get_ylabel() == "share of the sweeps that saw $r_e$"
    assert bar.get_ylim() == (0.4, 1.0)
    beside, plot = bar.get_window_extent(), axes.get_window_extent()
    assert (beside.y0, beside.y1) == pytest.approx((plot.y0, plot.y1), abs=1.0)
    assert [text.get_text() for text in bar.get_yticklabels()][-1] == "100%"


def test_no_sensor_at_all_is_an_empty_picture() -> None:
    assert draw_backgrounds([], ".png").startswith(b"\x89PNG")
