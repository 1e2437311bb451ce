"""The parts of a log: batches in, rows of the tables out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pyarrow as pa

from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.catalogue import Catalogue, names_in
from lidarcli.pipeline.objects.finders import finder
from lidarcli.pipeline.reading.summary import RunSummary
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular.rows import beams_rows, objects_rows, sweeps_rows

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions

Rows = tuple[str, str, pa.RecordBatch]
"""(table, topic, rows)"""

_ROWS = {"sweeps": sweeps_rows, "beams": beams_rows}


def rows_of(
    log: str, tables: Sequence[str], batch: SweepBatch, detection: Detection, labels: Sequence[str] = ()
) -> list[Rows]:
    """The rows that a batch of a log gives, of each of the tables; `labels` are the names in the catalogue."""
    return [(table, batch.topic, _rows(table, log, batch, detection, labels)) for table in tables]


def _rows(
    table: str, log: str, batch: SweepBatch, detection: Detection, labels: Sequence[str]
) -> pa.RecordBatch:
    if table == "objects":
        return objects_rows(log, batch, detection, labels)
    return _ROWS[table](log, batch, detection)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What is to be made of every batch."""

    log: str
    """Its name, as the tables have it."""
    tables: tuple[str, ...]
    parameters: Parameters
    background: BackgroundOptions | None = None
    catalogue: Catalogue | None = None
    followed: bool = False
    """Whether the objects are followed afterwards, which needs more than rows."""
    explain: bool = False
    """Whether to tell why a body is a thing."""


@dataclass(slots=True)
class Made:
    """What was made of one batch."""

    rows: list[Rows]
    seen: tuple[SweepBatch, Detection] | None = None
    """What it was made of, where the objects are followed afterwards."""


@dataclass(slots=True)
class Part:
    """What was made of some batches."""

    batches: list[Made] = field(default_factory=list)
    """In the order of the log."""
    found: RunSummary = field(default_factory=RunSummary)
    """Its objects, counted, unless they are followed afterwards."""

    @property
    def rows(self) -> Iterator[Rows]:
        """The rows of all batches, for each table in the order of the log."""
        return (rows for made in self.batches for rows in made.rows)


class Maker:
    """Makes parts by a recipe, in any order and in several threads at once."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._labels = names_in(recipe.catalogue)
        self.find = finder(recipe.parameters, recipe.background, recipe.catalogue, explain=recipe.explain)

    def make(self, batches: Sequence[SweepBatch]) -> Part:
        """The rows of some batches."""
        part = Part()
        tables, followed = self._recipe.tables, self._recipe.followed
        for batch in batches:
            detection = self.find(batch, "beams" in tables)
            if not followed:
                part.found.add_sets(detection)
            rows = rows_of(self._recipe.log, tables, batch, detection, self._labels)
            part.batches.append(Made(rows, (batch, detection) if followed else None))
        return part
