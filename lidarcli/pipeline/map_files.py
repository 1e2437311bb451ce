"""The files of a map: one fold over several logs, whose outputs appear together when all have been read."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO

from lidarcli.choices import CLOUDS
from lidarcli.errors import OptionError, OutputError
from lidarcli.formalism.mapping.occupancy import Occupancy
from lidarcli.machine import cores
from lidarcli.maps.clouds import CloudWriter, ParquetWriter, PcdWriter, PlyWriter
from lidarcli.maps.mapserver import pgm_bytes, write_occupancy_mcap, yaml_bytes
from lidarcli.newfiles import NewFiles, refuse, scratch_folder, writing
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.mapping import MapOptions, Mapping
from lidarcli.pipeline.reading.one_log import Progress, RunSummary, named_files
from lidarcli.pipeline.reading.posing import Need, of_one_run
from lidarcli.pipeline.runs.outcomes import Outcome
from lidarcli.pipeline.runs.over_logs import LogProgress, logs_at_once, over_logs
from lidarcli.stores.url import Place
from lidarcli.tabular.writing import table_metadata

GRIDS = (".yaml", ".png", ".mcap")
"""Suffixes of outputs that are made of the grid."""
WRITERS: dict[str, type[PlyWriter] | type[PcdWriter] | type[ParquetWriter]] = dict(
    zip(CLOUDS, (PlyWriter, PcdWriter, ParquetWriter), strict=True)
)
"""Suffix of a cloud → its writer."""


@dataclass(frozen=True, slots=True)
class Mapped:
    """Result of a run."""

    grid: Occupancy
    worlds: tuple[str, ...]
    sweeps: int
    """Sweeps that count."""
    outputs: tuple[Place, ...]
    notes: tuple[str, ...]


class MapRun:
    """One map of several logs, written when all have been read.

    Parameters
    ----------
    outputs : files, whose suffixes say what they are (`GRIDS`, `CLOUDS`)

    Raises
    ------
    OptionError
        A suffix is none of these, or two outputs would be one file.
    OutputError
        A file is there that may not be replaced.
    """

    def __init__(self, sources: Sequence[Source | Nothing], outputs: Sequence[Place], options: MapOptions) -> None:
        self._sources = sources
        self._options = options
        self._outputs = tuple(outputs)
        self._files = _files(outputs)
        refuse(self._files, options.overwrite, [*files_of(sources), *named_files(options)])
        needs_sets = options.without is not None or any(path.suffix.lower() == ".parquet" for path in outputs)
        # Paths that are matched lie each in a world of its own.
        self._options = options = replace(options, need=Need.ALL if len(sources) == 1 else Need.TOLD)
        self._mapping = Mapping(options, needs_sets)
        self._new = NewFiles(self._files, options.overwrite)
        self._clouds: list[CloudWriter] = []
        self._open: list[tuple[Place, BinaryIO]] = []
        self._stack = ExitStack()

    def outcomes(self, report: LogProgress | None = None) -> Iterator[Outcome]:
        """Take log after log, or several at the same time; a bad one does not stop the rest."""
        jobs = self._options.jobs or cores()
        # The points of a cloud have their order.
        at_once = 1 if self._clouds else logs_at_once(self._sources, jobs)
        if at_once < 2:
            yield from map(_whole, over_logs(self._sources, self.add, report))
            return
        with scratch_folder() as scratch:
            work = partial(_map_apart, options=self._options, sets=self._mapping.sets, scratch=str(scratch))
            for outcome in over_logs(self._sources, work, report, at_once):
                if outcome.summary is not None:
                    part = Path(outcome.summary.outputs.pop())
                    self._mapping.merge(pickle.loads(part.read_bytes()))
                    part.unlink()
                yield _whole(outcome)

    def add(self, source: Source, progress: Progress | None = None) -> RunSummary:
        """Take one log; errors as of `Mapping.add`."""
        with writing(self._open[0][0], nameless=True) if self._open else nullcontext():
            return self._mapping.add(source, self._clouds, progress)

    @property
    def is_empty(self) -> bool:
        """True where no log could be read."""
        return not self._mapping.described

    def finish(self) -> Mapped:
        """Write the map of all logs that could be read."""
        mapping = self._mapping
        grid = mapping.occupancy()
        notes = self._notes(grid)
        metadata = table_metadata(self._options.as_dict(), mapping.described, mapping.damage)
        for cloud, (path, file) in zip(self._clouds, self._open, strict=True):
            with writing(path):
                cloud.finish(metadata)
                file.close()
        for path in self._outputs:
            self._write(path, grid)
        notes += self._new.publish()
        worlds = tuple(mapping.worlds)
        return Mapped(grid, worlds, mapping.counts.sweeps, self._files, tuple(notes))

    def __enter__(self) -> MapRun:
        try:
            self._stack.enter_context(self._new)
            for path in self._outputs:
                if (make := WRITERS.get(path.suffix.lower())) is not None:
                    self._open_cloud(path, make)
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    def _open_cloud(self, path: Place, make: type[PlyWriter] | type[PcdWriter] | type[ParquetWriter]) -> None:
        with writing(path):
            file = self._new.part(path).open("w+b")
            self._stack.callback(_let_go, file)
            cloud = make(file, self._options.stamps) if make is ParquetWriter else make(file)
        self._stack.callback(cloud.abandon)
        self._clouds.append(cloud)
        self._open.append((path, file))

    def _write(self, path: Place, grid: Occupancy) -> None:
        """Write one output that is made of the grid."""
        suffix, part = path.suffix.lower(), self._new.part(path)
        with writing(path):
            if suffix == ".yaml":
                image = path.with_suffix(".pgm")
                part.write_bytes(yaml_bytes(grid, image.name))
                self._new.part(image).write_bytes(pgm_bytes(grid))
            elif suffix == ".mcap":
                with part.open("wb") as file:
                    write_occupancy_mcap(file, grid, self._mapping.end_ns)
            elif suffix == ".png":
                from lidarcli.reports.map_picture import MapPicture, draw_map

                part.write_bytes(draw_map(MapPicture(grid), ".png"))

    def _notes(self, grid: Occupancy) -> list[str]:
        """Return notes on the map, a line each."""
        mapping = self._mapping
        notes = []
        if len(mapping.worlds) > 1:
            notes.append(
                f"the logs have several world frames ({', '.join(mapping.worlds)}), laid onto each other as they are"
            )
        elif len(mapping.described) > 1 and any(map(of_one_run, mapping.worlds)):
            notes.append(
                f"{len(mapping.described)} logs are laid onto each other in the frame {next(iter(mapping.worlds))}: "
                "odometry begins anew in each, so give poses of a common map (--pose TOPIC, --poses FILE.tum)"
            )
        if not grid.occupied:
            notes.append(
                f"no cell is occupied: {mapping.counts.sweeps:,} sweeps were used, and a cell has to be hit by "
                f"{self._options.hits(mapping.counts.sweeps)} (--min-hits, --min-move)"
            )
        return notes


def _files(outputs: Sequence[Place]) -> tuple[Place, ...]:
    """Return all files of the outputs."""
    known = (*GRIDS, *WRITERS)
    files: list[Place] = []
    for path in outputs:
        suffix = path.suffix.lower()
        if suffix not in known:
            hint = f"; {path.with_suffix('.yaml')} comes with a .pgm" if suffix == ".pgm" else ""
            raise OptionError(f"{path}: the suffix of a map has to be one of {', '.join(known)}{hint}")
        if suffix == ".yaml" and not _is_text(path.name):
            raise OptionError(f"{path}: the YAML of a map names its image, and this name is not UTF-8")
        files += (path, path.with_suffix(".pgm")) if suffix == ".yaml" else (path,)
    return tuple(files)


def _is_text(name: str) -> bool:
    """Tell whether a name of a file is UTF-8."""
    return not any("\ud800" <= char <= "\udfff" for char in name)


def _whole(outcome: Outcome) -> Outcome:
    """End the run where a log does not fit the options or cannot be written: without it, it would be another map."""
    if outcome.exit_code == OptionError.exit_code:
        raise OptionError(f"{outcome.label}: {outcome.error}")
    if outcome.exit_code == OutputError.exit_code:
        raise OutputError(str(outcome.error))
    return outcome


def _map_apart(
    source: Source, options: MapOptions, sets: bool, scratch: str, progress: Progress | None = None
) -> RunSummary:
    """Take one log in a process of its own, and leave its part of the map in a file, the summary's output."""
    mapping = Mapping(options, sets)
    summary = mapping.add(source, progress=progress)
    mapping.counts.close()
    with tempfile.NamedTemporaryFile(dir=scratch, delete=False) as file:
        pickle.dump(mapping, file, pickle.HIGHEST_PROTOCOL)
    summary.outputs.append(file.name)
    return summary


def _let_go(file: BinaryIO) -> None:
    """Close a file that is given up."""
    with suppress(OSError):
        file.close()
