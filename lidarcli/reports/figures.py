"""The figures that a report states and a check may name, each with its unit and meaning; and their statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.detection import CHANGES, SHAPES, VISIBILITIES
from lidarcli.formalism.tracking.results import ENDS
from lidarcli.sweeps import Float64

COUNTS: dict[str, tuple[str, str]] = {
    "logs": ("1", "logs"),
    "topics": ("1", "sequences of sweeps: one per log, topic and frame"),
    "sweeps": ("1", "sweeps"),
    "objects": ("1", "objects of all sweeps, agents among them (sets O and A)"),
    "agents": ("1", "of these, objects that are agents (set A)"),
    "beams": ("1", "beams of all sweeps"),
    "valid_share": ("1", "share of the beams with a range"),
    "no_return_share": ("1", "share of the beams without a return"),
    "too_close_share": ("1", "share of the beams below the range limit"),
    "invalid_share": ("1", "share of the beams without a usable value"),
    "object_share": ("1", "share of the beams on objects, agents among them"),
    "agent_share": ("1", "share of the beams on agents"),
    "noise_share": ("1", "share of the beams on walls and the rest (set S); no noise in metres"),
    "duration": ("s", "from first to last stamp, summed over the logs"),
    "rate": ("Hz", "one over the median step between stamps"),
    "gaps": ("1", "steps of at least one and a half median steps"),
    "missing_sweeps": ("1", "sweeps that would fill the gaps"),
    "longest_gap": ("s", "the longest gap; 0 without gaps"),
    "backward": ("1", "stamps before their predecessor's"),
    "repeated": ("1", "stamps equal to their predecessor's"),
    "damage": ("1", "parts of the logs that could not be read"),
}
"""Figures of one number."""

SPREADS: dict[str, tuple[str, str]] = {
    "objects_per_sweep": ("1", "objects of a sweep, agents among them"),
    "agents_per_sweep": ("1", "of these, objects that are agents"),
    "lost_share": ("1", "share of a sweep's beams without a range"),
    "step": ("s", "time from sweep to sweep"),
    "noise": ("m", "estimated standard deviation of the ranges of a sweep"),
    "d_th": ("m", "threshold of a discontinuity"),
    "d_mean": ("m", "mean of |s| of a sweep (Def. 3)"),
    "nearest": ("m", "least range of a sweep, be it of an object or a wall"),
    "range": ("m", "range of the nearest point of an object"),
    "bearing": ("rad", "bearing of the nearest point of an object"),
    "width": ("m", "chord of an object"),
    "box_length": ("m", "longer side of an object's box"),
    "box_width": ("m", "shorter side of an object's box"),
    "beams_per_object": ("1", "valid beams of an object"),
    "intensity": ("1", "median intensity of an object's beams, in the sensor's own unit"),
    "difference": ("m", "median of r_w - r_e over an object's beams"),
}
"""Figures with a value per sweep or per object: `.mean`, `.std`, `.min`, `.p05`, `.p50`, `.p95`, `.max`."""

CATEGORIES: dict[str, tuple[str, ...]] = {
    "shape": tuple(name for name in SHAPES if name != "wall"),
    "visibility": VISIBILITIES,
    "change": CHANGES,
}
"""Numbers of objects by kind: `shape.prismatic`."""

TRACK_COUNTS: dict[str, tuple[str, str]] = {
    "tracks": ("1", "things that were followed from sweep to sweep"),
    "tracks.agents": ("1", "of these, agents (set A): things that moved by themselves"),
}
"""Figures of one number that need tracks tables."""

TRACK_SPREADS: dict[str, tuple[str, str]] = {
    "agents_at_once": ("1", "different agents (tracks of set A) that are seen in a sweep"),
    "tracks.duration": ("s", "from the first sight of a track to the last"),
    "tracks.sweeps": ("1", "sweeps in which a track was seen"),
    "tracks.distance": ("m", "way that a track travelled over ground"),
    "tracks.speed_mean": ("m/s", "mean speed of a track"),
    "tracks.speed_max": ("m/s", "greatest speed of a track"),
}
"""Figures with a value per sweep or per track, with the same statistics; they need tracks tables."""

TRACK_CATEGORIES: dict[str, tuple[str, ...]] = {
    "tracks.shape": CATEGORIES["shape"],
    "tracks.end": tuple(name.replace(" ", "_") for name in ENDS),
}
"""Numbers of tracks by kind: `tracks.shape.legged`."""

COMPARED: dict[str, tuple[str, str]] = {
    "compared_sweeps": ("1", "sweeps that are in both runs"),
    "changed_sweeps": ("1", "of these, sweeps with another number of objects"),
    "added_sweeps": ("1", "sweeps that are not in the baseline"),
    "removed_sweeps": ("1", "sweeps that are in the baseline alone"),
}
"""Figures that need a baseline, beside `delta.NAME` of every other."""

DELTA = "delta."
STATISTICS = ("mean", "std", "min", "p05", "p50", "p95", "max")


def names() -> list[str]:
    """Return the names of all figures of any run, statistics spelled out."""
    return _spelled(COUNTS, SPREADS, CATEGORIES)


def track_names() -> list[str]:
    """Return the names of all figures that need tracks tables."""
    return _spelled(TRACK_COUNTS, TRACK_SPREADS, TRACK_CATEGORIES)


def _spelled(counts: Iterable[str], spreads: Iterable[str], kinds: Mapping[str, Iterable[str]]) -> list[str]:
    statistics = [f"{name}.{statistic}" for name in spreads for statistic in STATISTICS]
    return [*counts, *statistics, *(f"{name}.{kind}" for name, values in kinds.items() for kind in values)]


def unit_of(name: str) -> str:
    """Return the unit of a figure, `1` for a count or a share."""
    plain = name.removeprefix(DELTA)
    entries = COUNTS | TRACK_COUNTS | SPREADS | TRACK_SPREADS
    entry = entries.get(plain) or entries.get(plain.rsplit(".", maxsplit=1)[0])
    return entry[0] if entry else "1"


@dataclass(frozen=True, slots=True)
class Spread:
    """Statistics of a column; None everywhere when it has no value."""

    count: int
    mean: float | None = None
    std: float | None = None
    min: float | None = None
    p05: float | None = None
    p50: float | None = None
    p95: float | None = None
    max: float | None = None

    @staticmethod
    def of(values: Float64) -> Spread:
        """Return the spread of the finite values.

        >>> Spread.of(np.array([1.0, 3.0, np.nan]))
        Spread(count=2, mean=2.0, std=1.0, min=1.0, p05=1.1, p50=2.0, p95=2.9, max=3.0)
        """
        there = values[np.isfinite(values)]
        if not len(there):
            return Spread(0)
        p05, p50, p95 = (float(value) for value in np.percentile(there, (5, 50, 95)))
        return Spread(
            count=len(there),
            mean=float(there.mean()),
            std=float(there.std()),
            min=float(there.min()),
            p05=p05,
            p50=p50,
            p95=p95,
            max=float(there.max()),
        )
