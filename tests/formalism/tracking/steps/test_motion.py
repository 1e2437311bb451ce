"""What sightings say for motion and against it."""

from __future__ import annotations

import pytest

from lidarcli.formalism.tracking import kalman, measurement, track_evidence
from lidarcli.formalism.tracking.kalman import Targets
from lidarcli.formalism.tracking.measurement import EdgeMeasurement

VAR = 1e-4
DT = 0.1


def box() -> Targets:
    """A box of 0.6 m by 0.4 m that was seen to stand for a while."""
    targets = Targets(1)
    b = kalman.allocate(targets)
    kalman.reset(targets, b)
    targets.kind[b] = kalman.BOX
    for i, half in enumerate((0.3, 0.2)):
        kalman.initiate_axis(targets, i, -half, half, VAR, VAR)
    targets.kind_hits[b] = track_evidence.SETTLED_SIGHTINGS
    for _ in range(20):
        see(targets, sides_at(0.0), weigh=False)
    return targets


def sides_at(x: float, known: tuple[int, ...] = (0, 1, 2, 3), longer: float = 0.0, var: float = VAR) -> EdgeMeasurement:
    """All sides of that box with its centre x metres on; `longer` by this at its high end."""
    sides = EdgeMeasurement()
    for side, place in enumerate((x - 0.3, x + 0.3 + longer, -0.2, 0.2)):
        sides.z[side] = place
        sides.var[side] = var if side in known else measurement.AT_LEAST
    return sides


def see(targets: Targets, sides: EdgeMeasurement, *, weigh: bool = True, whole: bool = True) -> float:
    """One more sighting; returns what it adds to the evidence."""
    kalman.predict(targets, 0, DT, 0.0)
    before = targets.evidence[0]
    if weigh:
        track_evidence.update_motion_evidence(targets, 0, sides, whole)
    for side in range(4):
        if sides.var[side] >= 0.0:
            sign = 1.0 if side % 2 else -1.0
            kalman.update(targets, side // 2, sides.z[side], sign, sides.var[side])
            kalman.update_static(targets, side // 2, sides.z[side], sign, sides.var[side])
    return targets.evidence[0] - before


def test_what_goes_on_gathers_evidence() -> None:
    targets = box()
    for k in range(1, 15):
        see(targets, sides_at(0.06 * k))
    gathered = targets.evidence[0]
    assert gathered > 12.0
    assert targets.max_evidence[0] == gathered


def test_what_stands_loses_its_evidence() -> None:
    targets = box()
    targets.evidence[0] = 5.0
    assert see(targets, sides_at(0.0)) < 0.0
    for _ in range(100):
        see(targets, sides_at(0.0))
    assert targets.evidence[0] == 0.0


def test_what_stands_has_no_evidence_however_long() -> None:
    targets = box()
    for k in range(300):
        see(targets, sides_at(0.004 * (-1) ** k))
    assert targets.evidence[0] < 1.0
    assert abs(targets.v[0]) < 0.1


@pytest.mark.parametrize("whole", [True, False])
def test_one_sweep_says_no_more_than_so_much(whole: bool) -> None:
    targets = box()
    added = see(targets, sides_at(0.5), whole=whole)
    assert added <= (track_evidence.MAX_SWEEP_EVIDENCE if whole else track_evidence.MAX_PARTIAL_EVIDENCE) - (
        track_evidence.EVIDENCE_DECAY if whole else 0.0
    )
    for k in range(200):
        see(targets, sides_at(0.5 + 0.1 * k), whole=whole)
    assert targets.evidence[0] == track_evidence.MAX_EVIDENCE


def test_what_has_not_settled_does_not_speak_for_motion() -> None:
    targets = box()
    targets.kind_hits[0] = track_evidence.SETTLED_SIGHTINGS - 1
    for k in range(10):
        see(targets, sides_at(0.1 * k))
    assert targets.evidence[0] == 0.0


def test_a_side_of_returns_alone_is_not_believed_without_the_other() -> None:
    open_ended = measurement.OPEN_EDGE_VAR + VAR
    alone, together = box(), box()
    for k in range(1, 30):
        # The near end is hidden, of the far one more and more comes into view.
        see(alone, sides_at(0.06 * k, known=(1, 2, 3), var=open_ended))
        see(together, sides_at(0.06 * k, var=open_ended))
    assert alone.evidence[0] == 0.0
    assert together.evidence[0] > 1.0


def test_more_of_a_thing_coming_into_view_is_no_motion() -> None:
    open_ended = measurement.OPEN_EDGE_VAR + VAR
    targets = box()
    for k in range(1, 30):
        see(targets, sides_at(0.0, longer=0.04 * k, var=open_ended))
    assert targets.evidence[0] == 0.0


def test_the_onset_is_where_there_was_no_evidence_last() -> None:
    targets = box()
    for sweep in range(40):
        x = 0.06 * max(sweep - 20, 0)
        see(targets, sides_at(x))
        track_evidence.mark_rest(targets, 0, sweep)
    assert targets.evidence[0] > 12.0
    assert targets.onset[0] in range(17, 24)
    assert abs(targets.birth_x[0]) < 0.1


def test_the_centre_of_a_disc_speaks_as_well() -> None:
    targets = box()
    targets.kind[0] = kalman.DISC
    sides = EdgeMeasurement()
    sides.by_centre = True
    for k in range(1, 15):
        kalman.predict(targets, 0, DT, 0.0)
        for i, z in enumerate((0.06 * k, 0.0)):
            sides.z[2 * i] = sides.z[2 * i + 1] = z
            sides.var[2 * i] = sides.var[2 * i + 1] = VAR
        track_evidence.update_motion_evidence(targets, 0, sides, True)
        for i in range(2):
            kalman.update(targets, i, sides.z[2 * i], 0.0, VAR)
            kalman.update_static(targets, i, sides.z[2 * i], 0.0, VAR)
    assert targets.evidence[0] > 12.0
