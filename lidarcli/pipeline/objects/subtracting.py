"""Comparison of the sweeps of a log with a background: the sensor that fits, the differences, and notes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.files.stores import place
from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.background import Background
from lidarcli.formalism.detect import noise
from lidarcli.formalism.detection import APPEARED, REMOVED
from lidarcli.formalism.subtraction import (
    MAX_DIFFERING,
    MAX_SWEEP_DIFFERING,
    MAX_SWEEPS_DIFFERING,
    MIN_SWEEPS_DIFFERING,
    SEEN_THROUGH,
    BackgroundDifference,
    Subtraction,
    Tolerance,
    assemble,
    changes,
    nothing_known,
)
from lidarcli.sweeps.masks import same_name
from lidarcli.sweeps.types import Int64, Status, SweepBatch
from lidarcli.tabular.background import read_background


@dataclass(frozen=True, slots=True)
class BackgroundOptions:
    """A background, and the options of comparing sweeps with it."""

    name: str
    """Its file's name."""
    sensors: tuple[Background, ...]
    removed: bool = False
    """Also report objects that have gone."""
    any_frame: bool = False
    """Use it for sensors of another name, too."""
    distance: float | None = None
    """Greatest distance of a sweep from its station [m]; by default as it was built."""
    angle: float | None = None
    """Greatest turn of a sweep away from its station [rad]; by default as it was built."""
    path: str = ""
    """Path of the file, if it was read from one: no output may replace it."""

    @staticmethod
    def of(path: str | Path, **options: Any) -> BackgroundOptions:
        """Read a background table (`UnreadableError` where it is none)."""
        sensors, _ = read_background(place(path))
        return BackgroundOptions(place(path).name, tuple(sensors), path=str(path), **options)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for the tables' metadata."""
        return {
            "file": self.name,
            "removed": self.removed,
            "any_frame": self.any_frame,
            "station_distance": self.distance,
            "station_angle": self.angle,
        }


@dataclass(slots=True)
class _ComparisonStats:
    """Counts of the comparison for one frame."""

    sweeps: int = 0
    without_pose: int = 0
    without_station: int = 0
    nearest: float = np.inf
    """Least distance of a sweep without a station from one [m]."""
    ranges: int = 0
    without_background: int = 0
    """Ranges in directions without a background."""
    differing: int = 0
    """Ranges before the background, or behind it by `SEEN_THROUGH`."""
    apart: int = 0
    """Sweeps that differ from the background in most ranges."""
    first_apart: float = np.inf
    """Index of the first of them."""


class BackgroundComparison:
    """Finds the objects that differ from a background, and counts what could not be compared.

    A threshold in metres is the least difference from the background; discontinuities are found as without one.
    """

    def __init__(self, options: BackgroundOptions, parameters: Parameters) -> None:
        threshold = parameters.threshold
        fixed = None if isinstance(threshold, str) else float(threshold)
        if fixed is not None:
            parameters = replace(parameters, threshold="mean" if parameters.profile == "paper" else "adaptive")
        self._options = options
        self._parameters = parameters
        self._tolerance = Tolerance(
            threshold=fixed,
            distance=options.distance,
            angle=options.angle,
            removed=options.removed,
            max_gap=parameters.max_gap,
        )
        self._prepared: dict[int, Subtraction] = {}
        self._chosen: dict[tuple[str, str], Subtraction] = {}
        self._counting = Lock()
        self._stats: dict[str, _ComparisonStats] = {}
        self._changes = np.zeros(2, np.int64)

    def admit(self, batch: SweepBatch) -> None:
        """Refuse the first batch of a frame that the background does not have or that looks elsewhere."""
        if not all((batch.topic, frame) in self._chosen for frame in batch.frame_ids):
            for frame, _, sweeps in batch.by_frame():
                self._subtraction(sweeps, frame)

    def detect(self, batch: SweepBatch, per_beam: bool) -> Detection:
        """Return the objects of a batch."""
        sigma = noise(batch)
        found = changes(batch, self.difference(batch, sigma), self._parameters, sigma, per_beam=per_beam)
        if found.change is not None:
            counts = np.bincount(found.change[found.change >= 0], minlength=2)
            with self._counting:
                self._changes += counts
        return found

    def difference(self, batch: SweepBatch, sigma: np.ndarray[Any, np.dtype[np.float64]]) -> BackgroundDifference:
        """Return r_w - r_e of a batch, whose sweeps may come from several frames."""
        parts: list[tuple[Int64, BackgroundDifference]] = []
        for frame, rows, sweeps in batch.by_frame():
            part = self._subtraction(sweeps, frame).difference(sweeps, sigma[rows])
            self._count(frame, sweeps, part)
            parts.append((rows, part))
        if len(parts) == 1:
            return parts[0][1]
        return assemble(nothing_known(batch), parts)

    def notes(self) -> list[str]:
        """Return notes on the changes that were found and on sweeps that could not be compared, a line each."""
        parts = [f"{self._changes[APPEARED]:,} appeared"]
        if self._options.removed:
            parts.append(f"{self._changes[REMOVED]:,} removed")
        lines = [f"compared with {self._options.name}: {', '.join(parts)}"]
        for frame, stats in sorted(self._stats.items()):
            name = frame or "without a name"
            if stats.without_station:
                line = (
                    f"without a station: {stats.without_station:,} of {stats.sweeps:,} sweeps of frame {name}, not compared"
                )
                if stats.without_pose:
                    line += f"; {stats.without_pose:,} of them have no pose"
                if np.isfinite(stats.nearest):
                    line += f"; the nearest is {stats.nearest:.2f} m away (--station-distance, --station-angle)"
                lines.append(line)
            if stats.without_background:
                share = stats.without_background / stats.ranges
                lines.append(
                    f"no background for {stats.without_background:,} of {stats.ranges:,} ranges ({share:.1%}) "
                    f"of frame {name}: they look where it does not"
                )
            compared = stats.ranges - stats.without_background
            if stats.differing > MAX_DIFFERING * compared:
                lines.append(
                    f"{stats.differing / compared:.0%} of the ranges of frame {name} differ from {self._options.name}: "
                    "it is of another place, or the sensor moved"
                )
            elif stats.apart > max(MAX_SWEEPS_DIFFERING * stats.sweeps, MIN_SWEEPS_DIFFERING - 1):
                lines.append(
                    f"{stats.apart:,} of {stats.sweeps:,} sweeps of frame {name}, from sweep {stats.first_apart:.0f} on, "
                    f"differ from {self._options.name} in more than {MAX_SWEEP_DIFFERING:.0%} of their ranges: the sensor "
                    "moved, or much before it did; compare what comes after with a background of its own (--start, --end)"
                )
        return lines

    def _subtraction(self, batch: SweepBatch, frame: str) -> Subtraction:
        key = batch.topic, frame
        if key not in self._chosen:
            index = choose_sensor(self._options, batch.topic, frame)
            sensor = self._options.sensors[index]
            _refuse_apart(self._options.name, sensor, batch, frame)
            self._chosen[key] = self._prepared.setdefault(index, Subtraction(sensor, self._tolerance))
        return self._chosen[key]

    def _count(self, frame: str, batch: SweepBatch, part: BackgroundDifference) -> None:
        lost = part.station < 0
        valid = (batch.status == Status.VALID) & ~lost[:, None]
        with np.errstate(invalid="ignore"):
            behind = np.isfinite(part.r_e) & (part.difference > SEEN_THROUGH)
        differing = valid & part.known & (part.appeared | behind)
        compared = np.count_nonzero(valid & part.known, axis=1)
        apart = np.flatnonzero(np.count_nonzero(differing, axis=1) > MAX_SWEEP_DIFFERING * compared)
        with self._counting:
            stats = self._stats.setdefault(frame, _ComparisonStats())
            stats.sweeps += len(batch)
            stats.without_station += int(np.count_nonzero(lost))
            stats.without_pose += int(np.count_nonzero(lost & np.isinf(part.away)))
            stats.nearest = min(stats.nearest, float(part.away[lost].min(initial=np.inf)))
            stats.ranges += int(np.count_nonzero(valid))
            stats.without_background += int(np.count_nonzero(valid & ~part.known))
            stats.differing += int(np.count_nonzero(differing))
            stats.apart += len(apart)
            if len(apart):
                stats.first_apart = min(stats.first_apart, float(batch.sweep[apart[0]]))


def choose_sensor(options: BackgroundOptions, topic: str, frame: str) -> int:
    """Return the index of the sensor of a background that took sweeps of this topic and frame.

    Raises
    ------
    OptionError
        None fits, or several do.
    """
    sensors = options.sensors
    fitting = [i for i, sensor in enumerate(sensors) if same_name(sensor.frame_id, frame)]
    if not fitting and options.any_frame:
        fitting = list(range(len(sensors)))
    if len(fitting) > 1:
        fitting = [i for i in fitting if same_name(sensors[i].topic, topic)] or fitting
    if len(fitting) == 1:
        return fitting[0]
    has = ", ".join(f"{sensor.frame_id or 'no frame'} ({sensor.topic})" for sensor in sensors) or "nothing"
    if fitting:
        raise OptionError(
            f"{options.name} holds several sensors that may be frame {frame} of {topic}: {has}; "
            "build a background of one of them with --topic"
        )
    raise OptionError(
        f"frame {frame or 'without a name'} of {topic} is not in {options.name}, which holds {has}; "
        "--topic chooses what to read, --any-frame takes the background all the same"
    )


def _refuse_apart(name: str, sensor: Background, batch: SweepBatch, frame: str) -> None:
    """Refuse a sensor whose view has no direction in common with that of the background."""
    first = batch.rows(np.zeros(1, np.int64))
    beams = sensor.grid.beam(first.bearings[:, : int(first.beams[0])])
    posed = bool(sensor.posed.any()) and batch.poses is not None
    if beams.size and not (beams >= 0).any() and not posed:
        views = (np.degrees([each.min(), each.max()]) for each in (sensor.grid.bearings, first.bearings[0]))
        known, here = (f"{low:.1f} to {high:.1f} deg" for low, high in views)
        raise OptionError(
            f"the views of {name} ({known}) and of frame {frame or 'without a name'} ({here}) do not overlap; build a "
            "background from a log of this sensor"
        )
