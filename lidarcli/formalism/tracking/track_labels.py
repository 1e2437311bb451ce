"""Labels of tracks (§3, matching): the object of interest that each one is, by all that was measured of it so far."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import Detection
from lidarcli.formalism.matching.catalogue import Catalogue, Evidence, evidence_of
from lidarcli.formalism.matching.catalogue import name as label_tracks
from lidarcli.formalism.tracking.results import BOX, SIZE_OUTLIER
from lidarcli.formalism.tracking.tracks import Track, Tracklet, frame_of_legs, main_part, shape_odds
from lidarcli.sweeps.types import Float64, Int64, SweepBatch


@dataclass(frozen=True)
class SizeRules:
    """How the sizes that sweeps measure make one size of a track."""

    max_views: int = 256
    """Views of a tracklet (by the beams at its edges) that are kept; further ones are left out."""
    half_weight_sweeps: float = 2.0
    """A view of so many sweeps counts half: beams at the same edges err alike."""
    shared_sd_share: float = 0.4
    """Share of the standard deviation that all views have in common, so that more views do not reduce it."""
    min_sd: float = 0.003
    """[m] No size has a smaller standard deviation, by the sweeps of one log."""


SIZE = SizeRules()

SIZES = 3
"""Number of sizes: sides along both axes, and the extent across the line of sight."""


SIZE_MEASUREMENT = np.dtype(
    [
        ("size", np.float64, (SIZES,)),
        ("sd", np.float64, (SIZES,)),
        ("yaw", np.float64),
        ("blur", np.float64),
        ("intensity", np.float64),
        ("edges", np.int64),
    ]
)
"""Of an object in one sweep: sides along both axes of the box and the extent across the line of sight [m], NaN where
not observed; their standard deviations [m]; direction of the first axis in the world [rad]; standard deviation of the
distance of two legs at that range [m]; median intensity, NaN without; first and last beam as one number."""

SizeMeasurements: TypeAlias = NDArray[np.void]
"""(K,) `SIZE_MEASUREMENT`."""


@dataclass(slots=True)
class _SizeEstimate:
    """Measured sizes of one tracklet."""

    kind: int
    yaw: float
    """Direction of the first axis at the first sighting [rad], for discs."""
    looks: dict[int, Float64] = field(default_factory=dict)
    """(3, SIZES) number of sightings, sum of weights [1/m²] and weighted sum of sizes, by the beams at the edges."""
    sightings: int = 0
    blur: float = 0.0
    """Mean of the measured blur."""
    lit: int = 0
    """Number of sightings with an intensity."""
    intensity: float = math.nan
    """Mean intensity."""
    known: Float64 | None = None
    """Final estimate, once the tracklet has ended."""

    def take(self, measured: SizeMeasurements, at: Int64, turned: Any) -> None:
        """Add sightings; `turned` is True where the first axis of a sighting is the second one of the tracklet."""
        size, sd = measured["size"][at], measured["sd"][at]
        for values in (size, sd):
            values[turned, :2] = values[turned, 1::-1]
        known = np.isfinite(size)
        weight = np.where(known, 1.0 / np.square(np.where(known, sd, 1.0)), 0.0)
        sums = np.stack([known.astype(float), weight, weight * np.where(known, size, 0.0)], axis=1)
        each, inverse = np.unique(measured["edges"][at], return_inverse=True)
        total = np.zeros((len(each), 3, SIZES))
        np.add.at(total, inverse, sums)
        for edges, more in zip(each.tolist(), total, strict=True):
            if edges in self.looks:
                self.looks[edges] += more
            elif len(self.looks) < SIZE.max_views and more[0].any():
                self.looks[edges] = more
        self.sightings += len(at)
        self.blur += float((measured["blur"][at] - self.blur).sum()) / self.sightings
        lit = measured["intensity"][at]
        lit = lit[~np.isnan(lit)]
        if len(lit):
            before = self.intensity if self.lit else 0.0
            self.lit += len(lit)
            self.intensity = before + float((lit - before).sum()) / self.lit

    def estimate(self) -> Float64:
        """Return (SIZES, 2) each size and its standard deviation [m]; NaN where it was not observed."""
        if self.known is not None:
            return self.known
        result = np.full((SIZES, 2), np.nan)
        if self.looks:
            sums = np.array(list(self.looks.values()))
            for one in range(SIZES):
                count, weight, total = sums[sums[:, 0, one] > 0, :, one].T
                if len(count):
                    result[one] = _mean(count, weight / count, total / weight)
        return result

    def close(self) -> None:
        """Keep the estimate only."""
        self.known = self.estimate()
        self.looks.clear()


def _mean(count: Float64, weight: Float64, size: Float64) -> tuple[float, float]:
    """Return the mean size and its standard deviation [m], by the sightings, weights per sighting and sizes of looks."""
    order = np.argsort(size, kind="stable")
    half = np.searchsorted(np.cumsum(count[order]), 0.5 * count.sum())
    off = size - size[order[half]]
    share = weight * count / (count + SIZE.half_weight_sweeps) / (1.0 + np.square(off) / (SIZE_OUTLIER + 1.0 / weight))
    total = share.sum()
    looks = total * total / np.square(share).sum()
    variance = (
        total
        / float((share * weight).sum())
        * (1.0 / looks + SIZE.shared_sd_share * SIZE.shared_sd_share * (1.0 - 1.0 / looks))
    )
    return float((share * size).sum() / total), float(np.hypot(math.sqrt(variance), SIZE.min_sd))


class TrackLabels:
    """TrackLabels of the tracks of one topic, window by window."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._sizes: dict[int, _SizeEstimate] = {}
        """Sizes by number of the tracklet."""

    def measure(self, batch: SweepBatch, detection: Detection, poses: Float64) -> SizeMeasurements:
        """Measure the K objects of a batch; `poses`: (K, 4) x, y, yaw and side of the sensor at each of them."""
        evidence = evidence_of(batch, detection)
        found = np.empty(len(detection), SIZE_MEASUREMENT)
        found["size"] = np.column_stack([evidence.side_1, evidence.side_2, evidence.across])
        found["sd"] = np.column_stack([evidence.side_1_sd, evidence.side_2_sd, evidence.across_sd])
        found["yaw"] = poses[:, 2] + poses[:, 3] * detection.box_yaw
        found["blur"], found["intensity"] = evidence.span_sd, evidence.intensity
        found["edges"] = (detection.beam_i.astype(np.int64) << 32) + detection.beam_f
        return found

    def take(self, pieces: list[SizeMeasurements], number: Int64, axes: Float64, known: dict[int, Tracklet]) -> None:
        """Add the measurements of a window.

        Parameters
        ----------
        pieces : measurements of K objects
        number : (K,) number of the tracklet of each object, 0 without one that is confirmed
        axes : (K,) direction of the first axis of the tracklet at the time [rad]; NaN for a disc
        known : confirmed tracklets, by number
        """
        if not pieces:
            return
        measured = np.concatenate(pieces)
        order = np.argsort(number, kind="stable")
        tracklets, begins = np.unique(number[order], return_index=True)
        for tracklet, at in zip(tracklets.tolist(), np.split(order, begins[1:]), strict=True):
            if tracklet == 0:
                continue
            is_box = known[tracklet].kind == BOX
            # Before it became a box it had other axes.
            rows = at[np.isfinite(axes[at]) == is_box]
            if not len(rows):
                continue
            sizes = self._sizes.get(tracklet)
            if sizes is None or sizes.kind != known[tracklet].kind:
                sizes = self._sizes[tracklet] = _SizeEstimate(known[tracklet].kind, float(measured["yaw"][rows[0]]))
            off = measured["yaw"][rows] - (axes[rows] if is_box else sizes.yaw)
            sizes.take(measured, rows, np.abs(np.sin(off)) > np.abs(np.cos(off)))

    def label(self, tracks: list[Track]) -> None:
        """Label tracks by all that was observed of them so far."""
        if not tracks:
            return
        rows = [self._of(track) for track in tracks]
        columns: dict[str, Any] = {key: np.array([row[key] for row in rows], float) for key in rows[0]}
        columns["legs"] = columns["legs"].astype(np.int32)
        columns["moved"] = columns["moved"].astype(np.bool_)
        shape = np.array([shape_odds(each, main_part(each)) for each in tracks])
        label, score = label_tracks(Evidence(shape=shape, **columns), self._catalogue)
        for track, one, sure in zip(tracks, label.tolist(), score.tolist(), strict=True):
            track.label, track.label_score = one, sure

    def forget(self, numbers: list[int]) -> None:
        """Keep only the estimates of these tracklets, which have ended."""
        for number in numbers:
            if number in self._sizes:
                self._sizes[number].close()

    def _of(self, track: Track) -> dict[str, float]:
        """Return the evidence of a track, without its shape."""
        tracklet = main_part(track)
        sizes = self._sizes.get(tracklet.number)
        frame = frame_of_legs(track)
        row = dict.fromkeys(_MEASURED, np.nan)
        row |= {"legs": 0.0, "moved": float(track.moved), "least_sd": SIZE.min_sd, "span_sd": SIZE.min_sd}
        row["intensity"] = math.nan if sizes is None else sizes.intensity
        if frame is not None:
            # The sizes of one leg tell nothing about the whole.
            row |= {"legs": float(frame["legs"]), "span_1": frame["length"]}
            row["span_2"] = frame["width"] if frame["legs"] > 2 else np.nan
            row["span_sd"] = SIZE.min_sd if sizes is None else sizes.blur
        elif any(part.has_legs for part in track.parts) or track.several:
            row["legs"] = 2.0
        elif sizes is not None:
            estimate = sizes.estimate()
            for one, what in enumerate(("side_1", "side_2", "across")):
                row[what], row[what + "_sd"] = estimate[one]
            row["least_1"], row["least_2"] = tracklet.least
        return row


_MEASURED = (
    *("side_1", "side_1_sd", "side_2", "side_2_sd", "least_1", "least_2", "least_sd", "across", "across_sd"),
    *("span_1", "span_2", "span_sd"),
)
"""Fields of `Evidence` that are NaN where nothing was observed."""
