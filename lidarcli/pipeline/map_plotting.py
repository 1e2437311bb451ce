"""A run from above as pictures: its map, the path of its sensor, and what was found (the paper's Figs. 6 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lidarcli.choices import AS_IT_COMES, Look
from lidarcli.errors import OptionError
from lidarcli.formalism import detect
from lidarcli.formalism.detection import ROUND
from lidarcli.formalism.mapping.counts import placed
from lidarcli.formalism.mapping.occupancy import HIT
from lidarcli.newfiles import write_whole
from lidarcli.pipeline.inputs.opening import open_source
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import one_pair, read_table
from lidarcli.pipeline.mapping import MapOptions, Mapping
from lidarcli.pipeline.reading.delays import MAP
from lidarcli.pipeline.reading.reading import Reading
from lidarcli.reports.columns import Rows
from lidarcli.reports.map_picture import COLUMNS, Box, MapPicture, Snapshot, draw_map, overview
from lidarcli.stores.url import Place
from lidarcli.sweeps import Status, SweepBatch, SweepPoses


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """Pictures, and what a user should know of the reading."""

    pictures: tuple[MapPicture, ...]
    notes: tuple[str, ...]
    damage: tuple[str, ...]


def take_map(
    source: Source, options: MapOptions, sweeps: Sequence[int] | None = None, tracks: str | None = None
) -> DrawnMap:
    """The map of a log with the path of its sensor.

    Parameters
    ----------
    sweeps : a picture for each of these, with its points and the boxes of its objects; None: one of the whole run
    tracks : table of `track` beside those of the same log: what stands, and what moved

    Raises
    ------
    UnreadableError
        Nothing tells where the sensor was.
    OptionError
        A sweep is not there or has no pose, or the tables are of another log.
    """
    mapping = Mapping(options)
    summary = mapping.add(source)
    paths = [(path.x, path.y) for path in mapping.paths]
    found = None if tracks is None else _overview(tracks, source)
    whole = MapPicture(
        grid=mapping.occupancy(),
        paths=paths,
        boxes=() if found is None else found.boxes,
        agents=() if found is None else found.agents,
        title=f"{source.name}  {', '.join(mapping.worlds)}",
    )
    if sweeps is None:
        return DrawnMap((whole,), tuple(summary.notes), tuple(summary.damage))
    shots = _snapshots(source, options, sweeps)
    pictures = tuple(
        replace(whole, snapshot=shots[sweep], title=f"{source.name}  sweep {sweep}") for sweep in sweeps
    )
    return DrawnMap(pictures, tuple(summary.notes), tuple(summary.damage))


def map_bytes(picture: MapPicture, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """The picture as a PNG, SVG or PDF."""
    return draw_map(picture, suffix, look)


def write_maps(
    paths: Sequence[Place], pictures: Sequence[MapPicture], overwrite: bool, look: Look = AS_IT_COMES
) -> list[str]:
    """Write each picture to its file; notes as of `NewFiles.publish`."""
    notes: list[str] = []
    for path, picture in zip(paths, pictures, strict=True):
        notes += write_whole(path, draw_map(picture, path.suffix.lower(), look), overwrite)
    return notes


def _overview(tracks: str, source: Source) -> MapPicture:
    """What the tables of this log say of things in the world."""
    pair = one_pair(tracks)
    sweeps, objects, things = (
        Rows.join([read_table(pair, kind, COLUMNS[kind])]) for kind in ("sweeps", "objects", "tracks")
    )
    _, logs = sweeps.words("log")
    here = source.name.rpartition("/")[2]
    if logs and here not in [name.rpartition("/")[2] for name in logs]:
        raise OptionError(f"{tracks}: is of the log {logs[0]}, not of {source.label}")
    found = overview(sweeps, objects, things)
    if found is None:
        raise OptionError(f"{tracks}: its sweeps have no poses: things have no place in the world")
    return found


def _snapshots(source: Source, options: MapOptions, sweeps: Sequence[int]) -> dict[int, Snapshot]:
    """Some sweeps in the world, by their index; of several topics, those of the first that has them."""
    wanted = np.array(sorted(set(sweeps)))
    found: dict[int, Snapshot] = {}
    with (
        open_source(source, options.opening) as log,
        Reading(log, options.read, options.poses, MAP) as reading,
    ):
        for batch in reading.batches(None):
            for row in np.flatnonzero(np.isin(batch.sweep, wanted)).tolist():
                one = batch.rows(np.array([row]))
                poses = one.true_poses or one.poses
                index = int(one.sweep[0])
                if poses is not None and np.isfinite(poses.x[0]) and index not in found:
                    found[index] = _snapshot(one, poses, options)
            if len(found) == len(wanted):
                break
    if missing := [sweep for sweep in sweeps if sweep not in found]:
        raise OptionError(f"{source.label}: no sweep {missing[0]} with a pose in this log")
    return found


def _snapshot(one: SweepBatch, poses: SweepPoses, options: MapOptions) -> Snapshot:
    """One sweep in the world."""
    use = np.where(one.status == Status.VALID, HIT, 0).astype(np.uint8)
    end = placed(one, poses, use).end
    there = np.isfinite(end[0, 0])
    objects = detect(one, options.parameters)
    x, y, yaw = poses.to_world(
        objects.row, objects.box_x, objects.box_y, objects.box_yaw, objects.shares(one)
    )
    boxes = tuple(
        Box(
            float(x[k]),
            float(y[k]),
            float(yaw[k]),
            float(objects.box_length[k]),
            float(objects.box_width[k]),
            is_round=int(objects.shape[k]) == ROUND,
        )
        for k in range(len(objects))
    )
    return Snapshot(
        int(one.sweep[0]),
        float(poses.x[0]),
        float(poses.y[0]),
        float(poses.yaw[0]),
        (end[0, 0][there], end[1, 0][there]),
        boxes,
    )
