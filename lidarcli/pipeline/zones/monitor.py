"""Acts of Nav2's Collision Monitor while the log was recorded, compared with the events of the zones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from lidarcli.display.texts import time_of_day, times
from lidarcli.logs.base import Log, Message, ReadReport
from lidarcli.options.times import SECOND_NS, TimeZone
from lidarcli.pipeline.zones.counts import event_row
from lidarcli.pipeline.zones.events import APPROACH, NAV2, OCCUPIED, STALE, ZoneEvents
from lidarcli.pose.messages import messages_of
from lidarcli.ros.cursor import Cursor

STATE = "nav2_msgs/msg/CollisionMonitorState"
ACTS = ("", "stop", "slowdown", "approach", "limit")
"""Actions of a state by their numbers; the first is none."""
NEAR_NS = 500_000_000
"""An event of the zones this near to an act is the same: Nav2 decides at each velocity command [ns]."""
SHOWN = 5
"""Most acts of which there is a line."""


class Act(NamedTuple):
    """A stretch of time in which Nav2 acted [ns], or, as read, did something else, too."""

    start_ns: int
    end_ns: int
    action: str
    zone: str
    otherwise: str = ""
    """The zones' view of it; empty if the same."""


def states(log: Log, report: ReadReport) -> list[Act]:
    """Read the states of the monitors, by times of the recording; what cannot be read is counted in the report."""
    topics = [topic.name for topic in log.topics() or () if topic.type == STATE]
    reported = [one for topic in topics for one in messages_of(log, topic, frozenset({STATE}), report, _state) or ()]
    # A monitor may report the same again.
    reported = [next(alike) for _, alike in groupby(sorted(reported), key=lambda one: one[2:4])]
    ends = [one.start_ns for one in reported[1:]] + [1 << 62]
    return [one._replace(end_ns=end) for one, end in zip(reported, ends, strict=False)]


def _state(message: Message, cursor: Cursor) -> Act:
    number, zone = cursor.byte(), cursor.text()
    return Act(message.record_ns, 0, ACTS[number] if number < len(ACTS) else f"action {number}", zone)


def acts_of(told: Sequence[Act], late_ns: int, by_zone: Sequence[ZoneEvents]) -> list[Act]:
    """Return what Nav2 did from the first sweep to the last, by stamps of sweeps, which are recorded `late_ns` later."""
    stamps = [each for one in by_zone if (each := one.columns["stamp"]) is not None and len(each)]
    last = max((int(each.max()) for each in stamps), default=0)
    first = min((int(each.min()) for each in stamps), default=last)
    shifted = [one._replace(start_ns=one.start_ns - late_ns, end_ns=min(one.end_ns - late_ns, last)) for one in told]
    own = [one for one in shifted if one.action and one.start_ns <= last and one.end_ns >= first]
    return [act._replace(otherwise=_otherwise(act, by_zone)) for act in own]


def _otherwise(act: Act, by_zone: Sequence[ZoneEvents]) -> str:
    begin, end, is_stale = act.start_ns - NEAR_NS, act.end_ns + NEAR_NS, act.zone == "invalid source"
    own = [one for one in by_zone if is_stale or one.zone.name == act.zone]
    kinds = (STALE,) if is_stale else (OCCUPIED, APPROACH)
    events = [event for one in own for event in one.events if event["kind"] in kinds]
    if any(event["start"] <= end and event["end"] >= begin for event in events):
        return ""
    if is_stale or not own:
        return "no source was too old" if is_stale else "no zone of this name is judged"
    most, sweeps = 0, 0
    for columns in (one.columns for one in own):
        stamps, points = columns["stamp"], columns["points"]
        assert stamps is not None
        assert points is not None
        shown = (stamps >= begin) & (stamps <= end)
        sweeps += int(np.count_nonzero(shown))
        most = max(most, int(points[shown].max(initial=0)))
    if not sweeps:
        return "not seen"
    return f"{most:,} of {own[0].zone.min_points:,} points in it" if most else "nothing was in it"


def rows_of(acts: Sequence[Act], by_zone: Sequence[ZoneEvents], first_ns: int) -> Iterator[dict[str, Any]]:
    """Yield a row of the table of events for each act, with the sweeps of the first topic of the zones meanwhile."""
    topic = by_zone[0].topics[0]
    order = np.argsort(topic.column("stamp_ns"), kind="stable")
    stamps, sweeps = topic.column("stamp_ns")[order], topic.column("sweep")[order]
    for act in acts:
        first, after = np.searchsorted(stamps, [act.start_ns, act.end_ns + 1])
        ends = sweeps[[min(int(first), len(sweeps) - 1), max(int(after) - 1, 0)]].tolist()
        about = {"zone": act.zone, "kind": NAV2, "action": act.action if act.action in ACTS else "none"}
        row = event_row(topic, about, ends, (act.start_ns, act.end_ns), first_ns)
        yield row | {"sweeps": max(int(after - first), 0), "cut": act.end_ns >= int(stamps[-1])}


def missed_stops(acts: Sequence[Act], by_zone: Sequence[ZoneEvents]) -> list[Act]:
    """Return the events of zones that stop the robot during which Nav2 did not stop it, as acts."""
    stops = [(act.start_ns - NEAR_NS, act.end_ns + NEAR_NS) for act in acts if act.action == "stop"]
    events = [
        (event, one.zone.name)
        for one in by_zone
        for event in one.events
        if event["kind"] in (OCCUPIED, APPROACH) and event["action"] == "stop"
    ]
    return [
        Act(event["start"], event["end"], "no stop", name, "the zone says stop")
        for event, name in events
        if not any(event["start"] <= end and event["end"] >= begin for begin, end in stops)
    ]


def lines_of(acts: Sequence[Act], first_ns: int, zone: TimeZone) -> list[tuple[str, str]]:
    """Return heads and words on what Nav2 did; stops come first, those first of which the zones say otherwise."""
    did = ", ".join(f"{action} {times(count)}" for action, count in Counter(act.action for act in acts).items())
    same = sum(not act.otherwise for act in acts)
    lines = [("  Nav2     ", f"{did}; the zones say the same {times(same) if same else 'never'}")] if acts else []
    width = max((len(act.zone) for act in acts), default=0)
    for act in sorted(acts, key=lambda one: ("stop" not in one.action, not one.otherwise, one.start_ns))[:SHOWN]:
        begin, lasts = (act.start_ns - first_ns) / SECOND_NS, (act.end_ns - act.start_ns) / SECOND_NS
        clock = f"{time_of_day(act.start_ns, zone)}  ".lstrip()
        words = f"{begin:8.1f} s  {clock}{act.zone:{width}}  {lasts:6.1f} s  {act.action:8}  {act.otherwise or 'the same'}"
        lines.append((" " * 11, words))
    return lines + ([(" " * 11, f"and {len(acts) - SHOWN:,} more")] if len(acts) > SHOWN else [])
