"""What is held against the judgements: each method gives the detection of every beam of the sweeps asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa

from benchmarks.accuracy.methods import METHODS, labels_of
from benchmarks.thing.examples import EVERYTHING
from benchmarks.thing.grow import Grown, odds
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.mapping.places import Places
from lidarcli.sweeps.types import Int64, SweepBatch

ROBUST, TRACK = "detect", "track"
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


def held_out(batches: Sequence[SweepBatch], grown: Grown, wanted: frozenset[int]) -> dict[str, Labels]:
    """What `detect` and `track` take for things by other trees than those of the package."""
    known, least = Places(), Parameters().min_thing
    found: list[tuple[SweepBatch, Detection, Int64]] = []
    for batch in batches:
        seen = detect(batch, EVERYTHING, per_beam=True, explain=True)
        assert seen.features is not None
        told = replace(seen, thing=1.0 / (1.0 + np.exp(-odds(*grown, seen.features))))
        found.append((batch, told, known.add(batch, told)))
    labels: dict[str, Labels] = {ROBUST: {}, TRACK: {}}
    for batch, told, worlds in found:
        for name, thing in ((ROBUST, told.thing), (TRACK, known.judged(batch, told, worlds, least).thing)):
            first = np.searchsorted(told.row, np.arange(len(batch)))[:, None]
            number = labels_of(told)
            body = np.clip(first + number - 1, 0, max(len(told) - 1, 0))
            kept = np.where((number > 0) & (thing[body] >= least), number, 0) if len(told) else number
            labels[name] |= {
                int(batch.sweep[row]): kept[row] for row in np.flatnonzero(np.isin(batch.sweep, list(wanted))).tolist()
            }
    return labels


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


PUBLISHED: dict[str, Method] = {name: one_by_one(find) for name, find in METHODS.items() if name != "robust"}
"""As published."""
