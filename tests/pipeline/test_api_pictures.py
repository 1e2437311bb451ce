"""`lidarcli.plot`: a sweep of a log or of a batch, as a figure of its own or on axes that somebody has."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError
from tests.places import SAMPLES

ROOM = SAMPLES / "room.mcap"
LATER = "no sweep 34 of /scan in this batch, whose sweeps are 0 to 9"
NO_VIEW = "--view: 'top' is not one of all, scene, sweep"


def pixels(data: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))


def test_a_figure_of_a_sweep() -> None:
    figure = lidarcli.plot(ROOM, sweep=34)
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 3
    assert "34" in figure._suptitle.get_text()
    picture = pixels(figure._repr_png_())
    assert picture.shape[0] > 100
    assert (picture != 255).any()
    other = pixels(lidarcli.plot(ROOM, sweep=35)._repr_png_())
    assert picture.shape != other.shape or (picture != other).any()


def test_a_batch_is_drawn_like_its_log(tmp_path: Path) -> None:
    (batch,) = lidarcli.read(ROOM)
    file = tmp_path / "log.svg"
    one = lidarcli.plot(ROOM, 34, file, view="scene", max_width=1.0)
    two = lidarcli.plot(batch, 34, view="scene", max_width=1.0)
    assert one._suptitle.get_text().replace("room.mcap", "room") == two._suptitle.get_text()
    dots = [
        [each.get_xydata().tolist() for each in figure.axes[0].lines if each.get_zorder() == 3] for figure in (one, two)
    ]
    assert sum(map(len, dots[0])) == np.isfinite(batch.ranges[34]).sum()
    assert dots[0] == dots[1]
    command = ["-q", "plot", str(ROOM), "--sweep", "34", "--view", "scene", "--max-width", "1"]
    assert run([*command, "-o", str(tmp_path / "command.svg")]) == 0
    assert file.read_bytes() == (tmp_path / "command.svg").read_bytes()


def test_the_sweep_at_a_time() -> None:
    expected = lidarcli.plot(ROOM, 34, view="scene")._suptitle.get_text()
    for at in (3.42, "3.42s", "2023-11-14T22:13:23.42Z"):
        assert lidarcli.plot(ROOM, at=at, view="scene")._suptitle.get_text() == expected, at


def test_how_large_it_is_and_what_it_says() -> None:
    figure = lidarcli.plot(ROOM, 34, view="scene", width=89, title=False, legend=False)
    assert figure.get_size_inches()[0] * 25.4 == pytest.approx(89)
    assert figure._suptitle is None
    assert not figure.legends


def test_on_axes_that_somebody_has() -> None:
    figure = Figure()
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    right.set_title("mine")
    assert lidarcli.plot(ROOM, 34, view="scene", axes=left) is figure
    assert lidarcli.plot(ROOM, 34, view="sweep", axes=[left, right]) is figure
    assert right.get_title() == "mine"
    assert left.has_data()
    assert right.has_data()


def test_what_cannot_be_drawn() -> None:
    with pytest.raises(OptionError, match="give either at or sweep"):
        lidarcli.plot(ROOM, 34, at=1.0)
    with pytest.raises(OptionError, match="--at: nan is neither a number of seconds nor a text"):
        lidarcli.plot(ROOM, at=float("nan"))
    (batch,) = lidarcli.read(ROOM, end=1.0)
    axes = Figure().subplots()
    for call, error, words in (
        (lambda: lidarcli.plot(batch, 34), lidarcli.OptionError, LATER),
        (lambda: lidarcli.plot(ROOM, 100), lidarcli.OptionError, f"{ROOM}: no sweep 100 of /scan: the last one is 99"),
        (lambda: lidarcli.plot(SAMPLES), lidarcli.OptionError, f"{SAMPLES}: holds 7 logs; name one of them"),
        (lambda: lidarcli.plot("no.bag"), lidarcli.UnreadableError, "no.bag: no such file or folder"),
        (lambda: lidarcli.plot(batch, topic="/scan"), TypeError, "only a log can be read with topic"),
        (lambda: lidarcli.plot(34), TypeError, "logs, files and outputs are named by their paths, not given as int"),  # type: ignore[arg-type]
        (lambda: lidarcli.plot([]), lidarcli.OptionError, "no log is named"),
        (
            lambda: lidarcli.plot([ROOM, ROOM]),
            lidarcli.OptionError,
            f"{ROOM} and {ROOM}: name one log; --join reads parts of one recording as one log",
        ),
        (
            lambda: lidarcli.plot(batch, axes=axes),
            lidarcli.OptionError,
            "view all has 3 panels, and there are 1 axes for it",
        ),
        (lambda: lidarcli.plot(batch, view="top"), lidarcli.OptionError, NO_VIEW),
    ):
        with pytest.raises(error) as caught:
            call()
        assert str(caught.value) == words


def test_a_sweep_is_counted_from_the_first() -> None:
    with pytest.raises(OptionError, match=r"--sweep: -1 is below 0"):
        lidarcli.plot(ROOM, sweep=-1)
