"""What tracking finds: for every object of a batch the thing it belongs to, and for every thing what is known of it."""

from __future__ import annotations

from lidarcli.sweeps import Bool, Float64, Int8, Int32, Int64, UInt8, record

ENDS = ("left view", "free", "lost", "end of log")
LEFT_VIEW, FREE, LOST, END_OF_LOG = range(4)

EMPTY, LIVE, ENDED = range(3)
"""A slot without a body, with one, with one that has ended and whose rows wait to be settled."""
DISC, BOX, PERSON = range(3)
"""What a body is taken for."""
LEGS = 6
"""Further legs of a thing that are remembered at most."""
CONFIRMED = 3
"""Sightings that make a track."""


@record
class Followed:
    """What tracking adds to the detection of one batch: K objects in the order of the detection, S sweeps."""

    track: Int64
    """(K,) number of the thing, 1, 2, ... by first sight; 0 where the object belongs to none."""
    vx: Float64
    """(K,) velocity of the thing over ground [m/s]; NaN without a track."""
    vy: Float64
    moving: Int8
    """(K,) 1 where the thing moves in this sweep, 0 where it stands, -1 without a track."""
    set: UInt8
    """(K,) the set of each object (Def. 4): agents are A, what is building by all that was seen of it is S."""
    shape: UInt8
    """(K,) the shape of each object, by all that was seen of its thing."""
    thing: Float64
    """(K,) how likely it is a thing, by all that was seen of it; NaN where nobody asked."""
    order: Int64
    """(K,) the objects by sweep, set S last, then bearing."""
    object: Int32
    """(K,) the number of each object in its sweep, in this order."""
    label: Int32
    """(K,) entry of the catalogue, -1 for none."""
    label_score: Float64
    """(K,) how well it fits, 0 to 1; NaN without a label."""
    objects: Int32
    """(S,) objects of set O, and agents, and their beams: Def. 4 sums as before."""
    agents: Int32
    object_beams: Int32
    agent_beams: Int32
    noise_beams: Int32


@record
class Tracks:
    """M things, ordered by their number. Metres, radians, seconds; in the world frame, or without a pose the sensor's."""

    frame: Int32
    """(M,) index into the frame names of the tracker."""
    track: Int64
    set: UInt8
    shape: UInt8
    label: Int32
    """(M,) entry of the catalogue, -1 for none."""
    label_score: Float64
    first_sweep: Int64
    last_sweep: Int64
    first_stamp_ns: Int64
    last_stamp_ns: Int64
    duration: Float64
    sweeps: Int64
    """(M,) sweeps in which it was seen."""
    hidden: Float64
    """(M,) time in which it was not [s]."""
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
    """(M,) whether it ever moved; then `moved_at_ns` is the onset."""
    moved_at_ns: Int64
    end: UInt8
    """(M,) index into `ENDS`."""

    def __len__(self) -> int:
        return len(self.track)
