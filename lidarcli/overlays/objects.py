"""Markers of the objects of some sweeps: outline, body, label, and the velocity of tracks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from lidarcli.display import palette
from lidarcli.options.choices import TRAIL
from lidarcli.overlays.markers import Kind, Markers
from lidarcli.sweeps.types import Bool, Float32, Float64, Int32, Int64, record
from lidarcli.tabular.columns import answers, are, codes, numbers, plain, values_and_mask

COLUMNS = (
    *("topic", "sweep", "object", "beam_i", "beam_f", "set", "shape", "x", "y", "box_x", "box_y", "box_length"),
    *("box_width", "box_yaw", "vertices", "track", "vx", "vy", "moving", "label", "world_x", "world_y"),
)
"""Columns of the objects table that markers need."""
PATH_COLUMNS = ("topic", "sweep", "t", "track", "frame", "x", "y", "vx", "vy", "seen")
"""Columns of the trajectories table that paths need."""

HEIGHT, MIN_SIDE = 0.2, 0.02
"""Height of every body, for a sweep has none, and the least side of a body [m]."""
LINE, TEXT = 0.02, 0.25
"""Width of outlines, and height of letters [m]."""
SOLID, CLEAR = 1.0, 0.35
"""Alpha of lines and letters, and of bodies, behind which the beams are still visible."""
PART = 1_000_000
"""Added to the id for each further object of a sweep that belongs to the same track."""
SHAFT = 0.05
"""Width of arrows [m]; a track of this speed [m/s] has an arrow as wide as long."""
UNKNOWN = "unknown"


@record
class PathPoses:
    """Poses of the sensor at S sweeps; NaN where unknown."""

    x: Float64
    y: Float64
    yaw: Float64

    def turned(self, message: Int64 | int, east: Float64, north: Float64) -> tuple[Float64, Float64]:
        """Return directions in the world in the axes of an upright sensor: ahead and left; as they are without a pose."""
        yaw = np.nan_to_num(self.yaw[message])
        cos, sin = np.cos(yaw), np.sin(yaw)
        return cos * east + sin * north, cos * north - sin * east


@record
class PathRows:
    """N rows of the trajectories of what moves, of one topic, by track and sweep."""

    track: Int64
    sweep: Int64
    seconds: Float64
    x: Float64
    y: Float64
    in_world: Bool
    is_agent: Bool
    """True from where it began to move."""
    seen: Bool
    """True where its sweep sees it."""
    by_sweep: Int64
    """(N,) the rows in the order of their sweeps."""
    newest: NDArray[np.complex128]
    """(N,) track, and the latest time of it so far [s]: in this order complex numbers are sorted."""

    @staticmethod
    def of(table: pa.Table, topic: str) -> PathRows:
        """Return those of a topic in a table with `PATH_COLUMNS`."""
        own = are(table["topic"], topic)
        names = ("track", "sweep", "t", "x", "y", "vx", "vy")
        track, sweep, seconds, x, y, vx, vy = (values_and_mask(table[name])[0] for name in names)
        moving = np.hypot(vx, vy) > 0.0
        own &= np.isin(track, np.unique(track[own & moving]))
        rows = np.flatnonzero(own)
        rows = rows[np.lexsort((sweep[rows], track[rows]))]
        in_world = are(table["frame"], "world")[rows]
        track, moving = track[rows], moving[rows]
        begin, count = np.searchsorted(track, track), np.cumsum(moving)
        is_agent = count - count[begin] + moving[begin] > 0
        seen = ~are(table["seen"], "hidden")[rows]
        sweep, seconds = sweep[rows], seconds[rows]
        order, newest = np.argsort(sweep, kind="stable"), np.maximum.accumulate(track + 1j * seconds)
        return PathRows(track, sweep, seconds, x[rows], y[rows], in_world, is_agent, seen, order, newest)

    def up_to(self, index: Int64) -> tuple[Int64, Int64, Int64, Int64]:
        """Return the rows in the last `TRAIL` seconds before sweeps (S,), which ascend, since they were hidden last.

        Returns
        -------
        (P,) the last row of each path, and its sweep, counted from 0; (K,) the path of each row, and the row
        """
        ends = np.searchsorted(self.sweep, [index[0], index[-1] + 1], sorter=self.by_sweep) if len(index) else (0, 0)
        last = self.by_sweep[slice(*ends)]
        last = last[np.isin(self.sweep[last], index)]
        since = self.seconds[last] - TRAIL
        first = np.searchsorted(self.newest, self.track[last] + 1j * since)
        count = last + 1 - first
        path = np.repeat(np.arange(len(last)), count)
        row = np.arange(len(path)) - np.repeat(np.cumsum(count) - count - first, count)
        recent = self.seconds[row] >= since[path]
        path, row = path[recent], row[recent]
        hidden, dark = np.full(len(last), -1), ~self.seen[row]
        hidden[path[dark]] = row[dark]
        seen = row > hidden[path]
        return last, np.searchsorted(index, self.sweep[last]), path[seen], row[seen]


def markers_of(rows: pa.RecordBatch, message: Int64, poses: PathPoses) -> list[Markers]:
    """Return the markers of N objects.

    Parameters
    ----------
    rows : `COLUMNS` of N rows of the objects table
    message : (N,) index of the message of each row, ascending
    poses : of the sweeps of these messages
    """
    if not rows.num_rows:
        return []
    x, y = (_place(rows, axis) for axis in "xy")
    there = np.isfinite(x) & np.isfinite(y)
    if not there.all():
        keep = np.flatnonzero(there)
        return markers_of(rows.take(plain(keep)), message[keep], poses)
    objects = _Objects(rows, message, np.column_stack([x, y]))
    return [
        *objects.outlines(),
        *objects.bodies(),
        *objects.labels(np.nan_to_num(poses.yaw[message])),
        *objects.arrows(_in_sensor_frame(rows, message, poses)),
    ]


def paths_of(trajectories: PathRows, index: Int64, poses: PathPoses, hangs: bool) -> list[Markers]:
    """Return the paths of what moves in the last `TRAIL` seconds before each of S sweeps, in the sensor frame of each.

    Parameters
    ----------
    trajectories : of the topic of these sweeps
    index : (S,) index of each sweep in the log, one message each
    hangs : whether the sensor hangs head down
    """
    last, message, path, row = trajectories.up_to(index)
    x, y = trajectories.x[row], trajectories.y[row]
    in_world, at = trajectories.in_world[last][path], message[path]
    ahead, left = poses.turned(at, x - poses.x[at], y - poses.y[at])
    points = np.column_stack([np.where(in_world, ahead, x), np.where(in_world, -left if hangs else left, y)])
    count = np.bincount(path, minlength=len(last))
    count[path[~np.isfinite(points).all(axis=1)]] = 0
    order = np.argsort(count[path], kind="stable")
    points, sizes = points[order], count[path][order]
    number = (trajectories.track[last] & 0x7FFFFFFF).astype(np.int32)
    colour = np.array([(*_of_set(name), SOLID) for name in "OA"], np.float32)[trajectories.is_agent[last].astype(int)]
    groups = []
    for length in np.unique(count[count > 1]).tolist():
        own, (first, end) = np.flatnonzero(count == length), np.searchsorted(sizes, [length, length + 1])
        lines = points[first:end].reshape(-1, length, 2)
        groups.append(_lines(Kind.PATH, message[own], number[own], colour[own], lines))
    return groups


def zone_of(number: int, action: str, corners: Float64, occupied: Bool) -> Markers:
    """Return the outline of a zone in S sweeps, one message each: wide and solid where it is occupied, else thin and pale.

    Parameters
    ----------
    number : of the zone, 1, 2, ...
    corners : (S, K, 2) in the frame of the sensor [m]; sweeps where they are not finite have no outline
    occupied : (S,)
    """
    message = np.flatnonzero(np.isfinite(corners).all(axis=(1, 2)))
    count, bright = len(message), occupied[message]
    colour = np.tile(np.array([*_rgb(palette.ZONE_COLOURS[action]), SOLID], np.float32), (count, 1))
    colour[:, 3] = np.where(bright, SOLID, CLEAR)
    # A line from one corner to the other and back looks like one.
    around = np.arange(corners.shape[1] + 1) % corners.shape[1]
    wide = np.where(bright, 3.0, 1.0)
    return _lines(Kind.ZONE, message, np.full(count, number, np.int32), colour, corners[message][:, around], wide)


def text_of(words: str, messages: int) -> Markers:
    """Return words over the sensor in each of some messages."""
    colour = np.array([*_rgb(palette.ZONE_COLOURS["stop"]), SOLID], np.float32)
    text = np.full(messages, words.encode("ascii", "replace"))
    number, zeros = np.zeros(messages, np.int32), np.zeros((messages, 3))
    scale, colours = np.full((messages, 3), 2 * TEXT), np.tile(colour, (messages, 1))
    return Markers(
        Kind.LABEL,
        np.arange(messages),
        number,
        zeros + np.array([0.0, 0.0, HEIGHT]),
        zeros[:, 0],
        scale,
        colours,
        text=text,
    )


def _lines(
    kind: Kind, message: Int64, number: Int32, colour: Float32, points: Float64, wide: Float64 | float = 1.0
) -> Markers:
    """Return M lines, `points` (M, P, 2), `wide` times as wide as an outline."""
    count = len(message)
    scale = LINE * np.broadcast_to(np.reshape(wide, (-1, 1)), (count, 3))
    return Markers(kind, message, number, np.zeros((count, 3)), np.zeros(count), scale, colour, points)


class _Objects:
    """N objects as arrays, with the values that all their markers need."""

    def __init__(self, rows: pa.RecordBatch, message: Int64, place: Float64) -> None:
        self._rows = rows
        self._message = message
        self._place = place
        self._yaw = np.nan_to_num(numbers(rows["box_yaw"]))
        sides = [numbers(rows[name]) for name in ("box_length", "box_width")]
        self._sides = np.fmin(np.fmax(np.column_stack(sides), MIN_SIDE), 1e6)
        names, shape = _coded(rows["shape"])
        self._is_round = np.array([name == "round" for name in names])[shape]
        number, self._is_tracked = values_and_mask(rows["track"])
        number = np.where(self._is_tracked, number, 0)
        objects = values_and_mask(rows["object"])[0].astype(np.int64)
        self._part = _parts(message, number, self._is_tracked)
        self._number = np.where(self._is_tracked, number, objects)
        # Where some are tracked, the numbers of the others must be none of a track.
        others = -objects if self._is_tracked.any() else objects
        wide = np.where(self._is_tracked, number + PART * self._part, others)
        self._id: Int32 = (wide & 0x7FFFFFFF if wide.max() > 0x7FFFFFFF else wide).astype(np.int32)
        self._colour = self._coloured(names, shape)

    def outlines(self) -> Iterator[Markers]:
        """Yield the outlines: the vertices and back to the first; the box where there are too few."""
        points, starts, counts = _vertices(self._rows, self._place, self._sides, self._yaw)
        for count in np.unique(counts).tolist():
            own = np.flatnonzero(counts == count)
            around = np.arange(count + 1) % count
            shown = points[starts[own, None] + around]
            zero = np.zeros((len(own), 2))
            yield self._markers(Kind.OUTLINE, own, zero, 0.0, np.full(3, LINE), SOLID, points=shown)

    def bodies(self) -> Iterator[Markers]:
        """Yield a cylinder or a box for each object."""
        is_round = self._is_round
        height = np.full((len(is_round), 1), HEIGHT)
        size = np.hstack([self._sides, height])
        # What is hidden of a round object shortens its box.
        size[is_round, :2] = self._sides[is_round].max(axis=1, keepdims=True)
        for kind, own in ((Kind.CUBE, ~is_round), (Kind.CYLINDER, is_round)):
            rows = np.flatnonzero(own)
            if len(rows):
                yield self._markers(kind, rows, self._place[rows], self._yaw[rows], size[rows], CLEAR)

    def labels(self, yaw: Float64) -> Iterator[Markers]:
        """Yield number and size of each object, and its name; once where several belong to one track.

        `yaw`: (N,) of the sensor in the world, which viewers show with x to the right
        """
        rows = np.flatnonzero(self._part == 0)
        texts = self._texts(rows)
        lengths = values_and_mask(pc.binary_length(texts))[0]
        behind = self._behind(rows, lengths, yaw[rows])
        for length in np.unique(lengths).tolist():
            own = np.flatnonzero(lengths == length)
            # Texts of one length lie one after the other.
            text = np.frombuffer(texts.take(plain(own)).buffers()[2], f"S{length}", len(own))
            size = np.full(3, TEXT)
            yield self._markers(Kind.LABEL, rows[own], behind[own], 0.0, size, SOLID, lift=HEIGHT + 0.15, text=text)

    def arrows(self, velocity: Float64) -> Iterator[Markers]:
        """Yield an arrow for each track that moves: its path in a second."""
        speed = np.hypot(*velocity.T)
        moving = np.logical_and(*values_and_mask(self._rows["moving"]))
        # A slower track would have an arrow wider than long.
        rows = np.flatnonzero(moving & (speed > SHAFT) & self._is_tracked & (self._part == 0))
        if len(rows):
            scale = np.column_stack([speed[rows], np.full((len(rows), 2), SHAFT)])
            yaw = np.arctan2(velocity[rows, 1], velocity[rows, 0])
            yield self._markers(Kind.ARROW, rows, self._place[rows], yaw, scale, SOLID, lift=HEIGHT)

    def _markers(
        self,
        kind: Kind,
        rows: NDArray[np.intp],
        place: Float64,
        yaw: Float64 | float,
        scale: Float64,
        alpha: float,
        *,
        lift: float = 0.0,
        points: Float64 | None = None,
        text: NDArray[np.bytes_] | None = None,
    ) -> Markers:
        count = len(rows)
        colour = self._colour[rows]
        if kind is Kind.LABEL:
            # Half of it white: letters are thin and lie on dark ground.
            colour = colour + 0.5 * (1 - colour)
        return Markers(
            kind,
            self._message[rows],
            self._id[rows],
            np.column_stack([place, np.full(count, lift)]),
            np.broadcast_to(yaw, count),
            np.broadcast_to(scale, (count, 3)),
            np.column_stack([colour, np.full(count, alpha, np.float32)]),
            points,
            text,
        )

    def _coloured(self, names: Sequence[str], shape: Int64) -> Float32:
        """Return (N, 3) the colour of each; `shape` (N,) are indices into `names`."""
        shapes = palette.SHAPE_COLOURS
        of_shapes = np.array([_rgb(shapes.get(name, shapes[UNKNOWN])) for name in names], np.float32)
        sets, which = _coded(self._rows["set"])
        of_sets = np.array([_of_set(name) for name in sets], np.float32)
        chosen: Float32 = np.where(self._is_tracked[:, None], of_sets[which], of_shapes[shape])
        return chosen

    def _behind(self, rows: NDArray[np.intp], letters: NDArray[Any], yaw: Float64) -> Float64:
        """Return (K, 2) positions behind some objects, as seen by the sensor, for texts of so many letters next to them."""
        place = self._place[rows]
        bearing = np.arctan2(place[:, 1], place[:, 0])
        # A letter is 0.55 times as wide as high.
        text = 0.5 * TEXT * np.column_stack([0.55 * letters, np.ones(len(rows))])
        across = np.abs(np.column_stack([np.cos(bearing + yaw), np.sin(bearing + yaw)]))
        # In the shadow of the body a label hides no other object.
        away = 0.5 * np.hypot(*self._sides[rows].T) + 0.2 + (text * across).sum(axis=1)
        behind: Float64 = place + away[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
        return behind

    def _texts(self, rows: NDArray[np.intp]) -> pa.StringArray:
        """Return number, name in the catalogue and size of some objects, as far as there are any."""
        unit, times, space = (_always(text, len(rows)) for text in (" m", " x ", " "))
        length, width = (_metres(side) for side in self._sides[rows].T)
        both = pc.binary_join_element_wise(length, width, times)
        # A side that is no more than what is drawn at least was not observed.
        known = self._sides[rows] > MIN_SIDE
        alone = (self._is_round[rows] | ~known[:, 1]).astype(np.int8)
        size = pc.if_else(answers(np.where(known[:, 0], alone, np.int8(-1))), length, both)
        number = plain(self._number[rows]).cast(pa.string())
        # RViz draws ASCII alone; the names of a catalogue are the user's.
        label = self._rows["label"].dictionary_decode().take(plain(rows))
        size = pc.binary_join_element_wise(size, unit, _always("", len(rows)))
        return pc.binary_join_element_wise(number, label, size, space, null_handling="skip")


def _always(text: str, count: int) -> pa.StringArray:
    """Return one text so many times; a scalar of Arrow would import pandas."""
    return codes(np.zeros(count, np.uint8), (text,)).dictionary_decode()


def _metres(sides: Float64) -> pa.StringArray:
    """Return lengths as text, to the centimetre."""
    hundredths, which = np.unique(np.rint(100 * sides).astype(np.int64), return_inverse=True)
    return codes(which, [f"{each / 100:.2f}" for each in hundredths.tolist()]).dictionary_decode()


def _parts(message: Int64, track: Int64, is_tracked: Bool) -> Int64:
    """Return (N,) the number of objects before each in its message and track; 0 without a track."""
    part = np.zeros(len(message), np.int64)
    rows = np.flatnonzero(is_tracked)
    order = rows[np.lexsort((rows, track[rows], message[rows]))]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(message[order]) != 0) | (np.diff(track[order]) != 0)
    place = np.arange(len(order))
    part[order] = place - np.maximum.accumulate(np.where(new, place, 0))
    return part


def _vertices(rows: pa.RecordBatch, place: Float64, sides: Float64, yaw: Float64) -> tuple[Float64, Int64, Int64]:
    """Return the corners of all outlines (P, 2), and for each of N objects the index of its first one and their number."""
    column = rows["vertices"]
    offsets = values_and_mask(column.offsets)[0].astype(np.int64)
    within = column.values
    theta, r = (numbers(within.field(k)) for k in (0, 1))
    with np.errstate(invalid="ignore"):
        points = np.column_stack([r * np.cos(theta), r * np.sin(theta)])
    starts, counts = offsets[:-1].copy(), np.diff(offsets)
    bad = np.concatenate([[0], np.cumsum(~np.isfinite(points[:, 0] + points[:, 1]))])
    boxed = np.flatnonzero((counts < 2) | (bad[offsets[1:]] > bad[offsets[:-1]]))
    if len(boxed):
        cos, sin = np.cos(yaw[boxed]), np.sin(yaw[boxed])
        along, across = 0.5 * sides[boxed].T
        corners = [
            place[boxed] + np.column_stack([cos * a - sin * b, sin * a + cos * b])
            for a, b in ((along, across), (-along, across), (-along, -across), (along, -across))
        ]
        starts[boxed] = len(points) + 4 * np.arange(len(boxed))
        counts[boxed] = 4
        points = np.concatenate([points, np.stack(corners, axis=1).reshape(-1, 2)])
    return points, starts, counts


def _in_sensor_frame(rows: pa.RecordBatch, message: Int64, poses: PathPoses) -> Float64:
    """Return (N, 2) velocity over ground in the axes of the sensor [m/s]; 0 where unknown."""
    ahead, left = poses.turned(message, *(np.nan_to_num(numbers(rows[name])) for name in ("vx", "vy")))
    # A sensor that hangs head down has its left where that of the world's is right.
    return np.column_stack([ahead, np.where(is_mirrored(rows, message, poses), -left, left)])


def is_mirrored(rows: pa.RecordBatch, message: Int64, poses: PathPoses) -> Bool:
    """Return (N,) True where an object is on the other side of the sensor in the world: the sensor hangs head down."""
    east, north = (numbers(rows[f"world_{axis}"]) - at[message] for axis, at in zip("xy", (poses.x, poses.y), strict=True))
    left = numbers(rows["box_y"])
    _, aside = poses.turned(message, east, north)
    with np.errstate(invalid="ignore"):
        mirrored: Bool = np.abs(aside + left) < np.abs(aside - left)
    return mirrored


def _place(rows: pa.RecordBatch, axis: str) -> Float64:
    """Return the centre of the box, or of the points where there is none."""
    box, mean = numbers(rows[f"box_{axis}"]), numbers(rows[axis])
    return np.where(np.isfinite(box), box, mean)


def _coded(column: pa.DictionaryArray) -> tuple[list[str], Int64]:
    """Return names, and (N,) the index of the name of each row; null is unknown."""
    names = [*column.dictionary.to_pylist(), UNKNOWN]
    code, there = values_and_mask(column.indices)
    return names, np.where(there, code, len(names) - 1)


def _of_set(name: str) -> tuple[float, ...]:
    return _rgb(palette.SET_STYLES.get(name, palette.SET_STYLES["O"])[0])


def _rgb(colour: str) -> tuple[float, ...]:
    """Return red, green and blue of the colour that takes the place of another on dark ground, each 0 to 1."""
    return tuple(part / 255 for part in bytes.fromhex(palette.on_dark(colour)[1:]))
