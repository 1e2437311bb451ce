"""A figure of matplotlib as a file."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def file_bytes(figure: Figure, suffix: str, dpi: int | None = None) -> bytes:
    """A figure as a file of the kind of `suffix` (.png, .svg, .pdf): no date in it, and its text is text."""
    import matplotlib

    out = io.BytesIO()
    dates: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(out, format=suffix[1:], dpi=dpi or "figure", metadata=dates.get(suffix))
    return out.getvalue()
