"""Messages on their way into a file."""

from __future__ import annotations

from typing import NamedTuple


class Outgoing(NamedTuple):
    """One message on its way into a file."""

    topic: str
    type: str
    record_ns: int
    stamp_ns: int
    """Where the message has one, else as `record_ns`."""
    data: bytes
