"""`diff` of logs, tables, backgrounds and maps in any mixture, one of them changed or made to harm."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from tools.fuzz.commands import judge_commands
from tools.fuzz.maps import map_of
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.tables import BACKGROUND, LOG, TRACKS, mutated_table, tables
from tools.fuzz.target import Random, Target

SOUND = (LOG, TRACKS, BACKGROUND, "map.yaml")
"""What is compared, each with each."""
FREE, BLACK, GREY = 254, 0, 205


def _yaml(image: str, resolution: str = "0.05", origin: str = "-3.0, -3.0") -> bytes:
    return (
        f"image: {image}\nresolution: {resolution}\norigin: [{origin}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    ).encode()


def _packed(pixels: np.ndarray[Any, Any], form: str = "PNG", mode: str = "L") -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels).convert(mode).save(out, form)
    return out.getvalue()


@cache
def room() -> bytes:
    """The image of a map of the room in which the log was taken."""
    pixels = np.full((120, 140), GREY, np.uint8)
    pixels[20:100, 20:120] = FREE
    pixels[20:22, 20:120] = pixels[98:100, 20:120] = pixels[20:100, 20:22] = pixels[20:100, 118:120] = BLACK
    return _packed(pixels)


def _even(side: int, shade: int) -> Callable[[], bytes]:
    return lambda: _packed(np.full((side, side), shade, np.uint8))


def _pattern(side: int, across: int, up: int, length: int = 1) -> Callable[[], bytes]:
    """Bars of some cells in free ground."""

    def make() -> bytes:
        pixels = np.full((side, side), FREE, np.uint8)
        for at in range(length):
            pixels[::up, at::across] = BLACK
        return _packed(pixels)

    return make


def _strip(width: int, height: int) -> Callable[[], bytes]:
    return lambda: _packed(np.full((height, width), FREE, np.uint8))


BOMBS: tuple[Callable[[], bytes], ...] = (
    room,
    *(_even(side, shade) for side in (3_000, 6_000, 12_000) for shade in (BLACK, FREE, GREY)),
    *(_pattern(3_000, across, up) for across, up in ((2, 2), (10, 10), (3, 3))),
    *(_pattern(3_000, 10, 4, 7), _pattern(1_000, 10, 4, 7), _pattern(5_000, 40, 40, 20)),
    *(_strip(30_000_000, 1), _strip(1, 30_000_000), _strip(60_000, 600)),
    lambda: _packed(np.full((5_000, 5_000), BLACK, np.uint8), mode="RGBA"),
    lambda: _packed(np.full((5_000, 5_000), 0, np.uint16), mode="I;16"),
    lambda: _packed(np.full((6_000, 6_000), BLACK, np.uint8), mode="1"),
)
"""Images of few bytes and many cells."""
RESOLUTIONS = ("0.01", "0.001", "1.0", "50", "1e-300", "1e300", "1e6", "nan")
ORIGINS = ("1e300, 0", "1e6, -1e6", "-1e15, 0", "999999, 999999", "nan, 0")
_MANY = (300, 3_000, 20_000)


def _spread(rows: int) -> bytes:
    """Standing things all over the place, in a table of so many rows."""
    table = pq.read_table(io.BytesIO(tables()[TRACKS]))
    stands = [one == "O" for one in table["set"].to_pylist()].index(True)
    many = table.take(pa.array([stands] * rows))
    side = int(np.ceil(np.sqrt(rows)))
    index = np.arange(rows)
    for name, values in (
        ("track", index + 1),
        ("x", 0.6 * (index % side)),
        ("y", 0.6 * (index // side)),
        ("sweeps", np.full(rows, 20)),
        ("duration", np.full(rows, 2.5)),
    ):
        at = many.schema.get_field_index(name)
        many = many.set_column(at, many.schema.field(at), pa.array(values).cast(many.schema.field(at).type))
    out = io.BytesIO()
    pq.write_table(many, out)
    return out.getvalue()


def _cases() -> list[tuple[str, str, dict[str, Callable[[], bytes]]]]:
    """First and second run, and the files that are not sound."""
    pairs: list[tuple[str, str, dict[str, Callable[[], bytes]]]] = [
        (first, second, {}) for first in SOUND for second in SOUND
    ]
    pairs += [(first, "map.yaml", {"room.png": bomb}) for first in ("other.yaml", LOG) for bomb in BOMBS]
    pairs += [("map.yaml", "map.yaml", {"room.png": bomb}) for bomb in BOMBS]
    pairs += [
        ("other.yaml", "map.yaml", {"map.yaml": lambda text=text: text})  # type: ignore[misc]
        for text in (
            *(_yaml("room.png", resolution=one) for one in RESOLUTIONS),
            *(_yaml("room.png", origin=one) for one in ORIGINS),
        )
    ]
    pairs += [
        (first, TRACKS, {TRACKS: lambda rows=rows: _spread(rows)})  # type: ignore[misc]
        for rows in _MANY
        for first in (TRACKS, LOG)
    ]
    return pairs


KNOWN = _cases()


def write(place: Place, number: int, random: Random) -> None:
    """Two or three runs, of which one is changed."""
    files = {name: tables()[name] for name in (LOG, TRACKS, BACKGROUND)}
    files |= {"map.yaml": _yaml("room.png"), "other.yaml": _yaml("other.png")}
    files |= {"room.png": room(), "other.png": room()}
    if number < len(KNOWN):
        first, second, odd = KNOWN[number]
        files |= {name: make() for name, make in odd.items()}
        runs = [first, second]
    else:
        runs = [SOUND[int(random.integers(len(SOUND)))] for _ in range(2 if random.integers(8) else 3)]
        name = runs[int(random.integers(len(runs)))]
        if name == "map.yaml":
            files["map.yaml"], files["map.pgm"] = map_of(number, random)
        elif name == LOG:
            files[LOG] = mutate(files[LOG], random)
        else:
            files[name] = mutated_table(name, random)
    for name in sorted({*runs, *(each for each in files if each.startswith(("room", "other", "map")))}):
        (place.input / name).write_bytes(files[name])
    align = ("auto", "as-is", "search")[number % 3]
    command = ["-q", "diff", *(f"in/{name}" for name in runs), "--align", align, "--overwrite"]
    output = ("changes.parquet", "changes.csv", "changes.png")[0 if number % 32 else number // 32 % 3]
    place.note(commands=[[*command, "-o", f"out/{output}", "--format", "json", "--check", "gone == 0"]])


def diff_targets() -> list[Target]:
    """Runs that are compared."""
    return [Target("diff", write, judge_commands, weight=60, known=len(KNOWN))]
