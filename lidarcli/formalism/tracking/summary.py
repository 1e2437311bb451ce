"""The rows of the tracks table: what is known of each thing in the end."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import AGENT, LEGGED, OBJECT, PRISMATIC, UNKNOWN
from lidarcli.formalism.evidence import rectangle
from lidarcli.formalism.shares import shape_likelihood
from lidarcli.formalism.tracking.things import Thing, Track
from lidarcli.formalism.tracking.tracked import BOX, END_OF_LOG, Tracks

if TYPE_CHECKING:
    from lidarcli.formalism.tracking.windows import Register

SURE_SIZE = 0.15
"""[m] A side whose standard deviation is larger is not known."""
STRAIGHT_POINTS = 60.0
"""Points of faces that tell whether these are straight."""
BULGE_SPREAD = 0.25
"""The squared distances from straight faces may be this much more than noise explains, as a logarithm."""
SURE = 20.0
"""Log-odds of what was seen beyond doubt."""
LEAST_ODDS = 0.2
"""A shape has to be likelier than the next one by this."""
LEG_SD = 0.03
"""[m] Standard deviation of the distance of two legs: their fronts are seen."""
ONE_LEG = 0.1
"""[m] Places that are closer together are those of one leg."""
RIGHT_ANGLE = 0.5 * math.pi


def tracks_of(register: Register, sweeps: int) -> Tracks:
    """All tracks, by their number. `sweeps`: of the topic."""
    tracks = register.tracks
    rows = [_row(track) for track in tracks]

    def column(name: str, kind: type) -> NDArray[Any]:
        return np.array([row[name] for row in rows], kind)

    return Tracks(
        frame=np.array([track.frame for track in tracks], np.int32),
        track=np.array([track.number for track in tracks], np.int64),
        set=np.array([AGENT if track.is_agent else OBJECT for track in tracks], np.uint8),
        shape=column("shape", np.uint8),
        label=np.array([track.label for track in tracks], np.int32),
        label_score=np.array([track.label_score for track in tracks], np.float64),
        first_sweep=np.array([track.first[0] for track in tracks], np.int64),
        last_sweep=np.array([track.last[0] for track in tracks], np.int64),
        first_stamp_ns=np.array([track.first[1] for track in tracks], np.int64),
        last_stamp_ns=np.array([track.last[1] for track in tracks], np.int64),
        duration=np.array([(track.last[1] - track.first[1]) / 1e9 for track in tracks], np.float64),
        sweeps=np.array([track.sweeps for track in tracks], np.int64),
        hidden=np.array([track.hidden for track in tracks], np.float64),
        x=column("x", float),
        y=column("y", float),
        yaw=column("yaw", float),
        length=column("length", float),
        width=column("width", float),
        length_sd=column("length_sd", float),
        width_sd=column("width_sd", float),
        distance=np.array([track.distance for track in tracks], np.float64),
        speed_mean=np.array([_mean_speed(track) for track in tracks], np.float64),
        speed_max=np.array([track.speed_max for track in tracks], np.float64),
        moved=np.array([track.is_agent for track in tracks], np.bool_),
        moved_at_ns=np.array([track.onset_ns for track in tracks], np.int64),
        end=column("end", np.uint8),
    )


def _mean_speed(track: Track) -> float:
    lasts = (track.last[1] - track.first[1]) / 1e9
    return track.distance / lasts if lasts > 0.0 else 0.0


def _row(track: Track) -> dict[str, float]:
    """What the parts of a track say of it."""
    body = main(track)
    last = max(track.parts, key=lambda part: (part.last_sweep, -part.number))
    shape, end = _shape(track, body), last.end if last.has_ended else END_OF_LOG
    if (frame := frame_of_legs(track)) is not None:
        return {**asdict(frame), "length_sd": LEG_SD, "width_sd": LEG_SD, "shape": shape, "end": end}
    sides = [_side(body, axis) for axis in range(2)]
    yaw = body.yaw
    if sides[1][0] > sides[0][0]:
        sides.reverse()
        yaw += RIGHT_ANGLE
    x, y = (track.x, track.y) if track.moved or len(track.parts) > 1 else body.place(True)
    (length, length_sd), (width, width_sd) = sides
    return {
        "x": x,
        "y": y,
        "yaw": _halved(yaw) if body.kind == BOX else 0.0,
        "length": length,
        "width": width,
        "length_sd": length_sd,
        "width_sd": width_sd,
        "shape": shape,
        "end": end,
    }


def main(track: Track) -> Thing:
    """The part that was seen most often."""
    return max(track.parts, key=lambda part: (part.sightings, -part.number))


def _halved(yaw: float) -> float:
    """The direction of an axis in (-π/2, π/2]."""
    return RIGHT_ANGLE - (RIGHT_ANGLE - yaw) % math.pi


@dataclass(frozen=True, slots=True)
class LegFrame:
    """The smallest rectangle through the places of legs that stand."""

    legs: int
    length: float
    width: float
    x: float
    y: float
    yaw: float


def frame_of_legs(track: Track) -> LegFrame | None:
    """Where the legs of a thing stand; None where it has none, or walks."""
    if track.moved:
        return None
    places: list[tuple[float, float]] = []
    for part in track.parts if track.several else [main(track)]:
        for place in (part.place(True), *part.legs):
            if all(math.dist(place, other) > ONE_LEG for other in places):
                places.append(place)
    if len(places) < 2:
        return None
    x, y = np.array([places]).transpose(2, 0, 1)
    sides, yaw, middle = rectangle(x, y)
    one, other = sides[:, 0].tolist()
    angle = float(yaw[0])
    if other > one:
        one, other, angle = other, one, angle + RIGHT_ANGLE
    return LegFrame(len(places), one, other, float(middle[0, 0]), float(middle[1, 0]), _halved(angle))


def _side(thing: Thing, axis: int) -> tuple[float, float]:
    """A side and its standard deviation [m]; NaN where it is not known."""
    if thing.side_weight[axis] > 0.0:
        return max(thing.side[axis], 0.0), max(math.sqrt(1.0 / thing.side_weight[axis]), 0.003)
    sd = 2.0 * math.sqrt(thing.hh[axis])
    return (2.0 * thing.h[axis], sd) if sd <= SURE_SIZE else (math.nan, math.nan)


def row_shape(thing: Thing) -> int:
    """The shape of a body in the rows: the likeliest by all that was seen of it, or what it was before if as good."""
    if not any(thing.looks):
        return thing.row_shape
    odds = body_odds(thing)
    best = int(np.argmax(odds))
    if thing.row_shape != UNKNOWN and odds[best] - odds[thing.row_shape] <= LEAST_ODDS:
        return thing.row_shape
    return best


def shape_odds(track: Track, thing: Thing) -> list[float]:
    """Log-likelihood of all that was seen of a track, mostly as one body, if it is prismatic, round, legged, irregular."""
    odds = body_odds(thing)
    if track.several or len(thing.legs) > 0 or any(part.has_legs for part in track.parts):
        odds[LEGGED] = max(odds) + SURE
    return odds


def body_odds(thing: Thing) -> list[float]:
    """The same of one body by itself."""
    odds = shape_likelihood(thing.looks)
    if thing.bulge_points >= STRAIGHT_POINTS:
        # Faces that stay further from straight than noise explains are none of a prism.
        ratio = thing.bulge / thing.bulge_points
        off = math.log(max(ratio, 1.0)) / BULGE_SPREAD
        odds[PRISMATIC] -= 0.5 * off * off
    return odds


def _shape(track: Track, thing: Thing) -> int:
    """The likeliest shape; unknown where nothing tells."""
    odds = shape_odds(track, thing)
    best = int(np.argmax(odds))
    rest = sorted(odds)[-2]
    return best if odds[best] - rest > LEAST_ODDS else UNKNOWN
