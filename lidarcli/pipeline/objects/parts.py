"""The parts of a log: batches in, rows of the tables out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pyarrow as pa

from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.catalogue import Catalogue
from lidarcli.pipeline.objects.finders import finder
from lidarcli.pipeline.reading.summary import RunSummary
from lidarcli.sweeps import SweepBatch
from lidarcli.tables.rows import beams_rows, objects_rows, sweeps_rows

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions

_ROWS = {"sweeps": sweeps_rows, "beams": beams_rows}


@dataclass(frozen=True, slots=True)
class Recipe:
    """What is to be made of every batch."""

    log: str
    """Its name, as the tables have it."""
    tables: tuple[str, ...]
    parameters: Parameters
    background: BackgroundOptions | None = None
    catalogue: Catalogue | None = None


@dataclass(slots=True)
class Part:
    """What was made of some batches."""

    rows: list[tuple[str, str, pa.RecordBatch]] = field(default_factory=list)
    """(table, topic, rows), for each table in the order of the log."""
    found: RunSummary = field(default_factory=RunSummary)
    """Its objects, counted."""


class Maker:
    """Makes parts by a recipe, in any order and in several threads at once."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self.find = finder(recipe.parameters, recipe.background, recipe.catalogue)

    def make(self, batches: Sequence[SweepBatch]) -> Part:
        """The rows of some batches."""
        part = Part()
        tables = self._recipe.tables
        for batch in batches:
            detection = self.find(batch, "beams" in tables)
            part.found.add_objects(detection)
            part.rows += [(table, batch.topic, self._rows(table, batch, detection)) for table in tables]
        return part

    def _rows(self, table: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
        log, catalogue = self._recipe.log, self._recipe.catalogue
        if table == "objects":
            return objects_rows(log, batch, detection, () if catalogue is None else catalogue.names)
        return _ROWS[table](log, batch, detection)
