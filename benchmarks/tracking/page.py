"""docs/tracking.md from the figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import get_args

import numpy as np

from benchmarks.accuracy.page import BEGIN, END, KEPT, NEVER, table
from benchmarks.scenes.random import SENSORS
from benchmarks.tracking import real
from benchmarks.tracking.bodies import EXPECTED, SIGHTINGS, Bodies
from benchmarks.tracking.by_eye import LOGS, Carried, InA, OneLog, intervals
from benchmarks.tracking.cells import LOST, Cell
from benchmarks.tracking.figures import Figures, Log, Summary, mean, persons, rigid, summarise
from benchmarks.tracking.methods import ORACLE, OURS
from benchmarks.tracking.prose import BY_EYE, HEAD, LIMITS, MEASURES, METHODS, REAL, SCENES, SETS, title

SHAPES = ("prismatic", "round", "legged", "irregular", "unknown")


def page(figures: Figures, before: str) -> str:
    """The whole page; `before` is the page as it was, whose real recordings are kept when there are no new ones."""
    parts = [
        HEAD.format(command=figures.command, first=figures.first_seed),
        "## Who moves on real logs\n",
        _real(figures, before),
        SCENES.format(cells=len(figures.cells), seeds=figures.seeds, logs=len(figures.logs)),
        METHODS,
        MEASURES,
        "## Rigid bodies\n",
        _by_method(figures, figures.of(rigid)),
        "![HOTA, and error of the velocity of movers, of every method in every cell](images/tracking.png)\n",
        _agents(figures, figures.of(rigid)),
        "## Persons\n",
        _by_method(figures, figures.of(persons)),
        _agents(figures, figures.of(persons)),
        "## Sizes and trajectories\n",
        _sizes_and_paths(figures),
        LIMITS,
    ]
    return "\n".join(parts)


def summary(figures: Figures) -> str:
    """The figures alone, for a terminal."""
    parts = [page_by_eye(figures.by_eye)] if figures.by_eye else []
    for name, wanted in (("Rigid bodies", rigid), ("Persons", persons)):
        if logs := figures.of(wanted):
            parts += [f"{name}, {len(logs)} logs\n", _by_method(figures, logs), _agents(figures, logs)]
    if OURS in figures.methods:
        parts += [_conditions(figures), _bodies(figures)]
    parts.append(_cost(figures))
    if figures.cars:
        parts += [_cars(figures.cars), _legs(figures.legs)]
    return "\n".join(parts)


def _by_method(figures: Figures, logs: Sequence[Log]) -> str:
    rows = []
    for method in figures.methods:
        one = summarise(logs, method)
        figures_ = (one.hota, one.hota_worst, one.detection, one.association, one.idf1, one.mota)
        name = title(method)
        rows.append(
            [
                f"**{name}**" if method == OURS else name,
                *(f"{value:.3f}" for value in figures_),
                f"{one.switches:.0f}",
                f"{one.tracks:.0f}",
                f"{one.hota_of_all:.3f}",
            ]
        )
    head = ["method", "HOTA, mean", "worst cell", "DetA", "AssA", "IDF1", "MOTA"]
    return table([*head, "switches per 100 bodies", "tracks per 100 bodies", "HOTA of all, detected or not"], rows)


def _agents(figures: Figures, logs: Sequence[Log]) -> str:
    text = "Velocities and set A. Errors in m/s; the shares are of rows of the objects table:\n\n"
    rows = []
    for method in figures.methods:
        if method == ORACLE:
            continue
        one = summarise(logs, method)
        rows.append(
            [
                f"**{method}**" if method == OURS else title(method),
                f"{one.speed_rms:.3f} / {one.speed_median:.3f}",
                f"{one.paused_rms:.3f}",
                f"{one.standing_rms:.3f}",
                *(_percent(value) for value in _shares(one)),
            ]
        )
    head = ["method", "moving: RMSE / median", "paused: RMSE", "standing: RMSE", "movers in A", "worst cell"]
    return text + table([*head, "standing in A", "worst cell"], rows)


def _shares(one: Summary) -> tuple[float, float, float, float]:
    return one.movers_in_a, one.movers_worst, one.standing_in_a, one.standing_worst


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %" if np.isfinite(share) else "–"


def _conditions(figures: Figures) -> str:
    plain = [cell for cell in figures.cells if not cell.fault]
    solid = [cell for cell in plain if rigid(cell)]
    lines: list[tuple[str, list[Cell]]] = [
        (place, [cell for cell in plain if cell.place == place]) for place in dict.fromkeys(cell.place for cell in plain)
    ]
    lines += [(f"{name} beams", [cell for cell in solid if cell.sensor == name]) for name in SENSORS]
    lines += [(f"σ {100 * noise:.0f} cm", [cell for cell in solid if cell.noise == noise]) for noise in LOST]
    lines += [
        (fault, [cell for cell in figures.cells if cell.fault == fault and rigid(cell)]) for fault in ("flicker", "rolling")
    ]
    others = [name for name in figures.methods if name not in (OURS, ORACLE)]
    rows = []
    for name, wanted in lines:
        logs = figures.of(wanted.__contains__)
        if not logs:
            continue
        one = summarise(logs, OURS)
        numbers = [f"{one.hota:.3f}", f"{one.hota_worst:.3f}", f"{one.association:.3f}", f"{one.switches:.0f}"]
        numbers.append(f"{one.speed_rms:.3f} / {one.speed_median:.3f}")
        numbers += [_percent(one.movers_in_a), _percent(one.standing_in_a), _percent(one.standing_worst)]
        best = max((summarise(logs, other).hota for other in others), default=float("nan"))
        oracle = summarise(logs, ORACLE).hota if ORACLE in figures.methods else float("nan")
        rows.append([name, *numbers, f"{oracle:.3f}", f"{best:.3f}"])
    text = (
        "*lidarcli* where the sensor stands or drives, by its beams and by its noise (rigid bodies), and with the two\n"
        "faults. Beside it the HOTA of the truth about each object, and of the best of the published rules there:\n\n"
    )
    head = ["", "HOTA, mean", "worst cell", "AssA", "switches per 100 bodies", "v: RMSE / median"]
    return text + table([*head, "movers in A", "standing in A", "worst cell", "truth: HOTA", "best rules: HOTA"], rows)


def _bodies(figures: Figures) -> str:
    found = [log.scores[OURS].bodies for log in figures.logs if OURS in log.scores]
    known = [one for one in found if one is not None]
    counts: dict[tuple[str, str], int] = {}
    for one in known:
        for key, count in one.shapes.items():
            counts[key] = counts.get(key, 0) + count
    text = (
        "## Shapes and sizes of tracks\n\n"
        f"Tracks seen in at least {SIGHTINGS} sweeps, by the entity that most of their objects are of, and the\n"
        "shape in the table of tracks:\n\n"
    )
    rows = []
    for kind, expected in EXPECTED.items():
        line = [counts.get((kind, shape), 0) for shape in SHAPES]
        if total := sum(line):
            right = line[SHAPES.index(expected)] / total
            rows.append([kind, *(f"{count:,}" for count in line), f"{right:.3f}"])
    if not rows:
        return text + "*No tracks.*\n"
    return text + table(["entity", *SHAPES, "right"], rows) + "\n" + _sizes_and_paths(figures)


def _sizes_and_paths(figures: Figures) -> str:
    found = [log.scores[OURS].bodies for log in figures.logs if OURS in log.scores]
    return _sizes([one for one in found if one is not None]) + "\n" + _paths(figures)


def _sizes(known: Sequence[Bodies]) -> str:
    length = np.abs(np.concatenate([one.length_errors for one in known]))
    width = np.abs(np.concatenate([one.width_errors for one in known]))
    off = np.abs(np.concatenate([one.deviations for one in known]))
    off = off[np.isfinite(off)]
    if not len(length):
        return ""
    text = (
        "Errors of the sides of boxes and cylinders (median / 90 %), and how many lie within twice the stated\n"
        "standard deviation:\n\n"
    )
    row = [
        f"{100 * np.median(length):.1f} / {100 * np.quantile(length, 0.9):.1f} cm",
        f"{100 * np.median(width):.1f} / {100 * np.quantile(width, 0.9):.1f} cm",
        _percent(float(np.mean(off <= 2)) if len(off) else float("nan")),
    ]
    return text + table(["", "length", "width", "within 2 sd"], [["boxes and cylinders", *row]])


def _paths(figures: Figures) -> str:
    text = (
        "Agents in sweeps that show nothing of another entity: error of place and velocity, rows whose place\n"
        "lies within twice the stated standard deviation, and the length of their paths over that of the true ones\n"
        "(median over tracks):\n\n"
    )
    rows = []
    kinds: dict[str, Callable[[Cell], bool]] = {
        "persons": persons,
        "rigid, parked": partial(_rigid_and, "parked"),
        "rigid, driving": partial(_rigid_and, "driving"),
    }
    for name, wanted in kinds.items():
        logs = [log for log in figures.of(wanted) if OURS in log.scores]
        found = [one.paths for log in logs if (one := log.scores[OURS].bodies) is not None]
        known = [one for one in found if one is not None]
        off, sd, speed, ratio = (
            np.concatenate([np.empty(0), *(getattr(one, part) for one in known)])
            for part in ("place_errors", "deviations", "speed_errors", "ratios")
        )
        if len(off):
            root = [np.sqrt(np.mean(values**2)) for values in (off, speed)]
            rows.append(
                [
                    name,
                    f"{len(ratio):,}",
                    f"{root[0]:.3f} / {np.median(off):.3f} m",
                    f"{root[1]:.3f} / {np.median(speed):.3f} m/s",
                    _percent(float(np.mean(sd <= 2))),
                    f"{np.median(ratio):.3f}",
                ]
            )
    head = ["", "tracks", "place: RMSE / median", "v: RMSE / median", "within 2 sd", "length of path"]
    return text + (table(head, rows) if rows else "*No agents.*\n")


def _rigid_and(carried: str, cell: Cell) -> bool:
    return rigid(cell) and cell.carried == carried


def _cost(figures: Figures) -> str:
    text = (
        "## Cost\n\n"
        "Time of a process per sweep, without the detection that all need. The published rules are written in Python\n"
        "here: their times say nothing of the published programs.\n\n"
    )
    names = [name for name in figures.methods if name != ORACLE]
    rows = [[title(name), f"{summarise(figures.logs, name).microseconds:,.0f} µs"] for name in names]
    detection = 1e6 * mean(log.detect_seconds for log in figures.logs)
    return text + table(["method", "per sweep"], [["*the detection*", f"{detection:,.0f} µs"], *rows])


def _real(figures: Figures, before: str) -> str:
    if figures.by_eye and figures.cars and figures.legs:
        parts = [BY_EYE, page_by_eye(figures.by_eye), REAL, _cars(figures.cars), _legs(figures.legs)]
        body = "\n".join(parts)
    else:
        body = before.partition(BEGIN)[2].partition(END)[0].replace(KEPT, "").strip("\n")
        body = f"{body}\n\n{KEPT}\n" if body and NEVER not in body else NEVER + "\n"
    return f"{BEGIN}\n\n{body}\n{END}\n"


def page_by_eye(logs: Sequence[OneLog]) -> str:
    """The two tables of set A on real logs, each after its words."""
    text = []
    for name, words in SETS.items():
        mine = [log for log in logs if log.set == name]
        groups = {"**all**": mine}
        if name == "untouched":
            groups |= {f"**{way}**": [log for log in mine if log.judged.carried == way] for way in get_args(Carried)}
        rows = [
            _in_a(title, sum((log.in_a for log in some), InA()), intervals(some)) for title, some in groups.items() if some
        ]
        head = ["log", "rows in A that move", "rows of movers in A", "tracks in A that move", "tracks of movers in A"]
        text.append(words.format(logs=len(mine), all=len(LOGS[name]), empty=sum(log.in_a.empty for log in mine)))
        text.append(table([*head, "not judged in A: rows, tracks"], rows))
    return "\n".join(text)


def _in_a(name: str, one: InA, within: Sequence[tuple[float, float] | None]) -> list[str]:
    cells = []
    for share, ends in zip(one.shares, within, strict=True):
        span = "" if ends is None else f" ({100 * ends[0]:.0f}–{100 * ends[1]:.0f})"
        cells.append(f"{share.some:,} of {share.all:,}: {100 * share.value:.1f} %{span}" if share.all else "–")
    return [name, *cells, f"{one.rows_unjudged:,}, {one.tracks_unjudged}"]


def _cars(cars: Sequence[real.Car]) -> str:
    rows = [
        [
            f"{car.log}, {title(car.method)}",
            f"{car.rows}",
            f"{car.rms:.3f} / {car.median:.3f}",
            f"{car.tracks}",
            _percent(car.in_a),
            _percent(car.others_in_a),
            f"{car.all_tracks}",
        ]
        for car in cars
        if car.method in (OURS, "leg_tracker")
    ]
    head = ["", "rows on the car", "its velocity: RMSE / median", "tracks on it", "its rows in A"]
    return table([*head, "rows of other objects in A", "tracks in all"], rows)


def _legs(legs: Sequence[real.Legs]) -> str:
    text = f"{legs[0].labels:,} labelled legs:\n\n"
    rows = [[title(one.method), f"{one.matched:.3f}", f"{one.in_a:.3f}", f"{one.tracks}"] for one in legs]
    return text + table(["method", f"with a track within {real.NEAR} m", "of these in A", "tracks on them"], rows)
