"""Objects and tracks of a log as a file that viewers play in step with it."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lidarcli.choices import MATCH
from lidarcli.errors import OptionError
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.maps import MAP_TYPE, image_of, occupancy_cdr, read_map
from lidarcli.newfiles import NewFiles, refuse, writing
from lidarcli.overlays.files import BAG, FRAME, MAP, RRD, SUFFIXES, overlay_file, topic_name, topics_of_objects
from lidarcli.overlays.markers import LAST_SECOND, MARKER_TYPE, SECOND, Markers, marker_arrays, transforms
from lidarcli.overlays.objects import Colours, Trajectories, is_mirrored, markers_of, paths_of, zone_of
from lidarcli.overlays.viewers import LAYOUT, RVIZ, Scene, layout_json, rviz_config
from lidarcli.pipeline.detecting import detect_beside, second_of_two
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, one_table_set, poses_of, world_in
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.pipeline.overlay_sources import (
    Copies,
    Joined,
    Tables,
    frames_told,
    in_order,
    is_ros,
    of_sweeps,
    scan_encodings,
    transform_topics,
)
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, damage_lines, opening_of, rules_of
from lidarcli.pipeline.zone_counting import Objects
from lidarcli.pipeline.zone_frames import Frames, Showing
from lidarcli.range_rules import normalise
from lidarcli.reports.palette import SET_STYLES, SHAPE_COLOURS, ZONE_COLOURS, on_dark
from lidarcli.ros.messages import ROS2, TF, Outgoing
from lidarcli.stores.url import Place
from lidarcli.sweeps import SweepPoses
from lidarcli.tabular.reading import file_metadata, note_value
from lidarcli.tabular.writing import PARAMETERS, SOURCE
from lidarcli.zone import Zones

if TYPE_CHECKING:
    from lidarcli.overlays.rrd import Recording


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
    beside = (LAYOUT, RVIZ) if options.layout and not _is_rrd(path) else ()
    return (path, *(path.with_suffix(suffix) for suffix in beside))


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
    if _is_rrd(path):
        _recording()
    inputs = options.detect.inputs([source])
    if options.objects is not None:
        pair = one_table_set(options.objects)
        inputs += [str(pair.objects), str(pair.sweeps)]
    if options.map is not None:
        inputs += [str(options.map), str(image_of(options.map))]
    refuse(outputs_of(path, options), options.overwrite, inputs)


def _is_rrd(path: Place) -> bool:
    return path.suffix.lower() == RRD


def _recording() -> type[Recording]:
    """Return the type of recordings of rerun, which is an extra.

    Raises
    ------
    OptionError
        It is not installed.
    """
    from lidarcli.overlays.rrd import Recording

    return Recording


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
            pair, found = one_table_set(options.objects), None
        else:
            pair, found = detect_beside(source, new.part(path).with_name("tables"), options.detect, progress)
            progress = second_of_two(progress, source.size)
        is_ros2 = path.suffix.lower() != BAG
        work = Overlay(source, pair, grid, options.detect.opening, is_ros2, options.with_log, options.zones)
        with writing(path, nameless=True):
            if _is_rrd(path):
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
        summary.notes += new.publish()
    summary.outputs = [str(each) for each in paths]
    return summary


COLOURS = Colours(
    {name: on_dark(colour) for name, colour in SHAPE_COLOURS.items()},
    {name: on_dark(colour) for name, (colour, _, _) in SET_STYLES.items()},
    {name: on_dark(colour) for name, colour in ZONE_COLOURS.items()},
)
MAP_Z = -0.05
"""Height of the map [m]: where the sensor is at 0, the beams lie on it, and are not in it."""
DEFAULT_WORLD = "map"
RECORDED = attrgetter("record_ns")


class Overlay:
    """Messages of one overlay: those of the log that are copied, and the markers of its objects."""

    def __init__(
        self,
        source: Source,
        pair: TableSet,
        grid: Occupancy | None,
        opening: OpenOptions,
        is_ros2: bool,
        with_log: bool,
        zones: Zones | None = None,
    ) -> None:
        """`grid`: a map to show; `is_ros2`: whether for ROS 2, else for ROS 1; `with_log`: copy the log, too."""
        self._source = source
        self._grid = grid
        # Sweeps are to be made again as they were for the tables.
        notes = file_metadata(pair.sweeps)
        told = opening_of(note_value(notes, PARAMETERS, dict))
        self._opening = replace(opening, slice=opening.slice or told.slice, echo=told.echo, segments=told.segments)
        self._zones = zones
        self._showing: Showing | None = None
        described = note_value(notes, SOURCE, dict)
        mask = described.get("mask")
        self._rules = rules_of(note_value(notes, PARAMETERS, dict), mask if isinstance(mask, dict) else None)
        self._is_ros2 = is_ros2
        self._with_log = with_log
        self._tables = Tables(pair)
        self._copies = Copies(frozenset(self._tables.topics), is_ros2)
        self._names = topics_of_objects(self._tables.topics)
        self._told = poses_of(described)
        """Sensor frame → the description of its poses."""
        self._ways = {
            frame: (str(way.get("fixed_frame", way["world"])), str(way.get("topic")))
            for frame, way in self._told.items()
            # No viewer tells frames of several robots apart that have one name.
            if isinstance(way["world"], str) and way["world"] not in ("", MATCH)
        }
        """Sensor frame → the fixed frame and the topic of its poses; no viewer knows the world of a matched path."""
        self._worlds = {frame: world for frame, (world, _) in self._ways.items()}
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
        self._trajectories: dict[str, Trajectories | None] = {}
        """Topic → its trajectories, where there are any."""
        self._frame_of: dict[str, str] = {}
        """Topic → the frame of its first sweep, as the log has it."""
        self._lost = 0
        """Sweeps that are not drawn, for they have no pose."""
        self._notes: list[str] = []

    def messages(self, stack: ExitStack, progress: Progress | None) -> Iterator[Outgoing]:
        """Yield all messages in the order in which they are to be played."""
        log = self._open(stack)
        self._encodings = scan_encodings(log)
        transforming = transform_topics(log, of_ros=self._with_log)
        self._placed = {frame for frame, (_, topic) in self._ways.items() if topic in transforming}
        others = self._worlds.keys() - self._placed
        if self._with_log and others:
            # A frame has one parent: where the log tells of one, another would tear the tree apart.
            self._to_place = others - frames_told(log, others)
            self._placed |= self._to_place
        drawn = self._drawn(log, progress)
        if len(self._tables.topics) > 1:
            drawn = in_order(drawn)
        everything = drawn
        if self._with_log:
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
        log = self._open(stack)
        file = _recording()(path)
        stack.callback(file.abandon)
        for joined in self._tables.join(log, self._report):
            self._sweeps += len(joined.raw)
            for told, mine in joined.by_frame():
                self._frame_of.setdefault(mine.raw.topic, told)
                self._draw(file, told, mine)
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
        frame, told = next(iter(self._frames.items()), (FRAME, FRAME))
        if told in self._placed:
            frame = self._worlds[told]
        if self._grid is not None and self._worlds:
            frame = self._world
        hidden = self._hidden()
        return Scene(
            frame,
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
            summary.notes = list(self._report.notes)
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
        return next((self._worlds[told] for told in self._frames.values() if told in self._worlds), DEFAULT_WORLD)

    def _open(self, stack: ExitStack) -> Log:
        """Open the log, and make ready to show zones."""
        if self._zones is not None:
            # Transforms are read by a pass of their own.
            other = stack.enter_context(open_source(self._source, self._opening))
            self._showing = Showing(self._zones, Frames.of(other, self._zones))
        return stack.enter_context(open_source(self._source, self._opening))

    def _hidden(self) -> dict[str, str]:
        """Return the topics that viewers hide at first, and why: others before them are seen in their place."""
        first: dict[str, str] = {}
        hidden = {}
        shown = ""
        for topic in self._tables.topics:
            frame = self._frame_of.get(topic, "")
            world = world_in(self._told.get(frame, {}), topic)
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
            anew = not is_ros(self._encodings.get(raw.topic, ""))
            parts: list[Iterator[Outgoing]] = []
            if self._with_log and anew:
                named = tuple(name or FRAME for name in raw.frame_ids)
                parts.append(self._copies.written_anew(replace(raw, frame_ids=named)))
            for told, mine in joined.by_frame():
                name = told or FRAME if anew else told
                self._frames.setdefault(name, told)
                self._frame_of.setdefault(raw.topic, told)
                if told in self._to_place:
                    parts.append(self._poses(name, told, mine))
                parts.append(self._markers(name, mine))
            # Of equal times the scan comes first, and what is drawn on it last.
            yield from sorted(chain(*parts), key=RECORDED) if len(parts) > 1 else parts[0]
            if progress is not None:
                progress(log.position)

    def _draw(self, file: Recording, told: str, joined: Joined) -> None:
        """Draw some sweeps of one frame into a recording."""
        poses = None
        if self._tables.is_posed:
            known = np.isfinite(joined.poses.yaw)
            self._lost += int(np.count_nonzero(~known))
            if not known.any():
                return
            joined = joined if known.all() else joined.rows(known)
            here = joined.poses
            poses = SweepPoses(here.x, here.y, here.yaw, np.full(len(here.x), self._hanging(joined, told)))
        batch = normalise(joined.raw, joined.index, self._rules)
        file.add(replace(batch, poses=poses), self._groups(told, joined))

    def _markers(self, frame: str, joined: Joined) -> Iterator[Outgoing]:
        """Yield the markers of some sweeps of one frame."""
        data = marker_arrays(joined.raw.time_ns, frame, self._groups(frame, joined), cdr=self._is_ros2)
        return of_sweeps(self._names[joined.raw.topic], MARKER_TYPE, joined.raw, data)

    def _groups(self, frame: str, joined: Joined) -> list[Markers]:
        """Return the markers of some sweeps of one frame."""
        groups = markers_of(joined.objects, joined.row, joined.poses, COLOURS)
        topic = joined.raw.topic
        if topic not in self._trajectories:
            self._trajectories[topic] = self._tables.trajectories(topic)
        if (known := self._trajectories[topic]) is not None:
            hangs = self._hanging(joined, frame)
            groups += paths_of(known, joined.index, joined.poses, hangs, COLOURS)
        if self._showing is not None:
            groups += self._outlines(self._showing, joined, frame)
        return groups

    def _outlines(self, showing: Showing, joined: Joined, frame: str) -> list[Markers]:
        """Return the outlines of the zones in some sweeps of one frame."""
        batch = normalise(joined.raw, joined.index, self._rules)
        here, hangs = joined.poses, np.full(len(batch), self._hanging(joined, frame))
        poses = SweepPoses(here.x, here.y, here.yaw, hangs) if np.isfinite(here.x).any() else None
        objects = Objects.of(joined.objects, batch)
        owners = objects.owners(batch)
        rest = np.uint8(SETS.index("S"))
        sets = np.append(objects.set, rest)[np.where(owners < 0, len(objects.set), owners)]
        return [
            zone_of(number, one.zone.action, one.corners, one.occupied, COLOURS)
            for number, one in enumerate(showing.of(replace(batch, poses=poses), sets), 1)
        ]

    def _hanging(self, joined: Joined, told: str) -> bool:
        """Return whether a sensor hangs head down, as far as its objects have shown."""
        key = joined.raw.topic, told
        if joined.objects.num_rows:
            self._hangs[key] = bool(np.mean(is_mirrored(joined.objects, joined.row, joined.poses)) > 0.5)
        return self._hangs.get(key, False)

    def _poses(self, frame: str, told: str, joined: Joined) -> Iterator[Outgoing]:
        """Yield the poses of the sensor as transforms, for a log without transforms that viewers know."""
        known = np.isfinite(joined.poses.yaw)
        if not known.any():
            return iter(())
        self._placing.add(frame)
        raw = joined.raw.rows(known)
        pose = np.column_stack([joined.poses.x, joined.poses.y, joined.poses.yaw])[known]
        hangs = np.full(len(raw), self._hanging(joined, told))
        data = transforms(raw.time_ns, self._worlds[told], frame, pose, hangs, cdr=self._is_ros2)
        return of_sweeps("/tf", TF, raw, data)

    def _scan_topic(self, topic: str) -> str:
        return topic if is_ros(self._encodings.get(topic, "")) else topic_name(topic)

    def _map(self, grid: Occupancy, record_ns: int) -> Outgoing:
        """Return the map, stamped as the first message, so that players show it at once."""
        stamp_ns = min(max(record_ns, 0), LAST_SECOND * SECOND)
        data = occupancy_cdr(replace(grid, frame_id=self._world), stamp_ns, MAP_Z)
        if not self._is_ros2:
            data = bytes(ROS2.cdr_to_ros1(data, MAP_TYPE))
        return Outgoing(MAP, MAP_TYPE, record_ns, stamp_ns, data)
