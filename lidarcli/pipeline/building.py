"""Background of a scene, learned from logs without objects of interest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.files.newfiles import refuse, write_whole
from lidarcli.files.stores import Place, place
from lidarcli.formalism.background import MAJORITY, STEADY, Background, Grid
from lidarcli.formalism.learning import Learning
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.registry import SUFFIXES
from lidarcli.options.choices import STATION_ANGLE, STATION_DISTANCE
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.needs import Need, PoseOptions
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, read_log, reading_as_dict
from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome, over_logs
from lidarcli.tabular.background import read_background, write_background
from lidarcli.tabular.writing import table_metadata


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """Options of `background`, apart from inputs and outputs."""

    read: ReadOptions = field(default_factory=ReadOptions)
    opening: OpenOptions = field(default_factory=OpenOptions)
    poses: PoseOptions = field(default_factory=PoseOptions)
    distance: float = STATION_DISTANCE
    """Greatest distance of a sweep from its station [m]."""
    angle: float = STATION_ANGLE
    """Greatest difference of its heading from that of the station [rad]."""

    def as_dict(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values, for the table's metadata."""
        stations = {"station_distance": self.distance, "station_angle": self.angle}
        return reading_as_dict(self.read, self.opening, self.poses) | stations


class BackgroundBuilder:
    """Learns from log after log; every topic and frame is a sensor of its own."""

    def __init__(self, options: BuildOptions) -> None:
        self._options = options
        self._learning: dict[tuple[str, str], Learning] = {}
        self._described: list[dict[str, Any]] = []
        self._damage: list[str] = []

    def add(self, source: Source, progress: Progress | None = None) -> RunSummary:
        """Learn from the sweeps of one log."""
        options = self._options
        with read_log(source, options, Need.MOVING) as reading:
            for batch in reading.batches(progress):
                for frame, _, mine in batch.by_frame():
                    key = batch.topic, frame
                    if key not in self._learning:
                        self._learning[key] = Learning(*key, Grid.of(mine, 0), options.distance, options.angle)
                    self._learning[key].add(mine)
            summary = reading.close()
            self._described.append(reading.describe(source))
            self._damage += [f"{self._described[-1]['name']}: {line}" for line in summary.damage]
        return summary

    def add_all(self, sources: Sequence[Source | MissingInput], report: LogProgress | None = None) -> Iterator[Outcome]:
        """Learn from one log after the other; a bad one does not stop the rest."""
        return over_logs(sources, self.add, report)

    def sensors(self) -> list[Background]:
        """Return the background of every sensor so far, by topic and frame."""
        return [self._learning[key].background() for key in sorted(self._learning)]

    def notes(self) -> list[str]:
        """Return a line for each reason for which sweeps were left out."""
        more = "there is no room for more stations or ranges; a greater --station-distance or a shorter --range needs less"
        lines = []
        for (topic, frame), learning in sorted(self._learning.items()):
            name = f"{topic} ({frame or 'no frame'})"
            if learning.left_out:
                lines.append(f"left out: {learning.left_out:,} sweeps of {name}: {more}")
            if learning.unplaced:
                lines.append(f"left out: {learning.unplaced:,} sweeps of {name} without a pose, while others have one")
        return lines

    def write(self, path: Place, sensors: Sequence[Background], overwrite: bool = True) -> list[str]:
        """Write the background table; notes as of `NewFiles.publish`."""
        metadata = table_metadata(self._options.as_dict(), self._described, self._damage)
        return write_background(path, sensors, metadata, overwrite)


def refuse_output(paths: Sequence[Place], sources: Sequence[Source | MissingInput], overwrite: bool) -> None:
    """Refuse a file that has the name of a log (`OptionError`), or cannot be written (`OutputError`)."""
    for path in paths:
        if path.name.lower().endswith(SUFFIXES):
            raise OptionError(f"{path} is the name of a log; a background is a .parquet")
    refuse(paths, overwrite, files_of(sources))


@dataclass(frozen=True, slots=True)
class Learned:
    """A background table that was read."""

    path: str
    """As the user wrote it."""
    sensors: Sequence[Background]
    metadata: dict[str, Any]


def load(source: Source) -> Learned:
    """Read a background table (`UnreadableError` where it is none)."""
    return Learned(source.label, *read_background(place(source.path)))


def scene_notes(sensors: Sequence[Background]) -> list[str]:
    """Return a line for each doubt in what was learned: a sensor that moved, beams whose background was hidden."""
    lines = []
    for sensor in sensors:
        name = f"{sensor.topic} ({sensor.frame_id or 'no frame'})"
        weak, beams = int(np.count_nonzero(sensor.weak)), sensor.weak.size
        unsteady = int(np.count_nonzero(~np.isnan(sensor.r_e) & (sensor.support < STEADY)))
        if sensor.seems_moved:
            lines.append(
                f"the sensor of {name} seems to have moved, or to have stood in several places: {unsteady:,} of {beams:,} "
                f"beams do not see the same range in {STEADY:.0%} of the sweeps; poses are needed (--pose TOPIC, "
                "docs/poses.md), or logs of a sensor parked in one place (--start, --end)"
            )
        elif weak:
            lines.append(
                f"support below {MAJORITY:.0%}: {weak:,} of {beams:,} beams of {name}: most sweeps saw something "
                "else there (--plot shows where)"
            )
    return lines


def draw_background(path: Place, sensors: Sequence[Background], overwrite: bool) -> list[str]:
    """Write a picture of a background, of the kind of the suffix; notes as of `NewFiles.publish`."""
    from lidarcli.reports.map_picture import draw_backgrounds

    return write_whole(path, draw_backgrounds(sensors, path.suffix.lower()), overwrite)


def refuse_nothing(sensors: Sequence[Background]) -> None:
    """Refuse a background without any sweep, and one without any known beam."""
    if not any(len(sensor) for sensor in sensors):
        raise NoScanError("no sweep to learn a background from")
    if all(np.isnan(sensor.r_e).all() for sensor in sensors):
        raise UnreadableError(
            "no background: no beam of any sweep has a range or says that nothing returned; 'lidarcli info' tells what "
            "the beams say, --range and --no-return how they are judged"
        )


def figures_of(sensor: Background) -> dict[str, Any]:
    """Return the figures of a background of one sensor, over all stations and beams."""
    r_e = sensor.r_e
    some = np.isfinite(r_e)
    any_range = bool(some.any())
    return {
        "sweeps": int(sensor.sweeps.sum()),
        "surface": int(np.count_nonzero(some)),
        "open": int(np.count_nonzero(np.isinf(r_e))),
        "unknown": int(np.count_nonzero(np.isnan(r_e))),
        "weak": int(np.count_nonzero(sensor.weak)),
        "r_e_min": float(r_e[some].min()) if any_range else None,
        "r_e_max": float(r_e[some].max()) if any_range else None,
        "spread": float(np.median(sensor.spread[some])) if any_range else None,
        "support": float(np.median(sensor.support[some])) if any_range else None,
        "least_support": float(sensor.support[some].min()) if any_range else None,
    }
