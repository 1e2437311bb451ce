"""A run over many logs into one folder of tables: what is to be done, and the manifest of what was done."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lidarcli._version import __version__
from lidarcli.errors import LidarcliError, OutputError, UnreadableError
from lidarcli.pipeline.detecting import DetectOptions
from lidarcli.pipeline.fleet.manifest import Manifest, read_entries
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.running.outcomes import Outcome
from lidarcli.stores.url import Place, State, Url, absolute, place
from lidarcli.tables import metadata
from lidarcli.tables.files import BY_DATE
from lidarcli.tables.reading import file_metadata, parsed
from lidarcli.tables.runs import DAMAGED, FAILED, OK, Entry, newest

_DAY = re.compile(r"/date=[^/]*/")
ASKED_AT_ONCE = 16
"""Requests for what a store knows of an object: each takes tens of milliseconds."""

Sources = Sequence[Source | Nothing]


@dataclass(frozen=True, slots=True)
class Step:
    """What a run does with one input."""

    source: Source | Nothing
    outputs: tuple[tuple[str, bool], ...] = ()
    """Files that are written, as far as they are known before reading, and whether they are there."""
    done: Entry | None = None
    """What says that it was done already; then nothing is read."""


@dataclass(slots=True)
class Plan:
    """What a run does, and what a user should know of how that was found out."""

    steps: list[Step]
    notes: list[str] = field(default_factory=list)

    @property
    def left(self) -> list[Source | Nothing]:
        """What is still to be done."""
        return [step.source for step in self.steps if step.done is None]

    @property
    def skipped(self) -> list[Outcome]:
        """What was done before, with the exit code that it had then."""
        return [_as_before(step.source, step.done) for step in self.steps if step.done is not None]


class FolderRun:
    """One run of `detect` or `track` over many logs into a folder of tables.

    Parameters
    ----------
    folder : where the tables go
    options : of the detection
    keeps_manifest : whether what becomes of each log is written down
    """

    def __init__(self, folder: Place, options: DetectOptions, keeps_manifest: bool) -> None:
        self._folder = folder
        self._options = options
        self._parameters = parameters_hash(options)
        self._manifest = Manifest(folder) if keeps_manifest else None

    def plan(self, sources: Sources, resume: bool, overwrite: bool) -> Plan:
        """What to do with each log; with `resume`, those that were done with the same parameters and version are left out.

        Whether a log was done is told by the manifests, or, where these are lost, by the tables themselves. What is done
        again may replace its own tables, and others only with `overwrite`.
        """
        if not resume:
            return Plan([Step(source) for source in sources])
        entries, problems = read_entries(self._folder)
        # What failed later, as for tables that were there, leaves these as they are.
        by_url = newest(entry for entry in entries if entry.is_done)
        told_of = {entry.url for entry in entries}
        mine = {output for entry in entries for output in entry.outputs}
        there = _There(self._folder)
        plan = Plan([], [f"{problem}; not used" for problem in problems])
        for source in known(sources):
            if isinstance(source, Nothing):
                plan.steps.append(Step(source))
                continue
            outputs = tuple(map(absolute, self._outputs(source)))
            done = by_url.get(url_of(source))
            if done is not None and not (
                self._is_same(done) and _is_unchanged(source, done) and all(map(there, done.outputs))
            ):
                done = None
            elif done is None and url_of(source) not in told_of and any(map(there, outputs)):
                done = self._told_by_tables(source, outputs, there)
            existing = self._existing(source, there) if done is None and not overwrite else []
            foreign = [out for out in existing if out not in mine and not _is_of(out, source)]
            if foreign:
                error = OutputError(
                    f"{foreign[0]} exists and is not of this log; use --overwrite to replace it"
                )
                plan.steps.append(Step(Nothing(source.path, error)))
                continue
            plan.steps.append(Step(source, done=done))
        return plan

    def refuse_existing(self, plan: Plan) -> None:
        """Refuse logs whose tables are there already, as each log does for itself where nobody else works on it.

        On a cluster a log may be done twice: what its first worker has written before it died is no reason to refuse it.
        """
        there = _There(self._folder)
        for index, step in enumerate(plan.steps):
            if isinstance(step.source, Source) and step.done is None:
                existing = next(iter(self._existing(step.source, there)), None)
                if existing is not None:
                    error = OutputError(
                        f"{existing} exists; use --overwrite to replace it, or -o to write elsewhere"
                    )
                    plan.steps[index] = Step(Nothing(step.source.path, error))

    def dry(self, plan: Plan) -> Iterator[Step]:
        """The steps of a plan, with what is in their way."""
        there = _There(self._folder)
        for step in plan.steps:
            if isinstance(step.source, Source):
                outputs = self._outputs(step.source)
                yield replace(step, outputs=tuple((output, there(absolute(output))) for output in outputs))
            else:
                yield step

    def record(self, outcome: Outcome) -> None:
        """Write down what became of one log."""
        source = outcome.source
        if self._manifest is None or outcome.skipped or source is None:
            return
        state = source.state() if isinstance(source, Source) else None
        summary = outcome.summary
        words = outcome.error or (
            "; ".join(summary.damage) if summary is not None and summary.damage else None
        )
        result = FAILED if summary is None else DAMAGED if summary.damage else OK
        self._manifest.add(
            Entry(
                log=source.name if isinstance(source, Source) else source.path,
                url=url_of(source),
                size=state.size if state else None,
                etag=(state.etag or None) if state else None,
                mtime=(state.mtime_ns or None) if state else None,
                parameters=self._parameters,
                version=__version__,
                outcome=result,
                exit_code=outcome.exit_code,
                message=words,
                outputs=[absolute(output) for output in summary.outputs] if summary else [],
                sweeps=summary.sweeps if summary else None,
                rows=summary.rows if summary else None,
                seconds=summary.seconds if summary else None,
            )
        )

    @property
    def manifest(self) -> Place | None:
        """Where it is, if there is one."""
        return None if self._manifest is None else self._manifest.path

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        """Write the manifest, also of a run that was broken off."""
        if self._manifest is None:
            return
        # What broke the run off is told, not what that does to the manifest.
        with suppress(*([LidarcliError] if kind is not None else [])):
            self._manifest.write()

    def _outputs(self, source: Source) -> tuple[str, ...]:
        if self._options.layout == BY_DATE:
            return ()
        return tuple(str(path) for path in self._options.outputs(source, self._folder).values())

    def _existing(self, source: Source, there: _There) -> list[str]:
        """The tables of a log that are there already."""
        if self._options.layout == BY_DATE:
            folders = [self._folder / table for table in self._options.tables]
            return [found for folder in folders for found in there.of_any_day(folder, source.name)]
        return [*filter(there, map(absolute, self._outputs(source)))]

    def _is_same(self, entry: Entry) -> bool:
        return entry.parameters == self._parameters and entry.version == __version__

    def _told_by_tables(self, source: Source, outputs: tuple[str, ...], there: _There) -> Entry | None:
        """That tables without a manifest are of this log as it is now, and of these parameters."""
        options, state = self._options, source.state()
        notes = _notes(outputs[0])
        if state is None or not all(map(there, outputs)) or notes.get(metadata.VERSION) != __version__:
            return None
        told = _parsed(notes, metadata.SOURCE)
        told_options = _parsed(notes, metadata.PARAMETERS)
        if not isinstance(told, dict) or (told.get("name"), told.get("size")) != (
            source.file_name,
            state.size,
        ):
            return None
        if told_options != json.loads(json.dumps(options.as_dict())) or options.explain:
            return None
        # As make does it: what the tables depend on is older than they are.
        written = [found.mtime_ns for output in outputs if (found := _state(output)) is not None]
        depends = [found.mtime_ns for file in options.inputs([]) if (found := _state(file)) is not None]
        if len(written) < len(outputs) or min(written) < max([state.mtime_ns, *depends]):
            return None
        damage = _parsed(notes, metadata.DAMAGE)
        lines = [str(line) for line in damage] if isinstance(damage, list) else []
        return Entry(
            source.name,
            url_of(source),
            state.size,
            state.etag or None,
            state.mtime_ns,
            self._parameters,
            __version__,
            DAMAGED if lines else OK,
            UnreadableError.exit_code if lines else 0,
            "; ".join(lines) or None,
            [*outputs],
        )


def keyed_states(sources: Sequence[Source]) -> list[Source]:
    """The same logs with what their stores know of them, asked for several at the same time."""
    from lidarcli.stores.store import head

    def asked(source: Source) -> Source:
        url = source.url
        try:
            found = head(url) if url is not None else None
        except LidarcliError:
            # Reading it says what is wrong.
            return source
        return replace(source, found=found)

    with ThreadPoolExecutor(ASKED_AT_ONCE, "ask") as pool:
        return [*pool.map(asked, sources)]


def known(sources: Sources) -> Sources:
    """The same inputs; of objects that were only listed it is known now what their stores know."""
    unknown = [
        source
        for source in sources
        if isinstance(source, Source) and source.url is not None and source.found is None
    ]
    if not unknown:
        return sources
    found = dict(zip(unknown, keyed_states(unknown), strict=True))
    return [found.get(source, source) if isinstance(source, Source) else source for source in sources]


def url_of(source: Source | Nothing) -> str:
    """Where an input is, whatever the working directory."""
    return absolute(source.path)


def parameters_hash(options: DetectOptions) -> str:
    """One word for everything that the tables of a log depend on, beside the log and the version."""
    digest = blake2b(digest_size=16)
    told = {
        **options.as_dict(),
        "tables": options.tables,
        "explain": options.explain,
        "layout": options.layout,
    }
    digest.update(json.dumps(told, sort_keys=True, default=str).encode())
    # Of files only names stand there.
    for file in options.inputs([]):
        where = place(file)
        if isinstance(where, Url):
            from lidarcli.stores.store import read_object

            digest.update(read_object(where))
        else:
            digest.update(where.read_bytes())
    return digest.hexdigest()


def _as_before(source: Source | Nothing, done: Entry) -> Outcome:
    """What became of a log in an earlier run."""
    return Outcome(
        source.label,
        done.exit_code,
        error=done.message if done.exit_code else None,
        source=source,
        skipped=True,
    )


def _is_unchanged(source: Source, done: Entry) -> bool:
    """Whether a log is what it was: of the same size, and of the same time or the same mark of its content."""
    state = source.state()
    if state is None or state.size != done.size:
        return False
    if state.mtime_ns == done.mtime:
        return True
    if not done.etag or source.url is None or source.files:
        return False
    etag = state.etag or next((it.found.etag for it in keyed_states([source]) if it.found is not None), "")
    return etag == done.etag


class _There:
    """Which files are there; of a store all names below the folder are asked for at once."""

    def __init__(self, folder: Place) -> None:
        self._names: set[str] | None = None
        self._dated: dict[str, str] = {}
        if isinstance(folder, Url):
            from lidarcli.stores.store import listing

            self._names = {str(url) for url, _ in listing(folder)}
            self._dated = {_DAY.sub("/", name): name for name in self._names}

    def __call__(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return name in self._names if self._names is not None else Path(name).exists()

    def of_any_day(self, path: Place, log: str) -> list[str]:
        """Files of a log below the folder of a table, whichever the day is that they are filed under."""
        if isinstance(path, Url):
            name = self._dated.get(absolute(path / f"{log}.parquet"))
            return [name] if name is not None else []
        days = path.glob("date=*")
        return [str(found.absolute()) for day in days if (found := day / f"{log}.parquet").exists()]


def _state(name: str) -> State | None:
    where = place(name)
    if isinstance(where, Url):
        from lidarcli.stores.store import head

        return head(where)
    return Source(name, "").state()


def _notes(name: str) -> dict[str, str]:
    try:
        return file_metadata(place(name))
    except UnreadableError:
        return {}


def _is_of(name: str, source: Source) -> bool:
    """Whether a file is a table of a log of this name, whose place it may take."""
    told = _parsed(_notes(name), metadata.SOURCE)
    return isinstance(told, dict) and told.get("name") == source.file_name


def _parsed(notes: dict[str, str], key: str) -> Any:
    try:
        return parsed(notes.get(key, "null"))
    except ValueError:
        return None
