"""Trajectories as TUM text: a line for each pose, `timestamp x y z qx qy qz qw`, as evo and others read and write them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import TextIO

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.poses.motion import Motion
from lidarcli.poses.tracks import MAX_POSES, Track, gathered
from lidarcli.sweeps import Float64, Int64

TUM = "tum"
"""What a trajectory's type is called."""
WORLD = "world"
"""The frame of a trajectory, which its file does not name."""
COLUMNS = 8
LONGEST_LINE = 1000
"""Characters of a line that can be a pose."""
MOST_NS = 1 << 62
"""No stamp is farther from 1970 [ns]: 146 years, so that differences of two still fit."""
MOST_DIGITS = 11
"""Digits of such a stamp before the point."""
_SECOND_NS = 1_000_000_000


def read_trajectory(path: Path) -> Track:
    """The path of a sensor from a file of TUM lines; empty lines and those that begin with `#` are left out.

    Raises
    ------
    UnreadableError
        The file cannot be read, a line is no pose, or there is none.
    """
    stamps: list[int] = []
    numbers: list[list[float]] = []
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, line in _lines(file):
                if not (text := line.strip()) or text.startswith("#"):
                    continue
                if len(stamps) == MAX_POSES:
                    raise UnreadableError(f"{path}: more than {MAX_POSES:,} poses")
                stamp, values = _pose(path, number, text)
                stamps.append(stamp)
                numbers.append(values)
    except OSError as err:
        raise UnreadableError(f"{path}: {err.strerror or err}") from err
    if not stamps:
        raise UnreadableError(f"{path}: holds no pose; lines are timestamp x y z qx qy qz qw")
    at, poses = np.array(stamps, np.int64), np.array(numbers, np.float64)
    refused: Counter[str] = Counter()
    track = gathered((path.name, TUM, WORLD, ""), at, poses, at, refused)
    if track is None or refused:
        cause, count = next(iter(refused.items()))
        raise UnreadableError(f"{path}: {count:,} of {len(stamps):,} poses cannot be used: {cause}")
    return track


def _lines(file: TextIO) -> Iterator[tuple[int, str]]:
    """The lines of a file by their numbers; of one that is too long only its beginning."""
    number = 0
    while line := file.readline(LONGEST_LINE):
        number += 1
        yield number, line
        while line and not line.endswith("\n"):
            line = file.readline(LONGEST_LINE)


def _pose(path: Path, number: int, text: str) -> tuple[int, list[float]]:
    """Stamp [ns], and x, y, z [m] and quaternion x, y, z, w of a line."""
    words = text.replace(",", " ").split()
    try:
        if len(words) != COLUMNS:
            raise ValueError
        # Seconds since 1970 with nine decimals are more than a float holds.
        seconds = Decimal(words[0])
        if not seconds.is_finite() or seconds.adjusted() > MOST_DIGITS:
            raise ValueError
        stamp = int((seconds * _SECOND_NS).to_integral_value())
        if abs(stamp) > MOST_NS:
            raise ValueError
        return stamp, [float(word) for word in words[1:]]
    except (ValueError, ArithmeticError):
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise UnreadableError(
            f"{path}: line {number}: '{shown}' is no pose; lines are timestamp x y z qx qy qz qw"
        ) from None


def trajectory_lines(stamp_ns: Int64, motion: Motion) -> str:
    """The lines of N poses; those that are not known are left out."""
    known = ~np.isnan(motion.position).any(axis=1)
    rows = zip(
        stamp_ns[known].tolist(),
        motion.position[known].tolist(),
        upright(motion.rotation[known]).tolist(),
        strict=True,
    )
    return "".join(
        f"{_seconds(stamp)} {_numbers(position, 6)} {_numbers(turn, 9)}\n" for stamp, position, turn in rows
    )


def _seconds(stamp_ns: int) -> str:
    sign = "-" if stamp_ns < 0 else ""
    whole, rest = divmod(abs(stamp_ns), _SECOND_NS)
    return f"{sign}{whole}.{rest:09d}"


def _numbers(values: list[float], decimals: int) -> str:
    # What is rounded to 0 has no sign.
    return " ".join(f"{round(value, decimals) + 0.0:.{decimals}f}" for value in values)


def upright(rotation: Float64) -> Float64:
    """Of the two quaternions of a rotation the one whose last number is not negative."""
    turned: Float64 = np.where(rotation[:, 3:] < 0, -rotation, rotation)
    return turned
