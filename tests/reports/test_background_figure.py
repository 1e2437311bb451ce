"""The picture of a background: where the sensor is, and the colours of support."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import lidarcli
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
