"""What docs/maps.md says beside its numbers."""

from __future__ import annotations

import numpy as np

from benchmarks.maps import scenes
from benchmarks.maps.figures import EVERY, MOVED, TOLD
from benchmarks.maps.paths import DRIFT, STRETCH, YAW_DRIFT
from benchmarks.maps.real_paths import SHORT
from benchmarks.maps.rules import (
    CARTOGRAPHER_CLAMP,
    CARTOGRAPHER_HIT,
    CARTOGRAPHER_MISS,
    GMAPPING_RATIO,
    KARTO_PASSES,
    KARTO_RATIO,
    OCTOMAP_HIT,
    OCTOMAP_MISS,
)
from benchmarks.maps.scoring import GHOST
from benchmarks.tracking.real import MOUNT
from lidarcli.choices import MIN_MOVE
from lidarcli.formalism.mapping.grid import MIN_TURN, PAUSE_NS

TUNING, REPORTING = 0, 80_000
"""First seeds of drives that constants may be chosen on, and of what is reported."""

HEAD = f"""# How right the maps are

How right are the maps that [`lidarcli map`](map.md) makes, beside those of the rules of published programs? What do
people leave in them, and how right are paths that are found from the sweeps themselves? `make maps` measures it and
writes this page; no number here is typed by hand. The same seeds give the same buildings, people and noise:

```sh
{{command}}
```

Reported drives begin with seed {{first:,}}; constants may be looked at on those from {TUNING} on
(`make maps MAPS="--tune"`). Everything runs with default options unless a row says otherwise.
"""

WHY = """F1 and ghosts are those of the default options. The true map has every cell that any beam of any sweep would hit,
also in rooms that are only glimpsed in passing. That is no matter of the path: `--pose match` has nearly the F1 of true
poses. What people leave are cells that few sweeps see, of which a few in a row hit a leg that stands for a moment.

"""

SCENES = f"""## The drives

`benchmarks/maps/scenes.py` draws them: {scenes.SWEEPS:,} sweeps, {scenes.RATE:g} a second, of {scenes.SENSOR.beams}
beams over a closed turn up to {scenes.SENSOR.range_max:g} m, with noise of σ {100 * scenes.NOISE:g} cm;
{100 * scenes.MIXED:g} % of the beams at an edge end between two surfaces, and {100 * scenes.LOST:g} % are lost.
A robot drives one loop; up to {scenes.PEOPLE} people walk about on two legs, through doors and past the robot, and
pause for 3 s at most. Poses are true.

- **corridors**: a ring around a core, with rooms on both sides that are only glimpsed through doorways in passing;
- **rooms**: two rows of three rooms, all of which the robot drives through.

The true map is that of `lidarcli simulate --map`: every cell that any beam of a perfect sensor on the same way hits,
without people. *Seen once* and *seen twice* tell how much of it there is to be seen with a motion filter: the share
of the true cells that one, or two, of the sweeps that count would hit without noise and without people.
"""

RULES = f"""## Maps with true poses

A cell of a map is right where an occupied one of the true map is at most a cell away, and the other way round
(precision, recall, F1: means of the drives). **Ghosts** are wrong cells within {100 * GHOST:g} cm of where a leg of
somebody was in any sweep; the table has their sum. Cells of 5 cm, once with *{EVERY}*, once with the
*{MOVED}* (one for each {MIN_MOVE:g} m, {np.degrees(MIN_TURN):g}° or {PAUSE_NS / 1e9:g} s).

- **lidarcli**: the program. Each cell counts once per sweep; it is occupied from 2 hits on (4 where every sweep
  counts), and by more than a quarter of the sweeps that hit or passed it. *Once per sweep* is the same with other
  constants.
- Rules of published programs, written anew from their code, with their default constants:
  - *gmapping*: every beam counts; hits of more than {GMAPPING_RATIO:g} of the visits;
  - *Karto* (slam_toolbox): every beam counts, the cell of its end as passed twice; more than {KARTO_PASSES} passes,
    hits of more than {KARTO_RATIO:g} of them;
  - *Cartographer*: log-odds, each cell once per sweep, hit {CARTOGRAPHER_HIT:g}, miss {CARTOGRAPHER_MISS:g}, kept
    within {CARTOGRAPHER_CLAMP[0]:g} and {CARTOGRAPHER_CLAMP[1]:g};
  - *OctoMap*: the same with hit {OCTOMAP_HIT:g}, miss {OCTOMAP_MISS:g}, occupied above even odds.
"""

MATCHED = """## Maps by matched paths

`--pose match` on the same logs, whose poses it does not look at. The scene begins at the origin, heading along x, as the
world of a matched path does, so neither path nor map has to be moved to be compared.
"""

PATHS = f"""## Paths from the sweeps themselves

How far matched paths are from the true ones, on these and further drives. The **error** is that of the step over
{STRETCH:g} m of the true way (half of it where all of it is shorter), from every sweep on: of its place as a share of
the way, and of its heading. *Length* is the distance from one end of such a step to the other in the matched path, as a
share of the true one: where it is not 1 the two measure in other units. *Loop* is the error of the place at every sweep,
with the first pose in common: loops are not closed, so it is what the whole way has gathered. Sweeps that *may slide*
see nothing that fixes the place along some direction, and have no pose if that lasts; *lost* counts how often the map
began anew. The time is that of a processor for the matching alone.

With *{TOLD}* the search begins where odometry leads, which drifts by {100 * DRIFT:g} cm and
{np.degrees(DRIFT * YAW_DRIFT):.1f}° (standard deviations for a metre of way): so the program uses told poses that fit the
sweeps in part. A *straight corridor* has no doors and no things, and its ends are out of reach: every sweep but the
first slides.
"""

ROLLING = f"""## Sweeps that take their time

The same buildings at {scenes.FAST:g} m/s, where a sweep takes the whole tenth of a second: the robot goes
{100 * scenes.FAST / scenes.RATE:g} cm and turns by some degrees while it looks around. Beside the F1 of the map stand
how thick the walls are, in occupied cells for each metre of true wall that the map has (a true map has 20), and how
far the boxes that `detect` finds of standing boxes and cylinders are from the middle of all boxes of the same thing in
the world. Boxes differ anyway by the side that they are seen from: the first row of each drive, where sweeps take no
time, is the measure.
"""

AGENTS = """## Without what moves

`--without agents` follows things as `lidarcli track` does and leaves out the hits on what moved. The detection takes
fewer than three beams for noise, and at one degree from beam to beam a leg has three of them up to about 2 m: what
leaves ghosts is mostly farther away, where nothing is there to be followed. Cells that people have left, in all drives:
"""

SPEED = """## Speed and memory

In one process, cells of 5 cm, every sweep counts, on the machine of the run; rounded to one digit, as machines differ:
"""

REAL = """Public recordings; they are no part of this project, and `LIDARCLI_REAL_LOGS` names their folder. There is no true
map of them: these are the maps of all logs, by told poses or by a matched path, and two of them to look at.
"""

REAL_PATHS = f"""### Their paths

Matched paths of all recordings of which something else tells where the sensor was; columns as above.

- *Gazebo*: the odometry of the simulator.
- *Motion capture*: of the car that carries the sensor ([datmo](https://github.com/kostaskonkk/datmo)), by a clock of its
  own. The laser sits {-100 * MOUNT:g} cm behind what is followed; the delay and the turn of the mount are those by
  which the path fits best over {SHORT:g} m.
- *SLAM*: logs of CARMEN, corrected by loop closure ([ple](https://github.com/acschaefer/ple)). Most have a sweep for each
  metre, and several have no stamps to speak of. The corrected poses are taken for the truth, and nothing but the sweeps
  is used here.
"""

LIMITS = """## Limits

- The buildings are drawn by the same project that is measured. Walls are straight and stand square to each other;
  there is no glass, and no door opens or shuts.
- The published rules are re-implementations, fed with the same true poses; their own programs correct poses on the way.
  Cartographer's probabilities are not rounded to 15 bits here.
- A true map with every cell that any sweep sees asks for much where rooms are only glimpsed: see the shares above.
- Corrected poses and motion capture are not the truth: where the *length* is not 1, walls and truth disagree.
"""
