"""How a picture looks, whatever it shows: its size, and what may be left out."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INCH = 25.4
"""[mm]"""
ANIMATED_DPI = 120
FRAMES_PER_SECOND = 10.0


@dataclass(frozen=True, slots=True)
class Look:
    """What papers, slides and pages want of a picture."""

    width: float | None = None
    """Of the whole picture [mm]; None: as wide as its kind is by default."""
    dpi: int | None = None
    """Pixels per inch; None: 200, of an animation 120."""
    title: bool = True
    legend: bool = True
    vertices: bool = False
    """Mark the vertices and the nearest point of each object in the scene and the polar view, too."""
    fps: float = FRAMES_PER_SECOND
    """Sweeps per second of an animation."""

    def inches(self, default: float) -> float:
        """Its width [inch]; `default` where nobody asked for one."""
        return default if self.width is None else self.width / INCH


AS_IT_COMES = Look()


def file_bytes(figure: Figure, suffix: str, dpi: int | None = None) -> bytes:
    """A figure as a file of the kind of `suffix` (.png, .svg, .pdf): no date in it, and its text is text."""
    import matplotlib

    out = io.BytesIO()
    dates: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(out, format=suffix[1:], dpi=dpi or "figure", metadata=dates.get(suffix))
    return out.getvalue()
