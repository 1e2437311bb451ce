"""Overlays as recordings of rerun (.rrd): beams, objects, poses and a map as columns, seen from above."""

from __future__ import annotations

import errno
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, Occupancy
from lidarcli.overlays import viewers
from lidarcli.overlays.markers import Kind, Markers, quaternions
from lidarcli.sweeps.types import Float64, SweepBatch

try:
    import rerun
    from rerun import blueprint
except ImportError as err:
    raise OptionError("an overlay as .rrd needs rerun-sdk, which is not installed: pip install 'lidarcli[rerun]'") from err

TIMELINE = "stamp"
BEAMS = "beams"
"""Name of the entity of beams, below that of their topic."""


class Recording:
    """A recording: for each topic its poses in the world, and below them beams and objects in the frame of the sensor."""

    def __init__(self, path: Path) -> None:
        self._stream = rerun.RecordingStream("lidarcli", send_properties=False)
        if not rerun.is_enabled(self._stream):
            raise OptionError("the variable RERUN of the environment turns rerun off; take it away to write .rrd")
        self._stream.save(path)
        self._drawn: set[tuple[str, Any]] = set()
        """Entities, each with what is drawn there."""
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)
        """Corners of where most beams have ended in the world [m]."""

    def add(self, batch: SweepBatch, groups: Sequence[Markers]) -> None:
        """Append S sweeps of a topic, and their markers.

        Parameters
        ----------
        batch : sweeps with their poses; without any the sensor is the origin
        groups : markers, each message of which is one of the sweeps
        """
        name, poses = _name(batch.topic), batch.poses
        times = [rerun.TimeColumn(TIMELINE, timestamp=batch.stamps)]
        there = np.isfinite(batch.ranges)
        points = batch.points[there]
        ends = points
        if poses is not None:
            turns = quaternions(poses.yaw, poses.upside_down)
            place = _raised(np.column_stack([poses.x, poses.y]))
            columns = rerun.Transform3D.columns(translation=place, quaternion=turns)
            self._stream.send_columns(rerun.new_entity_path([name]), times, columns)
            x, y, _ = poses.to_world(np.nonzero(there)[0], points[:, 0], points[:, 1], np.zeros(len(points)))
            ends = np.column_stack([x, y])
        if len(ends):
            # A few far ends are out of sight at first.
            low, high = np.quantile(ends, [0.02, 0.98], axis=0)
            self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        path = rerun.new_entity_path([name, BEAMS])
        self._look(path, BEAMS)
        columns = rerun.Points3D.columns(positions=_raised(points)).partition(there.sum(axis=1))
        self._stream.send_columns(path, times, columns)
        for kind in Kind:
            own = [group for group in groups if group.kind is kind]
            path = rerun.new_entity_path([name, kind.value[1].decode()])
            if own:
                self._look(path, kind)
            # Where a kind has been drawn, sweeps without it are written, too: else the last ones would stay.
            if (path, kind) in self._drawn:
                self._stream.send_columns(path, times, _columns(kind, own, len(batch)))

    def _look(self, path: str, what: Any) -> None:
        """Log once what all that is drawn at an entity has in common."""
        if (path, what) in self._drawn:
            return
        self._drawn.add((path, what))
        filled = rerun.components.FillMode.TransparentFillMajorWireframe
        look: Any = None
        if what == BEAMS:
            size = rerun.Radius.ui_points(0.5 * viewers.POINT)
            look = rerun.Points3D.from_fields(colors=_rgba(viewers.BEAMS), radii=size)
        elif what is Kind.CUBE:
            look = rerun.Boxes3D.from_fields(fill_mode=filled)
        elif what is Kind.CYLINDER:
            look = rerun.Cylinders3D.from_fields(fill_mode=filled)
        elif what is Kind.LABEL:
            look = rerun.Points3D.from_fields(radii=0.0, show_labels=True)
        if look is not None:
            self._stream.log(path, look, static=True)

    def add_map(self, grid: Occupancy, z: float) -> None:
        """Add a map at a height [m]: a picture on the ground."""
        height, width = grid.cells.shape
        left, low = grid.x, grid.y
        right, high = left + width * grid.resolution, low + height * grid.resolution
        colours = np.zeros((height, width, 4), np.uint8)
        for value, colour in ((FREE, viewers.FREE), (OCCUPIED, viewers.OCCUPIED)):
            colours[grid.cells[::-1] == value] = _rgba(colour)
        picture = rerun.Mesh3D(
            vertex_positions=[[left, low, z], [right, low, z], [right, high, z], [left, high, z]],
            triangle_indices=[[0, 1, 2], [0, 2, 3]],
            vertex_texcoords=[[0, 1], [1, 1], [1, 0], [0, 0]],
            albedo_texture=colours,
        )
        self._stream.log(viewers.MAP, picture, static=True)

    def finish(self, hidden: Collection[str]) -> None:
        """Add a view from above, in which some topics are hidden at first, and close the file."""
        any_beam = np.isfinite(self._low).all()
        low, high = (self._low, self._high) if any_beam else (np.full(2, -1.0), np.ones(2))
        # rerun sees 55 degrees.
        middle, away = 0.5 * (low + high), 1.1 * float((high - low).max())
        view = blueprint.Spatial3DView(
            origin="/",
            background=_rgba(viewers.BACKGROUND),
            line_grid=False,
            eye_controls=blueprint.EyeControls3D(
                position=(*middle, away), look_target=(*middle, 0.0), eye_up=(0.0, 1.0, 0.0)
            ),
            overrides={rerun.new_entity_path([_name(topic)]): blueprint.EntityBehavior(visible=False) for topic in hidden},
        )
        panel = blueprint.TimePanel(timeline=TIMELINE, state="collapsed")
        self._stream.send_blueprint(blueprint.Blueprint(view, panel, collapse_panels=True))
        try:
            self._stream.flush()
        except RuntimeError as err:
            raise OSError(errno.EIO, f"{err}; the lines of rerun before this one say why") from err
        self._stream.disconnect()

    def abandon(self) -> None:
        """Let go of a file; what is not in it by now will not be."""
        self._stream.disconnect()


def _name(topic: str) -> str:
    """Return the name of the entity of a topic: one part, for what is below a topic moves with it.

    >>> _name("/front/scan")
    'front/scan'
    """
    return topic.strip("/") or "scan"


def _columns(kind: Kind, groups: Sequence[Markers], sweeps: int) -> Any:
    """Return the markers of one kind as columns of S rows."""

    def joined(name: str, *shape: int) -> Float64:
        return np.concatenate([np.zeros((0, *shape)), *(getattr(group, name) for group in groups)])[order]

    message = np.concatenate([np.zeros(0, np.int64), *(group.message for group in groups)])
    order = np.argsort(message, kind="stable")
    position, scale, yaw = joined("position", 3), joined("scale", 3), joined("yaw")
    colours = np.rint(255 * joined("colour", 4)).astype(np.uint8)
    turns = quaternions(yaw, np.zeros(len(yaw), bool))
    made: Any
    if kind is Kind.ARROW:
        ahead = scale[:, :1] * np.column_stack([np.cos(yaw), np.sin(yaw)])
        made = rerun.Arrows3D.columns(origins=position, vectors=_raised(ahead), colors=colours)
    elif kind is Kind.CUBE:
        made = rerun.Boxes3D.columns(centers=position, half_sizes=0.5 * scale, quaternions=turns, colors=colours)
    elif kind is Kind.CYLINDER:
        made = rerun.Cylinders3D.columns(centers=position, lengths=scale[:, 2], radii=0.5 * scale[:, 0], colors=colours)
    elif kind is Kind.LABEL:
        texts = [text.decode() for group in groups if group.text is not None for text in group.text.tolist()]
        made = rerun.Points3D.columns(positions=position, labels=[texts[row] for row in order.tolist()], colors=colours)
    else:
        lines = [_raised(line) for group in groups if group.points is not None for line in group.points]
        made = rerun.LineStrips3D.columns(
            strips=[lines[row] for row in order.tolist()], radii=0.5 * scale[:, 0], colors=colours
        )
    return made.partition(np.bincount(message, minlength=sweeps))


def _raised(points: Float64) -> Float64:
    """Return points (N, 2) in space, on the ground."""
    return np.column_stack([points, np.zeros(len(points))])


def _rgba(colour: str) -> list[int]:
    """
    >>> _rgba("#FF008020")
    [255, 0, 128, 32]
    """
    return list(bytes.fromhex(colour[1:]))
