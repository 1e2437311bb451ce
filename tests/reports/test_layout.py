"""Where the panels of a picture stand: scenes of any form fill their place, and pictures are as wide as they should be."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from lidarcli.choices import Look
from lidarcli.formalism import Parameters
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.plotting import PlotOptions, take_pictures
from lidarcli.reports import drawing
from lidarcli.reports.picture import Picture, limits_of
from tests.places import SAMPLES


def sample(name: str, number: int) -> Picture:
    (source,) = find_logs([str(SAMPLES / name)])
    assert isinstance(source, Source)
    options = PlotOptions((number,), parameters=Parameters.for_profile("robust"))
    return take_pictures(source, options).pictures[0]


def laid_out(one: Picture, view: str, look: Look) -> Figure:
    with drawing.project_style():
        figure = drawing.new_figure(drawing.width_of(view, look))
        drawing.draw_whole(figure, one, view, limits_of([one]), look)
    return figure


def used(figure: Figure) -> float:
    """The share of its place that the scene fills."""
    place, box = (figure.axes[0].get_position(original=which) for which in (True, False))
    return (box.width * box.height) / (place.width * place.height)


@pytest.mark.parametrize(
    ("name", "number", "width", "stacked"),
    [
        ("corridor.bag", 3, None, True),
        ("people.csv.gz", 34, None, False),
        ("room.mcap", 50, None, False),
        ("people.csv.gz", 34, 84.0, True),
    ],
)
def test_a_scene_fills_its_place(name: str, number: int, width: float | None, stacked: bool) -> None:
    figure = laid_out(sample(name, number), "all", Look(width))
    assert figure.get_size_inches()[0] == pytest.approx(7.2 if width is None else width / 25.4)
    assert used(figure) > 0.93
    scene, curve, _ = (axes.get_position() for axes in figure.axes)
    assert (curve.y1 < scene.y0) == stacked
    assert (curve.x0 > scene.x1) == (not stacked)


@pytest.mark.parametrize(("name", "number"), [("corridor.bag", 3), ("people.csv.gz", 0), ("hall", 5)])
def test_a_scene_alone_is_cropped_to_its_content(name: str, number: int) -> None:
    one = sample(name, number)
    figure = laid_out(one, "scene", Look(120.0))
    assert used(figure) > 0.99
    bare = laid_out(one, "scene", Look(120.0, title=False, legend=False))
    assert bare.get_size_inches()[0] == figure.get_size_inches()[0]
    assert bare.get_size_inches()[1] < figure.get_size_inches()[1]
    # The scene is as large without title and legend.
    sizes = [axes.get_window_extent().size for axes in (figure.axes[0], bare.axes[0])]
    assert sizes[0] == pytest.approx(sizes[1], abs=2.0)


@pytest.mark.slow
@pytest.mark.parametrize("view", ["all", "scene", "polar", "sweep", "difference"])
@pytest.mark.parametrize("width", [60.0, 90.0, 200.0])
def test_nothing_stands_outside_of_the_picture(view: str, width: float) -> None:
    figure = laid_out(sample("people.csv.gz", 34), view, Look(width))
    (legend,) = figure.legends
    title = figure._suptitle
    assert title is not None
    for box in (legend.get_window_extent(), title.get_window_extent()):
        assert box.x0 >= 0.0
        assert box.x1 <= figure.bbox.width + 1.0
        assert box.y0 >= 0.0
        assert box.y1 <= figure.bbox.height + 1.0
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    assert all(box is not None and box.x0 > -1.0 and box.x1 < figure.bbox.width + 1.0 for box in boxes)
    assert np.all([box is not None and box.y0 >= legend.get_window_extent().y1 - 1.0 for box in boxes])
