"""The path of a sensor from its sweeps alone: each sweep is laid, point to line, onto a local map of surfels.

A *surfel* is a short piece of a wall: a point with a normal, or a point alone. The map holds them in square cells, as far
as the sensor reaches. A sweep that takes time is deskewed by the velocity that its own alignment gives. Where the walls in
view do not fix the place along some direction, as in a straight corridor, the guess decides along it.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import outline
from lidarcli.formalism.outline import Outline
from lidarcli.system import native

NAN = float("nan")
TURN, TINY = outline.TURN, outline.TINY
FARTHEST_RANGE, GRAIN, MAX_POINTS = outline.FARTHEST_RANGE, outline.GRAIN, outline.MAX_POINTS
MIN_POINTS = 15
"""A sweep of fewer points has no pose."""

# The map.

CELL, SIDE = 0.2, 512
"""Side of the cells of the map [m], and cells in each direction, which repeat beyond: more than the reach of all ranges to
both sides."""
MAX_SURFELS, MAX_HITS = 1 << 16, 20.0
"""Room for surfels; the mean of one forgets beyond this many points."""
SAME_SIDE = 0.5
"""Cosine of the angle between two normals, above which they are of one side of a wall."""

# An alignment.

MAX_STEPS, SMALL_STEP = 12, 3e-4
"""Steps of an alignment for each scale; it has converged at a step below the second [m, rad]."""
MAX_STEP, MAX_TURN = 0.5, 0.3
"""[m, rad] Limits of one step of an alignment."""
LIES_OFF, SPEEDS_UP, TURNS_UP = 0.2, 0.3, 0.6
"""Deviations: of a sweep from the map as a whole [m], and of its velocity from that until then [m/s, rad/s]."""
FINE_REACH, FINE_KERNEL = 0.15, 0.03
"""[m] Reach and scale of weights of the last steps of an alignment."""
MAX_BENDS, SMALL_BEND = 4, 3e-3
"""Corrections of the velocity of a sweep that takes time, until one is below this [m/s, rad/s]."""
POINT_WEIGHT, HALF_WEIGHT_HITS, MIN_WEIGHT = 0.3, 2.0, 1.0
"""Weight of a point without a line; number of points that give a surfel half of the weight of one that many hit; least sum
of weights of a step."""
SLIDES, SPINS = 0.02, 0.01
"""The walls do not fix the place along a direction whose curvature is a smaller share of all weights, nor the heading where
its curvature is a smaller share of what it can be."""
FITS, FITS_POINT, FITS_GROWS = 0.05, 0.08, 0.005
"""A point fits that is no further from a line or from a point than this [m], and this share of its range more."""
SHARP = 0.015
"""[m] Residuals below are of a sharp map, not one of sweeps that are deskewed wrongly."""

# The search for the place of a sweep.

GOOD_FIT, MIN_FIT, BETTER = 0.6, 0.5, 0.03
"""Share of points that fit below which other turns are tried, below which a sweep has no pose, and by which another turn
has to be better."""
TRIED_TURN, TRIED_TURNS = 0.12, 4
"""Other turns are tried in steps of so much [rad], so many to each side, ..."""
TRIED_POINTS, TRIED_REACH, TRIED_KERNEL = 60, 0.8, 0.15
"""... with about so many of the points, and with this reach and scale of weights [m]."""
APART = 0.05
"""[m, rad] Both the velocity and the last step are tried if they lead further apart than this."""
FARTHEST_STEP, WIDEST_STEP = 3.0, 1.2
"""[m, rad] A sweep is no further from its guess than this."""
PATIENCE = 10
"""After this many sweeps in a row that fit nowhere, the map begins again."""
HORIZON = 1.0
"""[s] A velocity is valid for this long."""
COLUMNS = 9
"""Numbers of each sweep in the result of `Matcher.follow`."""


class Surfels:
    """A map: points with normals in cells that repeat every `SIDE`."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.count = 0
        self.x = native.doubles(self.owner, MAX_SURFELS)
        self.y = native.doubles(self.owner, MAX_SURFELS)
        self.nx = native.doubles(self.owner, MAX_SURFELS)
        self.ny = native.doubles(self.owner, MAX_SURFELS)
        self.hits = native.doubles(self.owner, MAX_SURFELS)
        self.line = native.integers(self.owner, MAX_SURFELS)
        self.column = native.integers(self.owner, MAX_SURFELS)
        self.row = native.integers(self.owner, MAX_SURFELS)
        self.next = native.integers(self.owner, MAX_SURFELS)
        """Next surfel of the chain, counted from 1; 0 at its end."""
        self.head = native.integers(self.owner, SIDE * SIDE)


class Placement:
    """A pose on the map, and how well the points fit there."""

    def __init__(self) -> None:
        self.x = self.y = self.yaw = 0.0
        self.fit = self.sharp = 0.0
        """Share of points that fit, and of those within `SHARP`."""
        self.least = 0.0
        """Curvature along the direction that is fixed worst, as a share of all weights."""
        self.along_x = self.along_y = 0.0
        """That direction."""


class Sums:
    """Normal equations of a step (x, y, yaw), and how many points fit.

    `total` is the sum of all weights, `arms` that of the weights times squared ranges: what `htt` is at most.
    """

    def __init__(self) -> None:
        self.hxx = self.hxy = self.hyy = self.hxt = self.hyt = self.htt = 0.0
        self.gx = self.gy = self.gt = self.total = self.arms = 0.0
        self.fits = self.sharp = 0


class Matcher:
    """The path of one sensor: `follow` takes sweeps in log order, however they are cut into batches."""

    def __init__(self, beams: int) -> None:
        self.beams, self.columns = beams, COLUMNS
        self.points = Outline(beams)
        self.first = Outline(beams)
        """The sweep with which the map begins, while it is all there is of it."""
        self.map = Surfels()
        self.found, self.best = Placement(), Placement()
        self.sums = Sums()
        self.begun = self.moves = self.alone = False
        self.x = self.y = self.yaw = 0.0
        self.vx = self.vy = self.vyaw = 0.0
        self.stepped = False
        self.step_x = self.step_y = self.step_yaw = 0.0
        """The last step between two sweeps, once there is one."""
        self.time = 0.0
        self.prior_x = self.prior_y = self.prior_yaw = NAN
        self.prior_part = 0.0
        self.misses = self.passed = 0
        """Sweeps since the last pose: those that fit nowhere, and all."""
        self.pieces = 0

    def follow(
        self, ranges: Any, beams: Any, angle_min: Any, angle_increment: Any, timing: Any, prior: Any, found: Any
    ) -> None:
        """Find the poses of S sweeps, and write them to `found`.

        Parameters
        ----------
        ranges : (S, B) float32 [m], NaN without a return; B at most the `beams` of this matcher
        beams : (S,) int32 number of beams of each sweep
        angle_min, angle_increment : (S,) float64 [rad]
        timing : (S, 3) float64: header stamp, and how long after it the first and the last beam are sent [s]
        prior : (S, 4) float64: x, y, yaw of a pose that is known before, NaN for none, and the number of the part of that
            path, within which steps are believed
        found : (S, columns) float64: x, y, yaw, NaN without a pose; share of points that fit; least curvature; share of
            points within `SHARP`; number of the piece, from 1; 1 where the guess is a prior; 1 where it may slide
        """
        rows, width = ranges.shape
        if width > self.beams:
            first, self.points = self.first, Outline(width)
            self.first = Outline(width)
            outline.copy_outline(self.first, first)
            self.beams = width
        r, counted = native.at_singles(ranges), native.at_ints(beams)
        angles, step = native.at_doubles(angle_min), native.at_doubles(angle_increment)
        times, guesses, out = native.at_doubles(timing), native.at_doubles(prior), native.at_doubles(found)
        lock = native.release()
        for row in range(rows):
            for k in range(COLUMNS):
                out[COLUMNS * row + k] = NAN
            outline.read_outline(
                self.points, r, row * width, counted[row], angles[row], step[row], times[3 * row + 1], times[3 * row + 2]
            )
            place_sweep(self, times[3 * row], guesses, 4 * row, out, COLUMNS * row)
        native.resume(lock)


def nearest_surfel(surfels: Surfels, x: float, y: float, nx: float, ny: float, line: int, reach: float) -> int:
    """Return the nearest surfel of the same side of a wall, -1 where there is none within `reach` [m]."""
    column, row = int(math.floor(x / CELL)), int(math.floor(y / CELL))  # noqa: RUF046
    around = int(math.ceil(reach / CELL))  # noqa: RUF046
    best, found = reach * reach, -1
    own_x, own_y = x - column * CELL, y - row * CELL
    for ring in range(around + 1):
        # All cells of this ring are further off than the nearest so far.
        least = (ring - 1) * CELL + min(min(own_x, CELL - own_x), min(own_y, CELL - own_y))
        if ring > 0 and least * least > best:
            break
        for i in range(column - ring, column + ring + 1):
            edge = i == column - ring or i == column + ring
            j = row - ring
            while j <= row + ring:
                at = surfels.head[(i & (SIDE - 1)) * SIDE + (j & (SIDE - 1))] - 1
                while at >= 0:
                    if surfels.column[at] == i and surfels.row[at] == j:
                        dx, dy = surfels.x[at] - x, surfels.y[at] - y
                        d = dx * dx + dy * dy
                        if d < best and not (
                            line and surfels.line[at] and nx * surfels.nx[at] + ny * surfels.ny[at] < SAME_SIDE
                        ):
                            best, found = d, at
                    at = surfels.next[at] - 1
                j += 1 if edge else max(2 * ring, 1)
    return found


def add_surfel(surfels: Surfels, x: float, y: float, nx: float, ny: float, line: int) -> None:
    """Add a point to the surfel that it is one of, or as a new one."""
    at = nearest_surfel(surfels, x, y, nx, ny, line, GRAIN)
    if at >= 0:
        if surfels.line[at] and line:
            off = surfels.nx[at] * (x - surfels.x[at]) + surfels.ny[at] * (y - surfels.y[at])
            share = 1.0 / (min(surfels.hits[at], MAX_HITS) + 1.0)
            surfels.x[at] += share * off * surfels.nx[at]
            surfels.y[at] += share * off * surfels.ny[at]
            ax = surfels.nx[at] + share * (nx - surfels.nx[at])
            ay = surfels.ny[at] + share * (ny - surfels.ny[at])
            norm = math.sqrt(ax * ax + ay * ay)
            surfels.nx[at], surfels.ny[at] = ax / norm, ay / norm
            surfels.hits[at] += 1.0
        elif line:
            surfels.x[at], surfels.y[at], surfels.nx[at], surfels.ny[at] = x, y, nx, ny
            surfels.line[at], surfels.hits[at] = 1, 1.0
        else:
            surfels.hits[at] += 1.0
        return
    if surfels.count == MAX_SURFELS:
        return
    at = surfels.count
    surfels.count += 1
    surfels.x[at], surfels.y[at], surfels.nx[at], surfels.ny[at] = x, y, nx, ny
    surfels.line[at], surfels.hits[at] = line, 1.0
    column, row = int(math.floor(x / CELL)), int(math.floor(y / CELL))  # noqa: RUF046
    surfels.column[at], surfels.row[at] = column, row
    chain_surfel(surfels, at)


def chain_surfel(surfels: Surfels, at: int) -> None:
    """Put a surfel into the chain of its cell."""
    cell = (surfels.column[at] & (SIDE - 1)) * SIDE + (surfels.row[at] & (SIDE - 1))
    surfels.next[at] = surfels.head[cell]
    surfels.head[cell] = at + 1


def forget_far(surfels: Surfels, x: float, y: float, reach: float) -> None:
    """Keep only surfels within `reach` of a place [m]; none for a reach of 0."""
    for cell in range(SIDE * SIDE):
        surfels.head[cell] = 0
    kept = 0
    for at in range(surfels.count):
        dx, dy = surfels.x[at] - x, surfels.y[at] - y
        if dx * dx + dy * dy >= reach * reach:
            continue
        surfels.x[kept], surfels.y[kept], surfels.nx[kept] = surfels.x[at], surfels.y[at], surfels.nx[at]
        surfels.ny[kept], surfels.hits[kept], surfels.line[kept] = (surfels.ny[at], surfels.hits[at], surfels.line[at])
        surfels.column[kept], surfels.row[kept] = surfels.column[at], surfels.row[at]
        chain_surfel(surfels, kept)
        kept += 1
    surfels.count = kept


def enter_sweep(matcher: Matcher, points: Outline, vx: float, vy: float, vyaw: float) -> None:
    """Add a sweep to the map at the pose of the matcher."""
    reach = 2.0 * FARTHEST_RANGE
    while matcher.map.count > MAX_SURFELS - MAX_POINTS:
        forget_far(matcher.map, matcher.x, matcher.y, reach)
        reach *= 0.7
    outline.deskew(points, vx, vy, vyaw)
    cos, sin = math.cos(matcher.yaw), math.sin(matcher.yaw)
    for i in range(points.count):
        x = matcher.x + cos * points.at_x[i] - sin * points.at_y[i]
        y = matcher.y + sin * points.at_x[i] + cos * points.at_y[i]
        nx = cos * points.at_nx[i] - sin * points.at_ny[i]
        ny = sin * points.at_nx[i] + cos * points.at_ny[i]
        add_surfel(matcher.map, x, y, nx, ny, points.line[i])


def align(
    matcher: Matcher, x: float, y: float, yaw: float, vx: float, vy: float, vyaw: float, seconds: float, wide: int
) -> tuple[float, float, float]:
    """Lay the sweep onto the map, from a guess; return its velocity.

    The result is `matcher.found`. `seconds` since the last pose, 0 where the step between says nothing of the velocity.
    """
    matcher.found.x, matcher.found.y, matcher.found.yaw = x, y, yaw
    for scale in range(4):
        if scale == 0:
            if not wide:
                continue
            reach, kernel = 0.8, 0.3
        elif scale == 1:
            reach, kernel = (0.4, 0.12) if wide else (0.5, 0.15)
        elif scale == 2:
            reach, kernel = 0.2, 0.05
        else:
            reach, kernel = FINE_REACH, FINE_KERNEL
            if matcher.points.takes_time:
                return bend(matcher.points, matcher.map, matcher.found, matcher.sums, vx, vy, vyaw)
        outline.deskew(matcher.points, vx, vy, vyaw)
        refine(matcher.points, matcher.map, matcher.found, matcher.sums, reach, kernel, 1)
        if matcher.points.takes_time and seconds > 0.0:
            vx, vy, vyaw = velocity_to(matcher, matcher.found.x, matcher.found.y, matcher.found.yaw, seconds)
    return vx, vy, vyaw


def refine(
    points: Outline, surfels: Surfels, found: Placement, sums: Sums, reach: float, kernel: float, every: int
) -> None:
    """Take Gauss-Newton steps, and do not slide along walls; one point of `every` is used."""
    number = max((points.count + every - 1) // every, 1)
    for _ in range(MAX_STEPS):
        sum_up(points, surfels, found, sums, reach, kernel, every, 0, 0.0)
        found.fit, found.sharp = sums.fits / (1.0 * number), sums.sharp / (1.0 * number)
        if sums.total < MIN_WEIGHT:
            break
        # Yaw is taken out (Schur complement), so that translation is evaluated by itself.
        htt = max(sums.htt, TINY)
        a, b = sums.hxx - sums.hxt * sums.hxt / htt, sums.hxy - sums.hxt * sums.hyt / htt
        c = sums.hyy - sums.hyt * sums.hyt / htt
        bearing = 0.5 * math.atan2(2.0 * b, a - c)
        root = math.sqrt(0.25 * (a - c) * (a - c) + b * b)
        most, least = 0.5 * (a + c) + root, 0.5 * (a + c) - root
        cos, sin = math.cos(bearing), math.sin(bearing)
        found.least = least / sums.total
        found.along_x, found.along_y = -sin, cos
        gx, gy = sums.gx - sums.hxt * sums.gt / htt, sums.gy - sums.hyt * sums.gt / htt
        along = -(cos * gx + sin * gy) / most if most > 1e-6 else 0.0
        aside = -(cos * gy - sin * gx) / least if least > SLIDES * sums.total else 0.0
        dx, dy = cos * along - sin * aside, sin * along + cos * aside
        turn = -(sums.gt + sums.hxt * dx + sums.hyt * dy) / htt if htt > SPINS * sums.arms else 0.0
        far = math.sqrt(dx * dx + dy * dy)
        if far > MAX_STEP:
            dx, dy = dx * MAX_STEP / far, dy * MAX_STEP / far
        turn = max(-MAX_TURN, min(MAX_TURN, turn))
        found.x += dx
        found.y += dy
        found.yaw = math.remainder(found.yaw + turn, TURN)
        if far < SMALL_STEP and abs(turn) < SMALL_STEP:
            break


def bend(
    points: Outline, surfels: Surfels, found: Placement, sums: Sums, vx: float, vy: float, vyaw: float
) -> tuple[float, float, float]:
    """Correct the velocity during the sweep by the points themselves, about the middle of the sweep; return it.

    The velocity until the sweep holds it, with deviations of `SPEEDS_UP` and `TURNS_UP`.
    """
    middle = 0.0
    for i in range(points.count):
        middle += points.late[i]
    middle /= points.count
    off = LIES_OFF * LIES_OFF
    straight, round_about = off / (SPEEDS_UP * SPEEDS_UP), off / (TURNS_UP * TURNS_UP)
    ux, uy, turned = 0.0, 0.0, 0.0
    for _ in range(MAX_BENDS):
        cos, sin = math.cos(found.yaw), math.sin(found.yaw)
        outline.deskew(points, vx + cos * ux + sin * uy, vy + cos * uy - sin * ux, vyaw + turned)
        refine(points, surfels, found, sums, FINE_REACH, FINE_KERNEL, 1)
        sum_up(points, surfels, found, sums, FINE_REACH, FINE_KERNEL, 1, 1, middle)
        htt, gt = sums.htt + round_about, sums.gt + round_about * turned
        a, b = sums.hxx + straight - sums.hxt * sums.hxt / htt, sums.hxy - sums.hxt * sums.hyt / htt
        c = sums.hyy + straight - sums.hyt * sums.hyt / htt
        gx, gy = sums.gx + straight * ux - sums.hxt * gt / htt, sums.gy + straight * uy - sums.hyt * gt / htt
        det = a * c - b * b
        dx, dy = (b * gy - c * gx) / det, (b * gx - a * gy) / det
        turn = -(gt + sums.hxt * dx + sums.hyt * dy) / htt
        ux, uy, turned = ux + dx, uy + dy, turned + turn
        found.x -= middle * dx
        found.y -= middle * dy
        found.yaw = math.remainder(found.yaw - middle * turn, TURN)
        if dx * dx + dy * dy < SMALL_BEND * SMALL_BEND and abs(turn) < SMALL_BEND:
            break
    cos, sin = math.cos(found.yaw), math.sin(found.yaw)
    return vx + cos * ux + sin * uy, vy + cos * uy - sin * ux, vyaw + turned


def sum_up(
    points: Outline,
    surfels: Surfels,
    found: Placement,
    sums: Sums,
    reach: float,
    kernel: float,
    every: int,
    bends: int,
    middle: float,
) -> None:
    """Sum up the normal equations of residuals e with weights (k² / (k² + e²))², over one point of `every`.

    They are those of a step, or where `bends` of a velocity, that moves a point by how much later than `middle` it was
    observed [s].
    """
    k2, number = kernel * kernel, (points.count + every - 1) // every
    hxx, hxy, hyy, hxt, hyt, htt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    gx, gy, gt, total, arms = 0.0, 0.0, 0.0, 0.0, 0.0
    fits, sharp = 0, 0
    cos, sin = math.cos(found.yaw), math.sin(found.yaw)
    for k in range(number):
        i = every * k
        px = cos * points.at_x[i] - sin * points.at_y[i]
        py = sin * points.at_x[i] + cos * points.at_y[i]
        x, y = px + found.x, py + found.y
        nx = cos * points.at_nx[i] - sin * points.at_ny[i]
        ny = sin * points.at_nx[i] + cos * points.at_ny[i]
        at = nearest_surfel(surfels, x, y, nx, ny, points.line[i], reach)
        if at < 0:
            continue
        moves = points.late[i] - middle if bends else 1.0
        known = surfels.hits[at] / (surfels.hits[at] + HALF_WEIGHT_HITS)
        dx, dy = x - surfels.x[at], y - surfels.y[at]
        if surfels.line[at]:
            nx, ny = surfels.nx[at], surfels.ny[at]
            e = nx * dx + ny * dy
            w = k2 / (k2 + e * e)
            w *= w * known
            jx, jy, jt = moves * nx, moves * ny, moves * (ny * px - nx * py)
            hxx += w * jx * jx
            hxy += w * jx * jy
            hyy += w * jy * jy
            hxt += w * jx * jt
            hyt += w * jy * jt
            htt += w * jt * jt
            gx += w * jx * e
            gy += w * jy * e
            gt += w * jt * e
            total += w
            arms += w * (px * px + py * py)
            if abs(e) < FITS + FITS_GROWS * points.r[i]:
                fits += 1
            if abs(e) < SHARP:
                sharp += 1
        else:
            e = math.sqrt(dx * dx + dy * dy)
            w = k2 / (k2 + e * e)
            w *= w * POINT_WEIGHT * known
            total += w
            arms += w * (px * px + py * py)
            w *= moves
            gx += w * dx
            gy += w * dy
            gt += w * (px * dy - py * dx)
            w *= moves
            hxx += w
            hyy += w
            hxt -= w * py
            hyt += w * px
            htt += w * (px * px + py * py)
            if e < FITS_POINT + FITS_GROWS * points.r[i]:
                fits += 1
    sums.hxx, sums.hxy, sums.hyy, sums.hxt, sums.hyt, sums.htt = hxx, hxy, hyy, hxt, hyt, htt
    sums.gx, sums.gy, sums.gt, sums.total, sums.arms = gx, gy, gt, total, arms
    sums.fits, sums.sharp = fits, sharp


def copy_placement(to: Placement, of: Placement) -> None:
    """Write one alignment over another."""
    to.x, to.y, to.yaw, to.fit, to.sharp = of.x, of.y, of.yaw, of.fit, of.sharp
    to.least, to.along_x, to.along_y = of.least, of.along_x, of.along_y


def begin_map(matcher: Matcher, time: float) -> None:
    """Begin a map with the sweep at hand, at the pose of the matcher."""
    forget_far(matcher.map, 0.0, 0.0, 0.0)
    enter_sweep(matcher, matcher.points, 0.0, 0.0, 0.0)
    outline.copy_outline(matcher.first, matcher.points)
    matcher.begun, matcher.alone, matcher.moves = True, True, False
    matcher.vx = matcher.vy = matcher.vyaw = 0.0
    matcher.time, matcher.misses, matcher.passed = time, 0, 0
    matcher.pieces += 1
    matcher.found.x, matcher.found.y, matcher.found.yaw = matcher.x, matcher.y, matcher.yaw
    matcher.found.fit, matcher.found.least, matcher.found.sharp = 1.0, NAN, NAN


def place_sweep(matcher: Matcher, time: float, prior: Any, at: int, out: Any, to: int) -> None:
    """Find the pose of the sweep in `matcher.points`, write it down and enter it into the map."""
    if matcher.begun and time == matcher.time:
        return
    matcher.passed += 1
    if matcher.points.count < MIN_POINTS:
        return
    guided = False
    if not matcher.begun:
        begin_map(matcher, time)
    else:
        seconds = time - matcher.time
        follows = seconds > 0.0 and seconds <= HORIZON
        if not follows:
            seconds = 0.0
        x, y, yaw = matcher.x, matcher.y, matcher.yaw
        vx, vy, vyaw = matcher.vx, matcher.vy, matcher.vyaw
        if follows and matcher.moves:
            dx, dy, turn = outline.driven(vx, vy, vyaw, seconds)
            x, y, yaw = outline.pose_after(x, y, yaw, dx, dy, turn)
        guided = prior[at] == prior[at] and matcher.prior_x == matcher.prior_x and prior[at + 3] == matcher.prior_part
        if guided:
            dx, dy, turn = outline.step_between(
                matcher.prior_x, matcher.prior_y, matcher.prior_yaw, prior[at], prior[at + 1], prior[at + 2]
            )
            x, y, yaw = outline.pose_after(matcher.x, matcher.y, matcher.yaw, dx, dy, turn)
            if follows:
                vx, vy, vyaw = outline.velocity_of(dx, dy, turn, seconds)
        wide = 0 if guided or (follows and matcher.moves) else 1
        if not guided and matcher.stepped:
            x, y, yaw = start_of(matcher, x, y, yaw, seconds)
        vx, vy, vyaw = align(matcher, x, y, yaw, vx, vy, vyaw, seconds, wide)
        if matcher.found.fit < GOOD_FIT:
            vx, vy, vyaw = look_around(matcher, x, y, yaw, vx, vy, vyaw, seconds)
        if follows and matcher.alone and matcher.first.takes_time and matcher.found.fit >= 0.8 * MIN_FIT:
            # Now that the motion is known, the first sweep can be deskewed as well.
            forget_far(matcher.map, 0.0, 0.0, 0.0)
            enter_sweep(matcher, matcher.first, vx, vy, vyaw)
            vx, vy, vyaw = align(matcher, matcher.found.x, matcher.found.y, matcher.found.yaw, vx, vy, vyaw, seconds, 1)
        dx, dy, turn = outline.step_between(x, y, yaw, matcher.found.x, matcher.found.y, matcher.found.yaw)
        if matcher.found.fit < MIN_FIT or dx * dx + dy * dy >= FARTHEST_STEP * FARTHEST_STEP or abs(turn) >= WIDEST_STEP:
            matcher.misses += 1
            if matcher.misses < PATIENCE:
                return
            if guided:
                matcher.x, matcher.y, matcher.yaw = x, y, yaw
            begin_map(matcher, time)
        else:
            matcher.moves = follows
            dx, dy, turn = outline.step_between(
                matcher.x, matcher.y, matcher.yaw, matcher.found.x, matcher.found.y, matcher.found.yaw
            )
            if matcher.passed == 1:
                matcher.stepped = True
                matcher.step_x, matcher.step_y, matcher.step_yaw = dx, dy, turn
            if follows:
                if not matcher.points.takes_time:
                    vx, vy, vyaw = outline.velocity_of(dx, dy, turn, seconds)
                matcher.vx, matcher.vy, matcher.vyaw = vx, vy, vyaw
            matcher.x, matcher.y, matcher.yaw, matcher.time = (matcher.found.x, matcher.found.y, matcher.found.yaw, time)
            matcher.alone, matcher.misses, matcher.passed = False, 0, 0
            enter_sweep(matcher, matcher.points, vx, vy, vyaw)
    matcher.prior_x, matcher.prior_y, matcher.prior_yaw = prior[at], prior[at + 1], prior[at + 2]
    matcher.prior_part = prior[at + 3]
    out[to], out[to + 1], out[to + 2] = matcher.x, matcher.y, matcher.yaw
    out[to + 3], out[to + 4], out[to + 5] = matcher.found.fit, matcher.found.least, matcher.found.sharp
    out[to + 6], out[to + 7] = 1.0 * matcher.pieces, 1.0 if guided else 0.0
    out[to + 8] = 1.0 if matcher.found.least < SLIDES else 0.0


def start_of(matcher: Matcher, x: float, y: float, yaw: float, seconds: float) -> tuple[float, float, float]:
    """Return where to begin: where the velocity leads, or where the last step does, if stamps are uneven or far apart."""
    sx, sy, syaw = matcher.x, matcher.y, matcher.yaw
    for _ in range(matcher.passed):
        sx, sy, syaw = outline.pose_after(sx, sy, syaw, matcher.step_x, matcher.step_y, matcher.step_yaw)
    dx, dy, turn = outline.step_between(x, y, yaw, sx, sy, syaw)
    if dx * dx + dy * dy < APART * APART and abs(turn) < APART:
        return x, y, yaw
    try_pose(matcher, x, y, yaw, seconds)
    fit = matcher.found.fit
    try_pose(matcher, sx, sy, syaw, seconds)
    return (sx, sy, syaw) if matcher.found.fit > fit else (x, y, yaw)


def velocity_to(matcher: Matcher, x: float, y: float, yaw: float, seconds: float) -> tuple[float, float, float]:
    """Return the velocity from the last pose to another, 0 where `seconds` are."""
    if seconds <= 0.0:
        return 0.0, 0.0, 0.0
    dx, dy, turn = outline.step_between(matcher.x, matcher.y, matcher.yaw, x, y, yaw)
    return outline.velocity_of(dx, dy, turn, seconds)


def try_pose(matcher: Matcher, x: float, y: float, yaw: float, seconds: float) -> None:
    """Lay some of the points onto the map; the result is `matcher.found`."""
    vx, vy, vyaw = velocity_to(matcher, x, y, yaw, seconds)
    outline.deskew(matcher.points, vx, vy, vyaw)
    every = max(matcher.points.count // TRIED_POINTS, 1)
    matcher.found.x, matcher.found.y, matcher.found.yaw = x, y, yaw
    refine(matcher.points, matcher.map, matcher.found, matcher.sums, TRIED_REACH, TRIED_KERNEL, every)


def look_around(
    matcher: Matcher, x: float, y: float, yaw: float, vx: float, vy: float, vyaw: float, seconds: float
) -> tuple[float, float, float]:
    """Try other turns, at the guess and at the last pose, and the best of them with all points; return its velocity."""
    copy_placement(matcher.best, matcher.found)
    fit, tx, ty, tyaw = -1.0, x, y, yaw
    for place in range(2):
        for k in range(-TRIED_TURNS, TRIED_TURNS + 1):
            sx, sy, syaw = (x, y, yaw) if place == 0 else (matcher.x, matcher.y, matcher.yaw)
            try_pose(matcher, sx, sy, math.remainder(syaw + k * TRIED_TURN, TURN), seconds)
            if matcher.found.fit > fit:
                fit = matcher.found.fit
                tx, ty, tyaw = matcher.found.x, matcher.found.y, matcher.found.yaw
    wx, wy, wyaw = velocity_to(matcher, tx, ty, tyaw, seconds)
    wx, wy, wyaw = align(matcher, tx, ty, tyaw, wx, wy, wyaw, seconds, 1)
    if matcher.found.fit >= GOOD_FIT and matcher.found.fit > matcher.best.fit + BETTER:
        return wx, wy, wyaw
    copy_placement(matcher.found, matcher.best)
    return vx, vy, vyaw
