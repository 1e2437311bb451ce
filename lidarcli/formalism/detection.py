"""The result of a detection: flat arrays, one entry per object, vertex, face, sweep or beam."""

from __future__ import annotations

from dataclasses import MISSING, fields

import numpy as np

from lidarcli.columns import Per, column, columns_of
from lidarcli.sweeps import Float32, Float64, Int8, Int32, Int64, SweepBatch, UInt8, record

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

    def shares(self, batch: SweepBatch) -> Float64:
        """(K,) the share of the time of its sweep that has passed when the beam in the middle of each object is taken."""
        beams = batch.beams[self.row].astype(np.int64)
        first, last = self.beam_i.astype(np.int64), self.beam_f.astype(np.int64)
        # One that crosses the seam begins at the end of the sweep and ends at its start.
        middle = first + 0.5 * np.where(first <= last, last - first, last - first + beams)
        return batch.shares(self.row, np.where(middle >= beams, middle - beams, middle))


COLUMNS = columns_of(Detection)
"""Field of `Detection` → its declaration."""
REQUIRED = tuple(each.name for each in fields(Detection) if each.default is MISSING)
"""Fields that are never None."""


def fields_per(*per: Per) -> list[str]:
    """Return the fields whose arrays have one entry per object, vertex, face, sweep or beam."""
    return [name for name, one in COLUMNS.items() if one.per in per]
