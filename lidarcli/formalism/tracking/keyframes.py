"""Keyframes: sweeps half a second apart, by which a place is observed occupied or free before and after an object is there.

They reach back from a minute to two, in bounded memory. A look at a place in one of them ends there (a hit), passes it
(free space), or tells nothing. Who moves passes through places that are free before or after (Def. 4).
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import measurement
from lidarcli.formalism.tracking.kalman import Sightings
from lidarcli.formalism.tracking.measurement import Measurements
from lidarcli.sweeps import types
from lidarcli.system import native

NAN = float("nan")
NO_RETURN = types.Status.NO_RETURN.value
KEPT, SECONDS_APART, SWEEPS_APART = 384, 0.5, 2
"""Number of keyframes of a sensor, and least time [s] and number of sweeps between two of them, by which they hold two
windows."""
FLICKER_WEIGHT, MAX_FLICKER_SHARE = 0.02, 0.2
"""Weight of one sweep in the mean number of beams that flicker, and the share of the beams without a return that may have
one a sweep later: above it no such beam proves free space."""
GUARD_ANGLE, GUARD, MAX_BEAMS = 0.01, 0.05, 12.0
"""[rad], [m], beams: a look takes the beams within the sum of both, and so many, to each side of a place."""
LOOK_MARGIN, LOOK_MARGIN_SHARE = 0.12, 0.01
"""Least distance of the end of a beam from a place that it has not hit [m], and its growth with the range."""
SAME_VIEW, SAME_RANGE = math.cos(math.radians(10.0)), 1.25
"""A beam without a return shows free space only where the object itself was observed from about there: cosine of the
greatest angle between both views, and greatest ratio of both ranges."""
SECONDS_BEFORE, SECONDS_AFTER, MAX_WAY = 60.0, 25.0, 10.0
"""Keyframes so long before and after a sighting tell of its place [s], while the sensor has gone less than this [m]: the
path drifts."""

THINNED = 1.15
"""Least ratio of the times from a sighting to two keyframes that count."""
SECONDS_UNPLACED = 5.0
"""[s] The same where the place of the sensor is not known."""
WIDEST_COVER, COVER_STEP = 2.5, 0.5
"""[m] Greatest width of what hides an object to each side of it, and least step in range at its edges: what is wider is a
wall, behind which an object may leave unobserved."""
MAX_LOOKS = 8.0
"""Weight of the looks that decide on a place."""


class Keyframes:
    """The latest keyframes, `KEPT` for each sensor, and their poses; the newest replaces the oldest."""

    def __init__(self, beams: int, sensors: int = 1) -> None:
        """Make room for sweeps of so many beams, of so many sensors that are followed together."""
        self.owner: list[Any] = []
        self.beams, self.sensors, self.kept = beams, sensors, KEPT * sensors
        self.count = 0
        """Number of keyframes that were stored so far."""
        self.last_time = native.doubles(self.owner, sensors)
        self.last_sweep = native.integers(self.owner, sensors)
        """Time [s] and sweep of the last keyframe of each sensor; sweep -1 before the first."""
        self.sensor = native.integers(self.owner, self.kept)
        self.time = native.doubles(self.owner, self.kept)
        self.x = native.doubles(self.owner, self.kept)
        self.y = native.doubles(self.owner, self.kept)
        self.yaw = native.doubles(self.owner, self.kept)
        """Pose of the sensor at the first bearing [m, rad]."""
        self.motion_x = native.doubles(self.owner, self.kept)
        self.motion_y = native.doubles(self.owner, self.kept)
        self.motion_yaw = native.doubles(self.owner, self.kept)
        """Motion of the sensor from the first bearing to the last [m, rad]."""
        self.travelled = native.doubles(self.owner, self.kept)
        """Distance that the sensor had gone [m]."""
        self.side = native.doubles(self.owner, self.kept)
        self.first = native.doubles(self.owner, self.kept)
        self.step = native.doubles(self.owner, self.kept)
        self.bearings = native.integers(self.owner, self.kept)
        self.period = native.integers(self.owner, self.kept)
        self.r = native.singles(self.owner, self.kept * beams)
        """Ranges by bearing [m]: `measurement.NO_RANGE` where unknown, `FREE_RANGE` without a return."""
        self.pose = native.integers(self.owner, self.kept)
        """The same number for keyframes in a row of a sensor that is static."""
        # The place that is looked at (`aim`), and where it is observed from the last pose that was asked for.
        self.place_x = self.place_y = self.width = self.from_x = self.from_y = 0.0
        self.seen_from, self.seen_at, self.seen_x, self.seen_y = -1, 0.0, 0.0, 0.0
        self.seen_first, self.seen_last, self.nearest, self.farther, self.weight = 0, 0, 0.0, 0.0, 0.0
        """First and last beam to look at, ranges between which one is a hit [m], and the chance of a hit."""
        self.is_covered = False
        """True where the last look ended at what is nearer than the place."""
        # Of each sensor.
        self.farthest = native.doubles(self.owner, sensors)
        """Greatest range in its keyframes so far [m]."""
        self.changes = native.doubles(self.owner, sensors)
        """Mean number of beams that change between a range and no return from sweep to sweep."""
        self.lost = native.doubles(self.owner, sensors)
        """Mean number of beams without a return in either sweep."""
        self.status = native.integers(self.owner, sensors * beams)
        """Status of each beam in the sweep before."""
        self.watched = native.integers(self.owner, sensors)
        self.before = native.integers(self.owner, sensors)
        """Number of beams of the sweep before."""
        for sensor in range(sensors):
            self.last_sweep[sensor] = -1

    def grow(self, old: Keyframes) -> None:
        """Copy the keyframes of `old`, which have fewer beams."""
        self.count = old.count
        for s in range(old.sensors):
            self.changes[s], self.lost[s], self.watched[s] = old.changes[s], old.lost[s], old.watched[s]
            self.farthest[s] = old.farthest[s]
            self.before[s], self.last_sweep[s], self.last_time[s] = old.before[s], old.last_sweep[s], old.last_time[s]
            for beam in range(old.before[s]):
                self.status[s * self.beams + beam] = old.status[s * old.beams + beam]
        for m in range(old.kept):
            self.sensor[m], self.pose[m] = old.sensor[m], old.pose[m]
            self.time[m], self.x[m], self.y[m], self.yaw[m] = old.time[m], old.x[m], old.y[m], old.yaw[m]
            self.motion_x[m], self.motion_y[m], self.motion_yaw[m] = old.motion_x[m], old.motion_y[m], old.motion_yaw[m]
            self.side[m], self.first[m], self.step[m] = old.side[m], old.first[m], old.step[m]
            self.travelled[m] = old.travelled[m]
            self.bearings[m], self.period[m] = old.bearings[m], old.period[m]
            for k in range(old.bearings[m]):
                self.r[m * self.beams + k] = old.r[m * old.beams + k]

    def count_looks(self, sightings: Sightings, rows: Any, looks: Any) -> None:
        """Count the looks at the places of N sightings.

        Parameters
        ----------
        rows : (N,) int64, the sightings by their index
        looks : (N, 4) float64 to fill in: sums of free looks and of hits before, and after
        """
        row, out = native.at_longs(rows), native.at_doubles(looks)
        number = len(rows)
        lock = native.release()
        for i in range(number):
            count_looks_at(self, sightings, row[i], out, 4 * i)
        native.resume(lock)

    def stood(self, sightings: Sightings, i: int, since: float, until: float, unknown: bool = False) -> bool:
        """Return whether something stood at the place of sighting i between two times [s]; `unknown` without a look."""
        aim_at_sighting(self, sightings, i)
        since = max(sightings.time[i] - SECONDS_BEFORE, since)
        free, hits = looks_before(self, sightings.sensor[i], sightings.travelled[i], since, until)
        return hits > free if hits + free > 0.0 else unknown

    def uncovered(
        self, sensor: int, since: float, begin: complex, until: float, end: complex, width: float
    ) -> tuple[float, float, float]:
        """Return for how long an object on the straight path from one place x + iy to another had been observed, was out of
        view, and was hidden where it may have left unobserved [s].

        Parameters
        ----------
        sensor : the sensor that looks
        since, until : times at both ends of the path [s]
        begin, end : these ends [m]
        width : width of the object across the line of sight [m]
        """
        x, y, dx, dy = begin.real, begin.imag, end.real - begin.real, end.imag - begin.imag
        free, outside, left, later = 0.0, 0.0, 0.0, until
        for i in range(min(self.count, self.kept)):
            m = (self.count - 1 - i) % self.kept
            if self.time[m] >= until or self.sensor[m] != sensor:
                continue
            if self.time[m] <= since:
                break
            share = (self.time[m] - since) / (until - since)
            aim(self, x + share * dx, y + share * dy, width, self.x[m], self.y[m])
            seen = look(self, m)
            if seen > 0.0:
                free += seen * (later - self.time[m])
            elif seen == 0.0 and not self.is_covered:
                outside += later - self.time[m]
            elif seen < 0.0 or not is_enclosed(self, m):
                left += later - self.time[m]
            later = self.time[m]
        return free, outside, left


def is_enclosed(keyframes: Keyframes, m: int) -> bool:
    """Return whether what hides the place ends on both sides before what is behind it, so that nobody leaves unobserved."""
    r = math.sqrt(keyframes.seen_x * keyframes.seen_x + keyframes.seen_y * keyframes.seen_y)
    period, bearings = keyframes.period[m], keyframes.bearings[m]
    middle = int(math.floor(keyframes.seen_at + 0.5))  # noqa: RUF046
    for i in range(2):
        before, ends, lost = r, False, 0
        for k in range(bearings):
            at = middle + k if i else middle - k
            if k * r * keyframes.step[m] > WIDEST_COVER:
                return False
            if period > 0:
                at = (at + period) % period
            if at < 0 or at >= bearings:
                return False
            end = keyframes.r[m * keyframes.beams + at]
            if end < 0.0:
                continue
            # One beam alone may have been lost.
            lost = lost + 1 if end > measurement.MAX_RANGE else 0
            if lost > 1:
                return False
            if lost == 0 and end > before + COVER_STEP:
                ends = True
                break
            if lost == 0:
                before = end
        if not ends:
            return False
    return True


def count_flicker(keyframes: Keyframes, meas: Measurements, scans: Scans) -> None:
    """Count the beams that change between a range and no return: where few do, those without a return prove free space."""
    begin, beams, s = meas.row * scans.width, scans.beams[meas.row], meas.sensor
    changes, lost, last = 0, 0, s * keyframes.beams
    if keyframes.before[s] == beams:
        for beam in range(beams):
            now, then = scans.status[begin + beam], keyframes.status[last + beam]
            if now == NO_RETURN or then == NO_RETURN:
                lost += 1
                if now + then == NO_RETURN:
                    changes += 1
        # At first a plain mean of all sweeps so far.
        keyframes.watched[s] += 1
        share = max(FLICKER_WEIGHT, 1.0 / keyframes.watched[s])
        keyframes.changes[s] += share * (changes - keyframes.changes[s])
        keyframes.lost[s] += share * (lost - keyframes.lost[s])
    for beam in range(beams):
        keyframes.status[last + beam] = scans.status[begin + beam]
    keyframes.before[s] = beams
    meas.steady = keyframes.changes[s] <= MAX_FLICKER_SHARE * keyframes.lost[s]
    meas.farthest = keyframes.farthest[s]


def store(keyframes: Keyframes, meas: Measurements, scans: Scans) -> None:
    """Store a sweep, unless the last keyframe of its sensor is too recent."""
    s = meas.sensor
    if keyframes.last_sweep[s] >= 0:
        elapsed = meas.time - keyframes.last_time[s]
        if 0.0 <= elapsed < SECONDS_APART or meas.sweep - keyframes.last_sweep[s] < SWEEPS_APART * keyframes.sensors:
            return
    m = keyframes.count % keyframes.kept
    keyframes.last_time[s], keyframes.last_sweep[s], keyframes.sensor[m] = meas.time, meas.sweep, s
    keyframes.time[m], keyframes.travelled[m] = meas.time, meas.travelled
    keyframes.x[m], keyframes.y[m], keyframes.yaw[m] = meas.start_x, meas.start_y, meas.start_yaw
    keyframes.motion_x[m], keyframes.motion_y[m] = meas.motion_x, meas.motion_y
    keyframes.motion_yaw[m] = meas.motion_yaw
    if meas.reverse:
        keyframes.x[m] += meas.motion_x
        keyframes.y[m] += meas.motion_y
        keyframes.yaw[m] += meas.motion_yaw
        keyframes.motion_x[m], keyframes.motion_y[m] = -meas.motion_x, -meas.motion_y
        keyframes.motion_yaw[m] = -meas.motion_yaw
    keyframes.side[m], keyframes.first[m], keyframes.step[m] = meas.side, meas.first, meas.step
    keyframes.bearings[m], keyframes.period[m] = meas.bearings, meas.period
    before = (keyframes.count - 1) % keyframes.kept if keyframes.count > 0 else m
    keyframes.pose[m] = keyframes.pose[before] if before != m and is_same_pose(keyframes, m, before) else keyframes.count
    for k in range(meas.bearings):
        beam = meas.row * scans.width + measurement.position_of(meas, k)
        r = measurement.NO_RANGE
        if scans.status[beam] == measurement.VALID:
            r = scans.ranges[beam]
            keyframes.farthest[s] = max(keyframes.farthest[s], r)
        elif scans.status[beam] == NO_RETURN:
            r = measurement.FREE_RANGE
        keyframes.r[m * keyframes.beams + k] = r
    keyframes.count += 1


def is_same_pose(keyframes: Keyframes, m: int, n: int) -> bool:
    """Return whether two keyframes see every place at the same bearing and range."""
    is_there = (
        keyframes.x[m] == keyframes.x[n] and keyframes.y[m] == keyframes.y[n] and keyframes.yaw[m] == keyframes.yaw[n]
    )
    goes = keyframes.motion_x[m] == keyframes.motion_x[n] and keyframes.motion_y[m] == keyframes.motion_y[n]
    turns = keyframes.motion_yaw[m] == keyframes.motion_yaw[n] and keyframes.side[m] == keyframes.side[n]
    alike = keyframes.first[m] == keyframes.first[n] and keyframes.step[m] == keyframes.step[n]
    return is_there and goes and turns and alike and keyframes.bearings[m] == keyframes.bearings[n]


def aim(keyframes: Keyframes, x: float, y: float, width: float, from_x: float, from_y: float) -> None:
    """Set the place to look at in the world, the width of an object there across the line of sight, and the place of the
    sensor from which it was observed [m].
    """
    keyframes.place_x, keyframes.place_y, keyframes.width, keyframes.seen_from = x, y, width, -1
    keyframes.from_x, keyframes.from_y = from_x, from_y


def aim_at_sighting(keyframes: Keyframes, sightings: Sightings, i: int) -> None:
    """Set the place of a sighting."""
    x, y, width = sightings.middle_x[i], sightings.middle_y[i], sightings.chord[i]
    aim(keyframes, x, y, width, sightings.sensor_x[i], sightings.sensor_y[i])


def find_place(keyframes: Keyframes, m: int) -> None:
    """Find at which position in the order of bearings the place is in a keyframe, NaN outside of the view, and where it is
    from the sensor [m].
    """
    step, bearings = keyframes.step[m], keyframes.bearings[m]
    keyframes.seen_from, keyframes.seen_at = keyframes.pose[m], NAN
    if step < measurement.MIN_STEP or bearings < 2:
        return
    share, position, dx, dy = 0.5, 0.0, 0.0, 0.0
    # The bearing gives the time, which gives the pose, which gives the bearing.
    moves = keyframes.motion_x[m] != 0.0 or keyframes.motion_y[m] != 0.0 or keyframes.motion_yaw[m] != 0.0
    for _ in range(2 if moves else 1):
        dx = keyframes.place_x - keyframes.x[m] - share * keyframes.motion_x[m]
        dy = keyframes.place_y - keyframes.y[m] - share * keyframes.motion_y[m]
        yaw = keyframes.yaw[m] + share * keyframes.motion_yaw[m]
        angle = keyframes.side[m] * (math.atan2(dy, dx) - yaw) - keyframes.first[m]
        position = (angle - measurement.TURN * math.floor(angle / measurement.TURN)) / step
        if position > bearings - 0.5:
            if position < measurement.TURN / step - 0.5:
                return
            position -= measurement.TURN / step
        # Beyond some angle no number tells parts of a turn.
        if not -1.0 <= position <= bearings:
            return
        share = min(max(position / (bearings - 1), 0.0), 1.0)
    keyframes.seen_at, keyframes.seen_x, keyframes.seen_y = position, dx, dy
    r = math.sqrt(dx * dx + dy * dy)
    beside = min(max(1.0, (GUARD_ANGLE + GUARD / max(r, 0.1)) / step), MAX_BEAMS)
    margin = LOOK_MARGIN + LOOK_MARGIN_SHARE * r
    # C needs a conversion to integers here.
    keyframes.seen_first = int(math.ceil(position - beside))  # noqa: RUF046
    keyframes.seen_last = int(math.floor(position + beside))  # noqa: RUF046
    keyframes.nearest, keyframes.farther = r - margin, min(r + margin, measurement.MAX_RANGE)
    keyframes.weight = min(1.0, max(keyframes.width, 0.02) / max(r * step, 1e-3))


def look(keyframes: Keyframes, m: int) -> float:
    """Look at the place in a keyframe: -1 for a hit, 0 for nothing, else the chance that an object there had been hit."""
    if keyframes.pose[m] != keyframes.seen_from:
        find_place(keyframes, m)
    keyframes.is_covered = False
    if keyframes.seen_at != keyframes.seen_at:
        return 0.0
    bearings, period, begin = keyframes.bearings[m], keyframes.period[m], m * keyframes.beams
    nearest, farther, most = keyframes.nearest, keyframes.farther, measurement.MAX_RANGE
    passes, returns, blocked, unknown = 0, 0, 0, 0
    for k in range(keyframes.seen_first, keyframes.seen_last + 1):
        at = k
        if period > 0:
            while at < 0:
                at += period
            while at >= period:
                at -= period
        if at < 0 or at >= bearings:
            continue
        end = keyframes.r[begin + at]
        if farther < end <= most:
            passes += 1
        elif end > most:
            returns += 1
        elif end < 0.0:
            unknown += 1
        elif end >= nearest:
            return -1.0
        else:
            blocked += 1
    if blocked >= max(passes, 1):
        keyframes.is_covered = True
        return 0.0
    if passes == 0:
        # Beams without a return alone.
        s, dx, dy = keyframes.sensor[m], keyframes.seen_x, keyframes.seen_y
        r = math.sqrt(dx * dx + dy * dy)
        if returns == 0 or unknown > 0 or keyframes.changes[s] > MAX_FLICKER_SHARE * keyframes.lost[s]:
            return 0.0
        own_x, own_y = keyframes.place_x - keyframes.from_x, keyframes.place_y - keyframes.from_y
        own = math.sqrt(own_x * own_x + own_y * own_y)
        if own > SAME_RANGE * r or r > SAME_RANGE * own or own_x * dx + own_y * dy < SAME_VIEW * own * r:
            return 0.0
    # Next to what is nearer a small error of the pose would hide the object.
    open_share = 1.0 - 1.0 * blocked / max(passes, 1)
    return open_share * open_share * keyframes.weight


def looks_before(keyframes: Keyframes, sensor: int, travelled: float, oldest: float, until: float) -> tuple[float, float]:
    """Return the sums of free looks and of hits at the place, in the latest keyframes of a sensor between two times [s].

    Another sensor, which may look over objects or under them, says nothing of what this one observes.
    `travelled`: distance that the sensor had gone when it observed the object there.
    """
    free, hits = 0.0, 0.0
    for i in range(min(keyframes.count, keyframes.kept)):
        m = (keyframes.count - 1 - i) % keyframes.kept
        if keyframes.time[m] > until or keyframes.sensor[m] != sensor:
            continue
        if keyframes.time[m] < oldest or travelled - keyframes.travelled[m] > MAX_WAY:
            break
        seen = look(keyframes, m)
        if seen < 0.0:
            hits += 1.0
        else:
            free += seen
        if free + hits >= MAX_LOOKS:
            break
    return free, hits


def looks_at_measurement(keyframes: Keyframes, meas: Measurements, k: int, until: float) -> tuple[float, float]:
    """Return the sums of free looks and of hits at the middle of a measurement before a time [s]."""
    oldest = meas.time - (SECONDS_BEFORE if meas.is_placed else SECONDS_UNPLACED)
    aim(keyframes, meas.middle_x[k], meas.middle_y[k], meas.chord[k], meas.x, meas.y)
    return looks_before(keyframes, meas.sensor, meas.travelled, oldest, until)


def stood_before(keyframes: Keyframes, meas: Measurements, k: int, until: float) -> bool:
    """Return whether the latest looks before a time [s] show that something stood where a measurement is."""
    free, hits = looks_at_measurement(keyframes, meas, k, until)
    return hits > free


def count_looks_at(keyframes: Keyframes, sightings: Sightings, i: int, out: Any, at: int) -> None:
    """Count the looks at the place of one sighting (`Keyframes.count_looks`), the farther in time the fewer."""
    aim_at_sighting(keyframes, sightings, i)
    for k in range(4):
        out[at + k] = 0.0
    first, stop = max(keyframes.count - keyframes.kept, 0), keyframes.count
    begin = first - first % keyframes.kept
    # Times never fall.
    low, split = first, stop
    while low < split:
        m = (low + split) // 2
        if keyframes.time[m % keyframes.kept] >= sightings.time[i]:
            split = m
        else:
            low = m + 1
    for side in range(2):
        number, apart, most = split - 1 + side, 0.0, SECONDS_AFTER if side else SECONDS_BEFORE
        while first <= number < stop:
            m = number - begin if number - begin < keyframes.kept else number - begin - keyframes.kept
            number += 2 * side - 1
            off = abs(keyframes.time[m] - sightings.time[i])
            if off < apart or keyframes.sensor[m] != sightings.sensor[i]:
                continue
            if off > most or abs(keyframes.travelled[m] - sightings.travelled[i]) > MAX_WAY:
                break
            apart = THINNED * off
            seen = look(keyframes, m)
            if seen < 0.0:
                out[at + 2 * side + 1] += 1.0
            else:
                out[at + 2 * side] += seen
