"""Tables of `track`, `background` and `diff`, changed as pandas, other programs and hostile people change them."""

from __future__ import annotations

import io
import json
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tools.fuzz.commands import judge_commands, run
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target

LOG = "run.mcap"
BACKGROUND = "empty.background.parquet"
TRACKS = "run.tracks.parquet"
DIFFERENCE = "run.changes.parquet"
NAMES = ("run.objects.parquet", "run.sweeps.parquet", TRACKS, "run.beams.parquet", BACKGROUND, DIFFERENCE)
FORMATS = ("text", "markdown", "html", "json", "junit", "github")

SCENE = """
[scene]
name = "run"
sweeps = 20
[sensor]
beams = 91
angle_min = -180
angle_max = 180
noise = 0.01
lost = 0.05
[robot]
waypoints = [[0, 0], [1.5, 0]]
speed = 0.3
[robot.odometry]
[[wall]]
points = [[-2, -2], [3, -2], [3, 2], [-2, 2]]
closed = true
[[box]]
x = 1.6
y = 0.8
length = 0.6
width = 0.4
[[cylinder]]
x = -1.2
y = -0.6
radius = 0.25
velocity = [0.8, 0.0]
"""
LATER = f"{SCENE}[[box]]\nx = 0.0\ny = -1.2\nlength = 0.5\nwidth = 0.3\n"
"""Something that stands and something that moves, seen by a sensor that drives: all tables have rows, and poses."""

Change = Callable[[pa.Table, Random], pa.Table]


@cache
def tables() -> dict[str, bytes]:
    """Sound tables, by name, and the log that they are made of."""
    with tempfile.TemporaryDirectory() as folder:
        path, scene = str(Path(folder) / LOG), Path(folder) / "scene.toml"
        scene.write_text(SCENE, encoding="utf-8")
        after, later = str(Path(folder) / "later.mcap"), Path(folder) / "later.toml"
        later.write_text(LATER, encoding="utf-8")
        background = str(Path(folder) / BACKGROUND)
        for command in (
            ["simulate", str(scene), "-o", path],
            ["track", path, "-o", folder, "--beams"],
            ["background", "build", path, "-o", background],
            ["simulate", str(later), "-o", after],
            ["diff", path, after, "-o", str(Path(folder) / DIFFERENCE)],
        ):
            if (ran := run(["-q", *command])).code:
                raise RuntimeError(ran.err)
        return {name: (Path(folder) / name).read_bytes() for name in (LOG, *NAMES)}


def put(place: Place, changed: str = "", data: bytes = b"") -> None:
    """The tables, one of them changed, and below base/ as they were."""
    for folder in (place.input, place.input / "base"):
        folder.mkdir(exist_ok=True)
        for name, content in tables().items():
            (folder / name).write_bytes(data if name == changed and folder == place.input else content)


def write(place: Place, number: int, random: Random) -> None:
    """A table with one to three changes, and a command or two that read it."""
    if number < len(KNOWN):
        name, changes = KNOWN[number]
        data = _changed(tables()[name], changes, random)
        commands = _reading(name, ("html", "junit"))
    else:
        name = NAMES[int(random.integers(len(NAMES)))]
        data = mutated_table(name, random)
        choice = _reading(name, (FORMATS[int(random.integers(len(FORMATS)))],))
        commands = [choice[int(random.integers(len(choice)))]]
    put(place, name, data)
    place.note(commands=commands, table=name)


def mutated_table(name: str, random: Random, data: bytes = b"") -> bytes:
    """A table with one to three changes, now and then of its bytes, too; `data` where it is none of `tables`."""
    many = int(random.choice([1, 1, 2, 3]))
    changes = [CHANGES[int(random.integers(len(CHANGES)))] for _ in range(many)]
    data = _changed(data or tables()[name], changes, random)
    return data if random.integers(4) else mutate(data, random)


def _reading(name: str, formats: tuple[str, ...]) -> list[list[str]]:
    """Commands that read the table."""
    if name == BACKGROUND:
        return [
            ["info", f"in/{name}", "--format", "json"],
            ["info", f"in/{name}"],
            ["detect", f"in/{LOG}", "-o", "out", "--removed", "--background", f"in/{name}", "--overwrite"],
        ]
    if name == DIFFERENCE:
        alone = [["report", f"in/{name}", "--format", form, "--check", "new <= 9"] for form in formats]
        return [*alone, ["report", f"in/{name}", "in/run.objects.parquet", "--format", formats[0]]]
    reports = [["report", "in/run.objects.parquet", "--format", form] for form in formats]
    baseline = ["report", "in/run.objects.parquet", "--baseline", "in/base", "--format", formats[0]]
    against = ["report", "in/base/run.objects.parquet", "--baseline", "in/run.objects.parquet"]
    whole = [*reports, baseline, [*against, "--format", formats[-1]]]
    if name == TRACKS:
        whole.append(["report", f"in/{name}", "--format", formats[0]])
    if "beams" not in name:
        whole.append(["plot", f"in/{LOG}", "--sweep", "1", "--tracks", f"in/{TRACKS}", "-o", "out/sweep.png"])
    return whole


def _changed(data: bytes, changes: list[Change], random: Random) -> bytes:
    table = pq.read_table(io.BytesIO(data))
    for change in changes:
        # A change that this table does not allow is left out: so is every further one of a table without columns.
        try:
            table = change(table, random)
        except (pa.ArrowException, IndexError, ValueError, TypeError, KeyError, OverflowError):
            continue
    out = io.BytesIO()
    try:
        pq.write_table(table, out)
    except pa.ArrowException:
        return data[: len(data) // 2]
    return out.getvalue()


def _column(table: pa.Table, random: Random) -> int:
    return int(random.integers(table.num_columns))


def _drop(table: pa.Table, random: Random) -> pa.Table:
    return table.remove_column(_column(table, random))


def _double(table: pa.Table, random: Random) -> pa.Table:
    place = _column(table, random)
    return table.append_column(table.schema.field(place), table.column(place))


def _rename(table: pa.Table, random: Random) -> pa.Table:
    names = list(table.column_names)
    names[_column(table, random)] = str(random.choice(["", "x", names[0], "\x1b[31m", "sweep", "é" * 300]))
    return table.rename_columns(names)


def _replace(table: pa.Table, place: int, column: Any) -> pa.Table:
    """Another column in its place, under its name and with what the field says."""
    field = table.schema.field(place)
    return table.set_column(place, pa.field(field.name, column.type, metadata=field.metadata), column)


_TYPES = (
    *(pa.string(), pa.large_string(), pa.binary(), pa.float32(), pa.float64(), pa.int8(), pa.int64()),
    *(pa.uint64(), pa.bool_(), pa.null(), pa.timestamp("s"), pa.date32(), pa.decimal128(30, 4)),
    *(pa.list_(pa.float64()), pa.dictionary(pa.int8(), pa.string()), pa.dictionary(pa.int32(), pa.int64())),
)


def _retype(table: pa.Table, random: Random) -> pa.Table:
    place = _column(table, random)
    kind = _TYPES[int(random.integers(len(_TYPES)))]
    try:
        column = table.column(place).cast(kind, safe=False)
    except pa.ArrowException:
        column = pa.nulls(table.num_rows, kind)
    return _replace(table, place, column)


def _null(table: pa.Table, random: Random) -> pa.Table:
    place = _column(table, random)
    return _nulled(table, place, random)


def _nulled(table: pa.Table, place: int, random: Random) -> pa.Table:
    keep = random.random(table.num_rows) < random.choice([0.0, 0.5, 0.9])
    rows = pa.array(np.where(keep, np.arange(table.num_rows), 0), mask=~keep)
    return _replace(table, place, table.column(place).combine_chunks().take(rows))


_EXTREMES = (0, -1, 1, 127, 2**31 - 1, -(2**31), 2**40, 2**62, 2**63 - 1, -(2**63))
_ODD_FLOATS = (np.inf, -np.inf, np.nan, 1e308, -1e308, 1e-320, -0.0, 1e30)


def _extreme(table: pa.Table, random: Random) -> pa.Table:
    """Numbers at the ends of what their type can hold, in one row or in all."""
    numbers = [
        place
        for place, field in enumerate(table.schema)
        if pa.types.is_integer(field.type) or pa.types.is_floating(field.type) or pa.types.is_timestamp(field.type)
    ]
    place = numbers[int(random.integers(len(numbers)))]
    kind = table.schema.field(place).type
    if pa.types.is_floating(kind):
        odd: Any = float(_ODD_FLOATS[int(random.integers(len(_ODD_FLOATS)))])
    else:
        odd = _EXTREMES[int(random.integers(len(_EXTREMES)))]
        if pa.types.is_integer(kind) and kind.bit_width < 64:
            odd = max(-(2**31), min(2**31 - 1, odd))
    values = (
        table.column(place).cast(pa.int64()).to_pylist()
        if pa.types.is_timestamp(kind)
        else (table.column(place).to_pylist())
    )
    for row in range(len(values)):
        if not random.integers(3):
            values[row] = odd
    column = pa.array(values, pa.int64()).cast(kind) if pa.types.is_timestamp(kind) else pa.array(values, kind)
    return _replace(table, place, column)


_WORDS = ("", "\x01", "\x1b[31mred", "<script>", "]]>", "a" * 5000, "\u202e", "line\nline", "'", '"', "O", "round")


def _words(table: pa.Table, random: Random) -> pa.Table:
    texts = [place for place, field in enumerate(table.schema) if pa.types.is_dictionary(field.type)]
    place = texts[int(random.integers(len(texts)))]
    word = _WORDS[int(random.integers(len(_WORDS)))]
    values = [word if not random.integers(2) else value for value in table.column(place).to_pylist()]
    return _replace(table, place, pa.array(values, pa.string()).dictionary_encode())


def _reorder(table: pa.Table, random: Random) -> pa.Table:
    return table.select(random.permutation(table.num_columns).tolist())


def _shuffle(table: pa.Table, random: Random) -> pa.Table:
    return table.take(random.permutation(table.num_rows))


def _some_rows(table: pa.Table, random: Random) -> pa.Table:
    return table.slice(0, int(random.choice([0, 1, 2])))


def _twice(table: pa.Table, random: Random) -> pa.Table:
    return pa.concat_tables([table, table])


def _by_pandas(table: pa.Table, random: Random) -> pa.Table:
    """Through a data frame and back, as people do."""
    frame = table.to_pandas()
    text = "topic" if "topic" in frame else "log_b"
    frame[text] = frame[text].astype(str)
    return pa.Table.from_pandas(frame)


_ODD_JSON: tuple[Any, ...] = (
    *(None, True, 0, -1, 1e308, 10**400, "", "\x1b[31m", [], {}, [[]], [{}], {"a": {}}, "x" * 5000),
    *([1, 2, 3], {"topic": 1}, [None]),
)


def _metadata(table: pa.Table, random: Random) -> pa.Table:
    """Something else where a value of the metadata's JSON stands, or no JSON at all."""
    given = dict(table.schema.metadata or {})
    keys = sorted(given)
    key = keys[int(random.integers(len(keys)))]
    kind = int(random.integers(6))
    if kind == 0:
        del given[key]
    elif kind == 1:
        given[key] = mutate(given[key], random)
    elif kind == 2:
        given[key] = b"[" * 50_000
    else:
        odd = _ODD_JSON[int(random.integers(len(_ODD_JSON)))]
        try:
            value = json.loads(given[key])
        except (ValueError, RecursionError):
            # An earlier change has been here.
            value = None
        inner = value[0] if isinstance(value, list) and value else value
        if kind == 3 or not isinstance(inner, dict) or not inner:
            value = odd
        else:
            inner[sorted(inner)[int(random.integers(len(inner)))]] = odd
        given[key] = json.dumps(value).encode()
    return table.replace_schema_metadata(given)


def _no_metadata(table: pa.Table, random: Random) -> pa.Table:
    return table.replace_schema_metadata(None)


CHANGES: tuple[Change, ...] = (
    *(_drop, _double, _rename, _retype, _retype, _retype, _null, _null, _extreme, _extreme, _extreme),
    *(_words, _reorder, _shuffle, _some_rows, _twice, _by_pandas),
    *(_metadata, _metadata, _metadata, _no_metadata),
)


def _cast(name: str, kind: Any) -> Change:
    """One column as another type; what cannot be cast is null."""

    def change(table: pa.Table, random: Random) -> pa.Table:
        place = table.schema.get_field_index(name)
        try:
            column = table.column(place).cast(kind, safe=False)
        except pa.ArrowException:
            column = pa.nulls(table.num_rows, kind)
        return _replace(table, place, column)

    return change


def _set(name: str, value: Any) -> Change:
    def change(table: pa.Table, random: Random) -> pa.Table:
        place = table.schema.get_field_index(name)
        return _replace(table, place, pa.array([value] * table.num_rows, table.schema.field(place).type))

    return change


def _doubled(name: str) -> Change:
    return lambda table, random: table.append_column(table.schema.field(name), table.column(name))


def _geometry(value: Any) -> Change:
    return lambda table, random: table.replace_schema_metadata(
        {**table.schema.metadata, b"lidarcli.geometry": json.dumps(value).encode()}
    )


KNOWN: list[tuple[str, list[Change]]] = [
    ("run.sweeps.parquet", [_by_pandas]),
    ("run.objects.parquet", [_by_pandas]),
    ("run.sweeps.parquet", [_cast("sweep", pa.string())]),
    ("run.objects.parquet", [_cast("width", pa.string())]),
    ("run.objects.parquet", [_cast("shape", pa.int64())]),
    ("run.sweeps.parquet", [_set("sweep", None)]),
    ("run.sweeps.parquet", [_set("objects", None)]),
    ("run.sweeps.parquet", [_set("sweep", 2**63 - 1)]),
    ("run.sweeps.parquet", [_set("noise", np.inf)]),
    ("run.objects.parquet", [_set("r_min", np.inf)]),
    ("run.objects.parquet", [_set("r_min", 1e308)]),
    ("run.sweeps.parquet", [_doubled("topic")]),
    ("run.objects.parquet", [_doubled("sweep")]),
    ("run.beams.parquet", [_cast("status", pa.string())]),
    (TRACKS, [_by_pandas]),
    (TRACKS, [_cast("track", pa.string())]),
    (TRACKS, [_set("track", None)]),
    (TRACKS, [_set("track", 2**63 - 1)]),
    (TRACKS, [_set("duration", np.inf)]),
    (TRACKS, [_set("x", 1e308)]),
    (TRACKS, [_doubled("track")]),
    ("run.objects.parquet", [_set("track", 2**63 - 1)]),
    ("run.objects.parquet", [_set("vx", 1e308)]),
    ("run.objects.parquet", [_cast("moving", pa.string())]),
    (DIFFERENCE, [_by_pandas]),
    (DIFFERENCE, [_cast("status", pa.int64())]),
    (DIFFERENCE, [_set("log_b", None)]),
    (DIFFERENCE, [_set("x_b", 1e308)]),
    ("empty.background.parquet", [_geometry({"a": 1})]),
    ("empty.background.parquet", [_geometry([1, 2])]),
    ("empty.background.parquet", [_geometry([{"topic": None}])]),
    ("empty.background.parquet", [_cast("topic", pa.string())]),
    ("empty.background.parquet", [_set("r_e", 1e308)]),
    ("empty.background.parquet", [_set("station", -1)]),
]


_COMPARED = (
    *("delta.objects == 0", "delta.sweeps >= 0", "added_sweeps == 0", "removed_sweeps == 0", "delta.width.mean < 1"),
    *("delta.objects_per_sweep.p95 between -1 and 1", "objects where change == 'appeared' == 0", "delta.gaps is null"),
)
_RUNS = ("run.objects.parquet", "run.sweeps.parquet", TRACKS, DIFFERENCE)


def _write_compared(place: Place, number: int, random: Random) -> None:
    """Two runs, of which one has a changed table, or both the same one; each as it is first."""
    name = _RUNS[number % len(_RUNS)]
    put(place)
    if number >= len(_RUNS):
        name = NAMES[int(random.integers(len(NAMES)))]
        data = mutated_table(name, random)
        which = int(random.integers(3))
        for folder in (place.input, place.input / "base")[which % 2 : 1 + (which > 0)]:
            (folder / name).write_bytes(data)
    run_of = name if name in _RUNS else _RUNS[int(random.integers(len(_RUNS)))]
    baseline = "in/base" if random.integers(2) else f"in/base/{_RUNS[int(random.integers(len(_RUNS)))]}"
    checks = [_COMPARED[int(random.integers(len(_COMPARED)))] for _ in range(int(random.integers(3)))]
    told = [part for check in checks for part in ("--check", check)]
    form = FORMATS[int(random.integers(len(FORMATS)))]
    place.note(commands=[["report", f"in/{run_of}", "--baseline", baseline, "--format", form, *told]])


def _write_names(place: Place, number: int, random: Random) -> None:
    """Sound tables whose file names no terminal and no UTF-8 can take."""
    name = _ODD_NAMES[number % len(_ODD_NAMES)]
    for table in NAMES[:2]:
        path = os.fsencode(place.input) + b"/" + name + table.removeprefix("run").encode()
        Path(os.fsdecode(path)).write_bytes(tables()[table])
    form = FORMATS[number // len(_ODD_NAMES) % len(FORMATS)]
    suffix = {"markdown": "md", "html": "html", "json": "json", "junit": "xml"}.get(form, "txt")
    place.note(commands=[["report", "in", "--format", form], ["report", "in", "-o", f"out/r.{suffix}"]])


_ODD_NAMES = (b"bad\xff", b"red\x1b[31m", b"two\nlines", b"<b>&'\"", "\u202eabc".encode(), b"-o", b"a" * 200)


def table_targets() -> list[Target]:
    """Changed contents, also of two runs that are compared, and odd names."""
    return [
        Target("tables", write, judge_commands, weight=15, known=len(KNOWN)),
        Target("baseline", _write_compared, judge_commands, weight=15, known=len(_RUNS)),
        Target("table-names", _write_names, judge_commands, weight=4, known=len(_ODD_NAMES) * len(FORMATS)),
    ]
