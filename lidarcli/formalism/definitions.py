"""The paper's definitions by their names, each for a batch of S sweeps with up to B beams: `detect`, step by step.

Definition 1 is `SweepBatch.bearings` and `SweepBatch.ranges`. By default all follow the printed formulas (profile `paper`);
`Parameters()` are those that real sensors need. Arrays of another shape, bearings or ranges that are no numbers raise a
`ValueError`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detect import breakpoints, detect, difference
from lidarcli.formalism.detection import SETS, Detection
from lidarcli.formalism.parameters import Parameters
from lidarcli.sweeps.types import Bool, Float64, Int32, Status, SweepBatch

__all__ = ["difference", "discontinuities", "faces", "objects", "sets", "threshold", "vertices"]
PAPER = Parameters.for_profile("paper")


def threshold(batch: SweepBatch, parameters: Parameters = PAPER) -> Float64:
    """(S,) the threshold d_th of every sweep [m] (Def. 3): the mean of |s|, 0 where no two neighbours have a range.

    With `Parameters()` it is the part of the adaptive threshold that does not grow with range. Raises ValueError for arrays
    that are no sweeps.

    >>> from lidarcli.formalism import sweep
    >>> threshold(sweep([4.0, 2.0, 2.0, 4.0, 4.0], angle_min=0.0, angle_increment=0.1))
    array([1.])
    """
    return breakpoints(batch, parameters)[0]


def discontinuities(batch: SweepBatch, parameters: Parameters = PAPER) -> Bool:
    """(S, B) True where f is discontinuous between a beam and the one at the next smaller bearing (Def. 3): |s| > d_th.

    Also where the beam before has no range, and at the first point of a partial view. With `Parameters()` the one-sided
    limits of f decide, past up to `max_gap` beams without a range. Raises ValueError for arrays that are no sweeps.

    >>> from lidarcli.formalism import sweep
    >>> discontinuities(sweep([4.0, 2.0, 2.0, 4.0, 4.0], angle_min=0.0, angle_increment=0.1))
    array([[ True,  True, False,  True, False]])
    """
    return breakpoints(batch, parameters)[1]


def objects(batch: SweepBatch, parameters: Parameters = PAPER) -> Detection:
    """The K objects O of a batch (Def. 5), by sweep and bearing: each from a discontinuity P_i to the next one, P_f.

    Among the fields of a Detection, (K,) each, are `row`, `theta_i`, `theta_f` [rad], `r_i`, `r_f`, `s_i`, `s_f` [m].
    Raises ValueError for arrays that are no sweeps.
    """
    return detect(batch, parameters, per_beam=True)


def sets(batch: SweepBatch, parameters: Parameters = PAPER) -> NDArray[np.str_]:
    """(S, B) the set of every beam (Def. 4): `O` on objects, else `S`; empty text for padding. U = A ∪ S ∪ O.

    One sweep does not tell who goes by himself, so A is empty here. Raises ValueError for arrays that are no sweeps.
    """
    found = np.array(SETS)[objects(batch, parameters).beam_set]
    return np.where(batch.status == Status.PADDING, "", found)


def vertices(batch: SweepBatch, parameters: Parameters = PAPER) -> list[Float64]:
    """For each object of `objects` (V, 2): bearing [rad] and range [m] of its vertices (Def. 6), by bearing.

    These are P_i, P_f, and between them where f' is 0 or jumps. Raises ValueError for arrays that are no sweeps.
    """
    found = objects(batch, parameters)
    return _by_object(np.column_stack([found.vertex_theta, found.vertex_r]), found.vertex_offsets)


def faces(batch: SweepBatch, parameters: Parameters = PAPER) -> list[Float64]:
    """For each object of `objects` (F, 2): the bearings [rad] where its faces begin and end, vertex to vertex (Def. 7).

    Raises ValueError for arrays that are no sweeps.
    """
    found = objects(batch, parameters)
    return _by_object(np.column_stack([found.face_theta_i, found.face_theta_f]), found.face_offsets)


def _by_object(values: Float64, offsets: Int32) -> list[Float64]:
    return np.split(values, offsets[1:])[:-1]
