"""Does a log's own definition of LaserScan say what the decoder takes for granted?"""

from __future__ import annotations

import re

from lidarcli.logs.base import LASERSCAN, MULTI_ECHO

_SCALARS = (
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
)
_EXPECTED = {
    LASERSCAN: ("Header", "float32[]"),
    MULTI_ECHO: ("Header", "LaserEcho[]"),
}
# What is left open goes on to the end, and nothing is gone back over: a schema may be a megabyte of anything.
_NO_CODE = re.compile(r'"(?:[^"\\]|\\.)*+"?|//[^\n]*+|/\*(?:[^*]|\*(?!/))*+(?:\*/)?', re.DOTALL)
_ANNOTATION = re.compile(r"@\w++\s*+\([^)]*+\)?")
_BESIDE_TYPES = re.compile(r"\b\w++::|(?<=<)\s++|(?<!\s)\s++(?=[<>])")
_IDL_NAMES = {"float": "float32", "sequence<float>": "float32[]", "sequence<LaserEcho>": "LaserEcho[]"}


def differs(type_name: str, encoding: str, text: str) -> str | None:
    """The first field in which a definition leaves the standard one; None where it agrees or says nothing.

    >>> differs(LASERSCAN, "ros2msg", "std_msgs/Header header\\nfloat64 angle_min")
    "field 2 is 'float64 angle_min', not 'float32 angle_min'"
    """
    header, ranges = _EXPECTED[type_name]
    expected = [(header, "header"), *(("float32", name) for name in _SCALARS), (ranges, "ranges")]
    read = _idl_fields if encoding == "ros2idl" else _msg_fields
    found = read(text, type_name.rsplit("/", 1)[-1])
    if not found:
        return None
    for place, (kind, name) in enumerate(expected):
        seen = found[place] if place < len(found) else ("nothing", "")
        if seen != (kind, name):
            return f"field {place + 1} is '{' '.join(seen).strip()}', not '{kind} {name}'"
    return None


def _msg_fields(text: str, _name: str) -> list[tuple[str, str]]:
    """Types and names of a .msg definition; the definitions of its parts follow a line of '='."""
    fields = []
    for raw in text.splitlines():
        line = raw.split("#", 1)[0].strip()
        if line.startswith("=="):
            break
        words = line.split()
        if len(words) >= 2 and "=" not in line:
            fields.append((words[0].rsplit("/", 1)[-1], words[1]))
    return fields


def _idl_fields(text: str, name: str) -> list[tuple[str, str]]:
    """Types and names of the members of `struct name` in an IDL definition."""
    bare = _NO_CODE.sub("", text)
    struct = re.search(rf"\bstruct\s++{name}\s*+\{{([^}}]*+)", bare)
    if struct is None:
        return []
    members = _ANNOTATION.sub("", struct[1])
    fields = []
    for member in members.split(";"):
        words = _BESIDE_TYPES.sub("", member).split()
        if len(words) >= 2:
            kind = "".join(words[:-1])
            fields.append((_IDL_NAMES.get(kind, kind), words[-1]))
    return fields
