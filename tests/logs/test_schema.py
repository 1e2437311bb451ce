"""Definitions of LaserScan that come with a log, as they are and as somebody made them to take for ever."""

from __future__ import annotations

import pytest

from lidarcli.logs.base import LASERSCAN, MULTI_ECHO
from lidarcli.logs.laserscan import differs

MEGABYTE = 1_000_000


HEAD = "std_msgs::msg::Header header; double x;"
TEXTS = {
    "the same struct again and again": "struct LaserScan {" * (MEGABYTE // 18),
    "quotes in an open text": '"' + '\\"' * (MEGABYTE // 2),
    "open comments": "/*" * (MEGABYTE // 2),
    "stars in an open comment": "/*" + "*" * MEGABYTE,
    "open annotations": "struct LaserScan {" + "@a(" * (MEGABYTE // 3),
    "a word": "struct LaserScan {" + "a" * MEGABYTE,
    "spaces": "struct LaserScan { a" + " " * MEGABYTE + "b;",
    "spaces before the name": "struct" + " " * MEGABYTE,
}


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ros2idl", "ros2msg"])
@pytest.mark.parametrize("kind", TEXTS)
def test_a_megabyte_of_anything_is_read_once(kind: str, encoding: str) -> None:
    """With a look back from every place each of these took minutes."""
    says = differs(LASERSCAN, encoding, TEXTS[kind])
    assert says is None or says.startswith("field 1 is ")
    assert differs(MULTI_ECHO, encoding, TEXTS[kind]) is None or encoding == "ros2msg"
    # What stands before it is still understood.
    if encoding == "ros2idl":
        whole = f"struct LaserScan {{{HEAD}}}; {TEXTS[kind]}"
        assert differs(LASERSCAN, encoding, whole) == "field 2 is 'double x', not 'float32 angle_min'"
