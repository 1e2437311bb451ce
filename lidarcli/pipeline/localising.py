"""Was the robot lost? The path of the sensors of a log against a map, part by part."""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.display.texts import time_of_day
from lidarcli.errors import CHECK_FAILED, UnreadableError
from lidarcli.files.stores import Place
from lidarcli.formalism.localisation import FITTING, LOST, OFF, UNSURE, Field, field_of, intervals_of, judge, states_of
from lidarcli.formalism.mapping.grid import HIT, SKIPPED, Occupancy, TooLargeError, placed
from lidarcli.formalism.matching.free_space import HERE, SpaceMotion
from lidarcli.maps.grids import image_of, read_map
from lidarcli.options.choices import MAP_STATES, MATCH
from lidarcli.options.times import SECOND_NS, TimeZone
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.reading.needs import Need, of_one_run
from lidarcli.pipeline.reading.one_log import Progress, Reading, read_log
from lidarcli.pipeline.trajectories import PARQUET, PathOptions, PathSummary, read_rows, refuse_path, save
from lidarcli.reports.checks import Check, CheckVerdict, accepts, parse_check, verdict_of
from lidarcli.reports.columns import Observation, least_observed, missing_of
from lidarcli.reports.zones import floored
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.types import Float64, Int8, Int64, Status, SweepBatch
from lidarcli.tabular.columns import codes, floats
from lidarcli.tabular.schemas import POSES

if TYPE_CHECKING:
    from lidarcli.pose.sources import GivenPaths

WINDOW_NS, SLOTS, MAX_BEAMS = SECOND_NS // 2, 2, 90
"""Time that is evaluated at once [ns]; sweeps of it, the first of each part of it, and beams of a sweep, evenly chosen."""
RANGES = 0.15, 12.0
"""Ranges of these [m]."""
AT_ONCE = 256
"""Sweeps that are gathered before they are evaluated."""
MIN_SHARE = 0.7
"""Share of the beams that the map explains in the median, below which there is no verdict; `STEADY` and `NEARLY_ALL` are
exceptions."""
STEADY, AT_TIMES, NEARLY_ALL = 0.1, 0.25, 0.93
"""There is a verdict all the same if the corrected path explains `MIN_SHARE` and as many corrections lie within the first
of their median [m] (a path that is off as a whole), or the given one does so in the second share of windows (one that is
off most of the time), or if it explains the third share of the beams (one that drifts)."""
MAX_SHOWN = 10
"""Intervals that a line shows."""
JUMP = 0.1
"""Between poses whose corrections differ by more than this, none is known [m, rad]."""
MAP_COLUMNS = tuple(name for name in POSES.names if name.startswith("map_"))
FIGURES = ("lost", "lost_seconds", "lost_share", "off_max", "map_share", "observed")
"""Figures that a check of a path may name."""
PICTURE = ".png"
NEVER = np.int64(np.iinfo(np.int64).min)
"""Slot before the first sweep."""


class Site(NamedTuple):
    """A map, and the distances to what is occupied in it."""

    grid: Occupancy
    field: Field


def read_site(path: str, grid: Occupancy | None = None) -> Site:
    """Read the YAML file of a map, unless its cells are there; `UnreadableError` if it can explain no beam."""
    grid = grid or read_map(Path(path))
    if not grid.occupied:
        raise UnreadableError(f"{path}: nothing in it is occupied, so it explains no beam")
    try:
        return Site(grid, field_of(grid))
    except TooLargeError as err:
        raise UnreadableError(f"{path}: reaches over {err}, more than can be judged") from err


def refuse_judged(path: Place, source: Source, options: PathOptions, site: str) -> None:
    """Refuse an output as `refuse_path` does; it may be a picture, and is no file of the map."""
    refuse_path(path, source, options, (PICTURE,), [site, str(image_of(Path(site)))])


class Interval(NamedTuple):
    """Seconds in which a path does not fit the map, from the first sweep of its sensor."""

    begin: float
    end: float
    off: float
    """Greatest correction [m]; NaN where the path is lost."""
    words: str


class Localisation:
    """The path of one sensor, judged by a map."""

    def __init__(self, sensor: _LocalisedSensor, zone: TimeZone) -> None:
        """Evaluate what a sensor has observed."""
        self._zone = zone
        nothing = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, sensor.field.columns))
        window, points, found = (np.concatenate(each) for each in zip(nothing, *sensor.judged, strict=True))
        order = np.argsort(window, kind="stable")
        state, self.share, enough = states_of(points[order], found[order])
        self.first_ns, self.state = sensor.first_ns, state[enough]
        self.window, self.found = window[order][enough], found[order][enough]
        judged = self.window[self.state != UNSURE]
        self.tells = False
        """False where the map explains too little for a verdict."""
        if len(judged):
            away = np.hypot(*(self.found[:, 4:6] - np.median(self.found[:, 4:6], axis=0)).T)
            after = float(np.median(self.found[:, 2]))
            is_steady = np.mean(away < STEADY) >= MIN_SHARE or np.mean(self.found[:, 0] >= MIN_SHARE) >= AT_TIMES
            mends = after >= MIN_SHARE and is_steady
            self.tells = bool(self.share >= MIN_SHARE or mends or after >= NEARLY_ALL)
        parts = intervals_of(self.window, self.state, self.found) if self.tells else []
        self.intervals = [self._interval(part) for part in parts]
        # One window alone is no interval, and none that fits.
        alone = np.isin(self.state, (OFF, LOST))
        alone[np.concatenate([np.zeros(0, np.int64), *parts])] = False
        self.state[alone] = UNSURE
        number, stamps = (np.concatenate([nothing[0], *each]) for each in (sensor.seen, sensor.stamps))
        self.sight = Observation("", int(np.isin(number, judged).sum()), len(stamps) + missing_of(np.sort(stamps)))
        """Sweeps whose part of the path was judged, and all, those missing in gaps, too."""

    def _interval(self, part: Int64) -> Interval:
        each_s = WINDOW_NS / SECOND_NS
        begin, end = each_s * float(self.window[part[0]]), each_s * float(self.window[part[-1]] + 1)
        clocks = [time_of_day(self.first_ns + round(each * SECOND_NS), self._zone) for each in (begin, end)]
        span = f"from {begin:.1f} to {end:.1f} s" + (f" ({' to '.join(clocks)})" if all(clocks) else "")
        off = self.found[part[self.state[part] == OFF]]
        if 2 * len(off) < len(part):
            return Interval(begin, end, math.nan, f"lost {span}")
        sizes, turns = np.hypot(off[:, 4], off[:, 5]), np.degrees(np.abs(off[:, 6]))
        most, turn = float(sizes.max()), float(turns.max())
        # Corrections of a path that slides away grow; of others they are noisy.
        by = f"up to {most:.2f} m and {turn:.1f}"
        if np.ptp(sizes) <= JUMP:
            most, turn = float(np.median(sizes)), float(np.median(turns))
            by = f"{most:.2f} m and {turn:.1f}"
        return Interval(begin, end, most, f"off {span}, by {by} degrees")

    @property
    def words(self) -> str:
        """The verdict for people."""
        if not len(self.window):
            return "no part of the path can be judged: too few beams of a sweep with a pose have a range"
        if not self.tells:
            return f"the map explains only {self.share:.0%} of the beams: outdated, or of another place or frame"
        lacks = least_observed([self.sight])
        fits = "the path fits it throughout" if lacks is None else "where it can be judged, the path fits"
        words = [each.words for each in self.intervals] or [fits]
        if len(words) > MAX_SHOWN:
            words[MAX_SHOWN:] = [f"and {len(words) - MAX_SHOWN} times more"]
        more = [] if lacks is None else [f"judged in {self.sight.observed:,} of {self.sight.sweeps:,} sweeps"]
        return "; ".join([f"the map explains {self.share:.0%} of the beams", *words, *more])

    def at(self, stamp_ns: Int64, x: Float64, y: Float64) -> tuple[Int8, Float64, Float64]:
        """Return (N,) states of sweeps, -1 for no verdict, and shares, and (3, N) the corrections of their poses at x, y.

        Share and correction [m, m, rad] are NaN where there is none.
        """
        number = (stamp_ns - self.first_ns) // WINDOW_NS
        if not len(self.window):
            return np.full(len(number), -1, np.int8), np.full(len(number), np.nan), np.full((3, len(number)), np.nan)
        row = np.minimum(np.searchsorted(self.window, number), len(self.window) - 1)
        known = self.window[row] == number
        of, state = self.found[row], np.where(known, self.state[row], UNSURE).astype(np.int8)
        cos, sin, dx, dy = np.cos(of[:, 6]), np.sin(of[:, 6]), x - of[:, 8], y - of[:, 9]
        moved = np.stack([of[:, 4] + cos * dx - sin * dy - dx, of[:, 5] + sin * dx + cos * dy - dy, of[:, 6]])
        moved[:, ~np.isin(state, (FITTING, OFF)) | (not self.tells)] = np.nan
        return state if self.tells else np.full(len(state), -1, np.int8), np.where(known, of[:, 0], np.nan), moved


class _LocalisedSensor:
    """The windows of one sensor so far."""

    def __init__(self, field: Field, first_ns: int) -> None:
        self.field, self.first_ns = field, first_ns
        self.slot = NEVER
        self.points: list[Float64] = []
        self.windows: list[Int64] = []
        """Of the beams that wait: ends and places of the sensor (4, P), and numbers of windows (P,)."""
        self.judged: list[tuple[Int64, Int64, Float64]] = []
        self.stamps: list[Int64] = []
        """Of all sweeps [ns]."""
        self.seen: list[Int64] = []
        """Number of the window of each sweep that shows something and has a pose."""

    def add(self, sweeps: SweepBatch, motion: SpaceMotion) -> None:
        """Take some sweeps, their poses moved."""
        self.stamps.append(sweeps.stamp_ns)
        poses = sweeps.poses
        if poses is None:
            return
        slot = (sweeps.stamp_ns - self.first_ns) // (WINDOW_NS // SLOTS)
        rows = np.flatnonzero(np.isfinite(poses.x + poses.y + poses.yaw) & sweeps.observed)
        self.seen.append(slot[rows] // SLOTS)
        rows = rows[np.diff(slot[rows], prepend=self.slot) != 0]
        if not len(rows):
            return
        self.slot = slot[rows[-1]]
        sweeps, poses = sweeps.rows(rows), poses.rows(rows)
        use = np.full(sweeps.ranges.shape, SKIPPED, np.uint8)
        for index, beams in enumerate(sweeps.beams.tolist()):
            use[index, : beams : max(1, -(-beams // MAX_BEAMS))] = HIT
        use[(sweeps.status != Status.VALID) | ~(sweeps.ranges > RANGES[0]) | ~(sweeps.ranges < RANGES[1])] = SKIPPED
        row, beam = np.nonzero(use == HIT)
        end = placed(sweeps, poses, use).end[:, row, beam]
        self.points.append(np.stack([*motion.of(*end), *motion.of(poses.x[row], poses.y[row])]))
        self.windows.append(slot[rows[row]] // SLOTS)
        if len(self.points) >= AT_ONCE:
            self.judge()

    def judge(self, last: bool = False) -> None:
        """Evaluate the windows that are whole, at the end the last one, too."""
        if not self.points:
            return
        points, window = np.concatenate(self.points, axis=1), np.concatenate(self.windows)
        begin = np.flatnonzero(np.diff(window, prepend=NEVER) != 0)
        begin = np.append(begin, len(window)) if last else begin
        if len(begin) > 1:
            found = np.empty((len(begin) - 1, self.field.columns))
            judge(self.field, np.ascontiguousarray(points), begin.astype(np.int64), found)
            self.judged.append((window[begin[:-1]], np.diff(begin), found))
            self.points, self.windows = [points[:, begin[-1] :]], [window[begin[-1] :]]


@dataclass(slots=True)
class LocalisedPath(PathSummary):
    """The path of a log, judged by a map."""

    paths: dict[tuple[str, str], Localisation] = field(default_factory=dict)
    verdicts: list[CheckVerdict] = field(default_factory=list)
    unobserved: list[str] = field(default_factory=list)
    """Lines on paths that checks are about and that were not judged all the time."""

    @property
    def tells(self) -> bool:
        """False without a verdict."""
        return bool(self.paths) and all(each.tells for each in self.paths.values())

    @property
    def least(self) -> Observation | None:
        """The path that was judged least, named by its topic; None where all were judged all the time."""
        return least_observed([each.sight._replace(log=key[0]) for key, each in self.paths.items()])

    @property
    def exit_code(self) -> int:
        """1 where a check fails, else 3 without a verdict, or with less than checks ask for, else as of every run."""
        if not all(each.holds for each in self.verdicts):
            return CHECK_FAILED
        tells = self.tells and not self.unobserved
        return PathSummary.exit_code.fget(self) if tells else UnreadableError.exit_code  # type: ignore[attr-defined]

    @property
    def lines(self) -> list[str]:
        """The verdict for people."""
        if not self.paths:
            return ["no beam with a pose can be laid on the map"]
        return [f"{key[0]}: {one.words}" if len(self.paths) > 1 else one.words for key, one in self.paths.items()]

    def figures(self) -> dict[str, float | None]:
        """Return the figures that a check may name, of all paths; None for what the map does not show."""
        intervals = [each for path in self.paths.values() for each in path.intervals]
        seconds = sum(each.end - each.begin for each in intervals)
        whole = sum(len(path.window) for path in self.paths.values()) * WINDOW_NS / SECOND_NS
        off = max((each.off for each in intervals if not math.isnan(each.off)), default=0.0)
        found = (float(len(intervals)), seconds, seconds / max(whole, seconds, 1.0), off) if self.tells else (None,) * 4
        share = min((each.share for each in self.paths.values()), default=None)
        observed = min((each.sight.share for each in self.paths.values()), default=0.0)
        return dict(zip(FIGURES, (*found, share, observed), strict=True))

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values."""
        checks = [each.as_dict() for each in self.verdicts]
        return {**PathSummary.as_dict(self), "map": self.figures(), "verdict": self.lines, "checks": checks}


def findings_of(source: Source, options: PathOptions, path: str) -> list[Finding]:
    """Return the findings on the paths of a log by a map."""
    site = read_site(path)
    try:
        paths = localise(source, None, options, site).paths
    except UnreadableError as err:
        return [Finding("lost", "warning", "", "", f"{path}: nothing is judged: {err}")]
    return [
        Finding(
            "lost",
            "warning",
            *key,
            f"{path}: {each.words}",
            {"map_share": each.share, "observed": each.sight.share},
            {"map_share": MIN_SHARE},
        )
        for key, each in paths.items()
        if each.intervals or not each.tells or least_observed([each.sight]) is not None
    ]


def parse_checks(expressions: Sequence[str]) -> list[Check]:
    """Understand checks, or raise `OptionError`."""
    return [parse_check(each, only=FIGURES) for each in expressions]


def localise(
    source: Source,
    path: Place | None,
    options: PathOptions,
    site: Site,
    relocate: bool = False,
    checks: Sequence[Check] = (),
    progress: Progress | None = None,
    motion: SpaceMotion = HERE,
    first: Reading | None = None,
) -> LocalisedPath:
    """Evaluate the path of a log by a map, and write it: a table, TUM lines or a picture.

    The path is the given one to the frame of the map, as it is, or one that was named; that of a `first` reading as there.
    With `relocate` poses that are off are corrected, and those of lost seconds left out; `motion`: from the coordinates of
    the poses to those of the map; `first` as of `Reading`. Errors as of `write_path`.
    """
    suffix = "" if path is None else path.suffix.lower()
    lines = None if suffix in ("", PARQUET, PICTURE) else io.BytesIO()
    sensors: dict[tuple[str, str], _LocalisedSensor] = {}

    def take(batch: SweepBatch) -> None:
        for frame, _, sweeps in batch.by_frame():
            if not reading.posing.world_of(batch.topic, frame):
                continue
            sensor = sensors.setdefault((batch.topic, frame), _LocalisedSensor(site.field, int(sweeps.stamp_ns[0])))
            sensor.add(sweeps, motion)

    match = options.poses.source == MATCH
    options = replace(options, poses=replace(options.poses, on_map=not match))
    with read_log(source, options, Need.ALL if match else Need.TOLD, first) as reading:
        summary = read_rows(source, reading, options, progress, lines, take)
    for sensor in sensors.values():
        sensor.judge(last=True)
    paths = {key: Localisation(sensor, options.read.time_zone) for key, sensor in sorted(sensors.items())}
    run = LocalisedPath(**{name: getattr(summary, name) for name in PathSummary.__dataclass_fields__}, paths=paths)
    run.notes += filter(None, [site.grid.note])
    run.table = _judged(summary.table, paths, relocate, motion)
    worlds = sorted({*run.table["world"].to_pylist()})
    if not run.tells and any(map(of_one_run, worlds)):
        run.notes.append(
            f"the poses are in {worlds[0]}, which begins anew in every run, and the map has a frame of its own: "
            f"lidarcli diff MAP {source.name} lays them on each other"
        )
    chains = (path.chain for _, path in sorted(reading.posing.paths.items()))
    run.notes += dict.fromkeys(f"the path is that of {one.topics[0]} ({one.frames})" for one in chains if one is not None)
    figures = run.figures()
    run.verdicts = [verdict_of(check, figures[check.name]) for check in checks]
    if checks and run.tells and (least := run.least) is not None and not accepts(checks, "observed"):
        run.unobserved.append(
            f"the path of {least.log} was judged in {least.observed:,} of {least.sweeps:,} sweeps; "
            f"--check 'observed >= {floored(least.share)}' accepts that"
        )
    if path is not None:
        data = _picture(run, site.grid) if suffix == PICTURE else None if lines is None else _lines(run.table)
        save(path, options, run, data)
    return run


def _lines(table: pa.Table) -> bytes:
    """Return the poses of a table as lines of TUM."""
    from lidarcli.pose.tracks import trajectory_lines

    return trajectory_lines(table["stamp"].cast(pa.int64()).to_numpy(), _motion(table)).encode()


def _motion(table: pa.Table) -> Any:
    """Return the poses of a table in space."""
    from lidarcli.pose.tracks import PoseMotion

    return PoseMotion(
        *(np.column_stack([table[name].to_numpy() for name in names.split()]) for names in ("x y z", "qx qy qz qw"))
    )


def _judged(table: pa.Table, paths: dict[tuple[str, str], Localisation], relocate: bool, motion: SpaceMotion) -> pa.Table:
    """Return poses with the columns of a map; `relocate` and `motion` as of `localise`."""
    from lidarcli.pose.tracks import multiply, planar, upright

    count = table.num_rows
    state, share, moved = np.full(count, -1, np.int8), np.full(count, np.nan), np.full((3, count), np.nan)
    stamps, poses = table["stamp"].cast(pa.int64()).to_numpy(), _motion(table)
    place = np.stack(motion.of(*poses.position[:, :2].T))
    for rows, key in _sensors(table):
        if (path := paths.get(key)) is not None:
            state[rows], share[rows], moved[:, rows] = path.at(stamps[rows], *place[:, rows])
    changed = dict(zip(MAP_COLUMNS, (codes(state, MAP_STATES), *map(floats, (share, *moved))), strict=True))
    if relocate:
        half, flat = 0.5 * moved[2], np.zeros(count)
        rotation = upright(multiply(np.column_stack([flat, flat, np.sin(half), np.cos(half)]), poses.rotation))
        yaw = planar(poses._replace(rotation=rotation)).yaw
        values = *motion.inverse.of(*(place + moved[:2])), yaw, *rotation.T
        for name, value in zip(("x", "y", "yaw", "qx", "qy", "qz", "qw"), values, strict=True):
            changed[name] = floats(np.where(state == OFF, value, table[name]))
    for name, column in changed.items():
        index = table.schema.get_field_index(name)
        table = table.set_column(index, table.schema.field(index), column)
    return table.filter(pa.array(state != LOST)) if relocate else table


def _sensors(table: pa.Table) -> Iterator[tuple[Int64, tuple[str, str]]]:
    """Yield the rows of each topic and frame of a table of poses, and these names."""
    names = np.array([table[name].to_pylist() for name in ("topic", "frame_id")], object).T
    for key in sorted({*map(tuple, names.tolist())}):
        yield np.flatnonzero((names == key).all(axis=1)), key


def given_paths(table: pa.Table, name: str) -> GivenPaths:
    """Return the poses of a table as paths of a source of some name; none is known between poses that jump."""
    from lidarcli.pose.sources import GivenPaths
    from lidarcli.pose.tracks import TUM, gathered

    tracks, gaps = [], []
    for rows, (_, frame) in _sensors(table):
        mine = table.take(rows)
        stamps, poses = mine["stamp"].cast(pa.int64()).to_numpy(), np.column_stack(_motion(mine))
        key = name, TUM, mine["world"][0].as_py(), frame
        tracks.append(gathered(key, stamps, poses, stamps, Counter()))
        step = np.diff(mine["sweep"].to_numpy())
        is_off = np.array(mine["map_state"].to_pylist(), object) == MAP_STATES[OFF]
        moved = [np.diff(np.where(is_off, mine[name], 0.0)) for name in ("map_dx", "map_dy", "map_dyaw")]
        jumps = (step > np.median(step)) | (np.abs(moved).max(axis=0) > JUMP)
        gaps.append(np.column_stack([stamps[:-1][jumps], stamps[1:][jumps]]))
    return GivenPaths(tuple(filter(None, tracks)), np.concatenate(gaps))


def _picture(run: LocalisedPath, grid: Occupancy) -> bytes:
    """Return the map with the path, coloured by its states, and the times where it is off or lost."""
    from lidarcli.reports.map_picture import MapPicture, draw_map

    table = run.table
    xy = np.column_stack([table["x"].to_numpy(), table["y"].to_numpy()])
    # Without a verdict nothing is known of any place.
    state = np.array([one or MAP_STATES[UNSURE] for one in table["map_state"].to_pylist()], object)
    places = [(name, xy[state == name], "") for name in MAP_STATES]
    for rows, key in _sensors(table):
        path = run.paths.get(key)
        seconds = (table["stamp"].cast(pa.int64()).to_numpy()[rows] - (path.first_ns if path else 0)) / SECOND_NS
        for one in path.intervals if path else ():
            name = MAP_STATES[LOST if math.isnan(one.off) else OFF]
            part = rows[(seconds >= one.begin) & (seconds < one.end)]
            places.append((name, xy[part[state[part] == name]], f"{one.begin:.1f} to {one.end:.1f} s"))
    return draw_map(MapPicture(grid, places=places), PICTURE)
