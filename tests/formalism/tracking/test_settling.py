"""Rows of legs that go to the person beside whom they were seen, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from lidarcli.formalism.tracking import legs
from lidarcli.formalism.tracking.results import DISC, PERSON
from lidarcli.formalism.tracking.tracks import Track, Tracklet

PERSON_AT = np.arange(60)
"""Sweeps of a person, ten a second, who walks along x at 1 m/s."""


def walking(sweep: Any, y: float = 0.0) -> tuple[Any, Any, Any]:
    """Sweeps, x and y beside the person."""
    return sweep, 0.1 * sweep, np.full(len(sweep), y)


def settled(*others: tuple[Any, Any, Any], moved: int = 1, owners: bool = True) -> list[Any]:
    """The owners of the sightings of each body after a person, number 1, and others from 2 on were settled."""
    parts = [walking(PERSON_AT[PERSON_AT % 3 != 0]), *others]
    number = np.concatenate([np.full(len(sweep), n) for n, (sweep, _, _) in enumerate(parts, 1)])
    sweep, x, y = (np.concatenate([part[i] for part in parts]) for i in range(3))
    seen = SimpleNamespace(
        sweep=sweep,
        time=0.1 * sweep,
        place=x + 1j * y,
        width=np.full(len(x), 0.12),
        owner=np.where((number == 1) | owners, number, 0),
    )
    bodies = {
        n: Tracklet(n, kind=PERSON if n == 1 else DISC, moved=1 if n == 1 else moved) for n in range(1, len(parts) + 1)
    }
    Track().add_part(bodies[1])
    legs.assign_legs(seen, bodies)
    return [seen.owner[number == n] for n in bodies]


def test_the_other_leg_belongs_to_the_person_beside_whom_it_goes() -> None:
    person, leg = settled(walking(PERSON_AT[PERSON_AT % 3 == 0], 0.3))
    assert (person == 1).all()
    assert (leg == 1).all()


def test_rows_change_hands_where_both_go_together_and_no_others() -> None:
    # It follows a leg of the person, then that of somebody else, who has been 2 m away.
    together = PERSON_AT <= 40
    _, owner = settled((PERSON_AT, 0.1 * PERSON_AT, np.where(together, 0.3, 2.0)))
    assert (owner[together] == 1).all()
    assert (owner[~together] == 2).all()


def test_two_persons_side_by_side_have_four_legs() -> None:
    # Each shows both legs.
    sweep = np.repeat(PERSON_AT, 2)
    beside = np.tile([0.5, 0.6], 60)
    _, other = settled((sweep, 0.1 * sweep, beside))
    assert (other == 2).all()


def test_single_views_within_a_step_belong_to_the_person_until_it_has_two_legs() -> None:
    near, far = walking(np.array([3, 3, 4, 64]), 0.3), walking(np.array([9, 12]), 0.9)
    _, owner, other = settled(near, far, owners=False)
    assert owner.tolist() == [1, 1, 1, 1]
    assert other.tolist() == [0, 0]
    _, owner = settled(walking(np.array([3, 3, 3]), 0.3), owners=False)
    assert owner.tolist() == [1, 1, 0]
