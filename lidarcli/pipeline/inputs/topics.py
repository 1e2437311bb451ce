"""Which topics of a log to read, and clear words when the LaserScan is not there."""

from __future__ import annotations

from collections.abc import Sequence

from lidarcli.errors import LidarcliError, NoScanError, UnreadableError
from lidarcli.logs.base import SCAN_TYPES, Topic

_SHOWN = 5


def scan_topics(topics: Sequence[Topic]) -> list[str]:
    """Names of the LaserScan topics, sorted."""
    return sorted({topic.name for topic in topics if topic.type in SCAN_TYPES})


def choose(topics: Sequence[Topic], wanted: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """The topics to read (all LaserScan topics when none is wanted), and those that are not there.

    A leading slash makes no difference: old logs have names without one.

    Raises
    ------
    NoScanError
        None of them is there.
    """
    there = scan_topics(topics)
    if not wanted:
        if not there:
            raise NoScanError(f"no LaserScan topic in this log ({_list(topics)})")
        return there, ()
    by_name = {name.lstrip("/"): name for name in there} | {name: name for name in there}
    chosen = sorted({by_name.get(name) or by_name.get(name.lstrip("/"), "") for name in wanted} - {""})
    missing = tuple(name for name in wanted if name not in by_name and name.lstrip("/") not in by_name)
    if not chosen:
        raise NoScanError(absent(missing, topics))
    return chosen, missing


def absent(missing: Sequence[str], topics: Sequence[Topic]) -> str:
    """Words for topics that were asked for and are not there."""
    types = {topic.name.lstrip("/"): topic.type for topic in topics}
    first = missing[0].lstrip("/")
    if first in types and types[first] not in SCAN_TYPES:
        return f"topic {missing[0]} is {types[first]}, not a LaserScan"
    there = scan_topics(topics)
    has = f"its LaserScan topics: {', '.join(there)}" if there else _list(topics)
    return f"no LaserScan topic {' or '.join(missing)} in this log ({has})"


def nothing_read(damage: Sequence[str], error: NoScanError, wanted: Sequence[str]) -> LidarcliError:
    """A log that is damaged and shows no LaserScan counts as unreadable: the scans may be in the lost part."""
    if not damage:
        return error
    named = f" topic {' or '.join(wanted)}" if wanted else ""
    return UnreadableError(f"no LaserScan{named} in the part that could be read; {damage[0]}")


def _list(topics: Sequence[Topic]) -> str:
    if not topics:
        return "it has no topics"
    names = [f"{topic.name} {topic.type}" for topic in sorted(topics, key=lambda topic: topic.name)]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"its topics: {', '.join(names[:_SHOWN])}{more}"
