"""Every command that reads sweeps tells what looks wrong in them, in the same words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.simulation.writers import write_log
from tests.sweeping import room_sweeps

NOTE = "most ranges of /scan are beyond 1,000 m: they are probably millimetres (--range-unit mm)"
COMMANDS = {
    "info": ("info",),
    "detect": ("detect", "-o", "t"),
    "track": ("track", "-o", "t"),
    "background": ("background", "build", "-o", "t.parquet"),
    "map": ("map", "--poses", "p.tum", "-o", "m.yaml", "--resolution", "10", "--max-size", "100"),
    "overlay": ("overlay", "-o", "o.mcap"),
    "plot": ("plot", "-o", "p.png"),
    "poses": ("poses", "--poses", "p.tum", "-o", "q.tum"),
}


@pytest.fixture
def millimetres(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log whose ranges are millimetres, and a trajectory, in the working directory."""
    monkeypatch.chdir(tmp_path)
    block = room_sweeps()
    told = {name: getattr(block, name) * np.float32(1000) for name in ("ranges", "range_min", "range_max")}
    write_log(tmp_path / "run.mcap", [replace(block, **told)])
    times = (1_700_000_000 + k / 10 for k in range(-1, 23))
    (tmp_path / "p.tum").write_text("".join(f"{time:.3f} 0 0 0 0 0 0 1\n" for time in times))
    return tmp_path


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_tells_it(lidarcli: Callable[..., Any], millimetres: Path, command: str) -> None:
    ran = lidarcli(*COMMANDS[command], "run.mcap")
    assert ran.code == 0
    assert f"{ran.out}{ran.err}".count(NOTE) == 1
    again = lidarcli(*COMMANDS[command], "run.mcap", "--range-unit", "mm", *(("--overwrite",) * (command != "info")))
    assert again.code == 0
    assert "--range-unit" not in f"{again.out}{again.err}"


def test_degrees_are_refused(lidarcli: Callable[..., Any], tmp_path: Path) -> None:
    good = room_sweeps()
    many = replace(good, angle_increment=np.where(np.arange(20) < 5, 1.0, good.angle_increment))
    write_log(tmp_path / "run.mcap", [many])
    ran = lidarcli("detect", tmp_path / "run.mcap", "-o", tmp_path / "t")
    assert ran.code == 3
    assert "topic /scan: 5 messages left out: angle_increment is beyond 0.9 rad: probably degrees" in ran.err
    assert ": 15 sweeps, " in ran.err
