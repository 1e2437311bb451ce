"""From a batch of sweeps to its objects: the definitions in their order; and the reasons for each verdict."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism import features, forest
from lidarcli.formalism.core import Core
from lidarcli.formalism.description import Columns
from lidarcli.formalism.detection import COLUMNS, NOISE, OBJECT, REQUIRED, Detection, object_intensities
from lidarcli.formalism.features import NAMES
from lidarcli.formalism.parameters import Parameters, check
from lidarcli.formalism.segmentation import Scans
from lidarcli.sweeps.types import Bool, Closure, Float64, Int64, SweepBatch

OBJECTS_AT_FIRST, VERTICES_AT_FIRST = 16, 3
"""Room for so many objects per sweep, and vertices per object, before it is known how many there are."""
MAX_KEPT = 1 << 12
"""Most beams for which a thread keeps its core: the room for them is some MB."""

_LOCAL = threading.local()


def detect(
    batch: SweepBatch,
    parameters: Parameters | None = None,
    *,
    per_beam: bool = False,
    explain: bool = False,
    within: Bool | None = None,
    sigma: Float64 | None = None,
) -> Detection:
    """Find the objects of every sweep of a batch (Definitions 2 to 7).

    Parameters
    ----------
    batch : SweepBatch of S sweeps; the result for a sweep does not depend on the others
    parameters : Parameters, by default those of profile `robust`
    per_beam : also fill `beam_set`, `beam_object` and `beam_s`
    explain : also fill `features`
    within : (S, B) beams that belong to objects, as the difference from a background (§3) tells; all others do not.
        Objects begin and end with them, whatever their edges and whatever line they are on
    sigma : (S,) noise of the ranges [m], where that is known already

    Returns
    -------
    Detection of K objects [m, rad]; NaN where a number is not defined

    Raises
    ------
    ValueError
        Arrays of another shape, bearings or ranges that are no numbers (`check`).

    Examples
    --------
    >>> from lidarcli.formalism import sweep
    >>> ranges = [4.0] * 20 + [2.0] * 5 + [4.0] * 20
    >>> found = detect(sweep(ranges, angle_min=-0.22, angle_increment=0.01), Parameters.for_profile("paper"))
    >>> found.beam_i.tolist(), found.beam_f.tolist()
    ([20], [24])
    """
    sweeps = scans(batch, within, sigma)
    core = _core(sweeps.width, parameters or Parameters())
    arrays, columns, row = _room(batch, per_beam, explain), Columns(), 0
    columns.attach(arrays, per_beam)
    while (row := core.detect(sweeps, columns, row)) < len(batch):
        # As many times as long as the rest may need, but at least twice and at most four times.
        times = min(max(len(batch) / max(row, 1), 2.0), 4.0)
        rooms = columns.room_objects, columns.room_vertices, columns.room_faces
        _resize(arrays, *(int(times * room) + 1 for room in rooms))
        columns.attach(arrays, per_beam)
    _resize(arrays, columns.objects, columns.vertices, columns.faces)
    arrays["agents"][:] = arrays["agent_beams"][:] = 0
    arrays["noise_beams"][:] = batch.beams - arrays["object_beams"]
    if per_beam:
        arrays["beam_set"] = np.where(arrays["beam_object"] > 0, OBJECT, NOISE).astype(np.uint8)
    found = Detection(**arrays)
    if batch.intensities is None:
        return found
    return replace(found, intensity=object_intensities(batch, found))


def noise(batch: SweepBatch) -> Float64:
    """Estimate the noise of every sweep, which Definition 3's adaptive threshold needs, from its second differences.

    Parameters
    ----------
    batch : SweepBatch, S sweeps of up to B beams

    Returns
    -------
    (S,) standard deviation σ of a range [m], never NaN and at least 0.003: no scanner is better

    Raises
    ------
    ValueError
        Arrays of another shape, bearings or ranges that are no numbers (`check`).

    Examples
    --------
    >>> from lidarcli.formalism import sweep
    >>> noise(sweep([2.0, 2.01, 1.98, 2.0, 2.02], angle_min=0.0, angle_increment=0.01)).round(3)
    array([0.025])
    """
    sigma = np.empty(len(batch))
    sweeps = scans(batch)
    _core(sweeps.width).measure_noise(sweeps, sigma)
    return sigma


def difference(batch: SweepBatch) -> Float64:
    """Compute the difference function s of every beam (Def. 2), in the log's own beam order.

    Parameters
    ----------
    batch : SweepBatch, S sweeps of up to B beams

    Returns
    -------
    (S, B) signed differences [m] towards the neighbour at the next smaller bearing. NaN where the beam or that neighbour
    has no range, and for the first beam of a partial view. On a full turn the predecessor of the first bearing is the
    last; a bearing that is measured twice counts once, its repetition is NaN.

    Raises
    ------
    ValueError
        Arrays of another shape, bearings or ranges that are no numbers (`check`).

    Examples
    --------
    >>> import numpy as np
    >>> from lidarcli.formalism import sweep
    >>> difference(sweep([2.0, 2.0, 1.0, 2.0], angle_min=0.0, angle_increment=np.pi / 2))
    array([[ 0.,  0., -1.,  1.]])
    """
    s = np.empty(batch.ranges.shape)
    sweeps = scans(batch)
    _core(sweeps.width).measure_differences(sweeps, s)
    return s


def breakpoints(batch: SweepBatch, parameters: Parameters) -> tuple[Float64, Bool]:
    """Return Def. 3's threshold of every sweep (S,) [m], and the beams before which f is discontinuous (S, B)."""
    d_th, breaks = np.empty(len(batch)), np.zeros(batch.ranges.shape, np.bool_)
    sweeps = scans(batch)
    _core(sweeps.width, parameters).measure_breakpoints(sweeps, d_th, breaks)
    return d_th, breaks


def _core(width: int, parameters: Parameters | None = None) -> Core:
    """Return the core of this thread for sweeps of up to so many beams; None for any parameters."""
    kept: tuple[int, Parameters, Core] | None = getattr(_LOCAL, "kept", None)
    if kept is not None and width <= kept[0] and parameters in (None, kept[1]):
        return kept[2]
    parameters = parameters or Parameters()
    core = Core(max(width, 1), parameters)
    if width <= MAX_KEPT:
        _LOCAL.kept = width, parameters, core
    return core


def scans(batch: SweepBatch, within: Bool | None = None, sigma: Float64 | None = None) -> Scans:
    """Check a batch, and return it as the loops over one sweep read it."""
    check(batch, within, sigma)
    return Scans(batch, _directions(batch), within, sigma)


def _directions(batch: SweepBatch) -> tuple[Float64, Float64, Int64]:
    """Return cos θ and sin θ by increasing bearing, (D, B), of the D geometries of a batch, and which one each row has."""
    shared = batch.closure == Closure.SHARED.value
    last = np.where(batch.angle_increment < 0, batch.beams - shared - 1, 0)
    rows = np.stack([batch.angle_min, batch.angle_increment, last], axis=1)
    if len(batch) and (rows == rows[0]).all():
        cos, sin = _row_directions(*rows[0].tolist(), batch.width)
        return cos, sin, np.zeros(len(batch), np.int64)
    number: dict[tuple[float, ...], int] = {}
    code = np.array([number.setdefault(tuple(row), len(number)) for row in rows.tolist()], np.int64)
    tables = np.empty((2, len(number), batch.width))
    for row, k in number.items():
        tables[:, k] = _row_directions(*row, batch.width)
    return tables[0], tables[1], code


@lru_cache(maxsize=64)
def _row_directions(start: float, increment: float, last: float, width: int) -> tuple[Float64, Float64]:
    """Return cos θ and sin θ of one sweep. Sensors seldom have more geometries than the cache holds."""
    position = np.arange(width)
    theta = start + increment * (last - position if increment < 0 else position)
    cos, sin = np.cos(theta), np.sin(theta)
    cos.flags.writeable = sin.flags.writeable = False
    return cos, sin


def _room(batch: SweepBatch, per_beam: bool, explain: bool) -> dict[str, NDArray[Any]]:
    """Return arrays for as many objects as sweeps mostly have: field of a `Detection` → array."""
    rows, width = batch.ranges.shape
    objects = OBJECTS_AT_FIRST * rows + width
    sizes = {
        "object": objects,
        "offset": objects + 1,
        "vertex": VERTICES_AT_FIRST * objects + 2 * width,
        "face": VERTICES_AT_FIRST * objects + width,
        "sweep": rows,
    }
    arrays = {name: np.empty(sizes[COLUMNS[name].per], COLUMNS[name].dtype) for name in REQUIRED}
    arrays["vertex_offsets"][0] = arrays["face_offsets"][0] = 0
    if explain:
        arrays["features"] = np.empty((objects, len(features.NAMES)))
    if per_beam:
        arrays |= {name: np.zeros((rows, width), COLUMNS[name].dtype) for name in ("beam_object", "beam_s")}
    return arrays


def _resize(arrays: dict[str, NDArray[Any]], objects: int, vertices: int, faces: int) -> None:
    """Make the arrays longer or shorter, in place."""
    sizes = {"object": objects, "offset": objects + 1, "vertex": vertices, "face": faces}
    for name, array in arrays.items():
        if (per := COLUMNS[name].per) in sizes:
            array.resize((sizes[per], *array.shape[1:]), refcheck=False)


# Reasons for a verdict, object or building: the part of each kind of evidence in the log-odds.

KINDS = {
    "edges": ("jump", "gap", "flicker"),
    "around": ("beside", "around", "deeper", "bodies", "slim"),
    "lines": ("line", "unbroken", "arms", "support", "beyond", "wall_before"),
    "size": ("width", "extent", "range"),
    "form": ("bulge_away", "arc"),
}
"""Kind of evidence → features that belong to it."""
START = "start"
"""Log-odds before any feature."""
PLACE = "place"
"""Mean log-odds by all sweeps at that place, which take the place of this sweep's own."""
LEAST = 0.05
"""Least log-odds that are shown."""


def contributions(features: Float64) -> dict[str, Float64]:
    """Return the part of each kind of evidence in the log-odds of being an object; their sum is the whole.

    `features` is (K, F) as `Detection.features` has them.
    """
    kind_of = {name: kind for kind, names in KINDS.items() for name in names}
    found = {kind: np.zeros(len(features)) for kind in (START, *KINDS)}
    found[START] += forest.PRIOR
    every = np.arange(len(features))
    for questions, leaves in forest.TREES:
        asked, bound, value = (np.array(column) for column in zip(*questions, strict=True))
        value = np.append(value, leaves)
        found[START] += value[0]
        at: NDArray[np.int64] = np.zeros(len(features), np.int64)
        for _ in range(len(leaves).bit_length() - 1):
            then = 2 * at + 1 + (features[every, asked[at]] > bound[at])
            for feature in np.unique(asked[at]).tolist():
                mine = asked[at] == feature
                found[kind_of[NAMES[feature]]][mine] += (value[then] - value[at])[mine]
            at = then
    return found


def reasons(features: Float64, thing: Float64, place: Float64 | None = None) -> list[str | None]:
    """Return (K,) the parts in words, the greatest first: `edges +2.1, lines -0.8`; None without a verdict.

    Log-odds of a `place`, (K,), NaN where it is not known, come before: `place -0.7; this sweep: edges +2.1`.
    """
    parts = contributions(features)
    names, values = [*parts], np.stack([*parts.values()], axis=1)
    lines: list[str | None] = []
    place = np.full(len(thing), np.nan) if place is None else place
    for row, known, here in zip(values, ~np.isnan(thing), place.tolist(), strict=True):
        order = [k for k in np.argsort(-np.abs(row)).tolist() if abs(row[k]) >= LEAST]
        before = "" if here != here else f"{PLACE} {here:+.1f}; this sweep: "
        lines.append(before + ", ".join(f"{names[k]} {row[k]:+.1f}" for k in order) if known else None)
    return lines
