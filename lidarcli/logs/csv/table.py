"""The lines of a CSV as a table: its dialect, plain lines, and its head; formats of text that are no CSV."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.cells import DATED, MS, NS, TIME_OF_DAY, US, is_numeric, shown, time_unit
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps.types import Int64

_QUOTED = re.compile(rb'"[^"]*"')
# A bracket that nothing closes takes all that follows: to try each of many costs the square of their number.
_LIST = rb"\[[^\]]*(?:\]|\Z)|(?<![\w.])\([^()]*\)"
_LISTS = re.compile(_LIST)
_LISTS_AND_QUOTED = re.compile(_LIST + rb'|"[^"]*"')
_ARRAYS = re.compile(
    rb"\b(?:np\.)?array\(\s*(?:['\"]\w['\"],\s*)?(\[[^\[\]]*\])[^()\[\]]*\)|\b(?:np|numpy)\.\w+\(([^()]*)\)"
)
_BEGUN = re.compile(rb"[\[(]\s*(?:[-+.\d]|inf|nan)")
"""Start of a list of numbers."""
_DECIMAL_COMMA = re.compile(rb"\s*-?\d+,\d+(?:[eE][-+]?\d+)?\s*")
_ENOUGH = 64 << 10
SAMPLE_LINES = 3000
SAMPLE_BYTES = 256 << 10
"""Most lines and bytes by which a layout is recognised; two lines at least."""

MAX_TEXT = 64 << 10
"""Bytes at the start of a file in which other formats are looked for."""
_COMMENTS = rb"(?:[ \t]*(?:#[^\n]*)?\r?\n)*"
_YAML_KEY = rb"[ \t]*(?:- )?[A-Za-z_][\w.-]*:"
_LOGGED = rb"(?:\[[A-Z]+\][^\n]*?)?"
_AS_CSV = "convert it to CSV with a column per beam (`time,r0,r1,...` in the first line)"
_RECORD = "record with `ros2 bag record` or `rosbag record`, or print with `ros2 topic echo --csv --full-length`"
_ONLY_POSES = "it holds poses, no ranges"


@dataclass(frozen=True, slots=True)
class Dialect:
    """Separators of a file."""

    separator: bytes
    decimal_comma: bool = False
    trailing: bool = False
    """True where every line ends with a separator, behind which there is no cell."""


@dataclass(frozen=True, slots=True)
class PlainLines:
    """Plain lines and their numbers in the file."""

    text: bytes
    """Each line ended by one newline."""
    numbers: Int64
    cut: bool


def guess_dialect(lines: Sequence[bytes]) -> Dialect | None:
    """Return the separator that most lines hold, outside quotes and lists; None for text that is no table."""
    # The head counts for more than what follows: damage must not hide what the file is.
    lines = lines[:12]
    if max(map(len, lines)) <= _ENOUGH:
        # A quoted cell may span lines.
        bare = _unlisted(b"\n".join(lines)).split(b"\n")
    else:
        bare = [_unlisted(line[:_ENOUGH]) for line in lines]
    enough = max(1, (len(bare) + 1) // 2)

    def common(separator: bytes) -> bool:
        found = [separator in line.strip() for line in bare]
        return sum(found) >= enough or (len(found) > 2 and all(found[:2]))

    if common(b",") and common(b" ") and not common(b";") and not common(b"\t"):
        # Decimal commas set apart by spaces: every word of a line is such a number.
        words = max(bare, key=len).split()
        if len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(word) for word in words):
            return Dialect(b" ", decimal_comma=True)
    for separator in (b";", b"\t", b",", b" "):
        if common(separator):
            break
    else:
        return None
    trailing = separator != b" " and all(line.rstrip(b" ").endswith(separator) for line in lines)
    comma = separator in b";\t" and any(
        _DECIMAL_COMMA.fullmatch(cell.strip(b'"')) for line in lines for cell in line[:_ENOUGH].split(separator)
    )
    return Dialect(separator, comma, trailing)


def plain_lists(text: bytes) -> bytes:
    """Return the text with the calls of Python taken off lists and numbers: `array('f', [1.0])`, `np.float32(1.0)`."""
    return _ARRAYS.sub(rb"\1\2", text) if re.search(rb"array\(|\bnp\.|numpy\.", text) else text


def empty_lists(text: bytes) -> bytes:
    """Return the text with `[]` or `()` in place of each list in brackets."""
    return _LISTS.sub(lambda match: match[0][:1] + match[0][-1:] if match[0][-1:] in b"])" else match[0], plain_lists(text))


def _quoted_lists(line: bytes) -> bytes:
    """Return the line with quotes around each list in brackets, which is one cell."""
    if b"[" not in line and b"(" not in line:
        return line
    return _LISTS_AND_QUOTED.sub(
        lambda match: b'"%s"' % match[0] if match[0][-1:] in b"])" else match[0], plain_lists(line)
    )


def _unlisted(text: bytes) -> bytes:
    """Return the text with a mark in place of each list in brackets and each quoted cell."""

    def mark(match: re.Match[bytes]) -> bytes:
        whole = match[0].startswith(b'"') or match[0][-1:] in b"])"
        return b'"' if whole else _QUOTED.sub(b'"', match[0])

    return _LISTS_AND_QUOTED.sub(mark, text)


def split_line(line: bytes, dialect: Dialect) -> list[bytes]:
    """Return the cells of one line, quotes taken off."""
    plain = plain_text(line + b"\n", dialect)[:-1]
    return [cell.strip() for cell in plain.split(dialect.separator)]


def plain_text(text: bytes, dialect: Dialect) -> bytes:
    """Remove quotes, runs of spaces, decimal commas and trailing separators from lines."""
    separator = dialect.separator
    if b'"' in text:
        text = _unquote(text, separator)
    if separator == b" ":
        text = re.sub(rb"[ \t]+", b" ", text).replace(b" \n", b"\n").replace(b"\n ", b"\n").removeprefix(b" ")
    if dialect.decimal_comma:
        text = text.replace(b",", b".")
    if dialect.trailing:
        text = text.replace(separator + b"\n", b"\n")
    return text


def read_lines(block: TextBlock, dialect: Dialect | None, skip: bytes, start: int, report: ReadReport) -> PlainLines:
    """Return the lines of a block that can be rows, made plain where a dialect is given.

    Parameters
    ----------
    skip : a line that is left out wherever it stands (the header, repeated where files were joined); b'' for none
    start : number of the first line that is data
    """
    text = block.text
    numbers = block.line + np.arange(block.lines)
    awkward = block.line < start or b"#" in text or b"\0" in text
    last = block.line + len(numbers) - 1
    if awkward or (skip and skip[:32] in text):
        kept, place = [], []
        for number, line in enumerate(text.split(b"\n")[:-1], block.line):
            if number < start or line == skip or not line.strip(b" \t\0,;") or line.lstrip()[:1] == b"#":
                if b"\0" in line:
                    report.add_damage(f"line {number}", "nothing but NUL bytes")
            elif b"\0" in line:
                report.add_damage(f"line {number}", "NUL bytes among the text: the line is dropped")
            else:
                kept.append(line)
                place.append(number)
        text = b"".join(line + b"\n" for line in kept)
        numbers = np.array(place, np.int64)
    if dialect is not None:
        text = plain_text(text, dialect)
    return PlainLines(text, numbers, block.cut and bool(len(numbers)) and int(numbers[-1]) == last)


def csv_cells(line: str, separator: str) -> list[str]:
    """Return the cells of a record with quotes, the first one of `line`; ValueError where the quotes do not match."""
    try:
        return next(csv.reader(line.split("\n"), delimiter=separator, skipinitialspace=True), [])
    except csv.Error as err:
        raise ValueError(str(err)) from err


def _unquote(text: bytes, separator: bytes) -> bytes:
    """Take off quotes; a separator inside them becomes a space, or a decimal point between two digits."""
    buffer = np.frombuffer(text, np.uint8)
    quotes = np.flatnonzero(buffer == ord('"'))
    marks = np.flatnonzero(buffer == separator[0])
    ends = np.flatnonzero(buffer == ord("\n"))
    before_line = np.searchsorted(quotes, np.append(0, ends + 1))
    # A line with a quote too many has no inside and outside: its quotes go, its separators stay.
    matched = np.diff(before_line) % 2 == 0
    line = np.searchsorted(ends, marks)
    inside = marks[((np.searchsorted(quotes, marks) - before_line[line]) % 2 == 1) & matched[line]]
    if len(inside):
        changed = buffer.copy()
        digit = (buffer >= ord("0")) & (buffer <= ord("9"))
        changed[inside] = np.where(digit[inside - 1] & digit[inside + 1], ord("."), ord(" "))
        text = changed.tobytes()
    return text.replace(b'"', b"")


@dataclass(frozen=True, slots=True)
class Head:
    """First lines of a file: names of columns, if any, and rows as text and as cells."""

    path: str
    dialect: Dialect
    names: list[str]
    header: bytes
    """Line with the names of columns; b'' where there is none, or where it is a comment."""
    start: int
    lines: list[bytes]
    rows: list[list[bytes]]
    options: OpenOptions

    def column(self, index: int) -> list[bytes]:
        """Return the cells of a column that are not empty, in rows as long as the header where there is one."""
        least = len(self.names) or index + 1
        cells = [row[index] for row in self.rows if len(row) >= least and row[index]]
        return cells or [row[index] for row in self.rows if len(row) > index and row[index]]

    @property
    def usual(self) -> int:
        """Cells of more than half of the rows; 0 where rows differ."""
        counts = Counter(map(len, self.rows))
        return next((cells for cells, rows in counts.items() if 2 * rows > len(self.rows)), 0)

    def units(self, fields: dict[str, int]) -> dict[str, int]:
        """Return the units of the time columns among `fields`; a column that holds no times has none."""
        units: dict[str, int] = {}
        parts = time_unit(self.names[fields["nanoseconds"]].split(".")[-1], [b"0"]) if "seconds" in fields else None
        if parts in (US, MS):
            units["nanoseconds"] = parts
        for name in {"record", "stamp", "date"} & fields.keys():
            if self.names[0].strip().lower() == "%time" and name != "date":
                units[name] = NS
            elif (unit := time_unit(self.names[fields[name]], self.column(fields[name]))) is not None:
                units[name] = unit
        if "date" in units and units.get("record") == TIME_OF_DAY:
            units["record"] = DATED
        else:
            units.pop("date", None)
        return units


def read_head(lines: Sequence[bytes], options: OpenOptions, path: str) -> Head:
    """Find the table, its dialect and its names; UnreadableError where there is no table."""
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    # Spreadsheets name their separator so.
    numbered = numbered[bool(numbered and re.fullmatch(rb'\s*"?sep=."?\s*', numbered[0][1], re.IGNORECASE)) :]
    comment = b""
    while numbered and numbered[0][1].lstrip()[:1] == b"#":
        comment = numbered.pop(0)[1]
    numbered = _sample([(number, line) for number, line in numbered if line.lstrip()[:1] != b"#"])
    if not numbered:
        raise UnreadableError(f"{path}: no data in it, only comments or blank lines")
    dialect = guess_dialect([line for _, line in numbered])
    if dialect is None and _BEGUN.match(plain_lists(numbered[0][1].lstrip())):
        dialect = Dialect(b",")
    if dialect is None:
        raise UnreadableError(f"{path}: text, but no table with columns: {shown(numbered[0][1], 60)}")
    # A title above the table has a single cell.
    while len(numbered) > 1 and dialect.separator not in (line := numbered[0][1].strip()) and not _BEGUN.match(line):
        numbered.pop(0)
    cells = [split_line(_quoted_lists(line), dialect) for _, line in numbered]
    number, first = numbered[0]
    if _is_header(cells[0]):
        names = [*map(_name, cells[0])]
        return Head(path, dialect, names, first, number + 1, [line for _, line in numbered[1:]], cells[1:], options)
    names = []
    if comment:
        words = split_line(comment.lstrip().lstrip(b"#").lstrip(), dialect)
        if len(words) == len(cells[0]) and _is_header(words):
            names = [*map(_name, words)]
    return Head(path, dialect, names, b"", number, [line for _, line in numbered], cells, options)


def _name(cell: bytes) -> str:
    """Return the text of a name: in UTF-8, else in GBK where all bytes beyond ASCII are pairs, else in Latin-1."""
    try:
        return cell.decode()
    except UnicodeDecodeError:
        pairs = re.fullmatch(rb"(?:[\0-\x7f]|[\xa1-\xf7][\xa1-\xfe])*", cell)
        return cell.decode("gbk" if pairs else "latin-1", "replace")


def _sample(numbered: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    size = 0
    for place, (_, line) in enumerate(numbered):
        size += len(line)
        if place >= 2 and (size > SAMPLE_BYTES or place >= SAMPLE_LINES):
            return numbered[:place]
    return numbered


def _is_header(cells: Sequence[bytes]) -> bool:
    """Return whether cells are names: the first one that is not blank is neither a number, a list of these nor a time."""
    named = [cell for cell in cells if cell]
    return bool(named) and not (is_numeric(named[0]) or _BEGUN.match(named[0]) or time_unit("", [named[0]]) is not None)


@dataclass(frozen=True, slots=True)
class Other:
    """A text format that is recognised and not read."""

    name: str
    way_out: str
    marks: re.Pattern[bytes]

    @property
    def refusal(self) -> str:
        """Message that names the format and the way out."""
        return f"{self.name}, which lidarcli does not read: {self.way_out}"


TRAJECTORY = Other(
    "a trajectory (TUM)", _ONLY_POSES, re.compile(_COMMENTS + rb"#?[^\n]*\btx[ ,]+ty[ ,]+tz[ ,]+qx[ ,]+qy[ ,]+qz[ ,]+qw\b")
)
OTHERS = (
    TRAJECTORY,
    Other(
        "a pointer of Git LFS, not the file itself", "fetch it with `git lfs pull`", re.compile(rb"version https://git-lfs")
    ),
    Other("JSON", _AS_CSV, re.compile(rb"\s*(?:\{\s*[\"}]|\[\s*[\[{\"])")),
    Other("XML or HTML", "look whether a download has failed", re.compile(rb"\s*<[?!A-Za-z]")),
    Other(
        "ROS messages as Python prints them",
        _RECORD,
        re.compile(rb"%s[ \t]*(?:\[[ \t]*)?\w+_msgs\.msg\.[\w.]+\(" % _LOGGED),
    ),
    Other(
        "YAML",
        _RECORD,
        re.compile(
            rb"[^\n]*\bheader:[ \t]*\r?\n[ \t]+(?:seq|stamp):"
            rb"|%s(?:%%YAML|---[ \t]*\r?\n|%s[ \t][^\n]*\n---[ \t]*\r?\n|%s[ \t]*\r?\n(?:[ \t]+%s|[ \t]*- )"
            rb"|%s[ \t][^\n,;]*\n%s(?:[ \t][^\n,;]*)?\r?\n)"
            % (_COMMENTS, _YAML_KEY, _YAML_KEY, _YAML_KEY, _YAML_KEY, _YAML_KEY)
        ),
    ),
)


def other_format(text: bytes) -> Other | None:
    """Return the format of a text that is plainly no CSV; None for all others.

    >>> other_format(b"# time tx ty tz qx qy qz qw").name
    'a trajectory (TUM)'
    """
    start = text[:MAX_TEXT]
    return next((other for other in OTHERS if other.marks.match(start)), None)
