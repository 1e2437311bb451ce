"""Why did the robot stop? What a log says about the seconds around a time, put together as an answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from lidarcli.display import palette
from lidarcli.display.texts import counted, moment, time_of_day
from lidarcli.errors import OptionError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.options.times import SECOND_NS, Instant, Time, TimeOfDay, TimeZone
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import TableSet, contradicted
from lidarcli.pipeline.inputs.tracked import columns_of, paths_of
from lidarcli.pipeline.plotting import PlotOptions, take_pictures
from lidarcli.pipeline.zones.counts import TopicSeries
from lidarcli.pipeline.zones.events import APPROACH, NAV2, OCCUPIED, STALE, STOP, ZoneEvents
from lidarcli.pipeline.zones.monitor import NEAR_NS, Act
from lidarcli.pipeline.zones.options import ZoneOptions
from lidarcli.pipeline.zones.stops import SLOW, ahead_words, motion_of
from lidarcli.pose.messages import TWIST, TWIST_STAMPED, velocities
from lidarcli.pose.tracks import PoseTrack
from lidarcli.reports.document import Card, Stretch, TimePlot, TimeSeries
from lidarcli.reports.explanation import Explanation
from lidarcli.reports.scene import Picture
from lidarcli.reports.wording import in_unit
from lidarcli.reports.zones import WHO
from lidarcli.sweeps.types import Float64, Int64

AROUND_NS = 10 * SECOND_NS
"""Time before and after that is shown [ns]."""
MEANT_NS = 2 * SECOND_NS
"""Farthest event that a time means [ns]: people read it off a clock."""
SMOOTH_NS = SECOND_NS // 5
"""Time over which the driven speed is a mean [ns]."""
MAX_PICTURES = 120
"""Most pictures of a film."""
LEAP = 5.0
"""Speed between the poses of two sweeps that is no drive [m/s]."""
Row = Mapping[str, Any]


class Found(NamedTuple):
    """What `zones` found in a log, from which the answer is put together."""

    topics: Sequence[TopicSeries]
    by_zone: Sequence[ZoneEvents]
    acts: Sequence[Act]
    odometry: Sequence[PoseTrack]
    events: Sequence[Row]
    """Rows of the table of events."""
    described: Mapping[str, Any]
    """Description of the source."""
    frames: Sequence[str]
    """Notes on the transforms."""
    poses: Sequence[str]
    """Notes on the poses."""
    late_ns: int
    """Time from the stamps of sweeps to their recording."""


@dataclass(frozen=True)
class _Answer:
    """What happened at a time."""

    found: Found
    ns: int
    """The time [ns]."""
    span: tuple[int, int]
    """What is shown [ns]."""
    commanded: Mapping[str, tuple[Int64, Float64]]
    """Topic → stamps (N,) [ns] and velocities (N, 3) that it commands: ahead, left [m/s], turning [rad/s]."""
    tables: TableSet | None
    zone: TimeZone
    """Time zone of its words."""

    def near(self, *kinds: str, within_ns: int = NEAR_NS) -> list[Row]:
        """Return the events of some kinds that go on at the time or nearly so, the most severe first."""
        own = [one for one in self.found.events if one["kind"] in kinds and _away(one, self.ns) <= within_ns]
        return sorted(own, key=lambda one: ("stop" not in one["action"], _away(one, self.ns), one["nearest"] or 0.0))

    @cached_property
    def act(self) -> Row | None:
        """What Nav2 did."""
        return next(iter(self.near(NAV2)), None)

    @cached_property
    def stop(self) -> Row | None:
        """The stop of the robot."""
        return next(iter(self.near(STOP)), None)

    @cached_property
    def alarm(self) -> Row | None:
        """The event of a zone: the one by which Nav2 acted, if any."""
        every = self.near(OCCUPIED, APPROACH)
        named = [one for one in every if self.act is not None and one["zone"] == self.act["zone"]]
        return next(iter([*named, *every]), None)

    @cached_property
    def stale(self) -> Row | None:
        """The topic that was silent."""
        return next(iter(self.near(STALE)), None)

    @cached_property
    def cause(self) -> Row | None:
        """The event whose nearest point is the cause: in a zone, or ahead."""
        return self.alarm or (self.stop if self.stop is not None and self.stop["nearest"] is not None else None)

    @property
    def lead(self) -> TopicSeries:
        """The sensor that shows it."""
        named = [one for one in self.found.topics if self.cause is not None and one.topic == self.cause["topic"]]
        return (named or self.found.topics)[0]

    @cached_property
    def driven(self) -> tuple[Int64, Float64]:
        """Stamps (N,) [ns] and speeds [m/s] of the robot; none where nothing tells how it moved."""
        motion = motion_of(self.found.topics, self.found.odometry)._replace(span_ns=SMOOTH_NS)
        if motion.name:
            # Odometry that stays the same is kept by its ends.
            times = np.arange(motion.stamp_ns[0], motion.stamp_ns[-1] + 1, SMOOTH_NS // 2)
            x, y, yaw = (
                np.interp(times, motion.stamp_ns, each) for each in (*motion.pose[:, :2].T, np.unwrap(motion.pose[:, 2]))
            )
            motion = motion._replace(stamp_ns=times, pose=np.column_stack([x, y, yaw]))
        # The mean over a time is that of its middle.
        return (motion.stamp_ns + motion.stamp_ns[motion.then]) // 2, motion.speed()

    def speed(self, course: tuple[Int64, Float64], ns: int) -> float:
        """Return the newest speed at a time [m/s]; NaN where there was none in the second before."""
        at = int(np.searchsorted(course[0], ns, side="right")) - 1
        return float(course[1][at]) if at >= 0 and ns - course[0][at] <= SECOND_NS else np.nan

    @cached_property
    def culprit(self) -> tuple[Int64, Float64]:
        """Stamps [ns] of the sweeps that see the track of the cause, and the range of its nearest point [m]."""
        track = None if self.cause is None else self.cause["track"]
        if self.tables is None or track is None:
            return np.zeros(0, np.int64), np.zeros(0)
        rows = columns_of(self.tables, "objects", ("topic", "sweep", "track", "r_min"))
        own = (rows["topic"] == self.lead.topic) & (rows["track"] == track)
        sweeps = self.lead.column("sweep")
        order = np.argsort(sweeps)
        at = order[np.minimum(np.searchsorted(sweeps, rows["sweep"][own], sorter=order), len(sweeps) - 1)]
        nearest = np.full(len(sweeps), np.inf)
        np.minimum.at(nearest, at, rows["r_min"][own])
        stamps, seen = self.lead.column("stamp_ns"), np.isfinite(nearest)
        order = np.argsort(stamps[seen], kind="stable")
        return stamps[seen][order], nearest[seen][order]

    # In words.

    def clock(self, ns: int) -> str:
        """Return a time of the log in words: seconds, and the time of day where there is one."""
        return _clock(self.seconds(ns), ns, self.zone)

    def seconds(self, ns: int) -> float:
        """Return a time in seconds since the first sweep."""
        return (ns - min(one.first_ns for one in self.found.topics)) / SECOND_NS

    @property
    def who(self) -> str:
        """What was nearest, in words."""
        assert self.cause is not None
        name = WHO.get(self.cause["set"], "something").removesuffix("s")
        return " ".join(str(part) for part in (name, self.cause["track"], self.cause["label"]) if part)

    def sentences(self) -> Iterator[str]:
        """Yield the answer, the most important first."""
        yield self._what()
        if self.stale is not None:
            silent = f"No sweep of {self.stale['topic']} was new enough {self._from_to(self.stale)}"
            nav2 = " (Nav2 calls it an invalid source)" if self.act is not None else ""
            yield f"{silent}: what was around it then, nobody saw{nav2}."
        if self.alarm is not None:
            points = f" with {counted(self.alarm['points'], 'point')} at most" if self.alarm["points"] else ""
            nearest = f" {self.alarm['nearest']:.2f} m from the sensor" if self.alarm["nearest"] is not None else ""
            if self.span[0] <= self.alarm["start"] and self.alarm["end"] <= self.span[1]:
                yield f"{self.who[0].upper()}{self.who[1:]} was in {self.alarm['zone']}{nearest}{points}."
            else:
                zone = f"{self.alarm['zone']} was occupied {self._from_to(self.alarm)}"
                yield f"{zone}; the nearest in all that time was {self.who},{nearest}."
        elif self.stop is not None and self.stale is None:
            ahead = ahead_words(self.stop)
            if (unseen := self._unseen(self.stop["start"])) is not None:
                yield f"No sweep {unseen}: whether a zone was occupied, nobody saw."
            elif ahead.startswith("it"):
                yield f"No zone was occupied, and {ahead}."
            else:
                returned, beams = self.stop.get("that_way", (0, 0))
                unseen = f" ({returned} of {counted(beams, 'beam')} that way had a range)"
                more = unseen if self.stop["nearest"] is None else " from the sensor"
                yield f"No zone was occupied. Ahead on its way: {ahead}{more}."
        yield from self._disagreement()
        yield from self._command()
        faults = [*self._faults()]
        yield f"Not sound then: {'; '.join(faults)}." if faults else "Sensors, poses and transforms were sound."

    def _what(self) -> str:
        when = self.clock(self.ns)
        did = None if self.act is None else f"Nav2 said {self.act['action']} for {self.act['zone']}"
        if self.stop is not None:
            begun = self.clock(self.stop["start"])
            lasts = f"stood for {_lasting(self.stop)}" + (", until the log ends" if self.stop["cut"] else "")
            before = "turned" if abs(self.stop["speed"]) <= SLOW[0] else _drove(self.stop["speed"])
            stood = f"the robot, which {before}, {lasts}"
            return f"At {when} {did}, and at {begun} {stood}." if did else f"At {begun} {stood}."
        speed = self.speed(self.driven, self.ns)
        drove = "" if np.isnan(speed) else f"the robot {_drove(speed)}" if abs(speed) > SLOW[0] else "the robot stood"
        if self.act is not None and self.act["action"] == "stop" and abs(speed) > SLOW[0]:
            later = [one for one in self.near(STOP, within_ns=AROUND_NS) if one["start"] > self.ns]
            until = f" until {self.clock(later[0]['start'])}" if later else ""
            drove = f"the robot, which {_drove(speed)}, did not stop{until}"
        if did is None and self.alarm is not None:
            did = f"{self.alarm['zone']} was occupied from {self.clock(self.alarm['start'])} on for {_lasting(self.alarm)}"
        if did is None and self.stale is not None:
            did = f"{self.stale['topic']} was silent"
        return f"At {when} " + " and ".join(filter(None, [did, drove]) if did or drove else ["nothing happened"]) + "."

    def _unseen(self, ns: int) -> str | None:
        """Return from when to when there was no sweep about a time, in words; None where there was one."""
        stamps = np.sort(np.concatenate([one.column("stamp_ns") for one in self.found.topics]))
        after = int(np.searchsorted(stamps, ns))
        before = int(stamps[max(after - 1, 0)])
        end = int(stamps[min(after, len(stamps) - 1)])
        if min(abs(ns - before), abs(end - ns)) <= NEAR_NS:
            return None
        return f"from {self.clock(before)} to {self.clock(end)}"

    def _disagreement(self) -> Iterator[str]:
        """Yield what Nav2 and the zones say differently."""
        for act in self.found.acts:
            begin = act.start_ns - NEAR_NS <= self.ns <= act.end_ns + NEAR_NS
            if begin and act.otherwise:
                yield f"Nav2 and the zones disagree ({act.action}): {act.otherwise}."
                return
        if self.act is not None and self.stale is None:
            yield "The zones, judged by the sweeps of the log, say the same."

    def _command(self) -> Iterator[str]:
        """Yield what was commanded when the robot stopped."""
        if self.stop is None:
            yield from self._meanwhile()
            return
        if not self.commanded:
            yield "The log has no commands (geometry_msgs/Twist): whether it was told to stop cannot be said."
        start = self.stop["start"]
        for topic, (stamps, velocity) in self.commanded.items():
            last = int(np.searchsorted(stamps, start, side="right")) - 1
            if last < 0:
                yield f"{topic} commanded nothing until then."
                continue
            moves = (np.abs(velocity[:, 0]) > SLOW[0]) | (np.abs(velocity[:, 2]) > SLOW[1])
            # Poses may be late: a stand that is commanded right after it began is meant.
            after = slice(last, int(np.searchsorted(stamps, start + NEAR_NS, side="right")))
            last += 0 if moves[after].all() else int(np.argmin(moves[after]))
            age = (start - int(stamps[last])) / SECOND_NS
            if moves[last] and age > 1.0:
                yield f"The last command of {topic} had come {age:.1f} s before: it may have stopped as commands ceased."
            elif moves[last]:
                told = f"{velocity[last, 0]:.2f} m/s" if abs(velocity[last, 0]) > SLOW[0] else "a turn"
                yield f"{topic} commanded {told} all the same: something held the robot, or it did not listen."
            elif not moves[:last].any():
                yield f"It was told to: {topic} commanded to stand all the time."
            else:
                drive = int(np.flatnonzero(moves[:last])[-1])
                early = max((start - int(stamps[drive + 1])) / SECOND_NS, 0.0)
                told = f"{velocity[drive, 0]:.2f} m/s" if abs(velocity[drive, 0]) > SLOW[0] else "a turn"
                yield f"It was told to: {topic} went from {told} to a stand {early:.1f} s before."

    def _meanwhile(self) -> Iterator[str]:
        """Yield what was commanded while Nav2 acted and the robot did not stop."""
        if self.act is None:
            return
        for topic, (stamps, velocity) in self.commanded.items():
            own = velocity[(stamps >= self.act["start"]) & (stamps <= self.act["end"]), 0]
            yield f"Meanwhile {topic} commanded {f'up to {own[np.abs(own).argmax()]:.2f} m/s' if len(own) else 'nothing'}."

    def _faults(self) -> Iterator[str]:
        """Yield what was wrong with sensors, poses and transforms from a second before to half a second after."""
        low, high = max(self.ns - SECOND_NS, self.span[0]), min(self.ns + NEAR_NS, self.span[1])
        for one in self.found.topics:
            stamps = np.sort(one.column("stamp_ns"))
            step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
            # A gap counts as a whole, also where it began before.
            first, last = np.searchsorted(stamps, [low, high]).tolist()
            own = stamps[max(first - 1, 0) : last + 1]
            edges = own if len(own) > 1 else np.array([low, high])
            longest = float(np.diff(edges).max())
            if longest > max(2.5 * step, 0.5 * SECOND_NS):
                begin = self.clock(int(edges[np.diff(edges).argmax()]))
                yield f"no sweep of {one.topic} for {longest / SECOND_NS:.1f} s from {begin} on"
            shown = (one.column("stamp_ns") >= low) & (one.column("stamp_ns") <= high)
            pose = one.column("pose")[shown]
            if len(pose) > 1 and np.isfinite(pose[:, 0]).any():
                lost = int(np.isnan(pose[:, 0]).sum())
                if lost:
                    yield f"{counted(lost, 'sweep')} of {one.topic} without a pose"
                leaps = np.hypot(*np.diff(pose[:, :2], axis=0).T)
                leaps = leaps[
                    leaps * SECOND_NS > LEAP * np.maximum(np.diff(one.column("stamp_ns")[shown]), 0.05 * SECOND_NS)
                ]
                if len(leaps):
                    yield f"the poses leap by {leaps.max():.1f} m"
        for each in self.found.by_zone:
            when, observed = each.columns["stamp"], each.columns["observed"]
            assert when is not None
            assert observed is not None
            shown = observed[(when >= low) & (when <= high)]
            if not shown.all():
                yield f"{each.zone.name} was observed in {int(shown.sum()):,} of {counted(len(shown), 'sweep')}"
        for poses in self.found.described.get("poses", {}).values():
            yield from (f"poses {words.partition(';')[0]}" for words, _ in contradicted(poses).values())
        yield from (*self.found.poses, *self.found.frames)

    def facts(self) -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        yield "time", f"{self.seconds(self.ns):.3f} s, {moment(self.ns, self.zone)}"
        if self.act is not None:
            yield "Nav2", f"{self.act['action']}, {self.act['zone']}, {self._from_to(self.act)}"
        if self.stop is not None:
            yield "robot", f"stands {self._from_to(self.stop)}, drove {self.stop['speed']:.2f} m/s before"
            yield "ahead", ahead_words(self.stop)
        if self.alarm is not None:
            yield "zone", f"{self.alarm['zone']} ({self.alarm['action']}), occupied {self._from_to(self.alarm)}"
        if self.cause is not None:
            yield "nearest", f"{self.who}, {self.cause['nearest']:.2f} m" if self.cause["nearest"] is not None else self.who
        if self.stale is not None:
            yield "silent", f"{self.stale['topic']}, {self._from_to(self.stale)}"
        for topic, course in self.commanded.items():
            yield f"commanded by {topic}", self._speeds((course[0], course[1][:, 0]))
        if len(self.driven[0]):
            yield "driven", self._speeds(self.driven)
        for frame, poses in self.found.described.get("poses", {}).items():
            yield f"poses of {frame or 'the sensor'}", f"{poses.get('topic', 'none')} in {poses.get('world', 'no frame')}"

    def _from_to(self, row: Row) -> str:
        more = ", cut by the end of the log" if row["cut"] else ""
        return f"from {self.clock(row['start'])} to {self.clock(row['end'])}{more}"

    def _speeds(self, course: tuple[Int64, Float64]) -> str:
        values = [self.speed(course, self.ns + shift * SECOND_NS) for shift in (-1, 0, 1)]
        words = (in_unit(value, "m/s", ".2f") or "nothing" for value in values)
        return "{} a second before, {}, {} a second after".format(*words)

    def cards(self) -> Iterator[Card]:
        """Yield the key figures."""
        if self.cause is not None:
            yield Card("nearest", in_unit(self.cause["nearest"], "m", ".2f") or "unknown", self.who, alarming=True)
        if self.stop is not None:
            yield Card("stood for", f"{self.stop['duration']:.1f} s", "until the log ends" if self.stop["cut"] else "")
            backwards = "backwards" if self.stop["speed"] < 0.0 else ""
            yield Card("drove before", f"{self.stop['speed']:.2f} m/s", backwards)
        if self.act is not None:
            yield Card("Nav2", str(self.act["action"]), str(self.act["zone"]))

    def courses(self) -> TimePlot:
        """Return distance and speed over time."""
        distances, colours = [], (palette.PURPLE, palette.GREEN, palette.ORANGE)
        if len(self.culprit[0]):
            distances.append(self._course(self.who, self.culprit, palette.BLUE))
        for each, colour in zip(self.found.by_zone, colours, strict=False):
            stamps, nearest = each.columns["stamp"], each.columns["nearest"]
            if stamps is not None and nearest is not None and np.isfinite(nearest).any():
                distances.append(self._course(f"nearest in {each.zone.name}", (stamps, nearest), colour))
        speeds = [
            self._course(f"commanded by {topic}", _held((course[0], course[1][:, 0])), colour)
            for (topic, course), colour in zip(self.commanded.items(), (palette.VERMILION, *colours), strict=False)
        ]
        speeds += [self._course("driven", self.driven, palette.BLACK)] if len(self.driven[0]) else []
        stretches = []
        for row in self.found.events:
            begin, end = max(row["start"], self.span[0]), min(row["end"], self.span[1])
            words = {OCCUPIED: f"{row['zone']} occupied", APPROACH: f"{row['zone']} approached", STALE: "no sweeps"}
            words |= {NAV2: f"Nav2: {row['action']}", STOP: "the robot stands"}
            colour = {NAV2: palette.VERMILION, STALE: palette.DARK, STOP: palette.SKY}.get(row["kind"], palette.YELLOW)
            if row["kind"] in words and begin <= end:
                stretches.append(Stretch(words[row["kind"]], self.seconds(begin), self.seconds(end), colour))
        found = {"distance [m]": distances, "speed [m/s]": speeds}
        return TimePlot(self.seconds(self.ns), {name: some for name, some in found.items() if some}, stretches)

    def _course(self, name: str, course: tuple[Int64, Float64], colour: str) -> TimeSeries:
        own = (course[0] >= self.span[0]) & (course[0] <= self.span[1])
        seconds = np.array([self.seconds(each) for each in course[0][own].tolist()])
        # A line over a gap would show what nobody saw.
        after = np.flatnonzero(np.diff(seconds) > 1.0) + 1
        seconds, values = np.insert(seconds, after, seconds[after]), np.insert(course[1][own], after, np.nan)
        return TimeSeries(name, seconds, values, colour)

    def cells(self) -> dict[str, list[str]]:
        """Return the numbers second by second: heading → cells."""
        steps = range(-(AROUND_NS // SECOND_NS), AROUND_NS // SECOND_NS + 1)
        times = [ns for ns in (self.ns + step * SECOND_NS for step in steps) if self.span[0] <= ns <= self.span[1]]
        found = {"time": [f"{self.seconds(ns):.1f} s" for ns in times]}
        found["of day"] = [time_of_day(ns, self.zone) for ns in times]
        shown = self.courses()
        for one in (one for some in shown.courses.values() for one in some):
            values = [_nearest_value(one, self.seconds(ns)) for ns in times]
            found[one.name] = [in_unit(value, "", ".2f") for value in values]
        found["going on"] = [
            ", ".join(dict.fromkeys(one.name for one in shown.stretches if one.begin <= self.seconds(ns) <= one.end))
            for ns in times
        ]
        return found


def _held(course: tuple[Int64, Float64]) -> tuple[Int64, Float64]:
    """Return a course whose values hold until the next ones, as commands do."""
    return np.repeat(course[0], 2)[1:], np.repeat(course[1], 2)[:-1]


def _drove(speed: float) -> str:
    return f"drove {abs(speed):.2f} m/s" + (" backwards" if speed < 0.0 else "")


def _lasting(event: Row) -> str:
    return f"{event['duration']:.1f} s" if event["duration"] >= 0.05 else "less than 0.1 s"


def _clock(seconds: float, ns: int, zone: TimeZone) -> str:
    clock = time_of_day(ns, zone)
    return f"{seconds:.1f} s" + (f" ({clock})" if clock else "")


def _nearest_value(course: TimeSeries, seconds: float) -> float:
    """Return the value of a quantity at a time, by the nearest one within half a second; NaN without one."""
    away = np.abs(course.seconds - seconds) + np.where(np.isnan(course.values), np.inf, 0.0)
    return float(course.values[away.argmin()]) if len(away) and away.min() <= 0.5 else np.nan


def _away(row: Row, ns: int) -> int:
    """Return how far a time is from an event [ns]; 0 within."""
    return int(max(row["start"] - ns, ns - row["end"], 0))


def worst_times(events: Sequence[Row], most: int) -> list[int]:
    """Return the times [ns] to explain first: stops of Nav2 and of the robot, then zones that stop it, each once."""
    ranks = {NAV2: 0, STOP: 1, OCCUPIED: 2, APPROACH: 2, STALE: 3}
    own = [one for one in events if one["kind"] in ranks and (one["kind"] != NAV2 or one["action"] == "stop")]
    own.sort(key=lambda one: (ranks[one["kind"]], "stop" not in one["action"], one["nearest"] is None, one["nearest"]))
    found: list[int] = []
    for one in own:
        if all(abs(one["start"] - ns) > MEANT_NS for ns in found):
            found.append(one["start"])
    return found[:most]


def explain(
    source: Source, log: Log, options: ZoneOptions, found: Found, tables: TableSet | None, time: Time
) -> Explanation:
    """Return what happened at a time, by what `zones` found in the whole log.

    The time means the event that goes on then, or else begins or ends within two seconds. `OptionError`: the log does not
    have the time.
    """
    first_ns = min(one.first_ns for one in found.topics)
    zone = options.detect.read.time_zone
    wanted = time.after(first_ns) if isinstance(time, TimeOfDay) else time
    target = wanted.ns if isinstance(wanted, Instant) else first_ns + round(wanted * SECOND_NS)
    stamps = np.concatenate([one.column("stamp_ns") for one in found.topics])
    low, high = int(stamps.min()), int(stamps.max())
    if not low - MEANT_NS <= target <= high + MEANT_NS:
        raise OptionError(
            f"{source.label}: --explain {time}: the log has sweeps from {_clock((low - first_ns) / SECOND_NS, low, zone)} "
            f"to {_clock((high - first_ns) / SECOND_NS, high, zone)}"
        )
    ranked = [one for kind in (NAV2, STOP, OCCUPIED, APPROACH, STALE) for one in found.events if one["kind"] == kind]
    near = [one for one in ranked if _away(one, target) <= NEAR_NS and one["kind"] == NAV2]
    nearest = min(near or ranked, key=lambda one: (_away(one, target) > 0, abs(one["start"] - target)), default=None)
    ns = target
    if nearest is not None and _away(nearest, target) <= MEANT_NS:
        # Why it stands is told by how it stopped; what is in a zone changes while it is occupied.
        is_cause = nearest["kind"] in (NAV2, STOP, STALE) or target - nearest["start"] <= MEANT_NS
        ns = max(nearest["start"], low) if is_cause else target
    span = max(ns - AROUND_NS, low), min(ns + AROUND_NS, high)
    answer = _Answer(found, ns, span, _commanded(log, options, found.late_ns), tables, zone)
    pictures = _film(source, options, answer)
    return Explanation(
        log=source.file_name,
        moment=answer.clock(ns),
        answer=tuple(answer.sentences()),
        key=tuple(answer.cards()),
        facts=tuple(answer.facts()),
        courses=answer.courses(),
        pictures=pictures,
        seconds=tuple(answer.seconds(int(one.batch.stamp_ns[0])) for one in pictures),
        stamps=tuple(answer.clock(int(one.batch.stamp_ns[0])) for one in pictures),
        cells=answer.cells(),
        commands=() if options.explain is None else tuple(options.explain.commands(answer.lead.topic, answer.seconds(ns))),
    )


def _has_tracks(tables: TableSet, topic: str) -> bool:
    """Return whether anything was followed by the sensor."""
    return bool(tables.trajectories.exists()) and len(paths_of(tables, topic).track) > 0


def _commanded(log: Log, options: ZoneOptions, late_ns: int) -> dict[str, tuple[Int64, Float64]]:
    """Return the commanded speeds of a log by topic: those that zones name, else of every Twist."""
    types = {topic.name: topic.type for topic in log.topics() or () if topic.type in (TWIST, TWIST_STAMPED)}
    named = [zone.velocity_topic for zone in options.zones.zones if zone.velocity_topic in types]
    found = {}
    for topic in dict.fromkeys(named or types):
        told = velocities(log, topic, ReadReport())
        if told is not None and len(told[0]):
            # A plain Twist has no stamp but that of its record.
            found[topic] = told[0] - (late_ns if types[topic] == TWIST else 0), told[1]
    return found


def _film(source: Source, options: ZoneOptions, answer: _Answer) -> tuple[Picture, ...]:
    """Return pictures of the sweeps of the sensor around the time, at most `MAX_PICTURES`."""
    lead, detect = answer.lead, options.detect
    stamps = lead.column("stamp_ns")
    own = np.flatnonzero((stamps >= answer.span[0]) & (stamps <= answer.span[1]))
    if not len(own):
        return ()
    own = own[np.argsort(stamps[own], kind="stable")]
    chosen = own[np.unique(np.linspace(0, len(own) - 1, min(len(own), MAX_PICTURES)).astype(np.int64))]
    plot = PlotOptions(
        sweeps=tuple(lead.column("sweep")[chosen].tolist()),
        topic=lead.topic,
        parameters=detect.parameters,
        rules=detect.read.rules,
        opening=detect.opening,
        tracks=None if answer.tables is None or not _has_tracks(answer.tables, lead.topic) else answer.tables,
        poses=detect.poses,
        zones=options.zones,
        time_zone=answer.zone,
    )
    track = answer.cause["track"] if answer.cause is not None else None
    return tuple(replace(one, marked=-1 if track is None else track) for one in take_pictures(source, plot).pictures)
