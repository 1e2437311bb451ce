"""Three sweeps and what is detected in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.formalism import Detection, Parameters, detect, sweep
from lidarcli.sweeps.types import SweepBatch
from tests.sweeping import round_room
from tests.tabular.writing import STAMPS


@pytest.fixture
def batch() -> SweepBatch:
    """Three sweeps of a round room with two boxes in it, the second sweep without the boxes, one beam lost."""
    ranges = round_room(3)
    ranges[::2, 40:55] = 2.0
    ranges[::2, 200:230] = 1.5
    ranges[0, 5] = np.inf
    ranges[2, 7] = np.nan
    made = sweep(ranges, angle_increment=np.pi / 180, range_min=0.1, range_max=12)
    # So strong that a median needs all digits of single precision, but for the second sweep.
    intensities = np.where(made.sweep[:, None] == 1, np.nan, np.linspace(0.1, 900.3, 360)).astype(np.float32)
    return replace(
        made,
        intensities=intensities,
        topic="/scan",
        frame_ids=("a", "b"),
        frame=np.array([0, 1, 1], np.int32),
        stamp_ns=STAMPS,
        first_ns=int(STAMPS[0]),
    )


@pytest.fixture
def detection(batch: SweepBatch) -> Detection:
    return detect(batch, Parameters(), per_beam=True)
