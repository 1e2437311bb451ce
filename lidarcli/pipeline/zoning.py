"""`zones`: a pass over a log that counts what is in its zones, and the tables, lines and notes of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.display.texts import times
from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.files.newfiles import refuse, scratch_folder, write_whole
from lidarcli.files.stores import Place
from lidarcli.logs.base import Log, ReadReport
from lidarcli.options.choices import AROUND, MATCH
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.declared import plain
from lidarcli.pipeline.inputs.sources import MissingInput, Source, open_source
from lidarcli.pipeline.inputs.tables import (
    TableSet,
    contradicted,
    one_table_set,
    other_recording,
    tables_together,
    world_in,
)
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.masking import MaskRules, masking_of
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary
from lidarcli.pipeline.reading.posing import TWIST, Need, polygons, velocities
from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome, logs_at_once, over_logs
from lidarcli.pipeline.zone_counting import (
    OBJECT_COLUMNS,
    OLDEST_NS,
    Frames,
    Objects,
    Shapes,
    TopicCounter,
    TopicSeries,
    Velocities,
    ZoneSeries,
)
from lidarcli.pipeline.zone_events import AgentPaths, EventFinder, ZoneEvents
from lidarcli.pipeline.zone_monitor import Act, acts_of, lines_of, missed_stops, states
from lidarcli.pose.fit import Key
from lidarcli.pose.sources import WORLDS
from lidarcli.pose.tracks import frame_name
from lidarcli.reports.checks import Check, Verdict, verdict_of
from lidarcli.reports.figures import plain_number
from lidarcli.reports.programs import as_junit
from lidarcli.reports.wording import counted
from lidarcli.reports.zones import NEVER, WHO, by_words, figures_of, judge_zones, parse_zone_check, unobserved, zones_in
from lidarcli.sweeps.masks import Circle, Masks, Polygon, same_name
from lidarcli.sweeps.types import SweepBatch, spared
from lidarcli.sweeps.zone import ROBOT, SENSOR, WORLD, Line, Zone, Zones
from lidarcli.tabular.columns import COARSE, FORMS, answers, are, codes, constant
from lidarcli.tabular.reading import AGAIN, HeldTable, TopicRows, read_columns
from lidarcli.tabular.schemas import DIRECTIONS, EVENT_KINDS, SCHEMAS
from lidarcli.tabular.writing import TableFiles, table_metadata, table_paths

TABLES = ("events", "zones")
NAMED = ("name", "frame", "action", "count", "min_points", "trigger", "release", "hold", "timeout")
"""Fields of every zone in the metadata, beside those that it has."""


@dataclass(frozen=True, slots=True)
class ZoneOptions:
    """Options of `zones`, apart from inputs and outputs."""

    zones: Zones
    files: tuple[str, ...]
    """Files that the zones are from."""
    detect: DetectOptions
    """Options of reading, detection and tracking."""
    objects: str | None = None
    """The objects table of the log, where there is one."""
    find: bool = True
    """True to find and follow objects where no table is given."""
    footprint: Polygon | None = None
    """Shape of zones whose shape a topic tells that the log does not have."""
    overwrite: bool = False
    clips: Place | None = None
    """Folder for a part of the log around each event."""
    around: float = AROUND
    """Time before and after each [s]."""

    @property
    def has_objects(self) -> bool:
        """True if it is known which objects the points are on."""
        return self.find or self.objects is not None

    def outputs(self, source: Source, folder: Place) -> dict[str, Place]:
        """Return the path of each table of a log."""
        return table_paths(folder, source.name, TABLES)

    def inputs(self, sources: Sequence[Source | MissingInput]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        tables = [] if self.objects is None else [str(one_table_set(self.objects).objects)]
        return [*self.detect.inputs(sources), *self.files, *tables]

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the tables' metadata."""
        own: dict[str, Any] = {"zones": [*map(zone_dict, self.zones.zones)], "find": self.has_objects}
        more: dict[str, Any] = {"zone_masks": plain(self.zones.masks), "robot": self.zones.robot}
        more["footprint"] = None if self.footprint is None else self.footprint.corners
        return self.detect.as_dict() | own | {name: value for name, value in more.items() if value}


def zone_dict(zone: Zone) -> dict[str, Any]:
    """Return a zone as plain values; of its shape one of polygon, circle, line, or each of its polygons by name."""
    ahead = ("time_before_collision", "time_step") if zone.action == "approach" else ()
    topics = [name for name in ("shape_topic", "velocity_topic") if getattr(zone, name)]
    found = {name: getattr(zone, name) for name in (*NAMED, *(("topics",) if zone.topics else ()), *ahead, *topics)}
    match zone.shape:
        case Polygon(corners):
            found["polygon"] = corners
        case Circle():
            found["circle"] = asdict(zone.shape)
        case Line(first, second):
            found["line"] = first, second
        case None:
            found["polygons"] = {
                case.name: {
                    "polygon": case.shape.corners,
                    "linear": case.linear,
                    "turning": case.turning,
                    **({} if case.direction is None else {"direction": case.direction}),
                }
                for case in zone.cases
            }
            if zone.footprint is not None:
                found["footprint"] = zone.footprint.corners
    return found


def refuse_options(options: ZoneOptions) -> None:
    """Refuse zones that need objects where none are known, and options that no zone needs (`OptionError`)."""
    if options.footprint is not None and not any(zone.shape_topic for zone in options.zones.zones):
        raise OptionError("--footprint is for zones whose shape a topic tells, and there are none")
    for zone in options.zones.zones:
        needs = isinstance(zone.shape, Line) or zone.count != "beams"
        if needs and not options.has_objects:
            what = "is a line, and crossings" if isinstance(zone.shape, Line) else f"counts {zone.count}, which"
            raise OptionError(f"zone '{zone.name}' {what} need tracks: leave out --no-objects")
        if zone.frame == WORLD:
            refuse_resting(zone)


def refuse_resting(zone: Zone) -> None:
    """Refuse a zone in the world that is to move with the robot (`OptionError`)."""
    if zone.action == "approach":
        raise OptionError(
            f"zone '{zone.name}' approaches, and in the world it does not move with the robot: give another 'frame'"
        )


class ZoneReader:
    """One pass over a log that counts what is in its zones."""

    def __init__(
        self, log: Log, options: ZoneOptions, pair: TableSet | None, masking: MaskRules, first: Reading | None
    ) -> None:
        """`masking` is that of the log; `first` the reading that found the objects, where this run did so."""
        self._log, self._options, self._pair, self._first = log, options, pair, first
        if pair is not None and not (pair.trajectories.exists() and pair.tracks.exists()):
            for zone in options.zones.zones:
                if isinstance(zone.shape, Line):
                    raise OptionError(
                        f"zone '{zone.name}' is a line, and crossings need tracks, which are not beside {pair.objects}: "
                        "give the tables of track, or leave out --objects"
                    )
        own = masking.rules.masks or Masks()
        self._masks = Masks((*own.masks, *options.zones.masks.masks), (), own.path)
        self._notes = [*masking.notes]
        self._frames = Frames.of(log, options.zones, own.mounts)
        # Beams under a mask are counted here, and left out.
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
        """Zones that cannot be judged in this log → why."""
        self._shapes: dict[str, Shapes] = {}
        for zone in options.zones.zones:
            with self._judging(zone):
                self._shapes[zone.name] = self._shapes_of(zone)
        self._cursors: dict[str, tuple[TopicRows, TopicRows]] = {}
        self._late_ns: int | None = None
        """Time from the stamps of sweeps to their recording."""
        self.acts: list[Act] = []
        """Acts of Nav2; known when the log is read."""

    @property
    def _zones(self) -> list[Zone]:
        """Zones that can be judged; where there is none, the error of the first."""
        zones = [zone for zone in self._options.zones.zones if zone.name not in self._lost]
        if not zones:
            raise next(iter(self._lost.values()))
        return zones

    @contextmanager
    def _judging(self, zone: Zone) -> Iterator[None]:
        """Note a zone that cannot be judged; the others still are."""
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
        told = states(self._log, self._report)
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
        self.acts = acts_of(told, self._late_ns or 0, by_zone)
        summary.notes += [*self._notes, *notes, *self._frames.notes(), *gaps, *map(str, self._lost.values())]
        return summary, by_zone, described

    def _take(self, batch: SweepBatch, reading: Reading) -> None:
        """Count the sweeps of a batch."""
        self._topics.add(batch.topic)
        if self._late_ns is None and len(batch):
            self._late_ns = int(np.median(batch.record_ns - batch.stamp_ns))
        zones = [zone for zone in self._zones if zone.is_for(batch.topic)]
        if not len(batch) or not zones:
            return
        whole = self._objects(batch)
        for sensor, rows, mine in batch.by_frame():
            resolved = [self._resolved(zone, batch.topic, sensor, reading) for zone in zones]
            key = batch.topic, sensor, batch.run
            if key not in self._counting:
                series = TopicSeries(
                    *key,
                    [ZoneSeries(zone, shapes) for zone in resolved if (shapes := self._shapes.get(zone.name))],
                    batch.first_ns,
                )
                frames = self._frames.of_topic(batch.topic)
                self._counting[key] = TopicCounter(series, frames, self._masks, self._known_velocities)
            objects = None if whole is None else whole.of_rows(rows)
            self._counting[key].add(mine, objects)

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
        """Return the objects of a batch."""
        if self._pair is None:
            return None
        if batch.topic not in self._cursors:
            self._cursors[batch.topic] = (
                TopicRows(self._pair.sweeps, "sweeps", ("topic", "sweep", "stamp"), batch.topic),
                TopicRows(self._pair.objects, "objects", OBJECT_COLUMNS, batch.topic),
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
        # Poses tell no velocity before the second sweep.
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
        """Yield a zone as all sensors of a robot see it; one in the frame of the sensor for each of them."""
        counted_in = self._counted_in(zone)
        by_robot: dict[tuple[int, tuple[object, ...]], list[TopicSeries]] = {}
        for one in counted_in:
            frame = one.of_zone(zone.name).zone.frame
            carrier = self._frames.of_topic(one.topic).carrier_of(frame, one.frame_id)
            by_robot.setdefault((one.run, one.sensor if frame == SENSOR else carrier), []).append(one)
        groups = [by_robot[key] for key in sorted(by_robot, key=lambda key: key[0])]
        for one in counted_in:
            if one.sensor not in self._agents:
                self._agents[one.sensor] = self._tracked(one)
        for group in groups:
            every = [each.series for each in self._counting.values() if each.series.run == group[0].run]
            stamps = [each.column("stamp_ns") for each in every]
            yield EventFinder(
                group[0].of_zone(zone.name).zone,
                group,
                [self._agents[one.sensor] for one in group],
                has_objects=self._pair is not None,
                span_ns=(min(int(each.min()) for each in stamps), max(int(each.max()) for each in stamps)),
                first_ns=min(each.first_ns for each in every),
                every=self._read.every,
            ).find()

    def _tracked(self, series: TopicSeries) -> AgentPaths | None:
        """Return the agents that a sensor sees; None where nobody followed them."""
        pair = self._pair
        if pair is None or not pair.trajectories.exists() or not pair.tracks.exists():
            return None
        tracks = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], ("topic", "frame_id", "track", "set", "label"))
        every = tracks.to_pylist()
        shared = {row["track"] for row in every if row["frame_id"] is None}
        mine = [row for row in every if row["frame_id"] is None or (row["topic"], row["frame_id"]) == series.sensor[:2]]
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
        return AgentPaths(
            track[order],
            at[order],
            np.asarray(rows["x"])[order],
            np.asarray(rows["y"])[order],
            world[order],
            ~hidden[order],
            labels,
            shared,
        )

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


def narrowed(log: Log, options: ZoneOptions) -> ZoneOptions:
    """Return options that read only the topics that count in a zone, where each zone names some."""
    read, zones = options.detect.read, options.zones.zones
    scans = [topic.name for topic in log.topics() or () if topic.is_scan]
    mine = [topic for topic in scans if any(zone.is_for(topic) for zone in zones)]
    if read.topics or not mine or not all(zone.topics for zone in zones):
        return options
    return replace(options, detect=replace(options.detect, read=replace(read, topics=mine)))


def masked(log: Log, options: ZoneOptions, masking: MaskRules) -> DetectOptions:
    """Return how objects are found where the masks of a zone file are masks of the detection, too."""
    detect, zones = options.detect, options.zones
    own = masking.rules.masks or Masks()
    if not zones.masks.masks:
        mounted = Masks(own.masks, (*own.mounts, *zones.masks.mounts), own.path)
        rules = replace(masking.rules, masks=mounted) if mounted.mounts else masking.rules
        return replace(detect, read=replace(detect.read, rules=rules))
    frames = Frames.of(log, zones, own.mounts)
    mounts = frames.mounts_in({mask.frame for mask in zones.masks.masks if mask.frame})
    masks = Masks((*own.masks, *zones.masks.masks), (*frames.mounts, *mounts), own.path)
    return replace(detect, read=replace(detect.read, rules=replace(masking.rules, masks=masks)))


class ZoneTables(NamedTuple):
    """Tables that `zones` returns, with the schemas of `lidarcli.tabular.SCHEMAS`."""

    events: pa.Table
    """One row per event."""
    zones: pa.Table
    """One row per sweep and zone."""


@dataclass(slots=True)
class ZoneSummary(RunSummary):
    """The counts of one run over one log, and its zones."""

    tables: ZoneTables = field(default_factory=lambda: ZoneTables(*(SCHEMAS[name].empty_table() for name in TABLES)))
    lines: list[tuple[str, str]] = field(default_factory=list)
    """Head and words for each zone, and of what Nav2 did."""
    worst: list[tuple[str, str]] = field(default_factory=list)
    """Those of the worst events."""
    look: tuple[str, float] | None = None
    """Topic and time [s] of the sweep that shows the worst event."""
    acts: Sequence[Act] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values, with what a check may name."""
        figures = figures_of(zones_in({0: self.tables}))
        own = {
            "figures": {name: plain_number(figures[name]) for name in figures},
            "nav2": [act._asdict() for act in self.acts],
        }
        return RunSummary.as_dict(self) | own


def watch(
    source: Source, options: ZoneOptions, folder: Place | None = None, progress: Progress | None = None
) -> ZoneSummary:
    """Find what is in the zones in every sweep of a log, and write the tables if a folder is given.

    Raises
    ------
    OptionError
        The log is standard input, which is read only once.
    UnreadableError
        The log or its tables cannot be read, or its poses contradict its sweeps while a zone is in the world.
    NoScanError
        The log has no LaserScan topic, or not the one that a zone names; or nothing leads to the frame of a zone.
    OutputError
        A file cannot be written.
    """
    if source.is_stdin:
        raise OptionError("zones are watched by reading the log twice; give the name of its file instead of -")
    paths = None if folder is None else options.outputs(source, folder)
    if paths is not None:
        refuse(paths.values(), options.overwrite, options.inputs([source]))
    with ExitStack() as stack:
        first: Reading | None = None
        parameters = options.as_dict()
        pair = None if options.objects is None else tables_together(options.objects)
        finds = pair is None and options.find
        with open_source(source, options.detect.opening) as log:
            options = narrowed(log, options)
            read = options.detect.read
            masking = masking_of(log, read.rules, options.detect.poses, read.topics)
            finding = masked(log, options, masking) if finds else options.detect
        if finds:
            private = stack.enter_context(scratch_folder())
            pair, first = detect_to_temporary(source, private, finding, progress)
            progress = second_half(progress, source.size)
        log = stack.enter_context(open_source(source, options.detect.opening))
        reader = ZoneReader(log, options, pair, masking, first)
        found, by_zone, described = reader.run(source, progress)
        summary = ZoneSummary(**{name: getattr(found, name) for name in RunSummary.__dataclass_fields__})
        if first is not None:
            # Both passes tell of the same damage; the first one also of what it found.
            summary.damage = [*dict.fromkeys([*first.summary.damage, *summary.damage])]
            summary.notes = [*dict.fromkeys([*masking.notes, *first.summary.notes, *summary.notes])]
        metadata = table_metadata(parameters, described, summary.damage)
        tables = _tables(source.name, by_zone, metadata)
        summary.tables = tables
        names = _names(by_zone)
        longest = max(map(len, names))
        summary.lines = [(f"  {name:<{longest}}  ", _words(each)) for name, each in zip(names, by_zone, strict=True)]
        worst = _worst_first(by_zone)
        summary.look = worst[0]["look"] if worst else None
        summary.acts = [*reader.acts, *(missed_stops(reader.acts, by_zone) if reader.acts else [])]
        summary.worst = _worst_lines(worst)
        summary.lines += lines_of(summary.acts, summary.first_ns or 0)
        summary.notes += [*options.zones.notes, *_stale(by_zone, bool(options.zones.robot))]
        if pair is not None and options.objects is not None:
            summary.notes += other_recording(pair, described.get("recording", {}))
        if options.objects is not None and options.zones.masks.masks:
            hidden = "masks of the zone file hide beams, but no objects of --objects"
            summary.notes.append(f"{hidden}: give --mask where these are made, too")
        if paths is not None:
            files = stack.enter_context(TableFiles(paths, None, options.overwrite, options.detect.stamps))
            for name, table in tables._asdict().items():
                for batch in table.to_batches():
                    files.write(name, "", batch)
            summary.notes += files.publish(metadata)
            summary.outputs = [str(path) for path in files.paths]
        if options.clips is not None:
            # Most runs cut nothing, and should not wait for this import.
            from lidarcli.pipeline.cleaning import CleanOptions, clean_log

            held = HeldTable(f"the events of {source.label}", tables.events)
            detect = replace(options.detect, read=replace(read, start=None, end=None, run=None, every=1))
            cutting = CleanOptions(detect, frozenset(), overwrite=options.overwrite, clips=held, around=options.around)
            clips = clean_log(source, options.clips, cutting)
            summary.notes, summary.outputs = summary.notes + clips.notes, summary.outputs + clips.outputs
    return summary


def watch_files(
    sources: Sequence[Source | MissingInput], folder: Place | None, options: ZoneOptions, report: LogProgress | None = None
) -> Iterator[Outcome]:
    """Watch the zones in every log, one after the other or several at the same time."""
    at_once = logs_at_once(sources, options.detect.jobs or options.detect.cores)
    if at_once > 1:
        detect = options.detect
        detect = replace(detect, jobs=detect.jobs // at_once, cores=detect.cores // at_once)
        options = replace(options, detect=detect)

    return over_logs(sources, partial(watch, options=options, folder=folder), report, at_once)


def refuse_outputs(
    sources: Sequence[Source | MissingInput], folder: Place | None, options: ZoneOptions, more: Sequence[Place] = ()
) -> list[str]:
    """Return the files that are written, `more` besides, after refusing those that cannot be, before any work."""
    logs = [source for source in sources if isinstance(source, Source)]
    paths = [path for source in logs if folder is not None for path in options.outputs(source, folder).values()]
    paths += more
    refuse(paths, options.overwrite, options.inputs(sources))
    return [*map(str, paths)]


def understand(options: ZoneOptions, expressions: Sequence[str]) -> list[Check]:
    """Parse checks of zones, or raise a usage error."""
    return [parse_zone_check(each, [zone.name for zone in options.zones.zones]) for each in expressions]


def judge(
    checks: Sequence[Check], tables: Sequence[ZoneTables]
) -> tuple[list[Verdict], tuple[str, ...], dict[str, float | None]]:
    """Return the verdicts on all logs, a line for each zone that was not observed all the time, and the figures."""
    if not tables:
        return [verdict_of(check, None) for check in checks], (), {}
    rows = zones_in(dict(enumerate(tables)))
    figures = figures_of(rows)
    return [judge_zones(check, figures, rows) for check in checks], unobserved(checks, rows), figures


def write_verdicts(path: Place, overwrite: bool, *told: Any) -> list[str]:
    """Write what was `told` to `as_junit` to a file; returns notes."""
    return write_whole(path, as_junit("zones", *told).encode(), overwrite)


def _tables(log: str, by_zone: Sequence[ZoneEvents], metadata: dict[bytes, bytes]) -> ZoneTables:
    """Return the tables of a log."""
    events = [event for each in by_zone for event in each.events]
    order = sorted(range(len(events)), key=lambda at: (events[at]["start"], at))
    rows = [events[at] | {"log": log, "event": number} for number, at in enumerate(order, 1)]
    schema = SCHEMAS["events"]
    found = pa.table([pa.array([row.get(one.name) for row in rows], one.type) for one in schema], schema)
    pieces = [_zone_rows(log, each) for each in by_zone]
    zones = pa.Table.from_batches(pieces, SCHEMAS["zones"]).unify_dictionaries()
    if zones.num_rows:
        # By topic and sweep; zones of one sweep in the order of the file.
        topics = np.concatenate([np.array([one.topic for one in each.topics])[each.topic] for each in by_zone])
        zones = zones.take(pa.array(np.lexsort((np.asarray(zones["sweep"]), topics))))
    return ZoneTables(*(table.replace_schema_metadata(metadata) for table in (found, zones)))


def _zone_rows(log: str, one: ZoneEvents) -> pa.RecordBatch:
    count = len(one.topic)
    columns: dict[str, Any] = {
        "log": constant(log, count),
        "topic": codes(one.topic.astype(np.int32), tuple(each.topic for each in one.topics)),
        "zone": constant(one.zone.name, count),
    }
    columns |= {name: values for name, values in one.columns.items() if values is not None}
    columns |= {name: answers(columns[name].astype(np.int8)) for name in ("active", "observed")}
    return FORMS["zones"].fill(columns, None, count)


def _names(by_zone: Sequence[ZoneEvents]) -> list[str]:
    """Return a name for each zone, with its topic, or also its frame, where several sensors see one of their own."""
    several = len({each.topics[0].run for each in by_zone}) > 1
    plain = [f"{each.zone.name}, run {each.topics[0].run}" if several else each.zone.name for each in by_zone]
    names = [
        name if plain.count(name) == 1 else f"{name} ({each.topics[0].topic})"
        for name, each in zip(plain, by_zone, strict=True)
    ]
    return [
        name if names.count(name) == 1 else f"{name} ({each.topics[0].frame_id})"
        for name, each in zip(names, by_zone, strict=True)
    ]


def _words(one: ZoneEvents) -> str:
    """Return what was in a zone, for people."""
    zone, events = one.zone, one.events
    columns = one.columns
    observed = columns["observed"]
    assert observed is not None
    if not one.in_force:
        return "none of its polygons covers the velocity"
    if not observed.any():
        return NEVER
    if isinstance(zone.shape, Line):
        counts = [sum(event.get("direction") == direction for event in events) for direction in DIRECTIONS]
        missed = f"; {one.one_sided} seen on one side only" if one.one_sided else ""
        missed += f"; {one.unseen} out of sight, not counted" if one.unseen else ""
        if one.one_sided is None:
            return "no tracks"
        return f"in {counts[0]}, out {counts[1]}{missed}"
    alarms = [event for event in events if event["kind"] in EVENT_KINDS[:2]]
    stamps, away = columns["stamp"], columns["nearest"]
    assert stamps is not None
    assert away is not None
    span = (int(stamps.max()) - int(stamps.min())) * 1e-9
    active = sum(event["duration"] for event in alarms)
    parts = [f"{counted(len(alarms), 'event')}, {active:.1f} s of {span:.1f} s"]
    if np.isfinite(away).any():
        # Of all sweeps, as checks and reports have it: too few points for an event may be nearer.
        parts.append(f"nearest {np.nanmin(away):.2f} m")
    ttc = min((event["ttc"] for event in alarms if event["ttc"] is not None), default=None)
    if ttc is not None:
        parts.append(f"least time to collision {ttc:.1f} s")
    causes = by_words({letter: sum(event["set"] == letter for event in alarms) for letter in WHO})
    words = "; ".join(filter(None, [", ".join(parts), causes]))
    if visits := sum(event["kind"] == "visit" for event in events):
        words += f"; {counted(visits, 'visit')}"
    return words


WORST = 5
"""Most events of which there is a line."""


def _worst_first(by_zone: Sequence[ZoneEvents]) -> list[dict[str, Any]]:
    """Return the times at which zones were occupied, those that stop first and then the nearest; else the crossings."""
    events = [event for each in by_zone for event in each.events]
    alarms = [event for event in events if event["kind"] in EVENT_KINDS[:2]]
    if not alarms:
        return sorted((event for event in events if "direction" in event), key=lambda event: float(event["start"]))
    return sorted(alarms, key=lambda one: (one["action"] != "stop", one["nearest"] is None, one["nearest"]))


def _worst_lines(worst: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return heads and words on the worst events, as many as there are lines for."""
    width = max((len(event["zone"]) for event in worst[:WORST]), default=4)
    lines = [("  worst    ", f"{'at':>10}  {'zone':{width}}     lasts  nearest  by")] if worst else []
    for event in worst[:WORST]:
        who = (WHO.get(event["set"], "").removesuffix("s"), event["track"], event["label"], event.get("direction"))
        nearest = " " * 7 if event["nearest"] is None else f"{event['nearest']:5.2f} m"
        words = f"{event['t']:8.1f} s  {event['zone']:{width}}  {event['duration']:6.1f} s  {nearest}  "
        lines.append((" " * 11, words + " ".join(str(part) for part in who if part)))
    return lines + ([(" " * 11, f"and {len(worst) - WORST:,} more")] if len(worst) > WORST else [])


def _stale(by_zone: Sequence[ZoneEvents], is_nav2: bool) -> list[str]:
    """Return a line for each topic that told nothing for too long, be it in one zone or in several."""
    begins: dict[tuple[str, float], set[float]] = {}
    for each in by_zone:
        for event in (event for event in each.events if event["kind"] == EVENT_KINDS[-1]):
            begins.setdefault((event["topic"], each.zone.timeout), set()).add(event["t"])
    why = ": Nav2 stops the robot then (invalid source)" if is_nav2 else ""
    return [
        f"{topic}: no sweep for over {timeout:g} s, {times(len(stale))} from {min(stale):.1f} s on{why}"
        for (topic, timeout), stale in begins.items()
    ]
