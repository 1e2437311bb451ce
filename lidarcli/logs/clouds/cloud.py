"""A point cloud as it lies in a message: which bytes are which coordinate, looked at by column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps import Float64

Floats = NDArray[np.floating]

NO_COORDINATES = "no x and y as float32 or float64"
OUTSIDE = "a field that is no part of its point"
TOO_FEW = "more points declared than the message holds"

_INTENSITIES = ("intensity", "intensities", "reflectivity")
"""Names of the field that says how strong a return was, the better one first."""


class BadCloudError(ValueError):
    """A message that cannot be a cloud; the text is the cause."""


class PointField(NamedTuple):
    """A number of each point."""

    offset: int
    """Bytes from where the point begins."""
    kind: str
    """As numpy spells it, without byte order: `f4`, `u2` ..."""

    @property
    def end(self) -> int:
        """Bytes from where the point begins to where it ends."""
        return self.offset + int(self.kind[1:])


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the numbers of N points stand in bytes: in rows, of which an unorganised cloud has one."""

    rows: int
    columns: int
    row_step: int
    """Bytes from row to row."""
    point_step: int
    """Bytes from point to point."""
    order: str
    """Byte order: `<` or `>`."""
    x: PointField
    y: PointField
    z: PointField | None
    """None where all points lie in the plane of the sensor."""
    intensity: PointField | None

    @classmethod
    def of(
        cls,
        shape: tuple[int, int],
        steps: tuple[int, int],
        order: str,
        fields: Mapping[str, PointField],
        size: int,
    ) -> Layout:
        """The layout that a message declares, as far as it can be believed of `size` bytes of points.

        Parameters
        ----------
        shape : rows and columns
        steps : bytes from row to row, and from point to point

        Raises
        ------
        BadCloudError
            There are no coordinates, or the points do not fit into the bytes.
        """
        x, y, z = (_coordinate(fields.get(axis)) for axis in "xyz")
        if x is None or y is None or (z is None and "z" in fields):
            raise BadCloudError(NO_COORDINATES)
        intensity = next((fields[name] for name in _INTENSITIES if name in fields), None)
        (rows, columns), (row_step, point_step) = shape, steps
        # Coordinates that share bytes would let a message declare more points than it can hold.
        if sum(axis.end - axis.offset for axis in (x, y, z) if axis is not None) > point_step:
            raise BadCloudError(OUTSIDE)
        if any(field.end > point_step for field in (x, y, z, intensity) if field is not None):
            raise BadCloudError(OUTSIDE)
        if not rows or not columns:
            return cls(0, 0, 0, point_step, order, x, y, z, intensity)
        width = columns * point_step
        # Some writers leave the step from row to row at zero, or count it otherwise: then rows follow each other.
        if row_step < width or (rows - 1) * row_step + width > size:
            row_step = width
        if (rows - 1) * row_step + width > size:
            raise BadCloudError(TOO_FEW)
        return cls(rows, columns, row_step, point_step, order, x, y, z, intensity)

    def __len__(self) -> int:
        return self.rows * self.columns


def _coordinate(field: PointField | None) -> PointField | None:
    return field if field is not None and field.kind in ("f4", "f8") else None


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """The points of one message, as they lie in it."""

    frame_id: str
    stamp_ns: int
    data: bytes
    start: int
    """Where in `data` the points begin."""
    layout: Layout
    pose: Float64 | None = None
    """(7,) x, y, z and quaternion x, y, z, w of the points' origin in the frame; None where they are one."""

    def column(self, field: PointField | None, chosen: NDArray[np.intp] | None = None) -> Floats:
        """(N,) one field of all points as float32 or, where it has more digits, float64; zeros where there is none.

        With `chosen` (K,) it is that of these points alone.
        """
        layout = self.layout
        if field is None or not len(layout):
            return np.zeros(len(layout) if chosen is None else len(chosen), np.float32)
        lying = np.ndarray(
            (layout.rows, layout.columns),
            np.dtype(layout.order + field.kind),
            self.data,
            self.start + field.offset,
            (layout.row_step, layout.point_step),
        )
        kind = np.float64 if field.kind == "f8" else np.float32
        if chosen is None:
            return np.ravel(lying.astype(kind))
        row, column = np.divmod(chosen, layout.columns)
        return lying[row, column].astype(kind)
