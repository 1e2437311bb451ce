"""Options of `detect` and `track`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lidarcli.choices import NS
from lidarcli.formalism import Parameters
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.machine import cores
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.objects.making import Recipe
from lidarcli.pipeline.reading.one_log import named_files, reading_as_dict
from lidarcli.pipeline.reading.pose_sources import Need, PoseOptions
from lidarcli.stores.url import Place
from lidarcli.tabular.writing import table_paths

if TYPE_CHECKING:
    from lidarcli.formalism.matching.catalogue import Catalogue
    from lidarcli.pipeline.objects.following import TrackOptions
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions


OF_TRACKS = ("tracks", "trajectories")
"""Tables whose rows are known only once all sweeps of a track were seen."""


@dataclass(frozen=True, slots=True)
class DetectOptions:
    """Everything that `detect` and `track` let a user choose, apart from inputs and outputs."""

    parameters: Parameters = field(default_factory=Parameters)
    read: ReadOptions = field(default_factory=ReadOptions)
    opening: OpenOptions = field(default_factory=OpenOptions)
    poses: PoseOptions = field(default_factory=PoseOptions)
    background: BackgroundOptions | None = None
    """Background: only differences from it are objects."""
    tracking: TrackOptions | None = None
    """Follow things from sweep to sweep, and also write the tracks table."""
    catalogue: Catalogue | None = None
    """Things of interest, which objects are named by."""
    beams: bool = False
    """Also write the beams table."""
    explain: bool = False
    """Also fill the column `why`."""
    overwrite: bool = False
    layout: str | None = None
    """Layout of the tables below the folder, as of `table_path`."""
    stamps: str = NS
    """Unit of the stamps, as of `in_unit`."""
    jobs: int = 0
    """Processors to use at most, 0 for all; the result does not depend on it."""
    cores: int = field(default_factory=cores)
    """Processors that there are."""

    @property
    def threads(self) -> int:
        """Threads for the objects of one log, no more than processors."""
        return max(1, min(self.jobs or self.cores, self.cores))

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables to write."""
        beams = ("beams",) if self.beams else ()
        if self.tracking is None or not self.tracking.tracks:
            return ("objects", "sweeps", *beams)
        trajectories = ("trajectories",) if self.tracking.trajectories else ()
        return ("objects", "sweeps", "tracks", *trajectories, *beams)

    def outputs(self, source: Source, folder: Place, date: str | None = None) -> dict[str, Place]:
        """Return the path of each table of a log; `date` as of `Reading.date`."""
        return table_paths(folder, source.name, self.tables, self.layout, date)

    def inputs(self, sources: Sequence[Source | MissingInput]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        options = [each.path for each in (self.background, self.catalogue) if each is not None]
        return [*files_of(sources), *filter(None, options), *named_files(self)]

    @property
    def need(self) -> Need:
        """Sensors whose path is matched where the log tells none."""
        return Need.TOLD if self.tracking is None else Need.MOVING

    def recipe(self, source: Source, tables: tuple[str, ...]) -> Recipe:
        """Return the instructions for every batch of a log."""
        of_batches = tuple(table for table in tables if table not in OF_TRACKS)
        followed = self.tracking is not None
        # Where things are followed, their names are those of the tracks.
        catalogue = None if followed else self.catalogue
        parameters = self.parameters if self.tracking is None else self.tracking.found_with(self.parameters)
        return Recipe(
            source.name, of_batches, parameters, self.background, catalogue, followed=followed, explain=self.explain
        )

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the tables' metadata."""
        background = {} if self.background is None else {"background": self.background.as_dict()}
        # A delay of 0 that the user gave matters only where things are followed.
        as_told = {"pose_delay": 0.0} if self.tracking is not None and self.poses.delay == 0.0 else {}
        return {
            **self.parameters.as_dict(),
            **reading_as_dict(self.read, self.opening, self.poses),
            **as_told,
            **background,
            **({} if self.tracking is None else {"tracking": self.tracking.as_dict()}),
            **({} if self.catalogue is None else {"catalogue": self.catalogue.as_dict()}),
            **({} if self.stamps == NS else {"stamps": self.stamps}),
        }
