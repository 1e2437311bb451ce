"""Objects of interest (§3, matching): the entry of a catalogue that explains what was observed of an object.

Only what was observed may contradict an entry: one face of 1.2 m or 0.8 m makes a pallet possible, two faces make it
certain. Every entry is compared with "none of them", an object of any size between `MIN_SIZE` and `MAX_SIZE`. A name is
given where one entry is probable compared with the others and none, and also a good fit by chi-square."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lidarcli.formalism.detection import (
    BOTH_HIDDEN,
    CORNER,
    CUT,
    END_HIDDEN,
    FULL,
    IRREGULAR,
    LEGGED,
    PRISMATIC,
    ROUND,
    SHAPES,
    START_HIDDEN,
    WALL,
    Detection,
    spans,
)
from lidarcli.sweeps.types import Bool, Float64, Int32, Int64, SweepBatch, record
from lidarcli.system.records import asdict, dataclass

KINDS = tuple(SHAPES[code] for code in (PRISMATIC, ROUND, LEGGED, IRREGULAR))
"""Shapes of objects, in the order of `Evidence.shape`."""
MIN_PROBABILITY, MIN_FIT = 0.95, 0.01
"""Least probability of a name, and of a worse fit if the name is right: below it the evidence contradicts the name."""
ALL_LEGS_SEEN, MAX_UNKNOWN_LEGS = 0.5, 8
"""Probability that all legs of a legged object are visible at once, and most legs of an unknown object."""
INTENSITY_SHARE = 0.03
"""Share of the unknown objects within the limits of intensity of an entry, which are meant for bright or dark objects."""
MIN_SIZE, MAX_SIZE = 0.05, 2.0
"""[m] Range of the sizes of unknown objects."""
MIN_FIT_SD, MIN_LARGER_SHARE, MIN_DENSITY = 0.001, 0.05, 1e-300
"""Least standard deviation of a size [m], share of the unknown objects that are larger than what was observed, and density,
so that its logarithm is finite."""


@dataclass(frozen=True, slots=True)
class Thing:
    """An entry of a catalogue. Its size is two sides, a diameter, or legs with the distances of their axes [m]."""

    name: str
    shape: str | None = None
    """One of `KINDS`; None for any shape."""
    length: float | None = None
    width: float | None = None
    diameter: float | None = None
    legs: int = 0
    spacing: tuple[float, ...] = ()
    """Distances of the axes of the legs: one for two legs, along and across for more [m]."""
    tolerance: float = 0.02
    """Standard deviation of the sizes of things of this entry [m]."""
    moves: bool = True
    """False for things that never move."""
    intensity_min: float | None = None
    """Least median intensity of its returns, in the unit of the sensor."""
    intensity_max: float | None = None
    """Greatest median intensity of its returns."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values of the given fields."""
        given = {name: value for name, value in asdict(self).items() if value not in (None, ())}
        if not self.legs:
            del given["legs"]
        return given | {"tolerance": self.tolerance, "moves": self.moves}


@dataclass(frozen=True, slots=True)
class Catalogue:
    """Things of interest."""

    things: tuple[Thing, ...]
    path: str = ""
    """File that it was read from, if any."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries, by index (`name`)."""
        return tuple(thing.name for thing in self.things)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for the metadata of the tables."""
        return {"things": [thing.as_dict() for thing in self.things]}


@record
class Evidence:
    """Measurements of M objects, (M,) each; NaN where nothing was observed. Only what was observed may contradict an entry.

    Standard deviations include errors that more sweeps of the same beams do not reduce.
    """

    shape: Float64
    """(M, 4) log-likelihood of each of `KINDS`; all equal if the shape is unknown."""
    side_1: Float64
    """Side along axis 1 of the object, if both of its ends were observed [m]."""
    side_1_sd: Float64
    side_2: Float64
    """Side along axis 2, across axis 1; either may be the longer [m]."""
    side_2_sd: Float64
    least_1: Float64
    """Least length along axis 1 [m]."""
    least_2: Float64
    least_sd: Float64
    """Standard deviation of both least lengths [m]."""
    across: Float64
    """Extent across the line of sight if both ends were observed, or the diameter of a round object [m]."""
    across_sd: Float64
    legs: Int32
    """Greatest number of legs observed at once; 0 for an object without legs."""
    span_1: Float64
    """Distance of the axes of its legs, along axis 1 [m]."""
    span_2: Float64
    """Distance of the axes of its legs across axis 1 [m]; NaN for an object of two legs."""
    span_sd: Float64
    moved: Bool
    """True if it ever moved."""
    intensity: Float64
    """Median intensity of its returns, in the unit of the sensor."""

    def __len__(self) -> int:
        return len(self.moved)


@record
class CatalogueMatch:
    """CatalogueMatch of M objects with E entries of a catalogue, (M, E) each."""

    ratio: Float64
    """Log-likelihood of the entry less that of "none of them"; -inf if it is impossible."""
    fit: Float64
    """Probability of no better a fit if the entry is right, 0 to 1."""
    certain: Bool
    """True if all sizes of the entry were observed; otherwise it is only possible."""


def name(evidence: Evidence, catalogue: Catalogue) -> tuple[Int32, Float64]:
    """Return (M,) the entry of each object, -1 for none, and (M,) its probability, NaN for none.

    Each entry is as likely beforehand as "none of them".
    """
    compared = compare(evidence, catalogue)
    # Entries and "none of them" are equally likely beforehand.
    top = np.maximum(compared.ratio.max(axis=1, initial=0.0), 0.0)[:, None]
    weight = np.exp(compared.ratio - top)
    probability = weight / (weight.sum(axis=1, keepdims=True) + np.exp(-top))
    good = (probability >= MIN_PROBABILITY) & (compared.fit >= MIN_FIT) & compared.certain
    # As probabilities sum to one, at most one entry is good.
    found = good.any(axis=1)
    best = np.argmax(good, axis=1) if catalogue.things else np.zeros(len(evidence), np.intp)
    label = np.where(found, best, -1).astype(np.int32)
    score = np.full(len(evidence), np.nan)
    score[found] = probability[found, best[found]]
    return label, score


def compare(evidence: Evidence, catalogue: Catalogue) -> CatalogueMatch:
    """Compare every object with every entry."""
    count = len(evidence)
    # Only ratios count, as any outcome of many sweeps is unlikely.
    shape = evidence.shape - evidence.shape.max(axis=1)[:, None]
    shape -= np.log(np.exp(shape).mean(axis=1))[:, None]
    columns = [_compare(evidence, thing, shape) for thing in catalogue.things]
    ratio, fit = np.zeros((count, len(columns))), np.zeros((count, len(columns)))
    certain = np.zeros((count, len(columns)), np.bool_)
    for i, column in enumerate(columns):
        ratio[:, i], fit[:, i], certain[:, i] = column
    return CatalogueMatch(ratio=ratio, fit=fit, certain=certain)


def _compare(evidence: Evidence, thing: Thing, shape: Float64) -> tuple[Float64, Float64, Bool]:
    """Return the columns of `CatalogueMatch` for one entry; `shape` is relative to the mean over the shapes."""
    if thing.legs or thing.spacing:
        ratio, fit, certain = _by_legs(evidence, thing)
    elif thing.diameter is not None:
        ratio, fit, certain = _by_extent(evidence, thing.diameter, thing.diameter, thing.tolerance)
    elif thing.length is not None and thing.width is not None:
        # The sides of an irregular object bound its extent, observed from anywhere.
        by = _by_extent if thing.shape == "irregular" else _by_sides
        ratio, fit, certain = by(evidence, thing.length, thing.width, thing.tolerance)
    else:
        count = len(evidence)
        ratio, fit, certain = np.zeros(count), np.ones(count), np.ones(count, bool)
    if thing.shape is not None:
        mine = shape[:, KINDS.index(thing.shape)]
        ratio = ratio + mine
        fit = np.minimum(fit, np.exp(mine - shape.max(axis=1)))
    if not thing.moves:
        ratio = np.where(evidence.moved, -np.inf, ratio)
    if thing.intensity_min is not None or thing.intensity_max is not None:
        low, high = thing.intensity_min, thing.intensity_max
        known = ~np.isnan(evidence.intensity)
        with np.errstate(invalid="ignore"):
            within = known & (evidence.intensity >= (-np.inf if low is None else low))
            within &= evidence.intensity <= (np.inf if high is None else high)
        ratio = np.where(within, ratio - np.log(INTENSITY_SHARE), np.where(known, -np.inf, ratio))
        certain = certain & known
    return ratio, fit, certain


def _by_sides(evidence: Evidence, length: float, width: float, tolerance: float) -> tuple[Float64, Float64, Bool]:
    """Compare two sides, either of which may be the longer."""
    seen_1, seen_2 = np.isfinite(evidence.side_1), np.isfinite(evidence.side_2)
    sd_1, sd_2, least_sd = (np.hypot(sd, tolerance) for sd in (evidence.side_1_sd, evidence.side_2_sd, evidence.least_sd))
    orders = []
    for a, b in ((length, width), (width, length)):
        one = measured(evidence.side_1, sd_1, a, a).where(seen_1, at_least(evidence.least_1, least_sd, a))
        two = measured(evidence.side_2, sd_2, b, b).where(seen_2, at_least(evidence.least_2, least_sd, b))
        orders.append(one.plus(two))
    return *any_of(orders), seen_1 & seen_2


def _by_extent(evidence: Evidence, length: float, width: float, tolerance: float) -> tuple[Float64, Float64, Bool]:
    """Compare an extent across the line of sight, which lies between the width and the length."""
    low, high = min(length, width), max(length, width)
    seen = np.isfinite(evidence.across)
    across = measured(evidence.across, np.hypot(evidence.across_sd, tolerance), low, high)
    least = np.fmax(evidence.least_1, evidence.least_2)
    longer = at_least(least, np.hypot(evidence.least_sd, tolerance), high)
    return *any_of([across.where(seen, longer)]), seen


def _by_legs(evidence: Evidence, thing: Thing) -> tuple[Float64, Float64, Bool]:
    """Compare the number of legs and their distances."""
    count, seen = len(evidence), evidence.legs > 0
    ratio, fit, certain = np.zeros(count), np.ones(count), seen
    if thing.spacing:
        two, sd = len(thing.spacing) == 1, np.hypot(evidence.span_sd, thing.tolerance)
        a, b = thing.spacing[0], thing.spacing[-1]
        one, other = (measured(evidence.span_1, sd, side, side) for side in (a, b))
        if two:
            ratio, fit = any_of([one])
        else:
            along, across = (measured(evidence.span_2, sd, side, side) for side in (a, b))
            ratio, fit = any_of([one.plus(across), other.plus(along)])
        certain = seen & np.isfinite(evidence.span_1) & (two | np.isfinite(evidence.span_2))
    if thing.legs:
        hidden = (1.0 - ALL_LEGS_SEEN) / max(thing.legs - 1, 1)
        chance = np.log(np.where(evidence.legs == thing.legs, ALL_LEGS_SEEN, hidden) * MAX_UNKNOWN_LEGS)
        too_many = evidence.legs > thing.legs
        ratio = np.where(too_many, -np.inf, ratio + np.where(seen, chance, 0.0))
        fit = np.where(too_many, 0.0, fit)
    return ratio, fit, certain


@record
class SizeFit:
    """Fits of sizes, (M,) each."""

    ratio: Float64
    """Log-likelihood less that of an object of any size."""
    chi: Float64
    """Sum of squared deviations, in standard deviations."""
    freedom: Float64
    """Number of deviations: 0, 1 or 2."""

    def plus(self, other: SizeFit) -> SizeFit:
        """Return the fit of both sizes together."""
        return SizeFit(self.ratio + other.ratio, self.chi + other.chi, self.freedom + other.freedom)

    def where(self, known: Bool, other: SizeFit) -> SizeFit:
        """Return this fit where `known` is True, elsewhere the other."""
        pairs = ((self.ratio, other.ratio), (self.chi, other.chi), (self.freedom, other.freedom))
        return SizeFit(*(np.where(known, mine, its) for mine, its in pairs))

    def likely(self) -> Float64:
        """Return the probability of no better a fit if the size is right, 0 to 1."""
        one = 2.0 * below(-np.sqrt(self.chi))
        two = np.exp(-0.5 * self.chi)
        return np.where(self.freedom == 0, 1.0, np.where(self.freedom == 1, one, two))


def measured(value: Float64, sd: Float64, low: float, high: float) -> SizeFit:
    """Return the fits of measured sizes (M,) to a size from `low` to `high` [m]; NaN counts as not observed.

    `sd`: standard deviations, tolerance included [m]; the bounds are equal for a known size.
    """
    seen = np.isfinite(value)
    value, spread = np.where(seen, value, low), np.where(seen, np.hypot(sd, MIN_FIT_SD), 1.0)
    off = np.maximum(np.maximum(low - value, value - high), 0.0) / spread
    if high - low > MIN_FIT_SD:
        density = (below((value - low) / spread) - below((value - high) / spread)) / (high - low)
        log_density = np.log(np.maximum(density, MIN_DENSITY))
    else:
        log_density = -0.5 * off**2 - np.log(spread * math.sqrt(2.0 * math.pi))
    ratio = log_density + math.log(MAX_SIZE - MIN_SIZE)
    return SizeFit(np.where(seen, ratio, 0.0), np.where(seen, off**2, 0.0), seen.astype(np.float64))


def at_least(least: Float64, sd: Float64, size: float) -> SizeFit:
    """Return the fits of least lengths (M,) to a size [m], which only a longer one contradicts; NaN counts as not observed.

    `sd`: standard deviations, tolerance included [m].
    """
    seen = np.isfinite(least)
    least, spread = np.where(seen, least, 0.0), np.where(seen, np.hypot(sd, MIN_FIT_SD), 1.0)
    off = (least - size) / spread
    longer = np.clip((MAX_SIZE - least) / (MAX_SIZE - MIN_SIZE), MIN_LARGER_SHARE, 1.0)
    ratio = np.log(np.maximum(below(-off), MIN_DENSITY)) - np.log(longer)
    exceeds = seen & (off > 0.0)
    return SizeFit(np.where(seen, ratio, 0.0), np.where(exceeds, off**2, 0.0), exceeds.astype(np.float64))


def any_of(fits: Sequence[SizeFit]) -> tuple[Float64, Float64]:
    """Return the log-likelihood ratio of several equally likely fits, and the fit of the best, (M,) each."""
    ratio: Float64 = np.logaddexp.reduce([each.ratio for each in fits]) - math.log(len(fits))
    fit: Float64 = np.max([each.likely() for each in fits], axis=0)
    return ratio, fit


def below(z: Float64) -> Float64:
    """Return the share of a normal distribution below z standard deviations, to 1e-7 (numpy has no error function).

    Abramowitz and Stegun 1964, 26.2.17.

    >>> below(np.array([0.0, 1.0, -3.0])).round(6).tolist()
    [0.5, 0.841345, 0.00135]
    """
    t = 1.0 / (1.0 + 0.2316419 * np.abs(z))
    sum_ = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = np.exp(-0.5 * np.square(z)) / math.sqrt(2.0 * math.pi) * sum_
    return np.where(z > 0, 1.0 - tail, tail)


# The evidence of one sweep: a face is a side of the object if both of its ends are the object's own, a corner, or an edge
# that nothing hides. If an end is hidden or cut off, the face may go on there, and its length is a lower bound.

UNIFORM_SD = 1.0 / math.sqrt(12.0)
"""Standard deviation of a uniform distribution over a step."""
CORNER_SD = 4.0
"""Standard deviation of a corner between lines through n points, in standard deviations of a range over √n."""
FEW_POINTS = 2.5
"""Least number of points of a face with a line; other corners are points."""
SHORT_FACE = 3.5
"""Least number of points of a face whose ends are certain."""
ROUGH = 0.05
"""Standard deviation of the extent of an irregular object from all sides, as a share."""
MAX_PARTS = 8
"""Greatest number of legs of an object whose legs are measured."""
MIN_LENGTH = 1e-9
SEEN_AS = ((0.925, 0.02, 0.005, 0.05), (0.06, 0.855, 0.005, 0.08), (0.06, 0.14, 0.60, 0.20), (0.33, 0.13, 0.005, 0.535))
"""Shares of the sweeps that take a prismatic, round, legged or irregular object (rows) for prismatic, round,
legged or irregular: those of docs/accuracy.md with more room for rare cases, as one sweep is no proof. Sweeps that find
no shape, as few beams hit the object, are left out."""
ALIKE = (10.0, 10.0, 5.0, 4.0)
"""Weight of these shares for prismatic, round, legged and irregular objects, in sweeps: a box looks like any box, while
each plant is different."""


def evidence_of(batch: SweepBatch, detection: Detection) -> Evidence:
    """Return the evidence of each of K objects of a batch, by its own sweep alone; walls have none."""
    count = len(detection)
    shape = detection.shape
    likelihood = np.zeros((WALL + 1, 4))
    likelihood[: IRREGULAR + 1] = np.log(SEEN_AS).T
    step = np.abs(batch.angle_increment)[detection.row]
    sigma = np.nan_to_num(detection.noise[detection.row])
    nothing = np.full(count, np.nan)
    found = {name: nothing.copy() for name in ("side_1", "side_1_sd", "side_2", "side_2_sd", "across", "across_sd")}
    _sides(detection, step, sigma, found)
    _extents(detection, step, sigma, found)
    legs, span_1, span_2 = _legs(detection)
    seen = (shape != WALL) & (detection.beams > 1)
    return Evidence(
        shape=likelihood[shape],
        **found,
        least_1=np.where(seen, detection.box_length, np.nan),
        least_2=np.where(seen, detection.box_width, np.nan),
        least_sd=2.0 * sigma + 0.5 * detection.r_min * step,
        legs=legs,
        span_1=span_1,
        span_2=span_2,
        span_sd=sigma + detection.r_min * step,
        moved=np.zeros(count, np.bool_),
        intensity=nothing if detection.intensity is None else detection.intensity.astype(np.float64),
    )


def _sides(detection: Detection, step: Float64, sigma: Float64, found: dict[str, Float64]) -> None:
    """Measure the longest faces of prismatic objects with two own ends, along and across their boxes."""
    vertices, faces = np.diff(detection.vertex_offsets), np.diff(detection.face_offsets)
    owner = np.repeat(np.arange(len(detection)), faces)
    # An object that a thin one in front cuts in two has hidden ends in its middle.
    mine = (detection.shape == PRISMATIC) & (vertices == faces + 1)
    face = np.flatnonzero(mine[owner])
    owner = owner[face]
    place = face - detection.face_offsets[owner]
    first = detection.vertex_offsets[owner] + place
    theta, r = detection.vertex_theta, detection.vertex_r
    x, y = r * np.cos(theta), r * np.sin(theta)
    dx, dy = x[first + 1] - x[first], y[first + 1] - y[first]
    straight = np.maximum(np.hypot(dx, dy), MIN_LENGTH)
    visibility = detection.visibility[owner]
    variance = np.zeros(len(face))
    points = np.abs(np.diff(theta)) / np.repeat(step, vertices)[:-1] + 1.0 if len(theta) else theta
    # A face at a grazing angle may end early, where the next beam is too far behind to belong to it.
    own = points[first] > SHORT_FACE
    for end, hidden in ((0, START_HIDDEN), (1, END_HIDDEN)):
        at = first + end
        edge = place == (faces[owner] - 1 if end else 0)
        hides = (visibility == hidden) | (visibility == BOTH_HIDDEN) | (visibility == CUT)
        own &= np.where(edge, ~hides, detection.vertex_kind[at] == CORNER)
        grazing = np.abs(dx * y[at] - dy * x[at]) / (straight * np.maximum(r[at], MIN_LENGTH))
        along = np.minimum(r[at] * step[owner] / np.maximum(grazing, MIN_LENGTH), straight)
        # The line of the face beyond the corner gives the end of this one.
        beyond = np.clip(at if end else at - 1, 0, len(points) - 1)
        sharp = ~edge & (np.minimum(points[beyond], points[first]) > FEW_POINTS)
        corner = CORNER_SD * sigma[owner] / np.sqrt(points[beyond])
        variance += np.where(sharp, corner, UNIFORM_SD * along) ** 2
    length = detection.face_length[face]
    yaw = detection.box_yaw[owner]
    axis = np.abs(dx * np.cos(yaw) + dy * np.sin(yaw)) < np.abs(dy * np.cos(yaw) - dx * np.sin(yaw))
    for code, side in ((0, "side_1"), (1, "side_2")):
        chosen = np.flatnonzero(own & (axis == code))
        chosen = chosen[np.argsort(length[chosen], kind="stable")]
        found[side][owner[chosen]] = length[chosen]
        found[side + "_sd"][owner[chosen]] = np.sqrt(variance[chosen])


def _extents(detection: Detection, step: Float64, sigma: Float64, found: dict[str, Float64]) -> None:
    """Measure round objects and the extents of irregular ones across the line of sight, if both edges are their own."""
    spacing = detection.r_min * step
    whole = detection.visibility == FULL
    is_round, irregular = (whole & (detection.shape == code) for code in (ROUND, IRREGULAR))
    # One step more than from the first to the last beam: half a beam on either side.
    angle = detection.theta_f - detection.theta_i + step
    across = 2.0 * np.hypot(detection.x, detection.y) * np.tan(0.5 * np.minimum(angle, 0.5 * np.pi))
    sd = np.hypot(math.sqrt(2.0) * UNIFORM_SD * spacing, sigma)
    found["across"] = np.where(is_round, detection.box_length, np.where(irregular, across, np.nan))
    rough = np.hypot(sd, ROUGH * across)
    found["across_sd"] = np.where(is_round, sd, np.where(irregular, rough, np.nan))


def _legs(detection: Detection) -> tuple[Int32, Float64, Float64]:
    """Return the legs of legged objects, and the sides of the smallest rectangles through their places [m]."""
    count = len(detection)
    vertices, faces = np.diff(detection.vertex_offsets), np.diff(detection.face_offsets)
    parts = np.where(detection.shape == LEGGED, vertices - faces, 0).astype(np.int32)
    span_1, span_2 = np.full(count, np.nan), np.full(count, np.nan)
    rows = np.flatnonzero((parts >= 2) & (parts <= MAX_PARTS))
    if not len(rows):
        return parts, span_1, span_2
    x, y = _places(detection, rows)
    picked, _, _ = rectangle(x, y)
    span_1[rows] = picked[0]
    span_2[rows] = np.where(parts[rows] > 2, picked[1], np.nan)
    return parts, span_1, span_2


def rectangle(x: Float64, y: Float64) -> tuple[Float64, Float64, Float64]:
    """Return the smallest rectangles around up to N places each, (R, N) [m], NaN where there are fewer.

    (2, R) sides, along the first axis and across [m]; (R,) direction of that axis [rad]; (2, R) middle [m].
    """
    there = np.isfinite(x)
    # The smallest one has a side through two of the places.
    one, other = np.triu_indices(x.shape[1], 1)
    angle = np.arctan2(y[:, other] - y[:, one], x[:, other] - x[:, one])
    cos, sin = np.cos(angle)[:, :, None], np.sin(angle)[:, :, None]
    u, v = x[:, None, :] * cos + y[:, None, :] * sin, y[:, None, :] * cos - x[:, None, :] * sin
    ends = [_ends(np.where(there[:, None, :], each, np.nan)) for each in (u, v)]
    reach = np.stack([high - low for low, high in ends])
    area = np.where(np.isfinite(reach[0]), reach[0] * reach[1], np.inf)
    best = np.argmin(area, axis=1)
    every = np.arange(len(x))
    along, across = (0.5 * (low + high)[every, best] for low, high in ends)
    cos, sin = cos[every, best, 0], sin[every, best, 0]
    middle = np.stack([cos * along - sin * across, sin * along + cos * across])
    return reach[:, every, best], angle[every, best], middle


def _ends(along: Float64) -> tuple[Float64, Float64]:
    """Return the least and the greatest value along the last axis, without NaN; NaN if there is none."""
    empty = np.isnan(along)
    none = empty.all(axis=-1)
    low = np.where(none, np.nan, np.where(empty, np.inf, along).min(axis=-1))
    high = np.where(none, np.nan, np.where(empty, -np.inf, along).max(axis=-1))
    return low, high


def _places(detection: Detection, rows: Int64) -> tuple[Float64, Float64]:
    """Return (R, MAX_PARTS) the middles of the vertices of every part of some objects [m], NaN for fewer parts."""
    begin = detection.vertex_offsets[rows].astype(np.int64)
    vertex, row, offsets = spans(begin, np.diff(detection.vertex_offsets)[rows].astype(np.int64))
    face, owner, _ = spans(
        detection.face_offsets[rows].astype(np.int64), np.diff(detection.face_offsets)[rows].astype(np.int64)
    )
    theta, r = detection.vertex_theta[vertex], detection.vertex_r[vertex]
    # A part begins with a vertex where no face ends.
    starts = ~np.isin(row + 1j * theta, owner + 1j * detection.face_theta_f[face])
    counted: Int64 = np.cumsum(starts)
    number: Int64 = counted - counted[offsets[:-1]][row]
    place = row * MAX_PARTS + np.minimum(number, MAX_PARTS - 1)
    weight = np.bincount(place, minlength=len(rows) * MAX_PARTS)
    with np.errstate(invalid="ignore"):
        x, y = (
            (np.bincount(place, at, len(weight)) / weight).reshape(-1, MAX_PARTS)
            for at in (r * np.cos(theta), r * np.sin(theta))
        )
    return x, y


def shape_likelihood(seen: Sequence[float]) -> list[float]:
    """Return the log-likelihood of prismatic, round, legged and irregular by many sweeps of a thing, which are not
    independent.

    The shares of sweeps by shape differ from thing to thing (Dirichlet), and the sweeps of a thing follow its shares.
    `seen` are the numbers of sweeps that took it for each of these shapes; fractions count too.

    >>> [round(each, 2) for each in shape_likelihood([1, 0, 0, 5])]
    [-9.49, -11.31, -8.34, -3.95]
    """
    result = []
    for shares, weight in zip(SEEN_AS, ALIKE, strict=True):
        log = math.lgamma(weight) - math.lgamma(weight + sum(seen))
        for share, count in zip(shares, seen, strict=True):
            log += math.lgamma(weight * share + count) - math.lgamma(weight * share)
        result.append(log)
    return result
