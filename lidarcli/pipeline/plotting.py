"""A few sweeps of a log, or its map from above, as pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from lidarcli.display.texts import stamp
from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, write_whole, writing
from lidarcli.files.stores import Place
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detect import noise
from lidarcli.formalism.detection import ROUND, SETS, Detection
from lidarcli.formalism.mapping.grid import HIT, placed
from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.registry import TopicChoice, nothing_read
from lidarcli.options.choices import ANIMATIONS, AS_IT_COMES, MATCH, TRAIL, Look
from lidarcli.options.times import SAME_STAMP, SECOND_NS, Instant, Time, TimeOfDay, TimeZone
from lidarcli.pipeline.inputs.sources import Source, naming, open_source
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.needs import NO_POSES, Need, PoseOptions
from lidarcli.pipeline.reading.one_log import Progress, damage_lines, read_log
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.pipeline.zones.frames import Frames
from lidarcli.reports import map_picture
from lidarcli.reports.columns import Rows, rows_of
from lidarcli.reports.map_picture import MapBox, MapPicture, Snapshot, draw_map, overview
from lidarcli.reports.picture import animate, draw
from lidarcli.reports.scene import Picture, ZoneInSight, limits_of
from lidarcli.reports.world import COLUMNS, Paths
from lidarcli.sweeps.masks import Mount
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Int64, Status, SweepBatch, SweepPoses
from lidarcli.sweeps.zone import Zones

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.tables import TableSet
    from lidarcli.pipeline.mapping import GrowingMap, MapOptions
    from lidarcli.pipeline.objects.detection import DetectOptions
    from lidarcli.pipeline.objects.subtracting import BackgroundComparison
    from lidarcli.pipeline.zones.shown import Showing, ShownZone
P = TypeVar("P")
BATCH = 64
NEAR = 1.0
"""Greatest distance in time of the sweep that `--at` draws [s]: a gap of the log that is longer has no sweep to draw."""
SAME_RANGE = 1e-3
"""Greatest difference of two ranges of the same beam [m]."""
LATER_NS = 10 * SECOND_NS
"""Transforms tell of the mount of a sensor if they were recorded no later than this after its last sweep [ns]."""
MAX_PICTURES = 2_000
"""Most pictures of one call."""


@dataclass(frozen=True, slots=True)
class PlotOptions:
    """Sweeps to draw, and how to read them and find their objects."""

    sweeps: tuple[int, ...] | None
    """Indices within the topic; None for all."""
    topic: str | None = None
    parameters: Parameters = field(default_factory=Parameters)
    rules: RangeRules = field(default_factory=RangeRules)
    opening: OpenOptions = field(default_factory=OpenOptions)
    background: str | None = None
    """A background table, to draw r_w - r_e."""
    tracks: str | TableSet | None = None
    """Tables of `track`, to draw the paths up to each sweep."""
    trail: float = TRAIL
    """Length of these paths [s]."""
    poses: PoseOptions = field(default_factory=PoseOptions)
    """For a background of several stations."""
    start: Time | None = None
    """Of all sweeps, those from here on [s from the first one]."""
    end: Time | None = None
    """Of all sweeps, those before this [s]."""
    zones: Zones | None = None
    """Zones to draw into the scene."""
    follow: str = ""
    """Track, by its number, or zone in the middle of the scene; empty: none."""
    time_zone: TimeZone = UTC
    """Time zone of titles, and of times without one."""


@dataclass(frozen=True, slots=True)
class Drawn(Generic[P]):
    """Pictures, with the notes and the damage of reading."""

    pictures: tuple[P, ...]
    notes: tuple[str, ...]
    damage: tuple[str, ...]


def take_pictures(source: Source, options: PlotOptions, progress: Progress | None = None) -> Drawn[Picture]:
    """Return pictures of the wanted sweeps of a log with their objects; errors name the log.

    `progress` takes the position in the log [bytes] while it is read.

    Raises
    ------
    OptionError
        A sweep is not there, or not what to follow.
    NoScanError
        There is no LaserScan, or not the topic that was asked for.
    """
    with naming(source):
        return _take(source, options, _PictureMaker(source, options), progress)


def _take(source: Source, options: PlotOptions, work: _PictureMaker, progress: Progress | None) -> Drawn[Picture]:
    with open_source(source, options.opening) as log:
        choice = TopicChoice([options.topic] if options.topic else [], log.topics())
        topic, notes = _topic(choice)
        topics = frozenset({topic}) if topic else None
        masking = masking_of(log, options.rules, options.poses, topics)
        read = ReadOptions(
            topics, options.start, options.end, batch_size=BATCH, rules=masking.rules, time_zone=options.time_zone
        )
        rows: list[SweepBatch] = []
        last, last_ns, showing = -1, 0, None
        if options.zones is not None:
            # Imported here: most plots need no zones.
            from lidarcli.pipeline.zones.shown import Showing

            showing = Showing(options.zones, Frames.of(log, options.zones))
        posed = options.background or (showing is not None and showing.is_in_world)
        posing = PoseAttacher.of(log, options.poses if posed else NO_POSES, choice, read)
        report = ReadReport()
        for raw in read_batches(log, read, report):
            batch = posing.attach(raw)
            topic = topic or batch.topic
            if batch.topic != topic:
                continue
            chosen = slice(None) if options.sweeps is None else np.isin(batch.sweep, options.sweeps)
            rows += [one_sweep(batch, row) for row in np.arange(len(batch))[chosen].tolist()]
            last, last_ns = int(batch.sweep[-1]), max(last_ns, int(batch.record_ns[-1]))
            if progress is not None:
                progress(log.position)
            if options.sweeps is not None and last >= max(options.sweeps):
                break
            if len(rows) > MAX_PICTURES:
                raise OptionError(f"more than {MAX_PICTURES:,} sweeps to draw; choose some with --sweeps")
        damage = tuple(damage_lines(posing.together(report)))
        masks = masking.rules.masks
        frames = Frames.of(log, options.zones or Zones(()), masks.mounts if masks else (), last_ns + LATER_NS)
        work.place(rows, showing, frames)
    if last < 0 and report.notes and (options.start is not None or options.end is not None):
        raise OptionError(f"{source.label}: {report.notes[-1]}")
    if last < 0:
        raise nothing_read(damage, NoScanError("no LaserScan in it"), [topic] if topic else [])
    by_index = {int(row.sweep[0]): row for row in rows}
    for index in options.sweeps or ():
        if index not in by_index:
            words = f"{source.label}: no sweep {index} of {topic}: the last one is {last}"
            if damage:
                raise UnreadableError(f"{words} in the part that could be read; {damage[0]}")
            raise OptionError(words)
    order = options.sweeps if options.sweeps is not None else tuple(sorted(by_index))
    pictures = _centred([work.picture(by_index[index]) for index in order], options.follow, source.label)
    notes = (*notes, *masking.notes, *report.doubted(), *work.notes(), *_out_of_view(pictures))
    return Drawn(pictures, notes, damage)


def _centred(pictures: Sequence[Picture], follow: str, label: str) -> tuple[Picture, ...]:
    """Return pictures with a track or zone in the middle; in those without it, where it was last or will be first."""
    if not follow:
        return tuple(pictures)
    places = [
        {f"track {one.number}": one.mark for one in picture.paths}
        | {f"zone {one.zone.name}": one.middle for one in picture.areas}
        for picture in pictures
    ]
    there = [*dict.fromkeys(chain(*places))]
    name = next((each for each in (f"track {follow}", f"zone {follow}") if each in there), "")
    if not name:
        others = ", ".join(there[:12]) or "nothing to follow"
        raise OptionError(f"{label}: no track or zone {follow} in what is drawn, but {others} (--follow)")
    middle, found = next(each[name] for each in places if name in each), []
    for picture, each in zip(pictures, places, strict=True):
        middle = each.get(name, middle)
        found.append(replace(picture, followed=name, middle=middle))
    return tuple(found)


def _out_of_view(pictures: Sequence[Picture]) -> Iterator[str]:
    """Yield a note for each zone that has a place, but in none of the pictures."""
    zones = [one for picture in pictures for one in picture.areas]
    limits = limits_of(pictures if zones else ())
    visible = {one.zone.name for one in zones if len(one.in_view(limits))}
    for name in dict.fromkeys(one.zone.name for one in zones):
        if name not in visible:
            yield f"zone {name} lies outside of the picture"


def sweep_at(source: Source, time: Time, topic: str | None, opening: OpenOptions) -> int:
    """Return the index of the sweep that is nearest to a time, the first of several that are equally near.

    Raises
    ------
    OptionError
        The time is more than `NEAR` before the first sweep or after the last, or the log is standard input.
    """
    if source.is_stdin:
        raise OptionError("--at reads the log twice; give the name of its file instead of -, or --sweep")
    with open_source(source, opening) as log:
        choice = TopicChoice([topic] if topic else [], log.topics())
        name, _ = _topic(choice)
        report = ReadReport()
        best, nearest_ns, target_ns, first_ns, last_ns = -1, 0, 0, 0, 0
        for batch in read_batches(log, ReadOptions(topics=frozenset({name}) if name else None), report):
            name = name or batch.topic
            if batch.topic != name:
                continue
            if best < 0:
                first_ns = int(batch.stamp_ns[0])
                moment = time.after(first_ns) if isinstance(time, TimeOfDay) else time
                target_ns = moment.ns if isinstance(moment, Instant) else first_ns + round(moment * SECOND_NS)
            last_ns = int(batch.stamp_ns[-1])
            # The target may be farther away than int64 can hold.
            away = [abs(stamp_ns - target_ns) for stamp_ns in batch.stamp_ns.tolist()]
            if best < 0 or min(away) < nearest_ns:
                nearest_ns = min(away)
                best = int(batch.sweep[away.index(nearest_ns)])
            if int(batch.stamp_ns.min()) > target_ns + NEAR * SECOND_NS:
                break
        damage = damage_lines(report)
    if best < 0:
        raise nothing_read(damage, NoScanError("no LaserScan in it"), [name] if name else [])
    if nearest_ns > NEAR * SECOND_NS:
        nearest = f"the nearest, sweep {best}, is {nearest_ns / SECOND_NS:,.1f} s away"
        if isinstance(time, TimeOfDay) and target_ns > last_ns:
            nearest = f"its sweeps lie between {stamp(first_ns, time.zone)} and {stamp(last_ns, time.zone)}"
        raise OptionError(
            f"{source.label}: no sweep of {name} at {f'{time:g} s' if isinstance(time, float) else time}: {nearest}"
        )
    return best


def pictures_of(batch: SweepBatch, options: PlotOptions) -> tuple[Picture, ...]:
    """Return the pictures of sweeps of a batch with their objects (`OptionError` where one is not in the batch)."""
    row, sweeps = {sweep: row for row, sweep in enumerate(batch.sweep.tolist())}, options.sweeps or (0,)
    if lacking := [sweep for sweep in sweeps if sweep not in row]:
        there = f"{batch.sweep[0]} to {batch.sweep[-1]}" if len(batch) else "none"
        raise OptionError(f"no sweep {lacking[0]} of {batch.topic} in this batch, whose sweeps are {there}")
    name = batch.log or batch.topic.lstrip("/")
    make = _PictureMaker(Source(name, name), options).picture
    return _centred([make(one_sweep(batch, row[sweep])) for sweep in sweeps], options.follow, name)


def _topic(choice: TopicChoice) -> tuple[str | None, tuple[str, ...]]:
    """Return the topic to draw, the first of several, and a note that names the others."""
    if choice.is_listed and (error := choice.error()) is not None:
        raise error
    others = choice.chosen[1:]
    notes = (f"drawn is {choice.first}; also available: {', '.join(others)} (--topic NAME)",) if others else ()
    return choice.first, notes


def one_sweep(batch: SweepBatch, row: int) -> SweepBatch:
    """Return one sweep of a batch, without its padding."""
    one = batch.rows(np.array([row]))
    beams = int(one.beams[0])
    intensities = None if one.intensities is None else one.intensities[:, :beams]
    return replace(one, ranges=one.ranges[:, :beams], status=one.status[:, :beams], intensities=intensities)


class _PictureMaker:
    """Finds the objects of sweeps, compared with a background where there is one."""

    def __init__(self, source: Source, options: PlotOptions) -> None:
        self._options = options
        # A file as people know it, with its suffix.
        self._log = source.file_name
        self._subtracting: BackgroundComparison | None = None
        # Imported here, and so below: most plots need no tables.
        if options.background is not None:
            from lidarcli.pipeline.objects.subtracting import BackgroundComparison, BackgroundOptions

            self._subtracting = BackgroundComparison(BackgroundOptions.of(options.background), options.parameters)
        self._paths: Paths | None = None
        self._objects: Rows | None = None
        self._lacks_agents = False
        """True where no beam of a sweep has the range of an agent in the tables."""
        self._showing: Showing | None = None
        self._zones: dict[int, list[ShownZone]] = {}
        """Sweep → zones before its sensor."""
        self._mounts: dict[int, Mount | None] = {}
        """Sweep → place of its sensor on the robot."""

    def place(self, rows: Sequence[SweepBatch], showing: Showing | None, frames: Frames) -> None:
        """Place the sensor and zones in sweeps that are to be drawn, while their log is open."""
        self._showing = showing
        self._mounts = {int(batch.sweep[0]): frames.mount_of(batch) for batch in rows}
        if showing is not None:
            for batch in rows:
                sets = self._with_agents(batch, detect(batch, self._options.parameters, per_beam=True)).beam_set
                self._zones[int(batch.sweep[0])] = [*showing.of(batch, sets)]

    def picture(self, batch: SweepBatch) -> Picture:
        """Return the picture of one sweep with its objects."""
        parameters, known = self._options.parameters, self._paths_of(batch)
        threshold = parameters.threshold
        paths = None if known is None else known.up_to(int(batch.sweep[0]), self._options.trail)
        detection = self._with_agents(batch, detect(batch, parameters, per_beam=True))
        if paths is not None:
            culprits = self._culprits(batch)
            paths = tuple(replace(one, zone=culprits.get(one.number, "")) for one in paths)
        picture = Picture(
            log=self._log,
            time_zone=self._options.time_zone,
            batch=batch,
            detection=detection,
            profile=parameters.profile,
            threshold=threshold if isinstance(threshold, str) else "given",
            # Not static objects that are hidden: a crowd hides dozens.
            tracks=None
            if paths is None
            else tuple(one for one in paths if one.seen or one.is_agent or str(one.number) == self._options.follow),
            mount=self._mounts.get(int(batch.sweep[0])),
            zones=tuple(
                ZoneInSight(one.zone, one.corners[0], one.beams[0], bool(one.occupied[0]))
                for one in self._zones.get(int(batch.sweep[0]), ())
                if np.isfinite(one.corners).all()
            ),
        )
        if self._subtracting is None:
            return picture
        found = self._subtracting.difference(batch, noise(batch))
        r_e = found.r_e[0].astype(np.float64)
        return replace(
            picture,
            detection=self._with_agents(batch, self._subtracting.detect(batch, per_beam=True)),
            background=np.where(np.isfinite(r_e), r_e, np.nan),
            difference=found.difference[0].astype(np.float64),
        )

    def _with_agents(self, batch: SweepBatch, found: Detection) -> Detection:
        """Return a detection whose beams on agents are in set A, as far as tracks say."""
        assert found.beam_set is not None  # pictures are made with `per_beam`
        letter, _ = self._owners(batch)
        of_agents = letter == SETS.index("A")
        return replace(found, beam_set=np.where(of_agents, letter, found.beam_set).astype(found.beam_set.dtype))

    def _owners(self, batch: SweepBatch) -> tuple[Int64, Int64]:
        """Return set and track of the object of the tables that each beam of one sweep is on (1, B); -1 for none."""
        self._paths_of(batch)
        if self._objects is None or not len(rows := rows_of(self._objects, batch.topic, batch.sweep)[0]):
            return (none := np.full(batch.ranges.shape, -1)), none
        from lidarcli.pipeline.inputs.tracked import Objects
        from lidarcli.tabular.columns import plain

        found = Objects.of(self._objects.table.take(plain(rows)).combine_chunks().to_batches()[0], batch)
        r = self._objects.numbers("r_min")[rows][found.set == SETS.index("A")]
        self._lacks_agents |= len(r) > 0 and not (np.abs(batch.ranges[0] - r[:, None]) < SAME_RANGE).any()
        owner = found.owners(batch)
        letter, track = (np.append(values.astype(np.int64), -1)[owner] for values in (found.set, found.track))
        return letter, track

    def _culprits(self, batch: SweepBatch) -> dict[int, str]:
        """Return the track with most points in each occupied zone → the name of the zone, as `zones` reports it."""
        track, culprits = self._owners(batch)[1][0], dict[int, str]()
        for one in self._zones.get(int(batch.sweep[0]), ()):
            numbers, counts = np.unique(track[one.beams[0]], return_counts=True)
            # Of as many points a wall, -1, comes last, as in the events.
            if one.occupied[0] and (most := numbers[counts == counts.max()].max()) >= 0:
                culprits.setdefault(int(most), one.zone.name)
        return culprits

    def _paths_of(self, batch: SweepBatch) -> Paths | None:
        """Return the tracks of the topic of all sweeps; None without tables (`OptionError` where they lack this sweep)."""
        if (tables := self._options.tracks) is None:
            return None
        # The path of the objects table names those in memory, too.
        name = tables if isinstance(tables, str) else str(tables.objects)
        if self._paths is None:
            from lidarcli.pipeline.inputs.tables import one_table_set, read_together

            columns = COLUMNS | {"objects": (*COLUMNS["objects"], "object", "beam_i", "beam_f", "vx", "vy")}
            read = {kind: Rows.join([each]) for kind, each in read_together(one_table_set(tables), columns).items()}
            self._objects = read["objects"]
            self._paths = Paths(read["sweeps"], read["objects"], read["trajectories"], batch.topic)
            if not self._paths.are_there:
                raise OptionError(f"{name}: no tracks of {batch.topic} in it; lidarcli track LOG writes them")
        sweep = int(batch.sweep[0])
        if (stamp_ns := self._paths.stamp_of(sweep)) is None:
            raise OptionError(f"{name}: no sweep {sweep} of {batch.topic} in it")
        if abs(stamp_ns - int(batch.stamp_ns[0])) > SAME_STAMP:
            raise UnreadableError(f"{name}: not of this log: sweep {sweep} of {batch.topic} has another stamp in it")
        return self._paths

    def notes(self) -> list[str]:
        """Return the notes of the comparison, and of zones."""
        compared = [] if self._subtracting is None else self._subtracting.notes()
        compared += ["agents in --tracks have other ranges: of another recording, or a changed copy"] * self._lacks_agents
        return compared if self._showing is None else [*compared, *self._showing.notes()]


def picture_bytes(picture: Picture | MapPicture, view: str, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """Return a picture as a PNG, SVG or PDF."""
    return draw_map(picture, suffix, look) if isinstance(picture, MapPicture) else draw(picture, view, suffix, look)


def followed(
    source: Source, zones: Zones | None, detect: DetectOptions, folder: Path, progress: Progress | None = None
) -> TableSet:
    """Return the tables of the tracks of a log, written below a folder, with the numbers that `zones` gives them."""
    from lidarcli.pipeline.detecting import detect_to_temporary
    from lidarcli.pipeline.zones.options import ZoneOptions, masked, narrowed

    with open_source(source, detect.opening) as log:
        options = narrowed(log, ZoneOptions(zones or Zones(()), (), detect))
        masking = masking_of(log, detect.read.rules, detect.poses, options.detect.read.topics)
        return detect_to_temporary(source, folder, masked(log, options, masking), progress)[0]


def write_pictures(
    paths: Sequence[Place],
    pictures: Sequence[Any],
    view: str,
    overwrite: bool,
    look: Look = AS_IT_COMES,
    report: Callable[[int], None] | None = None,
) -> list[str]:
    """Write each picture to its file, or all as one that moves, by its suffix; notes as of `NewFiles.publish`.

    `report` takes the number of those that are done. `OutputError`: a file cannot be written.
    """
    if paths[0].suffix.lower() in ANIMATIONS:
        with NewFiles(paths, overwrite) as new:
            with writing(paths[0]):
                animate(pictures, view, new.part(paths[0]), look, report)
            return new.publish()
    notes: list[str] = []
    for number, (path, picture) in enumerate(zip(paths, pictures, strict=True), 1):
        notes += write_whole(path, picture_bytes(picture, view, path.suffix.lower(), look), overwrite)
        if report is not None:
            report(number)
    return notes


def take_map(
    source: Source,
    options: MapOptions,
    sweeps: Sequence[int] | None = None,
    tracks: str | TableSet | None = None,
    only: Sequence[int] = (),
    density: bool = False,
    progress: Progress | None = None,
) -> Drawn[MapPicture]:
    """Return pictures of the map of a log with the path of its sensor.

    Parameters
    ----------
    sweeps : a picture for each of these, with its points and the boxes of its objects; None: one of the whole run
    tracks : table of `track` in the folder of the others of the log: static objects, and what moved
    only : numbers of the tracks that are drawn; by default all
    density : True to draw how long agents were where, in place of their paths

    Raises
    ------
    UnreadableError
        Nothing tells where the sensor was.
    OptionError
        A sweep is not there or has no pose, or the tables are of another log.
    """
    from lidarcli.pipeline.mapping import GrowingMap

    mapping = GrowingMap(options)
    with naming(source):
        summary = mapping.add(source, progress=progress)
    paths = [np.column_stack([path.x, path.y]) for path in mapping.paths]
    found, notes = MapPicture(None), [*summary.notes]
    if tracks is not None:
        found, more = _overview(tracks, source, mapping, summary.first_ns or 0, only, density)
        notes += more
    full = replace(found, grid=mapping.occupancy(), paths=paths, title=f"{source.name}  {_frame_words(mapping.worlds)}")
    pictures = [full]
    if density and full.dwell is None:
        notes.append("no agents: --density has nothing to draw")
    if sweeps is not None:
        shots = _snapshots(source, mapping.options, sweeps)
        pictures = [replace(full, snapshot=shots[sweep], title=f"{source.name}  sweep {sweep}") for sweep in sweeps]
    return Drawn(tuple(pictures), tuple(notes), tuple(summary.damage))


def _frame_words(worlds: Iterable[str]) -> str:
    return ", ".join("path matched from the sweeps" if one == MATCH else f"frame {one}" for one in worlds)


def _overview(
    tracks: str | TableSet, source: Source, mapping: GrowingMap, first_ns: int, only: Sequence[int], density: bool
) -> tuple[MapPicture, list[str]]:
    """Return the objects and agents in the tables of this log that are of the topics and worlds of the map, and notes.

    `first_ns` is the stamp of the first sweep of the log.
    """
    from lidarcli.pipeline.inputs.tables import one_table_set, other_recording, poses_of, read_together, world_in
    from lidarcli.tabular.reading import note_value, notes_of
    from lidarcli.tabular.writing import SOURCE

    pair = one_table_set(tracks)
    read = read_together(pair, map_picture.COLUMNS)
    sweeps, things, trajectories = (Rows.join([read[kind]]) for kind in ("sweeps", "tracks", "trajectories"))
    _, logs = sweeps.words("log")
    log_name = source.name.rpartition("/")[2]
    if logs and log_name not in [name.rpartition("/")[2] for name in logs]:
        raise OptionError(f"{tracks}: is of the log {logs[0]}, not of {source.label}")
    topics = [path.topic for path in mapping.paths]
    sweeps, things, trajectories = (each.of_topics(topics) for each in (sweeps, things, trajectories))
    if not len(sweeps):
        raise OptionError(f"{tracks}: no tracks of {', '.join(topics)} in it; lidarcli track LOG writes them")
    stamps = sweeps.integers("stamp")
    if stamps.max() < first_ns - SAME_STAMP or stamps.min() > mapping.end_ns + SAME_STAMP:
        raise UnreadableError(f"{tracks}: not of this log: its sweeps have other stamps")
    notes = other_recording(pair, recording := mapping.described[-1].get("recording", {}))
    total = sum(int(recording.get(topic, "0").split()[0]) for topic in topics)
    if len(sweeps) < total:
        begin, end = ((int(each) - first_ns) / SECOND_NS + 0.0 for each in (stamps.min(), stamps.max()))
        some = f"{len(sweeps):,} of {total:,} sweeps ({begin:.1f} s to {end:.1f} s)"
        notes.append(f"{pair.tracks}: of {some}: what is in the others is not drawn")
    if lacking := sorted({*only} - {*things.integers("track").tolist()}):
        raise OptionError(f"{tracks}: no track {', '.join(map(str, lacking))} in it (--only)")
    if only:
        things = things.where(np.isin(things.integers("track"), only))
    # A matched path begins at 0, and no pose of a stationary sensor is known otherwise.
    is_static = [*mapping.worlds] == [MATCH] and all(path.stands for path in mapping.paths)
    found = overview(sweeps, things, trajectories, is_static, density=density)
    sources = poses_of(note_value(notes_of(read["sweeps"]), SOURCE, dict)).values()
    worlds = {world for one in sources for topic in topics if (world := world_in(one, topic))}
    if worlds and worlds.isdisjoint(mapping.worlds):
        raise OptionError(
            f"{tracks}: tracked in another world ({_frame_words(sorted(worlds))}) than that of the map "
            f"({_frame_words(mapping.worlds)}); give both commands the same --pose"
        )
    if found is None:
        raise OptionError(
            f"{tracks}: its sweeps have no poses: things have no place in the world; give track and plot the same --pose"
        )
    return found, notes


def _snapshots(source: Source, options: MapOptions, sweeps: Sequence[int]) -> dict[int, Snapshot]:
    """Return some sweeps in the world, by their index; of several topics, those of the first that has them."""
    wanted = np.array(sorted(set(sweeps)))
    found: dict[int, Snapshot] = {}
    with read_log(source, options, Need.ALL) as reading:
        for batch in reading.batches(None):
            for row in np.flatnonzero(np.isin(batch.sweep, wanted)).tolist():
                one = batch.rows(np.array([row]))
                poses = one.poses
                index = int(one.sweep[0])
                if poses is not None and np.isfinite(poses.x[0]) and index not in found:
                    found[index] = _snapshot(one, poses, options)
            if len(found) == len(wanted):
                break
    if missing := [sweep for sweep in sweeps if sweep not in found]:
        raise OptionError(f"{source.label}: no sweep {missing[0]} with a pose in this log")
    return found


def _snapshot(one: SweepBatch, poses: SweepPoses, options: MapOptions) -> Snapshot:
    """Return one sweep in the world."""
    use = np.where(one.status == Status.VALID, HIT, 0).astype(np.uint8)
    end = placed(one, poses, use).end
    placed_beams = np.isfinite(end[0, 0])
    objects = detect(one, options.parameters)
    x, y, yaw = poses.to_world(objects.row, objects.box_x, objects.box_y, objects.box_yaw, objects.shares(one))
    columns = (x, y, yaw, objects.box_length, objects.box_width, objects.shape == ROUND)
    sides = zip(*(column.tolist() for column in columns), strict=True)
    boxes = tuple(MapBox._make([*each, ""]) for each in sides)
    pose = (float(poses.x[0]), float(poses.y[0]), float(poses.yaw[0]))
    return Snapshot(int(one.sweep[0]), pose, end[:, 0, placed_beams].T, boxes)
