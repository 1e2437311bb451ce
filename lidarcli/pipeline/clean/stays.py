"""Objects that were static for a while, where the place was also observed free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.zones import samples, seen
from lidarcli.logs.base import Log
from lidarcli.pipeline.clean.options import CleanOptions
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.inputs.tracked import columns_of
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.pose.findings import Key
from lidarcli.sweeps.masks import Polygon
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Float64, Int64, SweepBatch, SweepPoses

FREE_SHARE, FREE_SWEEPS = 0.5, 3
"""A place is free where so much of it was in view and not hidden in so many sweeps."""
MIN_SIDE = 0.1
"""Least side of the place of an object [m]: a table on a leg is wider than the points on it."""
_PLACE = ("box_x", "box_y", "box_yaw")
_WORLD = ("world_x", "world_y", "world_yaw")


@dataclass(slots=True)
class _Stay:
    """A time in which an object was static, and how often its place was observed free before or afterwards."""

    track: int
    first: int
    last: int
    """First and last sweep of it."""
    in_world: bool
    places: Float64
    """(P, 2) samples of its place [m]."""
    free: int = 0
    run: int = 0
    """Run of the log in which it was, once its sweeps have come: the world of each is its own."""


def temporary_tracks(
    log: Log, tables: TableSet, options: CleanOptions, rules: RangeRules, posing: PoseAttacher
) -> dict[Key, Int64]:
    """Return by topic and frame the tracks of static objects whose place was also observed free, in a pass of its own."""
    stays = _stays_in(tables)
    for whole in options.sweeps(log, rules) if stays else ():
        for frame, _, batch in posing.attach(whole).by_frame():
            _observe(stays.get((whole.topic, frame), ()), batch)
    return {key: np.array([one.track for one in each if one.free >= FREE_SWEEPS], np.int64) for key, each in stays.items()}


def _observe(stays: Sequence[_Stay], batch: SweepBatch) -> None:
    """Count the sweeps of a sensor in which the places of its stays are free."""
    for one in stays:
        if one.run != batch.run and one.last >= batch.sweep[0]:
            one.run, one.free = batch.run, 0
    zero = np.zeros(len(batch))
    in_sensor = SweepPoses(zero, zero, zero, zero > 0.0)
    in_world = None if batch.poses is None else batch.poses.at_stamp()
    for one in stays:
        away = np.flatnonzero((batch.sweep < one.first) | (batch.sweep > one.last))
        poses = in_world if one.in_world else in_sensor
        if one.run != batch.run or one.free >= FREE_SWEEPS or poses is None or not len(away):
            continue
        share = seen(batch.rows(away), poses.rows(away), one.places).mean(axis=1)
        one.free += int(np.count_nonzero(share >= FREE_SHARE))


def _stays_in(tables: TableSet) -> dict[Key, list[_Stay]]:
    """Return the stays of static objects, by topic and frame."""
    names = ("topic", "frame_id", "sweep", "set", "track")
    columns = columns_of(tables, "objects", (*names, *_PLACE, "box_length", "box_width", *_WORLD))
    track, topics = columns["track"], columns["topic"]
    is_static = (track >= 0) & (columns["set"] == "O")
    found: dict[Key, list[_Stay]] = {}
    for topic in sorted(set(topics[is_static].tolist())):
        own = np.flatnonzero(is_static & (topics == topic))
        order = own[np.argsort(track[own], kind="stable")]
        for group in np.split(order, np.flatnonzero(np.diff(track[order])) + 1):
            rows = {name: column[group] for name, column in columns.items()}
            in_world = bool(np.isfinite(rows["world_x"]).all())
            shape = _median_box(*(rows[name] for name in (*(_WORLD if in_world else _PLACE), "box_length", "box_width")))
            ends = int(rows["sweep"].min()), int(rows["sweep"].max())
            stay = _Stay(int(rows["track"][0]), *ends, in_world, samples(shape))
            found.setdefault((topic, str(rows["frame_id"][0])), []).append(stay)
    return found


def _median_box(x: Float64, y: Float64, yaw: Float64, length: Float64, width: Float64) -> Polygon:
    """Return the box in the middle of boxes (N,) of one object; its sides are `MIN_SIDE` at least."""
    middle_x, middle_y = float(np.median(x)), float(np.median(y))
    # The direction of the box nearest to the middle: angles have no median.
    heading = float(yaw[int(np.argmin(np.hypot(x - middle_x, y - middle_y)))])
    along, across = (max(float(np.median(sides)), MIN_SIDE) for sides in (length, width))
    ahead = np.array([1.0, 1.0, -1.0, -1.0]) * along / 2
    left = np.array([1.0, -1.0, -1.0, 1.0]) * across / 2
    corner_x = middle_x + np.cos(heading) * ahead - np.sin(heading) * left
    corner_y = middle_y + np.sin(heading) * ahead + np.cos(heading) * left
    return Polygon(tuple(zip(corner_x.tolist(), corner_y.tolist(), strict=True)))
