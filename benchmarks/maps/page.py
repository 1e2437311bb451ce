"""docs/maps.md from the figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, degrees, floor, isfinite, log10

from benchmarks.accuracy.page import BEGIN, END, KEPT, NEVER, table
from benchmarks.maps.figures import EVERY, MOVED, OURS, WITHOUT_AGENTS, Figures, PathError, mean
from benchmarks.maps.paths import STRETCH
from benchmarks.maps.prose import AGENTS, HEAD, LIMITS, PATHS, REAL, RULES, SCENES, WHY
from benchmarks.maps.real import PICTURES, picture_name
from benchmarks.maps.real_paths import KNOWN
from benchmarks.maps.recordings import RESOLUTION

F1, F1_MATCHED, F1_LESS, PER_SECOND = 0.99, 0.95, 0.01, 5_000
"""What is wanted: F1 with true and with matched poses, the most that these lose; sweeps per second; ..."""
RMS, SHARE, FLAGGED = 0.05, 0.01, 0.95
"""... of matched paths: error of a loop [m], error as a share of the way, share of sliding sweeps that are flagged."""


def page(figures: Figures, before: str) -> str:
    """The whole page; `before` is the page as it was, whose real recordings are kept when there are no new ones."""
    parts = [
        HEAD.format(command=figures.command, first=figures.first_seed),
        "## In short\n",
        _short(figures),
        _why(figures),
        SCENES,
        RULES,
        _rules(figures, brief=True),
        f"![{OURS} beside the true map](images/maps/simulated.png)\n",
        AGENTS,
        _agents(figures),
        "## Real recordings\n",
        _real(figures, before),
        LIMITS,
    ]
    return "\n".join(parts)


def summary(figures: Figures) -> str:
    """The figures alone, for a terminal."""
    parts = [
        _short(figures),
        _why(figures),
        _ways(figures),
        _rules(figures),
        _matched(figures),
        _paths([*figures.loops, *figures.straight, *figures.real_paths]),
        _rolled(figures),
    ]
    parts += [_agents(figures), *([_speed(figures)] if figures.speed else [])]
    return "\n".join([*parts, *([_recorded(figures)] if figures.recorded else [])])


def _short(figures: Figures) -> str:
    """What is wanted, what is there, and whether that is enough: the worst drive decides."""
    rows = []

    def add(what: str, wanted: str, found: str, reached: bool) -> None:
        rows.append([what, wanted, found, "reached" if reached else "**missed**"])

    for kind in figures.kinds:
        scores = figures.of(OURS, MOVED, kind)
        least, ghosts = min(one.f1 for one in scores), sum(one.ghosts for one in scores)
        add(f"{kind}: F1, true poses, worst drive", f"≥ {F1:g}", _figure(least), least >= F1)
        add(f"{kind}: cells that people left, all {len(scores)} drives", "0", f"{ghosts}", ghosts == 0)
        matched = [one.score.f1 for one in figures.matched if one.way.startswith(f"{kind} ")]
        if matched:
            add(
                f"{kind}: F1, `--pose match`, worst drive",
                f"≥ {F1_MATCHED:g}",
                _figure(min(matched)),
                min(matched) >= F1_MATCHED,
            )
    if figures.matched:
        less = max(_with_true_poses(figures, one.way) - one.score.f1 for one in figures.matched)
        add(
            "F1 that `--pose match` loses, worst drive",
            f"≤ {F1_LESS:g}",
            f"{ceil(1000 * max(less, 0.0)) / 1000:.3f}",
            less <= F1_LESS,
        )
    _short_paths(figures, add)
    if figures.speed is not None:
        fast = figures.speed.per_second
        add("sweeps per second, every one counts", f"≥ {PER_SECOND:,}", f"about {coarse(fast)}", fast >= PER_SECOND)
    return table(["", "wanted", "found", ""], rows)


def _short_paths(figures: Figures, add: Callable[[str, str, str, bool], None]) -> None:
    """What is wanted of matched paths."""
    if loops := figures.loops:
        metres = [one.metres for one in loops]
        within = sum(one.rms <= RMS and not one.unplaced for one in loops)
        name = f"loops of {min(metres):.0f} to {max(metres):.0f} m whose path is off by at most {100 * RMS:g} cm, rms"
        add(name, f"{len(loops)} of {len(loops)}", f"{within} of {len(loops)}", within == len(loops))
        worst = max(one.median for one in loops if one.log.startswith("rooms"))
        name = f"rooms: error of the path over {STRETCH:g} m, median, worst drive"
        add(name, f"≤ {100 * SHARE:g} %", f"{ceil(1e4 * worst) / 100:.2f} %", worst <= SHARE)
    if figures.straight:
        flagged = min(one.slides for one in figures.straight)
        name = "straight corridors: sliding sweeps that are flagged, worst drive"
        add(name, f"≥ {100 * FLAGGED:g} %", f"{floor(1000 * flagged) / 10:.1f} %", flagged >= FLAGGED)
    if paths := figures.real_paths:
        # What was lost, or has no pose, is not in the median.
        within = sum(one.median <= SHARE and not one.lost for one in paths)
        name = f"recordings whose path is never lost, and off by at most {100 * SHARE:g} % of the way, median"
        add(name, f"{len(paths)} of {len(paths)}", f"{within} of {len(paths)}", within == len(paths))


def _why(figures: Figures) -> str:
    """Where precision and recall of each kind of building stand beside what there is to be seen."""
    text = ""
    for kind in figures.kinds:
        scores = figures.of(OURS, MOVED, kind)
        twice = mean(way.twice for way in figures.ways if way.kind == kind)
        text += (
            f"- **{kind}**: precision {_figure(mean(one.precision for one in scores))}, "
            f"recall {_figure(mean(one.recall for one in scores))};\n  two of the sweeps that count would hit "
            f"{_figure(twice)} of the true cells at best, and a cell needs two hits.\n"
        )
    return WHY + text


def _ways(figures: Figures) -> str:
    rows = [
        [
            way.name,
            f"{way.metres:.0f} m",
            f"{way.people}",
            f"{way.sweeps:,} / {way.counted:,}",
            f"{way.true_cells:,}",
            f"{100 * way.once:.1f} %",
            f"{100 * way.twice:.1f} %",
        ]
        for way in figures.ways
    ]
    head = ["drive", "way", "people", "sweeps / with the motion filter", "true cells", "seen once", "seen twice"]
    return table(head, rows)


def _rules(figures: Figures, brief: bool = False) -> str:
    parts = []
    for kind in figures.kinds:
        rows = []
        for rule in figures.rules:
            if rule == WITHOUT_AGENTS or (brief and rule.startswith("once per sweep")):
                continue
            row = [f"**{rule}**" if rule == OURS else rule]
            for taken in (EVERY, MOVED):
                scores = figures.of(rule, taken, kind)
                row += [
                    _figure(mean(one.precision for one in scores)),
                    _figure(mean(one.recall for one in scores)),
                    _figure(mean(one.f1 for one in scores)),
                    f"{sum(one.ghosts for one in scores)}",
                ]
            rows.append(row)
        names = ("precision", "recall", "F1", "ghosts")
        head = [kind, *(f"{EVERY}: {names[0]}", *names[1:]), *(f"{MOVED}: {names[0]}", *names[1:])]
        parts.append(table(head, rows))
    return "\n".join(parts)


def _matched(figures: Figures) -> str:
    rows = [
        [
            one.way,
            *_quality(one.score.precision, one.score.recall, one.score.f1),
            _figure(_with_true_poses(figures, one.way)),
        ]
        for one in figures.matched
    ]
    return table(["drive", "precision", "recall", "F1", "F1 with true poses"], rows)


def _with_true_poses(figures: Figures, way: str) -> float:
    """F1 of the map of a drive by true poses."""
    wanted = (way, OURS, MOVED)
    return mean(made.score.f1 for made in figures.made if (made.way, made.rule, made.taken) == wanted)


def _paths(paths: Sequence[PathError]) -> str:
    rows = [
        [
            one.log,
            f"{one.beams}, {one.view:.0f}°",
            f"{one.metres:,.0f} m" if one.over == STRETCH else f"{one.metres:.1f} m, over {one.over:.1f} m",
            f"{_percent(one.median)} / {_percent(one.p95)}",
            f"{one.length:.3f}" if isfinite(one.length) else "–",
            f"{degrees(one.heading):.2f}°" if isfinite(one.heading) else "–",
            f"{100 * one.rms:.1f} cm" if isfinite(one.rms) else "–",
            f"{100 * one.slides:.1f} %",
            f"{100 * one.unplaced:.1f} %",
            f"{one.lost}",
            f"{one.milliseconds:.2f}",
        ]
        for one in paths
    ]
    head = ["log", "beams, view", "way", f"error over {STRETCH:g} m: median / 95 %", "length", "heading: rms"]
    head += ["loop: rms", "may slide", "no pose", "lost", "ms a sweep"]
    return table(head, rows)


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %" if isfinite(share) else "–"


def _rolled(figures: Figures) -> str:
    rows = [
        [
            f"{one.way}, {one.sweeps}",
            f"{57.29578 * one.turn:.0f} °/s",
            _figure(one.score.f1),
            f"{one.score.thickness / RESOLUTION:.1f}",
            f"{one.things}",
            f"{100 * one.median:.1f} / {100 * one.rms:.1f} cm",
        ]
        for one in figures.rolled
    ]
    head = ["drive", "fastest turn", "F1", "cells per metre of wall", "objects", "boxes off: median / rms"]
    return table(head, rows)


def _agents(figures: Figures) -> str:
    rows = []
    for taken in (EVERY, MOVED):
        for rule in (OURS, WITHOUT_AGENTS):
            scores = figures.of(rule, taken)
            if scores:
                kinds = [sum(one.ghosts for one in figures.of(rule, taken, kind)) for kind in figures.kinds]
                rows.append(
                    [
                        f"{rule}, {taken}",
                        *(f"{count}" for count in kinds),
                        _figure(mean(one.precision for one in scores)),
                        _figure(mean(one.recall for one in scores)),
                    ]
                )
    return table(["", *(f"ghosts, {kind}" for kind in figures.kinds), "precision", "recall"], rows)


def _speed(figures: Figures) -> str:
    speed = figures.speed
    if speed is None:
        return "*Not measured.*\n"
    rows = [
        ["sweeps of 361 beams per second, from the start of the program to its end", coarse(speed.per_second)],
        ["its time as a multiple of that of iterating all messages of the log", coarse(speed.iterate)],
        ["cells of rays per second in the kernel, in millions", coarse(speed.cells / 1e6)],
        ["memory for a km² of the extent of a map", f"{coarse(speed.gb_per_km2)} GB"],
    ]
    return table(["", "about"], rows)


def _real(figures: Figures, before: str) -> str:
    if figures.recorded:
        pictures = [
            f"![The map of {log}, with the path of the sensor](images/maps/{picture_name(log)})\n" for log in PICTURES
        ]
        body = "\n".join([*pictures, PATHS, REAL, _real_paths(figures.real_paths)])
    else:
        body = before.partition(BEGIN)[2].partition(END)[0].replace(KEPT, "").strip("\n")
        body = f"{body}\n\n{KEPT}\n" if body and NEVER not in body else NEVER + "\n"
    return f"{BEGIN}\n\n{body}\n{END}\n"


def _real_paths(paths: Sequence[PathError]) -> str:
    """The errors of the paths, and which recordings were not at hand."""
    there = {one.log.partition("/")[0] for one in paths}
    wanted = dict.fromkeys(known.logs.partition("/")[0] for known in KNOWN)
    missing = ", ".join(name for name in wanted if name not in there)
    return _paths(paths) + (f"\n*Not at hand in this run: {missing}.*\n" if missing else "")


def _recorded(figures: Figures) -> str:
    rows = [
        [
            one.log,
            f"{one.sweeps:,} / {one.counted:,}",
            f"{one.metres:.1f} m",
            f"{one.width:.1f} x {one.height:.1f} m",
            f"{one.occupied:,}",
            f"{one.free:,}",
        ]
        for one in figures.recorded
    ]
    return table(["log", "sweeps / that count", "way", "extent", "occupied cells", "free cells"], rows)


def _quality(*values: float) -> list[str]:
    return [_figure(value) for value in values]


def _figure(share: float) -> str:
    # 0.98996 is not 0.990: rounded down, so that nothing is called reached that is not.
    return f"{floor(1000 * share) / 1000:.3f}" if isfinite(share) else "–"


def coarse(value: float) -> str:
    """With one digit, as machines differ."""
    if not value > 0:
        return "0"
    step = 10.0 ** floor(log10(value))
    rounded = round(value / step) * step
    return f"{rounded:,.0f}" if rounded >= 1 else f"{rounded:g}"
