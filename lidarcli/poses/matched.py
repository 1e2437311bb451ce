"""The path of a sensor from its sweeps alone, as a track of poses (`formalism.scan_matching`)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from lidarcli.choices import MATCH
from lidarcli.formalism.scan_matching import Matcher
from lidarcli.poses.tracks import SECOND_NS, Track, gathered
from lidarcli.sweeps import Float64, Int64, SweepBatch

TYPE = "matched"
"""Stands where a track has the type of its messages."""


class MatchedPath:
    """The path of one sensor: a fold over its batches in log order, however they are cut.

    A sweep has no pose where it has fewer than 15 points, repeats a stamp, or fits nowhere. Such sweeps do not change the map.
    After 10 that fit nowhere the map begins anew at the last known pose: the path is not to be trusted across such a point.
    """

    def __init__(self) -> None:
        self._matcher = Matcher(0)
        self._first_ns: int | None = None
        self._stamp_ns: list[Int64] = []
        self._record_ns: list[Int64] = []
        self._found: list[Float64] = []

    def add(self, batch: SweepBatch, told: Float64 | None = None) -> None:
        """Take sweeps of one topic and frame.

        Parameters
        ----------
        told : (S, 4) x, y, yaw of poses told for the sensor, NaN for none, and the part of the told path they belong to; the
            steps between them are where the search begins
        """
        if not len(batch):
            return
        if self._first_ns is None:
            self._first_ns = int(batch.stamp_ns[0])
        lasts = np.zeros(len(batch)) if batch.duration is None else np.nan_to_num(batch.duration)
        seconds = (batch.stamp_ns - self._first_ns) / SECOND_NS
        found = np.empty((len(batch), self._matcher.columns))
        self._matcher.follow(
            np.ascontiguousarray(batch.ranges, np.float32),
            np.ascontiguousarray(batch.beams, np.int32),
            np.ascontiguousarray(batch.angle_min, np.float64),
            np.ascontiguousarray(batch.angle_increment, np.float64),
            np.column_stack([seconds, np.zeros(len(batch)), lasts]),
            np.full((len(batch), 4), np.nan) if told is None else np.ascontiguousarray(told),
            found,
        )
        self._stamp_ns.append(batch.stamp_ns)
        self._record_ns.append(batch.record_ns)
        self._found.append(found)

    @property
    def stamp_ns(self) -> Int64:
        """(S,) stamps of all sweeps [ns]."""
        return np.concatenate(self._stamp_ns) if self._stamp_ns else np.zeros(0, np.int64)

    @property
    def poses(self) -> Float64:
        """(S, 3) x, y [m] and yaw [rad] of all sweeps, from the first; NaN without a pose."""
        return self._column(slice(0, 3))

    @property
    def pieces(self) -> Float64:
        """(S,) number of the piece of the path, from 1: it is not known how one lies to the next."""
        return self._column(6)

    @property
    def slides(self) -> Float64:
        """(S,) 1 where the walls in view do not fix the place along some direction, NaN without a pose."""
        return self._column(8)

    @property
    def unplaced(self) -> int:
        """Sweeps without a pose."""
        return int(np.count_nonzero(np.isnan(self.poses[:, 0])))

    @property
    def restarts(self) -> int:
        """Times that the map began anew."""
        return max(self._matcher.pieces - 1, 0)

    def track(self, topic: str, frame: str) -> Track | None:
        """Return the path from the frame of the first sweep; None where no sweep has a pose."""
        poses = self.poses
        there = np.flatnonzero(~np.isnan(poses[:, 0]))
        if not len(there):
            return None
        half, flat = 0.5 * poses[there, 2], np.zeros(len(there))
        numbers = np.column_stack([poses[there, :2], flat, flat, flat, np.sin(half), np.cos(half)])
        record_ns = np.concatenate(self._record_ns)
        return gathered((topic, TYPE, MATCH, frame), self.stamp_ns[there], numbers, record_ns[there], Counter())

    def _column(self, which: int | slice) -> Float64:
        found = np.concatenate(self._found) if self._found else np.zeros((0, self._matcher.columns))
        column: Float64 = found[:, which]
        return column
