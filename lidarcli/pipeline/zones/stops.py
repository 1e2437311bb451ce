"""The robot's own stops: where it stands between two drives, and what was ahead on the way that it would have driven."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidarcli.display.texts import time_of_day
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones import AHEAD
from lidarcli.options.times import SECOND_NS, TimeZone
from lidarcli.pipeline.zones.counts import TopicSeries
from lidarcli.pipeline.zones.events import STOP, event_row
from lidarcli.pipeline.zones.monitor import SHOWN
from lidarcli.pose.frames import nearness
from lidarcli.pose.tracks import PoseTrack, flat
from lidarcli.reports.wording import counted
from lidarcli.reports.zones import WHO
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64

SLOW = 0.03, 0.05
"""Speed [m/s] and turning rate [rad/s], over `SPAN_NS`, below which the robot stands."""
SPAN_NS = 500_000_000
BEFORE_NS = 2_000_000_000
"""Time before a stop in which the speed before it is the greatest [ns]."""
NEAR_NS = 1_000_000_000
"""Time before and after the begin of a stop in which is told what was ahead [ns]: stamps of poses are not exact."""


class Motion(NamedTuple):
    """How a robot moved."""

    stamp_ns: Int64
    """(N,) ascending."""
    pose: Float64
    """(N, 3) x, y [m] and yaw [rad] of the robot, or of a sensor on it."""
    name: str
    """Topic of the odometry; empty where it is by the poses of the sweeps."""

    @property
    def then(self) -> Int64:
        """(N,) the pose `SPAN_NS` before each."""
        found: Int64 = np.maximum(np.searchsorted(self.stamp_ns, self.stamp_ns - SPAN_NS, side="right") - 1, 0)
        return found

    def speed(self) -> Float64:
        """Return (N,) the mean speed since `then` [m/s]."""
        moved = self.pose[:, :2] - self.pose[self.then, :2]
        found: Float64 = np.hypot(*moved.T) / self._seconds()
        return found

    def stands(self) -> Bool:
        """Return (N,) whether it stood since `then`."""
        turn = self.pose[:, 2] - self.pose[self.then, 2]
        turning = np.abs((turn + np.pi) % TURN - np.pi) / self._seconds()
        found: Bool = (self.speed() < SLOW[0]) & (turning < SLOW[1]) & (self.then < np.arange(len(turn)))
        # Odometry that stays the same is kept by its ends; between sweeps that are far apart nobody saw it stand.
        return found if self.name else found & (self._seconds() * SECOND_NS <= 2 * SPAN_NS)

    def _seconds(self) -> Float64:
        found: Float64 = np.maximum(self.stamp_ns - self.stamp_ns[self.then], 1) / SECOND_NS
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
    stands, speed = motion.stands(), motion.speed()
    for begin, after in np.flatnonzero(np.diff(stands, prepend=False, append=False)).reshape(-1, 2).tolist():
        span = int(motion.stamp_ns[motion.then[begin]]), int(motion.stamp_ns[after - 1])
        first, last = np.searchsorted(stamps, [span[0], span[1] + 1]) - [0, 1]
        if last <= first or not (speed[:begin] > SLOW[0]).any():
            continue
        about = {"zone": "", "kind": STOP, "action": "none"}
        row = event_row(lead, about, sweeps[[first, last]].tolist(), span, first_ns)
        recent = (motion.stamp_ns >= span[0] - BEFORE_NS) & (motion.stamp_ns <= motion.stamp_ns[begin])
        cut = after == len(stands) or span[1] >= stamps[-1]
        row |= {"sweeps": int(last - first) + 1, "cut": bool(cut), "speed": float(speed[recent].max())}
        yield row | _ahead(sensors, span[0])


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


def stop_lines(stops: Sequence[Mapping[str, Any]], zone: TimeZone) -> list[tuple[str, str]]:
    """Return heads and words on stops, in the order of time."""
    if not stops:
        return [("  stops    ", "none: the robot never stood between two drives")]
    total = sum(one["duration"] for one in stops)
    lines = [
        (
            "  stops    ",
            f"{counted(len(stops), 'stop')} of the robot, {total:,.1f} s; when, how long, speed before, what was ahead",
        )
    ]
    longest = sorted(stops, key=lambda each: -each["duration"])[:SHOWN]
    for one in sorted(longest, key=lambda each: each["start"]):
        lasts = f"{'>' if one['cut'] else ' '} {one['duration']:.1f} s"
        clock = f"{time_of_day(one['start'], zone)}  ".lstrip()
        before = f"{one['speed']:.2f} m/s" if one["speed"] > SLOW[0] else "turning"
        lines.append((" " * 11, f"{one['t']:8.1f} s  {clock}{lasts:>8}  {before:8}  {ahead_words(one)}"))
    return lines + ([(" " * 11, f"and {len(stops) - SHOWN:,} more")] if len(stops) > SHOWN else [])


def ahead_words(stop: Mapping[str, Any]) -> str:
    """Return what was on the way when the robot stopped, in words."""
    if stop["nearest"] is None:
        return f"nothing ahead within {AHEAD:g} m"
    who = WHO.get(stop["set"], "something").removesuffix("s")
    return " ".join(map(str, filter(None, [who, stop["track"], f"{stop['nearest']:.2f} m ahead"])))
