"""Beams that are removed: on agents, on temporary objects, on the robot itself, and next to these; and their messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.copying.copying import replaced
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.detection import AGENT, OBJECT
from lidarcli.logs.base import Log
from lidarcli.logs.blocks import ScanLayout
from lidarcli.options.choices import ABOVE
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.clean.agents import Agents, agents_in
from lidarcli.pipeline.clean.options import CleanOptions
from lidarcli.pipeline.clean.stays import temporary_tracks
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.inputs.tracked import ObjectRows, Objects
from lidarcli.pipeline.reading.one_log import Progress
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.sweeps.finding_rules import LEAP
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
    beam = np.arange(chosen.shape[1], dtype=np.int32)
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


class BeamEdit:
    """Replaces the chosen beams of messages, which come in the order of their topics."""

    def __init__(self, chosen: dict[str, Chosen], value: str | float) -> None:
        self._chosen, self._value = chosen, value
        self.is_measurable = False
        """True where a message says a range that is within its limits."""

    def __call__(self, topic: str, number: int, data: bytes, written: ScanLayout) -> bytes:
        """Return the message to write, as `copying.Edit`."""
        own = self._chosen.get(topic)
        if own is None:
            return data
        if number >= len(own.beam) or written.beams != own.beams[number]:
            raise changed_log(topic)
        # A stamp that is farther off has been mended.
        if written.stamp_ns and 0 < abs(written.stamp_ns - int(own.stamp_ns[number])) < LEAP * SECOND_NS:
            raise changed_log(topic)
        if not len(own.beam[number]):
            return data
        chosen = np.zeros(written.beams, np.bool_)
        chosen[own.beam[number]] = True
        value = self._number(topic, written.range_max)
        self.is_measurable |= written.range_min <= value <= written.range_max
        return replaced(data, written, chosen, value)

    def conclude(self, sweeps: Mapping[str, int]) -> None:
        """Refuse a copy that lacks sweeps."""
        for topic, own in self._chosen.items():
            if sweeps[topic] != len(own.beam):
                raise changed_log(topic)

    def _number(self, topic: str, range_max: float) -> float:
        if self._value != ABOVE:
            return float(self._value)
        if not math.isfinite(range_max):
            raise OptionError(f"--value above: the range_max of {topic} is {range_max}")
        return range_max + 1.0


def changed_log(topic: str) -> UnreadableError:
    """Return the error of a log whose sweeps are others than in the pass before."""
    return UnreadableError(f"the sweeps of {topic} are not those that were read before: does the log still grow?")
