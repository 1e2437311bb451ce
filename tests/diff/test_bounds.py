"""What is refused because comparing it would take too long, in one line that tells the way out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lidarcli as package
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, Int8, Occupancy
from lidarcli.formalism.matching import differences, free_space
from lidarcli.maps.grids import pgm_bytes, yaml_bytes
from lidarcli.pipeline.differences import inputs
from tests.waiting import HANG


def write_map(path: Path, cells: Int8) -> str:
    grid = Occupancy(0.05, -3.0, -2.0, cells)
    path.write_bytes(yaml_bytes(grid, f"{path.stem}.pgm"))
    path.with_suffix(".pgm").write_bytes(pgm_bytes(grid))
    return str(path)


def walls(boxes: int) -> Int8:
    """A room, and a row of boxes in it."""
    cells = np.full((80, 120), FREE, np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for box in range(boxes):
        cells[10:18, 10 + 12 * box : 18 + 12 * box] = OCCUPIED
    return cells


def test_a_map_of_too_many_occupied_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = write_map(tmp_path / "one.yaml", walls(0))
    monkeypatch.setattr(inputs, "MAX_OCCUPIED", 395)
    with pytest.raises(UnreadableError, match=r"one.yaml: 396 occupied cells are more than .*; make what lies"):
        package.diff(one, one)


def test_structure_that_differs_in_too_many_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = (write_map(tmp_path / f"{boxes}.yaml", walls(boxes)) for boxes in (0, 3))
    assert package.diff(one, other).figures["new"] == 3.0
    monkeypatch.setattr(differences, "MAX_CHANGES", 2)
    with pytest.raises(UnreadableError, match=r"differ in 3 places of their structure, more than are told \(2\)"):
        package.diff(one, other)


def test_the_ground_of_all_runs_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = write_map(tmp_path / "one.yaml", walls(1))
    assert package.diff(one, one, one).figures["overlap"] == 1.0
    monkeypatch.setattr(free_space, "MAX_CELLS", 5000)
    with pytest.raises(OptionError, match=r"^the ground of all runs would reach over 6 x 4 m; compare fewer"):
        package.diff(one, one, one)


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["free", "dots", "black"])
def test_a_small_image_of_many_cells_takes_neither_time_nor_memory(pattern: str, tmp_path: Path) -> None:
    """Compared with itself it is read, laid on itself, and told; black alone is refused."""
    from PIL import Image

    pixels = np.full((3000, 3000), 0 if pattern == "black" else 254, np.uint8)
    if pattern == "dots":
        pixels[::5, ::5] = 0
    Image.fromarray(pixels).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_bytes(yaml_bytes(Occupancy(0.05, 0.0, 0.0, np.zeros((1, 1), np.int8)), "map.png"))
    script = (
        "from pathlib import Path; import lidarcli.cli as cli; code = cli.run(['-q', 'diff', 'map.yaml', 'map.yaml'])\n"
        # The peak since the process has begun its program; that of `getrusage` counts what forked it, too.
        "peak = Path('/proc/self/status').read_text().partition('VmHWM:')[2].split()[0]\n"
        "print(code, int(peak) // 1024)"
    )
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=HANG,
        env={**os.environ, "LIDARCLI_CONFIG": "none"},
    )
    code, peak = map(int, ran.stdout.split()[-2:])
    assert (code, len(ran.stderr.splitlines())) == ((0, 0) if pattern == "dots" else (3, 1))
    assert peak < 700
