"""A log whose topic is silent for a second, and a zone of Nav2 that does not wait so long."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lidarcli.simulation.writers import write_log
from tests.sweeping import START, STEP, raw_sweeps, round_room

LATE = 7
"""Time from the stamp of a sweep to its record [ns]."""


def silenced(folder: Path, timeout: float) -> tuple[Path, Path, int]:
    """Write log and zones; the last sweep before the silence is 1 s after the first; returns also the number of sweeps."""
    kept = np.r_[0:11, 22:30]
    stamps = START + STEP * kept
    log, zones = folder / "run.mcap", folder / "nav2.yaml"
    write_log(log, [raw_sweeps(round_room(30)[kept], stamp_ns=stamps, record_ns=stamps + LATE)])
    zones.write_text(
        "collision_monitor:\n  ros__parameters:\n    base_frame_id: laser\n    observation_sources: [scan]\n"
        f"    source_timeout: {timeout}\n    scan: {{type: scan, topic: /scan}}\n    polygons: [Stop]\n"
        "    Stop: {type: circle, radius: 1.0, action_type: stop}\n"
    )
    return log, zones, len(kept)
