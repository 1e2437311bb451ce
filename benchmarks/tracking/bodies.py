"""What the table of tracks says of the bodies themselves: their shapes and sizes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.tracking.recordings import Detected, Recording
from lidarcli.formalism.detection import SHAPES
from lidarcli.formalism.tracking.results import Tracks
from lidarcli.sweeps import Float64, Int64

EXPECTED = {"box": "prismatic", "cylinder": "round", "plant": "irregular", "person": "legged"}
"""Kind of entity → shape of its track."""
SIGHTINGS = 20
"""Tracks seen in fewer sweeps are not asked."""
_NOTHING = np.empty(0)


@dataclass(frozen=True, eq=False, slots=True)
class Bodies:
    """The tracks of one log that are of one entity each."""

    shapes: dict[tuple[str, str], int] = field(default_factory=dict)
    """(kind, shape) → tracks."""
    length_errors: Float64 = field(default_factory=_NOTHING.copy)
    """Of boxes and cylinders [m], the longer side."""
    width_errors: Float64 = field(default_factory=_NOTHING.copy)
    deviations: Float64 = field(default_factory=_NOTHING.copy)
    """Errors of both sides as multiples of the standard deviations that the table states."""


def bodies(recording: Recording, found: Detected, track: Int64, tracks: Tracks) -> Bodies:
    """Compare the table of tracks with the entities that most of their objects are of."""
    shapes: dict[tuple[str, str], int] = {}
    lengths, widths, deviations = [], [], []
    for row, number in enumerate(tracks.track.tolist()):
        of = found.entity[(track == number) & (found.entity >= 0)]
        if len(of) < SIGHTINGS:
            continue
        entity = int(np.bincount(of).argmax())
        kind = recording.kinds[entity]
        if kind not in EXPECTED:
            continue
        key = kind, SHAPES[tracks.shape[row]]
        shapes[key] = shapes.get(key, 0) + 1
        if kind in ("box", "cylinder") and np.isfinite(tracks.length[row] + tracks.width[row]):
            true = np.sort(recording.size[entity])[::-1]
            off = np.array([tracks.length[row], tracks.width[row]]) - true
            lengths.append(off[0])
            widths.append(off[1])
            deviations += (off / np.array([tracks.length_sd[row], tracks.width_sd[row]])).tolist()
    return Bodies(shapes, np.array(lengths), np.array(widths), np.array(deviations))
