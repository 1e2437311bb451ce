"""What finds objects and names them, by a catalogue and each sweep alone."""

from __future__ import annotations

from dataclasses import replace

from lidarcli.formalism import Detection
from lidarcli.formalism.catalogue import Catalogue, name
from lidarcli.formalism.evidence import evidence_of
from lidarcli.pipeline.objects.finders import Finder
from lidarcli.sweeps import SweepBatch


class Naming:
    """A finder whose objects have labels: indices into the names of the catalogue."""

    def __init__(self, find: Finder, catalogue: Catalogue) -> None:
        self._find = find
        self._catalogue = catalogue
        self.admit = find.admit
        self.notes = find.notes

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        """The objects of a batch."""
        found = self._find(batch, per_beam)
        label, score = name(evidence_of(batch, found), self._catalogue)
        return replace(found, label=label, label_score=score)
