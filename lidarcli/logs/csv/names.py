"""What the columns of a CSV header mean: beams, geometry, times, frames."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from string import whitespace

import numpy as np

from lidarcli.logs.csv.layouts import BAGPY, DEFAULT_TOPIC, MCAP_CAT, PLOTJUGGLER, ROSTOPIC, WIDE
from lidarcli.sweeps import Int64

_MARKS = re.compile(r"[./\[\]\s%#:]+")
_DECIMAL = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[-+]?\.\d+")
_LIST = re.compile(r"(?:\w[\w.]*\s*\()?\s*[\[(]|\w*array\(")
_INDEX = re.compile(r"(\d{1,7})\]?(?:[._/]echoes[\[._]?0\]?)?\Z")
_BEFORE_INDEX = "[._/-" + whitespace
"""What may stand between a word and its index."""
_RANGE_WORD = re.compile(
    r"(?:.*(?:range|scan|dist|beam|laser|lidar|ray|bin|point|value).*|r|d|b|m|l|v|rho|col(?:umn)?|)$"
)
_UNIT = r"(?:_?\(?(?:s|secs?|seconds|ms|msec|us|usec|µs|ns|nsecs?|nanosec)\)?)?"
_FIELDS = {
    name: re.compile(pattern)
    for name, pattern in {
        "angle_min": r"(?:angle_min|anglemin|min_angle|start_?angle)",
        "angle_max": r"(?:angle_max|anglemax|max_angle|end_?angle)",
        "angle_increment": r"(?:angle_increment|angleincrement|angle_inc|angular_resolution)",
        "time_increment": r"time_increment",
        "scan_time": r"scan_time",
        "range_min": r"(?:range_min|rangemin|min_range)",
        "range_max": r"(?:range_max|rangemax|max_range)",
        "seconds": r"(?:(?:header_)?(?:(?:time)?stamp_)?(?:secs?|seconds))",
        "nanoseconds": r"(?:(?:header_)?(?:(?:time)?stamp_)?(?:nsecs?|nanosecs?|nanoseconds))",
        "stamp": rf"(?:header_)?stamp{_UNIT}",
        "record": rf"(?:rosbag)?(?:time_?stamp|(?:date|bag|record|log)?_?time|t|date|record){_UNIT}",
        "frame": r"(?:header_)?(?:frame_?id|frame)",
        "header": r"header",
        "seq": r"(?:header_)?(?:seq|sequence|index|id)",
    }.items()
}
_ANY_FIELD = re.compile("|".join(pattern.pattern for pattern in _FIELDS.values()))
_LONGEST_FIELD = 40
"""Characters that no name of a field exceeds, what stands before it left out."""
_ANGLE = re.compile(
    r"(?:.*_)?(?:angle|theta|bearing|azimuth|phi)s?(?:_?\(?(?P<unit>deg|degrees?|°|rad|radians?)\)?)?"
    r"|(?P<bare>deg|degrees?|rad|radians?)"
)
_RANGE = re.compile(
    r"(?:.*_)?(?:ranges?|r|rho|distance|dist|radius|depth)(?:_?\(?(?:m|mm|cm|met[er]{2}s?)\)?)?"
)
_LAYER = re.compile(
    r"(?:.*_)?(?:elevations?|inclination|vertical(?:_angle)?|layer|ring|channel|laser)"
    r"(?:_?\(?(?:deg|degrees?|°|rad|radians?|id|index|idx|number|no|nr|num)\)?)?"
)
_SPHERE = re.compile(r"(theta|phi)(?:_?\(?(?:deg|degrees?|°|rad|radians?)\)?)?")
_SWEEP = re.compile(
    r"(?:sweep|scan|turn|revolution|rotation|seq|frame)(?:_?(?:id|index|idx|number|no|nr|num))?|id"
)


@dataclass(frozen=True, slots=True)
class Family:
    """Columns that hold the beams of one scan."""

    prefix: str
    """What stands before the word for ranges: `field.`, `/scan/`, or nothing."""
    columns: Int64
    """(B,) the column of each beam."""

    @property
    def topic(self) -> str:
        """The topic the prefix names; `/scan` where it names none."""
        name = self.prefix.rstrip("._/ ")
        return DEFAULT_TOPIC if name.lower() in ("", "field", "msg", "data") else name


@dataclass(frozen=True, slots=True)
class LongColumns:
    """Columns of a table with one beam per row."""

    angle: int
    range: int
    sweep: int | None
    degrees: bool | None
    """None: the name does not say."""


def canonical(name: str) -> str:
    """One spelling for a column name: `/scan/header.stamp` → `scan_header_stamp`.

    >>> canonical("%time"), canonical("field.header.frame_id"), canonical("Angle Min")
    ('time', 'field_header_frame_id', 'angle_min')
    """
    return _MARKS.sub("_", name.strip().lower()).strip("_")


class FieldIndex:
    """Where the fields of a scan may stand in a header: one look at each name serves every scan in it."""

    def __init__(self, names: Sequence[str]) -> None:
        self._starts: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
        """What stands before a field's name → column and the fields it may be, in the order of the columns."""
        seen: Counter[tuple[str, tuple[str, ...]]] = Counter()
        again: Counter[str] = Counter()
        for column, name in enumerate(names):
            again[name] += 1
            if again[name] > len(_FIELDS):
                continue
            for start, fields in _endings(canonical(name)):
                # Columns of one kind beyond the number of fields they may be are never needed.
                if seen[start, fields] < len(fields):
                    seen[start, fields] += 1
                    self._starts.setdefault(start, []).append((column, fields))

    def find(self, prefix: str) -> dict[str, int]:
        """The columns of the fields of one scan: those with its prefix first, then those without any."""
        found: dict[str, int] = {}
        start = canonical(prefix) + "_" if canonical(prefix) else ""
        for begin in dict.fromkeys((start, "")):
            for column, fields in self._starts.get(begin, ()):
                for field in fields:
                    if field not in found:
                        found[field] = column
                        break
        if not {"seconds", "nanoseconds"} <= found.keys():
            found.pop("nanoseconds", None)
            if "seconds" in found:
                found.setdefault("record", found.pop("seconds"))
        return found


def _endings(name: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Every way to read a canonical name as a prefix and a field: the prefix, and the fields it may be."""
    for place in range(max(len(name) - _LONGEST_FIELD, 0), len(name)):
        if (not place or name[place - 1] == "_") and _ANY_FIELD.fullmatch(name, place):
            yield (
                name[:place],
                tuple(field for field, pattern in _FIELDS.items() if pattern.fullmatch(name, place)),
            )


def find_families(names: Sequence[str]) -> list[Family]:
    """The groups of columns `ranges[0]`, `ranges_1`, `r2`, ... that are the beams of a scan."""
    found: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        name = name.strip()
        match = _INDEX.search(name)
        if match is None or "intens" in name.lower():
            continue
        stem = name[: match.start()].rstrip(_BEFORE_INDEX)
        found.setdefault(stem, {}).setdefault(int(match[1]), column)
    families = []
    for stem, columns in found.items():
        word = re.split(r"[./]", stem)[-1].strip(" _-").lower()
        indices = sorted(columns)
        whole = len(indices) >= 3 and indices[-1] - indices[0] == len(indices) - 1
        if whole and _RANGE_WORD.fullmatch(word):
            end = stem.lower().rfind("ranges")
            prefix = stem[:end] if end >= 0 else stem[: len(stem) - len(word)]
            ranged = end >= 0
            families.append((ranged, Family(prefix, np.array([columns[i] for i in indices], np.int64))))
    if any(ranged for ranged, _ in families):
        return [family for ranged, family in families if ranged]
    return (
        [max((family for _, family in families), key=lambda family: len(family.columns))] if families else []
    )


def find_intensities(names: Sequence[str]) -> dict[str, Int64]:
    """The columns `intensities[0]`, `intensities_1`, ... of each scan, by what stands before the word, in lower case."""
    found: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        stem = name.strip().lower()
        match = _INDEX.search(stem) if "intens" in stem else None
        if match is not None:
            stem = stem[: match.start()].rstrip(_BEFORE_INDEX)
            found.setdefault(stem, {}).setdefault(int(match[1]), column)
    return {
        stem.removesuffix("intensities"): np.array([columns[index] for index in sorted(columns)], np.int64)
        for stem, columns in found.items()
        if stem.endswith("intensities") and max(columns) - min(columns) == len(columns) - 1
    }


def find_bearings(names: Sequence[str]) -> tuple[Family, float, float] | None:
    """Columns that are named by their bearing: the columns, the first bearing and the step, as written."""
    numbers: dict[int, float] = {}
    for column, name in enumerate(names):
        text = name.strip().rstrip("°")
        if _DECIMAL.fullmatch(text):
            numbers[column] = float(text)
    columns = np.array(list(numbers), np.int64)
    values = np.array(list(numbers.values()))
    if len(values) < 3 or (np.diff(columns) != 1).any() or not np.isfinite(values).all():
        return None
    step = (values[-1] - values[0]) / (len(values) - 1)
    even = np.abs(values - values[0] - step * np.arange(len(values))).max() <= 0.25 * abs(step)
    counted = step == 1 and values[0] in (0, 1) and not any("." in names[c] for c in numbers)
    if not even or counted or not step:
        return None
    return Family("", columns), float(values[0]), float(step)


def _first_columns(names: Sequence[str]) -> dict[str, int]:
    """Each canonical name once, and the first column that has it."""
    columns: dict[str, int] = {}
    for name, column in {name: column for column, name in reversed(list(enumerate(names)))}.items():
        plain = canonical(name)
        columns[plain] = min(column, columns.get(plain, column))
    return dict(sorted(columns.items(), key=lambda item: item[1]))


def find_long(names: Sequence[str]) -> LongColumns | None:
    """The columns of a table with one beam per row; None where it is none."""
    columns = _first_columns(names)
    angle = next(
        (
            (column, match)
            for name, column in columns.items()
            if (match := _ANGLE.fullmatch(name)) and not _LAYER.fullmatch(name)
        ),
        None,
    )
    distance = next((column for name, column in columns.items() if _RANGE.fullmatch(name)), None)
    if angle is None or distance is None:
        return None
    unit = angle[1]["unit"] or angle[1]["bare"]
    sweep = next((column for name, column in columns.items() if _SWEEP.fullmatch(name)), None)
    return LongColumns(angle[0], distance, sweep, None if unit is None else not unit.startswith("rad"))


def find_layers(names: Sequence[str]) -> list[int]:
    """The columns that may tell the layers of a scan in space: an elevation, a ring, one of the angles of a sphere."""
    columns = _first_columns(names)
    sphere = {match[1]: column for name, column in columns.items() if (match := _SPHERE.fullmatch(name))}
    layers = [column for name, column in columns.items() if _LAYER.fullmatch(name)]
    return layers + ([max(sphere.values())] if len(sphere) == 2 else [])


def list_column(names: Sequence[str], cells: Mapping[int, str]) -> tuple[int, str] | None:
    """The column whose cell is a list of ranges, and the prefix of its name."""
    for column, cell in cells.items():
        text = cell.strip()
        if not _LIST.match(text):
            continue
        name = names[column].strip()
        word = re.split(r"[./]", name)[-1].lower()
        if "intens" not in word and re.fullmatch(r".*(?:ranges?|scan|distances?|data|values?)", word):
            end = name.lower().rfind("ranges")
            return column, name[:end] if end >= 0 else ""
    return None


def ros_name(names: Sequence[str]) -> str:
    """The layout that a tool of ROS names its columns by; plain wide where it is none of them."""
    plain = [name.strip().lower() for name in names]
    if plain[0] == "%time":
        return ROSTOPIC
    if "__time" in plain:
        return PLOTJUGGLER
    if plain[:3] == ["log_time", "publish_time", "sequence"]:
        return MCAP_CAT
    if any(name.startswith("header.") for name in plain):
        return BAGPY
    return WIDE


def has_ros_header(names: Sequence[str]) -> bool:
    """Columns of a ROS header: a log of something else than ranges."""
    plain = {canonical(name) for name in names}
    return bool(
        plain & {"header", "header_stamp", "header_frame_id", "header_stamp_secs", "header_stamp_sec"}
    )
