"""The sweeps that stand out, with their numbers: where to look first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Run
from lidarcli.reports.streams import Streams
from lidarcli.sweeps import Float64

EACH = 3
APART = 20
"""Sweeps of one log are no nearer to each other than this part of it."""
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
    """Up to three sweeps of each kind, the most striking first; none where all are alike.

    They are of different logs and topics, each with its earliest; where there is only one, each is of another time.
    """
    rows = run.sweeps
    objects, beams, valid = run.objects_per_sweep, rows.numbers("beams"), rows.numbers("valid")
    lost = np.divide(beams - valid, beams, out=np.zeros(len(rows)), where=beams > 0)
    gap = np.where(streams.gap, streams.step, 0.0)
    agents = np.nan_to_num(run.agents_at_once)
    usual, usual_agents = (float(np.median(counts)) if len(counts) else 0.0 for counts in (objects, agents))
    scores: dict[str, tuple[Float64, Float64]] = {
        "most_objects": (objects, objects - usual),
        "fewest_objects": (objects, usual - objects),
        "most_agents": (agents, agents - usual_agents),
        "most_lost": (lost, lost),
        "longest_gap": (gap, gap),
    }
    sweep, stamp = rows.integers("sweep"), rows.integers("stamp")
    found = []
    for kind, (value, score) in scores.items():
        for row in _best(score, streams):
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


def _best(score: Float64, streams: Streams) -> list[int]:
    """Rows of the greatest scores: one of each stream, of a single one those that are apart."""
    left = score.copy()
    found: list[int] = []
    while len(found) < EACH and len(left) and left.max() > 0:
        row = int(left.argmax())
        found.append(row)
        mine = np.flatnonzero(streams.stream == streams.stream[row])
        if len(streams.all) > 1:
            left[mine] = 0.0
        else:
            left[_around(score, row)] = 0.0
    return found


def _around(score: Float64, row: int) -> slice:
    """The sweeps near one of a single stream, and all that are its like without a break."""
    other = np.flatnonzero(score != score[row])
    at = int(np.searchsorted(other, row))
    near = max(1, len(score) // APART)
    low = min(int(other[at - 1]) + 1 if at else 0, row - near)
    high = max(int(other[at]) if at < len(other) else len(score), row + near + 1)
    return slice(max(low, 0), high)
