"""Random sweeps: piecewise surfaces, noise and lost beams, for full turns and partial views in both directions."""

from __future__ import annotations

from math import inf, nan, pi

import numpy as np
from hypothesis import strategies as st

from tests.formalism.reference import EACH_BEARING_ONCE, FIRST_BEARING_TWICE, NO_TURN, Sweep

LOST = (inf, inf, nan, -inf)


def geometry(closing: str, beams: int, clockwise: bool, offset: float) -> tuple[float, float]:
    """angle_min and angle_increment that close, or do not."""
    step = {
        NO_TURN: min(0.02, 4.0 / max(beams, 1)),
        EACH_BEARING_ONCE: 2 * pi / max(beams, 1),
        FIRST_BEARING_TWICE: 2 * pi / max(beams - 1, 1),
    }[closing]
    return offset, -step if clockwise else step


def closings(beams: int) -> list[str]:
    """A turn has at least four beams."""
    return [NO_TURN] if beams < 4 else [NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE]


@st.composite
def small_sweeps(draw: st.DrawFn) -> Sweep:
    """Up to 12 beams on a coarse grid of ranges: level stretches, equal differences and |s| = d_th come up often."""
    value = st.sampled_from([1.0, 1.125, 1.5, 2.0, 2.0, 3.0, *LOST])
    ranges = draw(st.lists(value, max_size=12))
    closing = draw(st.sampled_from(closings(len(ranges))))
    angle_min = draw(st.sampled_from([-pi, 0.0, -0.5]))
    return Sweep(ranges, *geometry(closing, len(ranges), draw(st.booleans()), angle_min), closing)


def random_sweep(rng: np.random.Generator, closing: str | None = None, most: int = 60, rough: bool = False) -> Sweep:
    """1 to `most` beams: pieces that are level, slanted, straight walls or round, with noise, steps and lost beams.

    A `rough` sweep always has noise, and so no two faces of one length and no two points equally near.
    """
    beams = int(rng.integers(1 if closing is None else 4, most + 1))
    if closing is None:
        closing = str(rng.choice(closings(beams)))
    pieces: list[np.ndarray] = []
    missing = beams
    while missing > 0:
        size = min(int(rng.integers(1, 16)), missing)
        k = np.linspace(-0.5, 0.5, size) if size > 1 else np.zeros(1)
        distance = rng.uniform(0.5, 8.0)
        kind = rng.integers(5)
        if kind == 0:
            piece = np.full(size, distance)
        elif kind == 1:
            piece = distance * (1 + rng.uniform(-0.5, 0.5) * k)
        elif kind == 2:
            piece = distance / np.cos(k * rng.uniform(0.0, 1.5) + rng.uniform(-0.5, 0.5))
        elif kind == 3:
            piece = distance * (1.3 - 0.3 * np.cos(2.0 * k))
        else:
            piece = distance * (1 + rng.uniform(0, 0.3) * np.abs(k))
        pieces.append(piece)
        missing -= size
    ranges = np.concatenate(pieces)
    noise = rng.choice([0.003, 0.03, 0.3] if rough else [0.0, 0.0, 0.003, 0.03, 0.3])
    ranges = 0.05 + np.abs(ranges + noise * rng.standard_normal(beams))
    if not rough and rng.random() < 0.3:
        # Sensors that count in millimetres or worse: differences of exactly 0 and exactly d_th.
        ranges = np.maximum(np.round(ranges * 32) / 32, 1 / 32)
    lost = rng.choice([0.0, 0.02, 0.2, 0.9], p=[0.5, 0.25, 0.2, 0.05])
    ranges = np.where(rng.random(beams) < lost, rng.choice(LOST, beams), ranges)
    if rng.random() < 0.2:
        begin = int(rng.integers(beams))
        ranges[begin : begin + int(rng.integers(1, 12))] = rng.choice(LOST)
    clockwise = bool(rng.random() < 0.4)
    start = float(rng.choice([-pi, 0.0, rng.uniform(-pi, pi)]))
    return Sweep(
        [float(value) for value in ranges.astype(np.float32)], *geometry(closing, beams, clockwise, start), closing
    )
