"""Maps of map_server and trajectories: mutated ones, and those made to harm."""

from __future__ import annotations

import io
import math
import struct
import tempfile
import traceback
import zlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from lidarcli.errors import UnreadableError
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy, UnlikeError, compare
from lidarcli.maps.grids import pgm_bytes, read_map, yaml_bytes
from lidarcli.pose.tracks import read_trajectory, trajectory_lines
from tools.fuzz.commands import judge_commands, run
from tools.fuzz.logs import LONGEST, odd_lines
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, tables
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

_MAP = "map.yaml"
_PATH = "run.tum"


@cache
def _grid() -> Occupancy:
    """A room with walls, seen from within."""
    cells = np.full((60, 80), UNKNOWN, np.int8)
    cells[5:55, 5:75] = FREE
    cells[5, 5:75] = cells[54, 5:75] = cells[5:55, 5] = cells[5:55, 74] = OCCUPIED
    return Occupancy(0.05, -2.0, -1.5, cells)


def _image(form: str, mode: str = "L") -> bytes:
    """The same map as another kind of image."""
    out = io.BytesIO()
    pixels = np.choose(_grid().cells[::-1].clip(-1, 1) + 1, [205, 254, 0]).astype(np.uint8)
    Image.fromarray(pixels).convert(mode).save(out, form)
    return out.getvalue()


@cache
def _images() -> tuple[bytes, ...]:
    plain = b"P2\n4 2\n255\n0 254 205 0\n254 254 0 0\n"
    deep = b"P5\n4 2\n65535\n" + struct.pack(">8H", 0, 65535, 52685, 0, 9, 99, 999, 9999)
    forms = (("PNG", "L"), ("PNG", "1"), ("PNG", "RGBA"), ("PNG", "P"), ("PNG", "LA"), ("BMP", "RGB"), ("BMP", "1"))
    return (pgm_bytes(_grid()), plain, deep, *(_image(*form) for form in forms))


def _chunk(kind: bytes, data: bytes) -> bytes:
    """A part of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png(width: int, height: int, data: bytes) -> bytes:
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + _chunk(b"IDAT", zlib.compress(data)) + _chunk(b"IEND", b"")


_YAML = yaml_bytes(_grid(), "map.pgm").decode()


def _with(line: str) -> str:
    """The YAML file with the line of a key changed."""
    key = line.partition(":")[0]
    return "".join(f"{line}\n" if it.startswith(f"{key}:") else it for it in _YAML.splitlines(keepends=True))


_MERGES = "a0: &a0 {x: 1}\n" + "".join(f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}], y{k}: 1}}\n" for k in range(1, 40))
_KNOWN_MAPS: tuple[tuple[str, bytes], ...] = (
    *((_YAML, image) for image in _images()),
    *(
        (_with(line), pgm_bytes(_grid()))
        for line in (
            *(f"resolution: {value}" for value in ("1e-320", "1e308", "nan", ".inf", "0", "-1", "0x10", "9" * 5000)),
            *(f"origin: [{value}, 0, 0]" for value in ("1e308", "-1e308", "nan", "[1]", "''", "1e400")),
            *("origin: [0, 0, 1]", "origin: [0, 0]", "origin: 0", "negate: 2", "negate: []", "mode: raw", "mode: \x1b"),
            *(f"image: {value}" for value in ("..", ".", "/dev/zero", "/dev/stdin", "../victims/pipe", "map.yaml", "''")),
            *("image: '\\0'", "image: " + "a" * 5000, "image: ../victims/thesis", "occupied_thresh: 1e308"),
        )
    ),
    (_MERGES + _YAML, pgm_bytes(_grid())),
    ("[" * 60_000, b""),
    ("a: " * 20_000, b""),
    ("- " * 30_000, b""),
    ("&a [*a]", b""),
    ("\ufeff" + _YAML, pgm_bytes(_grid())),
    (_YAML, b"P5\n0 0\n255\n"),
    (_YAML, b"P5\n100000 100000\n255\n"),
    (_YAML, b"P5\n20000 20000\n255\n"),
    (_YAML, b"P5\n20000 20000\n1\n"),
    (_YAML, b"P2\n20000 20000\n255\n" + b"0 " * 99),
    (_YAML, b"P4\n20000 20000\n"),
    (_YAML, b"P5\n2 2\n99999999999999999999\n"),
    (_YAML, b"P5\n" + b"#" * 200_000),
    (_YAML, b"P5 " + b"9" * 100_000),
    (_YAML, _png(20_000, 20_000, bytes(9))),
    (_YAML, _png(60_000, 60_000, bytes(999_999))),
)


def map_of(number: int, random: Random) -> tuple[bytes, bytes]:
    """YAML and image of a map made to harm, or of a sound one with words or bytes changed."""
    if number < len(_KNOWN_MAPS):
        text, image = _KNOWN_MAPS[number]
    else:
        images = _images()
        text, image = _YAML, images[int(random.integers(len(images)))]
        if random.integers(3):
            text = mutate_words(text, random)
        if random.integers(2):
            image = mutate(image, random)
    data = text.encode("utf-8", "surrogateescape")
    if number >= len(_KNOWN_MAPS) and not random.integers(4):
        data = mutate(data, random)
    return data, image


def write_map(place: Place, number: int, random: Random) -> None:
    """A map, and a command that reads it now and then."""
    data, image = map_of(number, random)
    (place.input / _MAP).write_bytes(data)
    (place.input / "map.pgm").write_bytes(image)
    if not number % 50:
        (place.input / LOG).write_bytes(tables()[LOG])
    place.note(commands=[["-q", "diff", f"in/{_MAP}", f"in/{LOG}", "--format", "json"]] if not number % 50 else [])


def judge_map(place: Place) -> Iterator[str]:
    """What `read_map` says, and a command now and then."""
    path = place.input / _MAP
    try:
        grid = read_map(path)
    except UnreadableError as err:
        yield from odd_lines("read_map", [_told(err, path)], 2 * LONGEST)
    except Exception:
        yield f"read_map: {traceback.format_exc()}"
    else:
        yield from _sound(grid, place.scratch)
    yield from judge_commands(place)


def _told(err: Exception, path: Path) -> str:
    """A message as a terminal gets it, without the place of the case."""
    return "".join(one if one.isprintable() or one == "\n" else "?" for one in str(err).replace(str(path), ""))


def _sound(grid: Occupancy, folder: Path) -> Iterator[str]:
    """A map that was read can be used, and written again."""
    if not all(map(math.isfinite, (grid.resolution, grid.x, grid.y))) or grid.resolution <= 0:
        yield f"read_map: {grid.resolution} m at {grid.x}, {grid.y}"
    if grid.cells.dtype != np.int8 or not np.isin(grid.cells, (UNKNOWN, FREE, OCCUPIED)).all():
        yield f"read_map: cells of {grid.cells.dtype}: {np.unique(grid.cells)[:9]}"
    try:
        found = compare(grid, grid)
        if found.cells and (found.precision, found.recall) != (1.0, 1.0):
            yield f"compare: {found} with itself"
    except UnlikeError as err:
        yield f"compare: {err}"
    if grid.cells.size > 1_000_000:
        return
    (folder / _MAP).write_bytes(yaml_bytes(grid, "map.pgm"))
    (folder / "map.pgm").write_bytes(pgm_bytes(grid))
    try:
        again = read_map(folder / _MAP)
        if not np.array_equal(again.cells, grid.cells) or not math.isclose(again.resolution, grid.resolution):
            yield "read_map: what it has read is another map when it is written and read again"
    except UnreadableError as err:
        yield f"read_map: what it has read cannot be read again when it is written: {err}"
    finally:
        (folder / _MAP).unlink()
        (folder / "map.pgm").unlink()


_LINES = [f"{1_700_000_000 + 0.1 * k:.9f} {0.03 * k:.6f} 0.1 0 0 0 0.1 0.995" for k in range(-5, 60)]
_PLAIN = "# timestamp x y z qx qy qz qw\n" + "\n".join(_LINES) + "\n"
_HERE = "0 0 0 0 0 0 1"


def _moved(place: str) -> str:
    """The path with every second pose elsewhere."""
    return "".join(
        f"{1_700_000_000 + 0.1 * k:.9f} {place if k % 2 else f'{0.03 * k:.3f} 0'} 0 0 0 0 1\n" for k in range(-5, 60)
    )


_KNOWN_PATHS: tuple[str, ...] = (
    _PLAIN,
    "",
    "\0" * 100_000,
    "1 " * 400_000,
    "#" * 900_000,
    "# " + "x" * 998 + f"7 {_HERE}\n" + _PLAIN,
    f"1e999999 {_HERE}\n",
    f"-1e999999999 {_HERE}\n",
    f"1e999980 {_HERE}\n",
    f"1e-999999999 {_HERE}\n",
    f"nan {_HERE}\n",
    f"sNaN {_HERE}\n",
    f"{'9' * 900} {_HERE}\n",
    f"0.{'9' * 900} {_HERE}\n",
    f"-9223372036.8 {_HERE}\n9223372036.8 1 0 0 0 0 0 1\n",
    f"9223372036.854775807 {_HERE}\n-9223372036.854775807 1 0 0 0 0 0 1\n",
    *(_moved(place) for place in ("1e9 1e9", "9e11 -9e11", "1e6 0", "1e300 0", "nan 0", "1e-320 0")),
    "\n".join(f"{1_700_000_000 + k} 9e11 -9e11 0 0 0 0 1" for k in range(-2, 9)),
    "\n".join(f"{1_700_000_000 + k} 1 1 9e11 0.5 0.5 0.5 -0.5" for k in range(-2, 9)),
    f"1700000000 {_HERE}\n" * 20_000,
    "\r".join(_LINES),
    "\u2028".join(_LINES),
    "\x1b[31m" + _PLAIN,
    "\ufeff" + _PLAIN.replace(" ", ","),
)


def write_path(place: Place, number: int, random: Random) -> None:
    """A trajectory made to harm, or a sound one with words or bytes changed."""
    if number < len(_KNOWN_PATHS):
        data = _KNOWN_PATHS[number].encode()
    else:
        data = (mutate_words(_PLAIN, random) if random.integers(3) else _PLAIN).encode("utf-8", "surrogateescape")
        if not random.integers(3):
            data = mutate(data, random)
    (place.input / _PATH).write_bytes(data)
    commands = []
    if number < len(_KNOWN_PATHS) or not number % 50:
        (place.input / LOG).write_bytes(tables()[LOG])
        told = [f"in/{LOG}", "--poses", f"in/{_PATH}", "--overwrite", "-o"]
        commands = [["-q", "map", *told, "out/m.yaml", "-o", "out/m.ply"], ["-q", "poses", *told, "out/p.tum"]]
    place.note(commands=commands)


def judge_path(place: Place) -> Iterator[str]:
    """What `read_trajectory` says, and commands that use it."""
    path = place.input / _PATH
    try:
        track, _ = read_trajectory(path)
    except UnreadableError as err:
        yield from odd_lines("read_trajectory", [_told(err, path)])
    except Exception:
        yield f"read_trajectory: {traceback.format_exc()}"
    else:
        if not (track.stamp_ns[1:] > track.stamp_ns[:-1]).all():
            yield "read_trajectory: stamps do not go on"
        if not all(np.isfinite(part).all() for part in track.motion):
            yield "read_trajectory: poses that are not finite"
        if len(trajectory_lines(track.stamp_ns, track.motion).splitlines()) != len(track.stamp_ns):
            yield "read_trajectory: poses are lost"
    yield from judge_commands(place)


@cache
def _site() -> tuple[str, bytes]:
    """YAML and image of a map of the room in which the log was taken."""
    with tempfile.TemporaryDirectory() as folder:
        log, path = Path(folder) / LOG, Path(folder) / _MAP
        log.write_bytes(tables()[LOG])
        if (ran := run(["-q", "map", str(log), "-o", str(path)])).code:
            raise RuntimeError(ran.err)
        return path.read_text(encoding="utf-8"), path.with_suffix(".pgm").read_bytes()


_JUDGED: tuple[tuple[str, ...], ...] = (
    ("-o", "out/p.parquet", "--format", "json", "--check", "lost == 0"),
    ("-o", "out/p.tum", "--relocate", "--check", "off <= 1"),
    ("-o", "out/p.png"),
    ("--format", "json", "--poses", f"in/{_PATH}"),
    ("-o", "out/p.tum", "--poses", f"in/{_PATH}", "--relocate"),
)
"""What is asked of a path that a map judges."""


def write_judged(place: Place, number: int, random: Random) -> None:
    """All as it is, then maps made to harm, then one of map, log and path changed, or two."""
    text, image = _site()
    log, path = tables()[LOG], _PLAIN
    if len(_JUDGED) <= number < len(_JUDGED) + len(_KNOWN_MAPS):
        text, image = _KNOWN_MAPS[number - len(_JUDGED)]
    elif number >= len(_JUDGED):
        for _ in range(int(random.integers(1, 3))):
            kind = int(random.integers(4))
            if kind == 0:
                text = mutate_words(text, random)
            elif kind == 1:
                image = mutate(image, random)
            elif kind == 2:
                log = mutate(log, random)
            else:
                path = mutate_words(path, random)
    for name, data in ((_MAP, text), (_PATH, path)):
        (place.input / name).write_bytes(data.encode("utf-8", "surrogateescape"))
    (place.input / "map.pgm").write_bytes(image)
    (place.input / LOG).write_bytes(log)
    asked = _JUDGED[number % len(_JUDGED)]
    place.note(commands=[["poses", f"in/{LOG}", "--map", f"in/{_MAP}", "--overwrite", *asked]])


def map_targets() -> list[Target]:
    """Maps, trajectories, and paths that a map judges."""
    return [
        Target("maps", write_map, judge_map, weight=60, known=len(_KNOWN_MAPS)),
        Target("trajectories", write_path, judge_path, weight=60, known=len(_KNOWN_PATHS)),
        Target("poses-map", write_judged, judge_commands, weight=30, known=len(_JUDGED) + len(_KNOWN_MAPS)),
    ]
