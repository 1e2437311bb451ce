"""From what each sweep has in a zone to the events of the zone, and its rows in the table of zones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones import Path, crossings, episodes, same_agents, visits
from lidarcli.masks import Circle, Polygon
from lidarcli.pipeline.reading.masking import REACH
from lidarcli.pipeline.zone_counting import TopicSeries, ZoneSeries
from lidarcli.sweeps import TURN, Bool, Float64, Int64
from lidarcli.tabular.schemas import DIRECTIONS, EVENT_KINDS
from lidarcli.zone import WORLD, Line, Zone

SECOND_NS = 1e9
BOTH_CROSS_NS = 1_000_000_000
"""Two sensors that see an agent cross a line see it within this time [ns]."""
OCCUPIED, APPROACH, VISIT, CROSSING, STALE = EVENT_KINDS
IN, OUT = DIRECTIONS
_AGENT = SETS.index("A")


class Tracked(NamedTuple):
    """The agents of a topic: where they were, by sweep."""

    track: Int64
    """(N,) ascending; those of one track are in the order of time."""
    number: Int64
    """(N,) number of the sweep in the series."""
    x: Float64
    y: Float64
    in_world: Bool
    """(N,) True for the world frame, else that of the sensor."""
    in_view: Bool
    """(N,) True where the sweep sees at least a part of it."""
    labels: Mapping[int, str]
    """Track → its name in the catalogue, where it has one; also of what is no agent."""


@dataclass(frozen=True, slots=True)
class Counted:
    """A zone, and what sweeps of the topics that count in it have in it."""

    zone: Zone
    topics: tuple[TopicSeries, ...]
    series: tuple[ZoneSeries, ...]
    """For each topic."""
    names: tuple[str, ...]
    """Name of each part of a velocity_polygon; empty of any other zone."""
    tracked: tuple[Tracked | None, ...]
    """For each topic; None without tracks."""
    has_objects: bool
    span_ns: tuple[int, int]
    """Stamps of the first and the last sweep that counts in any zone [ns]."""
    first_ns: int
    """Stamp of the first sweep of the topics that count in any zone, whether or not it is among these [ns]."""
    every: int = 1
    """Only one of so many sweeps is among these."""


@dataclass(slots=True)
class Settled:
    """The events of a zone, and its rows: one for each sweep of its topics."""

    zone: Zone
    events: list[dict[str, Any]]
    topic: NDArray[np.intp]
    """(N,) index of the topic."""
    columns: dict[str, NDArray[Any] | None]
    one_sided: int | None = None
    """Of a line: how often an agent went through it that was not clear of it on both sides; None without tracks."""
    topics: tuple[TopicSeries, ...] = ()
    always_same: bool = False
    """True where the same beams have nearly the same range nearly all the time."""
    in_force: bool = True
    """False for a velocity_polygon none of whose polygons ever covered the velocity."""


def settle(counted: Counted) -> Settled:
    """Return the events and the rows of a zone."""
    return _Settling(counted).settled()


SAME_SHARE, SAME_SPREAD, SAME_TURN = 0.9, 0.06, 0.1
"""In this share of the sweeps the nearest point stays within such a distance [m] and bearing [rad]: perhaps the robot."""


class _Settling:
    """All that is known of a zone, by sweep of any of its topics in the order of time."""

    def __init__(self, counted: Counted) -> None:
        self.counted, self.zone = counted, counted.zone
        stamps = [topic.column("stamp_ns") for topic in counted.topics]
        self.ends = [{int(each.min()), int(each.max())} for each in stamps]
        """Of each topic the first and the last stamp."""
        self._timeout_ns = [self._timeout(each) for each in stamps]
        """Age from which on a sweep of each topic tells nothing [ns]."""
        self.topic = np.repeat(np.arange(len(stamps)), [len(each) for each in stamps])
        self.own = np.concatenate([np.arange(len(each)) for each in stamps])
        time_ns = np.concatenate(stamps)
        # A clock that is set back makes sweeps come in another order than the log has them.
        order = np.argsort(time_ns, kind="stable")
        self.topic, self.own = self.topic[order], self.own[order]
        self.time_ns: Int64 = time_ns[order]
        self.latest = [self._latest(index, each) for index, each in enumerate(stamps)]
        """(N,) for each topic: number of its newest sweep that is not too old; -1 for none."""
        self.velocity = self._joined([each.column("velocity") for each in counted.series])
        self.part = self._part()
        self.sweep = self._own("sweep")
        self.hits = [each.ordered_hits() for each in counted.series]
        """For each topic."""
        self.points_of = self._of_topics("points")
        self.points: Int64 = self.points_of.sum(axis=0)
        self.numbers = self._number_agents()

    def _timeout(self, stamps: Int64) -> int:
        if not self.zone.timeout:
            return 1 << 62
        # A sweep that is left out could be as new as the next one is old.
        left_out = 1.0 - 1.0 / self.counted.every
        step = float(np.median(np.diff(np.sort(stamps)))) if len(stamps) > 1 else 0.0
        return round(self.zone.timeout * SECOND_NS + left_out * step)

    def _latest(self, index: int, stamps: Int64) -> Int64:
        if len(self.counted.topics) == 1:
            return self.own
        order = np.argsort(stamps, kind="stable")
        at = np.searchsorted(stamps[order], self.time_ns, side="right") - 1
        there = (at >= 0) & (self.time_ns - stamps[order][np.maximum(at, 0)] <= self._timeout_ns[index])
        latest: Int64 = np.where(there, order[np.maximum(at, 0)], -1)
        return np.where(self.topic == index, self.own, latest)

    def _own(self, name: str) -> NDArray[Any]:
        """Return a quantity of the sweep itself."""
        return self._joined([topic.column(name) for topic in self.counted.topics])

    def _joined(self, columns: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Return (N, ...) what each topic has at its own sweeps."""
        found = np.empty((len(self.own), *columns[0].shape[1:]), columns[0].dtype)
        for index, values in enumerate(columns):
            mine = self.topic == index
            found[mine] = values[self.own[mine]]
        return found

    def _part(self) -> Int64:
        """Return (N,) the part of the zone that counts, -1 for none."""
        count = len(self.own)
        if not self.zone.cases:
            return np.zeros(count, np.int64)
        found = np.full(count, -1)
        for number in reversed(range(len(self.zone.cases))):
            with np.errstate(invalid="ignore"):
                found[self.zone.cases[number].covers(self.velocity)] = number
        # Where none covers the velocity, the one before stays.
        last = np.maximum.accumulate(np.where(found >= 0, np.arange(count), -1))
        return np.where(last >= 0, found[np.maximum(last, 0)], -1)

    def _picked(self, index: int, name: str, missing: Any) -> NDArray[Any]:
        """Return (N,) a quantity of the newest sweep of a topic, in the part that counts."""
        values = self.counted.series[index].column(name)
        latest = self.latest[index]
        there = (latest >= 0) & (self.part >= 0)
        found = np.full(len(latest), missing, values.dtype)
        found[there] = values[latest[there], self.part[there]]
        return found

    def _of_topics(self, name: str) -> Int64:
        """Return (topics, N) a number of beams of the newest sweep of each topic; 0 on a line, which holds none."""
        found = np.zeros((len(self.counted.topics), len(self.own)), np.int64)
        if not isinstance(self.zone.shape, Line):
            for index in range(len(found)):
                found[index] = self._picked(index, name, 0)
        return found

    def settled(self) -> Settled:
        """Return the events and the rows."""
        zone = self.zone
        is_line = isinstance(zone.shape, Line)
        by_topic = [
            np.full((5, len(self.own)), np.nan)
            if is_line
            else np.stack([self._picked(index, name, np.nan) for name in ("nearest", "bearing", "x", "y", "ttc")])
            for index in range(len(self.counted.topics))
        ]
        away = np.where(np.isnan(stacked := np.stack([each[0] for each in by_topic])), np.inf, stacked)
        self.source = away.argmin(axis=0)
        """(N,) topic of the nearest point."""
        values = np.stack(by_topic)[self.source, :, np.arange(len(self.own))].T
        self.nearest, self.bearing, self.x, self.y, _ = values
        ttc = np.stack([each[4] for each in by_topic])
        self.ttc = np.where(np.isnan(ttc).all(axis=0), np.nan, np.fmin.reduce(ttc, axis=0))
        enough = ~np.isnan(self.ttc) if zone.action == "approach" else self.points >= zone.min_points
        found = (
            []
            if is_line
            else episodes(
                enough,
                self.time_ns,
                trigger=zone.trigger,
                release=zone.release,
                hold_ns=round(zone.hold * SECOND_NS),
                longest_gap_ns=max(self._timeout_ns),
            )
        )
        active = np.zeros(len(self.own), np.bool_)
        for each in found:
            active[each.first : each.last + 1] = True
        agents = self._agents()
        self.agents = None if agents is None else self._per_row(agents).astype(np.int32)
        """(N,) agents in the zone; None without tracks."""
        self.enough = enough
        events = [self._episode(each.first, each.last, each.cut) for each in found]
        events += self._stale()
        one_sided = None
        if self.numbers is not None:
            own, one_sided = self._of_agents()
            events += own
        columns: dict[str, NDArray[Any] | None] = {
            "sweep": self.sweep,
            "stamp": self.time_ns,
            "t": self._own("seconds"),
            "points": self.points.astype(np.int32),
            "nearest": self.nearest,
            "ttc": self.ttc,
            "active": active,
            "things": self._things().astype(np.int32) if self.counted.has_objects else None,
            "agents": self.agents,
            "masked": self._of_topics("masked").sum(axis=0).astype(np.int32),
            "observed": self._observed(),
        }
        return Settled(
            zone,
            events,
            self.topic,
            columns,
            one_sided,
            self.counted.topics,
            self._is_always_same(active),
            bool((self.part >= 0).any()),
        )

    def _observed(self) -> Bool:
        """Return (N,) whether something in the zone could have made an event: enough beams reach it for long enough."""
        beams = np.sum([self._picked(index, "reach", 0) for index in range(len(self.counted.topics))], axis=0)
        least = 1 if isinstance(self.zone.shape, Line) else self.zone.min_points
        observed: Bool = beams >= least
        if isinstance(self.zone.shape, Line):
            return observed
        edges = np.flatnonzero(np.diff(observed.astype(np.int8), prepend=0, append=0))
        for begin, end in edges.reshape(-1, 2).tolist():
            observed[begin:end] = end - begin >= self.zone.trigger
        return observed

    def _is_always_same(self, active: Bool) -> bool:
        if np.count_nonzero(active) < max(SAME_SHARE * len(active), 10):
            return False
        low, high = np.nanpercentile(self.nearest[active], (5, 95))
        if high > REACH:
            return False
        middle = np.nanmedian(self.bearing[active])
        off = np.abs((self.bearing[active] - middle + 0.5 * TURN) % TURN - 0.5 * TURN)
        return bool(high - low < SAME_SPREAD and np.mean(off < SAME_TURN) >= SAME_SHARE)

    # Whose points they are.

    def _hits(self) -> Iterator[tuple[int, NDArray[np.intp], NDArray[np.intp]]]:
        """Yield for each topic the rows that see an object in the part that counts, and the index of the hit."""
        for index, hits in enumerate(self.hits):
            latest = self.latest[index]
            begin, end = (np.searchsorted(hits.sweep, latest, side=side) for side in ("left", "right"))
            count = np.where(latest >= 0, end - begin, 0)
            row = np.repeat(np.arange(len(count)), count)
            hit = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(begin, count)
            right = hits.part[hit] == self.part[row]
            yield index, row[right], hit[right]

    def _numbers_of(self, index: int, track: Int64) -> Int64:
        """Return the number of the agent that each track of a topic is; -1 for none."""
        tracks, which = np.unique(track, return_inverse=True)
        numbers = self.numbers or {}
        return np.array([numbers.get((index, one), -1) for one in tracks.tolist()], np.int64)[which]

    def _things(self) -> Int64:
        """Return (N,) the number of things with points in the zone; an agent that two sensors see counts once."""
        pairs = []
        for index, row, hit in self._hits():
            if not len(hit):
                continue
            track = self.hits[index].track[hit]
            name = np.where(track >= 0, 2 * track, 2 * self.hits[index].object[hit] + 1)
            number = self._numbers_of(index, track)
            name = np.where(number >= 0, -1 - number, name * len(self.hits) + index)
            pairs.append(np.column_stack([row, name]))
        if not pairs:
            return np.zeros(len(self.own), np.int64)
        return self._per_row(np.unique(np.concatenate(pairs), axis=0)[:, 0])

    def _per_row(self, rows: NDArray[np.intp]) -> Int64:
        """Return (N,) how often each row is among some."""
        counted: Int64 = np.bincount(rows, minlength=len(self.own))
        return counted

    def _whose(self, row: int, index: int) -> tuple[str | None, int | None, str | None]:
        """Return set, track and label of most points of the nearest sensor in a sweep; None where no objects are known."""
        if not self.counted.has_objects:
            return None, None, None
        hits, latest = self.hits[index], int(self.latest[index][row])
        left = int(self.points_of[index, row])
        counts: dict[tuple[int, int], int] = {}
        low, high = np.searchsorted(hits.sweep, [latest, latest + 1])
        for at in range(int(low), int(high)):
            if hits.part[at] == self.part[row]:
                key = int(hits.set[at]), int(hits.track[at])
                counts[key] = counts.get(key, 0) + int(hits.points[at])
                left -= int(hits.points[at])
        # Of as many points those of an agent count first, and walls last.
        best = max(counts, key=lambda key: (counts[key], key[0] == _AGENT, -key[1]), default=None)
        if best is None or counts[best] < left:
            return "S", None, None
        letter, track = best
        tracked = self.counted.tracked[index] if self.counted.tracked else None
        label = tracked.labels.get(track) if tracked is not None else None
        return SETS[letter], track if track >= 0 else None, label

    # Agents.

    def _paths(self) -> list[dict[int, Path]] | None:
        """Return for each topic the paths of its agents in the frame of the zone; None without tracks."""
        if not self.counted.tracked or all(one is None for one in self.counted.tracked):
            return None
        found: list[dict[int, Path]] = []
        for topic, series, tracked in zip(self.counted.topics, self.counted.series, self.counted.tracked, strict=True):
            paths: dict[int, Path] = {}
            if tracked is not None and len(tracked.track):
                x, y = _in_zone(self.zone, topic, series, tracked)
                stamps = topic.column("stamp_ns")[tracked.number]
                begins = np.flatnonzero(np.diff(tracked.track, prepend=-1))
                for begin, end in zip(begins, [*begins[1:], len(tracked.track)], strict=True):
                    some = slice(int(begin), int(end))
                    paths[int(tracked.track[begin])] = Path(stamps[some], x[some], y[some])
            found.append(paths)
        return found

    def _number_agents(self) -> dict[tuple[int, int], int] | None:
        self.paths = self._paths()
        return None if self.paths is None else same_agents(self.paths)

    def _shapes(self, index: int) -> tuple[list[Circle | Polygon], Int64]:
        """Return the shapes of the zone, and which of them it has (S,) at each sweep of a topic, -1 for none."""
        shapes = self.counted.series[index].shapes
        which = shapes.at(self.counted.topics[index].column("stamp_ns"))
        if which is None:
            mine = self.topic == index
            which = np.empty(np.count_nonzero(mine), np.int64)
            which[self.own[mine]] = self.part[mine]
        return shapes.shapes, which

    def _visits(self) -> Iterator[tuple[int, int, int, int, bool]]:
        """Yield topic, track, and first and last index into its path of each visit, and whether an end is not seen.

        Nothing shows that an agent was there whose path is hidden in the zone all the time.
        """
        assert self.paths is not None
        if isinstance(self.zone.shape, Line):
            return
        for index, (paths, tracked) in enumerate(zip(self.paths, self.counted.tracked, strict=True)):
            if tracked is None:
                continue
            shapes, which = self._shapes(index)
            for track, path in paths.items():
                begin = int(np.searchsorted(tracked.track, track))
                in_view = tracked.in_view[begin:]
                now = which[tracked.number[begin : begin + len(path.x)]]
                for visit in visits(shapes, now, path):
                    if in_view[visit.first : visit.last + 1].any():
                        yield index, track, visit.first, visit.last, visit.cut

    def _agents(self) -> NDArray[np.intp] | None:
        """Return (K,) sweeps, by row, once for each agent that is in the zone then; None without tracks."""
        if self.paths is None or self.numbers is None:
            return None
        pairs = [np.zeros((0, 2), np.int64)]
        for index, row, hit in self._hits():
            if len(hit):
                number = self._numbers_of(index, self.hits[index].track[hit])
                agents = (self.hits[index].set[hit] == _AGENT) & (number >= 0)
                pairs.append(np.column_stack([row[agents], number[agents]]))
        for index, track, first, last, _ in self._visits():
            times = self.paths[index][track].time_ns
            rows = np.arange(*np.searchsorted(self.time_ns, [times[first], times[last] + 1]))
            pairs.append(np.column_stack([rows, np.full(len(rows), self.numbers[index, track])]))
        return np.unique(np.concatenate(pairs), axis=0)[:, 0].astype(np.intp)

    def _of_agents(self) -> tuple[list[dict[str, Any]], int]:
        """Return visits or crossings, of an agent that two sensors see each once; and crossings seen on one side only."""
        assert self.paths is not None
        assert self.numbers is not None
        events: list[tuple[int, dict[str, Any]]] = []
        one_sided = 0
        if isinstance(self.zone.shape, Line):
            for index, paths in enumerate(self.paths):
                for track, path in paths.items():
                    found, missed = crossings(self.zone.shape, path)
                    one_sided += missed
                    for each in found:
                        event = self._of_path(index, track, each.after, each.after, CROSSING)
                        event["direction"] = IN if each.inwards else OUT
                        events.append((self.numbers[index, track], event))
        else:
            for index, track, first, last, cut in self._visits():
                event = self._of_path(index, track, first, last, VISIT)
                event["cut"] = cut and not self.ends[index].isdisjoint((event["start"], event["end"]))
                events.append((self.numbers[index, track], event))
        return _once(events), one_sided

    def _of_path(self, index: int, track: int, first: int, last: int, kind: str) -> dict[str, Any]:
        """Return the event of a piece of the path of an agent."""
        assert self.paths is not None
        path, topic = self.paths[index][track], self.counted.topics[index]
        tracked = self.counted.tracked[index]
        assert tracked is not None
        series = self.counted.series[index]
        rows = int(np.searchsorted(tracked.track, track)) + np.arange(first, last + 1)
        away, bearing = _from_sensor(
            topic, series, self.zone, tracked, rows, path.x[first : last + 1], path.y[first : last + 1]
        )
        known = np.flatnonzero(np.isfinite(away))
        nearest = int(known[away[known].argmin()]) if len(known) else None
        sweeps = topic.column("sweep")
        velocity = series.column("velocity")[tracked.number[rows]]
        return self._event(
            index,
            kind,
            int(sweeps[tracked.number[rows[0]]]),
            int(sweeps[tracked.number[rows[-1]]]),
            len(rows),
            int(path.time_ns[first]),
            int(path.time_ns[last]),
        ) | {
            "agents": 1,
            "nearest": None if nearest is None else float(away[nearest]),
            "bearing": None if nearest is None else float(bearing[nearest]),
            "x": None if nearest is None else float(path.x[first + nearest]),
            "y": None if nearest is None else float(path.y[first + nearest]),
            "set": "A",
            "track": track,
            "label": tracked.labels.get(track),
            "speed": _greatest(np.hypot(velocity[:, 0], velocity[:, 1])),
        }

    # Events.

    def _event(self, index: int, kind: str, first: int, last: int, sweeps: int, start: int, end: int) -> dict[str, Any]:
        """Return an event with what all kinds have."""
        topic = self.counted.topics[index]
        return {
            "topic": topic.topic,
            "frame_id": topic.frame_id,
            "first_sweep": first,
            "last_sweep": last,
            "sweeps": sweeps,
            "zone": self.zone.name,
            "kind": kind,
            "action": self.zone.action,
            "polygon": None,
            "start": start,
            "end": end,
            "t": (start - self.counted.first_ns) / SECOND_NS,
            "duration": (end - start) / SECOND_NS,
            "cut": False,
        }

    def _episode(self, first: int, last: int, cut: bool) -> dict[str, Any]:
        """Return the event of an episode."""
        some = slice(first, last + 1)
        nearest = self.nearest[some]
        known = np.flatnonzero(np.isfinite(nearest))
        at = first + (int(known[nearest[known].argmin()]) if len(known) else 0)
        index = int(self.points_of[:, some].sum(axis=1).argmax())
        mine = np.flatnonzero(self.topic[some] == index) + first
        begin, end = (int(mine[0]), int(mine[-1])) if len(mine) else (first, last)
        letter, track, label = self._whose(at, int(self.source[at]))
        event = self._event(
            index,
            APPROACH if self.zone.action == "approach" else OCCUPIED,
            int(self.sweep[begin]),
            int(self.sweep[end]),
            int(self.enough[some].sum()),
            int(self.time_ns[first]),
            int(self.time_ns[last]),
        )
        return event | {
            "polygon": self.counted.names[self.part[at]] if self.counted.names else None,
            "cut": cut,
            "points": int(self.points[some].max()),
            "agents": None if self.agents is None else int(self.agents[some].max()),
            "nearest": _number(self.nearest[at]),
            "bearing": _number(self.bearing[at]),
            "x": _number(self.x[at]),
            "y": _number(self.y[at]),
            "set": letter,
            "track": track,
            "label": label,
            "ttc": _number(np.fmin.reduce(self.ttc[some])),
            "speed": _greatest(np.hypot(self.velocity[some, 0], self.velocity[some, 1])),
        }

    def _stale(self) -> list[dict[str, Any]]:
        """Return the times in which a topic told nothing that still counts."""
        if not self.zone.timeout:
            return []
        begin, end = self.counted.span_ns
        events = []
        for index, topic in enumerate(self.counted.topics):
            timeout = self._timeout_ns[index]
            order = np.argsort(topic.column("stamp_ns"), kind="stable")
            stamps, sweeps = (topic.column(name)[order] for name in ("stamp_ns", "sweep"))
            times = np.concatenate([[begin], stamps, [end]])
            for at in np.flatnonzero(np.diff(times) > timeout).tolist():
                before, after = max(at - 1, 0), min(at, len(stamps) - 1)
                start = int(times[at]) + timeout
                ends = int(sweeps[before]), int(sweeps[after])
                event = self._event(index, STALE, *ends, 0, start, int(times[at + 1]))
                events.append(event | {"cut": at in (0, len(stamps))})
        return events


def _once(events: Sequence[tuple[int, dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return events of agents, of those that two sensors tell of one agent the first, which lasts as long as both."""
    kept: list[dict[str, Any]] = []
    newest: dict[tuple[int, str | None], dict[tuple[str, str], dict[str, Any]]] = {}
    """Agent and direction → topic and frame → the newest event that is kept, the newest of all last."""
    for agent, event in sorted(events, key=lambda each: each[1]["start"]):
        its = newest.setdefault((agent, event.get("direction")), {})
        longest = BOTH_CROSS_NS if event["kind"] == CROSSING else 0
        mine = event["topic"], event["frame_id"]
        same = next(
            (one for sensor, one in reversed(its.items()) if sensor != mine and event["start"] - one["end"] <= longest),
            None,
        )
        if same is None:
            kept.append(event)
            its.pop(mine, None)
            its[mine] = event
            continue
        if event["kind"] == VISIT:
            same["end"] = max(same["end"], event["end"])
            same["cut"] |= event["cut"]
            same["duration"] = (same["end"] - same["start"]) / SECOND_NS
        if (event["nearest"] or np.inf) < (same["nearest"] or np.inf):
            same |= {name: event[name] for name in ("nearest", "bearing", "x", "y")}
    return kept


def _in_zone(zone: Zone, topic: TopicSeries, series: ZoneSeries, tracked: Tracked) -> tuple[Float64, Float64]:
    """Return where agents are in the frame of a zone (N,) [m]."""
    if zone.frame == WORLD and tracked.in_world.all():
        return tracked.x, tracked.y
    x, y = _in_sensor(topic, tracked)
    return _moved(series.column("placed")[tracked.number], x, y)


def _in_sensor(topic: TopicSeries, tracked: Tracked) -> tuple[Float64, Float64]:
    """Return where agents are in the frame of the sensor (N,) [m]."""
    return _back(topic.column("pose")[tracked.number], tracked.x, tracked.y, tracked.in_world)


def _from_sensor(
    topic: TopicSeries, series: ZoneSeries, zone: Zone, tracked: Tracked, rows: NDArray[np.intp], x: Float64, y: Float64
) -> tuple[Float64, Float64]:
    """Return how far places in the frame of the zone are from the sensor, and in which direction it sees them."""
    placed = topic.column("pose") if zone.frame == WORLD else series.column("placed")
    at_x, at_y = _back(placed[tracked.number[rows]], x, y, np.ones(len(rows), np.bool_))
    return np.hypot(at_x, at_y), np.arctan2(at_y, at_x)


def _moved(place: Float64, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """Return places of the frame of the sensor in the frame in which it is at `place` (N, 4)."""
    cos, sin = np.cos(place[:, 2]), np.sin(place[:, 2])
    left = np.where(place[:, 3] > 0.0, -y, y)
    return place[:, 0] + cos * x - sin * left, place[:, 1] + sin * x + cos * left


def _back(place: Float64, x: Float64, y: Float64, there: Bool) -> tuple[Float64, Float64]:
    """Return places of the frame in which the sensor is at `place` (N, 4) in its own, where they are `there`."""
    dx, dy = x - place[:, 0], y - place[:, 1]
    cos, sin = np.cos(place[:, 2]), np.sin(place[:, 2])
    left = cos * dy - sin * dx
    left = np.where(place[:, 3] > 0.0, -left, left)
    return np.where(there, cos * dx + sin * dy, x), np.where(there, left, y)


def _number(value: float) -> float | None:
    """Return a quantity to micrometres: single precision has no more; None where it is not known."""
    return round(float(value), 6) if np.isfinite(value) else None


def _greatest(values: Float64) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else None
