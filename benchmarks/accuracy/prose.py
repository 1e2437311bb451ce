"""What docs/accuracy.md says beside its figures."""

HEAD = """# Accuracy

How right is the detection, and where does it fail? `make accuracy` measures it, with default options, and writes this page:

```sh
{command}
```

The trees that tell objects from walls are grown (`make trees`) on judged sweeps and on scenes with other seeds (below
2,000); the scenes reported here begin with seed {first:,}, and each real log is reported by trees that have seen no log of
its recorder.
"""

SCENES = """## Drawn scenes

![A room, a corridor and a hall, with what profile robust finds in them](images/accuracy-scenes.png)

Rooms of 4–10 m, corridors of 15–40 m and halls (`benchmarks.scenes.random`) with boxes, cylinders, poles and plants that
touch nothing; 361 beams over 360°, 720 over 360°, 1081 over 270°; noise of σ 0, 1 or 3 cm with 0, 0.3 or 1 % of the beams
lost: 27 cells of {scenes} sweeps, {sweeps} in all; {legged} scenes of each kind with legged objects.

A detection is right when 70 % of its beams hit one entity that is no wall. An entity that at least 3 beams hit is found
when one right detection holds half of them.

Beside it stand published segmentations, reimplemented from their formulas, of what has 3 points and is at most 2 m wide:
*fixed 0.3 m*; *0.1 m + 0.00628 r* (Przybyła 2017); *Dietmayer* (2001); *Borges & Aldon* (2004); *DBSCAN(0.3, 3)* by
scikit-learn. *paper* is the profile of that name; the line below it adds the same filter.
"""

BUILDINGS = """Corridors and rooms with pilasters, niches, door leaves and objects against the walls
(`benchmarks.scenes.building`), {scenes} sweeps of each kind by each sensor. Good sensors: σ 1 cm, 0.3 % of the beams lost.
Cheap ones: noise of 5 mm and 5 mm for each metre, mixed pixels at half of the edges, 8 % that flicker.

"""

DRIVEN = """The same by a sensor that drives {way:g} m within {sweeps} sweeps, with its poses:

"""

REAL = """### Labels of others

Legs of people, labelled by the authors of [leg_tracker](https://github.com/angusleigh/leg_tracker)
(`positive_*_extracted.bag`): the share of the labelled legs with the centroid of a detection near.
"""

LIMITS = """## Limits

- The scenes are drawn by the same project that is measured: no curtains, glass or mirrors.
- Nothing tells a box from a short free-standing piece of wall, or an object that fills a doorway from the wall.
- Of objects hit by 3 or 4 beams more are missed than of others; their shape is `unknown`, their box the chord.
- One detection per leg: without `--group-gap` a chair is several objects.
- The baselines have no notion of a wall; a map of the walls would help them as it would help any method.
"""
