"""Which body is which view, at the least total cost: successive shortest augmenting paths."""

from __future__ import annotations

from typing import Any

from lidarcli import native

INFINITY = float("inf")


class Assignment:
    """Room for one assignment of `rows` to `columns`, to each row also a column of its own: it may stay without."""

    def __init__(self, most_rows: int, most_columns: int) -> None:
        self.owner: list[Any] = []
        wide = most_rows + most_columns + 1
        self.rows = 0
        self.columns = 0
        self.most_columns = most_columns
        self.cost = native.doubles(self.owner, max(most_rows * most_columns, 1))
        """Cost of row i and column j at i * columns + j; infinite where they cannot be one."""
        self.column = native.integers(self.owner, most_rows + 1)
        """The column of each row, -1 for none."""
        self.row_price = native.doubles(self.owner, most_rows + 1)
        self.column_price = native.doubles(self.owner, wide)
        self.taken_by = native.integers(self.owner, wide)
        self.before = native.integers(self.owner, wide)
        self.least = native.doubles(self.owner, wide)
        self.done = native.integers(self.owner, wide)


def solve(task: Assignment, without: float) -> None:
    """Fill `column`. `without`: what it costs a row to stay without a column."""
    wide = task.columns + task.rows
    # Rows and columns count from 1: 0 is none.
    for j in range(wide + 1):
        task.column_price[j] = 0.0
        task.taken_by[j] = 0
    for i in range(task.rows + 1):
        task.row_price[i] = 0.0
    for i in range(1, task.rows + 1):
        _augment(task, i, wide, without)
    for i in range(task.rows):
        task.column[i] = -1
    for j in range(1, task.columns + 1):
        if task.taken_by[j] > 0:
            task.column[task.taken_by[j] - 1] = j - 1


def _augment(task: Assignment, row: int, wide: int, without: float) -> None:
    """Give a row its column along the cheapest path of changes (Dijkstra with prices)."""
    task.taken_by[0] = row
    at = 0
    for j in range(wide + 1):
        task.least[j] = INFINITY
        task.done[j] = 0
    while task.taken_by[at] != 0:
        task.done[at] = 1
        i = task.taken_by[at]
        step, next_at = INFINITY, 0
        for j in range(1, wide + 1):
            if task.done[j]:
                continue
            if j <= task.columns:
                cost = task.cost[(i - 1) * task.columns + j - 1]
            else:
                cost = without if j - task.columns == i else INFINITY
            reduced = cost - task.row_price[i] - task.column_price[j]
            if reduced < task.least[j]:
                task.least[j] = reduced
                task.before[j] = at
            if task.least[j] < step:
                step, next_at = task.least[j], j
        for j in range(wide + 1):
            if task.done[j]:
                task.row_price[task.taken_by[j]] += step
                task.column_price[j] -= step
            else:
                task.least[j] -= step
        at = next_at
    while at != 0:
        previous = task.before[at]
        task.taken_by[at] = task.taken_by[previous]
        at = previous
