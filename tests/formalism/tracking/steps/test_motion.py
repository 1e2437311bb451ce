"""What sightings say for motion and against it."""

from __future__ import annotations

import pytest

from lidarcli.formalism.tracking import belief, estimation
from lidarcli.formalism.tracking.estimation import Bodies, Sides

VAR = 1e-4
DT = 0.1


def box() -> Bodies:
    """A box of 0.6 m by 0.4 m that was seen to stand for a while."""
    bodies = Bodies(1)
    b = estimation.free_slot(bodies)
    estimation.clear(bodies, b)
    bodies.kind[b] = estimation.BOX
    for i, half in enumerate((0.3, 0.2)):
        estimation.begin_axis(bodies, i, -half, half, VAR, VAR)
    bodies.settled[b] = belief.SETTLED_SIGHTINGS
    for _ in range(20):
        see(bodies, sides_at(0.0), weigh=False)
    return bodies


def sides_at(x: float, known: tuple[int, ...] = (0, 1, 2, 3), longer: float = 0.0, var: float = VAR) -> Sides:
    """All sides of that box with its centre x metres on; `longer` by this at its high end."""
    sides = Sides()
    for side, place in enumerate((x - 0.3, x + 0.3 + longer, -0.2, 0.2)):
        sides.z[side] = place
        sides.var[side] = var if side in known else estimation.AT_LEAST
    return sides


def see(bodies: Bodies, sides: Sides, *, weigh: bool = True, whole: bool = True) -> float:
    """One more sighting; returns what it adds to the evidence."""
    estimation.predict(bodies, 0, DT, 0.0)
    before = bodies.evidence[0]
    if weigh:
        belief.weigh_motion(bodies, 0, sides, whole)
    for side in range(4):
        if sides.var[side] >= 0.0:
            sign = 1.0 if side % 2 else -1.0
            estimation.update(bodies, side // 2, sides.z[side], sign, sides.var[side])
            estimation.update_still(bodies, side // 2, sides.z[side], sign, sides.var[side])
    return bodies.evidence[0] - before


def test_what_goes_on_gathers_evidence() -> None:
    bodies = box()
    for k in range(1, 15):
        see(bodies, sides_at(0.06 * k))
    gathered = bodies.evidence[0]
    assert gathered > 12.0
    assert bodies.evidence_most[0] == gathered


def test_what_stands_loses_its_evidence() -> None:
    bodies = box()
    bodies.evidence[0] = 5.0
    assert see(bodies, sides_at(0.0)) < 0.0
    for _ in range(100):
        see(bodies, sides_at(0.0))
    assert bodies.evidence[0] == 0.0


def test_what_stands_has_no_evidence_however_long() -> None:
    bodies = box()
    for k in range(300):
        see(bodies, sides_at(0.004 * (-1) ** k))
    assert bodies.evidence[0] < 1.0
    assert abs(bodies.v[0]) < 0.1


@pytest.mark.parametrize("whole", [True, False])
def test_one_sweep_says_no_more_than_so_much(whole: bool) -> None:
    bodies = box()
    added = see(bodies, sides_at(0.5), whole=whole)
    assert added <= (belief.MOST_SWEEP_EVIDENCE if whole else belief.MOST_PARTIAL_EVIDENCE) - (
        belief.EVIDENCE_DECAY if whole else 0.0
    )
    for k in range(200):
        see(bodies, sides_at(0.5 + 0.1 * k), whole=whole)
    assert bodies.evidence[0] == belief.MOST_EVIDENCE


def test_what_has_not_settled_does_not_speak_for_motion() -> None:
    bodies = box()
    bodies.settled[0] = belief.SETTLED_SIGHTINGS - 1
    for k in range(10):
        see(bodies, sides_at(0.1 * k))
    assert bodies.evidence[0] == 0.0


def test_a_side_of_returns_alone_is_not_believed_without_the_other() -> None:
    open_ended = estimation.OPEN_EDGE_VAR + VAR
    alone, together = box(), box()
    for k in range(1, 30):
        # The near end is hidden, of the far one more and more comes into view.
        see(alone, sides_at(0.06 * k, known=(1, 2, 3), var=open_ended))
        see(together, sides_at(0.06 * k, var=open_ended))
    assert alone.evidence[0] == 0.0
    assert together.evidence[0] > 1.0


def test_more_of_a_thing_coming_into_view_is_no_motion() -> None:
    open_ended = estimation.OPEN_EDGE_VAR + VAR
    bodies = box()
    for k in range(1, 30):
        see(bodies, sides_at(0.0, longer=0.04 * k, var=open_ended))
    assert bodies.evidence[0] == 0.0


def test_the_onset_is_where_there_was_no_evidence_last() -> None:
    bodies = box()
    for sweep in range(40):
        x = 0.06 * max(sweep - 20, 0)
        see(bodies, sides_at(x))
        belief.note_rest(bodies, 0, sweep)
    assert bodies.evidence[0] > 12.0
    assert bodies.onset[0] in range(17, 24)
    assert abs(bodies.birth_x[0]) < 0.1


def test_the_centre_of_a_disc_speaks_as_well() -> None:
    bodies = box()
    bodies.kind[0] = estimation.DISC
    sides = Sides()
    sides.by_centre = True
    for k in range(1, 15):
        estimation.predict(bodies, 0, DT, 0.0)
        for i, z in enumerate((0.06 * k, 0.0)):
            sides.z[2 * i] = sides.z[2 * i + 1] = z
            sides.var[2 * i] = sides.var[2 * i + 1] = VAR
        belief.weigh_motion(bodies, 0, sides, True)
        for i in range(2):
            estimation.update(bodies, i, sides.z[2 * i], 0.0, VAR)
            estimation.update_still(bodies, i, sides.z[2 * i], 0.0, VAR)
    assert bodies.evidence[0] > 12.0
