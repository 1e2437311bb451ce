"""Maps of map_server: both loaders read what is written, and what is damaged is told in one line."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

import lidarcli.maps.grids
from lidarcli.errors import UnreadableError
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.maps.grids import pgm_bytes, read_map, yaml_bytes

GRID = Occupancy(0.05, -1.25, 3 * 0.05, np.array([[-1, 0, 100, 0], [100, -1, 0, 0], [0, 0, 0, 100]], np.int8))
YAML = """\
image: map.pgm
mode: trinary
resolution: 0.050
origin: [-1.250, 0.150, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""

grids = st.builds(
    lambda cells, resolution, column, row: Occupancy(resolution, column * resolution, row * resolution, cells),
    arrays(np.int8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from([-1, 0, 100])),
    st.sampled_from([0.05, 0.025, 0.1, 0.03, 1.0]),
    st.integers(-100_000, 100_000),
    st.integers(-100_000, 100_000),
)


def put(folder: Path, grid: Occupancy) -> Path:
    (folder / "map.pgm").write_bytes(pgm_bytes(grid))
    (folder / "map.yaml").write_bytes(yaml_bytes(grid, "map.pgm"))
    return folder / "map.yaml"


def scalars(text: bytes) -> dict[str, str]:
    return dict(line.split(": ", 1) for line in text.decode().splitlines())


def p5(data: bytes) -> NDArray[np.uint8]:
    """A binary PGM by its specification: tokens, comments, one blank, then the pixels."""
    lines = data.split(b"\n", 4)
    assert lines[0] == b"P5"
    assert lines[1].startswith(b"#")
    width, height = map(int, lines[2].split())
    assert lines[3] == b"255"
    assert len(lines[4]) == width * height
    return np.frombuffer(lines[4], np.uint8).reshape(height, width)


def loaded_by_ros1(yaml: bytes, pgm: bytes) -> list[list[int]]:
    """image_loader.cpp of map_server, mode trinary, pixel by pixel."""
    said, pixels = scalars(yaml), p5(pgm)
    height, width = pixels.shape
    grid = [[99] * width for _ in range(height)]
    for j in range(height):
        for i in range(width):
            color = float(pixels[j, i])
            occ = color / 255.0 if int(said["negate"]) else (255 - color) / 255.0
            value = -1
            if occ > float(said["occupied_thresh"]):
                value = 100
            elif occ < float(said["free_thresh"]):
                value = 0
            grid[height - j - 1][i] = value
    return grid


def loaded_by_nav2(yaml: bytes, pgm: bytes) -> list[list[int]]:
    """map_io.cpp of nav2_map_server, mode trinary: single precision, inclusive, free after occupied."""
    said = scalars(yaml)
    shade = p5(pgm).astype(np.float32) / np.float32(255)
    if said["negate"] == "0":
        shade = np.float32(1) - shade
    result = np.full(shade.shape, -1)
    result[shade >= np.float32(said["occupied_thresh"])] = 100
    result[shade <= np.float32(said["free_thresh"])] = 0
    return np.flipud(result).tolist()


def test_the_files_byte_by_byte() -> None:
    assert yaml_bytes(GRID, "map.pgm").decode() == YAML
    assert pgm_bytes(GRID) == b"P5\n# CREATOR: lidarcli 0.050 m/pix\n4 3\n255\n" + bytes(
        [254, 254, 254, 0, 0, 205, 254, 254, 205, 254, 0, 254]
    )


@given(grids)
def test_both_loaders_read_what_was_written(grid: Occupancy) -> None:
    yaml, pgm = yaml_bytes(grid, "map.pgm"), pgm_bytes(grid)
    assert loaded_by_ros1(yaml, pgm) == grid.cells.tolist()
    assert loaded_by_nav2(yaml, pgm) == grid.cells.tolist()
    x, y, yaw = map(float, scalars(yaml)["origin"].strip("[]").split(","))
    resolution = float(scalars(yaml)["resolution"])
    assert resolution == grid.resolution
    assert [round(x / resolution), round(y / resolution)] == [round(grid.x / resolution), round(grid.y / resolution)]
    assert abs(x - grid.x) < 1e-10
    assert abs(y - grid.y) < 1e-10
    assert yaw == 0


def shades(folder: Path, image: Image.Image, name: str = "map.png", **keys: object) -> list[list[int]]:
    """The cells of an image with a YAML file of these keys."""
    image.save(folder / name)
    said = {
        "image": name,
        "resolution": 0.1,
        "origin": "[0, 0, 0]",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    } | keys
    (folder / "map.yaml").write_text("".join(f"{key}: {value}\n" for key, value in said.items()))
    return read_map(folder / "map.yaml").cells.tolist()


def gray(*rows: list[int]) -> Image.Image:
    return Image.fromarray(np.array(rows, np.uint8))


RAMP = gray([0, 89, 90, 204, 205, 206, 255])


@pytest.mark.parametrize("name", ["map.png", "map.bmp", "map.pgm"])
def test_every_image_format(tmp_path: Path, name: str) -> None:
    # 255 * (1 - 0.65) = 89.25 and 255 * (1 - 0.196) = 205.02: 205 is the brightest that is unknown.
    assert shades(tmp_path, RAMP, name) == [[100, 100, -1, -1, -1, 0, 0]]


@pytest.mark.parametrize("name", ["map.png", "map.pgm"])
@pytest.mark.parametrize(
    ("image", "keys", "cells"),
    [
        (gray([0, 205, 254]), {}, [100, -1, 0]),
        (gray([205, 205]), {}, [-1, -1]),
        # Any other shade is none of map_saver, and a file may mean what it says.
        (gray([0, 205, 254, 255]), {}, [100, 0, 0, 0]),
        (gray([0, 205, 254]), {"negate": 1}, [0, 100, 100]),
        (gray([0, 205, 254]), {"mode": "scale"}, [100, 0, 0]),
    ],
)
def test_unknown_cells_as_map_saver_writes_them(
    tmp_path: Path, image: Image.Image, keys: dict[str, Any], cells: list[int], name: str
) -> None:
    """Nav2's saver has 0.25 for `free_thresh` by default, by which they would be free: nobody drove there."""
    assert shades(tmp_path, image, name, **({"free_thresh": 0.25} | keys)) == [cells]
    note = read_map(tmp_path / "map.yaml").note
    words = "205 is unknown, as map_saver writes it; by its free_thresh of 0.25 it would be free"
    assert (words in note) == (-1 in cells and not keys)
    assert shades(tmp_path, gray([0, 205, 254]), name) == [[100, -1, 0]]
    assert not read_map(tmp_path / "map.yaml").note


LEVELS = gray([101, 102, 103, 203, 204, 205])
PER_CENT = gray([0, 19, 20, 64, 65, 100, 101, 255])
ALPHA = Image.fromarray(np.array([[(0, 255), (150, 255), (255, 255), (0, 254), (255, 0)]], np.uint8), "LA")
OPAQUE = Image.fromarray(np.array([[[0] * 4, [0, 0, 0, 255], [255] * 3 + [0], [255] * 4]], np.uint8), "RGBA")


@pytest.mark.parametrize(
    ("image", "keys", "cells"),
    [
        *((gray([0, 255]), {"negate": no}, [100, 0]) for no in ("0", "false", "no", "Off")),
        # At the threshold a cell counts: 51 / 255 = 0.2 and 153 / 255 = 0.6.
        (LEVELS, {"occupied_thresh": 0.6, "free_thresh": 0.2}, [100, 100, -1, -1, 0, 0]),
        # Scale is unknown between the thresholds, and where it is transparent.
        (ALPHA, {"mode": "scale"}, [100, -1, 0, -1, -1]),
        # Trinary takes opacity for a channel: (0 + 0 + 0 + 255) / 4 is a quarter bright.
        (OPAQUE, {}, [100, 100, -1, 0]),
        # Raw is per cent.
        (PER_CENT, {"mode": "Raw", "negate": 1}, [0, 0, -1, -1, 100, 100, -1, -1]),
    ],
)
def test_every_mode(tmp_path: Path, image: Image.Image, keys: dict[str, Any], cells: list[int]) -> None:
    assert shades(tmp_path, image, **keys) == [cells]


def refused(path: Path) -> str:
    """What is said of a file, without its name."""
    with pytest.raises(UnreadableError) as caught:
        read_map(path)
    text = str(caught.value)
    assert text.isprintable(), text
    place, said = text.split(": ", 1)
    assert place == str(path)
    return said


def test_a_large_image_needs_as_many_bytes_as_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A PNG of 8 kB may have 9 million pixels, and a bit of a PBM is one."""
    monkeypatch.setattr(lidarcli.maps.grids, "MAX_PACKED_PIXELS", 100)
    path = put(tmp_path, GRID)
    (tmp_path / "map.pgm").write_bytes(b"P5\n20 20\n255\n" + bytes(400))
    assert read_map(path).occupied == 400
    (tmp_path / "map.pgm").write_bytes(b"P4\n20 20\n" + bytes(60))
    assert "has 20 x 20 pixels, and no more than 10" in refused(path)
    monkeypatch.setattr(lidarcli.maps.grids, "MAX_PIXELS", 399)
    (tmp_path / "map.pgm").write_bytes(b"P5\n20 20\n255\n" + bytes(400))
    assert refused(path).endswith("no more than 399 are read; cut it, or save the map with larger cells")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("resolution: 0.050\n", "", "no resolution, hence no map of map_server"),
        (YAML, "image: map.pgm\n", "no resolution, origin, negate, occupied_thresh, free_thresh, hence"),
        (YAML, "just a text", "not valid YAML of a map: it has no keys"),
        ("0.050", ".nan", "resolution is nan, not a number from "),
        ("0.050", "[0.05]", "resolution is a list, not a number from "),
        ("0.050", "0", "resolution is 0, not a number from 0.001 to 10"),
        ("-1.250", "1e300", "origin is 1e+300, not a number from -1e+09 to 1e+09"),
        ("0.150, 0.0", "0.150, -nan", "origin is nan, not a number from "),
        ("0.150, 0.0", "0.150", "origin is not [x, y, yaw]"),
        ("0.150, 0.0", "0.150, 1.57", "origin has a yaw of 1.57 rad, and maps that are turned are not supported"),
        ("negate: 0", "negate: 2", "negate is 2"),
        ("trinary", "fuzzy", "mode is 'fuzzy'"),
        ("0.65", "high", "occupied_thresh is 'high', not a number from "),
        ("map.pgm", "", "image is neither a text nor a number"),
        ("map.pgm", "none.pgm", "image 'none.pgm' is missing"),
        ("map.pgm", "/dev/zero", "image '/dev/zero' is not a file"),
        ("map.pgm", "map.yaml", "image 'map.yaml' is no PGM, PNG or BMP image"),
        ("map.pgm", '"\\0\\x1b[2J\\n"', "image '\\x00\\x1b[2J\\n' cannot be read: embedded null"),
        ("map.pgm", "x" * 5000, f"image '{'x' * 56}... cannot be read: File name too long"),
        ("map.pgm", "[", "not valid YAML: line "),
    ],
)
def test_a_wrong_yaml_file_is_told_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = put(tmp_path, GRID)
    assert old in YAML
    path.write_text(YAML.replace(old, new, 1))
    assert refused(path).startswith(said)


def test_files_that_are_no_yaml(tmp_path: Path) -> None:
    path = put(tmp_path, GRID)
    assert refused(tmp_path / "none.yaml") == "cannot read the map: No such file or directory"
    assert refused(tmp_path) == "cannot read the map: Is a directory"
    for text in (pgm_bytes(GRID) + b"\xff", b"\xff\xfe" + YAML.encode("utf-16-le")):
        path.write_bytes(text)
        assert "not UTF-8 text; a map is a YAML file" in refused(path)
    path.write_bytes(YAML.encode() + b"#" * (1 << 17))
    assert refused(path).startswith("larger than a map may be")
    path.write_text("[\n" * 5000)
    assert refused(path).startswith("more than 16 levels")


def test_aliases_that_multiply_are_refused_at_once(tmp_path: Path) -> None:
    """Multiplied out they would have 10**28 entries, and the test no end."""
    path = put(tmp_path, GRID)
    lines = ["a0: &a0 {k: 1, l: 2, m: 3}"]
    lines += [f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}" for k in range(1, 30)]
    lines += ["b0: &b0 [x]", *(f"b{k}: &b{k} [{', '.join([f'*b{k - 1}'] * 9)}]" for k in range(1, 30))]
    path.write_text("\n".join(lines) + "\nloop: &loop [*loop]\n" + YAML)
    assert "an anchor that is used twice" in refused(path)


def png(width: int, height: int, mode: str = "L") -> bytes:
    """A PNG image of random pixels."""
    out = io.BytesIO()
    noise = np.random.default_rng(1).integers(0, 255, (height, width), np.uint8)
    Image.fromarray(noise).convert(mode).save(out, "png")
    return out.getvalue()


def broken_header(data: bytes, width: int, height: int) -> bytes:
    """The image with another size in its header, and the right checksum."""
    import zlib

    head = b"IHDR" + struct.pack(">II", width, height) + data[24:29]
    return data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "is no PGM, PNG or BMP image"),
        (b"P7\nWIDTH 1\n", "is no PGM, PNG or BMP image"),
        (b"P5\n4 3\n255\n1234567890", "cannot be read: image file is truncated"),
        (b"P5\n4 3\n70000\n" + bytes(100), "cannot be read: maxval"),
        (b"P5\n40000 40000\n255\n" + bytes(100), "has 40,000 x 40,000 pixels, and no more than 40,000,000 are read"),
        (b"P2\n2 2\n255\n1 2 3 \x1b[2J", "cannot be read: "),
        (png(20, 20)[:200], "cannot be read: "),
        (png(20, 20)[:100] + b"damage" + png(20, 20)[106:], "cannot be read: "),
        (broken_header(png(20, 20), 1 << 20, 1 << 20), "has 1,048,576 x 1,048,576 pixels"),
        (b"BM" + bytes(60), "cannot be read: "),
    ],
)
def test_a_wrong_image_is_told_in_one_line(tmp_path: Path, data: bytes, said: str) -> None:
    path = put(tmp_path, GRID)
    (tmp_path / "map.pgm").write_bytes(data)
    assert refused(path).startswith(f"image 'map.pgm' {said}")


def outcome(path: Path) -> bool:
    """Whether a file is read as a map, or refused in one line."""
    try:
        return set(np.unique(read_map(path).cells)) <= {-1, 0, 100}
    except UnreadableError as err:
        return str(err).isprintable()


@pytest.mark.parametrize("kind", ["pgm", "png", "bmp", "yaml"])
def test_damage_anywhere_is_a_map_or_one_line(tmp_path: Path, kind: str) -> None:
    (tmp_path / "map.yaml").write_bytes(yaml_bytes(GRID, f"map.{kind.replace('yaml', 'pgm')}"))
    (tmp_path / "map.pgm").write_bytes(pgm_bytes(GRID))
    with Image.open(tmp_path / "map.pgm") as image:
        image.save(tmp_path / "map.png")
        image.save(tmp_path / "map.bmp")
    path = tmp_path / f"map.{kind}"
    whole, random = path.read_bytes(), np.random.default_rng(3)
    for _ in range(150):
        data = bytearray(whole)
        for at in random.integers(0, len(data), random.integers(1, 4)):
            data[at] = random.integers(0, 256)
        path.write_bytes(data[: random.integers(1, len(data) + 1)] if random.random() < 0.3 else data)
        assert outcome(tmp_path / "map.yaml")
