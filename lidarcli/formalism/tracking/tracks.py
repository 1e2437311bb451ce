"""Confirmed tracklets, the tracks they are parts of, and the rows of the tracks table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import AGENT, LEGGED, OBJECT, PRISMATIC, UNKNOWN
from lidarcli.formalism.matching.catalogue import rectangle, shape_likelihood
from lidarcli.formalism.tracking.results import BOX, END_OF_LOG, ENDED, PERSON, Tracks
from lidarcli.sweeps.types import Int64

LEG_SHARE = 0.25
"""Share of the sightings of a tracklet in which a leg next to it has to be observed."""
WHOLE_SIGHTINGS = 3
"""Sightings of both legs of a person, or both ends of a tracklet, that are enough."""
KNOWN_SIZE_SD = 0.15
"""[m] Greatest standard deviation of a side that is known."""
STRAIGHT_POINTS, BULGE_SPREAD = 60.0, 0.25
"""Least number of points of faces that decide whether the faces are straight, and standard deviation of the logarithm of
the squared distances from straight ones, over what noise explains."""
LEGGED_ODDS, MIN_SHAPE_ODDS = 20.0, 0.2
"""[log-odds] Advantage of the shape legged where legs were observed, and least advantage of a shape over the next one."""
LEG_DISTANCE_SD, ONE_LEG = 0.03, 0.1
"""[m] Standard deviation of the distance of two legs, of which the fronts are visible; places closer than this are one
leg."""
STANDING_LEGS_APART = 0.65
"""[m] Greatest distance of a leg to the next one of its object."""
RIGHT_ANGLE = 0.5 * math.pi


@dataclass(slots=True, eq=False)
class Tracklet:
    """A confirmed tracklet, as it was at the end of a window; fields as in `kalman.Targets`."""

    number: int
    kind: int = 0
    sightings: int = 0
    whole: int = 0
    moved: int = 0
    first_sweep: int = 0
    last_sweep: int = 0
    onset: int = 0
    end: int = END_OF_LOG
    same_as: int = 0
    member: int = 0
    first_time: float = 0.0
    last_time: float = 0.0
    yaw: float = 0.0
    size: float = 0.0
    bulge: float = 0.0
    bulge_points: float = 0.0
    h: tuple[float, float] = (0.0, 0.0)
    hh: tuple[float, float] = (0.0, 0.0)
    c: tuple[float, float] = (0.0, 0.0)
    static_c: tuple[float, float] = (0.0, 0.0)
    static_cc: tuple[float, float] = (0.0, 0.0)
    side: tuple[float, float] = (0.0, 0.0)
    side_weight: tuple[float, float] = (0.0, 0.0)
    least: tuple[float, float] = (0.0, 0.0)
    shape_votes: tuple[float, ...] = (0.0,) * 4
    legs: tuple[tuple[float, float], ...] = ()
    """Places of legs that are too slim to be objects [m]."""
    has_ended: bool = False
    final: tuple[complex, complex] | None = None
    """Last place x + iy [m] and velocity there [m/s], once the sightings are settled."""
    row_shape: int = UNKNOWN
    """Shape in the rows, by what was observed so far."""
    track: Track | None = None

    def take(self, columns: dict[str, list[Any]], k: int) -> None:
        """Copy the state of the k-th tracklet (`columns_of`)."""
        for name, values in columns.items():
            setattr(self, name, values[k])

    @property
    def has_legs(self) -> bool:
        """True for a person whose two legs were observed at once."""
        return self.kind == PERSON and self.whole >= WHOLE_SIGHTINGS

    @property
    def size_is_known(self) -> bool:
        """True once the size was observed often enough."""
        return (self.sightings if self.kind == PERSON else self.whole) >= WHOLE_SIGHTINGS and self.size > 0.0

    def place(self, still: bool) -> tuple[float, float]:
        """Return the centre in the world [m], of the tracklet or of its static model that is static."""
        along, across = self.static_c if still else self.c
        cos, sin = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return cos * along - sin * across, sin * along + cos * across


def columns_of(arrays: dict[str, NDArray[Any]], slots: Int64) -> dict[str, list[Any]]:
    """Return the state of the tracklets in some slots of `Targets.arrays`, by field of `Tracklet`."""
    size = len(arrays["state"])
    names = [each.name for each in fields(Tracklet) if each.name in arrays]
    rows = {name: arrays[name].reshape(size, -1)[slots] for name in (*names, "state", "leg_hits", "leg_x", "leg_y")}
    # Sweeps that tell no shape have no vote.
    rows["shape_votes"] = rows["shape_votes"][:, :4]
    columns: dict[str, list[Any]] = {}
    for name in names:
        values = rows[name]
        columns[name] = values[:, 0].tolist() if values.shape[1] == 1 else [*map(tuple, values.tolist())]
    columns["has_ended"] = (rows["state"][:, 0] == ENDED).tolist()
    often = rows["leg_hits"] > LEG_SHARE * rows["sightings"]
    columns["legs"] = [()] * len(slots)
    for k in np.flatnonzero(often.any(axis=1)).tolist():
        at = often[k]
        columns["legs"][k] = tuple(zip(rows["leg_x"][k, at].tolist(), rows["leg_y"][k, at].tolist(), strict=True))
    return columns


@dataclass(slots=True, eq=False)
class Track:
    """One row of the tracks table: a tracklet, or several that belong together."""

    parts: list[Tracklet] = field(default_factory=list)
    number: int = 0
    """1, 2, ... by first sighting; 0 before its first row."""
    sensors: set[int] = field(default_factory=set)
    """Those that observed it."""
    several: bool = False
    """True if parts of it are visible side by side, as legs are."""
    moved: bool = False
    is_agent: bool = False
    """True once a row of it is in set A."""
    onset_ns: int = 0
    """Stamp at which it began to go; 0 before."""
    was_agent: bool = False
    agent_score: float = 0.0
    last_view: complex = 0.0
    """Verdict on its last row of the settled windows, and where it was observed then, x + iy [m]."""
    best_score: float = math.nan
    """Greatest score so far; NaN where no place of the sensor was known."""
    first: tuple[int, int] = (0, 0)
    """Sweep and stamp of its first row."""
    last: tuple[int, int] = (0, 0)
    """Sweep and stamp of its last row."""
    last_sweeps: int = 0
    """Number of sweeps of the topic before its last row."""
    last_time: float = 0.0
    """Time of its last row [s]."""
    sweeps: int = 0
    hidden: float = 0.0
    distance: float = 0.0
    distance_hidden: float = 0.0
    seen_ns: int = 0
    """Path that sweeps observed, the rest of its path [m], and the time of the first [ns] (`seen_steps`)."""
    seen_stop: int = -1
    """Number of sweeps of the topic up to its last row, if that row is visible; else -1."""
    speed_max: float = 0.0
    x: float = 0.0
    y: float = 0.0
    label: int = -1
    """Index into the catalogue, by what was observed so far; -1 for none."""
    label_score: float = math.nan
    """Probability of the label."""
    state: NDArray[np.float64] | None = None
    """State of the smoother in its last sweep of the settled windows (`Smoother.smooth`)."""
    path_stop: int = -1
    """Number of sweeps of the topic up to its last one of the settled windows; -1 before its first row."""
    static_codes: list[NDArray[np.uint8]] = field(default_factory=list)
    """Bytes of its last sweeps while it is static (`PARTS_MASK`), whose rows are pending."""

    def prune(self, stop: int) -> None:
        """Keep, of the tracklets that have ended, the one that was observed most and the last one: the tables need no
        other.

        `stop`: number of sweeps of the topic that are settled.
        """
        self.several = self.several or any(part.has_legs for part in self.parts)
        over = [part for part in self.parts if part.has_ended and part.last_sweep < stop]
        if len(over) > 2:
            kept = (max(over, key=lambda part: (part.sightings, -part.number)), max(over, key=lambda part: part.last_sweep))
            self.parts = [part for part in self.parts if part in kept or part not in over]

    def add_part(self, tracklet: Tracklet) -> None:
        """Take a tracklet as a part of this track."""
        self.parts.append(tracklet)
        tracklet.track = self


KINDS = {"Int32": np.int32, "Int64": np.int64, "Float64": np.float64, "UInt8": np.uint8, "Bool": np.bool_}


def tracks_of(tracks: list[Track]) -> Tracks:
    """Return the rows of the tracks table, by number."""
    rows = [_row(track) for track in tracks]
    columns = {each.name: KINDS[str(each.type)] for each in fields(Tracks)}
    return Tracks(**{name: np.array([row[name] for row in rows], kind) for name, kind in columns.items()})


def _row(track: Track) -> dict[str, float]:
    """Return the row of a track."""
    lasts = (track.last[1] - track.first[1]) / 1e9
    return _outline(track) | {
        "sensor": min(track.sensors) if len(track.sensors) == 1 else -1,
        "track": track.number,
        "set": AGENT if track.is_agent else OBJECT,
        "person": 0,
        "label": track.label,
        "label_score": track.label_score,
        "first_sweep": track.first[0],
        "last_sweep": track.last[0],
        "first_stamp_ns": track.first[1],
        "last_stamp_ns": track.last[1],
        "duration": lasts,
        "sweeps": track.sweeps,
        "hidden": track.hidden,
        "distance": track.distance,
        "distance_hidden": track.distance_hidden,
        "speed_mean": 1e9 * track.distance / track.seen_ns if track.seen_ns > 0 else 0.0,
        "speed_max": track.speed_max,
        "agent_score": track.best_score,
        "moved": track.is_agent,
        "moved_at_ns": (track.onset_ns or track.last[1]) if track.is_agent else 0,
    }


def _outline(track: Track) -> dict[str, float]:
    """Return place, size, shape and end of a track, by its parts."""
    tracklet = main_part(track)
    last = max(track.parts, key=lambda part: (part.last_sweep, -part.number))
    shape, end = shape_of(track, tracklet), last.end if last.has_ended else END_OF_LOG
    if (frame := frame_of_legs(track)) is not None:
        return frame | {"length_sd": frame["sd"], "width_sd": frame["sd"], "shape": shape, "end": end}
    sides = [_side(tracklet, axis) for axis in range(2)]
    yaw = tracklet.yaw
    if sides[1][0] > sides[0][0]:
        sides.reverse()
        yaw += RIGHT_ANGLE
    x, y = (track.x, track.y) if track.moved else tracklet.place(True)
    (length, length_sd), (width, width_sd) = sides
    return {
        "x": x,
        "y": y,
        "yaw": _halved(yaw) if tracklet.kind == BOX else 0.0,
        "length": length,
        "width": width,
        "length_sd": length_sd,
        "width_sd": width_sd,
        "shape": shape,
        "end": end,
    }


def place_of(track: Track) -> tuple[float, float, float, float, float]:
    """Return where a track stands, x and y [m], and the covariance of that, xx, xy and yy [m²]."""
    row, tracklet = _outline(track), main_part(track)
    c, s = math.cos(tracklet.yaw), math.sin(tracklet.yaw)
    along, across = tracklet.static_cc
    return (row["x"], row["y"], c * c * along + s * s * across, c * s * (along - across), s * s * along + c * c * across)


def main_part(track: Track) -> Tracklet:
    """Return the part that was observed most often."""
    return max(track.parts, key=lambda part: (part.sightings, -part.number))


def _halved(yaw: float) -> float:
    """Return the direction of an axis in (-π/2, π/2]."""
    return RIGHT_ANGLE - (RIGHT_ANGLE - yaw) % math.pi


def frame_of_legs(track: Track) -> dict[str, float] | None:
    """Return the smallest rectangle through the legs of a track at one time [m, rad]; None if it has none, or walks."""
    if track.moved:
        return None
    places: list[tuple[float, float]] = []
    parts = _side_by_side(track) if track.several else [main_part(track)]
    # From leg to next leg, the one that was observed most first: what is farther off came and went as another object.
    ahead = [place for part in parts for place in (part.place(True), *part.legs)]
    while near := [
        place for place in ahead if not places or min(math.dist(place, one) for one in places) < STANDING_LEGS_APART
    ]:
        ahead.remove(near[0])
        if all(math.dist(near[0], other) > ONE_LEG for other in places):
            places.append(near[0])
    if len(places) < 2:
        return None
    x, y = np.array([places]).transpose(2, 0, 1)
    sides, yaw, middle = rectangle(x, y)
    one, other = sides[:, 0].tolist()
    angle = float(yaw[0])
    if other > one:
        one, other, angle = other, one, angle + RIGHT_ANGLE
    x, y = float(middle[0, 0]), float(middle[1, 0])
    sd = math.hypot(LEG_DISTANCE_SD, math.sqrt(2.0 * max(max(part.static_cc) for part in parts)))
    return {"legs": len(places), "length": one, "width": other, "sd": sd, "x": x, "y": y, "yaw": _halved(angle)}


def _side_by_side(track: Track) -> list[Tracklet]:
    """Return the legs of a track that were followed at one time, of all such times those observed most; the best one
    first."""
    legs = [part for part in track.parts if part.kind != PERSON] or track.parts
    times = [[other for other in legs if other.first_sweep <= part.first_sweep <= other.last_sweep] for part in legs]
    found = max(times, key=lambda parts: (sum(part.sightings for part in parts), len(parts)))
    return sorted(found, key=lambda part: (-part.sightings, part.number))


def _side(tracklet: Tracklet, axis: int) -> tuple[float, float]:
    """Return a side and its standard deviation [m]; NaN where it is not known."""
    if tracklet.side_weight[axis] > 0.0:
        return max(tracklet.side[axis], 0.0), max(math.sqrt(1.0 / tracklet.side_weight[axis]), 0.003)
    sd = 2.0 * math.sqrt(tracklet.hh[axis])
    return (2.0 * tracklet.h[axis], sd) if sd <= KNOWN_SIZE_SD else (math.nan, math.nan)


def row_shape(tracklet: Tracklet) -> int:
    """Return the shape of a tracklet in the rows: the likeliest one, or the one before if it is about as likely."""
    if not any(tracklet.shape_votes):
        return tracklet.row_shape
    odds = body_odds(tracklet)
    best = int(np.argmax(odds))
    if tracklet.row_shape != UNKNOWN and odds[best] - odds[tracklet.row_shape] <= MIN_SHAPE_ODDS:
        return tracklet.row_shape
    return best


def shape_odds(track: Track, tracklet: Tracklet) -> list[float]:
    """Return the log-likelihood of a track and its main tracklet being prismatic, round, legged, irregular."""
    odds = body_odds(tracklet)
    if track.several or len(tracklet.legs) > 0 or any(part.has_legs for part in track.parts):
        odds[LEGGED] = max(odds) + LEGGED_ODDS
    return odds


def body_odds(tracklet: Tracklet) -> list[float]:
    """Return the log-likelihood of one tracklet being prismatic, round, legged, irregular."""
    odds = shape_likelihood(tracklet.shape_votes)
    if tracklet.bulge_points >= STRAIGHT_POINTS:
        # A prism has no face that is further from straight than noise explains.
        ratio = tracklet.bulge / tracklet.bulge_points
        off = math.log(max(ratio, 1.0)) / BULGE_SPREAD
        odds[PRISMATIC] -= 0.5 * off * off
    return odds


def shape_of(track: Track, tracklet: Tracklet) -> int:
    """Return the likeliest shape of a track; unknown where no shape stands out."""
    odds = shape_odds(track, tracklet)
    best = int(np.argmax(odds))
    rest = sorted(odds)[-2]
    return best if odds[best] - rest > MIN_SHAPE_ODDS else UNKNOWN
