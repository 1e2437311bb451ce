"""What docs/accuracy.md says of the sweeps judged by eye."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from benchmarks.annotations.choice import Side
from benchmarks.annotations.measure import ByEye
from benchmarks.annotations.methods import COMPARED, ROBUST, TRACK

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


Table = Callable[[Sequence[str], Iterable[Sequence[str]]], str]
"""Head and rows → Markdown."""


def section(found: ByEye, make: Table) -> str:
    """The text and its tables."""
    side: Side = "reporting"
    text = TEXT.format(
        sweeps=found.sweeps[side],
        logs=found.logs[side],
        tuned=found.sweeps["tuning"],
        others=found.logs["tuning"],
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
        rows.append(
            [
                log,
                str(each[0].things),
                *(f"{one.precision:.2f} / {one.recall:.2f}" for one in each),
            ]
        )
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
    boxes = found.boxes
    return text + (
        f"\nOf {boxes.boxes:,} boxes of `detect` in all these logs {100 * boxes.crossed / max(boxes.boxes, 1):.1f} % cover "
        f"more than a third of space that beams passed\nthrough, and {boxes.too_long} are longer than the limit.\n"
    )
