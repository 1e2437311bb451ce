"""How the values of a figure spread: seven numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps import Float64

STATISTICS = ("mean", "std", "min", "p05", "p50", "p95", "max")


@dataclass(frozen=True, slots=True)
class Spread:
    """Statistics of a column; None everywhere when it has no value."""

    count: int
    mean: float | None = None
    std: float | None = None
    min: float | None = None
    p05: float | None = None
    p50: float | None = None
    p95: float | None = None
    max: float | None = None

    @staticmethod
    def of(values: Float64) -> Spread:
        """The spread of the finite values.

        >>> Spread.of(np.array([1.0, 3.0, np.nan]))
        Spread(count=2, mean=2.0, std=1.0, min=1.0, p05=1.1, p50=2.0, p95=2.9, max=3.0)
        """
        there = values[np.isfinite(values)]
        if not len(there):
            return Spread(0)
        p05, p50, p95 = (float(value) for value in np.percentile(there, (5, 50, 95)))
        return Spread(
            count=len(there),
            mean=float(there.mean()),
            std=float(there.std()),
            min=float(there.min()),
            p05=p05,
            p50=p50,
            p95=p95,
            max=float(there.max()),
        )
