"""The echoes of a MultiEchoLaserScan: one of each beam, message by message.

Behind the geometry stand two lists, of ranges and of intensities. Each has an entry per beam: a count, and so many floats.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps import Float32

Words = NDArray[np.uint32]
Places = NDArray[np.intp]

_NOWHERE = np.zeros(0, np.intp)


class Echoes(NamedTuple):
    """One echo of each of B beams, NaN for a beam that has none."""

    ranges: Float32
    intensities: Float32
    """(B,) empty where the message has none."""


def choose(words: Words, beams: int, echo: str) -> Echoes | None:
    """One echo of each beam: the `first`, the `last`, or the `strongest`, which without intensities is the first.

    Parameters
    ----------
    words : what stands behind the number of beams, up to the end of the message
    beams : as many entries as the message declares

    Returns
    -------
    None where the echoes pass the end of the message; intensities that do are none
    """
    found = _starts(words, beams)
    if found is None:
        return None
    starts, end = found
    strength = _NOWHERE
    if end < len(words) and 0 < words[end] <= len(words) - end - 1:
        entries = min(int(words[end]), beams)
        behind = _starts(words[end + 1 :], entries)
        if behind is not None:
            strength = behind[0] + end + 1
    count = words[starts].astype(np.intp)
    strengths = np.zeros(beams, np.intp)
    strengths[: len(strength)] = words[strength]
    place = np.zeros(beams, np.intp)
    place[: len(strength)] = strength
    which = np.zeros(beams, np.intp)
    if echo == "last":
        which = np.maximum(count - 1, 0)
    elif echo == "strongest":
        which = _strongest(words, place, np.minimum(count, strengths))
    values = np.append(words, np.uint32(0)).view(np.float32)
    nothing = np.float32(np.nan)
    ranges = np.where(count > 0, values[np.minimum(starts + 1 + which, len(words))], nothing)
    if not strengths.any():
        return Echoes(ranges, np.empty(0, np.float32))
    has_both = (count > 0) & (which < strengths)
    return Echoes(ranges, np.where(has_both, values[np.where(has_both, place + 1 + which, -1)], nothing))


def _starts(words: Words, beams: int) -> tuple[Places, int] | None:
    """Where the count of each entry of a list stands, and where the list ends; None where it passes the end."""
    if not beams:
        return _NOWHERE, 0
    if not len(words):
        return None
    step = int(words[0]) + 1
    if step * beams <= len(words):
        at = np.arange(beams) * step
        if (words[at] == words[0]).all():
            return at, step * beams
    counts = words.tolist()
    starts = []
    place = 0
    for _ in range(beams):
        if place >= len(counts):
            return None
        starts.append(place)
        place += 1 + counts[place]
    return (np.array(starts, np.intp), place) if place <= len(counts) else None


def _strongest(words: Words, place: Places, count: Places) -> Places:
    """(B,) which of its first `count` echoes is the strongest, by the list of intensities; the first where none is."""
    which = np.zeros(len(count), np.intp)
    several = np.flatnonzero(count > 1)
    values = words.view(np.float32)
    # A beam of very many echoes does not make the others as wide as itself.
    for echoes in np.unique(count[several]).tolist():
        rows = several[count[several] == echoes]
        strengths = values[place[rows, None] + 1 + np.arange(echoes)]
        which[rows] = np.argmax(np.where(np.isnan(strengths), -np.inf, strengths), axis=1)
    return which
