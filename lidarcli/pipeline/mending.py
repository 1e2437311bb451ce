"""The pass before a log is copied: it chooses the rules by what `info` finds, and the parts that are cut."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.copying.copying import Copy, Cut, Met, copy_log
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.newfiles import scratch_folder
from lidarcli.logs import open_log
from lidarcli.logs.base import POSE_TYPES, STATIC, Log, ReadReport, Topic
from lidarcli.logs.blocks import ScanLayout
from lidarcli.logs.clock import SAME_NS
from lidarcli.logs.joined import earlier_parts
from lidarcli.logs.piles import NoReturnDetector
from lidarcli.logs.registry import TopicChoice
from lidarcli.options.choices import BEAM_ORDERS, FOUND, MENDS, UNITS
from lidarcli.options.times import SECOND_NS, Instant
from lidarcli.pipeline.inputs.sources import Source, read_pose_messages
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pose.tracks import PoseTrack
from lidarcli.sweeps.finding_rules import APART, FASTEST, LONG, OFTEN, SOME
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Float32, Int64, RawSweeps, Status, concatenate
from lidarcli.tabular.reading import ANY, Readable, column_names, is_text, read_as_is

if TYPE_CHECKING:
    from lidarcli.copying.mends import Mend, Step

SENSOR = re.compile(r"laser|lidar|scan", re.IGNORECASE)
"""Words in the name of a frame that is that of a sensor."""
ROOM = 0.1
"""A greatest range that is made up is a multiple of this above all ranges [m]."""
MOVING = ("order", "clock", "stamps", "times")
"""Words that change where or when beams are measured, which the poses can confirm or refute."""
MAX_CLIPS = 1000
MAX_HELD = 10_000
"""Sweeps out of place that are put in order."""
FOREVER = 1 << 62
"""Later than any time, and with a minus earlier [ns]."""


@dataclass(slots=True)
class TopicSweeps:
    """The sweeps of one topic, as a pass has met them."""

    blocks: list[RawSweeps] = field(default_factory=list)
    """Without their ranges."""
    rules: RangeRules = field(default_factory=RangeRules)
    greatest: float = 0.0
    """Greatest range [m] of sweeps without a limit, or with one below what they measure; 0 without such sweeps."""

    @property
    def run(self) -> Int64:
        """(S,) run of the log of each sweep."""
        return np.repeat([block.run for block in self.blocks], [len(block) for block in self.blocks])


def survey(log: Log, choice: TopicChoice, rules: RangeRules, report: ReadReport) -> dict[str, TopicSweeps]:
    """Read all chosen sweeps once; the report takes what their ranges show."""
    seen: dict[str, TopicSweeps] = {}
    detector = NoReturnDetector(rules, report)
    blocks = (block for block in log.scans(choice.asked, report) if not choice.wanted or choice.takes(block.topic))
    for block, block_rules in chain(chain.from_iterable(map(detector.take, blocks)), detector.flush()):
        known = seen.setdefault(block.topic, TopicSweeps())
        some = block.rows(~(block.range_max > np.maximum(block.range_min, 0.0)))
        ranges = normalise(some, np.arange(len(some)), block_rules).ranges
        known.greatest = float(np.fmax.reduce(ranges, axis=None, initial=known.greatest))
        known.rules = block_rules
        known.blocks.append(replace(block, ranges=block.ranges[:, :0].copy(), intensities=None))
    for found in report.findings():
        if found.mend == "limits" and found.topic in seen:
            seen[found.topic].greatest = max(seen[found.topic].greatest, float(found.evidence["greatest"]))
    return seen


def _frame(names: Collection[str], tracks: Sequence[PoseTrack]) -> tuple[str, str]:
    """Return the frame for sweeps of frames with these names, one of which may be empty; or why it is not known."""
    links = [track for track in tracks if track.is_link]
    children = {track.child for track in links if SENSOR.search(track.child)}
    known = {*names} - {""} or children or ({"laser"} if not links else set())
    is_known = len(known) == 1 or "" not in names
    return min(known, default="").lstrip("/"), "" if is_known else "no or several frames could be that of the sensor"


def _turn_time(times: Int64, scan_time: Float32 | None) -> float:
    """Return the time of a turn [s] by the median step, or by `scan_time` where sweeps are missing; 0: unknown."""
    steps = np.diff(times)
    period = float(np.median(steps[steps > 0])) / SECOND_NS if (steps > 0).any() else 0.0
    if scan_time is None:
        return period
    known = scan_time[(scan_time >= 1.0 / FASTEST) & np.isfinite(scan_time)]
    usual = float(np.median(known.astype(np.float64))) if len(known) else period
    return usual if period > LONG * usual else period


def _is_stuck(times: Int64) -> bool:
    """Return whether times are useless: most repeat the one before, or follow it faster than any sensor sends sweeps."""
    steps = np.diff(times)
    ahead = steps[steps > SAME_NS]
    fast = len(ahead) and np.median(ahead) * FASTEST < SECOND_NS
    return bool(fast or np.count_nonzero(np.abs(steps) <= SAME_NS) > max(OFTEN * len(times), SOME))


def _on_a_clock(times: Int64, records: Int64, tracks: Sequence[PoseTrack], delay: float) -> tuple[Int64, str]:
    """Return times by the clock of the recording where those of the sweeps are none or another; or why that cannot be.

    `delay`: time [s] after which poses of another clock fit the sweeps; it is taken where there is one.
    """
    offset = np.sort(records - times)[len(times) // 2]
    shared = any(first <= times.max() and times.min() <= last for first, last in (track.span_ns for track in tracks))
    if _is_stuck(times):
        if _is_stuck(records):
            return times, "neither stamps nor the times of the recording tell when a sweep was taken"
        return records - offset * (shared or abs(offset) <= SECOND_NS), ""
    if delay:
        return times + round(delay * SECOND_NS), ""
    if abs(offset) <= APART * SECOND_NS:
        return times, ""
    if shared:
        return times, "the poses have the same clock, which is another than that of the recording"
    return times + offset, ""


def _mend(
    topic: Topic,
    seen: TopicSweeps,
    words: Collection[str],
    tracks: Sequence[PoseTrack],
    limits: tuple[float, float] | None,
    delay: float,
    hidden: float | None,
    order: str,
    factors: tuple[float, float, float],
) -> tuple[Mend, dict[str, str]]:
    """Return how the sweeps of a topic are mended by words of `--mend` or `mask`, and for words why that cannot be."""
    # Most copies mend nothing, and should not wait for this import.
    from lidarcli.copying import mends

    mend, cannot, sweeps = mends.Mend(topic.encoding), dict[str, str](), concatenate(seen.blocks)
    new, times = sweeps.stamp_ns, sweeps.time_ns
    fill = partial(mends.fill, topic=topic.name, rules=seen.rules)
    if "clock" in words:
        new, cannot["clock"] = _on_a_clock(times, sweeps.record_ns, tracks, delay)
        times = new
    if "stamps" in words:
        shift = 0 if "clock" in words else round(delay * SECOND_NS)
        new, times = np.where(new == 0, 0, new + shift), times + shift
        places = np.lexsort((times, seen.run))
        away = np.count_nonzero(places != np.arange(len(places)))
        cannot["stamps"] = f"{away:,} sweeps are out of place" if away > MAX_HELD else ""
        mend.order = places if 0 < away <= MAX_HELD else None
    cannot["beams"] = "several sensors send on it" if len({*sweeps.frame_ids}) > 1 and "beams" in words else ""
    usual = np.bincount(sweeps.beams).argmax()
    first, step = (float(np.median(each[sweeps.beams == usual])) for each in (sweeps.angle_min, sweeps.angle_increment))
    greatest = math.ceil(seen.greatest / ROOM + 1.0) * ROOM if seen.greatest else 0.0
    frame, cannot["frames"] = _frame(sweeps.frame_ids, tracks) if "frames" in words else ("", "")
    # Stamps of ROS 2 end there.
    right = np.where((new >= 0) & (new < (1 << 31) * SECOND_NS), new, -1)
    turn = _turn_time(np.sort(times), sweeps.scan_time)
    steps: dict[str, Step] = {
        "frames": partial(mends.name_frame, frame=frame),
        "clock": partial(mends.stamp, stamp_ns=right),
        "stamps": partial(mends.stamp, stamp_ns=right),
        "limits": partial(mends.limit, least=limits and limits[0], most=limits[1] if limits else greatest),
        "no-return": partial(fill, status=Status.NO_RETURN, value=np.inf),
        "mask": partial(fill, status=Status.MASKED, value=hidden),
        "intensities": mends.reverse_intensities,
        "beams": partial(mends.put_on, first=first, spacing=step, beams=int(usual)),
        "angles": partial(mends.end, steps=factors[2]),
        "order": mends.turn_round,
        **({} if factors[:2] == (1.0, 1.0) else {"units": partial(mends.convert, angle=factors[0], length=factors[1])}),
        **({"times": partial(mends.time, turn=turn, at_once=order in BEAM_ORDERS[2:])} if turn else {}),
    }
    mend.steps = {word: step for word, step in steps.items() if word in words and not cannot.get(word)}
    return mend, {word: cause for word, cause in cannot.items() if cause}


class Mending:
    """The mends of a log."""

    def __init__(self) -> None:
        self.topics: dict[str, Mend] = {}
        self.said: dict[object, Met] = {}
        """Static transforms of an earlier part of the recording."""
        self.left: list[str] = []
        """A line for what is not mended."""

    def copy(self, log: Log) -> Copy:
        """Return what copies the log mended, once messages whose place is another are held."""
        if any(mend.order is not None and not mend.held for mend in self.topics.values()):
            copy_log(log, [], Copy(self._hold))
        return Copy(self._edit, said=self.said)

    def _edit(self, topic: str, number: int, data: bytes, _: ScanLayout) -> bytes:
        mend = self.topics.get(topic)
        return data if mend is None else mend.mended(number, data)

    def _hold(self, topic: str, number: int, data: bytes, _: ScanLayout) -> bytes:
        mend = self.topics.get(topic)
        if mend is not None and mend.order is not None and mend.order[number] != number:
            mend.held[number] = data
        return data


def plan(
    source: Source,
    log: Log,
    requested: frozenset[str],
    detect: DetectOptions,
    hidden: float | None,
    seen: Mapping[str, TopicSweeps],
) -> Mending:
    """Return how a log is mended.

    Parameters
    ----------
    requested : words of `--mend`
    detect : how the log is read
    hidden : value of beams under a mask [m]; None: range_max + 1
    seen : as of `survey`

    Raises
    ------
    OptionError
        What is requested cannot be mended in this log.
    """
    done, delay, found = Mending(), detect.poses.delay, tuple[Finding, ...]()
    orders = dict.fromkeys(seen, detect.poses.order)
    if requested & {FOUND, "units", "angles", *MOVING}:
        from lidarcli.pipeline.inspecting import inspect_log

        poses = replace(detect.poses, delay=None)
        info = inspect_log(source, detect.opening, detect.read, poses, deep=bool(requested & {FOUND, "stamps", "order"}))
        found = info.findings
        orders |= {scan.topic: str(scan.verdict["beam_order"]) for scan in info.scans if "beam_order" in scan.verdict}
    every = {name: {each.mend for each in found if each.topic in (name, "") and FOUND in requested} for name in seen}
    if FOUND in requested and (others := {each.id: None for each in found if not each.mend}):
        done.left.append(f"not mended: {', '.join(others)} (lidarcli info --deep tells them)")
    topics = {topic.name: topic for topic in log.topics() or ()}
    words = {name: {*requested, *more, *(["mask"] if detect.read.rules.masks else [])} for name, more in every.items()}
    tracks = read_pose_messages(log).tracks if any(chosen & {"clock", "frames"} for chosen in words.values()) else ()
    for name in [name for name, chosen in words.items() if chosen & {*MENDS, "mask"} - {"statics"}]:
        if not topics[name].is_laserscan:
            is_not = (
                f"{name}: only a LaserScan of ROS is mended, and this is a {topics[name].type} in {topics[name].encoding}"
            )
            if not any(topics[each].is_laserscan for each in seen):
                raise OptionError(is_not)
            done.left.append(is_not)
            continue
        shift = (
            next((each for one in found if one.topic == name and (each := _delay(one))), 0.0) if delay is None else delay
        )
        fixes = {one.fix.text for one in found if one.mend == "units" and one.topic == name and one.fix}
        length = next((unit for unit in ("mm", "cm") if f"--range-unit {unit}" in fixes), "m")
        steps = 2.0 if any("meet" in one.evidence and one.topic == name for one in found) else 1.0
        factors = TURN / 360.0 if "--degrees" in fixes else 1.0, UNITS[length], steps
        mend, cannot = _mend(
            topics[name], seen[name], words[name], tracks, detect.read.rules.limits, shift, hidden, orders[name], factors
        )
        done.topics[name] = mend
        for word, cause in cannot.items():
            if word in requested:
                raise OptionError(f"{name}: {word} cannot be mended: {cause}")
            done.left.append(f"{word} of {name} is not mended: {cause}")
    _leave_worse(source, log, detect, found, done)
    if any("statics" in chosen for chosen in words.values()) and STATIC not in topics:
        done.said = _said_before(source)
        if not done.said:
            raise OptionError(f"statics cannot be mended: no earlier part beside {source.path} has {STATIC}")
    return done


def _leave_worse(source: Source, log: Log, detect: DetectOptions, found: Sequence[Finding], done: Mending) -> None:
    """Leave out, by name, words with which a copy fits its poses less: `info` finds there what is not `found` here."""
    words = [word for word in MOVING if any(word in mend.steps for mend in done.topics.values())]
    if not words or not any(topic.type in POSE_TYPES for topic in log.topics() or ()):
        return
    from lidarcli.pipeline.inspecting import inspect_log

    def faults() -> set[tuple[str, str]]:
        with scratch_folder() as folder:
            copy = replace(source, path=str(folder / Path(source.path).name), found=None)
            copy_log(log, Path(copy.path), done.copy(log))
            poses = replace(detect.poses, delay=None)
            after = inspect_log(copy, detect.opening, detect.read, poses, deep="order" in words).findings
        known, still = ({(one.id, one.topic) for one in some} for some in (found, after))
        # What an error hid before is no fault of its mending.
        cured = any(one.level == "error" and (one.id, one.topic) not in still for one in found)
        return {(one.id, one.topic) for one in after if one.level == "error" or (one.level != "hint" and not cured)} - known

    worse = faults()
    for word in words if worse else ():
        whole = done.topics
        done.topics = {
            name: replace(
                mend,
                steps={one: step for one, step in mend.steps.items() if one != word},
                order=None if word == "stamps" else mend.order,
            )
            for name, mend in whole.items()
        }
        if len(without := faults()) < len(worse):
            added = ", ".join(sorted({name for name, _ in worse - without}))
            done.left.append(f"{word} is not mended: it would add what info finds as {added}")
            worse = without
        else:
            done.topics = whole


def _delay(found: Finding) -> float:
    """Return the time that mends stamps or clock by a finding [s]; 0 where it has none."""
    option, _, seconds = found.fix.text.partition(" ") if found.fix is not None else ("", "", "")
    known = float(seconds) if option == "--pose-delay" else float(found.evidence.get("delay", 0.0))
    return known if found.mend in ("clock", "stamps") else 0.0


def _said_before(source: Source) -> dict[object, Met]:
    """Return the static transforms of the first earlier part of a recording, in the same folder, that has some."""
    for path in earlier_parts(Path(source.path).absolute()):
        with suppress(UnreadableError), open_log(str(path)) as log:
            copy = Copy()
            copy_log(log, [], copy)
            if said := {key: met for key, met in copy.said.items() if met.topic == STATIC}:
                return said
    return {}


class Clip(NamedTuple):
    """A time around a row of a table."""

    first_ns: int
    last_ns: int
    sweep: tuple[str, int] | None
    """Topic and index of the sweep that the row names."""


def clips_of(table: Readable, log: str, around: float) -> dict[str, Clip]:
    """Return the times of the parts of a log around the rows of a table [s], each named by zone and time.

    Raises
    ------
    UnreadableError, OptionError
        It cannot be read as a table, has no times, or too many rows, or columns of other types.
    """
    names, wide = column_names(table, ANY), round(around * SECOND_NS)
    times = ["start", "end"] if {"start", "end"} <= {*names} else ["stamp", "stamp"]
    if times[0] not in names:
        raise OptionError(f"{table}: no columns start and end, and no stamp: nothing tells when to cut")
    parts: dict[str, Clip] = {}
    words, index = ("log", "zone", "topic"), "first_sweep" if "first_sweep" in names else "sweep"
    for batch in read_as_is(table, [name for name in (*words, index, *dict.fromkeys(times)) if name in names]):
        columns: dict[str, list[Any]] = dict.fromkeys((*words, index), [None] * len(batch))
        for name in columns.keys() & {*names}:
            kind = batch[name].type
            if not (pa.types.is_null(kind) or (pa.types.is_integer(kind) if name == index else is_text(kind))):
                raise OptionError(f"{table}: column {name} is {kind}, not {'integers' if name == index else 'text'}")
            columns[name] = batch[name].to_pylist()
        try:
            first, last = (batch[name].cast(pa.timestamp("ns", "UTC")).cast(pa.int64()).to_pylist() for name in times)
        except pa.ArrowException as err:
            raise UnreadableError(f"{table}: {times[0]} and {times[1]} are no times that can be read") from err
        for begin, end, of_log, zone, topic, sweep in zip(first, last, *columns.values(), strict=True):
            if begin is not None and end is not None and of_log in (None, log):
                when = re.sub(r"[-:]", "", str(Instant(begin - begin % 1_000_000)))
                plain = "-".join(filter(None, (re.sub(r"[^\w.-]", "_", zone or ""), when)))
                name = next(each for n in count(1) if (each := f"{plain}-{n}" if n > 1 else plain) not in parts)
                parts[name] = Clip(begin - wide, end + wide, None if None in (topic, sweep) else (topic, sweep))
        if len(parts) > MAX_CLIPS:
            raise OptionError(f"{table}: more than {MAX_CLIPS:,} rows, and each would be a log: choose some of them first")
    return parts


class Cutting:
    """Cuts parts of a log, each by its sweeps, by the sweeps of the copy; `leaves` are left out of all."""

    def __init__(self, seen: Mapping[str, TopicSweeps], mending: Mending, leaves: frozenset[str]) -> None:
        self._leaves = leaves
        self._times: dict[str, Int64] = {}
        self._recorded = {name: np.concatenate([block.record_ns for block in each.blocks]) for name, each in seen.items()}
        self.run = {name: each.run for name, each in seen.items()}
        """Topic → (S,) run of each sweep."""
        for name, each in seen.items():
            times = np.concatenate([block.time_ns for block in each.blocks])
            mend = mending.topics.get(name)
            if mend is not None and mend.order is not None:
                times, self.run[name] = times[mend.order], self.run[name][mend.order]
            self._times[name] = times
        # Who wrote the log may have had a clock that was set, or none.
        self._is_told = all((np.diff(each) >= 0).all() and not _is_stuck(each) for each in self._recorded.values())

    def part(self, first_ns: int, last_ns: int, run: int | None) -> Cut | None:
        """Return the part with the sweeps from one time to another, of one run or of all; None without any."""
        sweeps, spans = dict[str, dict[int, int]](), dict[int, list[int]]()
        for name, times in self._times.items():
            inside = np.flatnonzero((times >= first_ns) & (times <= last_ns) & ((self.run[name] == run) | (run is None)))
            runs, recorded = self.run[name][inside], self._recorded[name][inside]
            sweeps[name] = dict(zip(inside.tolist(), runs.tolist(), strict=True))
            for each in np.unique(runs).tolist():
                held = recorded[runs == each]
                spans.setdefault(each, []).extend((int(held.min()), int(held.max())))
        known = tuple((min(each), max(each)) for each in spans.values()) if self._is_told else ()
        return Cut(known, self._leaves, sweeps) if spans else None

    def around(self, clip: Clip) -> dict[int, Cut]:
        """Return the parts of each run around a row: of that of its sweep, else of all that have sweeps then."""
        topic, sweep = clip.sweep or ("", 0)
        times = self._times.get(topic, ())
        is_there = 0 <= sweep < len(times) and clip.first_ns <= times[sweep] <= clip.last_ns
        every = np.unique(np.concatenate([*self.run.values()])).tolist()
        runs = [int(self.run[topic][sweep])] if is_there else every
        return {run: cut for run in runs if (cut := self.part(clip.first_ns, clip.last_ns, run)) is not None}
