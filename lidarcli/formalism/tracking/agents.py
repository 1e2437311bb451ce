"""Which tracks are agents (set A, Def. 4): what passes through places that are free before it comes or after it has gone.

A track is parted into stretches at its jumps. A stretch has a score, the probability that it goes: by how clearly its
places are observed free, by how many of them lie on its path, and by its greatest step. After a jump it is still the same
agent, unless something stood at the new place while it was observed elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidarcli.formalism.detection import starts
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.results import MIN_WAY
from lidarcli.formalism.tracking.tracks import Track, main_part
from lidarcli.sweeps.types import Bool, Float64, Int64, UInt8, median


@dataclass(frozen=True)
class AgentRules:
    """When a track is an agent."""

    places_apart: float = 0.06
    """[m] A stretch is examined at places that are at least so far apart."""
    min_jump: float = 0.4
    """[m] A track jumps where it is further than this from where it is expected, or than its size if that is larger, ..."""
    largest: float = 2.0
    """[m] ... of which no more than this counts."""
    min_looks: float = 1.5
    """Looks at a place, before or after, of less weight do not decide whether it is free."""
    between: float = 0.2
    """A place lies on the path of a stretch if it is further from both ends than this share of the path."""
    odds: float = -2.55
    """[log-odds] That a stretch goes without evidence. This and the next three are of a logistic regression on 29 real logs
    that were labelled by eye and on simulated ones (docs/tracking.md)."""
    balance: float = 1.45
    """[log-odds] By the mean balance of the looks at its places, from -1 (all hit) to 1 (all free)."""
    places: float = 1.05
    """[log-odds] By the logarithm of 1 + the number of free places on its path."""
    step: float = -0.38
    """[log-odds] By the logarithm of its greatest step over the length of its path."""
    min_step_share: float = 0.02
    """Added to that ratio."""
    shortest_path: float = 0.05
    """[m] A shorter path counts as this."""
    seconds_before: float = 1.0
    """[s] What goes has begun so long before that is shown, ..."""
    rest: float = 0.5
    """[s] ... unless it rested at one place for so long."""
    body_reach: float = 1.2
    """[m] What is further from the sensor is no part of the robot."""
    body_cell: float = 0.06
    """[m] Resolution of the places of parts of the robot."""
    body_share: float = 0.6
    """A part of the robot is at its place on this share of the path of the sensor, ..."""
    body_path: float = 2.0
    """[m] ... which is no shorter than this."""


AGENTS = AgentRules()


@dataclass(frozen=True, slots=True)
class AgentVerdict:
    """Verdict on a track in each of the S sweeps of a window and the next one."""

    agent: Bool
    """(S,) True in set A."""
    goes: Bool
    """(S,) True where it goes by itself."""
    score: Float64
    """(S,) probability that it has gone by then; NaN where the place of the sensor is not known."""


def judge(sightings: Any, track: Track, at: Int64, step: Int64, time: Float64, moving: UInt8, least: float) -> AgentVerdict:
    """Evaluate a track that seems to move.

    Parameters
    ----------
    sightings : sightings of the window and the next one (`windows.WindowSightings`)
    at : (N,) those of the track, in the order of the log
    step : (N,) their sweeps, as indices into the S sweeps of its path
    time : (S,) times of these [s]
    moving : (S,) 1 where its smoothed speed is shown
    least : least score of an agent
    """
    firsts = starts(step)
    seen = step[firsts]
    place, when = np.add.reduceat(sightings.view[at], firsts) / np.bincount(step)[seen], time[seen]
    rows, moves = sightings.keep[at[firsts]], moving[seen] == 1
    own = np.logical_or.reduceat(sightings.own[at], firsts)
    far = max(AGENTS.min_jump, min(2.0 * max(main_part(track).h), AGENTS.largest) + MIN_WAY)
    picks = _picks(place)
    balance = _balance(sightings, sightings.keyframes, at, step, seen[picks])
    agent, goes, score = np.zeros(len(seen), bool), np.zeros(len(seen), bool), np.zeros(len(seen))
    was, known, last, then = track.was_agent, track.agent_score, track.last_view, track.last_time
    begins = [0, *_jumps(place, when, far)]
    for b, e in zip(begins, [*begins[1:], len(seen)], strict=True):
        if was and abs(place[b] - last) > far:
            was = not sightings.keyframes.stood(sightings.recorded, rows.item(b), -math.inf, then)
        known = known if was and known > 0.0 else 0.0
        of = slice(*np.searchsorted(picks, [b, e]))
        some = picks[of]
        chance, onset = _chance(place[some], balance[of], moves[some] & ~own[some])
        agent[b:e], score[b:e] = was, max(known, chance)
        # An agent goes on with even odds.
        if chance >= (min(least, 0.5) if was else least):
            begin = _first_row(when, some[: onset + 1])
            agent[begin:e] = goes[begin:e] = True
            if not was and begin > b and _left(sightings, rows.item(begin - 1)):
                # Who stood there was itself all the while.
                agent[b:begin], score[b:begin] = True, known
        agent[b:e] &= ~(own[b:e] | _rests_as_another(sightings, place[:e], when, rows, agent[b:e] & ~moves[b:e], far))
        was, known, last, then = bool(agent[e - 1]), score.item(e - 1), complex(place[e - 1]), when.item(e - 1)
    if not sightings.is_placed:
        # Without a known place it moves from where it seems to move.
        onset = min((part.onset for part in track.parts if part.moved), default=0)
        agent[:] = goes[:] = (sightings.sweep[at[firsts]] >= onset) & ~own
        score[:] = math.nan
    every = AgentVerdict(*(np.zeros(len(time), values.dtype) for values in (agent, goes, score)))
    every.agent[seen], every.goes[seen], every.score[seen] = agent, goes & ~own, score
    return every


def _first_row(when: Float64, picks: Int64) -> int:
    """Return from where on a track is one that goes, by its places up to the one that shows it."""
    rests = picks[1:][np.diff(when[picks]) >= AGENTS.rest]
    early = int(np.searchsorted(when, when[picks[-1]] - AGENTS.seconds_before))
    return int(max(picks[0], early, *rests[-1:]))


def _left(sightings: Any, row: int) -> bool:
    """Return whether the place of a sighting is observed free afterwards: what was static there has gone."""
    looks = np.empty((1, 4))
    sightings.keyframes.count_looks(sightings.recorded, np.array([row], np.int64), looks)
    free, hits = looks[0, 2:].tolist()
    return bool(free >= AGENTS.min_looks and free > hits)


def _rests_as_another(sightings: Any, place: Any, when: Float64, rows: Int64, rests: Bool, far: float) -> Bool:
    """Return which of the last places of a track are those of another object: it stood there while the track was elsewhere.

    `rests`: which of them may be.
    """
    another, first = np.zeros(len(rests), bool), len(place) - len(rests)
    edges = np.flatnonzero(np.append(False, rests) != np.append(rests, False)).reshape(-1, 2)
    for b, e in edges.tolist():
        i = first + (b + e) // 2
        apart = np.abs(place[:i] - place[i])
        away = np.flatnonzero(apart > 2.0 * far)
        if len(away) and when[first + e - 1] - when[first + b] >= AGENTS.rest:
            near = np.flatnonzero(apart[: away[-1]] <= far)
            since = when.item(int(near[-1])) + 1.0 if len(near) else -math.inf
            another[b:e] = sightings.keyframes.stood(sightings.recorded, rows.item(i), since, when.item(int(away[-1])))
    return another


def _jumps(place: Any, when: Float64, far: float) -> Int64:
    """Return the indices at which a track is farther from its last place, and from where its speed leads, than `far`."""
    apart, gap = np.diff(place), np.diff(when)
    expected = np.zeros(len(apart), complex)
    if len(apart) > 1:
        steady = gap[:-1] <= 2.0 * median(gap)
        expected[1:] = np.where(steady, apart[:-1] / np.maximum(gap[:-1], 1e-3) * gap[1:], 0.0)
        expected[0] = apart[1] / max(gap[1], 1e-3) * gap[0]
    return np.flatnonzero(np.minimum(np.abs(apart), np.abs(apart - expected)) > far) + 1


def _picks(place: Any) -> Int64:
    """Return the indices of places that are far enough from the one before."""
    picks, last = [], complex(math.inf)
    for k, here in enumerate(place.tolist()):
        if abs(here - last) >= AGENTS.places_apart:
            picks.append(k)
            last = here
    return np.array(picks, np.int64)


def _balance(sightings: Any, keyframes: Keyframes, at: Int64, step: Int64, sweeps: Int64) -> Float64:
    """Return the balance of the looks in some sweeps, before or after: from -1, all hit, to 1, all free; NaN if unknown."""
    which = np.flatnonzero(np.bincount(sweeps, minlength=step[-1] + 1)[step])
    looks = np.empty((len(which), 4))
    keyframes.count_looks(sightings.recorded, np.ascontiguousarray(sightings.keep[at[which]]), looks)
    looks = np.add.reduceat(looks, starts(step[which])) / np.bincount(step)[sweeps, None]
    free, hits = looks[:, ::2], looks[:, 1::2]
    total = free + hits
    either = np.where(total >= AGENTS.min_looks, (free - hits) / np.maximum(total, AGENTS.min_looks), np.nan)
    return np.fmax(either[:, 0], either[:, 1])


def _chance(place: Any, balance: Float64, moves: Bool) -> tuple[float, int]:
    """Return the probability that a stretch goes, by its places, and the first one from which on it does."""
    decided = moves & ~np.isnan(balance)
    free = np.flatnonzero(decided & (balance > 0.0))
    if len(free) < 2:
        return 0.0, 0
    off = place[free] - np.add.reduce(place[free]) / len(free)
    axis = np.sqrt(np.add.reduce(off * off) / len(free))
    along = (off * np.conj(axis)).real / max(abs(axis), 1e-9)
    along -= np.minimum.reduce(along)
    length = float(np.maximum.reduce(along))
    share = along / max(length, 1e-9)
    between = np.count_nonzero((share > AGENTS.between) & (share < 1.0 - AGENTS.between))
    step = float(np.maximum.reduce(np.abs(place[1:] - place[:-1]))) / max(length, AGENTS.shortest_path)
    odds = AGENTS.odds + AGENTS.balance * float(balance[decided].mean()) + AGENTS.places * math.log1p(between)
    odds += AGENTS.step * math.log(step + AGENTS.min_step_share)
    return 1.0 / (1.0 + math.exp(-odds)), int(free[0])


def own_body(sightings: Any, mine: Int64, known: set[complex]) -> Bool:
    """Return (N,) which sightings of a sensor show the robot itself: what stays at a place of its frame while it drives.

    `mine`: (N,) those of the sensor; `known`: such places in windows before, to which those of this one are added.
    """
    place = sightings.ahead[mine] + 1j * sightings.left[mine]
    own, near = np.zeros(len(place), bool), np.flatnonzero(np.abs(place) < AGENTS.body_reach)
    cell = np.round(place[near] / AGENTS.body_cell)
    if len(near) and np.ptp(sightings.travelled[mine]) >= AGENTS.body_path:
        sweeps, firsts = np.unique(sightings.sweep[mine], return_index=True)
        travelled = sightings.travelled[mine[firsts]]
        steps = dict(zip(sweeps.tolist(), np.diff(travelled, prepend=travelled[0]).tolist(), strict=True))
        seen: dict[complex, set[int]] = {}
        for one, sweep in zip(cell.tolist(), sightings.sweep[mine[near]].tolist(), strict=True):
            seen.setdefault(one, set()).add(sweep)
        around = [complex(i, k) for i in (-1, 0, 1) for k in (-1, 0, 1)]
        for one in seen:
            there = set().union(*(seen.get(one + each, ()) for each in around))
            if sum(steps[sweep] for sweep in there) >= AGENTS.body_share * np.ptp(travelled):
                known.add(one)
    if known:
        own[near] = np.isin(cell, np.array([*known], complex))
    return own
