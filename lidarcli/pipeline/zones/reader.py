"""One pass over a log that counts what is in its zones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.options.choices import MATCH
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import TableSet, contradicted, world_in
from lidarcli.pipeline.inputs.tracked import ObjectRows, Objects, paths_of, tracks_of
from lidarcli.pipeline.reading.masking import MaskRules
from lidarcli.pipeline.reading.needs import Need
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary
from lidarcli.pipeline.zones.counts import Shapes, TopicCounter, TopicSeries, ZoneSeries
from lidarcli.pipeline.zones.events import AgentPaths, EventFinder, ZoneEvents
from lidarcli.pipeline.zones.frames import OLDEST_NS, Frames, Velocities
from lidarcli.pipeline.zones.monitor import Act, acts_of, states
from lidarcli.pipeline.zones.options import ZoneOptions, refuse_resting
from lidarcli.pipeline.zones.stops import stops_in
from lidarcli.pose.findings import Key
from lidarcli.pose.frames import WORLDS, namespace
from lidarcli.pose.messages import ODOMETRY, TWIST, frame_name, polygons, velocities
from lidarcli.pose.tracks import PoseTrack
from lidarcli.reports.wording import counted
from lidarcli.sweeps.masks import Circle, Masks, Polygon, same_name
from lidarcli.sweeps.types import SweepBatch, spared
from lidarcli.sweeps.zone import ROBOT, SENSOR, WORLD, Line, Zone
from lidarcli.tabular.columns import COARSE, integers
from lidarcli.tabular.reading import AGAIN, TopicRows


class ZoneReader:
    """One pass over a log that counts what is in its zones."""

    def __init__(
        self, log: Log, options: ZoneOptions, tables: TableSet | None, masking: MaskRules, first: Reading | None
    ) -> None:
        """`masking` is that of the log; `first` the reading that found the objects, where this run did so."""
        self._log, self._options, self._tables, self._first = log, options, tables, first
        if tables is not None and not _has_tracks(tables):
            for zone in options.zones.zones:
                if isinstance(zone.shape, Line):
                    raise OptionError(
                        f"zone '{zone.name}' is a line, and crossings need tracks, which are not beside {tables.objects}: "
                        "give the tables of track, or leave out --objects"
                    )
        own = masking.rules.masks or Masks()
        self._masks = Masks((*own.masks, *options.zones.masks.masks), (), own.path)
        self._notes = [*masking.notes]
        self._frames = Frames.of(log, options.zones, own.mounts)
        # Beams under a mask are counted by the zones, and left out.
        self._read = replace(options.detect.read, rules=replace(masking.rules, masks=None))
        self._topics: set[str] = set()
        self._agents: dict[tuple[str, str, int], AgentPaths | None] = {}
        self._worlds: dict[Key, str] = {}
        """Sensor → the fixed frame of its poses."""
        self._robots: Mapping[str, tuple[Key, ...]] = {}
        """Topic → the sensors of its robot."""
        self._counting: dict[tuple[str, str, int], TopicCounter] = {}
        self._report = ReadReport()
        self._known_velocities = {
            zone.velocity_topic: self._velocities(zone) for zone in options.zones.zones if zone.velocity_topic
        }
        self._lost: dict[str, NoScanError] = {}
        """Zones that cannot be evaluated in this log → why."""
        self._shapes: dict[str, Shapes] = {}
        for zone in options.zones.zones:
            with self._judging(zone):
                self._shapes[zone.name] = self._shapes_of(zone)
        self._sweeps: dict[str, TopicRows] = {}
        self._rows = None if tables is None else ObjectRows(tables)
        self.doubts: list[str] = []
        """Notes on the transforms; known when the log is read."""
        self.late_ns: int | None = None
        """Time from the stamps of sweeps to their recording."""
        self.topics: list[TopicSeries] = []
        """The sweeps of each sensor; known when the log is read."""
        self.odometry: list[PoseTrack] = []
        """Odometry that moves; known when the log is read."""
        self.stops: list[dict[str, Any]] = []
        """Rows of the robot's own stops, as of the table of events; known when the log is read."""
        self.acts: list[Act] = []
        """Acts of Nav2; known when the log is read."""

    @property
    def _zones(self) -> list[Zone]:
        """Zones that can be evaluated; where there is none, the error of the first."""
        zones = [zone for zone in self._options.zones.zones if zone.name not in self._lost]
        if not zones:
            raise next(iter(self._lost.values()))
        return zones

    @contextmanager
    def _judging(self, zone: Zone) -> Iterator[None]:
        """Note a zone that cannot be evaluated; the others still are."""
        try:
            yield
        except NoScanError as err:
            self._lost.setdefault(zone.name, err)

    def _velocities(self, zone: Zone) -> Velocities | None:
        found = velocities(self._log, zone.velocity_topic, self._report)
        if found is None or not len(found[0]):
            return None
        types = {topic.type for topic in self._log.topics() or () if same_name(topic.name, zone.velocity_topic)}
        return Velocities(*found, recorded=types == {TWIST})

    def _shapes_of(self, zone: Zone) -> Shapes:
        """Return the shapes of a zone."""
        if isinstance(zone.shape, Circle | Polygon):
            return Shapes([zone.shape])
        if isinstance(zone.shape, Line) or zone.cases:
            return Shapes([case.shape for case in zone.cases])
        messages = polygons(self._log, zone.shape_topic, self._report)
        if messages is None:
            if (footprint := self._options.footprint or zone.footprint) is None:
                raise NoScanError(
                    f"zone '{zone.name}' has no shape without {zone.shape_topic}: give --footprint '[[x, y], ...]'"
                )
            if self._options.footprint is None:
                told = f"its file has that of the costmap, the log has no {zone.shape_topic}"
                self._notes.append(f"the shape of zone '{zone.name}' is a footprint: {told}")
            return Shapes([footprint])
        shapes: dict[tuple[tuple[float, float], ...], int] = {}
        times, parts = [], []
        for each in messages:
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

    def run(self, source: Source, progress: Progress | None) -> tuple[RunSummary, list[ZoneEvents], dict[str, Any]]:
        """Read the sweeps; returns the counts, the zones and the description of the source."""
        with Reading(self._log, self._read, self._options.detect.poses, Need.MOVING, self._first) as reading:
            for batch in reading.batches(progress):
                self._take(batch, reading)
            summary = reading.close()
            described = reading.describe(source)
            self._robots = reading.posing.robots
            tracks = () if reading.posing.found is None else reading.posing.found.sources.tracks
            self.odometry = [track for track in tracks if track.type == ODOMETRY and track.moves]
        reported = states(self._log, self._report)
        notes = self._refuse_contradiction(described, reading.posing.file_gap)
        summary.damage += [
            f"topic {topic}: {counted(count, 'message')} left out: {cause}"
            for (topic, cause), count in sorted(self._report.refused.items())
        ]
        if not self._topics:
            none = "no sweep has been read: the log holds none, or none from --start to --end"
            raise UnreadableError("; ".join([none, *summary.damage])) if summary.damage else NoScanError(none)
        gaps: list[str] = []
        for zone in self._zones:
            with self._judging(zone):
                gaps += [*self._gaps(zone)]
        by_zone = [one for zone in self._zones for one in self._events_in(zone)]
        gaps += [
            f"zone '{one.zone.name}': in {one.lost[0]:,} of {counted(len(one.topic), 'sweep')} up to {one.lost[1]:.0%} of "
            "it is lost (no usable beams, or a sensor that hangs or is silent); a mask takes a part out"
            for one in by_zone
            if one.lost[0] > spared(len(one.topic))
        ]
        self.topics = [each.series for each in self._counting.values()]
        tells = self._options.half_width is not None
        self.stops = [row for one in self._by_robot() for row in stops_in(one, self.odometry)] if tells else []
        self.acts = acts_of(reported, self.late_ns or 0, by_zone)
        self.doubts = self._frames.notes()
        summary.notes += [*self._notes, *notes, *self.doubts, *gaps, *map(str, self._lost.values())]
        return summary, by_zone, described

    def _take(self, batch: SweepBatch, reading: Reading) -> None:
        """Count the sweeps of a batch."""
        self._topics.add(batch.topic)
        if self.late_ns is None and len(batch):
            self.late_ns = int(np.median(batch.record_ns - batch.stamp_ns))
        zones = [zone for zone in self._zones if zone.is_for(batch.topic)]
        if not len(batch) or not zones:
            return
        objects = self._objects(batch)
        for sensor, rows, own in batch.by_frame():
            resolved = [self._resolved(zone, batch.topic, sensor, reading) for zone in zones]
            key = batch.topic, sensor, batch.run
            if key not in self._counting:
                series = TopicSeries(
                    *key,
                    [ZoneSeries(zone, shapes) for zone in resolved if (shapes := self._shapes.get(zone.name))],
                    batch.first_ns,
                )
                frames = self._frames.of_topic(batch.topic)
                self._counting[key] = TopicCounter(
                    series, frames, self._masks, self._known_velocities, self._options.half_width
                )
            self._counting[key].add(own, None if objects is None else objects.of_rows(rows))

    def _resolved(self, zone: Zone, topic: str, sensor: str, reading: Reading) -> Zone:
        """Return a zone whose frame is `world` where it names the fixed frame of the poses; refuse one without poses."""
        world = self._worlds[topic, sensor] = reading.posing.world_of(topic, sensor)
        if zone.frame == WORLD or (
            world
            and zone.frame not in (SENSOR, ROBOT)
            and (same_name(zone.frame, world) or world.endswith(f"/{frame_name(zone.frame)}"))
        ):
            path = reading.posing.paths.get((topic, sensor))
            if not world and path is not None and path.apart is not None:
                raise UnreadableError(f"zone '{zone.name}' is in the world: {path.apart.message}")
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
        """Return the objects of a batch; None where nobody looked for any."""
        if self._tables is None or self._rows is None:
            return None
        if batch.topic not in self._sweeps:
            self._sweeps[batch.topic] = TopicRows(self._tables.sweeps, "sweeps", ("topic", "sweep", "stamp"), batch.topic)
        sweeps = self._sweeps[batch.topic].until(int(batch.sweep[-1]) + 1)
        index, stamps = integers(sweeps, "sweep"), integers(sweeps, "stamp")
        at = np.minimum(np.searchsorted(index, batch.sweep), max(len(index) - 1, 0))
        if not len(index) or (index[at] != batch.sweep).any() or (np.abs(stamps[at] - batch.stamp_ns) >= COARSE).any():
            raise UnreadableError(
                f"{self._tables.sweeps}: not the table of these sweeps of {batch.topic}, which are not in it or have other "
                f"stamps: give the same --start, --end and --every, or {AGAIN}"
            )
        return self._rows.of(batch)

    def _counted_in(self, zone: Zone) -> list[TopicSeries]:
        """Return the sweeps of each sensor that counts in a zone."""
        return [self._counting[key].series for key in sorted(self._counting) if zone.is_for(key[0])]

    def _by_robot(self) -> Iterator[list[TopicSeries]]:
        """Yield the sensors of each robot of a run."""
        found: dict[tuple[int, object], list[TopicSeries]] = {}
        for (topic, _, run), each in self._counting.items():
            found.setdefault((run, self._robots.get(topic) or namespace(topic)), []).append(each.series)
        yield from found.values()

    def _gaps(self, zone: Zone) -> Iterator[str]:
        """Yield what a zone needs and the log has only in part; refuse one for which it has nothing of it."""
        counted_in = self._counted_in(zone)
        if not counted_in:
            raise NoScanError(
                f"zone '{zone.name}' is for {', '.join(zone.topics)}, and no sweeps of it have been read (only of "
                f"{', '.join(sorted(self._topics))})"
            )
        topics = [one.topic for one in counted_in]
        scans = [] if self._read.topics else [topic.name for topic in self._log.topics() or () if topic.is_scan]
        missing = [name for name in zone.topics or scans if not any(same_name(name, topic) for topic in topics)]
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
                f"zone '{zone.name}': {zone.velocity_topic} was over {OLDEST_NS * 1e-9:g} s old in {old:,} of "
                f"{counted(sweeps, 'sweep')}, and counted all the same"
            )
        # Poses give no velocity before the second sweep.
        if unknown > len(counted_in):
            yield f"zone '{zone.name}': velocity not known in {unknown:,} of {counted(sweeps, 'sweep')}, not judged there"

    def _refuse_several_worlds(self, zone: Zone, topics: Sequence[str]) -> None:
        """Refuse a zone in the world for sensors whose poses are in different ones."""
        worlds = {at: world for at, world in self._worlds.items() if at[0] in topics}
        # A path that is matched from the sweeps begins where its sensor was, or its robot.
        named = {
            (world, "" if world != MATCH else self._robots.get(topic) or sensor)
            for (topic, sensor), world in worlds.items()
        }
        if len(named) > 1:
            listed = ", ".join(f"{world} for {topic}" for (topic, _), world in sorted(worlds.items()))
            raise NoScanError(
                f"zone '{zone.name}' is in the world, and its sensors have each a world of its own ({listed}): give it one "
                "'topic', or poses in one world (--pose TOPIC, --poses FILE)"
            )

    def _events_in(self, zone: Zone) -> Iterator[ZoneEvents]:
        """Yield a zone as all sensors of a robot observe it; one in the frame of the sensor for each of them."""
        counted_in = self._counted_in(zone)
        by_robot: dict[tuple[int, tuple[object, ...]], list[TopicSeries]] = {}
        for one in counted_in:
            frame = one.of_zone(zone.name).zone.frame
            carrier = self._frames.of_topic(one.topic).carrier_of(frame, one.frame_id)
            by_robot.setdefault((one.run, one.sensor if frame == SENSOR else carrier), []).append(one)
        groups = [by_robot[key] for key in sorted(by_robot, key=lambda key: key[0])]
        for one in counted_in:
            if one.sensor not in self._agents:
                self._agents[one.sensor] = _agents_at(one, self._tables)
        for group in groups:
            every = [each.series for each in self._counting.values() if each.series.run == group[0].run]
            stamps = [each.column("stamp_ns") for each in every]
            yield EventFinder(
                group[0].of_zone(zone.name).zone,
                group,
                [self._agents[one.sensor] for one in group],
                has_objects=self._tables is not None,
                span_ns=(min(int(each.min()) for each in stamps), max(int(each.max()) for each in stamps)),
                first_ns=min(each.first_ns for each in every),
                every=self._read.every,
            ).find()

    def _refuse_contradiction(self, described: Mapping[str, Any], gap: str) -> list[str]:
        """Refuse zones in a fixed frame where the sweeps contradict the poses, as of `contradicted`; return notes."""
        fixed = {
            (zone.zone.name, topic): zone.zone.frame
            for (topic, _, _), each in self._counting.items()
            for zone in each.series.zones
            if zone.zone.frame == WORLD or frame_name(zone.zone.frame).rpartition("/")[2] in WORLDS
        }
        notes: dict[str, None] = {}
        for frame, poses in described.get("poses", {}).items():
            for (name, topic), where in sorted(fixed.items()):
                if topic in (wrong := contradicted(poses, gap)):
                    raise UnreadableError(
                        f"zone '{name}' is in the frame {where}, and the poses of {frame or 'the sensor'} {wrong[topic][0]}"
                    )
                if world_in(poses, topic) == MATCH and where == WORLD:
                    notes[f"zone '{name}' is in the world of the matched path of {topic}"] = None
        return [*notes]


def _has_tracks(tables: TableSet) -> bool:
    """Return whether objects were followed."""
    return bool(tables.trajectories.exists() and tables.tracks.exists())


def _agents_at(series: TopicSeries, tables: TableSet | None) -> AgentPaths | None:
    """Return the agents at the sweeps of a sensor; None where nobody followed them."""
    if tables is None or not _has_tracks(tables):
        return None
    tracks = tracks_of(tables, series.topic, series.frame_id, ("set", "label", "person"))
    paths = paths_of(tables, series.topic)
    # Sweeps of several frames are not in their order.
    sweeps = series.column("sweep")
    in_order = np.argsort(sweeps)
    at = in_order[np.minimum(np.searchsorted(sweeps, paths.sweep, sorter=in_order), len(sweeps) - 1)]
    agents = [row["track"] for row in tracks if row["set"] == "A"]
    own = np.flatnonzero(np.isin(paths.track, agents) & (sweeps[at] == paths.sweep))
    rows = own[np.lexsort((series.column("stamp_ns")[at[own]], paths.track[own]))]
    places = paths.x[rows], paths.y[rows], paths.in_world[rows]
    labels = {row["track"]: row["label"] for row in tracks if row["label"] is not None}
    shared = {row["track"] for row in tracks if row["frame_id"] is None}
    persons = {row["track"]: row["person"] for row in tracks if row["person"] is not None}
    return AgentPaths(paths.track[rows], at[rows], *places, ~paths.hidden[rows], labels, shared, persons)
