"""Counts of each sweep in each zone, batch by batch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import NoScanError
from lidarcli.formalism.detection import AGENT, SETS
from lidarcli.formalism.zones import (
    AHEAD,
    HALF_WIDTH,
    Inside,
    ZoneSight,
    candidates,
    collision_steps,
    meeting,
    on_the_way,
    samples,
    sight,
    times,
)
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.inputs.tracked import Objects
from lidarcli.pipeline.zones.frames import VELOCITY_SPAN_NS, Frames, Velocities, carrier_pose, velocity_of
from lidarcli.sweeps.masks import Circle, Masks, Polygon
from lidarcli.sweeps.types import TURN, Float32, Float64, Int32, Int64, Status, SweepBatch, SweepPoses, UInt8
from lidarcli.sweeps.zone import ROBOT, SENSOR, WORLD, Line, Zone

THAT_WAY = 0.35
"""Beams this near to the direction of a drive tell whether anything could be seen ahead [rad]."""
DRIVES = 0.05, 0.2
"""Least speed [m/s] that tells in which direction a robot drives, and turning rate [rad/s] with which it turns."""


class Shapes(NamedTuple):
    """The shapes of a zone: one, those of its cases, or those that a topic publishes one after the other."""

    shapes: list[Circle | Polygon]
    times: Int64 = np.zeros(0, np.int64)
    which: Int64 = np.zeros(0, np.int64)
    """(M,) from which time on which of them it is, where a topic publishes it."""

    def at(self, stamp_ns: Int64) -> Int64 | None:
        """Return which shape it is at times (S,), before the first message the first; None where no topic publishes it."""
        if not len(self.times):
            return None
        at = np.searchsorted(self.times, stamp_ns, side="right") - 1
        return self.which[np.maximum(at, 0)]


class Hits(NamedTuple):
    """Numbers of points of objects in a part of a zone: one entry for each object of a sweep."""

    sweep: Int64
    """(H,) number of the sweep in the series."""
    part: Int64
    set: UInt8
    track: Int64
    object: Int64
    points: Int64


_NONE = np.zeros(0, np.int64)
NO_HITS = Hits(_NONE, _NONE, np.zeros(0, np.uint8), _NONE, _NONE, _NONE)


class GrowingColumns:
    """Arrays by name that grow by a piece with each batch."""

    def __init__(self) -> None:
        self._pieces: dict[str, list[NDArray[Any]]] = {}

    def append(self, **pieces: NDArray[Any]) -> None:
        """Add the rows of a batch."""
        for name, piece in pieces.items():
            self._pieces.setdefault(name, []).append(piece)

    def column(self, name: str) -> NDArray[Any]:
        """Return one of the quantities of all sweeps."""
        pieces = self._pieces[name]
        if len(pieces) != 1:
            pieces[:] = [np.concatenate(pieces)]
        return pieces[0]


class ZoneSeries(GrowingColumns):
    """Counts of the sweeps of one topic in a zone, by part: its shape of the time, or each of its cases.

    Columns (S, parts) are `points`, `nearest`, `bearing`, `x`, `y`, `masked`, `reach` (beams that could have ended in it; 0
    in sweeps that show nothing), `seen` and `lost` of `formalism.zones.Sight`, and `ttc`. `placed` (S, 4) is the place of
    the sensor in the frame of the zone: x, y [m], yaw [rad], 1 where it hangs head down; `velocity` (S, 3) that of the
    robot: ahead, left [m/s], turning [rad/s], NaN where it is not known.
    """

    def __init__(self, zone: Zone, shapes: Shapes) -> None:
        super().__init__()
        self.zone = zone
        self.shapes = shapes
        # A line has one part for what is visible of it.
        line = [zone.shape] if isinstance(zone.shape, Line) else []
        self.places = [samples(shape) for shape in [*shapes.shapes, *line]]
        """(P, 2) of each shape, which are tested for being visible."""
        self.hits: list[Hits] = []

    def ordered_hits(self) -> Hits:
        """Return the hits of all sweeps, by sweep; each part of a batch has added its own."""
        joined = Hits._make(map(np.concatenate, zip(NO_HITS, *self.hits, strict=True)))
        order = np.argsort(joined.sweep, kind="stable")
        return Hits._make(values[order] for values in joined)


class TopicSeries(GrowingColumns):
    """The sweeps of one sensor in a run of the log, and what they have in each zone.

    Columns (S,) are `sweep`, `stamp_ns` and `seconds`; `pose` (S, 4) is that of the sensor in the world, as
    `ZoneSeries.placed`, NaN where it is not known. Where stops are told, `ahead` (S, 5) has of the nearest point on the way
    that the robot was driving last how far along it is, its range [m], its bearing [rad] and its place in the frame of the
    robot [m]; `ahead_owner` (S, 5) set and track of what it is on, -1 for none, the points on the way, and of
    the beams that way those with a range, and all.
    """

    def __init__(self, topic: str, frame_id: str, run: int, zones: Sequence[ZoneSeries], first_ns: int) -> None:
        super().__init__()
        self.topic, self.frame_id, self.run, self.zones = topic, frame_id, run, zones
        self.first_ns = first_ns
        """Stamp of the first sweep of the topic in the log."""
        self.count = 0

    @property
    def sensor(self) -> tuple[str, str, int]:
        """Topic and frame of its sensor, and the run."""
        return self.topic, self.frame_id, self.run

    def of_zone(self, name: str) -> ZoneSeries:
        """Return what it has in a zone."""
        return next(one for one in self.zones if one.zone.name == name)


def event_row(
    topic: TopicSeries, about: Mapping[str, str], ends: Sequence[int], span_ns: tuple[int, int], first_ns: int
) -> dict[str, Any]:
    """Return an event with what all kinds have; `about`: zone, kind and action; `ends`: its first and its last sweep."""
    return {
        "topic": topic.topic,
        "frame_id": topic.frame_id,
        "first_sweep": ends[0],
        "last_sweep": ends[1],
        "sweeps": 0,
        **about,
        "polygon": None,
        "start": span_ns[0],
        "end": span_ns[1],
        "t": (span_ns[0] - first_ns) / SECOND_NS,
        "duration": (span_ns[1] - span_ns[0]) / SECOND_NS,
        "cut": False,
        **dict.fromkeys(("nearest", "set", "track", "label")),
    }


class TopicCounter:
    """Folds the batches of one topic into a `TopicSeries`."""

    def __init__(
        self,
        series: TopicSeries,
        frames: Frames,
        masks: Masks,
        velocities: dict[str, Velocities | None],
        half_width: float | None = None,
    ) -> None:
        """Begin to count; `velocities`: by topic, None where the log has no such topic.

        `half_width`: half of the width of the robot [m], where its stops are to be told.
        """
        self.series = series
        self._half_width = half_width
        self._course = np.full((1, 3), np.nan)
        """The last velocity with which the robot drove."""
        self._frames = frames
        self._masks = masks
        self._velocities = velocities
        self.old: Counter[str] = Counter()
        """Topic → sweeps in which its last velocity was too old."""
        self._stamps, self._robots = np.zeros(0, np.int64), np.zeros((0, 3))
        """Stamps and poses of the robot in the last sweeps."""

    def add(self, batch: SweepBatch, objects: Objects | None) -> None:
        """Take sweeps of one frame."""
        series = self.series
        sensor = batch.frame_ids[int(batch.frame[0])] if len(batch) else ""
        masks = self._frames.masks_for(self._masks, batch)
        under = masks.under(batch, batch.ranges) if masks.masks else None
        ranges = batch.ranges if under is None else np.where(under, np.float32(np.nan), batch.ranges)
        owners = None if objects is None else objects.owners(batch)
        hidden = None if under is None else np.where(under, batch.ranges, np.float32(np.nan))
        posed = batch.poses
        places: dict[str, SweepPoses] = {}
        for each in series.zones:
            name = each.zone.frame
            if name not in places:
                if name == WORLD:
                    assert posed is not None
                    places[name] = posed
                else:
                    places[name] = self._frames.sensor_in(name, sensor, batch.stamp_ns)
        # Where the place of the sensor on the robot is not known, it is the robot.
        carried = self._frames.sensor_in(SENSOR, sensor, batch.stamp_ns)
        if posed is not None or any(self._velocities.values()):
            with suppress(NoScanError):
                carried = self._frames.sensor_in(ROBOT, sensor, batch.stamp_ns)
        driven = self._by_poses(batch, carried)
        velocities = self._velocity(batch, driven)
        if self._half_width is not None:
            self._look_ahead(_PlacedSweeps(batch, ranges, masks, carried, objects, owners, driven, series.count))
        pose = np.full((len(batch), 4), np.nan) if posed is None else _four(posed.at_stamp())
        series.append(sweep=batch.sweep, stamp_ns=batch.stamp_ns, seconds=batch.seconds, pose=pose)
        for each in series.zones:
            place, velocity = places[each.zone.frame], velocities[each.zone.velocity_topic]
            each.append(placed=_four(place.at_stamp()), velocity=velocity)
            own = velocity if each.zone.frame == WORLD else velocity_of(velocity, place, carried)
            placed = _PlacedSweeps(batch, ranges, masks, place, objects, owners, own, series.count)
            self._count(each, placed, hidden)
        series.count += len(batch)

    def _count(self, into: ZoneSeries, sweeps: _PlacedSweeps, masked: Float32 | None) -> None:
        """Count what is in a zone."""
        now = into.shapes.at(sweeps.batch.stamp_ns)
        count, parts = len(sweeps.batch), len(into.places) if now is None else 1
        points, away = np.zeros((count, parts), np.int32), np.zeros((count, parts), np.int32)
        nearest, bearing = (np.full((count, parts), np.nan, np.float32) for _ in range(2))
        x, y, ttc = (np.full((count, parts), np.nan) for _ in range(3))
        whole = sweeps
        sights = [sweeps.sight(into.zone, each) for each in (into.places if now is None else [np.stack(into.places)[now]])]
        beams, seen, lost = (np.stack(values, axis=1) for values in zip(*sights, strict=True))
        for number, shape in enumerate(into.shapes.shapes):
            part, sweeps = number, whole
            if now is not None:
                own = now == number
                if not own.any():
                    continue
                # A sweep without a place has no points.
                there = replace(whole.place, x=np.where(own, whole.place.x, np.nan))
                part, sweeps = 0, whole._replace(place=there)
            found, its = sweeps.inside(into.zone, shape)
            if into.zone.action == "approach":
                found, times_to = sweeps.approach(into.zone, shape, found, its)
                ttc[:, part] = np.fmin(ttc[:, part], times_to)
            counts = np.bincount(found.row, minlength=count)
            rows = np.flatnonzero(counts)
            points[rows, part] = counts[rows]
            if len(rows):
                least = sweeps.least(found)
                at = found.row[least], found.beam[least]
                nearest[rows, part] = sweeps.ranges[at]
                bearing[rows, part] = sweeps.bearing(*at)
                x[rows, part], y[rows, part] = found.x[least], found.y[least]
            into.hits.append(sweeps.hits(found, part))
            if masked is not None:
                under = candidates(sweeps.batch, masked, sweeps.place, shape)
                away[:, part] += np.bincount(under.row, minlength=count).astype(np.int32)
        into.append(points=points, nearest=nearest, bearing=bearing, x=x, y=y, masked=away, ttc=ttc)
        into.append(reach=np.maximum(beams, points), seen=seen, lost=lost)

    def _look_ahead(self, sweeps: _PlacedSweeps) -> None:
        """Note what is nearest on the way that the robot was driving last; the sweeps are placed on the robot."""
        batch, ranges, objects, owners = sweeps.batch, sweeps.ranges, sweeps.objects, sweeps.owners
        known = np.concatenate([self._course, sweeps.velocity])
        with np.errstate(invalid="ignore"):
            drives = np.hypot(known[:, 0], known[:, 1]) > DRIVES[0]
            turns = np.abs(known[:, 2]) > DRIVES[1]
        last = np.maximum.accumulate(np.where(drives | turns, np.arange(len(known)), 0))
        # Nothing is ahead of a turn on the spot.
        known[~drives] = np.nan
        course, self._course = known[last[1:]], known[last[-1:]]
        points = candidates(batch, ranges, sweeps.place, Circle(0.0, 0.0, AHEAD))
        there, along = on_the_way(points, course, self._half_width or HALF_WIDTH)
        points, along = points.of(there), along[there]
        order = np.lexsort((along, points.row))
        rows, first, counts = np.unique(points.row[order], return_index=True, return_counts=True)
        at = order[first]
        beams = points.beam[at]
        ahead, owner = np.full((len(batch), 5), np.nan), np.full((len(batch), 5), -1, np.int64)
        place = along[at], ranges[rows, beams], sweeps.bearing(rows, beams), points.x[at], points.y[at]
        ahead[rows] = np.column_stack(place)
        owner[rows, 2] = counts
        side = np.where(sweeps.place.upside_down, -1.0, 1.0)[:, None]
        turned = sweeps.place.yaw[:, None] + side * batch.bearings - np.arctan2(course[:, 1], course[:, 0])[:, None]
        that_way = np.abs((turned + np.pi) % TURN - np.pi) < THAT_WAY
        that_way &= np.arange(batch.width) < batch.beams[:, None]
        owner[:, 3:] = np.stack([(that_way & np.isfinite(ranges)).sum(axis=1), that_way.sum(axis=1)], axis=1)
        if owners is not None and objects is not None:
            owner[rows, 0] = SETS.index("S")
            whose = owners[rows, beams]
            owned = whose >= 0
            owner[rows[owned], 0], owner[rows[owned], 1] = objects.set[whose[owned]], objects.track[whose[owned]]
        self.series.append(ahead=ahead, ahead_owner=owner)

    def _velocity(self, batch: SweepBatch, driven: Float64) -> dict[str, Float64]:
        """Return the velocity of the robot (S, 3) as each topic reports it; of one that does not, by the poses."""
        topics = {each.zone.velocity_topic for each in self.series.zones}
        found: dict[str, Float64] = {}
        for topic in topics:
            if (known := self._velocities.get(topic)) is not None:
                found[topic], old = known.at(batch)
                self.old[topic] += old
        if len(found) < len(topics):
            found = dict.fromkeys(topics, driven) | found
        return found

    def _by_poses(self, batch: SweepBatch, carried: SweepPoses) -> Float64:
        """Return the velocity of the robot (S, 3) by the poses before each sweep."""
        velocities = np.full((len(batch), 3), np.nan)
        if batch.poses is None:
            return velocities
        known = np.flatnonzero(np.isfinite(batch.poses.x))
        robot = carrier_pose(batch.poses.at_stamp(), carried)
        here = np.column_stack([robot.x, robot.y, robot.yaw])[known]
        stamps = np.maximum.accumulate(np.concatenate([self._stamps, batch.stamp_ns[known]]))
        poses = np.concatenate([self._robots, here])
        now = np.arange(len(poses) - len(known), len(poses))
        then = np.maximum(np.searchsorted(stamps, stamps[now] - VELOCITY_SPAN_NS, side="right") - 1, 0)
        seconds = (stamps[now] - stamps[then]) * 1e-9
        turn = (poses[now, 2] - poses[then, 2] + np.pi) % TURN - np.pi
        # The heading half-way: the path of a turn is taken for a chord.
        heading = poses[then, 2] + 0.5 * turn
        cos, sin = np.cos(heading), np.sin(heading)
        with np.errstate(divide="ignore", invalid="ignore"):
            dx, dy = (poses[now, :2] - poses[then, :2]).T / seconds
            # A path that is matched from the sweeps of a sensor that hangs head down is the mirror image.
            side = np.where(robot.upside_down[known], -1.0, 1.0)
            left = side * (cos * dy - sin * dx)
            velocity = np.column_stack([cos * dx + sin * dy, left, side * turn / seconds])
        velocities[known] = np.where(seconds[:, None] > 0.0, velocity, np.nan)
        kept = int(then[-1]) if len(known) else 0
        self._stamps, self._robots = stamps[kept:], poses[kept:]
        return velocities


class _PlacedSweeps(NamedTuple):
    """Sweeps of one frame, and where their sensor is in the frame of a zone."""

    batch: SweepBatch
    ranges: Float32
    """(S, B) without those under a mask."""
    masks: Masks
    place: SweepPoses
    objects: Objects | None
    owners: Int32 | None
    velocity: Float64
    begin: int
    """Number of the first of these sweeps in the series."""

    def bearing(self, row: NDArray[np.intp], beam: NDArray[np.intp]) -> Float64:
        """Return the bearings of beams [rad]."""
        bearing: Float64 = self.batch.angle_min[row] + self.batch.angle_increment[row] * beam
        return bearing

    def sight(self, zone: Zone, places: Float64) -> ZoneSight:
        """Return what is visible of a zone by these places of it; of one that approaches, along its path."""
        batch = self.batch
        if zone.action == "approach":
            usable = np.isfinite(self.ranges) | (batch.status == Status.NO_RETURN)
            evaluated = np.isfinite(self.velocity).all(axis=1) & np.isfinite(self.place.x)
            beams = np.where(evaluated, np.count_nonzero(usable, axis=1), 0).astype(np.int32)
            ahead = np.linspace(0.0, zone.time_before_collision, places.shape[-2])[:, None]
            found = sight(batch, self.place, places + self.velocity[:, None, :2] * ahead, self.masks)._replace(beams=beams)
        else:
            found = sight(batch, self.place, places, self.masks)
        shows = np.isfinite(self.ranges).any(axis=1)
        return found._replace(beams=np.where(batch.observed & shows, found.beams, 0))

    def inside(self, zone: Zone, shape: Circle | Polygon) -> tuple[Inside, Inside]:
        """Return the points that count and are inside of a shape; and, for `approach`, all that count wherever they are."""
        if zone.action != "approach":
            found = self._counted(zone, candidates(self.batch, self.ranges, self.place, shape))
            return found, found
        # The robot comes to them: all that it could reach.
        speed = np.hypot(self.velocity[:, 0], self.velocity[:, 1])
        fastest = float(np.nanmax(speed, initial=0.0))
        if zone.count == "agents" and self.objects is not None:
            fastest += float(np.nanmax(np.hypot(*self.objects.velocity.T), initial=0.0))
        reach = fastest * (zone.time_before_collision + zone.time_step)
        near = candidates(self.batch, self.ranges, self.place, _around(shape, reach))
        return self._counted(zone, candidates(self.batch, self.ranges, self.place, shape)), self._counted(zone, near)

    def _counted(self, zone: Zone, found: Inside) -> Inside:
        """Return the points on what counts in a zone."""
        if zone.count == "beams" or self.owners is None or self.objects is None:
            return found
        owner = self.owners[found.row, found.beam]
        counts = owner >= 0
        if zone.count == "agents":
            agents = self.objects.set == AGENT
            counts &= agents[np.maximum(owner, 0)] if len(agents) else False
        return found.of(counts)

    def approach(self, zone: Zone, shape: Circle | Polygon, now: Inside, near: Inside) -> tuple[Inside, Float64]:
        """Return the points that will be met first, or those inside now, and the time to collision (S,) [s]."""
        own = self._own_velocity(near) if zone.count == "agents" else None
        ahead = zone.time_before_collision, zone.time_step
        steps = collision_steps(shape, near, self.velocity, *ahead, own)
        enough = steps >= zone.min_points
        step = np.where(enough.any(axis=1), enough.argmax(axis=1), -1)
        ttc = np.where(step >= 0, times(*ahead)[np.maximum(step, 0)], np.nan)
        met = meeting(shape, near, self.velocity, step, zone.time_step, own)
        others = step[now.row] < 0
        return near.of(met).with_(now.of(others)), ttc

    def _own_velocity(self, found: Inside) -> Float64:
        """Return the velocity in the world of the agents that points are on (K, 2), in the axes of the robot [m/s]."""
        assert self.owners is not None
        assert self.objects is not None
        vx, vy = np.nan_to_num(self.objects.velocity[np.maximum(self.owners[found.row, found.beam], 0)]).T
        poses = np.full(len(self.batch), np.nan) if self.batch.poses is None else self.batch.poses.yaw
        in_world = np.isfinite(poses)
        turned = self.place.yaw - np.where(in_world, poses, 0.0)
        vy = np.where((self.place.upside_down & ~in_world)[found.row], -vy, vy)
        cos, sin = np.cos(turned[found.row]), np.sin(turned[found.row])
        return np.column_stack([cos * vx - sin * vy, sin * vx + cos * vy])

    def least(self, found: Inside) -> NDArray[np.intp]:
        """Return the nearest point of each sweep that has any, by index."""
        order = np.lexsort((found.beam, self.ranges[found.row, found.beam], found.row))
        rows = found.row[order]
        nearest: NDArray[np.intp] = order[np.diff(rows, prepend=-1) != 0]
        return nearest

    def hits(self, found: Inside, part: int) -> Hits:
        """Return the points of each object."""
        if self.owners is None or self.objects is None or not len(found.row):
            return NO_HITS
        owner = self.owners[found.row, found.beam]
        row, owner = found.row[owner >= 0], owner[owner >= 0]
        key, counts = np.unique(row * (len(self.objects.row) + 1) + owner, return_counts=True)
        row, owner = np.divmod(key, len(self.objects.row) + 1)
        objects = self.objects
        return Hits(
            row + self.begin,
            np.full(len(row), part),
            objects.set[owner],
            objects.track[owner],
            objects.object[owner],
            counts,
        )


def _around(shape: Circle | Polygon, reach: float) -> Circle:
    """Return a circle about the robot that holds a shape and all within reach of it."""
    if isinstance(shape, Circle):
        return Circle(0.0, 0.0, float(np.hypot(shape.x, shape.y)) + shape.radius + reach)
    return Circle(0.0, 0.0, float(np.hypot(*np.array(shape.corners).T).max()) + reach)


def _four(poses: SweepPoses) -> Float64:
    """Return (S, 4): x, y, yaw, and 1 where the sensor hangs head down."""
    return np.column_stack([poses.x, poses.y, poses.yaw, poses.upside_down])
