#!/bin/sh
# small_gicp on flat sweeps: point-to-plane is exact without noise and "converges" to no motion with 1 cm of it.
#
# Packages: small_gicp 1.0.1, numpy 2.4.6.
# Guess:    points with z = 0 have every local plane lying flat, so that GICP (and PLANE_ICP as well, with noise or
#           without) has nothing to hold on to within the plane, stays near no motion and says converged.
# Seen:     two sweeps of a room, 0.22 m and 3 degrees apart, all converged, with over 500 inliers:
#                          no noise                          1 cm of noise
#             PLANE_ICP    exact to 0.1 mm and 0.01 degrees  no motion at all
#             GICP         2 mm, 0.1 degrees off             3 mm, 0.3 degrees off
#           Presumably: noise-free points lie on a line, any normal across it will do, and the one that comes out is
#           useful; noise makes "up" the thinnest direction everywhere.
# So what:  whoever tries 3D registration on LaserScans with a simulated log sees PLANE_ICP win by far, and then gets
#           "the robot stood still" from the real one; neither `converged` nor the count of inliers tells. GICP, which
#           one would expect to fail in the same way, does work.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 small_gicp==1.0.1
"$work/venv/bin/python" - <<'PYTHON'
import numpy as np
import small_gicp

ROOM = [(-3.7, -2.8), (4.6, -2.8), (4.6, 3.4), (-3.7, 3.4)]
BOX = [(1.15, 0.9), (2.05, 0.9), (2.05, 1.85), (1.15, 1.85)]
EDGES = [(shape[i], shape[(i + 1) % 4]) for shape in (ROOM, BOX) for i in range(4)]
BEARINGS = np.linspace(-np.pi, np.pi, 720, endpoint=False)
X, Y, YAW = 0.2, 0.1, np.radians(3)


def sweep(x, y, yaw, noise):
    """Cast 720 beams at the edges; points in the frame of the sensor, z = 0."""
    ranges = []
    for c, s in zip(np.cos(BEARINGS + yaw), np.sin(BEARINGS + yaw)):
        best = np.inf
        for (ax, ay), (bx, by) in EDGES:
            across = c * (by - ay) - s * (bx - ax)
            if abs(across) > 1e-12:
                along = ((ax - x) * (by - ay) - (ay - y) * (bx - ax)) / across
                share = ((ax - x) * s - (ay - y) * c) / across
                if along > 0 and 0 <= share <= 1:
                    best = min(best, along)
        ranges.append(best)
    ranges = np.array(ranges) + noise
    return np.stack([ranges * np.cos(BEARINGS), ranges * np.sin(BEARINGS), 0 * ranges], axis=1)


def register(kind, noise):
    random = np.random.default_rng(1)
    before = sweep(0, 0, 0, random.normal(0, noise, BEARINGS.size))
    after = sweep(X, Y, YAW, random.normal(0, noise, BEARINGS.size))
    result = small_gicp.align(
        before, after, registration_type=kind, downsampling_resolution=0.05, max_correspondence_distance=1.0
    )
    pose = result.T_target_source
    x, y, yaw = *pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])
    print(f"{kind:9} noise {noise} m: {x:.4f} {y:.4f} m {np.degrees(yaw):.3f} degrees", end=", ")
    print(f"converged {result.converged}, {result.num_inliers} inliers")
    assert result.converged and result.num_inliers > 500
    return np.hypot(x - X, y - Y), abs(np.degrees(yaw - YAW)), np.hypot(x, y), abs(np.degrees(yaw))


off, turned, _, _ = register("PLANE_ICP", 0.0)
assert off < 1e-4 and turned < 0.01
_, _, moved, turn = register("PLANE_ICP", 0.01)
assert moved < 0.001 and turn < 0.01
for noise in (0.0, 0.01):
    off, turned, _, _ = register("GICP", noise)
    assert off < 0.01 and turned < 0.5
PYTHON
