"""The events of a zone, and its rows in the table of zones, from the counts of each sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import AGENT, SETS
from lidarcli.formalism.tracking.trajectories import observed_steps
from lidarcli.formalism.zones import SAMPLES, TrackPath, crossings, episodes, visits
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.inputs.tracked import from_sensor, to_sensor
from lidarcli.pipeline.zones.counts import TopicSeries, ZoneSeries, event_row
from lidarcli.sweeps.masks import Circle, Polygon
from lidarcli.sweeps.types import Bool, Float64, Int64, UInt8
from lidarcli.sweeps.zone import UNSEEN, WORLD, Line, Zone
from lidarcli.tabular.schemas import DIRECTIONS, EVENT_KINDS

OCCUPIED, APPROACH, VISIT, CROSSING, STALE, NAV2, STOP = EVENT_KINDS
FEW = 2
"""Places of a zone, of `SAMPLES`, from which on it is not observed where they are lost."""
ONCE_NS = 2 * SECOND_NS
"""Tracks of one person that cross a line in one direction within this are one crossing [ns]."""


class AgentPaths(NamedTuple):
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
    """(N,) True where at least a part of it is visible in the sweep."""
    labels: Mapping[int, str]
    """Track → its name in the catalogue, where it has one; also of what is no agent."""
    shared: Collection[int] = ()
    """Tracks that several sensors have observed: their numbers are those of the robot."""
    persons: Mapping[int, int] = MappingProxyType({})
    """Track → the person that it is counted as."""


class _AgentPath(NamedTuple):
    """The path of an agent, at the sweeps of one sensor or of several."""

    track: int
    person: int
    """Its person; of an agent that is counted as none the track."""
    path: TrackPath
    topic: Int64
    """(N,) index of the topic of each sweep."""
    number: Int64
    """(N,) number of the sweep in the series of the topic."""
    in_view: Bool


class HitRows(NamedTuple):
    """Points on objects: one entry for each object that a row of the zone has in it, by row."""

    row: NDArray[np.intp]
    topic: Int64
    agent: Int64
    """(H,) number of the agent that it is, the same for all sensors; -1 for none."""
    set: UInt8
    track: Int64
    object: Int64
    points: Int64


@dataclass(slots=True)
class ZoneEvents:
    """The events of a zone, and its rows: one for each sweep of its topics."""

    zone: Zone
    events: list[dict[str, Any]]
    topic: NDArray[np.intp]
    """(N,) index of the topic."""
    columns: dict[str, NDArray[Any] | None]
    one_sided: int | None = None
    """Of a line: how often an agent went through it that was not clear of it on both sides; None without tracks."""
    unseen: int = 0
    """Of a line: how often an agent went through it out of sight."""
    unsure: Sequence[tuple[int, str]] = ()
    """Stamp and direction of each of both."""
    at_once: tuple[Int64, Int64] = (np.zeros(0, np.int64), np.zeros(0, np.int64))
    """Of a line: stamps of the sweeps that see agents, and how many."""
    topics: Sequence[TopicSeries] = ()
    lost: tuple[int, float] = (0, 0.0)
    """Sweeps in which too much of the zone is lost that a sensor could observe, and the greatest share of it."""
    in_force: bool = True
    """False for a velocity_polygon none of whose polygons ever covered the velocity."""


class EventFinder:
    """All that is known of a zone, by sweep of any of its sensors in the order of time."""

    def __init__(
        self,
        zone: Zone,
        topics: Sequence[TopicSeries],
        agents: Sequence[AgentPaths | None],
        *,
        has_objects: bool,
        span_ns: tuple[int, int],
        first_ns: int,
        every: int = 1,
    ) -> None:
        """Take the sweeps of the sensors that count in a zone.

        Parameters
        ----------
        agents : those of each sensor; None without tracks
        span_ns : stamps of the first and the last sweep that counts in any zone
        first_ns : stamp of the first sweep of the log for any zone, be it among these or not
        every : only one of so many sweeps is among these
        """
        self.zone, self.topics, self.paths_of = zone, topics, agents
        self.has_objects, self.span_ns, self.first_ns, self.every = has_objects, span_ns, first_ns, every
        self.series = [topic.of_zone(zone.name) for topic in topics]
        self.is_line = isinstance(zone.shape, Line)
        stamps = [topic.column("stamp_ns") for topic in topics]
        self.ends = [{int(each.min()), int(each.max())} for each in stamps]
        """Of each topic the first and the last stamp."""
        self._timeout_ns = [self._timeout(each) for each in stamps]
        """Age from which on a sweep of each topic does not count [ns]."""
        self.topic = np.repeat(np.arange(len(stamps)), [len(each) for each in stamps])
        self.own = np.concatenate([np.arange(len(each)) for each in stamps])
        time_ns = np.concatenate(stamps)
        # A clock that is set back makes sweeps come in another order than the log has them.
        order = np.argsort(time_ns, kind="stable")
        self.topic, self.own = self.topic[order], self.own[order]
        self.time_ns: Int64 = time_ns[order]
        self.latest = [self._latest(index, each) for index, each in enumerate(stamps)]
        """(N,) for each topic: number of its newest sweep that is not too old; -1 for none."""
        self.velocity = self._joined([each.column("velocity") for each in self.series])
        self.part = self._part()
        self.sweep = self._own("sweep")
        self.points_of = self._of_topics("points")
        self.points: Int64 = self.points_of.sum(axis=0)
        self.has_tracks = any(one is not None for one in agents)
        self.paths = self._paths()
        """The paths of the agents in the frame of the zone."""
        self.numbers = {
            (index, agent.track): number
            for number, agent in enumerate(self.paths)
            for index in np.unique(agent.topic).tolist()
        }
        """Topic and track of an agent → its number."""
        self.hits = self._hit_rows()

    def _timeout(self, stamps: Int64) -> int:
        if not self.zone.timeout:
            return 1 << 62
        # A sweep that is left out could be as new as the next one is old.
        left_out = 1.0 - 1.0 / self.every
        step = float(np.median(np.diff(np.sort(stamps)))) if len(stamps) > 1 else 0.0
        return round(self.zone.timeout * SECOND_NS + left_out * step)

    def _latest(self, index: int, stamps: Int64) -> Int64:
        if len(self.topics) == 1:
            return self.own
        newest = self._newest(stamps)
        age = self.time_ns - stamps[newest]
        latest: Int64 = np.where((age >= 0) & (age <= self._timeout_ns[index]), newest, -1)
        return np.where(self.topic == index, self.own, latest)

    def _newest(self, stamps: Int64) -> Int64:
        """Return (N,) for each sweep the newest one of a topic; before its first one that."""
        order = np.argsort(stamps, kind="stable")
        newest: Int64 = order[np.maximum(np.searchsorted(stamps[order], self.time_ns, side="right") - 1, 0)]
        return newest

    def _own(self, name: str) -> NDArray[Any]:
        """Return a quantity of the sweep itself."""
        return self._joined([topic.column(name) for topic in self.topics])

    def _joined(self, columns: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Return (N, ...) what each topic has at its own sweeps."""
        found = np.empty((len(self.own), *columns[0].shape[1:]), columns[0].dtype)
        for index, values in enumerate(columns):
            own = self.topic == index
            found[own] = values[self.own[own]]
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
        values = self.series[index].column(name)
        latest = self.latest[index]
        there = (latest >= 0) & (self.part >= 0)
        found = np.full(len(latest), missing, values.dtype)
        found[there] = values[latest[there], self.part[there]]
        return found

    def _of_topics(self, name: str) -> Int64:
        """Return (topics, N) a number of beams of the newest sweep of each topic."""
        return np.stack([self._picked(index, name, 0).astype(np.int64) for index in range(len(self.topics))])

    def find(self) -> ZoneEvents:
        """Return the events and the rows."""
        zone = self.zone
        names = ("nearest", "bearing", "x", "y", "ttc")
        values = np.stack([[self._picked(index, name, np.nan) for name in names] for index in range(len(self.topics))])
        self.source = np.where(np.isnan(values[:, 0]), np.inf, values[:, 0]).argmin(axis=0)
        """(N,) topic of the nearest point."""
        self.nearest, self.bearing, self.x, self.y, _ = values[self.source, :, np.arange(len(self.own))].T
        self.ttc = np.fmin.reduce(values[:, 4])
        self.enough = ~np.isnan(self.ttc) if zone.action == "approach" else self.points >= zone.min_points
        found = episodes(
            self.enough,
            self.time_ns,
            trigger=zone.trigger,
            release=zone.release,
            hold_ns=round(zone.hold * SECOND_NS),
            longest_gap_ns=max(self._timeout_ns),
        )
        active = np.zeros(len(self.own), np.bool_)
        for each in found:
            active[each.first : each.last + 1] = True
        self._inside = self._agents() if self.has_tracks else np.empty((0, 2), np.int64)
        """(K, 2) row of a sweep and number of the path of each agent that is in the zone then."""
        self.agents = self._per_row(self._inside[:, 0]).astype(np.int32) if self.has_tracks else None
        """(N,) agents in the zone; None without tracks."""
        events = [self._episode(each.first, each.last, each.cut) for each in found]
        events += self._stale()
        one_sided, unseen = None, 0
        unsure: list[tuple[int, str]] = []
        if self.has_tracks:
            own, one_sided, unseen, unsure = self._of_agents()
            events += own
        columns: dict[str, NDArray[Any] | None] = {
            "sweep": self.sweep,
            "stamp": self.time_ns,
            "t": self._own("seconds"),
            "points": self.points.astype(np.int32),
            "nearest": self.nearest,
            "ttc": self.ttc,
            "active": active,
            "things": self._things().astype(np.int32) if self.has_objects else None,
            "agents": self.agents,
            "masked": self._of_topics("masked").sum(axis=0).astype(np.int32),
            "observed": self._observed(),
        }
        in_force = bool((self.part >= 0).any())
        return ZoneEvents(
            zone, events, self.topic, columns, one_sided, unseen, unsure, self._at_once(), self.topics, self.lost, in_force
        )

    def _observed(self) -> Bool:
        """Return (N,) whether something in the zone could have made an event: enough beams reach it for long enough.

        Nor is any part of it lost that a sensor could observe; one that is silent has lost all that it observed last.
        """
        observed: Bool = self._of_topics("reach").sum(axis=0) >= (1 if self.is_line else self.zone.min_points)
        seen, lost = np.zeros((2, len(self.own)), np.uint64)
        part = np.maximum(self.part, 0)
        for index, topic in enumerate(self.topics):
            stamps = topic.column("stamp_ns")
            at = np.where(self.topic == index, self.own, self._newest(stamps))
            its_seen, its_lost = (self.series[index].column(name)[at, part] for name in ("seen", "lost"))
            step = float(np.median(np.diff(np.sort(stamps)))) if len(stamps) > 1 else 0.0
            silent = np.abs(self.time_ns - stamps[at]) > max(UNSEEN * SECOND_NS, 1.5 * step)
            seen |= np.where(silent, np.uint64(0), its_seen)
            lost |= np.where(silent, its_seen | its_lost, its_lost)
        places = np.bitwise_count(lost & ~seen)
        is_lost = (places >= FEW) & (self.points < self.zone.min_points)
        self.lost = int(np.count_nonzero(is_lost)), float(places[is_lost].max(initial=0)) / SAMPLES
        observed &= places < FEW
        if self.is_line:
            return observed
        observed |= self.points >= self.zone.min_points
        edges = np.flatnonzero(np.diff(observed.astype(np.int8), prepend=0, append=0))
        for begin, end in edges.reshape(-1, 2).tolist():
            observed[begin:end] = end - begin >= self.zone.trigger
        return observed

    # Whose points they are.

    def _hit_rows(self) -> HitRows:
        """Return what each row has in the part that counts."""
        pieces = []
        for index, hits in enumerate(each.ordered_hits() for each in self.series):
            latest = self.latest[index]
            begin, end = (np.searchsorted(hits.sweep, latest, side=side) for side in ("left", "right"))
            count = np.where(latest >= 0, end - begin, 0)
            row = np.repeat(np.arange(len(count)), count)
            hit = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(begin, count)
            right = hits.part[hit] == self.part[row]
            row, hit = row[right], hit[right]
            tracks, which = np.unique(hits.track[hit], return_inverse=True)
            known = [self.numbers.get((index, track), -1) for track in tracks.tolist()]
            agent = np.array(known, np.int64)[which]
            of_hit = (hits.set[hit], hits.track[hit], hits.object[hit], hits.points[hit])
            pieces.append(HitRows(row, np.full(len(row), index), agent, *of_hit))
        joined = HitRows._make(map(np.concatenate, zip(*pieces, strict=True)))
        order = np.argsort(joined.row, kind="stable")
        return HitRows._make(values[order] for values in joined)

    def _things(self) -> Int64:
        """Return (N,) the number of objects with points in the zone; one that several sensors have observed counts once."""
        hits = self.hits
        shared = np.array([track for one in self.paths_of if one is not None for track in one.shared], np.int64)
        topic = np.where(np.isin(hits.track, shared), 0, hits.topic)
        own = np.where(hits.track >= 0, 2 * hits.track, 2 * hits.object + 1) * len(self.topics) + topic
        thing = np.where(hits.agent >= 0, -1 - hits.agent, own)
        return self._per_row(np.unique(np.column_stack([hits.row, thing]), axis=0)[:, 0])

    def _per_row(self, rows: NDArray[np.intp]) -> Int64:
        """Return (N,) how often each row is among some."""
        counted: Int64 = np.bincount(rows, minlength=len(self.own))
        return counted

    def _whose(self, row: int, index: int) -> tuple[str | None, int | None, str | None]:
        """Return set, track and label of most points of the nearest sensor in a sweep; None where no objects are known."""
        if not self.has_objects:
            return None, None, None
        counts: Counter[tuple[int, int]] = Counter()
        low, high = np.searchsorted(self.hits.row, [row, row + 1])
        for at in range(int(low), int(high)):
            if self.hits.topic[at] == index:
                counts[int(self.hits.set[at]), int(self.hits.track[at])] += int(self.hits.points[at])
        left = int(self.points_of[index, row]) - counts.total()
        # Of as many points those of an agent count first, and walls last.
        best = max(counts, key=lambda key: (counts[key], key[0] == AGENT, -key[1]), default=None)
        if best is None or counts[best] < left:
            return "S", None, None
        letter, track = best
        agents = self.paths_of[index]
        label = None if agents is None else agents.labels.get(track)
        return SETS[letter], track if track >= 0 else None, label

    # Agents.

    def _paths(self) -> list[_AgentPath]:
        """Return the paths of all agents: of one that several sensors follow together, what it is at the sweeps of each."""
        pieces: dict[tuple[int, int], list[_AgentPath]] = {}
        for at, agents in enumerate(self.paths_of):
            if agents is None:
                continue
            x, y = self._in_zone(self.topics[at], self.series[at], agents)
            stamps = self.topics[at].column("stamp_ns")[agents.number]
            begins = np.flatnonzero(np.diff(agents.track, prepend=-1)).tolist()
            for some in (slice(*ends) for ends in pairwise([*begins, len(agents.track)])):
                track, path = int(agents.track[some.start]), TrackPath(stamps[some], x[some], y[some], agents.in_view[some])
                person, topic = agents.persons.get(track, track), np.full(len(path.x), at)
                own = _AgentPath(track, person, path, topic, agents.number[some], agents.in_view[some])
                pieces.setdefault((-1 if track in agents.shared else at, track), []).append(own)
        return [*map(_in_time_order, pieces.values())]

    def _of_path(self, agent: _AgentPath, name: str, rows: slice = slice(None)) -> NDArray[Any]:
        """Return what the zone has at the sweeps of the path of an agent."""
        columns = [series.column(name) for series in self.series]
        found = [columns[at][row] for at, row in zip(agent.topic[rows], agent.number[rows], strict=True)]
        return np.array(found)

    def _in_zone(self, topic: TopicSeries, series: ZoneSeries, agents: AgentPaths) -> tuple[Float64, Float64]:
        """Return where agents are in the frame of the zone (N,) [m]."""
        x, y = agents.x, agents.y
        if self.zone.frame == WORLD and agents.in_world.all():
            return x, y
        own = to_sensor(topic.column("pose")[agents.number], x, y)
        x, y = (np.where(agents.in_world, here, there) for here, there in zip(own, (x, y), strict=True))
        return from_sensor(series.column("placed")[agents.number], x, y)

    def _shapes(self, index: int) -> tuple[list[Circle | Polygon], Int64]:
        """Return the shapes of the zone, and which of them it has (S,) at each sweep of a topic, -1 for none."""
        shapes = self.series[index].shapes
        which = shapes.at(self.topics[index].column("stamp_ns"))
        if which is None:
            own = self.topic == index
            which = np.empty(np.count_nonzero(own), np.int64)
            which[self.own[own]] = self.part[own]
        return shapes.shapes, which

    def _visits(self) -> Iterator[tuple[int, int, int, bool]]:
        """Yield agent, first and last index into its path of each visit, both visible, and whether the path ends in it."""
        if self.is_line or not self.paths:
            return
        shapes = [self._shapes(index) for index in range(len(self.topics))]
        for number, agent in enumerate(self.paths):
            now = np.array([shapes[index][1][row] for index, row in zip(agent.topic, agent.number, strict=True)])
            for visit in visits(shapes[0][0], now, agent.path):
                seen = visit.first + np.flatnonzero(agent.in_view[visit.first : visit.last + 1])
                if len(seen):
                    yield number, int(seen[0]), int(seen[-1]), visit.cut

    def _agents(self) -> Int64:
        """Return (K, 2) sweeps, by row, with the number of the path of each agent that is in the zone then."""
        own = (self.hits.set == AGENT) & (self.hits.agent >= 0)
        pairs = [np.column_stack([self.hits.row[own], self.hits.agent[own]])]
        for number, first, last, _ in self._visits():
            times, steps = self.paths[number].path.time_ns, self.paths[number].path.steps
            rows = np.arange(*np.searchsorted(self.time_ns, [times[first], times[last] + 1]))
            after = np.searchsorted(times, self.time_ns[rows])
            seen = steps[after] | (self.paths[number].in_view[after] & (times[after] == self.time_ns[rows]))
            pairs.append(np.column_stack([rows[seen], np.full(np.count_nonzero(seen), number)]))
        return np.unique(np.concatenate(pairs).astype(np.int64), axis=0)

    def _at_once(self) -> tuple[Int64, Int64]:
        """Return the stamps of sweeps that see agents, wherever they are, and how many each of them sees."""
        seen = [path.path.time_ns[path.in_view] for path in self.paths] if self.is_line else []
        return np.unique(np.concatenate([np.zeros(0, np.int64), *seen]), return_counts=True)

    def _of_agents(self) -> tuple[list[dict[str, Any]], int, int, list[tuple[int, str]]]:
        """Return visits or crossings; crossings that were observed on one side only, and those out of sight; stamp and
        direction of these."""
        events: list[dict[str, Any]] = []
        unsure: list[tuple[int, str]] = []
        one_sided = unseen = 0
        if isinstance(shape := self.zone.shape, Line):
            found = [
                (int(agent.path.time_ns[each.after]), kind, DIRECTIONS[0 if each.inwards else 1], number, each.after)
                for number, agent in enumerate(self.paths)
                for kind, some in enumerate(crossings(shape, agent.path))
                for each in some
            ]
            known: dict[tuple[int, str], list[tuple[int, int]]] = {}
            for stamp, kind, direction, number, after in sorted(found, key=lambda one: (one[1] > 0, one[0])):
                agent = self.paths[number]
                own = known.setdefault((agent.person, direction), [])
                if any(other != number and abs(stamp - then) <= ONCE_NS for then, other in own):
                    # Another track of the same person.
                    continue
                own.append((stamp, number))
                if kind:
                    unsure.append((stamp, direction))
                    one_sided, unseen = one_sided + (kind == 1), unseen + (kind == 2)
                else:
                    events.append(self._of_agent(agent, after, after, CROSSING) | {"direction": direction})
        else:
            for number, first, last, cut in self._visits():
                event = self._of_agent(self.paths[number], first, last, VISIT)
                ends = {stamp for index in np.unique(self.paths[number].topic).tolist() for stamp in self.ends[index]}
                seen = self.paths[number].path.steps[first + 1 : last + 1]
                steps = np.diff(self.paths[number].path.time_ns[first : last + 1])
                event |= {"hidden": int(steps[~seen].sum()) / SECOND_NS}
                events.append(event | {"cut": cut and not ends.isdisjoint((event["start"], event["end"]))})
        return events, one_sided, unseen, unsure

    def _of_agent(self, agent: _AgentPath, first: int, last: int, kind: str) -> dict[str, Any]:
        """Return the event of a piece of the path of an agent."""
        some, path = slice(first, last + 1), agent.path
        x, y = path.x[some], path.y[some]
        ahead, left = to_sensor(self._of_path(agent, "placed", some), x, y)
        away = np.hypot(ahead, left)
        known = np.flatnonzero(np.isfinite(away))
        # The sensor with most of it.
        index = int(np.bincount(agent.topic[some]).argmax())
        number = agent.number[some][agent.topic[some] == index]
        tracked = self.paths_of[index]
        assert tracked is not None
        event = self._event(
            index,
            kind,
            self.topics[index].column("sweep")[number[[0, -1]]].tolist(),
            (int(path.time_ns[first]), int(path.time_ns[last])),
            int(agent.in_view[some].sum()),
        )
        if len(known):
            k = int(known[away[known].argmin()])
            bearing = float(np.arctan2(left[k], ahead[k]))
            event |= {"nearest": float(away[k]), "bearing": bearing, "x": float(x[k]), "y": float(y[k])}
        velocity = self._of_path(agent, "velocity", some)
        return event | {
            "agents": 1,
            "set": "A",
            "track": agent.track,
            "label": tracked.labels.get(agent.track),
            "speed": _greatest(np.hypot(velocity[:, 0], velocity[:, 1])),
        }

    # Events.

    def _event(self, index: int, kind: str, ends: Sequence[int], span_ns: tuple[int, int], sweeps: int) -> dict[str, Any]:
        """Return an event with what all kinds have; `ends`: its first and its last sweep of a topic."""
        about = {"zone": self.zone.name, "kind": kind, "action": self.zone.action}
        return event_row(self.topics[index], about, ends, span_ns, self.first_ns) | {
            "sweeps": sweeps,
            "look": self._look(index, span_ns[0]),
        }

    def _look(self, index: int, time_ns: int) -> tuple[str, float]:
        """Return a topic, and a time in seconds since its first sweep, where a picture shows an event."""
        return self.topics[index].topic, (time_ns - self.topics[index].first_ns) / SECOND_NS

    def _episode(self, first: int, last: int, cut: bool) -> dict[str, Any]:
        """Return the event of an episode."""
        some = slice(first, last + 1)
        nearest = self.nearest[some]
        known = np.flatnonzero(np.isfinite(nearest))
        at = first + (int(known[nearest[known].argmin()]) if len(known) else 0)
        index = int(self.points_of[:, some].sum(axis=1).argmax())
        own = np.flatnonzero(self.topic[some] == index) + first
        begin, end = (int(own[0]), int(own[-1])) if len(own) else (first, last)
        letter, track, label = self._whose(at, int(self.source[at]))
        agents = self._inside[(self._inside[:, 0] >= first) & (self._inside[:, 0] <= last), 1]
        if letter == "S" and len(agents):
            # Who is in the zone counts before the wall that its beams are taken for.
            letter, track = "A", self.paths[int(np.bincount(agents).argmax())].track
            label = next((each.labels.get(track) for each in self.paths_of if each is not None), None)
        event = self._event(
            index,
            APPROACH if self.zone.action == "approach" else OCCUPIED,
            (int(self.sweep[begin]), int(self.sweep[end])),
            (int(self.time_ns[first]), int(self.time_ns[last])),
            int(self.enough[some].sum()),
        )
        return event | {
            "polygon": self.zone.cases[self.part[at]].name if self.zone.cases else None,
            "cut": cut,
            "look": self._look(int(self.source[at]), int(self.time_ns[at])),
            "points": int(self.points[some].max()),
            "agents": None if self.agents is None else int(self.agents[some].max()),
            **{name: _number(getattr(self, name)[at]) for name in ("nearest", "bearing", "x", "y")},
            "set": letter,
            "track": track,
            "label": label,
            "ttc": _number(np.fmin.reduce(self.ttc[some])),
            "speed": _greatest(np.hypot(self.velocity[some, 0], self.velocity[some, 1])),
        }

    def _stale(self) -> list[dict[str, Any]]:
        """Return the times in which a topic had no sweep that still counts."""
        if not self.zone.timeout:
            return []
        begin, end = self.span_ns
        events = []
        for index, topic in enumerate(self.topics):
            timeout = self._timeout_ns[index]
            order = np.argsort(topic.column("stamp_ns"), kind="stable")
            stamps, sweeps = (topic.column(name)[order] for name in ("stamp_ns", "sweep"))
            times = np.concatenate([[begin], stamps, [end]])
            for at in np.flatnonzero(np.diff(times) > timeout).tolist():
                before, after = max(at - 1, 0), min(at, len(stamps) - 1)
                start = int(times[at]) + timeout
                ends = int(sweeps[before]), int(sweeps[after])
                event = self._event(index, STALE, ends, (start, int(times[at + 1])), 0)
                events.append(event | {"cut": at in (0, len(stamps))})
        return events


def _in_time_order(pieces: Sequence[_AgentPath]) -> _AgentPath:
    """Return the pieces of the path of one agent as one."""
    path = TrackPath(*map(np.concatenate, zip(*(piece.path for piece in pieces), strict=True)))
    order = np.argsort(path.time_ns, kind="stable")
    more = (np.concatenate(values)[order] for values in zip(*(piece[3:] for piece in pieces), strict=True))
    topic, number, in_view = more
    times = path.time_ns[order]
    steps = observed_steps(times / SECOND_NS, in_view, topic)
    return _AgentPath(*pieces[0][:2], TrackPath(times, path.x[order], path.y[order], steps), topic, number, in_view)


def _number(value: float) -> float | None:
    """Return a quantity to micrometres: single precision has no more; None where it is not known."""
    return round(float(value), 6) if np.isfinite(value) else None


def _greatest(values: Float64) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else None
