"""What a user says of the ranges of a log and of what it lacks, checked: for the command line and for Python."""

from __future__ import annotations

import math

from lidarcli.choices import BINS, ECHOES, UNITS
from lidarcli.errors import OptionError
from lidarcli.logs.base import OpenOptions, Slice
from lidarcli.range_rules import FARTHEST, RangeRules
from lidarcli.sweeps import TURN

MOST_BINS = 100_000
"""A sweep that is made of a point cloud has no more beams."""


def range_rules(
    limits: tuple[float, float] | None, no_return: tuple[frozenset[str], tuple[float, ...]]
) -> RangeRules:
    """How ranges are judged, by limits [m] and by words and markers as of `range_rules.parse_no_return`.

    Raises
    ------
    OptionError
        The limits are no range.
    """
    if limits is not None:
        least, most = map(float, limits)
        if not 0 <= least < most < math.inf:
            raise OptionError(
                f"--range: {least:g} to {most:g} m is no range; give the least and the greatest"
            )
        limits = least, most
    words, markers = no_return
    return RangeRules(no_return=words, markers=markers, limits=limits)


def open_options(
    *,
    angle_min: float | None,
    angle_increment: float | None,
    fov: float | None,
    range_max: float | None,
    degrees: bool,
    range_unit: str,
    echo: str,
    heights: tuple[float, float] | None = None,
    bins: int | None = None,
    limits: tuple[float, float] | None = None,
) -> OpenOptions:
    """What a log may need to be told, and which echo counts; the three angles are radians, or `degrees`.

    `heights`, `bins` and `limits` say which points of a cloud are a sweep (`Slice`); without heights none are.

    Raises
    ------
    OptionError
        A value has no meaning, or two exclude each other.
    """
    if range_unit not in UNITS:
        raise OptionError(f"--range-unit: '{range_unit}' is not one of {', '.join(UNITS)}")
    if echo not in ECHOES:
        raise OptionError(f"--echo: '{echo}' is not one of {', '.join(ECHOES)}")
    if angle_increment is not None and fov is not None:
        raise OptionError("--angle-increment and --fov exclude each other")
    if angle_increment == 0:
        raise OptionError("--angle-increment: 0 is no step from beam to beam")
    if range_max is not None and not 0 < range_max <= FARTHEST:
        raise OptionError(f"--range-max: {range_max:g} is not above 0 and at most {FARTHEST:g} m")

    def radians(name: str, angle: float | None) -> float | None:
        found = math.radians(angle) if degrees and angle is not None else angle
        if found is not None and not abs(found) <= 2 * TURN:
            unit, hint = (
                ("degrees", "") if degrees else ("radians", "; --degrees says that angles are degrees")
            )
            raise OptionError(f"{name}: {angle:g} {unit} are more than two turns{hint}")
        return found

    part = _slice(heights, bins, limits)
    if part is not None and range_unit != "m":
        raise OptionError(
            "--range-unit is for LaserScan: with --slice, points of clouds are in metres; leave one out"
        )
    told = OpenOptions(
        angle_min=radians("--angle-min", angle_min),
        angle_increment=radians("--angle-increment", angle_increment),
        fov=radians("--fov", fov),
        range_max=range_max,
        range_scale=UNITS[range_unit],
        slice=part,
        echo=echo,
    )
    if part is not None:
        _refuse_view(told, part.bins)
    return told


def _refuse_view(told: OpenOptions, bins: int) -> None:
    """Refuse beams that cannot be those of a cloud: each direction is seen once."""
    most = TURN * (1 + 1e-6)
    if told.fov is not None and not 0 < abs(told.fov) <= most:
        raise OptionError("--fov: with --slice the view is more than nothing, and one turn at most")
    if told.angle_increment is not None:
        if told.angle_min is None:
            raise OptionError("--angle-increment: with --slice give --angle-min, too, or --fov instead")
        if abs(told.angle_increment) * bins > most:
            raise OptionError(f"--angle-increment: {bins} beams (--bins) so far apart are more than one turn")


def _slice(
    heights: tuple[float, float] | None, bins: int | None, limits: tuple[float, float] | None
) -> Slice | None:
    if heights is None:
        if bins is not None:
            raise OptionError("--bins is for point clouds, which --slice reads as sweeps")
        return None
    low, high = map(float, heights)
    if not -math.inf < low <= high < math.inf:
        raise OptionError(f"--slice: {low:g} to {high:g} m are no heights; give the least and the greatest")
    count = BINS if bins is None else bins
    if not 1 < count <= MOST_BINS:
        raise OptionError(f"--bins: {count} is not from 2 to {MOST_BINS:,}")
    return Slice(low, high, count, None if limits is None else (float(limits[0]), float(limits[1])))
