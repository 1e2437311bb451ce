"""What the core is described with: the names of its columns, and the room that it is given."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.detect import detect
from lidarcli.formalism.detection import COLUMNS, REQUIRED
from lidarcli.system import native
from tests.formalism.oracles.recording import random_batches


def test_columns_have_the_names_of_a_detection() -> None:
    assert list(COLUMNS) == [field.name for field in fields(Detection)]
    found = detect(random_batches()[0], Parameters(), per_beam=True, explain=True)
    there = [name for name in COLUMNS if getattr(found, name) is not None]
    assert {*there} >= {*REQUIRED, "beam_set", "beam_object", "beam_s", "features"}
    for name in there:
        assert getattr(found, name).dtype == COLUMNS[name].dtype, name


def test_room_is_zero_at_first_and_rounds_where_it_is_single() -> None:
    owner: list[object] = []
    assert list(native.doubles(owner, 3)) == [0.0, 0.0, 0.0]
    assert list(native.integers(owner, 2)) == [0, 0]
    singles = native.singles(owner, 1)
    singles[0] = 0.1
    assert singles[0] == float(np.float32(0.1))
    values = np.arange(4.0)
    native.at_doubles(values)[2] = 7.0
    assert values.tolist() == [0.0, 1.0, 7.0, 3.0]


def test_checked_room_has_no_negative_indices() -> None:
    checked = native._Checked([1, 2])
    checked[1] = 5
    assert checked[1] == 5
    for index in (-1, 2):
        with pytest.raises(IndexError):
            checked[index]
        with pytest.raises(IndexError):
            checked[index] = 0
