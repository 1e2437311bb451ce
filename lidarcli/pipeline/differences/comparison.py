"""Runs compared, each with those before it."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import pyarrow as pa

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.mapping.grid import OCCUPIED, UNKNOWN, Occupancy, TooLargeError, UnlikeError, compare
from lidarcli.formalism.matching.differences import GONE, POSES, UNCERTAIN, Compared, FoundChange, RunEvidence
from lidarcli.formalism.matching.free_space import HERE, MAX_CELLS, Nearest, SpaceMap, SpaceMotion, of_map
from lidarcli.formalism.matching.pairs import TooManyError
from lidarcli.options import choices
from lidarcli.pipeline.differences.alignment import AlignmentStep, align
from lidarcli.pipeline.differences.changes import Difference, rows_of
from lidarcli.pipeline.differences.inputs import Input, of_log, read_input
from lidarcli.pipeline.differences.runs import (
    AS_IS,
    MIN_SECONDS,
    MIN_SWEEPS,
    DiffOptions,
    ObservedRun,
    joined,
    known_or_none,
)
from lidarcli.pipeline.runs.over_logs import LogProgress
from lidarcli.reports.figures import OF_MAPS
from lidarcli.tabular.schemas import CHANGES
from lidarcli.tabular.writing import ALIGNMENT, CHANGE_FIGURES, table_metadata


def diff_inputs(inputs: Sequence[Input], options: DiffOptions, report: LogProgress | None = None) -> Difference:
    """Compare each run with those before it.

    `UnreadableError`: two do not lie on each other, do so in several manners, or slide along their walls, or as of
    `read_input`; `OptionError`: as of `read_input`, or two maps have cells of different sizes.
    """
    runs = []
    for one in inputs:
        progress = None if report is None or one.source is None else partial(report, one.source)
        runs.append(read_input(one, options, progress))
    names = Counter(each.name for each in runs)
    for one, each in zip(inputs, runs, strict=True):
        if names[each.name] > 1:
            each.name = one.text
    known: Counter[str] = Counter()
    for each in runs[1:]:
        # Rows of a run that is compared twice are told apart.
        known[each.name] += 1
        if known[each.name] > 1:
            each.name = f"{each.name} ({known[each.name]})"
    for each in runs:
        each.log = [each.name] * len(each.log)
    try:
        return _compared(inputs, runs, options)
    except TooLargeError as err:
        raise OptionError(f"the ground of all runs would reach over {err}; compare fewer of them") from err


def _compared(inputs: Sequence[Input], runs: list[ObservedRun], options: DiffOptions) -> Difference:
    """Compare runs that are read, each with those before it."""
    labels = [one.text for one in inputs]
    reference, steps, rows = runs[0], [], []
    notes = [note for each in runs for note in each.notes]
    tables = [each.run.ground is None for each in runs]
    if any(tables):
        notes.append("tables tell no free space; name the logs to learn what is gone, or new: checks of that fail")
    short = [label for label, each in zip(labels, runs, strict=True) if each.is_short]
    notes += [
        f"{label} is too short: a thing has to stand in {MIN_SWEEPS} sweeps and for {MIN_SECONDS:g} s; only structure "
        "is compared, and checks of numbers of changes fail"
        for label in short
    ]
    # Of each run so far, the latest one first.
    grounds = [(runs[0].name, runs[0].run.ground)]
    for number in range(1, len(runs)):
        now = runs[number] = _on_map(inputs[number], runs[number], runs[0], options)
        notes += now.poses
        label = labels[0] if number == 1 else "the runs before"
        step, changes = _changes(reference, now, label, labels[number], options, notes)
        rows += rows_of(changes, reference, now, step.motion, grounds)
        steps.append(step)
        if number < len(runs) - 1:
            reference, moved = _after(reference, now, changes, step.motion)
            grounds.insert(0, (now.name, moved))
    counted = Counter(row["status"] for row in rows)
    figures = {status: None if short else float(counted[status]) for status in choices.CHANGE_STATUSES}
    # What nobody could have found is not none.
    figures |= {status: None for status, blind in (("new", tables[:-1]), ("gone", tables[1:])) if any(blind)}
    figures["overlap"] = min((step.overlap for step in steps if step.overlap is not None), default=None)
    if len(runs) == 2:
        figures |= _map_figures(runs, steps[0].motion, labels)
    damage = [line for each in runs for line in each.damage]
    parameters = {**options.detect.as_dict(), "align": options.align, "min_score": options.min_score}
    metadata = table_metadata(parameters, [each.source or {"name": each.name} for each in runs], damage)
    metadata[ALIGNMENT.encode()] = json.dumps([step.alignment() for step in steps]).encode(errors="replace")
    metadata[CHANGE_FIGURES.encode()] = json.dumps(figures).encode()
    for number, row in enumerate(rows, 1):
        row["thing"] = number
    table = pa.Table.from_pylist(rows, CHANGES.with_metadata(metadata))
    return Difference(table, tuple(steps), figures, tuple(dict.fromkeys(notes)), tuple(damage))


def _changes(
    before: ObservedRun, now: ObservedRun, label: str, other: str, options: DiffOptions, notes: list[str]
) -> tuple[AlignmentStep, list[FoundChange]]:
    """Return how a run lies on those before it, and what changed; `label` and `other` are their names for people."""
    nearest = _nearest(before), _nearest(now)
    step, chance = align(before, now, nearest, options.align, label, other, notes)
    try:
        changes = Compared(before.run, now.run, step.motion, nearest, chance, options.min_score).changes()
    except TooManyError as err:
        raise UnreadableError(f"{label} and {other} differ in {err}; are they of one place?") from err
    sure = len(now.run.things) - now.unsure
    changes = [each._replace(status=UNCERTAIN, why=POSES) if each.second >= sure else each for each in changes]
    known = None if before.run.ground is None else before.run.ground.occupancy()
    return step._replace(ground=known, sensors=np.column_stack(step.motion.of(*now.run.sensors.T))), changes


def _nearest(one: ObservedRun) -> Nearest | None:
    return None if one.run.ground is None else Nearest(one.run.ground)


def _map_figures(runs: Sequence[ObservedRun], motion: SpaceMotion, labels: Sequence[str]) -> dict[str, float | None]:
    """Return how well the second of two maps shows the first; empty where one is no map."""
    true, grid = (each.grid for each in runs)
    if true is None or grid is None:
        return {}
    try:
        found = compare(_laid(grid, motion), true)
    except UnlikeError as err:
        resolution = f"make the map with --resolution {true.resolution:g}"
        raise OptionError(f"{labels[0]} and {labels[1]}: {err}; {resolution}") from err
    return {name: known_or_none(getattr(found, name)) for name in OF_MAPS}


def _on_map(one: Input, now: ObservedRun, site: ObservedRun, options: DiffOptions) -> ObservedRun:
    """Return a run as read again with poses that a map corrects; itself where they fit, or frames are taken as they are."""
    if site.grid is None or one.source is None or not now.world or now.run.ground is None or options.align == AS_IS:
        return now
    from lidarcli.pipeline.localising import given_paths, localise, read_site
    from lidarcli.pipeline.trajectories import PathOptions

    detect, motions = options.detect, [HERE]
    with suppress(UnreadableError):
        nearest = Nearest(of_map(site.grid)), Nearest(now.run.ground)
        motions.insert(0, align(site, now, nearest, options.align, "", "", [])[0].motion)
    field, paths = read_site(site.name, site.grid), PathOptions(detect.read, detect.opening, detect.poses)
    tried = []
    for motion in dict.fromkeys(motions):
        run = localise(one.source, None, paths, field, True, motion=motion, first=now.reading)
        tried.append(run)
        if run.figures()["lost"] == 0:
            break
    if now.reading is not None and now.reading.posing.is_other:
        for where in (HERE, motion):
            if (own := localise(one.source, None, paths, field, motion=where)).tells:
                break
        lines = own.lines if own.figures()["lost"] != 0 else []
        now.poses = [f"{one.text}: by the robot's own localisation {line}; compared is another path" for line in lines]
    if run.figures()["lost"] == 0:
        return now
    best = max(tried, key=lambda each: each.figures()["map_share"] or 0.0)
    if not best.table.num_rows or not best.figures()["lost"]:
        return now
    given = given_paths(best.table, f"{site.name}, corrected")
    poses = replace(detect.poses, source=None, file=None, delay=None, given=given)
    again = of_log(one.source, replace(options, detect=replace(detect, poses=poses)), None)
    again.name, again.log, again.before = now.name, [now.name] * len(again.log), now.run.ground
    again.poses = [*now.poses] + [
        f"{one.text}: {line}: placed anew where it is off, left out where it is lost" for line in best.lines
    ]
    is_lost = any(math.isnan(each.off) for path in best.paths.values() for each in path.intervals)
    if is_lost and again.run.ground is not None:
        # Places of their own: only a lost robot observed them.
        old = now.run.things
        kept = np.flatnonzero(again.run.ground.seen(old.x, old.y) == 0).tolist()
        things, yaw, lists = joined((again, range(len(again.run.things))), (now, kept))
        return replace(again, run=replace(again.run, things=things, yaw=yaw), unsure=len(kept), **lists)
    return again


def _laid(grid: Occupancy, motion: SpaceMotion) -> Occupancy:
    """Return the occupied cells of a map in other coordinates, those that none fell into as unknown."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    if motion == HERE or not len(row):
        return grid
    side = grid.resolution
    middle = np.column_stack([column + 0.5, row + 0.5]) * side + [grid.x, grid.y]
    x, y = motion.of(*middle.T)
    left, low = (math.floor(values.min() / side) for values in (x, y))
    columns = np.floor(x / side).astype(np.int64) - left
    rows = np.floor(y / side).astype(np.int64) - low
    height, width = int(rows.max()) + 1, int(columns.max()) + 1
    if height * width > MAX_CELLS:
        raise TooLargeError(f"{width * side:,.0f} x {height * side:,.0f} m")
    cells = np.full((height, width), UNKNOWN, np.int8)
    cells[rows, columns] = OCCUPIED
    return Occupancy(side, left * side, low * side, cells, grid.frame_id)


def _after(
    before: ObservedRun, now: ObservedRun, changes: Sequence[FoundChange], motion: SpaceMotion
) -> tuple[ObservedRun, SpaceMap | None]:
    """Return all runs so far as one, each place by the last run that observed it; and the occupancy of the last."""
    moved = replace(now, run=now.run.moved(motion))
    gone = {change.first for change in changes if change.status == GONE or change.second >= 0}
    kept = [k for k in range(len(before.run.things)) if k not in gone]
    things, yaw, lists = joined((before, kept), (moved, range(len(now.run.things))))
    own, old = moved.run.ground, before.run.ground
    ground = old if own is None else own if old is None else own.over(old)
    sensors = np.concatenate([before.run.sensors, moved.run.sensors])
    return ObservedRun(now.name, RunEvidence(things, yaw, ground, sensors), before.world, **lists), own
