"""What a user says of the ranges of a log and of what it lacks, checked: for the command line and for Python."""

from __future__ import annotations

import math

from lidarcli.choices import ECHOES
from lidarcli.errors import OptionError
from lidarcli.logs.base import OpenOptions
from lidarcli.sweeps import FARTHEST, TURN, RangeRules

UNITS = {"m": 1.0, "mm": 0.001}
"""Units that the ranges of a CSV may have, in metres."""


def range_rules(
    limits: tuple[float, float] | None, no_return: tuple[frozenset[str], tuple[float, ...]]
) -> RangeRules:
    """How ranges are judged, by limits [m] and by words and markers as of `sweeps.parse_no_return`.

    Raises
    ------
    OptionError
        The limits are no range.
    """
    if limits is not None:
        least, most = map(float, limits)
        if not 0 <= least < most:
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
) -> OpenOptions:
    """The geometry that a text log may lack, and which echo counts; the three angles are radians, or `degrees`.

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

    return OpenOptions(
        angle_min=radians("--angle-min", angle_min),
        angle_increment=radians("--angle-increment", angle_increment),
        fov=radians("--fov", fov),
        range_max=range_max,
        range_scale=UNITS[range_unit],
        echo=echo,
    )
