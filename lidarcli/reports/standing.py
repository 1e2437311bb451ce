"""The sweeps that stand out, with their numbers: where to look first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Run
from lidarcli.reports.streams import Streams
from lidarcli.sweeps import Float64

EACH = 3
KINDS = {
    "most_objects": "most objects",
    "fewest_objects": "fewest objects",
    "most_agents": "most agents",
    "most_lost": "most lost beams",
    "longest_gap": "longest gap before",
}


@dataclass(frozen=True, slots=True)
class Standing:
    """One sweep that stands out."""

    kind: str
    """One of `KINDS`."""
    stream: int
    log: str
    topic: str
    sweep: int
    stamp_ns: int
    value: float
    """Objects, agents, share of lost beams, or seconds."""

    @property
    def words(self) -> str:
        """The value for people."""
        if self.kind == "most_lost":
            return f"{100 * self.value:.1f} %"
        return f"{self.value:.3g} s" if self.kind == "longest_gap" else f"{self.value:,.0f}"


def standing_out(run: Run, streams: Streams) -> tuple[Standing, ...]:
    """Up to three sweeps of each kind, the most striking first, earlier ones before later; none where all are alike."""
    rows = run.sweeps
    objects, beams, valid = rows.numbers("objects"), rows.numbers("beams"), rows.numbers("valid")
    lost = np.divide(beams - valid, beams, out=np.zeros(len(rows)), where=beams > 0)
    gap = np.where(streams.gap, streams.step, 0.0)
    agents = np.nan_to_num(run.agents_at_once)
    usual = float(np.median(objects)) if len(objects) else 0.0
    scores: dict[str, tuple[Float64, Float64]] = {
        "most_objects": (objects, objects - usual),
        "fewest_objects": (objects, usual - objects),
        "most_agents": (agents, agents),
        "most_lost": (lost, lost),
        "longest_gap": (gap, gap),
    }
    sweep, stamp = rows.integers("sweep"), rows.integers("stamp")
    found = []
    for kind, (value, score) in scores.items():
        best = np.argsort(-score, kind="stable")[:EACH]
        for row in best[score[best] > 0].tolist():
            stream = streams.all[streams.stream[row]]
            found.append(
                Standing(
                    kind=kind,
                    stream=int(streams.stream[row]),
                    log=stream.log,
                    topic=stream.topic,
                    sweep=int(sweep[row]),
                    stamp_ns=int(stamp[row]),
                    value=float(value[row]),
                )
            )
    return tuple(found)
