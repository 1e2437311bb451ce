"""The robot's own stops: where it stands between two drives, and what was ahead on the way that it would have driven."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidarcli.display.texts import time_of_day
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones import AHEAD
from lidarcli.options.times import SECOND_NS, TimeZone
from lidarcli.pipeline.zones.counts import TopicSeries, event_row
from lidarcli.pipeline.zones.events import STOP
from lidarcli.pose.frames import nearness
from lidarcli.pose.tracks import PoseTrack, flat
from lidarcli.reports.wording import counted
from lidarcli.reports.zones import WHO
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64

SLOW = 0.03, 0.05
"""Speed [m/s] and turning rate [rad/s], over `SPAN_NS`, below which the robot stands."""
SPAN_NS = 500_000_000
SHOWN = 10
"""Most stops of which there is a line."""


class Motion(NamedTuple):
    """How a robot moved."""

    stamp_ns: Int64
    """(N,) ascending."""
    pose: Float64
    """(N, 3) x, y [m] and yaw [rad] of the robot, or of a sensor on it."""
    name: str
    """Topic of the odometry; empty where it is by the poses of the sweeps."""
    span_ns: int = SPAN_NS
    """Time over which speeds are means [ns]."""

    @property
    def then(self) -> Int64:
        """(N,) the pose `span_ns` before each."""
        found: Int64 = np.maximum(np.searchsorted(self.stamp_ns, self.stamp_ns - self.span_ns, side="right") - 1, 0)
        return found

    def speed(self) -> Float64:
        """Return (N,) the mean speed since `then` [m/s]; by odometry it is negative backwards."""
        moved = self.pose[:, :2] - self.pose[self.then, :2]
        found: Float64 = np.hypot(*moved.T) / self._seconds()
        ahead = (moved * np.column_stack([np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])])).sum(axis=1)
        # Where a sensor is mounted is not always known.
        return np.where(ahead < 0.0, -found, found) if self.name else found

    def stands(self) -> Bool:
        """Return (N,) whether it stood since `then`."""
        turning = np.abs(_turn(self.pose[:, 2] - self.pose[self.then, 2])) / self._seconds()
        found: Bool = (np.abs(self.speed()) < SLOW[0]) & (turning < SLOW[1]) & (self.then < np.arange(len(turning)))
        # Odometry that stays the same is kept by its ends; between sweeps that are far apart nobody saw it stand.
        return found if self.name else found & (self._seconds() * SECOND_NS <= 2 * SPAN_NS)

    def begin(self, stands: int) -> int:
        """Return from which pose on it stands that stood since the one `then`: it slowed down after that."""
        first = int(self.then[stands])
        steps = np.diff(self.pose[first : stands + 1], axis=0)
        seconds = np.diff(self.stamp_ns[first : stands + 1]) / SECOND_NS
        slow = (np.hypot(*steps[:, :2].T) < SLOW[0] * seconds) & (np.abs(_turn(steps[:, 2])) < SLOW[1] * seconds)
        return first + int(slow.argmax()) if slow.any() else first

    def speed_before(self, stamp_ns: int) -> float:
        """Return the median speed of the second that ends half a second before a time [m/s], signed as of `speed`."""
        first, after = np.searchsorted(self.stamp_ns, [stamp_ns - 3 * SPAN_NS, stamp_ns - SPAN_NS + 1]).tolist()
        return float(np.median(self.speed()[first:after])) if first < after else 0.0

    def _seconds(self) -> Float64:
        found: Float64 = np.maximum(self.stamp_ns - self.stamp_ns[self.then], 1) / SECOND_NS
        return found


def _turn(angle: Float64) -> Float64:
    """Return angles from -pi to pi [rad]."""
    found: Float64 = (angle + np.pi) % TURN - np.pi
    return found


def motion_of(sensors: Sequence[TopicSeries], odometry: Sequence[PoseTrack]) -> Motion:
    """Return how the robot of some sensors moved: by its odometry, else by the poses of the sensor that has most."""
    topics = [one.topic for one in sensors]
    near = {one.topic: how for one in odometry if (how := nearness(one.topic, topics[0], topics)) is not None}
    if near:
        own = max((one for one in odometry if one.topic in near), key=lambda one: near[one.topic])
        return Motion(own.stamp_ns, flat(own.motion), own.topic)
    lead = max(sensors, key=lambda one: int(np.isfinite(one.column("pose")[:, 0]).sum()))
    known = np.flatnonzero(np.isfinite(lead.column("pose")[:, 0]))
    order = known[np.argsort(lead.column("stamp_ns")[known], kind="stable")]
    return Motion(lead.column("stamp_ns")[order], lead.column("pose")[order, :3], "")


def stops_in(sensors: Sequence[TopicSeries], odometry: Sequence[PoseTrack]) -> Iterator[dict[str, Any]]:
    """Yield a row of the table of events for each stop of one robot.

    A stop begins where a drive ends. It is `cut` where it goes on at the end of the log.
    """
    motion, lead = motion_of(sensors, odometry), sensors[0]
    first_ns = min(one.first_ns for one in sensors)
    order = np.argsort(lead.column("stamp_ns"), kind="stable")
    stamps, sweeps = lead.column("stamp_ns")[order], lead.column("sweep")[order]
    stands, speed = motion.stands(), np.abs(motion.speed())
    for begin, after in np.flatnonzero(np.diff(stands, prepend=False, append=False)).reshape(-1, 2).tolist():
        span = int(motion.stamp_ns[motion.begin(begin)]), int(motion.stamp_ns[after - 1])
        if span[1] < stamps[0] or span[0] > stamps[-1] or not (speed[:begin] > SLOW[0]).any():
            continue
        first, beyond = np.searchsorted(stamps, [span[0], span[1] + 1]).tolist()
        ends = sweeps[[min(first, len(sweeps) - 1), max(beyond - 1, 0)]].tolist()
        about = {"zone": "", "kind": STOP, "action": "none"}
        row = event_row(lead, about, sorted(ends), span, first_ns)
        cut = after == len(stands) or span[1] >= stamps[-1]
        row |= {"sweeps": beyond - first, "cut": bool(cut), "speed": motion.speed_before(span[0])}
        yield row | _ahead(sensors, span[0])


def _ahead(sensors: Sequence[TopicSeries], start_ns: int) -> dict[str, Any]:
    """Return what was nearest on the way of the robot when it stopped, as columns of the table of events.

    There are no `points` where no sweep saw the half second before and after.
    """
    found: dict[str, Any] = {"points": None}
    least = np.inf
    for one in sensors:
        near = np.abs(one.column("stamp_ns") - start_ns) <= SPAN_NS
        if near.any():
            at = int(np.abs(one.column("stamp_ns") - start_ns).argmin())
            found |= {"points": found["points"] or 0, "that_way": tuple(one.column("ahead_owner")[at, 3:].tolist())}
        along = np.where(near, one.column("ahead")[:, 0], np.nan)
        if np.nanmin(along, initial=np.inf) < least:
            at = int(np.nanargmin(along))
            least, nearest, bearing, x, y = one.column("ahead")[at].tolist()
            letter, track, points, *_ = one.column("ahead_owner")[at].tolist()
            found |= {"points": points, "nearest": nearest, "bearing": bearing, "x": x, "y": y}
            found |= {"set": SETS[letter] if letter >= 0 else None, "track": track if track >= 0 else None}
    return found


def stop_lines(stops: Sequence[Mapping[str, Any]], zone: TimeZone) -> list[tuple[str, str]]:
    """Return heads and words on stops, in the order of time."""
    if not stops:
        return [("  stops    ", "none: the robot never stood between two drives")]
    total = sum(one["duration"] for one in stops)
    words = f"{counted(len(stops), 'stop')}, {total:,.1f} s: how long, speed before, and what was ahead"
    lines = [("  stops    ", words)]
    longest = sorted(stops, key=lambda each: -each["duration"])[:SHOWN]
    for one in sorted(longest, key=lambda each: each["start"]):
        lasts = f"{'>' if one['cut'] else ' '} {one['duration']:.1f} s"
        clock = f"{time_of_day(one['start'], zone)}  ".lstrip()
        before = f"{one['speed']:.2f} m/s" if abs(one["speed"]) > SLOW[0] else "turning"
        lines.append((" " * 11, f"{one['t']:8.1f} s  {clock}{lasts:>8}  {before:>9}  {ahead_words(one)}"))
    return lines + ([(" " * 11, f"and {len(stops) - SHOWN:,} more")] if len(stops) > SHOWN else [])


def ahead_words(stop: Mapping[str, Any]) -> str:
    """Return what was on the way when the robot stopped, in words."""
    if abs(stop["speed"]) <= SLOW[0]:
        return "it turned on the spot"
    if stop["points"] is None:
        return "no sweep then"
    if stop["nearest"] is None:
        return f"nothing seen within {AHEAD:g} m"
    who = WHO.get(stop["set"], "something").removesuffix("s")
    return " ".join(map(str, filter(None, [who, stop["track"], f"at {stop['nearest']:.2f} m"])))
