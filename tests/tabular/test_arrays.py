"""Values as Arrow arrays: codes, and null for what is undefined."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.formalism import VERTEX_KINDS
from lidarcli.tabular.columns import codes, floats, names_of


def test_codes_and_their_names() -> None:
    values = np.array([1, 3, 0, 2, 2], np.uint8)
    expected = ["end", "extremum", "start", "corner", "corner"]
    assert names_of(values, VERTEX_KINDS).to_pylist() == expected
    assert codes(values, VERTEX_KINDS).to_pylist() == expected
    assert names_of(values[:0], VERTEX_KINDS).to_pylist() == []


@pytest.mark.parametrize("values", [[], [1.0, -2.0], [np.nan, 1.0], [np.inf, -np.inf], [-1.0, np.nan, np.inf]])
def test_only_nan_is_null(values: list[float]) -> None:
    assert floats(np.array(values)).to_pylist() == [None if np.isnan(value) else value for value in values]
