"""What docs/tracking.md says beside its numbers."""

from __future__ import annotations

from benchmarks.tracking import by_eye, cells, real
from benchmarks.tracking.methods import AGENT_SPEED, ORACLE, OURS
from benchmarks.tracking.scoring import LEAST


def title(method: str) -> str:
    """The name of a method in a table."""
    return {OURS: OURS, ORACLE: "*truth about each object*"}.get(method, f"{method} rules")


HEAD = f"""# Tracking

The rules are in [the formalism](formalism.md#over-time).
How well are things followed, how well is their motion told, and where does it fail? `make tracking` measures it, on
real logs first, and writes this page; no number here is typed by hand. The same seeds give the same scenes and noise:

```sh
{{command}}
```

The constants of the tracker were chosen on scenes with other seeds (from {cells.TUNING} on), and those of set A on some
real logs, too; what is reported of drawn scenes begins with seed {{first:,}}. Everything runs with default options;
nothing is tuned to a sensor, a noise or a kind of scene.
"""

SCENES = f"""## The scenes

`benchmarks.scenes.moving` draws them, 300 to 400 sweeps each, ten a second.

- **Rooms** with up to two doorways and 3–10 bodies, of which at least two move;
- **halls** open to infinity with 12–25 bodies that hide each other;
- **crossings** of two corridors: who comes round a corner was hidden;
- **people**: a room with 4–8 walkers on two legs, the standing one of which stands.

Bodies are boxes (some turn as they go), cylinders and plants. Movers go at 0.15–1.5 m/s through waypoints, start
and stop with 2 m/s², turn and pause; none touches another, and none appears or is gone in mid-air.

The sensor is *parked* (the log has no poses), *driving* with true poses, or *drifting*: driving with poses that
are {cells.DELAY:g} s late and drift by {100 * cells.DRIFT:g} % of the way. It has 361 beams over a closed ±180°, 720 over
[0°, 360°) or 1081 over 270°; noise of σ 0, 1 or 3 cm with 0, 0.3 or 1 % of the beams lost. Two faults are tried
apart from these: *flicker*, where {100 * cells.FLICKER:g} % of the beams that would hit something return
nothing, in runs and most where it is far or dark, and *rolling* sweeps that take the whole tenth of a second. That
makes {{cells}} cells of {{seeds}} logs with seeds of their own, {{logs}} in all.
"""

METHODS = f"""## What is compared

All follow the same objects, those of `detect` with its defaults.

- **lidarcli**: the columns `track`, `vx`, `vy` and `set` of `lidarcli track`.
- *The truth about each object*: every object belongs to the entity that most of its beams hit. What is missing
  there is the detection's, and no tracker can do better.
- Rules of published trackers, written anew from their code, with their default constants, at the log's own rate:
  - *leg_tracker* (Leigh et al. 2015): best assignment in all, constant velocity, an end by uncertainty; two slim
    tracks that walk together become a person, which may take two objects. A width takes the place of its decision
    trees, and all places count as free;
  - *obstacle_detector* (Przybyła 2017): least distance of place and radius with fusion and fission, filters that
    are corrected a hundred times a second with the last measurement, 2 s of life;
  - *dynamic_obstacle_detector* (robotics-upo): nearest free object within 0.55 m, constant velocity, 1 s of life;
  - *datmo* (Konstantinidis): nearest centroid within 0.25 m, constant acceleration of a corner, ended by the
    first miss. The corner nearest to the predicted one is taken, which spares it jumps;
  - *SORT* (Bewley et al. 2016): overlap of upright boxes, a filter per sweep, three sightings, one miss.

  They have no set A: their rows count as A from {AGENT_SPEED:g} m/s on, the limit of dynamic_obstacle_detector.
"""

MEASURES = f"""## What is measured

Tracks and entities are compared by their **beams**: the similarity of a track and an entity in a sweep is the
number of beams that they share, as a share of all beams of either. All objects of a track in a sweep are one set
of beams, so that a body in two parts, or a person on two legs, is asked to be one track. On this stand HOTA (mean
of 19 thresholds) with its parts DetA and AssA; IDF1, MOTA and switches from a similarity of one half on. The code
gives the figures of py-motmetrics and TrackEval on a recorded case (`tests/benchmarks/test_tracking_metrics.py`).
An entity is asked for in the sweeps in which some object is mostly of it: what is not detected cannot be
followed. *HOTA of all* also asks for the others that {LEAST} beams hit. Tracks on pieces of wall count against a
method.

A mean is that of all logs, a worst cell the one with the worst mean of its logs. **Velocity** is compared in the
rows of what *moves* in that sweep, starts and stops among them, of what has moved and is *paused*, and of what
*stands* all the time. **Movers in A**: of the rows of what goes with at least {cells.SLOW:g} m/s in that sweep or did
before, the share in set A. **Standing in A**: of the rows of what never moves in its log, pieces of wall among
them, the share in set A.
"""

BY_EYE = f"""Public recordings; they are no part of this project, and `LIDARCLI_REAL_LOGS` names their folder. They are
followed with default options, with corrected poses where a log has them.

Set A is to hold what moves or has moved. The rows (objects of one sweep) of each log were judged *{by_eye.MOVER}*,
*{by_eye.STATIC}* or *unclear* by eye, on maps, close-ups and places over time; the judgements are in
`benchmarks/annotations/movers_*.parquet`, by the beams of each row. A row in set A has the verdict of the judged row that
shares most beams with it, at least {100 * by_eye.LEAST_SHARED:.0f} %; others are not judged. In logs where nothing
moves every row in set A is wrong. A track counts when it is in set A for {by_eye.LEAST_SECONDS:g} s or in
{by_eye.LEAST_SWEEPS} sweeps: it moves when most of its judged rows do. A mover's track is one that an earlier tracker had
in set A for as long; it is found when half of its rows are. In brackets: 95 % intervals in percent, by drawing whole
recordings with replacement, where at least {by_eye.LEAST_LOGS} count.

**One judge**, so errors of the eye are the same everywhere. In a second look by the same judge at 47 random rows of the
logs that nobody tuned on, without the verdicts shown, 46 agreed and one could not be told. Marks of legs by the authors of
leg_tracker, which the judge had not used, lie on rows judged movers (414 of 419) and on none judged static.
"""

SETS: dict[by_eye.Set, str] = {
    "untouched": """### Logs that nobody tuned on

{logs} of {all} logs and stretches were at hand. No constant was chosen on them and no rule made by these judgements; that
set A loses no rows of people was looked at in demo, positive_2, positive_3 and the log outdoors while the rules were made.
Rows outside of set A were judged, too, most static ones by how often other sweeps hit their place. In {empty} of the logs
nothing is in set A, and nothing should be.

The places are few: `positive_*` are of one, `sea_me_coss` of one. Only fhw (a crowd, a sweep each 1.6 s) and the two
stretches outdoors, where no path is known, show people to a sensor that drives. No door, cart or second robot moves. Nearly
half of all rows of movers are of one log, so look at the logs one by one before the sum.
""",
    "chosen": """### Logs that constants were chosen on

The weights of an agent's score come from these judgements and from drawn scenes: the figures say how well they fit, not
how well they will do. {logs} of {all} logs were at hand; in {empty} of them nothing is in set A, and nothing was judged to
move. Only rows that an earlier tracker had put into set A were judged, so that recall is of the movers that it found. Two
faults of the judgements are known and left: one track of obstacle_detector, 151 rows called movers, mixes in the legs of
chairs; and half of the sweeps of zcoakley/fsm have no pose, so that its movers can hardly be told.
""",
}

REAL = f"""### A car and legs of people

A car, and the sensor on another one, by the motion capture of [datmo](https://github.com/kostaskonkk/datmo). The
sensor's mount ({real.MOUNT:g} m) and the delay of its sweeps ({real.DELAY:g} s) are given. An object within
{real.ON_CAR:g} m of the car's place is the car, one further than {real.BESIDE:g} m away another thing; other things
stand, as far as is known.

Legs of people are labelled by the authors of [leg_tracker](https://github.com/angusleigh/leg_tracker)
(`positive_*_extracted.bag`), without telling which leg is whose.
"""

LIMITS = """## Limits

- Who moves on real logs is judged by one judge, and where a sensor drives among people there are few such logs.
- The scenes are drawn by the same project that is measured. Nothing in them touches another thing, there are no
  curtains, glass or mirrors, and a sensor drives only in rooms and halls.
- The published rules are re-implementations, fed with detections that are not theirs; their own programs may do
  better with their own detections, and people's trackers are meant for people.
- The velocity of a box that turns is that of its centre, which a sensor never sees.
- The recordings with the car are few and short, and other things beside it may have moved.
"""
