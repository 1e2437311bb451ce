"""Occupancy grids as map_server and Nav2 have them: an image with its YAML file, or a message."""

from __future__ import annotations

import itertools
import json
import math
import re
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import clipped
from lidarcli.errors import UnreadableError
from lidarcli.files.configfiles import read_yaml
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.options.choices import MAP_RESOLUTIONS
from lidarcli.sweeps.types import Int8

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

MAX_PIXELS = 400_000_000
"""Largest image that is read [pixels]: 1 km x 1 km in cells of 5 cm; …"""
MAX_PACKED_PIXELS = 40_000_000
"""… one of fewer bytes than pixels: 300 m x 300 m in cells of 5 cm."""

_PIXELS = np.full(256, 205, np.uint8)
_PIXELS[[FREE, OCCUPIED]] = 254, 0
"""Cell, as an unsigned number → brightness of its pixel. 205 is black enough not to be free, by less than 0.0001."""
FARTHEST = 1e9
"""Greatest number of a file, such as a coordinate of a world whose origin is far away [m]."""
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_MODES = ("trinary", "scale", "raw")
_SIDE = 2048
"""Images are converted in squares of this side [pixels]."""
_SAVE_AGAIN = "save the map again"
MAP_TYPE = "nav_msgs/msg/OccupancyGrid"


def yaml_bytes(grid: Occupancy, image: str) -> bytes:
    """Return the YAML file of a map [m] whose cells are in the file `image`, a name relative to that of the YAML file."""
    name = (
        image if re.fullmatch(r"[A-Za-z][A-Za-z0-9_.-]*\.(?:pgm|png|bmp)", image) else json.dumps(image, ensure_ascii=False)
    )
    x, y = _decimal(grid.x), _decimal(grid.y)
    # The thresholds are shares of black, as map_saver writes them.
    text = (
        f"image: {name}\nmode: trinary\nresolution: {_decimal(grid.resolution)}\norigin: [{x}, {y}, 0.0]\n"
        f"negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    # Names of files need not be UTF-8.
    return text.encode("utf-8", "surrogateescape")


def pgm_bytes(grid: Occupancy) -> bytes:
    """Return the cells as a binary PGM image: 254 free, 0 occupied, 205 unknown, the row of greatest y first."""
    height, width = grid.cells.shape
    head = f"P5\n# CREATOR: lidarcli {_decimal(grid.resolution)} m/pix\n{width} {height}\n255\n"
    return head.encode() + _PIXELS[grid.cells[::-1].view(np.uint8)].tobytes()


def image_of(path: Path) -> Path:
    """Return the image that a YAML file names (`UnreadableError` as of `read_map`)."""
    return path.parent / _described(path).image


def read_map(path: Path) -> Occupancy:
    """Read the map of a YAML file and its image (PGM, PNG or BMP), in metres, by the rules of map_server and Nav2.

    A pixel is as occupied as the mean of its channels is dark (in mode `trinary` opacity is one of them); with `negate`,
    as it is bright. From `occupied_thresh` on a cell is occupied, up to `free_thresh` it is free; at the very threshold
    Nav2 and ROS 1 differ, and this is Nav2's rule. The rest is unknown. So it is in mode `scale`, which has shades of
    likelihood there, and where anything is transparent as well. In mode `raw` a pixel of 0 to 100 is the likelihood of
    its cell in per cent, to which the same thresholds apply, and any other is unknown; `negate` means nothing then.
    An image that has 205 in addition to 0 and 254 alone is one of map_saver, which writes 205 for unknown: it is, whatever
    `free_thresh` says (Nav2's default of 0.25 would make it free), with a note.

    Raises
    ------
    UnreadableError
        The YAML file or its image is missing, damaged, too large, incomplete or says something impossible; or the map
        is turned (a yaw in its origin), which hardly any program supports.
    """
    described = _described(path)
    cells, is_saved = _cells(path, described)
    note = f"{path}: 205 is unknown, as map_saver writes it; by its free_thresh of {described.free:g} it would be free"
    return Occupancy(described.resolution, described.x, described.y, cells, note=note if is_saved else "")


@dataclass(frozen=True)
class _Described:
    """Content of a YAML file; lengths in metres."""

    image: str
    mode: str
    resolution: float
    x: float
    y: float
    negate: bool
    occupied: float
    free: float


def _described(path: Path) -> _Described:
    """Read the YAML file, each value of the right kind."""
    values = read_yaml(str(path), "map")
    missing = [key for key in _KEYS if key not in values]
    if missing:
        raise _refused(path, f"no {', '.join(missing)}, hence no map of map_server", "add what is missing")
    resolution = _number(path, "resolution", values["resolution"], *MAP_RESOLUTIONS)
    origin = values["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise _refused(path, "origin is not [x, y, yaw]", _SAVE_AGAIN)
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    # What is less is rounding: 1 mm at 1 km.
    if abs(yaw) > 1e-6:
        turned = f"origin has a yaw of {yaw:g} rad, and maps that are turned are not supported"
        raise _refused(path, turned, "turn the image and set the yaw to 0")
    negate = values["negate"]
    if negate not in (0, 1):
        raise _refused(path, f"negate is {_shown(negate)}", "set it to 0 or 1")
    mode = _text(path, "mode", values.get("mode", _MODES[0])).lower()
    if mode not in _MODES:
        raise _refused(path, f"mode is {_shown(mode)}", f"use {', '.join(_MODES[:-1])} or {_MODES[-1]}")
    return _Described(
        _text(path, "image", values["image"]),
        mode,
        resolution,
        x,
        y,
        bool(negate),
        *(_number(path, key, values[key]) for key in ("occupied_thresh", "free_thresh")),
    )


def _number(path: Path, key: str, value: object, least: float = -FARTHEST, most: float = FARTHEST) -> float:
    number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    if not least <= number <= most:
        way_out = "write 0 there" if key == "origin" and not math.isfinite(number) else _SAVE_AGAIN
        raise _refused(path, f"{key} is {_shown(value)}, not a number from {least:g} to {most:g}", way_out)
    return number


def _text(path: Path, key: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise _refused(path, f"{key} is {_shown(value)}", _SAVE_AGAIN)
    return value


def _cells(path: Path, described: _Described) -> tuple[Int8, bool]:
    """Return the cells of the image, row 0 with the least y; and True where 205 is unknown against the thresholds."""
    named = path.parent / described.image
    shown = f"image {_shown(described.image)}"
    beside = path.parent / re.split(r"[\\/]", described.image)[-1]
    try:
        # A map that was copied names a folder of the machine where it was saved.
        named = beside if not named.exists() and beside.is_file() else named
        # Nothing that is no file is opened: a pipe would never end.
        found = named.stat()
        if not S_ISREG(found.st_mode):
            raise _refused(path, f"{shown} is not a file", "name the image of the map there")
        with named.open("rb") as file, warnings.catch_warnings():
            # Pillow warns of large images, which have their own bound here, and of what it could put right.
            warnings.simplefilter("ignore")
            return _decoded(path, shown, file, found.st_size, described)
    except UnreadableError:
        raise
    except (FileNotFoundError, NotADirectoryError) as err:
        raise _refused(path, f"{shown} is missing", "put it beside the YAML file, or name its place there") from err
    except SyntaxError as err:
        raise _refused(path, f"{shown} cannot be read: it is damaged", _SAVE_AGAIN) from err
    # As for YAML; Pillow raises errors of any kind for damaged images.
    except Exception as err:
        raise _refused(path, f"{shown} cannot be read: {_reason(err)}", _SAVE_AGAIN) from err


def _decoded(path: Path, shown: str, file: BinaryIO, size: int, described: _Described) -> tuple[Int8, bool]:
    image = _opened(path, shown, file)
    width, height = image.size
    most = min(max(size, MAX_PACKED_PIXELS), MAX_PIXELS)
    if width * height > most:
        large = f"{shown} has {width:,} x {height:,} pixels, and no more than {most:,} are read"
        raise _refused(path, large, "cut it, or save the map with larger cells")
    image.load()
    cells = np.empty((height, width), np.int8)
    tables: dict[int, Int8] = {}
    is_saved = False
    if image.mode == "L" and described.mode == "trinary" and not described.negate:
        unknown = int(_PIXELS[UNKNOWN])
        tables[255] = _evaluated(np.arange(256) / 255, described)
        shades = {shade for _, shade in image.getcolors(len({*_PIXELS.tolist()})) or ()}
        is_saved = unknown in shades <= {*_PIXELS.tolist()} and tables[255][unknown] == FREE
        tables[255][unknown] = UNKNOWN if is_saved else tables[255][unknown]
    tops, lefts = range(0, height, _SIDE), range(0, width, _SIDE)
    for rows, columns in itertools.product(*([slice(at, at + _SIDE) for at in begins] for begins in (tops, lefts))):
        part: Any = image.crop((columns.start, rows.start, min(columns.stop, width), min(rows.stop, height)))
        levels, white, opaque = _levels(part, described.mode == "trinary")
        if white not in tables:
            tables[white] = _evaluated(np.arange(white + 1) / white, described)
        cells[::-1][rows, columns] = tables[white][levels]
        if opaque is not None and described.mode == "scale":
            cells[::-1][rows, columns][~opaque] = UNKNOWN
    return cells, is_saved


def _opened(path: Path, shown: str, file: BinaryIO) -> ImageFile:
    """Open the image without reading its pixels; `Image.open` would guess at fifty formats."""
    from PIL.BmpImagePlugin import BmpImageFile
    from PIL.PngImagePlugin import PngImageFile
    from PIL.PpmImagePlugin import PpmImageFile

    start = file.read(8)
    file.seek(0)
    if start[:1] == b"P" and start[1:2] in b"123456" and start[2:3].isspace():
        return PpmImageFile(file)
    if start == b"\x89PNG\r\n\x1a\n":
        return PngImageFile(file)
    if start[:2] == b"BM":
        return BmpImageFile(file)
    raise _refused(path, f"{shown} is no PGM, PNG or BMP image", _SAVE_AGAIN)


def _levels(image: Any, with_alpha: bool) -> tuple[NDArray[Any], int, NDArray[np.bool_] | None]:
    """Return the sum of the channels of each pixel, its greatest value, and a mask of opaque pixels (None: all are)."""
    if image.mode in ("1", "L"):
        return np.asarray(image.convert("L")), 255, None
    if image.mode[0] == "I":
        # 16 bits, however Pillow keeps them.
        return np.clip(np.asarray(image), 0, 65535).astype(np.uint16), 65535, None
    transparent = image.mode in ("LA", "La", "PA", "RGBA", "RGBa") or (image.mode == "P" and "transparency" in image.info)
    channels = np.asarray(image.convert("RGBA" if transparent else "RGB"))
    shown = channels if with_alpha else channels[..., :3]
    levels = shown.sum(axis=2, dtype=np.uint16)
    return levels, 255 * shown.shape[2], channels[..., 3] == 255 if transparent else None


def _evaluated(shade: NDArray[np.float64], described: _Described) -> Int8:
    """Return free, occupied or unknown for pixels of a brightness from 0 to 1."""
    occupied = shade if described.negate else 1 - shade
    if described.mode == "raw":
        occupied = np.round(shade * 255) / 100
    cells = np.full(shade.shape, UNKNOWN, np.int8)
    # Less than any step between two shades: what is at the threshold must not hang on rounding.
    cells[occupied <= described.free + 1e-9] = FREE
    cells[occupied >= described.occupied - 1e-9] = OCCUPIED
    if described.mode == "raw":
        cells[occupied > 1] = UNKNOWN
    return cells


def _decimal(value: float) -> str:
    """Return a number with at least three decimals, without those that only rounding has left.

    >>> _decimal(3 * 0.05), _decimal(-12.0), _decimal(0.0125)
    ('0.150', '-12.000', '0.0125')
    """
    return np.format_float_positional(float(f"{value + 0.0:.15g}"), min_digits=3)


def _refused(path: Path, cause: str, way_out: str) -> UnreadableError:
    return UnreadableError(f"{path}: {cause}; {way_out}")


def _shown(value: object) -> str:
    """Return a value of a file in a message, short and printable."""
    if value is None or isinstance(value, list | dict):
        return "a list" if isinstance(value, list) else "neither a text nor a number"
    return clipped(ascii(value))


def _reason(err: Exception) -> str:
    """Return the cause of an error as one short line."""
    if isinstance(err, OSError) and err.strerror:
        return err.strerror
    text = str(err).strip() or type(err).__name__
    return "".join(character if character.isprintable() else " " for character in text.splitlines()[0])[:120]


def write_occupancy_mcap(file: BinaryIO, grid: Occupancy, stamp_ns: int, topic: str = "/map") -> None:
    """Write an MCAP file with the map as its one message, on a latched topic.

    A stamp [ns] that ROS 2 cannot hold, before 1970 or after 2038, becomes the nearest one that it can.
    """
    # Those who only read maps do not wait for the definitions of all messages.
    from lidarcli.ros.messages import add_channel, offered, ros2_definition, start_ros2

    stamp_ns = min(max(stamp_ns, 0), (1 << 31) * 1_000_000_000 - 1)
    writer = start_ros2(file)
    channel = add_channel(writer, topic, MAP_TYPE, ros2_definition(MAP_TYPE), offered(1, latched=True))
    writer.add_message(channel, stamp_ns, occupancy_cdr(grid, stamp_ns), stamp_ns)
    writer.finish()  # type: ignore[no-untyped-call]


def occupancy_cdr(grid: Occupancy, stamp_ns: int, z: float = 0.0) -> bytes:
    """Return the map as a nav_msgs/msg/OccupancyGrid in little-endian CDR.

    `stamp_ns`: 0 to 2^31 s [ns]; `z`: height of the map [m].
    """
    stamp = divmod(stamp_ns, 1_000_000_000)
    frame = grid.frame_id.encode("utf-8", "replace") + b"\0"
    height, width = grid.cells.shape
    body = bytearray(struct.pack("<iII", *stamp, len(frame)) + frame)
    _align(body, 4)
    body += struct.pack("<iIfII", *stamp, grid.resolution, width, height)
    _align(body, 8)
    body += struct.pack("<7d", grid.x, grid.y, z, 0, 0, 0, 1)
    body += struct.pack("<I", grid.cells.size)
    return b"".join((b"\0\1\0\0", body, np.ascontiguousarray(grid.cells, np.int8).data.cast("B")))


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)
