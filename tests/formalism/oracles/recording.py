"""What the core knows after each of its steps on one sweep, in plain lists: only its source shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from math import inf, nan
from types import ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from lidarcli.formalism import (
    Detection,
    Parameters,
    core,
    description,
    detect,
    features,
    objects,
    range_noise,
    segmentation,
    surfaces,
    verdict,
)
from lidarcli.sweeps.types import SweepBatch
from tests.formalism.batches import batch_of, rows_of
from tests.formalism.random_sweeps import random_sweep
from tests.formalism.reference import NO_TURN, Sweep
from tests.formalism.surroundings import simulated

STEPS: tuple[tuple[ModuleType, str], ...] = (
    (segmentation, "load"),
    (segmentation, "differences"),
    (range_noise, "sigma_of"),
    (segmentation, "find_breakpoints"),
    (segmentation, "cut"),
    (surfaces, "measure_chords"),
    (surfaces, "find_faces"),
    (objects, "find_protrusions"),
    (objects, "divide"),
    (surfaces, "measure_extent"),
    (surfaces, "mark_vertices"),
    (objects, "pieces"),
    (objects, "fully_visible"),
    (objects, "join_fragments"),
    (features, "measure"),
    (verdict, "decide"),
    (verdict, "choose"),
    (objects, "group_legs"),
    (core, "_settle"),
    (objects, "assemble"),
    (description, "describe"),
)
"""Functions that each change what the core knows."""


class Segment(NamedTuple):
    """A segment as the core has it."""

    first: int
    size: int
    start_edge: int
    end_edge: int
    s_start: float
    s_end: float

    @property
    def last(self) -> int:
        """Its last point."""
        return self.first + self.size - 1


class Face(NamedTuple):
    """A face as the core has it."""

    segment: int
    first: int
    last: int
    points: int
    middle_x: float
    middle_y: float
    direction_x: float
    direction_y: float
    rms: float
    length: float


@dataclass
class State:
    """All there is after one step."""

    points: Any
    survey: Any
    bodies: Any
    parts: Any
    features: Any
    verdict: Any
    breaks: list[int]
    protrusions: list[tuple[int, int, int]]
    """Segment, first and last point of each."""
    segments: list[Segment]
    faces: list[Face]
    result: Any
    """What the step returned."""

    def faces_of(self, j: int) -> list[Face]:
        """The faces of one segment."""
        return [face for face in self.faces if face.segment == j]


@dataclass(eq=False)
class Recorded:
    """One sweep, what was found in it, and the state after each step by the name of its function."""

    batch: SweepBatch
    parameters: Parameters
    after: dict[str, State] = field(default_factory=dict)
    found: Detection | None = None


class Plain:
    """The fields of an object of the core, its arrays as lists; those that are as they were `before` are the same."""

    def __init__(self, source: Any, before: Plain | None) -> None:
        for name, value in vars(source).items():
            if isinstance(value, list):
                old = None if before is None else getattr(before, name)
                value = old if old == value else list(value)
            setattr(self, name, value)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)


def state_of(everything: core.Core, result: Any, before: State | None) -> State:
    """A copy of what the core knows now."""
    these, faces, found = everything.segments, everything.faces, everything.protrusions
    return State(
        points=Plain(everything.points, before and before.points),
        survey=Plain(everything.survey, before and before.survey),
        bodies=Plain(everything.bodies, before and before.bodies),
        parts=Plain(everything.description.parts, before and before.parts),
        features=Plain(everything.features, before and before.features),
        verdict=Plain(everything.verdict, before and before.verdict),
        breaks=list(everything.breakpoints.at[: everything.breakpoints.count]),
        protrusions=[(found.segment[k], found.first[k], found.last[k]) for k in range(found.count)],
        segments=[Segment(*(getattr(these, name)[j] for name in Segment._fields)) for j in range(these.count)],
        faces=[Face(*(getattr(faces, name)[f] for name in Face._fields)) for f in range(faces.count)],
        result=result,
    )


@contextmanager
def watched(recorded: Recorded) -> Iterator[None]:
    """Note the state of the core after each step."""
    cores: list[core.Core] = []
    detect_row = core.detect_row

    def remember(everything: core.Core, *arguments: Any) -> None:
        cores[:] = [everything]
        detect_row(everything, *arguments)

    def watch(name: str, step: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            result = step(*arguments)
            last = next(reversed(recorded.after.values()), None)
            recorded.after[name] = state_of(cores[0], result, last)
            return result

        return call

    with ExitStack() as stack:
        stack.enter_context(patch.object(core, "detect_row", remember))
        for module, name in STEPS:
            known_as = f"{module.__name__.rpartition('.')[2]}.{name}"
            stack.enter_context(patch.object(module, name, watch(known_as, getattr(module, name))))
        yield


def record(batch: SweepBatch, parameters: Parameters) -> Recorded:
    """Run the core on a batch of one sweep."""
    recorded = Recorded(batch, parameters)
    with watched(recorded):
        recorded.found = detect(batch, parameters, per_beam=True)
    return recorded


ROBUST = Parameters.for_profile("robust", group_gap=0.45, walls=True)
RANDOM, WALLS = 600, 40


def interrupted_wall(rng: np.random.Generator) -> Sweep:
    """A straight wall behind posts: short pieces on one line, some of them set back or forward."""
    beams = int(rng.integers(100, 200))
    theta = np.linspace(-1.2, 1.2, beams)
    distance, direction = rng.uniform(1.0, 3.0), rng.uniform(-0.5, 0.5)
    ranges = np.full(beams, inf)
    begin = 0
    while begin < beams:
        end = begin + int(rng.integers(8, 40))
        depth = distance + rng.choice([0.0, 0.0, 0.0, rng.uniform(-0.2, 0.6)])
        ranges[begin:end] = depth / np.maximum(np.cos(theta[begin:end] - direction), 0.1)
        begin = end + int(rng.integers(2, 8))
        ranges[end:begin] = rng.choice([0.5 * distance, inf, nan])
    ranges += rng.choice([0.003, 0.01, 0.03]) * rng.standard_normal(beams)
    return Sweep([float(r) for r in ranges.astype(np.float32)], -1.2, 2.4 / (beams - 1), NO_TURN)


@cache
def random_batches() -> list[SweepBatch]:
    """Random sweeps of every closing and direction, walls, rooms, corridors and halls: one sweep at a time."""
    rng = np.random.default_rng(20240407)
    some = []
    for k in range(RANDOM):
        sweep = random_sweep(rng, rough=k % 2 == 0)
        # Every third is a crowd of small things close to the sensor.
        nearer = 0.2 if k % 3 == 0 else 1.0
        some.append(batch_of([replace(sweep, ranges=[nearer * r for r in sweep.ranges])]))
    some += [batch_of([interrupted_wall(rng)]) for _ in range(WALLS)]
    scenes = simulated()
    return some + [rows_of(scenes, slice(row, row + 1)) for row in range(len(scenes))]


@cache
def recordings() -> list[Recorded]:
    """What the core knows of each of them step by step, with all that profile `robust` can do."""
    return [record(batch, ROBUST) for batch in random_batches()]
