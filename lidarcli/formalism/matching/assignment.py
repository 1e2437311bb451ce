"""Assignment of rows to columns with the greatest sum of gains."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps.types import Float64, Int64


def assign(gain: Float64) -> Int64:
    """Return (N,) the columns of the pairs with the greatest sum of gains, by shortest augmenting paths; -1 for none.

    No pair has a gain of 0 or less; -inf rules one out. The choice among equal sums is always the same.

    >>> assign(np.array([[3.0, 2.0], [2.0, -1.0]])).tolist()
    [1, 0]
    """
    rows, columns = gain.shape
    # Behind the others every row has a column of its own with no gain.
    cost = np.full((rows, columns + rows), np.inf)
    cost[:, :columns] = np.where(gain > 0.0, -gain, np.inf)
    cost[np.arange(rows), columns + np.arange(rows)] = 0.0
    row_of = np.full(columns + rows, -1)
    column_of = np.full(rows, -1)
    price = np.zeros(columns + rows)
    for row in range(rows):
        _augment(cost, row, price, row_of, column_of)
    return np.where(column_of < columns, column_of, -1)


def _augment(cost: Float64, start: int, price: Float64, row_of: Int64, column_of: Int64) -> None:
    """Give a row a column along the cheapest path of changes of the other rows."""
    distance = np.full(cost.shape[1], np.inf)
    before = np.full(cost.shape[1], start)
    done = np.zeros(cost.shape[1], np.bool_)
    row, total = start, 0.0
    while True:
        # By the prices, pairs that exist cost nothing along the path.
        level = 0.0 if row == start else cost[row, column_of[row]] - price[column_of[row]]
        through = total + cost[row] - price - level
        shorter = ~done & (through < distance)
        distance[shorter], before[shorter] = through[shorter], row
        column = int(np.argmin(np.where(done, np.inf, distance)))
        total = float(distance[column])
        done[column] = True
        if row_of[column] < 0:
            break
        row = int(row_of[column])
    price[done] += distance[done] - total
    while True:
        row = int(before[column])
        row_of[column] = row
        column_of[row], column = column, int(column_of[row])
        if row == start:
            return
