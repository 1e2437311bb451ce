"""What tracking may assume: each parameter has a unit, a default and an option on the command line."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from lidarcli.errors import OptionError


@dataclass(frozen=True, slots=True)
class TrackParameters:
    """What `track` lets a user choose beside the parameters of the detection."""

    significance: float = 1e-5
    """Share of the standing things that may pass for moving by chance: the smaller, the later a slow mover is told."""
    memory: bool = True
    """Whether what a thing is, and its shape, are decided by all sweeps that saw it, not anew in each."""

    def __post_init__(self) -> None:
        if not 1e-12 <= self.significance <= 0.1:
            raise OptionError(f"--significance: {self.significance:g} is not between 1e-12 and 0.1")

    def as_dict(self) -> dict[str, Any]:
        """Plain values by name, for the tables' metadata."""
        return asdict(self)
