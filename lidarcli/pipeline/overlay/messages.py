"""Messages of an overlay: markers, zones, maps and poses."""

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

from lidarcli.formalism.detection import NOISE
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.logs.base import Log, ReadReport
from lidarcli.maps.grids import MAP_TYPE, occupancy_cdr
from lidarcli.options.choices import MATCH
from lidarcli.overlays.markers import LAST_SECOND, MARKER_TYPE, SECOND, Markers, marker_arrays, transforms
from lidarcli.overlays.objects import is_mirrored, markers_of, paths_of, text_of, zone_of
from lidarcli.overlays.viewers import FRAME, MAP, ViewerScene, topic_name, topics_of_objects
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, poses_of, world_in
from lidarcli.pipeline.inputs.tracked import Objects
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.overlay.copies import (
    ROS,
    Copies,
    frames_in_transforms,
    in_order,
    of_sweeps,
    scan_encodings,
    transform_topics,
)
from lidarcli.pipeline.overlay.tables import OverlayTables, TabledSweeps
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, damage_lines, opening_of, rules_of
from lidarcli.pipeline.zones.frames import Frames
from lidarcli.pipeline.zones.shown import Showing
from lidarcli.ros.messages import ROS2, TF, Outgoing
from lidarcli.sweeps.range_rules import normalise
from lidarcli.sweeps.types import SweepPoses
from lidarcli.sweeps.zone import Zones
from lidarcli.tabular.reading import file_metadata, note_value
from lidarcli.tabular.writing import PARAMETERS, SOURCE

if TYPE_CHECKING:
    from lidarcli.overlays.rrd import Recording


MAP_Z = -0.05
"""Height of the map [m]: where the sensor is at 0, the beams lie on it, and are not in it."""
RECORDED = attrgetter("record_ns")


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
    """Write settings of viewers next to the file."""
    overwrite: bool = False


class Overlay:
    """Messages of one overlay: those of the log that are copied, and the markers of its objects."""

    def __init__(
        self, source: Source, tables: TableSet, grid: Occupancy | None, options: OverlayOptions, is_ros2: bool
    ) -> None:
        """Take what is to be shown; `is_ros2`: for ROS 2, else for ROS 1."""
        self._source, self._grid, self._options = source, grid, options
        # Sweeps are to be made again as they were for the tables.
        notes, opening = file_metadata(tables.sweeps), options.detect.opening
        then = opening_of(note_value(notes, PARAMETERS, dict))
        self._opening = replace(opening, slice=opening.slice or then.slice, echo=then.echo, segments=then.segments)
        self._showing: Showing | None = None
        described = note_value(notes, SOURCE, dict)
        mask = described.get("mask")
        self._rules = rules_of(note_value(notes, PARAMETERS, dict), mask if isinstance(mask, dict) else None)
        self._is_ros2 = is_ros2
        self._tables = OverlayTables(tables)
        self._copies = Copies(frozenset(self._tables.topics), is_ros2)
        self._names = topics_of_objects(self._tables.topics)
        self._pose_sources = poses_of(described)
        """Sensor frame → the description of its poses."""
        self._pose_frames = {
            frame: (str(poses.get("fixed_frame", poses["world"])), str(poses.get("topic")))
            for frame, poses in self._pose_sources.items()
            # Viewers cannot distinguish frames of several robots that have one name.
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
        """Those of them whose place is in this file alone."""
        self._placing: set[str] = set()
        """Frames whose place has been written."""
        self._hangs: dict[tuple[str, str], bool] = {}
        """Topic and frame of a sensor → True where it hangs head down, as far as its objects have shown."""
        self._frame_of: dict[str, str] = {}
        """Topic → the frame of its first sweep, as the log has it."""
        self._newest: dict[tuple[str, str], tuple[int, int, int]] = {}
        """Topic and frame → index, stamp and record time of the last sweep."""
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
            # A frame has one parent: where the log has one, another would tear the tree apart.
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
        """Write a recording of rerun: sweeps and objects at the poses of the tables, whatever their source."""
        from lidarcli.overlays.rrd import Recording

        log = self._open(stack)
        file = Recording(path)
        stack.callback(file.abandon)
        for joined in self._tables.join(log, self._report):
            self._sweeps += len(joined.raw)
            for frame, own in joined.by_frame():
                self._frame_of.setdefault(own.raw.topic, frame)
                if len((late := self._silences(own, frame)).index):
                    self._draw(file, frame, late, silent=True)
                self._draw(file, frame, own)
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

    def scene(self) -> ViewerScene:
        """Return the settings of viewers; known when all messages have been written."""
        fixed, frame = next(iter(self._frames.items()), (FRAME, FRAME))
        if frame in self._placed:
            fixed = self._worlds[frame]
        if self._grid is not None and self._worlds:
            fixed = self._world
        hidden = self._hidden()
        return ViewerScene(
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
        return next((self._worlds[frame] for frame in self._frames.values() if frame in self._worlds), "map")

    def _open(self, stack: ExitStack) -> Log:
        """Open the log, and make ready to show zones."""
        if (zones := self._options.zones) is not None:
            # Transforms are read by a pass of their own.
            other = stack.enter_context(open_source(self._source, self._opening))
            self._showing = Showing(zones, Frames.of(other, zones))
        return stack.enter_context(open_source(self._source, self._opening))

    def _hidden(self) -> dict[str, str]:
        """Return the topics that viewers hide at first, and why: others before them are shown in their place."""
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
        """Return the topics that cannot be drawn next to the first one without poses, and note what is not shown."""
        if self._grid is not None:
            self._notes.append("the map is left out, for nothing tells where the sensor is in it; give --pose or --poses")
        first, *others = self._tables.topics or ("",)
        apart = [topic for topic in others if topic not in hidden]
        self._notes += [
            f"nothing tells where the sensor of {topic} is beside that of {first}: it is hidden at first" for topic in apart
        ]
        return apart

    def _drawn(self, log: Log, progress: Progress | None) -> Iterator[Outgoing]:
        """Yield the markers of all sweeps, and scans of the log that have to be encoded again."""
        for joined in self._tables.join(log, self._report):
            raw = joined.raw
            self._sweeps += len(raw)
            anew = self._encodings.get(raw.topic) not in ROS
            parts: list[Iterator[Outgoing]] = []
            if self._options.with_log and anew:
                named = tuple(name or FRAME for name in raw.frame_ids)
                parts.append(self._copies.written_anew(replace(raw, frame_ids=named)))
            for frame, own in joined.by_frame():
                name = frame or FRAME if anew else frame
                self._frames.setdefault(name, frame)
                self._frame_of.setdefault(raw.topic, frame)
                if frame in self._to_place:
                    parts.append(self._poses(name, frame, own))
                if len((late := self._silences(own, name)).index):
                    data = marker_arrays(late.raw.time_ns, name, self._groups(name, late, silent=True), cdr=self._is_ros2)
                    parts.append(of_sweeps(self._names[raw.topic], MARKER_TYPE, late.raw, data))
                data = marker_arrays(own.raw.time_ns, name, self._groups(name, own), cdr=self._is_ros2)
                parts.append(of_sweeps(self._names[raw.topic], MARKER_TYPE, own.raw, data))
            # Of equal times the scan comes first, and what is drawn on it last.
            yield from sorted(chain(*parts), key=RECORDED) if len(parts) > 1 else parts[0]
            if progress is not None:
                progress(log.position)

    def _silences(self, joined: TabledSweeps, frame: str) -> TabledSweeps:
        """Return sweeps of one frame without a beam, at the times at which the sweep before is too old for a zone."""
        zones = () if self._options.zones is None else self._options.zones.zones
        timeouts = [zone.timeout for zone in zones if zone.timeout and zone.is_for(joined.raw.topic)]
        raw, longest_ns = joined.raw, round(min(timeouts, default=0.0) * SECOND)
        now = np.stack([joined.index, raw.time_ns, raw.record_ns])
        before = np.column_stack([self._newest.get((raw.topic, frame), now[:, 0]), now[:, :-1]])
        self._newest[raw.topic, frame] = tuple(now[:, -1].tolist())
        apart, pause, _ = now - before
        # Sweeps that were left out, of every N, are not missing.
        late = (pause > longest_ns * apart) & (apart > 0) & (longest_ns > 0)
        found, at = joined.rows(late), before[:, late] + longest_ns
        nothing = np.full_like(found.raw.ranges, np.nan)
        return replace(found, raw=replace(found.raw, ranges=nothing, stamp_ns=at[1], record_ns=at[2], mended_ns=None))

    def _draw(self, file: Recording, frame: str, joined: TabledSweeps, silent: bool = False) -> None:
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
        file.add(replace(batch, poses=poses), self._groups(frame, joined, silent))

    def _groups(self, frame: str, joined: TabledSweeps, silent: bool = False) -> list[Markers]:
        """Return the markers of some sweeps of one frame; of those of `_silences` the zones, and a text."""
        if silent and self._showing is not None:
            text = text_of(f"no {joined.raw.topic}", len(joined.index))
            return [*self._outlines(self._showing, joined, frame), text]
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
        rest = np.uint8(NOISE)
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
