"""What is compared: each method turns a batch into the number of the detection of every beam."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.accuracy.baselines import BASELINES, MAX_WIDTH, MIN_POINTS
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.sweeps.types import Int64, SweepBatch

Method = Callable[[SweepBatch], Int64]

GROUP_GAP = 0.45
"""[m] `--group-gap` that makes one object of the legs of a chair, a person or a ladder."""


def labels_of(detection: Detection) -> Int64:
    """(S, B) number of the object of every beam."""
    if detection.beam_object is None:
        raise ValueError("the detection was made without per_beam")
    return detection.beam_object.astype(np.int64)


def by_profile(parameters: Parameters) -> Method:
    """A method from the parameters of lidarcli's own detection."""

    def method(batch: SweepBatch) -> Int64:
        return labels_of(detect(batch, parameters, per_beam=True))

    return method


ROBUST = "robust"
GROUPED = f"robust, --group-gap {GROUP_GAP:g}"
METHODS: dict[str, Method] = {
    ROBUST: by_profile(Parameters()),
    "paper": by_profile(Parameters.for_profile("paper")),
    "paper, 3 beams, 2 m": by_profile(Parameters.for_profile("paper", min_beams=MIN_POINTS, max_width=MAX_WIDTH)),
    **BASELINES,
}
"""With default options, or as published."""
GROUPING: dict[str, Method] = {GROUPED: by_profile(Parameters(group_gap=GROUP_GAP))}
