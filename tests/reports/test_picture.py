"""What a plot draws: boxes, members across the seam, axes; and the same bytes each time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from PIL import Image

from lidarcli.choices import VIEWS, Look
from lidarcli.formalism import Parameters, detect, sweep
from lidarcli.formalism.detection import ROUND, VERTEX_KINDS
from lidarcli.masks import Polygon
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.plotting import PlotOptions, take_pictures
from lidarcli.reports import drawing, palette, panels
from lidarcli.reports.drawing import animate, draw
from lidarcli.reports.ground import TrackPath
from lidarcli.reports.labels import Labels
from lidarcli.reports.panels import scene
from lidarcli.reports.picture import Limits, Picture, ZoneInSight, limits_of, printable
from lidarcli.sweeps import Float64
from lidarcli.zone import Line, Zone
from tests.places import SAMPLES


def picture(ranges: Sequence[float], background: Float64 | None = None, log: str = "run.mcap") -> Picture:
    """A full turn of 72 beams, or a part of it, profile `paper`."""
    batch = sweep(ranges, angle_min=-np.pi, angle_increment=np.pi / 36)
    parameters = Parameters.for_profile("paper")
    return Picture(log, batch, detect(batch, parameters, per_beam=True), "paper", "mean", background)


def room(**nearer: float) -> list[float]:
    """72 beams at 4 m; `b10_14=2.0` puts beams 10 to 14 at 2 m."""
    ranges = [4.0] * 72
    for beams, value in nearer.items():
        first, last = map(int, beams[1:].split("_"))
        ranges[first : last + 1] = [value] * (last + 1 - first)
    return ranges


def sample(name: str, number: int, walls: bool = False) -> Picture:
    """A sweep of a sample."""
    (source,) = find_logs([str(SAMPLES / name)])
    assert isinstance(source, Source)
    options = PlotOptions((number,), parameters=Parameters.for_profile("robust", walls=walls))
    return take_pictures(source, options).pictures[0]


def test_members_of_an_object_across_the_seam() -> None:
    one = picture([2.0] * 3 + room()[6:] + [2.0] * 3)
    assert len(one.detection) == 1
    beams, theta = one.members(0)
    assert beams.tolist() == [69, 70, 71, 0, 1, 2]
    assert np.diff(theta) == pytest.approx(np.full(5, np.pi / 36))
    assert theta[0] == pytest.approx(one.detection.theta_i[0])
    assert one.between(0).sum() == 6


def test_the_corners_of_a_box() -> None:
    one = picture(room(b10_14=2.0))
    corners = one.corners(0)
    found = one.detection
    assert corners[0].tolist() == corners[4].tolist()
    assert corners[:4].mean(axis=0) == pytest.approx([found.box_x[0], found.box_y[0]])
    sides = np.hypot(*np.diff(corners, axis=0).T)
    assert sides == pytest.approx([found.box_length[0], found.box_width[0]] * 2)
    along = corners[0] - corners[1]
    assert np.arctan2(along[1], along[0]) == pytest.approx(found.box_yaw[0])


def test_the_axes_hold_every_point_and_the_sensor() -> None:
    one, other = picture(room(b3_5=2.0)), picture([9.0] * 72)
    limits = limits_of([one, other])
    assert limits.x[0] < -9 < 9 < limits.x[1]
    assert limits.r > 9
    assert 2.0 < limits.s < 2.5
    nothing = limits_of([picture([np.inf] * 72)])
    assert nothing.x == pytest.approx((-0.1, 0.1))


def test_the_title_says_where_it_comes_from() -> None:
    first, second = picture(room(b10_14=2.0), log="$x^2$.mcap").title
    assert first == r"\$x^2\$.mcap  /scan  sweep 0"
    assert second == "1970-01-01T00:00:00.000Z, profile paper, $d_{th}$ = 0.0556 m (mean), 1 object"
    assert printable("a\nb\\c") == "a?b/c"


def named(axes: Axes) -> dict[str, Any]:
    """What a legend would name."""
    handles, words = axes.get_legend_handles_labels()
    return dict(zip(words, handles, strict=True))


def pieces(line: Line2D) -> list[list[list[float]]]:
    """The points of a line that breaks, piece by piece."""
    points = np.asarray(line.get_xydata(), float)
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    return [part[~np.isnan(part[:, 0])].tolist() for part in np.split(points, gaps)]


def test_what_the_scene_shows() -> None:
    one = picture(room(b10_14=2.0, b30_40=1.0))
    axes = Figure().add_subplot()
    scene(axes, one)
    (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
    assert [label.text for label in labels.labels] == ["1", "2"]
    assert [one.shape(k) for k in (0, 1)] == ["prismatic", "prismatic"]
    # All boxes of a shape are one line, which breaks between them.
    (boxes,) = (line for line in axes.lines if line.get_zorder() == 4)
    assert boxes.get_color() == palette.SHAPE_COLOURS["prismatic"]
    assert pieces(boxes) == [one.corners(0).tolist(), one.corners(1).tolist()]
    # Faces lie above the beams, in the colour of their object.
    (faces,) = (line for line in axes.lines if line.get_zorder() == 5)
    assert faces.get_color() == boxes.get_color()
    assert [len(face) for face in pieces(faces)] == [5, 11]
    assert len(one.detection.face_length) == 2
    points = {one.get_label(): len(one.get_offsets()) for one in axes.collections}
    assert points == {"beams on objects": 16, "walls and rest": 56}
    assert set(named(axes)) == {*points, "sensor", "prismatic object"}
    assert axes.get_xlim() == limits_of([one]).x


def corner_ahead(reach: float = 2.0) -> list[float]:
    """360 beams over a full turn: the corner of a box of 0.6 m that stands in front of nothing, turned by 45 degrees."""
    theta = np.radians(np.arange(360) - 180.0)
    ahead = np.abs(theta) < np.arctan2(0.6 * np.sqrt(0.5), reach + 0.6 * np.sqrt(0.5))
    # On x = reach + |y|.
    return np.where(ahead, reach / (np.cos(theta) - np.abs(np.sin(theta))), np.inf).tolist()


def test_a_scene_holds_all_of_every_box() -> None:
    batch = sweep(corner_ahead(), angle_min=-np.pi, angle_increment=np.pi / 180)
    one = Picture("run", batch, detect(batch, Parameters(), per_beam=True), "robust", "adaptive")
    (k,) = one.things
    limits = limits_of([one])
    beams = one.points()[0]
    # The far corner lies behind all beams.
    assert one.outline(k)[:, 0].max() > beams[np.isfinite(beams)].max() + 0.3
    for low, high, values in zip(*zip(limits.x, limits.y, strict=True), one.outline(k).T, strict=True):
        assert low < values.min() <= values.max() < high


def test_a_scene_holds_where_tracks_are_and_their_arrows() -> None:
    path = TrackPath(1, True, "", True, np.array([-50.0, 5.0]), np.array([0.0, 1.0]), (0.5, 1.5))
    limits = limits_of([replace(picture(room()), tracks=(path,))])
    assert limits.x[1] > 5.5
    # But not all of the way that led there.
    assert limits.x[0] > -6.0


def test_a_circle_that_was_fitted_to_a_wall_does_not_make_the_scene_small() -> None:
    one = picture(room(b10_14=2.0))
    found = one.detection
    huge = replace(found, shape=np.full_like(found.shape, ROUND), box_length=np.array([500.0]))
    assert limits_of([replace(one, detection=huge)]).x == pytest.approx(limits_of([one]).x, abs=3.0)


def test_vertices_are_marked_on_request() -> None:
    one = picture(room(b10_14=2.0, b30_40=1.0))
    axes = Figure().add_subplot()
    scene(axes, one, vertices=True)
    found = named(axes)
    kinds = [VERTEX_KINDS[code] for code in one.detection.vertex_kind]
    for name in ("start", "end"):
        assert len(found[f"vertex: {name}"].get_xdata()) == kinds.count(name) == 2
    assert len(found["nearest point"].get_xdata()) == 2
    near = found["nearest point"]
    assert np.hypot(near.get_xdata(), near.get_ydata()) == pytest.approx([2.0, 1.0])


def test_a_round_object_is_a_circle() -> None:
    theta = np.arange(1440) * (np.pi / 720) - np.pi
    # A post of 0.2 m radius, 1.5 m ahead.
    inner = (1.5 * np.cos(theta)) ** 2 - (1.5**2 - 0.2**2)
    hit = (inner >= 0) & (np.abs(theta) < 1.0)
    ranges = np.where(hit, 1.5 * np.cos(theta) - np.sqrt(np.maximum(inner, 0.0)), 4.0)
    batch = sweep(ranges, angle_min=-np.pi, angle_increment=np.pi / 720)
    one = Picture("run", batch, detect(batch, Parameters(), per_beam=True), "robust", "adaptive")
    assert one.shape(0) == "round"
    axes = Figure().add_subplot()
    scene(axes, one)
    circle = named(axes)["round object"]
    x, y = np.asarray(circle.get_xdata()), np.asarray(circle.get_ydata())
    assert np.hypot(x - 1.5, y) == pytest.approx(np.full(len(x), 0.2), abs=0.005)


def test_a_beam_beside_a_round_object_is_no_part_of_its_arc() -> None:
    theta = np.arange(1440) * (np.pi / 720) - np.pi
    inner = (1.5 * np.cos(theta)) ** 2 - (1.5**2 - 0.2**2)
    hit = (inner >= 0) & (np.abs(theta) < 1.0)
    ranges = np.where(hit, 1.5 * np.cos(theta) - np.sqrt(np.maximum(inner, 0.0)), 4.0)
    batch = sweep(ranges, angle_min=-np.pi, angle_increment=np.pi / 720)
    one = Picture("run", batch, detect(batch, Parameters(), per_beam=True), "robust", "adaptive")
    # The first beam of the object ends 0.4 m nearer, as one that met something thin.
    ranges[np.flatnonzero(hit)[0]] = 1.0
    seen = replace(one, batch=sweep(ranges, angle_min=-np.pi, angle_increment=np.pi / 720))
    axes = Figure().add_subplot()
    scene(axes, seen)
    (arc,) = (line for line in axes.lines if line.get_zorder() == 5)
    x, y = np.asarray(arc.get_xdata()), np.asarray(arc.get_ydata())
    assert len(x) == np.count_nonzero(hit) - 1
    assert np.hypot(x - 1.5, y) == pytest.approx(np.full(len(x), 0.2), abs=0.005)


def in_sight(name: str, corners: Sequence[tuple[float, float]], occupied: bool = False, **other: Any) -> ZoneInSight:
    """A zone before the sensor of `picture`; with two corners a line."""
    shape = Line(*corners) if len(corners) == 2 else Polygon(tuple(corners))
    beams = np.zeros(72, bool)
    beams[36] = occupied
    return ZoneInSight(Zone(name, shape, **other), np.array(corners), beams, occupied)


def test_what_is_in_view_of_a_zone() -> None:
    limits = Limits((-2.0, 4.0), (-1.0, 3.0), 5.0, 1.0)
    across = in_sight("door", [(1.0, -9.0), (1.0, 9.0)]).in_view(limits)
    assert sorted(across.tolist()) == [[1.0, -1.0], [1.0, 3.0]]
    slanted = in_sight("door", [(3.0, 0.0), (5.0, 4.0)]).in_view(limits)
    assert sorted(slanted.tolist()) == [[3.0, 0.0], [4.0, 2.0]]
    for corners in ([(5.0, -9.0), (5.0, 9.0)], [(3.5, 9.0), (9.0, 2.0)], [(5.0, 5.0), (6.0, 5.0), (6.0, 6.0)]):
        assert len(in_sight("far", corners).in_view(limits)) == 0
    inner = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]
    assert {*map(tuple, in_sight("area", inner).in_view(limits).tolist())} == {*inner}
    # All of the view is inside of it: its name stands in the upper left corner.
    around = in_sight("hall", [(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)])
    assert around.in_view(limits).tolist() == [[-2.0, 3.0]]


def test_the_name_of_a_zone_stays_in_the_scene() -> None:
    zones = (
        in_sight("door", [(1.0, -90.0), (1.0, 90.0)]),
        in_sight("far", [(50.0, -1.0), (50.0, 1.0)]),
        in_sight("yard", [(-60.0, -60.0), (3.0, -60.0), (3.0, 60.0), (-60.0, 60.0)], occupied=True),
        in_sight("stop", [(0.2, 0.2), (1.0, 0.2), (1.0, -0.2)], action="stop"),
    )
    one = replace(picture(room(b10_14=2.0)), zones=zones)
    figure = Figure(figsize=(5, 5))
    axes = figure.add_subplot()
    scene(axes, one)
    FigureCanvasAgg(figure).draw()
    (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
    names = {label.text: place for label, place in zip(labels.labels, labels.places, strict=True)}
    # Its action is its name: it stands there once.
    assert {*names} == {"1", "door", "yard: 1 point", "stop"}
    ground = axes.get_window_extent()
    for name, place in names.items():
        assert ground.x0 < place.left < place.right < ground.x1, name
        assert ground.y0 < place.low < place.high < ground.y1, name
    assert not any(one.meets(other) for one, other in combinations(labels.places, 2))


def test_zones_look_like_no_wall() -> None:
    walls = {palette.SET_STYLES["S"][0], palette.WALL}
    assert not walls & {*palette.ZONE_COLOURS.values()}
    corners = [(0.2, 0.2), (1.0, 0.2), (1.0, -0.2)]
    for occupied in (True, False):
        axes = Figure().add_subplot()
        scene(axes, replace(picture(room()), zones=(in_sight("area", corners, occupied),)))
        line = named(axes)["zone"]
        assert line.get_color() == palette.PURPLE
        assert (line.get_linestyle() == "-") == occupied
        assert line.get_xydata().tolist() == [[*corner] for corner in (*corners, corners[0])]


def test_walls_are_subdued_and_break_where_nothing_was_seen() -> None:
    one = sample("corridor.bag", 3, walls=True)
    axes = Figure().add_subplot()
    scene(axes, one)
    (bands,) = (line for line in axes.lines if line.get_color() == palette.WALL)
    steps = np.concatenate([np.hypot(*np.diff(band, axis=0).T) for band in pieces(bands)])
    # Two faces that end in one far corner were drawn as a wedge from 7.5 m to 11.5 m.
    assert 1.0 < steps.max() < 2.0
    corners = np.count_nonzero(one.detection.vertex_kind == VERTEX_KINDS.index("corner"))
    assert 0 < len(named(axes)["corner of a wall"].get_xdata()) < corners


def test_what_the_scene_shows_of_tracks() -> None:
    still = TrackPath(4, False, "pallet", False, np.array([2.0]), np.array([0.0]), (0.0, 0.0))
    walking = TrackPath(12, True, "", True, np.array([1.0, 1.0, 1.0]), np.array([0.0, 0.1, 0.2]), (0.0, 1.0))
    one = replace(picture(room(b10_14=2.0)), tracks=(still, walking))
    axes = Figure().add_subplot()
    scene(axes, one)
    # The object of the sweep has no number of its own beside those of the tracks.
    (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
    assert [(label.text, label.away) for label in labels.labels] == [("4 pallet", None), ("12", (1.0, 1.2))]
    lines = named(axes)
    agent, thing = lines["track: agent"], lines["track: object, hidden"]
    assert (agent.get_marker(), agent.get_markeredgecolor(), agent.get_markerfacecolor()) == (
        "^",
        palette.VERMILION,
        palette.VERMILION,
    )
    assert (thing.get_marker(), thing.get_markeredgecolor(), thing.get_markerfacecolor()) == ("o", palette.BLUE, "white")
    assert [list(line.get_ydata()) for line in axes.lines if len(line.get_xdata()) == 3] == [[0.0, 0.1, 0.2]]
    (arrow,) = [text for text in axes.texts if isinstance(text, Annotation)]
    assert (arrow.xy, arrow.xyann) == ((1.0, 1.2), (1.0, 0.2))
    assert one.title[1].startswith("1970-01-01T00:00:00.000Z, 2 tracks (1 agent), profile paper, ")


def test_what_the_difference_shows() -> None:
    one = picture(room(b10_14=2.0))
    axes = Figure().add_subplot()
    panels.difference(axes, one, limits_of([one]))
    lines = {line.get_label(): line for line in axes.lines}
    rings = lines["edge of an object"]
    assert list(rings.get_xdata()) == pytest.approx([-130, -105])
    assert list(rings.get_ydata()) == [-2.0, 2.0]
    assert list(lines["$|s| > d_{th}$"].get_ydata()) == [-2.0, 2.0]
    assert len(axes.patches) == 1


def test_the_difference_is_logarithmic_where_its_jumps_are_many_times_d_th() -> None:
    one = picture(room(b10_14=2.0))
    axes = Figure().add_subplot()
    panels.difference(axes, one, limits_of([one]))
    d_th = float(one.detection.sweep_d_th[0])
    assert d_th == pytest.approx(0.0556, abs=1e-4)
    assert axes.get_yscale() == "symlog"
    low, zero, high = axes.transData.transform([(0, -d_th), (0, 0), (0, d_th)])[:, 1]
    # ±d_th stand apart beside a jump of 36 times as much.
    assert (high - low) / axes.bbox.height > 0.1
    assert zero - low == pytest.approx(high - zero)
    assert axes.get_yticks() == pytest.approx([-1.0, -0.3, 0.0, 0.3, 1.0])
    assert [text.get_text() for text in axes.get_yticklabels()] == ["−1", "−0.3", "0", "0.3", "1"]
    small = replace(one, detection=replace(one.detection, sweep_d_th=np.array([0.5])))
    axes = Figure().add_subplot()
    panels.difference(axes, small, limits_of([one]))
    assert axes.get_yscale() == "linear"


def test_a_legend_names_what_is_drawn_alone() -> None:
    axes = Figure().add_subplot()
    panels.difference(axes, picture([4.0] * 72), limits_of([picture([4.0] * 72)]))
    assert set(named(axes)) == {r"$\pm d_{th}$"}
    axes = Figure().add_subplot()
    one = picture(room(b10_14=2.0), np.array(room()))
    panels.subtraction(axes, one, limits_of([one]))
    assert set(named(axes)) == {"nearer", "farther", "bearings of an object"}


def test_what_the_polar_view_shows() -> None:
    one = picture(room(b10_14=2.0, b30_40=1.0))
    figure = Figure()
    axes = figure.add_subplot(projection="polar")
    panels.polar(axes, one, limits_of([one]))
    FigureCanvasAgg(figure).draw()
    assert [text.get_text() for text in axes.get_xticklabels()] == [
        *("0°", "45°", "90°", "135°", "180°", "−135°", "−90°", "−45°")
    ]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["1 m", "2 m", "3 m", "4 m"]
    (labels,) = (artist for artist in axes.artists if isinstance(artist, Labels))
    assert [label.text for label in labels.labels] == ["1", "2"]
    assert len(labels.places) == 2


def test_an_object_across_the_seam_is_shaded_on_both_sides() -> None:
    one = picture([2.0] * 3 + room()[6:] + [2.0] * 3)
    axes = Figure().add_subplot()
    panels.sweep(axes, one, limits_of([one]))
    (shade,) = axes.patches
    parts = np.array(shade.get_path().to_polygons(closed_only=False))
    spans = sorted(zip(parts[:, :, 0].min(axis=1), parts[:, :, 0].max(axis=1), strict=True))
    assert np.array(spans) == pytest.approx(np.array([[-180, -167.5], [162.5, 177.5]]))


def test_what_the_subtraction_shows() -> None:
    one = picture(room(b10_14=2.0), np.array(room(b40_41=3.0)))
    axes = Figure().add_subplot()
    panels.subtraction(axes, one, limits_of([one]))
    near, far = (np.asarray(line.get_ydata(), float).reshape(-1, 3)[:, :2] for line in axes.lines[:2])
    assert near.tolist() == [[0.0, -2.0]] * 5
    assert far.max() == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("view", "suffix"), [*((view, ".svg") for view in VIEWS), ("scene", ".png"), ("scene", ".pdf")])
def test_every_view_in_every_format_is_the_same_each_time(view: str, suffix: str) -> None:
    one = picture(room(b10_14=2.0))
    data = draw(one, view, suffix)
    assert data.startswith({".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix])
    assert data == draw(one, view, suffix)
    assert b"CreationDate" not in data
    assert b"dc:date" not in data


@pytest.mark.slow
@pytest.mark.parametrize("ranges", [[np.inf] * 72, [4.0] * 72, [1.0], [2.0, np.nan, 2.0]])
def test_sweeps_with_hardly_anything_in_them(ranges: list[float]) -> None:
    one = picture(ranges, np.array(ranges), log="日本\x00語.csv")
    assert draw(one, "all", ".png").startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_frames_of_an_animation_hold_still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    legends: list[list[str]] = []
    places: list[list[float]] = []
    shown = drawing._Moving.pixels

    def pixels(moving: drawing._Moving) -> Any:
        figure = moving._figure
        (legend,) = figure.legends
        legends.append([text.get_text() for text in legend.get_texts()])
        places.append([*legend.get_window_extent().bounds, *figure.axes[0].get_window_extent().bounds])
        return shown(moving)

    monkeypatch.setattr(drawing._Moving, "pixels", pixels)
    pictures = [picture(room()), picture(room(b10_14=2.0)), picture(room())]
    done: list[int] = []
    animate(pictures, "scene", tmp_path / "a.gif", Look(fps=5, dpi=60, width=80), done.append)
    assert done == [1, 2, 3]
    # In any frame, though objects are seen in one alone.
    assert {*legends[0]} == {"walls and rest", "sensor", "beams on objects", "prismatic object"}
    assert legends[0] == legends[1] == legends[2]
    assert places[0] == places[1] == places[2]
    with Image.open(tmp_path / "a.gif") as image:
        assert image.info["duration"] == 200
        assert image.size[0] == int(80 / 25.4 * 60) == 188
