#!/bin/sh
# PedPy: who turns back ON the line is counted as having crossed it; whose track ends with the step across is not.
#
# Packages: PedPy 1.5.1, pandas 3.1.1, numpy 2.4.6.
# Guess:    a crossing is a step from one side to the other: touch and return counts 0, a step across counts 1.
# Seen:     x of a walker, frame by frame, and the crossings of the line x = 0 that compute_n_t finds:
#             -1.5 -0.5  0.5  1.5    1
#             -1.5 -0.5  0.5         0   the last step of a track never counts
#             -2 -1  0 -1 -2         1   was never on the other side
#             -1  0  0 -1            0   ... but not if it stood there for a frame
# So what:  tracks by a laser end where people leave its view, and a line across a door at the edge of the view is
#           crossed in the last step of a track: these people are missing from the flow. Positions on a grid (or rounded
#           to 0.1 m) lie ON lines, so that people who only came up to the line are counted. Extend tracks by a frame,
#           and put lines where no rounded position lies.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 pandas==3.1.1 PedPy==1.5.1
"$work/venv/bin/python" - <<'PYTHON'
import pandas as pd
import pedpy

door = pedpy.MeasurementLine([(0, -1), (0, 1)])
CASES = [
    ([-1.5, -0.5, 0.5, 1.5], 1),
    ([-1.5, -0.5, 0.5], 0),
    ([-2.0, -1.0, 0.0, -1.0, -2.0], 1),
    ([-1.0, 0.0, 0.0, -1.0], 0),
]
for walk, seen in CASES:
    rows = pd.DataFrame({"id": 1, "frame": range(len(walk)), "x": walk, "y": 0.0})
    walker = pedpy.TrajectoryData(rows, frame_rate=10)
    _, crossings = pedpy.compute_n_t(traj_data=walker, measurement_line=door)
    print(walk, len(crossings))
    assert len(crossings) == seen, (walk, len(crossings))
PYTHON
