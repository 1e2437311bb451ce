"""The picture of a background: where the sensor is, and the colours of support."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle

import lidarcli
from lidarcli import palette
from lidarcli.formalism.background import Background
from lidarcli.reports.drawing import project_style
from lidarcli.reports.map_picture import background_figure, draw_backgrounds
from tests.places import SAMPLES


@pytest.fixture(scope="module")
def people() -> Background:
    (sensor,) = lidarcli.background(SAMPLES / "people.csv.gz")
    return sensor


def drawn(sensor: Background) -> Figure:
    with project_style():
        figure = background_figure([sensor])
        FigureCanvasAgg(figure).draw()
    return figure


def test_the_sensor_is_black_and_points_where_it_looks(people: Background) -> None:
    (axes,) = drawn(people).axes[:1]
    (sensor,) = (line for line in axes.lines if line.get_label() == "sensor")
    assert sensor.get_markerfacecolor() == palette.BLACK
    marker = sensor.get_marker()
    tip = MarkerStyle(marker).get_path().transformed(MarkerStyle(marker).get_transform()).vertices
    assert tip[np.argmax(np.hypot(tip[:, 0], tip[:, 1] * 0.99))] == pytest.approx([0.5, 0.0], abs=0.01)


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


def test_one_support_everywhere_is_one_end_of_the_colours() -> None:
    (sensor,) = lidarcli.background(SAMPLES / "room_empty.mcap")
    (points,) = drawn(sensor).axes[0].collections
    assert points.get_clim() == pytest.approx((0.9, 1.0))


def test_no_sensor_at_all_is_an_empty_picture() -> None:
    assert draw_backgrounds([], ".png").startswith(b"\x89PNG")
