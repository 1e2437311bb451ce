"""A log written once more: without what moves in it, mended, or parts of it; all else is the same."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.copying.copying import ALL, MAX_SAID, Copy, Cut, Targets, copy_log, replaced
from lidarcli.display.texts import counted
from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse, refuse_nameless, scratch_folder, writing
from lidarcli.files.stores import Place, Url
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.tracking.results import HIDDEN, VIEWS
from lidarcli.formalism.tracking.tracker import share_moving
from lidarcli.formalism.zones import samples, seen
from lidarcli.logs.base import CLOUD_TYPES, SCAN_TYPES, STATIC, Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches, refuse_run
from lidarcli.logs.blocks import ScanLayout
from lidarcli.logs.registry import SUFFIXES, TopicChoice, format_of, nothing_read, scan_topics
from lidarcli.options.choices import ABOVE, AROUND, INF, KEEP, MATCH, NAN
from lidarcli.options.times import SECOND_NS, Instant
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, contradicted, world_in
from lidarcli.pipeline.mending import FOREVER, Cutting, Mending, clips_of, plan, survey
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.needs import NO_POSES, NONE, Need
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary, damage_lines, rules_of
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.pipeline.zone_counting import OBJECT_COLUMNS, Objects
from lidarcli.pose.findings import Key
from lidarcli.sweeps.findings import LEAP
from lidarcli.sweeps.masks import Polygon
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import STATUSES, Bool, Closure, Float64, Int32, Int64, Status, SweepBatch, SweepPoses
from lidarcli.sweeps.zone import WORLD
from lidarcli.tabular.columns import constant, held, numbers, restamped
from lidarcli.tabular.reading import Readable, TopicRows, file_metadata, note_value, read_columns
from lidarcli.tabular.schemas import CLEANED, SCHEMAS
from lidarcli.tabular.writing import PARAMETERS, SOURCE, ParquetSink, table_metadata, table_suffix

if TYPE_CHECKING:
    from lidarcli.pipeline.merging import Merging

MAX_PLACED = 0.5
"""A sensor is placed if poses tell where it was at this share of its sweeps."""
MOSTLY = 0.9
"""A sensor stood if it did so at this share of its sweeps."""
POINTS = "sensor_msgs/msg/PointCloud"
REASONS = ("agents", "temporary", "body", "margin")
"""Reasons for which a beam is chosen, the first that holds; columns of the table."""
AGENTS, TEMPORARY, BODY, MARGIN = range(1, 5)
FREE_SHARE, FREE_SWEEPS = 0.5, 3
"""A place was seen free where so much of it was in view and not hidden in so many sweeps."""
REACH, REACH_AROUND = 0.45, 0.1
"""A piece belongs to an agent if it ends so near to its middle [m], or so near to its box if that is larger."""
LINK = 0.1
"""Greatest step in range between beams of one piece [m], beside what its slant takes."""
MAX_SD = 0.3
"""Greatest standard deviation of a place of an agent that tells where its beams are [m]."""
MIN_SPEED, MOVING_SDS = 0.1, 2.0
"""Least speed of what is on its way [m/s], and least way in standard deviations."""
PAIRS = 256
"""Places of agents that are looked at together."""
MIN_SIDE = 0.1
"""Least side of the place of a thing [m]: what stands at a leg is wider than the points on it."""
_NONE = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True)
class CleanOptions:
    """Options of `clean`, apart from input and output."""

    detect: DetectOptions
    """Options of reading, detection and tracking; a mask tells the robot itself, times and run the part to write."""
    remove: frozenset[str] = frozenset({"agents"})
    """Kinds of beams that are removed beside those under a mask: of agents and temporary."""
    value: str | float = NAN
    """Value of removed beams: one of `SAYINGS`, or a range [m]."""
    margin: int = 1
    """Neighbours of these beams that are removed, too."""
    overwrite: bool = False
    mend: frozenset[str] | None = None
    """Faults that are mended: words of `MENDS`, or `FOUND`; None: none."""
    clips: Readable | None = None
    """Table with a row for each log that is written."""
    around: float = AROUND
    """Time before and after each of its rows [s]."""
    merge: str | None = None
    """Topic of the merged sweeps of a robot; None: none are written."""
    merge_frame: str | None = None
    """Frame of these; None: that of the robot itself."""

    def inputs(self, sources: Sequence[Source]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        return [*self.detect.inputs(sources), *([str(self.clips)] if isinstance(self.clips, Path) else [])]

    @property
    def is_cut(self) -> bool:
        """True if only a part of the log is written, or more than it: of a folder one file."""
        return self.merge is not None or not self.is_whole

    @property
    def is_whole(self) -> bool:
        """True if no part of the log is left out."""
        read = self.detect.read
        return all(each is None for each in (read.start, read.end, read.run, self.clips))

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the table's metadata."""
        own: dict[str, Any] = {"remove": sorted(self.remove), "value": self.value, "margin": self.margin}
        own |= {"mend": sorted(self.mend)} if self.mend is not None else {}
        own |= {"merge": [self.merge, self.merge_frame]} if self.merge is not None else {}
        return self.detect.as_dict() | own


@dataclass(slots=True)
class CleanSummary(RunSummary):
    """The counts of one run over one log, and its lines for people."""

    table: pa.Table = field(default_factory=CLEANED.empty_table)
    """One row per sweep."""
    line: str = ""
    """Values of beams in the copy, and their reasons."""
    copied: str = ""
    """Number of messages that were copied."""
    mended: dict[str, dict[str, int]] = field(default_factory=dict)
    """Topic → word of `--mend` → sweeps that it changed."""
    removed: dict[str, int] = field(default_factory=dict)
    """Reason that was asked for → beams that say something else in the copy."""

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values."""
        return {**RunSummary.as_dict(self), "removed": self.removed, "mended": self.mended}

    @property
    def lines(self) -> list[str]:
        """The lines for people."""
        words = {
            topic: ", ".join(f"{word} {count:,}" for word, count in each.items()) for topic, each in self.mended.items()
        }
        mended = [f"  mended   {topic}: {shown}" for topic, shown in sorted(words.items())]
        return [self.line, *mended, f"  copied   {self.copied}"]


def clean_log(source: Source, path: Place, options: CleanOptions, progress: Progress | None = None) -> CleanSummary:
    """Write a log mended, in parts, and without what moves in it; beside it the table of what was left out, if anything.

    Raises
    ------
    OptionError
        The log is none that can be cleaned or mended, or the output is another container, or the input.
    UnreadableError
        The log or the table of clips cannot be read, or it is not known how its sensor moved.
    NoScanError
        The log has no LaserScan topic, or not the one that was asked for.
    OutputError
        A file cannot be written.
    """
    with ExitStack() as stack:
        _refuse_names(source, path)
        # Messages are copied one by one, so they are read as they are.
        opening = replace(options.detect.opening, segments=KEEP)
        log = stack.enter_context(open_source(source, opening))
        _refuse(log, source, path, options)
        mending, cuts = _planned(source, log, path, options)
        table = [_table_path(path)] if options.remove else []
        outputs = [*cuts, *table]
        new = stack.enter_context(NewFiles(outputs, options.overwrite, _bag(log, source, path, options.is_cut)))
        targets = [(new.part(each), cut) for each, cut in cuts.items()]
        merging = _merging(source, log, options, stack) if options.merge is not None else None
        if merging is not None:
            merging.copies = _copies(cuts.values(), merging.keys[0][0])
        for name, mend in mending.topics.items():
            mend.copies = _copies(cuts.values(), name)
        parameters = options.as_dict()
        copy = mending.copy(log) if merging is None else merging.copy(mending.copy(log))
        if not options.remove:
            with writing(path):
                copy_log(log, targets, copy)
            copied = copy.written if all(cuts.values()) else copy.sweeps
            summary = CleanSummary(sweeps=copied.total(), topics={*copied})
            summary.line = counted(summary.sweeps, "sweep")
        else:
            # Who moves is told by the whole log, whatever part of it is written, and by right stamps.
            read = replace(options.detect.read, start=None, end=None, run=None)
            poses = replace(options.detect.poses, delay=None) if mending.topics else options.detect.poses
            options = replace(options, detect=replace(options.detect, read=read, poses=poses))
            if mending.topics or mending.said:
                folder = stack.enter_context(scratch_folder(path.parent if isinstance(path, Path) else None))
                mended = replace(source, path=str(folder / Path(source.path).name), found=None)
                with writing(path):
                    copy_log(log, Path(mended.path), copy)
                source, log = mended, stack.enter_context(open_source(mended, opening))
            private = new.part(table[0]).with_name(f"{path.name}.tables")
            summary, copy = _emptied(source, log, private, targets, options, parameters, merging, progress)
            with ParquetSink(new.part(table[0]), summary.table.schema, table[0]) as sink:
                for rows in summary.table.to_batches():
                    sink.write(rows)
                sink.finish(summary.table.schema.metadata)
        summary.damage = [*dict.fromkeys([*summary.damage, *damage_lines(copy.report)])]
        for name, mend in mending.topics.items():
            if odd := mend.done.pop("odd", 0):
                summary.notes.append(f"{counted(odd, 'message')} of {name} not mended: more or less than a LaserScan")
        summary.mended = {name: dict(mend.done) for name, mend in mending.topics.items() if mend.done}
        summary.mended |= {STATIC: {"statics": len(mending.said)}} if mending.said else {}
        if options.mend is not None and not summary.mended:
            summary.notes.append("nothing is mended")
        summary.copied = _copied(copy, summary.topics if options.remove else None)
        if copy.left_out:
            summary.notes.append(f"{counted(copy.left_out, 'record')} of applications are not copied")
        if copy.unsaid:
            summary.notes.append(f"{counted(copy.unsaid, 'latched message')} of before not copied: more than {MAX_SAID:,}")
        summary.notes += [*mending.left, *(merging.notes() if merging is not None else [])]
        if not cuts:
            summary.notes.append(f"no row of {options.clips} is of this log: no clip is written")
        summary.notes += new.publish()
        summary.outputs = [str(each) for each in outputs]
    return summary


def _planned(source: Source, log: Log, path: Place, options: CleanOptions) -> tuple[Mending, dict[Place, Cut | None]]:
    """Return how a log is mended, and what is written: each with its part of the log, None for all of it."""
    detect, asked = options.detect, options.detect.read
    whole: dict[Place, Cut | None] = {path: None if options.merge is None else ALL}
    if options.mend is None and options.is_whole and (options.remove or asked.rules.masks is None):
        if not options.remove and options.merge is None:
            raise OptionError(
                "--remove none leaves nothing to do: add --mend, --merge, --start, --end, --run, --clips or --mask"
            )
        return Mending(), whole
    # Where beams are removed those of the robot are, too.
    masks = None if options.remove else masking_of(log, asked.rules, detect.poses, asked.topics).rules.masks
    read = replace(asked, rules=replace(asked.rules, masks=masks), start=None, end=None, run=None)
    choice, report = TopicChoice(read.topics, log.topics()), ReadReport()
    seen = survey(log, choice, read.rules, report)
    if (error := choice.error(every=True)) is not None or not seen:
        raise nothing_read(damage_lines(report), error or NoScanError(f"{source.path}: no sweep"), choice.wanted)
    opening = replace(detect.opening, segments=KEEP)
    hidden = None if options.value == ABOVE else float(options.value)
    mending = plan(source, log, options.mend or frozenset(), replace(detect, read=read, opening=opening), hidden, seen)
    leaves = frozenset(scan_topics(log.topics() or ()) if choice.wanted else ()) - {*seen}
    cutting = Cutting(seen, mending, leaves)
    if options.clips is not None:
        stem, suffix = PurePosixPath(source.name).name, _suffix(log, source, True)
        cuts: dict[Place, Cut | None] = {}
        lacking = 0
        for name, clip in clips_of(options.clips, source.name, options.around).items():
            found = cutting.around(clip)
            lacking += not found
            for run, part in found.items():
                of_run = f"-run{run}" if len(found) > 1 else ""
                cuts[path / f"{stem}.{name}{of_run}{suffix}"] = part
        if lacking and cuts:
            mending.left.append(f"{counted(lacking, 'row')} of {options.clips} without a sweep around: no clip")
        return mending, cuts
    if options.is_whole:
        return mending, whole
    refuse_run(asked.run, max(int(each.run.max()) for each in seen.values()))
    begin = min(int(each.blocks[0].time_ns[0]) for each in seen.values())
    first, last = (
        none if each is None else each.ns if isinstance(each, Instant) else begin + math.ceil(each * SECOND_NS)
        for each, none in ((asked.start, -FOREVER), (asked.end, FOREVER))
    )
    cut = cutting.part(first, last - 1, asked.run)
    if cut is None:
        raise OptionError("no sweep lies between --start and --end")
    return mending, {path: cut}


def _emptied(
    source: Source,
    log: Log,
    private: Path,
    targets: Targets,
    options: CleanOptions,
    parameters: dict[str, Any],
    merging: Merging | None,
    progress: Progress | None,
) -> tuple[CleanSummary, Copy]:
    """Write a log without what moves in it; `parameters` are those that the table tells."""
    pair, first = detect_to_temporary(source, private, options.detect, progress)
    if not first.summary.sweeps:
        raise nothing_read(first.summary.damage, NoScanError("no sweep to clean"), sorted(options.detect.read.topics or ()))
    notes = file_metadata(pair.sweeps)
    described = note_value(notes, SOURCE, dict)
    if joined := described.get("segments"):
        raise OptionError(
            f"{source.path}: messages of {joined[0]} are segments of a turn, which clean cannot write back; "
            f"--segments {KEEP} cleans each alone"
        )
    mask = described.get("mask")
    rules = rules_of(note_value(notes, PARAMETERS, dict), mask if isinstance(mask, dict) else None)
    blind = _blind(pair)
    _refuse_motion(log, pair, described | {"gap": first.posing.file_gap}, options, rules, blind)
    chosen = choose(log, pair, options, rules, first.posing, second_half(progress, source.size))
    editing = _Editing(chosen, options.value)
    copy = Copy(editing) if merging is None else merging.copy(Copy(editing))
    with writing(private.parent):
        copy_log(log, targets, copy)
    editing.conclude(copy.sweeps)
    rows: dict[str, Int64] = {}
    """Topic → sweeps in the copy, several times where several parts have them."""
    for topic, each in chosen.items():
        copies = _copies([cut for _, cut in targets], topic)
        rows[topic] = np.array(range(len(each.beam)) if copies is None else sorted(copies.elements()), np.int64)
    summary = _summary(first.summary, options, chosen, rows, editing)
    summary.by_status = _statuses(pair, rows)
    summary.notes += [f"no beam of {topic} has a range: nothing moves there" for topic in sorted(blind)]
    damage = [*dict.fromkeys([*summary.damage, *damage_lines(copy.report)])]
    table = restamped(_table(source.name, chosen, rows), options.detect.stamps)
    summary.table = table.replace_schema_metadata(table_metadata(parameters, described, damage))
    return summary, copy


def _merging(source: Source, log: Log, options: CleanOptions, stack: ExitStack) -> Merging:
    """Return what merges the sensors of a robot; it reads the log beside the pass that copies it."""
    # Most copies merge nothing, and should not wait for this import.
    from lidarcli.pipeline.merging import merging_of

    read = replace(options.detect.read, start=None, end=None, run=None)
    beside = stack.enter_context(open_source(source, replace(options.detect.opening, segments=KEEP)))
    reading = stack.enter_context(Reading(beside, read, replace(options.detect.poses, together=True), Need.ALL))
    return merging_of(log, reading, options.merge or "", options.merge_frame)


def _table_path(path: Place) -> Place:
    """Return the path of the table beside a log."""
    return path.with_name(f"{_stem(path)}{table_suffix('cleaned')}")


def _stem(path: Place) -> str:
    """Return the name of a log without the suffixes of its container."""
    stem = path.name
    for suffix in (".zstd", ".mcap", ".bag", ".db3"):
        if stem.lower().endswith(suffix):
            stem = stem[: -len(suffix)]
    return stem


def _refuse_names(source: Source, path: Place) -> None:
    """Refuse names that cannot be those of a log and its copy."""
    if source.is_stdin:
        raise OptionError("a log is cleaned by reading it twice; give the name of its file instead of -")
    if str(path) == "-":
        raise OptionError("a log is no text for standard output; give the name of a file")
    refuse_nameless(path)
    if isinstance(path, Url):
        same = str(path) == source.path
    else:
        original = Path(source.path)
        same = original.is_dir() and original.resolve() in path.resolve().parents
        with suppress(OSError):
            same |= path.samefile(original)
    if same:
        raise OptionError(f"{path} is the log that is read; write elsewhere with -o")


def _refuse(log: Log, source: Source, path: Place, options: CleanOptions) -> None:
    """Refuse logs that cannot be cleaned, and outputs that cannot be written, before any work."""
    if not format_of(log).magic or source.parts:
        raise OptionError(f"{source.path}: only MCAP and ROS bags can be cleaned")
    topics = log.topics() if options.remove else None
    chosen = frozenset(TopicChoice(options.detect.read.topics, topics).chosen)
    for topic in topics or ():
        if topic.name in chosen and topic.encoding == "json":
            raise OptionError(f"{source.path}: {topic.name} is in JSON, which has no NaN, and cannot be cleaned")
        if topic.name in chosen and topic.encoding == "protobuf" and options.value == ABOVE:
            raise OptionError(f"--value above: {topic.name} is a {topic.type}, which tells no range_max")
    if options.clips is not None:
        return
    wanted = _suffix(log, source, options.is_cut)
    name = path.name.lower()
    fits = name.endswith(wanted) if wanted else not name.endswith(SUFFIXES)
    if not fits and not wanted:
        raise OptionError(
            f"{path}: {source.path} is a ROS 2 bag folder, and clean changes no container: name a folder, e.g. "
            f"-o {path.with_name(_stem(path))}"
        )
    if not fits:
        raise OptionError(f"{path}: a copy of {source.path} has to have the suffix {wanted}; clean changes no container")
    if not wanted and isinstance(path, Url):
        raise OptionError(f"{path}: the folder of a ROS 2 bag is not written into a store")
    outputs = [path, *([_table_path(path)] if options.remove else [])]
    refuse(outputs, options.overwrite, options.inputs([source]), _bag(log, source, path, options.is_cut))


def _bag(log: Log, source: Source, path: Place, is_cut: bool) -> Place | None:
    """Return the path of a copy that is a folder."""
    return None if _suffix(log, source, is_cut) else path


def _suffix(log: Log, source: Source, is_cut: bool) -> str:
    """Return the suffix of a copy, or of a part; empty for a folder, whose parts are files."""
    if Path(source.path).is_dir():
        if is_cut and "+" in log.format:
            raise OptionError(f"{source.path}: the bag has files of two kinds; cut one of them")
        return "" if not is_cut else ".mcap" if "mcap" in log.format else ".db3"
    suffix = format_of(log).suffixes[0]
    is_packed = suffix == ".db3" and log.compression == "zstd" and source.path.endswith(".zstd") and not is_cut
    return f"{suffix}.zstd" if is_packed else suffix


def _blind(pair: TableSet) -> set[str]:
    """Return the topics of which no beam has a range."""
    rows = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "valid"))
    topics, valid = np.array(rows["topic"].to_pylist(), np.str_), held(rows["valid"])[0]
    return {name for name in np.unique(topics).tolist() if not valid[topics == name].any()}


def _refuse_motion(
    log: Log, pair: TableSet, described: dict[str, Any], options: CleanOptions, rules: RangeRules, blind: Collection[str]
) -> None:
    """Refuse a log if it is not known where its sensor was while it moved; topics in `blind` have no ranges."""
    for frame, source in described.get("poses", {}).items():
        for topic, (words, is_apart) in contradicted(source, described["gap"]).items():
            if world_in(source, topic) not in (("",) if is_apart else ("", MATCH)):
                raise UnreadableError(f"the poses of {frame or 'the sensor'} {words}")
    rows = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "pose_x"))
    topics, known = np.array(rows["topic"].to_pylist(), np.str_), held(rows["pose_x"])[1]
    seeing = [name for name in np.unique(topics).tolist() if name not in blind]
    unplaced = [name for name in seeing if known[topics == name].mean() < MAX_PLACED]
    if not unplaced:
        return
    detect = options.detect
    choice = TopicChoice(detect.read.topics, log.topics())
    runs = PoseAttacher.of(log, NO_POSES, choice, ReadOptions(rules=rules), need=Need.MOVING).every
    tracks = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], ("topic", "set", "sweeps")).to_pylist()
    for topic in unplaced:
        looks = [path for run in runs for (name, _), path in run.paths.items() if name == topic]
        stood = bool(looks) and all(len(path.still) and path.still.mean() >= MOSTLY for path in looks)
        drove = any(not len(path.still) for path in looks)
        mine = [row for row in tracks if row["topic"] in (topic, None)]
        share = share_moving([row["sweeps"] for row in mine], [row["set"] == "A" for row in mine])
        if stood or not (drove or share is not None):
            continue
        seems = "the sensor moves" if share is None else f"{share:.0%} of what stands seems to move"
        why = "no poses (--pose none)" if detect.poses.source == NONE else "no poses, and the path cannot be matched"
        raise UnreadableError(f"{why}: {seems}; nothing written")


class _Editing:
    """Replaces the chosen beams of messages, which come in the order of their topics."""

    def __init__(self, chosen: dict[str, Chosen], value: str | float) -> None:
        self._chosen, self._value = chosen, value
        self.is_measurable = False
        """True where a message says a range that is within its limits."""

    def __call__(self, topic: str, number: int, data: bytes, written: ScanLayout) -> bytes:
        """Return the message to write, as `copying.Edit`."""
        mine = self._chosen.get(topic)
        if mine is None:
            return data
        if number >= len(mine.beam) or written.beams != mine.beams[number]:
            raise _changed(topic)
        # A stamp that is farther off has been mended.
        if written.stamp_ns and 0 < abs(written.stamp_ns - int(mine.stamp_ns[number])) < LEAP * SECOND_NS:
            raise _changed(topic)
        if not len(mine.beam[number]):
            return data
        chosen = np.zeros(written.beams, np.bool_)
        chosen[mine.beam[number]] = True
        value = self._number(topic, written.range_max)
        self.is_measurable |= written.range_min <= value <= written.range_max
        return replaced(data, written, chosen, value)

    def conclude(self, sweeps: Mapping[str, int]) -> None:
        """Refuse a copy that lacks sweeps."""
        for topic, mine in self._chosen.items():
            if sweeps[topic] != len(mine.beam):
                raise _changed(topic)

    def _number(self, topic: str, range_max: float) -> float:
        if self._value != ABOVE:
            return float(self._value)
        if not math.isfinite(range_max):
            raise OptionError(f"--value above: the range_max of {topic} is {range_max}")
        return range_max + 1.0


def _changed(topic: str) -> UnreadableError:
    return UnreadableError(f"the sweeps of {topic} are not those that were read before: does the log still grow?")


def _copies(cuts: Iterable[Cut | None], topic: str) -> Counter[int] | None:
    """Return how often each sweep of a topic is written; None where all are, once."""
    every = [cut.sweeps.get(topic) if cut is not None and cut.sweeps else None for cut in cuts]
    return None if None in every else Counter(number for numbers in every for number in numbers or ())


def _statuses(pair: TableSet, rows: Mapping[str, Int64]) -> Counter[str]:
    """Return the beams by status of some sweeps of each topic."""
    table = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", *STATUSES))
    topics = _names(table["topic"])
    mine = np.concatenate([np.flatnonzero(topics == topic)[numbers] for topic, numbers in rows.items()])
    return Counter({name: int(held(table[name])[0][mine].sum()) for name in STATUSES})


def _summary(
    found: RunSummary, options: CleanOptions, chosen: dict[str, Chosen], rows: Mapping[str, Int64], editing: _Editing
) -> CleanSummary:
    """Return the counts of the copy, which has the sweeps in `rows` of each topic."""
    summary = CleanSummary(sweeps=sum(map(len, rows.values())), topics={name for name in rows if len(rows[name])})
    summary.missing_topics = found.missing_topics
    summary.damage = [*found.damage]
    summary.notes = [*found.notes]
    beams = sum(int(each.beams[rows[name]].sum()) for name, each in chosen.items())
    totals = sum((each.counts[rows[name]].sum(axis=0) for name, each in chosen.items()), np.zeros(4, np.int64))
    removed = int(totals.sum())
    by_mask = ["body"] if options.detect.read.rules.masks else []
    asked = [*options.remove, *by_mask, *(["margin"] if options.margin else [])]
    summary.removed = {reason: int(count) for reason, count in zip(REASONS, totals, strict=True) if reason in asked}
    parts = ", ".join(f"{reason} {count:,}" for reason, count in summary.removed.items())
    share = f" ({removed / beams:.1%})" if beams else ""
    value = options.value
    says = {NAN: "NaN", INF: "inf", ABOVE: "range_max + 1"}[value] if isinstance(value, str) else f"{value:g} m"
    summary.line = f"{counted(summary.sweeps, 'sweep')}; {removed:,} of {beams:,} beams{share} say {says}: {parts}"
    if options.value == INF:
        summary.notes.append("inf says that nothing is there: costmaps with inf_is_valid free beams beyond walls")
    elif options.value == 0:
        summary.notes.append("0 becomes range_max in AMCL and gmapping: beams free what is beyond walls")
    elif editing.is_measurable:
        summary.notes.append(f"{value:g} m is a range that the sensor can measure: programs take it for a wall")
    return summary


def _copied(copy: Copy, changed: Collection[str] | None) -> str:
    """Return how many messages were copied, and which topics show what the `changed` ones, if any, do not."""
    alike = [
        f"{topic} ({kind.rsplit('/', 1)[-1].rsplit('.', 1)[-1]})"
        for topic, kind in sorted(copy.messages)
        if changed is not None and (kind in {*CLOUD_TYPES, POINTS} or (kind in SCAN_TYPES and topic not in changed))
    ]
    topics = len({topic for topic, _ in copy.messages})
    shows = f"; {', '.join(alike)} may show the same" if alike else ""
    return f"{counted(copy.messages.total(), 'message')} of {counted(topics, 'topic')}{shows}"


def _table(log: str, chosen: dict[str, Chosen], rows: Mapping[str, Int64]) -> pa.Table:
    """Return the table of what was left out, by topic and sweep, of the sweeps in `rows` of each topic."""
    pieces = []
    for topic, each in sorted(chosen.items()):
        at = np.unique(rows[topic])
        count = len(at)
        numbered = [at, each.stamp_ns[at], *np.ascontiguousarray(each.counts[at].T)]
        arrays = [pa.array(values).cast(one.type) for values, one in zip(numbered, [*CLEANED][2:], strict=True)]
        named = [constant(log, count), constant(topic, count)]
        pieces.append(pa.RecordBatch.from_arrays([*named, *arrays], schema=CLEANED))
    return pa.Table.from_batches(pieces, CLEANED).unify_dictionaries()


class Chosen(NamedTuple):
    """The chosen beams of one topic, sweep by sweep."""

    stamp_ns: Int64
    beams: Int32
    """(S,) beams of each sweep."""
    counts: Int32
    """(S, 4) chosen beams by `REASONS`."""
    beam: list[NDArray[np.intp]]
    """Chosen beams of each sweep, ascending."""


def choose(
    log: Log,
    pair: TableSet,
    options: CleanOptions,
    rules: RangeRules,
    posing: PoseAttacher,
    progress: Progress | None = None,
) -> dict[str, Chosen]:
    """Return the chosen beams of each topic by the tables of its objects; `posing` is that of the pass that made them.

    Raises
    ------
    UnreadableError
        A table cannot be read.
    """
    temporary = _temporary(log, pair, options, rules, posing.anew()) if "temporary" in options.remove else {}
    agents = _agents(pair) if "agents" in options.remove else {}
    found: dict[str, list[Chosen]] = {}
    cursors: dict[str, TopicRows] = {}
    for batch in _batches(log, options, rules):
        topic = batch.topic
        if topic not in cursors:
            cursors[topic] = TopicRows(pair.objects, "objects", OBJECT_COLUMNS, topic)
        rows = cursors[topic].until(int(batch.sweep[-1]) + 1)
        objects = Objects.of(rows, batch)
        reason = np.zeros(batch.ranges.shape, np.uint8)
        for frame, at, mine in batch.by_frame():
            key = topic, frame
            reason[at] = _reasons(mine, objects.of_rows(at), options, temporary.get(key, _NONE), agents.get(key))
        counts = np.column_stack([np.count_nonzero(reason == code, axis=1) for code in range(1, 5)]).astype(np.int32)
        beams = [np.flatnonzero(row) for row in reason]
        found.setdefault(topic, []).append(Chosen(batch.stamp_ns, batch.beams, counts, beams))
        if progress is not None:
            progress(log.position)
    return {
        topic: Chosen(
            np.concatenate([part.stamp_ns for part in parts]),
            np.concatenate([part.beams for part in parts]),
            np.concatenate([part.counts for part in parts]),
            [beam for part in parts for beam in part.beam],
        )
        for topic, parts in found.items()
    }


def _batches(log: Log, options: CleanOptions, rules: RangeRules) -> Iterator[SweepBatch]:
    """Yield all sweeps; the pass that makes the tables reports the damage."""
    topics = options.detect.read.topics
    yield from read_batches(log, ReadOptions(topics, rules=rules), ReadReport(), TopicChoice(topics, log.topics()))


def _reasons(
    batch: SweepBatch, objects: Objects, options: CleanOptions, temporary: Int64, agents: _Agents | None
) -> NDArray[np.uint8]:
    """Return the reason (S, B) for which each beam is chosen, 0 for none; `temporary` are tracks."""
    valid = batch.status == Status.VALID
    owner = objects.owners(batch)
    is_thing = (objects.set == SETS.index("O")) & (objects.track >= 0)
    is_agent = objects.set == SETS.index("A")
    if agents is not None and len(agents.track):
        at = np.minimum(np.searchsorted(agents.track, objects.track), len(agents.track) - 1)
        is_agent |= (agents.track[at] == objects.track) & (batch.sweep[objects.row] >= agents.since[at])
    reason = np.zeros(valid.shape, np.uint8)
    reason[batch.status == Status.MASKED] = BODY
    reason[valid & np.append(is_thing & np.isin(objects.track, temporary), False)[owner]] = TEMPORARY
    if "agents" in options.remove:
        reason[valid & np.append(is_agent, False)[owner]] = AGENTS
    if agents is not None:
        # What stands is no part of who passes by.
        stands = np.append(is_thing & ~is_agent, False)[owner]
        reason[agents.of(batch).pieces(batch) & ~stands & (reason != BODY)] = AGENTS
    reason[neighbours(batch, reason > 0, options.margin) & valid & (reason == 0)] = MARGIN
    return reason


def neighbours(batch: SweepBatch, chosen: Bool, margin: int) -> Bool:
    """Return the beams (S, B) that are so near to chosen ones; of a full turn the last is beside the first."""
    beam = np.arange(chosen.shape[1])
    far = margin + 2 * len(beam) + 1
    # The chosen ones next to each beam, on both sides; behind the last beam of a full turn comes the first chosen one.
    before, after = np.where(chosen, beam, -far), np.where(chosen, beam, far)
    turn = np.where(batch.closure == Closure.OPEN, far, batch.beams)[:, None]
    last = before.max(axis=1, keepdims=True, initial=-far) - turn
    first = after.min(axis=1, keepdims=True, initial=far) + turn
    before = np.maximum(np.maximum.accumulate(before, axis=1), last)
    after = np.minimum(np.minimum.accumulate(after[:, ::-1], axis=1)[:, ::-1], first)
    near: Bool = np.minimum(beam - before, after - beam) <= margin
    return near & (beam < batch.beams[:, None])


class _Places(NamedTuple):
    """Places (P) of agents in sweeps of a batch, in the frame of the sensor."""

    row: Int64
    x: Float64
    y: Float64
    radius: Float64

    def pieces(self, batch: SweepBatch) -> Bool:
        """Return the beams (S, B) on pieces that end within the reach of an agent as a whole.

        A leg far away has too few beams for an object; of a wall only a part is within reach.
        """
        found = np.zeros(batch.ranges.shape, np.bool_)
        for first in range(0, len(self.row), PAIRS):
            part = slice(first, first + PAIRS)
            some = _Places(self.row[part], self.x[part], self.y[part], self.radius[part])
            pair, beam = np.nonzero(some._whole_pieces(batch.rows(some.row)))
            found[some.row[pair], beam] = True
        return found

    def _whole_pieces(self, batch: SweepBatch) -> Bool:
        """Return the beams (P, B) by place; `batch` has the sweep of each."""
        valid = batch.status == Status.VALID
        ranges = np.where(valid, batch.ranges, np.float32(np.nan)).astype(np.float64)
        bearing = batch.bearings()
        x, y = ranges * np.cos(bearing), ranges * np.sin(bearing)
        slant = 2.0 * np.abs(batch.angle_increment)[:, None] * ranges
        with np.errstate(invalid="ignore"):
            inside = np.hypot(x - self.x[:, None], y - self.y[:, None]) <= self.radius[:, None]
            joined = np.abs(ranges - np.roll(ranges, 1, axis=1)) <= LINK + slant
        begins = ~joined
        begins[:, 0] = True
        piece = np.cumsum(begins, axis=1) - 1
        # Of a full turn the last piece may go on in the first.
        seam = joined[:, 0] & (batch.closure != Closure.OPEN)
        piece = np.where((piece == piece[:, -1:]) & seam[:, None], 0, piece)
        number = piece + np.arange(len(piece))[:, None] * (batch.width + 1)
        beams = np.bincount(number.ravel(), valid.ravel())
        within = np.bincount(number.ravel(), inside.ravel())
        whole: Bool = inside & (within >= beams)[number]
        return whole


@dataclass(frozen=True, slots=True)
class _Agents:
    """Places (N) of the agents of a topic by sweep, from when on they are on their way."""

    sweep: Int64
    """(N,) ascending."""
    x: Float64
    y: Float64
    radius: Float64
    in_world: Bool
    track: Int64
    """(T,) their tracks, and those of parts of them, ascending; and the sweeps (T,) from which on they are left out."""
    since: Int64
    sweeps: Int64
    """(S,) sweeps of the topic, and the pose (S, 3) of the sensor in each."""
    pose: Float64
    mirrored: bool
    """True where the sensor hangs head down."""

    def of(self, batch: SweepBatch) -> _Places:
        """Return the places of agents in some sweeps."""
        first, after = np.searchsorted(self.sweep, [batch.sweep[0], batch.sweep[-1] + 1])
        mine = slice(first, after)
        sweep, x, y = self.sweep[mine], self.x[mine], self.y[mine]
        at = np.minimum(np.searchsorted(self.sweeps, sweep), len(self.sweeps) - 1)
        pose = self.pose[at]
        dx, dy = x - pose[:, 0], y - pose[:, 1]
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        left = cos * dy - sin * dx
        here_x = np.where(self.in_world[mine], cos * dx + sin * dy, x)
        here_y = np.where(self.in_world[mine], -left if self.mirrored else left, y)
        row = np.minimum(np.searchsorted(batch.sweep, sweep), len(batch) - 1)
        there = np.isfinite(here_x) & (batch.sweep[row] == sweep)
        return _Places(row[there], here_x[there], here_y[there], self.radius[mine][there])


class _Paths(NamedTuple):
    """Trajectories (N) of one topic, those of a track one after the other in the order of time."""

    track: Int64
    sweep: Int64
    stamp_ns: Int64
    x: Float64
    y: Float64
    sd: Float64
    """(N,) the greater standard deviation of the place [m]."""
    in_world: Bool
    hidden: Bool

    def of(self, track: int) -> slice:
        """Return the rows of a track."""
        first, after = np.searchsorted(self.track, [track, track + 1])
        return slice(int(first), int(after))


class _Track(NamedTuple):
    """A track of one topic."""

    number: int
    moves: bool
    moved_at_ns: int
    half: float
    """Half of its diagonal [m], 0 where it is not known."""

    @property
    def reach(self) -> float:
        """Distance from its middle in which pieces belong to it [m]."""
        return max(REACH, self.half + REACH_AROUND)


def _agents(pair: TableSet) -> dict[Key, _Agents]:
    """Return where agents are, by topic and frame, hidden or not."""
    found = {}
    paths = _paths(pair)
    for (topic, frame), tracks in _tracks(pair).items():
        if topic in paths and any(each.moves for each in tracks):
            found[topic, frame] = _agents_of(tracks, paths[topic], *_sensor(pair, topic, frame))
    return found


def _tracks(pair: TableSet) -> dict[Key, list[_Track]]:
    """Return the tracks of each topic and frame by number; those that several sensors saw are tracks of each."""
    columns = ("topic", "frame_id", "track", "set", "moved_at", "length", "width")
    rows = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], columns)
    moves = _names(rows["set"]) == "A"
    moved_at, _ = held(rows["moved_at"].cast(pa.int64()))
    half = 0.5 * np.hypot(*(np.nan_to_num(numbers(rows[name])) for name in ("length", "width")))
    names = (_names(rows[name]) for name in ("topic", "frame_id"))
    shared = np.asarray(rows["frame_id"].is_null())
    values = (shared, *names, np.asarray(rows["track"]), moves, moved_at, half)
    every = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "frame_id"))
    sensors = {*zip(*(_names(every[name]).tolist() for name in ("topic", "frame_id")), strict=True)}
    found: dict[Key, dict[int, _Track]] = {}
    # Own tracks come last, and stay.
    for is_shared, topic, frame, *track in sorted(zip(*(each.tolist() for each in values), strict=True), reverse=True):
        for key in sensors if is_shared else [(topic, frame)]:
            if topic in ("", key[0]):
                found.setdefault(key, {})[track[0]] = _Track(*track)
    return {key: sorted(tracks.values()) for key, tracks in found.items()}


def _paths(pair: TableSet) -> dict[str, _Paths]:
    """Return the trajectories of each topic."""
    columns = ("topic", "track", "sweep", "stamp", "frame", "x", "y", "x_sd", "y_sd", "seen")
    rows = read_columns(pair.trajectories, "trajectories", SCHEMAS["trajectories"], columns)
    topics = _names(rows["topic"])
    whole = _Paths(
        np.asarray(rows["track"]),
        np.asarray(rows["sweep"]),
        np.asarray(rows["stamp"].cast(pa.int64())),
        numbers(rows["x"]),
        numbers(rows["y"]),
        np.maximum(numbers(rows["x_sd"]), numbers(rows["y_sd"])),
        _names(rows["frame"]) == WORLD,
        _names(rows["seen"]) == VIEWS[HIDDEN],
    )
    order = np.lexsort((whole.sweep, whole.track))
    found = {}
    for topic in np.unique(topics).tolist():
        mine = order[topics[order] == topic]
        found[topic] = _Paths(*(values[mine] for values in whole))
    return found


def _agents_of(tracks: list[_Track], paths: _Paths, sweeps: Int64, pose: Float64, mirrored: bool) -> _Agents:
    """Return the agents of a topic; `sweeps`, `pose` and `mirrored` as of `_sensor`."""
    since: dict[int, int] = {}
    rows, radius = [_NONE], [np.zeros(0)]
    for track in tracks:
        mine = paths.of(track.number)
        count = mine.stop - mine.start
        if not track.moves or not count:
            continue
        onset = int(np.searchsorted(paths.stamp_ns[mine], track.moved_at_ns))
        onset = mine.start + min(onset, count - 1)
        first = _sets_out(paths, slice(mine.start, onset))
        since[track.number] = int(paths.sweep[first])
        sure = first + np.flatnonzero(paths.sd[first : mine.stop] <= MAX_SD)
        rows.append(sure)
        radius.append(np.full(len(sure), track.reach))
    begun = np.array([sweep for sweep, some in zip(since.values(), rows[1:], strict=True) if len(some)], np.int64)
    ends = [(some[-1], reach[-1]) for some, reach in zip(rows, radius, strict=True) if len(some)]
    last = _Reach(np.array([row for row, _ in ends], np.int64), np.array([reach for _, reach in ends]))
    at, reach = np.concatenate(rows), np.concatenate(radius)
    order = np.argsort(paths.sweep[at], kind="stable")
    at, reach = at[order], reach[order]
    for track in tracks:
        if not track.moves and _came_along(track, paths, _Reach(at, reach), last, begun):
            since[track.number] = 0
    numbers_of, left_out = np.array(sorted(since.items()), np.int64).reshape(-1, 2).T
    return _Agents(
        paths.sweep[at], paths.x[at], paths.y[at], reach, paths.in_world[at], numbers_of, left_out, sweeps, pose, mirrored
    )


def _sets_out(paths: _Paths, rows: slice) -> int:
    """Return the row, of those up to its onset, from which on an agent went further within a second than noise explains."""
    first: int = rows.start
    if first == rows.stop:
        return first
    x, y, var, stamp_ns = paths.x[rows], paths.y[rows], paths.sd[rows] ** 2, paths.stamp_ns[rows]
    # Of a clock that steps back none is later.
    before = np.minimum(np.searchsorted(stamp_ns, stamp_ns - SECOND_NS), np.arange(len(x)))
    distance = np.hypot(x - x[before], y - y[before])
    least = MIN_SPEED * 1e-9 * (stamp_ns - stamp_ns[before])
    stands = np.flatnonzero(~(distance > np.maximum(least, MOVING_SDS * np.sqrt(var + var[before]))))[-1]
    # What is on its way so soon after it was first seen was so before.
    return first if before[stands] == 0 else first + int(stands)


class _Reach(NamedTuple):
    """Rows (N) of the paths of agents, ascending by sweep, and how far pieces of them are from there."""

    row: Int64
    radius: Float64
    """[m]"""


def _came_along(track: _Track, paths: _Paths, agents: _Reach, ends: _Reach, since: Int64) -> bool:
    """Return whether a thing is part of an agent, or one that came to stand there; `ends`, `since` (A,) are of agents."""
    # What stands is also seen while no agent is within reach. Of an agent that stops a new track may begin.
    mine = paths.of(track.number)
    rows = np.arange(mine.start, mine.stop)[~paths.hidden[mine]]
    # Most things are seen without agents at first.
    if not len(rows):
        return False
    first = rows[0]
    over = np.hypot(paths.x[ends.row] - paths.x[first], paths.y[ends.row] - paths.y[first]) + track.half
    left = (over <= ends.radius) & (since < paths.sweep[first])
    left &= paths.stamp_ns[ends.row] >= paths.stamp_ns[first] - SECOND_NS
    if not left.any() and not _with_agents(rows[:1], track.half, paths, agents).all():
        return False
    inside = _with_agents(rows, track.half, paths, agents)
    last = paths.sweep[ends.row[left]]
    return bool(inside.all()) or any(inside[paths.sweep[rows] <= end].all() for end in last.tolist())


def _with_agents(rows: Int64, half: float, paths: _Paths, agents: _Reach) -> Bool:
    """Return whether in rows (K,) of the path of a thing all of it is within the reach of an agent."""
    sweep = paths.sweep[agents.row]
    first, after = (np.searchsorted(sweep, paths.sweep[rows], side) for side in ("left", "right"))
    count = after - first
    which = np.repeat(np.arange(len(rows)), count)
    agent = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + first[which]
    there, here = agents.row[agent], rows[which]
    over = np.hypot(paths.x[there] - paths.x[here], paths.y[there] - paths.y[here]) + half
    inside: Bool = np.bincount(which, over <= agents.radius[agent], len(rows)) > 0
    return inside


def _sensor(pair: TableSet, topic: str, frame: str) -> tuple[Int64, Float64, bool]:
    """Return the sweeps of a sensor, its pose (S, 3) in each, and whether it hangs head down."""
    names = ("pose_x", "pose_y", "pose_yaw")
    rows = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "frame_id", "sweep", *names))
    mine = (_names(rows["topic"]) == topic) & (_names(rows["frame_id"]) == frame)
    sweep = np.asarray(rows["sweep"])[mine]
    pose = np.column_stack([numbers(rows[name])[mine] for name in names])
    columns = ("topic", "frame_id", "sweep", "box_x", "box_y", "world_x", "world_y")
    objects = read_columns(pair.objects, "objects", SCHEMAS["objects"], columns)
    here = (_names(objects["topic"]) == topic) & (_names(objects["frame_id"]) == frame)
    x, y, world_x, world_y = (numbers(objects[name])[here] for name in columns[3:])
    at = np.minimum(np.searchsorted(sweep, np.asarray(objects["sweep"])[here]), max(len(sweep) - 1, 0))
    if not len(x):
        return sweep, pose, False
    dx, dy, yaw = world_x - pose[at, 0], world_y - pose[at, 1], pose[at, 2]
    left = np.cos(yaw) * dy - np.sin(yaw) * dx
    with np.errstate(invalid="ignore"):
        flipped = np.abs(left + y) < np.abs(left - y)
    return sweep, pose, 2 * int(np.count_nonzero(flipped)) > len(x)


_COLUMNS = (
    *("topic", "frame_id", "sweep", "set", "track", "box_x", "box_y", "box_length", "box_width", "box_yaw"),
    *("world_x", "world_y", "world_yaw"),
)


@dataclass(slots=True)
class _Stay:
    """A thing that stood, and how often its place was seen free before or afterwards."""

    track: int
    first: int
    last: int
    """Sweeps in which it stood first and last."""
    in_world: bool
    places: Float64
    """(P, 2) samples of its place [m]."""
    free: int = 0
    run: int = 0
    """Run of the log in which it stood, once its sweeps have come: the world of each is its own."""


def _temporary(
    log: Log, pair: TableSet, options: CleanOptions, rules: RangeRules, posing: PoseAttacher
) -> dict[Key, Int64]:
    """Return by topic and frame the tracks that stood where the place was also seen free, in a pass of its own."""
    stays = _stood(pair)
    if not stays:
        return {}
    sensors = (
        ((whole.topic, frame), batch)
        for whole in _batches(log, options, rules)
        for frame, _, batch in posing.attach(whole).by_frame()
    )
    for key, batch in sensors:
        for one in stays.get(key, ()):
            if one.run != batch.run and one.last >= batch.sweep[0]:
                one.run, one.free = batch.run, 0
        mine = [one for one in stays.get(key, ()) if one.run == batch.run and one.free < FREE_SWEEPS]
        if not mine:
            continue
        world = None if batch.poses is None else batch.poses.at_stamp()
        zero = np.zeros(len(batch))
        sensor = SweepPoses(zero, zero, zero, np.zeros(len(batch), np.bool_))
        for one in mine:
            away = (batch.sweep < one.first) | (batch.sweep > one.last)
            place = world if one.in_world else sensor
            if place is None or not away.any():
                continue
            rows = np.flatnonzero(away)
            some = batch.rows(rows)
            share = seen(some, place.rows(rows), one.places).mean(axis=1)
            one.free += int(np.count_nonzero(share >= FREE_SHARE))
    return {key: np.array([one.track for one in each if one.free >= FREE_SWEEPS], np.int64) for key, each in stays.items()}


def _stood(pair: TableSet) -> dict[Key, list[_Stay]]:
    """Return where tracks stood, by topic and frame."""
    rows = read_columns(pair.objects, "objects", SCHEMAS["objects"], _COLUMNS)
    track, there = held(rows["track"])
    letters, topics, frames = (_names(rows[name]) for name in ("set", "topic", "frame_id"))
    stood = there & (letters == "O")
    found: dict[Key, list[_Stay]] = {}
    sweep = np.asarray(rows["sweep"])
    columns = {name: numbers(rows[name]) for name in _COLUMNS[5:]}
    for topic in sorted(set(topics[stood].tolist())):
        mine = np.flatnonzero(stood & (topics == topic))
        order = mine[np.argsort(track[mine], kind="stable")]
        for group in np.split(order, np.flatnonzero(np.diff(track[order])) + 1):
            values = {name: column[group] for name, column in columns.items()}
            in_world = bool(np.isfinite(values["world_x"]).all())
            names = ("world_x", "world_y", "world_yaw") if in_world else ("box_x", "box_y", "box_yaw")
            x, y = (float(np.median(values[name])) for name in names[:2])
            # The direction of the box nearest to the middle: angles have no median.
            nearest = int(np.argmin(np.hypot(values[names[0]] - x, values[names[1]] - y)))
            yaw = float(values[names[2]][nearest])
            sides = (float(np.median(values[name])) for name in ("box_length", "box_width"))
            length, width = (max(side, MIN_SIDE) for side in sides)
            ahead = np.array([1.0, 1.0, -1.0, -1.0]) * length / 2
            left = np.array([1.0, -1.0, -1.0, 1.0]) * width / 2
            corners = np.column_stack(
                [x + np.cos(yaw) * ahead - np.sin(yaw) * left, y + np.sin(yaw) * ahead + np.cos(yaw) * left]
            )
            shape = Polygon(tuple((float(a), float(b)) for a, b in corners))
            found.setdefault((topic, str(frames[group[0]])), []).append(
                _Stay(int(track[group[0]]), int(sweep[group].min()), int(sweep[group].max()), in_world, samples(shape))
            )
    return found


def _names(column: pa.ChunkedArray) -> NDArray[np.str_]:
    """Return a column of names as text, empty for null."""
    whole = column.unify_dictionaries().combine_chunks()
    if not len(whole):
        return np.zeros(0, np.str_)
    # The last one is that of null, which is counted as -1.
    words: NDArray[np.str_] = np.array([*whole.dictionary.to_pylist(), ""])[np.asarray(whole.indices.fill_null(-1))]
    return words
