"""What docs/maps.md says beside its numbers."""

from __future__ import annotations

import numpy as np

from benchmarks.maps import scenes
from benchmarks.maps.figures import EVERY, MOVED
from benchmarks.maps.paths import STRETCH
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
from lidarcli.formalism.mapping.grid import MIN_TURN, PAUSE_NS
from lidarcli.options.choices import MIN_MOVE

TUNING, REPORTING = 0, 80_000
"""First seeds of drives that constants may be chosen on, and of what is reported."""

HEAD = f"""# How right the maps are

How right are the maps of [`lidarcli map`](map.md) and the paths that are matched from the sweeps? `make maps` measures it,
with default options, and writes this page; constants may be looked at on drives from seed {TUNING} on
(`make maps MAPS="--tune"`), those reported begin with seed {{first:,}}:

```sh
{{command}}
```
"""

WHY = """The true map has every cell that any beam of any sweep would hit, also in rooms that are only glimpsed in
passing. What people leave are cells that few sweeps see, of which a few in a row hit a leg that stands for a moment.

"""

SCENES = f"""## The drives

`benchmarks/maps/scenes.py` draws them: {scenes.SWEEPS:,} sweeps, {scenes.RATE:g} a second, of {scenes.SENSOR.beams}
beams over a closed turn up to {scenes.SENSOR.range_max:g} m, noise of σ {100 * scenes.NOISE:g} cm, mixed pixels at
{100 * scenes.MIXED:g} % of the edges, {100 * scenes.LOST:g} % lost. A robot drives one loop of 59 to 73 m, in
**corridors** (a ring with rooms on both sides that are only glimpsed) or through two rows of three **rooms**; up to
{scenes.PEOPLE} people walk about. The true map is that of `lidarcli simulate --map`.
"""

RULES = f"""## Maps with true poses

A cell is right where an occupied one of the other map is at most a cell away. **Ghosts** are wrong cells within
{100 * GHOST:g} cm of where a leg was. Cells of 5 cm, with *{EVERY}* or the *{MOVED}* (one for each {MIN_MOVE:g} m,
{np.degrees(MIN_TURN):g}° or {PAUSE_NS / 1e9:g} s). Beside lidarcli stand rules of published programs, written anew
with their default constants: *gmapping* (hits of more than {GMAPPING_RATIO:g} of the visits), *Karto* of slam_toolbox
(more than {KARTO_PASSES} passes, hits of more than {KARTO_RATIO:g}), *Cartographer* (log-odds, hit
{CARTOGRAPHER_HIT:g}, miss {CARTOGRAPHER_MISS:g}, kept within {CARTOGRAPHER_CLAMP[0]:g} and
{CARTOGRAPHER_CLAMP[1]:g}), *OctoMap* (hit {OCTOMAP_HIT:g}, miss {OCTOMAP_MISS:g}).
"""

PATHS = f"""## Paths from the sweeps themselves

The **error** is that of the step over {STRETCH:g} m of the true way, as a share of it, and of its heading. Where
*length* is not 1, the two measure in other units. Sweeps that *may slide* see nothing that fixes the place along some
direction; *lost* counts how often the map began anew. No loop is closed.
"""

AGENTS = """## Without what moves

Cells that people have left, in all drives. At one degree from beam to beam a leg has three beams up to about 2 m:
ghosts are mostly farther away, where nothing is there to be followed.
"""

REAL = f"""Public recordings of which something else tells where the sensor was: the odometry of *Gazebo*; *motion capture*
of the car that carries the sensor ([datmo](https://github.com/kostaskonkk/datmo); the laser sits {-100 * MOUNT:g} cm
behind what is followed, delay and turn of the mount are those that fit best over {SHORT:g} m); *SLAM*, logs of CARMEN
corrected by loop closure ([ple](https://github.com/acschaefer/ple)), most with a sweep for each metre, several without
stamps to speak of.
"""

LIMITS = """## Limits

- The buildings are drawn by the same project that is measured: straight walls, no glass, no door that opens.
- The published rules are re-implementations, fed with true poses; their own programs correct poses on the way.
- Corrected poses and motion capture are not the truth: where the *length* is not 1, walls and truth disagree.
"""
