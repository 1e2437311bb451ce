#!/bin/sh
# KISS-ICP, as it comes, loses a third to a half of the turn in a room and three quarters of the way in a corridor.
#
# Packages: kiss-icp 1.3.0, numpy 2.4.6.
# Guess:    twenty noise-free sweeps, 5 cm and one degree apart: within 5 cm of the truth, in a room at least.
# Seen:     truth 1.02 m and 19 degrees. The last pose is off by, with load_config(None) and with cells of 0.15 m:
#             room of 8.3 x 6.2 m with a pillar    0.14 m  6.4 degrees    4 mm  0.1 degrees
#             bare room of 5.7 x 4.9 m             0.12 m  8.9 degrees    3 mm  0.0 degrees
#             corridor of 12 x 2.6 m               0.76 m  0.9 degrees    2 mm  0.1 degrees
#           Nothing is raised or said. The cells are a hundredth of max_range, which is 100 m whatever the points say.
# So what:  somebody who has no odometry lifts LaserScans to points with z = 0 and calls a well-known odometry.
#           Indoors the path comes out bent and short by the defaults alone, which looks like drift of the
#           method. Set max_range AND mapping.voxel_size: it is computed once, and a later change of max_range alone
#           does not change it.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 kiss-icp==1.3.0
"$work/venv/bin/python" - <<'PYTHON'
import numpy as np
from kiss_icp.config import load_config
from kiss_icp.kiss_icp import KissICP


def box(left, low, right, high):
    return [(left, low), (right, low), (right, high), (left, high)]


PLACES = {
    "room with a pillar": [box(-3.7, -2.8, 4.6, 3.4), box(1.15, 0.9, 2.05, 1.85)],
    "bare room": [box(-2.3, -2.2, 3.4, 2.7)],
    "corridor": [box(-3.3, -1.2, 8.7, 1.4)],
}
BEARINGS = np.linspace(-np.pi, np.pi, 720, endpoint=False)


def sweep(shapes, x, y, yaw):
    """Cast 720 beams at the walls; points in the frame of the sensor, z = 0."""
    way = np.stack([np.cos(BEARINGS + yaw), np.sin(BEARINGS + yaw)])
    nearest = np.full(BEARINGS.size, np.inf)
    walls = [(shape[i], shape[(i + 1) % 4]) for shape in shapes for i in range(4)]
    for (ax, ay), (bx, by) in walls:
        ex, ey, px, py = bx - ax, by - ay, ax - x, ay - y
        with np.errstate(divide="ignore", invalid="ignore"):
            across = way[0] * ey - way[1] * ex
            along = (px * ey - py * ex) / across
            share = (px * way[1] - py * way[0]) / across
        hit = (along > 0) & (share >= 0) & (share <= 1)
        nearest[hit] = np.minimum(nearest[hit], along[hit])
    return np.stack([nearest * np.cos(BEARINGS), nearest * np.sin(BEARINGS), 0 * nearest], axis=1)


def odometry(shapes, cell=None):
    """Give how far off the last of twenty poses is, in metres and degrees."""
    config = load_config(None)
    if cell:
        config.data.max_range, config.mapping.voxel_size = 100 * cell, cell
    matcher = KissICP(config)
    for i in range(20):
        matcher.register_frame(sweep(shapes, 0.05 * i, 0.02 * i, np.radians(i)), np.array([]))
    pose = matcher.last_pose
    off = np.hypot(pose[0, 3] - 0.95, pose[1, 3] - 0.38)
    turned = np.degrees(np.arctan2(pose[1, 0], pose[0, 0])) - 19
    print(f"cells of {config.mapping.voxel_size} m: off by {off:.3f} m and {turned:.2f} degrees")
    return off, turned


for name, shapes in PLACES.items():
    print(name)
    (off, turned), (fine, bent) = odometry(shapes), odometry(shapes, 0.15)
    if name == "corridor":
        assert off > 0.5 and fine < 0.2 and abs(bent) < 0.5
    else:
        assert off > 0.08 and turned < -4 and fine < 0.02 and abs(bent) < 0.5
PYTHON
