"""Parts that copies of all containers share: the ranges that are replaced, and the count of the messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import ReadReport
from lidarcli.logs.blocks import Locate, ScanLayout
from lidarcli.sweeps import Bool

Edit = Callable[[str, bytes, Locate], bytes]
"""Takes topic and message, and what finds its ranges; returns the message to write, the same one if nothing changes."""


@dataclass(slots=True)
class Copy:
    """One copy of a log, as far as it has come."""

    edit: Edit
    """Called for every message of sweeps, in log order."""
    report: ReadReport = field(default_factory=ReadReport)
    messages: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Topic and type → messages that were copied."""
    left_out: int = 0
    """Records of applications that are no messages, attachments or metadata."""


def replaced(message: bytes, written: ScanLayout, chosen: Bool, value: float) -> bytes:
    """Return a message in which all ranges of the chosen beams (B,) say a value."""
    places = written.place[chosen[written.beam]]
    number = np.frombuffer(np.array(value, written.kind).tobytes(), np.uint8)
    data = np.frombuffer(message, np.uint8).copy()
    data[places[:, None] + np.arange(len(number))] = number
    return data.tobytes()
