"""A folder of tables that a run over many logs writes: which logs have their tables already, and which may be replaced."""

from __future__ import annotations

import glob
import json
import os
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from lidarcli._version import __version__
from lidarcli.errors import LidarcliError, OutputError, UnreadableError
from lidarcli.files.newfiles import exists_already
from lidarcli.files.stores import Place, State, Url, absolute, has_bucket, head, listing, place, remove
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.runs.over_logs import Outcome
from lidarcli.system.records import dataclass, replace
from lidarcli.tabular.reading import file_metadata, note_value
from lidarcli.tabular.writing import BY_DATE, DAMAGE, PARAMETERS, SOURCE, VERSION

ASKED_AT_ONCE = 16
"""Logs whose tables are looked at at the same time: each request to a store takes tens of milliseconds."""
_DAY = re.compile(r"/date=[^/]*/")


@dataclass(frozen=True, slots=True)
class FolderStep:
    """One input of a run, and its outcome if it was done before; then nothing is read."""

    source: Source | MissingInput
    done: Outcome | None = None


class TableFolder:
    """The folder of tables of one run of `detect` or `track`; of a store all names in it are listed once.

    Raises
    ------
    OutputError
        There is no such bucket.
    """

    def __init__(self, folder: Place, options: DetectOptions) -> None:
        self._folder = folder
        self._options = options
        self._is_by_date = options.layout == BY_DATE
        self._listed: dict[str, State] | None = None
        """Object of a store → its state, once they were listed."""
        self._other_days: dict[Source, list[str]] = {}
        """Log → its tables of any day, which are to be replaced."""
        if isinstance(folder, Url):
            try:
                is_there = has_bucket(folder)
            except UnreadableError as err:
                raise OutputError(f"cannot write {err}") from err
            if not is_there:
                raise OutputError(f"cannot write {folder}: there is no such bucket")

    def plan(self, sources: Sequence[Source | MissingInput], *, resume: bool, overwrite: bool) -> list[FolderStep]:
        """Return the steps of a run.

        With `resume`, a log whose tables have the same parameters and version, and are no older than what they were made
        of, is done. One that is done again may replace its own tables, and those of others only with `overwrite`.
        """
        if self._is_by_date:
            self._other_days = {source: self.existing(source) for source in sources if isinstance(source, Source)}
        if resume:
            depends = [_state(place(file)).mtime_ns for file in self._options.inputs([])]
            newest = max(depends, default=0)
            self._list()
            with ThreadPoolExecutor(ASKED_AT_ONCE, "ask") as pool:
                return [*pool.map(partial(self._resumed, newest=newest, overwrite=overwrite), sources)]
        steps = [FolderStep(source) for source in sources]
        # A log of this name may have tables of another day, which would be removed.
        return self.refused(steps) if self._is_by_date and not overwrite else steps

    def refused(self, steps: Sequence[FolderStep]) -> list[FolderStep]:
        """Refuse logs whose tables are there already, before any is sent to a worker.

        On a cluster a log may be done twice: tables that its first worker wrote before it died must not refuse it.
        """
        found = []
        for step in steps:
            existing = self.existing(step.source) if isinstance(step.source, Source) and step.done is None else []
            found.append(FolderStep(MissingInput(step.source.path, exists_already(existing[0]))) if existing else step)
        return found

    def outputs(self, source: Source) -> list[str]:
        """Return the tables of a log, as far as their names are known before reading."""
        return [] if self._is_by_date else [str(path) for path in self._options.outputs(source, self._folder).values()]

    def existing(self, source: Source) -> list[str]:
        """Return the tables of a log that are there already, of whatever day."""
        if not self._is_by_date:
            return [*filter(self.is_there, map(absolute, self.outputs(source)))]
        if isinstance(self._folder, Url):
            dated = {_DAY.sub("/", name): name for name in self._list()}
            names = (absolute(self._folder / table / f"{source.name}.parquet") for table in self._options.tables)
            return [dated[name] for name in names if name in dated]
        name = f"date=*/{glob.escape(source.name)}.parquet"
        return [absolute(path) for table in self._options.tables for path in sorted(self._folder.glob(f"{table}/{name}"))]

    def is_there(self, name: str) -> bool:
        """Return True if there is a file of this name."""
        return name in self._list() if isinstance(self._folder, Url) else os.path.exists(name)  # noqa: PTH110 (never raises)

    def remove_other_days(self, outcome: Outcome) -> list[str]:
        """Remove the tables of a log that has another day now: a reader of the folder would find it twice."""
        if outcome.summary is None or not isinstance(outcome.source, Source):
            return []
        notes = []
        outputs = [*map(absolute, outcome.summary.outputs)]
        for old in self._other_days.pop(outcome.source, ()):
            if old not in outputs:
                try:
                    remove(place(old))
                except OutputError as err:
                    notes.append(f"{err}; the log has another day now, and is there twice")
        return notes

    def _list(self) -> dict[str, State]:
        if self._listed is None:
            self._listed = {}
            if isinstance(self._folder, Url):
                self._listed = {str(url): state for url, state in listing(self._folder)}
        return self._listed

    def _resumed(self, source: Source | MissingInput, newest: int, overwrite: bool) -> FolderStep:
        if isinstance(source, MissingInput):
            return FolderStep(source)
        existing = self.existing(source)
        notes = [_notes(name) for name in existing]
        if len(existing) == len(self._options.tables) and self._are_of(source, existing, notes, newest):
            damage = "; ".join(map(str, note_value(notes[0], DAMAGE, list)))
            code = UnreadableError.exit_code if damage else 0
            return FolderStep(source, Outcome(source.label, code, error=damage or None, source=source, skipped=True))
        for name, note in zip(existing, notes, strict=True):
            if not overwrite and note_value(note, SOURCE, dict).get("name") != _written_name(source):
                error = OutputError(f"{name} exists and is not of this log; use --overwrite to replace it")
                return FolderStep(MissingInput(source.path, error))
        return FolderStep(source)

    def _are_of(self, source: Source, tables: Sequence[str], notes: Sequence[dict[str, str]], newest: int) -> bool:
        """Return True if tables were made of this log as it is now, with the same parameters and version."""
        if self._options.explain or (state := _known(source)) is None:
            return False
        parameters = json.loads(json.dumps(self._options.as_dict()))
        # The reader of a folder does not count all of its files.
        counts_all = all(
            not part.files and (part.url is not None or not Path(part.path).is_dir()) for part in source.parts or (source,)
        )
        for note in notes:
            log = note_value(note, SOURCE, dict)
            if log.get("name") != _written_name(source) or (counts_all and log.get("size") != state.size):
                return False
            if note_value(note, PARAMETERS, dict) != parameters or note.get(VERSION) != __version__:
                return False
        # As make does: what the tables were made of is older than they are.
        written = [(self._list().get(name) or _state(place(name))).mtime_ns for name in tables]
        return min(written) >= max(state.mtime_ns, newest)


def _written_name(source: Source) -> str:
    """Return the name of a log as the metadata of its tables has it, which is UTF-8."""
    return source.file_name.encode(errors="replace").decode()


def _known(source: Source) -> State | None:
    """Return the state of a log; None where it is unknown. Reading it raises the errors."""
    try:
        if source.parts:
            return replace(source, parts=tuple(replace(part, found=_known(part)) for part in source.parts)).state()
        return source.state() or (None if source.url is None else _state(source.url))
    except LidarcliError:
        return None


def _state(where: Place) -> State:
    """Return size and time of a file that is there."""
    found = head(where) if isinstance(where, Url) else Source(str(where), "").state()
    if found is None:
        raise UnreadableError(f"{where}: no such file")
    return found


def _notes(name: str) -> dict[str, str]:
    try:
        return file_metadata(place(name))
    except UnreadableError:
        return {}
