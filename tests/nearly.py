"""Values of golden files, to be compared within their rounding."""

from __future__ import annotations

from typing import Any

import pytest

from tools.golden import DECIMALS


def nearly(value: Any) -> Any:
    """Floats that compare equal within the rounding of the golden tables; everything else as it is."""
    if isinstance(value, float):
        return pytest.approx(value, abs=2 * 10**-DECIMALS, rel=0)
    if isinstance(value, list):
        return [nearly(item) for item in value]
    if isinstance(value, dict):
        return {name: nearly(item) for name, item in value.items()}
    return value
