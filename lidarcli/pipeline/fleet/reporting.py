"""Manifests in, a report on the runs that wrote them out: what became of each log."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lidarcli.errors import LidarcliError, OptionError, UnreadableError
from lidarcli.pipeline.fleet.manifest import FOLDER
from lidarcli.pipeline.inputs.files import Named, all_files, files_named
from lidarcli.reports.checks import Check, accepts, parse_check, verdict_of
from lidarcli.reports.runs import BAD, FIGURES, RunsReport, RunsSummary, summarise_runs
from lidarcli.reports.wording import counted
from lidarcli.stores.url import Place, absolute, place
from lidarcli.tabular.runs import Entry, read_run

SUFFIX = ".parquet"


@dataclass(frozen=True, slots=True)
class MadeRuns:
    """A report on runs."""

    report: RunsReport


def is_of_runs(text: str) -> bool:
    """Whether a name is that of manifests: their folder, files in it, or a pattern of either.

    >>> [is_of_runs(name) for name in ("tables/_lidarcli", "tables/_lidarcli/*.parquet", "tables")]
    [True, True, False]
    """
    named = place(text)
    named = named.absolute() if isinstance(named, Path) else named
    is_file = named.suffix == SUFFIX or glob.has_magic(named.name)
    return named.name == FOLDER or (named.parent.name == FOLDER and is_file)


def manifest_files(inputs: Iterable[str]) -> tuple[list[Place], list[UnreadableError]]:
    """The manifests that folders, files and patterns name, each once, and what is none."""
    found: dict[str, Place] = {}
    problems = []
    for text in inputs:
        try:
            found |= {absolute(file): file for file in _files(text)}
        except UnreadableError as err:
            problems.append(err)
    return [*found.values()], problems


def understand_runs(checks: Iterable[str]) -> list[Check]:
    """The checks, or a usage error before any work is done."""
    return [parse_check(text, only=FIGURES) for text in checks]


def report_runs(
    inputs: Iterable[str],
    checks: Iterable[str] = (),
    progress: Callable[[int, int], None] | None = None,
) -> MadeRuns:
    """Read the manifests and make the report; `progress` is called with the number of those done, and of all.

    Raises
    ------
    UnreadableError
        None of the manifests can be read.
    """
    gates = understand_runs(checks)
    files, problems = manifest_files(inputs)
    rows: list[Entry] = []
    read = 0
    for done, file in enumerate(files):
        if progress is not None:
            progress(done, len(files))
        try:
            rows += read_run(file)
        except UnreadableError as err:
            problems.append(err)
            continue
        read += 1
    if not read:
        raise nothing_read(problems)
    summary = summarise_runs(rows, read)
    verdicts = tuple(verdict_of(check, summary.figures[check.name]) for check in gates)
    unread, unseen = tuple(map(str, problems)), _unseen(gates, summary)
    return MadeRuns(RunsReport(summary, verdicts=verdicts, unread=unread, unseen=unseen))


def _unseen(checks: Sequence[Check], summary: RunsSummary) -> tuple[str, ...]:
    """A line for logs that are missing where checks judge the others, and none says how many of these there may be."""
    return tuple(
        f"{counted(count, 'log')} {outcome}: the checks saw what is left; --check '{outcome} <= {count:.0f}' accepts that"
        for outcome in BAD
        if checks and (count := summary.figures[outcome] or 0.0) and not accepts(checks, outcome)
    )


def nothing_read(problems: Sequence[UnreadableError]) -> LidarcliError:
    """The error where there is nothing to report on."""
    if not problems:
        return OptionError("no tables to report on")
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return UnreadableError(f"{problems[0]}{more}")


def render_runs(report: RunsReport, kind: str, colour: bool = False) -> str:
    """The report in one of the formats of reports."""
    if kind == "text":
        from lidarcli.reports import runs_text

        return runs_text.render(report, colour)
    if kind == "markdown":
        from lidarcli.reports import runs_markdown

        return runs_markdown.render(report)
    if kind == "html":
        from lidarcli.reports import runs_html

        return runs_html.render(report)
    from lidarcli.reports import ci, json

    return json.render(report) if kind == "json" else ci.as_junit(report)


def _files(text: str) -> list[Place]:
    kind, files, denied = files_named(text)
    if kind is Named.FILE:
        return files
    if denied:
        raise denied[0]
    found = [manifest for file in files for manifest in _manifests(file)]
    if not found:
        where = "in this folder" if kind is Named.FOLDER else "matches this pattern"
        raise UnreadableError(f"{text}: no manifest {where}; detect --resume writes one")
    return found


def _manifests(file: Place) -> list[Place]:
    """A pattern may also name folders."""
    if isinstance(file, Path) and file.is_dir():
        return all_files(file, SUFFIX)
    return [file] if file.suffix == SUFFIX else []
