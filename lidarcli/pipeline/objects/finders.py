"""What finds the objects of a batch: the sweep by itself, or its difference from a background."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.sweeps import SweepBatch

if TYPE_CHECKING:
    from lidarcli.formalism.catalogue import Catalogue
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions


class Finder(Protocol):
    """Finds the objects of batches, in any order and in several threads at once; counts what a user should know."""

    def admit(self, batch: SweepBatch) -> None:
        """Refuse a batch for which it cannot be used; asked in the order of the log, before anything is found in it."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection: ...

    def notes(self) -> list[str]:
        """What a user should know of it in the end, a line each."""


def finder(
    parameters: Parameters,
    background: BackgroundOptions | None,
    catalogue: Catalogue | None = None,
    *,
    explain: bool = False,
) -> Finder:
    """Each sweep by itself, or what differs from a background; with a catalogue its objects have labels.

    `explain`: also tell why a body is a thing, where that is decided by the sweep alone.
    """
    if catalogue is not None:
        from lidarcli.pipeline.objects.naming import Naming

        return Naming(finder(parameters, background, explain=explain), catalogue)
    if background is None:
        return _Alone(parameters, explain)
    from lidarcli.pipeline.objects.subtracting import Subtracting

    return Subtracting(background, parameters)


class _Alone:
    """Finds objects by the sweep alone."""

    def __init__(self, parameters: Parameters, explain: bool) -> None:
        self._parameters = parameters
        self._explain = explain

    def admit(self, batch: SweepBatch) -> None:
        """Every batch will do."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        return detect(batch, self._parameters, per_beam=per_beam, explain=self._explain)

    def notes(self) -> list[str]:
        """Nothing."""
        return []
