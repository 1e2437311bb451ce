"""Public recordings of which something beside the sweeps tells where the sensor was: simulators, motion capture, SLAM."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy.real import EGO, Mocap, mocap, poses_at
from benchmarks.maps.figures import PathError
from benchmarks.maps.paths import Followed, errors_over, follow, path_error, told_poses
from benchmarks.tracking.real import MOUNT
from lidarcli.sweeps.types import Float64

JUDGED = Path("judged", "logs")
"""Folder of further recordings, beside that of the others."""
DELAYS, YAWS = np.arange(-20, 21) / 100, np.radians(np.arange(-20, 21) / 2)
"""Delays of the sweeps [s] and turns of the sensor [rad] that are tried for motion capture, ..."""
SHORT = 1.0
"""... by the errors over so much of the way [m]."""


@dataclass(frozen=True, slots=True)
class Known:
    """Recordings and what tells where their sensor was."""

    logs: str
    """Pattern below the folder of recordings, or below `JUDGED` beside it."""
    truth: str
    topic: str
    is_body: bool = False
    """True where the topic tells of what carries the sensor, by a clock of its own."""

    def find(self, folder: Path) -> list[Path]:
        """Those that are at hand."""
        return sorted([*folder.glob(self.logs), *(folder.resolve().parent / JUDGED).glob(self.logs)])


KNOWN = (
    Known("my_gazebo_tutorials/2*", "Gazebo", "/odom"),
    Known("datmo/*.bag", "motion capture", EGO, is_body=True),
    Known("datmo_more/intersection.bag", "motion capture", EGO, is_body=True),
    Known("datmo_more/two_robots.bag", "motion capture", "/mocap_pose", is_body=True),
    Known("carmen_ple/*.log.gz", "SLAM", "/corrected"),
)


def measure_real_paths(folder: Path, wanted: Sequence[Known] = KNOWN) -> list[PathError]:
    """The paths of all recordings that are at hand."""
    found = []
    for known in wanted:
        for log in known.find(folder):
            print(f"path of {log.name} ...", file=sys.stderr)
            followed = follow(log)
            if known.is_body:
                true = captured(mocap(log, known.topic), followed)
            else:
                true = told_poses(log, known.topic, followed.topic)
            name = log.name.removesuffix(".gz").removesuffix(".log").removesuffix(".bag")
            found.append(path_error(f"{log.parent.name}/{name}, {known.truth}", followed, true))
    return found


def captured(body: Mocap, followed: Followed) -> Float64:
    """(S, 3) where the sensor was by motion capture, with the delay and the turn that fit the path best over short ways."""

    def at(delay: float, yaw: float) -> Float64:
        there = poses_at(body, followed.stamp_ns + round(delay * 1e9))
        there[:, :2] += MOUNT * np.column_stack([np.cos(there[:, 2]), np.sin(there[:, 2])])
        there[:, 2] += yaw
        return there

    def cost(delay: float, yaw: float) -> float:
        off, turned, _ = errors_over(at(delay, yaw), followed.poses, SHORT)
        return float(np.median(off) + SHORT * np.median(np.abs(turned)))

    return at(*min(((delay, yaw) for delay in DELAYS for yaw in YAWS), key=lambda tried: cost(*tried)))
