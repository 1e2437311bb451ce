"""Batches of sweeps for the tests: from plain lists, rotated, mirrored, cut into pieces, put together again."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism import Detection
from lidarcli.formalism.detection import REQUIRED, fields_per
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Closure, RawSweeps, SweepBatch
from tests.formalism.reference import EACH_BEARING_ONCE, FIRST_BEARING_TWICE, NO_TURN, Sweep
from tests.sweeping import raw_sweeps

CLOSING = {NO_TURN: Closure.OPEN, EACH_BEARING_ONCE: Closure.CLOSED, FIRST_BEARING_TWICE: Closure.SHARED}


def raw_of(sweeps: list[Sweep], width: int | None = None) -> RawSweeps:
    """Sweeps of any beam counts in one block, padded to the widest."""
    beams = np.array([len(sweep.ranges) for sweep in sweeps], np.int32)
    rows = len(sweeps)
    # Padding may hold anything; a plausible range would do the most harm.
    ranges = np.full((rows, width or int(beams.max(initial=0))), 1.25, np.float32)
    for row, sweep in enumerate(sweeps):
        ranges[row, : beams[row]] = sweep.ranges
    return raw_sweeps(
        ranges,
        stamp_ns=np.arange(1, rows + 1) * 100_000_000,
        angle_min=[sweep.angle_min for sweep in sweeps],
        angle_increment=[sweep.angle_increment for sweep in sweeps],
        range_min=0.0,
        range_max=100.0,
        beams=beams,
    )


def batch_of(sweeps: list[Sweep], width: int | None = None) -> SweepBatch:
    """The same, normalised; the closing that a sweep claims must be what its geometry says."""
    batch = normalise(raw_of(sweeps, width), np.arange(len(sweeps)), RangeRules())
    assert [CLOSING[sweep.closing] for sweep in sweeps] == batch.closure.tolist()
    return batch


def spans(found: Detection) -> list[tuple[int, int]]:
    """(beam_i, beam_f) of every object."""
    return list(zip(found.beam_i.tolist(), found.beam_f.tolist(), strict=True))


def rows_of(batch: SweepBatch, rows: slice) -> SweepBatch:
    """Some rows of a batch."""
    return batch.rows(np.arange(len(batch))[rows])


PER_OBJECT, PER_VERTEX, PER_FACE, PER_SWEEP = (
    [name for name in fields_per(per) if name in {*REQUIRED} - {"row"}] for per in ("object", "vertex", "face", "sweep")
)
PER_BEAM = ("beam_set", "beam_object", "beam_s")


def joined(parts: list[Detection], sizes: list[int]) -> dict[str, np.ndarray]:
    """The arrays of consecutive detections put together as one detection of all rows would hold them."""
    first_row = np.cumsum([0, *sizes[:-1]])
    together = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in (*PER_OBJECT, *PER_VERTEX, *PER_FACE, *PER_SWEEP, *PER_BEAM)
    }
    together["row"] = np.concatenate([part.row + first for part, first in zip(parts, first_row, strict=True)])
    for name in ("vertex_offsets", "face_offsets"):
        together[name] = np.concatenate([np.diff(getattr(part, name)) for part in parts])
    return together
