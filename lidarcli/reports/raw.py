"""The ranges of the sweeps that a report shows."""

from __future__ import annotations

from dataclasses import dataclass

from lidarcli.sweeps import Float64, Int64, UInt8


@dataclass(frozen=True, slots=True)
class Raw:
    """Ranges of K sweeps of one topic, sorted by index."""

    sweep: Int64
    """(K,)"""
    angle_min: Float64
    angle_increment: Float64
    closure: UInt8
    beams: Int64
    ranges: Float64
    """(K, B) metres; NaN without a range and beyond `beams`."""
