"""What docs/accuracy.md says of the sweeps judged by eye."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from benchmarks.annotations.measure import DRIVING, PARKED, ByEye, Key
from benchmarks.annotations.methods import PUBLISHED, ROBUST, TRACK
from benchmarks.annotations.table import PLACES

TEXT = """{sweeps} sweeps of {logs} public recordings by {recorders} recorders, of RPLIDAR, YDLIDAR, SICK, Hokuyo and Neato
sensors and of simulators, judged beam by beam by eye ([how](annotating.md)), with default options. A detection is right
when 70 % of its beams are on objects, and an object is found when one right detection holds half of it. `track` sees the
whole log and decides by [places](formalism.md#places). The features of the trees and the constants of places were chosen
with such figures of these sweeps in view.

"""
STEADY = """
Of detections of at least 8 beams within 5 m of a parked sensor, the share that has no counterpart within 0.2 m in the next
sweep, and of those with one the share of another shape (by the trees of the package):

"""

Table = Callable[[Sequence[str], Iterable[Sequence[str]]], str]
"""Head and rows → Markdown."""
OURS = (ROBUST, TRACK)


def section(found: ByEye, make: Table) -> str:
    """The text and its tables."""
    text = TEXT.format(sweeps=found.sweeps, logs=found.logs, recorders=found.recorders)
    rows = [[f"**{method}**" if method in OURS else method, *_figures(found, method)] for method in (*OURS, *PUBLISHED)]
    text += make(["method", "precision", "recall"], [row for row in rows if len(row) > 1])
    whole = found.of(ROBUST)
    text += (
        f"\n{whole.things} objects, {whole.detections} detections of `detect`. In brackets: nine of ten draws of as many "
        "logs. By kind of place, and by\nwhether the sensor stood or drove in the sweep:\n\n"
    )
    parts: dict[str, Callable[[Key], bool]] = {
        **{place: (lambda key, place=place: key.place == place) for place in PLACES},  # type: ignore[misc]
        **{motion: (lambda key, motion=motion: key.motion == motion) for motion in (PARKED, DRIVING)},  # type: ignore[misc]
    }
    text += make(
        ["", "objects", *(f"{method}: {figure}" for method in OURS for figure in ("precision", "recall"))],
        [
            [
                name,
                str(found.of(ROBUST, which).things),
                *(cell for method in OURS for cell in _figures(found, method, which)),
            ]
            for name, which in parts.items()
        ],
    )
    text += STEADY
    rows = [
        [
            method,
            f"{each.detections:,}",
            f"{100 * each.share:.1f} %",
            f"{100 * each.reshaped_share:.1f} %" if method in OURS else "–",
        ]
        for method, each in found.flicker.items()
    ]
    text += make(["method", "detections", "without counterpart", "of another shape"], rows)
    return text


def _figures(found: ByEye, method: str, which: Callable[[Key], bool] = lambda _: True) -> list[str]:
    """Precision and recall of a method with their intervals; nothing where it was not run."""
    whole = found.of(method, which)
    if not whole.detections:
        return []
    each = zip((whole.precision, whole.recall), found.interval(method, which), strict=True)
    return [f"{value:.3f} ({low:.2f}–{high:.2f})" for value, (low, high) in each]
