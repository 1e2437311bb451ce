"""Everything that was measured, in one place, and as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field

from benchmarks.accuracy.boxes import BoxResult, CylinderResult
from benchmarks.accuracy.cells import THINGS
from benchmarks.accuracy.driven import Driven
from benchmarks.accuracy.objects import Tally
from benchmarks.accuracy.real import Car, Legs
from benchmarks.accuracy.scoring import BEAMS, Score
from benchmarks.annotations.measure import ByEye
from lidarcli.formalism import SHAPES


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a run."""

    command: str
    """What makes them again."""
    first_seed: int
    scenes: int
    """Of each kind."""
    legged_scenes: int
    box_sweeps: int
    """Sweeps of each box."""
    tally: Tally
    boxes: list[BoxResult]
    cylinder: list[CylinderResult]
    legs: list[Legs] = field(default_factory=list)
    """Empty without the recordings."""
    cars: list[Car] = field(default_factory=list)
    driven: Driven = field(default_factory=dict)
    by_eye: ByEye | None = None
    """None without the recordings."""


def as_json(figures: Figures) -> str:
    """All figures with their counts."""
    cells = [
        {"scenes": things, **asdict(cell), "method": method, **_score(score)}
        for (things, cell, method), score in figures.tally.scores.items()
    ]
    shapes = [
        {"scenes": things, "noise": noise, "counts": counts.tolist()}
        for (things, noise), counts in figures.tally.shapes.items()
    ]
    tables: dict[str, object] = {
        "command": figures.command,
        "kinds": THINGS,
        "shapes": (*SHAPES, "not found"),
        "beams_from": BEAMS,
        "cells": cells,
        "confusion": shapes,
        "boxes": [asdict(result) for result in figures.boxes],
        "cylinder": [asdict(result) for result in figures.cylinder],
        "legs": [asdict(result) for result in figures.legs],
        "cars": [asdict(result) for result in figures.cars],
    }
    tables["driven"] = [
        {"sensors": group, "method": method, **_score(found)} for (group, method), found in figures.driven.items()
    ]
    if figures.by_eye is not None:
        tables["by_eye"] = [{**key._asdict(), **asdict(counts)} for key, counts in figures.by_eye.counts.items()]
    return json.dumps(tables, indent=1) + "\n"


def _score(score: Score) -> dict[str, object]:
    return {
        "f1": score.f1,
        "precision": score.precision,
        "recall": score.recall,
        "detections": score.detections,
        "right": score.right,
        "on_walls": score.on_walls,
        "mixed": score.mixed,
        "entities": score.entities.tolist(),
        "found": score.found.tolist(),
        "parts": score.parts.tolist(),
    }
