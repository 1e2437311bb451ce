"""Results of tracking: the track of every object of a batch, and the tracks themselves."""

from __future__ import annotations

from lidarcli.sweeps import Bool, Float64, Int8, Int32, Int64, UInt8, record

ENDS = ("left view", "free", "lost", "end of log")
"""Reasons for the end of a track: it left the view, beams pass through its place, it was lost, the log ended."""
LEFT_VIEW, FREE, LOST, END_OF_LOG = range(4)

EMPTY, LIVE, ENDED = range(3)
"""States of a slot: without a body, with one, with one that has ended and waits for its window to be settled."""
DISC, BOX, PERSON = range(3)
"""Kinds of bodies."""
MOST_LEGS = 6
"""Greatest number of legs of a body that are remembered beside it."""
CONFIRMED_SIGHTINGS = 3
"""Least number of sightings of a track."""
SIZE_OUTLIER = 9e-4
"""[m²] A measured size that differs from the others by the root of this, (3 cm)², counts half."""


@record
class Followed:
    """Tracks of the objects of one batch: K objects in the order of the detection, S sweeps."""

    track: Int64
    """(K,) number of the track, 1, 2, ... by first sight; 0 without a track."""
    vx: Float64
    """(K,) velocity of the track over ground [m/s]; NaN without a track."""
    vy: Float64
    moving: Int8
    """(K,) 1 where the track moves in this sweep, 0 where it stands, -1 without a track."""
    set: UInt8
    """(K,) set of each object (Def. 4): agents are in A, and what all sweeps together take for building is in S."""
    shape: UInt8
    """(K,) shape of each object, by all sweeps that saw its track."""
    thing: Float64
    """(K,) probability of being a thing, by all sweeps that saw its track; NaN where it was not asked."""
    order: Int64
    """(K,) the objects by sweep, set S last, then bearing."""
    object: Int32
    """(K,) number of each object in its sweep, in this order."""
    label: Int32
    """(K,) index into the catalogue, -1 for none."""
    label_score: Float64
    """(K,) probability of the label, 0 to 1; NaN without a label."""
    objects: Int32
    """(S,) number of objects of set O; with the agents the sums of Def. 4 stay as they were."""
    agents: Int32
    """(S,) number of agents."""
    object_beams: Int32
    agent_beams: Int32
    noise_beams: Int32
    """(S,) number of beams of each set."""


@record
class Tracks:
    """M tracks by number. Metres, radians, seconds; in the world frame, or without poses in that of the sensor."""

    frame: Int32
    """(M,) index into the frame names of the tracker."""
    track: Int64
    set: UInt8
    shape: UInt8
    label: Int32
    """(M,) index into the catalogue, -1 for none."""
    label_score: Float64
    first_sweep: Int64
    last_sweep: Int64
    first_stamp_ns: Int64
    last_stamp_ns: Int64
    duration: Float64
    sweeps: Int64
    """(M,) number of sweeps that saw it."""
    hidden: Float64
    """(M,) time in which it was not seen [s]."""
    x: Float64
    y: Float64
    yaw: Float64
    length: Float64
    width: Float64
    length_sd: Float64
    width_sd: Float64
    distance: Float64
    speed_mean: Float64
    speed_max: Float64
    moved: Bool
    """(M,) True if it ever moved, from `moved_at_ns` on."""
    moved_at_ns: Int64
    end: UInt8
    """(M,) index into `ENDS`."""

    def __len__(self) -> int:
        return len(self.track)
