"""Which LaserScan topics of a log are read, and clear words where one is not there."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from fnmatch import fnmatchcase

from lidarcli.errors import LidarcliError, NoScanError, UnreadableError
from lidarcli.logs.base import CLOUD_TYPES, LASERSCAN, SCAN_TYPES, Topic

_SHOWN = 5


def scan_topics(topics: Iterable[Topic]) -> list[str]:
    """Names of the topics that sweeps are read from, sorted."""
    return sorted({topic.name for topic in topics if topic.is_scan})


def bare(name: str) -> str:
    """A topic's name as names are compared: old logs have names without the leading slash.

    >>> bare("/scan") == bare("scan")
    True
    """
    return name.lstrip("/")


def is_pattern(name: str) -> bool:
    """Whether a name stands for several: `*` for any text, `?` for any character, `[ab]` for one of these."""
    return any(mark in name for mark in "*?[")


def means(wanted: str, topic: str) -> bool:
    """Whether a name or a pattern that was asked for means a topic.

    >>> means("scan", "/scan"), means("/scan*", "/scan_front"), means("/scan", "/scan_front")
    (True, True, False)
    """
    if bare(wanted) == bare(topic):
        return True
    return is_pattern(wanted) and fnmatchcase(bare(topic), bare(wanted))


def no_scan_topic(names: Sequence[str] = ()) -> str:
    """Words for topics that are not there: those that were asked for, or any."""
    return f"no LaserScan topic{_named(names)} in this log"


def clouds_hint(topics: Iterable[Topic]) -> str:
    """What to type where some of the topics hold point clouds; empty where none does."""
    clouds = sorted(topic.name for topic in topics if topic.type in CLOUD_TYPES)
    if not clouds:
        return ""
    return (
        f"; to read the point clouds of {_some(clouds)} as sweeps, add --slice ZMIN ZMAX (heights in metres)"
    )


class TopicChoice:
    """The LaserScan topics that are wanted of a log, those that are there, and those that reading has seen.

    A wanted name may be a pattern. A leading slash counts only where a log has both names. A log without an index shows its
    topics while it is read: `takes` remembers them.
    """

    def __init__(self, wanted: Collection[str] | None, topics: Sequence[Topic] | None) -> None:
        """`topics` are those that the log lists, None where it lists none; without any `wanted` all are read."""
        self.wanted = tuple(sorted(set(wanted or ())))
        self.is_listed = topics is not None
        self._topics = topics or ()
        self._there = set(scan_topics(self._topics))

    @property
    def there(self) -> list[str]:
        """The LaserScan topics that the log lists, or that have been seen."""
        return sorted(self._there)

    @property
    def chosen(self) -> list[str]:
        """Those of them that are read."""
        if not self.wanted:
            return self.there
        if not self.is_listed:
            return [name for name in self.there if any(means(wanted, name) for wanted in self.wanted)]
        return sorted({name for wanted in self.wanted for name in self._found(wanted)})

    @property
    def asked(self) -> frozenset[str] | None:
        """What to ask of the log: the names as it spells them, None for all."""
        return frozenset(self.chosen) if self.wanted and self.is_listed else None

    @property
    def first(self) -> str | None:
        """The topic that comes first in the tables, where that is known before reading."""
        known = self.chosen if self.is_listed else self.wanted if len(self.wanted) == 1 else ()
        if not self.is_listed and any(map(is_pattern, known)):
            return None
        return next(iter(known), None)

    @property
    def missing(self) -> tuple[str, ...]:
        """Those of the wanted that are not there."""
        return tuple(name for name in self.wanted if not self._found(name))

    def takes(self, topic: str) -> bool:
        """Whether the sweeps of a topic that reading has come to are wanted."""
        self._there.add(topic)
        return not self.wanted or self.is_listed or any(means(wanted, topic) for wanted in self.wanted)

    def error(self, every: bool = False) -> NoScanError | None:
        """Why there is nothing to read; where `every` wanted topic has to be there, also why one cannot be read."""
        missing = self.missing
        if missing and (every or len(missing) == len(self.wanted)):
            return NoScanError(self._absent(missing))
        if self.wanted or self._there:
            return None
        words = f"{no_scan_topic()} ({self._list()})" if self.is_listed else "no LaserScan in it"
        return NoScanError(words + self._hint(topic.name for topic in self._topics))

    def _found(self, name: str) -> list[str]:
        """The topics that a name or a pattern means: the very one where it is there."""
        if name in self._there:
            return [name]
        there = [each for each in self.there if means(name, each)]
        return there if is_pattern(name) else there[:1]

    def _absent(self, missing: Sequence[str]) -> str:
        types = {bare(topic.name): topic.type for topic in self._topics}
        kind = types.get(bare(missing[0]), LASERSCAN)
        hint = self._hint(missing)
        if kind not in SCAN_TYPES:
            return f"topic {missing[0]} is {kind}, not a LaserScan{hint}"
        has = f"its LaserScan topics: {', '.join(self.there)}" if self._there else self._list()
        return f"{no_scan_topic(missing)} ({has})"

    def _hint(self, names: Iterable[str]) -> str:
        """What to type where some of these topics hold point clouds."""
        named = {bare(name) for name in names}
        return clouds_hint(topic for topic in self._topics if bare(topic.name) in named)

    def _list(self) -> str:
        """What the log has instead."""
        if not self._topics:
            return "it has no topics"
        names = [f"{topic.name} {topic.type}" for topic in sorted(self._topics, key=lambda topic: topic.name)]
        return f"its topics: {_some(names)}"


def nothing_read(damage: Sequence[str], error: NoScanError, wanted: Sequence[str]) -> LidarcliError:
    """A log that is damaged and shows no LaserScan counts as unreadable: the scans may be in the lost part."""
    if not damage:
        return error
    topics = f" topic{_named(wanted)}" if wanted else ""
    return UnreadableError(f"no LaserScan{topics} in the part that could be read; {damage[0]}")


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{', '.join(names[:_SHOWN])}{more}"


def _named(names: Sequence[str]) -> str:
    return f" {' or '.join(names)}" if names else ""
