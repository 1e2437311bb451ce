"""One log through the formalism into tables: files in, files out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lidarcli.formalism import Parameters
from lidarcli.formalism.catalogue import Catalogue
from lidarcli.logs.base import Log, OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.newfiles import refuse
from lidarcli.pipeline.inputs.opening import open_source
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.objects.parts import Recipe, Rows
from lidarcli.pipeline.reading.delays import TRACKS
from lidarcli.pipeline.reading.pose_options import PoseOptions
from lidarcli.pipeline.reading.reading import Progress, Reading, reading_as_dict
from lidarcli.pipeline.reading.summary import RunSummary
from lidarcli.pipeline.running.cores import cores
from lidarcli.pipeline.running.splitting import Splitting
from lidarcli.stores.url import Place
from lidarcli.tabular.files import BY_DATE, TableFiles, table_paths
from lidarcli.tabular.metadata import table_metadata
from lidarcli.tabular.order import RowSink, TopicOrders

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.following import TrackOptions
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions


@dataclass(frozen=True, slots=True)
class DetectOptions:
    """Everything that `detect` and `track` let a user choose, apart from inputs and outputs."""

    parameters: Parameters = field(default_factory=Parameters)
    read: ReadOptions = field(default_factory=ReadOptions)
    opening: OpenOptions = field(default_factory=OpenOptions)
    poses: PoseOptions = field(default_factory=PoseOptions)
    background: BackgroundOptions | None = None
    """Only what differs from this background is an object."""
    tracking: TrackOptions | None = None
    """Follow things from sweep to sweep, and also write the tracks table."""
    catalogue: Catalogue | None = None
    """Things of interest, which objects are named by."""
    beams: bool = False
    """Also write the beams table."""
    explain: bool = False
    """Also tell why each object is a thing."""
    overwrite: bool = False
    layout: str | None = None
    """How tables are laid out below the folder, as of `table_path`."""
    jobs: int = 0
    """Processors to use at most, 0 for all; the result does not depend on it."""
    cores: int = field(default_factory=cores)
    """Processors that there are."""

    @property
    def threads(self) -> int:
        """Threads for the objects of one log: more than there are processors would only be in each other's way."""
        return max(1, min(self.jobs or self.cores, self.cores))

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables to write."""
        tracks = ("tracks",) if self.tracking is not None and self.tracking.tracks else ()
        return ("objects", "sweeps", *tracks, *(("beams",) if self.beams else ()))

    def outputs(self, source: Source, folder: Place, date: str | None = None) -> dict[str, Place]:
        """Table → where that of one log goes; `date` as of `Reading.date`."""
        return table_paths(folder, source.name, self.tables, self.layout, date)

    def inputs(self, sources: Sequence[Source | Nothing]) -> list[str]:
        """The files that are read, none of which an output may replace."""
        options = [each.path for each in (self.background, self.catalogue) if each is not None]
        return [*files_of(sources), *(path for path in (*options, self.poses.file) if path)]

    def reading(self, log: Log) -> Reading:
        """The sweeps of a log with their poses."""
        return Reading(log, self.read, self.poses, TRACKS if self.tracking is not None else "")

    def recipe(self, source: Source, tables: tuple[str, ...]) -> Recipe:
        """What is to be made of every batch of a log."""
        of_batches = tuple(table for table in tables if table != "tracks")
        followed = self.tracking is not None
        # Where things are followed, their names are those of the tracks.
        catalogue = None if followed else self.catalogue
        parameters = self.parameters if self.tracking is None else self.tracking.found_with(self.parameters)
        return Recipe(
            source.name,
            of_batches,
            parameters,
            self.background,
            catalogue,
            followed=followed,
            explain=self.explain,
        )

    def as_dict(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values, for the tables' metadata."""
        background = {} if self.background is None else {"background": self.background.as_dict()}
        # Only where things are followed it matters whether somebody has said so.
        as_told = {"pose_delay": 0.0} if self.tracking is not None and self.poses.delay == 0.0 else {}
        return {
            **self.parameters.as_dict(),
            **reading_as_dict(self.read, self.opening, self.poses),
            **as_told,
            **background,
            **({} if self.tracking is None else {"tracking": self.tracking.as_dict()}),
            **({} if self.catalogue is None else {"catalogue": self.catalogue.as_dict()}),
        }


def detect_to_files(
    source: Source, folder: Place, options: DetectOptions, progress: Progress | None = None
) -> RunSummary:
    """Write the tables of one log below `folder`; they appear when all of them are whole, or not at all."""
    known_before = options.layout != BY_DATE
    if known_before:
        refuse(options.outputs(source, folder).values(), options.overwrite, options.inputs([source]))
    with (
        open_source(source, options.opening) as log,
        options.reading(log) as reading,
        ExitStack() as stack,
    ):

        def opened() -> TableFiles:
            paths = options.outputs(source, folder, reading.date)
            if not known_before:
                refuse(paths.values(), options.overwrite, options.inputs([source]))
            return stack.enter_context(TableFiles(paths, reading.first, options.overwrite))

        files = opened() if known_before else None
        work = stack.enter_context(
            Splitting(reading, options.recipe(source, options.tables), options.threads)
        )
        summary = reading.summary
        for table, topic, rows in _rows(source, reading, work, options, progress):
            # The day of a log is that of its first sweep.
            files = files or opened()
            files.write(table, topic, rows)
            summary.rows += rows.num_rows
        files = files or opened()
        described = reading.describe(source)
        summary.notes += files.publish(table_metadata(options.as_dict(), described, summary.damage))
        summary.outputs = [str(path) for path in files.paths]
        summary.output_sizes = files.sizes
    return summary


def detect_to_sinks(
    source: Source, sinks: Mapping[str, RowSink], options: DetectOptions, progress: Progress | None = None
) -> tuple[RunSummary, dict[str, Any]]:
    """Pass the rows of one log to the sink of their table, in its order; also the description of the source."""
    with (
        open_source(source, options.opening) as log,
        options.reading(log) as reading,
        TopicOrders(sinks, reading.first) as orders,
        Splitting(reading, options.recipe(source, tuple(sinks)), options.threads) as work,
    ):
        orders.write(_rows(source, reading, work, options, progress))
        orders.drain()
        return reading.summary, reading.describe(source)


def _rows(
    source: Source, reading: Reading, work: Splitting, options: DetectOptions, progress: Progress | None
) -> Iterator[Rows]:
    """All rows of one log, those of a table and topic in their order; in the end the summary is whole."""
    summary = reading.summary
    following = None
    if options.tracking is not None:
        # Who does not track does not wait for this import.
        from lidarcli.pipeline.objects.following import Following

        following = Following(source.name, options.tracking, options.parameters, options.catalogue)
    for part in work.parts(progress):
        summary.add_found(part.found)
        yield from part.rows if following is None else following.take(part.batches)
    notes = []
    if following is not None:
        yield from following.finish()
        summary.add_found(following.summary)
        notes = following.notes
    # The end of the work: the summary tells how long it took.
    reading.close()
    summary.notes += [*work.notes(), *notes]
