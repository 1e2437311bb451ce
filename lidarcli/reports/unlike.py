"""Whether the sweeps of a run are of sensors that are alike: what is unlike should not be pooled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lidarcli.reports.streams import Stream

ALIKE = 1.2
"""Rates, and numbers of beams, up to this ratio are those of sensors of one kind: no two motors turn equally fast."""


@dataclass(frozen=True, slots=True)
class Unlike:
    """In what the sensors of a run are unlike; empty is what they have in common."""

    rates: tuple[float, ...] = ()
    """[Hz], of every stream that has one."""
    beams: tuple[float, ...] = ()
    """Of a sweep, the median of every stream."""
    frames: tuple[str, ...] = ()
    """A frame is the place of a sensor on its robot: what is ahead of the one may be behind the other."""

    def __bool__(self) -> bool:
        return bool(self.rates or self.beams or self.frames)


def unlike_of(streams: Sequence[Stream]) -> Unlike:
    """The sensors of these streams beside each other."""
    rates = tuple(one.rate for one in streams if one.rate is not None)
    beams = tuple(float(one.beams) for one in streams)
    frames = tuple(dict.fromkeys(one.frame_id for one in streams))
    return Unlike(
        rates if _differ(rates) else (), beams if _differ(beams) else (), frames if len(frames) > 1 else ()
    )


def _differ(values: Sequence[float]) -> bool:
    """Whether the greatest is more than `ALIKE` times the least."""
    return bool(values) and max(values) > ALIKE * min(values)
