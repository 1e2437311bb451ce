"""What one sweep says of its objects: sides with two own ends, least lengths, diameters, places of legs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli import formalism
from lidarcli.formalism.detection import LEGGED, PRISMATIC, ROUND, Detection
from lidarcli.formalism.matching.catalogue import KINDS, SEEN_AS, Evidence, evidence_of
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import cast, place
from lidarcli.simulation.scene import Entity
from lidarcli.sweeps.types import Float64

BEAMS = 1440
STEP = 2 * math.pi / BEAMS
BEARINGS = -math.pi + STEP * np.arange(BEAMS)
ROOM = make.wall([[-4.1, -3.9], [4.2, -3.9], [4.2, 4.0], [-4.1, 4.0], [-4.1, -3.9]])


def ranges_of(*things: Entity) -> Float64:
    """(B,) ranges of things in a room, seen from its middle."""
    return cast(place((ROOM, *things), np.zeros((1, 3)), np.zeros(1)), BEARINGS)[0][0]


def looked_at(ranges: Float64, **parameters: float) -> tuple[Detection, Evidence]:
    """The objects of sweeps, and their evidence."""
    batch = formalism.sweep(ranges.astype(np.float32), angle_increment=STEP, range_max=12.0)
    found = formalism.detect(batch, formalism.Parameters.for_profile("robust", **parameters))
    return found, evidence_of(batch, found)


def test_both_sides_of_a_box_across_its_corner() -> None:
    _, evidence = looked_at(ranges_of(make.box(2.0, 0.3, 0.7, 0.4, 0.6)))
    assert len(evidence) == 1
    sides = np.sort([evidence.side_1[0], evidence.side_2[0]])
    assert sides == pytest.approx([0.4, 0.7], abs=0.02)
    assert 0 < evidence.side_1_sd[0] < 0.02
    assert 0 < evidence.side_2_sd[0] < 0.02
    assert np.isnan(evidence.across[0])
    assert evidence.shape[0].tolist() == np.log(SEEN_AS).T[PRISMATIC].tolist()
    assert (evidence.legs[0], evidence.moved[0]) == (0, False)


@pytest.mark.parametrize("left", [True, False])
def test_a_hidden_face_is_only_so_long_at_least(left: bool) -> None:
    """A post stands before one end of a box: the side that goes on behind it has no length, the other has."""
    at = 0.24 if left else -0.24
    post = make.cylinder(1.2 * math.cos(at), 1.2 * math.sin(at), 0.08)
    found, evidence = looked_at(ranges_of(make.box(2.0, 0.0, 0.9, 0.9, math.pi / 4), post))
    box = int(np.argmax(found.beams * (found.shape == PRISMATIC)))
    known = np.isfinite([evidence.side_1[box], evidence.side_2[box]])
    assert known.tolist() in ([True, False], [False, True])
    assert np.nansum([evidence.side_1[box], evidence.side_2[box]]) == pytest.approx(0.9, abs=0.02)
    least = [evidence.least_1[box], evidence.least_2[box]][int(known[0])]
    assert 0.3 < least < 0.9


def test_the_diameter_of_a_cylinder() -> None:
    _, evidence = looked_at(ranges_of(make.cylinder(1.5, 1.0, 0.2)))
    assert evidence.across == pytest.approx([0.4], abs=0.005)
    assert 0 < evidence.across_sd[0] < 0.01
    assert np.isnan([evidence.side_1[0], evidence.side_2[0]]).all()
    assert evidence.shape[0].argmax() == KINDS.index("round")


def test_the_places_of_legs() -> None:
    """Legs of 6 cm at the corners of 0.5 x 0.4 m: their axes are 6 cm nearer."""
    chair = make.legged("chair", 1.5, 0.4, 0.5, 0.4, 0.06, yaw=0.5)
    found, evidence = looked_at(ranges_of(chair), group_gap=0.6)
    assert found.shape.tolist() == [LEGGED]
    assert evidence.legs.tolist() == [4]
    assert sorted([evidence.span_1[0], evidence.span_2[0]]) == pytest.approx([0.34, 0.44], abs=0.02)
    person = make.person(1.5, 0.4, 0.3, gap=0.3)
    found, evidence = looked_at(ranges_of(person), group_gap=0.6)
    assert evidence.legs.tolist() == [2]
    assert evidence.span_1 == pytest.approx([0.3], abs=0.02)
    assert np.isnan(evidence.span_2[0])


@pytest.mark.slow
@pytest.mark.parametrize(("beams", "sigma"), [(361, 0.01), (720, 0.0), (1081, 0.01)])
def test_standard_deviations_are_honest(beams: int, sigma: float) -> None:
    """Sides of 300 boxes are off by as much as is claimed: one in 15 by more than two standard deviations, not more."""
    rng = np.random.Generator(np.random.PCG64(beams))
    sides = rng.uniform(0.25, 1.2, (300, 2))
    step = 2 * math.pi / beams
    bearings = -math.pi + step * np.arange(beams)
    rows = np.full((len(sides), beams), 6.0)
    for row, (length, width) in zip(rows, sides, strict=True):
        away, towards = rng.uniform(1.0, 4.2), rng.uniform(-3.0, 3.0)
        x, y = away * math.cos(towards), away * math.sin(towards)
        box = make.box(x, y, length, width, rng.uniform(0.0, math.pi))
        hit = cast(place((box,), np.zeros((1, 3)), np.zeros(1)), bearings)[0][0]
        row[:] = np.minimum(row, hit) + rng.normal(0.0, sigma, beams)
    batch = formalism.sweep(rows.astype(np.float32), angle_increment=step, range_max=12.0)
    found = formalism.detect(batch)
    evidence = evidence_of(batch, found)
    off = []
    for side, sd in ((evidence.side_1, evidence.side_1_sd), (evidence.side_2, evidence.side_2_sd)):
        nearest = np.abs(side[:, None] - sides[found.row]).min(axis=1)
        off.append((nearest / np.hypot(sd, 0.001))[np.isfinite(side) & (found.beams > 8)])
    z = np.concatenate(off)
    assert len(z) > 400
    assert 0.3 < np.median(z) < 0.9
    assert np.mean(z > 2.0) < 0.1
    assert np.mean(z > 4.0) < 0.02
    assert (evidence.shape[found.shape == ROUND] == np.log(SEEN_AS).T[ROUND]).all()
