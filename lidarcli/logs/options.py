"""Options for reading a log, checked: geometry, units, slices of clouds, and the choice of topics."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from fnmatch import fnmatchcase

from lidarcli.choices import BINS, JOIN, UNITS
from lidarcli.errors import LidarcliError, NoScanError, OptionError, UnreadableError
from lidarcli.logs.base import CLOUD_TYPES, LASERSCAN, MAX_BEAMS, SCAN_TYPES, OpenOptions, Slice, Topic
from lidarcli.masks import Masks
from lidarcli.range_rules import FARTHEST, RangeRules
from lidarcli.sweeps import TURN

MOST_BINS = 100_000
"""Most beams of a sweep made of a point cloud."""


def range_rules(
    limits: tuple[float, float] | None, no_return: tuple[frozenset[str], tuple[float, ...]], masks: Masks | None = None
) -> RangeRules:
    """Return the rules for ranges, from limits [m], words and markers of `range_rules.parse_no_return`, and masks.

    Raises
    ------
    OptionError
        The limits are no range.
    """
    if limits is not None:
        least, most = map(float, limits)
        if not 0 <= least < most < math.inf:
            raise OptionError(f"--range: {least:g} to {most:g} m is no range; give the least and the greatest")
        limits = least, most
    words, markers = no_return
    return RangeRules(no_return=words, markers=markers, limits=limits, masks=masks)


def open_options(
    *,
    angle_min: float | None,
    angle_increment: float | None,
    fov: float | None,
    range_max: float | None,
    degrees: bool,
    range_unit: str,
    echo: str,
    segments: str = JOIN,
    columns: str | Iterable[str] = (),
    heights: tuple[float, float] | None = None,
    bins: int | None = None,
    limits: tuple[float, float] | None = None,
) -> OpenOptions:
    """Return checked options for opening a log; the three angles are radians, or `degrees`.

    `heights`, `bins` and `limits` say which points of a cloud are a sweep (`Slice`); without heights none are.

    Raises
    ------
    OptionError
        A value has no meaning, or two exclude each other.
    """
    if angle_increment is not None and fov is not None:
        raise OptionError("--angle-increment and --fov exclude each other")
    if angle_increment == 0:
        raise OptionError("--angle-increment: 0 is no step from beam to beam")
    if range_max is not None and not 0 < range_max <= FARTHEST:
        raise OptionError(f"--range-max: {range_max:g} is not above 0 and at most {FARTHEST:g} m")

    def radians(name: str, angle: float | None) -> float | None:
        found = math.radians(angle) if degrees and angle is not None else angle
        if found is not None and not abs(found) <= 2 * TURN:
            unit, hint = ("degrees", "") if degrees else ("radians", "; --degrees says that angles are degrees")
            raise OptionError(f"{name}: {angle:g} {unit} are more than two turns{hint}")
        return found

    part = _slice(heights, bins, limits)
    if part is not None and range_unit != "m":
        raise OptionError("--range-unit is for LaserScan: with --slice, points of clouds are in metres; leave one out")
    options = OpenOptions(
        angle_min=radians("--angle-min", angle_min),
        angle_increment=radians("--angle-increment", angle_increment),
        fov=radians("--fov", fov),
        range_max=range_max,
        range_scale=UNITS[range_unit],
        slice=part,
        echo=echo,
        segments=segments,
        columns=parse_columns(columns),
    )
    if part is not None:
        _refuse_view(options, part.bins)
    return options


def parse_columns(names: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the columns of a CSV: `time,ranges`, or `time,other*23,ranges*682`.

    Raises
    ------
    OptionError
        There is no name before a comma, or no number behind a star.

    >>> parse_columns("time, ranges")
    ('time', 'ranges')
    """
    found = tuple(name.strip() for name in (names.split(",") if isinstance(names, str) else names))
    if found == ("",):
        return ()
    for name in found:
        word, star, count = name.partition("*")
        if not word.strip():
            raise OptionError(f"--columns: '{','.join(found)}' has an empty name")
        if star and not (count.strip().isdecimal() and 0 < int(count) <= MAX_BEAMS):
            raise OptionError(f"--columns: '{name}' is not NAME*N, as ranges*360")
    if max(found.count("ranges"), found.count("intensities")) > 1:
        raise OptionError("--columns: only one name stands for all other columns; give the others a number, as ranges*360")
    return found


def _refuse_view(options: OpenOptions, bins: int) -> None:
    """Refuse views that a cloud cannot have: each direction is seen once."""
    most = TURN * (1 + 1e-6)
    if options.fov is not None and not 0 < abs(options.fov) <= most:
        raise OptionError("--fov: with --slice the view is more than nothing, and one turn at most")
    if options.angle_increment is not None:
        if options.angle_min is None:
            raise OptionError("--angle-increment: with --slice give --angle-min, too, or --fov instead")
        if abs(options.angle_increment) * bins > most:
            raise OptionError(f"--angle-increment: {bins} beams (--bins) so far apart are more than one turn")


def _slice(heights: tuple[float, float] | None, bins: int | None, limits: tuple[float, float] | None) -> Slice | None:
    if heights is None:
        if bins is not None:
            raise OptionError("--bins is for point clouds, which --slice reads as sweeps")
        return None
    low, high = map(float, heights)
    if not -math.inf < low <= high < math.inf:
        raise OptionError(f"--slice: {low:g} to {high:g} m are no heights; give the least and the greatest")
    count = BINS if bins is None else bins
    if not 1 < count <= MOST_BINS:
        raise OptionError(f"--bins: {count} is not from 2 to {MOST_BINS:,}")
    return Slice(low, high, count, None if limits is None else (float(limits[0]), float(limits[1])))


_SHOWN = 5


def scan_topics(topics: Iterable[Topic]) -> list[str]:
    """Return the sorted names of topics that sweeps are read from."""
    return sorted({topic.name for topic in topics if topic.is_scan})


def bare(name: str) -> str:
    """Return a topic name without leading slash, for comparison: old logs have none.

    >>> bare("/scan") == bare("scan")
    True
    """
    return name.lstrip("/")


def is_pattern(name: str) -> bool:
    """Return True for a pattern: `*` for any text, `?` for any character, `[ab]` for one of these."""
    return any(mark in name for mark in "*?[")


def means(wanted: str, topic: str) -> bool:
    """Return True if a wanted name or pattern means a topic.

    >>> means("scan", "/scan"), means("/scan*", "/scan_front"), means("/scan", "/scan_front")
    (True, True, False)
    """
    if bare(wanted) == bare(topic):
        return True
    return is_pattern(wanted) and fnmatchcase(bare(topic), bare(wanted))


def no_scan_topic(names: Sequence[str] = ()) -> str:
    """Return words for missing topics: the wanted ones, or any."""
    return f"no LaserScan topic{_named(names)} in this log"


def clouds_hint(topics: Iterable[Topic]) -> str:
    """Return a hint for topics that hold point clouds; empty without any."""
    clouds = sorted(topic.name for topic in topics if topic.type in CLOUD_TYPES)
    if not clouds:
        return ""
    return f"; to read the point clouds of {_some(clouds)} as sweeps, add --slice ZMIN ZMAX (heights in metres)"


class TopicChoice:
    """Wanted LaserScan topics of a log, existing ones, and those met while reading.

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
        """LaserScan topics that the log lists, or that were met."""
        return sorted(self._there)

    @property
    def chosen(self) -> list[str]:
        """Topics that are read."""
        if not self.wanted:
            return self.there
        if not self.is_listed:
            return [name for name in self.there if any(means(wanted, name) for wanted in self.wanted)]
        return sorted({name for wanted in self.wanted for name in self._found(wanted)})

    @property
    def asked(self) -> frozenset[str] | None:
        """Names to ask of the log, as it spells them; None for all."""
        return frozenset(self.chosen) if self.wanted and self.is_listed else None

    @property
    def first(self) -> str | None:
        """First topic of the tables, where that is known before reading."""
        known = self.chosen if self.is_listed else self.wanted if len(self.wanted) == 1 else ()
        if not self.is_listed and any(map(is_pattern, known)):
            return None
        return next(iter(known), None)

    @property
    def missing(self) -> tuple[str, ...]:
        """Wanted names that match no topic."""
        return tuple(name for name in self.wanted if not self._found(name))

    def takes(self, topic: str) -> bool:
        """Return True if the sweeps of a topic met while reading are wanted; remember the topic."""
        self._there.add(topic)
        return not self.wanted or self.is_listed or any(means(wanted, topic) for wanted in self.wanted)

    def error(self, every: bool = False) -> NoScanError | None:
        """Return the error if nothing can be read; with `every`, also if any wanted topic is missing."""
        missing = self.missing
        if missing and (every or len(missing) == len(self.wanted)):
            return NoScanError(self._absent(missing))
        if self.wanted or self._there:
            return None
        words = f"{no_scan_topic()} ({self._list()})" if self.is_listed else "no LaserScan in it"
        return NoScanError(words + self._hint(topic.name for topic in self._topics))

    def _found(self, name: str) -> list[str]:
        """Return the topics that a name or pattern means: the exact one if it exists."""
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
        """Return a hint if some of these topics hold point clouds."""
        named = {bare(name) for name in names}
        return clouds_hint(topic for topic in self._topics if bare(topic.name) in named)

    def _list(self) -> str:
        """Return the topics of the log as words."""
        if not self._topics:
            return "it has no topics"
        names = [f"{topic.name} {topic.type}" for topic in sorted(self._topics, key=lambda topic: topic.name)]
        return f"its topics: {_some(names)}"


def nothing_read(damage: Sequence[str], error: NoScanError, wanted: Sequence[str]) -> LidarcliError:
    """Return the error of a log without LaserScan; a damaged log counts as unreadable, as scans may be in the lost part."""
    if not damage:
        return error
    topics = f" topic{_named(wanted)}" if wanted else ""
    return UnreadableError(f"no LaserScan{topics} in the part that could be read; {damage[0]}")


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{', '.join(names[:_SHOWN])}{more}"


def _named(names: Sequence[str]) -> str:
    return f" {' or '.join(names)}" if names else ""
