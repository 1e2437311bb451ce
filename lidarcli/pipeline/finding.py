"""What finds the objects of a batch: the sweep by itself, or its difference from a background."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.sweeps import SweepBatch

if TYPE_CHECKING:
    from lidarcli.pipeline.subtracting import BackgroundOptions


class Finder(Protocol):
    """Finds the objects of batches, in any order; counts what a user should know."""

    def admit(self, batch: SweepBatch) -> None:
        """Refuse a batch for which it cannot be used; asked in the order of the log, by one process."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection: ...

    def take(self) -> Any:
        """What it has counted and not yet handed over, for the finder of another process."""

    def add(self, counted: Any) -> None:
        """Count what another one has counted."""

    def notes(self) -> list[str]:
        """What a user should know of it in the end, a line each."""


def finder(parameters: Parameters, background: BackgroundOptions | None, helping: bool = False) -> Finder:
    """Each sweep by itself, or what differs from a background; `helping` one that admits every batch."""
    if background is None:
        return _Alone(parameters)
    from lidarcli.pipeline.subtracting import Subtracting

    return Subtracting(background, parameters, helping)


class _Alone:
    """Finds objects by the sweep alone."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def admit(self, batch: SweepBatch) -> None:
        """Every batch will do."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        return detect(batch, self._parameters, per_beam=per_beam)

    def take(self) -> None:
        """Nothing is counted."""

    def add(self, counted: None) -> None:
        """Nothing is counted."""

    def notes(self) -> list[str]:
        """Nothing."""
        return []
