"""Moving pictures: frames, time, and colours that stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from lidarcli.reports import palette
from lidarcli.reports.drawing import write_gif


def frame(colour: str, columns: int) -> np.ndarray:
    """White, its first columns in a colour."""
    pixels = np.full((20, 30, 3), 255, np.uint8)
    pixels[:, :columns] = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return pixels


def test_a_colour_that_comes_later_is_the_same(tmp_path: Path) -> None:
    frames = [frame(palette.BLACK, 1), frame(palette.VERMILION, 2), frame(palette.PURPLE, 3)]
    write_gif(tmp_path / "a.gif", iter(frames), 4.0, palette.ALL)
    with Image.open(tmp_path / "a.gif") as image:
        assert (getattr(image, "n_frames", 1), image.size, image.info["loop"]) == (3, (30, 20), 0)
        for number, expected in enumerate(frames):
            image.seek(number)
            assert image.info["duration"] == 250
            assert np.array_equal(np.asarray(image.convert("RGB")), expected)


def test_the_same_frames_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_gif(tmp_path / name, iter([frame(palette.BLUE, 4), frame(palette.SKY, 9)]), 10.0, palette.ALL)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
