"""How well tracks agree with the truth: HOTA, IDF1 and MOTA, with the overlap of sets of beams as similarity.

HOTA: Luiten et al., International Journal of Computer Vision 129, 2021. IDF1: Ristani et al. 2016. MOTA: Bernardin and
Stiefelhagen 2008.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from lidarcli.sweeps.types import Bool, Float64, Int64, record

ALPHAS = np.arange(0.05, 0.99, 0.05)
"""The 19 similarities from which on HOTA takes two for the same."""
HALF = 0.5
"""The similarity from which on IDF1, MOTA and the switches do."""
_LITTLE = 1e-9
"""Rounding: a similarity that is smaller by less is not."""


@record
class Overlaps:
    """What S sweeps hold of truth and of tracks, and where the two overlap."""

    sweeps: int
    truth_sweep: Int64
    """(G,) sweep of each truth row; a row is one entity in one sweep, and rows are ordered by sweep."""
    truth: Int64
    """(G,) entity, from 0 without a gap."""
    track_sweep: Int64
    """(T,)"""
    track: Int64
    """(T,) track, from 0 without a gap."""
    pair_truth: Int64
    """(P,) row of the truth and …"""
    pair_track: Int64
    """(P,) … row of the tracks that share beams."""
    similarity: Float64
    """(P,) the beams that they share, as a share of all their beams, above 0 to 1."""

    @property
    def entities(self) -> int:
        """How many there are."""
        return int(self.truth.max(initial=-1)) + 1

    @property
    def tracks(self) -> int:
        """How many there are."""
        return int(self.track.max(initial=-1)) + 1


@dataclass(frozen=True, slots=True)
class Agreement:
    """The figures of one log."""

    hota: float
    detection: float
    """DetA."""
    association: float
    """AssA."""
    idf1: float
    mota: float
    switches: int
    entities: int
    tracks: int


def overlaps(truth: Int64, tracks: Int64, ignored: Bool | None = None) -> Overlaps:
    """Rows and overlaps from labelled beams.

    Parameters
    ----------
    truth, tracks : (S, B) number of the entity and of the track of each beam, -1 for none. All beams of a track in a sweep
        are one set, however many objects they come from
    ignored : (S, B) beams on what is not asked for: a track most of whose beams in a sweep are of this kind does not count
        there, neither for nor against
    """
    if ignored is not None:
        tracks = np.where(_mostly(tracks, ignored), -1, tracks)
        truth = np.where(ignored, -1, truth)
    truth_sweep, truth_id, truth_row, truth_size = _rows(truth)
    track_sweep, track_id, track_row, track_size = _rows(tracks)
    both = (truth_row >= 0) & (track_row >= 0)
    width = max(len(track_id), 1)
    pairs, shared = np.unique(truth_row[both] * width + track_row[both], return_counts=True)
    of_truth, of_track = np.divmod(pairs, width)
    union = truth_size[of_truth] + track_size[of_track] - shared
    return Overlaps(len(truth), truth_sweep, truth_id, track_sweep, track_id, of_truth, of_track, shared / union)


def agreement(found: Overlaps) -> Agreement:
    """All figures of one log."""
    hota, detection, association = _hota(found)
    mota, switches = _clear(found)
    return Agreement(hota, detection, association, _idf1(found), mota, switches, found.entities, found.tracks)


def _rows(labels: Int64) -> tuple[Int64, Int64, Int64, Int64]:
    """Sweep and dense number of each row, row of each beam (S, B), beams of each row."""
    sweep, beam = np.nonzero(labels >= 0)
    span = int(labels.max(initial=0)) + 1
    rows, of_beam, size = np.unique(sweep * span + labels[sweep, beam], return_inverse=True, return_counts=True)
    row = np.full(labels.shape, -1)
    row[sweep, beam] = of_beam
    _, number = np.unique(rows % span, return_inverse=True)
    return rows // span, number, row, size


def _mostly(tracks: Int64, ignored: Bool) -> Bool:
    """(S, B) beams of tracks more than half of whose beams in the sweep are ignored."""
    _, _, row, size = _rows(tracks)
    known = row >= 0
    share = np.bincount(row[known], ignored[known], minlength=len(size)) / np.maximum(size, 1)
    result = np.zeros(tracks.shape, np.bool_)
    result[known] = share[row[known]] > 0.5
    return result


def _hota(found: Overlaps) -> tuple[float, float, float]:
    """HOTA, DetA and AssA: means over all thresholds."""
    entities, tracks = found.entities, found.tracks
    if not entities or not tracks:
        return 0.0, 0.0, 0.0
    truth, track = found.truth[found.pair_truth], found.track[found.pair_track]
    of_truth = np.bincount(found.truth, minlength=entities)
    of_track = np.bincount(found.track, minlength=tracks)

    # How well an entity and a track go together in all, which decides where several assignments are possible.
    sum_truth = np.bincount(found.pair_truth, found.similarity, minlength=len(found.truth))
    sum_track = np.bincount(found.pair_track, found.similarity, minlength=len(found.track))
    either = sum_truth[found.pair_truth] + sum_track[found.pair_track] - found.similarity
    together = np.zeros((entities, tracks))
    np.add.at(together, (truth, track), found.similarity / either)
    together /= of_truth[:, None] + of_track[None, :] - together

    matched = _assigned(found, together[truth, track] * found.similarity)
    truth, track, similarity = truth[matched], track[matched], found.similarity[matched]
    figures = []
    for alpha in ALPHAS:
        same = similarity >= alpha - _LITTLE
        right = int(np.count_nonzero(same))
        detection = right / (len(found.truth) + len(found.track) - right)
        count = np.zeros((entities, tracks))
        np.add.at(count, (truth[same], track[same]), 1)
        jaccard = count / (of_truth[:, None] + of_track[None, :] - count)
        association = float((count * jaccard).sum()) / max(right, 1)
        figures.append((np.sqrt(detection * association), detection, association))
    hota, detection, association = np.mean(figures, axis=0)
    return float(hota), float(detection), float(association)


def _clear(found: Overlaps) -> tuple[float, int]:
    """MOTA and the number of switches: an entity's track is another one than when it was last matched."""
    # From one half on, at most one track shares so much with an entity, but two may share exactly one half.
    usable = np.flatnonzero(found.similarity >= HALF - _LITTLE)
    sweeps = found.truth_sweep[found.pair_truth[usable]]
    last = np.full(found.entities, -1)
    matches = switches = 0
    for start, end in _runs(sweeps):
        pairs = usable[start:end]
        truth, track = found.truth[found.pair_truth[pairs]], found.track[found.pair_track[pairs]]
        kept = last[truth] == track
        chosen = _assignment(found.pair_truth[pairs], found.pair_track[pairs], found.similarity[pairs] + 1000.0 * kept)
        truth, track = truth[chosen], track[chosen]
        matches += len(chosen)
        switches += int(np.count_nonzero((last[truth] >= 0) & (last[truth] != track)))
        last[truth] = track
    wrong = len(found.truth) + len(found.track) - 2 * matches + switches
    return 1.0 - wrong / max(len(found.truth), 1), switches


def _idf1(found: Overlaps) -> float:
    """The share of rows that are right when each entity has one track for the whole log."""
    same = found.similarity >= HALF - _LITTLE
    count = np.zeros((found.entities, found.tracks))
    np.add.at(count, (found.truth[found.pair_truth[same]], found.track[found.pair_track[same]]), 1)
    rows, columns = linear_sum_assignment(count, maximize=True)
    total = len(found.truth) + len(found.track)
    return float(2.0 * count[rows, columns].sum() / total) if total else 0.0


def _assigned(found: Overlaps, score: Float64) -> Int64:
    """The pairs of the best one-to-one assignment of every sweep."""
    chosen = [
        start + _assignment(found.pair_truth[start:end], found.pair_track[start:end], score[start:end])
        for start, end in _runs(found.truth_sweep[found.pair_truth])
    ]
    return np.concatenate(chosen) if chosen else np.empty(0, np.int64)


def _assignment(left: Int64, right: Int64, score: Float64) -> Int64:
    """The pairs (K,) of the one-to-one assignment with the greatest sum; scores are above 0."""
    lefts, row = np.unique(left, return_inverse=True)
    rights, column = np.unique(right, return_inverse=True)
    if len(lefts) == len(left) and len(rights) == len(right):
        return np.arange(len(left))
    table = np.zeros((len(lefts), len(rights)))
    which = np.full(table.shape, -1)
    table[row, column] = score
    which[row, column] = np.arange(len(left))
    chosen: Int64 = which[linear_sum_assignment(table, maximize=True)]
    return chosen[chosen >= 0]


def _runs(values: Int64) -> list[tuple[int, int]]:
    """Begin and end of each run of equal values."""
    if not len(values):
        return []
    edges = np.flatnonzero(np.diff(values)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(values)], strict=True))
