"""§2.2: walls, told from objects by their extent and by the lines they share."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.faces import Faces
from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import offsets_of, span_max, spans
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.sweeps import Bool, Float64, Int64

STRAIGHT = 0.02
"""[m] A face may leave its chord by this much plus three times the noise."""
STRAIGHT_NOISE = 3.0
WALL_STRIDE, WALL_POINTS = 4, 32
"""Of a run too wide for an object every fourth point is looked at, or as many as make 32: enough for its lines."""
LINE_LENGTH = 0.5
"""[m] A shorter face says too little about the direction of a wall."""
LINE_POINTS = 4
COLLINEAR = 0.03
"""[m] Walls are as plane as this; skirting boards and door frames stand out less."""
NOISE_GAIN = 3.0
WALL_THICKNESS = 0.5
"""[m] A door jamb reaches no further behind the line of its wall."""
DOORWAY = 2.0
"""[m] A jamb is no further than this from the nearest part of its wall."""
NEXT_PIECE = 3.0
"""[m] A fully visible piece further than this from a wall lies on its line by chance."""
PAIR_ERROR = 0.1
"""[m] Two pieces prove a wall only where the line of one is known better than this at the other."""
REACH_LIMIT = 0.1
"""[m] Greatest distance at which a piece still counts as on the line, however uncertain the line is."""


def chord(runs: Runs) -> Float64:
    """(R,) distance of the first and the last point of a run [m]."""
    x, y = runs.points.x, runs.points.y
    dx, dy = x[runs.last] - x[runs.first], y[runs.last] - y[runs.first]
    distance: Float64 = np.sqrt(dx * dx + dy * dy)
    return distance


def straightness(runs: Runs, sigma: Float64) -> Float64:
    """(R,) by how much a face may leave its chord [m], for sweeps whose ranges have the noise `sigma` (S,) [m]."""
    tolerance: Float64 = STRAIGHT + STRAIGHT_NOISE * sigma[runs.row]
    return tolerance


@compiled
def surveyed(runs: Runs, sigma: Float64, min_beams: int, max_width: float) -> tuple[Float64, Float64, Int64]:
    """What to know of R runs before looking for their faces, (R,) each.

    Parameters
    ----------
    runs : R runs
    sigma : (S,) noise of the ranges [m]
    min_beams, max_width : what has fewer points or ends further apart [m] is no object

    Returns
    -------
    ends : their `chord` [m]
    tolerance : their `straightness` [m]
    most : how many of their points are enough to find their faces; 0 where these tell nothing
    """
    ends = chord(runs)
    narrow = ends <= max_width
    enough = runs.size >= min_beams
    thinned = np.maximum(-(-runs.size // WALL_STRIDE), np.minimum(runs.size, WALL_POINTS))
    most = np.where(enough & narrow, runs.size, np.where(narrow, 0, thinned))
    return ends, straightness(runs, sigma), most


def extent(runs: Runs, faces: Faces, ends: Float64 | None = None) -> Float64:
    """(R,) how far a run reaches [m]: the greatest distance of a vertex from its first or last point.

    `ends` (R,) is their `chord`, where it is known already.
    """
    return reached(runs, faces, chord(runs) if ends is None else ends)


@compiled
def reached(runs: Runs, faces: Faces, ends: Float64) -> Float64:
    """(R,) `extent` of runs whose chords are `ends` (R,) [m]."""
    x, y = runs.points.x, runs.points.y
    reach = ends.copy()
    count = np.diff(faces.offsets)
    bent = np.flatnonzero(count > 1)
    if not len(bent):
        return reach
    face, _, offsets = spans(faces.offsets[bent], count[bent])
    at, size = faces.last[face], count[bent]
    vertex_x, vertex_y = x[at], y[at]
    for anchor in (runs.first[bent], runs.last[bent]):
        dx, dy = vertex_x - np.repeat(x[anchor], size), vertex_y - np.repeat(y[anchor], size)
        away = np.sqrt(span_max(dx * dx + dy * dy, offsets))
        reach[bent] = np.maximum(reach[bent], away)
    return reach


@compiled
def on_wall_lines(
    runs: Runs, faces: Faces, wall: Bool, candidate: Bool, partial: Bool, sigma: Float64, max_width: float
) -> Bool:
    """Which small runs lie on the line of a wall: a wall between two doorways is short, but continues its neighbours.

    Parameters
    ----------
    runs, faces : R runs and their F faces
    wall : (R,) runs known as walls, whose long faces give the lines
    candidate : (R,) runs to decide on
    partial : (R,) runs of which some part may be hidden: two of them on one line are one wall where together they
        reach further than `max_width`
    sigma : (S,) noise of the ranges [m]
    max_width : greatest extent of an object [m]

    Returns
    -------
    (R,) True where most of the length of a candidate lies on the line of some wall of its sweep
    """
    rows = len(runs.points.start) - 1
    gives = wall | (candidate & partial)
    line = np.flatnonzero(gives[faces.run] & (faces.length >= LINE_LENGTH) & (faces.points >= LINE_POINTS))
    lines = offsets_of(np.bincount(runs.row[faces.run[line]], minlength=rows))
    piece = np.flatnonzero(candidate[faces.run])
    row = runs.row[faces.run[piece]]
    which, owner = _near(faces, line, piece, lines, row, sigma[row])
    which, part = line[which], piece[owner]
    on_line, jamb, reach, beyond, error = _within(runs.points, faces, which, part, sigma[row[owner]])
    pair = (
        partial[faces.run[part]]
        & (faces.run[which] != faces.run[part])
        & (reach > max_width)
        & (error < PAIR_ERROR)
    )
    on_line &= partial[faces.run[part]] | (beyond < NEXT_PIECE)
    fits = ((on_line | jamb) & wall[faces.run[which]]) | (on_line & pair)
    matched = np.zeros(len(faces), bool)
    matched[part[fits]] = True
    matched[which[fits]] = True
    signed = np.where(matched[piece], 1.0, -1.0) * faces.length[piece]
    balance = np.bincount(faces.run[piece], signed, minlength=len(runs))
    result: Bool = candidate & (balance > 0)
    return result


def _near(
    faces: Faces, line: Int64, piece: Int64, lines: Int64, row: Int64, sigma: Float64
) -> tuple[Int64, Int64]:
    """Pairs of a line and a piece of one sweep, without the many of which the middle of the piece lies too far off.

    Parameters
    ----------
    line, piece : faces; sweep i has the lines `line[lines[i]:lines[i + 1]]`
    row, sigma : (P,) sweep of each piece, and its noise [m]

    Returns
    -------
    which, owner : (T,) indices into `line` and `piece`
    """
    middle_x, middle_y = faces.middle_x[line], faces.middle_y[line]
    normal_x, normal_y = faces.direction_y[line], -faces.direction_x[line]
    distance = middle_x * normal_x + middle_y * normal_y
    behind = np.where(distance > 0, 1.0, -1.0)
    count = np.diff(lines)[row]
    which, owner, _ = spans(lines[row], count)
    depth = np.repeat(faces.middle_x[piece], count) * (normal_x * behind)[which]
    depth += np.repeat(faces.middle_y[piece], count) * (normal_y * behind)[which]
    depth -= (distance * behind)[which]
    # The middle is as deep as the two ends on average, and `_within` wants both in these bounds.
    allowed = COLLINEAR + REACH_LIMIT + NOISE_GAIN * sigma
    near = np.flatnonzero(
        (depth >= np.repeat(-allowed, count))
        & (depth <= np.repeat(np.maximum(allowed, WALL_THICKNESS), count))
    )
    return which[near], owner[near]


def _within(
    points: Cloud, faces: Faces, line: Int64, piece: Int64, sigma: Float64
) -> tuple[Bool, Bool, Float64, Float64, Float64]:
    """How face `piece` lies to the straight line of face `line`, (T,) each.

    Returns
    -------
    on_line : both its ends lie on the line, within what is known of it
    jamb : one end lies on the line close to the face, and the other behind it by no more than a wall is thick
    reach : how far the two reach together along the line [m]
    error : uncertainty of the line at the piece [m]
    """
    middle_x, middle_y = faces.middle_x[line], faces.middle_y[line]
    direction_x, direction_y = faces.direction_x[line], faces.direction_y[line]
    length = faces.length[line]
    spread = np.maximum(faces.rms[line], sigma) / np.sqrt(faces.points[line])
    behind = np.where(middle_x * direction_y - middle_y * direction_x > 0, 1.0, -1.0)
    depth, along, allowed = [], [], []
    error = np.zeros(len(line))
    own_error = NOISE_GAIN * sigma * np.minimum(1.0, 2.0 / np.sqrt(faces.points[piece]))
    half = 0.5 * faces.length[piece]
    for side in (-half, half):
        dx = faces.middle_x[piece] + side * faces.direction_x[piece] - middle_x
        dy = faces.middle_y[piece] + side * faces.direction_y[piece] - middle_y
        depth.append((dx * direction_y - dy * direction_x) * behind)
        along.append(np.abs(dx * direction_x + dy * direction_y))
        line_error = NOISE_GAIN * spread * np.sqrt(1.0 + 12.0 * np.square(along[-1] / length))
        error = np.maximum(error, line_error)
        allowed.append(COLLINEAR + own_error + np.minimum(line_error, REACH_LIMIT))
    on = [np.abs(depth[i]) <= allowed[i] for i in (0, 1)]
    reach = np.maximum(along[0], along[1]) + 0.5 * length
    beyond = np.minimum(along[0], along[1]) - 0.5 * length
    inside_wall = [(depth[i] >= -allowed[i]) & (depth[i] <= WALL_THICKNESS) for i in (0, 1)]
    jamb = (on[0] | on[1]) & inside_wall[0] & inside_wall[1] & (beyond < DOORWAY)
    return on[0] & on[1], jamb, reach, beyond, error
