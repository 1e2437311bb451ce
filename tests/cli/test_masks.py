"""`--mask` on the command line: refusals, notes, and the file that `info` writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.simulation.writers import write_log
from tests.sweeping import raw_sweeps

Run = Callable[..., Any]


@pytest.fixture
def parked(tmp_path: Path) -> Path:
    """A log of a sensor that stands, with a post before it."""
    ranges = np.full((20, 360), 4.0, np.float32)
    ranges[:, 90:96] = 0.3
    write_log(tmp_path / "parked.mcap", [raw_sweeps(ranges)])
    return tmp_path / "parked.mcap"


def test_what_a_parked_sensor_sees_is_proposed(lidarcli: Run, parked: Path, tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    ran = lidarcli("info", parked, "--mask", "auto", "-o", file)
    assert ran.code == 0
    assert "nothing is masked: the sensor drove 0.0 m and turned by 0 degrees" in ran.out
    assert "6 beams at 0.26 to 0.34 m look like the robot itself: --mask FILE masks them" in ran.out
    assert f"wrote    {file}" in ran.err
    assert file.read_text() == (
        "# The sensor stood: what follows looks like the robot itself. Remove the # where it is.\n\n"
        "# [[mask]]\n"
        '# topic = "/scan"\n'
        "# sector = { from = -90.500006, to = -84.500006, nearest = 0.2625, farthest = 0.3425 }\n"
    )
    assert lidarcli("info", parked, "--mask", file).code == 2
    file.write_text("".join(line[2:] for line in file.read_text().splitlines(keepends=True)[2:]))
    assert "masked    120 beams (1.67%)" in lidarcli("info", parked, "--mask", file).out
    ran = lidarcli("detect", parked, "--mask", file, "-o", tmp_path)
    assert "masked 120 (1.7%)" in ran.err
