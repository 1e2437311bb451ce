"""A background learned from a public recording of people itself; `LIDARCLI_REAL_LOGS` names the folder of the logs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import lidarcli

LOG = (
    Path(os.environ.get("LIDARCLI_REAL_LOGS", "")) / "leg_tracker" / "demo_stationary_simple_environment.bag"
)

pytestmark = pytest.mark.skipif(
    "LIDARCLI_REAL_LOGS" not in os.environ, reason="LIDARCLI_REAL_LOGS names no folder of real logs"
)


def test_the_walls_vanish_and_the_people_remain() -> None:
    """The figures and the picture of docs/background.md."""
    (sensor,) = lidarcli.learn(LOG)
    assert (len(sensor), sensor.grid.beams, int(sensor.sweeps[0])) == (1, 512, 1265)
    assert np.isinf(sensor.r_e).mean() == pytest.approx(0.69, abs=0.01)
    assert np.nanmedian(sensor.spread) < 0.01
    alone, against = lidarcli.detect(LOG), lidarcli.detect(LOG, background=[sensor])
    assert against.num_rows < 0.45 * alone.num_rows
    assert against.num_rows / 1265 > 4.0
    for table, most, least in ((alone, 1.0, 0.4), (against, 0.03, 0.0)):
        # Objects within 15 cm of the surfaces of the background.
        x, y = table["x"].to_numpy(), table["y"].to_numpy()
        theta, r_e = sensor.grid.bearings(), sensor.r_e[0]
        wall = np.column_stack([r_e * np.cos(theta), r_e * np.sin(theta)])[np.isfinite(r_e)]
        near = np.array([np.hypot(*(wall - point).T).min() < 0.15 for point in np.column_stack([x, y])])
        assert least <= near.mean() <= most
