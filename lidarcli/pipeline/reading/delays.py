"""How late or early the poses of a log are, for each topic and frame: what `info` tells and `track` uses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidarcli.judging import RangeRules
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.choice import TopicChoice
from lidarcli.logs.piles import Settling
from lidarcli.sweeps import Int64, RawSweeps

if TYPE_CHECKING:
    from lidarcli.poses.delay import DelaySample
    from lidarcli.poses.sources import PoseSources, Told

MAX_DELAYS = 4
"""Topics and frames of which the delay of the poses is looked for: 0.1 s and a megabyte each."""
MOST_SWEEPS = 10_000
"""Sweeps that are read for it before those that are followed: a sensor that has hardly moved by then is left alone."""
SECOND = 1e-9
TRACKS, MAP = "tracks", "the map"
"""What a delay that fits better may be used for unasked."""


@dataclass(frozen=True, slots=True)
class Delay:
    """The delay that fits the sweeps of a topic and frame best."""

    seconds: float
    """The pose of a sweep is that at its header stamp and this much later."""
    saved: float
    """Share of the cells of the world that its points fill less."""

    def note(self, topic: str) -> str:
        """What a user should know who looks at the log."""
        return (
            f"{self._fits(topic)}: its points fill {self.saved:.0%} fewer cells of the world "
            f"(--pose-delay {self.seconds:.2f})"
        )

    def note_of_use(self, topic: str, purpose: str) -> str:
        """What a user should know who gets it unasked, for a purpose as `tracks`."""
        also = " also for the world columns" if purpose == TRACKS else "; 0 takes them as they are"
        return f"{self._fits(topic)}: used for {purpose} (--pose-delay {self.seconds:.2f}{also})"

    def _fits(self, topic: str) -> str:
        side = "after" if self.seconds > 0 else "before"
        return f"poses {abs(self.seconds):.2f} s {side} the header stamps of {topic} fit better"


class DelaySearch:
    """Looks for the delay of the first topics and frames that come; a fold over the blocks of a log."""

    def __init__(self, sources: PoseSources | Told, deskew: bool = True) -> None:
        self._sources = sources
        self._deskew = deskew
        self._samples: dict[tuple[str, str], DelaySample | None] = {}

    def add(self, block: RawSweeps, rules: RangeRules) -> None:
        """Take the sweeps of a block, in the order of the log."""
        for code in np.unique(block.frame).tolist():
            key = block.topic, block.frame_ids[code]
            if key not in self._samples and len(self._samples) < MAX_DELAYS:
                self._samples[key] = self._sample(key[1])
            sample = self._samples.get(key)
            if sample is not None and not sample.full:
                sample.add_raw(block.rows(block.frame == code), rules)

    def whole(self, topics: set[str]) -> bool:
        """Whether nothing more is to be learned of a log with these topics."""
        seen = {topic for topic, _ in self._samples}
        all_there = len(self._samples) == MAX_DELAYS or seen >= topics
        return all_there and all(sample is None or sample.full for sample in self._samples.values())

    def best(self) -> dict[tuple[str, str], Delay]:
        """Topic and frame → its delay, where one is clearly better than none."""
        found = {key: sample.best() for key, sample in sorted(self._samples.items()) if sample is not None}
        return {key: Delay(*best) for key, best in found.items() if best is not None}

    def _sample(self, frame: str) -> DelaySample | None:
        """What finds the delay of a frame that has a moving pose."""
        way = self._sources.way(frame)
        if way is None or way.span_ns is None:
            return None
        # Most logs have no poses and need not wait for the import.
        from lidarcli.poses.delay import DelaySample

        return DelaySample(way, self._deskew)


def later(stamp_ns: Int64, delay: float) -> Int64:
    """The stamps and a delay [s]; one at the end of its type stays there."""
    by = round(delay / SECOND)
    most = np.iinfo(np.int64).max - abs(by)
    moved: Int64 = np.clip(stamp_ns, -most, most) + by if by else stamp_ns
    return moved


def first_delays(
    log: Log, sources: PoseSources | Told, choice: TopicChoice, rules: RangeRules, deskew: bool = True
) -> Mapping[tuple[str, str], Delay]:
    """Topic and frame → the delay of its poses, by the first sweeps of a log that can be read twice.

    `--start`, `--end` and `--every` do not matter here: the clocks are the same all along, and the way is needed whole.
    """
    search = DelaySearch(sources, deskew)
    empty = {topic.name for topic in log.topics() or () if topic.messages == 0}
    topics, sweeps = set(choice.chosen) - empty, 0
    # The damage that this pass meets is told by the one over all sweeps.
    report = ReadReport()
    for block, judging in Settling(rules, report).blocks(log.scans(choice.asked, report)):
        search.add(block, judging)
        sweeps += len(block)
        if sweeps >= MOST_SWEEPS or search.whole(topics):
            break
    return search.best()
