"""Names of tracks (§3, matching): which thing of interest each is, by all that was seen of it so far.

What one sweep says of sizes is that of `evidence`. As long as the same beams see the edges of a thing, more sweeps say
nothing new of where these are: such sightings are one look. Only other looks make a size better known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from lidarcli.formalism.catalogue import Catalogue, Evidence, name
from lidarcli.formalism.detection import Detection
from lidarcli.formalism.evidence import evidence_of
from lidarcli.formalism.tracking import summary
from lidarcli.formalism.tracking.things import Thing, Track
from lidarcli.formalism.tracking.tracked import BOX
from lidarcli.sweeps import Float64, Int64, SweepBatch, record

MOST_LOOKS = 256
"""So many looks at a thing are remembered."""
FEW = 2.0
"""A look of so many sweeps counts half."""
OUTLIER = 9e-4
"""[m²] A look at a size that is (3 cm)² off from most counts half."""
SHARED = 0.4
"""Share of its standard deviation by which all looks at a size are off alike."""
LEAST_SD = 0.003
"""[m] No size is known better by the sweeps of one log."""
SIZES = 3
"""Sides along both axes, and the extent across the line of sight."""


@record
class Looks:
    """What single sweeps say of K objects."""

    size: Float64
    """(K, SIZES) sides along both axes of its box, and extent across [m]; NaN where they were not seen."""
    sd: Float64
    """(K, SIZES) standard deviations of these [m]."""
    yaw: Float64
    """(K,) direction of its first axis in the world [rad]."""
    blur: Float64
    """(K,) standard deviation of the distance of two legs there [m]."""
    intensity: Float64
    """(K,) median intensity of its returns; NaN where there is none."""
    edges: Int64
    """(K,) its first and its last beam, as one number."""

    def rows(self, part: slice) -> Looks:
        """Of some of the objects."""
        return Looks(*(getattr(self, each.name)[part] for each in fields(self)))

    @staticmethod
    def joined(parts: list[Looks]) -> Looks:
        """Of one object after the other; there are parts."""
        return Looks(*(np.concatenate([getattr(one, each.name) for one in parts]) for each in fields(Looks)))


@dataclass(slots=True)
class _Sizes:
    """What was seen of the sizes of one body."""

    kind: int
    yaw: float
    """Direction of its first axis when it began [rad]: that of a disc, which has none of its own."""
    looks: dict[int, Float64] = field(default_factory=dict)
    """Beams at the edges → (3, SIZES) sightings, the sum of their weights [1/m²], and of what they measure by these."""
    sightings: int = 0
    blur: float = 0.0
    """Mean of `Looks.blur`."""
    lit: int = 0
    """Sightings whose intensity is known ..."""
    intensity: float = math.nan
    """... and the mean of these."""
    known: Float64 | None = None
    """The estimate, once nothing can come any more."""

    def take(self, looks: Looks, at: Int64, turned: Any) -> None:
        """Add sightings; `turned`: whether the first axis of each is the second one of the body."""
        size, sd = looks.size[at], looks.sd[at]
        for values in (size, sd):
            values[turned, :2] = values[turned, 1::-1]
        seen = np.isfinite(size)
        weight = np.where(seen, 1.0 / np.square(np.where(seen, sd, 1.0)), 0.0)
        sums = np.stack([seen.astype(float), weight, weight * np.where(seen, size, 0.0)], axis=1)
        each, inverse = np.unique(looks.edges[at], return_inverse=True)
        total = np.zeros((len(each), 3, SIZES))
        np.add.at(total, inverse, sums)
        for edges, more in zip(each.tolist(), total, strict=True):
            if edges in self.looks:
                self.looks[edges] += more
            elif len(self.looks) < MOST_LOOKS and more[0].any():
                self.looks[edges] = more
        self.sightings += len(at)
        self.blur += float((looks.blur[at] - self.blur).sum()) / self.sightings
        told = looks.intensity[at]
        told = told[~np.isnan(told)]
        if len(told):
            before = self.intensity if self.lit else 0.0
            self.lit += len(told)
            self.intensity = before + float((told - before).sum()) / self.lit

    def estimate(self) -> Float64:
        """(SIZES, 2) each size and its standard deviation [m], NaN where it was not seen."""
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
        """Keep only the estimate."""
        self.known = self.estimate()
        self.looks.clear()


def _mean(count: Float64, weight: Float64, size: Float64) -> tuple[float, float]:
    """Of looks that were had so often, of the weight of one sighting each: their size [m] and its standard deviation."""
    order = np.argsort(size, kind="stable")
    half = np.searchsorted(np.cumsum(count[order]), 0.5 * count.sum())
    off = size - size[order[half]]
    share = weight * count / (count + FEW) / (1.0 + np.square(off) / (OUTLIER + 1.0 / weight))
    total = share.sum()
    looks = total * total / np.square(share).sum()
    variance = total / float((share * weight).sum()) * (1.0 / looks + SHARED * SHARED * (1.0 - 1.0 / looks))
    return float((share * size).sum() / total), float(np.hypot(math.sqrt(variance), LEAST_SD))


class Naming:
    """Names the tracks of one topic, window by window."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._sizes: dict[int, _Sizes] = {}
        """By the number of the body."""

    def see(self, batch: SweepBatch, detection: Detection, poses: Float64) -> Looks:
        """What each sweep of a batch says of its K objects; `poses`: (K, 4) x, y, yaw and side of the sensor then."""
        seen = evidence_of(batch, detection)
        return Looks(
            size=np.column_stack([seen.side_1, seen.side_2, seen.across]),
            sd=np.column_stack([seen.side_1_sd, seen.side_2_sd, seen.across_sd]),
            yaw=poses[:, 2] + poses[:, 3] * detection.box_yaw,
            blur=seen.span_sd,
            intensity=seen.intensity,
            edges=(detection.beam_i.astype(np.int64) << 32) + detection.beam_f,
        )

    def take(self, pieces: list[Looks], number: Int64, axes: Float64, things: dict[int, Thing]) -> None:
        """Add what the sweeps of a window say.

        Parameters
        ----------
        pieces : looks at K objects
        number : (K,) the bodies these are, 0 for what is none that is believed
        axes : (K,) direction of the first axis of the body then [rad]; NaN for a disc
        """
        if not pieces:
            return
        looks = Looks.joined(pieces)
        order = np.argsort(number, kind="stable")
        bodies, begins = np.unique(number[order], return_index=True)
        for body, at in zip(bodies.tolist(), np.split(order, begins[1:]), strict=True):
            if body == 0:
                continue
            is_box = things[body].kind == BOX
            # Before it was taken for a box it had other axes.
            rows = at[np.isfinite(axes[at]) == is_box]
            if not len(rows):
                continue
            sizes = self._sizes.get(body)
            if sizes is None or sizes.kind != things[body].kind:
                sizes = self._sizes[body] = _Sizes(things[body].kind, float(looks.yaw[rows[0]]))
            off = looks.yaw[rows] - (axes[rows] if is_box else sizes.yaw)
            sizes.take(looks, rows, np.abs(np.sin(off)) > np.abs(np.cos(off)))

    def name(self, tracks: list[Track]) -> None:
        """Give tracks their names, by all that was seen of them so far."""
        if not tracks:
            return
        label, score = name(self._evidence(tracks), self._catalogue)
        for track, one, sure in zip(tracks, label.tolist(), score.tolist(), strict=True):
            track.label, track.label_score = one, sure

    def forget(self, numbers: list[int]) -> None:
        """Nothing will be seen of these bodies any more."""
        for number in numbers:
            if number in self._sizes:
                self._sizes[number].close()

    def _evidence(self, tracks: list[Track]) -> Evidence:
        rows = [self._of(track) for track in tracks]
        columns: dict[str, Any] = {key: np.array([row[key] for row in rows], float) for key in rows[0]}
        columns["legs"] = columns["legs"].astype(np.int32)
        columns["moved"] = columns["moved"].astype(np.bool_)
        return Evidence(
            shape=np.array([summary.shape_odds(each, summary.main(each)) for each in tracks]), **columns
        )

    def _of(self, track: Track) -> dict[str, float]:
        """What was seen of a track but its shape."""
        body = summary.main(track)
        sizes = self._sizes.get(body.number)
        frame = summary.frame_of_legs(track)
        row = dict.fromkeys(_MEASURED, np.nan)
        row |= {"legs": 0.0, "moved": float(track.moved), "least_sd": LEAST_SD, "span_sd": LEAST_SD}
        row["intensity"] = math.nan if sizes is None else sizes.intensity
        if frame is not None:
            # Sizes of one leg say nothing of the thing.
            row |= {"legs": float(frame.legs), "span_1": frame.length}
            row["span_2"] = frame.width if frame.legs > 2 else np.nan
            row["span_sd"] = LEAST_SD if sizes is None else sizes.blur
        elif any(part.has_legs for part in track.parts) or track.several:
            row["legs"] = 2.0
        elif sizes is not None:
            estimate = sizes.estimate()
            for one, what in enumerate(("side_1", "side_2", "across")):
                row[what], row[what + "_sd"] = estimate[one]
            row["least_1"], row["least_2"] = body.least
        return row


_MEASURED = (
    *("side_1", "side_1_sd", "side_2", "side_2_sd", "least_1", "least_2", "least_sd", "across", "across_sd"),
    *("span_1", "span_2", "span_sd"),
)
"""Fields of `Evidence` that are NaN where nothing was seen."""
