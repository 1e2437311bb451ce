"""docs/accuracy.md from the figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.accuracy import boxes, driven, real
from benchmarks.accuracy.cells import BUILDING_CELLS, CELLS, THINGS, Cell, Things
from benchmarks.accuracy.figures import Figures
from benchmarks.accuracy.methods import GROUP_GAP, ROBUST
from benchmarks.accuracy.objects import MISSED, SHAPE_BEAMS, Tally, total
from benchmarks.accuracy.prose import BUILDINGS, DRIVEN, HEAD, LIMITS, REAL, SCENES
from benchmarks.accuracy.scoring import BEAMS
from benchmarks.annotations import page as by_eye
from benchmarks.scenes import building
from benchmarks.scenes.random import FAULTS, KINDS, SENSORS
from lidarcli.formalism import SHAPES
from lidarcli.sweeps.types import Int64

BEGIN, END = "<!-- real recordings: begin -->", "<!-- real recordings: end -->"
KEPT = "*The recordings were not at hand in the last run; these figures are those of an earlier one.*"
NEVER = "*Not measured: set LIDARCLI_REAL_LOGS to the folder of the recordings.*"
SHOWN_METHODS = (ROBUST, "fixed", "Dietmayer")
"""How the methods begin that the page shows on scenes like buildings and on legged objects; a terminal shows all."""
SHOWN_NOISE = 0.01
"""[m] Noise of the boxes that the page shows."""
SHOWN = ("prismatic", "round", "legged", "irregular", "unknown")
EXPECTED = {
    "box": "prismatic",
    "cylinder": "round",
    "pole": "round",
    "plant": "irregular",
    "person": "legged",
    "chair": "legged",
    "table": "legged",
    "ladder": "legged",
}
PLURAL = {"room": "rooms", "corridor": "corridors", "hall": "halls", "passage": "corridors", "chamber": "rooms"}


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose first column is text and whose others are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def page(figures: Figures, before: str) -> str:
    """The whole page; `before` is the page as it was, whose real recordings are kept when there are no new ones."""
    parts = [
        HEAD.format(command=figures.command, first=figures.first_seed),
        "## On real logs\n",
        _real(figures, before),
        SCENES.format(
            first=figures.first_seed,
            scenes=figures.scenes,
            sweeps=f"{figures.scenes * len(CELLS):,}",
            legged=figures.legged_scenes,
        ),
        "## Objects\n",
        _summary(figures.tally, "plain"),
        "![F1 of every method in every cell](images/accuracy.png)\n",
        _buildings(figures.tally, figures.scenes, SHOWN_METHODS),
        _driven(figures.driven),
        _legged(figures.tally, SHOWN_METHODS),
        "## Shapes and boxes\n\n" + _right_shapes(figures.tally),
        _box_errors([result for result in figures.boxes if result.noise == SHOWN_NOISE]),
        LIMITS,
    ]
    return "\n".join(parts)


def summary(figures: Figures) -> str:
    """The figures alone, for a terminal."""
    tally = figures.tally
    return "\n".join(
        [
            _summary(tally, "plain"),
            _cells(tally),
            _buildings(tally, figures.scenes),
            _driven(figures.driven),
            _kinds(tally),
            _wrong(tally),
            _legged(tally),
            _shapes(tally),
            _boxes(figures.boxes, figures.box_sweeps),
            _cylinder(figures.cylinder),
            *([_legs(figures.legs), _cars(figures.cars)] if figures.legs and figures.cars else []),
        ]
    )


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def _summary(tally: Tally, things: Things, only: Sequence[str] = ()) -> str:
    rows = []
    for method in tally.methods(things):
        if only and not method.startswith(tuple(only)):
            continue
        scores = tally.of(things, method)
        f1 = [score.f1 for score in scores]
        by_kind = [
            _mean(score.f1 for cell, score in zip(CELLS, scores, strict=True) if cell.kind == kind) for kind in KINDS
        ]
        numbers = [
            _mean(f1),
            min(f1),
            _mean(score.precision for score in scores),
            _mean(score.recall for score in scores),
            *by_kind,
        ]
        name = f"**{method}**" if method == ROBUST else method
        rows.append([name, *(f"{number:.3f}" for number in numbers)])
    kinds = [PLURAL[kind] for kind in KINDS]
    return table(["method", "F1, mean", "F1, worst cell", "precision", "recall", *kinds], rows)


def _cells(tally: Tally) -> str:
    def entry(cell: Cell) -> str:
        score = tally.scores["plain", cell, ROBUST]
        return f"{score.f1:.3f} ({score.precision:.3f} / {score.recall:.3f})"

    rows = [
        [f"{PLURAL[kind]}, {sensor} beams"] + [entry(Cell(kind, sensor, noise, lost)) for noise, lost in FAULTS]
        for kind in KINDS
        for sensor in SENSORS
    ]
    head = ["", *(f"σ {100 * noise:.0f} cm, {100 * lost:g} % lost" for noise, lost in FAULTS)]
    return "Profile `robust` cell by cell, F1 (precision / recall):\n\n" + table(head, rows)


def _buildings(tally: Tally, scenes: int, only: Sequence[str] = ()) -> str:
    """Scenes like real buildings: every method by kind of scene and sensor."""
    faults = {"good sensors": False, "cheap sensors": True}
    groups = [
        (f"{PLURAL[kind]}, {name}", [cell for cell in BUILDING_CELLS if (cell.kind, cell.cheap) == (kind, is_cheap)])
        for kind in building.KINDS
        for name, is_cheap in faults.items()
    ]
    rows = []
    for method in tally.methods("plain"):
        if only and not method.startswith(tuple(only)):
            continue
        numbers = []
        for _, cells in groups:
            scores = tally.of("plain", method, cells)
            precision, recall = (_mean(getattr(each, name) for each in scores) for name in ("precision", "recall"))
            numbers.append(f"{precision:.2f} / {recall:.2f}")
        rows.append([f"**{method}**" if method == ROBUST else method, *numbers])
    return (
        "### Scenes like real buildings\n\n"
        + BUILDINGS.format(scenes=scenes)
        + table(["precision / recall", *(name for name, _ in groups)], rows)
    )


def _driven(found: driven.Driven) -> str:
    """The same buildings by a sensor that drives."""
    groups = sorted({group for group, _ in found}, reverse=True)
    head = ["precision / recall", *groups]
    return DRIVEN.format(sweeps=building.SWEEPS, way=building.WAY) + table(head, driven.rows(found))


def _classes() -> list[str]:
    ends = [f"{end - 1}" for end in BEAMS[1:]]
    return [*(f"{start}–{end}" for start, end in zip(BEAMS, ends, strict=False)), f"from {BEAMS[-1]}"]


def _kinds(tally: Tally) -> str:
    rows = []
    for kind in KINDS:
        counts = total(tally.scores["plain", cell, ROBUST] for cell in CELLS if cell.kind == kind)
        for number, thing in enumerate(THINGS):
            wanted, found = counts.entities[number], counts.found[number]
            if wanted.sum():
                rows.append(
                    [
                        f"{thing}, {PLURAL[kind]}",
                        f"{wanted.sum():,}",
                        f"{found.sum() / wanted.sum():.3f}",
                        *(f"{f / w:.3f}" if w else "–" for f, w in zip(found, wanted, strict=True)),
                    ]
                )
    head = ["entity", "number", "found", *(f"{beams} beams" for beams in _classes())]
    text = "Which entities profile `robust` finds, over all sensors and noises, and by the beams that hit them:\n\n"
    return text + table(head, rows)


def _wrong(tally: Tally) -> str:
    rows = []
    for method in tally.methods("plain"):
        counts = total(tally.of("plain", method))
        parts = int(counts.parts.sum())
        shares = [f"{100 * n / max(counts.detections, 1):.1f} %" for n in (counts.on_walls, counts.mixed, parts)]
        rows.append([method, f"{counts.detections:,}", *shares])
    head = ["method", "detections", "mostly wall", "more than one thing", "less than half of one"]
    text = (
        "What is wrong with the detections, as a share of all of a method's. Those that hold less than half of one\n"
        "thing count as right, but do not find it:\n\n"
    )
    return text + table(head, rows)


def _legged(tally: Tally, only: Sequence[str] = ()) -> str:
    return (
        "### With legged objects\n\n"
        "Scenes as above with persons (two legs), chairs, tables and ladders, each of which counts as one object,\n"
        f"which `--group-gap {GROUP_GAP:g}` asks for:\n\n" + _summary(tally, "whole", only)
    )


def _shapes(tally: Tally) -> str:
    text = (
        "## Shapes\n\n"
        f"Entities hit by at least {SHAPE_BEAMS} beams, and the shape of the detection that found them. Right are\n"
        "`prismatic` for boxes, `round` for cylinders and poles, `irregular` for plants; with `--group-gap\n"
        f"{GROUP_GAP:g}` `legged` for persons, chairs, tables and ladders.\n\n"
    )
    plain = {noise: tally.shapes["plain", noise] for noise, _ in FAULTS}
    whole = {noise: tally.shapes["whole", noise] for noise, _ in FAULTS}
    everything = sum(plain.values(), np.zeros_like(plain[0.0]))
    text += _matrix(everything, ("box", "cylinder", "pole", "plant"))
    text += "\n" + _matrix(sum(whole.values(), np.zeros_like(everything)), ("person", "chair", "table", "ladder"))
    return text + "\n" + _right_shapes(tally)


def _right_shapes(tally: Tally) -> str:
    rows = []
    for noise, _ in FAULTS:
        simple = _share_right(tally.shapes["plain", noise], ("box", "cylinder", "pole", "plant"))
        legged = _share_right(tally.shapes["whole", noise], ("person", "chair", "table", "ladder"))
        rows.append([f"σ {100 * noise:.0f} cm", f"{simple:.3f}", f"{legged:.3f}"])
    text = f"Share of the found entities hit by at least {SHAPE_BEAMS} beams whose shape is right:\n\n"
    return text + table(["", "plain", "legged"], rows)


def _matrix(counts: Int64, things: Sequence[str]) -> str:
    rows = []
    for thing in things:
        line = counts[THINGS.index(thing)]
        found = line[:MISSED].sum()
        right = line[SHAPES.index(EXPECTED[thing])] / found if found else 0.0
        shown = [f"{line[SHAPES.index(shape)]:,}" for shape in SHOWN]
        rows.append([thing, *shown, f"{line[MISSED]:,}", f"{right:.3f}"])
    return table(["entity", *SHOWN, "not found", "right of those found"], rows)


def _share_right(counts: Int64, things: Sequence[str]) -> float:
    rows = [THINGS.index(thing) for thing in things]
    right = sum(int(counts[row, SHAPES.index(EXPECTED[THINGS[row]])]) for row in rows)
    return right / max(int(counts[rows, :MISSED].sum()), 1)


def _boxes(results: Sequence[boxes.BoxResult], sweeps: int) -> str:
    low, high = boxes.SIZES
    near, far = boxes.DISTANCES
    text = (
        "## Corners, faces and boxes\n\n"
        f"{results[0].sweeps // sweeps} boxes with sides of {low} to {high} m that show two faces, their nearest corner "
        f"{near:g} to {far:g} m away, each\nface hit by at least {boxes.FACE_BEAMS} beams; {sweeps} sweeps of each. "
        f"A vertex is right within {100 * boxes.NEAR:.0f} cm of a true corner, one vertex\nfor one corner. *Corner* is the "
        "one between the two faces; *all three* also takes the far ends of both faces, where the\nlast beam on the box "
        "may lie a whole beam spacing before the edge.\n\n"
    )
    rows = [
        [
            f"{r.sensor} beams, σ {100 * r.noise:.0f} cm",
            f"{r.found:.3f}",
            f"{r.corner_recall:.3f} / {r.corner_precision:.3f}",
            f"{r.vertex_recall:.3f} / {r.vertex_precision:.3f}",
        ]
        for r in results
    ]
    text += table(["", "found", "corner: recall / precision", "all three: recall / precision"], rows)
    return text + "\n" + _box_errors(results)


def _box_errors(results: Sequence[boxes.BoxResult]) -> str:
    text = (
        "Boxes of 0.3 to 1.2 m that show two faces, 1 to 5 m away: median errors, and how often `box_yaw` turns by 90°\n"
        "from one sweep to the next:\n\n"
    )
    rows = [
        [
            f"{r.sensor} beams, σ {100 * r.noise:.0f} cm",
            *(f"{100 * value:.1f} cm" for value in (r.face_error, r.length_error, r.width_error, r.centre_error)),
            f"{np.rad2deg(r.yaw_error):.2f}°",
            f"{r.turns:,} of {r.pairs:,}",
        ]
        for r in results
    ]
    return text + table(["", "face", "box length", "box width", "box centre", "box yaw", "turns by 90°"], rows)


def _cylinder(results: Sequence[boxes.CylinderResult]) -> str:
    away, radius = boxes.CYLINDER
    text = (
        "## A cylinder\n\n"
        f"Radius {radius:g} m, axis {away:g} m away. The box of a round object is the square around its circle: its centre "
        "and half its\nlength are compared with the truth (medians).\n\n"
    )
    rows = [
        [
            f"{r.sensor} beams, σ {100 * r.noise:.0f} cm",
            f"{r.round_share:.2f}",
            f"{100 * r.centre_error:.1f} cm",
            f"{100 * r.radius_error:.1f} cm",
        ]
        for r in results
    ]
    return text + table(["", "called round", "centre", "radius"], rows)


def _real(figures: Figures, before: str) -> str:
    if figures.legs and figures.cars and figures.by_eye is not None:
        body = (
            by_eye.section(figures.by_eye, table)
            + "\n"
            + REAL
            + "\n"
            + _legs(figures.legs, (*SHOWN_METHODS, "Borges"))
            + "\n"
            + _cars(figures.cars)
        )
    else:
        body = before.partition(BEGIN)[2].partition(END)[0].replace(KEPT, "").strip("\n")
        body = f"{body}\n\n{KEPT}\n" if body and NEVER not in body else NEVER + "\n"
    return f"{BEGIN}\n\n{body}\n{END}\n"


def _legs(results: Sequence[real.Legs], only: Sequence[str] = ()) -> str:
    first = results[0]
    text = f"{first.labels:,} labelled legs in {first.sweeps} sweeps:\n\n"
    rows = [
        [leg.method, *(f"{share:.3f}" for share in leg.within), f"{leg.detections:.1f}"]
        for leg in results
        if not only or leg.method.startswith(tuple(only))
    ]
    within = [f"within {limit} m" for limit in real.WITHIN]
    return text + table(["method", *within, "detections per sweep"], rows)


def _cars(results: Sequence[real.Car]) -> str:
    text = (
        "The other car, by the motion capture of [datmo](https://github.com/kostaskonkk/datmo): distance from its\n"
        "position to the nearest box of profile `robust` (0 inside), in the sweeps that have a return within\n"
        f"{real.SEEN} m of it:\n\n"
    )
    rows = [
        [
            car.log,
            f"{car.seen} of {car.sweeps}",
            f"{car.median:.3f} m",
            f"{car.p90:.3f} m",
            *(f"{share:.3f}" for share in car.within),
            f"{car.to_point:.3f} m",
            f"{car.detections:.1f}",
        ]
        for car in results
    ]
    within = [f"within {limit} m" for limit in real.WITHIN]
    head = ["log", "sweeps", "median", "90 %", *within, "median to the nearest return", "detections per sweep"]
    return text + table(head, rows)
