"""The robot's own stops: where it stands between two drives, and what was ahead on the way that it would have driven."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones import AHEAD
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.zones.counts import TopicSeries
from lidarcli.pipeline.zones.events import STOP, event_row
from lidarcli.pipeline.zones.monitor import SHOWN
from lidarcli.reports.wording import counted
from lidarcli.reports.zones import WHO
from lidarcli.sweeps.types import Bool, Float64, Int64

SLOW = 0.03, 0.05
"""Speed [m/s] and turning rate [rad/s], over `SPAN_NS`, below which the robot stands."""
SPAN_NS = 500_000_000
BEFORE_NS = 2_000_000_000
"""Time before a stop in which the speed before it is the greatest [ns]."""
NEAR_NS = 1_000_000_000
"""Time before and after the begin of a stop in which is told what was ahead [ns]: stamps of poses are not exact."""


def standing(stamp_ns: Int64, pose: Float64) -> tuple[Int64, Bool, Float64]:
    """Return (N,) the sweep `SPAN_NS` before each, whether the sensor stood since then, and its speed since [m/s].

    `pose` (N, 4) as of `TopicSeries`, of sweeps in the order of time; one without a pose stands as little as it drives.
    """
    then = np.maximum(np.searchsorted(stamp_ns, stamp_ns - SPAN_NS, side="right") - 1, 0)
    seconds = np.maximum(stamp_ns - stamp_ns[then], 1) / SECOND_NS
    moved = pose - pose[then]
    turned = np.abs((moved[:, 2] + np.pi) % (2.0 * np.pi) - np.pi) / seconds
    speed = np.hypot(moved[:, 0], moved[:, 1]) / seconds
    return then, (speed < SLOW[0]) & (turned < SLOW[1]) & (then < np.arange(len(then))), speed


def stops_in(sensors: Sequence[TopicSeries]) -> Iterator[dict[str, Any]]:
    """Yield a row of the table of events for each stop of one robot, by its sensors.

    A stop begins where a drive ends. It is `cut` where it goes on at the end of the log.
    """
    lead = max(sensors, key=lambda one: int(np.isfinite(one.column("pose")[:, 0]).sum()))
    known = np.flatnonzero(np.isfinite(lead.column("pose")[:, 0]))
    order = known[np.argsort(lead.column("stamp_ns")[known], kind="stable")]
    if not len(order):
        return
    stamps, sweeps = lead.column("stamp_ns")[order], lead.column("sweep")[order]
    then, stands, speed = standing(stamps, lead.column("pose")[order])
    edges = np.flatnonzero(np.diff(stands, prepend=False, append=False)).reshape(-1, 2)
    first_ns = min(one.first_ns for one in sensors)
    for begin, end in edges.tolist():
        first, last = int(then[begin]), end - 1
        drives = np.flatnonzero(~stands[: begin + 1] & (speed[: begin + 1] > SLOW[0]))
        if not len(drives):
            continue
        span = int(stamps[first]), int(stamps[last])
        recent = (stamps >= span[0] - BEFORE_NS) & (stamps <= stamps[begin])
        row = event_row(lead, {"zone": "", "kind": STOP, "action": "none"}, sweeps[[first, last]].tolist(), span, first_ns)
        row |= {"sweeps": end - first, "cut": end == len(stamps), "speed": float(speed[recent].max())}
        yield row | _ahead(sensors, span[0]) | {"look": (lead.topic, (span[0] - lead.first_ns) / SECOND_NS)}


def _ahead(sensors: Sequence[TopicSeries], start_ns: int) -> dict[str, Any]:
    """Return what was nearest on the way of the robot when it stopped, as columns of the table of events."""
    found: dict[str, Any] = {"points": 0}
    least = np.inf
    for one in sensors:
        near = np.abs(one.column("stamp_ns") - start_ns) <= NEAR_NS
        along = np.where(near, one.column("ahead")[:, 0], np.nan)
        if np.nanmin(along, initial=np.inf) < least:
            at = int(np.nanargmin(along))
            least, nearest, bearing, x, y = one.column("ahead")[at].tolist()
            letter, track, points = one.column("ahead_owner")[at].tolist()
            found = {"points": points, "nearest": nearest, "bearing": bearing, "x": x, "y": y}
            found |= {"set": SETS[letter] if letter >= 0 else None, "track": track if track >= 0 else None}
    return found


def stop_lines(stops: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return heads and words on stops, in the order of time."""
    if not stops:
        return [("  stops    ", "none: the robot never stood between two drives")]
    total = sum(one["duration"] for one in stops)
    lines = [("  stops    ", f"{counted(len(stops), 'stop')} of the robot, {total:,.1f} s")]
    for one in sorted(stops, key=lambda each: each["start"])[:SHOWN]:
        lasts = f"{'>' if one['cut'] else ' '} {one['duration']:.1f} s"
        lines.append((" " * 11, f"{one['t']:8.1f} s  {lasts:>9}  from {one['speed']:.2f} m/s  {ahead_words(one)}"))
    return lines + ([(" " * 11, f"and {len(stops) - SHOWN:,} more")] if len(stops) > SHOWN else [])


def ahead_words(stop: Mapping[str, Any]) -> str:
    """Return what was on the way when the robot stopped, in words."""
    if stop["nearest"] is None:
        return f"nothing ahead within {AHEAD:g} m"
    who = WHO.get(stop["set"], "something").removesuffix("s")
    return " ".join(map(str, filter(None, [f"{stop['nearest']:.2f} m ahead:", who, stop["track"]])))
