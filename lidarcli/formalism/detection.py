"""The result of a detection: flat arrays, one entry per object, vertex, face, sweep or beam, and intensities of objects."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps.types import (
    TURN,
    Closure,
    Float32,
    Float64,
    Int8,
    Int32,
    Int64,
    Per,
    Status,
    SweepBatch,
    UInt8,
    column,
    columns_of,
    record,
)
from lidarcli.system.records import MISSING, declared, replace

SETS = ("O", "A", "S")
SHAPES = ("prismatic", "round", "legged", "irregular", "unknown", "wall")
VISIBILITIES = ("full", "start_hidden", "end_hidden", "both_hidden", "cut")
VERTEX_KINDS = ("start", "end", "corner", "extremum")
CHANGES = ("appeared", "removed")

OBJECT, AGENT, NOISE = range(3)
PRISMATIC, ROUND, LEGGED, IRREGULAR, UNKNOWN, WALL = range(6)
FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN, CUT = range(5)
START, END, CORNER, EXTREMUM = range(4)
APPEARED, REMOVED = range(2)


THRESHOLD = "threshold of a discontinuity that was used; null where it is d_mean and that is null"


@record
class Detection:
    """Objects of a batch, ordered by (row, theta_i). Metres and radians in the sensor frame; NaN = undefined.

    K objects, V vertices, F faces, S sweeps, B beams. Small integers are codes into the tuples of this module. An array
    has one entry per object unless it says otherwise. The tables, their documentation and the compiled loops follow these
    declarations; where a table says null, the array has NaN, -1, or 0 for no object.
    """

    row: Int64 = column("1", "row of the batch")
    object: Int32 = column("1", "number of the object in its sweep, 1, 2, ... by increasing theta_i")
    set: UInt8 = column("", "O object, A agent (moves by itself), S wall (with --walls)", words=SETS)
    shape: UInt8 = column("", "prismatic, round, legged, irregular, unknown or wall", words=SHAPES)
    visibility: UInt8 = column("", "full, start_hidden, end_hidden, both_hidden or cut", words=VISIBILITIES)
    beam_i: Int32 = column("1", "first beam, from 0; greater than beam_f when the object crosses the seam")
    beam_f: Int32 = column("1", "last beam, inclusive")
    beams: Int32 = column("1", "number of valid beams of the object")
    theta_i: Float64 = column("rad", "bearing of the first point P_i")
    theta_f: Float64 = column("rad", "bearing of the last point P_f; may pass pi, never below theta_i")
    r_i: Float64 = column("m", "range of P_i")
    r_f: Float64 = column("m", "range of P_f")
    s_i: Float64 = column("m", "signed difference on entering the object; null where undefined", nullable=True)
    s_f: Float64 = column("m", "signed difference on leaving the object; null where undefined", nullable=True)
    d_th: Float64 = column("m", THRESHOLD, nullable=True)
    theta_min: Float64 = column("rad", "bearing of the point nearest to the scanner")
    r_min: Float64 = column("m", "range of the point nearest to the scanner")
    x: Float64 = column("m", "centroid of the points, sensor frame, forward")
    y: Float64 = column("m", "centroid of the points, sensor frame, left")
    width: Float64 = column("m", "chord from P_i to P_f")
    box_x: Float64 = column("m", "centre of the oriented bounding box, sensor frame, forward")
    box_y: Float64 = column("m", "centre of the oriented bounding box, sensor frame, left")
    box_length: Float64 = column("m", "longer side of the box")
    box_width: Float64 = column("m", "shorter side of the box")
    box_yaw: Float64 = column("rad", "direction of the longer side, sensor frame")
    thing: Float64 = column(
        "1",
        "how likely it is a thing and not a piece of building, 0 to 1; null with a background or profile paper",
        nullable=True,
    )

    vertex_offsets: Int32 = column("1", "vertices of object k are vertex_offsets[k]:vertex_offsets[k + 1]", per="offset")
    vertex_theta: Float64 = column("rad", "bearing of the vertex", per="vertex")
    vertex_r: Float64 = column("m", "range of the vertex", per="vertex")
    vertex_kind: UInt8 = column("", "start, end, corner or extremum", per="vertex", words=VERTEX_KINDS, kind="string")

    face_offsets: Int32 = column("1", "faces of object k are face_offsets[k]:face_offsets[k + 1]", per="offset")
    face_theta_i: Float64 = column("rad", "bearing where the face begins", per="face")
    face_theta_f: Float64 = column("rad", "bearing where the face ends", per="face")
    face_length: Float64 = column("m", "length of the face", per="face")
    face_rms: Float64 = column("m", "rms distance of its points from a straight face", per="face")

    nearest: Float64 = column(
        "m", "least range of the sweep, be it of an object or a wall; null without a range", per="sweep", nullable=True
    )
    nearest_theta: Float64 = column(
        "rad", "bearing of the beam with that range; null without one", per="sweep", nullable=True
    )
    """Of several the first."""
    d_mean: Float64 = column(
        "m", "mean of |s|, the threshold of Def. 3; null without a difference", per="sweep", nullable=True
    )
    sweep_d_th: Float64 = column("m", THRESHOLD, per="sweep", nullable=True)
    """With `adaptive` the part that does not grow with range."""
    noise: Float64 = column("m", "noise of the ranges: their estimated standard deviation sigma", per="sweep")
    objects: Int32 = column("1", "objects in the sweep (set O)", per="sweep")
    agents: Int32 = column("1", "agents in the sweep (set A)", per="sweep")
    object_beams: Int32 = column("1", "beams on objects (set O)", per="sweep")
    agent_beams: Int32 = column("1", "beams on agents (set A)", per="sweep")
    noise_beams: Int32 = column(
        "1", "beams on walls and the rest (set S): in no object; the three sets sum to beams (Def. 4)", per="sweep"
    )

    beam_set: UInt8 | None = column("", "O, A or S (Def. 4)", per="beam", words=SETS, default=None)
    """Only with `per_beam`, as `beam_object` and `beam_s`."""
    beam_object: Int32 | None = column(
        "1", "number of the object the beam belongs to; null in S", per="beam", nullable=True, default=None
    )
    beam_s: Float64 | None = column(
        "m", "signed difference to the beam before; null where undefined", per="beam", nullable=True, default=None
    )
    beam_difference: Float32 | None = column(
        "m", "r_w - r_e; null without a background", per="beam", nullable=True, default=None
    )
    """Only with a background and `per_beam`."""

    intensity: Float32 | None = column(
        "1",
        "median intensity of its beams, in the sensor's own unit; null where the log has none",
        nullable=True,
        default=None,
    )
    """None: no sweep has intensities."""
    difference: Float64 | None = column(
        "m", "median of r_w - r_e over its beams; null without a background", nullable=True, default=None
    )
    change: Int8 | None = column(
        "", "appeared or removed; null without a background", words=CHANGES, nullable=True, default=None
    )
    """-1 for walls."""
    station: Int32 | None = column(
        "1",
        "station of the background that it was compared with; null without one",
        per="sweep",
        nullable=True,
        default=None,
    )
    features: Float64 | None = column("", "what `thing` was decided on", default=None)
    """(K, F) in the order of `features.NAMES`; only with `explain`."""
    place: Float64 | None = column("1", "log-odds of a thing by all sweeps of its place", default=None)
    """NaN where its place is not known; None: nobody has asked."""
    label: Int32 | None = column(
        "",
        "name in the catalogue; null without a catalogue, or where nothing in it fits",
        kind="text",
        nullable=True,
        default=None,
    )
    """Entry of the catalogue; None without a catalogue."""
    label_score: Float64 | None = column(
        "1", "how well the label fits, 0 to 1; null without one", nullable=True, default=None
    )

    def __len__(self) -> int:
        return len(self.row)

    def taken(self, order: Int64) -> Detection:
        """Return some of the objects, in this order; what is given per sweep or beam stays."""
        arrays = {name: getattr(self, name) for name in fields_per("object")}
        chosen = {name: values.take(order, 0) for name, values in arrays.items() if values is not None}
        lists: dict[Per, str] = {"vertex": "vertex_offsets", "face": "face_offsets"}
        for per, name in lists.items():
            begin = getattr(self, name).astype(np.int64)
            at, _, offsets = spans(begin[order], np.diff(begin)[order])
            chosen |= {each: getattr(self, each).take(at) for each in fields_per(per)} | {name: offsets.astype(np.int32)}
        return replace(self, **chosen)

    def shares(self, batch: SweepBatch) -> Float64:
        """(K,) the share of the time of its sweep that has passed when the beam in the middle of each object is taken."""
        beams = batch.beams[self.row].astype(np.int64)
        first, last = self.beam_i.astype(np.int64), self.beam_f.astype(np.int64)
        # One that crosses the seam begins at the end of the sweep and ends at its start.
        middle = first + 0.5 * np.where(first <= last, last - first, last - first + beams)
        return batch.shares(self.row, np.where(middle >= beams, middle - beams, middle))


COLUMNS = columns_of(Detection)
"""Field of `Detection` → its declaration."""
REQUIRED = tuple(name for name, one in declared(Detection).items() if one.default is MISSING)
"""Fields that are never None."""


def fields_per(*per: Per) -> list[str]:
    """Return the fields whose arrays have one entry per object, vertex, face, sweep or beam."""
    return [name for name, one in COLUMNS.items() if one.per in per]


# Ragged arrays, flat values with offsets as Arrow's lists: their indices, and medians of groups.

_MANTISSA = np.int64(0x7FFFFFFF)
"""All bits of a float32 but its sign."""


def spans(begin: Int64, size: Int64) -> tuple[Int64, Int64, Int64]:
    """Return the flat indices of the spans `begin[j] … begin[j] + size[j] - 1`, the span of each, and where each
    begins (J + 1,).

    >>> [part.tolist() for part in spans(np.array([5, 0]), np.array([2, 1]))]
    [[5, 6, 0], [0, 0, 1], [0, 2, 3]]
    """
    offsets = offsets_of(size)
    owner = np.repeat(np.arange(len(size)), size)
    index = np.arange(offsets[-1])
    index += np.repeat(begin - offsets[:-1], size)
    return index, owner, offsets


def offsets_of(sizes: Int64) -> Int64:
    """Return (J + 1,) the offsets of spans of the given sizes."""
    offsets = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets


def starts(values: Int64) -> Int64:
    """Return (R,) where the runs of equal values begin.

    >>> starts(np.array([7, 7, 2, 7])).tolist()
    [0, 2, 3]
    """
    begins = np.empty(len(values), np.bool_)
    begins[:1] = True
    np.not_equal(values[1:], values[:-1], out=begins[1:])
    return begins.nonzero()[0]


def grouped_medians(value: Float32, owner: Int64, groups: int) -> Float64:
    """Return (G,) the median of the values of each of G groups, without NaN; NaN for a group without a value.

    >>> grouped_medians(np.array([3, 1, np.nan, 2], np.float32), np.array([0, 0, 1, 0]), 2).tolist()
    [2.0, nan]
    """
    known = ~np.isnan(value)
    value, owner = value[known], owner[known]
    # One sort of whole numbers that order as (owner, value): several times as fast as a sort by two keys.
    bits = np.ascontiguousarray(value, np.float32).view(np.int32).astype(np.int64)
    order = (owner << 32) + np.where(bits < 0, -1 - (bits & _MANTISSA), bits) + (1 << 31)
    order.sort()
    bits = (order & 0xFFFFFFFF) - (1 << 31)
    value = np.where(bits < 0, (-1 - bits) | ~_MANTISSA, bits).astype(np.int32).view(np.float32)
    number = np.bincount(owner, minlength=groups)
    first = np.cumsum(number) - number
    result = np.full(groups, np.nan)
    some = np.flatnonzero(number)
    low = first[some] + (number[some] - 1) // 2
    high = first[some] + number[some] // 2
    # Half of inf and half of -inf have no sum.
    with np.errstate(invalid="ignore"):
        result[some] = 0.5 * (value[low].astype(np.float64) + value[high])
    return result


# Intensity of objects: the median over their own beams, for all objects of a batch at once.

MAX_INTENSITY = 1e9
"""Greatest intensity that a sensor can mean, in any unit; the bytes of a broken message may give more."""


def object_intensities(batch: SweepBatch, found: Detection) -> Float32:
    """Return (K,) the median intensity of each of K objects, in the unit of the sensor.

    NaN where no beam of the object has an intensity, or it is above `MAX_INTENSITY`.
    """
    if batch.intensities is None:
        return np.full(len(found), np.nan, np.float32)
    owner, first, last = _parts(batch, found)
    row = found.row[owner]
    count = (batch.beams - (batch.closure == Closure.SHARED)).astype(np.int64)[row]
    size = last - first
    # A part across the seam begins at the end of the sweep and ends at its start.
    size += np.where(size < 0, count, 0) + 1
    beam, part, _ = spans(first, size)
    beam -= np.where(beam >= count[part], count[part], 0)
    at = row[part] * batch.width + beam
    values = batch.intensities.ravel()[at]
    # Some beams between those of an object are lost.
    mine = batch.status.ravel()[at] == Status.VALID.value
    medians = grouped_medians(values[mine], owner[part[mine]], len(found))
    with np.errstate(invalid="ignore"):
        medians[~(np.abs(medians) <= MAX_INTENSITY)] = np.nan
    return medians.astype(np.float32)


def _parts(batch: SweepBatch, found: Detection) -> tuple[Int64, Int64, Int64]:
    """Return the connected parts of all objects: the object of each part, and its first and last beam."""
    vertices = np.diff(found.vertex_offsets).astype(np.int64)
    several = vertices - np.diff(found.face_offsets) > 1
    whole = np.flatnonzero(~several)
    owner, first, last = whole, found.beam_i[whole].astype(np.int64), found.beam_f[whole].astype(np.int64)
    if not several.any():
        return owner, first, last
    some = np.flatnonzero(several)
    vertex, mine, _ = spans(found.vertex_offsets[some].astype(np.int64), vertices[some])
    faces = np.diff(found.face_offsets).astype(np.int64)[some]
    face, its, _ = spans(found.face_offsets[some].astype(np.int64), faces)
    theta = found.vertex_theta[vertex]
    # A face leads from one vertex to the next: a part begins at a vertex where no face ends, and ends where none begins.
    # Object and bearing are the two parts of one complex number, so that pairs can be looked up among pairs.
    bearing = mine + 1j * theta
    begins = ~np.isin(bearing, its + 1j * found.face_theta_f[face])
    ends = ~np.isin(bearing, its + 1j * found.face_theta_i[face])
    parts = some[mine[begins]]
    one, other = (_beam_at(batch, found.row[parts], theta[which]) for which in (begins, ends))
    falls = batch.angle_increment[found.row[parts]] < 0
    return (
        np.concatenate([owner, parts]),
        np.concatenate([first, np.where(falls, other, one)]),
        np.concatenate([last, np.where(falls, one, other)]),
    )


def _beam_at(batch: SweepBatch, row: Int64, theta: Float64) -> Int64:
    """Return the beams of sweeps at some bearings, which may go on past a full turn."""
    step = batch.angle_increment[row]
    place = (theta - batch.angle_min[row]) / step
    turn = TURN / np.abs(step)
    place += np.where(place < -0.5, turn, 0.0)
    place -= np.where(place > batch.beams[row] - 0.5, turn, 0.0)
    beams: Int64 = np.rint(place).astype(np.int64)
    return np.clip(beams, 0, batch.beams[row] - 1)
