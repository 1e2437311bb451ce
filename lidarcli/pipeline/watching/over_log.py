"""One pass over a log that counts what is in its zones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from lidarcli.choices import MATCH
from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.masks import Circle, Masks, Polygon, same_name
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import Pair, world_in
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.pipeline.overlay_sources import AGAIN, Cursor
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary
from lidarcli.pipeline.reading.posing import TWIST, Need, polygons, velocities
from lidarcli.pipeline.watching.counting import (
    OBJECT_COLUMNS,
    OLDEST_NS,
    Counting,
    Objects,
    Shapes,
    Told,
    TopicSeries,
    ZoneSeries,
)
from lidarcli.pipeline.watching.events import Counted, Settled, Tracked, settle
from lidarcli.pipeline.watching.frames import Frames
from lidarcli.pipeline.watching.options import ZoneOptions, refuse_resting
from lidarcli.pose.fit import Key
from lidarcli.pose.sources import WORLDS
from lidarcli.pose.tracks import frame_name
from lidarcli.reports.wording import counted
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular.arrays import are
from lidarcli.tabular.reading import read_columns
from lidarcli.tabular.schemas import SCHEMAS
from lidarcli.tabular.stamps import COARSE
from lidarcli.zone import ROBOT, SENSOR, WORLD, Line, Zone

T = TypeVar("T")


class Watching:
    """One pass over a log that counts what is in its zones."""

    def __init__(self, log: Log, options: ZoneOptions, pair: Pair | None) -> None:
        self._log, self._options, self._pair = log, options, pair
        if pair is not None and not (pair.trajectories.exists() and pair.tracks.exists()):
            for zone in options.zones.zones:
                if isinstance(zone.shape, Line):
                    raise OptionError(
                        f"zone '{zone.name}' is a line, and crossings need tracks, which are not beside {pair.objects}: "
                        "give the tables of track, or leave out --objects"
                    )
        detect = options.detect
        masking = masking_of(log, detect.read.rules, detect.poses, detect.read.topics)
        own = masking.rules.masks or Masks()
        self._masks = Masks((*own.masks, *options.zones.masks.masks), (), own.path)
        self._notes = [*masking.notes]
        self._frames = Frames.of(log, options.zones, own.mounts)
        # Beams under a mask are counted here, and left out.
        self._read = replace(detect.read, rules=replace(masking.rules, masks=None))
        self._topics: set[str] = set()
        self._agents: dict[Key, Tracked | None] = {}
        self._worlds: dict[Key, str] = {}
        """Sensor → the fixed frame of its poses."""
        self._counting: dict[Key, Counting] = {}
        self._report = ReadReport()
        self._told = {zone.velocity_topic: self._velocities(zone) for zone in options.zones.zones if zone.velocity_topic}
        self._lost: dict[str, NoScanError] = {}
        """Zones that cannot be judged in this log → why."""
        self._shapes = dict(self._judged(zone, self._shapes_of) for zone in options.zones.zones)
        self._cursors: dict[str, tuple[Cursor, Cursor]] = {}

    @property
    def _zones(self) -> list[Zone]:
        """Zones that can be judged; where there is none, the error of the first."""
        zones = [zone for zone in self._options.zones.zones if zone.name not in self._lost]
        if not zones:
            raise next(iter(self._lost.values()))
        return zones

    def _judged(self, zone: Zone, how: Callable[[Zone], T]) -> tuple[str, T | None]:
        """Return the name of a zone and what is to be known of it; where it cannot be judged, the others still are."""
        try:
            return zone.name, how(zone)
        except NoScanError as err:
            self._lost.setdefault(zone.name, err)
            return zone.name, None

    def _velocities(self, zone: Zone) -> Told | None:
        found = velocities(self._log, zone.velocity_topic, self._report)
        if found is None or not len(found[0]):
            return None
        types = {topic.type for topic in self._log.topics() or () if same_name(topic.name, zone.velocity_topic)}
        return Told(*found, recorded=types == {TWIST})

    def _shapes_of(self, zone: Zone) -> Shapes:
        """Return the shapes of a zone."""
        if isinstance(zone.shape, Circle | Polygon):
            return Shapes([zone.shape])
        if isinstance(zone.shape, Line) or zone.cases:
            return Shapes([case.shape for case in zone.cases])
        told = polygons(self._log, zone.shape_topic, self._report)
        if told is None:
            if (footprint := self._options.footprint or zone.footprint) is None:
                raise NoScanError(
                    f"zone '{zone.name}' has the shape that {zone.shape_topic} tells, and the log has no such topic: "
                    "give --footprint '[[x, y], ...]', or robot_radius of local_costmap in the file"
                )
            return Shapes([footprint])
        shapes: dict[tuple[tuple[float, float], ...], int] = {}
        times, parts = [], []
        for each in told:
            frames = self._frames.of_topic(zone.shape_topic)
            corners = frames.corners_in("", each.frame_id, each.stamp_ns, each.corners)
            if corners is None:
                raise NoScanError(
                    f"zone '{zone.name}': nothing leads from frame {each.frame_id} of {zone.shape_topic} to the robot"
                )
            key = tuple((round(float(x), 3), round(float(y), 3)) for x, y in corners)
            times.append(each.stamp_ns)
            parts.append(shapes.setdefault(key, len(shapes)))
        if not shapes:
            raise UnreadableError(f"zone '{zone.name}': no polygon of {zone.shape_topic} can be read")
        return Shapes([Polygon(key) for key in shapes], np.array(times, np.int64), np.array(parts, np.int64))

    def run(self, source: Source, progress: Progress | None) -> tuple[RunSummary, list[Settled], dict[str, Any]]:
        """Read the sweeps; returns the counts, the zones and the description of the source."""
        detect = self._options.detect
        with Reading(self._log, self._read, detect.poses, Need.MOVING) as reading:
            for batch in reading.batches(progress):
                self._take(batch, reading)
            summary = reading.close()
            described = reading.describe(source)
        notes = self._refuse_contradiction(described)
        summary.damage += [
            f"topic {topic}: {counted(count, 'message')} left out: {cause}"
            for (topic, cause), count in sorted(self._report.refused.items())
        ]
        told = [self._judged(zone, lambda one: [*self._gaps(one)]) for zone in self._zones]
        gaps = [note for _, lines in told for note in lines or ()]
        settled = [one for zone in self._zones for one in self._settled(zone)]
        left_out = [f"{error}; the others are judged" for error in self._lost.values()]
        summary.notes += [*self._notes, *notes, *self._frames.notes(), *gaps, *left_out]
        return summary, settled, described

    def _take(self, batch: SweepBatch, reading: Reading) -> None:
        """Count the sweeps of a batch."""
        self._topics.add(batch.topic)
        zones = [zone for zone in self._zones if zone.is_for(batch.topic)]
        if not len(batch) or not zones:
            return
        whole = self._objects(batch)
        for sensor, rows, mine in batch.by_frame():
            resolved = [self._resolved(zone, batch.topic, sensor, reading) for zone in zones]
            key = batch.topic, sensor
            if key not in self._counting:
                series = TopicSeries(
                    batch.topic,
                    sensor,
                    [ZoneSeries.of(zone, shapes) for zone in resolved if (shapes := self._shapes[zone.name])],
                    batch.first_ns,
                )
                frames = self._frames.of_topic(batch.topic)
                self._counting[key] = Counting(series, frames, self._masks, self._told)
            objects = None if whole is None else whole.of_rows(rows)
            self._counting[key].add(mine, objects)

    def _resolved(self, zone: Zone, topic: str, sensor: str, reading: Reading) -> Zone:
        """Return a zone whose frame is `world` where it names the fixed frame of the poses; refuse one without poses."""
        world = self._worlds[topic, sensor] = reading.world_of(topic, sensor)
        if zone.frame == WORLD or (
            world
            and zone.frame not in (SENSOR, ROBOT)
            and (same_name(zone.frame, world) or world.endswith(f"/{frame_name(zone.frame)}"))
        ):
            if not world:
                raise NoScanError(
                    f"zone '{zone.name}' is in the world, and nothing tells where the sensor of {topic} is: give --pose "
                    "or --poses (--pose match finds the path from the sweeps)"
                )
            resting = replace(zone, frame=WORLD)
            refuse_resting(resting)
            return resting
        return zone

    def _objects(self, batch: SweepBatch) -> Objects | None:
        """Return the objects of a batch."""
        if self._pair is None:
            return None
        if batch.topic not in self._cursors:
            self._cursors[batch.topic] = (
                Cursor(self._pair.sweeps, "sweeps", ("topic", "sweep", "stamp"), batch.topic),
                Cursor(self._pair.objects, "objects", OBJECT_COLUMNS, batch.topic),
            )
        sweeps, objects = (cursor.until(int(batch.sweep[-1]) + 1) for cursor in self._cursors[batch.topic])
        index = np.asarray(sweeps["sweep"])
        stamps = np.asarray(sweeps["stamp"].view(pa.int64()))
        at = np.minimum(np.searchsorted(index, batch.sweep), max(len(index) - 1, 0))
        if not len(index) or (index[at] != batch.sweep).any() or (np.abs(stamps[at] - batch.stamp_ns) >= COARSE).any():
            raise UnreadableError(
                f"{self._pair.sweeps}: not the table of these sweeps of {batch.topic}, which are not in it or have other "
                f"stamps: give the same --start, --end and --every, or {AGAIN}"
            )
        sweep = np.asarray(objects["sweep"])
        there = np.isin(sweep, batch.sweep)
        if not there.all():
            objects = objects.filter(pa.array(there))
        return Objects.of(objects, batch)

    def _counted_in(self, zone: Zone) -> list[TopicSeries]:
        """Return the sweeps of each sensor that counts in a zone."""
        return [self._counting[key].series for key in sorted(self._counting) if zone.is_for(key[0])]

    def _gaps(self, zone: Zone) -> Iterator[str]:
        """Yield what a zone needs and the log has only in part; refuse one for which it has nothing of it."""
        counted_in = self._counted_in(zone)
        if not counted_in:
            if not self._topics:
                raise NoScanError("no sweep has been read: the log holds none, or none from --start to --end")
            raise NoScanError(
                f"zone '{zone.name}' is for {', '.join(zone.topics)}, and no sweeps of it have been read (only of "
                f"{', '.join(sorted(self._topics))})"
            )
        topics = [one.topic for one in counted_in]
        missing = [name for name in zone.topics if not any(same_name(name, topic) for topic in topics)]
        if missing:
            yield f"zone '{zone.name}': no sweeps of {', '.join(missing)}, which would count in it too"
        if counted_in[0].of_zone(zone.name).zone.frame == WORLD:
            self._refuse_several_worlds(zone, topics)
        if zone.action != "approach" and not zone.cases:
            return
        series = [one.of_zone(zone.name) for one in counted_in]
        unknown = sum(int(np.isnan(each.column("velocity")[:, 0]).sum()) for each in series)
        sweeps = sum(one.count for one in counted_in)
        if unknown == sweeps:
            who = f"neither {zone.velocity_topic} nor poses" if zone.velocity_topic else "no poses"
            raise NoScanError(
                f"zone '{zone.name}' needs the velocity of the robot, which {who} tell: give --pose or --poses (--pose "
                "match finds the path from the sweeps)"
            )
        old = sum(self._counting[one.sensor].old[zone.velocity_topic] for one in counted_in)
        if old:
            yield (
                f"zone '{zone.name}': the last velocity of {zone.velocity_topic} was more than {OLDEST_NS * 1e-9:g} s old "
                f"in {old:,} of {counted(sweeps, 'sweep')}, and counted all the same"
            )
        # Poses tell no velocity before the second sweep.
        if unknown > len(counted_in):
            yield f"zone '{zone.name}': velocity not known in {unknown:,} of {counted(sweeps, 'sweep')}, not judged there"

    def _refuse_several_worlds(self, zone: Zone, topics: Sequence[str]) -> None:
        """Refuse a zone in the world for sensors whose poses are in different ones."""
        worlds = {at: world for at, world in self._worlds.items() if at[0] in topics}
        # A path that is matched from the sweeps begins where its sensor was.
        named = {(world, sensor if world == MATCH else "") for (_, sensor), world in worlds.items()}
        if len(named) > 1:
            told = ", ".join(f"{world} for {topic}" for (topic, _), world in sorted(worlds.items()))
            raise NoScanError(
                f"zone '{zone.name}' is in the world, and its sensors have each a world of its own ({told}): give the zone "
                "one 'topic', or poses in one world (--pose TOPIC, --poses FILE)"
            )

    def _settled(self, zone: Zone) -> Iterator[Settled]:
        """Yield a zone as all sensors see it; one in the frame of the sensor for each of them."""
        counted_in = self._counted_in(zone)
        groups = [[one] for one in counted_in] if zone.frame == SENSOR else [counted_in]
        for one in counted_in:
            if one.sensor not in self._agents:
                self._agents[one.sensor] = self._tracked(one)
        for group in groups:
            series = [one.of_zone(zone.name) for one in group]
            topics = [each.series for each in self._counting.values()]
            stamps = [each.column("stamp_ns") for each in topics]
            yield settle(
                Counted(
                    series[0].zone,
                    tuple(group),
                    tuple(series),
                    tuple(case.name for case in zone.cases),
                    tuple(self._agents[one.sensor] for one in group),
                    self._pair is not None,
                    (min(int(each.min()) for each in stamps), max(int(each.max()) for each in stamps)),
                    min(each.first_ns for each in topics),
                    self._read.every,
                )
            )

    def _tracked(self, series: TopicSeries) -> Tracked | None:
        """Return the agents that a sensor sees; None where nobody followed them."""
        pair = self._pair
        if pair is None or not pair.trajectories.exists() or not pair.tracks.exists():
            return None
        tracks = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], ("topic", "frame_id", "track", "set", "label"))
        mine = [row for row in tracks.to_pylist() if (row["topic"], row["frame_id"]) == series.sensor]
        agents = np.array([row["track"] for row in mine if row["set"] == "A"], np.int64)
        labels = {row["track"]: row["label"] for row in mine if row["label"] is not None}
        columns = ("topic", "track", "sweep", "frame", "x", "y", "seen")
        rows = read_columns(pair.trajectories, "trajectories", SCHEMAS["trajectories"], columns)
        here = are(rows["topic"], series.topic)
        track = np.asarray(rows["track"])
        # Sweeps of several frames are not in their order.
        sweeps = series.column("sweep")
        in_order = np.argsort(sweeps)
        sweep = np.asarray(rows["sweep"])
        at = in_order[np.minimum(np.searchsorted(sweeps, sweep, sorter=in_order), len(sweeps) - 1)]
        some = np.flatnonzero(here & np.isin(track, agents) & (sweeps[at] == sweep))
        order = some[np.lexsort((series.column("stamp_ns")[at[some]], track[some]))]
        world, hidden = are(rows["frame"], WORLD), are(rows["seen"], "hidden")
        return Tracked(
            track[order],
            at[order],
            np.asarray(rows["x"])[order],
            np.asarray(rows["y"])[order],
            world[order],
            ~hidden[order],
            labels,
        )

    def _refuse_contradiction(self, described: Mapping[str, Any]) -> list[str]:
        """Refuse zones in a fixed frame where the sweeps contradict the poses; return notes on matched worlds."""
        fixed = {
            (zone.zone.name, topic): zone.zone.frame
            for (topic, _), each in self._counting.items()
            for zone in each.series.zones
            if zone.zone.frame == WORLD or frame_name(zone.zone.frame).rpartition("/")[2] in WORLDS
        }
        notes: dict[str, None] = {}
        for frame, told in described.get("poses", {}).items():
            for (name, topic), where in sorted(fixed.items()):
                if told.get("pose_verdict", {}).get(topic) == "rejected":
                    raise UnreadableError(
                        f"zone '{name}' is in the frame {where}, and the poses of {frame or 'the sensor'} contradict the "
                        f"sweeps of {topic}: nothing written; give other poses (--pose TOPIC, --poses FILE)"
                    )
                if world_in(told, topic) == MATCH and where == WORLD:
                    notes[f"zone '{name}' is in the world of the path that is matched from the sweeps of {topic}"] = None
        return [*notes]


def narrowed(log: Log, options: ZoneOptions) -> ZoneOptions:
    """Return options that read only the topics that count in a zone, where each zone names some."""
    read, zones = options.detect.read, options.zones.zones
    scans = [topic.name for topic in log.topics() or () if topic.is_scan]
    mine = [topic for topic in scans if any(zone.is_for(topic) for zone in zones)]
    if read.topics or not mine or not all(zone.topics for zone in zones):
        return options
    return replace(options, detect=replace(options.detect, read=replace(read, topics=mine)))


def masked(log: Log, options: ZoneOptions) -> DetectOptions:
    """Return how objects are found where the masks of a zone file are masks of the detection, too."""
    detect, zones = options.detect, options.zones
    if not zones.masks.masks:
        return detect
    masking = masking_of(log, detect.read.rules, detect.poses, detect.read.topics)
    own = masking.rules.masks or Masks()
    frames = Frames.of(log, zones, own.mounts)
    mounts = frames.mounts_in({mask.frame for mask in zones.masks.masks if mask.frame})
    masks = Masks((*own.masks, *zones.masks.masks), (*frames.mounts, *mounts), own.path)
    return replace(detect, read=replace(detect.read, rules=replace(masking.rules, masks=masks)))
