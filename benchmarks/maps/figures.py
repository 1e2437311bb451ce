"""Everything that `make maps` measures."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

import numpy as np

from benchmarks.maps.scoring import Score

OURS, WITHOUT_AGENTS = "lidarcli", "lidarcli --without-agents"
EVERY, MOVED = "every sweep", "motion filter"
INSTANT, DESKEWED, SKEWED = "sweeps in an instant", "sweeps of 0.1 s", "sweeps of 0.1 s, --no-deskew"


@dataclass(frozen=True, slots=True)
class Way:
    """A drive through a building."""

    kind: str
    seed: int
    metres: float
    sweeps: int
    counted: int
    """Sweeps that the motion filter lets through."""
    people: int
    true_cells: int
    once: float
    twice: float
    """Shares of the true cells that one, or two, of these sweeps would hit without noise and without people."""

    @property
    def name(self) -> str:
        """Of the drive in tables."""
        return f"{self.kind} {self.seed}"


@dataclass(frozen=True, slots=True)
class Made:
    """A map by a rule."""

    way: str
    rule: str
    taken: str
    """`EVERY` or `MOVED`."""
    score: Score


@dataclass(frozen=True, slots=True)
class Matched:
    """A path found by `--pose match`, and its map."""

    way: str
    metres: float
    rms: float
    worst: float
    """Errors of the place [m]."""
    score: Score


@dataclass(frozen=True, slots=True)
class Rolled:
    """A fast drive, seen with sweeps that take their time or do not."""

    way: str
    sweeps: str
    turn: float
    """Fastest turn [rad/s]."""
    score: Score
    things: int
    """Standing things whose boxes are compared."""
    median: float
    rms: float
    """How far a box is from the middle of all boxes of its thing in the world [m]."""


@dataclass(frozen=True, slots=True)
class Speed:
    """Of the program and its kernel."""

    per_second: float
    """Sweeps, every one of which counts, in one process from its start to its end."""
    iterate: float
    """Its time as a multiple of that of iterating the messages."""
    cells: float
    """Cells of rays per second in the kernel."""
    gb_per_km2: float
    """Memory by the extent of the map."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A map of a public recording."""

    log: str
    sweeps: int
    counted: int
    metres: float
    """Way of the sensor."""
    width: float
    height: float
    occupied: int
    free: int


@dataclass(frozen=True)
class Figures:
    """Of one run."""

    command: str
    first_seed: int
    ways: list[Way]
    made: list[Made]
    matched: list[Matched]
    rolled: list[Rolled]
    speed: Speed | None = None
    recorded: list[Recorded] = field(default_factory=list)

    @property
    def rules(self) -> list[str]:
        """In the order in which they come."""
        return list(dict.fromkeys(one.rule for one in self.made))

    @property
    def kinds(self) -> list[str]:
        """Kinds of buildings."""
        return list(dict.fromkeys(way.kind for way in self.ways))

    def of(self, rule: str, taken: str, kind: str | None = None) -> list[Score]:
        """The scores of a rule, of one kind of building or of all."""
        names = [way.name for way in self.ways if kind is None or way.kind == kind]
        return [
            one.score for one in self.made if one.rule == rule and one.taken == taken and one.way in names
        ]


def mean(values: Iterable[float]) -> float:
    """Their mean, NaN of none."""
    known = list(values)
    return float(np.mean(known)) if known else float("nan")


def as_json(figures: Figures) -> str:
    """For programs."""
    return json.dumps(asdict(figures), indent=2) + "\n"
