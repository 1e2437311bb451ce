"""The path of a sensor from its sweeps alone, whether the sensor is static, and the order in which it sends its beams."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.scan_matching import Matcher
from lidarcli.options.choices import BEAM_ORDERS, MATCH
from lidarcli.options.times import SECOND_NS
from lidarcli.pose.tracks import PoseTrack, gathered
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepBatch

MIN_STEP = 0.001
"""Stamps that are mostly closer are no times [s]."""
MAX_UNPLACED = 0.3
"""Nothing is evaluated where a greater share of the sweeps has no matched pose."""
STANDING_OFF, STANDING_TURN = 0.02, np.deg2rad(0.5)
"""A sensor is static whose matched poses are no further from their middle [m, rad], but for 1 % of them."""


def wrapped(angle: Float64) -> Float64:
    """Return angles within ±π [rad]."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def stands(matched: Float64, slides: Float64) -> bool:
    """Return whether the sensor never moves, by the matched path.

    Parameters
    ----------
    matched : (S, 3) x, y, yaw, NaN where a sweep has no pose
    slides : (S,) 1 where the place is not fixed along some direction
    """
    known = np.isfinite(matched[:, 0])
    if len(known) == 0 or known.mean() < 1.0 - MAX_UNPLACED:
        return False
    middle = np.median(matched[known], axis=0)
    off = np.hypot(matched[known, 0] - middle[0], matched[known, 1] - middle[1])
    turn = np.abs(wrapped(matched[known, 2] - middle[2]))
    # Where most sweeps may slide, nothing says that the sensor is static.
    fixed = float(np.mean(slides[known] > 0)) < 0.5
    return bool(fixed and np.quantile(off, 0.99) < STANDING_OFF and np.quantile(turn, 0.99) < STANDING_TURN)


def still_at(stamp_ns: Int64, matched: Float64, slides: Float64) -> Bool:
    """Return at which sweeps (S,) the sensor is static; empty where too few sweeps have a pose.

    Parameters are as of `stands`, with the stamps of the sweeps (S,) [ns], increasing.
    """
    known = np.isfinite(matched[:, 0])
    if len(known) == 0 or known.mean() < 1.0 - MAX_UNPLACED:
        return np.zeros(0, bool)
    if stands(matched, slides):
        return np.ones(len(known), bool)
    # It is static at a sweep if the poses at both ends of 2 s around it are within 5 cm and 2 degrees.
    seconds = (stamp_ns[-1] - stamp_ns[0]) * 1e-9
    third = min(max(1, round(2.0 / 3.0 * len(stamp_ns) / max(seconds, 1e-3))), len(known))
    numbers = np.arange(len(known))
    columns = matched[known, 0], matched[known, 1], np.unwrap(matched[known, 2])
    filled = np.column_stack([np.interp(numbers, numbers[known], column) for column in columns])
    padded = np.pad(filled, ((third, third), (0, 0)), mode="edge")
    middles = np.median(np.lib.stride_tricks.sliding_window_view(padded, third, axis=0), axis=2)
    # Medians of the third of the window before each sweep, and of the third after it.
    apart = (middles[third + 1 :] - middles[: -(third + 1)])[: len(known)]
    still: Bool = (np.hypot(apart[:, 0], apart[:, 1]) < 0.05) & (np.abs(apart[:, 2]) < 0.035)
    return still


AUTO, FORWARD, REVERSE, ONCE = BEAM_ORDERS
SHORTEST_SWEEP = 0.005
"""Duration below which headers do not count [s]: all beams are taken at once."""
MIN_SHARE, MAX_SHARE, USUAL_SHARE = 0.2, 1.25, 0.9
"""Shares of the time from sweep to sweep that a sweep can take, and the share where headers state another."""
SKEWED, TYPICAL_RANGE = 0.03, 2.0
"""Motion during a sweep from which on it shows the order of its beams [m]; the range at which turns move points [m]."""
MIN_SKEWED, BLOCKS, CLEAR, OPPOSITE = 40, 20, 2.0, 1.5
"""Least sweeps that show an order, blocks they are compared in, deviations from which a difference is clear, and how many
times as many it takes to the opposite order: all at once lies between the two."""
LONGEST_SLIDE = 1.0
"""A slide without a guess loses its poses from this duration on, and no pose is between poses further apart [s]."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Times at which the beams of sweeps are sent."""

    order: str = AUTO
    """Order of the beams, of `BEAM_ORDERS`; `auto`: as the headers state."""
    duration: float = 0.0
    """Duration of a sweep [s] where the headers state none that can be; 0 for that of the headers."""

    @property
    def takes_time(self) -> bool:
        """True where a sweep takes time whatever the headers state."""
        return self.duration > 0.0 and self.order in (FORWARD, REVERSE)

    def of(self, headers: Float64) -> tuple[Float64, Float64]:
        """Return (S,) the times of the first and of the last beam after the header stamp [s].

        `headers`: (S,) duration of each sweep as its header states it, 0 for none.
        """
        none = np.zeros(len(headers))
        if self.order == AUTO:
            return none, np.where(np.abs(headers) < SHORTEST_SWEEP, 0.0, headers)
        if self.order == ONCE:
            return none, none
        lasts = np.full(len(headers), self.duration) if self.duration else headers
        return (none, lasts) if self.order == FORWARD else (lasts, none)


def headers_of(sweeps: SweepBatch) -> Float64:
    """Return (S,) the duration of each sweep as its header states it [s], 0 for none."""
    return np.zeros(len(sweeps.stamp_ns)) if sweeps.duration is None else np.nan_to_num(sweeps.duration)


def duration_of(sweeps: Sequence[SweepBatch]) -> tuple[float, float]:
    """Return the duration of a sweep by its period, 0 where the headers state a possible one, and the one to use [s]."""
    stamps = np.concatenate([batch.stamp_ns for batch in sweeps])
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0, 0.0
    period = float(np.median(steps)) / SECOND_NS
    given = [headers_of(batch) for batch in sweeps if batch.duration is not None]
    headers = float(np.median(np.concatenate(given))) if given else 0.0
    if MIN_SHARE * period <= headers <= MAX_SHARE * period:
        return 0.0, headers
    return USUAL_SHARE * period, USUAL_SHARE * period


class MatchedPath:
    """The path of one sensor: a fold over its batches in log order, however they are cut.

    A sweep has no pose where it has fewer than 15 points, repeats a stamp, or fits nowhere. Such sweeps do not change the
    map. After 10 that fit nowhere the map begins again at the last known pose: the path is not to be trusted across that.
    """

    def __init__(self, timing: Timing | None = None) -> None:
        self.timing = timing or Timing()
        self._matcher = Matcher(0)
        self._first_ns: int | None = None
        self._stamp_ns: list[Int64] = []
        self._record_ns: list[Int64] = []
        self._found: list[Float64] = []

    def add(self, sweeps: SweepBatch, given: Float64 | None = None) -> Float64:
        """Take sweeps of one topic and frame; return their x, y, yaw (S, 3), as `poses` has them.

        Parameters
        ----------
        given : (S, 4) x, y, yaw of given poses of the sensor, NaN for none, and the part of the given path they belong to;
            the search begins with the steps between them
        """
        if not len(sweeps):
            return np.zeros((0, 3))
        if self._first_ns is None:
            self._first_ns = int(sweeps.stamp_ns[0])
        seconds = (sweeps.stamp_ns - self._first_ns) / SECOND_NS
        found = np.empty((len(sweeps), self._matcher.columns))
        self._matcher.follow(
            np.ascontiguousarray(sweeps.ranges, np.float32),
            np.ascontiguousarray(sweeps.beams, np.int32),
            np.ascontiguousarray(sweeps.angle_min, np.float64),
            np.ascontiguousarray(sweeps.angle_increment, np.float64),
            np.column_stack([seconds, *self.timing.of(headers_of(sweeps))]),
            np.full((len(sweeps), 4), np.nan) if given is None else np.ascontiguousarray(given),
            found,
        )
        self._stamp_ns.append(sweeps.stamp_ns)
        self._record_ns.append(sweeps.record_ns)
        self._found.append(found)
        return found[:, :3]

    @property
    def stamp_ns(self) -> Int64:
        """(S,) stamps of all sweeps [ns]."""
        return _one(self._stamp_ns) if self._stamp_ns else np.zeros(0, np.int64)

    @property
    def record_ns(self) -> Int64:
        """(S,) record times of all sweeps [ns]."""
        return _one(self._record_ns) if self._record_ns else np.zeros(0, np.int64)

    @property
    def poses(self) -> Float64:
        """(S, 3) x, y [m] and yaw [rad] of all sweeps, from the first; NaN without a pose."""
        return self._column(slice(0, 3))

    @property
    def sharp(self) -> Float64:
        """(S,) share of the points that lie on the map within 15 mm."""
        return self._column(5)

    @property
    def pieces(self) -> Float64:
        """(S,) number of the piece of the path, from 1: it is not known how one lies to the next."""
        return self._column(6)

    @property
    def slides(self) -> Float64:
        """(S,) 1 where the walls in view do not fix the place along some direction, NaN without a pose."""
        return self._column(8)

    @property
    def restarts(self) -> int:
        """Times that the map began again."""
        return max(self._matcher.pieces - 1, 0)

    @property
    def placed(self) -> float:
        """Share of the sweeps that have a pose; 0 of none."""
        poses = self.poses
        return float(np.isfinite(poses[:, 0]).mean()) if len(poses) else 0.0

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        steps = np.diff(self.poses[:, :2], axis=0)
        return float(np.nansum(np.hypot(steps[:, 0], steps[:, 1])))

    def turns(self, duration: float) -> Float64:
        """Return (S,) how far points move as the sensor turns during each sweep [m], 0 where it is not known."""
        if not len(self.stamp_ns):
            return np.zeros(0)
        turns, seconds = np.abs(np.diff(self.poses[:, 2])), np.diff(self.stamp_ns) / SECOND_NS
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = TYPICAL_RANGE * np.minimum(turns, TURN - turns) * (duration / seconds)
        return np.concatenate([[0.0], np.nan_to_num(moved, nan=0.0, posinf=0.0, neginf=0.0)])

    def track(self, topic: str, frame: str) -> PoseTrack | None:
        """Return the path from the frame of the first sweep; None where no sweep has a pose.

        Long slides without a guess have no poses.
        """
        poses, there = self.poses, self._there()
        if not len(there):
            return None
        half, flat = 0.5 * poses[there, 2], np.zeros(len(there))
        numbers = np.column_stack([poses[there, :2], flat, flat, flat, np.sin(half), np.cos(half)])
        return gathered((topic, "matched", MATCH, frame), self.stamp_ns[there], numbers, self.record_ns[there], Counter())

    @property
    def gaps(self) -> Int64:
        """(G, 2) stamps of the sweeps before and after each stretch without poses [ns].

        It is longer than `LONGEST_SLIDE`, or the map began again after it.
        """
        there, stamps = self._there(), self.stamp_ns
        there = there[np.argsort(stamps[there], kind="stable")]
        ends = np.column_stack([stamps[there[:-1]], stamps[there[1:]]])
        is_long = ends[:, 1] - ends[:, 0] > LONGEST_SLIDE * SECOND_NS
        if len(stamps) > 1 and np.median(np.abs(np.diff(stamps))) < MIN_STEP * SECOND_NS:
            is_long[:] = True
        is_lost = np.diff(self.pieces[there]) != 0
        found: Int64 = ends[(np.diff(there) > 1) & (is_long | is_lost)]
        return found

    def _there(self) -> Int64:
        """Return the numbers of the sweeps whose poses are those of the path."""
        return np.flatnonzero(~np.isnan(self.poses[:, 0]) & ~self._long_slides())

    def _long_slides(self) -> Bool:
        """Return (S,) True in slides without a guess that are longer than `LONGEST_SLIDE`."""
        sliding = (np.nan_to_num(self.slides) > 0) & (np.nan_to_num(self._column(7)) == 0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], sliding.astype(np.int8), [0]])))
        long, stamps = np.zeros(len(sliding), bool), self.stamp_ns
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            long[begin:end] = stamps[end - 1] - stamps[begin] > LONGEST_SLIDE * SECOND_NS
        return long

    def _column(self, which: int | slice) -> Float64:
        found = _one(self._found) if self._found else np.zeros((0, self._matcher.columns))
        column: Float64 = found[:, which]
        return column


def _one(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Return parts as one array, and keep this in their place: a path is read after each batch."""
    if len(parts) > 1:
        parts[:] = [np.concatenate(parts)]
    return parts[0]


def order_of(paths: Mapping[str, MatchedPath], duration: float, clear: float) -> str:
    """Return the order of beams by which the sweeps fit the map best, empty where it is not clear.

    Parameters
    ----------
    paths : order → path that was matched by it, of the same sweeps
    duration : of a sweep [s]
    clear : standard deviations by which it must fit better than the others
    """
    skewed = np.flatnonzero(paths[FORWARD].turns(duration) > SKEWED)
    if len(skewed) < MIN_SKEWED:
        return ""
    sharp = {order: path.sharp[skewed] for order, path in paths.items()}

    def betters(one: str, other: str) -> float:
        """Return by how many standard deviations one order is better than the other."""
        apart = sharp[one] - sharp[other]
        means = np.array([np.nanmean(block) for block in np.array_split(apart, BLOCKS) if np.isfinite(block).any()])
        if len(means) < 2:
            return 0.0
        spread = float(np.std(means, ddof=1) / np.sqrt(len(means)))
        return float(np.mean(means)) / max(spread, 1e-9)

    for order in paths:
        others = {other: clear if ONCE in (order, other) else OPPOSITE * clear for other in paths if other != order}
        if all(betters(order, other) > least for other, least in others.items()):
            return order
    return ""
