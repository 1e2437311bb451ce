"""Labels of pictures: none on another, near to what they name, the same each time."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidarcli.formalism import Parameters
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.plotting import PlotOptions, take_pictures
from lidarcli.reports import panels
from lidarcli.reports.drawing import project_style
from lidarcli.reports.labels import Label, Labels, Rectangle, Wanted, _Counts, _Tried, add_labels, line_to, set_labels
from lidarcli.reports.panels import scene
from lidarcli.reports.picture import limits_of
from tests.places import SAMPLES

GROUND = Rectangle(0.0, 0.0, 200.0, 200.0)
NOTHING = np.empty((0, 2))


def at(x: float, y: float, half: float = 2.0) -> Rectangle:
    return Rectangle(x - half, y - half, x + half, y + half)


def wanted(x: float, y: float, way: tuple[float, float] = (1.0, 0.0)) -> Wanted:
    return Wanted(10.0, 8.0, at(x, y), way)


def test_a_label_alone_stands_on_the_side_that_it_wants() -> None:
    (place,) = set_labels([wanted(100, 100)], NOTHING, GROUND, 1.0)
    assert place == pytest.approx((103.0, 96.0, 113.0, 104.0))
    (place,) = set_labels([wanted(100, 100, (0.0, -1.0))], NOTHING, GROUND, 1.0)
    assert place == pytest.approx((95.0, 89.0, 105.0, 97.0))


def test_a_label_stays_on_the_ground_and_off_the_points() -> None:
    (place,) = set_labels([wanted(196, 100)], NOTHING, GROUND, 1.0)
    assert place.right <= 200.0
    points = np.array([(104.0 + dx, 98.0 + dy) for dx in range(9) for dy in range(5)])
    (place,) = set_labels([wanted(100, 100)], points, GROUND, 1.0)
    assert not any(place.left < x < place.right and place.low < y < place.high for x, y in points)


def test_points_in_rectangles_are_counted_as_one_by_one() -> None:
    drawn = np.random.default_rng(5)
    points = np.floor(drawn.uniform(-20.0, 220.0, (3_000, 2))) + 0.5
    low = np.floor(drawn.uniform(-30.0, 200.0, (50, 2)))
    high = low + np.floor(drawn.uniform(1.0, 60.0, (50, 2)))
    inside = (points >= 0.0).all(axis=1) & (points < 200.0).all(axis=1)
    one_by_one = [
        np.count_nonzero(inside & (points > first).all(axis=1) & (points < last).all(axis=1))
        for first, last in zip(low, high, strict=True)
    ]
    assert _Counts(points, GROUND, 1.0).within(low, high).tolist() == one_by_one
    assert max(one_by_one) > 50


def test_a_line_crosses_what_any_of_its_points_lies_in() -> None:
    drawn = np.random.default_rng(6)
    start, end = drawn.uniform(0.0, 10.0, (200, 2)), np.array([5.0, 5.0])
    corner = drawn.uniform(0.0, 9.0, (40, 2))
    others = np.concatenate([corner, corner + drawn.uniform(0.2, 3.0, (40, 2))], axis=1)
    steps = np.linspace(0.0, 1.0, 2_000)[None, :, None]
    way = start[:, None] * (1.0 - steps) + end * steps
    found = _Tried._crossed(start, end, others)
    for k, (left, low, right, high) in enumerate(others):
        x, y = way[..., 0], way[..., 1]
        sampled = ((left < x) & (x < right) & (low < y) & (y < high)).any(axis=1)
        # Between two samples a corner may be cut off.
        assert np.count_nonzero(found[:, k] != sampled) <= 1
        assert (found[:, k] >= sampled).all()


def test_labels_of_a_crowd_do_not_meet() -> None:
    crowd = [wanted(100 + 5 * column, 100 + 5 * row) for column in range(5) for row in range(5)]
    places = set_labels(crowd, NOTHING, GROUND, 1.0)
    assert not any(one.meets(other) for one, other in combinations(places, 2))
    assert all(place.left >= 0 and place.low >= 0 and place.right <= 200 and place.high <= 200 for place in places)
    assert set_labels(crowd, NOTHING, GROUND, 1.0) == places
    # In the innermost place there is no room; a line tells whose it is.
    others = [one.thing for one in crowd]
    lines = [line_to(place, one.thing, others, 1.0) for place, one in zip(places, crowd, strict=True)]
    assert any(line is not None for line in lines)
    for line, one, place in zip(lines, crowd, places, strict=True):
        if line is not None:
            assert tuple(line[1]) == pytest.approx(one.thing.nearest(*place.middle))


def test_without_room_every_label_is_still_drawn() -> None:
    small = Rectangle(0.0, 0.0, 12.0, 10.0)
    places = set_labels([wanted(5, 5), wanted(6, 5), wanted(5, 6)], NOTHING, small, 1.0)
    assert len(places) == 3
    assert set_labels([], NOTHING, small, 1.0) == ()


def test_a_near_label_has_no_line() -> None:
    assert line_to(Rectangle(3, -4, 13, 4), at(0, 0), [], 1.0) is None
    line = line_to(Rectangle(12, -4, 22, 4), at(0, 0), [], 1.0)
    assert line is not None
    assert line.tolist() == [[12.0, 0.0], [2.0, 0.0]]
    # A neighbour that is as near makes it doubtful whose label it is.
    assert line_to(Rectangle(6, -4, 16, 4), at(0, 0), [], 1.0) is None
    assert line_to(Rectangle(6, -4, 16, 4), at(0, 0), [at(20, 0)], 1.0) is not None


SAMPLE_SWEEPS = [("people.csv.gz", 0), ("people.csv.gz", 34), ("corridor.bag", 3), ("hall", 5), ("room.mcap", 50)]


@pytest.mark.parametrize(("log", "number"), SAMPLE_SWEEPS)
@pytest.mark.parametrize("inches", [2.4, 4.5])
def test_no_two_labels_of_a_sample_meet(log: str, number: int, inches: float) -> None:
    (source,) = find_logs([str(SAMPLES / log)])
    assert isinstance(source, Source)
    one = take_pictures(source, PlotOptions((number,), parameters=Parameters.for_profile("robust"))).pictures[0]
    limits = limits_of([one])
    for panel, projection in ((scene, None), (panels.polar, "polar")):
        with project_style():
            figure = Figure(figsize=(inches, inches), layout="constrained")
            axes = figure.add_subplot(projection=projection)
            panel(axes, one, limits)
            FigureCanvasAgg(figure).draw()
        (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
        assert len(labels.places) == len(one.detection) > 1
        assert not any(first.meets(second) for first, second in combinations(labels.places, 2))
        box = axes.get_window_extent()
        assert all(box.x0 <= place.left and place.right <= box.x1 for place in labels.places)


def test_labels_follow_the_size_of_the_picture() -> None:
    figure = Figure(figsize=(3, 3))
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 10), ylim=(0, 10))
    add_labels(axes, [Label("a", np.array([[5.0, 5.0]])), Label("b", np.array([[5.0, 5.2]]))], [])
    (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
    assert labels.places == ()
    middles = []
    for inches in (3, 6):
        figure.set_size_inches(inches, inches)
        canvas.draw()
        assert not labels.places[0].meets(labels.places[1])
        middles.append(labels.places[0].middle)
    (near, far) = ((x / size, y / size) for (x, y), size in zip(middles, (300, 600), strict=True))
    # As far from its thing in points, so nearer to it on the larger picture.
    assert np.hypot(far[0] - 0.5, far[1] - 0.5) < np.hypot(near[0] - 0.5, near[1] - 0.5)
    # What lies outside of a part that somebody looks at has no label there.
    axes.set(xlim=(0, 10), ylim=(5.1, 10))
    canvas.draw()
    assert len(labels.places) == 1
    add_labels(axes, [], [])
    assert list(axes.artists) == [labels]
