#!/bin/sh
# scipy.ndimage.median_filter: one NaN tears the edge of an object that lies beyond the window of the NaN.
#
# Packages: scipy 1.17.1, numpy 2.4.6.
# Guess:    the NaN spoils the windows that hold it (four beams either side for a window of nine), as it does in any
#           median.
# Seen:     a post at 1 m before a wall at 4 m, a cm of noise, a window of nine. Beam 98 has no return; its last window
#           is that of beam 102. Without the NaN the post begins at beam 106. With it, the result says post at beams 103
#           to 105, wall at 106 to 109 and post again from 110: seven beams wrong by 3 m, beyond the window.
#           scipy.signal.medfilt does the same. The same row as a picture of one line (2-D) has no such damage; nor has
#           the 1-D filter with inf in place of NaN.
# So what:  smoothing a sweep along its beams is a usual first step, and beams without a return are often NaN. The
#           faults look like ranges and lie beyond what one would mask around a gap. Fill gaps by inf, or use a filter
#           that knows NaN, before any median over beams.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 scipy==1.17.1
"$work/venv/bin/python" - <<'PYTHON'
import numpy as np
from scipy import ndimage, signal

BEAMS, GAP, WINDOW = 241, 98, 9
beam = np.arange(BEAMS)
sweep = np.where(np.abs(beam - 120) < 15, 1.0, 4.0) + np.random.default_rng(152).normal(0, 0.01, BEAMS)


def far(smooth, fill):
    """Say which beams beyond the window of the gap change by over 1 m, and at all."""
    holed = sweep.copy()
    holed[GAP] = fill
    whole, gapped = smooth(sweep), smooth(holed)
    beyond = np.abs(beam - GAP) > WINDOW // 2
    wrong = np.flatnonzero(~(np.abs(whole - gapped) < 1) & beyond)
    changed = np.flatnonzero((whole != gapped) & beyond)
    print(f"{smooth.__name__:8} {fill}: changed beyond the window {changed.tolist()}, by over 1 m {wrong.tolist()}")
    return wrong.tolist(), changed.tolist()


def line(row):
    return ndimage.median_filter(row, WINDOW, mode="nearest")


def picture(row):
    return ndimage.median_filter(row[None], (1, WINDOW), mode="nearest")[0]


def medfilt(row):
    return signal.medfilt(row, WINDOW)


assert far(line, np.nan)[0] == [103, 104, 105, 106, 107, 108, 109]
assert far(medfilt, np.nan)[0] == [103, 104, 105, 106, 107, 108, 109]
assert far(picture, np.nan)[1] == far(line, np.inf)[1] == far(picture, np.inf)[1] == far(medfilt, np.inf)[1] == []
PYTHON
