#!/bin/sh
# evo: two paths with equal positions are metres apart in relative translation, if one has quaternions of zeros.
#
# Packages: evo 1.38.1, numpy 2.4.6.
# Guess:    quaternions 0 0 0 0 (a path that knows positions only) are refused, or the error of equal positions is 0.
# Seen:     a circle of 3 m in radius, sixty poses, the same positions in both files. APE, translation: 0. RPE,
#           translation, ten poses apart: 4.5 m, and no exception. Zeros count as no rotation, and the relative step is
#           told in the frame of the pose. point_distance, which needs no orientation, gives 0. check() does say
#           "invalid (must be unit quaternions)", but the metrics do not call it, and after project(Plane.XY) even that
#           passes.
# So what:  paths of people and of GNSS know no heading, and TUM has a place for one: whoever fills it by zeros sees a
#           perfect absolute error and a drift of 4.5 m in each 3.2 m of way. Take PoseRelation.point_distance for such
#           paths, or derive a yaw first.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 evo==1.38.1
cd "$work"
HOME="$work" MPLBACKEND=agg "$work/venv/bin/python" - <<'PYTHON'
import math

from evo.core import metrics
from evo.core.trajectory import Plane
from evo.tools import file_interface

COUNT, RADIUS = 60, 3.0
with open("with_yaw.tum", "w") as known, open("zeros.tum", "w") as unknown:
    for i in range(COUNT):
        turn = 2 * math.pi * i / (COUNT - 1)
        half = (turn + math.pi / 2) / 2
        place = f"{i * 0.1:.1f} {RADIUS * math.cos(turn):.6f} {RADIUS * math.sin(turn):.6f} 0"
        print(place, 0, 0, f"{math.sin(half):.9f} {math.cos(half):.9f}", file=known)
        print(place, 0, 0, 0, 0, file=unknown)
reference = file_interface.read_tum_trajectory_file("with_yaw.tum")
path = file_interface.read_tum_trajectory_file("zeros.tum")


def error(metric):
    metric.process_data((reference, path))
    return float(metric.get_statistic(metrics.StatisticsType.rmse))


kinds = metrics.PoseRelation
absolute = error(metrics.APE(kinds.translation_part))
relative = error(metrics.RPE(kinds.translation_part, 10, metrics.Unit.frames, all_pairs=True))
distance = error(metrics.RPE(kinds.point_distance, 10, metrics.Unit.frames, all_pairs=True))
print(f"APE translation {absolute:.3f} m, RPE translation {relative:.3f} m, RPE point_distance {distance:.3f} m")
before = path.check()
path.project(Plane.XY)
after = path.check()
print("check before:", before[1]["quaternions"], "- after project(XY):", after[1]["quaternions"])
assert absolute == distance == 0
assert 4 < relative < 5
assert not before[0] and after[0]
PYTHON
