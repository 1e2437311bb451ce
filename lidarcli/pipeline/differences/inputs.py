"""Runs read from logs, tables of tracks, backgrounds and maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.files.newfiles import scratch_folder
from lidarcli.files.stores import place
from lidarcli.formalism.background import Background
from lidarcli.formalism.mapping.grid import CLEAR, HIT, SKIPPED, Beams, Counts, TooLargeError, placed
from lidarcli.formalism.matching.differences import RunEvidence
from lidarcli.formalism.matching.free_space import OBSERVED_FREE, SpaceMap, SpaceSurvey, of_map
from lidarcli.logs.batches import LONGEST
from lidarcli.logs.registry import nothing_read
from lidarcli.maps.grids import image_of, read_map
from lidarcli.options import choices
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.differences.runs import (
    MIN_SECONDS,
    MIN_SWEEPS,
    NOTHING,
    DiffOptions,
    ObservedRun,
    frame_key,
    frame_words,
    observed_run,
    travelled,
)
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, Source, naming
from lidarcli.pipeline.inputs.tables import find_tracks, poses_of, read_tracks_table, world_in
from lidarcli.pipeline.inputs.tracked import ObjectRows, Objects
from lidarcli.pipeline.mapping import KM2, MIN_HITS_OF_ALL
from lidarcli.pipeline.reading.needs import Need
from lidarcli.pipeline.reading.one_log import Progress, Reading, read_log
from lidarcli.sweeps.types import Float64, Status, SweepBatch, SweepPoses
from lidarcli.tabular.background import read_background
from lidarcli.tabular.reading import column_names
from lidarcli.tabular.schemas import BACKGROUND
from lidarcli.tabular.writing import SOURCE

MAX_OCCUPIED = 1_500_000
"""Most occupied cells of a map from a file: 75 km of walls at 5 cm."""


@dataclass(frozen=True, slots=True)
class Input:
    """One input, by what it is."""

    text: str
    kind: str
    """`log`, `tracks`, `background` or `map`."""
    source: Source | None = None

    @property
    def files(self) -> list[str]:
        """The files that are read."""
        return [self.text, str(image_of(Path(self.text)))] if self.kind == "map" else [self.text]


def inputs_of(texts: Sequence[str]) -> list[Input]:
    """Return what the inputs are; an `OptionError` for fewer than two, the standard input or several logs in one."""
    if len(texts) < 2:
        raise OptionError(f"{texts[0] if texts else 'nothing'}: one run has nothing to be compared with; give two or more")
    return [_input(text) for text in texts]


def _input(text: str) -> Input:
    suffix = place(text).suffix.lower()
    if suffix in (".yaml", ".yml"):
        return Input(text, "map")
    if suffix == ".parquet":
        is_background = {*BACKGROUND.names} <= {*column_names(place(text), "tracks")}
        return Input(text, "background" if is_background else "tracks")
    if Path(text).is_dir() and any(Path(text).glob("*.tracks.parquet")):
        tables = find_tracks([text])
        if len(tables) > 1:
            raise OptionError(f"{text}: holds the tables of {len(tables)} logs; name one of them")
        return Input(str(tables[0]), "tracks")
    found = find_logs([text])
    if len(found) > 1:
        raise OptionError(f"{text}: holds {len(found)} logs; name one of them")
    source = found[0]
    if isinstance(source, MissingInput):
        raise type(source.error)(f"{text}: {source.error}")
    if source.is_stdin:
        raise OptionError("runs are compared by reading their logs twice; give the name of a file instead of -")
    return Input(text, "log", source)


def read_input(one: Input, options: DiffOptions, progress: Progress | None = None) -> ObservedRun:
    """Return the run of an input.

    `UnreadableError`, `NoScanError`: it cannot be read, or has no LaserScan topic; `OptionError`: it has too many objects,
    or covers too much.
    """
    if one.kind == "map":
        grid = read_map(Path(one.text))
        if grid.occupied > MAX_OCCUPIED:
            raise UnreadableError(
                f"{one.text}: {grid.occupied:,} occupied cells are more than can be compared ({MAX_OCCUPIED:,}); make "
                "what lies behind walls unknown, or save the map with larger cells"
            )
        run = RunEvidence(*NOTHING, of_map(grid), np.empty((0, 2)))
        return ObservedRun(one.text, run, "map", grid=grid, notes=[*filter(None, [grid.note])])
    if one.source is None and one.kind == "tracks":
        table = read_tracks_table(place(one.text))
        return observed_run(one.text, table, {}, {})
    try:
        if one.source is None:
            return _of_background(one.text)
        with naming(one.source):
            return of_log(one.source, options, progress)
    except TooLargeError as err:
        raise OptionError(
            f"{one.text}: the ground would reach over {err}, more than {choices.MAX_MAP_KM2:g} km²: a pose or a "
            "range may be far off; limit the log (--range, --start, --end)"
        ) from err


def _of_background(text: str) -> ObservedRun:
    sensors, metadata = read_background(place(text))
    poses = {frame: each for log in metadata.get(SOURCE, []) for frame, each in poses_of(log).items()}
    notes = []
    groups: dict[str, list[Background]] = {}
    for sensor in sensors:
        world = world_in(poses.get(sensor.frame_id, {}), sensor.topic) if sensor.posed.any() else ""
        groups.setdefault(frame_key(world, sensor.topic, sensor.frame_id), []).append(sensor)
    if not groups:
        raise UnreadableError(f"{text}: the background of no sensor")
    chosen = max(groups, key=lambda key: sum(int(each.sweeps.sum()) for each in groups[key]))
    if len(groups) > 1:
        notes.append(f"{text}: only what lies in {frame_words(chosen)} is compared")
    survey = _survey()
    places = []
    for sensor in groups[chosen]:
        x, y, yaw = (np.nan_to_num(each) for each in (sensor.poses.x, sensor.poses.y, sensor.poses.yaw))
        side = np.where(sensor.poses.upside_down, -1.0, 1.0)
        direction = yaw[:, None] + side[:, None] * sensor.grid.bearings
        surface, is_open = np.isfinite(sensor.r_e), np.isinf(sensor.r_e) & np.isfinite(sensor.range_max)
        ranges = np.where(surface, sensor.r_e, np.where(is_open, sensor.range_max, np.nan))
        end = np.stack([x[:, None] + ranges * np.cos(direction), y[:, None] + ranges * np.sin(direction)])
        use = np.where(surface, HIT, np.where(is_open, CLEAR, SKIPPED)).astype(np.uint8)
        beams = np.full(len(sensor), sensor.grid.beams, np.int32)
        each = Beams(end, use, beams, np.column_stack([x, y, yaw, side]), np.zeros((len(sensor), 3)))
        # What all sweeps of a station agree on is as good as several of them.
        for _ in range(OBSERVED_FREE):
            survey.add(each)
        places.append(np.column_stack([x, y]))
    ground = replace(survey.ground(1, choices.OCCUPIED_RATIO), counted=False)
    run = RunEvidence(*NOTHING, ground, np.concatenate(places))
    return ObservedRun(text, run, "" if chosen.startswith(" ") else chosen, notes=notes)


def of_log(source: Source, options: DiffOptions, progress: Progress | None) -> ObservedRun:
    """Return the static objects of a log, and the occupancy that its sweeps observed in a second pass over it."""
    read = options.detect.read
    detect = replace(options.detect, read=replace(read, run=read.run or LONGEST))
    survey = _LogSurvey()
    with scratch_folder() as private:
        tables, first = detect_to_temporary(source, private, detect, progress)
        table = read_tracks_table(tables.tracks)
        agents, rows = travelled(table), ObjectRows(tables)
        with read_log(source, detect, Need.MOVING, first) as reading:
            for batch in reading.batches(second_half(progress, source.size)):
                if len(batch):
                    survey.add(batch, rows.of(batch), agents, reading)
            summary = reading.close()
            described = reading.describe(source)
            robots = reading.posing.robots
    if not summary.sweeps:
        none = nothing_read(summary.damage, NoScanError("no sweep to compare"), sorted(read.topics or ()))
        raise type(none)(f"{source.label}: {none}")
    places = {frame: np.concatenate(parts) for frame, parts in survey.places.items()}
    run = observed_run(source.name, table, survey.grounds(), places, robots)
    run.is_short |= summary.sweeps < MIN_SWEEPS or survey.seconds < MIN_SECONDS
    run.source, run.reading = described, first
    run.damage = [f"{source.label}: {line}" for line in dict.fromkeys([*first.summary.damage, *summary.damage])]
    run.notes += [f"{source.label}: {line}" for line in dict.fromkeys([*first.summary.doubts, *summary.notes])]
    return run


class _LogSurvey:
    """Occupancy that the sweeps of a log observe, and the places of their sensors, by frame as of `frame_key`."""

    def __init__(self) -> None:
        self._surveys: dict[str, SpaceSurvey] = {}
        self.places: dict[str, list[Float64]] = {}
        """(N, 2) each [m]"""
        self._stamps: list[int] = []

    def add(self, batch: SweepBatch, objects: Objects, agents: Mapping[str | None, list[int]], reading: Reading) -> None:
        """Take sweeps; `agents` are tracks by topic, as of `travelled`."""
        self._stamps += [int(batch.stamp_ns.min()), int(batch.stamp_ns.max())]
        robot = reading.posing.robots.get(batch.topic, ())
        moved = [*agents.get(batch.topic, []), *(agents.get(None, []) if robot else [])]
        is_agent = np.append(np.isin(objects.track, moved), False)[objects.owners(batch)]
        use = np.where(batch.status == Status.VALID, HIT, SKIPPED).astype(np.uint8)
        for frame, at, own in batch.by_frame():
            world, poses = reading.posing.world_of(batch.topic, frame).strip("/"), own.poses
            if poses is None or not world or not np.isfinite(poses.yaw).any():
                world, zero = "", np.zeros(len(own))
                poses = SweepPoses(zero, zero, zero, zero > 0.0)
            key = frame_key(world, batch.topic, frame, robot)
            known = np.flatnonzero(np.isfinite(poses.x + poses.y + poses.yaw))
            survey = self._surveys.setdefault(key, _survey())
            survey.add(
                placed(own.rows(known), poses.rows(known), use[at][known]), is_agent[at][known], f"{batch.topic} {frame}"
            )
            self.places.setdefault(key, []).append(np.column_stack([poses.x, poses.y])[known])

    def grounds(self) -> dict[str, SpaceMap]:
        """Return the occupancy in each frame that has sweeps."""
        return {
            key: survey.ground(max(1, min(survey.counts.sweeps, MIN_HITS_OF_ALL)), choices.OCCUPIED_RATIO)
            for key, survey in self._surveys.items()
            if survey.counts.sweeps
        }

    @property
    def seconds(self) -> float:
        """Time from the first sweep to the last [s]."""
        return (max(self._stamps) - min(self._stamps)) / SECOND_NS if self._stamps else 0.0


def _survey() -> SpaceSurvey:
    """Return a survey that has observed nothing yet."""
    return SpaceSurvey(Counts(choices.MAP_RESOLUTION, int(choices.MAX_MAP_KM2 * KM2 / choices.MAP_RESOLUTION**2)))
