"""One log cleaned: the copy, and the table of what was removed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from lidarcli.copying.copying import ALL, MAX_SAID, Copy, Cut, Targets, copy_log
from lidarcli.display.texts import counted, moment
from lidarcli.errors import NoScanError, OptionError
from lidarcli.files.newfiles import NewFiles, scratch_folder, writing
from lidarcli.files.stores import Place
from lidarcli.logs.base import CLOUD_TYPES, SCAN_TYPES, STATIC, Log, ReadReport
from lidarcli.logs.batches import ReadOptions, refuse_run
from lidarcli.logs.registry import TopicChoice, nothing_read, scan_topics
from lidarcli.options.choices import ABOVE, INF, KEEP, NAN
from lidarcli.options.times import SECOND_NS, Instant, window
from lidarcli.pipeline.clean.beams import REASONS, BeamEdit, Chosen, choose
from lidarcli.pipeline.clean.options import (
    CleanOptions,
    blind_topics,
    folder_of,
    refuse_log,
    refuse_motion,
    refuse_names,
    suffix_of,
    table_path,
)
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.inputs.tracked import columns_of
from lidarcli.pipeline.mending import FOREVER, Cutting, Mending, TopicSweeps, clips_of, plan, survey
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.needs import Need
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary, damage_lines, rules_of
from lidarcli.sweeps.types import STATUSES, Int64
from lidarcli.tabular.columns import constant, plain, restamped
from lidarcli.tabular.reading import Readable, file_metadata, note_value
from lidarcli.tabular.schemas import CLEANED
from lidarcli.tabular.writing import PARAMETERS, SOURCE, ParquetSink, table_metadata

if TYPE_CHECKING:
    from lidarcli.pipeline.merging import Merging


@dataclass(slots=True)
class CleanSummary(RunSummary):
    """The counts of one run over one log, and its lines for people."""

    table: pa.Table = field(default_factory=lambda: pa.Table.from_batches([], CLEANED))
    """One row per sweep."""
    line: str = ""
    """Values of beams in the copy, and their reasons."""
    copied: str = ""
    """Number of messages that were copied."""
    mended: dict[str, dict[str, int]] = field(default_factory=dict)
    """Topic → word of `--mend` → sweeps that it changed."""
    removed: dict[str, int] = field(default_factory=dict)
    """Requested reason → beams that say something else in the copy."""

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
    """Write a log mended, in parts, and without what moves in it; next to it the table of what was removed, if anything.

    `OptionError`: the log cannot be cleaned or mended, or the output is another container, or the input;
    `UnreadableError`: the log or the table of clips cannot be read, or it is not known how its sensor moved;
    `NoScanError`: no LaserScan topic, or not the one that was requested; `OutputError`: a file cannot be written.
    """
    with ExitStack() as stack:
        refuse_names(source, path)
        # Messages are copied one by one, so they are read as they are.
        opening = replace(options.detect.opening, segments=KEEP)
        log = stack.enter_context(open_source(source, opening))
        refuse_log(log, source, path, options)
        mending, cuts = _planned(source, log, path, options)
        table = table_path(path) if options.remove else None
        outputs = [*cuts, *([] if table is None else [table])]
        new = stack.enter_context(NewFiles(outputs, options.overwrite, folder_of(log, source, path, options.is_cut)))
        targets = [(new.part(each), cut) for each, cut in cuts.items()]
        merging = _merging(source, log, options, stack) if options.merge is not None else None
        copy = _copy_of(log, mending, merging, cuts)
        if table is None:
            with writing(path):
                copy_log(log, targets, copy)
            copied = copy.written if all(cuts.values()) else copy.sweeps
            summary = CleanSummary(sweeps=copied.total(), topics={*copied})
            summary.line = counted(summary.sweeps, "sweep")
        else:
            if mending.topics or mending.said:
                # Agents are found by right stamps, in a copy that is mended.
                folder = stack.enter_context(scratch_folder(path.parent if isinstance(path, Path) else None))
                mended = replace(source, path=str(folder / Path(source.path).name), found=None)
                with writing(path):
                    copy_log(log, Path(mended.path), copy)
                source, log = mended, stack.enter_context(open_source(mended, opening))
            private = new.part(table).with_name(f"{path.name}.tables")
            summary, copy = _emptied(source, log, private, targets, options, mending, merging, progress)
            with ParquetSink(new.part(table), summary.table.schema, table) as sink:
                for rows in summary.table.to_batches():
                    sink.write(rows)
                sink.finish(summary.table.schema.metadata)
        _conclude(summary, copy, mending, options)
        summary.notes += [*mending.left, *(merging.notes() if merging is not None else [])]
        if not cuts:
            summary.notes.append(f"no row of {options.clips} is of this log: no clip is written")
        summary.notes += new.publish()
        summary.outputs = [str(each) for each in outputs]
    return summary


def _copy_of(log: Log, mending: Mending, merging: Merging | None, cuts: Mapping[Place, Cut | None]) -> Copy:
    """Return how messages are copied: mended, and merged."""
    for name, mend in mending.topics.items():
        mend.copies = _copies(cuts.values(), name)
    if merging is None:
        return mending.copy(log)
    merging.copies = _copies(cuts.values(), merging.keys[0][0])
    return merging.copy(mending.copy(log))


def _conclude(summary: CleanSummary, copy: Copy, mending: Mending, options: CleanOptions) -> None:
    """Add to a summary what was copied, what was mended, and what could not be."""
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


def _planned(source: Source, log: Log, path: Place, options: CleanOptions) -> tuple[Mending, dict[Place, Cut | None]]:
    """Return the mending of a log, and its copies: path of each → the part of the log in it, None for the complete log."""
    detect, read = options.detect, options.detect.read
    complete: dict[Place, Cut | None] = {path: None if options.merge is None else ALL}
    if options.mend is None and options.is_whole and (options.remove or read.rules.masks is None):
        if not options.remove and options.merge is None:
            raise OptionError(
                "--remove none leaves nothing to do: add --mend, --merge, --start, --end, --run, --clips or --mask"
            )
        return Mending(), complete
    # Where beams are removed those of the robot are, too.
    masks = None if options.remove else masking_of(log, read.rules, detect.poses, read.topics).rules.masks
    read = replace(read, rules=replace(read.rules, masks=masks), start=None, end=None, run=None)
    choice, report = TopicChoice(read.topics, log.topics()), ReadReport()
    surveyed = survey(log, choice, read.rules, report)
    if (error := choice.error(every=True)) is not None or not surveyed:
        raise nothing_read(damage_lines(report), error or NoScanError(f"{source.path}: no sweep"), choice.wanted)
    detect = replace(detect, read=read, opening=replace(detect.opening, segments=KEEP))
    hidden = None if options.value == ABOVE else float(options.value)
    mending = plan(source, log, options.mend or frozenset(), detect, hidden, surveyed)
    left_out = frozenset(scan_topics(log.topics() or ()) if choice.wanted else ()) - {*surveyed}
    cutting = Cutting(surveyed, mending, left_out)
    if options.clips is not None:
        suffix = suffix_of(log, source, True)
        return mending, dict(_clips(source, path, suffix, options.clips, options.around, cutting, mending))
    if options.is_whole:
        return mending, complete
    return mending, {path: _part(options.detect.read, surveyed, cutting)}


def _clips(
    source: Source, folder: Place, suffix: str, clips: Readable, around: float, cutting: Cutting, mending: Mending
) -> Iterator[tuple[Place, Cut]]:
    """Yield the path and the part of the log of each clip; rows of the table without a sweep are noted in `mending`."""
    stem, lacking, count = PurePosixPath(source.name).name, 0, 0
    for name, clip in clips_of(clips, source.name, around).items():
        found = cutting.around(clip)
        lacking, count = lacking + (not found), count + len(found)
        for run, part in found.items():
            of_run = f"-run{run}" if len(found) > 1 else ""
            yield folder / f"{stem}.{name}{of_run}{suffix}", part
    if lacking and count:
        mending.left.append(f"{counted(lacking, 'row')} of {clips} without a sweep around: no clip")


def _part(read: ReadOptions, surveyed: Mapping[str, TopicSweeps], cutting: Cutting) -> Cut:
    """Return the part of a log from --start to --end, or of one run."""
    refuse_run(read.run, max(int(each.run.max()) for each in surveyed.values()))
    begin = min(int(each.blocks[0].time_ns[0]) for each in surveyed.values())
    first, last = (
        none if each is None else each.ns if isinstance(each, Instant) else begin + math.ceil(each * SECOND_NS)
        for each, none in zip(window(read.start, read.end, begin), (-FOREVER, FOREVER), strict=True)
    )
    cut = cutting.part(first, last - 1, read.run)
    if cut is None:
        latest = max(int(each.blocks[-1].time_ns[-1]) for each in surveyed.values())
        there = f"{moment(begin, read.time_zone)} and {moment(latest, read.time_zone)}"
        raise OptionError(f"no sweep lies between --start and --end: those of the log lie between {there}")
    return cut


def _emptied(
    source: Source,
    log: Log,
    private: Path,
    targets: Targets,
    options: CleanOptions,
    mending: Mending,
    merging: Merging | None,
    progress: Progress | None,
) -> tuple[CleanSummary, Copy]:
    """Write a log, mended already, without what moves in it; tables are made in the folder `private`."""
    parameters = options.as_dict()
    # Who moves is found in the complete log, whatever part of it is written, and by mended stamps.
    read = replace(options.detect.read, start=None, end=None, run=None)
    poses = replace(options.detect.poses, delay=None) if mending.topics else options.detect.poses
    options = replace(options, detect=replace(options.detect, read=read, poses=poses))
    tables, first = detect_to_temporary(source, private, options.detect, progress)
    if not first.summary.sweeps:
        raise nothing_read(first.summary.damage, NoScanError("no sweep to clean"), sorted(options.detect.read.topics or ()))
    notes = file_metadata(tables.sweeps)
    described = note_value(notes, SOURCE, dict)
    if joined := described.get("segments"):
        raise OptionError(
            f"{source.path}: messages of {joined[0]} are segments of a turn, which clean cannot write back; "
            f"--segments {KEEP} cleans each alone"
        )
    mask = described.get("mask")
    rules = rules_of(note_value(notes, PARAMETERS, dict), mask if isinstance(mask, dict) else None)
    blind = blind_topics(tables)
    refuse_motion(log, tables, described, first.posing, options, rules, blind)
    chosen = choose(log, tables, options, rules, first.posing, second_half(progress, source.size))
    editing = BeamEdit(chosen, options.value)
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
    summary.by_status = _statuses(tables, rows)
    summary.notes += [f"no beam of {topic} has a range: nothing moves there" for topic in sorted(blind)]
    damage = [*dict.fromkeys([*summary.damage, *damage_lines(copy.report)])]
    table = restamped(_table(source.name, chosen, rows), options.detect.stamps)
    summary.table = table.replace_schema_metadata(table_metadata(parameters, described, damage))
    return summary, copy


def _merging(source: Source, log: Log, options: CleanOptions, stack: ExitStack) -> Merging:
    """Return what merges the sensors of a robot; it reads the log next to the pass that copies it."""
    # Most copies merge nothing, and should not wait for this import.
    from lidarcli.pipeline.merging import merging_of

    read = replace(options.detect.read, start=None, end=None, run=None)
    other = stack.enter_context(open_source(source, replace(options.detect.opening, segments=KEEP)))
    reading = stack.enter_context(Reading(other, read, replace(options.detect.poses, together=True), Need.ALL))
    return merging_of(log, reading, options.merge or "", options.merge_frame)


def _summary(
    found: RunSummary, options: CleanOptions, chosen: dict[str, Chosen], rows: Mapping[str, Int64], editing: BeamEdit
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
    requested = [*options.remove, *by_mask, *(["margin"] if options.margin else [])]
    summary.removed = {reason: int(count) for reason, count in zip(REASONS, totals, strict=True) if reason in requested}
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
    clouds = {*CLOUD_TYPES, "sensor_msgs/msg/PointCloud"}
    alike = [
        f"{topic} ({kind.rsplit('/', 1)[-1].rsplit('.', 1)[-1]})"
        for topic, kind in sorted(copy.messages)
        if changed is not None and (kind in clouds or (kind in SCAN_TYPES and topic not in changed))
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
        arrays = [plain(values).cast(one.type) for values, one in zip(numbered, [*CLEANED][2:], strict=True)]
        named = [constant(log, count), constant(topic, count)]
        pieces.append(pa.RecordBatch.from_arrays([*named, *arrays], schema=CLEANED))
    return pa.Table.from_batches(pieces, CLEANED).unify_dictionaries()


def _copies(cuts: Iterable[Cut | None], topic: str) -> Counter[int] | None:
    """Return how often each sweep of a topic is written; None where all are, once."""
    every = [cut.sweeps.get(topic) if cut is not None and cut.sweeps else None for cut in cuts]
    return None if None in every else Counter(number for numbers in every for number in numbers or ())


def _statuses(tables: TableSet, rows: Mapping[str, Int64]) -> Counter[str]:
    """Return the beams by status of some sweeps of each topic."""
    columns = columns_of(tables, "sweeps", ("topic", *STATUSES))
    topics = columns.pop("topic")
    own = np.concatenate([np.flatnonzero(topics == topic)[numbers] for topic, numbers in rows.items()])
    return Counter({name: int(beams[own].sum()) for name, beams in columns.items()})
