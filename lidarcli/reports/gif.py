"""Frames as a GIF. One set of colours for all frames, so that nothing changes its colour from frame to frame."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

MOST = 256
"""Colours of a GIF."""
SHADES = 6
"""Of each colour of a mark, towards white: the edges of lines and letters."""
Pixels = NDArray[np.uint8]


def write_gif(path: Path, frames: Iterable[Pixels], fps: float, colours: Iterable[str]) -> None:
    """Write frames (H, W, 3) that go round for ever.

    Parameters
    ----------
    colours : what is drawn with, `#RRGGBB`, on white; all else is shown in the nearest shade of these
    """
    table = _table(colours)
    first, *rest = (_reduced(pixels, table) for pixels in frames)
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=rest,
        duration=round(1000.0 / fps),
        loop=0,
        optimize=False,
    )


def _table(colours: Iterable[str]) -> NDArray[np.int64]:
    """(N, 3) every shade of each colour, and white."""
    named = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in colours], np.float64)
    shade = np.linspace(0.0, 1.0, SHADES, endpoint=False)[:, None, None]
    shades = (named * (1.0 - shade) + 255.0 * shade).round().astype(np.int64).reshape(-1, 3)
    return np.unique(np.concatenate([[[255, 255, 255]], shades]), axis=0)[-MOST:]


def _reduced(pixels: Pixels, table: NDArray[np.int64]) -> Image.Image:
    """A frame with the nearest colours of the table."""
    packed = pixels.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
    seen, place = np.unique(packed, return_inverse=True)
    parts = np.stack([seen >> 16, (seen >> 8) & 255, seen & 255], axis=1)
    nearest = ((parts[:, None] - table) ** 2).sum(axis=2).argmin(axis=1).astype(np.uint8)
    image = Image.fromarray(nearest[place].reshape(pixels.shape[:2]))
    # From grey levels to places in the table.
    image.putpalette(table.astype(np.uint8).ravel().tolist())
    return image
