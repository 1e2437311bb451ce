"""How a run lies on those before it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from lidarcli.errors import UnreadableError
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.formalism.matching import alignment
from lidarcli.formalism.matching.free_space import HERE, Nearest, SpaceMotion
from lidarcli.pipeline.differences.runs import AS_IS, AUTO, ObservedRun, known_or_none
from lidarcli.sweeps.types import Float64

DOUBTFUL = 0.75
"""Share of the structure in place below which an alignment is told to be doubtful."""


class AlignmentStep(NamedTuple):
    """One run, compared with those before it."""

    before: str
    name: str
    motion: SpaceMotion
    overlap: float | None
    rms: float | None
    how: str
    """Words for people on how it was aligned."""
    ground: Occupancy | None = None
    """Occupancy of the runs before, in the coordinates of the first."""
    sensors: Float64 | None = None
    """(N, 2) places of the sensor of the run, in these coordinates [m]."""

    def alignment(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        runs = {"log_a": self.before, "log_b": self.name}
        motion = {"dx": self.motion.x, "dy": self.motion.y, "dyaw": self.motion.angle}
        return runs | motion | {"overlap": self.overlap, "rms": self.rms}


def align(
    reference: ObservedRun,
    now: ObservedRun,
    nearest: tuple[Nearest | None, Nearest | None],
    how: str,
    label: str,
    other: str,
    notes: list[str],
) -> tuple[AlignmentStep, float]:
    """Return how a run lies on those before it, and the probability of that; what is doubtful is added to the notes."""
    first, second = nearest
    both = f"{label} and {other}"
    common = reference.is_common and reference.world == now.world
    if how == AS_IS or (how == AUTO and common):
        words = f"as they are, in the frame {reference.world}" if common else "as they are"
        if first is None or second is None:
            return _step(reference, now, HERE, None, words), 1.0
        here, better = alignment.settle(first, second)
        if better is not None:
            move = better.motion
            notes.append(
                f"{both} lie better on each other if shifted by {_distance(move)}: {better.overlap:.0%} of the structure "
                f"in place, not {here.overlap:.0%}; poses of one may be off"
            )
            if how == AUTO:
                here, words = better, f"shifted, in the frame {reference.world}"
        _refuse_apart(both, here, "; as they are, that is (--align search)")
        return _step(reference, now, here.motion, here, words), 1.0
    if first is None or second is None:
        motion, chance = alignment.align(reference.run.things, now.run.things)
        if motion is None:
            raise UnreadableError(
                f"{both} cannot be laid on each other: fewer than three of their things stand alike; "
                "name the logs, or take places as they are (--align as-is)"
            )
        if chance < 0.6:
            raise UnreadableError(f"{both} {IN_TWO_WAYS}; {ALIGN_AS_IS}")
        return _step(reference, now, motion, None, "aligned by things"), chance
    found = alignment.search(first, second, alignment.proposals(reference.run.things, now.run.things))
    best, rival = found.best, found.rival
    _refuse_apart(both, best)
    if not found.is_certain:
        raise UnreadableError(f"{both} {SLIDING if found.slides else IN_TWO_WAYS}; {ALIGN_AS_IS}")
    if rival is not None:
        if abs(rival.motion.turn) > alignment.NEAR_HERE_TURN:
            differs = f"turned by {math.degrees(abs(rival.motion.turn)):.0f} degrees, as in a symmetric room"
        else:
            apart = math.hypot(rival.motion.x - best.motion.x, rival.motion.y - best.motion.y)
            differs = f"shifted by {apart:.1f} m, as along a row of like pillars"
        notes.append(
            f"{other} lies on {label} in a second way, {differs}: it is taken where "
            "the sensor hardly moved (--align as-is is sure of that)"
        )
    return _step(reference, now, best.motion, best, "aligned by structure"), 1.0


IN_TWO_WAYS = "lie on each other in two ways: nothing tells which one is right, as in a symmetric room"
SLIDING = "may slide on each other along their walls: nothing tells how far, as in a bare corridor"
ALIGN_AS_IS = "where their frames are the same, --align as-is takes them as they are"


def _refuse_apart(both: str, found: alignment.Fit, hint: str = "") -> None:
    """Refuse runs that do not lie on each other (`UnreadableError`)."""
    if found.lies:
        return
    why = f"{found.overlap:.0%} of the structure at best, {alignment.MIN_OVERLAP:.0%} needed"
    if not found.common:
        why = "they have too little of their structure in common"
    raise UnreadableError(f"{both} do not lie on each other: {why}{hint}")


def _distance(motion: SpaceMotion) -> str:
    return f"{motion.shift:.2f} m, {math.degrees(abs(motion.turn)):.1f} degrees"


def _step(
    before: ObservedRun, now: ObservedRun, motion: SpaceMotion, found: alignment.Fit | None, how: str
) -> AlignmentStep:
    words = how if how.startswith("as") else f"{how}: {_distance(motion)}"
    if found is None:
        return AlignmentStep(before.name, now.name, motion, None, None, words)
    place = f"{found.overlap:.0%} of the structure in place"
    words += f"; only {place}: a path may drift, so doubt each change" if found.overlap < DOUBTFUL else f"; {place}"
    return AlignmentStep(before.name, now.name, motion, found.overlap, known_or_none(found.rms), words)
