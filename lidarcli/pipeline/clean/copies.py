"""Messages of a copy, with the values of removed beams."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np

from lidarcli.copying.copying import Cut, replaced
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.blocks import ScanLayout
from lidarcli.options.choices import ABOVE
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.clean.beams import Chosen
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.inputs.tracked import columns_of
from lidarcli.sweeps.findings import LEAP
from lidarcli.sweeps.types import STATUSES, Int64


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


def copies_of(cuts: Iterable[Cut | None], topic: str) -> Counter[int] | None:
    """Return how often each sweep of a topic is written; None where all are, once."""
    every = [cut.sweeps.get(topic) if cut is not None and cut.sweeps else None for cut in cuts]
    return None if None in every else Counter(number for numbers in every for number in numbers or ())


def statuses_in(tables: TableSet, rows: Mapping[str, Int64]) -> Counter[str]:
    """Return the beams by status of some sweeps of each topic."""
    columns = columns_of(tables, "sweeps", ("topic", *STATUSES))
    topics = columns.pop("topic")
    own = np.concatenate([np.flatnonzero(topics == topic)[numbers] for topic, numbers in rows.items()])
    return Counter({name: int(beams[own].sum()) for name, beams in columns.items()})
