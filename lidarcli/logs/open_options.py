"""Checked options for opening logs, and for the ranges of their sweeps, by the values that a user gives."""

from __future__ import annotations

import math
from collections.abc import Iterable

from lidarcli.errors import OptionError
from lidarcli.logs.base import MAX_BEAMS, OpenOptions, Slice
from lidarcli.options.choices import BINS, JOIN, UNITS
from lidarcli.sweeps.masks import Masks
from lidarcli.sweeps.range_rules import FARTHEST, RangeRules
from lidarcli.sweeps.types import TURN

MAX_BINS = 100_000


def range_rules(
    limits: tuple[float, float] | None, no_return: tuple[frozenset[str], tuple[float, ...]], masks: Masks | None = None
) -> RangeRules:
    """Return the rules for ranges, from limits [m], words and markers of `range_rules.parse_no_return`, and masks.

    Raises
    ------
    OptionError
        The limits are no range.
    """
    if limits is not None:
        least, most = map(float, limits)
        if not 0 <= least < most < math.inf:
            raise OptionError(f"--range: {least:g} to {most:g} m is no range; give the least and the greatest")
        limits = least, most
    words, markers = no_return
    return RangeRules(no_return=words, markers=markers, limits=limits, masks=masks)


def open_options(
    *,
    angle_min: float | None,
    angle_increment: float | None,
    fov: float | None,
    range_max: float | None,
    degrees: bool,
    range_unit: str,
    echo: str,
    segments: str = JOIN,
    columns: str | Iterable[str] = (),
    heights: tuple[float, float] | None = None,
    bins: int | None = None,
    limits: tuple[float, float] | None = None,
) -> OpenOptions:
    """Return checked options for opening a log; the three angles, or without them those of the log, are `degrees`.

    `heights`, `bins` and `limits` say which points of a cloud are a sweep (`Slice`); without heights none are.

    Raises
    ------
    OptionError
        A value has no meaning, or two exclude each other.
    """
    if angle_increment is not None and fov is not None:
        raise OptionError("--angle-increment and --fov exclude each other")
    if angle_increment == 0:
        raise OptionError("--angle-increment: 0 is no step from beam to beam")
    if range_max is not None and not 0 < range_max <= FARTHEST:
        raise OptionError(f"--range-max: {range_max:g} is not above 0 and at most {FARTHEST:g} m")

    def radians(name: str, angle: float | None) -> float | None:
        found = math.radians(angle) if degrees and angle is not None else angle
        if found is not None and not abs(found) <= 2 * TURN:
            unit, hint = ("degrees", "") if degrees else ("radians", "; --degrees says that angles are degrees")
            raise OptionError(f"{name}: {angle:g} {unit} are more than two turns{hint}")
        return found

    part = _slice(heights, bins, limits)
    if part is not None and range_unit != "m":
        raise OptionError("--range-unit is for LaserScan: with --slice, points of clouds are in metres; leave one out")
    options = OpenOptions(
        angle_min=radians("--angle-min", angle_min),
        angle_increment=radians("--angle-increment", angle_increment),
        fov=radians("--fov", fov),
        range_max=range_max,
        range_scale=UNITS[range_unit],
        angle_scale=TURN / 360.0 if degrees and angle_min is angle_increment is fov is None else 1.0,
        slice=part,
        echo=echo,
        segments=segments,
        columns=parse_columns(columns),
    )
    if part is not None:
        _refuse_view(options, part.bins)
    return options


def parse_columns(names: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the columns of a CSV: `time,ranges`, or `time,other*23,ranges*682`.

    Raises
    ------
    OptionError
        There is no name before a comma, or no number behind a star.

    >>> parse_columns("time, ranges")
    ('time', 'ranges')
    """
    found = tuple(name.strip() for name in (names.split(",") if isinstance(names, str) else names))
    if found == ("",):
        return ()
    for name in found:
        word, star, count = name.partition("*")
        if not word.strip():
            raise OptionError(f"--columns: '{','.join(found)}' has an empty name")
        if star and not (count.strip().isdecimal() and 0 < int(count) <= MAX_BEAMS):
            raise OptionError(f"--columns: '{name}' is not NAME*N, as ranges*360")
    if max(found.count("ranges"), found.count("intensities")) > 1:
        raise OptionError("--columns: only one name stands for all other columns; give the others a number, as ranges*360")
    return found


def _refuse_view(options: OpenOptions, bins: int) -> None:
    """Refuse views that a cloud cannot have: each direction is observed once."""
    most = TURN * (1 + 1e-6)
    if options.fov is not None and not 0 < abs(options.fov) <= most:
        raise OptionError("--fov: with --slice the view is more than nothing, and one turn at most")
    if options.angle_increment is not None:
        if options.angle_min is None:
            raise OptionError("--angle-increment: with --slice give --angle-min, too, or --fov instead")
        if abs(options.angle_increment) * bins > most:
            raise OptionError(f"--angle-increment: {bins} beams (--bins) so far apart are more than one turn")


def _slice(heights: tuple[float, float] | None, bins: int | None, limits: tuple[float, float] | None) -> Slice | None:
    if heights is None:
        if bins is not None:
            raise OptionError("--bins is for point clouds, which --slice reads as sweeps")
        return None
    low, high = map(float, heights)
    if not -math.inf < low <= high < math.inf:
        raise OptionError(f"--slice: {low:g} to {high:g} m are no heights; give the least and the greatest")
    count = BINS if bins is None else bins
    if not 1 < count <= MAX_BINS:
        raise OptionError(f"--bins: {count} is not from 2 to {MAX_BINS:,}")
    return Slice(low, high, count, None if limits is None else (float(limits[0]), float(limits[1])))
