"""`lidarcli.report`: runs as people look at them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any, Unpack

from lidarcli.errors import warn
from lidarcli.newfiles import refuse, write_whole
from lidarcli.options import Changed, Paths, Reporting, TableOrPath, Tables
from lidarcli.pipeline.api.options import several, with_keywords
from lidarcli.pipeline.inputs.search import files_of, find_logs
from lidarcli.pipeline.inputs.tables import table_files, tables_of
from lidarcli.pipeline.reporting import Made, ReportOptions, encoded, format_of, make_report, render, understand
from lidarcli.reports.checks import Verdict
from lidarcli.reports.document import PartsReport
from lidarcli.reports.programs import as_dict
from lidarcli.stores.url import place

HEIGHT = 720
"""Height of the report in a notebook [px]."""


@dataclass(frozen=True, slots=True, repr=False)
class RunReport:
    """Report on one or many runs. `print` shows it as text, a notebook as the page with the viewer of the sweeps.

    Attributes
    ----------
    figures : every figure by its name, as checks name it; None where it cannot be measured
    checks : one verdict for each check: `expression`, `holds`, `expected`, `found`
    problems : what could not be read, and damage that no check accepts, one line each
    """

    _made: Made
    _asked: ReportOptions

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Every figure by its name, as checks name it; with a baseline also its change, `delta.NAME`."""
        return {**self._made.report.figures}

    @property
    def checks(self) -> tuple[Verdict, ...]:
        """One verdict for each check."""
        return self._made.report.verdicts

    @property
    def problems(self) -> tuple[str, ...]:
        """Files that could not be read, and damage that no check accepts, one line each."""
        return self._made.report.problems

    @property
    def holds(self) -> bool:
        """True if every check holds, and all of the data could be read."""
        return self._made.report.holds

    def as_dict(self) -> dict[str, Any]:
        """Everything as plain values: the JSON schema of docs/reports.md."""
        return as_dict(self._made.report)

    def __repr__(self) -> str:
        report, figures = self._made.report, self.figures
        held = sum(verdict.holds for verdict in self.checks)
        judged = f", {held} of {len(self.checks)} checks hold" if self.checks else ""
        if isinstance(report, PartsReport):
            return f"<report on {report.lines[0]}{judged}>"
        return f"<report on {report.title}: {figures['sweeps']:,.0f} sweeps, {figures['objects']:,.0f} objects{judged}>"

    def __str__(self) -> str:
        return render(self._made, "text")

    def _repr_html_(self) -> str:
        # Who only looks at figures does not wait for what the viewer shows.
        made = self._made if self._made.page is not None else make_report(self._asked, viewer=True)
        # The page is a document of its own, with a style and a script that are not to meet the notebook's.
        page = escape(render(made, "html"), quote=True)
        return (
            f'<iframe srcdoc="{page}" sandbox="allow-scripts allow-downloads" '
            f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
        )


@with_keywords
def report(
    tables: Tables | Changed | Iterable[TableOrPath | Changed], output: Paths = (), **options: Unpack[Reporting]
) -> RunReport:
    """The figures of one or many runs, held against checks, from tables that are in memory or in files.

    Parameters
    ----------
    tables : what `detect`, `track`, `tables`, `zones` or `diff` returned, or such tables, as Arrow tables or data frames;
        paths of objects, sweeps or tracks tables (the others of a log are found beside each), of tables of changes, folders
        or patterns; or several of all
    output : files to write, replaced where they exist, each in the format that its suffix says: .txt, .md, .html, .json
        or .xml (JUnit); by default none

    Returns
    -------
    RunReport
        `figures`, `checks` and `holds`; a check that does not hold is no error.

    Raises
    ------
    UnreadableError
        None of the tables can be read, or the baseline cannot.
    TypeError
        Something is neither a path nor a table.
    OptionError
        A table in memory is none of lidarcli, or its others are missing; a check cannot be understood, or a suffix names
        no format.
    OutputError
        A file cannot be written.
    """
    check = options["check"]
    asked = ReportOptions(
        tables=tuple(tables_of(tables)),
        checks=(check,) if isinstance(check, str) else tuple(check),
        baseline=tuple(tables_of(options["baseline"])),
        logs=tuple(several(options["log"])),
        join=options["join"],
    )
    understand(asked)
    files = {place(name): format_of(place(name)) for name in several(output)}
    read = map(str, table_files(each for each in (*asked.tables, *asked.baseline) if isinstance(each, str)))
    refuse(files, True, [*read, *files_of(find_logs(asked.logs))], devices=True)
    made = make_report(asked, viewer="html" in files.values())
    for problem in made.report.problems:
        warn(problem)
    for file, form in files.items():
        for note in write_whole(file, encoded(render(made, form)), overwrite=True, devices=True):
            warn(note)
    return RunReport(made, asked)
