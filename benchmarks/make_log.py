"""Write the benchmark's log: `make_log.py SCENE SWEEPS BEAMS_JITTER LOG`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from lidarcli.simulate.generate import simulate_blocks
from lidarcli.simulate.load import load_scene
from lidarcli.simulate.writers import write_log


def main(scene_file: str, sweeps: str, beams_jitter: str, log: str) -> None:
    """Simulate `sweeps` sweeps, whose beam count varies by up to `beams_jitter`, into an MCAP log (zstd)."""
    scene = load_scene(Path(scene_file))
    scene = replace(scene, sensor=replace(scene.sensor, beams_jitter=int(beams_jitter)))
    blocks = (block.raw for block in simulate_blocks(scene, int(sweeps)))
    write_log(log, blocks, compression="zstd")


if __name__ == "__main__":
    main(*sys.argv[1:])
