"""The contents of a log (topics, sweeps, geometry, clocks, beams and damage), from one pass over the whole log."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.logs.base import LASERSCAN, POSE_TYPES, OpenOptions, ReadReport, Topic
from lidarcli.logs.batches import ReadOptions, refuse_run
from lidarcli.logs.clock import ClockInfo
from lidarcli.logs.joined import Part, earlier_parts
from lidarcli.logs.log_stats import MAX_COMPARED_TOPICS, LogStats, repeated_topics
from lidarcli.logs.piles import NoReturnDetector
from lidarcli.logs.registry import TopicChoice, clouds_hint, no_scan_topic, nothing_read, scan_topics
from lidarcli.logs.scan_checks import MOST, ScanChecks
from lidarcli.options.choices import MENDS
from lidarcli.pipeline.inputs.laser_filters import View, filter_text
from lidarcli.pipeline.inputs.masks import mask_text
from lidarcli.pipeline.inputs.sources import MissingInput, Source, made_of_clouds, open_source, parts_of
from lidarcli.pipeline.reading.found_poses import FoundPoses, PoseInfo, pose_infos
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.needs import Need, PoseOptions
from lidarcli.pipeline.reading.one_log import damage_lines
from lidarcli.pipeline.reading.posing import PoseAttacher, alike_note
from lidarcli.pipeline.runs.over_logs import Failure, LogProgress, attempt, one_by_one, progress_of
from lidarcli.sweeps.findings import DEEP_IDS, IDS, Finding
from lidarcli.sweeps.masks import Masks
from lidarcli.sweeps.range_rules import closure, normalise
from lidarcli.sweeps.types import Closure, RawSweeps, Status, SweepBatch

if TYPE_CHECKING:
    from lidarcli.pipeline.building import Learned
    from lidarcli.reports.checks import Check, CheckVerdict

FACTS = (
    *("pose_verdict", "pose_chain", "pose_agreement", "pose_again", "pose_drift", "pose_fit", "pose_delay"),
    "beam_order",
)
"""Keys of the verdict on the poses of a log; null where there is none."""

FIXES = (".toml", ".yaml")
"""Suffixes of files that mend a log: masks and mounts, and filters for a running robot."""


@dataclass(frozen=True, slots=True)
class Span:
    """Smallest and largest of a quantity that may change from sweep to sweep; NaN before the first sweep."""

    low: float = float("nan")
    high: float = float("nan")

    def with_values(self, values: NDArray[Any]) -> Span:
        """Return the span that also covers `values`."""
        low, high = np.fmin.reduce(values), np.fmax.reduce(values)
        return Span(float(np.fmin(self.low, low)), float(np.fmax(self.high, high)))


@dataclass(frozen=True, slots=True)
class ScanInfo:
    """The sweeps of one topic in one frame. Radians, metres, seconds."""

    topic: str
    frame_id: str
    sweeps: int
    beams: Span
    view: Span
    """Angle that the sweep covers: from the first to the last beam, a whole turn where it closes."""
    angle_min: Span
    increment: Span
    closure: tuple[str, ...]
    """`open`, `closed` (a full turn of distinct bearings), `shared` (the last bearing is the first)."""
    range_min: Span
    range_max: Span
    clock: ClockInfo
    by_status: Mapping[str, int]
    """`valid`, `no_return`, `too_close`, `invalid`, `masked` → beams."""
    pose: str = ""
    """Topics and frames by which `detect` would know where the sensor was; empty where it could not."""
    verdict: Mapping[str, Any] = field(default_factory=dict)
    """Verdict on these poses (`CheckedPath.facts`); empty where none was made."""
    made_of: str = ""
    """Type of the messages that the sweeps are made of, where that is no LaserScan."""


@dataclass(frozen=True, slots=True)
class LogInfo:
    """Contents of a log, as `info` prints them."""

    path: str
    format: str
    compression: str
    size: int | None
    parts: tuple[Part, ...]
    """Recordings that are joined, in their order; none of any other log."""
    topics: tuple[Topic, ...]
    scans: tuple[ScanInfo, ...]
    pose_topics: tuple[str, ...]
    pose_sources: tuple[PoseInfo, ...]
    """Contents of the pose topics; empty for a pipe, which is read only once."""
    dropped: tuple[tuple[str, str, int], ...]
    """(topic, cause, messages) that could not be a sweep."""
    notes: tuple[str, ...]
    damage: tuple[str, ...]
    """One line per loss, the dropped messages included."""
    findings: tuple[Finding, ...] = ()
    """Faults of sweeps and poses, in the order of their rules."""
    learned: Masks = field(default_factory=Masks)
    """Masks of the robot itself, and mounts, that were learned from the log."""
    proposed: Masks = field(default_factory=Masks)
    """Mask of what looks like the robot itself before stationary sensors."""

    @property
    def mends(self) -> list[str]:
        """Words of `clean --mend` that mend what was found."""
        can = {topic.name for topic in self.topics if topic.is_laserscan}
        return [word for word in MENDS if any(each.mend == word and each.topic in can for each in self.findings)]

    @property
    def warnings(self) -> list[str]:
        """What a user has to know: the damage, and that there is no LaserScan."""
        lacking = self.exit_code == NoScanError.exit_code
        return [*self.damage, *([f"{no_scan_topic()}{clouds_hint(self.topics)}"] if lacking else [])]

    @property
    def exit_code(self) -> int:
        """3 on damage, 4 without a LaserScan topic, else 0."""
        if self.damage:
            return UnreadableError.exit_code
        return 0 if self.scans or scan_topics(self.topics) else NoScanError.exit_code


def inspect_log(
    source: Source,
    opening: OpenOptions | None = None,
    read: ReadOptions | None = None,
    poses_from: PoseOptions | None = None,
    progress: Callable[[int], None] | None = None,
    deep: bool = False,
    site: str | None = None,
    need: Need = Need.TOLD,
) -> LogInfo:
    """Read a log from end to end, in bounded memory, and return its contents; its poses are read first.

    `deep` adds the findings that align sweeps; `read` names the topics and the run to inspect, by default all; `site` is a
    map for its paths; with a `need` of none no sweep is matched, and the notes and findings on paths are left out.

    Raises
    ------
    NoScanError
        One of the topics is not there.
    OptionError
        `deep` or `site` is for a log that can be read only once.
    """
    wanted, read = poses_from or PoseOptions(), read or ReadOptions()
    found: dict[tuple[str, str], _Scan] = {}
    only_counted: Counter[str] = Counter()
    with open_source(source, opening) as log:
        if (deep or site is not None) and log.size is None:
            option = "--deep" if deep else "--map"
            raise OptionError(f"{option} reads a log twice, and a pipe is read only once: give the file's name")
        choice = TopicChoice(read.topics, log.topics())
        if choice.wanted and choice.is_listed and (error := choice.error(every=True)) is not None:
            raise error
        masking = masking_of(log, read.rules, wanted, choice.wanted or None)
        read = ReadOptions(frozenset(choice.wanted) or None, run=read.run, rules=masking.rules)
        posing = PoseAttacher.of(log, wanted, choice, read, need=need)
        poses, runs = posing.found, 0
        report, checks = ReadReport(), ScanChecks(made_of_clouds(log), posing.went)
        stats: dict[tuple[str, str], LogStats] = {}
        compares = len(choice.chosen) != 1
        count: Counter[str] = Counter()
        scans = log.scans(choice.asked, report)
        blocks = (one for one in scans if not choice.wanted or choice.takes(one.topic))
        detector = NoReturnDetector(read.rules, report)
        for block, range_rules in chain(chain.from_iterable(map(detector.take, blocks)), detector.flush()):
            runs = max(runs, block.run)
            if read.run not in (None, block.run):
                count[block.topic] += len(block)
                continue
            for code, sweeps in zip(*np.unique(block.frame, return_counts=True), strict=True):
                key = block.topic, block.frame_ids[code]
                if key in found or len(found) < MOST:
                    if key not in found:
                        found[key], stats[key] = _Scan(), LogStats(compares and len(found) < MAX_COMPARED_TOPICS)
                    rows = np.flatnonzero(block.frame == code)
                    part = block.rows(rows)
                    batch = normalise(part, rows + count[block.topic], range_rules)
                    found[key].add(part, batch)
                    checks.add(part, batch)
                    stats[key].add(part, batch)
                else:
                    only_counted[block.topic] += int(sweeps)
            count[block.topic] += len(block)
            if progress is not None:
                progress(log.position)
        if choice.wanted and (error := choice.error(every=True)) is not None:
            raise nothing_read(damage_lines(report), error, choice.wanted)
        refuse_run(read.run, runs)
        listed = _with_counts(log.topics() or (), found, only_counted)
        report = report if poses is None else poses.together(report)
        checks.report_to(report)
        made_of, sources = made_of_clouds(log), pose_infos(poses) if poses is not None else ()
        notes, findings = posing.findings(found)
        findings = [*report.findings(), *_of_sweeps(listed, stats, checks, report), *findings]
        if not wanted.deskew:
            findings = [each for each in findings if each.fix is None or each.fix.text != "--no-deskew"]
        rest = only_counted.total()
        uncounted = [f"{rest:,} sweeps are counted and no more: there are over {MOST:,} frames and topics"] if rest else []
        learned = masking.learned
        if deep:
            from lidarcli.pipeline.reading.deep import deep_findings

            more = deep_findings(source, opening, read, wanted)
            known = {(each.id, each.topic, each.frame) for each in more.findings}
            # A closer look counts.
            findings = [each for each in findings if (each.id, each.topic, each.frame) not in known]
            findings += more.findings
            learned = Masks(more.masks.masks or learned.masks, more.mounts)
        if site is not None:
            from lidarcli.pipeline.localising import findings_of
            from lidarcli.pipeline.trajectories import PathOptions

            findings += findings_of(source, PathOptions(read, opening or OpenOptions(), wanted), site)
        return LogInfo(
            path=source.label,
            format=log.format,
            compression=log.compression,
            size=log.size,
            parts=parts_of(log),
            topics=listed,
            scans=tuple(
                found[key].info(
                    *key,
                    checks.clock(*key),
                    _pose(poses, *key),
                    posing.paths[key].facts() if key in posing.paths else {},
                    made_of.get(key[0], ""),
                )
                for key in sorted(found)
            ),
            pose_topics=tuple(topic.name for topic in listed if topic.type in POSE_TYPES),
            pose_sources=sources,
            dropped=tuple((topic, cause, count) for (topic, cause), count in sorted(report.refused.items())),
            notes=(*report.notes, *masking.notes, *_pose_notes(posing, found), *notes, *uncounted),
            damage=tuple(damage_lines(report)),
            findings=tuple(
                sorted(
                    _with_way_out(findings, source, bool(sources)),
                    key=lambda each: (IDS.index(each.id), each.topic, each.frame),
                )
            ),
            learned=learned,
            proposed=masking.proposed,
        )


def _pose(poses: FoundPoses | None, topic: str, frame_id: str) -> str:
    chain = poses.sources.chain(frame_id, topic) if poses is not None else None
    return f"{' and '.join(chain.topics)} ({chain.frames})" if chain is not None else ""


def _pose_notes(posing: PoseAttacher, found: Mapping[tuple[str, str], _Scan]) -> list[str]:
    """Return notes on the poses: frames with several alike, and notes of reading them."""
    if posing.found is None:
        return [posing.unused] if posing.unused else []
    sources = posing.found.sources
    doubtful = {
        alike_note(frame, alike, sources.alternatives(frame, topic)): None
        for frame, topic in sorted((frame, topic) for topic, frame in found)
        if (alike := sources.alike(frame, topic))
    }
    return [*doubtful, *posing.found.notes]


def _of_sweeps(
    topics: Sequence[Topic], stats: Mapping[tuple[str, str], LogStats], checks: ScanChecks, report: ReadReport
) -> Iterator[Finding]:
    """Yield the findings on sweeps that are no notes of other commands."""
    encodings = {topic.name: topic.encoding for topic in topics}
    for (topic, frame), own in sorted(stats.items()):
        # An `angle_max` that is off is not used, and so leaves all other findings as they are.
        known = [each.id for each in report.doubts.get(topic, ()) if "angle_max" not in each.evidence]
        # Messages of other encodings name no frame of a sensor.
        lacks_frame = not frame and encodings.get(topic) in ("cdr", "ros1", "json", "protobuf")
        yield from own.findings(checks.sensor(topic, frame), checks.clock(topic, frame), known, lacks_frame)
    yield from repeated_topics(stats)


def _with_way_out(findings: Sequence[Finding], source: Source, has_poses: bool) -> Iterator[Finding]:
    """Yield findings; none is mended by what there is not: an earlier part, or a clock that poses do not share."""
    asks = any(each.mend == "statics" for each in findings) and not source.is_stdin
    has_parts = asks and earlier_parts(Path(source.path).absolute())
    for each in findings:
        shared = each.mend == "clock" and has_poses and "record_minus_header" in each.evidence
        yield replace(each, mend="") if shared or (each.mend == "statics" and not has_parts) else each


class _Scan:
    """Folds blocks of one topic and frame into `ScanInfo`."""

    def __init__(self) -> None:
        self.sweeps = 0
        self._spans = dict.fromkeys(("beams", "view", "angle_min", "increment", "range_min", "range_max"), Span())
        self._closures: set[int] = set()
        self._statuses = np.zeros(len(Status), np.int64)

    def add(self, block: RawSweeps, batch: SweepBatch) -> None:
        """Take a block, as the log holds it and as it was classified."""
        self.sweeps += len(block)
        closed = closure(block.beams, block.angle_increment)
        self._closures |= set(np.unique(closed).tolist())
        step = np.abs(block.angle_increment)
        values = {
            "beams": block.beams,
            "view": np.maximum(block.beams - (closed != Closure.CLOSED), 0) * step,
            "angle_min": block.angle_min,
            "increment": block.angle_increment,
            "range_min": block.range_min,
            "range_max": block.range_max,
        }
        for name, value in values.items():
            self._spans[name] = self._spans[name].with_values(value)
        self._statuses += np.bincount(batch.status.ravel(), minlength=len(Status))

    def info(
        self, topic: str, frame_id: str, clock: ClockInfo, pose: str, verdict: Mapping[str, Any], made_of: str
    ) -> ScanInfo:
        """Return the state so far."""
        return ScanInfo(
            topic=topic,
            frame_id=frame_id,
            sweeps=self.sweeps,
            closure=tuple(Closure(code).name.lower() for code in sorted(self._closures)),
            clock=clock,
            pose=pose,
            verdict=verdict,
            made_of=made_of,
            by_status={status.name.lower(): int(self._statuses[status]) for status in Status if status != Status.PADDING},
            **self._spans,
        )


def _with_counts(
    topics: Sequence[Topic], found: Mapping[tuple[str, str], _Scan], only_counted: Counter[str]
) -> tuple[Topic, ...]:
    """Return the topics by name, with the number of sweeps that were read where the log does not say it."""
    sweeps = only_counted.copy()
    for (name, _), scan in found.items():
        sweeps[name] += scan.sweeps
    known = {topic.name for topic in topics}
    unlisted = [Topic(name, LASERSCAN, "", sweeps[name]) for name in sweeps if name not in known]
    counted = [
        replace(topic, messages=sweeps[topic.name]) if topic.messages is None and topic.name in sweeps else topic
        for topic in topics
    ]
    return tuple(sorted([*counted, *unlisted], key=lambda topic: topic.name))


def fix_text(info: LogInfo, suffix: str) -> str:
    """Return what a file of fixes says, by its suffix of `FIXES`; empty where there is nothing to fix.

    Raises
    ------
    OptionError
        A mask cannot be written in this format.
    """
    if suffix == FIXES[0]:
        return mask_text(info.learned, info.proposed)
    views: dict[str, Span] = {}
    for scan in info.scans:
        low, high = scan.angle_min.low, scan.angle_min.high
        ends = np.array([low + min(scan.view.high * np.sign(scan.increment.low), 0.0), low, high])
        ends = np.append(ends, high + max(scan.view.high * np.sign(scan.increment.high), 0.0))
        views[scan.topic] = views.get(scan.topic, Span()).with_values(ends)
    return filter_text(info.learned, [View(topic, span.low, span.high) for topic, span in views.items()])


def inspect_logs(
    sources: Sequence[Source | MissingInput], report: LogProgress | None = None, **options: Any
) -> Iterator[tuple[Source | MissingInput, LogInfo | Learned | Failure]]:
    """Yield the contents of each log or background table, or its failure, one after the other; options of `inspect_log`."""

    def look_into(source: Source) -> LogInfo | Learned:
        if not _is_table(source):
            return inspect_log(source, progress=progress_of(source, report), **options)
        # Logs should not wait for this import.
        from lidarcli.pipeline.building import load

        return load(source)

    for source in one_by_one(sources):
        yield source, attempt(source, look_into)


def _is_table(source: Source) -> bool:
    """Return whether a source begins as a Parquet file, which no log does; in a store by its name."""
    if source.url is not None:
        return source.url.suffix == ".parquet"
    path = Path(source.path)
    # A pipe would lose what is read of it here.
    with suppress(OSError):
        if not source.parts and path.is_file():
            with path.open("rb") as file:
                return file.read(4) == b"PAR1"
    return False


FIGURES = (*("findings", "findings.errors", "findings.warnings", "findings.hints"), *(f"findings.{rule}" for rule in IDS))
"""Figures that a check of findings may name."""


def understand_checks(checks: Sequence[str], deep: bool, site: bool = False) -> list[Check]:
    """Parse checks of findings, or raise a usage error before any work is done."""
    if not checks:
        return []
    from lidarcli.reports.checks import parse_check

    parsed = [parse_check(text, only=FIGURES) for text in checks]
    for check in parsed:
        if not deep and check.name.removeprefix("findings.") in DEEP_IDS:
            raise OptionError(f"--check '{check.expression}': only --deep looks for {check.name}: add --deep")
        if not site and check.name == "findings.lost":
            raise OptionError(f"--check '{check.expression}': only a map tells: add --map FILE.yaml")
    return parsed


def judge_checks(checks: Sequence[Check], infos: Iterable[LogInfo]) -> list[CheckVerdict]:
    """Hold checks against the findings of all logs together."""
    if not checks:
        return []
    from lidarcli.reports.checks import verdict_of

    found = [each for info in infos for each in info.findings]
    counts = Counter({"findings": len(found)})
    counts.update(f"findings.{each.level}s" for each in found)
    counts.update(f"findings.{each.id}" for each in found)
    return [verdict_of(check, counts[check.name]) for check in checks]


def info_dict(info: LogInfo) -> dict[str, Any]:
    """Return plain values by the keys that docs/info.md lists; null stands for what is unknown."""
    return {
        "path": info.path,
        "format": info.format,
        "compression": info.compression,
        "size": info.size,
        "parts": [{"name": part.name, "size": part.size} for part in info.parts],
        "topics": [
            {"name": topic.name, "type": topic.type, "encoding": topic.encoding, "messages": topic.messages}
            for topic in info.topics
        ],
        "scans": [_scan_json(scan) for scan in info.scans],
        "pose_topics": list(info.pose_topics),
        "pose_sources": [
            {name: getattr(source, name) for name in ("topic", "type", "poses", "rate", "start_ns", "end_ns", "span")}
            | {"frames": [{"parent": parent, "child": child} for parent, child in source.frames]}
            for source in info.pose_sources
        ],
        "dropped": [{"topic": topic, "cause": cause, "messages": count} for topic, cause, count in info.dropped],
        "findings": [each.as_dict() for each in info.findings],
        "notes": list(info.notes),
        "damage": list(info.damage),
    }


def _scan_json(scan: ScanInfo) -> dict[str, Any]:
    clock = scan.clock
    return {
        **{name: getattr(scan, name) for name in ("topic", "frame_id", "sweeps")},
        "beams": [int(scan.beams.low), int(scan.beams.high)],
        "field_of_view": _pair(scan.view),
        "angle_min": _pair(scan.angle_min),
        "angle_increment": _pair(scan.increment),
        "closure": list(scan.closure),
        "range_min": _pair(scan.range_min),
        "range_max": _pair(scan.range_max),
        **{name: getattr(clock, name) for name in ("rate", "start_ns", "end_ns", "span")},
        "clock": {
            "monotonic": clock.monotonic,
            "backward_steps": clock.backward,
            "largest_backward_step": clock.largest_backward,
            "repeated_stamps": clock.repeated,
            "zero_stamps": clock.zero_stamps,
            "record_minus_header": clock.offset,
        },
        "beams_by_status": dict(scan.by_status),
        "pose": scan.pose or None,
        **{name: scan.verdict.get(name) for name in FACTS},
        "made_of": scan.made_of or None,
    }


def _pair(span: Span) -> list[float | None]:
    """Return both ends, null where they are not finite: JSON has no infinity and no NaN."""
    return [value if math.isfinite(value) else None for value in (span.low, span.high)]
