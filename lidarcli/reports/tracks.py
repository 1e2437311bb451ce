"""Figures of the tracks of a run: numbers of tracks and of agents at once, and the mobility of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Rows, Run
from lidarcli.reports.figures import STATISTICS, TRACK_CATEGORIES, TRACK_SPREADS, Spread
from lidarcli.reports.streams import Streams
from lidarcli.sweeps import Bool, Int64

STATIC_SHARE = 0.001
"""Greatest share of the beams in set A of a structured scene: errors of the tracking stay below."""
MOBILE_SHARE = 0.25
"""Greatest share of the beams in set A of a semi-structured scene: agents fill a quarter of the view."""
KEPT = 100
"""Most tracks that are kept one by one, for the tables of the report."""
TRACK_COLUMNS = (
    *("topic", "frame_id", "track", "set", "shape", "label", "first_sweep", "first_stamp", "sweeps"),
    *("duration", "hidden", "length", "width", "distance", "speed_mean", "speed_max", "end"),
)
"""Columns of the tracks table that a summary reads."""
_NUMBERS = ("duration", "hidden", "length", "width", "distance", "speed_mean", "speed_max")
_WHOLE = ("track", "first_sweep", "first_stamp", "sweeps")


@dataclass(frozen=True, slots=True)
class Track:
    """A track, as a row of a table for people."""

    stream: int | None
    """Its stream of sweeps; None where there is none of its topic."""
    log: str
    topic: str
    number: int
    set: str
    shape: str
    label: str
    first_sweep: int
    start: float
    """Time from the first sweep of its stream to its first sight [s]."""
    duration: float
    sweeps: int
    hidden: float
    length: float
    width: float
    distance: float
    speed_mean: float
    speed_max: float
    end: str

    @property
    def is_agent(self) -> bool:
        """True if the track moves."""
        return self.set == "A"


@dataclass(frozen=True, slots=True)
class Label:
    """A name of the catalogue, and the numbers of its tracks and objects."""

    name: str
    tracks: int | None
    """None where nothing was tracked."""
    objects: int
    """Rows of the objects table."""


@dataclass(frozen=True, slots=True)
class Tracked:
    """The tracks of a run."""

    figures: dict[str, float | None]
    """Every name of `figures.track_names()` → value."""
    spreads: dict[str, Spread]
    kinds: dict[str, dict[str, int]]
    """`tracks.shape`, `tracks.end` → name → tracks; only names that occur."""
    agent_share: float | None
    """Share of the beams of the tracked sweeps in set A; None without beams."""
    tracks: tuple[Track, ...]
    """By stream and number; of more than `KEPT` the agents and those that were seen most."""

    @property
    def scene(self) -> str | None:
        """The paper's name (§2) of such a scene, by the share of A."""
        return None if self.agent_share is None else scene_of(self.agent_share)

    def most(self, count: int) -> tuple[Track, ...]:
        """Return the `count` tracks to look at first, in their order: agents, then what was seen most."""
        best = sorted(self.tracks, key=lambda one: (not one.is_agent, -one.sweeps))[:count]
        return tuple(one for one in self.tracks if one in best)


def scene_of(agent_share: float) -> str:
    """Return the paper's name (§2) of a scene with this share of its beams on agents.

    >>> [scene_of(share) for share in (0.0, 0.03, 0.4)]
    ['structured', 'semi-structured', 'unstructured']
    """
    if agent_share <= STATIC_SHARE:
        return "structured"
    return "semi-structured" if agent_share <= MOBILE_SHARE else "unstructured"


def tracked_of(run: Run, streams: Streams) -> Tracked | None:
    """Sum up the tracks; None where no log has a tracks table."""
    rows = run.tracks
    if rows is None:
        return None
    values = {name: rows.numbers(name.removeprefix("tracks.")) for name in TRACK_SPREADS if "." in name}
    values["agents_at_once"] = run.agents_at_once
    spreads = {name: Spread.of(values[name]) for name in TRACK_SPREADS}
    shapes, ends = rows.counts("shape"), rows.counts("end")
    kinds = {
        "tracks.shape": shapes,
        "tracks.end": {name.replace(" ", "_"): count for name, count in ends.items()},
    }
    is_agent = rows.are("set", "A")
    figures: dict[str, float | None] = {"tracks": len(rows), "tracks.agents": int(is_agent.sum())}
    for name, spread in spreads.items():
        figures |= {f"{name}.{statistic}": getattr(spread, statistic) for statistic in STATISTICS}
    for name, known in TRACK_CATEGORIES.items():
        figures |= {f"{name}.{kind}": kinds[name].get(kind, 0) for kind in known}
    return Tracked(
        figures=figures,
        spreads=spreads,
        kinds=kinds,
        agent_share=_agent_share(run),
        tracks=_kept(run, rows, is_agent, streams),
    )


def labels_of(run: Run) -> tuple[Label, ...]:
    """Return the names of the catalogue that occur, by name."""
    objects = run.objects.counts("label", run.is_object)
    tracks = {} if run.tracks is None else run.tracks.counts("label")
    return tuple(
        Label(name, None if run.tracks is None else tracks.get(name, 0), objects.get(name, 0))
        for name in sorted({*objects, *tracks})
    )


def _agent_share(run: Run) -> float | None:
    tracked = np.array([source.tracked for source in run.sources], bool)[run.sweeps.source]
    beams = float(run.sweeps.numbers("beams")[tracked].sum())
    return float(run.sweeps.numbers("agent_beams")[tracked].sum()) / beams if beams else None


def _kept(run: Run, rows: Rows, is_agent: Bool, streams: Streams) -> tuple[Track, ...]:
    """Return the tracks that are shown one by one."""
    best = np.lexsort((-rows.numbers("sweeps"), ~is_agent))[:KEPT]
    # The table is in order of topic and track.
    order = np.sort(best)
    words = {
        name: _texts(rows, name, order) for name in ("topic", "frame_id", "set", "shape", "label", "end")
    }
    numbers = {name: rows.numbers(name)[order].tolist() for name in _NUMBERS}
    whole = {name: rows.integers(name)[order].tolist() for name in _WHOLE}
    found = []
    for k, source in enumerate(rows.source[order].tolist()):
        stream = _stream(streams, source, words["topic"][k], words["frame_id"][k])
        start = whole["first_stamp"][k] if stream is None else streams.all[stream].start_ns
        found.append(
            Track(
                stream=stream,
                log=run.sources[source].log,
                number=whole["track"][k],
                first_sweep=whole["first_sweep"][k],
                sweeps=whole["sweeps"][k],
                start=(whole["first_stamp"][k] - start) * 1e-9,
                topic=words["topic"][k],
                set=words["set"][k],
                shape=words["shape"][k],
                label=words["label"][k],
                end=words["end"][k],
                **{name: numbers[name][k] for name in _NUMBERS},
            )
        )
    return tuple(found)


def _texts(rows: Rows, name: str, order: Int64) -> Sequence[str]:
    """Return a column of names, empty for null."""
    codes, names = rows.words(name)
    return ["" if code < 0 else names[code] for code in codes[order].tolist()]


def _stream(streams: Streams, source: int, topic: str, frame: str) -> int | None:
    """Return the stream that a track belongs to."""
    mine = [k for k, one in enumerate(streams.all) if (one.source, one.topic) == (source, topic)]
    exact = [k for k in mine if streams.all[k].frame_id == frame]
    return next(iter([*exact, *mine]), None)
