"""Results of tracking: the track of every object of a batch, the tracks themselves, and their trajectories.

From small to large: a measurement is what one sweep shows of a body, a target its slot in the filter, a tracklet what a
target has observed until it ends, a track the tracklets of one object.
"""

from __future__ import annotations

from lidarcli.formalism.detection import SETS, SHAPES, Detection
from lidarcli.sweeps.types import Bool, Float64, Int8, Int32, Int64, SweepBatch, UInt8, column, record

ENDS = ("left view", "free", "lost", "end of log")
"""Reasons for the end of a track: it left the view, beams pass through its place, it was lost, the log ended."""
LEFT_VIEW, FREE, LOST, END_OF_LOG = range(4)

VIEWS = ("seen", "partly", "hidden")
"""Share of a track that a sweep shows: all of it, a part of it (of a person one leg), or nothing."""
SEEN, PARTLY, HIDDEN = range(3)
FRAMES = ("sensor", "world")
"""Frames of places: of a sensor that is static, and the fixed frame of the poses."""
EMPTY, LIVE, ENDED = range(3)
"""States of a slot: without a body, with one, with one that has ended and waits for its window to be settled."""
DISC, BOX, PERSON = range(3)
"""Kinds of bodies."""
MAX_LEGS = 6
"""Greatest number of legs of a body that are remembered next to it."""
CONFIRMED_SIGHTINGS = 3
"""Least number of sightings of a track, by which a target is confirmed."""
SHORTEST_STAND = 2.0
"""[s] A static object may be unobserved for as long as it was observed to be static, or for this long."""
MIN_WAY = 0.2
"""[m] Least distance that a moving body has gone."""
SIZE_OUTLIER = 9e-4
"""[m²] A measured size that differs from the others by the root of this, (3 cm)², counts half."""


@record
class TrackedBatch:
    """Results of tracking that complete the detection of one batch: K objects in the order of the detection, S sweeps.

    The fields that a `Detection` has as well take the place of its own.
    """

    batch: SweepBatch
    detection: Detection
    """The batch and its detection, as they were given to the tracker."""
    track: Int64 = column(
        "1", "thing that the object belongs to, 1, 2, ... by first sight; null until tracked", nullable=True
    )
    """0 without a track."""
    vx: Float64 = column(
        "m/s", "velocity of the thing over ground, world frame or else sensor frame; null until tracked", nullable=True
    )
    vy: Float64 = column("m/s", "velocity of the thing over ground; null until tracked", nullable=True)
    moving: Int8 = column("", "whether the thing moves in this sweep; null until tracked", kind="bool", nullable=True)
    """-1 without a track."""
    agent_score: Float64 = column(
        "1", "probability that the thing has gone by itself by then; null until tracked", nullable=True
    )
    """NaN without a track, and where the place of the sensor is not known."""
    set: UInt8
    """(K,) set of each object (Def. 4): agents are in A, and what all sweeps together take for building is in S."""
    shape: UInt8
    """(K,) shape of each object, by all sweeps that observed its track."""
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

    sensor: Int32
    """(M,) index of the sensor among those of the tracker; -1 where several observed it."""
    track: Int64 = column("1", "number of the thing, 1, 2, ... by first sight within its topic", per="track")
    set: UInt8 = column("", "A agent: it has moved by itself; O object: it has not", per="track", words=SETS)
    person: Int64 = column(
        "1", "person that it counts as: its first track; null for what counts as none", per="track", nullable=True
    )
    """0 for none; as of `counting.PersonFinder`."""
    shape: UInt8 = column(
        "", "prismatic, round, legged (slim parts), irregular or unknown, by all that was seen", per="track", words=SHAPES
    )
    label: Int32
    """(M,) index into the catalogue, -1 for none."""
    label_score: Float64
    first_sweep: Int64 = column("1", "sweep in which it was first seen", per="track")
    last_sweep: Int64 = column("1", "sweep in which it was last seen", per="track")
    first_stamp_ns: Int64 = column("ns", "stamp of the first of these sweeps", per="track")
    last_stamp_ns: Int64 = column("ns", "stamp of the last", per="track")
    duration: Float64 = column("s", "from the first sight to the last", per="track")
    sweeps: Int64 = column("1", "sweeps in which it was seen", per="track")
    hidden: Float64 = column("s", "time between first and last sight in which it was not seen", per="track")
    x: Float64 = column(
        "m", "centre, world frame or else sensor frame; of an agent where it was last", per="track", kind="float64"
    )
    y: Float64 = column("m", "centre, world frame or else sensor frame", per="track", kind="float64")
    yaw: Float64 = column("rad", "direction of the longer side", per="track", kind="float64")
    length: Float64 = column("m", "longer side by all that was seen of it; null where unknown", per="track", nullable=True)
    width: Float64 = column("m", "shorter side by all that was seen of it; null where unknown", per="track", nullable=True)
    length_sd: Float64 = column("m", "standard deviation of the length; null with it", per="track", nullable=True)
    width_sd: Float64 = column("m", "standard deviation of the width; null with it", per="track", nullable=True)
    distance: Float64 = column("m", "way over ground that was seen", per="track")
    distance_hidden: Float64 = column("m", "way over ground that was not seen", per="track")
    speed_mean: Float64 = column("m/s", "mean speed while it was seen", per="track")
    speed_max: Float64 = column("m/s", "greatest speed while it was seen", per="track")
    moved_at_ns: Int64 = column(
        "ns", "stamp at which it began to move; null for what never moved", per="track", nullable=True
    )
    agent_score: Float64 = column(
        "1",
        "probability that it goes by itself; null where the place of the sensor is not known",
        per="track",
        nullable=True,
    )
    end: UInt8 = column("", "left view, free, lost or end of log: why it ends", per="track", words=ENDS)
    moved: Bool
    """(M,) True if it ever moved, from `moved_at_ns` on."""

    def __len__(self) -> int:
        return len(self.track)


@record
class Trajectories:
    """N rows, those of one track in the order of time."""

    track: Int64 = column("1", "number of the thing, as in the tracks table", per="trajectory")
    sensor: Int32
    """(N,) index of the sensor of the sweep among those of the tracker."""
    sweep: Int64
    """(N,) index of the sweep in its topic."""
    stamp_ns: Int64
    seconds: Float64
    """(N,) stamp of the sweep [ns], and seconds since the first sweep of the topic."""
    frame: UInt8 = column("", "frame of x and y: world where poses are known, else sensor", per="trajectory", words=FRAMES)
    x: Float64 = column(
        "m", "middle of the thing by all sweeps that saw it, before and after", per="trajectory", kind="float64"
    )
    y: Float64 = column("m", "middle of the thing", per="trajectory", kind="float64")
    vx: Float64 = column("m/s", "velocity over ground; 0 while it stands", per="trajectory")
    vy: Float64 = column("m/s", "velocity over ground", per="trajectory")
    x_sd: Float64 = column("m", "standard deviation of x", per="trajectory")
    y_sd: Float64 = column("m", "standard deviation of y", per="trajectory")
    xy_cov: Float64 = column("m²", "covariance of x and y", per="trajectory")
    vx_sd: Float64 = column("m/s", "standard deviation of vx", per="trajectory")
    vy_sd: Float64 = column("m/s", "standard deviation of vy", per="trajectory")
    seen: UInt8 = column("", "seen, partly (of a person one leg) or hidden in this sweep", per="trajectory", words=VIEWS)
    parts: Int32 = column("1", "objects of this sweep that are parts of it; 0 while hidden", per="trajectory")

    def __len__(self) -> int:
        return len(self.track)
