"""The path of each sensor of a log: given, or matched from its sweeps, by what they all agree on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import LogBatcher, ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.logs.scan_checks import Went
from lidarcli.pipeline.reading.needs import Need
from lidarcli.pipeline.reading.path_choice import CheckedPath, PathChoice
from lidarcli.pipeline.reading.sensor_look import SensorLook
from lidarcli.pose import matched as matching
from lidarcli.pose.findings import Key
from lidarcli.pose.sources import Correction, PoseChain, went
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Status, SweepBatch

if TYPE_CHECKING:
    from lidarcli.pose.sources import GivenPaths, PoseSources

MAX_MATCHED = 16
"""Topics and frames whose paths are looked at: each has a map in memory."""


def check_paths(
    log: Log,
    sources: PoseSources | GivenPaths | None,
    choice: TopicChoice,
    rules: RangeRules,
    *,
    by_run: Sequence[PoseSources] = (),
    run: int | None = None,
    delay_ns: int = 0,
    named: str = "",
    match: bool = False,
    need: Need = Need.MOVING,
    wanted: bool = True,
    order: str = matching.AUTO,
) -> tuple[dict[tuple[int, Key], CheckedPath], Counter[int]]:
    """Find the path of each sensor of a log that can be read twice.

    Parameters
    ----------
    sources : given poses of the log, None for none
    by_run : those of each run, taken where the sweeps have as many runs
    run : the one run to look at; None or `LONGEST` for all
    choice : topics to read
    delay_ns : the pose of a sweep is that so much after its stamp [ns]
    named : why the poses are taken as they are; empty where the sweeps choose
    match : the matched paths are taken in any case
    need : sensors without given poses that need a path
    wanted : False to find only whether the sensor is static, until it was observed to move
    order : order of the beams, of `BEAM_ORDERS`

    Returns
    -------
    By run, topic and frame, for at most `MAX_MATCHED`, without those that need no look; and the sweeps of each run.
    """

    def given_by(given: PoseSources | GivenPaths | None, topic: str, frame: str) -> list[PoseChain]:
        chains = [] if given is None or match else given.chains(frame, topic)
        return [replace(one, correction=replace(one.correction or Correction(), delay_ns=delay_ns)) for one in chains]

    match_all = match or need is Need.ALL
    looks: dict[tuple[int, Key], SensorLook] = {}
    sweeps_of: Counter[int] = Counter()
    recorded: dict[int, tuple[Any, Any]] = {}
    expected = {topic.name for topic in log.topics() or () if topic.messages != 0} & set(choice.chosen)
    moves = None if sources is None else partial(went, sources)
    for key, sweeps in _sweeps(log, choice, rules, moves):
        sweeps_of[key[0]] += len(sweeps)
        first, last = recorded.get(key[0], (sweeps.record_ns[0], 0))
        recorded[key[0]] = min(first, sweeps.record_ns.min()), max(last, sweeps.record_ns.max())
        if key not in looks:
            chains = given_by(sources, *key[1])
            is_left_out = run and run != key[0]
            if len(looks) == MAX_MATCHED or is_left_out or (not chains and need is Need.TOLD and not match):
                continue
            looks[key] = SensorLook(chains, matching.Timing(order), None, whole=match, wanted=wanted)
        looks[key].add(sweeps)
        is_all = not wanted and {topic for _, (topic, _) in looks} >= expected > set()
        if is_all and not any(look.may_be_static for look in looks.values()):
            break
    found: dict[tuple[int, Key], CheckedPath] = {}
    again: dict[tuple[int, Key], tuple[PathChoice, list[SensorLook]]] = {}
    for key, look in looks.items():
        look.decide_order()
        if len(by_run) == len(sweeps_of):
            look.chains = given_by(by_run[key[0] - 1], *key[1])
        elif len(sweeps_of) > 1 and not named:
            # What was recorded with other runs alone says nothing of this one.
            first, last = recorded[key[0]]
            look.chains = [one for one in look.chains if one.record_ns[0] <= last and one.record_ns[1] >= first]
        if not look.chains and need is Need.TOLD and not match:
            found[key] = CheckedPath("none", remark="recorded in another run")
            continue
        choice_of = PathChoice(key[1], look, named=named, match=match_all)
        found[key], second = choice_of.first()
        if not wanted:
            still = found[key].still if look.may_be_static else np.zeros(0, bool)
            found[key] = replace(found[key], verdict="none", chain=None, notes=(), still=still)
        elif second:
            again[key] = choice_of, second
        else:
            found[key] = choice_of.beside(found[key])
    for key, sweeps in _sweeps(log, choice, rules, moves) if again else ():
        for look in again[key][1] if key in again else ():
            look.add(sweeps)
    return found | {key: one.beside(one.second(second)) for key, (one, second) in again.items()}, sweeps_of


def _sweeps(
    log: Log, choice: TopicChoice, rules: RangeRules, moves: Went | None
) -> Iterator[tuple[tuple[int, Key], SweepBatch]]:
    """Yield the sweeps of a log by run, topic and frame; the pass that makes the tables reports the damage.

    Those that repeat old ones say nothing of the path.
    """
    for batch in LogBatcher(log, ReadOptions(choice.wanted or None, rules=rules), ReadReport(), choice, moves).batches():
        for frame, _, sweeps in batch.by_frame():
            hung = ~sweeps.observed & (sweeps.status == Status.VALID).any(axis=1)
            if not hung.all():
                yield (batch.run, (batch.topic, frame)), sweeps.rows(np.flatnonzero(~hung)) if hung.any() else sweeps
