"""What is measured on simulated drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.maps.figures import (
    DESKEWED,
    EVERY,
    INSTANT,
    MOVED,
    OURS,
    SKEWED,
    WITHOUT_AGENTS,
    Made,
    Matched,
    Rolled,
    Way,
)
from benchmarks.maps.program import find_objects, make_map
from benchmarks.maps.recordings import RESOLUTION, Drive, new_sweeps, record_drive, write_drive
from benchmarks.maps.rules import counts_of, maps_by_rules, maps_once
from benchmarks.maps.scenes import FAST, ROLLING, SENSOR, Kind, drive, fastest_turn, length, walkers
from benchmarks.maps.scoring import score
from lidarcli.options.choices import MIN_MOVE
from lidarcli.simulation.scene import Scene
from lidarcli.sweeps.types import Float64

STANDING = ("box", "cylinder")
"""Kinds of things whose boxes are looked for."""
LEAST = 10
"""Sightings that a thing needs."""
FARTHEST = 0.5
"""A box farther from the middle of all boxes of its thing is that of something else, too [m]."""


def measure_way(kind: Kind, seed: int, folder: Path) -> tuple[Way, list[Made], Matched, Drive]:
    """Everything of one drive with sweeps in an instant; its log stays in the folder."""
    scene = drive(kind, seed)
    driven = record_drive(scene, seed)
    log = folder / f"{kind}-{seed}.mcap"
    write_drive(driven, log)
    taken = {EVERY: new_sweeps(driven, 0.0), MOVED: new_sweeps(driven, MIN_MOVE)}
    calm = record_drive(_calm(driven), seed)
    seen = counts_of(calm.beams, taken[MOVED], RESOLUTION)
    once, twice = (score(seen.occupancy(hits, 0.0, "map"), driven.true, driven.walked).recall for hits in (1, 2))
    way = Way(
        kind,
        seed,
        length(scene),
        scene.sweeps,
        int(taken[MOVED].sum()),
        len(walkers(scene)),
        driven.true.occupied,
        once,
        twice,
    )
    made = []
    for name, rows in taken.items():
        every = ("--min-move", "0") if name == EVERY else ()
        maps = {
            OURS: make_map(log, *every),
            WITHOUT_AGENTS: make_map(log, "--without", "agents", *every),
            **maps_by_rules(driven.beams, rows, RESOLUTION),
            **maps_once(driven.beams, rows, RESOLUTION),
        }
        made += [Made(way.name, rule, name, score(grid, driven.true, driven.walked)) for rule, grid in maps.items()]
    matched = Matched(way.name, score(make_map(log, "--pose", "match"), driven.true, driven.walked))
    return way, made, matched, driven


def _calm(driven: Drive) -> Scene:
    """The building alone, and a perfect sensor."""
    sensor = replace(driven.scene.sensor, noise=0.0, lost=0.0, mixed_pixels=0.0)
    standing = tuple(entity for entity in driven.scene.entities if entity.motion.still)
    return replace(driven.scene, sensor=sensor, entities=standing)


def measure_rolling(kind: Kind, seed: int, folder: Path) -> list[Rolled]:
    """The same building at 1 m/s: with sweeps in an instant, and with such that take the whole time, seen either way."""
    found = []
    for sensor, cases in ((SENSOR, {INSTANT: ()}), (ROLLING, {DESKEWED: (), SKEWED: ("--no-deskew",)})):
        scene = drive(kind, seed, sensor, FAST)
        driven = record_drive(scene, seed)
        log = folder / f"fast-{kind}-{seed}-{len(cases)}.mcap"
        write_drive(driven, log)
        for name, options in cases.items():
            things, off = scatter(driven, log, *options)
            found.append(
                Rolled(
                    f"{kind} {seed}",
                    name,
                    fastest_turn(scene),
                    score(make_map(log, *options), driven.true, driven.walked),
                    things,
                    float(np.median(off)) if len(off) else float("nan"),
                    float(np.sqrt(np.mean(off**2))) if len(off) else float("nan"),
                )
            )
    return found


def scatter(driven: Drive, log: Path, *options: str) -> tuple[int, Float64]:
    """Number of standing things, and how far each box is from the middle of all boxes of its thing in the world [m]."""
    objects, beams = find_objects(log, *options)
    entities = driven.scene.entities
    wanted = np.array([entity.kind in STANDING for entity in entities])
    held = np.flatnonzero(beams["object"].is_valid().to_numpy())
    sweep, beam, number = (beams[name].to_numpy()[held].astype(np.int64) for name in ("sweep", "beam", "object"))
    # The entity that most beams of each object hit.
    most = len(entities) + 1
    key = (sweep << 20) + number
    pairs, hits = np.unique(key * most + driven.entity[sweep, beam] + 1, return_counts=True)
    order = np.lexsort((-hits, pairs // most))
    objects_, first = np.unique(pairs[order] // most, return_index=True)
    entity = dict(zip(objects_.tolist(), (pairs[order][first] % most - 1).tolist(), strict=True))
    places: dict[int, list[tuple[float, float]]] = {}
    columns = (objects[name].to_numpy() for name in ("sweep", "object", "world_x", "world_y"))
    for at, which, x, y in zip(*columns, strict=True):
        thing = entity.get((int(at) << 20) + int(which), -1)
        if thing >= 0 and wanted[thing] and np.isfinite(x):
            places.setdefault(thing, []).append((x, y))
    away = []
    for boxes in places.values():
        off = np.hypot(*(np.array(boxes) - np.median(boxes, axis=0)).T)
        off = off[off <= FARTHEST]
        if len(off) >= LEAST:
            away.append(off)
    return len(away), np.concatenate(away) if away else np.empty(0)
