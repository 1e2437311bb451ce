"""Things and building that are kept, by labels that the map of the whole log gives, where nobody judged most sweeps.

A body on a long line of the map is building, one on an island is a thing, and others, about half, do not count. The logs
are those with corrected poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import lidarcli
from benchmarks.annotations.choice import CHOSEN, Chosen
from benchmarks.annotations.table import BUILDING, THING, Sweep
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.mapping.grid import HIT, SKIPPED, Beams, Counts, MotionFilter, placed
from lidarcli.formalism.mapping.places import FARTHEST, Places, islands, lines
from lidarcli.sweeps import Bool, Float64, Int32, Int64, SweepBatch

FOLDER, POSES = "carmen_ple/", "/corrected"
CELL, MOST_CELLS = 0.05, 1 << 30
"""[m] Side of a cell of the map; greatest number of them."""
STEP = 0.05
"""[m] Least way from one sweep of the map to the next."""
MOSTLY = 0.85
"""Share of the beams of a body that are on lines, or on islands."""
RECALL = 0.95
JUDGED = 0.7
"""Share of the beams of a body that have one verdict by eye."""
NEITHER = -1


@dataclass(frozen=True, eq=False, slots=True)
class Building:
    """N bodies of one log that its map tells."""

    label: Int64
    """(N,) `THING` or `BUILDING`."""
    sweep: Float64
    """(N,) probability of being a thing by one sweep."""
    votes: Float64
    """(N,) the same by the votes of all sweeps at its place, without the map."""
    judged: int
    """Bodies of judged sweeps among them."""
    right: int
    """Those with the label that they have by eye."""

    def count(self, verdict: int) -> int:
        """Return the number of bodies with a label."""
        return int(np.sum(self.label == verdict))

    def kept(self, verdict: int, least: float) -> float:
        """Return the share of the bodies with a label that one sweep takes for things with at least this probability."""
        return float(np.mean(self.sweep[self.label == verdict] >= least))

    def building_kept(self, thing: Float64) -> float:
        """Return the share of building that is kept where `RECALL` of the things are; `thing` (N,) as `sweep`."""
        least = np.quantile(thing[self.label == THING], 1.0 - RECALL)
        return float(np.mean(thing[self.label == BUILDING] >= least))


def chosen_logs(folder: Path) -> list[Chosen]:
    """Return the logs that are there."""
    return [each for each in CHOSEN if each.log.startswith(FOLDER) and each.path(folder).exists()]


def sweeps_of(folder: Path, chosen: Chosen) -> Iterator[SweepBatch]:
    """Return the sweeps of a log with its corrected poses."""
    return lidarcli.read(chosen.path(folder), topic=chosen.topic, pose=POSES)


def measure(batches: Iterable[SweepBatch], judged: dict[int, Sweep]) -> Building:
    """Label the bodies of a topic whose sweeps have poses, and tell what is kept of them; `judged` by sweep."""
    places = Places()
    counts, motion = Counts(CELL, MOST_CELLS), MotionFilter(STEP)
    seen: list[tuple[SweepBatch, Detection, Int64]] = []
    for batch in batches:
        detection = detect(batch, Parameters(min_thing=0.0), per_beam=True)
        seen.append((batch, detection, places.add(batch, detection)))
        assert batch.poses is not None
        taken = motion.take(batch.poses, batch.stamp_ns)
        if len(taken):
            counts.add(_ends(batch).rows(taken))
    on_line, on_island = _layer(counts, lines, 0), _layer(counts, islands, 1)
    parts = []
    for batch, detection, worlds in seen:
        body, ends = _bodies(batch, detection), _ends(batch)
        line, island = (_share(body, _at(layer, counts, ends), len(detection)) for layer in (on_line, on_island))
        label = np.where(line >= MOSTLY, BUILDING, np.where((island >= MOSTLY) & (line == 0.0), THING, NEITHER))
        votes = 1.0 / (1.0 + np.exp(-places.read(batch, detection, worlds).place))
        by_eye = _by_eye(batch, body, judged, len(detection))
        kept = (label != NEITHER) & ~np.isnan(votes)
        parts.append([each[kept] for each in (label, detection.thing, votes, by_eye)])
    label, sweep, votes, by_eye = (np.concatenate(each) for each in zip(*parts, strict=True))
    told = by_eye != NEITHER
    return Building(label, sweep, votes, int(told.sum()), int(np.sum(label[told] == by_eye[told])))


def _ends(batch: SweepBatch) -> Beams:
    """Return the beams of sweeps with poses, but those that go too far."""
    assert batch.poses is not None
    use = np.where(batch.ranges <= FARTHEST, np.uint8(HIT), np.uint8(SKIPPED))
    return placed(batch, batch.poses, use)


def _layer(counts: Counts, which: Callable[[Int32, Int32, float], Int64], grow: int) -> Bool:
    """Return (H, W) True for the cells of the map that `which` gives, and for so many around them."""
    layer: Bool = np.zeros(counts.hits.shape, np.bool_)
    row, column = np.divmod(which(counts.hits, counts.passes, CELL), layer.shape[1])
    for down in range(-grow, grow + 1):
        for right in range(-grow, grow + 1):
            layer[(row + down).clip(0, len(layer) - 1), (column + right).clip(0, layer.shape[1] - 1)] = True
    return layer


def _at(layer: Bool, counts: Counts, beams: Beams) -> Bool:
    """Return (S, B) True for the beams that end in cells of a layer."""
    known = np.isfinite(beams.end).all(axis=0)
    cell = np.floor(np.where(known, beams.end, 0.0) / CELL).astype(np.int64)
    column, row = cell[0] - counts.column, cell[1] - counts.row
    known &= (column >= 0) & (row >= 0) & (column < layer.shape[1]) & (row < len(layer))
    found: Bool = known & layer[row.clip(0, len(layer) - 1), column.clip(0, layer.shape[1] - 1)]
    return found


def _bodies(batch: SweepBatch, detection: Detection) -> Int64:
    """Return (S, B) the body of each beam, -1 for none."""
    assert detection.beam_object is not None
    first = np.searchsorted(detection.row, np.arange(len(batch)))
    return np.where(detection.beam_object > 0, first[:, None] + detection.beam_object - 1, -1)


def _share(body: Int64, on: Bool, count: int) -> Float64:
    """Return (K,) the share of the beams of each body that are on something."""
    mine = body >= 0
    beams = np.bincount(body[mine], minlength=count)
    return np.bincount(body[mine], on[mine], minlength=count) / np.maximum(beams, 1)


def _by_eye(batch: SweepBatch, body: Int64, judged: dict[int, Sweep], count: int) -> Int64:
    """Return (K,) the verdicts by eye: `THING`, `BUILDING`, or `NEITHER` where nobody looked, or it is not clear."""
    verdict = np.full(body.shape, NEITHER)
    for row, sweep in enumerate(batch.sweep.tolist()):
        if sweep in judged:
            verdict[row] = judged[sweep].beams(batch.width)[0]
    found = np.full(count, NEITHER)
    for kind in (THING, BUILDING):
        found[_share(body, verdict == kind, count) >= JUDGED] = kind
    return found
