"""Names of columns as people and tools write them: the fields of a scan, and rows of columns that hold its beams."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from string import whitespace

import numpy as np

from lidarcli.sweeps.types import Int64

_MARKS = re.compile(r"[./\[\]\s%#:]+")
INDEX = re.compile(r"(\d{1,7})\]?(?:[._/]echoes[\[._]?0\]?)?\Z")
BEFORE_INDEX = "[._/-" + whitespace
_RANGE_WORD = re.compile(
    r"(?:.*(?:range|scan|dist|beam|laser|lidar|ray|bin|point|value).*|r|d|b|m|mm|cm|l|v|rho|col(?:umn)?|)$"
)
_PARTS = r"(?:milli|micro|nano)(?:s|sec|seconds)"
_WHOSE = r"(?:date|bag|record|log|unix|epoch|system|host|device|ros|utc|gps|boot|elapsed)"
_UNIT = rf"(?:_?\(?(?:s|secs?|seconds|ms|msec|us|usec|µs|ns|nsecs?|nanosec|{_PARTS})\)?)?"
FIELDS = {
    name: re.compile(pattern)
    for name, pattern in {
        "angle_min": r"(?:angle_min|anglemin|min_angle|start_?angle)",
        "angle_max": r"(?:angle_max|anglemax|max_angle|end_?angle)",
        "angle_increment": r"(?:angle_increment|angleincrement|angle_inc|angular_resolution)",
        "time_increment": r"time_increment",
        "scan_time": r"scan_time",
        "range_min": r"(?:range_min|rangemin|min_range)",
        "range_max": r"(?:range_max|rangemax|max_range)",
        "seconds": r"(?:(?:header_|tv_)?(?:(?:time)?stamp_)?(?:secs?|seconds))",
        "nanoseconds": r"(?:(?:header_|tv_)?(?:(?:time)?stamp_)?(?:[num]secs?|(?:nano|micro|milli)sec(?:ond)?s?))",
        "stamp": rf"(?:header_)?stamp{_UNIT}",
        "record": rf"(?:rosbag)?(?:time_?stamp|{_WHOSE}?_?time|t|record|epoch|elapsed|uptime){_UNIT}|{_PARTS}|[mun]s",
        "date": r"date",
        "frame": r"(?:header_)?(?:frame_?id|frame)",
        "header": r"header",
        "seq": r"(?:header_)?(?:seq|sequence|index|id)",
    }.items()
}
"""Field of a scan → the canonical names of its column."""
_ANY_FIELD = re.compile("|".join(pattern.pattern for pattern in FIELDS.values()))
OF_NO_USE = re.compile(
    "|".join(FIELDS[name].pattern for name in FIELDS if not re.search("seconds|stamp|record|date", name))
)
LENGTH = r"(?:mm|cm|m|(?:milli|centi)?met[er]{2}s?)"
_END_LENGTH = re.compile(rf"(?<=\d)[_ (\[]+{LENGTH}[)\]]?$", re.IGNORECASE)
ANGLE = re.compile(
    r"(?:.*_)?(?:angle|theta|bearing|azimuth|phi|(?P<clockwise>clockwise))s?"
    r"(?:_?\(?(?P<unit>deg|degrees?|°|rad|radians?)\)?)?|(?P<bare>deg|degrees?|rad|radians?)"
)
BEAM = re.compile(
    r"(?:(?:beam|ray|bin|step|point|angle|bearing)_?(?:id|index|idx|number|no|nr|num)|beam|ray|bin|step|index|idx|number)"
)
LAYER = re.compile(
    r"(?:.*_)?(?:elevations?|inclination|vertical(?:_angle)?|layer|ring|channel|laser)"
    r"(?:_?\(?(?:deg|degrees?|°|rad|radians?|id|index|idx|number|no|nr|num)\)?)?"
)
SPHERE = re.compile(r"(theta|phi)(?:_?\(?(?:deg|degrees?|°|rad|radians?)\)?)?")
SWEEP = re.compile(r"(?:sweep|scan|turn|revolution|rotation|seq|frame)(?:_?(?:id|index|idx|number|no|nr|num))?|id")


def canonical(name: str) -> str:
    """Return one spelling for a column name: `/scan/header.stamp` → `scan_header_stamp`.

    >>> canonical("%time"), canonical("field.header.frame_id"), canonical("Angle Min")
    ('time', 'field_header_frame_id', 'angle_min')
    """
    return _MARKS.sub("_", name.strip().lower()).strip("_")


class FieldIndex:
    """Columns that may be fields of a scan; each name is parsed once for all scans of a header."""

    def __init__(self, names: Sequence[str]) -> None:
        self._starts: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
        """Prefix → column and the fields it may be, in the order of the columns."""
        kinds: Counter[tuple[str, tuple[str, ...]]] = Counter()
        again: Counter[str] = Counter()
        for column, name in enumerate(names):
            again[name] += 1
            if again[name] > len(FIELDS):
                continue
            for start, fields in _endings(canonical(name)):
                # Columns of one kind beyond the number of fields they may be are never needed.
                if kinds[start, fields] < len(fields):
                    kinds[start, fields] += 1
                    self._starts.setdefault(start, []).append((column, fields))

    def find(self, prefix: str) -> dict[str, int]:
        """Return the columns of the fields of one scan: those with its prefix first, then those without any."""
        found: dict[str, int] = {}
        start = canonical(prefix) + "_" if canonical(prefix) else ""
        for begin in dict.fromkeys((start, "")):
            for column, fields in self._starts.get(begin, ()):
                for name in fields:
                    if name not in found:
                        found[name] = column
                        break
        if not {"seconds", "nanoseconds"} <= found.keys():
            for name in ("seconds", "nanoseconds"):
                if name in found:
                    found.setdefault("record", found.pop(name))
        if "record" not in found and "date" in found:
            found["record"] = found.pop("date")
        return found


def _endings(name: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield every way to read a canonical name as a prefix and a field: the prefix, and the fields it may be."""
    for place in range(max(len(name) - 40, 0), len(name)):
        if (not place or name[place - 1] == "_") and _ANY_FIELD.fullmatch(name, place):
            yield (name[:place], tuple(field for field, pattern in FIELDS.items() if pattern.fullmatch(name, place)))


def _series(names: Iterable[str]) -> dict[str, dict[int, int]]:
    """Return the stem of each name with an index → index → first column with it."""
    series: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        if (match := INDEX.search(name)) is not None:
            stem = name[: match.start()].rstrip(BEFORE_INDEX)
            series.setdefault(stem, {}).setdefault(int(match[1]), column)
    return series


def find_families(names: Sequence[str]) -> list[tuple[str, Int64]]:
    """Return prefix and (B,) columns of each group `ranges[0]`, `ranges_1`, `r2`, ... that are the beams of a scan."""
    families = []
    plain = (_END_LENGTH.sub("", name.strip()) for name in names)
    for stem, columns in _series("" if "intens" in name.lower() else name for name in plain).items():
        word = re.split(r"[./]", stem)[-1].strip(" _-").lower()
        indices = sorted(columns)
        whole = len(indices) >= 3 and indices[-1] - indices[0] == len(indices) - 1
        if whole and _RANGE_WORD.fullmatch(word):
            end = stem.lower().rfind("ranges")
            prefix = stem[:end] if end >= 0 else stem[: len(stem) - len(word)]
            families.append((end >= 0, (prefix, np.array([columns[i] for i in indices], np.int64))))
    if any(ranged for ranged, _ in families):
        return [family for ranged, family in families if ranged]
    return [max((family for _, family in families), key=lambda family: len(family[1]))] if families else []


def find_intensities(names: Sequence[str]) -> dict[str, Int64]:
    """Return the columns `intensities[0]`, `intensities_1`, ... of each scan by their prefix in lower case."""
    lower = [name.strip().lower() for name in names]
    return {
        stem.removesuffix("intensities"): np.array([columns[index] for index in sorted(columns)], np.int64)
        for stem, columns in _series(name if "intens" in name else "" for name in lower).items()
        if stem.endswith("intensities") and max(columns) - min(columns) == len(columns) - 1
    }
