"""How much compressed data is believed: a kilobyte of a bomb unpacks to a gigabyte of nothing."""

from __future__ import annotations

from dataclasses import dataclass, field

SMALL = 64 << 20
"""So many bytes may always come out."""
MAX_RATIO = 1000
"""And of a whole log so many times what went in. Most logs stay below 50; 1,081 beams without any return, and as many
intensities, reach 530 as MCAP and 690 as bz2."""
CHUNK_RATIO = 64
"""And so many times of a part that has to be held in memory as a whole."""


@dataclass(slots=True)
class Unpacking:
    """What one pass over a log may still unpack to."""

    left: int = field(default_factory=lambda: SMALL)

    def room(self, packed: int) -> int:
        """Most bytes that are believed of so many more packed ones."""
        self.left += packed * MAX_RATIO
        return max(0, self.left)

    def used(self, size: int) -> None:
        """So many bytes have come out."""
        self.left -= size


def too_much(size: int, packed: int) -> str:
    """The cause of a loss."""
    return f"it declares {size:,} bytes, more than is believed of {packed:,} packed ones"
