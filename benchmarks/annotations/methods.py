"""What is held against the judgements: each method gives the detection of every beam of the sweeps asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pyarrow as pa

import lidarcli
from benchmarks.accuracy.methods import METHODS
from lidarcli.sweeps import Int64, SweepBatch

Labels = dict[int, Int64]
"""Sweep → (B,) number of the detection of each beam, 0 for none."""
Method = Callable[[Sequence[SweepBatch], frozenset[int]], Labels]
"""Batches of one topic in the order of the log, the sweeps that are asked for → their labels."""


def one_by_one(find: Callable[[SweepBatch], Int64]) -> Method:
    """A method that sees one sweep at a time."""

    def method(batches: Sequence[SweepBatch], wanted: frozenset[int]) -> Labels:
        found: Labels = {}
        for batch in batches:
            rows = np.flatnonzero(np.isin(batch.sweep, list(wanted)))
            if len(rows):
                part = batch.rows(rows)
                found |= dict(zip(part.sweep.tolist(), find(part), strict=True))
        return found

    return method


def tracked(batches: Sequence[SweepBatch], wanted: frozenset[int]) -> Labels:
    """`track`, which sees the whole log."""
    return from_rows(lidarcli.track(batches).objects, batches, wanted)


def from_rows(objects: pa.Table, batches: Sequence[SweepBatch], wanted: frozenset[int]) -> Labels:
    """The labels that rows of the objects table give: the beams from the first to the last that have a range."""
    found: Labels = {}
    for batch in batches:
        for row in range(len(batch)):
            if int(batch.sweep[row]) in wanted:
                found[int(batch.sweep[row])] = np.zeros(batch.width, np.int64)
    names = ("sweep", "object", "beam_i", "beam_f")
    columns = (objects[name].to_numpy() for name in names)
    for sweep, number, first, last in zip(*columns, strict=True):
        labels = found.get(int(sweep))
        if labels is None:
            continue
        if first <= last:
            labels[first : last + 1] = number
        else:
            labels[first:] = labels[: last + 1] = number
    return found


ROBUST, TRACK = "detect", "track"
COMPARED: dict[str, Method] = {
    ROBUST: one_by_one(METHODS["robust"]),
    TRACK: tracked,
    **{name: one_by_one(find) for name, find in METHODS.items() if name != "robust"},
}
"""With default options, or as published."""
