"""One run as it is compared: its static objects, its occupancy, its frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.formalism.matching import alignment
from lidarcli.formalism.matching.differences import Run
from lidarcli.formalism.matching.ground import Ground
from lidarcli.options import choices
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.one_log import Reading
from lidarcli.pipeline.reading.posing import of_one_run
from lidarcli.sweeps.types import Float64
from lidarcli.sweeps.zone import ROBOT

AUTO, AS_IS, _ = choices.ALIGN


@dataclass(frozen=True, slots=True)
class DiffOptions:
    """Options of `diff`, apart from inputs and outputs."""

    detect: DetectOptions
    """Options of reading logs, and of finding and following static objects in them."""
    align: str = AUTO
    min_score: float = choices.MIN_SCORE
    overwrite: bool = False


@dataclass(slots=True)
class RunThings:
    """Static objects, occupancy and names of one input."""

    name: str
    run: Run
    world: str
    """Fixed frame of its places; empty for the sensor's own."""
    log: list[str] = field(default_factory=list)
    """Log of each object."""
    track: list[int] = field(default_factory=list)
    """Track of each object; 0 where there is none."""
    label: list[str | None] = field(default_factory=list)
    grid: Occupancy | None = None
    """The map, if it is one."""
    is_short: bool = False
    """True if nothing could be observed in it for as long as an object has to be static."""
    source: dict[str, Any] = field(default_factory=dict)
    reading: Reading | None = None
    """The first reading of its log."""
    before: Ground | None = None
    """The occupancy by the given poses, where a map corrects them."""
    unsure: int = 0
    """Number of the last objects, which only a lost robot observed."""
    poses: list[str] = field(default_factory=list)
    """Notes on poses that a map corrects."""
    notes: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)

    @property
    def is_common(self) -> bool:
        """True if its world outlives a run."""
        return bool(self.world) and not of_one_run(self.world)


def joined(*parts: tuple[RunThings, Sequence[int]]) -> tuple[alignment.Standing, Float64, dict[str, Any]]:
    """Return the objects of several runs, of each those in these rows: evidence, directions, and log, track, label."""
    names = alignment.Standing.__dataclass_fields__
    things = {name: np.concatenate([getattr(one.run.things, name)[rows] for one, rows in parts]) for name in names}
    yaw = np.concatenate([one.run.yaw[rows] for one, rows in parts])
    lists = {name: [getattr(one, name)[k] for one, rows in parts for k in rows] for name in ("log", "track", "label")}
    return alignment.Standing(**things), yaw, lists


_NONE, _NO_CODE = np.empty(0), np.empty(0, np.int32)
NOTHING = alignment.Standing(_NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NO_CODE, _NO_CODE), _NONE
"""No objects, and no direction of any."""


def frame_key(world: str, topic: str, frame: str, robot: Sequence[tuple[str, str]] = ()) -> str:
    """Return the world of a sensor, which may be on a robot; one that lies in no common frame begins with a blank."""
    if world.rpartition("/")[2] not in ("", choices.MATCH, ROBOT):
        return world
    topic, frame = (" and ".join(dict.fromkeys(names)) for names in zip(*(robot or [(topic, frame)]), strict=True))
    return f" {frame} of {topic}"


def frame_words(key: str) -> str:
    """Return words for people on a frame, as of `frame_key`."""
    return f"the frame of the sensor {key.strip()}" if key.startswith(" ") else f"the frame {key}"


def known_or_none(value: float) -> float | None:
    """Return a number, None where it is not finite."""
    return float(value) if math.isfinite(value) else None
