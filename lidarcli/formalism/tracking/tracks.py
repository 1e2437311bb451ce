"""Tracklets that were seen often enough, the tracks they are parts of, and the rows of the tracks table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import AGENT, LEGGED, OBJECT, PRISMATIC, UNKNOWN, Detection
from lidarcli.formalism.matching.catalogue import Catalogue, Evidence, evidence_of, rectangle, shape_likelihood
from lidarcli.formalism.matching.catalogue import name as label_tracks
from lidarcli.formalism.tracking.results import (
    BOX,
    END_OF_LOG,
    ENDED,
    HIDDEN,
    PARTLY,
    PERSON,
    SEEN,
    SIZE_OUTLIER,
    Tracks,
    Trajectories,
)
from lidarcli.sweeps.types import Bool, Float64, Int32, Int64, SweepBatch, UInt8

LEG_SHARE = 0.25
"""Share of the sightings of a tracklet in which a leg beside it has to be seen."""
WHOLE_SIGHTINGS = 3
"""Sightings of both legs of a person, or both ends of a tracklet, that are enough."""
KNOWN_SIZE_SD = 0.15
"""[m] Greatest standard deviation of a side that is known."""
STRAIGHT_POINTS, BULGE_SPREAD = 60.0, 0.25
"""Least number of points of faces that decide whether the faces are straight, and standard deviation of the logarithm of
the squared distances from straight ones, over what noise explains."""
LEGGED_ODDS, MIN_SHAPE_ODDS = 20.0, 0.2
"""[log-odds] Advantage of the shape legged where legs were seen, and least advantage of a shape over the next one."""
LEG_DISTANCE_SD, ONE_LEG = 0.03, 0.1
"""[m] Standard deviation of the distance of two legs, of which the fronts are seen; places closer than this are one leg."""
STANDING_LEGS_APART = 0.65
"""[m] Greatest distance of a leg to the next one of its thing."""
RIGHT_ANGLE = 0.5 * math.pi


@dataclass(slots=True, eq=False)
class Tracklet:
    """A tracklet that was seen often enough, as it was at the end of a window; fields as in `kalman.Targets`."""

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
    """Shape in the rows, by what was seen so far."""
    track: Track | None = None

    def take(self, columns: dict[str, list[Any]], k: int) -> None:
        """Copy the state of the k-th tracklet (`columns_of`)."""
        for name, values in columns.items():
            setattr(self, name, values[k])

    @property
    def has_legs(self) -> bool:
        """True for a person whose two legs were seen at once."""
        return self.kind == PERSON and self.whole >= WHOLE_SIGHTINGS

    @property
    def size_is_known(self) -> bool:
        """True once the size was seen often enough."""
        return (self.sightings if self.kind == PERSON else self.whole) >= WHOLE_SIGHTINGS and self.size > 0.0

    def place(self, still: bool) -> tuple[float, float]:
        """Return the centre in the world [m], of the tracklet or of its static model that stands."""
        along, across = self.static_c if still else self.c
        cos, sin = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return cos * along - sin * across, sin * along + cos * across


def columns_of(arrays: dict[str, NDArray[Any]], slots: Int64) -> dict[str, list[Any]]:
    """Return the state of the tracklets in some slots of `Targets.arrays`, by field of `Tracklet`."""
    size = len(arrays["state"])
    rows = {name: values.reshape(size, -1)[slots] for name, values in arrays.items()}
    # Sweeps that tell no shape have no vote.
    rows["shape_votes"] = rows["shape_votes"][:, :4]
    columns: dict[str, list[Any]] = {}
    for name in (each.name for each in fields(Tracklet) if each.name in rows):
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
    """1, 2, ... by first sight; 0 before its first row."""
    sensors: set[int] = field(default_factory=set)
    """Those that saw it."""
    several: bool = False
    """True if parts of it are seen side by side, as legs are."""
    moved: bool = False
    is_agent: bool = False
    """True once a row of it is in set A."""
    onset_ns: int = 0
    """Stamp at which it began to go; 0 before."""
    was_agent: bool = False
    agent_score: float = 0.0
    last_view: complex = 0.0
    """Verdict on its last row of the settled windows (`agents.Verdict`), and where it was seen then, x + iy [m]."""
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
    """Way that sweeps saw, the rest of its way [m], and the time of the first [ns] (`seen_steps`)."""
    seen_stop: int = -1
    """Number of sweeps of the topic up to its last row, if that row is seen; else -1."""
    speed_max: float = 0.0
    x: float = 0.0
    y: float = 0.0
    label: int = -1
    """Index into the catalogue, by what was seen so far; -1 for none."""
    label_score: float = math.nan
    """Probability of the label."""
    state: NDArray[np.float64] | None = None
    """State of the smoother in its last sweep of the settled windows (`Smoother.smooth`)."""
    path_stop: int = -1
    """Number of sweeps of the topic up to its last one of the settled windows; -1 before its first row."""
    static_codes: list[NDArray[np.uint8]] = field(default_factory=list)
    """Bytes of its last sweeps while it stands (`PARTS_MASK`), whose rows are pending."""

    def prune(self, stop: int) -> None:
        """Keep, of the tracklets that have ended, the one that was seen most and the last one: the tables need no other.

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
    """Return the part that was seen most often."""
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
    # From leg to next leg, the one that was seen most first: what is farther off came and went as another thing.
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
    """Return the legs of a track that were followed at one time, of all such times those seen most; the best one first."""
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


# Trajectories: where each track was in every sweep from its first sight to its last, seen or not.

PARTS_MASK, PARTLY_BIT = 63, 64
"""A byte for a sweep of a track: the number of its parts that are seen, and whether more of it is hidden."""
LONGEST_STEP, PAUSE = 1.0, 3.0
"""[s] A longer step from row to row is a pause of the log, in which nothing was seen, unless it is less than so many times
the median step."""
MAX_ROWS = 65_536
"""Rows that are handed out at once, about."""


def seen_steps(seconds: Float64, seen: Bool, sensor: NDArray[np.integer[Any]]) -> Bool:
    """Return (N,) whether sweeps saw a track all the way to each of its rows from the one before.

    They saw the way between two rows that are seen if no other sweep of the sensor of the latter lies between them, and no
    pause of the log. The rows are those of one track in the order of time, with the sensor of each.
    """
    at, steps = np.flatnonzero(seen), np.diff(seconds)
    before = np.full(len(seen), -1)
    for one in np.unique(sensor):
        mine = np.flatnonzero(sensor == one)
        before[mine[1:]] = mine[:-1]
    longest = max(LONGEST_STEP, PAUSE * float(np.median(steps))) if len(steps) else 0.0
    whole = np.flatnonzero((before[at[1:]] <= at[:-1]) & (np.diff(seconds[at]) <= longest))
    edges = np.zeros(len(seen) + 1, np.int64)
    edges[at[whole] + 1] += 1
    edges[at[whole + 1] + 1] -= 1
    found: Bool = np.cumsum(edges)[:-1] > 0
    return found


@dataclass(slots=True)
class Path:
    """A piece of the path of a track that moves, sweep by sweep."""

    track: Track
    begin: int
    """Number of sweeps of the topic before the first one of the piece."""
    path: Float64
    """(S, 9) as `smoothing.Smoother.smooth` fills it in."""
    codes: UInt8
    """(S,) bytes as of `PARTS_MASK`."""
    moving: UInt8
    """(S,) 1 where it moves."""

    def add_way(self, sweeps: Sweeps) -> None:
        """Add the way of the piece to that of the track, apart what sweeps saw of it and what they did not."""
        track, place, stop = self.track, self.path[:, :2], self.begin + len(self.codes)
        seen = self.codes & PARTS_MASK > 0
        # The row before is the last one of the piece before.
        lead = int(track.seen_stop == self.begin)
        rows = sweeps.of(self.begin - lead, stop)
        step = seen_steps(rows["seconds"], np.pad(seen, (lead, 0), constant_values=True), rows["sensor"])[lead:]
        goes_on = track.path_stop >= 0 and self.moving.any()
        way = np.hypot(*np.diff(place, axis=0, prepend=[[track.x, track.y]] if goes_on else place[:1]).T)
        track.distance += float(way[step & (self.moving == 1)].sum())
        track.distance_hidden += float(way[~step].sum())
        track.seen_ns += int(np.diff(rows["stamp_ns"], prepend=rows["stamp_ns"][:1])[lead:][step].sum())
        track.seen_stop = stop if seen[-1] else -1

    def add_to_track(self) -> None:
        """Add the piece to the greatest speed of the track, whose place is now the end of the piece."""
        track, place = self.track, self.path[:, :2]
        speed = np.hypot(self.path[:, 2], self.path[:, 3])[self.codes & PARTS_MASK > 0]
        track.speed_max = max(track.speed_max, float(speed.max(initial=0.0)))
        track.x, track.y = float(place[-1, 0]), float(place[-1, 1])
        track.path_stop = self.begin + len(self.codes)


SWEEP = np.dtype(
    [
        ("index", np.int64),
        ("stamp_ns", np.int64),
        ("seconds", np.float64),
        ("posed", np.uint8),
        ("sensor", np.int32),
        ("placed", np.bool_),
    ]
)
"""Of a sweep: its index in the log; stamp [ns]; time since the first sweep [s]; 1 where places are those of the world;
its sensor; True where the place of the sensor is known, because it has a pose or stands."""


class Sweeps:
    """(N,) `SWEEP` of all sweeps so far, of one sensor or of several that are followed together, by number."""

    def __init__(self) -> None:
        self.count = 0
        self._rows = np.empty(0, SWEEP)

    def add(self, rows: NDArray[np.void]) -> None:
        """Add the next sweeps."""
        stop = self.count + len(rows)
        if stop > len(self._rows):
            more = np.empty(max(len(self._rows) * 5 // 4, stop), SWEEP)
            more[: self.count] = self._rows[: self.count]
            self._rows = more
        self._rows[self.count : stop] = rows
        self.count = stop

    def of(self, begin: int, stop: int) -> NDArray[np.void]:
        """Return the sweeps of some numbers."""
        return self._rows[begin:stop]

    def sensors_of(self, sweeps: Int64) -> Int32:
        """Return (N,) the sensors of some sweeps."""
        found: Int32 = self._rows["sensor"][sweeps]
        return found

    def steps(self, before: int, sweeps: Int64) -> Int64:
        """Return (N,) the steps to sweeps from the ones before, the first from `before`, in sweeps of their own sensors."""
        sensors = self._rows["sensor"][before : int(sweeps[-1]) + 1]
        mine = np.unique(self.sensors_of(sweeps), return_inverse=True)
        passed = np.cumsum(sensors[:, None] == mine[0], axis=0)
        at = np.concatenate([[before], sweeps]) - before
        found: Int64 = passed[at[1:], mine[1]] - passed[at[:-1], mine[1]]
        return found

    def rows(self, track: Int64, sweeps: Int64, path: Float64, codes: UInt8) -> Trajectories:
        """Return rows for (N,) tracks in sweeps by number, with (N, 9) of the path and (N,) bytes as of `PARTS_MASK`."""
        parts = (codes & PARTS_MASK).astype(np.int32)
        sd = np.sqrt(path[:, [4, 6, 7, 8]])
        row = self._rows[sweeps]
        return Trajectories(
            track=track,
            sensor=row["sensor"].copy(),
            sweep=row["index"].copy(),
            stamp_ns=row["stamp_ns"].copy(),
            seconds=row["seconds"].copy(),
            frame=row["posed"].copy(),
            x=path[:, 0],
            y=path[:, 1],
            vx=path[:, 2],
            vy=path[:, 3],
            x_sd=sd[:, 0],
            y_sd=sd[:, 1],
            xy_cov=path[:, 5],
            vx_sd=sd[:, 2],
            vy_sd=sd[:, 3],
            seen=np.where(parts == 0, HIDDEN, np.where(codes & PARTLY_BIT, PARTLY, SEEN)).astype(np.uint8),
            parts=parts,
        )


def standing(sweeps: Sweeps, tracks: list[Track]) -> Iterator[Trajectories]:
    """Yield the pending rows of what stands: one place each, by all that was seen of it."""
    pending: list[Path] = []
    rows = 0
    for track in tracks:
        if not track.static_codes:
            continue
        codes = np.concatenate(track.static_codes)
        track.static_codes.clear()
        for first in range(0, len(codes), MAX_ROWS):
            some = codes[first : first + MAX_ROWS]
            begin, rest = track.path_stop - len(codes) + first, np.zeros(len(some), np.uint8)
            x, y, xx, xy, yy = place_of(track)
            path = np.tile([x, y, 0.0, 0.0, xx, xy, yy, 0.0, 0.0], (len(some), 1))
            pending.append(Path(track, begin, path, some, rest))
            rows += len(some)
            if rows >= MAX_ROWS:
                yield joined(sweeps, pending)
                pending, rows = [], 0
    if pending:
        yield joined(sweeps, pending)


def joined(sweeps: Sweeps, pieces: list[Path]) -> Trajectories:
    """Return the rows of pieces of paths, one after the other, and add their ways to those of the tracks."""
    for piece in pieces:
        piece.add_way(sweeps)
    lengths = [len(piece.codes) for piece in pieces]
    return sweeps.rows(
        np.repeat([piece.track.number for piece in pieces], lengths).astype(np.int64),
        np.concatenate([np.arange(piece.begin, piece.begin + len(piece.codes)) for piece in pieces]),
        np.concatenate([piece.path for piece in pieces]),
        np.concatenate([piece.codes for piece in pieces]),
    )


# Names of tracks (§3, matching): the thing of interest that each one is, by all that was seen of it so far.

MAX_LOOKS = 256
"""Greatest number of looks at a tracklet that are remembered."""
HALF_WEIGHT_SWEEPS, SHARED_SD_SHARE = 2.0, 0.4
"""Number of sweeps of a look that counts half, and share of the standard deviation of a size that all looks have in
common."""
MIN_SIZE_SD = 0.003
"""[m] Least standard deviation of a size by the sweeps of one log."""
SIZES = 3
"""Number of sizes: sides along both axes, and the extent across the line of sight."""


SIZE_MEASUREMENT = np.dtype(
    [
        ("size", np.float64, (SIZES,)),
        ("sd", np.float64, (SIZES,)),
        ("yaw", np.float64),
        ("blur", np.float64),
        ("intensity", np.float64),
        ("edges", np.int64),
    ]
)
"""Of an object in one sweep: sides along both axes of the box and the extent across the line of sight [m], NaN where
not seen; their standard deviations [m]; direction of the first axis in the world [rad]; standard deviation of the
distance of two legs at that range [m]; median intensity, NaN without; first and last beam as one number."""

SizeMeasurements: TypeAlias = NDArray[np.void]
"""(K,) `SIZE_MEASUREMENT`."""


@dataclass(slots=True)
class _SizeEstimate:
    """Measured sizes of one tracklet."""

    kind: int
    yaw: float
    """Direction of the first axis at the first sighting [rad], for discs."""
    looks: dict[int, Float64] = field(default_factory=dict)
    """(3, SIZES) number of sightings, sum of weights [1/m²] and weighted sum of sizes, by the beams at the edges."""
    sightings: int = 0
    blur: float = 0.0
    """Mean of the measured blur."""
    lit: int = 0
    """Number of sightings with an intensity."""
    intensity: float = math.nan
    """Mean intensity."""
    known: Float64 | None = None
    """Final estimate, once the tracklet has ended."""

    def take(self, measured: SizeMeasurements, at: Int64, turned: Any) -> None:
        """Add sightings; `turned` is True where the first axis of a sighting is the second one of the tracklet."""
        size, sd = measured["size"][at], measured["sd"][at]
        for values in (size, sd):
            values[turned, :2] = values[turned, 1::-1]
        known = np.isfinite(size)
        weight = np.where(known, 1.0 / np.square(np.where(known, sd, 1.0)), 0.0)
        sums = np.stack([known.astype(float), weight, weight * np.where(known, size, 0.0)], axis=1)
        each, inverse = np.unique(measured["edges"][at], return_inverse=True)
        total = np.zeros((len(each), 3, SIZES))
        np.add.at(total, inverse, sums)
        for edges, more in zip(each.tolist(), total, strict=True):
            if edges in self.looks:
                self.looks[edges] += more
            elif len(self.looks) < MAX_LOOKS and more[0].any():
                self.looks[edges] = more
        self.sightings += len(at)
        self.blur += float((measured["blur"][at] - self.blur).sum()) / self.sightings
        lit = measured["intensity"][at]
        lit = lit[~np.isnan(lit)]
        if len(lit):
            before = self.intensity if self.lit else 0.0
            self.lit += len(lit)
            self.intensity = before + float((lit - before).sum()) / self.lit

    def estimate(self) -> Float64:
        """Return (SIZES, 2) each size and its standard deviation [m]; NaN where it was not seen."""
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
        """Keep the estimate only."""
        self.known = self.estimate()
        self.looks.clear()


def _mean(count: Float64, weight: Float64, size: Float64) -> tuple[float, float]:
    """Return the mean size and its standard deviation [m], by the sightings, weights per sighting and sizes of looks."""
    order = np.argsort(size, kind="stable")
    half = np.searchsorted(np.cumsum(count[order]), 0.5 * count.sum())
    off = size - size[order[half]]
    share = weight * count / (count + HALF_WEIGHT_SWEEPS) / (1.0 + np.square(off) / (SIZE_OUTLIER + 1.0 / weight))
    total = share.sum()
    looks = total * total / np.square(share).sum()
    variance = (
        total / float((share * weight).sum()) * (1.0 / looks + SHARED_SD_SHARE * SHARED_SD_SHARE * (1.0 - 1.0 / looks))
    )
    return float((share * size).sum() / total), float(np.hypot(math.sqrt(variance), MIN_SIZE_SD))


class Naming:
    """Naming of the tracks of one topic, window by window."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._sizes: dict[int, _SizeEstimate] = {}
        """Sizes by number of the tracklet."""

    def measure(self, batch: SweepBatch, detection: Detection, poses: Float64) -> SizeMeasurements:
        """Measure the K objects of a batch; `poses`: (K, 4) x, y, yaw and side of the sensor at each of them."""
        evidence = evidence_of(batch, detection)
        found = np.empty(len(detection), SIZE_MEASUREMENT)
        found["size"] = np.column_stack([evidence.side_1, evidence.side_2, evidence.across])
        found["sd"] = np.column_stack([evidence.side_1_sd, evidence.side_2_sd, evidence.across_sd])
        found["yaw"] = poses[:, 2] + poses[:, 3] * detection.box_yaw
        found["blur"], found["intensity"] = evidence.span_sd, evidence.intensity
        found["edges"] = (detection.beam_i.astype(np.int64) << 32) + detection.beam_f
        return found

    def take(self, pieces: list[SizeMeasurements], number: Int64, axes: Float64, known: dict[int, Tracklet]) -> None:
        """Add the measurements of a window.

        Parameters
        ----------
        pieces : measurements of K objects
        number : (K,) number of the tracklet of each object, 0 without one that was seen often enough
        axes : (K,) direction of the first axis of the tracklet at the time [rad]; NaN for a disc
        known : tracklets that were seen often enough, by number
        """
        if not pieces:
            return
        measured = np.concatenate(pieces)
        order = np.argsort(number, kind="stable")
        tracklets, begins = np.unique(number[order], return_index=True)
        for tracklet, at in zip(tracklets.tolist(), np.split(order, begins[1:]), strict=True):
            if tracklet == 0:
                continue
            is_box = known[tracklet].kind == BOX
            # Before it became a box it had other axes.
            rows = at[np.isfinite(axes[at]) == is_box]
            if not len(rows):
                continue
            sizes = self._sizes.get(tracklet)
            if sizes is None or sizes.kind != known[tracklet].kind:
                sizes = self._sizes[tracklet] = _SizeEstimate(known[tracklet].kind, float(measured["yaw"][rows[0]]))
            off = measured["yaw"][rows] - (axes[rows] if is_box else sizes.yaw)
            sizes.take(measured, rows, np.abs(np.sin(off)) > np.abs(np.cos(off)))

    def name(self, tracks: list[Track]) -> None:
        """Name tracks by all that was seen of them so far."""
        if not tracks:
            return
        rows = [self._of(track) for track in tracks]
        columns: dict[str, Any] = {key: np.array([row[key] for row in rows], float) for key in rows[0]}
        columns["legs"] = columns["legs"].astype(np.int32)
        columns["moved"] = columns["moved"].astype(np.bool_)
        shape = np.array([shape_odds(each, main_part(each)) for each in tracks])
        label, score = label_tracks(Evidence(shape=shape, **columns), self._catalogue)
        for track, one, sure in zip(tracks, label.tolist(), score.tolist(), strict=True):
            track.label, track.label_score = one, sure

    def forget(self, numbers: list[int]) -> None:
        """Keep only the estimates of these tracklets, which have ended."""
        for number in numbers:
            if number in self._sizes:
                self._sizes[number].close()

    def _of(self, track: Track) -> dict[str, float]:
        """Return the evidence of a track, without its shape."""
        tracklet = main_part(track)
        sizes = self._sizes.get(tracklet.number)
        frame = frame_of_legs(track)
        row = dict.fromkeys(_MEASURED, np.nan)
        row |= {"legs": 0.0, "moved": float(track.moved), "least_sd": MIN_SIZE_SD, "span_sd": MIN_SIZE_SD}
        row["intensity"] = math.nan if sizes is None else sizes.intensity
        if frame is not None:
            # The sizes of one leg tell nothing about the whole.
            row |= {"legs": float(frame["legs"]), "span_1": frame["length"]}
            row["span_2"] = frame["width"] if frame["legs"] > 2 else np.nan
            row["span_sd"] = MIN_SIZE_SD if sizes is None else sizes.blur
        elif any(part.has_legs for part in track.parts) or track.several:
            row["legs"] = 2.0
        elif sizes is not None:
            estimate = sizes.estimate()
            for one, what in enumerate(("side_1", "side_2", "across")):
                row[what], row[what + "_sd"] = estimate[one]
            row["least_1"], row["least_2"] = tracklet.least
        return row


_MEASURED = (
    *("side_1", "side_1_sd", "side_2", "side_2_sd", "least_1", "least_2", "least_sd", "across", "across_sd"),
    *("span_1", "span_2", "span_sd"),
)
"""Fields of `Evidence` that are NaN where nothing was seen."""
