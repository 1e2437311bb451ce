"""The figures that a report states and a check may name, their statistics, histograms, and maps of objects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import Any, NamedTuple

import numpy as np

from lidarcli.formalism.detection import CHANGES, SHAPES, VISIBILITIES
from lidarcli.formalism.tracking.results import ENDS
from lidarcli.sweeps.types import TURN, Float64, Int64, Unit
from lidarcli.tabular.schemas import TABLES


class Figure(NamedTuple):
    """Declaration of a figure, or of the values that its statistics are of."""

    unit: Unit
    meaning: str
    table: str = ""
    """Table whose column has the values; empty for a figure that is computed otherwise."""
    column: str = ""


def _of(table: str, column: str, meaning: str) -> Figure:
    """Return the figure of a column, which has its unit."""
    [unit] = [one.unit for one in TABLES[table] if one.name == column]
    return Figure(unit, meaning, table, column)


COUNTS: dict[str, Figure] = {
    "logs": Figure("1", "logs"),
    "topics": Figure("1", "sequences of sweeps: one per log, topic and frame"),
    "sweeps": Figure("1", "sweeps"),
    "objects": Figure("1", "objects of all sweeps, agents among them (sets O and A)"),
    "agents": Figure("1", "of these, objects that are agents (set A)"),
    "beams": Figure("1", "beams of all sweeps"),
    "valid_share": Figure("1", "share of the beams with a range"),
    "no_return_share": Figure("1", "share of the beams without a return"),
    "too_close_share": Figure("1", "share of the beams below the range limit"),
    "invalid_share": Figure("1", "share of the beams without a usable value"),
    "masked_share": Figure("1", "share of the beams left out by `--mask`"),
    "object_share": Figure("1", "share of the beams on objects, agents among them"),
    "agent_share": Figure("1", "share of the beams on agents"),
    "noise_share": Figure("1", "share of the beams on walls and the rest (set S); no noise in metres"),
    "duration": Figure("s", "from first to last stamp, summed over the logs"),
    "rate": Figure("Hz", "one over the median step between stamps"),
    "gaps": Figure("1", "steps of at least one and a half median steps"),
    "missing_sweeps": Figure("1", "sweeps that would fill the gaps"),
    "longest_gap": Figure("s", "the longest gap; 0 without gaps"),
    "backward": Figure("1", "stamps before their predecessor's"),
    "repeated": Figure("1", "stamps equal to their predecessor's"),
    "damage": Figure("1", "parts of the logs that could not be read"),
    "observed": Figure("1", "share of the sweeps that show anything (column `observed`); of several logs the least"),
}
"""Figures of one number."""

SPREADS: dict[str, Figure] = {
    "objects_per_sweep": Figure("1", "objects of a sweep, agents among them"),
    "agents_per_sweep": _of("sweeps", "agents", "of these, objects that are agents"),
    "lost_share": Figure("1", "share of a sweep's beams without a range"),
    "step": Figure("s", "time from sweep to sweep"),
    "noise": _of("sweeps", "noise", "estimated standard deviation of the ranges of a sweep"),
    "d_th": _of("sweeps", "d_th", "threshold of a discontinuity"),
    "d_mean": _of("sweeps", "d_mean", "mean of |s| of a sweep (Def. 3)"),
    "nearest": _of("sweeps", "nearest", "least range of a sweep, be it of an object or a wall"),
    "range": _of("objects", "r_min", "range of the nearest point of an object"),
    "bearing": _of("objects", "theta_min", "bearing of the nearest point of an object"),
    "width": _of("objects", "width", "chord of an object"),
    "box_length": _of("objects", "box_length", "longer side of an object's box"),
    "box_width": _of("objects", "box_width", "shorter side of an object's box"),
    "beams_per_object": _of("objects", "beams", "valid beams of an object"),
    "intensity": _of("objects", "intensity", "median intensity of an object's beams, in the sensor's own unit"),
    "difference": _of("objects", "difference", "median of r_w - r_e over an object's beams"),
}
"""Figures with a value per sweep or per object: `.mean`, `.std`, `.min`, `.p05`, `.p50`, `.p95`, `.max`."""

CATEGORIES: dict[str, tuple[str, ...]] = {
    "shape": tuple(name for name in SHAPES if name != "wall"),
    "visibility": VISIBILITIES,
    "change": CHANGES,
}
"""Numbers of objects by kind: `shape.prismatic`."""

TRACK_COUNTS: dict[str, Figure] = {
    "tracks": Figure("1", "things that were followed from sweep to sweep"),
    "tracks.agents": Figure("1", "of these, agents (set A): things that moved by themselves"),
    "tracks.people": Figure("1", "people: agents that went 2 m or more, each person once (docs/counting.md)"),
}
"""Figures of one number that need tracks tables."""

TRACK_SPREADS: dict[str, Figure] = {
    "agents_at_once": Figure("1", "different agents (tracks of set A) that are seen in a sweep"),
    "tracks.duration": _of("tracks", "duration", "from the first sight of a track to the last"),
    "tracks.sweeps": _of("tracks", "sweeps", "sweeps in which a track was seen"),
    "tracks.distance": _of("tracks", "distance", "way that a track travelled over ground"),
    "tracks.speed_mean": _of("tracks", "speed_mean", "mean speed of a track"),
    "tracks.speed_max": _of("tracks", "speed_max", "greatest speed of a track"),
}
"""Figures with a value per sweep or per track, with the same statistics; they need tracks tables."""

TRACK_CATEGORIES: dict[str, tuple[str, ...]] = {
    "tracks.shape": CATEGORIES["shape"],
    "tracks.end": tuple(name.replace(" ", "_") for name in ENDS),
}
"""Numbers of tracks by kind: `tracks.shape.legged`."""

ZONES = "zones."
"""Beginning of the names of the figures of a zone: `zones.NAME.events`."""

ZONE_COUNTS: dict[str, Figure] = {
    "events": Figure("1", "times that it was occupied, or a collision was predicted"),
    "share": Figure("1", "share of the sweeps in which such an event goes on"),
    "nearest": _of("zones", "nearest", "least distance of a point in it from the sensor"),
    "points.max": _of("zones", "points", "most points in it at once"),
    "ttc.min": _of("zones", "ttc", "least time to collision"),
    "in": Figure("1", "crossings of the line to the left of the way from its first point to its second"),
    "out": Figure("1", "crossings to the right of it"),
    "observed": Figure(
        "1", "share of the sweeps in which something in it could have made an event; of several logs the least"
    ),
}
"""Figures of one number for each zone."""

ZONE_SPREADS: dict[str, Figure] = {
    "duration": _of("events", "duration", "how long such an event lasted"),
    "agents_at_once": _of("zones", "agents", "agents in it that are seen in a sweep"),
    "dwell": _of("events", "duration", "how long an agent was seen in it"),
}
"""Figures of each zone with a value per event, sweep or visit, with the same statistics."""

OF_CHANGES: dict[str, Figure] = {
    "known": Figure("1", "things that are where they were"),
    "moved": Figure("1", "things that were moved"),
    "new": Figure("1", "things and pieces of structure that were not there"),
    "gone": Figure("1", "things and pieces of structure that are no longer there"),
    "uncertain": Figure("1", "things of which nobody can tell"),
    "overlap": Figure("1", "share of the structure in place, that of the worst run"),
}
"""Figures that need tables of changes."""

OF_MAPS: dict[str, Figure] = {
    "precision": Figure("1", "share of the occupied cells of the second map that are within one cell of one of the first"),
    "recall": Figure("1", "share of those of the first that are within one cell of one of the second"),
    "f1": Figure("1", "harmonic mean of both"),
}
"""Figures that need a table of the changes from a map to another one."""

COMPARED: dict[str, Figure] = {
    "compared_sweeps": Figure("1", "sweeps that are in both runs"),
    "changed_sweeps": Figure("1", "of these, sweeps with another number of objects"),
    "added_sweeps": Figure("1", "sweeps that are not in the baseline"),
    "removed_sweeps": Figure("1", "sweeps that are in the baseline alone"),
}
"""Figures that need a baseline, in addition to `delta.NAME` and `percent.NAME` of every other."""

GUARDED: dict[str, tuple[float | None, float | None]] = {
    **dict.fromkeys(("sweeps", "valid_share", "known"), (0.8, None)),
    **dict.fromkeys(("observed", "zones.NAME.observed", "overlap"), (0.9, None)),
    "topics": (1.0, None),
    "f1": (0.95, None),
    "nearest.min": (0.5, None),
    "rate": (0.9, 1.1),
    **dict.fromkeys(("zones.NAME.events", "moved", "new", "gone"), (None, 1.5)),
    **dict.fromkeys(("step.max", "agents_at_once.max"), (None, 2.0)),
    "damage": (None, 1.0),
}
"""Figure that the checks of a good run hold → their least and greatest limit, as parts of the value there."""

DELTA, PERCENT = "delta.", "percent."
"""Before the name of a figure: its difference from a baseline, and that in percent of the baseline's value."""
STATISTICS = ("mean", "std", "min", "p05", "p50", "p95", "max")
BINS = 24
TAIL = 99.5
"""Percentile of the last edge [%]: values beyond go into the last bin, lest one far point flatten all others."""


def names() -> list[str]:
    """Return the names of all figures of any run, statistics spelled out."""
    return _spelled(COUNTS, SPREADS, CATEGORIES)


def track_names() -> list[str]:
    """Return the names of all figures that need tracks tables."""
    return _spelled(TRACK_COUNTS, TRACK_SPREADS, TRACK_CATEGORIES)


def zone_names(zone: str) -> list[str]:
    """Return the names of all figures of a zone."""
    return [f"{ZONES}{zone}.{name}" for name in _spelled(ZONE_COUNTS, ZONE_SPREADS, {})]


def plain_name(name: str) -> str:
    """Return the name of a figure without what makes it a difference from a baseline."""
    return name.removeprefix(DELTA).removeprefix(PERCENT)


def zone_of(name: str) -> tuple[str, str] | None:
    """Return the zone that a figure is of, and the rest of its name; None for a figure of no zone.

    >>> zone_of("zones.left-door.dwell.mean"), zone_of("delta.zones.stop.events"), zone_of("sweeps")
    (('left-door', 'dwell.mean'), ('stop', 'events'), None)
    """
    plain = plain_name(name)
    if not plain.startswith(ZONES):
        return None
    zone, _, rest = plain.removeprefix(ZONES).partition(".")
    return zone, rest


def _spelled(counts: Iterable[str], spreads: Iterable[str], kinds: Mapping[str, Iterable[str]]) -> list[str]:
    statistics = [f"{name}.{statistic}" for name in spreads for statistic in STATISTICS]
    return [*counts, *statistics, *(f"{name}.{kind}" for name, values in kinds.items() for kind in values)]


def guards(runs: Sequence[Mapping[str, float | None]]) -> dict[str, list[float]]:
    """Return the checks that good runs with these figures set for others, as of `GUARDED` → the values there.

    A limit is beyond the worst value by the spread of all, at least by the part of `GUARDED` over the root of their number.
    """
    checks = {}
    for name in dict.fromkeys(name for one in runs for name in one):
        of_zone = zone_of(name) if name == plain_name(name) else None
        least, most = GUARDED.get(f"{ZONES}NAME.{of_zone[1]}" if of_zone else name, (None, None))
        values = sorted(value for one in runs if (value := one.get(name)) is not None)
        if not values:
            continue
        low, high, room, part = values[0], values[-1], values[-1] - values[0], len(values) ** -0.5
        down = least and _rounded(low - max(room, part * low * (1.0 - least)), ROUND_FLOOR)
        whole = all(value == int(value) for value in values)
        up = most and _rounded(high + max(room, part * high * (most - 1.0)), ROUND_CEILING, whole)
        down = down if down and float(down) > 0.0 else None
        if down and up:
            checks[f"{name} between {down} and {up}"] = values
        elif down or up:
            checks[f"{name} >= {down}" if down else f"{name} <= {up}"] = values
    return checks


def _rounded(limit: float, how: str, whole: bool = False) -> str:
    """Return a limit with three digits, or of a `whole` number a whole one."""
    exact = Decimal(f"{limit:.9g}")
    rounded = exact.to_integral_value(how) if whole else Context(prec=3, rounding=how).plus(exact)
    return f"{rounded.normalize():f}"


def unit_of(name: str) -> str:
    """Return the unit of a figure, `1` for a count or a share."""
    if name.startswith(PERCENT):
        return "%"
    plain = plain_name(name)
    entries = COUNTS | TRACK_COUNTS | SPREADS | TRACK_SPREADS
    if (of_zone := zone_of(name)) is not None:
        plain, entries = of_zone[1], ZONE_COUNTS | ZONE_SPREADS
    entry = entries.get(plain) or entries.get(plain.rsplit(".", maxsplit=1)[0])
    return entry.unit if entry else "1"


BLOCK = 1 << 16
"""Values that are counted together: more take more memory."""


def finite(values: Float64) -> Float64:
    """Return the values that are finite, without a copy where all are."""
    there = np.isfinite(values)
    return values if there.all() else values[there]


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
        there = finite(values)
        if not len(there):
            return Spread(0)
        p05, p50, p95 = (float(value) for value in np.percentile(there, (5, 50, 95)))
        mean, std, least, greatest = (float(value) for value in (there.mean(), there.std(), there.min(), there.max()))
        return Spread(len(there), mean, std, least, p05, p50, p95, greatest)


@dataclass(frozen=True, slots=True)
class Histogram:
    """Counts of a figure between edges; the first and last bin also hold the values beyond."""

    name: str
    unit: str
    edges: Float64
    """(B + 1,)"""
    counts: Int64
    """(B,)"""


@dataclass(frozen=True, slots=True)
class Density:
    """Numbers of objects whose centroid lies in each cell of a grid."""

    frame: str
    """`sensor` or `world`."""
    x0: float
    y0: float
    cell: float
    """[m]"""
    counts: Int64
    """(NX, NY), x forward, y left."""


def nice_edges(values: Float64, bins: int = BINS) -> Float64:
    """Return edges at round numbers that hold the values but for a far tail.

    >>> nice_edges(np.array([0.11, 0.5, 1.02]), 10).tolist()[:3]
    [0.1, 0.2, 0.30000000000000004]
    """
    there = finite(values)
    if not len(there):
        return np.array([0.0, 1.0])
    low, high = (float(value) for value in np.percentile(there, (100 - TAIL, TAIL)))
    # Bins far narrower than the values would have edges that are all the same number.
    span = high - low if high - low > 1e-9 * max(abs(low), abs(high), 1e-9) else max(abs(low), 1e-3)
    width = round_up(span / bins)
    first = math.floor(low / width)
    last = max(math.floor(high / width) + 1, first + 1)
    edges: Float64 = np.arange(first, last + 1, dtype=np.float64) * width
    return edges


def round_up(value: float) -> float:
    """Return the next of 1, 2, 2.5, 5 times a power of ten.

    >>> [round_up(value) for value in (0.03, 1.0, 7.0)]
    [0.05, 1.0, 10.0]
    """
    power = 10.0 ** math.floor(math.log10(value))
    step = next(step for step in (1.0, 2.0, 2.5, 5.0, 10.0) if step * power >= value * (1 - 1e-9))
    return step * power


def bearing_edges() -> Float64:
    """Return the full turn in bins of 15 degrees."""
    return np.linspace(-TURN / 2, TURN / 2, BINS + 1)


def histogram(name: str, unit: str, values: Float64, edges: Float64) -> Histogram:
    """Count values between edges."""
    counts = np.zeros(len(edges) - 1, np.int64)
    for begin in range(0, len(values), BLOCK):
        there = finite(values[begin : begin + BLOCK])
        if unit == "rad":
            there = (there + TURN / 2) % TURN - TURN / 2
        counts += np.histogram(np.clip(there, edges[0], edges[-1]), edges)[0]
    return Histogram(name, unit, edges, counts)


def _far(values: Float64) -> Float64:
    """Return the values (2,) between which all lie but for a far tail; the array is used up."""
    ends: Float64 = np.percentile(values, (100 - TAIL, TAIL), overwrite_input=True)
    return ends


def density(frame: str, read: Callable[[int], Float64]) -> Density | None:
    """Count points on square cells of a round size; None without points.

    `read`: returns a new array of x (0) or y (1), as of a long log both would take much memory
    """
    there = np.isfinite(read(0)) & np.isfinite(read(1))
    if not there.any():
        return None
    low, high = np.stack([_far(read(axis)[there]) for axis in (0, 1)], axis=1)
    cell = max(round_up(max(float((high - low).max()), 1e-3) / 48), 0.05)
    # The map ends at whole cells; what lies beyond the tail is outside, where a cell has no number that fits.
    first, last = np.floor(low / cell), np.floor(high / cell)
    columns, rows = (last - first + 1).astype(np.int64).tolist()
    place = np.zeros(len(there), np.int32)
    for axis, many in enumerate((columns, rows)):
        cells = read(axis)
        cells /= cell
        np.floor(cells, out=cells)
        cells -= first[axis]
        there &= (cells >= 0) & (cells < many)
        cells[~there] = 0
        place *= many
        place += cells.astype(np.int32)
    counts = np.bincount(place[there], minlength=columns * rows).reshape(columns, rows)
    x0, y0 = (first * cell).tolist()
    return Density(frame, x0, y0, cell, counts)


def plain_number(value: float | None) -> float | int | None:
    """Return a whole number as an integer, any other with nine digits; None for a value that is not finite."""
    if value is None or not math.isfinite(value):
        return None
    return int(value) if value == int(value) else float(f"{value:.9g}")


def plain_numbers(values: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return figures by their names, as of `plain_number`."""
    return {name: plain_number(value) for name, value in values.items()}


def plain(value: Any) -> Any:
    """Return a value or an array for JSON, with numbers as of `plain_number`."""
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind in "iu" else [plain_number(each) for each in value.tolist()]
    return plain_number(value) if isinstance(value, float) else value


def plain_fields(one: object, *names: str) -> dict[str, Any]:
    """Return some fields of a record by name, as of `plain`."""
    return {name: plain(getattr(one, name)) for name in names}
