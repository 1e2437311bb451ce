"""Windows of sweeps. Each is settled when the next one has been observed: tracklets get their tracks, objects their
rows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import UNKNOWN, starts
from lidarcli.formalism.tracking import joins
from lidarcli.formalism.tracking.agents import judge, own_body
from lidarcli.formalism.tracking.kalman import Sightings, Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.legs import assign_legs
from lidarcli.formalism.tracking.results import CONFIRMED_SIGHTINGS, EMPTY, ENDED, LIVE, PERSON, Trajectories
from lidarcli.formalism.tracking.smoothing import KEPT, Smoother
from lidarcli.formalism.tracking.track_labels import SizeMeasurements, TrackLabels
from lidarcli.formalism.tracking.tracks import Track, Tracklet, columns_of, row_shape
from lidarcli.formalism.tracking.trajectories import PARTLY_BIT, PARTS_MASK, Sweeps, TrackPiece, joined, standing
from lidarcli.sweeps.types import Bool, Float64, Int64, UInt8

MAX_PLACED = 0.5
"""Share of the sweeps of a window with a known place of the sensor, above which places of before still hold."""
LEGS_APART = 0.3
"""[m] Least width of an object that is both legs of a person."""


@dataclass(slots=True)
class Window:
    """Sweeps that are settled together, in pieces as the batches bring them."""

    begin: int
    """Number of sweeps before."""
    numbers: list[Int64] = field(default_factory=list)
    """(K,) number of the tracklet of each object, 0 for none."""
    sweeps: list[Int64] = field(default_factory=list)
    """(K,) number of sweeps of the topic before that of each object."""
    sizes: list[SizeMeasurements] = field(default_factory=list)
    """Measured sizes of each object, where tracks are named."""
    count: int = 0
    """Number of its sweeps so far."""
    pieces: list[tuple[Any, slice, int]] = field(default_factory=list)
    """Batches that its objects are of, which of theirs these are, and how many sweeps."""


RESULT = np.dtype(
    [
        ("track", np.int64),
        ("vx", np.float64),
        ("vy", np.float64),
        ("moving", np.bool_),
        ("agent", np.bool_),
        ("agent_score", np.float64),
        ("label", np.int32),
        ("label_score", np.float64),
        ("shape", np.uint8),
    ]
)
"""Fields of the result of a window for an object."""

WindowResult: TypeAlias = NDArray[np.void]
"""(K,) `RESULT` of the objects of a window."""


class TrackRegistry:
    """All confirmed tracklets, and the tracks they are parts of."""

    def __init__(
        self, least_score: float, labels: TrackLabels | None = None, every: list[Track] | None = None, before: int = 0
    ) -> None:
        """
        Parameters
        ----------
        least_score : least score of an agent
        labels : labels of tracks, if there is a catalogue
        every : takes the tracks of all sensors of the topic, by number
        before : number of tracks before these
        """
        self._least_score = least_score
        self._every = [] if every is None else every
        self._before = before
        self.labels = labels
        """Labels of tracks, if there is a catalogue."""
        self.tracklets: dict[int, Tracklet] = {}
        """Tracklets by number; one that has ended stays as long as a later one may be joined to it."""
        self.tracks: list[Track] = []
        """Tracks by number."""
        self.sweeps = Sweeps()
        self.own_places: dict[int, set[complex]] = {}
        """Sensor → places of its frame where the robot itself is visible (`agents.own_body`)."""
        self.trajectories: list[Trajectories] = []
        """Rows of settled windows that nobody has fetched yet, in the order of the windows."""

    def collect(self, tracklets: Targets) -> None:
        """Copy the state of all confirmed targets, and free the slots of those that have ended."""
        arrays = tracklets.arrays
        state = arrays["state"][: tracklets.slots_used]
        confirmed = (state != EMPTY) & (arrays["sightings"][: tracklets.slots_used] >= CONFIRMED_SIGHTINGS)
        columns = columns_of(arrays, np.flatnonzero(confirmed))
        for k, number in enumerate(columns["number"]):
            tracklet = self.tracklets.get(number)
            if tracklet is None:
                tracklet = self.tracklets[number] = Tracklet(number)
            tracklet.take(columns, k)
        state[state == ENDED] = EMPTY
        live = np.flatnonzero(state == LIVE)
        tracklets.slots_used = int(live[-1]) + 1 if len(live) else 0

    def settle(self, window: Window, recorded: Sightings, keyframes: Keyframes) -> WindowResult:
        """Settle a window by its sightings and those of the next one: join tracklets to tracks, number them, smooth the
        paths of what moves, and name the tracks. Return the results for its objects.
        """
        stop = window.begin + window.count
        is_placed = float(self.sweeps.of(window.begin, stop)["placed"].mean()) > MAX_PLACED
        sightings = WindowSightings(recorded, self.tracklets, stop, keyframes, is_placed)
        self._join(sightings, is_placed)
        self._number(sightings)
        sensors = self.sweeps.sensors_of(sightings.sweep)
        for sensor in np.flatnonzero(np.bincount(sensors)).tolist():
            mine = np.flatnonzero(sensors == sensor)
            sightings.own[mine] = own_body(sightings, mine, self.own_places.setdefault(sensor, set()))
        self._extend_trajectories(sightings, smooth(sightings, self.tracklets, self._least_score))
        at, found = sightings.find(window)
        if sightings.tracks:
            self._update_statistics(window, sightings)
        if self.labels is not None:
            self._label(self.labels, window, sightings, at, found)
        settled = _rows(sightings, at, found)
        self._forget(sightings, stop, is_placed)
        return settled

    def _join(self, sightings: WindowSightings, is_placed: bool) -> None:
        """Join the tracklets that are new in a window to the tracks that they belong to.

        Where the place of the sensor is known, legs next to a person are given to that person.
        """
        new = [self.tracklets[number] for number in sightings.in_window if self.tracklets[number].track is None]
        joins.merge_duplicates(sightings, new, self.tracklets)
        joins.join_legs(sightings, self.tracklets)
        if is_placed:
            assign_legs(sightings, self.tracklets)
        # Tracklets with sightings of their own, whose tracks have no row yet.
        begun = [
            tracklet
            for tracklet in new
            if (tracklet.track is None or tracklet.track.number == 0)
            and (sightings.owner[sightings.spans[tracklet.number]] == tracklet.number).any()
        ]
        joins.join_halves(sightings, begun, self.tracklets)
        is_longer = joins.stitch(sightings, begun, self.tracklets)
        if is_placed and is_longer:
            # The pieces of a person make a longer path.
            assign_legs(sightings, self.tracklets)

    def _number(self, sightings: WindowSightings) -> None:
        """Number the new tracks with rows in this window by first sighting."""
        sightings.settle_owners()
        for number in sightings.owners:
            tracklet = self.tracklets[number]
            if tracklet.track is None:
                Track().add_part(tracklet)
            assert tracklet.track is not None
            if tracklet.track.number == 0:
                self.tracks.append(tracklet.track)
                self._every.append(tracklet.track)
                tracklet.track.number = self._before + len(self._every)
            tracklet.row_shape = row_shape(tracklet)
        sightings.settle_tracks()

    def _extend_trajectories(self, sightings: WindowSightings, paths: list[TrackPiece]) -> None:
        """Add the rows of what moves, and keep the codes of the sweeps in which the rest was observed."""
        moving = {path.track.number for path in paths}
        for track, at in sightings.by_track():
            if track.number not in moving:
                sweep = sightings.sweep[at]
                begin = int(sweep[0]) if track.path_stop < 0 else track.path_stop
                codes = sightings.bytes_of(at, sweep - begin, int(sweep[-1]) + 1 - begin)
                track.static_codes.append(codes)
                track.path_stop = begin + len(codes)
        for path in paths:
            if path.track.static_codes and path.begin > path.track.path_stop:
                path.track.static_codes.append(np.zeros(path.begin - path.track.path_stop, np.uint8))
                path.track.path_stop = path.begin
        self.trajectories += standing(self.sweeps, [path.track for path in paths])
        if paths:
            self.trajectories.append(joined(self.sweeps, paths))
        for path in paths:
            path.add_to_track()

    def _update_statistics(self, window: Window, sightings: WindowSightings) -> None:
        """Add the sightings of a window to the sums of the tracks."""
        rows = self.sweeps.of(window.begin, window.begin + window.count)
        index, stamps, sensors = rows["index"], rows["stamp_ns"], rows["sensor"]
        tracks = sightings.by_track()
        every = np.concatenate([at for _, at in tracks])
        edges = np.cumsum([0, *(len(at) for _, at in tracks)])
        scores = np.maximum.reduceat(sightings.agent_score[every], edges[:-1])
        scores = np.fmax([track.best_score for track, _ in tracks], scores).tolist()
        # The first of several parts in one sweep stands for all.
        first = starts((sightings.track[every] << 32) + sightings.sweep[every])
        ends = np.searchsorted(first, edges).tolist()
        columns = every[first], sightings.sweep[every[first]], sightings.time[every[first]]
        one = {*sensors[:1].tolist()} if (sensors == sensors[0]).all() else None
        for (track, at), score, *span in zip(tracks, scores, ends[:-1], ends[1:], strict=True):
            track.best_score = score
            firsts, sweeps, times = (values[slice(*span)] for values in columns)
            begin, end = int(sweeps[0]) - window.begin, int(sweeps[-1]) - window.begin
            if track.sweeps == 0:
                track.first = (index.item(begin), stamps.item(begin))
                track.last_sweeps, track.last_time = int(sweeps[0]), float(times[0])
            missed = int(sweeps[-1]) - track.last_sweeps - len(sweeps) + (track.sweeps == 0)
            if missed > 0:
                gaps = np.diff(times, prepend=track.last_time)
                steps = self.sweeps.steps(track.last_sweeps, sweeps)
                # One sweep of a pause is the usual time from sighting to sighting.
                track.hidden += float((gaps * (1.0 - 1.0 / np.maximum(steps, 1))).sum())
            track.last = (index.item(end), stamps.item(end))
            track.last_sweeps, track.last_time = int(sweeps[-1]), float(times[-1])
            track.sensors |= one or {*sensors[sweeps - window.begin].tolist()}
            track.sweeps += len(sweeps)
            if track.moved:
                goes = np.flatnonzero(sightings.goes[firsts])
                track.is_agent = track.is_agent or bool(sightings.agent[firsts].any())
                if len(goes) and track.onset_ns == 0:
                    track.onset_ns = stamps.item(int(sweeps[goes[0]]) - window.begin)
            else:
                last = sightings.sweep[at] == sweeps[-1]
                track.x, track.y = float(sightings.x[at][last].mean()), float(sightings.y[at][last].mean())

    def _label(self, labels: TrackLabels, window: Window, sightings: WindowSightings, at: Int64, found: Bool) -> None:
        """Label the tracks of a window."""
        number, axes = np.zeros(len(found), np.int64), np.full(len(found), np.nan)
        number[found] = np.where(sightings.owner[at] == sightings.number[at], sightings.number[at], 0)
        centred, sin, cos = (sightings.column(name, at) for name in ("centred", "sin", "cos"))
        axes[found] = np.where(centred != 0, np.nan, np.arctan2(sin, cos))
        labels.take(window.sizes, number, axes, self.tracklets)
        labels.label([track for track, _ in sightings.by_track()])

    def _forget(self, sightings: WindowSightings, stop: int, is_placed: bool) -> None:
        """Drop the tracklets that have ended and are not joined to later ones; their tracks keep them as parts."""
        settled = [n for n, tracklet in self.tracklets.items() if tracklet.has_ended and tracklet.last_sweep < stop]
        for number in settled:
            joins.store_end(sightings, self.tracklets[number])
        until = float(sightings.time[sightings.now].max(initial=-math.inf))
        over = [n for n in settled if not is_placed or joins.is_expired(self.tracklets[n], until)]
        for track in {id(track): track for n in over if (track := self.tracklets[n].track) is not None}.values():
            track.prune(stop)
        for number in over:
            del self.tracklets[number]
        if self.labels is not None:
            self.labels.forget(over)


class WindowSightings:
    """Sightings (N,) of the confirmed tracklets, by tracklet, and the results for them."""

    def __init__(
        self, recorded: Sightings, tracklets: dict[int, Tracklet], stop: int, keyframes: Keyframes, is_placed: bool
    ) -> None:
        """
        Parameters
        ----------
        recorded : all sightings of the window and the next one
        tracklets : confirmed tracklets, by number
        stop : number of sweeps of the topic up to the end of the window
        keyframes : those before and after the window
        is_placed : True if the place of the sensor is known
        """
        self.recorded, count = recorded, recorded.count
        self.keyframes, self.is_placed = keyframes, is_placed
        number = recorded.arrays["number"][:count]
        # In the order of the log within each tracklet.
        keep = np.argsort(number, kind="stable")
        self.number: Int64 = number[keep]
        begins = starts(self.number)
        numbers, counts = self.number[begins].tolist(), np.diff(begins, append=count)
        spans = {
            n: slice(begin, begin + many)
            for n, begin, many in zip(numbers, begins.tolist(), counts.tolist(), strict=True)
            # Most sightings of a leg may belong to its person; the rest is too little for a track.
            if n in tracklets and (many >= CONFIRMED_SIGHTINGS or tracklets[n].track is not None)
        }
        self.spans = spans
        """Sightings of each confirmed tracklet, by its number."""
        self.owner: Int64 = np.repeat(np.array([n if n in spans else 0 for n in numbers], np.int64), counts)
        """(N,) number of the tracklet to whose track each sighting belongs; 0 for none."""
        self.track: Int64 = np.zeros(len(keep), np.int64)
        """(N,) number of the track of each sighting; 0 without one that has a row in the window."""
        self.keep: Int64 = keep
        """(N,) index of each among the recorded ones."""
        self.sweep: Int64 = self.column("sweep")
        self.time: Float64 = self.column("time")
        self.object: Int64 = self.column("object")
        self.x: Float64 = self.column("x")
        self.y: Float64 = self.column("y")
        self.ahead: Float64 = self.column("ahead")
        self.left: Float64 = self.column("left")
        self.travelled: Float64 = self.column("travelled")
        """(N,) place in the sensor frame, and distance that the sensor had gone [m]."""
        self.width: Float64 = 2.0 * np.maximum(self.column("half_1"), self.column("half_2"))
        """(N,) width of the tracklet at each sighting [m]."""
        self.view: Any = self.column("middle_x") + 1j * self.column("middle_y")
        """(N,) middle of the view x + iy [m]."""
        self.place = self.x + 1j * self.y
        """(N,) place x + iy [m]."""
        self.tracklets = tracklets
        self.now: Bool = self.sweep < stop
        """(N,) True in the window, False in the next one."""
        size = len(keep)
        self.vx, self.vy = np.zeros(size), np.zeros(size)
        self.moving, self.agent, self.goes = np.zeros(size, bool), np.zeros(size, bool), np.zeros(size, bool)
        self.agent_score = np.full(size, 0.0 if is_placed else math.nan)
        """(N,) probability that the track has gone by then (`agents.judge`)."""
        self.own = np.zeros(size, bool)
        """(N,) True where the robot itself is visible."""
        first: dict[int, int] = {}
        for n, span in self.spans.items():
            if self.now[span.start]:
                first[n] = int(self.object[span.start])
        self.in_window = sorted(first, key=first.__getitem__)
        """Numbers of the tracklets with a row in the window, by first sighting."""
        self.owners: list[int] = []
        self.tracks: list[tuple[Track, Int64, int]] = []

    def column(self, name: str, at: Any = slice(None)) -> Any:
        """Return a column of the recorded sightings, or of some of them."""
        return self.recorded.arrays[name].take(self.keep[at])

    def find(self, window: Window) -> tuple[Int64, Bool]:
        """Return the sightings of the objects of a window, and (K,) which objects have one, as parts of a tracklet too."""
        numbers = np.concatenate(window.numbers) if window.numbers else np.empty(0, np.int64)
        sweeps = np.concatenate(window.sweeps) if window.sweeps else np.empty(0, np.int64)
        # Sightings are in order of tracklet, then sweep: so are these keys.
        keys = (self.number << 32) + self.sweep
        wanted = (numbers << 32) + sweeps
        at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        found = (keys[at] == wanted) & (self.track[at] > 0) if len(keys) else np.zeros(len(numbers), bool)
        return at[found], found

    def settle_owners(self) -> None:
        """Find the tracklets whose tracks have rows in the window, once each sighting has its owner."""
        begins = starts(self.owner)
        self._runs = np.diff(begins, append=len(self.owner))
        self._owner_of_run = self.owner[begins].tolist()
        later = np.iinfo(np.int64).max
        first = np.minimum.reduceat(np.where(self.now, self.object, later), begins).tolist() if len(begins) else []
        sightings: dict[int, int] = {}
        for number, at in zip(self._owner_of_run, first, strict=True):
            if number and at < later:
                sightings[number] = min(sightings.get(number, at), at)
        self.owners = sorted(sightings, key=sightings.__getitem__)

    def of_owner(self, value: Callable[[Tracklet], Any], empty: Any, kind: Any) -> NDArray[Any]:
        """Return (N,) a value of the owner of each sighting, `empty` without an owner."""
        values = [value(self.tracklets[number]) if number else empty for number in self._owner_of_run]
        return np.repeat(np.array(values, kind), self._runs)

    def settle_tracks(self) -> None:
        """Find the sightings of each track, once those with rows in the window have a number."""
        self.track = self.of_owner(lambda tracklet: 0 if tracklet.track is None else tracklet.track.number, 0, np.int64)
        order = np.flatnonzero(self.track)
        order = order[np.argsort((self.track[order] << 32) + self.sweep[order], kind="stable")]
        begins = starts(self.track[order])
        if not len(begins):
            return
        counts = np.add.reduceat(self.now[order], begins, dtype=np.int64).tolist()
        owners = self.owner[order[begins]].tolist()
        for owner, at, count in zip(owners, np.split(order, begins[1:]), counts, strict=True):
            track = self.tracklets[owner].track
            if count and track is not None:
                self.tracks.append((track, at, count))

    def by_track(self, *, ahead: bool = False) -> list[tuple[Track, Int64]]:
        """Return the tracks with sightings in the window, and these in the order of the log.

        `ahead`: with their sightings in the next window.
        """
        return [(track, at if ahead else at[:count]) for track, at, count in self.tracks]

    def bytes_of(self, at: Any, step: Int64, count: int) -> UInt8:
        """Return (count,) the bytes of the sweeps of a track (`tracks.PARTS_MASK`).

        Parameters
        ----------
        at : its N sightings
        step : (N,) their sweeps, as indices
        """
        parts = np.minimum(np.bincount(step, minlength=count), PARTS_MASK)
        hidden, owners = np.zeros(count, bool), self.owner[at]
        hidden[step[self.column("whole", at) == 0]] = True
        if any(self.tracklets[number].has_legs for number in set(owners[starts(owners)].tolist())):
            # One leg hides the other.
            hidden = (parts == 1) & (np.bincount(step, self.column("chord", at), count) < LEGS_APART)
        return (parts + np.where(hidden & (parts > 0), PARTLY_BIT, 0)).astype(np.uint8)


def _rows(sightings: WindowSightings, at: Int64, found: Bool) -> WindowResult:
    """Return the results for the objects of a window, by the sightings `at` of those that are `found`."""
    no_track = (0, np.nan, np.nan, False, False, np.nan, -1, np.nan, UNKNOWN)
    rows = np.full(len(found), np.array(no_track, RESULT))
    known = np.empty(len(at), RESULT)
    for name in ("track", "vx", "vy", "moving", "agent", "agent_score"):
        known[name] = getattr(sightings, name)[at]
    known["label"] = sightings.of_owner(lambda one: -1 if one.track is None else one.track.label, -1, np.int32)[at]
    known["label_score"] = sightings.of_owner(
        lambda one: np.nan if one.track is None else one.track.label_score, np.nan, np.float64
    )[at]
    known["shape"] = sightings.of_owner(lambda one: one.row_shape, UNKNOWN, np.uint8)[at]
    rows[found] = known
    return rows


def smooth(sightings: WindowSightings, tracklets: dict[int, Tracklet], least_score: float) -> list[TrackPiece]:
    """Smooth everything that moves: fill in its velocities and from where on it is an agent; return the paths."""
    moving = [(track, at) for track, at in sightings.by_track(ahead=True) if is_moving(track)]
    if not moving:
        return []
    first = min([int(sightings.sweep.min()), *(track.path_stop for track, _ in moving if track.path_stop >= 0)])
    smoother = Smoother(max(len(at) for _, at in moving), int(sightings.sweep.max()) + 1 - first)
    paths = (_smooth_track(sightings, tracklets, track, at, smoother, least_score) for track, at in moving)
    return [path for path in paths if path is not None]


def is_moving(track: Track) -> bool:
    """Return whether a track has gone, or one of its tracklets seems to."""
    return track.moved or any(part.moved for part in track.parts)


def _smooth_track(
    sightings: WindowSightings,
    tracklets: dict[int, Tracklet],
    track: Track,
    at: Int64,
    smoother: Smoother,
    least_score: float,
) -> TrackPiece | None:
    """Fill in the velocities of a track, by all of its sightings, and return its path in the window."""
    is_person = any(part.kind == PERSON for part in track.parts)
    several = track.several or any(part.has_legs for part in track.parts)
    # By tracklet.
    at = np.sort(at)
    order = np.argsort(sightings.sweep[at], kind="stable")
    sighted = sightings.sweep[at][order]
    last = int(sighted[sightings.now[at][order]][-1])
    begin = int(sighted[0]) if track.path_stop < 0 or track.state is None else track.path_stop
    # All sweeps of the window, hidden ones too, and those of the next one that see it.
    ahead = sighted[sighted > last]
    sweeps = np.append(np.arange(begin, last + 1), ahead[starts(ahead)])
    step, count = np.searchsorted(sweeps, sighted), len(sweeps)
    stop = 0
    rows = sightings.keep[at]
    begins = starts(sightings.number[at])
    for number, own in zip(sightings.number[at[begins]].tolist(), np.split(rows, begins[1:]), strict=True):
        tracklet = tracklets.get(number) or Tracklet(number)
        sides = zip(tracklet.side, tracklet.side_weight, tracklet.h, strict=True)
        half = np.array([0.5 * side if weight > 0.0 else h for side, weight, h in sides])
        stop = smoother.locate(
            stop, sightings.recorded, own, half, np.array(tracklet.hh), tracklet.kind, several and not is_person
        )
    state = track.state
    if state is None:
        state = track.state = np.full(KEPT, np.nan)
    times, known = sightings.time[at][order], state[0]
    if math.isnan(known):
        time = np.interp(sweeps, sighted, times)
    else:
        time = np.interp(sweeps, np.append(begin - 1, sighted), np.append(known, times))
    codes = sightings.bytes_of(at, step, count)
    legs = np.zeros(count, np.uint8)
    if is_person:
        wide = np.bincount(step, sightings.column("chord", at[order]) > LEGS_APART, count) > 0
        legs[:] = np.where(wide | (codes & PARTS_MASK > 1), 2, 1)
    parts, path, moving = np.empty(count, np.int64), np.empty((count, 9)), np.empty(count, np.uint8)
    smoother.measure(order, step, parts, legs)
    keep = last + 1 - begin
    smoother.smooth(time, parts, legs, state, keep, path, moving)
    at = at[order]
    verdict = judge(sightings, track, at, step, time, moving, least_score)
    sightings.agent_score[at] = verdict.score[step]
    if not track.is_agent:
        if not verdict.agent[step].any():
            track.moved, track.state = False, None
            return None
        onset = int(np.argmax(verdict.goes))
        path[:onset, [2, 3, 7, 8]] = 0.0
        moving[:onset] = 0
    moving[step] &= verdict.goes[step]
    sightings.vx[at], sightings.vy[at], sightings.moving[at] = path[step, 2], path[step, 3], moving[step]
    sightings.agent[at], sightings.goes[at] = verdict.agent[step], verdict.goes[step]
    track.moved = True
    end = int(at[sightings.now[at]][-1])
    track.was_agent, track.agent_score = bool(sightings.agent[end]), float(sightings.agent_score[end])
    track.last_view = complex(sightings.view[at[sightings.sweep[at] == sightings.sweep[end]]].mean())
    return TrackPiece(track, begin, path[:keep], codes[:keep], moving[:keep])
