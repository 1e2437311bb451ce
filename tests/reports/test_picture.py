"""What a picture of a sweep holds: marks, labels and axes of its panels; and the same bytes each time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from lidarcli.display import palette
from lidarcli.formalism import Parameters, detect, sweep
from lidarcli.formalism.detection import VERTEX_KINDS
from lidarcli.options.choices import VIEWS, Look
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.plotting import PlotOptions, take_pictures
from lidarcli.reports import curves, drawing
from lidarcli.reports import picture as panels
from lidarcli.reports.drawing import Mark, Panel, draw_panel, new_figure, project_style, write_gif
from lidarcli.reports.picture import animate, draw, draw_whole
from lidarcli.reports.scene import Limits, Picture, ZoneInSight, limits_of, printable, scene
from lidarcli.reports.world import TrackPath
from lidarcli.sweeps.masks import Mount, Polygon
from lidarcli.sweeps.types import Float64
from lidarcli.sweeps.zone import Line, Zone
from tests.places import SAMPLES


def picture(ranges: Sequence[float] | Float64, background: Float64 | None = None, log: str = "run.mcap") -> Picture:
    """A full turn, or 5 degrees per beam where there are fewer than 72, profile `paper`."""
    return seen(ranges, Parameters.for_profile("paper"), background=background, log=log)


def seen(ranges: Sequence[float] | Float64, parameters: Parameters, **other: Any) -> Picture:
    step = 2.0 * np.pi / max(len(ranges), 72)
    batch = sweep(ranges, angle_min=-np.pi, angle_increment=step)
    words: dict[str, Any] = {"log": "run", "profile": "paper", "threshold": "mean", **other}
    return Picture(batch=batch, detection=detect(batch, parameters, per_beam=True), **words)


def room(**nearer: float) -> list[float]:
    """72 beams at 4 m; `b10_14=2.0` puts beams 10 to 14 at 2 m."""
    ranges = [4.0] * 72
    for beams, value in nearer.items():
        first, last = map(int, beams[1:].split("_"))
        ranges[first : last + 1] = [value] * (last + 1 - first)
    return ranges


@cache
def sample(name: str, number: int, walls: bool = False) -> Picture:
    """A sweep of a sample."""
    (source,) = find_logs([str(SAMPLES / name)])
    assert isinstance(source, Source)
    options = PlotOptions((number,), parameters=Parameters.for_profile("robust", walls=walls))
    return take_pictures(source, options).pictures[0]


def named(panel: Panel) -> dict[str, Mark]:
    """What a legend would name."""
    return {mark.name: mark for mark in panel.marks if mark.name is not None}


def pieces(xy: Float64) -> list[list[list[float]]]:
    """The points of a line that breaks, piece by piece."""
    parts = np.split(xy, np.flatnonzero(np.isnan(xy[:, 0])))
    return [kept.tolist() for part in parts if len(kept := part[~np.isnan(part[:, 0])])]


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


def test_the_content_of_the_scene() -> None:
    one = picture(room(b10_14=2.0, b30_40=1.0))
    panel = scene(one)
    assert [label.text for label in panel.labels] == ["1", "2"]
    found = named(panel)
    assert {*found} == {"beams on objects", "walls and rest", "sensor", "prismatic object"}
    assert [len(found[name].xy) for name in ("beams on objects", "walls and rest")] == [16, 56]
    # All boxes of a shape are one line, which breaks between them.
    assert pieces(found["prismatic object"].xy) == [one.outline(0).tolist(), one.outline(1).tolist()]
    # Faces lie above the beams, in the colour of their object.
    (faces,) = (mark for mark in panel.marks if mark.style["zorder"] == 5)
    assert faces.style["color"] == found["prismatic object"].style["color"] == palette.SHAPE_COLOURS["prismatic"]
    assert [len(face) for face in pieces(faces.xy)] == [5, 11]
    assert panel.frame.x == limits_of([one]).x


def test_a_scene_holds_all_of_every_box() -> None:
    theta = np.radians(np.arange(360) - 180.0)
    # The corner of a box of 0.6 m ahead, turned by 45 degrees, in front of nothing: on x = 2 + |y|.
    ahead = np.abs(theta) < np.arctan2(0.6 * np.sqrt(0.5), 2.0 + 0.6 * np.sqrt(0.5))
    one = seen(np.where(ahead, 2.0 / (np.cos(theta) - np.abs(np.sin(theta))), np.inf), Parameters())
    (k,) = one.things
    limits = limits_of([one])
    # The far corner lies behind all beams.
    assert one.outline(k)[:, 0].max() > np.nanmax(one.points[np.isfinite(one.ranges), 0]) + 0.3
    for low, high, values in zip(*zip(limits.x, limits.y, strict=True), one.outline(k).T, strict=True):
        assert low < values.min() <= values.max() < high


def test_a_scene_holds_where_tracks_are_and_their_arrows() -> None:
    path = TrackPath(1, True, "", True, np.array([-50.0, 5.0]), np.array([0.0, 1.0]), (0.5, 1.5))
    limits = limits_of([replace(picture(room()), tracks=(path,))])
    assert limits.x[1] > 5.5
    # But not all of the way that led there.
    assert limits.x[0] > -6.0


def test_vertices_are_marked_on_request() -> None:
    one = picture(room(b10_14=2.0, b30_40=1.0))
    found = named(scene(one, vertices=True))
    kinds = [VERTEX_KINDS[code] for code in one.detection.vertex_kind]
    for name in ("start", "end"):
        assert len(found[f"vertex: {name}"].xy) == kinds.count(name) == 2
    assert np.hypot(*found["nearest point"].xy.T) == pytest.approx([2.0, 1.0])


def test_a_round_object_is_a_circle_and_a_beam_beside_it_no_part_of_its_arc() -> None:
    theta = np.arange(1440) * (np.pi / 720) - np.pi
    # A post of 0.2 m radius, 1.5 m ahead.
    inner = (1.5 * np.cos(theta)) ** 2 - (1.5**2 - 0.2**2)
    hit = (inner >= 0) & (np.abs(theta) < 1.0)
    ranges = np.where(hit, 1.5 * np.cos(theta) - np.sqrt(np.maximum(inner, 0.0)), 4.0)
    one = seen(ranges, Parameters())
    # The first beam of the object ends 0.4 m nearer, as one that met something thin.
    ranges[np.flatnonzero(hit)[0]] = 1.0
    panel = scene(replace(one, batch=seen(ranges, Parameters()).batch))
    assert np.hypot(*(named(panel)["round object"].xy[:-1] - [1.5, 0.0]).T) == pytest.approx(0.2, abs=0.005)
    (arc,) = (mark for mark in panel.marks if mark.style["zorder"] == 5)
    assert len(arc.xy[:-1]) == np.count_nonzero(hit) - 1
    assert np.hypot(*(arc.xy[:-1] - [1.5, 0.0]).T) == pytest.approx(0.2, abs=0.005)


def in_sight(name: str, corners: Sequence[tuple[float, float]], occupied: bool = False, **other: Any) -> ZoneInSight:
    """A zone before the sensor of `picture`; with two corners a line."""
    shape = Line(*corners) if len(corners) == 2 else Polygon(tuple(corners))
    beams = np.zeros(72, bool)
    beams[36] = occupied
    return ZoneInSight(Zone(name, shape, **other), np.array(corners), beams, occupied)


def test_the_part_of_a_zone_in_view() -> None:
    limits = Limits((-2.0, 4.0), (-1.0, 3.0), 5.0, 1.0)
    for corners, low, high in (([(1.0, -9.0), (1.0, 9.0)], (1.0, -1.0), (1.0, 3.0)), ([(3, 0), (5, 4)], (3, 0), (4, 2))):
        found = in_sight("door", corners).in_view(limits)
        assert (found.min(axis=0), found.max(axis=0)) == (pytest.approx(low, abs=0.1), pytest.approx(high, abs=0.1))
    for corners in ([(5.0, -9.0), (5.0, 9.0)], [(3.5, 9.0), (9.0, 2.0)], [(5.0, 5.0), (6.0, 5.0), (6.0, 6.0)]):
        assert len(in_sight("far", corners).in_view(limits)) == 0
    # All of the view is inside of it: its name stands in the upper left corner.
    around = in_sight("hall", [(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)])
    assert around.in_view(limits).tolist() == [[-2.0, 3.0]]


def test_the_name_of_a_zone_stands_in_the_scene() -> None:
    zones = (
        in_sight("door", [(1.0, -90.0), (1.0, 90.0)]),
        in_sight("far", [(50.0, -1.0), (50.0, 1.0)]),
        in_sight("yard", [(-60.0, -60.0), (3.0, -60.0), (3.0, 60.0), (-60.0, 60.0)], occupied=True),
        in_sight("stop", [(0.2, 0.2), (1.0, 0.2), (1.0, -0.2)], action="stop"),
    )
    one = replace(picture(room(b10_14=2.0)), zones=zones)
    limits = limits_of([one])
    labels = {label.text: label.around for label in scene(one).labels}
    # Its action is its name: it stands there once.
    assert {*labels} == {"1", "door", "yard: 1 point", "stop"}
    for (x, y), *_ in labels.values():
        assert limits.x[0] - 1e-9 <= x <= limits.x[1] + 1e-9
        assert limits.y[0] - 1e-9 <= y <= limits.y[1] + 1e-9


def test_walls_are_subdued_and_break_where_nothing_was_seen() -> None:
    one = sample("corridor.bag", 3, walls=True)
    found = named(scene(one))
    steps = np.concatenate([np.hypot(*np.diff(band, axis=0).T) for band in pieces(found["wall"].xy)])
    # Two faces that end in one far corner were drawn as a wedge from 7.5 m to 11.5 m.
    assert 1.0 < steps.max() < 2.0
    assert found["wall"].style["color"] == palette.WALL
    corners = np.count_nonzero(one.detection.vertex_kind == VERTEX_KINDS.index("corner"))
    assert 0 < len(found["corner of a wall"].xy) < corners


def test_tracks_in_the_scene() -> None:
    still = TrackPath(4, False, "pallet", False, np.array([2.0]), np.array([0.0]), (0.0, 0.0))
    walking = TrackPath(12, True, "", True, np.array([1.0, 1.0, 1.0]), np.array([0.0, 0.1, 0.2]), (0.0, 1.0))
    one = replace(picture(room(b10_14=2.0)), tracks=(still, walking))
    panel = scene(one)
    # The object of the sweep has no number of its own beside those of the tracks.
    assert [(label.text, label.away) for label in panel.labels] == [("4 pallet", (0.0, 0.0)), ("12", (1.0, 1.2))]
    found = named(panel)
    marks = {
        name: (mark.style["marker"], mark.style["mec"], mark.style["mfc"])
        for name, mark in found.items()
        if "track" in name
    }
    assert marks == {
        "track: agent": ("^", palette.VERMILION, palette.VERMILION),
        "track: object, hidden": ("o", palette.BLUE, "white"),
    }
    path, line, head = (
        mark.xy.tolist()
        for mark in panel.marks
        if mark.style["color" if "color" in mark.style else "mec"] == palette.VERMILION and mark.name is None
    )
    assert path == [[1.0, 0.0], [1.0, 0.1], [1.0, 0.2]]
    assert (line, head) == ([[1.0, 0.2], [1.0, 1.2]], [[1.0, 1.2]])
    assert one.title[1].startswith("1970-01-01T00:00:00.000Z, 2 tracks (1 agent), profile paper, ")


@pytest.mark.parametrize("width", [None, 60.0, 183.0])
@pytest.mark.parametrize("beams", [37, 72])
def test_bearings_on_the_axes_stand_apart(beams: int, width: float | None) -> None:
    """Beside a background the axis of r_w and r_e is a third of the picture wide."""
    one = replace(picture([4.0] * beams), background=np.full(beams, 4.0), difference=np.zeros(beams))
    look = Look(width=width)
    for view in ("all", "sweep"):
        with project_style():
            figure = new_figure(panels.width_of(view, look))
            axes = draw_whole(figure, one, view, limits_of([one]), look)
            figure.canvas.draw()
        for each in axes:
            words = [text.get_window_extent() for text in each.get_xticklabels() if text.get_text()]
            assert all(left.x1 < right.x0 for left, right in pairwise(words)), view
        bearings = [each.get_xticks().tolist() for each in axes if "bearing" in each.get_xlabel()]
        assert bearings
        assert all(0.0 in ticks for ticks in bearings)


def test_the_difference_marks_jumps_and_edges() -> None:
    one = picture(room(b10_14=2.0))
    found = named(curves.difference(one, limits_of([one])))
    assert found["edge of an object"].xy == pytest.approx(np.array([[-130, -2.0], [-105, 2.0]]))
    assert found["$|s| > d_{th}$"].xy[:, 1].tolist() == [-2.0, 2.0]
    one = picture([4.0] * 72)
    assert {*named(curves.difference(one, limits_of([one])))} == {r"$\pm d_{th}$"}


def test_the_difference_is_logarithmic_where_its_jumps_are_many_times_d_th() -> None:
    one = picture(room(b10_14=2.0))
    axes = Figure().add_subplot()
    draw_panel(axes, curves.difference(one, limits_of([one])))
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
    assert curves.difference(small, limits_of([small])).frame.linear == 0.0


def test_an_object_across_the_seam_is_shaded_on_both_sides() -> None:
    one = picture([2.0] * 3 + room()[6:] + [2.0] * 3)
    shade = named(curves.sweep(one, limits_of([one])))["bearings of an object"]
    spans = sorted((min(part)[0], max(part)[0]) for part in pieces(shade.xy))
    assert np.array(spans) == pytest.approx(np.array([[-180, -167.5], [162.5, 177.5]]))
    axes = Figure().add_subplot()
    draw_panel(axes, curves.sweep(one, limits_of([one])))
    (drawn,) = axes.patches
    assert len(drawn.get_path().to_polygons()) == 2


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


def laid_out(one: Picture, view: str, look: Look) -> Figure:
    with drawing.project_style():
        figure = drawing.new_figure(panels.width_of(view, look))
        panels.draw_whole(figure, one, view, limits_of([one]), look)
    return figure


def filled(figure: Figure) -> float:
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
    assert filled(figure) > 0.93
    above, curve, _ = (axes.get_position() for axes in figure.axes)
    assert (curve.y1 < above.y0) == stacked
    assert (curve.x0 > above.x1) == (not stacked)


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("width", [60.0, 200.0])
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
    assert all(box is not None and box.y0 >= legend.get_window_extent().y1 - 1.0 for box in boxes)


@pytest.mark.slow
def test_the_frames_of_an_animation_hold_still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    legends: list[list[str]] = []
    places: list[list[float]] = []
    shown = drawing.shown_on

    def pixels(figure: Figure) -> Any:
        (legend,) = figure.legends
        legends.append([text.get_text() for text in legend.get_texts()])
        places.append([*legend.get_window_extent().bounds, *figure.axes[0].get_window_extent().bounds])
        return shown(figure)

    monkeypatch.setattr(panels, "shown_on", pixels)
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


def test_a_colour_of_a_moving_picture_that_comes_later_is_the_same(tmp_path: Path) -> None:
    frames = []
    for columns, colour in enumerate((palette.BLACK, palette.VERMILION, palette.PURPLE), 1):
        frames.append(np.full((20, 30, 4), 255, np.uint8))
        frames[-1][:, :columns, :3] = [*bytes.fromhex(colour[1:])]
    for name in ("a.gif", "b.gif"):
        write_gif(tmp_path / name, iter(frames), 4.0)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    with Image.open(tmp_path / "a.gif") as image:
        assert (getattr(image, "n_frames", 1), image.size, image.info["loop"]) == (3, (30, 20), 0)
        for number, expected in enumerate(frames):
            image.seek(number)
            assert image.info["duration"] == 250
            assert np.array_equal(np.asarray(image.convert("RGB")), expected[..., :3])


def frames_of(pictures: Sequence[Picture], view: str, look: Look, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The frames of an animation, as they are before they become a file."""
    frames: list[Any] = []
    monkeypatch.setattr(panels, "write_gif", lambda _, shown, fps: frames.extend(one[..., :3].copy() for one in shown))
    animate(pictures, view, Path("a.gif"), look)
    return frames


def drawn_anew(pictures: Sequence[Picture], view: str, look: Look) -> Iterator[Any]:
    """The same pictures, each on a figure of its own with all of its marks, axes and words."""
    limits = limits_of(pictures)
    places = panels.places_of(pictures[0], view, limits, look)
    widest = max(pictures, key=lambda one: len(" ".join(one.title)))
    for one in pictures:
        with drawing.project_style():
            figure = drawing.new_figure(panels.width_of(view, look))
            figure.set_dpi(120)
            axes = panels.draw_whole(figure, widest, view, limits, look, {})
            figure.set_layout_engine(None)
            for each, place in zip(axes, places, strict=True):
                for artist in [*each.lines, *each.patches, *each.artists]:
                    artist.remove()
                draw_panel(each, place.content(one, limits))
            if look.title:
                drawing.draw_title(figure, one.title)
            yield drawing.pixels_of(figure)


COMING_AND_GOING = ({}, {"b10_14": 2.0}, {"b10_14": 2.0, "b30_40": 1.0}, {"b50_53": 3.0}, {})


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
def test_a_frame_is_the_still_picture(view: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # No tracks, and so no numbers either: marks and axes are the same to the pixel, also where objects were before.
    pictures = [replace(picture(room(**nearer)), tracks=()) for nearer in COMING_AND_GOING]
    look = Look(title=False, legend=False)
    frames = frames_of(pictures, view, look, monkeypatch)
    assert len(frames) == len(pictures)
    for frame, still in zip(frames, drawn_anew(pictures, view, look), strict=True):
        assert np.array_equal(frame, still)
    assert np.array_equal(frames[0], frames[-1])
    assert not np.array_equal(frames[1], frames[2])


@pytest.mark.slow
def test_axes_that_change_are_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    # The second sweep spans less of a turn.
    pictures = [picture(room()), picture(room()[:50]), picture(room(b10_14=2.0))]
    look = Look(title=False, legend=False)
    frames = frames_of(pictures, "sweep", look, monkeypatch)
    for frame, still in zip(frames, drawn_anew(pictures, "sweep", look), strict=True):
        assert np.array_equal(frame, still)


@pytest.mark.slow
def test_labels_and_titles_of_a_frame_are_those_of_the_still_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = [sample("people.csv.gz", number) for number in (0, 20, 34)]
    look = Look(legend=False)
    frames = frames_of(pictures, "scene", look, monkeypatch)
    for frame, still in zip(frames, drawn_anew(pictures, "scene", look), strict=True):
        # Words stand on the nearest quarter of a pixel, and those beside a formula are set a little closer.
        ink, expected = (255.0 - each.mean(axis=2) for each in (frame, still))
        assert ink.sum() == pytest.approx(expected.sum(), rel=0.01)
        below = slice(60, None)
        assert np.abs(ink - expected)[below].max() < 150.0
        assert (np.abs(ink - expected)[below] > 30.0).mean() < 0.002


def test_a_scene_is_in_the_frame_of_the_robot_where_the_mount_is_known() -> None:
    one = picture(room(b10_14=2.0))
    path = TrackPath(4, True, "", True, np.array([1.0, 2.0]), np.array([0.0, 0.5]), (0.5, 0.0), (2.0, 0.4))
    area = ZoneInSight(Zone("a", Polygon(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))), np.eye(2), np.zeros(72, np.bool_), False)
    one = replace(one, tracks=(path,), zones=(area,))
    backward = replace(one, mount=Mount("laser", "base_link", -0.1, 0.0, np.pi))
    assert backward.points == pytest.approx(np.array([-0.1, 0.0]) - one.points)
    assert backward.outline(0) == pytest.approx(np.array([-0.1, 0.0]) - one.outline(0))
    assert backward.paths[0].mark == pytest.approx((-2.1, -0.4))
    assert backward.paths[0].velocity == pytest.approx((-0.5, 0.0))
    assert backward.areas[0].corners == pytest.approx(np.array([[-1.1, 0.0], [-0.1, -1.0]]))
    panel = scene(backward)
    assert panel.frame.names == ("x in base_link [m]", "y in base_link [m]")
    assert scene(one).frame.names == ("x [m]", "y [m]")
    triangle = named(panel)["sensor"]
    assert triangle.xy == pytest.approx(np.array([[-0.1, 0.0]]))
    # It points back: a triangle without a turn points up.
    assert triangle.style["marker"] == (3, 0, pytest.approx(90.0))
    # Head down and ahead: left is right.
    over = replace(one, mount=Mount("laser", "base_link", 0.3, 0.0, 0.0, upside_down=True))
    assert over.points == pytest.approx(one.points * [1.0, -1.0] + [0.3, 0.0])
    # Curves are by the bearings of the sensor.
    for panel_of in (curves.sweep, curves.difference):
        for mark, other in zip(panel_of(over, limits_of([over])).marks, panel_of(one, limits_of([one])).marks, strict=True):
            assert mark.xy == pytest.approx(other.xy, nan_ok=True)


def test_a_scene_that_follows_something_shows_it_in_its_middle_and_the_sensor() -> None:
    pictures = [replace(picture(room()), followed="track 9", middle=(x, 0.0), mount=None) for x in (1.0, 5.0)]
    limits = limits_of(pictures)
    assert limits.x == limits.y == pytest.approx((-6.5, 6.5))
    for one in pictures:
        panel = scene(one, limits)
        assert panel.frame.x == limits.x
        assert named(panel)["sensor"].xy == pytest.approx(np.array([[-one.middle[0], 0.0]]))
        assert panel.frame.names[0] == "x from track 9 [m]"
