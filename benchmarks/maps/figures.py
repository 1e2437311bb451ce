"""Everything that `make maps` measures."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

import numpy as np

from benchmarks.maps.scoring import Score

OURS, WITHOUT_AGENTS = "lidarcli", "lidarcli --without agents"
EVERY, MOVED = "every sweep", "motion filter"
TOLD = "told steps"
"""Stands after the name of a drive whose path was guided by odometry."""
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
    """The map by the path that `--pose match` finds."""

    way: str
    score: Score


@dataclass(frozen=True, slots=True)
class PathError:
    """A path that was matched from sweeps beside the true one."""

    log: str
    beams: int
    view: float
    """Of the sensor [degrees]."""
    metres: float
    """Length of the true way."""
    over: float
    """The errors are those over so much of it [m]."""
    median: float
    p95: float
    """Error of the place as a share of that: median, and of the worst twentieth at least."""
    length: float
    """Distance from end to end of it that was found, as a share of the true one: median."""
    heading: float
    """Error of the heading [rad], rms."""
    rms: float
    """Error of the place with the first pose in common [m]; NaN of a way that does not come back."""
    slides: float
    unplaced: float
    """Shares of the sweeps that may slide along their walls, and that have no pose."""
    lost: int
    """Times that the map began anew."""
    milliseconds: float
    """Processor time of the matching for each sweep."""


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
    ways: list[Way] = field(default_factory=list)
    made: list[Made] = field(default_factory=list)
    matched: list[Matched] = field(default_factory=list)
    rolled: list[Rolled] = field(default_factory=list)
    loops: list[PathError] = field(default_factory=list)
    """Errors of matched paths along drawn loops ..."""
    straight: list[PathError] = field(default_factory=list)
    """... and straight corridors."""
    speed: Speed | None = None
    recorded: list[Recorded] = field(default_factory=list)
    real_paths: list[PathError] = field(default_factory=list)

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
        return [one.score for one in self.made if one.rule == rule and one.taken == taken and one.way in names]


def mean(values: Iterable[float]) -> float:
    """Their mean, NaN of none."""
    known = list(values)
    return float(np.mean(known)) if known else float("nan")


def as_json(figures: Figures) -> str:
    """For programs."""
    return json.dumps(asdict(figures), indent=2) + "\n"
