"""Flat values with offsets against lists of lists."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.formalism.detection import offsets_of, spans


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 5)), max_size=8))
def test_spans_are_lists_put_together(some: list[tuple[int, int]]) -> None:
    begin, size = (np.array([one[k] for one in some], np.int64) for k in (0, 1))
    index, owner, offsets = spans(begin, size)
    lists = [list(range(first, first + count)) for first, count in some]
    assert index.tolist() == [value for values in lists for value in values]
    assert owner.tolist() == [j for j, values in enumerate(lists) for _ in values]
    assert offsets.tolist() == [sum(map(len, lists[:j])) for j in range(len(lists) + 1)]
    assert offsets_of(size).tolist() == offsets.tolist()
