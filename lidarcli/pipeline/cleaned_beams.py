"""Beams of a log that are to say nothing: on agents, on what stands for a while, on the robot, and beside them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lidarcli.formalism.detection import SETS
from lidarcli.formalism.tracking.results import HIDDEN, VIEWS
from lidarcli.formalism.zones import samples, seen
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.options import TopicChoice
from lidarcli.masks import Polygon
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.reading.one_log import Progress
from lidarcli.pipeline.reading.pose_sources import Need, PoseOptions
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.pipeline.zone_counting import OBJECT_COLUMNS, Objects
from lidarcli.pose.faults import Key
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import Bool, Closure, Float64, Int32, Int64, Status, SweepBatch, SweepPoses
from lidarcli.tabular.columns import held, numbers
from lidarcli.tabular.reading import TopicRows, read_columns
from lidarcli.tabular.schemas import SCHEMAS
from lidarcli.zone import WORLD

REASONS = ("agents", "temporary", "body", "margin")
"""Reasons for which a beam is chosen, the first that holds; columns of the table."""
AGENTS, TEMPORARY, BODY, MARGIN = range(1, 5)
FREE_SHARE, FREE_SWEEPS = 0.5, 3
"""A place was seen free where so much of it was in view and not hidden in so many sweeps."""
REACH, AROUND = 0.45, 0.1
"""A piece belongs to an agent if it ends so near to its middle [m], or so near to its box if that is larger."""
LINK = 0.1
"""Greatest step in range between beams of one piece [m], beside what its slant takes."""
MOST_SD = 0.3
"""Greatest standard deviation of a place of an agent that tells where its beams are [m]."""
SECOND_NS = 1_000_000_000
"""Time in which the path of an agent tells that it is on its way [ns]."""
LEAST_SPEED, MOVING_SDS = 0.1, 2.0
"""Least speed of what is on its way [m/s], and least way in standard deviations."""
PAIRS = 256
"""Places of agents that are looked at together."""
LEAST_SIDE = 0.1
"""Least side of the place of a thing [m]: what stands at a leg is wider than the points on it."""
CELL, OFTEN, MOSTLY = 0.12, 0.1, 0.8
"""Cells of such a size [m] are always the same few places of a thing, which is seen mostly in these, and often in each."""
LONG, MOST_HIDDEN, MOST_DOUBTED = 3.0, 0.5, 0.2
"""A track so long [s] is doubted if it is hidden in such a share of its sweeps; a note tells of such a share of beams."""
_NONE = np.zeros(0, np.int64)


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


def choose(log: Log, pair: TableSet, choice: Choice, progress: Progress | None = None) -> dict[str, Chosen]:
    """Return the chosen beams of each topic by the tables of its objects.

    Raises
    ------
    UnreadableError
        A table cannot be read.
    """
    temporary = _temporary(log, pair, choice) if "temporary" in choice.remove else {}
    agents = _agents(pair) if "agents" in choice.remove else {}
    found: dict[str, Chosen] = {}
    cursors: dict[str, TopicRows] = {}
    for batch in _batches(log, choice):
        topic = batch.topic
        if topic not in cursors:
            cursors[topic] = TopicRows(pair.objects, "objects", OBJECT_COLUMNS, topic)
            found[topic] = Chosen()
        rows = cursors[topic].until(int(batch.sweep[-1]) + 1)
        objects = Objects.of(rows, batch)
        reason = np.zeros(batch.ranges.shape, np.uint8)
        for frame, at, mine in batch.by_frame():
            key = topic, frame
            held_by = temporary.get(key, _NO_STAYS)
            reason[at] = _reasons(mine, objects.of_rows(at), choice, held_by, agents.get(key))
        found[topic].add(batch, reason)
        if progress is not None:
            progress(log.position)
    for each in found.values():
        each.settle()
    return found


def _batches(log: Log, choice: Choice) -> Iterator[SweepBatch]:
    """Yield all sweeps; the pass that makes the tables reports the damage."""
    read = ReadOptions(choice.topics, rules=choice.rules)
    yield from read_batches(log, read, ReadReport(), TopicChoice(choice.topics, log.topics()))


def _reasons(
    batch: SweepBatch, objects: Objects, choice: Choice, temporary: _Stays, agents: _Agents | None
) -> NDArray[np.uint8]:
    """Return the reason (S, B) for which each beam is chosen, 0 for none."""
    valid = batch.status == Status.VALID
    owner = objects.owners(batch)
    is_agent = objects.set == SETS.index("A")
    if agents is not None:
        is_agent |= agents.tracks.hold(objects, batch)
    is_temporary = np.append(temporary.hold(objects, batch), False)
    reason = np.zeros(valid.shape, np.uint8)
    reason[batch.status == Status.MASKED] = BODY
    reason[valid & is_temporary[owner]] = TEMPORARY
    if "agents" in choice.remove:
        reason[valid & np.append(is_agent, False)[owner]] = AGENTS
        if agents is not None:
            # What stands is no part of who passes by.
            is_thing = np.append(~is_agent & (objects.set == SETS.index("O")) & (objects.track >= 0), False)
            reason[agents.of(batch).pieces(batch) & ~is_thing[owner] & (reason != BODY)] = AGENTS
    beside = _beside(batch, reason > 0, choice.margin)
    reason[beside & valid & (reason == 0)] = MARGIN
    return reason


def _beside(batch: SweepBatch, chosen: Bool, margin: int) -> Bool:
    """Return the beams (S, B) that are so near to chosen ones; of a full turn the last is beside the first."""
    beam = np.arange(chosen.shape[1])
    far = margin + 2 * len(beam) + 1
    # The chosen ones next to each beam, on both sides; behind the last beam of a full turn comes the first chosen one.
    before, after = np.where(chosen, beam, -far), np.where(chosen, beam, far)
    turn = np.where(batch.closure == Closure.OPEN, far, batch.beams)[:, None]
    last = before.max(axis=1, keepdims=True, initial=-far) - turn
    first = after.min(axis=1, keepdims=True, initial=far) + turn
    before = np.maximum(np.maximum.accumulate(before, axis=1), last)
    after = np.minimum(np.minimum.accumulate(after[:, ::-1], axis=1)[:, ::-1], first)
    beside: Bool = np.minimum(beam - before, after - beam) <= margin
    return beside & (beam < batch.beams[:, None])


class _Places(NamedTuple):
    """Places (P) of agents in sweeps of a batch, in the frame of the sensor."""

    row: Int64
    x: Float64
    y: Float64
    radius: Float64

    def pieces(self, batch: SweepBatch) -> Bool:
        """Return the beams (S, B) on pieces that end within the reach of an agent as a whole.

        A leg far away has too few beams for an object; of a wall only a part is within reach.
        """
        found = np.zeros(batch.ranges.shape, np.bool_)
        for first in range(0, len(self.row), PAIRS):
            part = slice(first, first + PAIRS)
            some = _Places(self.row[part], self.x[part], self.y[part], self.radius[part])
            pair, beam = np.nonzero(some._whole_pieces(batch.rows(some.row)))
            found[some.row[pair], beam] = True
        return found

    def _whole_pieces(self, batch: SweepBatch) -> Bool:
        """Return the beams (P, B) by place; `batch` has the sweep of each."""
        valid = batch.status == Status.VALID
        ranges = np.where(valid, batch.ranges, np.float32(np.nan)).astype(np.float64)
        bearing = batch.bearings()
        x, y = ranges * np.cos(bearing), ranges * np.sin(bearing)
        slant = 2.0 * np.abs(batch.angle_increment)[:, None] * ranges
        with np.errstate(invalid="ignore"):
            inside = np.hypot(x - self.x[:, None], y - self.y[:, None]) <= self.radius[:, None]
            joined = np.abs(ranges - np.roll(ranges, 1, axis=1)) <= LINK + slant
        begins = ~joined
        begins[:, 0] = True
        piece = np.cumsum(begins, axis=1) - 1
        # Of a full turn the last piece may go on in the first.
        seam = joined[:, 0] & (batch.closure != Closure.OPEN)
        piece = np.where((piece == piece[:, -1:]) & seam[:, None], 0, piece)
        number = piece + np.arange(len(piece))[:, None] * (batch.width + 1)
        beams = np.bincount(number.ravel(), valid.ravel())
        within = np.bincount(number.ravel(), inside.ravel())
        whole: Bool = inside & (within >= beams)[number]
        return whole


class _Since(NamedTuple):
    """Tracks whose objects are left out, and from which sweeps on."""

    track: Int64
    """(N,) ascending."""
    sweep: Int64

    def hold(self, objects: Objects, batch: SweepBatch) -> Bool:
        """Return which objects (K,) are of these tracks by then."""
        if not len(self.track):
            return np.zeros(len(objects.track), np.bool_)
        at = np.minimum(np.searchsorted(self.track, objects.track), len(self.track) - 1)
        found: Bool = (self.track[at] == objects.track) & (batch.sweep[objects.row] >= self.sweep[at])
        return found


@dataclass(frozen=True, slots=True)
class _Agents:
    """Places (N) of the agents of a topic by sweep, from when on they are on their way."""

    sweep: Int64
    """(N,) ascending."""
    x: Float64
    y: Float64
    radius: Float64
    in_world: Bool
    tracks: _Since
    """Their tracks, and those of parts of them."""
    sweeps: Int64
    """(S,) sweeps of the topic, and the pose (S, 3) of the sensor in each."""
    pose: Float64
    mirrored: bool
    """True where the sensor hangs head down."""

    def of(self, batch: SweepBatch) -> _Places:
        """Return the places of agents in some sweeps."""
        first, after = np.searchsorted(self.sweep, [batch.sweep[0], batch.sweep[-1] + 1])
        mine = slice(first, after)
        sweep, x, y = self.sweep[mine], self.x[mine], self.y[mine]
        at = np.minimum(np.searchsorted(self.sweeps, sweep), len(self.sweeps) - 1)
        pose = self.pose[at]
        dx, dy = x - pose[:, 0], y - pose[:, 1]
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        left = cos * dy - sin * dx
        here_x = np.where(self.in_world[mine], cos * dx + sin * dy, x)
        here_y = np.where(self.in_world[mine], -left if self.mirrored else left, y)
        row = np.minimum(np.searchsorted(batch.sweep, sweep), len(batch) - 1)
        there = np.isfinite(here_x) & (batch.sweep[row] == sweep)
        return _Places(row[there], here_x[there], here_y[there], self.radius[mine][there])


class _Paths(NamedTuple):
    """Trajectories (N) of one topic, those of a track one after the other in the order of time."""

    track: Int64
    sweep: Int64
    stamp_ns: Int64
    x: Float64
    y: Float64
    sd: Float64
    """(N,) the greater standard deviation of the place [m]."""
    in_world: Bool
    hidden: Bool

    def of(self, track: int) -> slice:
        """Return the rows of a track."""
        first, after = np.searchsorted(self.track, [track, track + 1])
        return slice(int(first), int(after))


class _Track(NamedTuple):
    """A track of one topic."""

    number: int
    moves: bool
    moved_at_ns: int
    half: float
    """Half of its diagonal [m], 0 where it is not known."""

    @property
    def reach(self) -> float:
        """Distance from its middle in which pieces belong to it [m]."""
        return max(REACH, self.half + AROUND)


def _agents(pair: TableSet) -> dict[Key, _Agents]:
    """Return where agents are, by topic and frame, hidden or not."""
    found = {}
    paths = _paths(pair)
    for (topic, frame), tracks in _tracks(pair).items():
        if topic in paths and any(each.moves for each in tracks):
            found[topic, frame] = _agents_of(tracks, paths[topic], *_sensor(pair, topic, frame))
    return found


def _tracks(pair: TableSet) -> dict[Key, list[_Track]]:
    """Return the tracks of each topic and frame by number."""
    columns = ("topic", "frame_id", "track", "set", "moved_at", "length", "width")
    rows = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], columns)
    moves = _names(rows["set"]) == "A"
    moved_at, _ = held(rows["moved_at"].cast(pa.int64()))
    half = 0.5 * np.hypot(*(np.nan_to_num(numbers(rows[name])) for name in ("length", "width")))
    names = (_names(rows[name]) for name in ("topic", "frame_id"))
    values = (*names, np.asarray(rows["track"]), moves, moved_at, half)
    found: dict[Key, list[_Track]] = {}
    for topic, frame, *track in zip(*(each.tolist() for each in values), strict=True):
        found.setdefault((topic, frame), []).append(_Track(*track))
    return {key: sorted(tracks) for key, tracks in found.items()}


def _paths(pair: TableSet) -> dict[str, _Paths]:
    """Return the trajectories of each topic."""
    columns = ("topic", "track", "sweep", "stamp", "frame", "x", "y", "x_sd", "y_sd", "seen")
    rows = read_columns(pair.trajectories, "trajectories", SCHEMAS["trajectories"], columns)
    topics = _names(rows["topic"])
    whole = _Paths(
        np.asarray(rows["track"]),
        np.asarray(rows["sweep"]),
        np.asarray(rows["stamp"].cast(pa.int64())),
        numbers(rows["x"]),
        numbers(rows["y"]),
        np.maximum(numbers(rows["x_sd"]), numbers(rows["y_sd"])),
        _names(rows["frame"]) == WORLD,
        _names(rows["seen"]) == VIEWS[HIDDEN],
    )
    order = np.lexsort((whole.sweep, whole.track))
    found = {}
    for topic in np.unique(topics).tolist():
        mine = order[topics[order] == topic]
        found[topic] = _Paths(*(values[mine] for values in whole))
    return found


def _agents_of(tracks: list[_Track], paths: _Paths, sweeps: Int64, pose: Float64, mirrored: bool) -> _Agents:
    """Return the agents of a topic; `sweeps`, `pose` and `mirrored` as of `_sensor`."""
    since: dict[int, int] = {}
    rows, radius = [_NONE], [np.zeros(0)]
    for track in tracks:
        mine = paths.of(track.number)
        count = mine.stop - mine.start
        if not track.moves or not count:
            continue
        onset = int(np.searchsorted(paths.stamp_ns[mine], track.moved_at_ns))
        onset = mine.start + min(onset, count - 1)
        first = _sets_out(paths, slice(mine.start, onset))
        since[track.number] = int(paths.sweep[first])
        sure = first + np.flatnonzero(paths.sd[first : mine.stop] <= MOST_SD)
        rows.append(sure)
        radius.append(np.full(len(sure), track.reach))
    begun = np.array([sweep for sweep, some in zip(since.values(), rows[1:], strict=True) if len(some)], np.int64)
    ends = [(some[-1], reach[-1]) for some, reach in zip(rows, radius, strict=True) if len(some)]
    last = _Reach(np.array([row for row, _ in ends], np.int64), np.array([reach for _, reach in ends]))
    at, reach = np.concatenate(rows), np.concatenate(radius)
    order = np.argsort(paths.sweep[at], kind="stable")
    at, reach = at[order], reach[order]
    for track in tracks:
        if not track.moves and _came_along(track, paths, _Reach(at, reach), last, begun):
            since[track.number] = 0
    numbers_of = np.array(sorted(since), np.int64)
    return _Agents(
        paths.sweep[at],
        paths.x[at],
        paths.y[at],
        reach,
        paths.in_world[at],
        _Since(numbers_of, np.array([since[number] for number in numbers_of.tolist()], np.int64)),
        sweeps,
        pose,
        mirrored,
    )


def _sets_out(paths: _Paths, rows: slice) -> int:
    """Return the row in which an agent sets out, among those of its path up to its onset.

    At its onset it is off its first place by more than its size. Its smoothed path tells that it was on its way before:
    within a second it went further than the noise of both places.
    """
    first: int = rows.start
    if first == rows.stop:
        return first
    x, y, var, stamp_ns = paths.x[rows], paths.y[rows], paths.sd[rows] ** 2, paths.stamp_ns[rows]
    before = np.searchsorted(stamp_ns, stamp_ns - SECOND_NS)
    way = np.hypot(x - x[before], y - y[before])
    least = LEAST_SPEED * 1e-9 * (stamp_ns - stamp_ns[before])
    stands = np.flatnonzero(~(way > np.maximum(least, MOVING_SDS * np.sqrt(var + var[before]))))[-1]
    # What is on its way so soon after it was first seen was so before.
    return first if before[stands] == 0 else first + int(stands)


class _Reach(NamedTuple):
    """Rows (N) of the paths of agents, ascending by sweep, and how far pieces of them are from there."""

    row: Int64
    radius: Float64
    """[m]"""


def _came_along(track: _Track, paths: _Paths, agents: _Reach, ends: _Reach, since: Int64) -> bool:
    """Return whether a thing is part of an agent, or an agent that came to stand there.

    What stands is also seen while no agent is within reach. Of an agent that stops, the track may end, and a new one begin.

    Parameters
    ----------
    track : the thing
    agents : all places of agents
    ends, since : (A,) last places of agents, and the sweeps from which on they are agents
    """
    mine = paths.of(track.number)
    rows = np.arange(mine.start, mine.stop)[~paths.hidden[mine]]
    # Most things are seen without agents at first.
    if not len(rows):
        return False
    first = rows[0]
    over = np.hypot(paths.x[ends.row] - paths.x[first], paths.y[ends.row] - paths.y[first]) + track.half
    left = (over <= ends.radius) & (since < paths.sweep[first])
    left &= paths.stamp_ns[ends.row] >= paths.stamp_ns[first] - SECOND_NS
    if not left.any() and not _with_agents(rows[:1], track.half, paths, agents).all():
        return False
    inside = _with_agents(rows, track.half, paths, agents)
    last = paths.sweep[ends.row[left]]
    return bool(inside.all()) or any(inside[paths.sweep[rows] <= end].all() for end in last.tolist())


def _with_agents(rows: Int64, half: float, paths: _Paths, agents: _Reach) -> Bool:
    """Return whether in rows (K,) of the path of a thing all of it is within the reach of an agent."""
    sweep = paths.sweep[agents.row]
    first, after = (np.searchsorted(sweep, paths.sweep[rows], side) for side in ("left", "right"))
    count = after - first
    which = np.repeat(np.arange(len(rows)), count)
    agent = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + first[which]
    there, here = agents.row[agent], rows[which]
    over = np.hypot(paths.x[there] - paths.x[here], paths.y[there] - paths.y[here]) + half
    inside: Bool = np.bincount(which, over <= agents.radius[agent], len(rows)) > 0
    return inside


def _sensor(pair: TableSet, topic: str, frame: str) -> tuple[Int64, Float64, bool]:
    """Return the sweeps of a sensor, its pose (S, 3) in each, and whether it hangs head down."""
    names = ("pose_x", "pose_y", "pose_yaw")
    rows = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ("topic", "frame_id", "sweep", *names))
    mine = (_names(rows["topic"]) == topic) & (_names(rows["frame_id"]) == frame)
    sweep = np.asarray(rows["sweep"])[mine]
    pose = np.column_stack([numbers(rows[name])[mine] for name in names])
    columns = ("topic", "frame_id", "sweep", "box_x", "box_y", "world_x", "world_y")
    objects = read_columns(pair.objects, "objects", SCHEMAS["objects"], columns)
    here = (_names(objects["topic"]) == topic) & (_names(objects["frame_id"]) == frame)
    x, y, world_x, world_y = (numbers(objects[name])[here] for name in columns[3:])
    at = np.minimum(np.searchsorted(sweep, np.asarray(objects["sweep"])[here]), max(len(sweep) - 1, 0))
    if not len(x):
        return sweep, pose, False
    dx, dy, yaw = world_x - pose[at, 0], world_y - pose[at, 1], pose[at, 2]
    left = np.cos(yaw) * dy - np.sin(yaw) * dx
    with np.errstate(invalid="ignore"):
        flipped = np.abs(left + y) < np.abs(left - y)
    return sweep, pose, 2 * int(np.count_nonzero(flipped)) > len(x)


def doubted(pair: TableSet) -> list[str]:
    """Return notes on agents that may be none, by topic: the robot itself, and what was hidden for most of its time."""
    names = ("box_x", "box_y", "world_x", "world_y")
    rows = read_columns(pair.objects, "objects", SCHEMAS["objects"], ("topic", "track", "set", "beams", *names))
    its = ("topic", "track", "sweeps", "first_sweep", "last_sweep", "duration")
    tracks = read_columns(pair.tracks, "tracks", SCHEMAS["tracks"], its).to_pylist()
    hidden = set()
    for row in tracks:
        sweeps = row["last_sweep"] + 1 - row["first_sweep"]
        if row["duration"] >= LONG and sweeps - row["sweeps"] > MOST_HIDDEN * sweeps:
            hidden.add((row["topic"], row["track"]))
    topics, agents = _names(rows["topic"]), _names(rows["set"]) == "A"
    (track, _), beams = held(rows["track"]), numbers(rows["beams"])
    places = np.column_stack([numbers(rows[name]) for name in names])
    lines = []
    for topic in np.unique(topics).tolist():
        mine = np.flatnonzero(agents & (topics == topic))
        mine = mine[np.argsort(track[mine], kind="stable")]
        on_robot = on_hidden = 0
        for some in np.split(mine, np.flatnonzero(np.diff(track[mine])) + 1) if len(mine) else ():
            count = int(beams[some].sum())
            if _stays(places[some, :2]) and np.isfinite(places[some]).all() and not _stays(places[some, 2:]):
                on_robot += count
            elif (topic, int(track[some[0]])) in hidden:
                on_hidden += count
        every = int(beams[mine].sum())
        if on_robot:
            lines.append(
                f"{topic}: {on_robot / every:.0%} of the beams on agents always end at the same places before the sensor: "
                "the robot's own body? (--mask auto)"
            )
        if on_hidden > MOST_DOUBTED * (every - on_robot):
            lines.append(
                f"{topic}: {on_hidden / every:.0%} of the beams on agents are on what was hidden for most of its time: "
                "furniture that seems to move? (docs/clean.md)"
            )
    return lines


def _stays(places: Float64) -> bool:
    """Return whether places (N, 2) are nearly all the same few."""
    _, counts = np.unique(np.floor(places / CELL), axis=0, return_counts=True)
    return int(counts[counts >= OFTEN * len(places)].sum()) >= MOSTLY * len(places)


class _Stays(NamedTuple):
    """Tracks that stood where the place was also seen free."""

    track: Int64
    """(N,) ascending."""

    def hold(self, objects: Objects, batch: SweepBatch) -> Bool:
        """Return which objects (K,) are such things, standing."""
        stands = (objects.set == SETS.index("O")) & (objects.track >= 0)
        found: Bool = stands & np.isin(objects.track, self.track)
        return found


_NO_STAYS = _Stays(_NONE)
_COLUMNS = (
    *("topic", "frame_id", "sweep", "set", "track", "box_x", "box_y", "box_length", "box_width", "box_yaw"),
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


def _temporary(log: Log, pair: TableSet, choice: Choice) -> dict[Key, _Stays]:
    """Return by topic and frame the tracks that stood where the place was also seen free, in a pass of its own."""
    stays = _stood(pair)
    if not stays:
        return {}
    topics = TopicChoice(choice.topics, log.topics())
    posing = Posing.of(log, choice.poses, topics, choice.rules, need=Need.MOVING)
    sensors = (
        ((whole.topic, frame), batch)
        for whole in _batches(log, choice)
        for frame, _, batch in posing.attach(whole).by_frame()
    )
    for key, batch in sensors:
        mine = [one for one in stays.get(key, ()) if one.free < FREE_SWEEPS]
        if not mine:
            continue
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
        key: _Stays(np.array(sorted(one.track for one in each if one.free >= FREE_SWEEPS), np.int64))
        for key, each in stays.items()
    }


def _stood(pair: TableSet) -> dict[Key, list[_Stay]]:
    """Return where tracks stood, by topic and frame."""
    rows = read_columns(pair.objects, "objects", SCHEMAS["objects"], _COLUMNS)
    track, there = held(rows["track"])
    letters, topics, frames = (_names(rows[name]) for name in ("set", "topic", "frame_id"))
    stood = there & (letters == "O")
    found: dict[Key, list[_Stay]] = {}
    sweep = np.asarray(rows["sweep"])
    columns = {name: numbers(rows[name]) for name in _COLUMNS[5:]}
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
            ahead = np.array([1.0, 1.0, -1.0, -1.0]) * length / 2
            left = np.array([1.0, -1.0, -1.0, 1.0]) * width / 2
            corners = np.column_stack(
                [x + np.cos(yaw) * ahead - np.sin(yaw) * left, y + np.sin(yaw) * ahead + np.cos(yaw) * left]
            )
            shape = Polygon(tuple((float(a), float(b)) for a, b in corners))
            found.setdefault((topic, str(frames[group[0]])), []).append(
                _Stay(int(track[group[0]]), int(sweep[group].min()), int(sweep[group].max()), in_world, samples(shape))
            )
    return found


def _names(column: pa.ChunkedArray) -> NDArray[np.str_]:
    """Return a column of names as text."""
    whole = column.unify_dictionaries().combine_chunks()
    if not len(whole):
        return np.zeros(0, np.str_)
    words: NDArray[np.str_] = np.array(whole.dictionary.to_pylist())[np.asarray(whole.indices)]
    return words
