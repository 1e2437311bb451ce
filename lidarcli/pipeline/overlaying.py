"""Objects and tracks of a log as a file that viewers play in step with it."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse, writing
from lidarcli.files.stores import Place
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, POSE_TYPES, SCAN_TYPES, Log, ReadReport
from lidarcli.logs.batches import Checksum
from lidarcli.logs.clock import mended
from lidarcli.maps.grids import MAP_TYPE, image_of, occupancy_cdr, read_map
from lidarcli.options.choices import MATCH
from lidarcli.overlays.markers import LAST_SECOND, MARKER_TYPE, SECOND, Markers, marker_arrays, transforms
from lidarcli.overlays.objects import COLUMNS, PATH_COLUMNS, Poses, Trajectories, is_mirrored, markers_of, paths_of, zone_of
from lidarcli.overlays.viewers import (
    BAG,
    FRAME,
    LAYOUT,
    MAP,
    RRD,
    RVIZ,
    SUFFIXES,
    Scene,
    layout_json,
    overlay_file,
    rviz_config,
    topic_name,
    topics_of_objects,
)
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, one_table_set, other_recording, poses_of, tables_together, world_in
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, damage_lines, opening_of, rules_of
from lidarcli.pipeline.zone_counting import Frames, Objects, Showing
from lidarcli.pose.messages import TRANSFORMS
from lidarcli.ros.messages import ROS2, SCAN, TF, Outgoing, cdr_scans, ros1_scans
from lidarcli.sweeps.range_rules import normalise
from lidarcli.sweeps.types import Bool, Int64, RawSweeps, SweepPoses
from lidarcli.sweeps.zone import Zones
from lidarcli.tabular.columns import COARSE, integers, numbers, plain
from lidarcli.tabular.reading import AGAIN, TopicRows, file_metadata, note_value, read_columns
from lidarcli.tabular.schemas import SCHEMAS
from lidarcli.tabular.writing import PARAMETERS, SOURCE

if TYPE_CHECKING:
    from lidarcli.overlays.rrd import Recording

MAP_Z = -0.05
"""Height of the map [m]: where the sensor is at 0, the beams lie on it, and are not in it."""
DEFAULT_WORLD = "map"
RECORDED = attrgetter("record_ns")
WINDOW = 4096
"""Messages that are sorted at a time: more than come of one topic at a stretch."""
ROS = ("cdr", "ros1")
"""Encodings of messages that can be copied; others are written anew."""
SLICED = "sliced"
"""Stands for an encoding where sweeps are made of point clouds, which no message of the log holds."""
_OLD_TF = "tf/msg/tfMessage"
_SWEEP_COLUMNS = ("topic", "sweep", "stamp", "pose_x", "pose_y", "pose_yaw")


@dataclass(frozen=True, slots=True)
class OverlayOptions:
    """Options of `overlay`, apart from input and output."""

    detect: DetectOptions
    """Options of detection and tracking, where no tables are given."""
    objects: str | None = None
    """The objects table of the log, where there is one."""
    with_log: bool = False
    """Copy scans and poses, too."""
    map: Path | None = None
    """A map (YAML) to show."""
    zones: Zones | None = None
    """Zones to show."""
    layout: bool = True
    """Write settings of viewers beside the file."""
    overwrite: bool = False


def outputs_of(path: Place, options: OverlayOptions) -> tuple[Place, ...]:
    """Return all files that are written; what an .rrd shows first is in it."""
    settings = (LAYOUT, RVIZ) if options.layout and path.suffix.lower() != RRD else ()
    return (path, *(path.with_suffix(suffix) for suffix in settings))


def refuse_overlay(path: Place, source: Source, options: OverlayOptions) -> None:
    """Refuse outputs that cannot be written, and inputs that are not there, before any work.

    Raises
    ------
    OptionError
        The suffix is none of `SUFFIXES`, the log is standard input, or rerun-sdk is missing for an .rrd.
    OutputError
        As of `newfiles.refuse`.
    UnreadableError
        There are no such tables, or there is no such map.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise OptionError(f"{path}: the suffix of an overlay has to be one of {', '.join(SUFFIXES)}")
    if source.is_stdin:
        raise OptionError("an overlay is made by reading the log twice; give the name of its file instead of -")
    if path.suffix.lower() == RRD:
        # It refuses to be imported without rerun, which is an extra.
        import lidarcli.overlays.rrd  # noqa: F401
    inputs = options.detect.inputs([source])
    if options.objects is not None:
        pair = one_table_set(options.objects)
        inputs += [str(pair.objects), str(pair.sweeps)]
    if options.map is not None:
        inputs += [str(options.map), str(image_of(options.map))]
    refuse(outputs_of(path, options), options.overwrite, inputs)


def write_overlay(source: Source, path: Place, options: OverlayOptions, progress: Progress | None = None) -> RunSummary:
    """Write the overlay of one log, and beside it the settings of viewers.

    Raises
    ------
    UnreadableError
        The log, its tables or the map cannot be read, or the tables are those of another log.
    NoScanError
        The log has no LaserScan topic, or not the one that was asked for.
    OutputError
        A file cannot be written.
    """
    grid = None if options.map is None else read_map(options.map)
    paths = outputs_of(path, options)
    with ExitStack() as stack:
        new = stack.enter_context(NewFiles(paths, options.overwrite))
        if options.objects is not None:
            pair, found = tables_together(options.objects), None
        else:
            pair, first = detect_to_temporary(source, new.part(path).with_name("tables"), options.detect, progress)
            found = first.summary
            progress = second_half(progress, source.size)
        is_ros2 = path.suffix.lower() != BAG
        work = Overlay(source, pair, grid, options, is_ros2)
        with writing(path, nameless=True):
            if path.suffix.lower() == RRD:
                work.record(new.part(path), stack, progress)
            else:
                file = overlay_file(new.part(path))
                stack.callback(file.abandon)
                for message in work.messages(stack, progress):
                    file.write(message)
                file.finish()
            if len(paths) > 1:
                new.part(paths[1]).write_bytes(layout_json(work.scene()))
                new.part(paths[2]).write_bytes(rviz_config(work.scene(), is_ros2=is_ros2))
        summary = work.summary(found)
        summary.notes += [*([grid.note] if grid and grid.note else []), *new.publish()]
    summary.outputs = [str(each) for each in paths]
    return summary


class Overlay:
    """Messages of one overlay: those of the log that are copied, and the markers of its objects."""

    def __init__(
        self, source: Source, pair: TableSet, grid: Occupancy | None, options: OverlayOptions, is_ros2: bool
    ) -> None:
        """Take what is to be shown; `is_ros2`: for ROS 2, else for ROS 1."""
        self._source, self._grid, self._options = source, grid, options
        # Sweeps are to be made again as they were for the tables.
        notes, opening = file_metadata(pair.sweeps), options.detect.opening
        then = opening_of(note_value(notes, PARAMETERS, dict))
        self._opening = replace(opening, slice=opening.slice or then.slice, echo=then.echo, segments=then.segments)
        self._showing: Showing | None = None
        described = note_value(notes, SOURCE, dict)
        mask = described.get("mask")
        self._rules = rules_of(note_value(notes, PARAMETERS, dict), mask if isinstance(mask, dict) else None)
        self._is_ros2 = is_ros2
        self._tables = Tables(pair)
        self._copies = Copies(frozenset(self._tables.topics), is_ros2)
        self._names = topics_of_objects(self._tables.topics)
        self._pose_sources = poses_of(described)
        """Sensor frame → the description of its poses."""
        self._pose_frames = {
            frame: (str(poses.get("fixed_frame", poses["world"])), str(poses.get("topic")))
            for frame, poses in self._pose_sources.items()
            # No viewer tells frames of several robots apart that have one name.
            if isinstance(poses["world"], str) and poses["world"] not in ("", MATCH)
        }
        """Sensor frame → the fixed frame and the topic of its poses; no viewer knows the world of a matched path."""
        self._worlds = {frame: world for frame, (world, _) in self._pose_frames.items()}
        """Sensor frame → the fixed frame, where poses are known."""
        self._report, self._copied = ReadReport(), ReadReport()
        self._sweeps = 0
        self._encodings: dict[str, str] = {}
        self._frames: dict[str, str] = {}
        """Frames of the sweeps in the order in which they come, as they are written → as the log has them."""
        self._placed: set[str] = set()
        """Frames of the log whose place in the world a viewer learns."""
        self._to_place: set[str] = set()
        """Those of them whose place only this file tells."""
        self._placing: set[str] = set()
        """Frames whose place this file has told."""
        self._hangs: dict[tuple[str, str], bool] = {}
        """Topic and frame of a sensor → True where it hangs head down, as far as its objects have shown."""
        self._frame_of: dict[str, str] = {}
        """Topic → the frame of its first sweep, as the log has it."""
        self._lost = 0
        """Sweeps that are not drawn, for they have no pose."""
        self._notes: list[str] = []

    def messages(self, stack: ExitStack, progress: Progress | None) -> Iterator[Outgoing]:
        """Yield all messages in the order in which they are to be played."""
        log = self._open(stack)
        self._encodings = scan_encodings(log)
        transforming = transform_topics(log, of_ros=self._options.with_log)
        self._placed = {frame for frame, (_, topic) in self._pose_frames.items() if topic in transforming}
        others = self._worlds.keys() - self._placed
        if self._options.with_log and others:
            # A frame has one parent: where the log tells of one, another would tear the tree apart.
            self._to_place = others - frames_in_transforms(log, others)
            self._placed |= self._to_place
        drawn = self._drawn(log, progress)
        if len(self._tables.topics) > 1:
            drawn = in_order(drawn)
        everything = drawn
        if self._options.with_log:
            # Both passes go on at the same time, and each needs a log of its own.
            other = stack.enter_context(open_source(self._source, self._opening))
            everything = heapq.merge(self._copies.of(other, self._copied), drawn, key=RECORDED)
        first = next(everything, None)
        if self._grid is not None:
            yield self._map(self._grid, 0 if first is None else first.record_ns)
        if first is not None:
            yield first
        yield from everything

    def record(self, path: Path, stack: ExitStack, progress: Progress | None) -> None:
        """Write a recording of rerun: sweeps and objects at the poses of the tables, whatever tells them."""
        from lidarcli.overlays.rrd import Recording

        log = self._open(stack)
        file = Recording(path)
        stack.callback(file.abandon)
        for joined in self._tables.join(log, self._report):
            self._sweeps += len(joined.raw)
            for frame, mine in joined.by_frame():
                self._frame_of.setdefault(mine.raw.topic, frame)
                self._draw(file, frame, mine)
            if progress is not None:
                progress(log.position)
        hidden = [*self._hidden()]
        if self._tables.is_posed:
            if self._grid is not None:
                file.add_map(self._grid, MAP_Z)
        else:
            hidden += self._apart(hidden)
        if self._lost:
            self._notes.append(f"{self._lost:,} sweeps are not drawn, for they have no pose")
        file.finish(hidden)

    def scene(self) -> Scene:
        """Return the settings of viewers; known when all messages have been written."""
        fixed, frame = next(iter(self._frames.items()), (FRAME, FRAME))
        if frame in self._placed:
            fixed = self._worlds[frame]
        if self._grid is not None and self._worlds:
            fixed = self._world
        hidden = self._hidden()
        return Scene(
            fixed,
            tuple(self._names.values()),
            tuple(self._scan_topic(topic) for topic in self._tables.topics),
            None if self._grid is None else MAP,
            frozenset(name for topic in hidden for name in (self._names[topic], self._scan_topic(topic))),
        )

    def summary(self, found: RunSummary | None) -> RunSummary:
        """Return the summary of the run; `found`: of the tables, if this run made them."""
        if found is not None:
            summary = replace(found, sweeps=self._sweeps)
        else:
            left = self._tables.left()
            if left:
                self._report.add_damage("the end", f"{left:,} sweeps of the tables are not in the log")
            summary = RunSummary(sweeps=self._sweeps, topics=set(self._tables.topics))
            summary.damage = damage_lines(self._report)
            summary.notes = [*self._report.notes, *self._tables.notes()]
        summary.damage += [line for line in damage_lines(self._copied) if line not in summary.damage]
        summary.notes += self._copies.notes()
        summary.notes += [] if self._showing is None else self._showing.notes()
        if self._placing:
            frames = ", ".join(sorted(self._placing))
            summary.notes.append(f"transforms of {frames} are written by its poses, for no transforms of ROS tell of it")
        summary.notes += [
            f"{topic} is {why}, and is hidden at first; --topic takes one alone" for topic, why in self._hidden().items()
        ]
        summary.notes += self._notes
        if self._grid is not None and self._frames and not self._worlds:
            summary.notes.append(
                f"the map is in frame {self._world}, and nothing tells where the sensor is in it: a viewer shows one "
                "of the two; give --pose or --poses"
            )
        slashed = sorted(frame for frame in self._frames if frame.startswith("/"))
        if slashed and self._is_ros2:
            summary.notes.append(
                f"frame {slashed[0]} begins with a slash, and RViz of ROS 2 draws nothing in it; write a .bag for ROS 1"
            )
        if "" in self._frames:
            summary.notes.append("the scans name no frame, and RViz draws nothing without one")
        return summary

    @property
    def _world(self) -> str:
        return next((self._worlds[frame] for frame in self._frames.values() if frame in self._worlds), DEFAULT_WORLD)

    def _open(self, stack: ExitStack) -> Log:
        """Open the log, and make ready to show zones."""
        if (zones := self._options.zones) is not None:
            # Transforms are read by a pass of their own.
            other = stack.enter_context(open_source(self._source, self._opening))
            self._showing = Showing(zones, Frames.of(other, zones))
        return stack.enter_context(open_source(self._source, self._opening))

    def _hidden(self) -> dict[str, str]:
        """Return the topics that viewers hide at first, and why: others before them are seen in their place."""
        first: dict[str, str] = {}
        hidden = {}
        shown = ""
        for topic in self._tables.topics:
            frame = self._frame_of.get(topic, "")
            world = world_in(self._pose_sources.get(frame, {}), topic)
            shown = shown or world
            if world and world != shown:
                hidden[topic] = f"in the frame {world}, not in {shown}"
            elif frame and first.setdefault(frame, topic) != topic:
                hidden[topic] = f"of frame {frame}, as {first[frame]} is"
        return hidden

    def _apart(self, hidden: Collection[str]) -> list[str]:
        """Return the topics that cannot be drawn beside the first one without poses, and note what is not shown."""
        if self._grid is not None:
            self._notes.append("the map is left out, for nothing tells where the sensor is in it; give --pose or --poses")
        first, *others = self._tables.topics or ("",)
        apart = [topic for topic in others if topic not in hidden]
        self._notes += [
            f"nothing tells where the sensor of {topic} is beside that of {first}: it is hidden at first" for topic in apart
        ]
        return apart

    def _drawn(self, log: Log, progress: Progress | None) -> Iterator[Outgoing]:
        """Yield the markers of all sweeps, and scans of the log that have to be written anew."""
        for joined in self._tables.join(log, self._report):
            raw = joined.raw
            self._sweeps += len(raw)
            anew = self._encodings.get(raw.topic) not in ROS
            parts: list[Iterator[Outgoing]] = []
            if self._options.with_log and anew:
                named = tuple(name or FRAME for name in raw.frame_ids)
                parts.append(self._copies.written_anew(replace(raw, frame_ids=named)))
            for frame, mine in joined.by_frame():
                name = frame or FRAME if anew else frame
                self._frames.setdefault(name, frame)
                self._frame_of.setdefault(raw.topic, frame)
                if frame in self._to_place:
                    parts.append(self._poses(name, frame, mine))
                data = marker_arrays(mine.raw.time_ns, name, self._groups(name, mine), cdr=self._is_ros2)
                parts.append(of_sweeps(self._names[raw.topic], MARKER_TYPE, mine.raw, data))
            # Of equal times the scan comes first, and what is drawn on it last.
            yield from sorted(chain(*parts), key=RECORDED) if len(parts) > 1 else parts[0]
            if progress is not None:
                progress(log.position)

    def _draw(self, file: Recording, frame: str, joined: TabledSweeps) -> None:
        """Draw some sweeps of one frame into a recording."""
        poses = None
        if self._tables.is_posed:
            known = np.isfinite(joined.poses.yaw)
            self._lost += int(np.count_nonzero(~known))
            if not known.any():
                return
            joined = joined if known.all() else joined.rows(known)
            poses = self._sensor_poses(joined, frame)
        batch = normalise(joined.raw, joined.index, self._rules)
        file.add(replace(batch, poses=poses), self._groups(frame, joined))

    def _groups(self, frame: str, joined: TabledSweeps) -> list[Markers]:
        """Return the markers of some sweeps of one frame."""
        groups = markers_of(joined.objects, joined.row, joined.poses)
        if (known := self._tables.trajectories(joined.raw.topic)) is not None:
            hangs = self._hanging(joined, frame)
            groups += paths_of(known, joined.index, joined.poses, hangs)
        if self._showing is not None:
            groups += self._outlines(self._showing, joined, frame)
        return groups

    def _outlines(self, showing: Showing, joined: TabledSweeps, frame: str) -> list[Markers]:
        """Return the outlines of the zones in some sweeps of one frame."""
        batch = normalise(joined.raw, joined.index, self._rules)
        poses = self._sensor_poses(joined, frame) if np.isfinite(joined.poses.x).any() else None
        objects = Objects.of(joined.objects, batch)
        owners = objects.owners(batch)
        rest = np.uint8(SETS.index("S"))
        sets = np.append(objects.set, rest)[np.where(owners < 0, len(objects.set), owners)]
        return [
            zone_of(number, one.zone.action, one.corners, one.occupied)
            for number, one in enumerate(showing.of(replace(batch, poses=poses), sets), 1)
        ]

    def _sensor_poses(self, joined: TabledSweeps, frame: str) -> SweepPoses:
        here = joined.poses
        return SweepPoses(here.x, here.y, here.yaw, np.full(len(here.x), self._hanging(joined, frame)))

    def _hanging(self, joined: TabledSweeps, frame: str) -> bool:
        """Return whether a sensor hangs head down, as far as its objects have shown."""
        key = joined.raw.topic, frame
        if joined.objects.num_rows:
            self._hangs[key] = bool(np.mean(is_mirrored(joined.objects, joined.row, joined.poses)) > 0.5)
        return self._hangs.get(key, False)

    def _poses(self, name: str, frame: str, joined: TabledSweeps) -> Iterator[Outgoing]:
        """Yield the poses of the sensor as transforms, for a log without transforms that viewers know."""
        known = np.isfinite(joined.poses.yaw)
        if not known.any():
            return iter(())
        self._placing.add(name)
        raw, poses = joined.raw.rows(known), self._sensor_poses(joined, frame)
        pose = np.column_stack([poses.x, poses.y, poses.yaw])[known]
        data = transforms(raw.time_ns, self._worlds[frame], name, pose, poses.upside_down[known], cdr=self._is_ros2)
        return of_sweeps("/tf", TF, raw, data)

    def _scan_topic(self, topic: str) -> str:
        return topic if self._encodings.get(topic) in ROS else topic_name(topic)

    def _map(self, grid: Occupancy, record_ns: int) -> Outgoing:
        """Return the map, stamped as the first message, so that players show it at once."""
        stamp_ns = min(max(record_ns, 0), LAST_SECOND * SECOND)
        data = occupancy_cdr(replace(grid, frame_id=self._world), stamp_ns, MAP_Z)
        if not self._is_ros2:
            data = bytes(ROS2.cdr_to_ros1(data, MAP_TYPE))
        return Outgoing(MAP, MAP_TYPE, record_ns, stamp_ns, data)


def scan_encodings(log: Log) -> dict[str, str]:
    """Return the encoding of each topic of sweeps; a log without an index is read once for it."""
    topics = log.topics()
    if topics is not None:
        return {one.name: one.encoding if one.type in SCAN_TYPES else SLICED for one in topics if one.is_scan}
    return {message.topic: message.encoding for message in log.messages(SCAN_TYPES, ReadReport())}


def transform_topics(log: Log, *, of_ros: bool) -> frozenset[str]:
    """Return the topics of transforms, all or those that can be copied; of a log without an index those that ROS uses."""
    topics = log.topics()
    if topics is None:
        return frozenset({"/tf", "/tf_static"})
    transforming = [topic for topic in topics if topic.type in TRANSFORMS]
    return frozenset(topic.name for topic in transforming if topic.encoding in ROS or not of_ros)


def frames_in_transforms(log: Log, frames: Collection[str]) -> set[str]:
    """Return those of the frames that transforms of the log name."""
    names: dict[str, tuple[bytes, bytes]] = {}
    for frame in frames:
        # As ROS 1 and ROS 2 write it; old transforms have no leading slash.
        name = frame.removeprefix("/").encode()
        names[frame] = len(name).to_bytes(4, "little") + name, (len(name) + 1).to_bytes(4, "little") + name + b"\0"
    found: set[str] = set()
    for message in log.messages(TRANSFORMS, ReadReport()):
        if message.encoding not in ROS:
            continue
        found |= {frame for frame, forms in names.items() if any(form in message.data for form in forms)}
        if len(found) == len(names):
            break
    return found


class Copies:
    """Copies messages of a log, and counts those that cannot be copied."""

    def __init__(self, topics: Collection[str], is_ros2: bool) -> None:
        """`topics`: those of the sweeps that are wanted; `is_ros2`: whether for ROS 2, else for ROS 1."""
        self._topics = topics
        self._is_ros2 = is_ros2
        self._left_out: Counter[tuple[str, str]] = Counter()

    def of(self, log: Log, report: ReadReport) -> Iterator[Outgoing]:
        """Yield scans, transforms, odometry and poses in log order."""
        convert = ROS2.ros1_to_cdr if self._is_ros2 else ROS2.cdr_to_ros1
        for message in log.messages({LASERSCAN, MULTI_ECHO} | POSE_TYPES, report):
            if message.type in SCAN_TYPES and message.topic not in self._topics:
                continue
            if message.encoding not in ROS:
                if message.type in POSE_TYPES:
                    self._left_out[message.topic, message.type] += 1
                continue
            kind = TF if message.type == _OLD_TF else message.type
            try:
                is_alike = (message.encoding == "cdr") == self._is_ros2
                data = message.data if is_alike else bytes(convert(message.data, kind))
            # The library raises errors of many kinds for messages that are not what they say.
            except Exception:
                report.refused[message.topic, f"its {kind} cannot be copied: it is damaged"] += 1
                continue
            yield Outgoing(message.topic, kind, message.record_ns, message.record_ns, data)

    def written_anew(self, raw: RawSweeps) -> Iterator[Outgoing]:
        """Yield sweeps of a log that is not of ROS, as LaserScan."""
        data = cdr_scans(raw) if self._is_ros2 else ros1_scans(raw)
        return of_sweeps(topic_name(raw.topic), SCAN, raw, data)

    def notes(self) -> list[str]:
        """Return a line for each topic that was left out."""
        return [
            f"{topic} ({kind}) is not copied: {number:,} messages that are not of ROS"
            for (topic, kind), number in sorted(self._left_out.items())
        ]


def of_sweeps(topic: str, kind: str, raw: RawSweeps, data: Sequence[bytes]) -> Iterator[Outgoing]:
    """Yield a message for each of some sweeps, recorded when the sweep was."""
    times = raw.record_ns.tolist()
    # Header stamps may go back where record times do not, and a file of messages has one order.
    return (Outgoing(topic, kind, at, at, one) for at, one in zip(times, data, strict=True))


def in_order(messages: Iterable[Outgoing]) -> Iterator[Outgoing]:
    """Yield messages by record time, within a window of `WINDOW` messages; equal times keep their order."""
    heap: list[tuple[int, int, Outgoing]] = []
    for number, message in enumerate(messages):
        heapq.heappush(heap, (message.record_ns, number, message))
        if len(heap) > WINDOW:
            yield heapq.heappop(heap)[2]
    yield from (message for _, _, message in sorted(heap))


@dataclass(frozen=True, slots=True)
class TabledSweeps:
    """Some sweeps of one topic that the tables know, and their objects."""

    raw: RawSweeps
    """S sweeps."""
    poses: Poses
    """S poses."""
    objects: pa.RecordBatch
    """N rows."""
    row: Int64
    """(N,) index of the sweep of each object, ascending."""
    index: Int64
    """(S,) index of each sweep in the log."""

    def by_frame(self) -> Iterator[tuple[str, TabledSweeps]]:
        """Yield each frame with its sweeps."""
        codes = np.unique(self.raw.frame).tolist()
        for code in codes:
            yield self.raw.frame_ids[code], self if len(codes) == 1 else self.rows(self.raw.frame == code)

    def rows(self, mine: Bool) -> TabledSweeps:
        """Return some of the sweeps."""
        poses = Poses(self.poses.x[mine], self.poses.y[mine], self.poses.yaw[mine])
        its = mine[self.row]
        place = np.cumsum(mine) - 1
        objects = self.objects.take(plain(np.flatnonzero(its)))
        return TabledSweeps(self.raw.rows(mine), poses, objects, place[self.row[its]], self.index[mine])


class Tables:
    """The sweeps and objects tables of one log, from which rows are taken as its sweeps come by."""

    def __init__(self, pair: TableSet) -> None:
        self._pair = pair
        columns = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ["topic", "pose_x"])
        self.topics: tuple[str, ...] = tuple(sorted(columns["topic"].unique().to_pylist()))
        self.is_posed = columns["pose_x"].null_count < columns.num_rows
        """True where some sweep has a pose."""
        self._cursors: dict[str, tuple[TopicRows, TopicRows]] = {}
        self._met: dict[str, Checksum] = {}
        self._trajectories: dict[str, Trajectories] = {}

    def join(self, log: Log, report: ReadReport) -> Iterator[TabledSweeps]:
        """Yield all sweeps of the log that the tables have, in log order within each topic.

        Raises
        ------
        UnreadableError
            A table cannot be read, or is that of another log.
        """
        if not self.topics:
            return
        for block in mended(log.scans(frozenset(self.topics), report)):
            met = self._met.setdefault(block.topic, Checksum())
            joined = self._join(block, met.count)
            met.add(block)
            if joined is not None:
                yield joined

    def trajectories(self, topic: str) -> Trajectories | None:
        """Return the trajectories of a topic; None where there is no such table."""
        path, schema = self._pair.trajectories, SCHEMAS["trajectories"]
        if topic not in self._trajectories and path.exists():
            self._trajectories[topic] = Trajectories.of(read_columns(path, "trajectories", schema, PATH_COLUMNS), topic)
        return self._trajectories.get(topic)

    def notes(self) -> list[str]:
        """Return what a user should know of them."""
        return other_recording(self._pair, {topic: str(met) for topic, met in self._met.items()})

    def left(self) -> int:
        """Count the sweeps of the tables that the log does not have."""
        return sum(1 for topic in self.topics for rows in self._cursor(topic)[0].rest() for _ in range(rows.num_rows))

    def _join(self, block: RawSweeps, first: int) -> TabledSweeps | None:
        sweeps, objects = (cursor.until(first + len(block)) for cursor in self._cursor(block.topic))
        index = integers(sweeps, "sweep") - first
        if not len(index) and not objects.num_rows:
            return None
        raw = block if len(index) == len(block) else block.rows(index)
        stamps = integers(sweeps, "stamp")
        row = np.searchsorted(index, of := integers(objects, "sweep") - first)
        strays = not np.isin(of, index).all()
        if strays or (np.diff(index) <= 0).any() or (np.abs(raw.time_ns - stamps) >= COARSE).any():
            raise UnreadableError(
                f"{self._pair.sweeps}, {self._pair.objects.name}: not the tables of this log, whose sweeps have other "
                f"stamps; {AGAIN}"
            )
        poses = Poses(*(numbers(sweeps[name]) for name in ("pose_x", "pose_y", "pose_yaw")))
        return TabledSweeps(raw, poses, objects, row, index + first)

    def _cursor(self, topic: str) -> tuple[TopicRows, TopicRows]:
        if topic not in self._cursors:
            self._cursors[topic] = (
                TopicRows(self._pair.sweeps, "sweeps", _SWEEP_COLUMNS, topic),
                TopicRows(self._pair.objects, "objects", COLUMNS, topic),
            )
        return self._cursors[topic]
