"""The result of a detection: flat arrays, one entry per object, vertex, face, sweep or beam."""

from __future__ import annotations

import numpy as np

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


@record
class Detection:
    """Objects of a batch, ordered by (row, theta_i). Metres and radians in the sensor frame; NaN = undefined.

    K objects, V vertices, F faces, S sweeps, B columns. Small integers are codes into the tuples of this module.
    """

    row: Int64
    """(K,) row of the batch."""
    object: Int32
    """(K,) 1, 2, … by increasing theta_i within the sweep; walls are numbered among them when they are asked for."""
    set: UInt8
    shape: UInt8
    visibility: UInt8
    beam_i: Int32
    beam_f: Int32
    beams: Int32
    theta_i: Float64
    theta_f: Float64
    r_i: Float64
    r_f: Float64
    s_i: Float64
    s_f: Float64
    d_th: Float64
    theta_min: Float64
    r_min: Float64
    x: Float64
    y: Float64
    width: Float64
    box_x: Float64
    box_y: Float64
    box_length: Float64
    box_width: Float64
    box_yaw: Float64
    thing: Float64
    """(K,) how likely it is a thing and not a piece of building, 0 to 1; NaN where the profile or a background tells."""

    vertex_offsets: Int32
    """(K + 1,) the vertices of object k are `vertex_offsets[k]:vertex_offsets[k + 1]`."""
    vertex_theta: Float64
    vertex_r: Float64
    vertex_kind: UInt8

    face_offsets: Int32
    face_theta_i: Float64
    face_theta_f: Float64
    face_length: Float64
    face_rms: Float64

    nearest: Float64
    """(S,) the least range of the sweep, whatever it is of; NaN without one."""
    nearest_theta: Float64
    """(S,) its bearing; of several the first."""
    d_mean: Float64
    """(S,) Def. 3's mean absolute difference."""
    sweep_d_th: Float64
    """(S,) the threshold of the sweep; with `adaptive` the part that does not grow with range."""
    noise: Float64
    """(S,) estimated standard deviation of a range."""
    objects: Int32
    agents: Int32
    object_beams: Int32
    agent_beams: Int32
    noise_beams: Int32

    beam_set: UInt8 | None = None
    """(S, B) the set of each beam (Def. 4); only with `per_beam`."""
    beam_object: Int32 | None = None
    """(S, B) number of the object a beam belongs to; 0 = none."""
    beam_s: Float64 | None = None
    """(S, B) the difference function (Def. 2)."""

    intensity: Float32 | None = None
    """(K,) median intensity of the beams of each object, in the sensor's own unit; NaN where there is none. None: no
    sweep has intensities."""
    difference: Float64 | None = None
    """(K,) median signed r_w - r_e over the beams of each object (§3); only with a background."""
    change: Int8 | None = None
    """(K,) whether it appeared or is gone, -1 for walls; only with a background."""
    station: Int32 | None = None
    """(S,) station of the background that each sweep was compared with, -1 for none; only with a background."""
    features: Float64 | None = None
    """(K, F) what `thing` was decided on, in the order of `features.NAMES`; only with `explain`."""
    label: Int32 | None = None
    """(K,) entry of the catalogue, -1 for none; only with a catalogue."""
    label_score: Float64 | None = None
    """(K,) how well it fits, 0 to 1; NaN without a label."""
    beam_difference: Float32 | None = None
    """(S, B) r_w - r_e [m], NaN where not known; only with a background and `per_beam`."""

    def __len__(self) -> int:
        return len(self.row)

    def shares(self, batch: SweepBatch) -> Float64:
        """(K,) the share of the time of its sweep that has passed when the beam in the middle of each object is taken."""
        beams = batch.beams[self.row].astype(np.int64)
        first, last = self.beam_i.astype(np.int64), self.beam_f.astype(np.int64)
        # One that crosses the seam begins at the end of the sweep and ends at its start.
        middle = first + 0.5 * np.where(first <= last, last - first, last - first + beams)
        return batch.shares(self.row, np.where(middle >= beams, middle - beams, middle))
