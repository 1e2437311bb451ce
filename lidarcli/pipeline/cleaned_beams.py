"""Beams of a log that are to say nothing: those on agents, on what stands for a while, on the robot itself, and beside them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones.points import samples, seen
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.options import TopicChoice
from lidarcli.masks import Polygon
from lidarcli.pipeline.inputs.tables import Pair
from lidarcli.pipeline.overlay_sources import Cursor
from lidarcli.pipeline.reading.one_log import Progress
from lidarcli.pipeline.reading.pose_sources import Need, PoseOptions
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.pipeline.watching.counting import OBJECT_COLUMNS, Objects
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import Bool, Closure, Float64, Int32, Int64, Status, SweepBatch, SweepPoses
from lidarcli.tabular.arrays import held, numbers
from lidarcli.tabular.reading import read_columns
from lidarcli.tabular.schemas import SCHEMAS

REASONS = ("agents", "temporary", "body", "margin")
"""Reasons for which a beam is chosen, the first that holds; columns of the table."""
AGENTS, TEMPORARY, BODY, MARGIN = range(1, 5)
FREE_SHARE, FREE_SWEEPS = 0.5, 3
"""A place was seen free where so much of it was in view and not hidden in so many sweeps."""
LEAST_SIDE = 0.1
"""Least side of the place of a thing [m]: what stands at a leg is wider than the points on it."""


class Sweep(NamedTuple):
    """One sweep and its chosen beams."""

    stamp_ns: int
    beams: int
    chosen: NDArray[np.intp]
    """(K,) beams, ascending."""


@dataclass(slots=True)
class Chosen:
    """The chosen beams of one topic, sweep by sweep."""

    stamp_ns: list[Int64] = field(default_factory=list)
    beams: list[Int32] = field(default_factory=list)
    """(S,) beams of each sweep."""
    counts: list[Int32] = field(default_factory=list)
    """(S, 4) beams by `REASONS`."""
    beam: list[NDArray[np.intp]] = field(default_factory=list)
    """(S,) chosen beams of each sweep."""

    def __len__(self) -> int:
        return len(self.beam)

    def add(self, batch: SweepBatch, reason: NDArray[np.uint8]) -> None:
        """Take sweeps, and the reason (S, B) for each beam, 0 for none."""
        self.stamp_ns.append(batch.stamp_ns)
        self.beams.append(batch.beams)
        by_reason = [np.count_nonzero(reason == code, axis=1) for code in range(1, 5)]
        self.counts.append(np.column_stack(by_reason).astype(np.int32))
        self.beam += [np.flatnonzero(row) for row in reason]

    def settle(self) -> None:
        """Join what was added."""
        self.stamp_ns[:] = [np.concatenate([np.zeros(0, np.int64), *self.stamp_ns])]
        self.beams[:] = [np.concatenate([np.zeros(0, np.int32), *self.beams])]
        self.counts[:] = [np.concatenate([np.zeros((0, 4), np.int32), *self.counts])]

    def sweep(self, number: int) -> Sweep | None:
        """Return a sweep by its number; None where there is none."""
        if number >= len(self):
            return None
        return Sweep(int(self.stamp_ns[0][number]), int(self.beams[0][number]), self.beam[number])


@dataclass(frozen=True, slots=True)
class Choice:
    """Beams to choose."""

    topics: Collection[str] | None
    rules: RangeRules
    poses: PoseOptions
    remove: frozenset[str]
    """Of agents and temporary."""
    margin: int
    """Beams beside others that are chosen, too."""


def choose(log: Log, pair: Pair, choice: Choice, progress: Progress | None = None) -> dict[str, Chosen]:
    """Return the chosen beams of each topic by the tables of its objects.

    Raises
    ------
    UnreadableError
        A table cannot be read.
    """
    temporary = _temporary(log, pair, choice) if "temporary" in choice.remove else {}
    found: dict[str, Chosen] = {}
    cursors: dict[str, Cursor] = {}
    for batch in _batches(log, choice):
        topic = batch.topic
        if topic not in cursors:
            cursors[topic] = Cursor(pair.objects, "objects", OBJECT_COLUMNS, topic)
            found[topic] = Chosen()
        rows = cursors[topic].until(int(batch.sweep[-1]) + 1)
        objects = Objects.of(rows, batch)
        found[topic].add(batch, _reasons(batch, objects, choice, temporary.get(topic, _NO_STAYS)))
        if progress is not None:
            progress(log.position)
    for each in found.values():
        each.settle()
    return found


def _batches(log: Log, choice: Choice) -> Iterator[SweepBatch]:
    """Yield all sweeps; the pass that makes the tables reports the damage."""
    read = ReadOptions(choice.topics, rules=choice.rules)
    yield from read_batches(log, read, ReadReport(), TopicChoice(choice.topics, log.topics()))


def _reasons(batch: SweepBatch, objects: Objects, choice: Choice, temporary: _Stays) -> NDArray[np.uint8]:
    """Return the reason (S, B) for which each beam is chosen, 0 for none."""
    valid = batch.status == Status.VALID
    owner = objects.owners(batch)
    is_agent = np.append(objects.set == SETS.index("A"), False)
    is_temporary = np.append(temporary.hold(objects, batch), False)
    reason = np.zeros(valid.shape, np.uint8)
    reason[batch.status == Status.MASKED] = BODY
    reason[valid & is_temporary[owner]] = TEMPORARY
    if "agents" in choice.remove:
        reason[valid & is_agent[owner]] = AGENTS
    beside = _beside(batch, reason > 0, choice.margin)
    reason[beside & valid & (reason == 0)] = MARGIN
    return reason


def _beside(batch: SweepBatch, chosen: Bool, margin: int) -> Bool:
    """Return the beams (S, B) that are so near to chosen ones; of a full turn the last is beside the first."""
    found = chosen.copy()
    row, beam = np.nonzero(chosen)
    count, turns = batch.beams[row], batch.closure[row] != Closure.OPEN
    for step in range(1, margin + 1):
        for beside in (beam - step, beam + step):
            within = (beside >= 0) & (beside < count)
            kept = within | turns
            found[row[kept], beside[kept] % np.maximum(count[kept], 1)] = True
    return found


class _Stays(NamedTuple):
    """Tracks that stood where the place was also seen free."""

    track: Int64
    """(N,) ascending."""

    def hold(self, objects: Objects, batch: SweepBatch) -> Bool:
        """Return which objects (K,) are such things, standing."""
        stands = (objects.set == SETS.index("O")) & (objects.track >= 0)
        found: Bool = stands & np.isin(objects.track, self.track)
        return found


_NO_STAYS = _Stays(np.zeros(0, np.int64))
_COLUMNS = (
    *("topic", "sweep", "set", "track", "box_x", "box_y", "box_length", "box_width", "box_yaw"),
    *("world_x", "world_y", "world_yaw"),
)


@dataclass(slots=True)
class _Stay:
    """A thing that stood, and how often its place was seen free before or afterwards."""

    track: int
    first: int
    last: int
    """Sweeps in which it stood first and last."""
    in_world: bool
    places: Float64
    """(P, 2) samples of its place [m]."""
    free: int = 0


def _temporary(log: Log, pair: Pair, choice: Choice) -> dict[str, _Stays]:
    """Return by topic the tracks that stood where the place was also seen free, in a pass of its own."""
    stays = _stood(pair)
    if not stays:
        return {}
    topics = TopicChoice(choice.topics, log.topics())
    posing = Posing.of(log, choice.poses, topics, choice.rules, need=Need.MOVING)
    for batch in _batches(log, choice):
        mine = [one for one in stays.get(batch.topic, ()) if one.free < FREE_SWEEPS]
        if not mine:
            continue
        batch = posing.attach(batch)
        world = None if batch.poses is None else batch.poses.at_stamp()
        zero = np.zeros(len(batch))
        sensor = SweepPoses(zero, zero, zero, np.zeros(len(batch), np.bool_))
        for one in mine:
            away = (batch.sweep < one.first) | (batch.sweep > one.last)
            place = world if one.in_world else sensor
            if place is None or not away.any():
                continue
            rows = np.flatnonzero(away)
            some = batch.rows(rows)
            share = seen(some, place.rows(rows), one.places).mean(axis=1)
            one.free += int(np.count_nonzero(share >= FREE_SHARE))
    return {
        topic: _Stays(np.array(sorted(one.track for one in each if one.free >= FREE_SWEEPS), np.int64))
        for topic, each in stays.items()
    }


def _stood(pair: Pair) -> dict[str, list[_Stay]]:
    """Return where tracks stood, by topic."""
    rows = read_columns(pair.objects, "objects", SCHEMAS["objects"], _COLUMNS)
    track, there = held(rows["track"])
    letters, topics = (_names(rows[name]) for name in ("set", "topic"))
    stood = there & (letters == "O")
    found: dict[str, list[_Stay]] = {}
    sweep = np.asarray(rows["sweep"])
    columns = {name: numbers(rows[name]) for name in _COLUMNS[4:]}
    for topic in sorted(set(topics[stood].tolist())):
        mine = np.flatnonzero(stood & (topics == topic))
        order = mine[np.argsort(track[mine], kind="stable")]
        for group in np.split(order, np.flatnonzero(np.diff(track[order])) + 1):
            values = {name: column[group] for name, column in columns.items()}
            in_world = bool(np.isfinite(values["world_x"]).all())
            names = ("world_x", "world_y", "world_yaw") if in_world else ("box_x", "box_y", "box_yaw")
            x, y = (float(np.median(values[name])) for name in names[:2])
            # The direction of the box nearest to the middle: angles have no median.
            nearest = int(np.argmin(np.hypot(values[names[0]] - x, values[names[1]] - y)))
            yaw = float(values[names[2]][nearest])
            sides = (float(np.median(values[name])) for name in ("box_length", "box_width"))
            length, width = (max(side, LEAST_SIDE) for side in sides)
            ahead, left = (
                np.array([1.0, 1.0, -1.0, -1.0]) * length / 2,
                np.array([1.0, -1.0, -1.0, 1.0]) * width / 2,
            )
            corners = np.column_stack(
                [
                    x + np.cos(yaw) * ahead - np.sin(yaw) * left,
                    y + np.sin(yaw) * ahead + np.cos(yaw) * left,
                ]
            )
            shape = Polygon(tuple((float(a), float(b)) for a, b in corners))
            found.setdefault(topic, []).append(
                _Stay(
                    int(track[group[0]]),
                    int(sweep[group].min()),
                    int(sweep[group].max()),
                    in_world,
                    samples(shape),
                )
            )
    return found


def _names(column: pa.ChunkedArray) -> NDArray[np.str_]:
    """Return a column of names as text."""
    whole = column.unify_dictionaries().combine_chunks()
    if not len(whole):
        return np.zeros(0, np.str_)
    words: NDArray[np.str_] = np.array(whole.dictionary.to_pylist())[np.asarray(whole.indices)]
    return words
