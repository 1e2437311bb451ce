"""What docs/accuracy.md says of the sweeps judged by eye."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from benchmarks.annotations.buildings import FOLDER, RECALL
from benchmarks.annotations.choice import Side
from benchmarks.annotations.measure import ByEye
from benchmarks.annotations.methods import COMPARED, ROBUST, TRACK
from benchmarks.annotations.table import BUILDING, THING
from lidarcli.formalism import Parameters

TEXT = """{sweeps} sweeps of {logs} public recordings that no constant of `detect` was chosen on, of RPLIDAR, Hokuyo and
Neato sensors and of simulators, judged beam by beam by eye ([how](annotating.md)); {tuned} sweeps of {others} other logs
were used to grow the trees that tell things from building. A detection is right when 70 % of its beams are on things,
and a thing is found when one right detection holds half of it. `track` sees the whole log and decides by
[places](formalism.md#places), whose constants were chosen with these sweeps in view.

"""
STEADY = """
Of detections of at least 8 beams within 5 m of a parked sensor, the share that has no counterpart within 0.2 m in the next
sweep; and the share of those with one whose shape is another. People who walk are among them:

"""
BUILDINGS = """
Bodies of all sweeps of seven of these logs, labelled by the map of the whole log: on a long line of it is building, an
island in free space is a thing, and others do not count. {right} of {judged} such bodies in judged sweeps have the label
that they have by eye. The share of things and of building that `detect` keeps with its default threshold; and the share of
building that is kept where {recall} % of the things are, by one sweep and by the [votes](formalism.md#places) of all
(without the map, which made the labels):

"""


Table = Callable[[Sequence[str], Iterable[Sequence[str]]], str]
"""Head and rows → Markdown."""


def section(found: ByEye, make: Table) -> str:
    """The text and its tables."""
    side: Side = "reporting"
    text = TEXT.format(
        sweeps=found.sweeps[side], logs=found.logs[side], tuned=found.sweeps["tuning"], others=found.logs["tuning"]
    )
    places = found.places(side)
    rows = []
    for method in COMPARED:
        whole = found.of(side, method)
        if not whole.detections:
            continue
        name = f"**{method}**" if method in (ROBUST, TRACK) else method
        by_place = [found.of(side, method, place=place) for place in places]
        rows.append(
            [
                name,
                *(
                    f"{value:.3f} ({low:.2f}–{high:.2f})"
                    for value, (low, high) in zip(
                        (whole.precision, whole.recall), found.interval(side, method), strict=True
                    )
                ),
                *(f"{each.precision:.2f} / {each.recall:.2f}" for each in by_place),
            ]
        )
    text += make(["method", "precision", "recall", *places], rows)
    whole = found.of(side, ROBUST)
    text += (
        f"\n{whole.things} things, {whole.detections} detections of `detect`. In brackets: nine of ten draws of as many "
        "logs. By place: precision / recall.\nBy log:\n\n"
    )
    rows = []
    for log in found.names(side):
        each = [found.of(side, method, log=log) for method in (ROBUST, TRACK)]
        rows.append([log, str(each[0].things), *(f"{one.precision:.2f} / {one.recall:.2f}" for one in each)])
    text += make(["log", "things", ROBUST, TRACK], rows)
    text += STEADY
    rows = [
        [
            method,
            f"{each.detections:,}",
            f"{100 * each.share:.1f} %",
            f"{100 * each.reshaped_share:.1f} %" if method in (ROBUST, TRACK) else "–",
        ]
        for method, each in found.flicker.items()
    ]
    text += make(["method", "detections", "without counterpart", "of another shape"], rows)
    if found.buildings:
        text += _buildings(found, make)
    boxes = found.boxes
    return text + (
        f"\nOf {boxes.boxes:,} boxes of `detect` in all these logs {100 * boxes.crossed / max(boxes.boxes, 1):.1f} % cover "
        f"more than a third of space that beams passed\nthrough, and {boxes.too_long} are longer than the limit.\n"
    )


def _buildings(found: ByEye, make: Table) -> str:
    """Building that is kept, log by log."""
    each = found.buildings
    right, judged = (sum(getattr(one, name) for one in each.values()) for name in ("right", "judged"))
    text = BUILDINGS.format(right=right, judged=judged, recall=round(100 * RECALL))
    least = Parameters().min_thing
    rows = [
        [
            log.removeprefix(FOLDER),
            *(f"{one.count(verdict):,}" for verdict in (THING, BUILDING)),
            *(f"{one.kept(verdict, least):.2f}" for verdict in (THING, BUILDING)),
            *(f"{one.building_kept(thing):.2f}" for thing in (one.sweep, one.votes)),
        ]
        for log, one in each.items()
    ]
    kept = [f"building kept at {RECALL:g}, {name}" for name in ("one sweep", "votes")]
    return text + make(["log", "things", "building", "things kept", "building kept", *kept], rows)
