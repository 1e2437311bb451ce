"""One map of logs: the occupancy grid, the cloud and the paths of their sensors in the world."""

from __future__ import annotations

import math
import pickle
import shlex
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from lidarcli.display.texts import Routine
from lidarcli.errors import OptionError, OutputError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse, scratch_folder, writing
from lidarcli.files.stores import Place
from lidarcli.formalism import Parameters
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.mapping.grid import (
    CLEAR,
    HIT,
    MIN_TURN,
    PAUSE_NS,
    SKIPPED,
    Counts,
    MotionFilter,
    Occupancy,
    TooLargeError,
    placed,
)
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.maps.clouds import CloudPoints, CloudWriter, ParquetWriter, PcdWriter, PlyWriter, VoxelFilter
from lidarcli.maps.grids import pgm_bytes, write_occupancy_mcap, yaml_bytes
from lidarcli.options.choices import (
    CLOUDS,
    MAP_RESOLUTION,
    MAP_RESOLUTIONS,
    MATCH,
    MAX_MAP_KM2,
    MIN_MOVE,
    NS,
    OCCUPIED_RATIO,
)
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.needs import NONE, Need, PoseOptions, of_one_run
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, named_files, read_log, reading_as_dict
from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome, logs_at_once, over_logs
from lidarcli.pose.matched import stands
from lidarcli.sweeps.types import Float64, Int64, Status, SweepBatch, SweepPoses, UInt8
from lidarcli.system.machine import cores
from lidarcli.tabular.writing import table_metadata

MIN_HITS, MIN_HITS_OF_ALL = 2, 4
"""Sweeps that have to hit an occupied cell, and where every sweep counts: a robot at rest observes the same many times."""
KM2 = 1e6
"""m² in a km²."""


@dataclass(frozen=True, slots=True)
class MapOptions:
    """Options of `map`, apart from inputs and outputs."""

    read: ReadOptions = field(default_factory=ReadOptions)
    opening: OpenOptions = field(default_factory=OpenOptions)
    poses: PoseOptions = field(default_factory=PoseOptions)
    resolution: float = MAP_RESOLUTION
    """Side of a cell [m]."""
    min_move: float = MIN_MOVE
    """Distance of a sensor from one sweep that counts to the next [m]; 0: every sweep counts."""
    min_hits: int | None = None
    """Sweeps that have to hit an occupied cell; by default `MIN_HITS`, or where every sweep counts `MIN_HITS_OF_ALL`."""
    occupied_ratio: float = OCCUPIED_RATIO
    """Of the sweeps that hit or passed an occupied cell more than this share hit it."""
    free_no_return: float = 0.0
    """Free space along a beam without a return [m]."""
    voxel: float = 0.0
    """The cloud has one point in each square cell of this side [m]; 0: all points."""
    without: str | None = None
    """`agents` to leave out what moves (set A): such a beam is free as far as it got."""
    parameters: Parameters = field(default_factory=Parameters)
    """Parameters of the detection, where sets matter."""
    max_size: float = MAX_MAP_KM2
    """Largest area that is mapped [km²]."""
    need: Need = Need.ALL
    """Sensors whose path is matched where the log has none."""
    overwrite: bool = False
    stamps: str = NS
    """Unit of the stamps of the cloud's table, as of `in_unit`."""
    jobs: int = 0
    """Processes for several logs at most, 0 for as many as there are processors; the result does not depend on it."""

    def hits(self, sweeps: int) -> int:
        """Return the number of sweeps that have to hit an occupied cell, of so many that count; one may be enough."""
        if self.min_hits is not None:
            return self.min_hits
        return max(1, min(sweeps, MIN_HITS if self.min_move > 0 else MIN_HITS_OF_ALL))

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the cloud's metadata."""
        names = ("resolution", "min_move", "occupied_ratio", "free_no_return", "voxel", "without")
        values = {name: getattr(self, name) for name in names}
        return reading_as_dict(self.read, self.opening, self.poses) | values | {"min_hits": self.min_hits}


@dataclass(frozen=True, slots=True)
class SensorPath:
    """Path of a sensor in the world: its positions at the sweeps that count."""

    log: str
    topic: str
    frame: str
    x: Float64
    """(N,) metres."""
    y: Float64
    yaw: Float64
    """[rad]"""

    @property
    def stands(self) -> bool:
        """True where the sensor never moves."""
        return stands(np.column_stack([self.x, self.y, self.yaw]), np.zeros(len(self.x)))

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.hypot(np.diff(self.x), np.diff(self.y)).sum())


@dataclass(slots=True)
class GrowingMap:
    """A map that grows log by log."""

    options: MapOptions
    sets: bool = False
    """True where the set of each beam is needed."""
    counts: Counts = field(init=False)
    worlds: dict[str, None] = field(default_factory=dict)
    """Names of world frames, in the order in which they come."""
    end_ns: int = 0
    """Stamp of the last sweep that counts."""
    paths: list[SensorPath] = field(default_factory=list)
    described: list[dict[str, Any]] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    _voxels: VoxelFilter | None = None
    _matched: int = 0
    """Robots whose path was matched, each in a world of its own."""

    def __post_init__(self) -> None:
        # The sensors of a robot make one map.
        options = self.options = replace(self.options, poses=replace(self.options.poses, together=True))
        cells = int(options.max_size * KM2 / options.resolution**2)
        self.counts = Counts(options.resolution, cells)
        if 0 < options.voxel < MAP_RESOLUTIONS[0]:
            raise OptionError(
                f"--voxel: {options.voxel:g} m is less than the least cell of {MAP_RESOLUTIONS[0]:g} m; 0 keeps all points"
            )
        self._voxels = VoxelFilter(options.voxel) if options.voxel > 0 else None

    def add(self, source: Source, clouds: Sequence[CloudWriter] = (), progress: Progress | None = None) -> RunSummary:
        """Take one log; its points go to the clouds.

        `UnreadableError`: its sensor has no poses; `OptionError`: it covers more than a map may.
        """
        options = self.options
        with read_log(source, options, options.need) as reading:
            chosen = _Selection(options.min_move, bool(options.read.topics), reading.posing.world_of)
            for batch, sets in self._with_sets(reading.batches(progress)):
                for frame, rows, own in batch.by_frame():
                    kept = chosen.rows(batch.topic, frame, own.poses, own.stamp_ns)
                    self._take(source, own.rows(kept), None if sets is None else sets[rows][kept], clouds)
            reading.posing.leave_out(chosen.left_out)
            robots = {reading.posing.robots.get(topic) or (topic, frame) for topic, frame in chosen.filters}
            self._matched += len(robots) if MATCH in chosen.worlds else 0
            summary = reading.close()
            described = reading.describe(source)
        self._conclude(source, summary, described, chosen)
        return summary

    def merge(self, other: GrowingMap) -> None:
        """Add what was counted elsewhere; errors as of `add`."""
        with self._in_bounds():
            self.counts.merge(other.counts)
        self.worlds |= other.worlds
        self.end_ns = max(self.end_ns, other.end_ns)
        self.paths += other.paths
        self.described += other.described
        self.damage += other.damage
        self._matched += other._matched
        self._refuse_several_worlds()

    def occupancy(self) -> Occupancy:
        """Return the grid of all logs so far."""
        options = self.options
        hits = options.hits(self.counts.sweeps)
        return self.counts.occupancy(hits, options.occupied_ratio, next(iter(self.worlds), "map"))

    def _with_sets(self, batches: Iterator[SweepBatch]) -> Iterator[tuple[SweepBatch, UInt8 | None]]:
        """Yield every batch with the set of each of its beams (S, B), by the complete log; None where not needed."""
        if not self.sets:
            yield from ((batch, None) for batch in batches)
            return
        # Maps of everything should not wait for these imports.
        from lidarcli.formalism.tracking.tracker import Tracker
        from lidarcli.pipeline.objects.detection import ObjectFinder
        from lidarcli.tabular.columns import beam_sets

        find = ObjectFinder(self.options.parameters).find
        trackers: defaultdict[str, Tracker] = defaultdict(Tracker)
        for batch in batches:
            for followed in trackers[batch.topic].add(batch, find(batch, True)):
                yield followed.batch, beam_sets(followed)[0]
        for tracker in trackers.values():
            for followed in tracker.finish()[0]:
                yield followed.batch, beam_sets(followed)[0]

    def _take(self, source: Source, batch: SweepBatch, sets: UInt8 | None, clouds: Sequence[CloudWriter]) -> None:
        """Count sweeps of one sensor."""
        poses = batch.poses
        if poses is None or not len(batch):
            return
        use = np.where(batch.status == Status.VALID, HIT, SKIPPED).astype(np.uint8)
        ranges = batch.ranges
        if self.options.without is not None and sets is not None:
            use[(sets == AGENT) & (use == HIT)] = CLEAR
        if self.options.free_no_return > 0:
            nothing = batch.status == Status.NO_RETURN
            use[nothing] = CLEAR
            ranges = np.where(nothing, np.float32(self.options.free_no_return), ranges)
        beams = placed(batch, poses, use, ranges)
        with self._in_bounds():
            self.counts.add(beams)
        self.end_ns = max(self.end_ns, int(batch.stamp_ns.max()))
        if clouds:
            points = self._points(source.name, batch, beams.end, use, sets)
            for cloud in clouds:
                cloud.write(points)

    @contextmanager
    def _in_bounds(self) -> Iterator[None]:
        """Name the remedy where the map would be too large."""
        try:
            yield
        except TooLargeError as err:
            raise OptionError(
                f"the map would reach over {err}, more than {self.options.max_size:g} km²: a pose or a range may be far "
                "off; limit the log (--range, --start, --end), take a coarser --resolution, or allow more with --max-size"
            ) from err
        except MemoryError as err:
            raise OptionError(
                "the map needs more memory than there is: limit the log (--range, --start, --end), or take a coarser "
                "--resolution"
            ) from err

    def _refuse_several_worlds(self) -> None:
        """Refuse a second path that was matched."""
        if self._matched > 1:
            raise OptionError(
                "--pose match finds the path of each sensor in a world of its own, and a map has one world: "
                "take one log, and one topic with --topic"
            )

    def _points(self, log: str, batch: SweepBatch, end: Float64, use: UInt8, sets: UInt8 | None) -> CloudPoints:
        """Return the points of some sweeps."""
        row, beam = np.nonzero(use == HIT)
        x, y = end[0][row, beam], end[1][row, beam]
        if self._voxels is not None:
            kept = self._voxels.keep(x, y)
            row, beam, x, y = row[kept], beam[kept], x[kept], y[kept]
        stamp = batch.stamp_ns[row]
        if batch.duration is not None and self.options.poses.deskew:
            stamp = stamp + np.rint(batch.duration[row] * batch.shares(row, beam) * 1e9).astype(np.int64)
        of_sets = None if sets is None else sets[row, beam].astype(np.int8)
        return CloudPoints(log, batch.topic, batch.sweep[row], beam.astype(np.int32), stamp, x, y, of_sets)

    def _conclude(self, source: Source, summary: RunSummary, described: dict[str, Any], chosen: _Selection) -> None:
        """Keep the results of a log, and add notes on it to the summary."""
        if not chosen.count:
            notes = [note for note in summary.notes if note not in summary.doubts]
            why = "; ".join(notes) or "nothing in the log tells where the sensor was"
            if self.options.poses.source == NONE:
                why = "--pose none leaves them out"
            others = "" if self.options.poses.file else ", or give --poses FILE.tum"
            is_matched = self.options.poses.source == MATCH
            hint = "" if is_matched else f"; find its path with --pose match{others}"
            none = "; ".join(["no sweep to map", *summary.damage])
            raise UnreadableError(f"no poses: {why}{hint}" if summary.sweeps else none)
        self.worlds |= dict.fromkeys(chosen.worlds)
        self.paths += chosen.paths(source.name)
        self.described.append(described)
        self.damage += [f"{described['name']}: {line}" for line in summary.damage]
        self._refuse_several_worlds()
        summary.notes += [
            f"{topic} is {why}: left out (--topic {shlex.quote(topic)})" for topic, why in chosen.left_out.items()
        ]
        which = "all that have a pose" if any(one.unplaced for one in chosen.filters.values()) else "all"
        if self.options.min_move > 0:
            turn, wait = math.degrees(MIN_TURN), PAUSE_NS / 1e9
            which = f"one every {self.options.min_move:g} m, {turn:g} degrees or {wait:g} s; --min-move"
        summary.notes.append(Routine(f"used {chosen.count:,} of {summary.sweeps:,} sweeps ({which})"))


class _Selection:
    """Choice of the sweeps of one log that count, of each of its sensors."""

    def __init__(self, min_move: float, all_topics: bool, world_of: Callable[[str, str], str]) -> None:
        """`all_topics`: also take further topics of the same frame; `world_of`: the fixed frame of a topic and frame."""
        self._min_move = min_move
        self._all_topics = all_topics
        self._world_of = world_of
        self._topics: dict[tuple[str, str], str] = {}
        """World and frame → the topic."""
        self.left_out: dict[str, str] = {}
        """Topic that is left out → why."""
        self.filters: dict[tuple[str, str], MotionFilter] = {}
        """Topic and frame of each sensor → its filter."""
        self._places: dict[tuple[str, str], list[SweepPoses]] = {}

    @property
    def worlds(self) -> list[str]:
        """The world of these sweeps; empty where there are none."""
        return [world for world, _ in [*self._topics][:1]]

    @property
    def count(self) -> int:
        """Number of these sweeps."""
        return sum(len(part.x) for parts in self._places.values() for part in parts)

    def rows(self, topic: str, frame: str, poses: SweepPoses | None, stamp_ns: Int64) -> Int64:
        """Return the rows (of S) of a sensor that count."""
        if poses is None:
            return np.zeros(0, np.int64)
        world = self._world_of(topic, frame)
        if self.worlds and world not in self.worlds:
            # Points of two worlds have no place relative to each other.
            self.left_out[topic] = f"in the frame {world}, not in {self.worlds[0]}"
            return np.zeros(0, np.int64)
        first = self._topics.setdefault((world, frame), topic)
        if first != topic and not self._all_topics:
            self.left_out[topic] = f"of the same frame as {first}, most likely the same sweeps again"
            return np.zeros(0, np.int64)
        key = topic, frame
        if key not in self.filters:
            self.filters[key] = MotionFilter(self._min_move)
            self._places[key] = []
        rows = self.filters[key].take(poses, stamp_ns)
        if len(rows):
            self._places[key].append(poses.rows(rows))
        return rows

    def paths(self, log: str) -> list[SensorPath]:
        """Return the paths of the sensors."""
        return [
            SensorPath(log, *key, *(np.concatenate([getattr(part, axis) for part in parts]) for axis in ("x", "y", "yaw")))
            for key, parts in sorted(self._places.items())
            if parts
        ]


# The files of a map: one fold over several logs, whose outputs appear together when all have been read.

GRIDS = (".yaml", ".png", ".mcap")
"""Suffixes of outputs that are made of the grid."""
WRITERS: dict[str, type[PlyWriter] | type[PcdWriter] | type[ParquetWriter]] = dict(
    zip(CLOUDS, (PlyWriter, PcdWriter, ParquetWriter), strict=True)
)
"""Suffix of a cloud → its writer."""


@dataclass(frozen=True, slots=True)
class Mapped:
    """Result of a run."""

    grid: Occupancy
    worlds: tuple[str, ...]
    sweeps: int
    """Sweeps that count."""
    outputs: tuple[Place, ...]
    notes: tuple[str, ...]


class MapRun:
    """One map of several logs, written when all have been read, to files by their suffixes (`GRIDS`, `CLOUDS`).

    Other suffixes are an `OptionError`, a file that may not be replaced an `OutputError`.
    """

    def __init__(self, sources: Sequence[Source | MissingInput], outputs: Sequence[Place], options: MapOptions) -> None:
        self._sources = sources
        self._options = options
        self._outputs = tuple(outputs)
        self._files = _files(outputs)
        refuse(self._files, options.overwrite, [*files_of(sources), *named_files(options)])
        needs_sets = options.without is not None or any(path.suffix.lower() == ".parquet" for path in outputs)
        # Paths that are matched lie each in a world of its own.
        self._options = options = replace(options, need=Need.ALL if len(sources) == 1 else Need.TOLD)
        self._mapping = GrowingMap(options, needs_sets)
        self._new = NewFiles(self._files, options.overwrite)
        self._clouds: list[CloudWriter] = []
        self._open: list[tuple[Place, BinaryIO]] = []
        self._stack = ExitStack()

    def outcomes(self, report: LogProgress | None = None) -> Iterator[Outcome]:
        """Take log after log, or several at the same time; a bad one does not stop the rest."""
        jobs = self._options.jobs or cores()
        # The points of a cloud have their order.
        at_once = 1 if self._clouds else logs_at_once(self._sources, jobs)
        if at_once < 2:
            yield from map(_whole, over_logs(self._sources, self.add, report))
            return
        with scratch_folder() as scratch:
            work = partial(_map_apart, options=self._options, sets=self._mapping.sets, scratch=str(scratch))
            for outcome in over_logs(self._sources, work, report, at_once):
                if outcome.summary is not None:
                    part = Path(outcome.summary.outputs.pop())
                    self._mapping.merge(pickle.loads(part.read_bytes()))
                    part.unlink()
                yield _whole(outcome)

    def add(self, source: Source, progress: Progress | None = None) -> RunSummary:
        """Take one log; errors as of `GrowingMap.add`."""
        with writing(self._open[0][0], nameless=True) if self._open else nullcontext():
            return self._mapping.add(source, self._clouds, progress)

    @property
    def is_empty(self) -> bool:
        """True where no log could be read."""
        return not self._mapping.described

    def finish(self) -> Mapped:
        """Write the map of all logs that could be read."""
        mapping = self._mapping
        grid = mapping.occupancy()
        notes = self._notes(grid)
        metadata = table_metadata(self._options.as_dict(), mapping.described, mapping.damage)
        for cloud, (path, file) in zip(self._clouds, self._open, strict=True):
            with writing(path):
                cloud.finish(metadata)
                file.close()
        for path in self._outputs:
            self._write(path, grid)
        notes += self._new.publish()
        worlds = tuple(mapping.worlds)
        return Mapped(grid, worlds, mapping.counts.sweeps, self._files, tuple(notes))

    def __enter__(self) -> MapRun:
        with ExitStack() as stack:
            stack.enter_context(self._new)
            for path in self._outputs:
                if (make := WRITERS.get(path.suffix.lower())) is None:
                    continue
                with writing(path):
                    file = self._new.part(path).open("w+b")
                    stack.callback(_let_go, file)
                    cloud = make(file, self._options.stamps) if make is ParquetWriter else make(file)
                stack.callback(cloud.abandon)
                self._clouds.append(cloud)
                self._open.append((path, file))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    def _write(self, path: Place, grid: Occupancy) -> None:
        """Write one output that is made of the grid."""
        suffix, part = path.suffix.lower(), self._new.part(path)
        with writing(path):
            if suffix == ".yaml":
                image = path.with_suffix(".pgm")
                part.write_bytes(yaml_bytes(grid, image.name))
                self._new.part(image).write_bytes(pgm_bytes(grid))
            elif suffix == ".mcap":
                with part.open("wb") as file:
                    write_occupancy_mcap(file, grid, self._mapping.end_ns)
            elif suffix == ".png":
                from lidarcli.reports.map_picture import MapPicture, draw_map

                part.write_bytes(draw_map(MapPicture(grid), ".png"))

    def _notes(self, grid: Occupancy) -> list[str]:
        """Return notes on the map, a line each."""
        mapping = self._mapping
        notes = []
        if len(mapping.worlds) > 1:
            notes.append(
                f"the logs have several world frames ({', '.join(mapping.worlds)}), laid onto each other as they are"
            )
        elif len(mapping.described) > 1 and any(map(of_one_run, mapping.worlds)):
            notes.append(
                f"{len(mapping.described)} logs are laid onto each other in the frame {next(iter(mapping.worlds))}: "
                "odometry begins anew in each, so give poses of a common map (--pose TOPIC, --poses FILE.tum)"
            )
        if not grid.occupied:
            notes.append(
                f"no cell is occupied: {mapping.counts.sweeps:,} sweeps were used, and a cell has to be hit by "
                f"{self._options.hits(mapping.counts.sweeps)} (--min-hits, --min-move)"
            )
        return notes


def _files(outputs: Sequence[Place]) -> tuple[Place, ...]:
    """Return all files of the outputs."""
    known = (*GRIDS, *WRITERS)
    files: list[Place] = []
    for path in outputs:
        suffix = path.suffix.lower()
        if suffix not in known:
            hint = f"; {path.with_suffix('.yaml')} comes with a .pgm" if suffix == ".pgm" else ""
            raise OptionError(f"{path}: the suffix of a map has to be one of {', '.join(known)}{hint}")
        if suffix == ".yaml" and any("\ud800" <= char <= "\udfff" for char in path.name):
            raise OptionError(f"{path}: the YAML of a map names its image, and this name is not UTF-8")
        files += (path, path.with_suffix(".pgm")) if suffix == ".yaml" else (path,)
    return tuple(files)


def _whole(outcome: Outcome) -> Outcome:
    """End the run where a log does not fit the options or cannot be written: without it, it would be another map."""
    if outcome.exit_code == OptionError.exit_code:
        raise OptionError(f"{outcome.label}: {outcome.error}")
    if outcome.exit_code == OutputError.exit_code:
        raise OutputError(str(outcome.error))
    return outcome


def _map_apart(
    source: Source, options: MapOptions, sets: bool, scratch: str, progress: Progress | None = None
) -> RunSummary:
    """Take one log in a process of its own, and leave its part of the map in a file, the summary's output."""
    mapping = GrowingMap(options, sets)
    summary = mapping.add(source, progress=progress)
    mapping.counts.close()
    with tempfile.NamedTemporaryFile(dir=scratch, delete=False) as file:
        pickle.dump(mapping, file, pickle.HIGHEST_PROTOCOL)
    summary.outputs.append(file.name)
    return summary


def _let_go(file: BinaryIO) -> None:
    """Close a file that is given up."""
    with suppress(OSError):
        file.close()
