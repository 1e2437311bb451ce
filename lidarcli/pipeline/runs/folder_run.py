"""A run over many logs into one folder of tables: the plan of it, and the manifest of what was done."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from types import TracebackType
from typing import Self

from lidarcli._version import __version__
from lidarcli.errors import LidarcliError, OptionError, OutputError, UnreadableError
from lidarcli.newfiles import exists_already
from lidarcli.pipeline.inputs.files import read_file
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.pipeline.runs.manifest import (
    Manifest,
    Sources,
    There,
    is_unchanged,
    known,
    read_entries,
    remove_file,
    state_of,
)
from lidarcli.pipeline.runs.outcomes import Outcome
from lidarcli.stores.url import Place, Url, absolute, place
from lidarcli.tabular.reading import file_metadata, note_value
from lidarcli.tabular.runs import DAMAGED, FAILED, OK, Entry, newest
from lidarcli.tabular.writing import BY_DATE, DAMAGE, PARAMETERS, SOURCE, VERSION


@dataclass(frozen=True, slots=True)
class Step:
    """Step of a run: one input, and whether it is done already."""

    source: Source | MissingInput
    done: Entry | None = None
    """Entry of an earlier run that did it; then nothing is read."""


@dataclass(slots=True)
class Plan:
    """Steps of a run, and notes on the plan."""

    steps: list[Step]
    notes: list[str] = field(default_factory=list)

    @property
    def left(self) -> list[Source | MissingInput]:
        """Inputs that are still to be done."""
        return [step.source for step in self.steps if step.done is None]

    @property
    def skipped(self) -> list[Outcome]:
        """Outcomes of inputs that were done before, with their exit codes."""
        return [_as_before(step.source, step.done) for step in self.steps if step.done is not None]


class FolderRun:
    """One run of `detect` or `track` over many logs into a folder of tables.

    Parameters
    ----------
    folder : where the tables go
    options : of the detection
    keeps_manifest : whether outcomes are written to a manifest
    """

    def __init__(self, folder: Place, options: DetectOptions, keeps_manifest: bool) -> None:
        self._folder = folder
        self._options = options
        self._manifest = Manifest(folder) if keeps_manifest else None
        self._parameters = ""
        """Hash of the parameters, once there is a plan."""
        self._days: dict[str, list[str]] = {}
        """Log → its tables of any day, which are to be replaced."""
        self._before: dict[str, list[str]] = {}
        """Log → its tables of an earlier run."""

    def plan(self, sources: Sources, resume: bool, overwrite: bool) -> Plan:
        """Plan the run; `resume` leaves out logs that were done with the same parameters and version.

        Manifests tell which logs were done, or, where these are lost, the tables themselves. A log that is done again may
        replace its own tables, and those of others only with `overwrite`.
        """
        if resume or self._manifest is not None:
            sources = known(sources)
            # An error of the files of options comes before any work, once.
            self._parameters = parameters_hash(self._options)
        there = There(self._folder) if resume or self._options.layout == BY_DATE else None
        if there is not None and self._options.layout == BY_DATE:
            self._days = {_url(source): self._existing(source, there) for source in sources if isinstance(source, Source)}
        if not resume or there is None:
            plan = Plan([Step(source) for source in sources])
            if there is not None and not overwrite:
                # A log of this name may have tables of another day, which would be removed.
                self.refuse_existing(plan)
            return plan
        entries, problems = read_entries(self._folder)
        # A later failure, as for tables that were there, has left these as they are.
        by_url = newest(entry for entry in entries if entry.is_done)
        self._before = {
            url: [output for output in entry.outputs if _is_below(self._folder, output)] for url, entry in by_url.items()
        }
        told_of = {entry.url for entry in entries}
        mine = {output for entry in entries for output in entry.outputs}
        plan = Plan([], [f"{problem}; not used" for problem in problems])
        for source in sources:
            if isinstance(source, MissingInput):
                plan.steps.append(Step(source))
                continue
            outputs = tuple(map(absolute, self._outputs(source)))
            done = by_url.get(_url(source))
            if done is not None and not self._counts(done, source, there):
                done = None
            elif done is None and _url(source) not in told_of and any(map(there, outputs)):
                done = self._told_by_tables(source, outputs, there)
                if done is not None and self._manifest is not None:
                    self._manifest.add(done)
            existing = self._existing(source, there) if done is None and not overwrite else []
            foreign = [out for out in existing if out not in mine and not _is_of(out, source)]
            if foreign:
                error = OutputError(f"{foreign[0]} exists and is not of this log; use --overwrite to replace it")
                plan.steps.append(Step(MissingInput(source.path, error)))
                continue
            plan.steps.append(Step(source, done=done))
        return plan

    def refuse_existing(self, plan: Plan) -> None:
        """Refuse logs whose tables are there already, before any is sent to a worker.

        On a cluster a log may be done twice: tables that its first worker wrote before it died must not refuse it.
        """
        there = There(self._folder)
        for index, step in enumerate(plan.steps):
            if isinstance(step.source, Source) and step.done is None:
                existing = next(iter(self._existing(step.source, there)), None)
                if existing is not None:
                    plan.steps[index] = Step(MissingInput(step.source.path, exists_already(existing)))

    def dry(self, plan: Plan) -> Iterator[tuple[Step, list[tuple[str, bool]]]]:
        """Yield the steps of a plan with their files, as far as they are known before reading, and whether these exist."""
        there = There(self._folder)
        for step in plan.steps:
            outputs = self._outputs(step.source) if isinstance(step.source, Source) and step.done is None else ()
            yield step, [(output, there(absolute(output))) for output in outputs]

    def record(self, outcome: Outcome) -> list[str]:
        """Add the outcome of one log to the manifest; returns a line for each of its earlier tables that stays."""
        source = outcome.source
        if self._manifest is None or outcome.skipped or source is None:
            return []
        state = source.state() if isinstance(source, Source) else None
        summary = outcome.summary
        words = outcome.error or ("; ".join(summary.damage) if summary is not None and summary.damage else None)
        outputs = [absolute(output) for output in summary.outputs] if summary else []
        result = FAILED if summary is None else DAMAGED if summary.damage else OK
        self._manifest.add(
            Entry(
                log=source.name if isinstance(source, Source) else source.path,
                url=_url(source),
                size=state.size if state else None,
                etag=(state.etag or None) if state else None,
                mtime=(state.mtime_ns or None) if state else None,
                parameters=self._parameters,
                version=__version__,
                outcome=result,
                exit_code=outcome.exit_code,
                message=words,
                outputs=outputs,
                output_sizes=summary.output_sizes if summary else [],
                sweeps=summary.sweeps if summary else None,
                rows=summary.rows if summary else None,
                seconds=summary.seconds if summary else None,
            )
        )
        if not outputs:
            return []
        notes = self._remove_other_days(source, outputs)
        stale = [old for old in self._before.get(_url(source), ()) if old not in outputs]
        return notes + [
            f"{old} is of an earlier run with other options, and is left as it was"
            for old in stale
            if state_of(old) is not None
        ]

    def _remove_other_days(self, source: Source | MissingInput, outputs: Sequence[str]) -> list[str]:
        """Remove the tables of a log that has another day now: a reader of the folder would find it twice."""
        notes = []
        for old in self._days.pop(_url(source), ()):
            if old not in outputs:
                try:
                    remove_file(old)
                except OutputError as err:
                    notes.append(f"{err}; the log has another day now, and is there twice")
        return notes

    @property
    def manifest(self) -> Place | None:
        """Path of the manifest, if there is one."""
        return None if self._manifest is None else self._manifest.path

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        """Write the manifest, also of a run that was interrupted."""
        if self._manifest is None:
            return
        # The error that ended the run is reported, not one of the manifest.
        with suppress(*([LidarcliError] if kind is not None else [])):
            self._manifest.write()

    def _outputs(self, source: Source) -> tuple[str, ...]:
        if self._options.layout == BY_DATE:
            return ()
        return tuple(str(path) for path in self._options.outputs(source, self._folder).values())

    def _existing(self, source: Source, there: There) -> list[str]:
        """Return the tables of a log that are there already."""
        if self._options.layout == BY_DATE:
            folders = [self._folder / table for table in self._options.tables]
            return [found for folder in folders for found in there.of_any_day(folder, source.name)]
        return [*filter(there, map(absolute, self._outputs(source)))]

    def _counts(self, done: Entry, source: Source, there: There) -> bool:
        """Tell whether an entry counts: the same log, parameters and version, and its tables are still there."""
        if done.parameters != self._parameters or done.version != __version__ or not is_unchanged(source, done):
            return False
        # A manifest may name any files: the tables of this log in this folder count, and all of them.
        existing = self._days[done.url] if self._options.layout == BY_DATE else self._existing(source, there)
        if len(existing) != len(self._options.tables) or sorted(done.outputs) != sorted(existing):
            return False
        states = [there.state(output) for output in done.outputs]
        if [state.size if state is not None else None for state in states] != done.output_sizes:
            return False
        if all(state is not None and state.mtime_ns <= done.ended for state in states):
            return True
        # A run that wrote no manifest may have been here since, with other parameters.
        return self._is_by_parameters(_notes(done.outputs[0]))

    def _is_by_parameters(self, notes: dict[str, str]) -> bool:
        """Tell whether a table was written with the same parameters and version, by its metadata."""
        told = note_value(notes, PARAMETERS, dict)
        same = told == json.loads(json.dumps(self._options.as_dict())) and not self._options.explain
        return same and notes.get(VERSION) == __version__

    def _told_by_tables(self, source: Source, outputs: tuple[str, ...], there: There) -> Entry | None:
        """Return an entry for tables without a manifest that are of this log as it is, and of these parameters; or None."""
        notes, state = _notes(outputs[0]), source.state()
        told = note_value(notes, SOURCE, dict)
        if state is None or not self._is_by_parameters(notes):
            return None
        # The reader of a folder does not count all of its files.
        counts_all = all(
            not part.files and (part.url is not None or not Path(part.path).is_dir()) for part in source.parts or (source,)
        )
        if told.get("name") != source.file_name or (counts_all and told.get("size") != state.size):
            return None
        # As make does: the inputs of the tables are older than these.
        written = [found.mtime_ns for output in outputs if (found := there.state(output)) is not None]
        depends = [found.mtime_ns for file in self._options.inputs([]) if (found := state_of(file)) is not None]
        if len(written) < len(outputs) or min(written) < max([state.mtime_ns, *depends]):
            return None
        lines = [str(line) for line in note_value(notes, DAMAGE, list)]
        return Entry(
            source.name,
            _url(source),
            state.size,
            state.etag or None,
            state.mtime_ns,
            self._parameters,
            __version__,
            DAMAGED if lines else OK,
            UnreadableError.exit_code if lines else 0,
            "; ".join(lines) or None,
            [*outputs],
            [found.size for output in outputs if (found := there.state(output)) is not None],
        )


def _is_below(folder: Place, name: str) -> bool:
    """Tell whether a name in a manifest is that of a file below its folder."""
    try:
        where = place(name)
    except OptionError:
        return False
    if isinstance(where, Url) and isinstance(folder, Url):
        inside = where.key.startswith(f"{folder.key}/" if folder.key else "")
        return inside and replace(where, key="") == replace(folder, key="")
    if isinstance(where, Path) and isinstance(folder, Path):
        return ".." not in where.parts and where.is_relative_to(folder.absolute())
    return False


def _url(source: Source | MissingInput) -> str:
    """Return the place of an input, independent of the working directory."""
    return absolute(source.path)


def parameters_hash(options: DetectOptions) -> str:
    """Hash everything that the tables of a log depend on, beside the log and the version."""
    digest = blake2b(digest_size=16)
    told = {**options.as_dict(), "tables": options.tables, "explain": options.explain, "layout": options.layout}
    digest.update(json.dumps(told, sort_keys=True, default=str).encode())
    # The options hold only the names of files.
    for file in options.inputs([]):
        digest.update(read_file(file))
    return digest.hexdigest()


def _as_before(source: Source | MissingInput, done: Entry) -> Outcome:
    """Return the outcome of a log in an earlier run."""
    return Outcome(
        source.label, done.exit_code, error=done.message if done.exit_code else None, source=source, skipped=True
    )


def _notes(name: str) -> dict[str, str]:
    try:
        return file_metadata(place(name))
    except UnreadableError:
        return {}


def _is_of(name: str, source: Source) -> bool:
    """Tell whether a file is a table of a log of this name, which may be replaced."""
    return bool(note_value(_notes(name), SOURCE, dict).get("name") == source.file_name)
