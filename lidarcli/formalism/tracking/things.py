"""Bodies that were seen often enough to be believed, and the tracks they are parts of."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import UNKNOWN
from lidarcli.formalism.tracking.tracked import END_OF_LOG, ENDED, LEGS, PERSON

_SNAPSHOT = (
    *(
        "kind",
        "sightings",
        "whole",
        "moved",
        "first_sweep",
        "last_sweep",
        "onset",
        "member",
        "same_as",
        "end",
        "first_at",
        "seen_at",
    ),
    *("evidence_most", "yaw", "yaw_rate", "birth_x", "birth_y", "size", "bulge", "bulge_points"),
)
_SNAPSHOT_AXES = ("c", "v", "h", "hh", "still_c", "side", "side_weight", "least")


@dataclass(slots=True, eq=False)
class Thing:
    """A body that was seen often enough to be believed, as it was when a window ended."""

    number: int
    kind: int = 0
    sightings: int = 0
    whole: int = 0
    moved: int = 0
    first_sweep: int = 0
    last_sweep: int = 0
    onset: int = 0
    end: int = END_OF_LOG
    same_as: int = 0
    member: int = 0
    first_at: float = 0.0
    seen_at: float = 0.0
    evidence_most: float = 0.0
    yaw: float = 0.0
    yaw_rate: float = 0.0
    birth_x: float = 0.0
    birth_y: float = 0.0
    size: float = 0.0
    bulge: float = 0.0
    bulge_points: float = 0.0
    legs: tuple[tuple[float, float], ...] = ()
    """Where it has legs that are too slim to be objects [m]."""
    c: tuple[float, float] = (0.0, 0.0)
    v: tuple[float, float] = (0.0, 0.0)
    h: tuple[float, float] = (0.0, 0.0)
    hh: tuple[float, float] = (0.0, 0.0)
    still_c: tuple[float, float] = (0.0, 0.0)
    side: tuple[float, float] = (0.0, 0.0)
    side_weight: tuple[float, float] = (0.0, 0.0)
    least: tuple[float, float] = (0.0, 0.0)
    looks: tuple[float, ...] = (0.0,) * 4
    """Views that took it for prismatic, round, legged, irregular."""
    has_ended: bool = False
    odds: float = 0.0
    """Sum of the log-odds of being a thing over its settled sightings …"""
    judged: int = 0
    """… and how many these are."""
    row_shape: int = UNKNOWN
    """Its shape in the rows, by what was seen so far."""
    track: Track | None = None
    state: NDArray[np.float64] | None = None
    """What the smoother knows at the end of the latest settled window, per axis."""

    def take(self, arrays: dict[str, NDArray[Any]], slot: int) -> None:
        """Note what is known of it now."""
        for name in _SNAPSHOT:
            setattr(self, name, arrays[name].item(slot))
        for name in _SNAPSHOT_AXES:
            values = arrays[name]
            setattr(self, name, (values.item(2 * slot), values.item(2 * slot + 1)))
        self.looks = tuple(arrays["looks"][5 * slot : 5 * slot + 4].tolist())
        at = slice(LEGS * slot, LEGS * slot + LEGS)
        seen = arrays["leg_seen"][at].tolist()
        if any(seen):
            places = zip(seen, arrays["leg_x"][at].tolist(), arrays["leg_y"][at].tolist(), strict=True)
            self.legs = tuple((x, y) for often, x, y in places if often > LEG_SHARE * self.sightings)
        self.has_ended = arrays["state"].item(slot) == ENDED

    @property
    def has_legs(self) -> bool:
        """Whether it is somebody whose two legs were seen at once."""
        return self.kind == PERSON and self.whole >= PAIRS

    @property
    def size_is_known(self) -> bool:
        """Whether its size was seen, often enough."""
        return (self.sightings if self.kind == PERSON else self.whole) >= PAIRS and self.size > 0.0

    def place(self, still: bool) -> tuple[float, float]:
        """Its centre in the world [m], of the body or of its twin that stands."""
        along, across = self.still_c if still else self.c
        cos, sin = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return cos * along - sin * across, sin * along + cos * across


HELD = 0.5
"""Log-odds beyond the least that change a verdict."""
LEG_SHARE = 0.25
"""A leg is seen in so many of the sightings of its thing."""
PAIRS = 3
"""Sweeps in which both legs of a person were seen, or both ends of a thing, that are enough."""


@dataclass(slots=True, eq=False)
class Track:
    """One thing as the tables have it: a body, or several that go together."""

    parts: list[Thing] = field(default_factory=list)
    number: int = 0
    """1, 2, … once it has its first row; 0 before."""
    frame: int = 0
    several: bool = False
    """Whether parts of it are seen side by side: legs."""
    moved: bool = False
    onset: int = 0
    is_agent: bool = False
    """Whether a row of it is in set A, from the stamp `onset_ns` on."""
    first: tuple[int, int] = (0, 0)
    """Sweep and stamp of its first row."""
    last: tuple[int, int] = (0, 0)
    last_sweeps: int = 0
    """Sweeps of the topic before the last one it was seen in."""
    last_time: float = 0.0
    sweeps: int = 0
    hidden: float = 0.0
    distance: float = 0.0
    speed_max: float = 0.0
    onset_ns: int = 0
    label: int = -1
    """Entry of the catalogue by what was seen so far, -1 for none, …"""
    label_score: float = math.nan
    """… and how probable that is."""
    x: float = 0.0
    y: float = 0.0
    is_thing: bool | None = None
    """The verdict by what was seen so far; None before the first."""
    odds: float = 0.0
    """Sum of the log-odds of the bodies that are not kept, and how many sightings these are of."""
    judged: int = 0
    thing: float = math.nan
    """How likely it is a thing, by what was seen so far."""
    state: NDArray[np.float64] | None = None

    def let_go(self, stop: int) -> None:
        """Of the bodies that are over keep the one that was seen most, and the last: they tell all that the tables say.

        `stop`: sweeps of the topic that are settled.
        """
        self.several = self.several or any(part.has_legs for part in self.parts)
        over = [part for part in self.parts if part.has_ended and part.last_sweep < stop]
        if len(over) > 2:
            kept = (
                max(over, key=lambda part: (part.sightings, -part.number)),
                max(over, key=lambda part: part.last_sweep),
            )
            for part in over:
                if part not in kept:
                    self.odds += part.odds
                    self.judged += part.judged
            self.parts = [part for part in self.parts if part in kept or part not in over]

    def decide(self, ahead: dict[int, tuple[float, int]], least: float) -> None:
        """The verdict by the mean of the log-odds of all sightings, those ahead too; held until there is more against it.

        Parameters
        ----------
        ahead : body → sum of the log-odds of its sightings that are not settled, and how many these are
        least : log-odds that make a thing
        """
        odds, judged = self.odds, self.judged
        for part in self.parts:
            more, count = ahead.get(part.number, (0.0, 0))
            odds += part.odds + more
            judged += part.judged + count
        mean = odds / max(judged, 1)
        self.thing = 1.0 / (1.0 + math.exp(-mean))
        if self.is_thing is None:
            self.is_thing = mean >= least
        else:
            self.is_thing = mean >= (least - HELD if self.is_thing else least + HELD)

    def absorb(self, thing: Thing) -> None:
        """Take a body as a part of this."""
        self.parts.append(thing)
        thing.track = self
