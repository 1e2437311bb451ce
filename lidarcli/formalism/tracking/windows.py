"""A window of sweeps is settled once the next one has been seen: bodies get their tracks, and rows their numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import UNKNOWN
from lidarcli.formalism.tracking import grouping, motions, summary
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.things import Thing, Track
from lidarcli.formalism.tracking.tracked import CONFIRMED, EMPTY, ENDED, LIVE, PERSON
from lidarcli.sweeps import Bool, Float64, Int8, Int32, Int64, UInt8

if TYPE_CHECKING:
    from lidarcli.formalism.tracking.naming import Looks, Naming

EVERYTHING = slice(None)
MOST_PLACED = 0.5
LONGEST_LAPSE = 10.0
"""[s] Nobody knows how far something went that was unseen for longer."""


@dataclass(slots=True)
class Window:
    """Sweeps that are settled together, in pieces as the batches bring them."""

    begin: int
    """Sweeps of the topic before."""
    objects: int
    """Objects of the topic before."""
    numbers: list[Int64] = field(default_factory=list)
    """(K,) the body of each object, 0 for none."""
    sweeps: list[Int64] = field(default_factory=list)
    """(K,) of each object, the sweeps of the topic before its own."""
    index: list[Int64] = field(default_factory=list)
    """(S,) of each sweep, its index in the log …"""
    stamps: list[Int64] = field(default_factory=list)
    """… its stamp …"""
    frames: list[Int64] = field(default_factory=list)
    """… and its frame."""
    placed: list[Bool] = field(default_factory=list)
    """… and whether it is known where its sensor was: poses tell, or it stands."""
    looks: list[Looks] = field(default_factory=list)
    """What each object looked like, where tracks are named."""

    @property
    def count(self) -> int:
        """Its sweeps."""
        return sum(map(len, self.index))

    @property
    def is_placed(self) -> bool:
        """Whether most of its sweeps have a place that is known: then things are the same ones from sweep to sweep."""
        return float(np.concatenate(self.placed).mean()) > MOST_PLACED


@dataclass(slots=True)
class Settled:
    """What is known of the objects (K,) of a window."""

    track: Int64
    vx: Float64
    vy: Float64
    moving: Bool
    agent: Bool
    label: Int32
    label_score: Float64
    is_thing: Int8
    """(K,) the verdict by all that was seen of it: 1 thing, 0 building, -1 none."""
    thing: Float64
    shape: UInt8

    def rows(self, part: slice) -> Settled:
        """Of some of the objects."""
        return Settled(*(getattr(self, each.name)[part] for each in fields(self)))

    @staticmethod
    def joined(parts: list[Settled]) -> Settled:
        """Of one object after the other."""
        kinds = (
            *(np.int64, np.float64, np.float64, np.bool_, np.bool_, np.int32, np.float64),
            *(np.int8, np.float64, np.uint8),
        )
        if not parts:
            nothing: list[Any] = [np.empty(0, kind) for kind in kinds]
            return Settled(*nothing)
        if len(parts) == 1:
            return parts[0]
        return Settled(
            *(np.concatenate([getattr(one, each.name) for one in parts]) for each in fields(Settled))
        )


class Register:
    """All things that were believed, and the tracks they are parts of."""

    def __init__(self, naming: Naming | None = None, least_odds: float = -math.inf) -> None:
        """`least_odds`: what has less log-odds of being a thing, by all that was seen of it, is building."""
        self.least_odds = least_odds
        self.naming = naming
        """Names tracks, if there is a catalogue."""
        self.things: dict[int, Thing] = {}
        """By the number of their body; those that are over and settled are left out."""
        self.tracks: list[Track] = []
        """By their number, from 1."""

    def collect(self, bodies: Bodies) -> None:
        """Note what is known of all bodies that were seen often enough, and let go of those that have ended."""
        arrays = bodies.arrays
        state = arrays["state"][: bodies.high]
        believed = (state != EMPTY) & (arrays["sightings"][: bodies.high] >= CONFIRMED)
        for slot in np.flatnonzero(believed).tolist():
            number = arrays["number"].item(slot)
            thing = self.things.get(number)
            if thing is None:
                thing = self.things[number] = Thing(number)
            thing.take(arrays, slot)
        state[state == ENDED] = EMPTY
        live = np.flatnonzero(state == LIVE)
        bodies.high = int(live[-1]) + 1 if len(live) else 0

    def settle(self, window: Window, log: dict[str, NDArray[Any]], count: int) -> Settled:
        """The objects of a window, by its sightings and those of the one after: the first `count` of the log."""
        stop = window.begin + window.count
        least = -math.inf if window.is_placed else self.least_odds
        seen = _Sightings(log, count, self.things, stop, least)
        grouping.join(seen, self.things, window.begin, stop)
        self._judge(seen, window.is_placed)
        motions.smooth(seen, self.things)
        at, found = seen.find(window)
        self._sum_up(window, seen)
        if self.naming is not None:
            self._name(self.naming, window, seen, at, found)
        settled = _rows(seen, at, found, window.objects)
        self._forget(stop)
        return settled

    def _judge(self, seen: _Sightings, is_placed: bool) -> None:
        """Decide which tracks with rows in this window are things, and number those that are new, by first sight.

        Where nobody knows where the sensor was, what seems to be one thing may be several: then each sweep is for itself.
        """
        for number in seen.in_window:
            thing, span = self.things[number], seen.spans[number]
            if thing.track is None:
                Track().absorb(thing)
            odds, now = seen.column("odds", span), seen.now[span]
            thing.odds += float(odds[now].sum())
            thing.judged += int(np.count_nonzero(now))
            seen.ahead[number] = float(odds[~now].sum()), int(np.count_nonzero(~now))
            thing.row_shape = summary.row_shape(thing)
        tracks = {id(track): track for n in seen.in_window if (track := self.things[n].track) is not None}
        for track in tracks.values():
            if is_placed:
                track.decide(seen.ahead, self.least_odds)
            else:
                track.is_thing = None
            if track.is_thing is not False and track.number == 0:
                self.tracks.append(track)
                track.number = len(self.tracks)
        seen.in_window = [n for n in seen.in_window if _is_thing(self.things[n])]

    def _sum_up(self, window: Window, seen: _Sightings) -> None:
        """Add what a window says to the tracks."""
        index, stamps, frames = (
            np.concatenate(values) for values in (window.index, window.stamps, window.frames)
        )
        for track, at in seen.by_track():
            sweeps = seen.sweep[at]
            firsts = at
            if not isinstance(at, slice):
                # Of several parts in one sweep the first stands for all.
                sweeps, first = np.unique(sweeps, return_index=True)
                firsts = at[first]
            times = seen.time[firsts]
            begin, end = int(sweeps[0]) - window.begin, int(sweeps[-1]) - window.begin
            if track.sweeps == 0:
                track.first = (index.item(begin), stamps.item(begin))
                track.frame = frames.item(begin)
                track.last_sweeps, track.last_time = int(sweeps[0]), float(times[0])
            missed = int(sweeps[-1]) - track.last_sweeps - len(sweeps) + (track.sweeps == 0)
            if missed > 0:
                gaps = np.diff(times, prepend=track.last_time)
                steps = np.diff(sweeps, prepend=track.last_sweeps)
                # Of a pause of several sweeps one is the usual time from sight to sight.
                track.hidden += float((gaps * (1.0 - 1.0 / np.maximum(steps, 1))).sum())
            track.last = (index.item(end), stamps.item(end))
            track.last_sweeps, track.last_time = int(sweeps[-1]), float(times[-1])
            track.sweeps += len(sweeps)
            if track.moved:
                _sum_up_motion(track, seen, firsts, times)
                agent = np.flatnonzero(seen.agent[firsts])
                if len(agent) and not track.is_agent:
                    track.is_agent = True
                    track.onset_ns = stamps.item(int(sweeps[agent[0]]) - window.begin)
            last = seen.sweep[at] == sweeps[-1]
            track.x, track.y = float(seen.x[at][last].mean()), float(seen.y[at][last].mean())

    def _name(self, naming: Naming, window: Window, seen: _Sightings, at: Int64, found: Bool) -> None:
        """Name the tracks of a window, by what it says."""
        number, axes = np.zeros(len(found), np.int64), np.full(len(found), np.nan)
        number[found] = seen.number[at]
        axes[found] = np.where(
            seen.column("centred")[at] != 0,
            np.nan,
            np.arctan2(seen.column("sin")[at], seen.column("cos")[at]),
        )
        naming.take(window.looks, number, axes, self.things)
        naming.name(seen.tracks())

    def _forget(self, stop: int) -> None:
        """Let go of what is over; the track keeps its parts."""
        over = [n for n, thing in self.things.items() if thing.has_ended and thing.last_sweep < stop]
        for track in {id(track): track for n in over if (track := self.things[n].track) is not None}.values():
            track.let_go(stop)
        for number in over:
            del self.things[number]
        if self.naming is not None:
            self.naming.forget(over)


def _is_thing(thing: Thing) -> bool:
    return thing.track is not None and thing.track.is_thing is not False


def _sum_up_motion(track: Track, seen: _Sightings, at: Any, times: Float64) -> None:
    """Add the way and the speed of a track that moves."""
    speed, going = np.hypot(seen.vx[at], seen.vy[at]), seen.moving[at]
    lapse = np.minimum(np.diff(times, append=times[-1]), LONGEST_LAPSE)
    track.distance += float((speed * lapse * going).sum())
    track.speed_max = max(track.speed_max, float(speed.max(initial=0.0)))


class _Sightings:
    """The sightings of bodies that are believed, with what is found out about them."""

    def __init__(
        self, log: dict[str, NDArray[Any]], count: int, things: dict[int, Thing], stop: int, least: float
    ) -> None:
        """
        Parameters
        ----------
        log, count : the sightings, and how many of them there are
        things : the bodies that are believed
        stop : sweeps of the topic up to the end of the window
        least : sightings of the window with less log-odds of being a thing are left out
        """
        number = log["number"][:count]
        believed = np.fromiter(things, np.int64, len(things))
        asked = (log["odds"][:count] >= least) | (log["sweep"][:count] >= stop)
        keep = np.flatnonzero(np.isin(number, believed) & asked)
        # Of a leg most sightings may be those of its person; what is left of it is too little for a track.
        seen, counts = np.unique(number[keep], return_counts=True)
        few = [n for n in seen[counts < CONFIRMED].tolist() if things[n].track is None]
        if few:
            keep = keep[~np.isin(number[keep], few)]
        # In the order of the log within each body.
        keep = keep[np.argsort(number[keep], kind="stable")]
        self.number: Int64 = number[keep]
        self._log, self._keep = log, keep
        self.sweep: Int64 = self.column("sweep")
        self.time: Float64 = self.column("time")
        self.object: Int64 = self.column("object")
        self.x: Float64 = self.column("x")
        self.y: Float64 = self.column("y")
        self.things = things
        self.now: Bool = self.sweep < stop
        """Whether it is in the window, or in the one after."""
        size = len(keep)
        self.vx, self.vy = np.zeros(size), np.zeros(size)
        self.moving, self.agent = np.zeros(size, bool), np.zeros(size, bool)
        numbers, begins = np.unique(self.number, return_index=True)
        ends = np.append(begins, size)[1:]
        self.spans = {int(n): slice(int(b), int(e)) for n, b, e in zip(numbers, begins, ends, strict=True)}
        """Body → its sightings."""
        first: dict[int, int] = {}
        for n, span in self.spans.items():
            if self.now[span.start]:
                first[n] = int(self.object[span.start])
        self.in_window = sorted(first, key=first.__getitem__)
        """Bodies with a row in the window, by first sight; once they are judged, those of things."""
        self.ahead: dict[int, tuple[float, int]] = {}
        """Body → sum of the log-odds of its sightings in the window after, and how many these are."""

    def column(self, name: str, of: slice = EVERYTHING) -> NDArray[Any]:
        """A column of the log of sightings, or some of it."""
        return self._log[name][self._keep[of]]

    def find(self, window: Window) -> tuple[Int64, Bool]:
        """Of the objects of a window those that are sightings, and which of all these are: further parts of a body, too."""
        numbers = np.concatenate(window.numbers) if window.numbers else np.empty(0, np.int64)
        sweeps = np.concatenate(window.sweeps) if window.sweeps else np.empty(0, np.int64)
        # Sightings are in order of body, then sweep: so are these keys.
        keys = (self.number << 32) + self.sweep
        wanted = (numbers << 32) + sweeps
        at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        found = keys[at] == wanted if len(keys) else np.zeros(len(numbers), bool)
        return at[found], found

    def tracks(self) -> list[Track]:
        """Tracks with sightings in the window."""
        parts = (self.things[number].track for number in self.in_window)
        return list({track.number: track for track in parts if track is not None}.values())

    def by_track(self) -> list[tuple[Track, Any]]:
        """Tracks with sightings in the window, and these in the order of the log: a slice, or indices of several bodies."""
        members: dict[int, list[slice]] = {}
        tracks: dict[int, Track] = {}
        for number in self.in_window:
            span, track = self.spans[number], self.things[number].track
            assert track is not None
            now = int(np.count_nonzero(self.now[span]))
            members.setdefault(track.number, []).append(slice(span.start, span.start + now))
            tracks[track.number] = track
        return [(tracks[number], self._in_order(spans)) for number, spans in members.items()]

    def _in_order(self, spans: list[slice]) -> Any:
        """Sightings of several bodies in the order of the log; those of one that is seen once a sweep are as they are."""
        first = spans[0]
        if len(spans) == 1 and self.things[int(self.number[first.start])].kind != PERSON:
            return first
        at = np.concatenate([np.arange(span.start, span.stop) for span in spans])
        return at[np.argsort(self.sweep[at], kind="stable")]


def _rows(seen: _Sightings, at: Int64, found: Bool, objects: int) -> Settled:
    """What the sightings `at` say of those objects of a window that were found, further parts of a body among them.

    Parameters
    ----------
    objects : of the topic before the window
    """
    size = len(seen.number)
    track_of, label_of, score_of = (
        np.zeros(size, np.int64),
        np.full(size, -1, np.int32),
        np.full(size, np.nan),
    )
    for number in seen.in_window:
        track = seen.things[number].track
        assert track is not None
        span = seen.spans[number]
        track_of[span], label_of[span], score_of[span] = track.number, track.label, track.label_score

    verdict, thing, shape = (
        np.full(size, -1, np.int8),
        np.full(size, np.nan),
        np.full(size, UNKNOWN, np.uint8),
    )
    for number, span in seen.spans.items():
        body = seen.things[number]
        if body.track is not None and body.track.is_thing is not None:
            verdict[span], thing[span] = body.track.is_thing, body.track.thing
            shape[span] = body.row_shape

    def column(values: NDArray[Any], empty: Any) -> NDArray[Any]:
        out = np.full(len(found), empty, values.dtype)
        out[found] = values[at]
        return out

    judged = column(verdict, -1)
    # A further part of a body may be something else beside it: nobody has judged it.
    judged[found & (column(seen.object, -1) != objects + np.arange(len(found)))] = -1
    return Settled(
        track=column(track_of, 0),
        vx=column(seen.vx, np.nan),
        vy=column(seen.vy, np.nan),
        moving=column(seen.moving, False),
        agent=column(seen.agent, False),
        label=column(label_of, -1),
        label_score=column(score_of, np.nan),
        is_thing=judged,
        thing=column(thing, np.nan),
        shape=column(shape, UNKNOWN),
    )
