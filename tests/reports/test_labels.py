"""Labels of pictures: none on another, near to what they name, the same each time."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidarcli.reports.drawing import Label, Labels, draw_panel, line_to, place_labels, project_style
from lidarcli.reports.scene import scene
from lidarcli.sweeps.types import Float64
from tests.reports.test_picture import sample

VIEW = np.array([0.0, 0.0, 200.0, 200.0])
NOTHING = np.empty((0, 2))


def at(x: float, y: float) -> Float64:
    """An object of 4 pixels."""
    return np.array([x - 2.0, y - 2.0, x + 2.0, y + 2.0])


def placed(*where: tuple[float, float], side: Any = (1.0, 0.0), drawn: Float64 = NOTHING, view: Float64 = VIEW) -> Float64:
    """Places of labels of 10 x 8 pixels of objects at some points."""
    count = len(where)
    sizes, objects = [np.array([10.0, 8.0])] * count, [at(*each) for each in where]
    return place_labels(sizes, objects, [np.array(side)] * count, drawn, view, 1.0)


def meet(one: Float64, other: Float64) -> bool:
    return bool((one[:2] < other[2:]).all() and (other[:2] < one[2:]).all())


def test_labels_of_a_crowd_do_not_meet() -> None:
    crowd = [(100.0 + 5 * column, 100.0 + 5 * row) for column in range(5) for row in range(5)]
    places = placed(*crowd)
    assert not any(meet(one, other) for one, other in combinations(places, 2))
    assert (places >= 0.0).all()
    assert (places <= 200.0).all()
    assert placed(*crowd).tolist() == places.tolist()
    # In the innermost place there is no room; a line shows whose it is.
    objects = np.array([at(*each) for each in crowd])
    lines = [line_to(place, k, objects, 1.0) for k, place in enumerate(places)]
    assert any(line is not None for line in lines)


def test_without_room_every_label_is_still_drawn() -> None:
    small = np.array([0.0, 0.0, 12.0, 10.0])
    assert placed((5, 5), (6, 5), (5, 6), view=small).shape == (3, 4)
    assert np.isfinite(placed((5, 5), (6, 5), (5, 6), view=small)).all()
    assert placed(view=small).shape == (0, 4)


SAMPLE_SWEEPS = [("people.csv.gz", 0), ("people.csv.gz", 34), ("corridor.bag", 3), ("hall", 5), ("room.mcap", 50)]


@pytest.mark.parametrize(("log", "number"), SAMPLE_SWEEPS)
@pytest.mark.parametrize("inches", [2.4, 4.5])
def test_no_two_labels_of_a_sample_meet(log: str, number: int, inches: float) -> None:
    one = sample(log, number)
    with project_style():
        figure = Figure(figsize=(inches, inches), layout="constrained")
        axes = figure.add_subplot()
        draw_panel(axes, scene(one))
        FigureCanvasAgg(figure).draw()
    (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
    assert len(labels.places) == len(one.detection) > 1
    assert not any(meet(first, second) for first, second in combinations(labels.places, 2))
    box = axes.get_window_extent()
    assert (labels.places[:, 0] >= box.x0).all()
    assert (labels.places[:, 2] <= box.x1).all()


def test_labels_follow_the_size_of_the_picture() -> None:
    figure = Figure(figsize=(3, 3))
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 10), ylim=(0, 10))
    labels = Labels([Label("a", np.array([[5.0, 5.0]])), Label("b", np.array([[5.0, 5.2]]))], [], NOTHING)
    axes.add_artist(labels)
    far = []
    for inches in (3, 6):
        figure.set_size_inches(inches, inches)
        canvas.draw()
        assert not meet(*labels.places)
        far.append(np.hypot(*(labels.places[0].reshape(2, 2).mean(axis=0) / (100.0 * inches) - 0.5)))
    # As far from its object in points, so nearer to it on the larger picture.
    assert far[1] < far[0]
    # What lies outside of a part that somebody looks at has no label there.
    axes.set(xlim=(0, 10), ylim=(5.1, 10))
    canvas.draw()
    assert len(labels.places) == 1
