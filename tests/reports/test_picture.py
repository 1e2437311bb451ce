"""What a plot draws: boxes, members across the seam, axes; and the same bytes each time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from lidarcli.choices import VIEWS
from lidarcli.formalism import Parameters, detect, sweep
from lidarcli.reports import palette, panels
from lidarcli.reports.drawing import animate, draw
from lidarcli.reports.paths import TrackPath
from lidarcli.reports.picture import Picture, limits_of, printable
from lidarcli.sweeps import Float64


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
    limits = limits_of([one.batch, other.batch])
    assert limits.x[0] < -9 < 9 < limits.x[1]
    assert limits.r > 9
    assert 2.0 < limits.s < 2.5
    nothing = limits_of([picture([np.inf] * 72).batch])
    assert nothing.x == pytest.approx((-0.1, 0.1))


def test_the_title_says_where_it_comes_from() -> None:
    first, second = picture(room(b10_14=2.0), log="$x^2$.mcap").title
    assert first == r"\$x^2\$.mcap  /scan  sweep 0"
    assert second == "1970-01-01T00:00:00.000Z, profile paper, $d_{th}$ = 0.0556 m (mean), 1 object"
    assert printable("a\nb\\c") == "a?b/c"


def test_what_the_scene_shows() -> None:
    one = picture(room(b10_14=2.0, b30_40=1.0))
    axes = Figure().add_subplot()
    panels.scene(axes, one, limits_of([one.batch]))
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    boxes = [line for line in axes.lines if len(line.get_xdata()) == 5 and line.get_zorder() == 4]
    assert len(boxes) == 2
    points = {one.get_label(): len(one.get_offsets()) for one in axes.collections}
    assert points == {"set O": 16, "set S": 56}


def test_what_the_scene_shows_of_tracks() -> None:
    still = TrackPath(4, False, "pallet", False, np.array([2.0]), np.array([0.0]), (0.0, 0.0))
    walking = TrackPath(12, True, "", True, np.array([1.0, 1.0, 1.0]), np.array([0.0, 0.1, 0.2]), (0.0, 1.0))
    one = replace(picture(room(b10_14=2.0)), tracks=(still, walking))
    axes = Figure().add_subplot()
    panels.scene(axes, one, limits_of([one.batch]))
    # The object of the sweep has no number of its own beside those of the tracks; the arrow has no text.
    assert [text.get_text() for text in axes.texts] == ["4 pallet", "", "12"]
    lines = {line.get_label(): line for line in axes.lines}
    agent, thing = lines["track, agent"], lines["track, object"]
    assert (agent.get_marker(), agent.get_markeredgecolor(), agent.get_markerfacecolor()) == (
        "^",
        palette.VERMILION,
        palette.VERMILION,
    )
    assert (thing.get_marker(), thing.get_markeredgecolor(), thing.get_markerfacecolor()) == (
        "o",
        palette.BLUE,
        "white",
    )
    assert [list(line.get_ydata()) for line in axes.lines if len(line.get_xdata()) == 3] == [[0.0, 0.1, 0.2]]
    (arrow,) = [text for text in axes.texts if isinstance(text, Annotation)]
    assert (arrow.xy, arrow.xyann) == ((1.0, 1.2), (1.0, 0.2))
    assert one.title[1].startswith("1970-01-01T00:00:00.000Z, 2 tracks (1 agent), profile paper, ")


def test_what_the_difference_shows() -> None:
    one = picture(room(b10_14=2.0))
    axes = Figure().add_subplot()
    panels.difference(axes, one, limits_of([one.batch]))
    lines = {line.get_label(): line for line in axes.lines}
    rings = lines["edge of an object"]
    assert list(rings.get_xdata()) == pytest.approx([-130, -105])
    assert list(rings.get_ydata()) == [-2.0, 2.0]
    assert list(lines["$|s| > d_{th}$"].get_ydata()) == [-2.0, 2.0]
    assert len(axes.patches) == 1


def test_an_object_across_the_seam_is_shaded_on_both_sides() -> None:
    one = picture([2.0] * 3 + room()[6:] + [2.0] * 3)
    axes = Figure().add_subplot()
    panels.sweep(axes, one, limits_of([one.batch]))
    spans = sorted((patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches)
    assert np.array(spans) == pytest.approx(np.array([[-180, -167.5], [162.5, 177.5]]))


def test_what_the_subtraction_shows() -> None:
    one = picture(room(b10_14=2.0), np.array(room(b40_41=3.0)))
    axes = Figure().add_subplot()
    panels.subtraction(axes, one, limits_of([one.batch]))
    near, far = axes.collections
    assert len(near.get_segments()) == 5
    assert [segment[1][1] for segment in near.get_segments()] == [-2.0] * 5
    assert max(segment[1][1] for segment in far.get_segments()) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("view", "suffix"), [*((view, ".svg") for view in VIEWS), ("scene", ".png"), ("scene", ".pdf")]
)
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
def test_the_legend_of_an_animation_is_the_same_in_every_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    legends: list[list[str]] = []
    drawn = Figure.legend

    def legend(figure: Figure, handles: Any, labels: Any, **settings: Any) -> Any:
        legends.append([*labels])
        return drawn(figure, handles, labels, **settings)

    monkeypatch.setattr(Figure, "legend", legend)
    pictures = [picture(room()), picture(room(b10_14=2.0)), picture(room())]
    for one in pictures:
        draw(one, "scene", ".png")
    assert legends[0] == legends[2] != legends[1]
    united = {*legends[0], *legends[1]}
    legends.clear()
    animate(pictures, "scene", tmp_path / "a.gif")
    assert len(legends) == 3
    assert all(one == legends[0] for one in legends)
    assert {*legends[0]} == united
