"""Beams that are removed: on agents, on temporary objects, on the robot itself, and next to these."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import AGENT, OBJECT
from lidarcli.logs.base import Log
from lidarcli.pipeline.clean.agents import Agents, agents_in
from lidarcli.pipeline.clean.options import CleanOptions
from lidarcli.pipeline.clean.stays import temporary_tracks
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.inputs.tracked import ObjectRows, Objects
from lidarcli.pipeline.reading.one_log import Progress
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Bool, Closure, Int32, Int64, Status, SweepBatch

REASONS = ("agents", "temporary", "body", "margin")
"""Reasons for which a beam is chosen, the first that holds; columns of the table."""
AGENTS, TEMPORARY, BODY, MARGIN = range(1, 5)


class Chosen(NamedTuple):
    """The chosen beams of one topic, sweep by sweep."""

    stamp_ns: Int64
    beams: Int32
    """(S,) beams of each sweep."""
    counts: Int32
    """(S, 4) chosen beams by `REASONS`."""
    beam: list[NDArray[np.intp]]
    """Chosen beams of each sweep, ascending."""


def choose(
    log: Log,
    tables: TableSet,
    options: CleanOptions,
    rules: RangeRules,
    posing: PoseAttacher,
    progress: Progress | None = None,
) -> dict[str, Chosen]:
    """Return the chosen beams of each topic by the tables of its objects; `posing` is that of the pass that made them."""
    temporary = temporary_tracks(log, tables, options, rules, posing.anew()) if "temporary" in options.remove else {}
    agents = agents_in(tables) if "agents" in options.remove else {}
    found: dict[str, list[Chosen]] = {}
    rows = ObjectRows(tables)
    for batch in options.sweeps(log, rules):
        objects = rows.of(batch)
        reason = np.zeros(batch.ranges.shape, np.uint8)
        for frame, at, own in batch.by_frame():
            key = batch.topic, frame
            reason[at] = _reasons(own, objects.of_rows(at), options, temporary.get(key, ()), agents.get(key))
        counts = np.column_stack([np.count_nonzero(reason == code, axis=1) for code in range(1, 5)]).astype(np.int32)
        beams = [np.flatnonzero(row) for row in reason]
        found.setdefault(batch.topic, []).append(Chosen(batch.stamp_ns, batch.beams, counts, beams))
        if progress is not None:
            progress(log.position)
    return {topic: _joined(parts) for topic, parts in found.items()}


def _joined(parts: Sequence[Chosen]) -> Chosen:
    stamp_ns, beams, counts, beam = zip(*parts, strict=True)
    return Chosen(np.concatenate(stamp_ns), np.concatenate(beams), np.concatenate(counts), [*chain.from_iterable(beam)])


def _reasons(
    batch: SweepBatch, objects: Objects, options: CleanOptions, temporary: Sequence[int] | Int64, agents: Agents | None
) -> NDArray[np.uint8]:
    """Return the reason (S, B) for which each beam is chosen, 0 for none; `temporary` are tracks."""
    valid = batch.status == Status.VALID
    owner = objects.owners(batch)
    is_static = (objects.set == OBJECT) & (objects.track >= 0)
    is_agent = objects.set == AGENT
    if agents is not None and len(agents.track):
        at = np.minimum(np.searchsorted(agents.track, objects.track), len(agents.track) - 1)
        is_agent |= (agents.track[at] == objects.track) & (batch.sweep[objects.row] >= agents.since[at])
    reason = np.zeros(valid.shape, np.uint8)
    reason[batch.status == Status.MASKED] = BODY
    reason[valid & np.append(is_static & np.isin(objects.track, temporary), False)[owner]] = TEMPORARY
    if "agents" in options.remove:
        reason[valid & np.append(is_agent, False)[owner]] = AGENTS
    if agents is not None:
        # What is static is no part of who passes by.
        on_static = np.append(is_static & ~is_agent, False)[owner]
        reason[agents.of(batch).pieces(batch) & ~on_static & (reason != BODY)] = AGENTS
    reason[neighbours(batch, reason > 0, options.margin) & valid & (reason == 0)] = MARGIN
    return reason


def neighbours(batch: SweepBatch, chosen: Bool, margin: int) -> Bool:
    """Return the beams (S, B) that are so near to chosen ones; of a full turn the last is next to the first."""
    beam = np.arange(chosen.shape[1])
    far = margin + 2 * len(beam) + 1
    # The chosen ones next to each beam, on both sides; behind the last beam of a full turn comes the first chosen one.
    before, after = np.where(chosen, beam, -far), np.where(chosen, beam, far)
    turn = np.where(batch.closure == Closure.OPEN, far, batch.beams)[:, None]
    last = before.max(axis=1, keepdims=True, initial=-far) - turn
    first = after.min(axis=1, keepdims=True, initial=far) + turn
    before = np.maximum(np.maximum.accumulate(before, axis=1), last)
    after = np.minimum(np.minimum.accumulate(after[:, ::-1], axis=1)[:, ::-1], first)
    near: Bool = np.minimum(beam - before, after - beam) <= margin
    return near & (beam < batch.beams[:, None])
