"""One sweep after the other through the definitions, in their order."""

from __future__ import annotations

from typing import Any

from lidarcli.formalism import description, features, objects, range_noise, segmentation, surfaces, verdict
from lidarcli.formalism.description import Columns, Description
from lidarcli.formalism.features import Features
from lidarcli.formalism.objects import Bodies, Protrusions
from lidarcli.formalism.parameters import Parameters
from lidarcli.formalism.range_noise import Noise
from lidarcli.formalism.segmentation import Breakpoints, Points, Scans, Segments
from lidarcli.formalism.surfaces import Faces, Survey
from lidarcli.formalism.verdict import Verdict
from lidarcli.system import native

NAN = float("nan")


class Core:
    """Finder of the objects of sweeps: room for one sweep, and the parameters."""

    def __init__(self, most: int, parameters: Parameters) -> None:
        """Make room for sweeps of up to so many beams, at least one."""
        self.robust = parameters.profile == "robust"
        adaptive = parameters.threshold == "adaptive"
        self.adaptive = adaptive
        self.by_mean = parameters.threshold == "mean"
        self.threshold = 0.0 if isinstance(parameters.threshold, str) else parameters.threshold
        self.report_walls = parameters.walls
        self.group_gap = parameters.group_gap
        self.points = Points(most)
        self.noise = Noise(most)
        self.breakpoints = Breakpoints(most, adaptive, parameters.max_gap)
        self.segments = Segments(most)
        self.faces = Faces(most)
        self.survey = Survey(most, parameters.min_beams, parameters.max_width)
        self.protrusions = Protrusions(most)
        self.bodies = Bodies(most)
        self.features = Features(most)
        self.verdict = Verdict(most, parameters.min_thing)
        self.description = Description(most, self.robust, adaptive)
        self.owner: list[Any] = []
        self.inner = native.integers(self.owner, 2 * most)

    def detect(self, scans: Scans, columns: Columns, row: int) -> int:
        """Write the objects of the sweeps from a row on; returns the row for which the columns have no room."""
        lock = native.release()
        while row < scans.rows and description.has_room(columns, scans.width):
            detect_row(self, scans, columns, row)
            row += 1
        native.resume(lock)
        return row

    def measure_noise(self, scans: Scans, sigma: Any) -> None:
        """Write the noise of every sweep to an array (S,) [m]."""
        out = native.at_doubles(sigma)
        lock = native.release()
        write_noise(self, scans, out)
        native.resume(lock)

    def measure_differences(self, scans: Scans, s: Any) -> None:
        """Write Def. 2's difference of every beam to an array (S, B) [m]."""
        out = native.at_doubles(s)
        lock = native.release()
        write_all_differences(self, scans, out)
        native.resume(lock)

    def measure_breakpoints(self, scans: Scans, d_th: Any, breaks: Any) -> None:
        """Write Def. 3's threshold of every sweep to an array (S,) [m], and 1 to one (S, B) of zeros where f breaks."""
        out, at = native.at_doubles(d_th), native.at_bytes(breaks)
        lock = native.release()
        write_all_breakpoints(self, scans, out, at)
        native.resume(lock)


def write_noise(core: Core, scans: Scans, out: Any) -> None:
    """Write the noise of every sweep; apart, as methods that hold the lock count references to what they hand on."""
    for row in range(scans.rows):
        out[row] = range_noise.sigma_of(core.noise, scans, row)


def write_all_differences(core: Core, scans: Scans, out: Any) -> None:
    """Write s at the beams of every sweep."""
    for row in range(scans.rows):
        segmentation.load(core.points, scans, row)
        segmentation.differences(core.points)
        write_differences(core.points, scans, out)


def write_differences(points: Points, scans: Scans, out: Any) -> None:
    """Write s at the beams of a sweep; NaN where the beam or its neighbour has no range."""
    begin = points.row * scans.width
    for beam in range(begin, begin + scans.width):
        out[beam] = NAN
    for k in range(points.count):
        if points.missing[k] == 0:
            out[begin + segmentation.beam_at(points, points.position[k])] = points.s[k]


def write_all_breakpoints(core: Core, scans: Scans, d_th: Any, breaks: Any) -> None:
    """Write d_th, and the beams before which f breaks, of every sweep."""
    for row in range(scans.rows):
        break_row(core, scans, row)
        d_th[row] = core.points.d_th
        for j in range(core.breakpoints.count):
            position = core.points.position[core.breakpoints.at[j]]
            breaks[row * scans.width + segmentation.beam_at(core.points, position)] = 1


def break_row(core: Core, scans: Scans, row: int) -> float:
    """Definitions 1 to 3 on the sweep in a row of a batch; returns the mean of |s| [m]."""
    segmentation.load(core.points, scans, row)
    segmentation.differences(core.points)
    d_mean = segmentation.mean_difference(core.points)
    core.points.flicker = segmentation.flicker(core.points, scans) if core.robust else 0.0
    core.points.sigma = range_noise.sigma_of(core.noise, scans, row)
    if core.adaptive:
        core.points.d_th = segmentation.noise_threshold(core.points.sigma)
    else:
        core.points.d_th = d_mean if core.by_mean else core.threshold
    segmentation.find_breakpoints(core.breakpoints, core.points, scans)
    return d_mean


def detect_row(core: Core, scans: Scans, columns: Columns, row: int) -> None:
    """Definitions 1 to 7 on the sweep in a row of a batch."""
    d_mean = break_row(core, scans, row)
    segmentation.cut(core.segments, core.points, core.breakpoints, scans)
    surfaces.measure_chords(core.survey, core.points, core.segments)
    if not core.robust:
        _as_printed(core, scans)
    elif scans.has_within:
        _within_mask(core, scans)
    else:
        _as_sensors_need(core, scans)
    if core.group_gap > 0:
        objects.group_legs(core.survey, core.points, core.segments, core.group_gap)
    if core.robust:
        _settle(core)
    objects.assemble(core.description.parts, core.survey, core.points, core.segments, core.report_walls)
    description.describe(core.description, columns, core.points, core.segments, core.survey, core.bodies, core.faces)
    if columns.explained and core.robust and not scans.has_within:
        _explain(core, columns)
    near = core.points.nearest
    columns.out.nearest[row] = core.points.r[near] if near >= 0 else NAN
    columns.out.nearest_theta[row] = segmentation.bearing(core.points, near) if near >= 0 else NAN
    columns.out.d_mean[row], columns.out.sweep_d_th[row] = d_mean, core.points.d_th
    columns.out.noise[row] = core.points.sigma
    if columns.per_beam:
        write_differences(core.points, scans, columns.out.beam_s)


def _as_printed(core: Core, scans: Scans) -> None:
    """Profile `paper`: Definitions 5 to 7 as printed; a mask tells the objects in place of their edges."""
    surfaces.mark_vertices(core.points, core.segments, core.inner, core.description.extremum)
    core.faces.count = 0
    for j in range(core.segments.count):
        core.faces.offset[j] = core.faces.count
        surfaces.between(core.faces, core.points, core.segments, j, core.inner)
        core.survey.label[j] = core.bodies.label[j] = j
    core.faces.offset[core.segments.count] = core.faces.count
    surfaces.measure_extent(core.survey, core.points, core.segments, core.faces)
    if scans.has_within:
        _take_mask(core, scans)
    objects.fully_visible(core.survey, core.segments, scans.has_within)
    for j in range(core.segments.count):
        core.survey.wall[j] = core.segments.size[j] >= core.survey.min_beams and not core.survey.is_object[j]
        core.survey.thing[j] = NAN


def _take_mask(core: Core, scans: Scans) -> None:
    """Mark the segments within the mask, whose border no segment crosses."""
    for j in range(core.segments.count):
        core.survey.candidate[j] = segmentation.is_within(core.points, scans, core.segments.first[j])
        core.survey.wall[j] = False
        core.survey.thing[j] = NAN


def _within_mask(core: Core, scans: Scans) -> None:
    """Profile `robust` where the segments that belong to objects are known: no walls to look for."""
    _take_mask(core, scans)
    core.faces.count = 0
    for j in range(core.segments.count):
        core.faces.offset[j] = core.faces.count
        if core.survey.candidate[j]:
            surfaces.straight(core.faces, core.points, core.segments, j, core.segments.size[j], core.survey.tolerance[j])
    core.faces.offset[core.segments.count] = core.faces.count
    surfaces.measure_extent(core.survey, core.points, core.segments, core.faces)
    objects.join_fragments(core.bodies, core.survey, core.points, core.segments, core.survey.candidate)
    objects.known_bodies(core.survey, core.segments, core.bodies)
    for j in range(core.segments.count):
        core.survey.label[j] = core.bodies.label[j]


def _as_sensors_need(core: Core, scans: Scans) -> None:
    """Profile `robust`: the same definitions with the estimates a real sensor needs."""
    surfaces.find_faces(core.survey, core.points, core.segments, core.faces)
    objects.find_protrusions(core.protrusions, core.survey, core.points, core.segments, core.faces)
    objects.divide(core.protrusions, core.survey, core.points, core.segments, core.faces)
    surfaces.measure_extent(core.survey, core.points, core.segments, core.faces)
    objects.pieces(core.survey, core.segments)
    objects.join_fragments(core.bodies, core.survey, core.points, core.segments, core.survey.loose)
    features.gather(core.features, core.survey, core.points, core.segments, core.bodies)
    features.measure(core.features, core.survey, core.points, core.segments, core.faces, core.bodies, scans)
    verdict.decide(core.verdict, core.features)
    verdict.choose(core.survey, core.segments, core.features, core.verdict)
    for j in range(core.segments.count):
        core.survey.label[j] = core.bodies.label[j]


def _settle(core: Core) -> None:
    """Fit the faces of the objects and walls that are reported, with one vertex for each corner."""
    core.faces.count = 0
    # Where segments were divided the faces are not their own.
    own = 1 if core.protrusions.count == 0 else 0
    for j in range(core.segments.count):
        low, high = core.faces.offset[j], core.faces.offset[j + own]
        core.faces.offset[j] = core.faces.count
        if core.survey.is_object[j] or (core.report_walls and core.survey.wall[j]):
            surfaces.settled(core.faces, core.points, core.segments, j, core.survey.tolerance[j], low, high)
    core.faces.offset[core.segments.count] = core.faces.count


def _explain(core: Core, columns: Columns) -> None:
    """Write the features on which the verdict of each object was decided."""
    begin = columns.objects - core.description.parts.objects
    for k in range(core.description.parts.objects):
        body = core.features.body[core.description.parts.segment[core.description.parts.begin[k]]]
        for i in range(features.COUNT):
            value = core.features.values[body * features.COUNT + i] if body >= 0 else NAN
            columns.out.features[(begin + k) * features.COUNT + i] = value
