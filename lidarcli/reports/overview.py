"""What the tables of a run say of it from above: paths of sensors, boxes of what stands, ways of what moved."""

from __future__ import annotations

import numpy as np

from lidarcli.reports.columns import Rows
from lidarcli.reports.map_picture import Box, MapPicture
from lidarcli.sweeps import Float64, Int64

COLUMNS = {
    "sweeps": ("log", "topic", "sweep", "pose_x", "pose_y"),
    "objects": ("topic", "sweep", "set", "track", "world_x", "world_y"),
    "tracks": ("topic", "track", "set", "shape", "label", "sweeps", "x", "y", "yaw", "length", "width"),
}
"""Table → columns that it is made of."""
MOST_POINTS = 2_000
"""Points of a line that are drawn; more are thinned out evenly."""
MOST_AGENTS = 200
"""Agents whose ways are drawn, those that were seen longest."""
LEAST_SWEEPS = 5
"""What stands is drawn where so many sweeps have seen it, or half of all if that is fewer."""


def paths_of(sweeps: Rows) -> list[tuple[Float64, Float64]]:
    """x and y of the sensor of each log and topic, in the order of the sweeps; none without a pose."""
    topic, _ = sweeps.words("topic")
    x, y, index = sweeps.numbers("pose_x"), sweeps.numbers("pose_y"), sweeps.integers("sweep")
    found = []
    for key in np.unique(np.column_stack([sweeps.source, topic]), axis=0):
        rows = np.flatnonzero((sweeps.source == key[0]) & (topic == key[1]) & np.isfinite(x))
        rows = _thinned(rows[np.argsort(index[rows], kind="stable")])
        if len(rows):
            found.append((x[rows], y[rows]))
    return found


def overview(sweeps: Rows, objects: Rows, tracks: Rows | None) -> MapPicture | None:
    """The run from above; None where no sweep has a pose."""
    paths = paths_of(sweeps)
    if not paths:
        return None
    boxes: list[Box] = []
    agents: list[tuple[int, Float64, Float64]] = []
    if tracks is not None:
        boxes = _boxes(sweeps, tracks)
        agents = _agents(objects, tracks)
    return MapPicture(None, paths, boxes, agents)


def _boxes(sweeps: Rows, tracks: Rows) -> list[Box]:
    """What stands, each once, where enough sweeps have seen it."""
    of_sweep, topics = sweeps.words("topic")
    of_track, names = tracks.words("topic")
    rows = [
        np.count_nonzero((sweeps.source == source) & (of_sweep == topics.index(names[code])))
        if names[code] in topics
        else 0
        for source, code in zip(tracks.source.tolist(), of_track.tolist(), strict=True)
    ]
    least = np.minimum(LEAST_SWEEPS, np.maximum(1, np.array(rows, np.int64) // 2))
    enough = tracks.integers("sweeps") >= least
    columns = {name: tracks.numbers(name) for name in ("x", "y", "yaw", "length", "width")}
    known = np.logical_and.reduce([np.isfinite(values) for values in columns.values()])
    labels, words = tracks.words("label")
    number = tracks.integers("track")
    is_round = tracks.are("shape", "round")
    return [
        Box(
            **{name: float(values[row]) for name, values in columns.items()},
            is_round=bool(is_round[row]),
            name=str(number[row]) if labels[row] < 0 else f"{number[row]} {words[labels[row]]}",
        )
        for row in np.flatnonzero(tracks.are("set", "O") & enough & known).tolist()
    ]


def _agents(objects: Rows, tracks: Rows) -> list[tuple[int, Float64, Float64]]:
    """Number, x and y of what moved: the mean of its parts in each sweep."""
    rows = np.flatnonzero(tracks.are("set", "A"))
    rows = rows[np.argsort(-tracks.integers("sweeps")[rows], kind="stable")][:MOST_AGENTS]
    x, y, track = (objects.numbers(name) for name in ("world_x", "world_y", "track"))
    sweep = objects.integers("sweep")
    code, names = objects.words("topic")
    of_track, topics = tracks.words("topic")
    numbers = tracks.integers("track")
    found = []
    for row in sorted(rows.tolist()):
        topic = topics[of_track[row]]
        mine = np.flatnonzero(
            (track == numbers[row])
            & (objects.source == tracks.source[row])
            & (code == (names.index(topic) if topic in names else -2))
            & np.isfinite(x)
        )
        if not len(mine):
            continue
        places, part, size = np.unique(sweep[mine], return_inverse=True, return_counts=True)
        kept = _thinned(np.arange(len(places)))
        way_x, way_y = (np.bincount(part, values[mine]) / size for values in (x, y))
        found.append((int(numbers[row]), way_x[kept], way_y[kept]))
    return found


def _thinned(rows: Int64) -> Int64:
    """Not more than `MOST_POINTS` of them, evenly, the last one included."""
    if len(rows) <= MOST_POINTS:
        return rows
    return rows[np.linspace(0, len(rows) - 1, MOST_POINTS).astype(np.int64)]
