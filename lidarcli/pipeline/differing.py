"""Runs compared: logs, tables of tracks, backgrounds and maps in, one table of changes out."""

from __future__ import annotations

import json
import math
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse, scratch_folder, writing
from lidarcli.files.stores import Place, place
from lidarcli.formalism.background import Background
from lidarcli.formalism.mapping.grid import (
    CLEAR,
    HIT,
    OCCUPIED,
    SKIPPED,
    UNKNOWN,
    Beams,
    Counts,
    Occupancy,
    TooLargeError,
    UnlikeError,
    compare,
    placed,
)
from lidarcli.formalism.matching import alignment
from lidarcli.formalism.matching.differences import (
    BESIDE,
    GONE,
    HIDDEN,
    MOVED,
    NEW,
    OUT_OF_VIEW,
    POSES,
    SAME_PLACE,
    STRUCTURE,
    UNCERTAIN,
    Change,
    Compared,
    Run,
    TooManyError,
    contained,
    each_of,
    measured,
)
from lidarcli.formalism.matching.ground import HERE, MAX_CELLS, SEEN_FREE, Ground, Motion, Nearest, Surveying, of_map
from lidarcli.formalism.tracking.results import ENDS
from lidarcli.logs.batches import LONGEST
from lidarcli.logs.registry import nothing_read
from lidarcli.maps.grids import image_of, read_map
from lidarcli.options import choices
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, Source, naming
from lidarcli.pipeline.inputs.tables import TracksTable, find_tracks, poses_of, read_tracks_table, world_in
from lidarcli.pipeline.mapping import KM2, MIN_HITS_OF_ALL
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.needs import Need, of_one_run
from lidarcli.pipeline.reading.one_log import Progress, Reading, read_log
from lidarcli.pipeline.runs.over_logs import LogProgress
from lidarcli.pipeline.zone_counting import OBJECT_COLUMNS, Objects
from lidarcli.reports.changes import pairs_of
from lidarcli.reports.checks import Check, Verdict, parse_check, verdict_of
from lidarcli.reports.figures import OF_CHANGES, OF_MAPS
from lidarcli.reports.programs import as_junit
from lidarcli.sweeps.types import Float64, Int64, Status, SweepPoses
from lidarcli.sweeps.zone import ROBOT
from lidarcli.tabular.background import read_background
from lidarcli.tabular.reading import TopicRows, column_names
from lidarcli.tabular.schemas import BACKGROUND, CHANGES
from lidarcli.tabular.writing import ALIGNMENT, CHANGE_FIGURES, SOURCE, table_metadata, write_stream

AUTO, AS_IS, _ = choices.ALIGN
MAX_THINGS = 10_000
"""Most standing things of a run."""
MAX_GROUND = int(choices.MAX_MAP_KM2 * KM2 / choices.MAP_RESOLUTION**2)
"""Most cells of the ground of a run."""
MAX_OCCUPIED = 1_500_000
"""Most occupied cells of a map from a file: 75 km of walls at 5 cm."""
MIN_SWEEPS, MIN_SECONDS = 10, 2.0
"""Fewest sweeps, and shortest time [s], in which a standing thing was seen."""
MIN_TRAVELLED = 0.5
"""Least distance that an agent travelled [m], whose place is not that of a standing thing."""
MIN_CHANCE = 0.6
"""Least probability of an alignment by things alone."""
TABLES = {".parquet": "parquet", ".csv": "csv"}
PICTURE = ".png"
CHANGED_THINGS = tuple(choices.CHANGE_STATUSES[code] for code in (MOVED, NEW, GONE))
MAX_LISTED = 10
"""Most things of a run, and changes of structure, that are listed for people."""
NO_FREE_SPACE = "tables tell no free space; name the logs to learn what is gone"
MAP_WORLD = "map"
"""World of a map, whose file names none."""


@dataclass(frozen=True, slots=True)
class DiffOptions:
    """Options of `diff`, apart from inputs and outputs."""

    detect: DetectOptions
    """Options of reading logs, and of finding and following what stands in them."""
    align: str = AUTO
    min_score: float = choices.MIN_SCORE
    overwrite: bool = False


@dataclass(slots=True)
class RunThings:
    """Things, ground and names of one input."""

    name: str
    run: Run
    world: str
    """Fixed frame of its places; empty for the sensor's own."""
    log: list[str] = field(default_factory=list)
    """Log of each thing."""
    track: list[int] = field(default_factory=list)
    """Track of each thing; 0 where there is none."""
    label: list[str | None] = field(default_factory=list)
    grid: Occupancy | None = None
    """The map, if it is one."""
    is_short: bool = False
    """True if nothing could be seen in it for as long as a thing has to stand."""
    source: dict[str, Any] = field(default_factory=dict)
    reading: Reading | None = None
    """The first reading of its log."""
    before: Ground | None = None
    """The ground by the told poses, where a map corrects them."""
    unsure: int = 0
    """Number of the last things, which only a lost robot saw."""
    poses: list[str] = field(default_factory=list)
    """Notes on poses that a map corrects."""
    notes: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)

    @property
    def is_common(self) -> bool:
        """True if its world outlives a run."""
        return bool(self.world) and not of_one_run(self.world)


class Step(NamedTuple):
    """One run, compared with those before it."""

    before: str
    name: str
    motion: Motion
    overlap: float | None
    rms: float | None
    how: str
    """Words for people on how it was aligned."""
    ground: Occupancy | None = None
    """Ground of the runs before, in the coordinates of the first."""
    sensors: Float64 | None = None
    """(N, 2) places of the sensor of the run, in these coordinates [m]."""

    def alignment(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        runs = {"log_a": self.before, "log_b": self.name}
        motion = {"dx": self.motion.x, "dy": self.motion.y, "dyaw": self.motion.angle}
        return runs | motion | {"overlap": self.overlap, "rms": self.rms}


@dataclass(slots=True)
class Difference:
    """The changes of all runs; `changes` has the schema `lidarcli.tabular.schemas.CHANGES`."""

    changes: pa.Table
    steps: tuple[Step, ...]
    figures: dict[str, float | None]
    notes: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """The result for people."""
        rows = self.changes.to_pylist()
        found = []
        for step in self.steps:
            found.append(step.how if len(self.steps) == 1 else f"{step.before} to {step.name}: {step.how}")
            found += _lines_of([row for row in rows if row["log_b"] == step.name])
        if (f1 := self.figures.get("f1")) is not None:
            found.append(f"  precision {self.figures['precision']:.4f}, recall {self.figures['recall']:.4f}, f1 {f1:.4f}")
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        alignments = [step.alignment() for step in self.steps]
        changes = self.changes.to_pylist()
        return {"figures": self.figures, "alignments": alignments, "changes": changes, "notes": [*self.notes]}


def _lines_of(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the changes of one run for people."""
    counted = Counter(row["status"] for row in rows)
    whys = Counter(row["why"] for row in rows if row["why"])
    words = [f"{status} {counted[status]}" for status in choices.CHANGE_STATUSES if counted[status]]
    if whys:
        words[-1] += f" ({', '.join(f'{whys[why]} {why}' for why in choices.CHANGE_WHYS if whys[why])})"
    found = [f"  {', '.join(words)}" if words else "  nothing stands in them, and no structure differs"]
    things, structure = [], []
    for row in rows:
        x, y = (row[f"{axis}_a"] if row[f"{axis}_b"] is None else row[f"{axis}_b"] for axis in ("x", "y"))
        where = f"({x:.1f}, {y:.1f})"
        if row["kind"] == choices.CHANGE_KINDS[STRUCTURE]:
            structure.append(f"{row['status']} {row['length']:.1f} m at {where}")
        elif row["status"] in CHANGED_THINGS:
            sizes = " x ".join(f"{row[size]:.1f}" for size in ("length", "width") if row[size] is not None)
            moved = "at" if row["moved"] is None else f"by {row['moved']:.2f} m to"
            names = (row["status"], row["label"], sizes and f"{sizes} m", moved, where)
            things.append("  " + " ".join(word for word in names if word))
    found += things[:MAX_LISTED]
    if len(things) > MAX_LISTED:
        found.append(f"  and {len(things) - MAX_LISTED} more")
    if len(structure) > MAX_LISTED:
        structure[MAX_LISTED:] = [f"and {len(structure) - MAX_LISTED} more"]
    return [*found, f"  structure: {', '.join(structure)}"] if structure else found


# Inputs.


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


def read_input(one: Input, options: DiffOptions, progress: Progress | None = None) -> RunThings:
    """Return what an input tells.

    `UnreadableError`, `NoScanError`: it cannot be read, or has no LaserScan topic; `OptionError`: it has too many things,
    or ground.
    """
    if one.kind == "map":
        grid = read_map(Path(one.text))
        if grid.occupied > MAX_OCCUPIED:
            raise UnreadableError(
                f"{one.text}: {grid.occupied:,} occupied cells are more than can be compared ({MAX_OCCUPIED:,}); make "
                "what lies behind walls unknown, or save the map with larger cells"
            )
        return RunThings(
            one.text,
            Run(*_NOTHING, of_map(grid), np.empty((0, 2))),
            MAP_WORLD,
            grid=grid,
            notes=[*filter(None, [grid.note])],
        )
    if one.source is None and one.kind == "tracks":
        table = read_tracks_table(place(one.text))
        return _of_tracks(one.text, table, {}, {})
    try:
        if one.source is None:
            return _of_background(one.text)
        with naming(one.source):
            return _of_log(one.source, options, progress)
    except TooLargeError as err:
        raise OptionError(
            f"{one.text}: the ground would reach over {err}, more than {choices.MAX_MAP_KM2:g} km²: a pose or a "
            "range may be far off; limit the log (--range, --start, --end)"
        ) from err


_NONE, _NO_CODE = np.empty(0), np.empty(0, np.int32)
_NOTHING = alignment.Standing(_NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NO_CODE, _NO_CODE), _NONE
"""No things, and no direction of any."""


def _of_background(text: str) -> RunThings:
    sensors, metadata = read_background(place(text))
    poses = {frame: each for log in metadata.get(SOURCE, []) for frame, each in poses_of(log).items()}
    notes = []
    groups: dict[str, list[Background]] = {}
    for sensor in sensors:
        world = world_in(poses.get(sensor.frame_id, {}), sensor.topic) if sensor.posed.any() else ""
        groups.setdefault(_key(world, sensor.topic, sensor.frame_id), []).append(sensor)
    if not groups:
        raise UnreadableError(f"{text}: the background of no sensor")
    chosen = max(groups, key=lambda key: sum(int(each.sweeps.sum()) for each in groups[key]))
    if len(groups) > 1:
        notes.append(f"{text}: only what lies in {_frame_words(chosen)} is compared")
    survey = Surveying(Counts(choices.MAP_RESOLUTION, MAX_GROUND))
    places = []
    for sensor in groups[chosen]:
        x, y, yaw = (np.nan_to_num(each) for each in (sensor.poses.x, sensor.poses.y, sensor.poses.yaw))
        side = np.where(sensor.poses.upside_down, -1.0, 1.0)
        direction = yaw[:, None] + side[:, None] * sensor.grid.bearings()
        surface, is_open = np.isfinite(sensor.r_e), np.isinf(sensor.r_e) & np.isfinite(sensor.range_max)
        ranges = np.where(surface, sensor.r_e, np.where(is_open, sensor.range_max, np.nan))
        end = np.stack([x[:, None] + ranges * np.cos(direction), y[:, None] + ranges * np.sin(direction)])
        use = np.where(surface, HIT, np.where(is_open, CLEAR, SKIPPED)).astype(np.uint8)
        beams = np.full(len(sensor), sensor.grid.beams, np.int32)
        each = Beams(end, use, beams, np.column_stack([x, y, yaw, side]), np.zeros((len(sensor), 3)))
        # What all sweeps of a station agree on is as good as several of them.
        for _ in range(SEEN_FREE):
            survey.add(each)
        places.append(np.column_stack([x, y]))
    ground = replace(survey.ground(1, choices.OCCUPIED_RATIO), counted=False)
    run = Run(*_NOTHING, ground, np.concatenate(places))
    return RunThings(text, run, "" if chosen.startswith(" ") else chosen, notes=notes)


def _key(world: str, topic: str, frame: str, robot: Sequence[tuple[str, str]] = ()) -> str:
    """Return the world of a sensor, which may be on a robot; one that lies in no common frame begins with a blank."""
    if world.rpartition("/")[2] not in ("", choices.MATCH, ROBOT):
        return world
    topic, frame = (" and ".join(dict.fromkeys(names)) for names in zip(*(robot or [(topic, frame)]), strict=True))
    return f" {frame} of {topic}"


def _frame_words(key: str) -> str:
    return f"the frame of the sensor {key.strip()}" if key.startswith(" ") else f"the frame {key}"


def _of_log(source: Source, options: DiffOptions, progress: Progress | None) -> RunThings:
    """Return the standing things of a log, and the ground that its sweeps saw in a second pass over it."""
    read = options.detect.read
    options = replace(options, detect=replace(options.detect, read=replace(read, run=read.run or LONGEST)))
    with scratch_folder() as private:
        pair, first = detect_to_temporary(source, private, options.detect, progress)
        table = read_tracks_table(pair.tracks)
        agents = _agents(table)
        surveys: dict[str, Surveying] = {}
        places: dict[str, list[Float64]] = {}
        cursors: dict[str, TopicRows] = {}
        stamps: list[int] = []
        with read_log(source, options.detect, Need.MOVING, first) as reading:
            for batch in reading.batches(second_half(progress, source.size)):
                if not len(batch):
                    continue
                stamps += [int(batch.stamp_ns.min()), int(batch.stamp_ns.max())]
                if batch.topic not in cursors:
                    cursors[batch.topic] = TopicRows(pair.objects, "objects", OBJECT_COLUMNS, batch.topic)
                objects = Objects.of(cursors[batch.topic].until(int(batch.sweep[-1]) + 1), batch)
                robot = reading.posing.robots.get(batch.topic, ())
                moved = [*agents.get(batch.topic, []), *(agents.get(None, []) if robot else [])]
                is_agent = np.append(np.isin(objects.track, moved), False)[objects.owners(batch)]
                use = np.where(batch.status == Status.VALID, HIT, SKIPPED).astype(np.uint8)
                for frame, at, mine in batch.by_frame():
                    world, poses = reading.posing.world_of(batch.topic, frame).strip("/"), mine.poses
                    if poses is None or not world or not np.isfinite(poses.yaw).any():
                        world, zero = "", np.zeros(len(mine))
                        poses = SweepPoses(zero, zero, zero, np.zeros(len(mine), np.bool_))
                    world = _key(world, batch.topic, frame, robot)
                    known = np.flatnonzero(np.isfinite(poses.x + poses.y + poses.yaw))
                    survey = surveys.setdefault(world, Surveying(Counts(choices.MAP_RESOLUTION, MAX_GROUND)))
                    survey.add(placed(mine.rows(known), poses.rows(known), use[at][known]), is_agent[at][known])
                    places.setdefault(world, []).append(np.column_stack([poses.x, poses.y])[known])
            summary = reading.close()
            described = reading.describe(source)
            robots = reading.posing.robots
    if not summary.sweeps:
        none = nothing_read(summary.damage, NoScanError("no sweep to compare"), sorted(read.topics or ()))
        raise type(none)(f"{source.label}: {none}")
    grounds = {
        world: survey.ground(max(1, min(survey.counts.sweeps, MIN_HITS_OF_ALL)), choices.OCCUPIED_RATIO)
        for world, survey in surveys.items()
        if survey.counts.sweeps
    }
    found = {world: np.concatenate(parts) for world, parts in places.items()}
    run = _of_tracks(source.name, table, grounds, found, robots)
    seconds = (max(stamps) - min(stamps)) / SECOND_NS if stamps else 0.0
    run.is_short |= summary.sweeps < MIN_SWEEPS or seconds < MIN_SECONDS
    run.source, run.reading = described, first
    run.damage = [f"{source.label}: {line}" for line in dict.fromkeys([*first.summary.damage, *summary.damage])]
    run.notes += [f"{source.label}: {line}" for line in dict.fromkeys([*first.summary.doubts, *summary.notes])]
    return run


def _agents(table: TracksTable) -> dict[str | None, list[int]]:
    """Return the tracks of each topic that travelled, and those of several topics by None.

    What only turned on the spot stands, for all that others know.
    """
    rows = table.rows.to_pydict()
    moved: dict[str | None, list[int]] = {}
    for topic, track, kind, distance in zip(*(rows[name] for name in ("topic", "track", "set", "distance")), strict=True):
        if kind == "A" and distance >= MIN_TRAVELLED:
            moved.setdefault(topic, []).append(track)
    return moved


def _of_tracks(
    name: str,
    table: TracksTable,
    grounds: dict[str, Ground],
    places: dict[str, Float64],
    robots: Mapping[str, Sequence[tuple[str, str]]] | None = None,
) -> RunThings:
    """Return the standing things of a tracks table in the world that has most of them, with its ground.

    `robots`: topic → the sensors that were followed together with it.
    """
    rows = table.rows.to_pydict()
    # What several sensors of a robot saw is in the world of all of them.
    one = next(iter(table.poses), "")
    of = next(iter(table.poses.get(one, {}).get("pose_verdict") or {}), "")
    of, one = next(iter((robots or {}).values()), [(of, one)])[0]
    sensors = [(topic or of, frame or one) for topic, frame in zip(rows["topic"], rows["frame_id"], strict=True)]
    keys = [
        _key(world_in(table.poses.get(frame, {}), topic), topic, frame, (robots or {}).get(topic, ()))
        for topic, frame in sensors
    ]
    worlds = np.array(keys, object)
    number = {each: np.array(rows[each], np.float64) for each in _MEASURED}
    sweeps = np.array(rows["sweeps"], np.int64)
    long = (sweeps >= MIN_SWEEPS) & (np.array(rows["duration"], np.float64) >= MIN_SECONDS)
    stands = (np.array(rows["set"], object) == "O") & (np.array(rows["end"], object) != ENDS[1])
    sizes = dict.fromkeys(worlds, 0) | {world: len(ground.points) for world, ground in grounds.items()}
    key = max(sorted(sizes), key=lambda each: (sizes[each], int((worlds == each).sum())), default=" ")
    notes = []
    if others := sorted({*sizes} - {key}):
        notes.append(
            f"{name}: only what lies in {_frame_words(key)} is compared, not in "
            f"{', '.join(each.strip() for each in others)} (--topic)"
        )
    at = np.flatnonzero(stands & long & np.isfinite(number["x"] + number["y"]) & (worlds == key))
    at = at[_distinct({name: values[at] for name, values in number.items()}, sweeps[at])]
    if len(at) > MAX_THINGS:
        raise OptionError(f"{name}: more than {MAX_THINGS:,} standing things cannot be compared; take a part with --end")
    shapes, labels = ([_code(each) for each in rows[column]] for column in ("shape", "label"))
    things = alignment.Standing(
        **{each: number[each][at] for each in _MEASURED if each != "yaw"},
        shape=np.array(shapes, np.int32)[at],
        label=np.array(labels, np.int32)[at],
    )
    yaw, ground = np.nan_to_num(number["yaw"][at]), grounds.get(key)
    if ground is not None:
        things, yaw, kept = measured(things, yaw, ground)
        at = at[kept]
    return RunThings(
        name,
        Run(things, yaw, ground, places.get(key, np.empty((0, 2)))),
        "" if key.startswith(" ") else key,
        log=[rows["log"][k] for k in at],
        track=[rows["track"][k] for k in at],
        label=[rows["label"][k] for k in at],
        is_short=bool(len(long)) and not long.any(),
        notes=notes,
    )


_MEASURED = ("x", "y", "yaw", "length", "width", "length_sd", "width_sd")


def _code(word: str | None) -> int:
    """Return the code of a word, the same in all runs; -1 for none."""
    return -1 if word in (None, "unknown") else zlib.crc32(str(word).encode()) >> 1


def _distinct(number: dict[str, Float64], sweeps: Int64) -> Int64:
    """Return the things that stand in places of their own: of several in one place the one that was seen longest."""
    length, width = (np.fmax(number[name], 2.0 * (SAME_PLACE - BESIDE)) for name in ("length", "width"))
    boxes = np.column_stack([number["x"], number["y"], np.nan_to_num(number["yaw"]), length, width])
    inside = each_of(*contained(boxes, boxes[:, :2], BESIDE), len(boxes))
    kept: list[int] = []
    alone = np.ones(len(boxes), np.bool_)
    for k in np.argsort(-sweeps, kind="stable").tolist():
        if alone[k]:
            kept.append(k)
            alone[inside[k]] = False
        if len(kept) > MAX_THINGS:
            break
    return np.array(sorted(kept), np.int64)


# Comparing.


def diff_inputs(inputs: Sequence[Input], options: DiffOptions, report: LogProgress | None = None) -> Difference:
    """Compare each run with those before it.

    `UnreadableError`: two do not lie on each other, do so in several ways, or slide along their walls, or as of
    `read_input`; `OptionError`: as of `read_input`, or two maps have cells of different sizes.
    """
    runs = []
    for one in inputs:
        progress = None if report is None or one.source is None else partial(report, one.source)
        runs.append(read_input(one, options, progress))
    names = Counter(each.name for each in runs)
    for one, each in zip(inputs, runs, strict=True):
        if names[each.name] > 1:
            each.name = one.text
    known: Counter[str] = Counter()
    for each in runs[1:]:
        # Rows of a run that is compared twice are told apart.
        known[each.name] += 1
        if known[each.name] > 1:
            each.name = f"{each.name} ({known[each.name]})"
    for each in runs:
        each.log = [each.name] * len(each.log)
    try:
        return _compared(inputs, runs, options)
    except TooLargeError as err:
        raise OptionError(f"the ground of all runs would reach over {err}; compare fewer of them") from err


def _compared(inputs: Sequence[Input], runs: list[RunThings], options: DiffOptions) -> Difference:
    labels = [one.text for one in inputs]
    reference, steps, rows = runs[0], [], []
    notes = [note for each in runs for note in each.notes]
    if any(each.run.ground is None for each in runs):
        notes.append(NO_FREE_SPACE)
    short = [label for label, each in zip(labels, runs, strict=True) if each.is_short]
    notes += [
        f"{label} is too short: a thing has to stand in {MIN_SWEEPS} sweeps and for {MIN_SECONDS:g} s; only structure "
        "is compared, and checks of numbers of changes fail"
        for label in short
    ]
    # Of each run so far, the latest one first.
    grounds = [(runs[0].name, runs[0].run.ground)]
    for number in range(1, len(runs)):
        now = runs[number] = _on_map(inputs[number], runs[number], runs[0], options)
        notes += now.poses
        first, second = (None if (ground := each.run.ground) is None else Nearest(ground) for each in (reference, now))
        label = labels[0] if number == 1 else "the runs before"
        step, chance = _align(reference, now, (first, second), options.align, label, labels[number], notes)
        try:
            changes = Compared(reference.run, now.run, step.motion, (first, second), chance, options.min_score).changes()
        except TooManyError as err:
            raise UnreadableError(f"{label} and {labels[number]} differ in {err}; are they of one place?") from err
        sure = len(now.run.things) - now.unsure
        changes = [each._replace(status=UNCERTAIN, why=POSES) if each.second >= sure else each for each in changes]
        rows += _rows(changes, reference, now, step.motion, grounds)
        known = None if reference.run.ground is None else reference.run.ground.occupancy()
        sensors = np.column_stack(step.motion.of(*now.run.sensors.T))
        steps.append(step._replace(ground=known, sensors=sensors))
        if number < len(runs) - 1:
            reference, moved = _after(reference, now, changes, step.motion)
            grounds.insert(0, (now.name, moved))
    overlaps = [step.overlap for step in steps if step.overlap is not None]
    counted = Counter(row["status"] for row in rows)
    figures = {status: None if short else float(counted[status]) for status in choices.CHANGE_STATUSES}
    figures["overlap"] = min(overlaps) if overlaps else None
    if len(runs) == 2 and (true := runs[0].grid) is not None and (grid := runs[1].grid) is not None:
        try:
            found = compare(_laid(grid, steps[0].motion), true)
        except UnlikeError as err:
            resolution = f"make the map with --resolution {true.resolution:g}"
            raise OptionError(f"{labels[0]} and {labels[1]}: {err}; {resolution}") from err
        figures |= {name: _known(getattr(found, name)) for name in OF_MAPS}
    metadata = table_metadata(
        {**options.detect.as_dict(), "align": options.align, "min_score": options.min_score},
        [each.source or {"name": each.name} for each in runs],
        damage := [line for each in runs for line in each.damage],
    )
    metadata[ALIGNMENT.encode()] = json.dumps([step.alignment() for step in steps]).encode(errors="replace")
    metadata[CHANGE_FIGURES.encode()] = json.dumps(figures).encode()
    for number, row in enumerate(rows, 1):
        row["thing"] = number
    table = pa.Table.from_pylist(rows, CHANGES.with_metadata(metadata))
    return Difference(table, tuple(steps), figures, tuple(dict.fromkeys(notes)), tuple(damage))


def _on_map(one: Input, now: RunThings, site: RunThings, options: DiffOptions) -> RunThings:
    """Return a run as read anew with poses that a map corrects; itself where they fit, or frames are taken as they are."""
    if site.grid is None or one.source is None or not now.world or now.run.ground is None or options.align == AS_IS:
        return now
    from lidarcli.pipeline.localising import given_paths, localise, read_site
    from lidarcli.pipeline.trajectories import PathOptions

    detect, motions = options.detect, [HERE]
    with suppress(UnreadableError):
        nearest = Nearest(of_map(site.grid)), Nearest(now.run.ground)
        motions.insert(0, _align(site, now, nearest, options.align, "", "", [])[0].motion)
    field, paths = read_site(site.name, site.grid), PathOptions(detect.read, detect.opening, detect.poses)
    tried = []
    for motion in dict.fromkeys(motions):
        run = localise(one.source, None, paths, field, True, motion=motion, first=now.reading)
        tried.append(run)
        if run.figures()["lost"] == 0:
            break
    if now.reading is not None and now.reading.posing.is_other:
        for where in (HERE, motion):
            if (own := localise(one.source, None, paths, field, motion=where)).tells:
                break
        lines = own.lines if own.figures()["lost"] != 0 else []
        now.poses = [f"{one.text}: by the robot's own localisation {line}; compared is another path" for line in lines]
    if run.figures()["lost"] == 0:
        return now
    run = max(tried, key=lambda each: each.figures()["map_share"] or 0.0)
    if not run.table.num_rows or not run.figures()["lost"]:
        return now
    given = given_paths(run.table, f"{site.name}, corrected")
    poses = replace(detect.poses, source=None, file=None, delay=None, given=given)
    again = _of_log(one.source, replace(options, detect=replace(detect, poses=poses)), None)
    again.name, again.log, again.before = now.name, [now.name] * len(again.log), now.run.ground
    again.poses = [*now.poses] + [
        f"{one.text}: {line}: placed anew where it is off, left out where it is lost" for line in run.lines
    ]
    old, new = now.run.things, again.run.things
    is_lost = any(math.isnan(each.off) for path in run.paths.values() for each in path.intervals)
    if is_lost and again.run.ground is not None:
        # Places of their own: only a lost robot saw them.
        kept = np.flatnonzero(again.run.ground.seen(old.x, old.y) == 0)
        names, again.unsure = alignment.Standing.__dataclass_fields__, len(kept)
        things = alignment.Standing(
            **{name: np.concatenate([getattr(new, name), getattr(old, name)[kept]]) for name in names}
        )
        again.run = replace(again.run, things=things, yaw=np.append(again.run.yaw, now.run.yaw[kept]))
        for name in ("log", "track", "label"):
            getattr(again, name).extend(getattr(now, name)[k] for k in kept)
    return again


def _laid(grid: Occupancy, motion: Motion) -> Occupancy:
    """Return the occupied cells of a map in other coordinates, those that none fell into as unknown."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    if motion == HERE or not len(row):
        return grid
    side = grid.resolution
    middle = np.column_stack([column + 0.5, row + 0.5]) * side + [grid.x, grid.y]
    x, y = motion.of(*middle.T)
    left, low = (math.floor(values.min() / side) for values in (x, y))
    columns = np.floor(x / side).astype(np.int64) - left
    rows = np.floor(y / side).astype(np.int64) - low
    height, width = int(rows.max()) + 1, int(columns.max()) + 1
    if height * width > MAX_CELLS:
        raise TooLargeError(f"{width * side:,.0f} x {height * side:,.0f} m")
    cells = np.full((height, width), UNKNOWN, np.int8)
    cells[rows, columns] = OCCUPIED
    return Occupancy(side, left * side, low * side, cells, grid.frame_id)


def _align(
    reference: RunThings,
    now: RunThings,
    nearest: tuple[Nearest | None, Nearest | None],
    how: str,
    label: str,
    other: str,
    notes: list[str],
) -> tuple[Step, float]:
    """Return how a run lies on those before it, and the probability of that; what is doubtful is added to the notes."""
    first, second = nearest
    both = f"{label} and {other}"
    common = reference.is_common and reference.world == now.world
    if how == AS_IS or (how == AUTO and common):
        words = f"as they are, in the frame {reference.world}" if common else "as they are"
        if first is None or second is None:
            return _step(reference, now, HERE, None, words), 1.0
        here, better = alignment.settle(first, second)
        if better is not None:
            move = better.motion
            notes.append(
                f"{both} lie better on each other if shifted by {_distance(move)}: {better.overlap:.0%} of the structure "
                f"in place, not {here.overlap:.0%}; poses of one may be off"
            )
            if how == AUTO:
                here, words = better, f"shifted, in the frame {reference.world}"
        _refuse_apart(both, here, "; as they are, that is (--align search)")
        return _step(reference, now, here.motion, here, words), 1.0
    if first is None or second is None:
        motion, chance = alignment.align(reference.run.things, now.run.things)
        if motion is None:
            raise UnreadableError(
                f"{both} cannot be laid on each other: fewer than three of their things stand alike; "
                "name the logs, or take places as they are (--align as-is)"
            )
        if chance < MIN_CHANCE:
            raise UnreadableError(f"{both} {IN_TWO_WAYS}; {ALIGN_AS_IS}")
        return _step(reference, now, motion, None, "aligned by things"), chance
    found = alignment.search(first, second, alignment.proposals(reference.run.things, now.run.things))
    best, rival = found.best, found.rival
    _refuse_apart(both, best)
    if not found.is_certain:
        raise UnreadableError(f"{both} {SLIDING if found.slides else IN_TWO_WAYS}; {ALIGN_AS_IS}")
    if rival is not None:
        if abs(rival.motion.turn) > alignment.NEAR_HERE_TURN:
            differs = f"turned by {math.degrees(abs(rival.motion.turn)):.0f} degrees, as in a symmetric room"
        else:
            apart = math.hypot(rival.motion.x - best.motion.x, rival.motion.y - best.motion.y)
            differs = f"shifted by {apart:.1f} m, as along a row of like pillars"
        notes.append(
            f"{other} lies on {label} in a second way, {differs}: it is taken where "
            "the sensor hardly moved (--align as-is is sure of that)"
        )
    return _step(reference, now, best.motion, best, "aligned by structure"), 1.0


IN_TWO_WAYS = "lie on each other in two ways: nothing tells which one is right, as in a symmetric room"
SLIDING = "may slide on each other along their walls: nothing tells how far, as in a bare corridor"
ALIGN_AS_IS = "where their frames are the same, --align as-is takes them as they are"


def _refuse_apart(both: str, found: alignment.Fit, hint: str = "") -> None:
    """Refuse runs that do not lie on each other (`UnreadableError`)."""
    if found.lies:
        return
    why = f"{found.overlap:.0%} of the structure at best, {alignment.MIN_OVERLAP:.0%} needed"
    if not found.common:
        why = "they have too little of their structure in common"
    raise UnreadableError(f"{both} do not lie on each other: {why}{hint}")


def _distance(motion: Motion) -> str:
    return f"{motion.shift:.2f} m, {math.degrees(abs(motion.turn)):.1f} degrees"


def _step(before: RunThings, now: RunThings, motion: Motion, found: alignment.Fit | None, how: str) -> Step:
    words = how if how.startswith("as") else f"{how}: {_distance(motion)}"
    if found is None:
        return Step(before.name, now.name, motion, None, None, words)
    words += f"; {found.overlap:.0%} of the structure in place"
    return Step(before.name, now.name, motion, found.overlap, _known(found.rms), words)


def _after(before: RunThings, now: RunThings, changes: Sequence[Change], motion: Motion) -> tuple[RunThings, Ground | None]:
    """Return all runs so far as one, each place as the last run that saw it tells it; and the ground of the last."""
    run = now.run.moved(motion)
    gone = {change.first for change in changes if change.status == GONE or change.second >= 0}
    kept = [k for k in range(len(before.run.things)) if k not in gone]
    old, new = before.run.things, run.things
    names = alignment.Standing.__dataclass_fields__
    things = alignment.Standing(**{name: np.concatenate([getattr(old, name)[kept], getattr(new, name)]) for name in names})
    ground = before.run.ground if run.ground is None else run.ground
    if before.run.ground is not None and run.ground is not None:
        ground = run.ground.over(before.run.ground)
    yaw = np.concatenate([before.run.yaw[kept], run.yaw])
    sensors = np.concatenate([before.run.sensors, run.sensors])
    lists = [[getattr(before, name)[k] for k in kept] + getattr(now, name) for name in ("log", "track", "label")]
    return RunThings(now.name, Run(things, yaw, ground, sensors), before.world, *lists), run.ground


def _rows(
    changes: Sequence[Change],
    before: RunThings,
    now: RunThings,
    motion: Motion,
    grounds: Sequence[tuple[str, Ground | None]],
) -> list[dict[str, Any]]:
    """Return the rows of the table, without their numbers."""
    found = []
    old, new = before.run.things, now.run.things
    x, y = motion.of(new.x, new.y)
    counted = [(ground := each.run.ground) is not None and ground.counted for each in (before, now)]
    for change in changes:
        i, j = change.first, change.second
        looks = [count if known and count >= 0 else None for count, known in zip(change.looks, counted, strict=True)]
        row: dict[str, Any] = {
            "log_b": now.name,
            "kind": choices.CHANGE_KINDS[change.kind],
            "status": choices.CHANGE_STATUSES[change.status],
            "why": None if change.why < 0 else choices.CHANGE_WHYS[change.why],
            "score": change.score,
            "area": _known(change.area),
            "sweeps_a": looks[0],
            "sweeps_b": looks[1],
            "free_a": _known(change.free[0]),
            "free_b": _known(change.free[1]),
        }
        if change.kind == STRUCTURE:
            px, py, yaw, length, width = change.place
            run = "b" if change.status == NEW or change.free[0] > 0 else "a"
            row |= {f"x_{run}": px, f"y_{run}": py, f"yaw_{run}": yaw, "length": length, "width": width}
            where = px, py
        else:
            if i >= 0:
                where = float(old.x[i]), float(old.y[i])
                row |= {"x_a": where[0], "y_a": where[1], "yaw_a": _line(before.run.yaw[i])}
                row |= {"track_a": before.track[i] or None, "label": before.label[i]}
            if j >= 0:
                where = float(x[j]), float(y[j])
                row |= {"x_b": where[0], "y_b": where[1], "yaw_b": _line(now.run.yaw[j] + motion.angle)}
                row |= {"track_b": now.track[j] or None, "label": now.label[j] or row.get("label")}
            if i >= 0 and j >= 0:
                row["moved"] = math.hypot(row["x_b"] - row["x_a"], row["y_b"] - row["y_a"])
                row["turned"] = _line(row["yaw_b"] - row["yaw_a"])
            things, k = (new, j) if j >= 0 else (old, i)
            row |= {"length": _known(things.length[k]), "width": _known(things.width[k])}
        at = np.array([where]).T
        if change.why in (HIDDEN, OUT_OF_VIEW) and now.before is not None and now.before.seen(*motion.inverse.of(*at))[0]:
            row["why"] = choices.CHANGE_WHYS[POSES]
        # The latest run that saw the place; where none did, the latest.
        seeing = [name for name, ground in grounds if ground is not None and ground.seen(*at)[0]]
        row["log_a"] = before.log[i] if i >= 0 else [*seeing, grounds[0][0]][0]
        found.append(row)
    return found


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _line(angle: float) -> float:
    """Return an angle of an undirected line, -π/2 to π/2."""
    return float(0.5 * math.pi - (0.5 * math.pi - angle) % math.pi)


# Outputs.


def refuse_outputs(outputs: Sequence[Place], inputs: Sequence[Input], options: DiffOptions) -> None:
    """Refuse outputs of an unknown suffix (`OptionError`), that exist or are an input, before any work."""
    known = (*TABLES, PICTURE, choices.JUNIT)
    for path in outputs:
        if path.suffix.lower() not in known:
            raise OptionError(f"{path}: the suffix of an output has to be one of {', '.join(known)}")
    sources = [one.source for one in inputs if one.source is not None]
    refuse(outputs, options.overwrite, [*options.detect.inputs(sources), *(file for one in inputs for file in one.files)])


def write_changes(
    found: Difference, outputs: Sequence[Place], overwrite: bool, verdicts: Sequence[Verdict] = ()
) -> list[str]:
    """Write the changes as tables and pictures, and the verdicts of checks; returns notes."""
    notes: list[str] = []
    with NewFiles(outputs, overwrite) as new:
        for path in outputs:
            suffix, part = path.suffix.lower(), new.part(path)
            with writing(path):
                if suffix == PICTURE:
                    from lidarcli.reports.map_picture import Sight, draw_changes

                    sights = [Sight(step.ground, step.sensors) for step in found.steps]
                    part.write_bytes(draw_changes(pairs_of(found.changes), sights))
                elif suffix == choices.JUNIT:
                    title = ", ".join([found.steps[0].before, *(step.name for step in found.steps)])
                    part.write_bytes(as_junit("diff", title, verdicts, found.figures, found.damage, found.lines).encode())
                else:
                    table = found.changes.combine_chunks()
                    metadata = dict(table.schema.metadata)
                    with part.open("wb") as out:
                        notes += write_stream(out, TABLES[suffix], str(path), CHANGES, metadata, table.to_batches())[1]
        return notes + new.publish()


def parse_checks(expressions: Sequence[str]) -> list[Check]:
    """Understand checks, or raise `OptionError`."""
    return [parse_check(each, only=(*OF_CHANGES, *OF_MAPS)) for each in expressions]


def judged(found: Difference, checks: Sequence[Check]) -> list[Verdict]:
    """Hold checks against the figures."""
    return [verdict_of(check, found.figures.get(check.name)) for check in checks]
