"""From a batch of sweeps to its objects: the definitions in their order."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism import mask, vertices
from lidarcli.formalism.carving import carve, cut_out, of_parts
from lidarcli.formalism.corners import locate, settled_faces
from lidarcli.formalism.describe import Segmentation, describe
from lidarcli.formalism.detection import Detection
from lidarcli.formalism.difference import gaps, steepness, steps
from lidarcli.formalism.discontinuity import jumps, one_sided_jumps
from lidarcli.formalism.faces import faces_between, straight_faces
from lidarcli.formalism.fragments import bodies, torn
from lidarcli.formalism.grouping import LEG_WIDTH, close_pairs, joined
from lidarcli.formalism.objects import by_extent, chosen, fully_visible, pieces
from lidarcli.formalism.parameters import Parameters
from lidarcli.formalism.points import collect, refuse_geometry
from lidarcli.formalism.runs import Runs, split
from lidarcli.formalism.threshold import mean_difference, noise, noise_threshold
from lidarcli.formalism.walls import chord, extent, on_wall_lines, reached, straightness, surveyed
from lidarcli.sweeps import Bool, Float64, Int64, SweepBatch


def detect(
    batch: SweepBatch,
    parameters: Parameters | None = None,
    *,
    per_beam: bool = False,
    within: Bool | None = None,
    sigma: Float64 | None = None,
) -> Detection:
    """Objects of every sweep of a batch (Definitions 2 to 7).

    Parameters
    ----------
    batch : SweepBatch of S sweeps; the result for a sweep does not depend on the others
    parameters : Parameters, by default those of profile `robust`
    per_beam : also fill `beam_set`, `beam_object` and `beam_s`
    within : (S, B) beams that are known to belong to objects, all others not: §3's difference from a background tells.
        Objects begin and end with them, too, whatever their edges and whatever line they are on
    sigma : (S,) noise of the ranges [m], where that is known already

    Returns
    -------
    Detection

    Raises
    ------
    ValueError
        `angle_min` or `angle_increment` of a sweep is NaN or infinite.

    Examples
    --------
    >>> from lidarcli.formalism import sweep
    >>> ranges = [4.0] * 20 + [2.0] * 5 + [4.0] * 20
    >>> found = detect(sweep(ranges, angle_min=-0.22, angle_increment=0.01), Parameters.for_profile("paper"))
    >>> found.beam_i.tolist(), found.beam_f.tolist()
    ([20], [24])
    """
    parameters = parameters or Parameters()
    refuse_geometry(batch)
    points = collect(batch)
    gap, size = gaps(points), steepness(points)
    sigma = noise(batch) if sigma is None else sigma
    d_mean = mean_difference(points, gap, size)
    sweep_d_th = _sweep_threshold(d_mean, sigma, parameters)
    adaptive = parameters.threshold == "adaptive"
    inside = None if within is None else mask.lay_out(points, within)
    candidates = steps(
        points, gap, size if inside is None else mask.bordered(points, size, inside), sweep_d_th
    )
    jump = (
        one_sided_jumps(points, candidates, gap, sigma, parameters.max_gap)
        if adaptive
        else jumps(candidates.s, sweep_d_th[candidates.row])
    )
    if inside is not None:
        jump |= mask.crossing(candidates, inside)
    runs = split(batch, points, candidates, jump, parameters.max_gap)
    known = None if inside is None else mask.of_runs(runs, inside)
    if parameters.profile == "paper":
        segmentation = _literal(runs, sweep_d_th, parameters, known)
    elif known is not None:
        segmentation = _known(runs, sigma, parameters, known)
    else:
        runs, segmentation = _robust(runs, sigma, parameters)
    return describe(batch, runs, segmentation, d_mean, sweep_d_th, adaptive, sigma, per_beam)


def _sweep_threshold(d_mean: Float64, sigma: Float64, parameters: Parameters) -> Float64:
    """(S,) d_th of each sweep [m]; with `adaptive` the part of it that does not grow with range."""
    if parameters.threshold == "adaptive":
        return noise_threshold(sigma)
    if parameters.threshold == "mean":
        return d_mean
    return np.full(len(d_mean), float(parameters.threshold))


def _literal(runs: Runs, d_th: Float64, parameters: Parameters, known: Bool | None) -> Segmentation:
    """Profile `paper`: Definitions 5 to 7 as printed; `known` (R,) tells the objects in place of their edges."""
    extremum, corner = vertices.literal(runs, d_th)
    faces = faces_between(runs, extremum | corner)
    small = extent(runs, faces) <= parameters.max_width
    enough = runs.size >= parameters.min_beams
    visible = fully_visible(runs) if known is None else known
    is_object = visible & small & enough
    return Segmentation(
        faces=faces,
        extremum=extremum,
        is_object=is_object,
        is_wall=~(visible & small) & enough & parameters.walls,
        label=_grouped(runs, is_object, parameters),
    )


def _grouped(runs: Runs, is_object: Bool, parameters: Parameters, label: Int64 | None = None) -> Int64 | None:
    """(R,) label of the thing that each object is a part of, where things of several parts are asked for."""
    if parameters.group_gap <= 0:
        return label
    legs = np.flatnonzero(is_object & (chord(runs) <= LEG_WIDTH))
    a, b = close_pairs(runs, legs, parameters.group_gap)
    if label is not None:
        a, b = np.append(a, np.arange(len(runs))), np.append(b, label)
    return joined(len(runs), a, b)


def _known(runs: Runs, sigma: Float64, parameters: Parameters, known: Bool) -> Segmentation:
    """Profile `robust` where the runs (R,) that belong to objects are known: no walls to look for."""
    tolerance = straightness(runs, sigma)
    reach = extent(runs, straight_faces(runs, np.where(known, runs.size, 0), tolerance))
    body = bodies(runs, reach, *torn(runs, known, reach))
    is_object = known & (body.size >= parameters.min_beams) & (body.reach <= parameters.max_width)
    group = _grouped(runs, is_object, parameters, body.label)
    faces = settled_faces(runs, is_object, tolerance)
    corners = locate(runs.points, faces, tolerance)
    extremum, is_wall = np.zeros(len(runs.points), bool), np.zeros(len(runs), bool)
    return Segmentation(faces, extremum, is_object, is_wall, group, body.label, corners)


def _robust(runs: Runs, sigma: Float64, parameters: Parameters) -> tuple[Runs, Segmentation]:
    """Profile `robust`: the same definitions with the estimates a real sensor needs."""
    least, most = parameters.min_beams, parameters.max_width
    ends, tolerance, looked_at = surveyed(runs, sigma, least, most)
    faces = straight_faces(runs, looked_at, tolerance)
    carved = carve(runs, faces, runs.size >= least, sigma)
    runs, origin, thing = cut_out(runs, carved)
    if thing.any():
        faces = of_parts(faces, runs)
        ends, tolerance = chord(runs), tolerance[origin]
    reach = reached(runs, faces, ends)
    wall, candidate, partial, bend = by_extent(runs, faces, reach, thing, least, most)
    wall |= on_wall_lines(runs, faces, wall, candidate, partial, sigma, most)
    piece = pieces(runs, ends, wall, thing, most)
    body = bodies(runs, reach, *torn(runs, piece, reach))
    is_object = chosen(runs, wall, piece, thing, body, bend, least, most)
    is_wall = wall & parameters.walls
    group = _grouped(runs, is_object, parameters, body.label)
    faces = settled_faces(runs, is_object | is_wall, tolerance)
    corners = locate(runs.points, faces, tolerance)
    extremum = np.zeros(len(runs.points), bool)
    return runs, Segmentation(faces, extremum, is_object, is_wall, group, body.label, corners)
