"""What docs/accuracy.md says beside its figures."""

HEAD = """# Accuracy

How right is the detection, and where does it fail? `make accuracy` measures it and writes this page; no number here
is typed by hand. The same seeds give the same scenes and the same noise:

```sh
{command}
```

The trees that tell things from building are grown (`make trees`) on scenes with other seeds (below 2,000) and on judged
sweeps; drawn scenes that are reported here begin with seed {first:,}, and each real log is reported by trees that have
seen no log of its recorder. A score is that of the options' defaults; nothing is tuned to a sensor, a noise or a kind of
scene.
"""

SCENES = """## The scenes

![A room, a corridor and a hall, with what profile robust finds in them](images/accuracy-scenes.png)

`benchmarks.scenes.random` draws them; a seed is a scene of each kind.

- **Rooms** of 4–10 m, some L-shaped, with up to two doorways of 0.8–1.2 m that open into nothing; 3–10 things, a
  third of them boxes standing 10–40 cm from a wall.
- **Corridors** 15–40 m long and 1.5–3 m wide, seen at grazing incidence, with doorways of about a metre on both sides
  that open into nothing or into side rooms; boxes 15–35 cm from the wall, poles of 4–12 cm, a few other things.
- **Halls**, open to infinity or with up to three walls, with 15–40 things that hide each other.

Things are boxes (sides of 0.15–1.2 m), cylinders (radius 0.1–0.4 m), poles (2–6 cm) and plants (ragged stars of
0.2–0.45 m). They touch neither each other (15 cm) nor the walls. The sensors: 361 beams over a closed ±180°, 720 over
[0°, 360°), 1081 over 270°. The faults: noise of σ 0, 1 or 3 cm with 0, 0.3 or 1 % of the beams lost, half as inf and
half as NaN. That makes 27 cells of {scenes} sweeps, {sweeps} in all; {legged} scenes of each kind for the tables with
legged things.

**Score.** A detection is right when 70 % of its beams hit one entity that is no wall. An entity that at least 3 beams
hit is found when one right detection holds half of them. Precision is the share of right detections, recall the share
of found entities, F1 their harmonic mean.

**Compared with** published segmentations, reimplemented from their formulas. All but the last break a sweep where the
distance between consecutive valid points exceeds a threshold, and close the seam of a full turn. What has at least 3
points and extends no further than 2 m in any direction is a detection:

- *fixed 0.3 m*;
- *0.1 m + 0.00628 r*, of the range r (Przybyła, Detection and tracking of 2D geometric obstacles from LRF data,
  2017);
- *Dietmayer*: 0.3 m + √(2 (1 − cos Δθ)) min(r₁, r₂) (Dietmayer, Sparbert, Streller 2001);
- *Borges & Aldon*: r₁ sin Δθ / sin(10° − Δθ) + 3 · 3 cm (Borges, Aldon 2004);
- *DBSCAN(0.3, 3)* of the points (Ester et al. 1996), by scikit-learn.

*paper* is this project's profile of that name, the formulas as printed; the line below it adds the same filter of 3
beams and 2 m.
"""

BUILDINGS = """`benchmarks.scenes.building` draws corridors and rooms of thick walls in pieces of 0.25–4 m between
doorways, with pilasters, niches, radiators, skirting and door leaves, side rooms behind, and things that stand square to
the walls, close to them or against them: {scenes} sweeps of each kind by each sensor. Good sensors: σ 1 cm, 0.3 % of the
beams lost. Cheap ones: noise of 5 mm and 5 mm for each metre, steps of 5 mm, half of the beams at edges between both
surfaces, 8 % that flicker.

"""

DRIVEN = """The same buildings by a sensor that drives {way:g} m within {sweeps} sweeps, with its poses, over all sweeps:

"""

REAL = """Public recordings whose labels are not ours; they are no part of this project, and `LIDARCLI_REAL_LOGS` names
their folder.

Legs of people, labelled by the authors of [leg_tracker](https://github.com/angusleigh/leg_tracker)
(`positive_*_extracted.bag`): the share of the labelled legs that have a detection's centroid near. Two feet that
touch are one thing to a geometric detector, and its centroid lies between them.
"""

LIMITS = """## Limits

- The scenes are drawn by the same project that is measured. They hold no curtains, glass, mirrors, mixed pixels,
  moving sensors or sloping floors. The real recordings are few and their labels narrow.
- Nothing tells a box from a short free-standing piece of wall, or a thing that stands in a doorway and fills it from
  the wall; where a thing is hidden on both sides, only its line shows that it is no wall behind.
- Of things hit by 3 or 4 beams more are missed than of others (see the table by beams); their shape is `unknown`, and
  their box is the chord of what was hit.
- One detection per leg: without `--group-gap` a chair is several objects.
- The baselines have no notion of a wall. Their precision in rooms and corridors is that of their width limit; a map
  of the walls would help them as it would help any method.
"""
