"""What docs/tracking.md says beside its numbers."""

from __future__ import annotations

from benchmarks.tracking import by_eye, cells, real
from benchmarks.tracking.methods import AGENT_SPEED, ORACLE, OURS
from benchmarks.tracking.scoring import LEAST


def title(method: str) -> str:
    """The name of a method in a table."""
    return {OURS: OURS, ORACLE: "*truth about each object*"}.get(method, f"{method} rules")


HEAD = """# Tracking

How well are objects followed and their motion told, and where does it fail? `make tracking` measures it, with default
options, and writes this page ([the rules](formalism.md#over-time)):

```sh
{command}
```

The constants of the tracker were chosen on scenes with other seeds, and those of set A on some real logs, too; the drawn
scenes reported here begin with seed {first:,}.
"""

SCENES = f"""## Drawn scenes

`benchmarks.scenes.moving` draws **rooms** with 3–10 bodies, **halls** with 12–25, **crossings** of two corridors, and
**people**: 4–8 walkers on two legs. Movers go at 0.15–1.5 m/s, start, stop and turn. The sensor is *parked*,
*driving* with true poses, or *drifting*: {cells.DELAY:g} s late, by {100 * cells.DRIFT:g} % of the way. It has 361
beams over 360°, 720 over 360° or 1081 over 270°; noise of σ 0, 1 or 3 cm with 0, 0.3 or 1 % of the beams lost. Two
faults are apart: {100 * cells.FLICKER:g} % of the beams *flicker*, and *rolling* sweeps take a tenth of a second.
{{cells}} cells of {{seeds}} logs, {{logs}} in all.
"""

METHODS = f"""All follow the same objects, those of `detect`. *The truth about each object*: every object belongs to
the entity that most of its beams hit; no tracker can do better. Beside it stand rules of published trackers, written
anew from their code with their default constants: *leg_tracker* (Leigh et al. 2015), *obstacle_detector* (Przybyła
2017), *dynamic_obstacle_detector* (robotics-upo), *datmo* (Konstantinidis), *SORT* (Bewley et al. 2016). They have no
set A: their rows count as A from {AGENT_SPEED:g} m/s on.
"""

MEASURES = f"""Tracks and entities are compared by the **beams** that they share. HOTA is the mean of 19 thresholds,
with its parts DetA and AssA; IDF1, MOTA and switches are from a similarity of one half on, as py-motmetrics and
TrackEval have them. An entity is asked for in the sweeps in which some object is mostly of it; *HOTA of all* also
asks for the others that {LEAST} beams hit. A worst cell is the one with the worst mean of its logs. **Movers in A**:
of the rows of what goes with at least {cells.SLOW:g} m/s in that sweep or did before. **Standing in A**: of the rows
of what never moves.
"""

BY_EYE = f"""Set A is to hold what moves or has moved. The rows (objects of one sweep) of public recordings were
judged *{by_eye.MOVER}*, *{by_eye.STATIC}* or *unclear* by eye (`benchmarks/annotations/movers_*.parquet`). A row in
set A has the verdict of the judged row that shares most beams with it, at least {100 * by_eye.MIN_SHARED:.0f} %. A
track counts when it is in set A for {by_eye.MIN_SECONDS:g} s or in {by_eye.MIN_SWEEPS} sweeps: it moves when most
of its judged rows do. A mover's track is one that an earlier tracker had in set A for as long; it is found when half
of its rows are. In brackets: 95 % intervals in percent, by drawing whole recordings, where at least
{by_eye.MIN_LOGS} count.

**One judge**: in a second look at 47 random rows, without the verdicts shown, 46 agreed and one could not be told. Marks of
legs by the authors of leg_tracker lie on rows judged movers (414 of 419) and on none judged static.
"""

SETS: dict[by_eye.Set, str] = {
    "untouched": """### Logs that nobody tuned on

{logs} of {all} logs and stretches were at hand. No constant was chosen on them and no rule made by these judgements; that
set A loses no rows of people was looked at in demo, positive_2, positive_3 and the log outdoors while the rules were made.
In {empty} of the logs nothing is in set A, and nothing should be.

The places are few: `positive_*` are of one, `sea_me_coss` of one. Only fhw (a crowd, a sweep each 1.6 s) and the two
stretches outdoors, where no path is known, show people to a sensor that drives. No door, cart or second robot moves. Nearly
half of all rows of movers are of one log.
""",
    "chosen": """### Logs that constants were chosen on

The weights of an agent's score come from these judgements and from drawn scenes. {logs} of {all} logs were at hand; in
{empty} of them nothing is in set A, and nothing was judged to move. Only rows that an earlier tracker had put into set A
were judged, so that recall is of the movers that it found. Known faults: one track of obstacle_detector, 151 rows called
movers, mixes in the legs of chairs; half of the sweeps of zcoakley/fsm have no pose.
""",
}

REAL = f"""### A car and legs of people

A car, and the sensor on another one, by the motion capture of [datmo](https://github.com/kostaskonkk/datmo); the mount
({real.MOUNT:g} m) and the delay ({real.DELAY:g} s) of the sensor are given. An object within {real.ON_CAR:g} m is the car,
one further than {real.BESIDE:g} m away another one, which stands. Legs of people are labelled by the authors of
[leg_tracker](https://github.com/angusleigh/leg_tracker), without telling which leg is whose.
"""

LIMITS = """## Limits

- One judge; few logs of a sensor that drives among people.
- The scenes are drawn by the same project that is measured. Nothing in them touches another body, and there are no
  curtains, glass or mirrors.
- The published rules are re-implementations, fed with detections that are not theirs.
- The recordings with the car are few and short, and what stands beside it may have moved.
"""
