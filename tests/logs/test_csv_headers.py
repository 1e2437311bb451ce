"""The names of CSV columns: found as a slow look at every name finds them, in time that grows with the header alone."""

from __future__ import annotations

import io
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
import pytest

from lidarcli.errors import LidarcliError
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.csv.column_names import FIELDS, FieldIndex, canonical
from tests.logs.watched import CsvLog

SIZE = 1_000_000
"""Bytes of a header that nobody meant well."""
SOME = "stamp secs nsecs frame_id angle_min angle_max angle_increment range_min range_max seq id t timestamp"
WORDS = f"{SOME} stamp_secs stamp_nsecs header header/stamp header.stamp.secs header.stamp.nanosecs x ranges[0] _".split()
UNITS = ["_", "[", "._", "1", "_" * 99 + ",", "._" * 50 + "x,", "t,", "header_stamp_secs,", '"', '","', "[,", "(,"]
UNITS += [" ", "angle_,", "angle_", "range", "_s)", "/echoes[0]", "ranges[", "a ,", "°", ",", "-"]


def slow_fields(names: Sequence[str], prefix: str) -> dict[str, int]:
    """Every name against every field, for one scan."""
    fields: dict[str, int] = {}
    start = canonical(prefix) + "_" if canonical(prefix) else ""
    for begin in dict.fromkeys((start, "")):
        for column, name in enumerate(map(canonical, names)):
            if name.startswith(begin):
                for field, pattern in FIELDS.items():
                    if field not in fields and pattern.fullmatch(name[len(begin) :]):
                        fields[field] = column
                        break
    if not {"seconds", "nanoseconds"} <= fields.keys():
        for name in ("seconds", "nanoseconds"):
            if name in fields:
                fields.setdefault("record", fields.pop(name))
    return fields


def test_the_fields_are_those_of_a_slow_look_at_every_name() -> None:
    random = np.random.default_rng(3)
    found = 0
    for _ in range(400):
        prefixes = random.choice(["", "/a/", "field.", "/a/b/", "/scan/"], 3)
        names = [
            random.choice(prefixes) + random.choice(["", "", "x_"]) + random.choice(WORDS)
            for _ in range(random.integers(1, 25))
        ]
        index = FieldIndex(names)
        for prefix in {*prefixes.tolist(), "/other/"}:
            want = slow_fields(names, prefix)
            assert index.find(prefix) == want, (names, prefix)
            found += len(want)
    assert found > 3000


def plotjuggler(topics: int, rows: int) -> bytes:
    """An export of many scans of three beams."""
    fields = ["angle_min", "angle_max", "angle_increment", "range_min", "range_max", "ranges[0]", "ranges[1]", "ranges[2]"]
    names = ["__time", *(f"/robot{topic}/scan/{field}" for topic in range(topics) for field in fields)]
    cells = ["-0.5,0.5,0.5,0.1,12.0,2.1,2.0,2.1"] * topics
    lines = [",".join(names), *(",".join([f"{row}.5", *cells]) for row in range(rows))]
    return "\n".join([*lines, ""]).encode()


def calls(work: Callable[[], object]) -> int:
    """Calls of functions that some work takes: unlike its time, the same on every machine."""
    counted = Counter[str]()
    sys.setprofile(lambda frame, event, value: counted.update([event]))
    try:
        work()
    finally:
        sys.setprofile(None)
    return counted["call"] + counted["c_call"]


@pytest.mark.slow
def test_thousands_of_scans_in_one_table() -> None:
    with CsvLog(io.BytesIO(plotjuggler(5000, 3))) as log:
        blocks = list(log.scans())
    assert [block.topic for block in blocks] == [f"/robot{topic}/scan" for topic in range(5000)]
    assert all(block.stamp_ns.tolist() == [500_000_000, 1_500_000_000, 2_500_000_000] for block in blocks)
    assert all((block.angle_min == -0.5).all() and (block.range_max == 12).all() for block in blocks)


@pytest.mark.whole
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("begin", ["time,", "time,ranges", "angle,range,"])
def test_a_header_of_a_megabyte_is_looked_at_quickly(begin: str, unit: str) -> None:
    """Twice the header takes twice the calls; a look that goes back again and again within one would take hours."""

    def look(size: int) -> None:
        header = begin + unit * (size // len(unit))
        row = ",".join(["1"] * (header.count(",") + 1))
        with suppress(LidarcliError):
            CsvLog(io.BytesIO(f"{header}\n{row}\n{row}\n".encode()), OpenOptions(fov=1.0))

    look(SIZE)
    assert calls(lambda: look(SIZE // 50)) < 2.1 * calls(lambda: look(SIZE // 100))
