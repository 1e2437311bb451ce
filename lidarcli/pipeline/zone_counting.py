"""Counts of each sweep in each zone, batch by batch; and the places of sensors in the frames of zones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.errors import NoScanError
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones import Inside, Sight, candidates, collision_steps, meeting, samples, sight, times
from lidarcli.logs.base import Log
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.inputs.sources import read_pose_messages
from lidarcli.pose.frames import WORLDS, FrameTree, Step, along, namespace
from lidarcli.pose.messages import frame_name
from lidarcli.pose.tracks import HOLD_STEPS, Track, planar
from lidarcli.sweeps.masks import Circle, Mask, Masks, Mount, Polygon, mounted, same_name
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int32, Int64, Status, SweepBatch, SweepPoses, UInt8, record
from lidarcli.sweeps.zone import ROBOT, SENSOR, WORLD, Line, Zone, Zones, placed
from lidarcli.tabular.columns import held, numbers

LONG_HELD = 1.0
"""A link that moves and is held for longer beyond its transforms has a note [s]."""
COUNTED = {"things": ("O", "A"), "agents": ("A",)}
"""Kind of beams that count in a zone → their sets."""


@dataclass(slots=True)
class Frames:
    """Places of sensors in the frames of zones."""

    mounts: Sequence[Mount]
    """Mounts that files tell; they count before the transforms of the log."""
    robot: str
    """Name of the frame of the robot; empty: the one at the end of the mounts, or by the transforms of the log."""
    _log: Log
    _topic: str = ""
    """Topic of the sensors; empty: any."""
    _links: list[list[Track]] = field(default_factory=list)
    """One list of all transforms, once they have been read."""
    _trees: dict[str, FrameTree] = field(default_factory=dict)
    _found: dict[tuple[str, str, str], Mount] = field(default_factory=dict)
    _held: dict[str, float] = field(default_factory=dict)
    """Link that moves → longest time for which it is held [s]."""
    _used: set[str] = field(default_factory=set)
    """Frames whose places count."""

    @classmethod
    def of(cls, log: Log, zones: Zones, mounts: Sequence[Mount] = ()) -> Frames:
        """Return the frames for the zones of a file; `mounts`: more of them."""
        return cls((*zones.masks.mounts, *mounts), zones.robot, log)

    def of_topic(self, topic: str) -> Frames:
        """Return the frames as the sensors of a topic see them: robots may have the same names for theirs."""
        return replace(self, _topic=topic)

    @property
    def tree(self) -> FrameTree:
        """The transforms of the log for the topic of the sensors."""
        topics = self._log.topics()
        if not self._links:
            tracks = read_pose_messages(self._log).tracks if self._log.size is not None and topics is not None else ()
            self._links.append([track for track in tracks if track.is_link])
        if self._topic not in self._trees:
            scans = [topic.name for topic in topics or () if topic.is_scan]
            self._trees[self._topic] = FrameTree(self._links[0], self._topic, scans)
        return self._trees[self._topic]

    def sensor_in(self, frame: str, sensor: str, stamp_ns: Int64) -> SweepPoses:
        """Return where a sensor is in a frame other than the world at each time (S,).

        Raises
        ------
        NoScanError
            Nothing leads from the sensor to the frame.
        """
        if frame == SENSOR:
            return _resting(Mount(sensor, sensor, 0.0, 0.0, 0.0), len(stamp_ns))
        target = self.robot_of(sensor) if frame == ROBOT else frame
        mount = mounted(self.mounts, sensor, target)
        # Sweeps may tell that they are elsewhere in the frame that they name.
        if mount is not None and not same_name(sensor, target):
            return _resting(mount, len(stamp_ns))
        steps = self.tree.path(self.tree.sensor(frame_name(sensor)), frame_name(target))
        if steps is None:
            raise self._lost(sensor, target)
        # A mount stays where it is, also before the first transform of it and after the last one; the robot does not.
        return self._along(steps, stamp_ns, held=frame_name(target).rpartition("/")[2] not in WORLDS)

    def _along(self, steps: Sequence[Step], stamp_ns: Int64, *, held: bool) -> SweepPoses:
        """Return the places at times (S,); note links that are `held` though they moved."""
        self._used.update(step.track.child for step in steps)
        for track in (step.track for step in steps if held and step.track.moves):
            first, last = track.span_ns
            beyond = max(first - int(stamp_ns.min()), int(stamp_ns.max()) - last) / SECOND_NS
            if beyond > max(LONG_HELD, HOLD_STEPS / (track.rate or LONG_HELD)):
                link = f"{track.parent} > {track.child}"
                self._held[link] = max(beyond, self._held.get(link, 0.0))
        return planar(along(steps, stamp_ns, held=held))

    def notes(self) -> list[str]:
        """Return a note on each link that was held for long, though it moved, and on those that contradict each other."""
        from lidarcli.pose.findings import contradictions, upright_words

        links = self._links[0] if self._links else []
        noted = [each.message for each in contradictions(links) if each.frame in self._used]
        noted += filter(None, [upright_words(self._used)])
        return noted + [
            f"sweeps are up to {seconds:.1f} s beyond the transforms of {link}, which moved: it is held there"
            for link, seconds in self._held.items()
        ]

    def robot_of(self, sensor: str) -> str:
        """Return the name of the frame of the robot that carries a sensor; errors as of `sensor_in`."""
        if self.robot:
            return self.robot
        here, left = sensor, len(self.mounts)
        while left and (parent := next((one.parent for one in self.mounts if same_name(one.frame, here)), "")):
            here, left = parent, left - 1
        if here != sensor or any(same_name(one.parent, sensor) for one in self.mounts):
            return here
        steps = self.tree.to_base(self.tree.sensor(frame_name(sensor)))
        if steps:
            return steps[-1].target
        if frame_name(sensor).rpartition("/")[2].startswith("base"):
            return sensor
        raise self._lost(sensor, "")

    def carrier_of(self, frame: str, sensor: str) -> tuple[str, str]:
        """Return the name of the frame of a zone, and the namespace that tells it: robots may have the same names."""
        target = self.robot_of(sensor) if frame == ROBOT else frame
        if frame in (SENSOR, WORLD) or mounted(self.mounts, sensor, target) is not None:
            return target, ""
        steps = self.tree.path(self.tree.sensor(frame_name(sensor)), frame_name(target))
        return frame_name(target), namespace(steps[-1].track.topic) if steps else ""

    def corners_in(self, sensor: str, frame: str, stamp_ns: int, corners: Float64) -> Float64 | None:
        """Return points (C, 2) of another frame in that of the robot at a time; None where nothing leads there."""
        robot = self.robot_of(sensor)
        if same_name(frame, robot):
            return corners
        steps = self.tree.path(frame_name(frame), frame_name(robot))
        if steps is None:
            return None
        pose = self._along(steps, np.array([stamp_ns]), held=True)
        row = np.zeros(len(corners), np.int64)
        x, y, _ = pose.to_world(row, corners[:, 0], corners[:, 1], np.zeros(len(corners)))
        found: Float64 = np.column_stack([x, y])
        return found if np.isfinite(found).all() else None

    def mounts_in(self, names: Collection[str]) -> Iterator[Mount]:
        """Yield where the frames of the log and of its mounts are in some others, where that is known before any sweep."""
        if not names:
            return
        known = dict.fromkeys([*(one.frame for one in self.mounts), *self.tree.frames])
        for name in sorted(names):
            for frame in known:
                if not same_name(frame, name):
                    with suppress(NoScanError):
                        yield self._mount(name, frame, np.zeros(1, np.int64))

    def masks_for(self, masks: Masks, batch: SweepBatch) -> Masks:
        """Return masks with a mount for each frame that they name, as it is at the first sweep of a batch."""
        placed: list[Mask] = []
        mounts: list[Mount] = [*self.mounts, *masks.mounts]
        for mask in masks.masks:
            if mask.topic and not same_name(mask.topic, batch.topic):
                continue
            placed.append(mask)
            for sensor in batch.frame_ids if mask.frame else ():
                if mounted(mounts, sensor, mask.frame) is None:
                    mounts.append(self._mount(mask.frame, sensor, batch.stamp_ns[:1]))
        return Masks(tuple(placed), tuple(mounts), masks.path)

    def _mount(self, frame: str, sensor: str, stamp_ns: Int64) -> Mount:
        key = self._topic, frame, sensor
        if key not in self._found:
            here = self.sensor_in(frame, sensor, stamp_ns)
            x, y, yaw = (float(each[0]) for each in (here.x, here.y, here.yaw))
            self._found[key] = Mount(sensor, frame, x, y, yaw, bool(here.upside_down[0]))
        return self._found[key]

    def _lost(self, sensor: str, target: str) -> NoScanError:
        name = sensor or "without a name"
        return NoScanError(
            f"nothing leads from frame {name} to {target or 'the robot'}; add to the zone file (Nav2: to one for --mask), "
            f'a line each: [[mount]] frame = "{sensor}" parent = "{target or "base_link"}" x = 0.0 y = 0.0 yaw = 0.0'
        )


def _resting(mount: Mount, count: int) -> SweepPoses:
    """Return one place for so many sweeps."""
    x, y, yaw = (np.full(count, value) for value in (mount.x, mount.y, mount.yaw))
    return SweepPoses(x, y, yaw, np.full(count, mount.upside_down))


@record
class ShownZone:
    """A zone in S sweeps."""

    zone: Zone
    corners: Float64
    """(S, K, 2) its outline in the frame of the sensor [m]; NaN where nothing tells where that is."""
    beams: Bool
    """(S, B) beams that count in it."""

    @property
    def occupied(self) -> Bool:
        """(S,) True where as many beams count as it takes."""
        found: Bool = np.count_nonzero(self.beams, axis=1) >= self.zone.min_points
        return found


class Showing:
    """Places zones before the sensors of a log; what cannot be shown is a note."""

    def __init__(self, zones: Zones, frames: Frames) -> None:
        self._zones = zones
        self._frames = frames
        self._notes: dict[str, None] = {}

    @property
    def is_in_world(self) -> bool:
        """True if a zone needs poses."""
        return any(zone.frame == WORLD for zone in self._zones.zones)

    def of(self, batch: SweepBatch, sets: UInt8 | None) -> Iterator[ShownZone]:
        """Yield the zones that can be placed in sweeps of one frame.

        Parameters
        ----------
        sets : (S, B) index into `SETS` of each beam; None where nobody knows
        """
        sensor = batch.frame_ids[int(batch.frame[0])]
        frames = self._frames.of_topic(batch.topic)
        masks = frames.masks_for(self._zones.masks, batch)
        ranges = batch.ranges
        if masks.masks:
            ranges = np.where(masks.under(batch, ranges), np.float32(np.nan), ranges)
        for zone in self._zones.zones:
            shape = zone.shape
            place = self._place(zone, batch, sensor, frames)
            if shape is None or place is None:
                continue
            beams = np.zeros(ranges.shape, np.bool_)
            if self._counts(zone, batch.topic, sets) and not isinstance(shape, Line):
                found = candidates(batch, ranges, place, shape)
                beams[found.row, found.beam] = True
                if zone.count in COUNTED and sets is not None:
                    beams &= np.isin(sets, [SETS.index(name) for name in COUNTED[zone.count]])
            yield ShownZone(zone, placed(shape, place), beams)

    def notes(self) -> list[str]:
        """Return a line for each zone that is not shown, or not as occupied."""
        return [*self._zones.notes, *self._notes, *self._frames.notes()]

    def _place(self, zone: Zone, batch: SweepBatch, sensor: str, frames: Frames) -> SweepPoses | None:
        if zone.shape is None:
            why = f"{zone.shape_topic} tells its shape" if zone.shape_topic else "its shape depends on the velocity"
        elif zone.frame != WORLD:
            try:
                return frames.sensor_in(zone.frame, sensor, batch.stamp_ns)
            except NoScanError as err:
                why = str(err)
        elif batch.poses is not None:
            return batch.poses
        else:
            why = "nothing tells where the sensor is in the world"
        self._notes[f"zone {zone.name} is not drawn: {why}"] = None
        return None

    def _counts(self, zone: Zone, topic: str, sets: UInt8 | None) -> bool:
        """Tell whether it is known which beams of a topic count in a zone."""
        if not zone.is_for(topic):
            return False
        if zone.count in COUNTED and sets is None:
            self._notes[f"zone {zone.name} counts {zone.count}, and nobody knows which beams are on them"] = None
            return False
        return True


NO_OBJECT = -1
"""In place of an object: a point on walls and the rest."""
OBJECT_COLUMNS = ("topic", "sweep", "object", "beam_i", "beam_f", "set", "track", "vx", "vy")
"""Columns of the objects table that tell whose beams are in a zone."""
OLDEST_NS = 2_000_000_000
"""Age from which on a velocity may be that of another time [ns]."""
VELOCITY_SPAN_NS = 200_000_000
"""Least time over which poses tell a velocity [ns]."""


class Objects(NamedTuple):
    """Objects of the sweeps of a batch, from the objects table."""

    row: Int64
    """(N,) sweep of the batch."""
    object: Int64
    beam_i: Int64
    beam_f: Int64
    set: UInt8
    """(N,) index into `SETS`."""
    track: Int64
    """(N,) its track, -1 for none."""
    velocity: Float64
    """(N, 2) [m/s] in the world or else the sensor frame; NaN where it is not known."""

    @staticmethod
    def of(rows: pa.RecordBatch, batch: SweepBatch) -> Objects:
        """Return the objects of a batch among rows of the table; walls are none."""
        sweep, first, beam_i, beam_f = (
            held(rows[name])[0].astype(np.int64) for name in ("sweep", "object", "beam_i", "beam_f")
        )
        row = np.searchsorted(batch.sweep, sweep)
        names = rows["set"]
        letters = np.array([SETS.index(str(name)) for name in names.dictionary.to_pylist()] or [0], np.uint8)
        its = letters[held(names.indices)[0]] if len(names) else np.zeros(0, np.uint8)
        mine = its != SETS.index("S")
        track, there = held(rows["track"])
        velocity = np.column_stack([numbers(rows["vx"]), numbers(rows["vy"])])
        track = np.where(there, track, -1)
        return Objects(row[mine], first[mine], beam_i[mine], beam_f[mine], its[mine], track[mine], velocity[mine])

    def of_rows(self, rows: Int64) -> Objects:
        """Return the objects of some sweeps of the batch, which are numbered anew."""
        at = np.searchsorted(rows, self.row)
        mine = rows[np.minimum(at, len(rows) - 1)] == self.row
        return Objects(at[mine], *(values[mine] for values in self[1:]))

    def owners(self, batch: SweepBatch) -> Int32:
        """Return the object (S, B) of every beam, by index here; `NO_OBJECT` where there is none."""
        owner = np.full(batch.ranges.shape, NO_OBJECT, np.int32)
        # Beams between the first and the last of an object are on it, or have no range.
        count = (self.beam_f - self.beam_i) % np.maximum(batch.beams[self.row], 1) + 1
        which = np.repeat(np.arange(len(self.row)), count)
        after = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        beam = (self.beam_i[which] + after) % np.maximum(batch.beams[self.row[which]], 1)
        owner[self.row[which], beam] = which
        return owner


class Shapes(NamedTuple):
    """The shapes of a zone: one, those of its cases, or those that a topic tells one after the other."""

    shapes: list[Circle | Polygon]
    times: Int64 = np.zeros(0, np.int64)
    which: Int64 = np.zeros(0, np.int64)
    """(M,) from which time on which of them it is, where a topic tells it."""

    def at(self, stamp_ns: Int64) -> Int64 | None:
        """Return which shape it is at times (S,), before the first message the first; None where no topic tells it."""
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


class Columns:
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


class ZoneSeries(Columns):
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
        # A line has one part for what is seen of it.
        line = [zone.shape] if isinstance(zone.shape, Line) else []
        self.places = [samples(shape) for shape in [*shapes.shapes, *line]]
        """(P, 2) of each shape, at which is asked whether they are seen."""
        self.hits: list[Hits] = []

    def ordered_hits(self) -> Hits:
        """Return the hits of all sweeps, by sweep; each part of a batch has added its own."""
        joined = Hits._make(map(np.concatenate, zip(NO_HITS, *self.hits, strict=True)))
        order = np.argsort(joined.sweep, kind="stable")
        return Hits._make(values[order] for values in joined)


class TopicSeries(Columns):
    """The sweeps of one sensor in a run of the log, and what they have in each zone.

    Columns (S,) are `sweep`, `stamp_ns` and `seconds`; `pose` (S, 4) is that of the sensor in the world, as
    `ZoneSeries.placed`, NaN where it is not known.
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


class Velocities(NamedTuple):
    """Velocities that a log tells."""

    stamp_ns: Int64
    velocity: Float64
    recorded: bool
    """True where the stamps are those of the recording."""

    def at(self, batch: SweepBatch) -> tuple[Float64, int]:
        """Return the newest velocity (S, 3) before each sweep, NaN before the first; and how many are too old."""
        times = batch.record_ns if self.recorded else batch.stamp_ns
        index = np.searchsorted(self.stamp_ns, times, side="right") - 1
        newest: Float64 = np.where(index[:, None] < 0, np.nan, self.velocity[np.maximum(index, 0)])
        old = (index >= 0) & (times - self.stamp_ns[np.maximum(index, 0)] > OLDEST_NS)
        return newest, int(np.count_nonzero(old))


class TopicCounter:
    """Folds the batches of one topic into a `TopicSeries`."""

    def __init__(self, series: TopicSeries, frames: Frames, masks: Masks, velocities: dict[str, Velocities | None]) -> None:
        """`velocities`: by topic; None where the log has no such topic."""
        self.series = series
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
        # Where nothing tells where the sensor is on the robot, it is the robot.
        carried = self._frames.sensor_in(SENSOR, sensor, batch.stamp_ns)
        if posed is not None or any(self._velocities.values()):
            with suppress(NoScanError):
                carried = self._frames.sensor_in(ROBOT, sensor, batch.stamp_ns)
        velocities = self._velocity(batch, carried)
        pose = np.full((len(batch), 4), np.nan) if posed is None else _four(posed.at_stamp())
        series.append(sweep=batch.sweep, stamp_ns=batch.stamp_ns, seconds=batch.seconds(), pose=pose)
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
                mine = now == number
                if not mine.any():
                    continue
                # A sweep without a place has no points.
                there = replace(whole.place, x=np.where(mine, whole.place.x, np.nan))
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

    def _velocity(self, batch: SweepBatch, carried: SweepPoses) -> dict[str, Float64]:
        """Return the velocity of the robot (S, 3) as each topic tells it; of one that does not, by the poses."""
        topics = {each.zone.velocity_topic for each in self.series.zones}
        found: dict[str, Float64] = {}
        for topic in topics:
            if (known := self._velocities.get(topic)) is not None:
                found[topic], old = known.at(batch)
                self.old[topic] += old
        if len(found) < len(topics):
            found = dict.fromkeys(topics, self._by_poses(batch, carried)) | found
        return found

    def _by_poses(self, batch: SweepBatch, carried: SweepPoses) -> Float64:
        """Return the velocity of the robot (S, 3) by the poses before each sweep."""
        velocities = np.full((len(batch), 3), np.nan)
        if batch.poses is None:
            return velocities
        known = np.flatnonzero(np.isfinite(batch.poses.x))
        robot = _carrier(batch.poses.at_stamp(), carried)
        here = np.column_stack([robot.x, robot.y, robot.yaw])[known]
        stamps = np.maximum.accumulate(np.concatenate([self._stamps, batch.stamp_ns[known]]))
        poses = np.concatenate([self._robots, here])
        now = np.arange(len(poses) - len(known), len(poses))
        then = np.maximum(np.searchsorted(stamps, stamps[now] - VELOCITY_SPAN_NS, side="right") - 1, 0)
        seconds = (stamps[now] - stamps[then]) * 1e-9
        turn = (poses[now, 2] - poses[then, 2] + np.pi) % TURN - np.pi
        # The direction half-way: the way of a turn is a chord.
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

    def sight(self, zone: Zone, places: Float64) -> Sight:
        """Return what is seen of a zone by these places of it; of one that approaches, on its way."""
        batch = self.batch
        if zone.action == "approach":
            usable = np.isfinite(self.ranges) | (batch.status == Status.NO_RETURN)
            judged = np.isfinite(self.velocity).all(axis=1) & np.isfinite(self.place.x)
            beams = np.where(judged, np.count_nonzero(usable, axis=1), 0).astype(np.int32)
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
            agents = self.objects.set == SETS.index("A")
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
        """Return the velocity over ground of the agents that points are on (K, 2), in the axes of the robot [m/s]."""
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


def _carrier(sensor: SweepPoses, carried: SweepPoses) -> SweepPoses:
    """Return the poses of what carries a sensor, from those of the sensor and its places on what carries it."""
    turned_over = sensor.upside_down != carried.upside_down
    side = np.where(turned_over, -1.0, 1.0)
    yaw = sensor.yaw - side * carried.yaw
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = sensor.x - cos * carried.x + side * sin * carried.y
    y = sensor.y - sin * carried.x - side * cos * carried.y
    return SweepPoses(x, y, yaw, turned_over)


def velocity_of(velocity: Float64, place: SweepPoses, carried: SweepPoses) -> Float64:
    """Return the velocity (S, 3) of a frame in its own axes, from that of the robot that carries it.

    Parameters
    ----------
    place, carried : where the sensor is in the frame, and on the robot
    """
    frame = _carrier(carried, place)
    turning = velocity[:, 2]
    dx, dy = velocity[:, 0] - turning * frame.y, velocity[:, 1] + turning * frame.x
    cos, sin = np.cos(frame.yaw), np.sin(frame.yaw)
    # In a frame that hangs head down left is right.
    side = np.where(frame.upside_down, -1.0, 1.0)
    return np.column_stack([cos * dx + sin * dy, side * (cos * dy - sin * dx), side * turning])


def _four(poses: SweepPoses) -> Float64:
    """Return (S, 4): x, y, yaw, and 1 where the sensor hangs head down."""
    return np.column_stack([poses.x, poses.y, poses.yaw, poses.upside_down])
