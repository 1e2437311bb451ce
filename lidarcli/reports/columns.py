"""Columns of Arrow tables as numpy arrays; a table of one or many logs knows which row came from which."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lidarcli.options.times import TimeZone
from lidarcli.sweeps.types import Float64, Int32, Int64, spared
from lidarcli.sweeps.zone import UNSEEN

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T", bound=np.generic)
Record = SimpleNamespace
"""A row of a table, or of what a report shows: attributes are its columns."""
OBJECTS_OF_SWEEP = ("objects", "agents")
"""Columns of the sweeps table (Def. 4) that together count the objects of a sweep, tracked or not …"""
BEAMS_OF_OBJECTS = ("object_beams", "agent_beams")
"""… and their beams."""


OF_INPUT = dict.fromkeys(("world_x", "world_y", "world_yaw", "pose_x", "pose_y", "pose_yaw", "intensity"), "")
OF_INPUT |= {"label": "catalogue", "label_score": "catalogue", "change": "background", "difference": "background"}
"""Column → the parameter without which it is empty; without a name it is the log that may lack it."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of the rows of one pair of tables."""

    label: str
    """The objects table as the user named it."""
    log: str
    """The log's name, as in column `log`."""
    format: str = ""
    size: int | None = None
    version: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    mask: dict[str, Any] = field(default_factory=dict)
    """Content of the mask file with which the log was read, empty without one."""
    damage: tuple[str, ...] = ()
    tracked: bool = False
    """True if there is a tracks table in the same folder."""
    recording: dict[str, str] = field(default_factory=dict)
    """Topic → number and checksum of its sweeps, by which two logs of one recording are recognised; empty where unknown."""


def same_recording(one: Mapping[str, str], other: Mapping[str, str]) -> bool | None:
    """Return whether two logs are of one recording, by their topics as of `Origin`; None where they share none."""
    shared = one.keys() & other.keys()
    return all(one[topic] == other[topic] for topic in shared) if shared else None


@dataclass(frozen=True)
class Rows:
    """Rows of one kind of table, from one or many sources."""

    table: pa.Table
    """That of a long log is a `StoredTable`, which only has columns."""
    source: Int32
    """(K,) index of the source of each row."""

    def __len__(self) -> int:
        return int(self.table.num_rows)

    @staticmethod
    def join(tables: Sequence[pa.Table], sources: Sequence[int] | None = None) -> Rows:
        """The rows of several sources, one after the other; `sources` where not every source has a table."""
        import pyarrow as pa

        numbers = np.arange(len(tables), dtype=np.int32) if sources is None else np.array(sources, np.int32)
        if len(tables) == 1 and not isinstance(tables[0], pa.Table):
            # Of a long log one number stands for all rows.
            return Rows(tables[0], np.broadcast_to(numbers, tables[0].num_rows))
        source = np.repeat(numbers, [table.num_rows for table in tables])
        return Rows(pa.concat_tables(tables).unify_dictionaries().combine_chunks(), source)

    def of_source(self, source: int) -> Rows:
        """The rows of one of the sources, which follow each other."""
        first, end = np.searchsorted(self.source, [source, source + 1]).tolist()
        return self if end - first == len(self) else Rows(self.table.slice(first, end - first), self.source[first:end])

    def numbers(self, name: str) -> Float64:
        """A numeric column, NaN for null; the number of elements of a list column.

        A number of single precision is the one of few decimals that it stands for, if there is one: 0.08, which checks
        and reports name, and not the double of its bits.
        """
        import pyarrow as pa

        from lidarcli.tabular.columns import numbers

        def short(chunk: pa.Array) -> Float64:
            if pa.types.is_list(chunk.type):
                import pyarrow.compute as pc

                chunk = pc.list_value_length(chunk)
            values = numbers(chunk)
            if pa.types.is_float32(chunk.type):
                single = values.astype(np.float32)
                for scale in (1e6, 1e4, 1e2):
                    rounded = np.rint(values * scale) / scale
                    values = np.where(rounded.astype(np.float32) == single, rounded, values)
            return values

        return self._gathered(name, np.empty(len(self)), short)

    def integers(self, name: str) -> Int64:
        """A column of integers without nulls; a stamp in nanoseconds."""
        import pyarrow as pa

        from lidarcli.tabular.columns import values_and_mask

        def whole(chunk: pa.Array) -> NDArray[Any]:
            return values_and_mask(chunk.cast(pa.int64()) if pa.types.is_timestamp(chunk.type) else chunk)[0]

        return self._gathered(name, np.empty(len(self), np.int64), whole)

    def _gathered(self, name: str, found: NDArray[T], values: Callable[[pa.Array], NDArray[Any]]) -> NDArray[T]:
        """Put values (K,) of a column into an array, piece by piece: of a long log it is never held as a whole."""
        import pyarrow as pa

        at = 0
        for chunk in self.table[name].chunks if isinstance(self.table, pa.Table) else self.table.pieces(name):
            found[at : at + len(chunk)] = values(chunk)
            at += len(chunk)
        return found

    def total(self, names: Sequence[str]) -> Float64:
        """(K,) the sum of some columns."""
        total: Float64 = np.sum([self.numbers(name) for name in names], axis=0)
        return total

    def words(self, name: str) -> tuple[Int32, list[str]]:
        """A column of names: (K,) codes, -1 for null, and the names."""
        from lidarcli.tabular.columns import values_and_mask

        names: dict[str, int] = {}

        def coded(chunk: pa.DictionaryArray) -> Int32:
            codes, there = values_and_mask(chunk.indices)
            known = [names.setdefault(word, len(names)) for word in chunk.dictionary.to_pylist()]
            return np.array([*known, -1], np.int32)[np.where(there, codes, -1)]

        return self._gathered(name, np.empty(len(self), np.int32), coded), [*names]

    def texts(self, name: str, at: Int64 | slice = slice(None)) -> list[str]:
        """A column of names in some rows, empty for null."""
        codes, names = self.words(name)
        return ["" if code < 0 else names[code] for code in codes[at].tolist()]

    def records(self, at: Int64, names: Sequence[str], **more: Sequence[Any]) -> list[Record]:
        """Some rows, each with its values by column and `more`: empty for a name that is null, NaN for a number."""
        import pyarrow as pa

        columns: dict[str, Sequence[Any]] = {}
        for name in names:
            column = self.table[name]
            if pa.types.is_dictionary(column.type):
                columns[name] = self.texts(name, at)
            elif pa.types.is_timestamp(column.type) or (pa.types.is_integer(column.type) and not column.null_count):
                columns[name] = self.integers(name)[at].tolist()
            else:
                columns[name] = self.numbers(name)[at].tolist()
        columns |= more
        return [Record(**dict(zip(columns, values, strict=True))) for values in zip(*columns.values(), strict=True)]

    def are(self, name: str, word: str) -> NDArray[np.bool_]:
        """(K,) rows with this name in a column."""
        codes, names = self.words(name)
        return codes == names.index(word) if word in names else np.zeros(len(codes), bool)

    def of_topics(self, topics: Sequence[str]) -> Rows:
        """The rows of some topics, and those that are of several."""
        codes, names = self.words("topic")
        return self.where(np.isin(codes, [-1, *(names.index(topic) for topic in topics if topic in names)]))

    def where(self, own: NDArray[np.bool_]) -> Rows:
        """Some of the rows."""
        import pyarrow as pa

        return Rows(self.table.filter(pa.array(own)).combine_chunks(), self.source[own])

    def has_any(self, name: str) -> bool:
        """Return True if the column is there with any value at all."""
        return name in self.table.column_names and self.table[name].null_count < len(self)

    def counts(self, name: str, where: NDArray[np.bool_] | None = None) -> dict[str, int]:
        """Count how often each name occurs among the rows of `where`."""
        codes, names = self.words(name)
        chosen = codes if where is None else codes[where]
        totals = [int(np.count_nonzero(chosen == code)) for code in range(len(names))]
        return {text: total for text, total in zip(names, totals, strict=True) if total}


class Observation(NamedTuple):
    """In how many sweeps of a log anything, or a zone, was observed."""

    log: str
    observed: int
    sweeps: int

    @property
    def share(self) -> float:
        """Share of the sweeps."""
        return self.observed / self.sweeps if self.sweeps else 0.0


def missing_of(stamp_ns: Int64, ends: Int64 | None = None) -> int:
    """Return how many sweeps are missing in gaps above `UNSEEN` of increasing stamps (S,) [ns].

    `ends`: (2,) stamps from which on and up to which there should be some; without, the first and the last.
    """
    own = np.diff(stamp_ns) * 1e-9
    step = float(np.median(own)) if len(own) else UNSEEN
    steps = own if ends is None else np.diff(stamp_ns, prepend=ends[:1], append=ends[1:]) * 1e-9
    gaps = steps[steps > max(UNSEEN, 1.5 * step)]
    return int(np.maximum(np.rint(gaps / step) - 1.0, 0.0).sum()) if step else 0


def least_observed(sights: Iterable[Observation]) -> Observation | None:
    """Return the worst of those that lack more sweeps than may be spared, its log named with their number."""
    lacking = [one for one in sights if not one.observed or one.sweeps - one.observed > spared(one.sweeps)]
    if not lacking:
        return None
    least = min(lacking, key=lambda one: one.share)
    return least._replace(log=f"{least.log} and {len(lacking) - 1:,} more logs") if len(lacking) > 1 else least


@dataclass(frozen=True, slots=True)
class ZoneRows:
    """Zones that were watched in one or many logs."""

    events: Rows
    zones: Rows
    """A row for each sweep and zone."""
    shapes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Name of a zone → its outline, as the metadata has it."""
    left_out: tuple[tuple[str, str], ...] = ()
    """Logs, each with a zone that could not be evaluated in it."""
    counts: Rows | None = None
    """Numbers of people by line and interval, where there are any."""

    @property
    def names(self) -> list[str]:
        """The zones that were watched, in their order."""
        codes, names = self.zones.words("zone")
        found, first = np.unique(codes, return_index=True)
        return [names[code] for code in found[np.argsort(first)].tolist() if code >= 0]

    @property
    def lines(self) -> frozenset[str]:
        """Those that are known to be lines."""
        return frozenset(name for name, shape in self.shapes.items() if "line" in shape)


@dataclass(frozen=True)
class Run:
    """One or many logs after `detect` or `track`: what a report is about."""

    sources: tuple[Origin, ...]
    sweeps: Rows
    objects: Rows
    tracks: Rows | None = None
    """Of the sources that were tracked; None where none was."""
    trajectories: Rows | None = None
    """Trajectories, if the viewer asks for them; of the sources that have them."""
    zones: ZoneRows | None = None
    """Of the sources that have tables of zones; None where none has."""
    time_zone: TimeZone = UTC
    """Time zone of what people read."""

    @cached_property
    def is_object(self) -> NDArray[np.bool_]:
        """(K,) rows of the objects table that are objects of their sweeps, agents among them.

        Walls (set S) are none, nor is what has gone from a background.
        """
        return ~self.objects.are("set", "S") & ~self.objects.are("change", "removed")

    @cached_property
    def is_agent(self) -> NDArray[np.bool_]:
        """(K,) those of the objects that are agents (set A)."""
        return self.objects.are("set", "A")

    def knows(self, rows: Rows, column: str) -> bool:
        """Return False for a column that is empty because nothing could tell its values."""
        given = OF_INPUT.get(column)
        is_given = given is None or any(one.parameters.get(given) for one in self.sources)
        return is_given or not len(rows) or rows.has_any(column)

    def observed_in(self) -> list[Observation]:
        """Return for each source how many sweeps show anything."""
        some, total = (
            np.bincount(self.sweeps.source[chosen], minlength=len(self.sources)).tolist()
            for chosen in (self.sweeps.numbers("observed") > 0, slice(None))
        )
        logs = (source.log for source in self.sources)
        return [Observation(*each) for each in zip(logs, some, total, strict=True)]

    @cached_property
    def objects_per_sweep(self) -> Float64:
        """(S,) objects of each sweep, agents among them."""
        return self.sweeps.total(OBJECTS_OF_SWEEP)

    @cached_property
    def lost_share(self) -> Float64:
        """(S,) share of the beams of each sweep without a range; NaN without beams."""
        beams = self.sweeps.numbers("beams")
        lost = beams - self.sweeps.numbers("valid")
        share: Float64 = np.divide(lost, beams, out=np.full(len(beams), np.nan), where=beams > 0)
        return share

    @cached_property
    def agents_at_once(self) -> Float64:
        """(S,) tracks of set A that are visible in each sweep, whatever their objects; NaN where there are no tracks."""
        tracked = np.array([source.tracked for source in self.sources], bool)
        agents = np.where(tracked[self.sweeps.source], 0.0, np.nan)
        if not tracked.any() or not self.is_agent.any():
            return agents
        place, wanted = places(self.objects, self.sweeps)
        track = self.objects.numbers("track")
        own = self.is_agent & ~np.isnan(track)
        place, track = place[own], track[own]
        names = np.unique(track)
        place *= max(len(names), 1)
        place += np.searchsorted(names, track)
        place = np.unique(place)
        place //= max(len(names), 1)
        found, count = np.unique(place, return_counts=True)
        at = np.searchsorted(found, wanted)
        there = at < len(found)
        there[there] = found[at[there]] == wanted[there]
        agents[there] += count[at[there]]
        return agents


def rows_of(rows: Rows, topic: str, sweeps: Int64, source: int | None = None) -> tuple[Int64, Int64]:
    """Return the rows of a table of these sweeps of a topic, which ascend, and the place of each one's sweep among them.

    They are in the order of the sweeps; `source`: of all of them, if there is more than one.
    """
    index = rows.integers("sweep")
    own = rows.are("topic", topic) & np.isin(index, sweeps)
    found = np.flatnonzero(own if source is None else own & (rows.source == source))
    at = np.searchsorted(sweeps, index[found])
    order = np.argsort(at, kind="stable")
    return found[order], at[order]


def places(*tables: Rows) -> list[Int64]:
    """A number for the sweep of each row, equal in all tables where source, topic and index are."""
    words = [rows.words("topic") for rows in tables]
    topics = {name: k for k, name in enumerate(dict.fromkeys(name for _, names in words for name in names))}
    sweeps = [rows.integers("sweep") for rows in tables]
    after = 1 + max((int(each.max(initial=0)) for each in sweeps), default=0)
    if after > 1 << 31:
        # Another program may number sweeps as it likes, and a place has 64 bits.
        dense = np.unique(np.concatenate(sweeps), return_inverse=True)[1]
        sweeps, after = np.split(dense, np.cumsum([*map(len, sweeps)])[:-1]), 1 + len(dense)
    found = []
    for rows, (code, names), sweep in zip(tables, words, sweeps, strict=True):
        place = np.array([topics[name] for name in names] or [0], np.int64)[code]
        place += rows.source * np.int64(max(len(topics), 1))
        place *= after
        place += sweep
        found.append(place)
    return found
